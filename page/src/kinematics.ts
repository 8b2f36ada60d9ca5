/** Where the bodies of a tree are for given positions of its joints; of a scene that was not run. */

import { Quaternion, Vector3 } from "three";
import type { Joint, Model, Quad, Triple } from "./data";
import type { Moment, Posed } from "./motion";

/** A distance (of the size of the scene) beyond which a loop is open. */
const CLOSED = 1e-4;
const DEGREES = 180 / Math.PI;

export function turned([w, x, y, z]: Quad | number[]): Quaternion {
  return new Quaternion(x, y, z, w);
}

/** R = Rz(yaw) Ry(pitch) Rx(roll). */
export function fromRpy([roll, pitch, yaw]: number[]): Quaternion {
  const about = (x: number, y: number, z: number, angle: number) => new Quaternion().setFromAxisAngle(new Vector3(x, y, z), angle);
  return about(0, 0, 1, yaw).multiply(about(0, 1, 0, pitch)).multiply(about(1, 0, 0, roll));
}

function pointOf(body: { position: Vector3; quaternion: Quaternion }, at: Triple): Vector3 {
  return new Vector3(...at).applyQuaternion(body.quaternion).add(body.position);
}

export class Kinematics implements Posed {
  /** Positions of hinges and slides (one number), balls (roll, pitch, yaw from the start), free bodies (x, y, z, and those), by body. */
  readonly values: number[][];
  private readonly places: { position: Vector3; quaternion: Quaternion }[];
  private readonly leaders = new Map<number, { leader: number; ratio: number; offset: number }>();
  /** Distances (m) and angles of the loops at the start, which need not be closed there. */
  private readonly first: { distance: number; angle: number }[];

  constructor(
    private readonly model: Model,
    private readonly radius: number,
  ) {
    this.places = model.joints.map(() => ({ position: new Vector3(), quaternion: new Quaternion() }));
    for (const { body, leader, ratio, offset } of model.follows) this.leaders.set(body, { leader, ratio, offset });
    this.values = model.joints.map(startOf);
    this.update();
    this.first = model.loops.map((_, index) => this.openness(index));
  }

  /** Whether the position of a joint follows from another's. */
  follows(body: number): boolean {
    return this.leaders.has(body);
  }

  set(body: number, values: number[]): void {
    this.values[body] = values;
    this.update();
  }

  /** All joints where they begin, or at zero (within their limits). */
  reset(zero: boolean): void {
    for (const joint of this.model.joints) {
      this.values[joint.body] = startOf(joint);
      if (zero && (joint.kind === "hinge" || joint.kind === "slide")) {
        const [low, high] = joint.limits ?? [0, 0];
        this.values[joint.body] = [Math.min(high, Math.max(low, 0))];
      }
    }
    this.update();
  }

  at(body: number, _moment: Moment, position: Vector3, quaternion: Quaternion): void {
    position.copy(this.places[body].position);
    quaternion.copy(this.places[body].quaternion);
  }

  /** What sliders break: loops that are open, limits that followers and sums exceed. */
  broken(): string[] {
    const { joints, loops, sums } = this.model;
    const lines: string[] = [];
    loops.forEach((loop, index) => {
      const { distance, angle } = this.openness(index);
      const far = distance - this.first[index].distance > CLOSED * this.radius;
      if (far) lines.push(`loop “${loop.name}” is open by ${(1000 * distance).toPrecision(3)} mm`);
      else if (loop.weld && angle - this.first[index].angle > CLOSED) lines.push(`loop “${loop.name}” is turned by ${(angle * DEGREES).toPrecision(3)}°`);
    });
    for (const body of this.leaders.keys()) {
      const { name, limits, kind } = joints[body];
      const [value] = this.values[body];
      const slack = 1e-6;
      if (limits !== null && (value < limits[0] - slack || value > limits[1] + slack))
        lines.push(`${name}, which follows ${joints[this.leaders.get(body)?.leader ?? 0].name}, is beyond its limits (${shown(kind, value)})`);
    }
    for (const { name, parts, limits } of sums) {
      const value = parts.reduce((sum, [body, coefficient]) => sum + coefficient * this.values[body][0], 0);
      if (value < limits[0] - 1e-6 || value > limits[1] + 1e-6) lines.push(`sum “${name}” is beyond its limits (${value.toPrecision(3)})`);
    }
    for (const joint of joints)
      if (joint.kind === "ball" && joint.cone !== null) {
        const { w, x, y, z } = this.displacement(joint).quaternion;
        const angle = 2 * Math.atan2(Math.hypot(x, y, z), Math.abs(w));
        if (angle > joint.cone + 1e-6) lines.push(`${joint.name} is beyond its limit (${(angle * DEGREES).toPrecision(3)}°)`);
      }
    return lines;
  }

  private openness(index: number): { distance: number; angle: number } {
    const loop = this.model.loops[index];
    const [first, second] = [this.places[loop.first], this.places[loop.second]];
    const distance = pointOf(first, loop.position).distanceTo(pointOf(second, loop.point));
    const wanted = first.quaternion.clone().multiply(turned(loop.quaternion));
    return { distance, angle: loop.weld ? wanted.angleTo(second.quaternion) : 0 };
  }

  private update(): void {
    for (const joint of this.model.joints) {
      const { position, quaternion } = this.places[joint.body];
      if (this.leaders.has(joint.body)) this.values[joint.body] = [this.led(joint.body, 0)];
      const moved = this.displacement(joint);
      quaternion.copy(turned(joint.quaternion));
      position.set(...joint.position).add(moved.position.applyQuaternion(quaternion));
      quaternion.multiply(moved.quaternion);
      if (joint.parent < 0) continue;
      const above = this.places[joint.parent];
      position.applyQuaternion(above.quaternion).add(above.position);
      quaternion.premultiply(above.quaternion);
    }
  }

  /** The position of a joint, from that of the joint that it follows. */
  private led(body: number, depth: number): number {
    const rule = this.leaders.get(body);
    if (rule === undefined || depth > this.leaders.size) return this.values[body][0];
    return rule.ratio * this.led(rule.leader, depth + 1) + rule.offset;
  }

  private displacement(joint: Joint): { position: Vector3; quaternion: Quaternion } {
    const values = this.values[joint.body];
    const moved = { position: new Vector3(), quaternion: new Quaternion() };
    const axis = new Vector3(...joint.axis);
    if (joint.kind === "hinge") moved.quaternion.setFromAxisAngle(axis, values[0]);
    else if (joint.kind === "slide") moved.position.copy(axis).multiplyScalar(values[0]);
    else if (joint.kind === "ball") moved.quaternion.copy(fromRpy(values)).multiply(turned(joint.start));
    else if (joint.kind === "free") {
      moved.position.set(values[0], values[1], values[2]);
      moved.quaternion.copy(fromRpy(values.slice(3))).multiply(turned(joint.start.slice(3)));
    }
    return moved;
  }
}

function startOf(joint: Joint): number[] {
  switch (joint.kind) {
    case "hinge":
    case "slide":
      return [joint.start[0]];
    case "ball":
      return [0, 0, 0];
    case "free":
      return [...joint.start.slice(0, 3), 0, 0, 0];
    default:
      return [];
  }
}

/** A position of a joint in words. */
export function shown(kind: Joint["kind"], value: number): string {
  const text = kind === "slide" ? `${value.toFixed(3)} m` : `${(value * DEGREES).toFixed(1)}°`;
  return text.replace("-", "−");
}
