/** Plots of a study: figures over the timestep or over time, with intervals and single values; those over the same axis are linked. */

import uPlot from "uplot";
import type { Chart, Mark, Series } from "./data";
import { colour } from "./palette";
import { DASHES, themed } from "./plots";

const HEIGHT = 300;
const PADDING = 1.15;
const ELSEWHERE = [5, 5];
const CAP = 4;
const DOT = 1.6;

function plain(value: number): string {
  return String(Number(value.toPrecision(4)));
}

function told(mark: Mark | undefined, unit: string): string {
  if (mark === undefined) return "–";
  const interval = mark.low === null || mark.high === null ? "" : ` (${plain(mark.low)} to ${plain(mark.high)})`;
  return `${plain(mark.value)}${unit ? ` ${unit}` : ""}${interval}`;
}

/** Ticks of a logarithmic axis: 1, 2, 5 of each decade, or whole decades where there are many. */
function ticks(low: number, high: number): number[] {
  const steps = Math.log10(high / low) > 2.5 ? [1] : [1, 2, 5];
  const made: number[] = [];
  for (let exponent = Math.floor(Math.log10(low)); exponent <= Math.ceil(Math.log10(high)); exponent++)
    for (const step of steps) {
      const value = Number((step * 10 ** exponent).toPrecision(1));
      if (value >= low && value <= high) made.push(value);
    }
  return made;
}

/** The values of a logarithmic axis that have room for a label. */
function spaced(values: number[], low: number, high: number, width: number): number[] {
  const least = (36 / Math.max(120, width)) * Math.log(high / low);
  const kept: number[] = [];
  for (const value of values)
    if (value >= low && value <= high && (kept.length === 0 || Math.log(value / kept[kept.length - 1]) > least)) kept.push(value);
  return kept;
}

class ChartPlot {
  readonly plot: uPlot;
  private readonly places: number[];
  private readonly found: Map<number, Mark>[];

  constructor(
    readonly chart: Chart, readonly box: HTMLElement, private readonly ends: [number, number], key: string, follow: (plot: ChartPlot) => void,
  ) {
    const xs = new Set<number>();
    for (const series of chart.series) for (const mark of series.marks) xs.add(mark.x);
    this.places = [...xs].sort((a, b) => a - b);
    this.found = chart.series.map((series) => new Map(series.marks.map((mark) => [mark.x, mark])));
    const columns = this.found.map((marks) => this.places.map((x) => marks.get(x)?.value ?? null));
    const axis: uPlot.Axis = {
      stroke: themed("--ink"),
      grid: { stroke: themed("--line"), width: 1 },
      ticks: { stroke: themed("--line"), width: 1 },
      font: "12px system-ui, sans-serif",
      labelFont: "12px system-ui, sans-serif",
    };
    const logX: uPlot.Axis = chart.x.logarithmic
      ? { splits: (_, __, low, high) => spaced(this.places, low, high, box.clientWidth), filter: (_, splits) => splits }
      : {};
    const logY: uPlot.Axis = chart.logarithmic
      ? { splits: (_, __, low, high) => ticks(low, high), filter: (_, splits) => splits }
      : {};
    this.plot = new uPlot(
      {
        width: Math.max(260, box.clientWidth),
        height: HEIGHT,
        cursor: { sync: { key, scales: ["x", null] }, drag: { x: true, y: false } },
        scales: {
          x: { time: false, ...(chart.x.logarithmic ? { distr: 3 as const } : {}), range: (_, low, high) => this.padded(low, high) },
          y: { ...(chart.logarithmic ? { distr: 3 as const } : {}), range: () => this.range() },
        },
        axes: [
          { ...axis, label: chart.x.unit ? `${chart.x.label}, ${chart.x.unit}` : chart.x.label, labelSize: 18, values: (_, splits) => splits.map(plain), ...logX },
          { ...axis, size: 62, values: (_, splits) => splits.map(plain), ...logY },
        ],
        series: [
          { label: chart.x.label, value: (_, value) => (value === null ? "–" : `${plain(value)} ${chart.x.unit}`.trim()) },
          ...chart.series.map((series, index) => this.series(series, index)),
        ],
        hooks: { setScale: [(_, scale) => scale === "x" && follow(this)], draw: [(plot) => this.draw(plot)] },
      },
      [this.places, ...columns] as uPlot.AlignedData,
      box,
    );
  }

  private series(series: Series, index: number): uPlot.Series {
    const own = colour(series.colour);
    const elsewhere = series.kind === "elsewhere";
    return {
      label: series.label,
      stroke: own,
      width: elsewhere ? 1.5 : 2,
      dash: elsewhere ? ELSEWHERE : DASHES[series.dash % DASHES.length],
      spanGaps: true,
      points: { show: series.kind !== "steps", size: 7, stroke: own, fill: elsewhere ? themed("--paper") : own },
      ...(series.kind === "steps" && uPlot.paths.stepped ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}),
      value: (_, __, ___, at) => (at === null || at === undefined ? "–" : told(this.found[index].get(this.places[at]), this.chart.unit)),
    };
  }

  /** All of the x axis has some room on both sides; a part that was chosen has none. */
  private padded(low: number, high: number): [number, number] {
    const [first, last] = this.ends;
    if (low > first || high < last) return [low, high];
    if (this.chart.x.logarithmic) return [first / PADDING, last * PADDING];
    const room = 0.02 * (last - first || 1);
    return [first - room, last + room];
  }

  /** The range of all values, with their intervals. */
  private range(): [number, number] {
    const values: number[] = [];
    for (const series of this.chart.series)
      for (const mark of series.marks) values.push(mark.value, mark.low ?? mark.value, mark.high ?? mark.value, ...mark.values);
    const positive = values.filter((value) => Number.isFinite(value) && (value > 0 || !this.chart.logarithmic));
    if (positive.length === 0) return [0.1, 1];
    const low = Math.min(...positive);
    const high = Math.max(...positive);
    if (this.chart.logarithmic) return [low / PADDING, high * PADDING];
    return [Math.min(0, low), high > 0 ? 1.05 * high : 1];
  }

  /** Intervals, single values, and vertical lines. */
  private draw(plot: uPlot): void {
    const { ctx } = plot;
    const ratio = devicePixelRatio;
    const { left, top, width, height } = plot.bbox;
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, top, width, height);
    ctx.clip();
    ctx.lineWidth = 1.5 * ratio;
    this.chart.series.forEach((series, index) => {
      if (plot.series[index + 1].show === false) return;
      ctx.strokeStyle = ctx.fillStyle = colour(series.colour);
      for (const mark of series.marks) {
        const x = plot.valToPos(mark.x, "x", true);
        if (mark.low !== null && mark.high !== null) {
          const low = plot.valToPos(mark.low, "y", true);
          const high = plot.valToPos(mark.high, "y", true);
          ctx.beginPath();
          for (const y of [low, high]) {
            ctx.moveTo(x - CAP * ratio, y);
            ctx.lineTo(x + CAP * ratio, y);
          }
          ctx.moveTo(x, low);
          ctx.lineTo(x, high);
          ctx.stroke();
        }
        ctx.globalAlpha = 0.55;
        mark.values.forEach((value, at) => {
          const aside = (at - (mark.values.length - 1) / 2) * 3 * ratio;
          ctx.beginPath();
          ctx.arc(x + aside, plot.valToPos(value, "y", true), DOT * ratio, 0, 2 * Math.PI);
          ctx.fill();
        });
        ctx.globalAlpha = 1;
      }
    });
    ctx.textAlign = "left";
    ctx.font = `${11 * ratio}px system-ui, sans-serif`;
    this.chart.limits.forEach((limit, index) => {
      const x = plot.valToPos(limit.x, "x", true);
      ctx.strokeStyle = ctx.fillStyle = colour(limit.colour);
      ctx.setLineDash((limit.elsewhere ? ELSEWHERE : []).map((part) => part * ratio));
      ctx.beginPath();
      ctx.moveTo(x, top);
      ctx.lineTo(x, top + height);
      ctx.stroke();
      ctx.fillStyle = themed("--ink");
      const wide = ctx.measureText(limit.label).width;
      const beside = x + 4 * ratio + wide > left + width ? x - wide - 4 * ratio : x + 4 * ratio;
      ctx.fillText(limit.label, beside, top + height - (8 + 14 * (index % 6)) * ratio);
    });
    ctx.restore();
  }

  /** Move the cursor to the next place of the x axis, or the one before. */
  step(by: number): void {
    const { plot, places } = this;
    const now = plot.cursor.idx ?? (by > 0 ? -1 : places.length);
    const next = Math.min(places.length - 1, Math.max(0, now + by));
    plot.setCursor({ left: plot.valToPos(places[next], "x"), top: plot.over.clientHeight / 2 }, true);
  }

  /** Show all of the x axis again. */
  all(): void {
    this.plot.setScale("x", { min: this.ends[0], max: this.ends[1] });
  }
}

export class Charts {
  private plots: ChartPlot[] = [];
  private zooming = false;

  constructor(private readonly described: Chart[], private readonly box: HTMLElement) {
    this.rebuild();
    new ResizeObserver(() => this.resize()).observe(box);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.rebuild());
    addEventListener("beforeprint", () => this.rebuild());
    addEventListener("afterprint", () => this.rebuild());
  }

  private rebuild(): void {
    for (const { plot } of this.plots) plot.destroy();
    this.plots = [];
    this.box.replaceChildren();
    const boxes = this.described.map((chart) => {
      const figure = document.createElement("figure");
      const caption = document.createElement("figcaption");
      caption.textContent = chart.unit ? `${chart.title}, ${chart.unit}` : chart.title;
      figure.append(caption);
      figure.tabIndex = 0;
      figure.setAttribute("aria-label", `plot: ${chart.title}`);
      this.box.append(figure);
      return figure;
    });
    this.zooming = true; // each begins with the whole range of its group
    this.described.forEach((chart, index) => {
      const key = `${this.box.id} ${chart.group}`;
      const plot = new ChartPlot(chart, boxes[index], this.ends(chart.group), key, (from) => this.follow(from));
      boxes[index].addEventListener("keydown", (event) => this.key(event, plot));
      this.plots.push(plot);
    });
    for (const plot of this.plots) plot.all();
    queueMicrotask(() => (this.zooming = false)); // plots announce their ranges at the end of this task
  }

  /** The first and last x of all plots of a group. */
  private ends(group: string): [number, number] {
    const xs = this.described
      .filter((chart) => chart.group === group)
      .flatMap((chart) => [...chart.series.flatMap((series) => series.marks.map((mark) => mark.x)), ...chart.limits.map((limit) => limit.x)]);
    return [Math.min(...xs), Math.max(...xs)];
  }

  private key(event: KeyboardEvent, plot: ChartPlot): void {
    if (event.key === "ArrowRight") plot.step(1);
    else if (event.key === "ArrowLeft") plot.step(-1);
    else if (event.key === "Escape") plot.all();
    else return;
    event.preventDefault();
  }

  /** Take over the range of x that was chosen in another plot of the same group. */
  private follow(from: ChartPlot): void {
    const { min, max } = from.plot.scales.x;
    if (this.zooming || min === undefined || max === undefined || min === null || max === null) return;
    this.zooming = true;
    for (const other of this.plots)
      if (other !== from && other.chart.group === from.chart.group) other.plot.setScale("x", { min, max });
    this.zooming = false;
  }

  private resize(): void {
    for (const { plot, box } of this.plots) {
      const width = Math.max(260, box.clientWidth);
      if (width !== plot.width) plot.setSize({ width, height: HEIGHT });
    }
  }

  /** The range of x that a plot shows. */
  shown(index: number): [number, number] {
    const { min, max } = this.plots[index].plot.scales.x;
    return [min ?? NaN, max ?? NaN];
  }
}
