"""Shapes of a stage: prims of geometry as shapes of the language, meshes as files that are made of them."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simspec.imports.draft import BEGINNING, Draft, made_file, numbers, plain, shape_data
from simspec.imports.elements import APPEARANCE, CARRIED, INFORMATION
from simspec.imports.usd.stage import PREFIX, STALE, PrimRead, agree, first_of
from simspec.language.shapes import FEWEST_VERTICES, MOST_VERTICES
from simspec.meshes.load import MeshOptions, load
from simspec.meshes.reading import MeshError
from simspec.world import frames
from simspec.world.types import Pose, Quaternion, Vector3

# Where prims are: their stacks of operations as rigid poses and factors along axes, in metres.
#
# Operations that only move and turn are composed as they are written, in doubles; a place below other factors than 1 is taken
# from the matrix that USD computes.

UNIT_SCALE: Final = (1.0, 1.0, 1.0)
SAME: Final = Pose()
SHEARED: Final = 1e-4
"""Cosine between two axes of a shape up to which they are at right angles: files have single precision."""
ROTATIONS: Final = "unit-rotations"
UNIT: Final = 1e-2
"""How far from 1 a quaternion's length may be; the language's own bound."""
ALIKE: Final = 1e-6
"""Relative deviation of factors that are the same but for single precision."""


@dataclass(frozen=True, slots=True)
class PrimPlace:
    """A rigid pose (m), and factors along the axes that it gives."""

    pose: Pose = SAME
    scale: Vector3 = UNIT_SCALE


class PrimPlaces:
    """Where prims are against each other. ``metres``: of one unit of the stage."""

    def __init__(self, metres: float, upright: bool):
        self.metres = metres
        self.upright = upright
        """Whether z is up; else y is, and the world is turned."""
        self._local = functools.cache(self._read)

    def world(self, prim: PrimRead) -> PrimPlace:
        """The place of a prim in the world. Raises SpecError where axes are not at right angles."""
        place = self.within(prim, None)
        return place if self.upright else PrimPlace(frames.compose(UPRIGHT, place.pose), place.scale)

    def within(self, prim: PrimRead, body: PrimRead | None) -> PrimPlace:
        """The place of a prim in the rigid frame of one that it is in, or itself; None: in the stage."""
        chain: list[PrimRead] = []
        closed = False
        for above in prim.ancestors():
            if above is body:
                closed = True
                break
            chain.append(above)
            if above.record.get("reset"):
                break
        if body is not None and not closed:  # a prim that stands in the body does not move with its place
            place = self.within(prim, None)
            return PrimPlace(frames.compose(frames.inverse(self.within(body, None).pose), place.pose), place.scale)
        start = UNIT_SCALE if body is None else self.within(body, None).scale
        return (self._composed(chain) if start == UNIT_SCALE else None) or self._by_matrix(prim, body)

    def _composed(self, chain: list[PrimRead]) -> PrimPlace | None:
        """The place of the first of a chain of prims in what is around the last; None where factors stand in between."""
        pose = Pose()
        for index, prim in enumerate(reversed(chain)):
            operations = self._local(prim)
            if operations is None or (operations.scale != UNIT_SCALE and index < len(chain) - 1):
                return None
            pose = frames.compose(pose, operations.pose)
        scale = self._local(chain[0]) if chain else None
        return PrimPlace(pose, scale.scale if scale is not None else UNIT_SCALE)

    def _by_matrix(self, prim: PrimRead, body: PrimRead | None) -> PrimPlace:
        matrix = _matrix(prim)
        if body is not None:
            around = self.within(body, None).pose
            rigid = np.eye(4)
            rigid[:3, :3] = frames.matrix(around.quaternion)
            rigid[:3, 3] = np.array(around.position) / self.metres
            matrix = np.linalg.inv(rigid) @ matrix
        return self._of_matrix(matrix, prim)

    def _of_matrix(self, matrix: NDArray[np.float64], prim: PrimRead) -> PrimPlace:
        """A matrix as a pose and factors. Raises SpecError where it has none."""
        axes = matrix[:3, :3]
        factors = np.linalg.norm(axes, axis=0)
        if not np.isfinite(matrix).all() or factors.min() == 0.0:
            raise prim.error("its transformation leaves no volume, or is not finite", code="I102")
        if float(np.ptp(factors)) <= ALIKE * float(factors.max()):
            factors[:] = factors.mean()
        factors[np.abs(factors - 1.0) <= ALIKE] = 1.0
        unit = axes / np.linalg.norm(axes, axis=0)
        if np.abs(unit.T @ unit - np.eye(3)).max() > SHEARED:
            raise prim.error(
                "its axes are not at right angles to each other: sheared shapes are not supported", code="I104"
            )
        if np.linalg.det(unit) < 0.0:
            unit[:, 0], factors[0] = -unit[:, 0], -factors[0]
        rows: Any = tuple(tuple(row) for row in unit.tolist())
        turn = frames.from_matrix(rows)
        origin = frames.vector3(float(value) * self.metres for value in matrix[:3, 3])
        return PrimPlace(Pose(origin, frames.IDENTITY if 1.0 - turn[0] < 1e-14 else turn), tuple(factors.tolist()))

    def _read(self, prim: PrimRead) -> PrimPlace | None:
        """A prim's own operations; None where they are no pose with factors after it."""
        pose, scale = Pose(), UNIT_SCALE
        for name, kind, inverse, value in prim.record.get("ops", ()):
            prim._taken.add(name.removeprefix("!invert!"))
            if value is None:
                continue
            if scale != UNIT_SCALE:
                return None
            if kind == "Scale":
                if inverse:
                    return None
                scale = tuple(map(float, value))  # type: ignore[assignment]
                if 0.0 in scale:
                    raise prim.error("a factor of 0 leaves no volume", found=str(value)[:80], code="I102")
                continue
            operations = self._pose(prim, kind, value)
            if operations is None:
                return None
            pose = frames.compose(pose, frames.inverse(operations) if inverse else operations)
        return PrimPlace(pose, scale)

    def _pose(self, prim: PrimRead, kind: str, value: Any) -> Pose | None:
        values = value if isinstance(value, list) else [value]
        if any(not isinstance(item, (int, float)) for item in values):
            raise prim.error("a transformation should be finite", found=str(value)[:80], code="I102")
        if kind == "Translate":
            return Pose(frames.vector3(self.metres * item for item in values))
        if kind == "Orient":
            return Pose(quaternion=quaternion(prim, "xformOp:orient", values))
        if kind.startswith("Rotate"):
            axes = kind.removeprefix("Rotate")
            if len(axes) != len(values):
                return None
            turn = frames.IDENTITY
            angles = dict(zip("XYZ" if len(axes) == 3 else axes, values, strict=True))
            for axis in axes:  # the first is the innermost
                turn = frames.multiply(_about(axis, math.radians(angles[axis])), turn)
            return Pose(quaternion=turn)
        return None


def quaternion(prim: PrimRead, name: str, values: Any) -> Quaternion:
    """A unit quaternion w x y z. Raises SpecError for what is none; another length than 1 is a defect, which a rule repairs."""
    w, x, y, z = values
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if length == 0.0 or not (abs(length - 1.0) <= UNIT or prim.forgiving):
        hint = f"simspec import --repair {ROTATIONS}: quaternions of another length than 1 become unit quaternions"
        message = f"{name} is no rotation: its length is {length:g}"
        raise prim.error(message, found=str(values)[:80], hint=hint if length else None, code="I102")
    if abs(length - 1.0) > UNIT:
        prim.set_aside(name, CARRIED, f"made a unit quaternion by the rule {ROTATIONS}")
    return frames.normalise((w, x, y, z))


def _about(axis: str, angle: float) -> Quaternion:
    unit: Vector3 = tuple(1.0 if axis == word else 0.0 for word in "XYZ")  # type: ignore[assignment]
    return frames.from_axis_angle(unit, angle)


UPRIGHT: Final = Pose(quaternion=_about("X", math.pi / 2.0))
"""Where the axes of a stage with y up are in a world with z up."""


def _matrix(prim: PrimRead) -> NDArray[np.float64]:
    for above in prim.ancestors():
        if "world" in above.record:
            values = above.record["world"]
            if any(not isinstance(item, (int, float)) for item in values):
                raise above.error("a transformation should be finite", code="I102")
            return np.array(values, float).reshape(4, 4).T
    return np.eye(4)


COLLISION: Final = "PhysicsCollisionAPI"
PRIMITIVES: Final = ("Cube", "Sphere", "Cylinder", "Cylinder_1", "Capsule", "Capsule_1", "Cone", "Plane")
GEOMETRY: Final = (*PRIMITIVES, "Mesh")
AXES: Final = ("X", "Y", "Z")
TOWARDS: Final[dict[str, Quaternion]] = {
    "X": (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0),
    "Y": (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0),
    "Z": frames.IDENTITY,
}
"""The rotation from z to an axis."""
CORNERS: Final = 64
"""Of the hull that stands for a cone."""
MARGINS: Final = ("newton:contactMargin", "mjc:margin")
"""Attributes for the distance at which contact begins, the first of which holds."""
EMPTY: Final = "empty-shapes"
COLOUR: Final = [0.7, 0.7, 0.7, 1.0]
"""The language's default."""
HULLS: Final = (
    *("convexHull", "convexDecomposition", "meshSimplification", "none", "sdf", "boundingCube", "boundingSphere"),
)


@dataclass
class UsdShapeRead:
    """A shape of a body, in the body's frame."""

    prim: PrimRead
    data: dict[str, Any]
    pose: Pose
    collision: bool
    visual: bool
    name: str = ""
    colour: list[float] | None = None
    material: str = ""
    """The path of its material of physics."""
    obj: bytes = b""
    """The file of a mesh."""
    sizes: tuple[str, tuple[float, ...]] | None = None
    """The kind and the size as a world has them; None for a mesh."""

    def written(self, offset: Vector3, default_name: str) -> dict[str, Any]:
        """The words of the shape, in a body whose frame is at ``offset``."""
        data: dict[str, Any] = {"name": self.name} if self.name not in ("", default_name) else {}
        data |= self.data
        place = Pose(frames.subtract(self.pose.position, offset), self.pose.quaternion)
        if said := pose_data(place):
            data["pose"] = said
        if not self.collision:
            data["collision"] = False
        if not self.visual:
            data["visual"] = False
        if self.colour is not None and self.colour != COLOUR:
            data["colour"] = numbers(self.colour)
        return data


def pose_data(pose: Pose) -> dict[str, Any]:
    """A pose as the language has it; {} for the identity."""
    data: dict[str, Any] = {}
    if any(pose.position):
        data["xyz"] = numbers(pose.position)
    if pose.quaternion != frames.IDENTITY:
        data["quat"] = numbers(pose.quaternion)
    return data


@dataclass
class ShapeReader:
    """Reads the shapes of bodies."""

    places: PrimPlaces
    draft: Draft

    def read(self, prim: PrimRead, body: PrimRead | None) -> UsdShapeRead | None:
        """The shape of a prim of geometry in the rigid frame of a body (None: in the world); None for what is not carried."""
        prim.take()
        collides = prim.applies(COLLISION) and prim.flag("physics:collisionEnabled", True)
        purpose = prim.record.get("purpose", "default")
        seen = bool(prim.record.get("visible", True)) and purpose not in ("guide", "proxy")
        for name in ("visibility", "purpose"):
            prim.value(name)
        if not collides and not seen:
            prim.ignore(None, "it does not collide and is not drawn")
            return None
        factors = [value for _, kind, _, value in prim.record.get("ops", ()) if kind == "Scale" and value is not None]
        if flat := next((str(value) for value in factors if 0.0 in map(float, value)), ""):
            shape = UsdShapeRead(prim, {}, Pose(), collides, seen, prim.called())
            self._refuse(shape, "a factor of 0 leaves no volume", flat[:80])
            return None
        place = self.places.world(prim) if body is None else self.places.within(prim, body)
        shape = UsdShapeRead(prim, {}, place.pose, collides, seen, prim.called())
        shape.colour = _colour(prim)
        if prim.tag == "Mesh":
            self._mesh(shape, place)
        else:
            self._primitive(shape, place)
        if shape.data and collides and (margin := first_of(prim, dict.fromkeys(MARGINS, self.places.metres))) > 0.0:
            shape.data["margin"] = plain(margin)
        return shape if shape.data else None

    def _primitive(self, shape: UsdShapeRead, place: PrimPlace) -> None:
        prim, metres = shape.prim, self.places.metres
        scale = tuple(abs(factor) for factor in place.scale)
        kind = prim.tag.removesuffix("_1")
        if kind == "Cube":
            size = prim.real("size", 2.0) * metres
            self._of(shape, "box", [size * factor for factor in scale])
            return
        if kind == "Sphere":
            radius = prim.real("radius", 1.0) * metres
            if max(scale) - min(scale) <= ALIKE * max(scale):
                self._of(shape, "sphere", [radius * scale[0]])
            else:
                self._of(shape, "ellipsoid", [radius * factor for factor in scale])
            return
        axis = prim.token("axis", "Z")
        if axis not in AXES:
            raise prim.error("not an axis", found=axis[:20], allowed="X, Y, Z", code="I101")
        turn = Pose(quaternion=TOWARDS[axis])
        if kind == "Plane":
            for name in ("width", "length"):
                prim.ignore(name, "a plane has no end", APPEARANCE)
            shape.data, shape.pose, shape.sizes = {"plane": {}}, frames.compose(shape.pose, turn), ("plane", ())
            return
        along = scale[AXES.index(axis)]
        across = [factor for word, factor in zip(AXES, scale, strict=True) if word != axis]
        if abs(across[0] - across[1]) > ALIKE * max(across):
            self._refuse(shape, f"a {kind.lower()} with an elliptical section is not supported")
            return
        radius = self._radius(prim) * metres * across[0]
        height = prim.real("height", 2.0 if kind != "Capsule" else 1.0) * metres * along
        if kind == "Cone":
            self._cone(shape, radius, height, axis)
            return
        if kind == "Capsule" and abs(along - across[0]) > ALIKE * along:
            shape.prim.lose("height", "a capsule with another factor along its axis: its caps stay round")
        shape.pose = frames.compose(shape.pose, turn)
        self._of(shape, kind.lower(), [radius, height])

    def _radius(self, prim: PrimRead) -> float:
        if not prim.tag.endswith("_1"):
            return prim.real("radius", 0.5 if prim.tag == "Capsule" else 1.0)
        default = 0.5 if prim.tag == "Capsule_1" else 1.0
        bottom, top = prim.real("radiusBottom", default), prim.real("radiusTop", default)
        if bottom != top:
            raise prim.error("two radii are not supported", found=f"{bottom:g}, {top:g}", code="I104")
        return bottom

    def _of(self, shape: UsdShapeRead, kind: str, size: list[float]) -> None:
        if min(size) <= 0.0:
            self._refuse(shape, "the lengths of a shape must be above 0", str(size))
            return
        shape.sizes, shape.data = (kind, tuple(size)), shape_data(kind, size)

    def _cone(self, shape: UsdShapeRead, radius: float, height: float, axis: str) -> None:
        """A cone as the hull of its tip and of a polygon around its base: the volume is 0.16 % less."""
        turns = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
        base = np.stack([radius * np.cos(turns), radius * np.sin(turns), np.full(CORNERS, -0.5 * height)], axis=1)
        points = np.vstack([base, [[0.0, 0.0, 0.5 * height]]])
        faces = [(k, (k + 1) % CORNERS, CORNERS) for k in range(CORNERS)]
        faces += [(0, k + 1, k) for k in range(1, CORNERS - 1)]
        shape.pose = frames.compose(shape.pose, Pose(quaternion=TOWARDS[axis]))
        shape.prim.lose("radius", f"a hull with {CORNERS} corners around its base stands for a cone")
        self._file(shape, points, faces)

    def _mesh(self, shape: UsdShapeRead, place: PrimPlace) -> None:
        prim = shape.prim
        points, counts, indices = (prim.array(name) for name in ("points", "faceVertexCounts", "faceVertexIndices"))
        if points is None or counts is None or indices is None or points.ndim != 2:
            self._refuse(shape, "a mesh without points or faces")
            return
        stored = prim.array(f"{PREFIX}points")
        if stored is not None:
            same = stored.shape == points.shape and agree(stored.ravel().tolist(), points.ravel().tolist())
            points = stored if same else points
            if not same:
                prim.lose(f"{PREFIX}points", STALE, INFORMATION)
        if not np.isfinite(points).all():
            raise prim.error("the points of a mesh should be finite", code="I102")
        wrong = counts.size and (counts.min() < 0 or int(counts.sum()) != indices.size)
        if wrong or (indices.size and (indices.min() < 0 or indices.max() >= len(points))):
            raise prim.error("faces of a mesh name points that it does not have", code="I102")
        if shape.collision:
            self._approximation(prim)
        factors = np.array(place.scale) * self.places.metres
        faces = list(_triangles(counts, indices))
        if float(np.prod(factors)) < 0.0:
            faces = [(a, c, b) for a, b, c in faces]
        if prim.token("orientation", "rightHanded") == "leftHanded":
            faces = [(a, c, b) for a, b, c in faces]
        self._file(shape, points * factors if place.scale != UNIT_SCALE or self.places.metres != 1.0 else points, faces)

    def _approximation(self, prim: PrimRead) -> None:
        said = prim.token("physics:approximation", "none")
        prim.applies("PhysicsMeshCollisionAPI")
        if said not in HULLS:
            raise prim.error("not an approximation of a mesh", found=said[:40], allowed=", ".join(HULLS), code="I101")
        if said != "convexHull":
            where = "physics:approximation" if prim.has("physics:approximation") else "points"
            prim.lose(where, f"approximation {said}: the convex hull stands for it")

    def _file(self, shape: UsdShapeRead, points: NDArray[np.float64], faces: list[tuple[int, int, int]]) -> None:
        lines = [BEGINNING.decode()]
        lines += ["v " + " ".join(repr(float(value)) for value in point) for point in points.tolist()]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
        most = shape.prim.real("newton:maxHullVertices", -1.0) if shape.collision else -1.0
        shape.obj = ("\n".join(lines) + "\n").encode()
        shape.data = {"mesh": {"max_vertices": int(most)} if FEWEST_VERTICES <= most <= MOST_VERTICES else {}}

    def _refuse(self, shape: UsdShapeRead, message: str, found: str = "") -> None:
        refuse(shape, self.draft, message, found)


def refuse(shape: UsdShapeRead, draft: Draft, message: str, found: str = "") -> None:
    """Leave a shape out: one that is only drawn, or by the rule; else it is a defect."""
    prim = shape.prim
    shape.data = {}
    if not shape.collision:
        prim.lose(None, f"{message}: not drawn", APPEARANCE)
    elif draft.mend(EMPTY, prim, message, f"{prim.path} is left out: {message}", ("bodies",), found or None):
        prim.lose(None, f"left out by the rule {EMPTY}: {message}")


def _triangles(counts: NDArray[Any], indices: NDArray[Any]) -> Iterator[tuple[int, int, int]]:
    """Faces as fans of triangles."""
    start, flat = 0, indices.tolist()
    for count in counts.tolist():
        face = flat[start : start + count]
        start += count
        for k in range(1, count - 1):
            yield face[0], face[k], face[k + 1]


def _colour(prim: PrimRead) -> list[float] | None:
    attributes = prim.record["attributes"]
    colours, opacities = (attributes.get(f"primvars:display{word}") for word in ("Color", "Opacity"))
    if colours is None or not colours.get("value") or len(colours["value"]) != 1:
        return None
    rgb = colours["value"][0]
    opacity = (opacities or {}).get("value") or [1.0]
    values = [*rgb, opacity[0]]
    if any(not isinstance(value, (int, float)) for value in values):
        return None
    prim.value("primvars:displayColor")
    prim.value("primvars:displayOpacity")
    clipped = [min(1.0, max(0.0, float(value))) for value in values]
    said = prim.exactly("colour", clipped)
    return numbers(said if said != tuple(clipped) else [float(np.float32(value).astype(str)) for value in clipped])


def name_meshes(shapes: Sequence[UsdShapeRead], draft: Draft) -> set[int]:
    """Write and name the meshes of shapes; the ``id`` of each shape that can be used."""
    meshes = [shape for shape in shapes if shape.obj]
    paths: list[Path] = []
    for shape in meshes:
        text, path = made_file(shape.obj, shape.prim.called())
        paths.append(path)
        draft.meshes[text] = path
        shape.data = {**shape.data, "mesh": {"file": text, **shape.data["mesh"]}}
    made = load([(path, MeshOptions()) for path in paths], MOST_VERTICES)
    usable = {id(shape) for shape in shapes if shape.data}
    for shape, path in zip(meshes, paths, strict=True):
        result = made[path, MeshOptions()]
        if isinstance(result, MeshError):
            draft.meshes.pop(shape.data["mesh"]["file"], None)
            refuse(shape, draft, str(result))
            usable.discard(id(shape))
        elif result.enclosed is None:
            shape.data["mesh"]["mass_from"] = "hull"
    return usable
