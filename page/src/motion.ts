/** Poses of bodies at any time, between recorded frames. */

import { Quaternion, Vector3 } from "three";
import type { Motion, PageData, Scene } from "./data";
import { series, unpacked } from "./packing";

/** A moment: the frame before it, and the share of the way to the next. */
export interface Moment {
  frame: number;
  share: number;
}

/** The moment of a time among recorded times. */
export function momentOf(times: Float32Array, time: number): Moment {
  let low = 0;
  let high = times.length - 1;
  if (time >= times[high]) return { frame: high, share: 0 };
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  return { frame: low, share: Math.max(0, (time - times[low]) / (times[high] - times[low])) };
}

/** Where bodies are. */
export interface Posed {
  /** Write the pose of a body at a moment. */
  at(body: number, moment: Moment, position: Vector3, quaternion: Quaternion): void;
}

export class Poses implements Posed {
  private readonly places = new Map<number, number>();
  private readonly turns = new Map<number, number>();

  private constructor(
    private readonly scene: Scene,
    private readonly frames: number,
    private readonly position: Int16Array,
    private readonly turn: Int16Array | null,
    moving: number[],
    turning: number[],
  ) {
    moving.forEach((body, index) => this.places.set(body, index));
    turning.forEach((body, index) => this.turns.set(body, index));
  }

  static async load(page: PageData, scene: Scene, motion: Motion, frames: number, moving: number[], turning: number[]) {
    const position = await series(page, motion.position, frames);
    const turn = motion.turn === null ? null : await series(page, motion.turn, frames);
    return new Poses(scene, frames, position, turn, moving, turning);
  }

  /** Write the pose of a body at a moment; after its last frame a run stays where it ended. */
  at(body: number, moment: Moment, position: Vector3, quaternion: Quaternion): void {
    const rest = this.scene.rest[body];
    const frame = Math.min(moment.frame, this.frames - 1);
    const share = frame === moment.frame && frame + 1 < this.frames ? moment.share : 0;
    const between = (values: Int16Array, start: number) => {
      const value = values[start + frame];
      return share ? value + (values[start + frame + 1] - value) * share : value;
    };
    const place = this.places.get(body);
    if (place === undefined) position.set(rest[0], rest[1], rest[2]);
    else {
      const { low, high } = this.scene;
      const axis = (k: number) => unpacked(between(this.position, (place * 3 + k) * this.frames), low[k], high[k]);
      position.set(axis(0), axis(1), axis(2));
    }
    const turn = this.turns.get(body);
    if (turn === undefined || this.turn === null) quaternion.set(rest[4], rest[5], rest[6], rest[3]);
    else {
      const values = this.turn;
      const part = (k: number) => between(values, (turn * 4 + k) * this.frames);
      quaternion.set(part(1), part(2), part(3), part(0)).normalize();
    }
  }
}
