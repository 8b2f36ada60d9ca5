/** Shapes of bodies: what is seen, what collides, or both. Shapes of one geometry are drawn at once. */

import {
  Box3, BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry, Group, InstancedMesh, Matrix4, MeshLambertMaterial,
  Quaternion, SphereGeometry, Vector3,
} from "three";
import { toCreasedNormals } from "three/examples/jsm/utils/BufferGeometryUtils.js";
import type { PageData, Shape, Triple } from "./data";
import { float32, int16, uint16, unpacked } from "./packing";

export const MODES = ["visual", "collision", "both"] as const;
export type Mode = (typeof MODES)[number];

const ONE = new Vector3(1, 1, 1);
/** Of what collides, drawn over what is seen. */
const COLLISION_COLOUR = "#009e73";
const COLLISION_OPACITY = 0.35;
/** Angle (rad) between triangles from which on their edge is sharp. */
const CREASE = 0.6;
const MATRIX = new Matrix4();
const POSITION = new Vector3();
const QUATERNION = new Quaternion();

/** Numbers of 16 bits as places in a box. */
function between(codes: Int16Array, low: Triple, high: Triple): Float32Array {
  return Float32Array.from(codes, (code, index) => unpacked(code, low[index % 3], high[index % 3]));
}

async function made(page: PageData, shape: Shape): Promise<BufferGeometry | null> {
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
      const { low, high, vertices } = shape.hull;
      const hull = new BufferGeometry();
      const places = low && high ? between(await int16(page, vertices), low, high) : await float32(page, vertices);
      hull.setAttribute("position", new BufferAttribute(places, 3));
      hull.setIndex(new BufferAttribute(await uint16(page, shape.hull.triangles), 1));
      if (low) return toCreasedNormals(hull, CREASE);
      const faces = hull.toNonIndexed(); // each with a normal of its own
      faces.computeVertexNormals();
      return faces;
    }
    default:
      return null; // a plane has no end: the grid stands for it
  }
}

/** The geometries of a page, each made once. */
export class Geometries {
  private readonly known = new Map<string, Promise<BufferGeometry | null>>();

  constructor(private readonly page: PageData) {}

  static key(shape: Shape): string {
    return `${shape.kind} ${shape.size.join(" ")} ${shape.hull?.vertices ?? ""} ${shape.hull?.triangles ?? ""}`;
  }

  of(shape: Shape): Promise<BufferGeometry | null> {
    const key = Geometries.key(shape);
    let geometry = this.known.get(key);
    if (geometry === undefined) {
      geometry = made(this.page, shape);
      this.known.set(key, geometry);
    }
    return geometry;
  }
}

interface Batch {
  mesh: InstancedMesh<BufferGeometry, MeshLambertMaterial>;
  shapes: { shape: Shape; local: Matrix4 }[];
  /** Of the shapes' colours. */
  opacity: number;
}

async function batches(geometries: Geometries, shapes: Shape[]): Promise<Batch[]> {
  const groups = new Map<string, Shape[]>();
  for (const shape of shapes) {
    const key = `${Geometries.key(shape)} ${shape.colour[3]}`;
    groups.set(key, [...(groups.get(key) ?? []), shape]);
  }
  const all: Batch[] = [];
  for (const group of groups.values()) {
    const geometry = await geometries.of(group[0]);
    if (geometry === null) continue;
    const mesh = new InstancedMesh(geometry, new MeshLambertMaterial(), group.length);
    mesh.frustumCulled = false;
    const placed = group.map((shape) => {
      const [w, x, y, z] = shape.quaternion;
      return { shape, local: new Matrix4().compose(new Vector3(...shape.position), new Quaternion(x, y, z, w), ONE) };
    });
    all.push({ mesh, shapes: placed, opacity: group[0].colour[3] });
  }
  return all;
}

/** How the shapes of one run are drawn: `colour` null for those that they have, `opacity`, and how far nearer than they are, or
 * farther where it is negative (`order`). */
export interface Appearance {
  colour: string | null;
  opacity: number;
  order: number;
  /** Whether what is behind them is hidden. */
  hides: boolean;
  mode: Mode;
  /** Colours of bodies that are meant. */
  highlighted: ReadonlyMap<number, string>;
}

/** How much nearer each run is drawn than the one before it, in the least steps of depth: surfaces at the same place do not flicker. */
const NEARER = 8;

export class Solids {
  readonly group = new Group();

  private constructor(
    private readonly seen: Batch[],
    private readonly solid: Batch[],
  ) {
    for (const batch of [...seen, ...solid]) this.group.add(batch.mesh);
  }

  static async open(geometries: Geometries, shapes: Shape[]): Promise<Solids> {
    const seen = await batches(geometries, shapes.filter((shape) => shape.seen && shape.colour[3] > 0));
    return new Solids(seen, await batches(geometries, shapes.filter((shape) => shape.solid)));
  }

  /** Place all shapes, by a function that writes the pose of a body. */
  place(pose: (body: number, position: Vector3, quaternion: Quaternion) => void): void {
    for (const batch of [...this.seen, ...this.solid]) {
      if (!batch.mesh.visible) continue;
      batch.shapes.forEach(({ shape, local }, index) => {
        pose(shape.body, POSITION, QUATERNION);
        batch.mesh.setMatrixAt(index, MATRIX.compose(POSITION, QUATERNION, ONE).multiply(local));
      });
      batch.mesh.instanceMatrix.needsUpdate = true;
    }
  }

  /** The box of what is seen, where it is placed now. */
  box(): Box3 {
    const all = new Box3();
    for (const { mesh } of this.seen.length ? this.seen : this.solid) {
      mesh.computeBoundingBox();
      if (mesh.boundingBox !== null) all.union(mesh.boundingBox);
    }
    return all;
  }

  appear(how: Appearance): void {
    const over = how.mode === "both";
    for (const batch of this.seen) {
      batch.mesh.material.depthWrite = how.hides && batch.opacity === 1;
      dress(batch, how, how.mode !== "collision", how.colour, batch.opacity * how.opacity, how.order);
    }
    const opacity = over ? COLLISION_OPACITY * how.opacity : how.opacity;
    const colour = over ? (how.colour ?? COLLISION_COLOUR) : how.colour;
    for (const batch of this.solid) {
      batch.mesh.material.depthWrite = how.hides && !over;
      dress(batch, how, how.mode !== "visual", colour, opacity, how.order + (over ? 1 : 0));
    }
  }
}

function dress(batch: Batch, how: Appearance, visible: boolean, single: string | null, opacity: number, order: number): void {
  const { mesh } = batch;
  mesh.visible = visible;
  if (!visible) return;
  mesh.material.transparent = opacity < 1;
  mesh.material.opacity = opacity;
  mesh.material.polygonOffset = order !== 0;
  mesh.material.polygonOffsetUnits = -NEARER * order;
  mesh.material.polygonOffsetFactor = -order;
  mesh.renderOrder = Math.abs(order);
  const colour = new Color();
  batch.shapes.forEach(({ shape }, index) => {
    const [red, green, blue] = shape.colour;
    const chosen = how.highlighted.get(shape.body) ?? single;
    mesh.setColorAt(index, chosen === null ? colour.setRGB(red, green, blue, "srgb") : colour.set(chosen));
  });
  if (mesh.instanceColor !== null) mesh.instanceColor.needsUpdate = true;
}
