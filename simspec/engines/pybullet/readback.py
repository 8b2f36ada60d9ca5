"""PyBullet's read-back, in the world's frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.pybullet.sidecar import LINK_MARGIN, PybulletInstance
from simspec.engines.pybullet.actuation import PybulletEfforts
from simspec.engines.pybullet.bullet_file import colliders, dump
from simspec.engines.pybullet.constraints import read_constraints
from simspec.engines.pybullet.geometry import Alike, Hulls, StoredMesh
from simspec.engines.pybullet.simulation import PybulletSimulation
from simspec.engines.pybullet.trees import (
    JOINT_KINDS,
    SHAPE_KINDS,
    Link,
    PybulletTree,
    joint_fields,
    joint_pose,
    pose_at,
    shape_size,
    solid_on_link,
)
from simspec.errors import EngineError
from simspec.formats.kit.contract import restore_frames, tensor
from simspec.formats.kit.mesh_reading import SUFFIX, read_field, read_triangles
from simspec.formats.kit.text import FIELDS
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import Body, Hardness, Inertial, Joint, Pose, Quaternion, ReadBack, Shape, Surface

WITHIN = ("box", "cylinder")
"""Kinds of shapes that have PyBullet's margin within them; how large it is compares the inventory."""

UP = (0.0, 0.0, 1.0)
"""Normal of a plane in its own frame; the world has no other, and turns the frame."""


@dataclasses.dataclass(frozen=True, slots=True)
class StoredHulls:
    """PyBullet's meshes: of every link (tree's uid, link) that has some, in their order; and which are the same."""

    of: Mapping[tuple[int, int], Sequence[StoredMesh]]
    alike: Alike = dataclasses.field(default_factory=Alike)


SINGLE = 2.0**-23
"""Relative precision of PyBullet's triangles."""
SAME_SHAPE = 1e-9
"""Relative and absolute: a visual shape of the same kind, size and pose as a collision shape is the same shape. Both were
printed from one, so that only round-off (1e-15) can stand between them."""


def read_back(sim: PybulletSimulation, efforts: PybulletEfforts) -> ReadBack:
    """The model and its present state as PyBullet holds them."""
    q, v = sim.get_state()
    hulls = _stored_hulls(sim)
    bodies: dict[int, Body] = {}
    for tree, instance in zip(sim.trees, sim.sidecar.instances, strict=True):
        frames_in_tree = {link: pose_at(sim.bullet.getDynamicsInfo(tree.uid, link), 3) for link in _links(sim, tree)}
        by_link = {link.link: link for link in tree.links}
        visuals = _visual_shapes(sim, tree, hulls.alike)
        for position, link in enumerate(tree.links):
            joint = _joint(sim, tree, link, frames_in_tree, by_link, efforts)
            joint = dataclasses.replace(
                joint,
                name=instance.joints[position],
                position=tuple(q[link.q].tolist()),
                velocity=tuple(v[link.v].tolist()),
            )
            if link.kind == "free":
                joint = _free_state(joint, frames_in_tree[link.link])
            moments = tuple(sim.moments[link.index].tolist())
            centre = tuple(sim.centre[link.index].tolist())
            bodies[link.index] = Body(
                sim.names[link.index],
                instance.model,
                Inertial(float(sim.mass[link.index]), centre, tensor(moments, link.turn)),
                joint,
                _body_shapes(sim, tree, instance, position, visuals.get(link.link, []), hulls),
            )
    bodies |= {sim.place[name]: body for name, body in sim.frames.bodies().items()}
    offsets = {name: tuple(offset) for name, offset in zip(sim.names, sim.offsets.tolist(), strict=True) if any(offset)}
    parameters = sim.bullet.getPhysicsEngineParameters()
    return ReadBack(
        restore_frames(tuple(bodies[index] for index in range(len(sim.names))), offsets),
        tuple(parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"),
        parameters["fixedTimeStep"],
        sim.sidecar.friction_cone,
        constraints=read_constraints(sim),
        sums=efforts.sums,
    )


def _free_state(joint: Joint, inertial: Pose) -> Joint:
    """From generalised coordinates (centre of mass; ω in body axes) to those of the file's body frame."""
    x, y, z, *quaternion = joint.position
    vx, vy, vz, *rates = joint.velocity
    turn: Quaternion = (quaternion[0], quaternion[1], quaternion[2], quaternion[3])
    lever = frames.rotate(turn, inertial.position)
    angular = frames.rotate(turn, (rates[0], rates[1], rates[2]))
    linear = frames.subtract((vx, vy, vz), frames.cross(angular, lever))
    return dataclasses.replace(
        joint,
        position=(*frames.subtract((x, y, z), lever), *turn),
        velocity=(*linear, *angular),
    )


def _base_pose(sim: PybulletSimulation, tree: PybulletTree, inertial: Pose) -> Pose:
    place = pose_at(sim.bullet.getBasePositionAndOrientation(tree.uid), 0)
    return frames.compose(place, frames.inverse(inertial))


def _joint(
    sim: PybulletSimulation,
    tree: PybulletTree,
    link: Link,
    inertials: dict[int, Pose],
    by_link: dict[int, Link],
    efforts: PybulletEfforts,
) -> Joint:
    if link.link < 0:
        if tree.root == "free":
            return Joint("", "free")
        return Joint("", "fixed", None, _base_pose(sim, tree, inertials[-1]))
    info: tuple[Any, ...] = sim.bullet.getJointInfo(tree.uid, link.link)
    above, kind = info[16], JOINT_KINDS[info[2]]  # the sidecar's, which is checked while loading
    origin = joint_pose(info, inertials[above], inertials[link.link])
    if above not in by_link:
        origin = frames.compose(_base_pose(sim, tree, inertials[above]), origin)
    stiffness, rest = efforts.springs.get(link.index, (0.0, 0.0))
    return Joint(
        "",
        kind,
        sim.names[by_link[above].index] if above in by_link else None,
        origin,
        **joint_fields(info, kind, inertials[link.link]),
        armature=float(efforts.armature[link.v][0]) if kind in SCALAR_JOINTS else 0.0,
        spring_stiffness=stiffness,
        spring_rest=rest,
    )


def _stored_hulls(sim: PybulletSimulation) -> StoredHulls:
    """The hulls that PyBullet made of meshes: of every link (tree's uid, link) that has some, in their order."""
    shapes = (shape for tree in sim.trees for link in _links(sim, tree) for shape in _link_shapes(sim, tree, link))
    if not any(_kind(shape[2]) == "mesh" for shape in shapes):
        return StoredHulls({})
    blocks = dump(sim.bullet)
    hulls = Hulls(blocks)
    return StoredHulls(
        {key: hulls.of(address) for key, address, _ in colliders([tree.uid for tree in sim.trees], blocks)}
    )


def _links(sim: PybulletSimulation, tree: PybulletTree) -> range:
    return range(-1, sim.bullet.getNumJoints(tree.uid))


def _link_shapes(sim: PybulletSimulation, tree: PybulletTree, link: int) -> Sequence[Any]:
    shapes: Sequence[Any] = sim.bullet.getCollisionShapeData(tree.uid, link)
    return shapes


def _body_shapes(
    sim: PybulletSimulation,
    tree: PybulletTree,
    instance: PybulletInstance,
    position: int,
    visuals: list[Shape],
    hulls: StoredHulls,
) -> tuple[Shape, ...]:
    """The shapes of a body: those of its own link, and those that links of their own carry, each once with a surface for
    every copy, in the order of layers."""
    names, visual_only = instance.shapes[position], instance.visual_only[position]
    carried = [
        (copy.layer, copy.shapes, _solid(sim, tree, link, hulls))
        for (link, _), copy in zip(tree.copies, instance.copies, strict=True)
        if copy.body == instance.bodies[position]
    ]
    others = {name for _, some, _ in carried for name in some}
    shapes_of_link = _solid(sim, tree, tree.links[position].link, hulls)
    solid = [name for index, name in enumerate(names) if index not in visual_only]
    layer = instance.layers[position] if carried else 0
    copies = [(layer, solid_on_link(instance, position), shapes_of_link), *carried]
    if any(len(some) != len(shapes) for _, some, shapes in copies) or not others <= set(solid):
        return tuple(_with_visuals([shape for _, _, shapes in copies for shape in shapes], visuals, hulls.alike))
    found: dict[str, Shape] = {}
    for _, some, actual in sorted(copies, key=lambda copy: copy[0]):
        for name, shape in zip(some, actual, strict=True):
            known = found.get(name)
            if known is None:
                found[name] = dataclasses.replace(shape, name=name)
            elif not _same(known, shape, hulls.alike):
                raise EngineError("pybullet", f"holds a copy of shape {name!r} that is unlike the shape")
            else:
                found[name] = dataclasses.replace(known, surfaces=(*known.surfaces, *shape.surfaces))
    actual = [found[name] for name in solid]
    ordered = _in_order(actual, visuals, len(names), visual_only, hulls.alike)
    shapes = ordered or _with_visuals(actual, visuals, hulls.alike)
    return _named(tuple(shapes), names, visual_only)


def _solid(sim: PybulletSimulation, tree: PybulletTree, link: int, hulls: StoredHulls) -> list[Shape]:
    """The collision shapes of one link, without names, with the link's surface."""
    p = sim.bullet
    info = p.getDynamicsInfo(tree.uid, link)
    inertial = pose_at(info, 3)
    surface = Surface(info[1], info[7], info[6], info[5], _hardness(sim, info[9], info[8]))
    found = []
    left = list(hulls.of.get((tree.uid, link), ()))
    for entry in _link_shapes(sim, tree, link):
        kind = _kind(entry[2])
        if kind == "mesh" and not left:
            raise EngineError("pybullet", f"holds a mesh of link {link} without a hull")
        size, margin = shape_size(kind, entry[3]) if kind != "mesh" else (), 0.0
        if kind in WITHIN:
            margin = float(sim.settings["collision_margin"]) if link < 0 else LINK_MARGIN
        if kind == "mesh":
            mesh = left.pop(0)
            kind, size, margin = ("heightfield", mesh.size, 0.0) if mesh.field else ("mesh", mesh.size, mesh.margin)
            hulls.alike.of_file(size, (entry[4], entry[3]))
        if kind == "plane" and tuple(entry[3]) != UP:
            raise EngineError("pybullet", f"holds a plane of link {link} with the normal {tuple(entry[3])}, not {UP}")
        pose = frames.compose(inertial, pose_at(entry, 5))
        found.append(Shape("", kind, size, pose, visual=False, surfaces=(surface,), rounding=margin))
    return found


def _hardness(sim: PybulletSimulation, stiffness: float, damping: float) -> Hardness:
    """The combination of two links of this kind: springs in series, dampers in sum."""
    if stiffness > 0.0:
        return Hardness("stiffness", stiffness=stiffness / 2.0, damping=2.0 * damping)
    return Hardness("native") if sim.sidecar.native_contact else Hardness()


def _with_visuals(solid: list[Shape], visuals: list[Shape], alike: Alike) -> list[Shape]:
    """Collision shapes that are also seen, and after them shapes that only are seen."""
    rest = list(visuals)
    found = []
    for shape in solid:
        same = next((visual for visual in rest if _same(shape, visual, alike)), None)
        if same is not None:
            rest.remove(same)
            shape = dataclasses.replace(shape, visual=True, colour=same.colour)
        found.append(shape)
    return [*found, *rest]


def _in_order(
    solid: list[Shape], visuals: list[Shape], count: int, visual_only: Sequence[int], alike: Alike
) -> list[Shape] | None:
    """The same for the ``count`` shapes of a body, of which those at ``visual_only`` only are seen: visuals are in the order of
    the shapes, so that a visual shape is distinguished from a solid one like it; of two solids alike in one place the first is
    taken for the one that is seen. None where visuals and shapes do not fit."""
    alone = set(visual_only)
    if len(solid) + len(alone) != count:
        return None
    left = iter(solid)
    places = [None if index in alone else next(left) for index in range(count)]
    fits = [[False] * (len(visuals) + 1) for _ in range(count + 1)]
    fits[count][len(visuals)] = True
    for index in reversed(range(count)):
        place = places[index]
        for taken in range(len(visuals) + 1):
            takes = taken < len(visuals) and fits[index + 1][taken + 1]
            takes = takes and (place is None or _same(place, visuals[taken], alike))
            fits[index][taken] = takes or (place is not None and fits[index + 1][taken])
    if not fits[0][0]:
        return None
    taken, solids, seen = 0, [], []
    for index, place in enumerate(places):
        takes = taken < len(visuals) and fits[index + 1][taken + 1]
        if place is None:
            seen.append(visuals[taken])
        elif takes and _same(place, visuals[taken], alike):
            solids.append(dataclasses.replace(place, visual=True, colour=visuals[taken].colour))
        else:
            solids.append(place)
            continue
        taken += 1
    return [*solids, *seen]


def _named(shapes: tuple[Shape, ...], names: Sequence[str], visual_only: Sequence[int]) -> tuple[Shape, ...]:
    """Shapes in the world's order, under the world's names, which PyBullet does not keep.

    A count that differs from the sidecar's leaves them as they came, without names.
    """
    solid = [shape for shape in shapes if shape.collision]
    seen = [shape for shape in shapes if not shape.collision]
    if len(shapes) != len(names) or len(seen) != len(visual_only):
        return shapes
    ordered = [seen.pop(0) if place in visual_only else solid.pop(0) for place in range(len(names))]
    return tuple(dataclasses.replace(shape, name=name) for shape, name in zip(ordered, names, strict=True))


def _kind(number: int) -> str:
    if number not in SHAPE_KINDS:
        raise EngineError("pybullet", f"holds a shape of its type {number}, unknown here")
    return SHAPE_KINDS[number]


def _visual_shapes(sim: PybulletSimulation, tree: PybulletTree, alike: Alike) -> dict[int, list[Shape]]:
    found: dict[int, list[Shape]] = {}
    for entry in sim.bullet.getVisualShapeData(tree.uid):
        kind = _kind(entry[2])
        pose = pose_at(entry, 5)
        if kind == "mesh":
            kind, size = _seen_mesh(sim, entry)
            alike.of_file(size, (entry[4], entry[3]))
        else:
            size = shape_size(kind, entry[3])
        if kind != "plane" and not any(size):
            continue  # nothing to be seen: it keeps PyBullet from showing the collision shapes
        shape = Shape("", kind, size, pose, collision=False, colour=tuple(entry[7]))
        found.setdefault(entry[1], []).append(shape)
    return found


def _seen_mesh(sim: PybulletSimulation, entry: Any) -> tuple[str, tuple[float, ...]]:
    """The kind of a mesh, and the vertices in the file that PyBullet names, as it scales them: of visual shapes it reports
    nothing else."""
    try:
        path = Path(entry[4].decode()).relative_to(sim.loaded_from)
        if path.parts[0] == FIELDS and tuple(entry[3]) == (1.0, 1.0, 1.0):
            return "heightfield", read_field(sim.folder, path.as_posix())
        vertices, _ = read_triangles(sim.folder, path.with_suffix(SUFFIX).as_posix())
    except (ValueError, FileNotFoundError) as error:
        raise EngineError("pybullet", f"shows the mesh {entry[4]!r}: {error}") from error
    return "mesh", tuple((vertices * np.array(entry[3])).ravel().tolist())


def _same(shape: Shape, other: Shape, alike: Alike) -> bool:
    if shape.kind != other.kind:
        return False
    sizes = ((), ()) if shape.kind in ("mesh", "heightfield") else (shape.size, other.size)
    there = np.allclose(
        (*sizes[0], *shape.pose.position, *np.abs(shape.pose.quaternion)),
        (*sizes[1], *other.pose.position, *np.abs(other.pose.quaternion)),
        rtol=SAME_SHAPE,
        atol=SAME_SHAPE,
    )
    if not there or shape.kind not in ("mesh", "heightfield"):
        return bool(there)
    return alike(shape.size, other.size) if shape.kind == "mesh" else _same_field(shape.size, other.size)


def _same_field(first: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two height fields are the same, within single precision, in which those that touch are held."""
    return len(first) == len(other) and bool(np.allclose(first, other, rtol=0.0, atol=SINGLE * max(*first, *other)))
