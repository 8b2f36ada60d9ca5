"""Mass properties of links: what the file says, whether a body can have them, and what rules of repair make of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from simspec.imports.draft import Draft, angle, numbers, plain
from simspec.imports.elements import Element
from simspec.imports.moments import (
    DENSITY,
    FROM_SHAPES,
    MEANING,
    NOT_POSITIVE,
    OF_SHAPES,
    OF_SHAPES_OR_BALL,
    Six,
    ball,
    became,
    given,
    nearest,
    shown,
)
from simspec.imports.moments import RULE as TRIANGLE
from simspec.imports.urdf.shapes import Shape
from simspec.imports.urdf.table import INFORMATION, LOST, UNUSED
from simspec.language.document import Path_
from simspec.language.moments import impossible, principal_moments
from simspec.world import frames
from simspec.world.types import Pose, Vector3

MOMENTS: Final = ("xx", "yy", "zz", "xy", "xz", "yz")
MASS: Final = "<mass value>"
"""What an inertial without a mass lacks."""
COPIES: Final = {"iyx": "ixy", "izx": "ixz", "izy": "iyz"}
"""Products of inertia that a file may write twice."""


@dataclass
class Mass:
    """The mass properties of a link as the file says them: the tensor is in the axes of the inertial's own frame."""

    element: Element
    mass: float
    centre: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)
    tensor: Six | None = None
    missing: str = ""
    """What the inertial lacks, in words; "" for nothing."""
    from_shapes: bool = False
    """A rule lets the moments follow from the shapes."""
    density: float = 0.0
    """kg/m³ by which a rule lets the mass follow from the shapes; 0 where none does."""

    @property
    def lacks_mass(self) -> bool:
        """Whether the file gives no mass that a body can have: none at all, or one below 0."""
        return self.mass < 0.0 or (not self.mass and MASS in self.missing)

    def written(self) -> dict[str, Any]:
        """The words of the body."""
        if self.density:
            return {}
        if not self.mass and (self.tensor is None or not any(self.tensor)):
            return {}
        data: dict[str, Any] = {"mass": plain(self.mass)}
        if self.from_shapes or self.tensor is None:
            return data
        if any(self.centre):
            data["centre_of_mass"] = numbers(self.centre)
        data["inertia"] = self._inertia()
        return data

    def _inertia(self) -> dict[str, Any]:
        """The moments in the shortest words that say exactly the same, where there are such."""
        tensor = self.tensor or (0.0,) * 6
        diagonal, products = tensor[:3], tensor[3:]
        if not any(products) and min(diagonal) >= 0.0:
            turn = {"rpy": [angle(value) for value in self.rpy]} if any(self.rpy) else {}
            return {"principal": numbers(diagonal), **turn}
        if any(self.rpy):
            tensor = frames.rotate_inertia(frames.from_rpy(*self.rpy), tensor)
        pairs = zip(MOMENTS, tensor, strict=True)
        return {"tensor": {name: plain(value) for name, value in pairs if value or name in MOMENTS[:3]}}


def read_mass(link: Element) -> Mass | None:
    """What a link says of its mass; None where it says nothing. Raises SpecError for what are no numbers."""
    inertial = link.child("inertial")
    if inertial is None:
        return None
    origin, mass, inertia = inertial.child("origin"), inertial.child("mass"), inertial.child("inertia")
    read = Mass(inertial, 0.0)
    if origin is not None:
        read.centre, read.rpy = origin.vector("xyz"), origin.vector("rpy")
    missing = []
    if mass is None or not mass.has("value"):
        missing.append(MASS)
    else:
        read.mass = mass.number("value") or 0.0
    if inertia is None:
        missing.append("<inertia>")
    else:
        missing += [f"i{name} of <inertia>" for name in MOMENTS[:3] if not inertia.has(f"i{name}")]
        six = [inertia.number(f"i{name}") or 0.0 for name in MOMENTS]
        _copies(inertia)
        read.tensor = (six[0], six[1], six[2], six[3], six[4], six[5])
    read.missing = ", ".join(missing)
    return read


def _copies(inertia: Element) -> None:
    """Say of products of inertia that are written a second time, as a matrix has them, whether they are the same."""
    for copy, own in COPIES.items():
        if not inertia.has(copy):
            continue
        if inertia.number(copy) == (inertia.number(own) or 0.0):
            inertia.set_aside(copy, UNUSED, f"the same as {own}", INFORMATION)
        else:
            inertia.set_aside(copy, LOST, f"another than {own}, which readers take")


def check_mass(mass: Mass, has_shapes: bool, draft: Draft, path: Path_) -> None:
    """Repair the mass properties of a link that may move, or report what is wrong with them."""
    inertial = mass.element
    if mass.missing:
        _incomplete(mass, has_shapes, draft, path)
        return
    if mass.mass < 0.0:
        draft.defect(inertial, "a mass below 0", FROM_SHAPES, RULES[FROM_SHAPES], found=f"{mass.mass:g} kg")
        return
    tensor = mass.tensor or (0.0,) * 6
    if not mass.mass and any(tensor):
        _moments_of_nothing(mass, draft, path)
        return
    why = impossible(principal_moments(tensor))
    if why is None:
        return
    if "triangle" not in why:
        not_positive(mass, has_shapes, why, draft, path)
    elif not draft.repairing(TRIANGLE):
        draft.defect(inertial, why, TRIANGLE, RULES[TRIANGLE])
    else:
        before = principal_moments(tensor)
        mass.tensor = nearest(tensor)
        after = principal_moments(mass.tensor)
        draft.repaired(TRIANGLE, inertial, became(before, after), (*path, "inertia"))


def _moments_of_nothing(mass: Mass, draft: Draft, path: Path_) -> None:
    """A link without mass has no moments of inertia: no body has these, and readers that add them to what the link is fixed
    to change how it turns."""
    inertial, rule = mass.element, "massless-moments"
    if not draft.repairing(rule):
        found = shown((mass.tensor or (0.0,) * 6)[:3])
        draft.defect(inertial, "moments of inertia of a link without mass", rule, RULES[rule], found=f"{found} kg m²")
        return
    mass.tensor = None
    _left_out(inertial, LOST, f"left out by the rule {rule}")
    draft.repaired(rule, inertial, "moments of inertia of a link without mass are left out", path)


def _incomplete(mass: Mass, has_shapes: bool, draft: Draft, path: Path_) -> None:
    inertial, rule = mass.element, "incomplete-inertial"
    if not draft.repairing(rule):
        draft.defect(inertial, "an incomplete inertial", rule, RULES[rule], found=f"no {mass.missing}")
    elif mass.mass > 0.0:
        _without_moments(mass, has_shapes, rule, draft, path)
    else:
        mass.tensor, mass.mass = None, 0.0
        _left_out(inertial, LOST, f"without {mass.missing}: left out by the rule {rule}")
        draft.repaired(rule, inertial, f"without {mass.missing}: the body has no mass", path)


def give_mass(mass: Mass, solids: Sequence[Shape], density: float, draft: Draft, path: Path_) -> None:
    """Let the mass properties of a link follow from ``solids``, shapes of it with a volume, of ``density`` (kg/m³)."""
    element = mass.element
    what = given(path[-1] if isinstance(path[-1], str) else "", mass.mass, solids, density)
    for part in element.look("origin", "mass", "inertia") if element.tag == "inertial" else ():
        for name in part.attributes:
            part.set_aside(name, LOST, f"replaced by the rule {FROM_SHAPES}")
    mass.mass, mass.tensor, mass.missing, mass.density = 0.0, None, "", density
    draft.repaired(FROM_SHAPES, element, what, (*path, "shapes"))


def _left_out(element: Element, fate: Any, reason: str) -> None:
    """Say of everything that was taken in an inertial that it is left out."""
    for part in (element, *element.look("origin", "mass", "inertia")):
        for name in part.attributes:
            part.set_aside(name, fate, reason, INFORMATION)


def leave_out(mass: Mass) -> None:
    """Say that the mass properties of a link that is fixed to the world, which no body can have, are left out."""
    _left_out(mass.element, UNUSED, "impossible, and without effect: this link is fixed to the world")


def not_positive(mass: Mass, has_shapes: bool, why: str, draft: Draft, path: Path_) -> None:
    """Repair moments of inertia that are not above 0, or report them."""
    rule = NOT_POSITIVE
    if not draft.repairing(rule):
        draft.defect(mass.element, why, rule, RULES[rule])
    elif mass.mass <= 0.0:
        draft.defect(mass.element, f"{why}, and no mass that moments could follow from", found=f"{mass.mass:g} kg")
    else:
        _without_moments(mass, has_shapes, rule, draft, path)


def _without_moments(mass: Mass, has_shapes: bool, rule: str, draft: Draft, path: Path_) -> None:
    """Let the moments follow from the shapes; of a body without shapes, be those of a ball."""
    inertial = mass.element
    for part in inertial.look("origin", "inertia"):
        if has_shapes or part.tag == "inertia":
            for name in part.attributes:
                part.set_aside(name, LOST, f"replaced by the rule {rule}")
    if has_shapes:
        mass.from_shapes = True
        what = f"the centre of mass and the moments follow from the shapes, of even density, of {mass.mass:g} kg"
        draft.repaired(rule, inertial, what, (*path, "mass"))
        return
    moment = ball(mass.mass)
    mass.tensor = (moment, moment, moment, 0.0, 0.0, 0.0)
    what = f"the moments are those of a ball of {mass.mass:g} kg and {DENSITY:g} kg/m³: {moment:.6g} kg m²"
    draft.repaired(rule, inertial, what, (*path, "inertia"))


def total(members: Iterable[tuple[Mass, Pose]]) -> tuple[float, Six]:
    """Mass, and tensor about the common centre of mass, of links that are fixed to each other; each with the pose of its frame
    in a common one."""
    parts = []
    for mass, where in members:
        if mass.tensor is None:
            continue
        turn = frames.multiply(where.quaternion, frames.from_rpy(*mass.rpy))
        centre = frames.add(where.position, frames.rotate(where.quaternion, mass.centre))
        parts.append((mass.mass, centre, frames.rotate_inertia(turn, mass.tensor)))
    whole = math.fsum(part[0] for part in parts)
    if whole <= 0.0:
        return whole, (0.0,) * 6
    middle = [math.fsum(part[0] * part[1][axis] for part in parts) / whole for axis in range(3)]
    sums = [0.0] * 6
    for own, centre, tensor in parts:
        x, y, z = (centre[axis] - middle[axis] for axis in range(3))
        steiner = (y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z)
        sums = [value + a + own * b for value, a, b in zip(sums, tensor, steiner, strict=True)]
    return whole, (sums[0], sums[1], sums[2], sums[3], sums[4], sums[5])


RULES: Final = {
    FROM_SHAPES: OF_SHAPES,
    TRIANGLE: MEANING,
    NOT_POSITIVE: OF_SHAPES_OR_BALL,
    "massless-moments": "moments of inertia of a link whose mass is 0 are left out",
    "incomplete-inertial": "moments that are missing follow from the shapes; an inertial without mass is left out",
}
