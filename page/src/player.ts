/** The controls of one scene: time, speed, what is shown, the camera. */

import { chooseContacts, listContacts } from "./contacts";
import type { PageData, Scene } from "./data";
import { Kinematics } from "./kinematics";
import { float32 } from "./packing";
import { fill } from "./palette";
import { Plots } from "./plots";
import { Sliders } from "./sliders";
import { MODES } from "./solids";
import { Stage, VIEWS } from "./stage";

const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 30];
const EXAGGERATIONS = [1, 10, 100, 1000];
const NO_WEBGL = "This browser has no WebGL: there is no playback. The plots and tables show all the same.";
const TURN = Math.PI / 12;
const ZOOM = 0.8;

function button(text: string, label: string, press: () => void): HTMLButtonElement {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  if (label !== text) made.setAttribute("aria-label", label);
  made.addEventListener("click", press);
  return made;
}

function checkbox(text: string, checked: boolean, changed: (on: boolean) => void, colour?: number): HTMLLabelElement {
  const label = document.createElement("label");
  const box = document.createElement("input");
  box.type = "checkbox";
  box.checked = checked;
  box.addEventListener("change", () => changed(box.checked));
  label.append(box);
  if (colour !== undefined) {
    const dot = document.createElement("span");
    dot.className = "dot";
    fill(dot, colour);
    label.append(dot);
  }
  label.append(text);
  return label;
}

function group(name: string, ...parts: HTMLElement[]): HTMLElement {
  const made = document.createElement("div");
  made.className = "group";
  made.setAttribute("role", "group");
  made.setAttribute("aria-label", name);
  made.append(...parts);
  return made;
}

export class Player {
  time: number;
  private playing = false;
  private last = 0;
  private speed = 1;
  private plots: Plots | null = null;
  /** Of a scene that was not run. */
  joints: Sliders | null = null;
  private readonly slider = document.createElement("input");
  private readonly clock = document.createElement("output");
  private readonly play: HTMLButtonElement;

  private constructor(
    readonly scene: Scene,
    private readonly times: Float32Array,
    readonly stage: Stage | null,
  ) {
    this.time = times[0];
    this.play = button("Play", "Play", () => this.toggle());
  }

  static async open(page: PageData, scene: Scene, section: HTMLElement): Promise<Player> {
    const times = await float32(page, scene.times);
    const box = section.querySelector<HTMLElement>(".stage");
    const controls = section.querySelector<HTMLElement>(".controls");
    const charts = section.querySelector<HTMLElement>(".plots:not(.charts)");
    const joints = section.querySelector<HTMLElement>(".joints");
    const contacts = section.querySelector<HTMLDetailsElement>(".contacts");
    if (box === null || controls === null) throw new Error("the page's outline is incomplete");
    const kinematics = scene.runs.length ? null : new Kinematics(scene.model, scene.view.radius);
    const stage = await Stage.open(page, scene, times, box, kinematics);
    const player = new Player(scene, times, stage);
    if (stage === null) {
      box.classList.add("empty");
      box.textContent = NO_WEBGL;
    }
    player.build(controls);
    if (contacts !== null) listContacts(scene, stage, contacts);
    if (kinematics !== null && joints !== null) player.joints = new Sliders(scene, kinematics, stage, joints);
    if (charts !== null) player.plots = await Plots.open(page, scene.plots, times, charts, section.id, (time) => player.seek(time));
    player.seek(times[0]);
    section.addEventListener("keydown", (event) => player.key(event));
    return player;
  }

  private get end(): number {
    return this.times[this.times.length - 1];
  }

  private build(controls: HTMLElement): void {
    const { slider, scene, stage } = this;
    slider.type = "range";
    slider.min = "0";
    slider.max = String(this.times.length - 1);
    slider.step = "1";
    slider.className = "time";
    slider.setAttribute("aria-label", "time");
    slider.addEventListener("input", () => this.seek(this.times[Number(slider.value)]));
    const speed = document.createElement("select");
    speed.setAttribute("aria-label", "speed");
    for (const factor of SPEEDS) speed.add(new Option(`${factor}×`, String(factor), factor === 1, factor === 1));
    speed.addEventListener("change", () => (this.speed = Number(speed.value)));
    if (scene.runs.length) controls.append(group("playback", this.play, slider, this.clock, speed));
    if (stage === null) return;
    const show = (split: boolean) => {
      stage.split = split;
      together.setAttribute("aria-pressed", String(!split));
      apart.setAttribute("aria-pressed", String(split));
      stage.ask();
    };
    const together = button("overlaid", "overlaid", () => show(false));
    const apart = button("side by side", "side by side", () => show(true));
    const runs = scene.runs.map((run, index) =>
      checkbox(run.engine, true, (on) => {
        if (on) stage.shown.add(index);
        else stage.shown.delete(index);
        stage.ask();
      }, run.colour),
    );
    const shown = [...runs];
    if (scene.runs.some((run) => run.forces !== null))
      shown.push(checkbox("contact forces", true, (on) => { stage.showForces = on; stage.ask(); }));
    if (scene.ghost !== null)
      shown.push(checkbox("target of driven joints", true, (on) => { stage.showGhost = on; stage.ask(); }));
    const own = checkbox("own colours", stage.ownColours, (on) => { stage.ownColours = on; stage.ask(); });
    const larger = document.createElement("select");
    larger.setAttribute("aria-label", "differences drawn larger");
    for (const factor of EXAGGERATIONS) larger.add(new Option(`differences × ${factor}`, String(factor), factor === 1, factor === 1));
    larger.addEventListener("change", () => {
      stage.exaggeration = Number(larger.value);
      stage.ask();
    });
    if (scene.runs.length) controls.append(group("what is shown", ...(scene.runs.length > 1 ? [together, apart, larger, own] : []), ...shown));
    const again = <T>(change: (value: T) => void) => (value: T) => { change(value); stage.ask(); };
    const { marks } = stage;
    const { loads } = scene.model;
    const layers = document.createElement("select");
    layers.setAttribute("aria-label", "shapes");
    for (const mode of MODES) layers.add(new Option(`${mode === "both" ? "visual and collision" : mode} shapes`, mode));
    layers.addEventListener("change", again(() => (stage.mode = MODES[layers.selectedIndex])));
    const extras: HTMLElement[] = [layers, checkbox("frames", false, again((on) => (marks.frames = on)))];
    if (marks.moved.length) extras.push(checkbox("joint axes", false, again((on) => (marks.axes = on))));
    const choice = chooseContacts(scene, stage);
    if (choice !== null) extras.push(choice);
    if (loads.length) extras.push(checkbox("loads", true, again((on) => (marks.loads = on))));
    controls.append(group("layers", ...extras));
    const views = Object.keys(VIEWS).map((name) => button(name, `camera: ${name}`, () => stage.look(name)));
    const moves = [
      button("⟲", "camera: turn left", () => stage.turn(-TURN)),
      button("⟳", "camera: turn right", () => stage.turn(TURN)),
      button("+", "camera: nearer", () => stage.zoom(ZOOM)),
      button("−", "camera: away", () => stage.zoom(1 / ZOOM)),
    ];
    controls.append(group("camera", ...views, ...moves));
    show(false);
  }

  /** Show a time, clipped to the recorded ones. */
  seek(time: number): void {
    this.time = Math.min(this.end, Math.max(this.times[0], time));
    let frame = 0;
    while (frame + 1 < this.times.length && this.times[frame + 1] <= this.time) frame++;
    this.slider.value = String(frame);
    this.clock.textContent = `${this.time.toFixed(2)} s`;
    this.slider.setAttribute("aria-valuetext", this.clock.textContent);
    this.stage?.setTime(this.time);
    this.plots?.setTime(this.time);
  }

  private toggle(): void {
    this.playing = !this.playing;
    this.play.textContent = this.playing ? "Pause" : "Play";
    this.play.setAttribute("aria-label", this.playing ? "Pause" : "Play");
    if (!this.playing) return;
    if (this.time >= this.end) this.seek(this.times[0]);
    this.last = performance.now();
    requestAnimationFrame((now) => this.tick(now));
  }

  private tick(now: number): void {
    if (!this.playing) return;
    const passed = Math.max(0, now - this.last) / 1000;
    this.last = now;
    this.seek(this.time + passed * this.speed);
    if (this.time >= this.end) this.toggle();
    else requestAnimationFrame((next) => this.tick(next));
  }

  private key(event: KeyboardEvent): void {
    if (!this.scene.runs.length) return;
    const target = event.target as HTMLElement;
    if (event.key !== " " || ["BUTTON", "SELECT", "SUMMARY", "A"].includes(target.tagName)) return;
    if (target instanceof HTMLInputElement && target.type === "checkbox") return;
    event.preventDefault();
    this.toggle();
  }
}
