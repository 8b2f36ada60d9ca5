/** The playback of one scene: all runs overlaid, or side by side. Draws only when something changed. */

import {
  BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry, DirectionalLight, GridHelper, Group, HemisphereLight,
  InstancedMesh, Matrix4, MeshLambertMaterial, PerspectiveCamera, Quaternion, Scene as Space, SphereGeometry, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { PageData, RunData, Scene, Shape } from "./data";
import { ForceBars } from "./forces";
import { colour, fill } from "./palette";
import { type Moment, momentOf, Poses } from "./motion";
import { float32, uint16 } from "./packing";

const ONE = new Vector3(1, 1, 1);
const FIELD_OF_VIEW = 40;
/** Of the bodies of one run after the other, where several are at the same place: each is about as much of what is seen. */
const OVERLAID_OPACITY = [0.85, 0.52, 0.37, 0.29, 0.25, 0.22];
/** How far each run is drawn before the one before it, in the least steps of depth: surfaces at the same place do not flicker. */
const NEARER = 8;
const GHOST_OPACITY = 0.25;
const GHOST_COLOUR = "#888888";
/** The ball that is looked at fills the view a bit more than wholly: most of what moves is nearer its centre. */
const FILLING = 0.8;
/** Longest bar of a contact force, of the radius of the view. */
const LONGEST_FORCE = 0.15;

/** Directions that the camera can look from. */
export const VIEWS: Record<string, [number, number, number]> = {
  fit: [0.62, -0.66, 0.42],
  front: [0, -1, 0.02],
  side: [1, 0, 0.02],
  top: [0, -0.001, 1],
};

async function geometryOf(page: PageData, shape: Shape): Promise<BufferGeometry | null> {
  const [a, b, c] = shape.size;
  switch (shape.kind) {
    case "sphere":
      return new SphereGeometry(a, 20, 14);
    case "box":
      return new BoxGeometry(a, b, c);
    case "cylinder":
      return new CylinderGeometry(a, a, b, 28).rotateX(Math.PI / 2);
    case "capsule":
      return new CapsuleGeometry(a, b, 8, 18).rotateX(Math.PI / 2);
    case "ellipsoid":
      return new SphereGeometry(1, 24, 16).scale(a, b, c);
    case "mesh": {
      if (shape.hull === undefined) return null;
      const hull = new BufferGeometry();
      hull.setAttribute("position", new BufferAttribute(await float32(page, shape.hull.vertices), 3));
      hull.setIndex(new BufferAttribute(await uint16(page, shape.hull.triangles), 1));
      const faces = hull.toNonIndexed(); // each with a normal of its own
      faces.computeVertexNormals();
      return faces;
    }
    default:
      return null; // a plane has no end: the grid stands for it
  }
}

/** Shapes of one geometry, drawn at once. */
interface Batch {
  mesh: InstancedMesh;
  shapes: { shape: Shape; local: Matrix4 }[];
}

async function batches(page: PageData, shapes: Shape[], opacity: number): Promise<Batch[]> {
  const groups = new Map<string, Shape[]>();
  for (const shape of shapes) {
    const key = `${shape.kind} ${shape.size.join(" ")} ${shape.hull?.vertices ?? ""}`;
    groups.set(key, [...(groups.get(key) ?? []), shape]);
  }
  const made: Batch[] = [];
  for (const group of groups.values()) {
    const geometry = await geometryOf(page, group[0]);
    if (geometry === null) continue;
    const mesh = new InstancedMesh(geometry, new MeshLambertMaterial({ transparent: opacity < 1, opacity }), group.length);
    mesh.frustumCulled = false;
    const placed = group.map((shape) => {
      const [w, x, y, z] = shape.quaternion;
      return { shape, local: new Matrix4().compose(new Vector3(...shape.position), new Quaternion(x, y, z, w), ONE) };
    });
    made.push({ mesh, shapes: placed });
  }
  return made;
}

/** Colours: one for all (`single`), or those that the shapes have. */
function paint(batch: Batch, single: string | null): void {
  const made = new Color();
  batch.shapes.forEach(({ shape }, index) => {
    const [red, green, blue] = shape.colour;
    batch.mesh.setColorAt(index, single === null ? made.setRGB(red, green, blue, "srgb") : made.set(single));
  });
  if (batch.mesh.instanceColor !== null) batch.mesh.instanceColor.needsUpdate = true;
}

const POSITION = new Vector3();
const QUATERNION = new Quaternion();
const MATRIX = new Matrix4();
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

function place(batch: Batch, pose: (body: number) => void): void {
  batch.shapes.forEach(({ shape, local }, index) => {
    pose(shape.body);
    batch.mesh.setMatrixAt(index, MATRIX.compose(POSITION, QUATERNION, ONE).multiply(local));
  });
  batch.mesh.instanceMatrix.needsUpdate = true;
}

interface Actor {
  data: RunData;
  group: Group;
  batches: Batch[];
  poses: Poses;
  forces: ForceBars | null;
}

export class Stage {
  split = false;
  showForces = true;
  showGhost = true;
  /** By how much the differences of the other runs from the first shown one are drawn larger than they are. */
  exaggeration = 1;
  readonly shown: Set<number>;
  private readonly space = new Space();
  private readonly camera = new PerspectiveCamera(FIELD_OF_VIEW, 2, 0.005, 500);
  private readonly controls: OrbitControls;
  private readonly actors: Actor[] = [];
  private ghost: { group: Group; batches: Batch[]; poses: Poses } | null = null;
  private moment: Moment = { frame: 0, share: 0 };
  private asked = false;
  private tags: HTMLElement[] = [];

  private constructor(
    private readonly page: PageData,
    private readonly scene: Scene,
    private readonly times: Float32Array,
    private readonly box: HTMLElement,
    private readonly renderer: WebGLRenderer,
  ) {
    this.shown = new Set(scene.runs.map((_, index) => index));
    renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    renderer.domElement.setAttribute("aria-hidden", "true");
    box.append(renderer.domElement);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, renderer.domElement);
    this.controls.addEventListener("change", () => this.ask());
    new ResizeObserver(() => this.ask()).observe(box);
  }

  /** The stage, or null where the browser has no WebGL. */
  static async open(page: PageData, scene: Scene, times: Float32Array, box: HTMLElement): Promise<Stage | null> {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    if (context === null) return null;
    const renderer = new WebGLRenderer({ canvas, context });
    const stage = new Stage(page, scene, times, box, renderer);
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
    this.addGrid();
    for (const batch of await batches(page, scene.shapes.filter((shape) => !moving.has(shape.body)), 1)) {
      paint(batch, null);
      place(batch, (body) => {
        const [x, y, z, qw, qx, qy, qz] = scene.rest[body];
        POSITION.set(x, y, z);
        QUATERNION.set(qx, qy, qz, qw);
      });
      space.add(batch.mesh);
    }
    const movingShapes = scene.shapes.filter((shape) => moving.has(shape.body));
    for (const data of scene.runs) {
      if (data.motion === null) continue;
      const poses = await Poses.load(page, scene, data.motion, data.frames, scene.moving, scene.turning);
      const forces = data.forces && (await ForceBars.load(page, scene, data.forces, colour(data.colour)));
      const actor: Actor = { data, group: new Group(), batches: await batches(page, movingShapes, 1), poses, forces };
      for (const batch of actor.batches) actor.group.add(batch.mesh);
      if (forces) actor.group.add(forces.mesh);
      space.add(actor.group);
      this.actors.push(actor);
    }
    if (scene.ghost !== null) {
      const bodies = scene.ghost.bodies;
      const of = new Set(bodies);
      const poses = await Poses.load(page, scene, scene.ghost.motion, scene.frames, bodies, bodies);
      const made = await batches(page, scene.shapes.filter((shape) => of.has(shape.body)), GHOST_OPACITY);
      this.ghost = { group: new Group(), batches: made, poses };
      for (const batch of made) {
        paint(batch, GHOST_COLOUR);
        (batch.mesh.material as MeshLambertMaterial).depthWrite = false;
        this.ghost.group.add(batch.mesh);
      }
      space.add(this.ghost.group);
    }
  }

  private addGrid(): void {
    const { view, shapes, rest } = this.scene;
    const step = 10 ** Math.floor(Math.log10(view.radius));
    const lines = 2 * Math.ceil((2.5 * view.radius) / step);
    const grid = new GridHelper(lines * step, lines, "#8a8a85", "#a9a9a3");
    grid.rotation.x = Math.PI / 2;
    const level = shapes.find((shape) => shape.kind === "plane");
    const height = level ? rest[level.body][2] + level.position[2] : 0;
    const snapped = (value: number) => Math.round(value / step) * step;
    grid.position.set(snapped(view.centre[0]), snapped(view.centre[1]), height - 0.001 * view.radius);
    this.space.add(grid);
  }

  /** Look from one of the directions in `VIEWS` at all there is to see. */
  look(direction: string): void {
    const { centre, radius } = this.scene.view;
    const aspect = Math.min(1, this.box.clientWidth / Math.max(1, this.box.clientHeight));
    const distance = (FILLING * radius) / Math.sin((FIELD_OF_VIEW * Math.PI) / 360) / aspect;
    this.controls.target.set(...centre);
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
    const actor = this.actors.find(({ data }) => data === this.scene.runs[run]);
    const first = this.actors.find(({ data }) => this.shown.has(this.scene.runs.indexOf(data)));
    if (actor === undefined) return null;
    actor.poses.at(body, this.moment, POSITION, QUATERNION);
    if (first !== undefined && actor !== first && this.exaggeration !== 1) {
      first.poses.at(body, this.moment, FIRST_POSITION, FIRST_QUATERNION);
      exaggerate(this.exaggeration);
    }
    return POSITION.toArray();
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
    const on = this.actors.filter(({ data }) => this.shown.has(this.scene.runs.indexOf(data)));
    const alone = this.split || on.length === 1;
    on.forEach((actor, order) => this.pose(actor, on[0], alone, order));
    if (this.ghost !== null) {
      const ghost = this.ghost;
      ghost.group.visible = this.showGhost;
      for (const batch of ghost.batches) place(batch, (body) => ghost.poses.at(body, this.moment, POSITION, QUATERNION));
    }
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
    for (const batch of actor.batches) {
      const material = batch.mesh.material as MeshLambertMaterial;
      material.transparent = !alone;
      material.opacity = alone ? 1 : OVERLAID_OPACITY[Math.min(order, OVERLAID_OPACITY.length - 1)];
      material.polygonOffset = !alone;
      material.polygonOffsetUnits = -NEARER * order;
      material.polygonOffsetFactor = -order;
      batch.mesh.renderOrder = order;
      paint(batch, alone ? null : colour(actor.data.colour));
      place(batch, (body) => {
        actor.poses.at(body, this.moment, POSITION, QUATERNION);
        if (actor === first || this.exaggeration === 1) return;
        first.poses.at(body, this.moment, FIRST_POSITION, FIRST_QUATERNION);
        exaggerate(this.exaggeration);
      });
    }
    if (actor.forces !== null) {
      actor.forces.mesh.visible = this.showForces;
      const frame = this.moment.frame + Math.round(this.moment.share);
      actor.forces.show(frame, actor.data.frames - 1, LONGEST_FORCE * this.scene.view.radius);
    }
  }

  private tag(run: RunData, left: number, top: number): void {
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
