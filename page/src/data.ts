/** What the page is told of its runs: the JSON that `simspec/report/page/` writes. Lengths in m, times in s, quaternions w x y z. */

export type Triple = [number, number, number];

export type Quad = [number, number, number, number];

/** Names of packed numbers: x y z of vertices, and the triangles' indices of them. With `low` and `high` a surface, whose vertices
 * are 16-bit numbers between these corners, and which is smooth but for its edges. */
export interface Hull {
  vertices: string;
  triangles: string;
  low?: Triple;
  high?: Triple;
}

/** A shape of a body, at a pose in the body's frame. `size`: as in simspec's table of shapes. `seen`, `solid`: whether it is drawn as
 * what is seen, and as what collides. */
export interface Shape {
  body: number;
  kind: "sphere" | "box" | "cylinder" | "capsule" | "ellipsoid" | "plane" | "mesh";
  seen: boolean;
  solid: boolean;
  size: number[];
  /** Of a mesh, wound outwards. */
  hull?: Hull;
  position: Triple;
  quaternion: Quad;
  colour: Quad;
}

/** A joint between `body` and `parent` (-1: the world), whose frame is at a pose in the parent's; `limits` of a hinge or slide (rad, m),
 * `cone` the largest angle of a ball. */
export interface Joint {
  name: string;
  kind: "fixed" | "hinge" | "slide" | "ball" | "free";
  body: number;
  parent: number;
  position: Triple;
  quaternion: Quad;
  axis: Triple;
  limits: [number, number] | null;
  cone: number | null;
  start: number[];
}

/** A loop that is closed where `point` of `second` is at `position` of `first`; a weld has its orientation there, too. */
export interface Loop {
  name: string;
  first: number;
  second: number;
  position: Triple;
  quaternion: Quad;
  point: Triple;
  weld: boolean;
}

/** A force (N) and a torque (N m), world axes, at a point of a body, during a time (s). */
export interface Load {
  body: number;
  force: Triple;
  torque: Triple;
  at: Triple;
  start: number;
  until: number | null;
}

/** Joints are those of bodies, in their order; of a scene that was run without fixed and free ones. */
export interface Model {
  joints: Joint[];
  /** The joint of `body` follows that of `leader`. */
  follows: { body: number; leader: number; ratio: number; offset: number }[];
  loops: Loop[];
  sums: { name: string; parts: [number, number][]; limits: [number, number] }[];
  frames: { name: string; body: number; position: Triple; quaternion: Quad }[];
  /** Bodies that may touch the same others, and the pairs of such classes that may touch; of how many bodies. */
  contacts: { classes: number[][]; pairs: [number, number][]; bodies: number };
  loads: Load[];
}

/** Motions of some bodies: names of packed numbers (`packing.ts`), `turn` null where no body turns. */
export interface Motion {
  position: string;
  turn: string | null;
}

/** Contact forces at every `every`-th frame; `largest` (N) has the length 1. */
export interface Forces {
  frame: string;
  position: string;
  normal: string;
  force: string;
  count: number;
  every: number;
  largest: number;
}

export interface RunData {
  engine: string;
  label: string;
  colour: number;
  /** Frames that it recorded: fewer than there are times where it ended early. */
  frames: number;
  motion: Motion | null;
  forces: Forces | null;
}

export interface Line {
  label: string;
  values: string;
  colour: number;
  dash: number;
  /** `band`: filled from below, in grey; `limit`: a dashed constant. */
  kind: "line" | "band" | "limit";
}

export interface Plot {
  title: string;
  unit: string;
  logarithmic: boolean;
  lines: Line[];
}

/** One world in some engines. */
export interface Scene {
  name: string;
  times: string;
  frames: number;
  bodies: string[];
  shapes: Shape[];
  model: Model;
  /** The box that positions are packed in. */
  low: Triple;
  high: Triple;
  /** The poses (x y z w x y z) of the bodies that never move. */
  rest: number[][];
  moving: number[];
  turning: number[];
  /** None of a scene that was not run. */
  runs: RunData[];
  /** Where the targets of driven joints would have the bodies `ghost.bodies`. */
  ghost: { bodies: number[]; motion: Motion } | null;
  /** What the camera looks at first: a ball. */
  view: { centre: Triple; radius: number };
  plots: Plot[];
}

/** One figure of a study: a median at `x` with its interval, and the values that it is of. */
export interface Mark {
  x: number;
  value: number;
  low: number | null;
  high: number | null;
  values: number[];
}

export interface Series {
  label: string;
  colour: number;
  dash: number;
  /** `elsewhere`: figures that are not of these runs; `steps`: values of intervals, x their beginnings, and one more at the end. */
  kind: "measured" | "elsewhere" | "steps";
  marks: Mark[];
}

/** A plot of a study. Plots of one `group` have the same x axis and are linked. */
export interface Chart {
  title: string;
  unit: string;
  group: string;
  x: { label: string; unit: string; logarithmic: boolean };
  logarithmic: boolean;
  series: Series[];
  /** Vertical lines. */
  limits: { label: string; x: number; colour: number; elsewhere: boolean }[];
}

export interface PageData {
  scenes: Scene[];
  /** The plots of each part of the page that is a study. */
  charts: Chart[][];
  packed: Record<string, string>;
}

/** The JSON of a `<script type="application/json">`. */
export function readJson<T>(id: string): T {
  const element = document.getElementById(id);
  if (element === null) throw new Error(`the page has no ${id}`);
  return JSON.parse(element.textContent ?? "") as T;
}
