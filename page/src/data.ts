/** What the page is told of its runs: the JSON that `simspec/report/page/` writes. Lengths in m, times in s, quaternions w x y z. */

export type Triple = [number, number, number];

/** A shape of a body, at a pose in the body's frame. `size`: as in simspec's table of shapes. */
export interface Shape {
  body: number;
  kind: "sphere" | "box" | "cylinder" | "capsule" | "ellipsoid" | "plane";
  size: number[];
  position: Triple;
  quaternion: [number, number, number, number];
  colour: [number, number, number, number];
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
  /** The box that positions are packed in. */
  low: Triple;
  high: Triple;
  /** The poses (x y z w x y z) of the bodies that never move. */
  rest: number[][];
  moving: number[];
  turning: number[];
  runs: RunData[];
  /** Where the targets of driven joints would have the bodies `ghost.bodies`. */
  ghost: { bodies: number[]; motion: Motion } | null;
  /** What the camera looks at first: a ball. */
  view: { centre: Triple; radius: number };
  plots: Plot[];
}

export interface PageData {
  scenes: Scene[];
  packed: Record<string, string>;
}

/** The JSON of a `<script type="application/json">`. */
export function readJson<T>(id: string): T {
  const element = document.getElementById(id);
  if (element === null) throw new Error(`the page has no ${id}`);
  return JSON.parse(element.textContent ?? "") as T;
}
