"""Joints of a stage: which bodies they join, where, and along which axes they move."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from simspec.imports.draft import angle, numbers, plain
from simspec.imports.usd import stage as engine_schemas
from simspec.imports.usd.shapes import PrimPlaces, quaternion
from simspec.imports.usd.stage import PREFIX, UNBOUNDED, PrimRead, StageRead, Units, UsdMimic, agree
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import Pose, Quaternion, Vector3

TYPES: Final = {
    "PhysicsFixedJoint": "fixed",
    "PhysicsRevoluteJoint": "hinge",
    "PhysicsPrismaticJoint": "slide",
    "PhysicsSphericalJoint": "ball",
    "PhysicsDistanceJoint": "distance",
    "PhysicsJoint": "several",
}
UNITS: Final = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
SLIDES: Final = {f"trans{axis}": unit for axis, unit in UNITS.items()}
TURNS: Final = {f"rot{axis}": unit for axis, unit in UNITS.items()}
ANGLES: Final = "mjc:compiler:angle"
"""Of a scene: the unit of angles in attributes that are beyond UsdPhysics."""
UNBREAKABLE: Final = 1e30
"""Units of force beyond which a joint does not break: files write the largest number of single precision."""
STACKED: Final = "newton:jointsAddMobility"
"""Of an articulation: several joints of the same two bodies move one after the other."""
ADDING: Final = "MjcJointAPI"
"""The schema of joints that are of a tree of bodies, where each joint lets its body move."""
START: Final = 1e-5
"""rad and m below which a joint stands at zero: places of bodies and frames have single precision."""


@dataclass
class Freedom:
    """One degree of freedom: ``kind`` hinge, slide or ball, its axis in the frame of the joint, and its words in a spec."""

    kind: str
    axis: Vector3
    word: str
    data: dict[str, Any] = field(default_factory=dict)
    start: tuple[float, ...] = ()
    name: str = ""
    """As simspec wrote it; "" where it did not."""
    instance: str = ""
    """The instance name of drives and states of the axis."""
    units: Units | None = None
    mimic: UsdMimic | None = None


@dataclass
class UsdJointRead:
    """A joint between two bodies (None: the world), with its frames in theirs (m)."""

    prim: PrimRead
    first: PrimRead | None
    second: PrimRead | None
    in_first: Pose
    in_second: Pose
    freedoms: list[Freedom]
    outside: bool = False
    """The file excludes it from the tree."""
    name: str = ""
    touching: bool = False
    """Whether the bodies that it joins touch each other."""
    gap: float = 0.0
    """m or rad between its frames where the bodies are."""
    said: bool = False
    """Whether simspec's own attributes say where its axes stand."""
    outer: list[UsdJointRead] = field(default_factory=list)
    """Joints of the same two bodies that move the second before this one does, from the first outwards."""

    def stored(self, freedom: Freedom, name: str) -> tuple[float, ...] | None:
        """Numbers that only simspec says of one of the axes."""
        return self.prim.stored(prefix(self.prim, freedom.word) + name)

    def other(self, body: PrimRead | None) -> PrimRead | None:
        """The body that it joins to ``body``."""
        return self.second if body is self.first else self.first


def prefix(prim: PrimRead, word: str) -> str:
    """How simspec's own attributes of an axis begin: with its word, where the joint has several."""
    return f"{word}:" if TYPES[prim.tag] == "several" else ""


class JointReader:
    """Reads the joints of a stage. ``body_of``: the body that a prim is part of, None for what is fixed in the world."""

    def __init__(self, stage: StageRead, places: PrimPlaces, body_of: Callable[[PrimRead], PrimRead | None]):
        self.stage, self.places, self.body_of = stage, places, body_of
        self.of_force = stage.kilograms * stage.metres
        self.of_torque = stage.kilograms * stage.metres**2
        angles = [prim.token(ANGLES) for prim in stage.used() if prim.has(ANGLES)]
        self.degrees = "radian" not in angles

    def read(self, prim: PrimRead) -> UsdJointRead | None:
        """The joint of a prim; None for one that joins nothing. Raises SpecError for what is wrong."""
        prim.take()
        if not prim.flag("physics:jointEnabled", True):
            prim.ignore(None, "a joint that is switched off")
            return None
        kind = TYPES[prim.tag]
        for name in ("physics:breakForce", "physics:breakTorque"):
            if abs(prim.real(name, math.inf, infinite=True)) < UNBREAKABLE:
                prim.lose(name, "joints of simspec do not break")
        first, in_first = self._side(prim, 0)
        second, in_second = self._side(prim, 1)
        if kind == "distance":
            prim.lose(None, "simspec has no joints of distance")
            return None
        if first is second:
            prim.ignore(None, "it joins what does not move against each other")
            return None
        collide = prim.flag("physics:collisionEnabled", False)
        freedoms = self._freedoms(prim, kind)
        if freedoms is None:
            prim.ignore(None, "a joint that leaves everything free")
            return None
        outside = prim.flag("physics:excludeFromArticulation", False)
        return UsdJointRead(prim, first, second, in_first, in_second, freedoms, outside, prim.called(), collide)

    def _side(self, prim: PrimRead, number: int) -> tuple[PrimRead | None, Pose]:
        targets = prim.targets(f"physics:body{number}")
        if len(targets) > 1:
            raise prim.error(f"physics:body{number} should name one body", found=" ".join(targets)[:80], code="I101")
        at = prim.reals(f"physics:localPos{number}", 3) or (0.0, 0.0, 0.0)
        rotation = f"physics:localRot{number}"
        turn = quaternion(prim, rotation, prim.reals(rotation, 4) or frames.IDENTITY)
        holder = self.stage.prims.get(targets[0]) if targets else None
        if targets and (holder is None or not holder.used):
            raise prim.error(f"physics:body{number} names what is not there", found=targets[0][:200], code="I101")
        if holder is None:
            place = self.places.world(self.stage.root)
        else:
            body = self.body_of(holder)
            place = self.places.world(holder) if body is None else self.places.within(holder, body)
        point = frames.vector3(a * factor * self.stage.metres for a, factor in zip(at, place.scale, strict=True))
        return None if holder is None else self.body_of(holder), frames.compose(place.pose, Pose(point, turn))

    def _freedoms(self, prim: PrimRead, kind: str) -> list[Freedom] | None:
        """The free axes of a joint, in order; None where all are free."""
        if kind not in SCALAR_JOINTS:
            for name in ("physics:axis", "physics:lowerLimit", "physics:upperLimit"):
                prim.ignore(name, "this kind of joint has none")
        if kind == "fixed":
            return []
        if kind in SCALAR_JOINTS:
            axis = prim.token("physics:axis", "X")
            if axis not in UNITS:
                raise prim.error("not an axis", found=axis[:20], allowed="X, Y, Z", code="I101")
            freedom = Freedom(kind, UNITS[axis], axis)
            drive = "angular" if kind == "hinge" else "linear"
            self._moves(prim, freedom, "physics:lowerLimit", "physics:upperLimit", drive)
            return [freedom]
        if kind == "ball":
            prim.token("physics:axis", "X")
            for name in ("physics:coneAngle0Limit", "physics:coneAngle1Limit"):
                if 0.0 <= prim.real(name, -1.0, infinite=True) < math.inf:
                    prim.lose(name, "a ball is limited by its whole angle, not by a cone")
            for drive in prim.instances("PhysicsDriveAPI"):
                self._no_drive(prim, drive)
            ball = Freedom("ball", (0.0, 0.0, 0.0), "ball")
            if (stiffness := prim.stored_number("spring_stiffness")) is not None:
                ball.data["spring"] = {"stiffness": plain(stiffness)}
            if (damping := prim.stored_number("damping")) is not None:
                ball.data["damping"] = plain(damping)
            engine_schemas.of_ball(prim, ball.data, self._units(True))
            return [ball]
        return self._several(prim)

    def _several(self, prim: PrimRead) -> list[Freedom] | None:
        """The axes of a joint of up to six degrees of freedom: its slides, then its turns, in the order X, Y, Z."""
        limited = set(prim.instances("PhysicsLimitAPI"))
        if "distance" in limited:
            prim.lose("apiSchemas:PhysicsLimitAPI:distance", "simspec has no joints of distance")
        free: list[str] = []
        for word in (*SLIDES, *TURNS):
            low = prim.real(f"limit:{word}:physics:low", -math.inf, infinite=True)
            high = prim.real(f"limit:{word}:physics:high", math.inf, infinite=True)
            if word in limited and low > high:
                continue  # locked
            free.append(word)
        drives = prim.instances("PhysicsDriveAPI")
        turns = [word for word in free if word in TURNS]
        bounded = any(self._bounded(prim, word) for word in free if word in limited)
        if len(free) == 6 and not bounded and not drives:
            return None
        freedoms = [self._along(prim, word, "slide", SLIDES[word]) for word in free if word in SLIDES]
        stated = (self._bounded(prim, word) or word in drives or prim.has(f"{PREFIX}{word}:axis") for word in turns)
        if len(turns) == 3 and not any(stated):
            return [*freedoms, Freedom("ball", (0.0, 0.0, 0.0), "rot", name=prim.token(f"{PREFIX}rot:name"))]
        for drive in drives:
            if drive not in free:
                self._no_drive(prim, drive)
        return [*freedoms, *(self._along(prim, word, "hinge", TURNS[word]) for word in turns)]

    def _bounded(self, prim: PrimRead, word: str) -> bool:
        ends = (prim.real(f"limit:{word}:physics:{end}", math.inf, infinite=True) for end in ("low", "high"))
        return any(math.isfinite(end) and abs(end) < UNBOUNDED for end in ends)

    def _along(self, prim: PrimRead, word: str, kind: str, axis: Vector3) -> Freedom:
        freedom = Freedom(kind, axis, word, name=prim.token(f"{PREFIX}{word}:name"))
        self._moves(prim, freedom, f"limit:{word}:physics:low", f"limit:{word}:physics:high", word)
        return freedom

    def _moves(self, prim: PrimRead, freedom: Freedom, low: str, high: str, drive: str) -> None:
        turns = freedom.kind == "hinge"
        unit = math.pi / 180.0 if turns else self.stage.metres
        lower, upper = (prim.real(name, end, infinite=True) for name, end in ((low, -math.inf), (high, math.inf)))
        bounded = lower <= upper and (abs(lower) < UNBOUNDED or abs(upper) < UNBOUNDED)
        data, local_word = freedom.data, prefix(prim, freedom.word)
        limits: dict[str, Any] = {}
        if lower > upper and TYPES[prim.tag] != "several":
            # the schema says: a lower limit above the upper one locks nothing, it is no limit
            prim.ignore(low, "above the upper limit: no limits are said")
        if bounded:
            ends = [max(-FAR, min(FAR, value * unit)) for value in (lower, upper)]
            said = prim.exactly(f"{local_word}limits", ends)
            limits["position"] = [angle(value) if turns else plain(value) for value in said]
        self._drive(prim, freedom, drive)
        for word in ("velocity", "effort"):
            if (stored := prim.stored_number(f"{local_word}{word}_limit")) is not None:
                limits[word] = plain(stored)
        units = self._units(turns)
        engine_schemas.ratings(prim, limits, units, self.stage.metres == self.stage.kilograms == 1.0, drive)
        if limits:
            data["limits"] = limits
        for word in ("dry_friction", "armature"):
            if stored := prim.stored_number(local_word + word):
                data[word] = plain(stored)
        freedom.instance, freedom.units = drive, units
        if (armature := engine_schemas.armature(prim, units, drive)) and "armature" not in data:
            data["armature"] = plain(armature)
        engine_schemas.passive(prim, data, units, self.degrees, drive)
        if not local_word:
            freedom.mimic = engine_schemas.mimic(prim, units)
        if speed := engine_schemas.velocity(prim, drive, units):
            data["velocity"] = plain(speed)

    def _units(self, turns: bool) -> Units:
        if turns:
            return Units(self.of_torque, math.pi / 180.0, self.of_torque, turns)
        return Units(self.stage.kilograms, self.stage.metres, self.of_force, turns)

    def _drive(self, prim: PrimRead, freedom: Freedom, name: str) -> None:
        if name not in prim.instances("PhysicsDriveAPI"):
            return
        turns, start = freedom.kind == "hinge", f"drive:{name}:physics:"
        degrees = 180.0 / math.pi if turns else 1.0
        unit = (self.of_torque if turns else self.of_force / self.stage.metres) * degrees
        stiffness, damping = (prim.real(f"{start}{word}", 0.0) * unit for word in ("stiffness", "damping"))
        rest = prim.real(f"{start}targetPosition", 0.0) * (math.pi / 180.0 if turns else self.stage.metres)
        speed = prim.real(f"{start}targetVelocity", 0.0)
        most = prim.real(f"{start}maxForce", math.inf, infinite=True)
        kind = prim.token(f"{start}type", "force")
        if stiffness < 0.0 or damping < 0.0:
            raise prim.error(
                "a drive with a stiffness or a damping below 0", found=f"{stiffness:g}, {damping:g}", code="I102"
            )
        if not stiffness and not damping:
            for word in ("targetPosition", "targetVelocity", "maxForce", "type"):
                prim.ignore(f"{start}{word}", "a drive without stiffness and damping does nothing")
            return
        if (passive := self._passive(prim, freedom, stiffness, damping)) is not None:
            for word in ("targetPosition", "targetVelocity", "maxForce"):
                prim.ignore(f"{start}{word}", OF_CONTROL)
            self._say_passive(freedom, turns, *passive)
            return
        if kind != "force":
            reason = "simspec has no drives by acceleration: write the actuators as `control:` of the scenario"
            for word in ("type", "stiffness", "damping", "targetPosition", "targetVelocity", "maxForce"):
                prim.lose(f"{start}{word}", reason)
            return
        if speed:
            reason = "a damper of simspec has no speed of its own; write `control:` in the scenario"
            prim.lose(f"{start}targetVelocity", reason)
        if most < UNBOUNDED:
            reason = "springs and dampers have no largest effort; write `control:` in the scenario"
            prim.lose(f"{start}maxForce", reason)
        values = zip(OF_PASSIVE, (stiffness, damping, rest), strict=True)
        stiffness, damping, rest = (prim.exact(prefix(prim, freedom.word) + word, value) for word, value in values)
        if rest and not stiffness:
            prim.ignore(f"{start}targetPosition", "without stiffness it does nothing")
        self._say_passive(freedom, turns, stiffness, damping, rest)

    def _passive(
        self, prim: PrimRead, freedom: Freedom, stiffness: float, damping: float
    ) -> tuple[float, float, float] | None:
        """Stiffness, damping and rest of the joint itself, where simspec wrote the gains of a controller into the same drive;
        None where it did not, or the drive has been changed since."""
        before = prefix(prim, freedom.word)
        gains = prim.stored(f"{before}gains", 2)
        said = [prim.stored_number(before + word) for word in OF_PASSIVE] if gains is not None else []
        if gains is None or None in said:
            return None
        spring, damper, rest = (value or 0.0 for value in said)
        if not agree((spring + gains[0], damper + gains[1]), (stiffness, damping)):
            return None
        return spring, damper, rest

    def _say_passive(self, freedom: Freedom, turns: bool, stiffness: float, damping: float, rest: float) -> None:
        if stiffness:
            freedom.data["spring"] = {
                "stiffness": plain(stiffness),
                **({"rest": angle(rest) if turns else plain(rest)} if rest else {}),
            }
        if damping:
            freedom.data["damping"] = plain(damping)

    def _no_drive(self, prim: PrimRead, name: str) -> None:
        for attribute in prim.attributes:
            if attribute.startswith(f"drive:{name}:"):
                prim.lose(attribute, "a drive of an axis that simspec drives by `control:` only")


OF_PASSIVE: Final = ("spring_stiffness", "damping", "spring_rest")
"""simspec's own attributes of a spring and a damper."""
OF_CONTROL: Final = "the gains in the drive are those of a controller, which a scenario says by `control:`"
FAR: Final = 1e12
"""rad or m that stand for no limit at one end, where the other has one."""


def stacked(joints: list[UsdJointRead], adding: bool) -> list[UsdJointRead]:
    """The joints; of several that move the same two bodies one after the other the last, with the others as its outer ones.
    They do so where joints add mobility (:data:`STACKED`), or where all of them are of the schema :data:`ADDING`, and have to
    stand at zero where the bodies are."""
    of_pair: dict[tuple[int, int], list[UsdJointRead]] = {}
    for joint in joints:
        if not joint.outside and joint.second is not None and len(joint.freedoms) == 1:
            of_pair.setdefault((id(joint.first), id(joint.second)), []).append(joint)
    taken: set[int] = set()
    for row in of_pair.values():
        at_rest = all(joint.gap < START and not any(_turn(joint)) for joint in row)
        balls = any(joint.freedoms[0].kind == "ball" for joint in row[:-1])
        adds = adding or all(ADDING in joint.prim.schemas for joint in row)
        if adds and len(row) > 1 and at_rest and not balls:
            row[-1].outer = row[:-1]
            taken |= {id(joint) for joint in row[:-1]}
    return [joint for joint in joints if id(joint) not in taken]


def _turn(joint: UsdJointRead) -> list[float]:
    """How far the axis of a joint of one axis is from zero."""
    freedom = joint.freedoms[0]
    values = freedom.start[1:] if freedom.kind == "ball" else freedom.start
    return [value for value in values if abs(value) >= START]


def start_of(joint: UsdJointRead, first: Pose, second: Pose) -> Pose:
    """Where the second frame of a joint is in its first, with the bodies at these poses; its freedoms get their positions,
    and it the gap between its frames beyond them."""
    rest = frames.compose(
        frames.inverse(frames.compose(first, joint.in_first)), frames.compose(second, joint.in_second)
    )
    position, turn = rest.position, rest.quaternion
    left, turned = position, turn
    if stand_as_said(joint, rest):
        return rest
    hinges = [freedom for freedom in joint.freedoms if freedom.kind == "hinge"]
    for freedom in joint.freedoms:
        if freedom.kind == "slide":
            along = frames.dot(position, freedom.axis)
            freedom.start = (along,)
            left = frames.subtract(left, frames.vector3(along * value for value in freedom.axis))
        elif freedom.kind == "ball":
            freedom.start, turned = turn, frames.IDENTITY
    if len(hinges) == 1:
        about = frames.dot((turn[1], turn[2], turn[3]), hinges[0].axis)
        hinges[0].start = (2.0 * frames.angle(about, turn[0]),)
        turned = frames.multiply(frames.from_axis_angle(hinges[0].axis, -hinges[0].start[0]), turn)
    elif hinges:
        angles = dict(zip(UNITS.values(), frames.to_euler_xyz(turn), strict=True))
        for hinge in hinges:
            hinge.start = (angles.pop(hinge.axis),)
        turned = frames.IDENTITY if not angles else (1.0, *(0.5 * value for value in angles.values()))  # type: ignore[assignment]
    away = max(abs(value) for value in left)
    joint.gap = max(away, 2.0 * max(abs(value) for value in turned[1:]))
    return rest


def stand_as_said(joint: UsdJointRead, rest: Pose) -> bool:
    """Take the positions that simspec's own attributes say of hinges and slides, where they bring the second frame to ``rest``
    in the first: an angle beyond a half turn, and one of several, is not seen in places. Whether they do."""
    actual = [joint.stored(freedom, "position") for freedom in joint.freedoms]
    if all(values is None for values in actual) or [freedom.kind for freedom in joint.freedoms] == ["ball"]:
        return False
    place, starts = Pose(), []
    for freedom, values in zip(joint.freedoms, actual, strict=True):
        count = 4 if freedom.kind == "ball" else 1
        if values is None:
            values = frames.IDENTITY if count == 4 else (0.0,)
        if len(values) != count:
            return False
        starts.append(values)
        if freedom.kind == "slide":
            step = Pose(frames.vector3(values[0] * value for value in freedom.axis))
        elif freedom.kind == "hinge":
            step = Pose(quaternion=frames.from_axis_angle(freedom.axis, values[0]))
        else:
            step = Pose(quaternion=_seen_from(frames.conjugate(joint.in_second.quaternion), values))
        place = frames.compose(place, step)
    left = frames.compose(frames.inverse(place), rest)
    reach = 1.0 + max(abs(value) for value in (*joint.in_first.position, *joint.in_second.position, *rest.position))
    if max(abs(value) for value in left.position) > START * reach:
        return False
    if 2.0 * max(abs(value) for value in left.quaternion[1:]) > START:
        return False
    for freedom, values in zip(joint.freedoms, starts, strict=True):
        freedom.start = values
    joint.said = True
    return True


def _seen_from(turn: Quaternion, rotation: Sequence[float]) -> Quaternion:
    """A rotation in axes from which its own are turned by ``turn``."""
    return frames.multiply(turn, frames.multiply(frames.quaternion(rotation), frames.conjugate(turn)))


def start_words(joint: UsdJointRead) -> None:
    """Say in each freedom's words where it stands, but at zero."""
    for freedom in joint.freedoms:
        if (
            freedom.kind == "ball" and not joint.said
        ):  # from the frame of the joint to the axes of the body that it moves
            freedom.start = _seen_from(joint.in_second.quaternion, freedom.start)
    if len(joint.freedoms) == 1 and not joint.said:
        stored, start = joint.stored(joint.freedoms[0], "position"), joint.freedoms[0].start
        if stored is None:
            joint.freedoms[0].start = tuple(0.0 if abs(value) < START else value for value in start)
        elif len(stored) == len(start) and all(abs(a - b) < START for a, b in zip(stored, start, strict=True)):
            joint.freedoms[0].start, joint.said = stored, True
    for freedom in joint.freedoms:
        values = freedom.start
        if freedom.kind == "ball":
            if any(abs(value) >= START or (joint.said and value) for value in values[1:]):
                freedom.data["position"] = {"quat": numbers(values)}
        elif values:
            if abs(values[0]) >= START or (joint.said and values[0]):
                freedom.data["position"] = angle(values[0]) if freedom.kind == "hinge" else plain(values[0])
            if freedom.units is not None:
                engine_schemas.check_position(joint.prim, freedom.instance, freedom.units, values[0])
        speeds = joint.stored(freedom, "velocity")
        if speeds is not None and len(speeds) == (3 if freedom.kind == "ball" else 1):
            freedom.data["velocity"] = numbers(speeds) if freedom.kind == "ball" else plain(speeds[0])
