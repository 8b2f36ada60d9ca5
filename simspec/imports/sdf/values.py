"""Values of SDF: texts of child elements, with the defaults that the language gives them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from simspec import numerals
from simspec.imports.draft import angle
from simspec.imports.elements import Element
from simspec.language.foreign import Fate, Severity
from simspec.world import frames
from simspec.world.types import Pose, Quaternion, Vector3

TRUE: Final = ("true", "1")
FALSE: Final = ("false", "0")
EULER: Final = "euler_rpy"
QUATERNION: Final = "quat_xyzw"
UNIT: Final = 1e-2
"""How far from 1 a quaternion's length may be; the language's own bound."""


def text_of(parent: Element, tag: str, default: str) -> str:
    """The text of a child, taken."""
    child = parent.child(tag)
    return default if child is None or not child.text else child.text


def number_of(parent: Element, tag: str, default: float) -> float:
    """The number of a child, taken; ``inf`` is one. Raises SpecError for others."""
    child = parent.child(tag)
    return default if child is None else number(child)


def number(element: Element) -> float:
    """The number of an element; ``inf`` is one. Raises SpecError for others."""
    try:
        return numerals.number(element.text, infinite=True)
    except numerals.NumeralError as error:
        raise element.error(f"<{element.tag}> should be a number{error.suffix}", found=element.text[:80]) from None


def finite_of(parent: Element, tag: str, default: float) -> float:
    """The same, finite. Raises SpecError for others."""
    value = number_of(parent, tag, default)
    if math.isinf(value):
        raise parent.error(f"<{tag}> should be finite", found=str(value))
    return value


def vector_of(parent: Element, tag: str, default: Vector3) -> Vector3:
    """Three numbers of a child, taken. Raises SpecError for others."""
    child = parent.child(tag)
    return default if child is None else vector(child)


def vector(element: Element) -> Vector3:
    """The three numbers of an element, taken."""
    x, y, z = element.content(3)
    return (x, y, z)


def flag_of(parent: Element, tag: str, default: bool) -> bool:
    """The flag of a child, taken. Raises SpecError for other texts."""
    child = parent.child(tag)
    return default if child is None else flag(child, child.text)


def flag(element: Element, text: str) -> bool:
    """A flag of an element. Raises SpecError for other texts."""
    word = text.strip().lower()
    if word not in (*TRUE, *FALSE):
        raise element.error("not a flag", found=text[:80], allowed="true, false, 1, 0")
    return word in TRUE


IDENTITY: Final = Pose()
"""The same frame."""


@dataclass(frozen=True, slots=True)
class Placement:
    """A pose, with the angles that the file gives where it gives them."""

    pose: Pose = IDENTITY
    rpy: Vector3 | None = None

    def then(self, inner: Placement) -> Placement:
        """The pose of C in A, from this of B in A and ``inner`` of C in B."""
        if self.pose == IDENTITY:
            return inner
        if inner.pose == IDENTITY:
            return self
        if self.pose.quaternion == frames.IDENTITY:
            return Placement(frames.compose(self.pose, inner.pose), inner.rpy)
        return Placement(frames.compose(self.pose, inner.pose))

    def inverse(self) -> Placement:
        """The pose of A in B."""
        return self if self.pose == IDENTITY else Placement(frames.inverse(self.pose))

    def data(self) -> dict[str, object]:
        """The pose as the language has it; {} for the identity."""
        data: dict[str, object] = {}
        if any(self.pose.position):
            data["xyz"] = list(self.pose.position)
        if self.pose.quaternion != frames.IDENTITY:
            if self.rpy is not None:
                data["rpy"] = [angle(value) for value in self.rpy]
            else:
                data["quat"] = list(self.pose.quaternion)
        return data


def at(position: Vector3) -> Placement:
    """A pose without rotation."""
    return Placement(Pose(position))


SAME: Final = Placement()


@dataclass(frozen=True, slots=True)
class Placed:
    """A ``<pose>`` of the file: where it is, and against which frame ("": the default of its element)."""

    placement: Placement = SAME
    relative_to: str = ""
    element: Element | None = None


def pose_of(parent: Element) -> Placed:
    """The ``<pose>`` of an element, taken. Raises SpecError for what is none."""
    child = parent.child("pose")
    if child is None:
        return Placed()
    relative = child.word("relative_to") or child.word("frame") or ""
    wording = child.word("rotation_format", EULER)
    degrees = flag(child, child.word("degrees") or "false")
    if wording not in (EULER, QUATERNION):
        raise child.error("not a format of rotations", found=wording, allowed=f"{EULER}, {QUATERNION}")
    if not child.text:
        return Placed(Placement(), relative, child)
    values = child.content(7 if wording == QUATERNION else 6)
    position: Vector3 = (values[0], values[1], values[2])
    if wording == QUATERNION:
        return Placed(Placement(Pose(position, _quaternion(child, values[3:]))), relative, child)
    turn = (math.pi / 180.0) if degrees else 1.0
    rpy: Vector3 = (values[3] * turn, values[4] * turn, values[5] * turn)
    if any(abs(angle) > 1e6 for angle in rpy):
        raise child.error("angles of more than 1e6 rad", found=child.text[:80])
    return Placed(Placement(Pose(position, frames.from_rpy(*rpy)), rpy), relative, child)


def _quaternion(element: Element, values: tuple[float, ...]) -> Quaternion:
    x, y, z, w = values
    length = math.hypot(w, x, y, z)
    if abs(length - 1.0) > UNIT:
        raise element.error("not a unit quaternion", found=element.text[:80])
    return frames.normalise((w, x, y, z))


def lost(element: Element | None, reason: str, severity: Severity = Severity.PHYSICS, hint: str = "") -> None:
    """Say that an element with all that is in it is not carried."""
    if element is not None:
        element.set_aside(None, Fate.LOST, reason, severity, hint)


def unused(element: Element | None, reason: str, severity: Severity = Severity.INFORMATION) -> None:
    """Say that an element has no effect in the spec, and need not have."""
    if element is not None:
        element.set_aside(None, Fate.UNUSED, reason, severity)
