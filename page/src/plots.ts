/** Plots over time that are linked: one cursor, one range of time, one mark of the playback's time. */

import uPlot from "uplot";
import type { Line, PageData, Plot } from "./data";
import { float32 } from "./packing";
import { colour } from "./palette";

export const DASHES: number[][] = [[], [10, 4], [3, 3], [12, 4, 3, 4], [18, 6], [6, 6]];
const HEIGHT = 220;
const GREY = "#888888";

/** A CSS variable of the page, so that plots follow the theme. */
export function themed(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

function digits(value: number | null, unit: string): string {
  return value === null || value === undefined ? "–" : `${value.toPrecision(4)}${unit ? ` ${unit}` : ""}`;
}

function seriesOf(line: Line, unit: string): uPlot.Series {
  const value = (_: uPlot, number: number | null) => digits(number, unit);
  if (line.kind === "band") return { label: line.label, stroke: GREY, fill: `${GREY}44`, width: 1, value };
  if (line.kind === "limit") return { label: line.label, stroke: GREY, dash: [6, 4], width: 1.5, value };
  return { label: line.label, stroke: colour(line.colour), dash: DASHES[line.dash % DASHES.length], width: 2, value };
}

/** Ticks of a logarithmic axis: whole decades, every third where there are many. */
function decades(_: uPlot, __: number, low: number, high: number): number[] {
  const first = Math.floor(Math.log10(low));
  const last = Math.ceil(Math.log10(high));
  const every = last - first > 8 ? 3 : 1;
  const ticks: number[] = [];
  for (let exponent = Math.ceil(first / every) * every; exponent <= last; exponent += every) ticks.push(10 ** exponent);
  return ticks;
}

const LOGARITHMIC: uPlot.Axis = {
  splits: decades,
  filter: (_, splits) => splits,
  values: (_, splits) => splits.map((value) => `1e${Math.round(Math.log10(value))}`),
};

export class Plots {
  private plots: { plot: uPlot; mark: HTMLElement; box: HTMLElement }[] = [];
  private time = 0;
  private zooming = false;

  private constructor(
    private readonly described: Plot[],
    private readonly columns: (number | null)[][][],
    private readonly times: number[],
    private readonly box: HTMLElement,
    private readonly key: string,
    private readonly choose: (time: number) => void,
  ) {
    this.rebuild();
    new ResizeObserver(() => this.resize()).observe(box);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.rebuild());
    addEventListener("beforeprint", () => this.rebuild());
    addEventListener("afterprint", () => this.rebuild());
  }

  static async open(
    page: PageData, described: Plot[], times: Float32Array, box: HTMLElement, key: string, choose: (time: number) => void,
  ): Promise<Plots> {
    const columns: (number | null)[][][] = [];
    for (const plot of described) {
      const lines: (number | null)[][] = [];
      for (const line of plot.lines) {
        const values = await float32(page, line.values);
        lines.push(Array.from(times, (_, k) => (k < values.length && Number.isFinite(values[k]) ? values[k] : null)));
      }
      columns.push(lines);
    }
    return new Plots(described, columns, Array.from(times), box, key, choose);
  }

  private rebuild(): void {
    for (const { plot } of this.plots) plot.destroy();
    this.plots = [];
    this.box.replaceChildren();
    const boxes = this.described.map((described) => {
      const figure = document.createElement("figure");
      const caption = document.createElement("figcaption");
      caption.textContent = described.unit ? `${described.title}, ${described.unit}` : described.title;
      figure.append(caption);
      this.box.append(figure);
      return figure;
    });
    this.described.forEach((described, index) => this.add(described, this.columns[index], boxes[index]));
    this.setTime(this.time);
  }

  private add(described: Plot, columns: (number | null)[][], box: HTMLElement): void {
    const axis: uPlot.Axis = {
      stroke: themed("--ink"),
      grid: { stroke: themed("--line"), width: 1 },
      ticks: { stroke: themed("--line"), width: 1 },
      font: "12px system-ui, sans-serif",
    };
    const options: uPlot.Options = {
      width: Math.max(260, box.clientWidth),
      height: HEIGHT,
      cursor: { sync: { key: this.key, scales: ["x", null] }, drag: { x: true, y: false } },
      scales: { x: { time: false }, y: described.logarithmic ? { distr: 3 } : {} },
      axes: [
        { ...axis, values: (_, splits) => splits.map((value) => `${value} s`) },
        { ...axis, size: 66, ...(described.logarithmic ? LOGARITHMIC : {}) },
      ],
      series: [
        { label: "time", value: (_, value) => digits(value, "s") },
        ...described.lines.map((line) => seriesOf(line, described.unit)),
      ],
      hooks: { setScale: [(plot, scale) => this.follow(plot, scale)], draw: [() => this.setTime(this.time)] },
    };
    const plot = new uPlot(options, [this.times, ...columns] as uPlot.AlignedData, box);
    const mark = document.createElement("div");
    mark.className = "now";
    plot.over.append(mark);
    plot.over.addEventListener("click", (event) => this.choose(plot.posToVal(event.offsetX, "x")));
    this.plots.push({ plot, mark, box });
  }

  /** Take over the range of time that was chosen in another plot. */
  private follow(from: uPlot, scale: string): void {
    const { min, max } = from.scales.x;
    if (scale !== "x" || this.zooming || min === undefined || max === undefined || min === null || max === null) return;
    this.zooming = true;
    for (const { plot } of this.plots) if (plot !== from) plot.setScale("x", { min, max });
    this.zooming = false;
  }

  private resize(): void {
    for (const { plot, box } of this.plots) {
      const width = Math.max(260, box.clientWidth);
      if (width !== plot.width) plot.setSize({ width, height: HEIGHT });
    }
  }

  /** Move the mark of the playback's time. */
  setTime(time: number): void {
    this.time = time;
    for (const { plot, mark } of this.plots) {
      const left = plot.valToPos(time, "x");
      const inside = left >= 0 && left <= plot.over.clientWidth;
      mark.hidden = !inside;
      mark.style.left = `${left}px`;
    }
  }
}
