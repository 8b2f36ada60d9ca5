"""Bodies and joints of a compiled model as those of a spec.

A body's frame is moved to its first joint, where the spec's language has it. Joint coordinates begin at the reference
configuration: q = qpos − ref, so that ranges, springs and all else are given from there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simspec.errors import Location
from simspec.imports.elements import Element, UniqueNames
from simspec.imports.mjcf.compiled import BALL, FREE, HINGE, SLIDE, CompiledMjcf, MjcfFeatures
from simspec.language.beginning import LimitStart
from simspec.language.document import Path_
from simspec.language.trees import MOST
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.language.words import clean_name

GROUND: Final = "ground"
"""The body that has the shapes of the world itself, and is held where a constraint holds the world."""
KINDS: Final = {FREE: "free", BALL: "ball", SLIDE: "slide", HINGE: "hinge"}
IDENTITY: Final = np.array([1.0, 0.0, 0.0, 0.0])
Vector = NDArray[np.float64]


def rotated(quaternion: Vector, vector: Vector) -> Vector:
    """R(q) v, q as w x y z of unit length."""
    twice = 2.0 * np.cross(quaternion[1:], vector)
    turned: Vector = vector + quaternion[0] * twice + np.cross(quaternion[1:], twice)
    return turned


def product(first: Vector, second: Vector) -> Vector:
    """The rotation by ``second``, then by ``first``."""
    real = first[0] * second[0] - first[1:] @ second[1:]
    turned: Vector = np.r_[real, first[0] * second[1:] + second[0] * first[1:] + np.cross(first[1:], second[1:])]
    return turned


def inverse(quaternion: Vector) -> Vector:
    """The opposite rotation."""
    turned: Vector = quaternion * np.array([1.0, -1.0, -1.0, -1.0])
    return turned


def numbers(values: Any) -> list[float]:
    """Plain floats, without negative zeros."""
    return [float(value) + 0.0 for value in np.atleast_1d(values)]


def pose(position: Vector, quaternion: Vector) -> dict[str, Any]:
    """A pose as a spec has it, without zeros."""
    written: dict[str, Any] = {}
    if np.any(position):
        written["xyz"] = numbers(position)
    if np.any(quaternion[1:]):
        written["quat"] = numbers(quaternion)
    return written


class MjcfNames(UniqueNames):
    """Names of a spec for those of a file, each given once; ``changed``: those that are others, by the file's."""

    def __init__(self, taken: Iterable[str] = ()):
        super().__init__(taken)
        self.changed: dict[str, str] = {}

    def give(self, name: str, otherwise: str) -> str:
        """A free name of the language, the nearest to ``name``, or to ``otherwise`` where that is empty."""
        wanted = clean_name(name or otherwise)[:150]
        given = self.unique("world_" if wanted == "world" else wanted)
        if name and given != name:
            self.changed[name] = given
        return given


@dataclass
class MjcfBodies:
    """Bodies of the spec as they are made: plain data by name, and where each value comes from."""

    model: CompiledMjcf
    features: MjcfFeatures
    data: dict[str, dict[str, Any]] = field(default_factory=dict)
    places: dict[Path_, Location] = field(default_factory=dict)
    names: dict[int, str] = field(default_factory=dict)
    """Names of bodies by their number; the world has none."""
    ground: str | None = None
    """The body that has the shapes of the world itself."""
    joints: dict[int, str] = field(default_factory=dict)
    """Names of joints by their number."""
    shifts: dict[int, Vector] = field(default_factory=dict)
    """Origins of the spec's frames in those of the file, by the number of the body."""
    renamed: MjcfNames = field(default_factory=MjcfNames)
    joint_names: MjcfNames = field(default_factory=MjcfNames)

    folder: Path = field(default_factory=Path)
    """That of the file, from which the spec names others."""
    files: dict[str, Path] = field(default_factory=dict)
    """Files that the spec names, by the texts that name them."""
    constraint_names: MjcfNames = field(default_factory=MjcfNames)
    constraint_places: dict[str, Location] = field(default_factory=dict)
    begun: dict[int, float] = field(default_factory=dict)
    """Where joints begin whose reference is beyond their limits, by their numbers (rad or m)."""
    fixed_tendons: dict[int, float] = field(default_factory=dict)
    """The values at which constraints keep sums of joint positions, by the tendon's number."""

    def named(self, number: int) -> str:
        """The name of a body by its number; of the world, that of the fixed body which stands for it."""
        if number:
            return self.names[number]
        if self.ground is None:
            self.ground = self.renamed.give("", GROUND)
            self.data = {self.ground: {"fixed": True}, **self.data}
            self.places[(self.ground,)] = self.model.root.location
        return self.ground

    def reference(self, number: int, point: Vector) -> tuple[Vector, Vector]:
        """Where a point in the spec's frame of a body is in the reference configuration, and that frame's orientation."""
        turn = self.model["reference_quaternion"][number].astype(float)
        return self.model["reference_position"][number] + rotated(turn, self.shifts[number] + point), turn

    def initial(self, number: int, point: Vector) -> tuple[Vector, Vector]:
        """The same where joints whose reference is beyond their limits are at the nearest limit."""
        turn = self.model["initial_quaternion"][number].astype(float)
        return self.model["initial_position"][number] + rotated(turn, self.shifts[number] + point), turn

    def stands_alone(self, number: int) -> bool:
        """Whether a body is one that a program moves, and nothing hangs on it."""
        parents = self.model["body_parentid"].tolist()
        return int(self.model["body_mocapid"][number]) >= 0 and number not in parents

    def stand(self, number: int, place: Vector, turn: Vector) -> None:
        """Give a body that a program moves another place (that of the spec's frame) to begin at."""
        body, element = self.data[self.names[number]], self.model.part("body", number).element
        body.pop("pose", None)
        if where := pose(place, turn):
            body["pose"] = where
        self.features.add("body.mocap_start", element)

    def joint_data(self, number: int) -> dict[str, Any]:
        """The joint of the spec, by its number."""
        body = self.data[self.names[int(self.model["jnt_bodyid"][number])]]
        joints = body.get("joints") or [body["joint"]]
        made: dict[str, Any] = joints[number - self.model.joints_of(int(self.model["jnt_bodyid"][number])).start]
        return made

    def joint_name(self, number: int) -> str:
        """The name of a joint, which it is given where the file has none."""
        if number not in self.joints:
            data = self.joint_data(number)
            given = self.joint_names.give("", f"{self.names[int(self.model['jnt_bodyid'][number])]}_joint")
            named = {"name": given, **data}
            data.clear()
            data.update(named)
            self.joints[number] = given
        return self.joints[number]

    def starts(self, around: Path_) -> list[LimitStart]:
        """Joints that begin at a limit, since their reference is beyond it; ``around``: the path of the bodies in the spec."""
        found = []
        for number, position in self.begun.items():
            body = self.names[int(self.model["jnt_bodyid"][number])]
            found.append(LimitStart(self.joints.get(number, f"{body}_joint"), (*around, body), position, 0.0))
        return found

    def leave_start(self, number: int) -> None:
        """A joint that follows another begins where that one says."""
        self.joint_data(number).pop("position", None)
        self.begun.pop(number, None)

    def make(self) -> None:
        """All bodies but the world, without shapes."""
        count = self.model.numbers["nbody"]
        self.shifts[0] = np.zeros(3)
        for number in range(1, count):
            self.names[number] = self.renamed.give(self.model.part("body", number).name, f"body_{number}")
        for joint in range(self.model.numbers["njnt"]):
            if name := self.model.part("joint", joint).name:
                self.joints[joint] = self.joint_names.give(name, "joint")
        for number in range(1, count):
            self._body(number)

    def _body(self, number: int) -> None:
        model, name = self.model, self.names[number]
        element = model.part("body", number).element
        joints = model.joints_of(number)
        shift = first = np.zeros(3)
        kind = "fixed"
        if joints:
            kind = KINDS[int(model["jnt_type"][joints[-1]])]
            if kind != "free":
                first, shift = (model["jnt_pos"][joint].astype(float) for joint in (joints[0], joints[-1]))
        self.shifts[number] = shift
        parent = int(model["body_parentid"][number])
        turn = model["body_quat"][number].astype(float)
        place = model["body_pos"][number] + rotated(turn, first) - self.shifts[parent]
        body: dict[str, Any] = {}
        where = pose(place, turn)
        joint: dict[str, Any] = {"type": kind}
        if joints:
            joint = self._joint(joints[0])
        if parent:
            body["parent"] = self.names[parent]
        if parent or kind not in ("fixed", "free"):
            if where:
                joint = {**{key: joint[key] for key in ("name", "type") if key in joint}, "origin": where, **joint}
            if len(joints) > 1:
                body["joints"] = [joint, *self._further(name, joints)]
            else:
                body["joint"] = joint
        else:
            if kind == "fixed":
                body["fixed"] = True
            elif joint.keys() - {"type"}:
                body["joint"] = joint
            if where:
                body["pose"] = where
        self._mass(number, shift, body)
        self.data[name] = body
        self.places[(name,)] = element.location
        for index, entry in enumerate(joints if len(joints) > 1 else ()):
            self.places[name, "joints", index] = model.part("joint", entry).element.location
        if len(joints) == 1:
            self.places[name, "joint"] = model.part("joint", joints[0]).element.location
        if int(model["body_mocapid"][number]) >= 0:
            self.features.add("body.mocap", element)
        compensated = float(model["body_gravcomp"][number])
        # a model in which none is above 0 has none (measured)
        if compensated and float(model["body_mass"][number]) and bool((model["body_gravcomp"] > 0.0).any()):
            body["gravity_scale"] = 1.0 - compensated
            if any(
                model["jnt_actgravcomp"][joint] and model["jnt_actfrclimited"][joint]
                for joint in range(model.numbers["njnt"])
            ):
                self.features.add("body.gravcomp", element)

    def _mass(self, number: int, shift: Vector, body: dict[str, Any]) -> None:
        model = self.model
        mass, moments = float(model["body_mass"][number]), model["body_inertia"][number]
        if mass == 0.0 and not np.any(moments):
            return
        body["mass"] = mass
        centre = model["body_ipos"][number] - shift
        if np.any(centre):
            body["centre_of_mass"] = numbers(centre)
        body["inertia"] = {"principal": numbers(moments)}
        if np.any(model["body_iquat"][number][1:]):
            body["inertia"]["quat"] = numbers(model["body_iquat"][number])

    def _further(self, name: str, joints: range) -> list[dict[str, Any]]:
        """The joints of a body after its first, each with its origin in the frame that the one before it moves."""
        model = self.model
        further = []
        for before, number in pairwise(joints):
            self.joints.setdefault(number, self.joint_names.give("", f"{name}_joint_{number - joints[0]}"))
            joint = self._joint(number)
            offset = pose(model["jnt_pos"][number] - model["jnt_pos"][before], IDENTITY)
            if offset:
                joint = {"name": joint.pop("name"), "type": joint.pop("type"), "origin": offset, **joint}
            further.append(joint)
        return further

    def _joint(self, number: int) -> dict[str, Any]:
        model = self.model
        part = model.part("joint", number)
        kind = KINDS[int(model["jnt_type"][number])]
        joint: dict[str, Any] = {}
        body = int(model["jnt_bodyid"][number])
        if number not in self.joints and len(model.joints_of(body)) > 1:
            self.joints[number] = self.joint_names.give("", f"{self.names[body]}_joint_0")
        if number in self.joints:
            joint["name"] = self.joints[number]
        joint["type"] = kind
        at = int(model["jnt_dofadr"][number])
        damping = 0.0 if model.disabled("damper") else float(model["dof_damping"][at])
        dry = 0.0 if model.disabled("frictionloss", "constraint") else float(model["dof_frictionloss"][at])
        armature = float(model["dof_armature"][at])
        stiffness = 0.0 if model.disabled("spring") else float(model["jnt_stiffness"][number])
        self._polynomials(number, at, part.element)
        if kind in SCALAR_JOINTS:
            joint["axis"] = numbers(model["jnt_axis"][number])
            self._along(number, joint)
            values = {"damping": damping, "dry_friction": dry, "armature": armature}
        else:
            if kind == "ball":
                self._cone(number, joint)
            values = self._others(number, kind, part.element, damping, dry, armature)
        joint |= {key: value for key, value in values.items() if value}
        if stiffness:
            self._spring(number, kind, stiffness, joint, part.element)
        return joint

    def _along(self, number: int, joint: dict[str, Any]) -> None:
        model, element = self.model, self.model.part("joint", number).element
        reference = float(model["qpos0"][int(model["jnt_qposadr"][number])])
        limits: dict[str, Any] = {}
        if bool(model["jnt_limited"][number]) and not model.disabled("limit", "constraint"):
            lower, upper = (float(value) - reference for value in model["jnt_range"][number])
            limits["position"] = numbers([lower, upper])
            if not lower <= 0.0 <= upper:
                joint["position"] = self.begun[number] = min(max(0.0, lower), upper)
                self.features.add("joint.start", element)
            if float(model["jnt_margin"][number]):
                self.features.add("joint.margin", element)
        if bool(model["jnt_actfrclimited"][number]):
            low, high = model["jnt_actfrcrange"][number]
            if -low == high > 0.0:
                limits["effort"] = float(high)
            else:
                self.features.add("joint.effort_range", element)
        if limits:
            joint["limits"] = limits

    def _cone(self, number: int, joint: dict[str, Any]) -> None:
        model, element = self.model, self.model.part("joint", number).element
        if not bool(model["jnt_limited"][number]) or model.disabled("limit", "constraint"):
            return
        largest = float(model["jnt_range"][number][1])
        if 0.0 < largest < math.pi:  # an angle is never larger
            joint["limits"] = {"angle": largest}
        elif not largest > 0.0:
            self.features.add("joint.ball_limit", element)
        if float(model["jnt_margin"][number]):
            self.features.add("joint.margin", element)

    def _others(
        self, number: int, kind: str, element: Element, damping: float, dry: float, armature: float
    ) -> dict[str, Any]:
        """The properties of a ball or a free joint, as far as the language has them."""
        values: dict[str, Any] = {"damping": damping, "armature": armature} if kind == "ball" else {}
        if kind == "free":
            body = int(self.model["jnt_bodyid"][number])
            if np.any(self.model["body_ipos"][body]) or not float(self.model["body_mass"][body]):
                if damping:
                    self.features.add("joint.free_damping", element)
                if armature:
                    self.features.add("joint.armature", element)
            else:
                both = {"damping": damping, "armature": armature}
                values = {key: {"linear": value, "angular": value} for key, value in both.items() if value}
        if dry:
            self.features.add("joint.dry_friction", element)
        return values

    def _spring(self, number: int, kind: str, stiffness: float, joint: dict[str, Any], element: Element) -> None:
        model, at = self.model, int(self.model["jnt_qposadr"][number])
        if kind == "free":
            self.features.add("joint.free_spring", element)
            return
        joint["spring"] = {"stiffness": stiffness}
        if kind != "ball":
            rest = float(model["qpos_spring"][at]) - float(model["qpos0"][at])
            if rest:
                joint["spring"]["rest"] = rest

    def _polynomials(self, number: int, at: int, element: Element) -> None:
        """Springs and dampers that are not linear, springs that yield."""
        model = self.model
        higher = ((model.get("jnt_stiffnesspoly"), number, "spring"), (model.get("dof_dampingpoly"), at, "damper"))
        for values, index, flag in higher:
            if values is not None and np.any(values[index]) and not model.disabled(flag):
                self.features.add("joint.polynomial", element)
        yields = model.get("jnt_springyield")
        if yields is not None and np.any(yields[number]):
            self.features.add("joint.plastic", element)


def add_frames(bodies: MjcfBodies) -> tuple[dict[str, dict[str, Any]], MjcfNames]:
    """The sites of a file that have a name and stand on a body, by their names in the spec, and what is renamed. Those of the
    world itself are on the body that stands for it, where there is one."""
    model, names = bodies.model, MjcfNames(set(bodies.data))
    made: dict[str, dict[str, Any]] = {}
    for number, part in model.parts.get("site", {}).items():
        body = int(model["site_bodyid"][number])
        if not part.name or (not body and bodies.ground is None) or len(made) >= MOST["frames"]:
            continue
        shift = bodies.shifts.get(body)
        position = model["site_pos"][number] if shift is None else model["site_pos"][number] - shift
        words: dict[str, Any] = {"body": bodies.named(body)}
        if place := pose(position, model["site_quat"][number]):
            words["pose"] = place
        made[names.give(part.name, f"site_{number}")] = words
        bodies.features.framed.add(id(part.element))
    return made, names
