"""The sidecar of a .wbt: what simspec gives Webots beside the file, and the names that its nodes have no place for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from simspec.dialects.kit.joints import OfBody, Spring, check_of_bodies
from simspec.dialects.kit.sidecar import Sidecar
from simspec.formats.kit.forms import check_distinct, check_known
from simspec.world.types import Quaternion


@dataclass(frozen=True, slots=True)
class ShapeEntry:
    """A shape of a body, in the body's order; whether it is seen, and whether it is solid."""

    name: str
    body: str
    visual: bool
    solid: bool


@dataclass(frozen=True, slots=True)
class JointValue:
    """A number of a body's joint."""

    body: str
    value: float


@dataclass(frozen=True, slots=True)
class Range:
    """Position limits of a body's joint (rad, m)."""

    body: str
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class Start:
    """How a ball is turned at the beginning: its frame in its joint's."""

    body: str
    turn: Quaternion


@dataclass(frozen=True, slots=True, kw_only=True)
class WebotsSidecar(Sidecar):
    """The node of body i is ``DEF body_i``, that of its joint ``DEF joint_i``; i counts ``bodies`` from zero."""

    models: tuple[str, ...]
    """Of the bodies, in their order."""
    joints: tuple[str, ...]
    """Of the bodies, in their order."""
    shapes: tuple[ShapeEntry, ...]
    velocity_limits: tuple[JointValue, ...]
    effort_limits: tuple[JointValue, ...]
    damping: tuple[JointValue, ...]
    springs: tuple[Spring, ...]
    untold_limits: tuple[Range, ...]
    """Position limits that Webots is not told, since its stops have no such angles."""
    starts: tuple[Start, ...]

    def check(self) -> None:
        """Raise ValueError, which names the place, where its lists do not fit together."""
        bodies = [body.name for body in self.bodies]
        for name in ("models", "joints"):
            if len(getattr(self, name)) != len(bodies):
                raise ValueError(f"sidecar.{name} has {len(getattr(self, name))} entries for {len(bodies)} bodies")
        check_distinct(self.joints, "sidecar.joints")
        lists: Mapping[str, Iterable[OfBody]] = {
            "velocity_limits": self.velocity_limits,
            "effort_limits": self.effort_limits,
            "damping": self.damping,
            "springs": self.springs,
            "untold_limits": self.untold_limits,
            "starts": self.starts,
        }
        check_of_bodies(lists, bodies)
        check_known((shape.body for shape in self.shapes), bodies, "sidecar.shapes")
        check_distinct((shape.name for shape in self.shapes), "sidecar.shapes")
        for index, shape in enumerate(self.shapes):
            if not (shape.visual or shape.solid):
                raise ValueError(f"sidecar.shapes.{index} is neither seen nor solid")
        balls = {body.name for body in self.bodies if body.kind == "ball"}
        if {start.body for start in self.starts} != balls:
            raise ValueError(f"sidecar.starts are not of the balls {sorted(balls)}")
        for index, start in enumerate(self.starts):
            if abs(sum(part * part for part in start.turn) - 1.0) > 1e-9:
                raise ValueError(f"sidecar.starts.{index}.turn should be of length 1")
