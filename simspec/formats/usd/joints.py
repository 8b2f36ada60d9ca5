"""Joints of a world as prims: which bodies they join, where, along which axes, with limits, drives and ratings.

Attributes of simspec's own have the doubles; those of a joint of several axes begin with the word of the axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from simspec.control.reference import ActuatorDrive
from simspec.formats.kit.contract import readable
from simspec.formats.usd.text import UsdPrim
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.frames import Matrix3
from simspec.world.kinematics import is_carrier
from simspec.world.types import Body, Joint, Pose, Quaternion, Vector3, World

# --- several joints of a body as one PhysicsJoint ---
# UsdPhysics gives a joint axes X, Y and Z to slide along and to turn about, without an order. Readers take slides before turns,
# and turns in the order X, Y, Z: a frame is chosen in which the joints of the body stand in that order.

LETTERS: Final = "XYZ"
SQUARE: Final = 1e-12
"""Largest cosine between axes at right angles, which were normalised."""


@dataclass(frozen=True, slots=True)
class Several:
    """A body whose joints are one joint in the file.

    ``bodies``: the carriers of each joint but the last, then the body itself; ``words``: the axis of each joint (``transX``,
    ``rotZ``; "rot" for a ball); ``turn``: the axes X, Y, Z in the body's frame.
    """

    bodies: tuple[Body, ...]
    words: tuple[str, ...]
    turn: Quaternion

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints, from the parent on."""
        return tuple(body.joint for body in self.bodies)

    @property
    def parent(self) -> str | None:
        """The body that the first joint is fixed on."""
        return self.bodies[0].joint.parent


def several(world: World) -> dict[str, Several]:
    """The bodies whose joints are one joint in the file, by their names. Those of other bodies stay separate."""
    by_name = {body.name: body for body in world.bodies}
    found = {}
    for body in world.bodies:
        if is_carrier(body.name):
            continue
        chain = [body]
        while (above := chain[0].joint.parent) is not None and is_carrier(above):
            chain.insert(0, by_name[above])
        if len(chain) > 1 and (entry := _single_joint(tuple(chain))) is not None:
            found[body.name] = entry
    return found


def carriers(chains: dict[str, Several]) -> set[str]:
    """The bodies between joints that are not in the file."""
    return {body.name for chain in chains.values() for body in chain.bodies[:-1]}


def separate_carriers(world: World) -> list[str]:
    """The bodies between joints that are in the file, since one joint does not say the joints around them."""
    left_out = carriers(several(world))
    return [body.name for body in world.bodies if is_carrier(body.name) and body.name not in left_out]


def _single_joint(chain: tuple[Body, ...]) -> Several | None:
    """The joints of a body as one; None where they are not at one place, at right angles, slides before turns."""
    joints = [body.joint for body in chain]
    if any(joint.origin != Pose() for joint in joints[1:]) or any(body.inertial.mass for body in chain[:-1]):
        return None
    slides = [joint for joint in joints if joint.kind == "slide"]
    turns = joints[len(slides) :]
    if any(joint.kind != "slide" for joint in joints[: len(slides)]):
        return None
    ball = len(turns) == 1 and turns[0].kind == "ball"
    if ball and (turns[0].damping or turns[0].spring_stiffness or turns[0].armature):
        return None
    if not ball and any(joint.kind != "hinge" for joint in turns):
        return None
    axes = _frame([joint.axis for joint in slides], [] if ball else [joint.axis for joint in turns])
    if axes is None:
        return None
    words = [f"trans{_letter(joint.axis, axes)}" for joint in slides]
    words += ["rot"] if ball else [f"rot{_letter(joint.axis, axes)}" for joint in turns]
    if words != sorted(words, key=lambda word: (word.startswith("rot"), word)):
        return None
    x, y, z = axes
    columns: Matrix3 = ((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]))
    turn = frames.IDENTITY if list(axes) == UNITS else frames.from_matrix(columns)
    return Several(chain, tuple(words), turn)


UNITS: Final[list[Vector3]] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]


def _frame(slides: list[Vector3], turns: list[Vector3]) -> tuple[Vector3, Vector3, Vector3] | None:
    """Right-handed axes among which all of these are, in the order of the slides and of the turns; None where none are."""
    for rows in (slides, turns):
        for index, row in enumerate(rows):
            if any(abs(frames.dot(row, other)) > SQUARE for other in rows[:index]):
                return None
    kept: list[Vector3] = list(turns)
    for axis in slides:
        near = [frames.dot(axis, other) for other in kept]
        if any(abs(entry - 1.0) <= SQUARE for entry in near):
            continue
        if any(abs(value) > SQUARE for value in near):
            return None
        kept.append(axis)
    if len(kept) > 3:
        return None
    if all(axis in UNITS for axis in kept):
        chosen = UNITS
        if _sorted(slides, chosen) and _sorted(turns, chosen):
            return (chosen[0], chosen[1], chosen[2])
    for order in _orders(kept):
        if _sorted(slides, order) and _sorted(turns, order):
            return (order[0], order[1], order[2])
    return None


def _orders(kept: list[Vector3]) -> list[list[Vector3]]:
    """Right-handed frames of up to three axes, in each order."""
    if len(kept) == 1:
        x = kept[0]
        across = min(UNITS, key=lambda unit: abs(frames.dot(unit, x)))
        y = _unit(frames.cross(across, x))
        kept = [x, y]
    if len(kept) == 2:
        x, y = kept
        z = _unit(frames.cross(x, y))
        w = (0.0 - z[0], 0.0 - z[1], 0.0 - z[2])
        return [[x, y, z], [y, z, x], [z, x, y], [y, x, w], [x, w, y], [w, y, x]]
    x, y, z = kept
    if frames.dot(frames.cross(x, y), z) > 0.0:
        return [[x, y, z], [y, z, x], [z, x, y]]
    return [[y, x, z], [x, z, y], [z, y, x]]


def _unit(vector: Vector3) -> Vector3:
    size = frames.dot(vector, vector) ** 0.5
    return (vector[0] / size, vector[1] / size, vector[2] / size)


def _sorted(rows: list[Vector3], axes: list[Vector3]) -> bool:
    """Whether axes are among those of a frame, in its order."""
    places = [next((k for k in range(3) if abs(frames.dot(row, axes[k]) - 1.0) <= SQUARE), -1) for row in rows]
    return -1 not in places and places == sorted(places)


def _letter(axis: Vector3, axes: tuple[Vector3, Vector3, Vector3]) -> str:
    return next(LETTERS[k] for k in range(3) if abs(frames.dot(axis, axes[k]) - 1.0) <= SQUARE)


DEGREES: Final = 180.0 / math.pi
KINDS: Final = {"fixed": "Fixed", "hinge": "Revolute", "slide": "Prismatic", "ball": "Spherical"}
AXES: Final = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
UNLIMITED: Final = (-math.inf, math.inf)
LOCKED: Final = (1.0, -1.0)
"""Limits of an axis that does not move: the schema says so of a lower one above the upper one."""
EVERY_AXIS: Final = tuple(f"{kind}{axis}" for kind in ("trans", "rot") for axis in AXES)


@dataclass(frozen=True, slots=True)
class Joined:
    """The paths of the prims that a joint joins (``first`` None: the world). ``loop``: it is outside the tree."""

    first: str | None
    second: str
    touching: bool = False
    loop: bool = False


def single(prim: UsdPrim, joint: Joint, joined: Joined, drives: Mapping[str, ActuatorDrive]) -> None:
    """A joint of one kind. ``drives``: the driven joints of the world, by name."""
    axis, turn = _towards(joint.axis) if any(joint.axis) else ("X", frames.IDENTITY)
    here = Pose(joint.origin.position, frames.multiply(joint.origin.quaternion, turn))
    stand(prim, joined, here, Pose((0.0, 0.0, 0.0), turn))
    if joint.kind != "fixed":
        prim.uniform("physics:axis", axis)
    if joint.kind == "ball":
        prim.say("float", "physics:coneAngle0Limit", -1.0)
        prim.say("float", "physics:coneAngle1Limit", -1.0)
        prim.custom("double", "spring_stiffness", joint.spring_stiffness or None)
        prim.custom("double", "damping", joint.damping or None)
    _origin(prim, joint.origin)
    if any(joint.axis):
        prim.custom("double3", "axis", readable(joint.axis))
    if joint.kind in SCALAR_JOINTS:
        _limits(prim, joint, "physics:lowerLimit", "physics:upperLimit", "")
        _drive(prim, joint, "angular" if joint.kind == "hinge" else "linear", "", drives.get(joint.name))
        _ratings(prim, joint, "")
    _state(prim, joint, "")


def axes(
    prim: UsdPrim, chain: Several, joined: Joined, names: Sequence[str], drives: Mapping[str, ActuatorDrive]
) -> None:
    """A joint of several axes. ``names`` of the spec's joints, within their model."""
    origin = chain.joints[0].origin
    here = Pose(origin.position, frames.multiply(origin.quaternion, chain.turn))
    stand(prim, joined, here, Pose((0.0, 0.0, 0.0), chain.turn))
    _origin(prim, origin)
    free = set(chain.words) | ({f"rot{axis}" for axis in AXES} if "rot" in chain.words else set())
    limited = {word for word, joint in zip(chain.words, chain.joints, strict=True) if joint.position_limits is not None}
    for word in EVERY_AXIS:
        prim.apply(f"PhysicsLimitAPI:{word}")
        if word in limited:
            continue
        for end, value in zip(("low", "high"), UNLIMITED if word in free else LOCKED, strict=True):
            prim.say("float", f"limit:{word}:physics:{end}", value)
    for word, joint, name in zip(chain.words, chain.joints, names, strict=True):
        prim.custom("string", f"{word}:name", name)
        if joint.kind in SCALAR_JOINTS:
            prim.custom("double3", f"{word}:axis", readable(joint.axis))
            if joint.position_limits is not None:
                _limits(prim, joint, f"limit:{word}:physics:low", f"limit:{word}:physics:high", f"{word}:")
            _drive(prim, joint, word, f"{word}:", drives.get(joint.name))
            _ratings(prim, joint, f"{word}:")
        _state(prim, joint, f"{word}:")


def stand(prim: UsdPrim, joined: Joined, in_first: Pose, in_second: Pose) -> None:
    """The attributes of every joint: its bodies, its frames in theirs, and how it is taken."""
    if joined.first is not None:
        prim.relate("physics:body0", [joined.first])
    prim.relate("physics:body1", [joined.second])
    for number, pose in enumerate((in_first, in_second)):
        prim.say("point3f", f"physics:localPos{number}", pose.position)
        prim.say("quatf", f"physics:localRot{number}", pose.quaternion)
    prim.say("bool", "physics:jointEnabled", True)
    prim.say("bool", "physics:collisionEnabled", joined.touching)
    prim.say("bool", "physics:excludeFromArticulation", joined.loop)
    prim.say("float", "physics:breakForce", math.inf)
    prim.say("float", "physics:breakTorque", math.inf)


def _towards(axis: Vector3) -> tuple[str, Quaternion]:
    """The word for an axis, and the rotation from that axis to it."""
    for word, unit in AXES.items():
        if axis == unit:
            return word, frames.IDENTITY
    x, y, z = axis
    if x <= -1.0:
        return "X", (0.0, 0.0, 0.0, 1.0)
    # (1 + cos, axis × sin) of the turn from x, not yet of unit length
    return "X", frames.normalise((1.0 + x, 0.0, 0.0 - z, y))


def _origin(prim: UsdPrim, origin: Pose) -> None:
    prim.custom("double3", "origin", origin.position)
    prim.custom("quatd", "orientation", origin.quaternion)


def _limits(prim: UsdPrim, joint: Joint, low: str, high: str, prefix: str) -> None:
    turns = DEGREES if joint.kind == "hinge" else 1.0
    lower, upper = joint.position_limits or UNLIMITED
    prim.say("float", low, turns * lower)
    prim.say("float", high, turns * upper)
    if joint.position_limits is not None:
        prim.custom("double2", f"{prefix}limits", joint.position_limits)


def _drive(prim: UsdPrim, joint: Joint, name: str, prefix: str, control: ActuatorDrive | None) -> None:
    """The spring and the damper of a hinge or a slide, and the gains of its controller, as one drive: springs and dampers
    add up to. Its targets are those at time 0, its largest effort the controller's."""
    if control is not None and (control.effort_limit == 0 or not (control.kp or control.kd)):
        control = None
    if not joint.damping and not joint.spring_stiffness and control is None:
        return
    stiffness, damping, pull, push = (
        joint.spring_stiffness,
        joint.damping,
        joint.spring_stiffness * joint.spring_rest,
        0.0,
    )
    if control is not None:
        stiffness, damping = stiffness + control.kp, damping + control.kd
        pull, push = pull + control.kp * control.position, control.kd * control.velocity
        pull += control.effort if stiffness else 0.0
    turns = DEGREES if joint.kind == "hinge" else 1.0
    prim.apply(f"PhysicsDriveAPI:{name}")
    drive = f"drive:{name}:physics:"
    passive = control is None
    target = joint.spring_rest if passive else (pull / stiffness if stiffness else 0.0)
    limit = math.inf if control is None or control.effort_limit is None else control.effort_limit
    prim.uniform(f"{drive}type", "force")
    prim.say("float", f"{drive}stiffness", stiffness / turns)
    prim.say("float", f"{drive}damping", damping / turns)
    prim.say("float", f"{drive}targetPosition", turns * target)
    prim.say("float", f"{drive}targetVelocity", turns * push / damping if push else 0.0)
    prim.say("float", f"{drive}maxForce", limit)
    for word, value in (
        ("spring_stiffness", joint.spring_stiffness),
        ("damping", joint.damping),
        ("spring_rest", joint.spring_rest),
    ):
        prim.custom("double", f"{prefix}{word}", value)
    if control is not None:
        prim.custom("double2", f"{prefix}gains", (control.kp, control.kd))


def _ratings(prim: UsdPrim, joint: Joint, prefix: str) -> None:
    """The numbers of a hinge or a slide that the schemas lack."""
    for word, said in (("velocity_limit", joint.velocity_limit), ("effort_limit", joint.effort_limit)):
        prim.custom("double", f"{prefix}{word}", said)
    for word, value in (("dry_friction", joint.dry_friction), ("armature", joint.armature)):
        prim.custom("double", f"{prefix}{word}", value or None)


def _state(prim: UsdPrim, joint: Joint, prefix: str) -> None:
    """Where a joint stands and how fast it moves, but at zero."""
    if joint.kind != "fixed" and (any(joint.position[1:]) if joint.kind == "ball" else any(joint.position)):
        prim.custom("double[]", f"{prefix}position", list(joint.position))
    if any(joint.velocity):
        prim.custom("double[]", f"{prefix}velocity", list(joint.velocity))
