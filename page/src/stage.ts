/** The playback of one scene: all runs overlaid, or side by side. Draws only when something changed. */

import {
  Box3, Color, DirectionalLight, GridHelper, Group, HemisphereLight, PerspectiveCamera, Quaternion, Scene as Space, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { PageData, RunData, Scene } from "./data";
import { ForceBars } from "./forces";
import type { Kinematics } from "./kinematics";
import { Marks } from "./marks";
import { colour, fill } from "./palette";
import { type Moment, momentOf, type Posed, Poses } from "./motion";
import { Geometries, type Mode, Solids } from "./solids";

const FIELD_OF_VIEW = 40;
/** Of the bodies of one run after the other, where several are at the same place: each is about as much of what is seen. */
const OVERLAID_OPACITY = [0.85, 0.52, 0.37, 0.29, 0.25, 0.22];
/** Of the other runs, where the first one has its own colours. */
const BEHIND_OPACITY = 0.7;
const GHOST_OPACITY = 0.25;
const GHOST_COLOUR = "#888888";
const HIGHLIGHT = "#f0e442";
const RELATED = "#56b4e9";
/** The ball that is looked at fills the view a bit more than wholly: most of what moves is nearer its centre. */
const FILLING = 0.8;
/** Around the box of a scene that was not run: with FILLING more than 1, so that a tall robot is whole. */
const ROOM = 1.3;
/** Longest bar of a contact force, of the radius of the view. */
const LONGEST_FORCE = 0.15;

/** Directions that the camera can look from. */
export const VIEWS: Record<string, [number, number, number]> = {
  fit: [0.62, -0.66, 0.42],
  front: [0, -1, 0.02],
  side: [1, 0, 0.02],
  top: [0, -0.001, 1],
};

const POSITION = new Vector3();
const QUATERNION = new Quaternion();
const FIRST_POSITION = new Vector3();
const FIRST_QUATERNION = new Quaternion();
const TURN = new Quaternion();
const AXIS = new Vector3();

/** Move POSITION and QUATERNION away from those of the first run, `factor` times as far as they are; a turn by half a turn at most. */
function exaggerate(factor: number): void {
  POSITION.sub(FIRST_POSITION).multiplyScalar(factor).add(FIRST_POSITION);
  TURN.copy(FIRST_QUATERNION).conjugate().premultiply(QUATERNION);
  if (TURN.w < 0) TURN.set(-TURN.x, -TURN.y, -TURN.z, -TURN.w);
  const sine = Math.hypot(TURN.x, TURN.y, TURN.z);
  if (sine === 0) return;
  const angle = Math.min(Math.PI, 2 * factor * Math.atan2(sine, TURN.w));
  TURN.setFromAxisAngle(AXIS.set(TURN.x, TURN.y, TURN.z).divideScalar(sine), angle);
  QUATERNION.copy(FIRST_QUATERNION).premultiply(TURN);
}

interface Actor {
  data: RunData;
  group: Group;
  solids: Solids;
  poses: Posed;
  forces: ForceBars | null;
}

/** A scene that was not run, as if it were one. */
const INITIAL: RunData = { engine: "", label: "", colour: 0, frames: 1, motion: null, forces: null };

export class Stage {
  split = false;
  showForces = true;
  showGhost = true;
  /** By how much the differences of the other runs from the first shown one are drawn larger than they are. */
  exaggeration = 1;
  mode: Mode = "visual";
  /** Whether overlaid the first shown run has the colours of its shapes, and the others are seen where they differ from it. */
  ownColours: boolean;
  readonly shown: Set<number>;
  readonly marks: Marks;
  private highlighted: ReadonlyMap<number, string> = new Map();
  private readonly runs: RunData[];
  private readonly space = new Space();
  private readonly camera = new PerspectiveCamera(FIELD_OF_VIEW, 2, 0.005, 500);
  private readonly controls: OrbitControls;
  private readonly actors: Actor[] = [];
  private still: Solids | null = null;
  private ghost: { solids: Solids; poses: Poses } | null = null;
  private moment: Moment = { frame: 0, share: 0 };
  private asked = false;
  private tags: HTMLElement[] = [];

  private constructor(
    private readonly page: PageData,
    private readonly scene: Scene,
    private readonly times: Float32Array,
    private readonly box: HTMLElement,
    private readonly renderer: WebGLRenderer,
    private readonly kinematics: Kinematics | null,
  ) {
    this.runs = kinematics === null ? scene.runs : [INITIAL];
    this.shown = new Set(this.runs.map((_, index) => index));
    this.marks = new Marks(scene);
    this.ownColours = scene.shapes.some((shape) => shape.hull?.low !== undefined);
    renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    renderer.domElement.setAttribute("aria-hidden", "true");
    box.append(renderer.domElement);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, renderer.domElement);
    this.controls.addEventListener("change", () => this.ask());
    new ResizeObserver(() => this.ask()).observe(box);
  }

  /** The stage, or null where the browser has no WebGL. `kinematics`: of a scene that was not run. */
  static async open(
    page: PageData, scene: Scene, times: Float32Array, box: HTMLElement, kinematics: Kinematics | null,
  ): Promise<Stage | null> {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    if (context === null) return null;
    const renderer = new WebGLRenderer({ canvas, context });
    const stage = new Stage(page, scene, times, box, renderer, kinematics);
    await stage.build();
    stage.look("fit");
    return stage;
  }

  private async build(): Promise<void> {
    const { scene, space, page } = this;
    const moving = new Set(scene.moving);
    space.add(new HemisphereLight("#ffffff", "#9a978c", 2.3));
    const sun = new DirectionalLight("#ffffff", 1.7);
    sun.position.set(3, -4, 8);
    space.add(sun);
    const geometries = new Geometries(page);
    this.still = await Solids.open(geometries, scene.shapes.filter((shape) => !moving.has(shape.body)));
    space.add(this.still.group);
    const movingShapes = scene.shapes.filter((shape) => moving.has(shape.body));
    for (const data of this.runs) {
      if (data.motion === null && this.kinematics === null) continue;
      const poses =
        this.kinematics ?? (data.motion && (await Poses.load(page, scene, data.motion, data.frames, scene.moving, scene.turning)));
      if (poses === null) continue;
      const forces = data.forces && (await ForceBars.load(page, scene, data.forces, colour(data.colour)));
      const actor: Actor = { data, group: new Group(), solids: await Solids.open(geometries, movingShapes), poses, forces };
      actor.group.add(actor.solids.group);
      if (forces) actor.group.add(forces.mesh);
      space.add(actor.group);
      this.actors.push(actor);
    }
    if (scene.ghost !== null) {
      const bodies = scene.ghost.bodies;
      const of = new Set(bodies);
      const poses = await Poses.load(page, scene, scene.ghost.motion, scene.frames, bodies, bodies);
      const solids = await Solids.open(geometries, scene.shapes.filter((shape) => of.has(shape.body)));
      this.ghost = { solids, poses };
      space.add(solids.group);
    }
    space.add(this.marks.group);
    this.addGrid();
  }

  private addGrid(): void {
    const { view, shapes, rest } = this.scene;
    const step = 10 ** Math.floor(Math.log10(view.radius));
    const lines = 2 * Math.ceil((2.5 * view.radius) / step);
    const grid = new GridHelper(lines * step, lines, "#8a8a85", "#a9a9a3");
    grid.rotation.x = Math.PI / 2;
    const level = shapes.find((shape) => shape.kind === "plane");
    const height = level ? rest[level.body][2] + level.position[2] : this.lowest();
    const snapped = (value: number) => Math.round(value / step) * step;
    grid.position.set(snapped(view.centre[0]), snapped(view.centre[1]), height - 0.001 * view.radius);
    this.space.add(grid);
  }

  /** The ball that is looked at; of a scene that was not run that of what moves, as sliders have it now. */
  private seen(): { centre: Vector3; radius: number } {
    const { view } = this.scene;
    const seen = { centre: new Vector3(...view.centre), radius: view.radius };
    if (this.kinematics === null) return seen;
    this.draw();
    const all = new Box3();
    for (const { solids } of this.actors) all.union(solids.box());
    if (all.isEmpty()) return seen;
    all.getCenter(seen.centre);
    return { centre: seen.centre, radius: ROOM * (all.getSize(new Vector3()).length() / 2) || seen.radius };
  }

  /** The level of the grid where there is no plane: below all of a scene that was not run, else 0. */
  private lowest(): number {
    if (this.kinematics === null) return 0;
    this.draw();
    const all = new Box3().setFromObject(this.space);
    return all.isEmpty() ? 0 : all.min.z;
  }

  /** Look from one of the directions in `VIEWS` at all there is to see. */
  look(direction: string): void {
    const { centre, radius } = this.seen();
    const aspect = Math.min(1, this.box.clientWidth / Math.max(1, this.box.clientHeight));
    const distance = (FILLING * radius) / Math.sin((FIELD_OF_VIEW * Math.PI) / 360) / aspect;
    this.controls.target.copy(centre);
    this.camera.position.set(...VIEWS[direction]).normalize().multiplyScalar(distance).add(this.controls.target);
    this.controls.update();
    this.ask();
  }

  /** Come nearer (factor < 1) or go away. */
  zoom(factor: number): void {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
    this.ask();
  }

  /** Go round what is looked at, by an angle in rad. */
  turn(angle: number): void {
    const arm = this.camera.position.sub(this.controls.target).applyAxisAngle(this.camera.up, angle);
    this.camera.position.copy(arm.add(this.controls.target));
    this.controls.update();
    this.ask();
  }

  setTime(time: number): void {
    this.moment = momentOf(this.times, time);
    this.ask();
  }

  /** The position (m) that is shown of a body, in a run. */
  position(run: number, body: number): number[] | null {
    const actor = this.actors.find(({ data }) => data === this.runs[run]);
    const first = this.actors.find(({ data }) => this.shown.has(this.runs.indexOf(data)));
    if (actor === undefined) return null;
    actor.poses.at(body, this.moment, POSITION, QUATERNION);
    if (first !== undefined && actor !== first && this.exaggeration !== 1) {
      first.poses.at(body, this.moment, FIRST_POSITION, FIRST_QUATERNION);
      exaggerate(this.exaggeration);
    }
    return POSITION.toArray();
  }

  /** Show which bodies are meant, and others in another colour. */
  highlight(bodies: number[], others: number[] = []): void {
    const colours = (chosen: number[], colour: string): [number, string][] => chosen.map((body) => [body, colour]);
    this.highlighted = new Map([...colours(others, RELATED), ...colours(bodies, HIGHLIGHT)]);
    this.ask();
  }

  /** The pose of a body that does not move. */
  private resting(body: number, position: Vector3, quaternion: Quaternion): void {
    const [x, y, z, qw, qx, qy, qz] = this.scene.rest[body];
    position.set(x, y, z);
    quaternion.set(qx, qy, qz, qw);
  }

  /** Draw at the next opportunity. */
  ask(): void {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
  }

  draw(): void {
    const on = this.actors.filter(({ data }) => this.shown.has(this.runs.indexOf(data)));
    const alone = this.split || on.length === 1;
    on.forEach((actor, order) => this.pose(actor, on[0], alone, order));
    const plain = { colour: null, opacity: 1, order: 0, hides: true, mode: this.mode, highlighted: this.highlighted };
    this.still?.appear(plain);
    this.still?.place((body, position, quaternion) => this.resting(body, position, quaternion));
    if (this.ghost !== null) {
      const { solids, poses } = this.ghost;
      solids.group.visible = this.showGhost;
      const mode = this.mode === "both" ? "visual" : this.mode;
      solids.appear({ ...plain, colour: GHOST_COLOUR, opacity: GHOST_OPACITY, hides: false, mode });
      solids.place((body, position, quaternion) => poses.at(body, this.moment, position, quaternion));
    }
    const leading: Posed = on[0]?.poses ?? { at: (body, _, position, quaternion) => this.resting(body, position, quaternion) };
    const time = this.kinematics === null ? this.times[this.moment.frame] : null;
    this.marks.draw((body, position, quaternion) => leading.at(body, this.moment, position, quaternion), time);
    const width = this.box.clientWidth;
    const height = this.box.clientHeight;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.space.background = new Color(getComputedStyle(this.box).backgroundColor);
    this.tags.forEach((tag) => tag.remove());
    this.tags = [];
    const panes = this.split && on.length ? on.map((actor) => [actor]) : [on];
    const tall = this.split && width < height * 1.2;
    this.renderer.setScissorTest(true);
    panes.forEach((pane, index) => {
      const part = 1 / panes.length;
      const [left, top] = tall ? [0, index * part] : [index * part, 0];
      const [w, h] = tall ? [width, height * part] : [width * part, height];
      this.camera.aspect = w / h;
      this.camera.updateProjectionMatrix();
      this.renderer.setViewport(left * width, height - top * height - h, w, h);
      this.renderer.setScissor(left * width, height - top * height - h, w, h);
      for (const actor of this.actors) actor.group.visible = pane.includes(actor);
      this.renderer.render(this.space, this.camera);
      pane.forEach((actor, row) => this.tag(actor.data, left * width + 8, top * height + 8 + row * 26));
    });
  }

  private pose(actor: Actor, first: Actor, alone: boolean, order: number): void {
    const own = alone || (this.ownColours && actor === first);
    const behind = this.ownColours && !alone;
    actor.solids.appear({
      colour: own ? null : colour(actor.data.colour),
      opacity: own ? 1 : behind ? BEHIND_OPACITY : OVERLAID_OPACITY[Math.min(order, OVERLAID_OPACITY.length - 1)],
      order: behind ? -order : order,
      hides: true,
      mode: this.mode,
      highlighted: this.highlighted,
    });
    actor.solids.place((body, position, quaternion) => {
      actor.poses.at(body, this.moment, POSITION, QUATERNION);
      if (actor !== first && this.exaggeration !== 1) {
        first.poses.at(body, this.moment, FIRST_POSITION, FIRST_QUATERNION);
        exaggerate(this.exaggeration);
      }
      position.copy(POSITION);
      quaternion.copy(QUATERNION);
    });
    if (actor.forces !== null) {
      actor.forces.mesh.visible = this.showForces;
      const frame = this.moment.frame + Math.round(this.moment.share);
      actor.forces.show(frame, actor.data.frames - 1, LONGEST_FORCE * this.scene.view.radius);
    }
  }

  private tag(run: RunData, left: number, top: number): void {
    if (!run.label) return;
    const tag = document.createElement("div");
    tag.className = "tag";
    fill(tag, run.colour);
    tag.textContent = run.label;
    tag.style.left = `${left}px`;
    tag.style.top = `${top}px`;
    this.box.append(tag);
    this.tags.push(tag);
  }
}
