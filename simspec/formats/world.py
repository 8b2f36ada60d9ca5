"""What ``world.json`` holds, in SI units and the world's frames and order: for engines that are built by calls of their API.

Bodies with their joints and shapes, of each collision shape the copies of the contact plan with their numbers, which
materials meet in which layer, and which bodies and collision groups do not touch. Free roots have their frame at the centre
of mass, as in every format (``passes.recentre_free_roots``). The annotations are the form of the JSON (see
``formats/kit/forms.py``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from simspec.errors import SpecError
from simspec.files import NotReadableError, parse_json
from simspec.formats.kit.contract import Format, PlainFiles
from simspec.formats.kit.forms import NamePairs, check_distinct, check_fields, check_known, form_of, plain, typed
from simspec.formats.kit.text import json_text
from simspec.language.vocabulary import FRICTION_CONES
from simspec.outputs.files import read_text
from simspec.support import classes, features
from simspec.support.declarations import Table, exact, exactly, shape_kinds
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.canonical import canonical_json
from simspec.world.frames import quaternion, vector3
from simspec.world.shapes import SHAPES
from simspec.world.types import Hardness, Pose, Vector3, World

SCHEMA = 1


@dataclass(frozen=True, slots=True)
class ShapeCopy:
    """One copy of a collision shape and the numbers it holds in its layer; their meaning depends on how the engine combines
    those of two shapes. Sliding friction and restitution are ratios, torsional and rolling friction lengths (m)."""

    layer: int
    friction: float
    torsional_friction: float
    rolling_friction: float
    restitution: float
    hardness: Hardness | None = None


@dataclass(frozen=True, slots=True)
class JsonShape:
    """A shape as :class:`simspec.world.types.Shape` has it. Without copies it is no collision shape and its material is "";
    without a colour it is not visual."""

    name: str
    kind: str
    size: tuple[float, ...]
    pose: Pose
    material: str
    colour: tuple[float, float, float, float] | None
    copies: tuple[ShapeCopy, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedJoint:
    """A weld. ``parent`` None is the world; ``origin`` the joint's frame in the parent's."""

    name: str
    kind: Literal["fixed"] = "fixed"
    parent: str | None
    origin: Pose


@dataclass(frozen=True, slots=True)
class JsonServo:
    """The engine's own controller of a joint: gains as in :class:`simspec.world.actions.JointController`, largest effort."""

    kp: float
    kd: float
    effort_limit: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisJoint:
    """A hinge or a slide, with the fields of :class:`simspec.world.types.Joint`. ``servo`` None, which is left out of the text:
    no controller of the engine's own."""

    name: str
    kind: Literal["hinge", "slide"]
    parent: str | None
    origin: Pose
    axis: Vector3
    position_limits: tuple[float, float] | None
    velocity_limit: float | None
    effort_limit: float | None
    damping: float
    spring_stiffness: float
    spring_rest: float
    dry_friction: float
    armature: float
    position: tuple[float]
    velocity: tuple[float]
    servo: JsonServo | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BallJoint:
    """A ball: position a quaternion w x y z, velocity angular in the child's axes. ``armature`` None, which is left out of the
    text: none."""

    name: str
    kind: Literal["ball"] = "ball"
    parent: str | None
    origin: Pose
    damping: float
    spring_stiffness: float
    position: tuple[float, float, float, float]
    velocity: Vector3
    armature: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeJoint:
    """No joint: position x y z w x y z of the body, velocity linear and angular, in world axes."""

    name: str
    kind: Literal["free"] = "free"
    position: tuple[float, float, float, float, float, float, float]
    velocity: tuple[float, float, float, float, float, float]


Joint = FixedJoint | AxisJoint | BallJoint | FreeJoint


@dataclass(frozen=True, slots=True)
class JsonBody:
    """A rigid body; inertia about the centre of mass as (Ixx, Iyy, Izz, Ixy, Ixz, Iyz)."""

    name: str
    model: str
    group: str
    mass: float
    centre_of_mass: Vector3
    inertia: tuple[float, float, float, float, float, float]
    joint: Joint
    shapes: tuple[JsonShape, ...]


@dataclass(frozen=True, slots=True)
class Excluded:
    """Pairs of bodies, and of collision groups, that do not touch."""

    bodies: NamePairs
    groups: NamePairs


@dataclass(frozen=True, slots=True, kw_only=True)
class JsonWorld:
    """A whole ``world.json``."""

    schema: int = SCHEMA
    gravity: Vector3
    timestep: float
    friction_cone: str
    bodies: tuple[JsonBody, ...]
    """Every parent before its children."""
    meets: tuple[tuple[str, str, int], ...]
    """Two materials, and the one layer in which copies of both touch."""
    excluded: Excluded = field(metadata={"key": "apart"})


def parent_of(joint: Joint) -> str | None:
    """The name of the body that a joint hangs on; None for the world."""
    return None if isinstance(joint, FreeJoint) else joint.parent


@dataclass(frozen=True, slots=True)
class BodyRows:
    """How bodies hang together, by their rows. ``parents``: -1 is the world; ``roots``: of the tree that a body is in;
    ``groups``: the body by whose joint a rigid group moves, -1 of what cannot move."""

    parents: tuple[int, ...]
    roots: tuple[int, ...]
    groups: tuple[int, ...]


def rows_of(bodies: Sequence[JsonBody]) -> BodyRows:
    """How ``bodies`` hang together, every parent before its children."""
    number = {body.name: row for row, body in enumerate(bodies)}
    parents = tuple(-1 if (above := parent_of(body.joint)) is None else number[above] for body in bodies)
    roots: list[int] = []
    groups: list[int] = []
    for row, (body, parent) in enumerate(zip(bodies, parents, strict=True)):
        roots.append(row if parent < 0 else roots[parent])
        group = -1 if parent < 0 else groups[parent]
        groups.append(group if isinstance(body.joint, FixedJoint) else row)
    return BodyRows(parents, tuple(roots), tuple(groups))


def state_of(joint: Joint) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """A joint's initial position and velocity."""
    return ((), ()) if isinstance(joint, FixedJoint) else (joint.position, joint.velocity)


def initial_coordinates(document: JsonWorld) -> tuple[list[float], list[float]]:
    """The initial state (q (nq,), v (nv,)) in the coordinates of ``world/kinematics.py``."""
    q: list[float] = []
    v: list[float] = []
    for body in document.bodies:
        position, velocity = state_of(body.joint)
        q.extend(position)
        if isinstance(body.joint, FreeJoint):
            turn = frames.normalise(quaternion(position[3:7]))
            v.extend([*velocity[:3], *frames.rotate(frames.conjugate(turn), vector3(velocity[3:]))])
        else:
            v.extend(velocity)
    return q, v


# The format ``world``: a world and its contact plan as JSON, for engines that have no file language.

WORLD = "world.json"
UNIT = 1e-12
"""How far an axis or a quaternion may be from unit length: the tolerance of text."""


class WorldJson(Format):
    """One file, ``world.json``: a :class:`simspec.formats.world.JsonWorld`."""

    NAME: ClassVar[str] = "world"
    SUPPORT: ClassVar[Table] = {
        **exactly(
            *(*features.JOINTS, Feature.JOINT_SEVERAL, Feature.LIMIT_POSITION, *features.LIMIT_RATINGS),
            *(*features.DAMPERS_AND_SPRINGS, Feature.DRY_FRICTION, Feature.ARMATURE, *features.PASSIVE_FORCES),
            *(*features.INITIAL_STATE, *features.INERTIAS, Feature.KINEMATIC, *features.LARGE_TREES),
            *(*features.SHAPES_OF_BODIES, *features.CONTACT_LAWS, *features.HARDNESSES, *features.FILTERS),
            *(*features.CONSTRAINTS, *features.SUMS, Feature.FORCES, *features.CONTROLS, *features.PHYSICS),
        ),
        Feature.FRAME: classes.FRAMES_ALONGSIDE,
        Feature.DAMPING_IMPLICIT: exact(classes.AS_ARMATURE),
        Feature.FREE_ARMATURE: classes.FREE_ARMATURE,
        Feature.BALL_ARMATURE: exact(),
        **classes.NOT_IN_WORLD_JSON,
        **shape_kinds("world.json", SHAPES),
    }
    """The support of the language; an engine's dialect may support less of it, or more by its sidecar."""

    def write(self, tree: JsonWorld) -> dict[str, str]:
        """``world.json``."""
        return {WORLD: json_text(plain(tree))}

    def plain(self, world: World) -> PlainFiles:
        """The resolved world itself, as canonical JSON; nothing of it is lost."""
        return PlainFiles({WORLD: canonical_json(world) + "\n"}, ())

    def read(self, folder: Path) -> JsonWorld:
        """The document in ``folder``, checked: its form, and that its names fit together, so that an engine need not.

        Raises ValueError, which names the place, and FileNotFoundError where there is no ``world.json``.
        """
        try:
            content = parse_json(read_text(folder / WORLD))
        except (SpecError, NotReadableError) as error:
            raise ValueError(f"{WORLD}: {error}") from None
        check_fields(content, form_of(JsonWorld), WORLD)
        document: JsonWorld = typed(JsonWorld, content)
        check(document)
        return document


def check(document: JsonWorld) -> None:
    """Raise ValueError, which names the place, where the parts of a document do not fit together."""
    if document.schema != SCHEMA:
        raise ValueError(f"{WORLD}: schema {document.schema!r}, this simspec reads {SCHEMA}")
    check_known((document.friction_cone,), FRICTION_CONES, f"{WORLD}.friction_cone")
    if not document.timestep > 0.0:
        raise ValueError(f"{WORLD}.timestep is {document.timestep}, should be above zero")
    above: set[str] = set()
    for index, body in enumerate(document.bodies):
        at = f"{WORLD}.bodies.{index}"
        parent = parent_of(body.joint)
        if parent is not None and parent not in above:
            raise ValueError(f"{at}.joint.parent is {parent!r}, which is no body before it")
        _check_joint(body.joint, f"{at}.joint")
        for number, shape in enumerate(body.shapes):
            _check_shape(shape, f"{at}.shapes.{number}")
        if body.name in above:
            raise ValueError(f"{WORLD}.bodies has {body.name!r} twice")
        above.add(body.name)
    check_distinct((shape.name for body in document.bodies for shape in body.shapes), f"{WORLD} (shapes)")
    check_distinct((body.joint.name for body in document.bodies), f"{WORLD} (joints)")
    for pair in document.excluded.bodies:
        check_distinct(pair, f"{WORLD}.apart.bodies")
    check_known((name for pair in document.excluded.bodies for name in pair), above, f"{WORLD}.apart.bodies")
    groups = {body.group for body in document.bodies if any(shape.copies for shape in body.shapes)}
    check_known((name for pair in document.excluded.groups for name in pair), groups, f"{WORLD}.apart.groups")
    _check_meetings(document)


def _check_meetings(document: JsonWorld) -> None:
    """Two materials meet in one layer, in which both have copies."""
    at = f"{WORLD}.meets"
    layers = {
        (shape.material, copy.layer) for body in document.bodies for shape in body.shapes for copy in shape.copies
    }
    for name, other, layer in document.meets:
        if not {(name, layer), (other, layer)} <= layers:
            raise ValueError(f"{at} has {[name, other, layer]!r}, and both materials have no copy in that layer")
    check_distinct((tuple(sorted(entry[:2])) for entry in document.meets), at)


def _check_joint(joint: Joint, at: str) -> None:
    if not isinstance(joint, FreeJoint):
        _check_unit(joint.origin.quaternion, f"{at}.origin.quaternion")
    if isinstance(joint, (BallJoint, FreeJoint)):
        _check_unit(joint.position[-4:], f"{at}.position")
    elif not isinstance(joint, FixedJoint):
        _check_unit(joint.axis, f"{at}.axis")
        _check_servo(joint.servo, f"{at}.servo")


def _check_servo(servo: JsonServo | None, at: str) -> None:
    if servo is None:
        return
    for name, value in (("kp", servo.kp), ("kd", servo.kd), ("effort_limit", servo.effort_limit)):
        if value is not None and value < 0.0:
            raise ValueError(f"{at}.{name} is {value}, should not be negative")


def _check_shape(shape: JsonShape, at: str) -> None:
    check_known((shape.kind,), SHAPES, f"{at}.kind")
    wrong = SHAPES[shape.kind].wrong_size(shape.size)
    if wrong is not None:
        raise ValueError(f"{at}.size {wrong}")
    _check_unit(shape.pose.quaternion, f"{at}.pose.quaternion")
    if shape.colour is None and not shape.copies:
        raise ValueError(f"{at} is neither visual nor collision")
    if shape.material and not shape.copies:
        raise ValueError(f"{at} has the material {shape.material!r} and is no collision shape")
    layers = [copy.layer for copy in shape.copies]
    if layers != sorted(set(layers)):
        raise ValueError(f"{at}.copies are not in the order of their layers, each once")


def _check_unit(values: tuple[float, ...], at: str) -> None:
    length = sum(value * value for value in values)
    if abs(length - 1.0) > 2.0 * UNIT:
        raise ValueError(f"{at} is {list(values)}, should be of length 1")
