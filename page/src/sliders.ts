/** A slider for each coordinate of the joints of a scene that was not run. */

import type { Joint, Scene } from "./data";
import { type Kinematics, shown } from "./kinematics";
import type { Stage } from "./stage";

/** Sliders of joints that a page has, and free bodies that have some. */
const MOST_JOINTS = 200;
const MOST_FREE = 12;
const STEPS = 1000;
/** Of a slide without limits, and of a free body: so many radii of the scene from the start, both ways. */
const REACH = 2;
const TURNS = ["roll", "pitch", "yaw"];

interface Row {
  body: number;
  part: number;
  kind: Joint["kind"];
  input: HTMLInputElement;
  output: HTMLOutputElement;
}

export class Sliders {
  private readonly rows: Row[] = [];
  private readonly line = document.createElement("p");

  constructor(
    private readonly scene: Scene,
    private readonly kinematics: Kinematics,
    private readonly stage: Stage | null,
    box: HTMLElement,
  ) {
    const { joints } = scene.model;
    const adjustable = joints.filter(({ kind }) => kind === "hinge" || kind === "slide" || kind === "ball");
    const free = joints.filter(({ kind }) => kind === "free");
    if (!adjustable.length && (!free.length || free.length > MOST_FREE)) return;
    const head = document.createElement("div");
    head.className = "group";
    const title = document.createElement("strong");
    title.textContent = adjustable.length ? "Joints" : "Bodies";
    head.append(title, this.button("initial state", false));
    if (adjustable.length) head.append(this.button("all at zero", true));
    box.append(head);
    const grid = document.createElement("div");
    grid.className = "sliders";
    for (const joint of adjustable.slice(0, MOST_JOINTS)) this.addJoint(joint, grid);
    box.append(grid);
    if (adjustable.length > MOST_JOINTS) box.append(this.note(`The first ${MOST_JOINTS} of ${adjustable.length} joints have sliders.`));
    if (free.length && free.length <= MOST_FREE) {
      const more = document.createElement("details");
      const summary = document.createElement("summary");
      summary.textContent = free.length === 1 ? "Pose of the free body" : "Poses of the free bodies";
      const places = document.createElement("div");
      places.className = "sliders";
      for (const joint of free) this.addFree(joint, places);
      more.append(summary, places);
      box.append(more);
    }
    this.line.className = "broken";
    this.line.setAttribute("role", "status");
    box.append(this.line);
    this.update();
  }

  /** Put a joint, by its name, at a position; for scripts. */
  set(name: string, value: number, part = 0): void {
    const joint = this.scene.model.joints.find((other) => other.name === name);
    if (joint === undefined) throw new Error(`no joint ${name}`);
    this.move(joint.body, part, value);
  }

  private addJoint(joint: Joint, grid: HTMLElement): void {
    const { radius } = this.scene.view;
    if (joint.kind === "ball") {
      const reach = Math.min(Math.PI, joint.cone ?? Math.PI);
      TURNS.forEach((turn, part) => this.add(joint, part, `${joint.name} ${turn}`, -reach, reach, grid));
      return;
    }
    const reach = joint.kind === "hinge" ? Math.PI : REACH * radius;
    const [low, high] = joint.limits ?? [joint.start[0] - reach, joint.start[0] + reach];
    this.add(joint, 0, joint.name, low, high, grid);
  }

  private addFree(joint: Joint, grid: HTMLElement): void {
    const reach = REACH * this.scene.view.radius;
    const body = this.scene.bodies[joint.body];
    ["x", "y", "z"].forEach((axis, part) =>
      this.add(joint, part, `${body} ${axis}`, joint.start[part] - reach, joint.start[part] + reach, grid, "slide"),
    );
    TURNS.forEach((turn, part) => this.add(joint, 3 + part, `${body} ${turn}`, -Math.PI, Math.PI, grid, "hinge"));
  }

  private add(joint: Joint, part: number, name: string, low: number, high: number, grid: HTMLElement, kind = joint.kind): void {
    const label = document.createElement("label");
    label.className = "joint";
    const text = document.createElement("span");
    text.textContent = name;
    text.title = name;
    const input = document.createElement("input");
    input.type = "range";
    input.min = String(low);
    input.max = String(high);
    input.step = String((high - low) / STEPS || 1);
    input.disabled = this.kinematics.follows(joint.body);
    const output = document.createElement("output");
    const ends = `${shown(kind, low)} to ${shown(kind, high)}`;
    input.title = joint.limits === null ? `no limits; slider: ${ends}` : ends;
    input.addEventListener("input", () => this.move(joint.body, part, Number(input.value)));
    const point = (bodies: number[]) => () => this.stage?.highlight(bodies);
    for (const event of ["pointerenter", "focusin"]) label.addEventListener(event, point([joint.body]));
    for (const event of ["pointerleave", "focusout"]) label.addEventListener(event, point([]));
    if (input.disabled) text.append(this.note(" follows"));
    label.append(text, input, output);
    grid.append(label);
    this.rows.push({ body: joint.body, part, kind, input, output });
  }

  private move(body: number, part: number, value: number): void {
    const values = [...this.kinematics.values[body]];
    values[part] = value;
    this.kinematics.set(body, values);
    this.update();
  }

  private update(): void {
    for (const { body, part, kind, input, output } of this.rows) {
      const value = this.kinematics.values[body][part];
      input.value = String(value);
      output.textContent = shown(kind, value);
      input.setAttribute("aria-valuetext", output.textContent);
    }
    const broken = this.kinematics.broken();
    this.line.textContent = broken.length ? `Sliders move the tree only: ${broken.join("; ")}.` : "";
    this.stage?.ask();
  }

  private button(text: string, zero: boolean): HTMLButtonElement {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    made.addEventListener("click", () => {
      this.kinematics.reset(zero);
      this.update();
    });
    return made;
  }

  private note(text: string): HTMLElement {
    const made = document.createElement("small");
    made.className = "soft";
    made.textContent = text;
    return made;
  }
}
