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

from simspec.contact.parts import Part
from simspec.dialects.kit.contract import Dialect
from simspec.dialects.kit.sidecar import SIDECAR, sidecar, sidecar_text
from simspec.dialects.kit.target import Target
from simspec.dialects.pybullet.contact import (
    collision_filter,
    contact_values,
    copy_name,
    native_contact,
    problems,
    restitution_threshold,
    split,
)
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.passes import principal_axes, recentre_free_roots
from simspec.formats.kit.text import environment
from simspec.support.declarations import EXACT, Support, Table, unsupported, via_api
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.kinematics import free_rigid, initial_state, layout_of, trees
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

UNSEEN = "unseen"
"""Name of the visual of no size."""

POSITION_NUMBERS = 128
"""Numbers that PyBullet exchanges of one tree's position, 7 of them for its base, fixed or not; beyond that it gives
states of some joints as empty, without a word (measured: 121 hinges work, 122 do not)."""

MOST_LINKS = 127
"""Links beside the base of one tree; copies of shapes count."""

WORLD_SUFFIX = "__world"
"""Added to a root's name for the massless base link that stands for the world."""

_SIDECAR = "in the sidecar, set through the engine's API"
_COPIES = (
    "massless links on fixed joints carry further materials and copies of shapes; who meets whom is in the sidecar"
)


class PybulletDialect(Dialect):
    """URDF with PyBullet's extensions."""

    NAME: ClassVar[str] = "pybullet"
    FORMAT: ClassVar[str] = "urdf"
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
        Feature.MATERIALS_PER_BODY: via_api(_COPIES),
        Feature.FRICTION: EXACT,
        Feature.FRICTION_PAIRS: via_api(_COPIES),
        Feature.RESTITUTION: EXACT,
        Feature.RESTITUTION_PAIRS: via_api(_COPIES),
        Feature.RESTITUTION_THRESHOLD: via_api(_SIDECAR),
        Feature.TORSIONAL_FRICTION: EXACT,
        Feature.ROLLING_FRICTION: EXACT,
        Feature.HARDNESS_COMMON: EXACT,
        Feature.HARDNESS_TIME_CONSTANT: unsupported("PyBullet's springs are in N/m, for whatever mass"),
        Feature.HARDNESS_STIFFNESS: EXACT,
        Feature.HARDNESS_NATIVE: via_api(_SIDECAR),
        Feature.HARDNESS_PAIRS: via_api(_COPIES),
        Feature.PASSING_PAIRS: via_api(_SIDECAR),
        Feature.IMPACT_FRICTION: EXACT,
        Feature.CONE_ELLIPTIC: via_api(_SIDECAR),
        Feature.CONE_PYRAMID_INSCRIBED: unsupported(
            "PyBullet has the elliptic cone and the circumscribed pyramid only"
        ),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: via_api(_SIDECAR),
        Feature.COLLISION_GROUPS: via_api(_SIDECAR),
        Feature.EXCLUDED_PAIRS: via_api(_SIDECAR),
        Feature.CONTROL: EXACT,
        Feature.CONTROL_NATIVE: EXACT,
        Feature.GRAVITY: via_api(_SIDECAR),
        Feature.TIMESTEP: via_api(_SIDECAR),
    }

    def emit(self, world: World, target: Target) -> dict[str, str]:
        """The URDF files and ``sidecar.json``. Raises UnsupportedError for a tree with too many joints for PyBullet."""
        _check(world, target)
        moved, offsets = recentre_free_roots(world)
        coordinates = _Coordinates(world)
        files: dict[str, str] = {}
        seen: dict[Any, str] = {}
        names: set[str] = {SIDECAR}
        instances = []
        template = environment().get_template("urdf/model.urdf.j2")
        for bodies in trees(moved).values():
            some = {body.name: split(body, target.plan) for body in bodies}
            key = _content(bodies, some)
            if key not in seen:
                seen[key] = _file_name(bodies[0].model, names)
                files[seen[key]] = template.render(_model(bodies, some))
            instances.append(_instance(seen[key], bodies, some, coordinates))
        content = sidecar(
            self.FORMAT,
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
            collision_filter=collision_filter(world, target.plan),
            restitution_threshold=restitution_threshold(world),
            native_contact=native_contact(world),
            **({"sleepers": sorted(free_rigid(world))} if target.settings.get("sleeping", False) else {}),
        )
        files[SIDECAR] = sidecar_text(content)
        return files

    def read(self, folder: Path) -> ReadBack:
        """Read the files with yourdfpy (see ``dialects/pybullet/reading.py``)."""
        from simspec.dialects.pybullet.reading import read_folder

        return read_folder(folder)


def _check(world: World, target: Target) -> None:
    """Raise UnsupportedError with all that PyBullet cannot have of this world."""
    found = problems(world)
    for root, bodies in trees(world).items():
        links = sum(len(split(body, target.plan)) for body in bodies)
        if links > MOST_LINKS:
            found.append(
                Problem(
                    f"PyBullet holds at most {MOST_LINKS} links in one tree",
                    f"bodies.{root}",
                    found=f"{links}, of which {links - len(bodies)} carry further materials or copies of shapes",
                    hint="split the tree, use fewer materials in it, or run without this engine",
                )
            )
        numbers = 7 + sum(POSITION_SIZE[body.joint.kind] for body in bodies if body.joint.kind != "free")
        if numbers > POSITION_NUMBERS:
            found.append(
                Problem(
                    "PyBullet cannot have tree.size: it exchanges at most "
                    f"{POSITION_NUMBERS} position numbers of one tree, 7 of them for the base",
                    f"bodies.{root}",
                    found=f"{numbers}: a hinge or slide counts 1, a ball 4",
                    hint="split the tree, or run without this engine",
                )
            )
    if found:
        raise UnsupportedError(found)


class _Coordinates:
    """The world's initial state, by body."""

    def __init__(self, world: World):
        self._q, self._v = initial_state(world)
        self._places = layout_of(world)
        self._index = {body.name: index for index, body in enumerate(world.bodies)}

    def of(self, bodies: Iterable[Body]) -> tuple[list[float], list[float]]:
        q: list[float] = []
        v: list[float] = []
        for body in bodies:
            index = self._index[body.name]
            q.extend(self._q[self._places.position[index]].tolist())
            v.extend(self._v[self._places.velocity[index]].tolist())
        return q, v


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


def _content(bodies: tuple[Body, ...], some: Mapping[str, tuple[Part, ...]]) -> Any:
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
                tuple((part.surface, len(part.shapes)) for part in some[body.name]),
                tuple(
                    (
                        s.material if len(some[body.name]) > 1 else "",
                        s.kind,
                        s.size,
                        s.pose,
                        s.collision,
                        s.visual,
                        s.colour,
                    )
                    for s in body.shapes
                ),
            )
        )
    return tuple(found)


def _instance(
    file: str, bodies: tuple[Body, ...], some: Mapping[str, tuple[Part, ...]], coordinates: _Coordinates
) -> dict[str, Any]:
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
        # after the bodies' links: which shapes of which body a link carries, and the layer
        "copies": [
            {
                "link": copy_name(part),
                "body": body.name,
                "layer": part.layer,
                "shapes": [shape.name for shape in part.shapes],
            }
            for body in bodies
            for part in some[body.name][1:]
        ],
        "layers": [some[body.name][0].layer for body in bodies],
        "position": q,
        "velocity": v,
    }


def _model(bodies: tuple[Body, ...], some: Mapping[str, tuple[Part, ...]]) -> dict[str, Any]:
    """What the template prints for a tree."""
    root = bodies[0]
    links, joints = [], []
    taken = {body.name for body in bodies}
    world_link = root.name + WORLD_SUFFIX
    while world_link in taken:
        world_link += "_"
    if has_world_link(root):
        links.append(_massless(world_link, Surface(), ()))
    for body in bodies:
        own = some[body.name][0]
        moments, turn = principal_axes(body.inertial.inertia)
        links.append(
            {
                "name": body.name,
                "inertial": _frame(Pose(body.inertial.centre_of_mass, turn)),
                "mass": body.inertial.mass,
                "moments": moments,
                "contact": contact_values(own.surface),
                **_shown([_shape(shape, shape in own.shapes) for shape in body.shapes]),
            }
        )
        if body.joint.parent is not None:
            joints.append(_joint(body, body.joint.parent, body.joint.origin))
        elif has_world_link(root):
            joints.append(_joint(body, world_link, Pose()))
    for body in bodies:
        for part in some[body.name][1:]:
            links.append(_massless(copy_name(part), part.surface, part.shapes))
            joints.append(_weld(copy_name(part), body.name))
    return {"name": root.model, "links": links, "joints": joints}


def _massless(name: str, surface: Surface, shapes: tuple[Shape, ...]) -> dict[str, Any]:
    return {
        "name": name,
        "inertial": _frame(Pose()),
        "mass": 0.0,
        "moments": (0.0, 0.0, 0.0),
        "contact": contact_values(surface),
        **_shown([{**_shape(shape, True), "visual": False} for shape in shapes]),
    }


def _shown(shapes: list[dict[str, Any]]) -> dict[str, Any]:
    """The shapes of a link, and whether it needs a visual of no size: PyBullet shows the collision shapes of a link that has no
    visual at all (measured)."""
    unseen = any(shape["collision"] for shape in shapes) and not any(shape["visual"] for shape in shapes)
    return {"shapes": shapes, "unseen": UNSEEN if unseen else None}


def _weld(name: str, parent: str) -> dict[str, Any]:
    """The fixed joint of a copy's link."""
    return {
        "name": f"{name}.joint",
        "type": JOINT_TYPES["fixed"],
        "parent": parent,
        "child": name,
        "pose": _frame(Pose()),
        "axis": (1.0, 0.0, 0.0),
        "dynamics": False,
        "damping": 0.0,
        "friction": 0.0,
        "limits": [],
    }


def _frame(pose: Pose) -> dict[str, Any]:
    return {"xyz": pose.position, "rpy": frames.to_rpy(pose.quaternion)}


def _shape(shape: Shape, collision: bool) -> dict[str, Any]:
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
        "collision": collision,
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
