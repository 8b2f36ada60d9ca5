/** What is drawn over bodies: their frames, joint axes with limits, and loads. */

import { ConeGeometry, CylinderGeometry, Color, Group, InstancedMesh, Matrix4, MeshBasicMaterial, Quaternion, Vector3 } from "three";
import type { Joint, Scene, Triple } from "./data";
import { turned } from "./kinematics";

/** Lengths, of the radius of the view. */
const FRAME = 0.09;
const AXIS = 0.13;
const ARC = 0.08;
const LOAD = 0.3;
const THICK = 0.0035;
const ARC_PARTS = 20;
const AXES: [Triple, string][] = [[[1, 0, 0], "#e03030"], [[0, 1, 0], "#20a040"], [[0, 0, 1], "#3070ff"]];
const AXIS_COLOUR = "#b000b0";
const LIMIT_COLOUR = "#e69f00";
const FORCE_COLOUR = "#d00000";
const TORQUE_COLOUR = "#7030d0";
const UP = new Vector3(0, 1, 0);
/** Bodies from which on frames are drawn smaller. */
const MANY = 12;

/** Bars between points, each with a colour, drawn over everything. */
class Bars {
  readonly mesh: InstancedMesh;
  private count = 0;

  constructor(most: number, tip: boolean) {
    const bar = tip ? new ConeGeometry(1, 1, 12, 1) : new CylinderGeometry(1, 1, 1, 8, 1);
    this.mesh = new InstancedMesh(bar, new MeshBasicMaterial({ depthTest: false, transparent: true }), Math.max(1, most));
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 90;
    this.mesh.setColorAt(0, new Color());
  }

  clear(): void {
    this.count = 0;
  }

  add(from: Vector3, to: Vector3, thick: number, colour: string): void {
    const along = to.clone().sub(from);
    const length = along.length();
    if (!(length > 0) || this.count >= this.mesh.instanceMatrix.count) return;
    const turn = new Quaternion().setFromUnitVectors(UP, along.divideScalar(length));
    const middle = from.clone().add(to).multiplyScalar(0.5);
    this.mesh.setMatrixAt(this.count, new Matrix4().compose(middle, turn, new Vector3(thick, length, thick)));
    this.mesh.setColorAt(this.count++, new Color(colour));
  }

  finish(): void {
    this.mesh.count = this.count;
    this.mesh.instanceMatrix.needsUpdate = true;
    if (this.mesh.instanceColor !== null) this.mesh.instanceColor.needsUpdate = true;
  }
}

interface Place {
  position: Vector3;
  quaternion: Quaternion;
}

/** A unit vector at a right angle to another. */
function across(axis: Vector3): Vector3 {
  const least = Math.abs(axis.x) < 0.7 ? new Vector3(1, 0, 0) : new Vector3(0, 1, 0);
  return least.cross(axis).normalize();
}

export class Marks {
  readonly group = new Group();
  frames = false;
  axes = false;
  loads = true;
  private readonly bars: Bars;
  private readonly tips: Bars;

  constructor(private readonly scene: Scene) {
    const { joints, frames, loads } = scene.model;
    const most = 3 * (scene.bodies.length + frames.length) + joints.length * (ARC_PARTS + 4) + 2 * loads.length;
    this.bars = new Bars(most, false);
    this.tips = new Bars(2 * loads.length, true);
    this.group.add(this.bars.mesh, this.tips.mesh);
  }

  get moved(): Joint[] {
    return this.scene.model.joints.filter(({ kind }) => kind === "hinge" || kind === "slide" || kind === "ball");
  }

  /** Draw what is switched on; `pose` writes where a body is, `time` (s) null where every load is drawn. */
  draw(pose: (body: number, position: Vector3, quaternion: Quaternion) => void, time: number | null): void {
    const placed = (body: number): Place => {
      const place = { position: new Vector3(), quaternion: new Quaternion() };
      if (body >= 0) pose(body, place.position, place.quaternion);
      return place;
    };
    this.bars.clear();
    this.tips.clear();
    if (this.frames) this.drawFrames(placed);
    if (this.axes) for (const joint of this.moved) this.drawJoint(joint, placed(joint.parent), placed(joint.body));
    if (this.loads) this.drawLoads(placed, time);
    this.bars.finish();
    this.tips.finish();
  }

  private drawFrames(placed: (body: number) => Place): void {
    const { radius } = this.scene.view;
    const moving = this.scene.moving.length || this.scene.bodies.length;
    const length = (FRAME * radius) / Math.max(1, Math.cbrt(moving / MANY));
    const triad = ({ position, quaternion }: Place, share: number) => {
      for (const [axis, colour] of AXES) {
        const end = new Vector3(...axis).multiplyScalar(share * length).applyQuaternion(quaternion).add(position);
        this.bars.add(position, end, THICK * radius, colour);
      }
    };
    this.scene.bodies.forEach((_, body) => triad(placed(body), 1));
    for (const frame of this.scene.model.frames) {
      const body = placed(frame.body);
      const position = new Vector3(...frame.position).applyQuaternion(body.quaternion).add(body.position);
      triad({ position, quaternion: body.quaternion.multiply(turned(frame.quaternion)) }, 0.6);
    }
  }

  private drawJoint(joint: Joint, parent: Place, child: Place): void {
    const { radius } = this.scene.view;
    const thick = THICK * radius;
    const origin = new Vector3(...joint.position).applyQuaternion(parent.quaternion).add(parent.position);
    const quaternion = parent.quaternion.clone().multiply(turned(joint.quaternion));
    if (joint.kind === "ball") {
      for (const [axis] of AXES) {
        const half = new Vector3(...axis).multiplyScalar(0.5 * AXIS * radius).applyQuaternion(child.quaternion);
        this.bars.add(origin.clone().sub(half), origin.clone().add(half), thick, AXIS_COLOUR);
      }
      return;
    }
    const local = new Vector3(...joint.axis);
    const axis = local.clone().applyQuaternion(quaternion);
    const along = (reach: number) => axis.clone().multiplyScalar(reach).add(origin);
    if (joint.kind === "slide") {
      const [low, high] = joint.limits ?? [-0.5 * AXIS * radius, 0.5 * AXIS * radius];
      this.bars.add(along(low), along(high), thick, joint.limits === null ? AXIS_COLOUR : LIMIT_COLOUR);
      const side = across(axis).multiplyScalar(0.3 * ARC * radius);
      const tick = (at: Vector3, size: number, colour: string) =>
        this.bars.add(at.clone().addScaledVector(side, -size), at.clone().addScaledVector(side, size), thick, colour);
      if (joint.limits !== null) for (const end of [low, high]) tick(along(end), 1, LIMIT_COLOUR);
      tick(child.position, 1.6, AXIS_COLOUR);
      return;
    }
    this.bars.add(along(-0.5 * AXIS * radius), along(0.5 * AXIS * radius), thick * 1.4, AXIS_COLOUR);
    const reference = across(local);
    const reach = ARC * radius;
    const needle = reference.clone().applyQuaternion(child.quaternion).multiplyScalar(reach).add(origin);
    if (joint.limits === null) return;
    this.bars.add(origin, needle, thick, AXIS_COLOUR);
    const [low, high] = joint.limits;
    const wide = Math.min(high - low, 2 * Math.PI);
    const at = (share: number) => {
      const turn = new Quaternion().setFromAxisAngle(local, low + share * wide);
      return reference.clone().applyQuaternion(turn).applyQuaternion(quaternion).multiplyScalar(reach).add(origin);
    };
    for (let part = 0; part < ARC_PARTS; part++)
      this.bars.add(at(part / ARC_PARTS), at((part + 1) / ARC_PARTS), thick, LIMIT_COLOUR);
    if (wide < 2 * Math.PI - 1e-6) for (const end of [0, 1]) this.bars.add(origin, at(end), thick * 0.6, LIMIT_COLOUR);
  }

  private drawLoads(placed: (body: number) => Place, time: number | null): void {
    const { radius } = this.scene.view;
    const { loads } = this.scene.model;
    const largest = (part: "force" | "torque") => Math.max(...loads.map((load) => Math.hypot(...load[part])), 0);
    for (const load of loads) {
      if (time !== null && (time < load.start || (load.until !== null && time >= load.until))) continue;
      const body = placed(load.body);
      const at = new Vector3(...load.at).applyQuaternion(body.quaternion).add(body.position);
      for (const [part, colour] of [["force", FORCE_COLOUR], ["torque", TORQUE_COLOUR]] as const) {
        const size = Math.hypot(...load[part]);
        if (!size) continue;
        const direction = new Vector3(...load[part]).divideScalar(size);
        const reach = LOAD * radius * Math.sqrt(size / largest(part));
        const neck = at.clone().addScaledVector(direction, 0.8 * reach);
        this.bars.add(at, neck, 2 * THICK * radius, colour);
        this.tips.add(neck, at.clone().addScaledVector(direction, reach), 0.02 * radius, colour);
      }
    }
  }
}
