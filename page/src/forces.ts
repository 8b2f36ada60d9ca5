/** Contact forces: a bar for each contact, along its normal, as long as the square root of its force. */

import { CylinderGeometry, InstancedMesh, Matrix4, MeshBasicMaterial, Quaternion, Vector3 } from "three";
import type { Forces, PageData, Scene } from "./data";
import { bytes, int16, uint16, unpacked } from "./packing";

const UP = new Vector3(0, 1, 0);
/** Of the length of a bar. */
const THICKNESS = 0.06;

export class ForceBars {
  readonly mesh: InstancedMesh;
  private readonly first = new Map<number, number>();

  private constructor(
    private readonly scene: Scene,
    private readonly data: Forces,
    private readonly frame: Uint16Array,
    private readonly position: Int16Array,
    private readonly normal: Int8Array,
    private readonly force: Uint8Array,
    colour: string,
  ) {
    let most = 1;
    for (let i = 0; i < data.count; i++) {
      if (!this.first.has(frame[i])) this.first.set(frame[i], i);
      most = Math.max(most, i - (this.first.get(frame[i]) ?? 0) + 1);
    }
    const bar = new CylinderGeometry(THICKNESS / 2, THICKNESS / 2, 1, 6, 1);
    this.mesh = new InstancedMesh(bar, new MeshBasicMaterial({ color: colour, depthTest: false }), most);
    this.mesh.renderOrder = 100; // after all bodies
    this.mesh.frustumCulled = false;
  }

  static async load(page: PageData, scene: Scene, data: Forces, colour: string): Promise<ForceBars> {
    const frame = await uint16(page, data.frame);
    const position = await int16(page, data.position);
    const normal = new Int8Array((await bytes(page, data.normal)).buffer);
    return new ForceBars(scene, data, frame, position, normal, await bytes(page, data.force), colour);
  }

  /** Show the forces of the nearest frame that has any packed. `longest`: of a bar, m. */
  show(frame: number, last: number, longest: number): void {
    const nearest = Math.round(frame / this.data.every) * this.data.every;
    const wanted = Math.min(nearest, last - (last % this.data.every));
    const { low, high } = this.scene;
    const count = this.data.count;
    const place = new Vector3();
    const along = new Vector3();
    const turn = new Quaternion();
    const matrix = new Matrix4();
    let shown = 0;
    for (let i = this.first.get(wanted) ?? count; i < count && this.frame[i] === wanted; i++) {
      place.set(
        unpacked(this.position[i], low[0], high[0]),
        unpacked(this.position[count + i], low[1], high[1]),
        unpacked(this.position[2 * count + i], low[2], high[2]),
      );
      along.set(this.normal[i], this.normal[count + i], this.normal[2 * count + i]).normalize();
      const length = (this.force[i] / 255) * longest;
      const thick = Math.max(length, longest * 0.2);
      matrix.compose(place, turn.setFromUnitVectors(UP, along), new Vector3(thick, length, thick));
      this.mesh.setMatrixAt(shown++, matrix);
    }
    this.mesh.count = shown;
    this.mesh.instanceMatrix.needsUpdate = true;
  }
}
