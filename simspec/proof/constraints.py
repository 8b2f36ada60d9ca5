"""What holds joints and bodies together outside the tree, what acts along sums, named frames, and the fluid with the boxes
that feel it: the part of the comparator (``comparator.py``) that is not about single bodies alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from simspec.proof.checks import Tally
from simspec.proof.distances import distance, relative, turn_between
from simspec.world.actions import Box
from simspec.world.kinematics import members as ends_of
from simspec.world.types import Connect, Constraint, Follow, ReadBack, Weld, World

LEVELS = {"mass": "L1", "joint": "L2", "geometry": "L4"}


class ConstraintComparison:
    """Notes what a read-back holds other than the world. ``levels``: by part, the proof level of what is noted."""

    world: World
    read_back: ReadBack
    tally: Tally
    tolerance: float
    levels: Mapping[str, str]

    def readable(self, field: str) -> bool:
        return field not in self.read_back.unreadable

    def note(self, part: str, name: str, deviation: float | None, where: str, detail: str = "") -> None:
        self.tally.add(self.levels[part], name, self.tolerance, deviation, where, detail)

    def number(self, part: str, name: str, expected: float | None, actual: float | None, where: str) -> None:
        if (expected is None) != (actual is None):
            self.note(part, name, None, where, f"{actual}, should be {expected}")
        elif expected is not None and actual is not None:
            self.note(part, name, relative(expected, actual), where, f"{actual!r}, should be {expected!r}")
        else:
            self.note(part, name, 0.0, where)

    def vector(
        self, part: str, name: str, expected: Sequence[float], actual: Sequence[float], where: str, scale: float = 1.0
    ) -> None:
        if len(expected) != len(actual):
            self.note(part, name, None, where, f"{len(actual)} numbers, should be {len(expected)}")
        else:
            self.note(
                part, name, distance(expected, actual, scale), where, f"{tuple(actual)}, should be {tuple(expected)}"
            )

    def constraints(self) -> None:
        """What holds joints and bodies together outside the tree, by name."""
        wanted = {constraint.name: constraint for constraint in self.world.constraints}
        names = sorted(
            constraint.name for constraint in self.read_back.constraints
        )  # one that is held twice counts twice
        if wanted or names:
            self.tally.equal(self.levels["joint"], "constraints", sorted(wanted), names, "constraints")
        for actual in self.read_back.constraints:
            expected = wanted.get(actual.name)
            if expected is not None:
                self.constraint(expected, actual, f"constraints.{actual.name}")

    def constraint(self, expected: Constraint, actual: Constraint, where: str) -> None:
        level = self.levels["joint"]
        if not self.tally.equal(level, "constraint type", expected.kind, actual.kind, where):
            return
        self.tally.equal(level, "constraint of", ends_of(expected), ends_of(actual), where)
        if isinstance(expected, Follow) and isinstance(actual, Follow):
            self.number("joint", "ratio", expected.ratio, actual.ratio, f"{where}.ratio")
            self.number("joint", "offset", expected.offset, actual.offset, f"{where}.offset")
        elif isinstance(expected, Connect) and isinstance(actual, Connect):
            for name in ("first_point", "second_point"):
                self.place(getattr(expected, name), getattr(actual, name), f"{where}.{name}")
        elif isinstance(expected, Weld) and isinstance(actual, Weld):
            self.place(expected.pose.position, actual.pose.position, f"{where}.pose")
            turned = turn_between(expected.pose.quaternion, actual.pose.quaternion)
            self.note("joint", "weld, orientation", turned, f"{where}.pose", f"{actual.pose.quaternion}")

    def sums(self) -> None:
        """What acts along sums of joint positions, by name."""
        wanted = {sum_.name: sum_ for sum_ in self.world.sums}
        names = sorted(sum_.name for sum_ in self.read_back.sums)
        if wanted or names:
            self.tally.equal(self.levels["joint"], "sums", sorted(wanted), names, "constraints")
        for actual in self.read_back.sums:
            expected = wanted.get(actual.name)
            if expected is None:
                continue
            where = f"constraints.{actual.name}.sum"
            joints = [[joint for joint, _ in joint_sum.joints] for joint_sum in (expected, actual)]
            if self.tally.equal(self.levels["joint"], "sum of", joints[0], joints[1], f"{where}.joints"):
                for (joint, weight), (_, value) in zip(expected.joints, actual.joints, strict=True):
                    self.number("joint", "coefficient", weight, value, f"{where}.joints.{joint}")
            for name in ("stiffness", "rest", "damping", "dry_friction"):
                self.number("joint", f"sum, {name}", getattr(expected, name), getattr(actual, name), f"{where}.{name}")
            for expected_end, end in zip(
                expected.position_limits or (None, None), actual.position_limits or (None, None), strict=True
            ):
                self.number("joint", "sum, limits", expected_end, end, f"{where}.limits.position")

    def frames(self) -> None:
        """Named frames, of engines that are told them."""
        if self.read_back.frames is None:
            return
        wanted = {frame.name: frame for frame in self.world.frames}
        names = sorted(frame.name for frame in self.read_back.frames)
        if wanted or names:
            self.tally.equal(self.levels["mass"], "frames", sorted(wanted), names, "frames")
        for actual in self.read_back.frames:
            expected = wanted.get(actual.name)
            if expected is None:
                continue
            where, level = f"frames.{actual.name}", self.levels["mass"]
            if self.tally.equal(level, "frame of", expected.body, actual.body, f"{where}.body"):
                at, pose = expected.pose, actual.pose
                scale = max(1.0, math.sqrt(sum(x * x for x in at.position)))
                self.vector("mass", "frame, position", at.position, pose.position, f"{where}.pose", scale)
                turned = turn_between(at.quaternion, pose.quaternion)
                self.note("mass", "frame, orientation", turned, f"{where}.pose", f"{pose.quaternion}")

    def box(self, wanted: Box | None, actual: Box | None, where: str) -> None:
        """By which a body feels the fluid: the squares of its edges, which are sums of moments over a mass, relative to that of
        the longest; how its axes stand."""
        if wanted is None or actual is None:
            if wanted is not actual:
                self.note("mass", "box in the fluid", None, where, "one that is not there, or is not to be")
            return
        longest = max(wanted.edges) ** 2
        squares, stored = ([edge * edge for edge in box.edges] for box in (wanted, actual))
        self.note(
            "mass", "box in the fluid", distance(squares, stored, longest), where, f"{actual.edges}, not {wanted.edges}"
        )
        turned = turn_between(wanted.quaternion, actual.quaternion)
        self.note("mass", "box in the fluid, axes", turned, where, f"{actual.quaternion}")

    def fluid(self) -> None:
        """The fluid that bodies feel."""
        boxes = any(body.box is not None for body in self.world.bodies)
        wanted, actual = self.world.physics.fluid if boxes else None, self.read_back.fluid
        place = "physics.fluid"
        if wanted is None or actual is None:
            if wanted is not actual:
                self.note("geometry", "fluid", None, place, "one that is not there, or is not to be")
            return
        self.number("geometry", "density of the fluid", wanted.density, actual.density, f"{place}.density")
        self.number("geometry", "viscosity of the fluid", wanted.viscosity, actual.viscosity, f"{place}.viscosity")
        fast = max(1.0, math.sqrt(sum(x * x for x in wanted.velocity)))
        where = f"{place}.velocity"
        self.vector("geometry", "velocity of the fluid", wanted.velocity, actual.velocity, where, fast)

    def place(self, expected: Sequence[float], actual: Sequence[float], where: str) -> None:
        """A point that is held, relative to the larger of 1 m and its distance from the body's origin."""
        scale = max(1.0, math.sqrt(sum(x * x for x in expected)))
        self.vector("joint", "held point", expected, actual, where, scale)
