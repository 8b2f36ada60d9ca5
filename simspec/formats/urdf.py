"""World to URDF, in the dialect that PyBullet reads: one file for each distinct tree, and a sidecar for the rest.

The dialect: joints of type ``spherical``, geometries ``capsule`` and ``plane``, and a ``contact`` element in a link with its
friction and restitution. What URDF cannot say (where a tree stands, its initial state, springs, armature, collision
filters, solver settings) goes into the sidecar.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar

from simspec.errors import Problem, UnsupportedError
from simspec.features import EXACT, Feature, Support, Table, unsupported, via_api
from simspec.formats.base import SIDECAR, Format, Target, environment, sidecar, sidecar_text
from simspec.formats.passes import (
    excluded_pairs_to_write,
    principal_axes,
    recentre_free_roots,
    solid_shapes,
)
from simspec.world import frames
from simspec.world.kinematics import initial_state, layout, rigid_groups, trees
from simspec.world.types import POSITION_SIZE, Body, Pose, ReadBack, Shape, Surface, World

JOINT_TYPES = {"fixed": "fixed", "hinge": "continuous", "slide": "prismatic", "ball": "spherical"}
"""URDF's name of each joint kind; a hinge with position limits is ``revolute``."""

UNLIMITED_SLIDE = (("lower", 1.0), ("upper", -1.0))
"""URDF has no unlimited prismatic joint; PyBullet takes lower > upper as one."""

GEOMETRY: Mapping[str, tuple[str, tuple[tuple[str, slice], ...]]] = {
    "sphere": ("sphere", (("radius", slice(0, 1)),)),
    "box": ("box", (("size", slice(0, 3)),)),
    "cylinder": ("cylinder", (("radius", slice(0, 1)), ("length", slice(1, 2)))),
    "capsule": ("capsule", (("radius", slice(0, 1)), ("length", slice(1, 2)))),
}
"""For each shape kind the URDF element, and which part of ``Shape.size`` goes into which attribute."""

PLANE = ("plane", (("normal", (0.0, 0.0, 1.0)),))

FILTER_BITS = 31
"""Collision classes that PyBullet's 32-bit group masks can tell apart (the sign bit left alone)."""

POSITION_NUMBERS = 128
"""Numbers that PyBullet exchanges of one tree's position, 7 of them for its base, fixed or not; beyond that it gives
states of some joints as empty, without a word (measured: 121 hinges work, 122 do not)."""

WORLD_SUFFIX = "__world"
"""Added to a root's name for the massless base link that stands for the world."""

_SIDECAR = "in the sidecar, set through the engine's API"


class Urdf(Format):
    """URDF with PyBullet's extensions."""

    NAME: ClassVar[str] = "urdf"
    SUPPORT: ClassVar[Table] = {
        Feature.JOINT_FIXED: EXACT,
        Feature.JOINT_HINGE: EXACT,
        Feature.JOINT_SLIDE: EXACT,
        Feature.JOINT_BALL: Support(EXACT.level, "as type spherical, PyBullet's extension"),
        Feature.JOINT_FREE: EXACT,
        Feature.LIMIT_POSITION: EXACT,
        Feature.LIMIT_VELOCITY: EXACT,
        Feature.LIMIT_EFFORT: EXACT,
        Feature.DAMPING: EXACT,
        Feature.BALL_DAMPING: EXACT,
        Feature.DRY_FRICTION: EXACT,
        Feature.ARMATURE: via_api(_SIDECAR),
        Feature.SPRING: via_api(_SIDECAR),
        Feature.BALL_SPRING: via_api(_SIDECAR),
        Feature.INITIAL_POSITION: via_api(_SIDECAR),
        Feature.INITIAL_VELOCITY: via_api(_SIDECAR),
        Feature.INERTIA: EXACT,
        Feature.INERTIA_FULL: Support(EXACT.level, "as principal moments with an orientation"),
        Feature.TREE_SIZE: unsupported("PyBullet holds at most 127 links besides the base in one tree"),
        Feature.TREE_DEPTH: unsupported("PyBullet holds at most 127 links besides the base in one tree"),
        Feature.SHAPE_SPHERE: EXACT,
        Feature.SHAPE_BOX: EXACT,
        Feature.SHAPE_CYLINDER: EXACT,
        Feature.SHAPE_CAPSULE: Support(EXACT.level, "PyBullet's extension"),
        Feature.SHAPE_ELLIPSOID: unsupported("neither URDF nor PyBullet has an ellipsoid"),
        Feature.SHAPE_PLANE: Support(EXACT.level, "PyBullet's extension"),
        Feature.SHAPE_VISUAL: EXACT,
        Feature.SHAPES_PER_BODY: EXACT,
        Feature.MATERIALS_PER_BODY: unsupported("PyBullet holds friction and restitution once per body, not per shape"),
        Feature.FRICTION: EXACT,
        Feature.FRICTION_PAIRS: unsupported(
            "PyBullet multiplies two numbers, one per body, and no numbers give these pairs"
        ),
        Feature.RESTITUTION: EXACT,
        Feature.RESTITUTION_PAIRS: unsupported(
            "PyBullet multiplies two numbers, one per body, and no numbers give these pairs"
        ),
        **dict.fromkeys(
            (
                Feature.RESTITUTION_THRESHOLD,
                Feature.TORSIONAL_FRICTION,
                Feature.ROLLING_FRICTION,
                Feature.HARDNESS_TIME_CONSTANT,
                Feature.HARDNESS_STIFFNESS,
                Feature.HARDNESS_NATIVE,
                Feature.HARDNESS_PAIRS,
                Feature.HARDNESS_COMMON,
                Feature.PASSING_PAIRS,
            ),
            EXACT,
        ),
        Feature.CONE_ELLIPTIC: via_api(_SIDECAR),
        Feature.CONE_PYRAMID_INSCRIBED: unsupported(
            "PyBullet has the elliptic cone and the circumscribed pyramid only"
        ),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: via_api(_SIDECAR),
        Feature.COLLISION_GROUPS: via_api(_SIDECAR),
        Feature.EXCLUDED_PAIRS: via_api(_SIDECAR),
        Feature.GRAVITY: via_api(_SIDECAR),
        Feature.TIMESTEP: via_api(_SIDECAR),
    }

    def emit(self, world: World, target: Target) -> dict[str, str]:
        """The URDF files and ``sidecar.json``. Raises UnsupportedError for a tree with too many joints for PyBullet."""
        _check_size(world)
        moved, offsets = recentre_free_roots(world)
        surfaces = _surfaces(moved, target)
        coordinates = _Coordinates(world)
        files: dict[str, str] = {}
        seen: dict[Any, str] = {}
        names: set[str] = {SIDECAR}
        instances = []
        template = environment().get_template("urdf/model.urdf.j2")
        for bodies in trees(moved).values():
            key = _content(bodies, surfaces)
            if key not in seen:
                seen[key] = _file_name(bodies[0].model, names)
                files[seen[key]] = template.render(_model(bodies, surfaces))
            instances.append(_instance(seen[key], bodies, coordinates))
        content = sidecar(
            self.NAME,
            world,
            target,
            offsets,
            gravity=world.physics.gravity,
            timestep=world.physics.timestep,
            instances=instances,
            springs=[
                {"body": body.name, "stiffness": body.joint.spring_stiffness, "rest": body.joint.spring_rest}
                for body in world.bodies
                if body.joint.spring_stiffness
            ],
            armature=[
                {"body": body.name, "armature": body.joint.armature} for body in world.bodies if body.joint.armature
            ],
            collision_filter=_collision_filter(world),
        )
        files[SIDECAR] = sidecar_text(content)
        return files

    def read(self, folder: Path) -> ReadBack:
        """Read the files with yourdfpy (see ``formats/urdf_reader.py``)."""
        from simspec.formats.urdf_reader import read_folder

        return read_folder(folder)


def _check_size(world: World) -> None:
    problems = []
    for root, bodies in trees(world).items():
        numbers = 7 + sum(POSITION_SIZE[body.joint.kind] for body in bodies if body.joint.kind != "free")
        if numbers > POSITION_NUMBERS:
            problems.append(
                Problem(
                    "PyBullet cannot have tree.size: it exchanges at most "
                    f"{POSITION_NUMBERS} position numbers of one tree, 7 of them for the base",
                    f"bodies.{root}",
                    found=f"{numbers}: a hinge or slide counts 1, a ball 4",
                    hint="split the tree, or run without this engine",
                )
            )
    if problems:
        raise UnsupportedError(problems)


class _Coordinates:
    """The world's initial state, by body."""

    def __init__(self, world: World):
        self._q, self._v = initial_state(world)
        self._places = layout(world.bodies)
        self._index = {body.name: index for index, body in enumerate(world.bodies)}

    def of(self, bodies: Iterable[Body]) -> tuple[list[float], list[float]]:
        q: list[float] = []
        v: list[float] = []
        for body in bodies:
            index = self._index[body.name]
            q.extend(self._q[self._places.position[index]].tolist())
            v.extend(self._v[self._places.velocity[index]].tolist())
        return q, v


def _surfaces(world: World, target: Target) -> dict[str, tuple[float, float]]:
    """Friction and restitution numbers of each body under the engine's combination rules."""
    found = {}
    for body in world.bodies:
        solid = solid_shapes(body)
        material = solid[0].material if solid else None
        held = target.plan.numbers[material, 0] if material is not None else Surface()
        found[body.name] = (held.friction, held.restitution)
    return found


def _file_name(name: str, taken: set[str]) -> str:
    """A safe file name for a tree, unlike those ``taken`` (also where letters' case makes no difference); adds it."""
    stem = re.sub(r"[^A-Za-z0-9_-]", ".", name).strip(".") or "tree"
    found, count = f"{stem}.urdf", 1
    while found.lower() in taken:
        count += 1
        found = f"{stem}.{count}.urdf"
    taken.add(found.lower())
    return found


def has_world_link(root: Body) -> bool:
    """Whether a tree needs a massless base link that stands for the world.

    A root on a hinge, slide or ball has a joint to the world, and PyBullet drops the mass of a fixed base (measured:
    read back as 0), so that a fixed root with a mass must be a link as well.
    """
    return root.joint.kind in ("hinge", "slide", "ball") or (root.joint.kind == "fixed" and root.inertial.mass > 0.0)


def _content(bodies: tuple[Body, ...], surfaces: Mapping[str, tuple[float, float]]) -> Any:
    """Everything that goes into the file of a tree, apart from names: equal keys can share one file."""
    place = {body.name: index for index, body in enumerate(bodies)}
    found = []
    for body in bodies:
        joint = body.joint
        root = joint.parent is None
        found.append(
            (
                place.get(joint.parent, -1) if joint.parent is not None else -1,
                joint.kind,
                None if root else joint.origin,
                joint.axis,
                joint.position_limits,
                joint.velocity_limit,
                joint.effort_limit,
                joint.damping,
                joint.dry_friction,
                body.inertial,
                surfaces[body.name],
                tuple((s.kind, s.size, s.pose, s.collision, s.visual, s.colour) for s in body.shapes),
            )
        )
    return tuple(found)


def _instance(file: str, bodies: tuple[Body, ...], coordinates: _Coordinates) -> dict[str, Any]:
    """Where one tree stands and how it starts. ``bodies`` are in the order of the file's links (after the world link)."""
    root = bodies[0]
    q, v = coordinates.of(bodies)
    base = Pose(tuple(q[:3]), tuple(q[3:7])) if root.joint.kind == "free" else root.joint.origin
    return {
        "file": file,
        "model": root.model,
        "root": "free" if root.joint.kind == "free" else "world link" if has_world_link(root) else "fixed",
        "base": {"position": list(base.position), "quaternion": list(base.quaternion)},
        "bodies": [body.name for body in bodies],
        "joints": [body.joint.name for body in bodies],
        "shapes": [[shape.name for shape in body.shapes] for body in bodies],
        # PyBullet lists collision shapes and visual shapes apart: these are the places of those that are only visual
        "visual_only": [[i for i, shape in enumerate(body.shapes) if not shape.collision] for body in bodies],
        "position": q,
        "velocity": v,
    }


def _model(bodies: tuple[Body, ...], surfaces: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """What the template prints for a tree."""
    root = bodies[0]
    links, joints = [], []
    taken = {body.name for body in bodies}
    world_link = root.name + WORLD_SUFFIX
    while world_link in taken:
        world_link += "_"
    if has_world_link(root):
        links.append(_massless(world_link))
    for body in bodies:
        friction, restitution = surfaces[body.name]
        moments, turn = principal_axes(body.inertial.inertia)
        links.append(
            {
                "name": body.name,
                "inertial": _frame(Pose(body.inertial.centre_of_mass, turn)),
                "mass": body.inertial.mass,
                "moments": moments,
                "friction": friction,
                "restitution": restitution,
                "shapes": [_shape(shape) for shape in body.shapes],
            }
        )
        if body.joint.parent is not None:
            joints.append(_joint(body, body.joint.parent, body.joint.origin))
        elif has_world_link(root):
            joints.append(_joint(body, world_link, Pose()))
    return {"name": root.model, "links": links, "joints": joints}


def _massless(name: str) -> dict[str, Any]:
    return {
        "name": name,
        "inertial": _frame(Pose()),
        "mass": 0.0,
        "moments": (0.0, 0.0, 0.0),
        "friction": 0.0,
        "restitution": 0.0,
        "shapes": [],
    }


def _frame(pose: Pose) -> dict[str, Any]:
    return {"xyz": pose.position, "rpy": frames.to_rpy(pose.quaternion)}


def _shape(shape: Shape) -> dict[str, Any]:
    if shape.kind == "plane":
        tag, sizes = PLANE
    else:
        tag, parts = GEOMETRY[shape.kind]
        sizes = tuple((name, shape.size[part]) for name, part in parts)
    return {
        "name": shape.name,
        "tag": tag,
        "sizes": sizes,
        "pose": _frame(shape.pose),
        "colour": shape.colour,
        "visual": shape.visual,
        "collision": shape.collision,
    }


def _joint(body: Body, parent: str, origin: Pose) -> dict[str, Any]:
    joint = body.joint
    moves = joint.kind in ("hinge", "slide")
    limits: list[tuple[str, float]] = []
    kind = JOINT_TYPES[joint.kind]
    if joint.position_limits is not None:
        limits += zip(("lower", "upper"), joint.position_limits, strict=True)
        kind = "revolute" if joint.kind == "hinge" else kind
    elif joint.kind == "slide":
        limits += UNLIMITED_SLIDE
    if joint.effort_limit is not None:
        limits.append(("effort", joint.effort_limit))
    if joint.velocity_limit is not None:
        limits.append(("velocity", joint.velocity_limit))
    return {
        "name": joint.name,
        "type": kind,
        "parent": parent,
        "child": body.name,
        "pose": _frame(origin),
        # an axis is written always: without one PyBullet warns and takes x
        "axis": joint.axis if moves else (1.0, 0.0, 0.0),
        "dynamics": joint.kind != "fixed",
        "damping": joint.damping,
        "friction": joint.dry_friction,
        "limits": limits,
    }


def _collision_filter(world: World) -> dict[str, Any]:
    """Classes of bodies (a group bit and a mask each) and pairs that do not touch besides.

    A class is a collision group, apart for bodies that can move and for bodies that cannot (these never touch each other).
    Groups that ignore nothing share one class. More classes than bits: ignored groups become pairs.
    """
    groups = rigid_groups(world)
    ignored = set(world.contact.ignored_groups)
    named = {name for pair in ignored for name in pair}
    excluded = set(excluded_pairs_to_write(world))
    solid = [body for body in world.bodies if solid_shapes(body)]

    def members(by_group: bool) -> dict[tuple[bool, str], list[str]]:
        found: dict[tuple[bool, str], list[str]] = {}
        for body in solid:
            group = body.collision_group if by_group and body.collision_group in named else ""
            found.setdefault((groups[body.name] == "world", group), []).append(body.name)
        return dict(sorted(found.items()))

    classes = members(True)
    if len(classes) > FILTER_BITS:
        of = {body.name: body.collision_group for body in solid}
        by_group: dict[str, list[str]] = {}
        for name, group in of.items():
            by_group.setdefault(group, []).append(name)
        for first, second in ignored:
            for one in by_group.get(first, ()):
                excluded.update(
                    (min(one, other), max(one, other)) for other in by_group.get(second, ()) if one != other
                )
        classes, ignored = members(False), set()
    bits = {key: 1 << index for index, key in enumerate(classes)}

    def mask(key: tuple[bool, str]) -> int:
        return sum(
            bit
            for other, bit in bits.items()
            if not (key[0] and other[0]) and (min(key[1], other[1]), max(key[1], other[1])) not in ignored
        )

    return {
        "classes": [{"group": bits[key], "mask": mask(key), "bodies": names} for key, names in classes.items()],
        "excluded": sorted(excluded),
    }
