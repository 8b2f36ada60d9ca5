"""Mass properties of links, their repairs, and units of lengths and moments."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from simspec import numerals
from simspec.imports.draft import (
    FROM_SHAPES,
    MEANING,
    MOMENTS,
    NOT_POSITIVE,
    OF_SHAPES,
    OF_SHAPES_OR_BALL,
    Draft,
    Six,
    angle,
    ball,
    became,
    even,
    given,
    nearest,
    numbers,
    plain,
    shown,
    tensor_words,
)
from simspec.imports.draft import RULE as TRIANGLE
from simspec.imports.elements import INFORMATION, LOST, UNUSED, Element
from simspec.imports.urdf.elements import LENGTHS as LENGTHS_OF_SHAPES
from simspec.imports.urdf.joints import UrdfJointRead
from simspec.imports.urdf.shapes import UrdfShapeRead
from simspec.language.document import Path_
from simspec.language.moments import impossible, principal_moments
from simspec.world import frames
from simspec.world.inertia import summed_inertial
from simspec.world.types import Inertial, Pose, Vector3

MASS: Final = "<mass value>"
"""The part that an inertial without a mass lacks."""
COPIES: Final = {"iyx": "ixy", "izx": "ixz", "izy": "iyz"}
"""Products of inertia that a file may write twice."""


@dataclass
class UrdfMass:
    """The mass properties of a link as the file says them: the tensor is in the axes of the inertial's own frame."""

    element: Element
    mass: float
    centre: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)
    tensor: Six | None = None
    missing: str = ""
    """The parts that the inertial lacks, in words; "" for none."""
    from_shapes: bool = False
    """A rule lets the moments follow from the shapes."""
    density: float = 0.0
    """kg/m³ by which a rule lets the mass follow from the shapes; 0 where none does."""

    @property
    def lacks_mass(self) -> bool:
        """Whether the file gives no mass that a body can have: none at all, or one below 0."""
        return self.mass < 0.0 or (not self.mass and MASS in self.missing)

    @property
    def is_impossible(self) -> bool:
        """Whether no body has these moments, whatever else moves with the link."""
        return self.tensor is not None and impossible(principal_moments(self.tensor)) is not None

    def written(self) -> dict[str, Any]:
        """The words of the body."""
        if self.density or (not self.mass and not any(self.tensor or ())):
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
        return tensor_words(tensor)


def read_mass(link: Element) -> UrdfMass | None:
    """The mass properties of a link; None where it has none. Raises SpecError for values that are not finite."""
    inertial = link.child("inertial")
    if inertial is None:
        return None
    origin, mass, inertia = inertial.child("origin"), inertial.child("mass"), inertial.child("inertia")
    read = UrdfMass(inertial, 0.0)
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
        read.tensor = frames.vector6(inertia.number(f"i{name}") or 0.0 for name in MOMENTS)
        for copy, text in COPIES.items():
            if not inertia.has(copy):
                continue
            if inertia.number(copy) == (inertia.number(text) or 0.0):
                inertia.ignore(copy, f"the same as {text}")
            else:
                inertia.lose(copy, f"another than {text}, which readers take")
    read.missing = ", ".join(missing)
    return read


def check_mass(mass: UrdfMass, has_shapes: bool, draft: Draft, path: Path_) -> None:
    """Repair the mass properties of a link that may move, or report what is wrong with them."""
    inertial = mass.element
    tensor = mass.tensor or (0.0,) * 6
    if mass.missing:
        _incomplete(mass, has_shapes, draft, path)
    elif mass.mass < 0.0:
        draft.defect(inertial, "a mass below 0", FROM_SHAPES, f"{mass.mass:g} kg")
    elif not mass.mass and any(tensor):
        _moments_of_nothing(mass, draft, path)
    elif (why := impossible(principal_moments(tensor))) is None:
        return
    elif "triangle" not in why:
        not_positive(mass, has_shapes, why, draft, path)
    else:
        possible = nearest(tensor)
        repair = became(principal_moments(tensor), principal_moments(possible))
        if draft.mend(TRIANGLE, inertial, why, repair, (*path, "inertia")):
            mass.tensor = possible


def _moments_of_nothing(mass: UrdfMass, draft: Draft, path: Path_) -> None:
    """A link without mass has no moments of inertia: no body has these, and readers that add them to what the link is fixed
    to change how it turns."""
    rule, message = "massless-moments", "moments of inertia of a link without mass"
    found = f"{shown((mass.tensor or (0.0,) * 6)[:3])} kg m²"
    if draft.mend(rule, mass.element, message, f"{message} are left out", path, found):
        mass.tensor = None
        _left_out(mass.element, LOST, f"left out by the rule {rule}")


def _incomplete(mass: UrdfMass, has_shapes: bool, draft: Draft, path: Path_) -> None:
    inertial, rule = mass.element, "incomplete-inertial"
    if not draft.repairing(rule):
        draft.defect(inertial, "an incomplete inertial", rule, f"no {mass.missing}")
    elif mass.mass > 0.0:
        _without_moments(mass, has_shapes, rule, draft, path)
    else:
        mass.tensor, mass.mass = None, 0.0
        _left_out(inertial, LOST, f"without {mass.missing}: left out by the rule {rule}")
        draft.repaired(rule, inertial, f"without {mass.missing}: the body has no mass", path)


def give_mass(mass: UrdfMass, solids: Sequence[UrdfShapeRead], density: float, draft: Draft, path: Path_) -> None:
    """Let the mass properties of a link follow from ``solids``, shapes of it with a volume, of ``density`` (kg/m³)."""
    element = mass.element
    what = given(path[-1] if isinstance(path[-1], str) else "", mass.mass, solids, density)
    for part in element.look("origin", "mass", "inertia") if element.tag == "inertial" else ():
        for name in part.attributes:
            part.lose(name, f"replaced by the rule {FROM_SHAPES}")
    mass.mass, mass.tensor, mass.missing, mass.density = 0.0, None, "", density
    draft.repaired(FROM_SHAPES, element, what, (*path, "shapes"))


def _left_out(element: Element, fate: Any, reason: str) -> None:
    for part in (element, *element.look("origin", "mass", "inertia")):
        for name in part.attributes:
            part.set_aside(name, fate, reason, INFORMATION)


def leave_out_mass(mass: UrdfMass) -> None:
    """Say that the mass properties of a link that is fixed to the world, which no body can have, are left out."""
    _left_out(mass.element, UNUSED, "impossible, and without effect: this link is fixed to the world")


def not_positive(mass: UrdfMass, has_shapes: bool, why: str, draft: Draft, path: Path_) -> None:
    """Repair moments of inertia that are not above 0, or report them."""
    rule = NOT_POSITIVE
    if not draft.repairing(rule):
        draft.defect(mass.element, why, rule)
    elif mass.mass <= 0.0:
        draft.defect(mass.element, f"{why}, and no mass that moments could follow from", found=f"{mass.mass:g} kg")
    else:
        _without_moments(mass, has_shapes, rule, draft, path)


def _without_moments(mass: UrdfMass, has_shapes: bool, rule: str, draft: Draft, path: Path_) -> None:
    """Let the moments follow from the shapes; of a body without shapes, be those of a ball."""
    inertial = mass.element
    for part in inertial.look("origin", "inertia"):
        if has_shapes or part.tag == "inertia":
            for name in part.attributes:
                part.lose(name, f"replaced by the rule {rule}")
    if has_shapes:
        mass.from_shapes = True
        draft.repaired(rule, inertial, even(mass.mass), (*path, "mass"))
        return
    moment, what = ball(mass.mass)
    mass.tensor = (moment, moment, moment, 0.0, 0.0, 0.0)
    draft.repaired(rule, inertial, what, (*path, "inertia"))


def total(members: Iterable[tuple[UrdfMass, Pose]]) -> Inertial:
    """The inertia of links that are fixed to each other; each with the pose of its frame in a common one."""
    return summed_inertial(
        (Inertial(mass.mass, mass.centre, frames.rotate_inertia(frames.from_rpy(*mass.rpy), mass.tensor)), where)
        for mass, where in members
        if mass.tensor is not None
    )


RULES: Final = {
    FROM_SHAPES: OF_SHAPES,
    TRIANGLE: MEANING,
    NOT_POSITIVE: OF_SHAPES_OR_BALL,
    "massless-moments": "moments of inertia of a link whose mass is 0 are left out",
    "incomplete-inertial": "moments that are missing follow from the shapes; an inertial without mass is left out",
}

# Lengths and moments in millimetres: far larger than the robot that they belong to.

MILLIMETRES: Final = "millimetres"
UNIT_RULES: Final = {
    MILLIMETRES: "values many times larger than their robot are in millimetres: joints and shapes, meshes, moments of inertia"
}
FURTHEST_JOINT: Final = 50.0
"""m between a joint and its parent's: no robot is so large, and one in millimetres has its longest link in it."""
LARGEST_MESH: Final = 5.0
"""m from the origin of a mesh's frame, from which on it is compared with the joints."""
MESH_SHARE: Final = 20.0
"""Radius of a mesh by the longest distance between joints; that of a link in its right unit is below 3."""
GYRATION: Final = 2.0
"""m, radius of gyration from which on it is compared with the link: small links are given large moments on purpose."""
GYRATION_SHARE: Final = 100.0
"""Radius of gyration by the size of the link: in kg mm² it is 1,000 times that of the link itself, in g mm² 31,623 times."""
FINE: Final = 2500.0
"""Of the same, from which on the unit is g mm²."""
UNITS: Final = {"kg mm²": 1e-6, "g mm²": 1e-9}
"""kg m² of moments of inertia in them."""
THOUSANDTH: Final = 1e-3
LENGTHS: Final[Mapping[str, Sequence[str]]] = {"origin": ("xyz",), **LENGTHS_OF_SHAPES}
"""Attributes of elements that are lengths; those of limits are so for slides only."""


@dataclass
class LinkSize:
    """The size of a link, for comparison with its moments of inertia."""

    path: Path_
    mass: UrdfMass
    reach: float
    """m: the furthest that anything of the link is from its centre of mass."""


def scale_file(root: Element, draft: Draft) -> None:
    """Where joints are further from each other than any robot's, all lengths of the file become metres by the rule, or it is
    reported."""
    far = [joint for joint in root.look("joint") if _origin(joint) > FURTHEST_JOINT]
    if not far:
        return
    shown = f"{_origin(far[0]):g} m from its parent's frame"
    if not draft.repairing(MILLIMETRES):
        message = "a joint is further away than any robot's: lengths in millimetres?"
        draft.suspect(far[0], message, MILLIMETRES, shown)
        return
    for element in root.within():
        local = element.tag.rpartition(":")[2]
        for name in LENGTHS.get(local, ()):
            _scale(element, name)
        if local == "mesh":
            element.attributes.setdefault("scale", "1 1 1")
            _scale(element, "scale")
        if local == "joint" and element.attributes.get("type", "").strip() == "prismatic":
            for limit in element.look("limit"):
                for name in ("lower", "upper", "velocity"):
                    _scale(limit, name)
    draft.repaired(MILLIMETRES, root, f"all lengths are millimetres: a joint is {shown}", ())


def _origin(joint: Element) -> float:
    """m between a joint's frame and its parent's; 0 for a value that is not finite, which is reported where it is read."""
    for origin in joint.look("origin"):
        values = _numbers(origin.attributes.get("xyz", ""))
        return math.hypot(*values) if values is not None else 0.0
    return 0.0


def _scale(element: Element, name: str) -> None:
    values = _numbers(element.attributes.get(name, ""))
    if values is not None:
        element.attributes[name] = " ".join(repr(value * THOUSANDTH) for value in values)


def _numbers(text: str) -> list[float] | None:
    try:
        values = list(numerals.numbers(text))
    except numerals.NumeralError:
        return None
    return values or None


def large_meshes(shapes: Sequence[UrdfShapeRead], joints: Sequence[UrdfJointRead], draft: Draft) -> list[UrdfShapeRead]:
    """The shapes whose meshes are many times larger than the robot, with others of the same factors: by the rule they are
    millimetres now, and have to be read again. Without it none, and it is reported."""
    longest = max((math.hypot(*joint.origin.position) for joint in joints), default=0.0)
    least = max(LARGEST_MESH, MESH_SHARE * longest) if longest > 0.0 else FURTHEST_JOINT
    far = [shape for shape in shapes if shape.mesh is not None and shape.radius > least]
    # without joints the rule has to be named, since a ground may be of any size
    if not far or (longest == 0.0 and not draft.options.repairs.is_named(MILLIMETRES)):
        return []
    shown = f"{far[0].radius:.3g} m from its origin"
    if not draft.repairing(MILLIMETRES):
        message = _counted("a mesh is many times larger than its robot: in millimetres?", len(far), "meshes")
        draft.suspect(far[0].element, message, MILLIMETRES, shown)
        return []
    factors = {shape.mesh.scale for shape in far if shape.mesh is not None}
    large = [shape for shape in shapes if shape.mesh is not None and shape.mesh.scale in factors]
    for shape in large:
        assert shape.mesh is not None
        scale = frames.vector3(factor * THOUSANDTH for factor in shape.mesh.scale)
        shape.mesh = replace(shape.mesh, scale=scale)
        shape.data["mesh"] = shape.mesh.data()
        draft.repaired(MILLIMETRES, shape.element, "the mesh is in millimetres", ("model", "bodies"))
    return large


def reach(shapes: Sequence[UrdfShapeRead], mass: UrdfMass, joints: Sequence[UrdfJointRead]) -> float:
    """m: how far the shapes of a link, or the joints that lead from it, are from its centre of mass; 0 where it has none."""
    ends = [shape.radius + math.dist(shape.data.get("pose", {}).get("xyz", (0, 0, 0)), mass.centre) for shape in shapes]
    ends += [math.dist(joint.origin.position, mass.centre) for joint in joints]
    return max((end for end in ends if math.isfinite(end)), default=0.0)


def scale_moments(links: Sequence[LinkSize], draft: Draft) -> None:
    """Moments of inertia that are many times those of the links become kg m² by the rule, or it is reported."""
    shares = {id(link): _share(link) for link in links}
    large = [link for link in links if shares[id(link)] > GYRATION_SHARE]
    if not large:
        return
    fine = sum(shares[id(link)] > FINE for link in large)
    unit = "g mm²" if 2 * fine > len(large) else "kg mm²"
    most = len(links) > 1 and 2 * len(large) > len(links)
    # a single link may have been given large moments on purpose: there the rule has to be named
    if not (draft.repairing(MILLIMETRES) if most else draft.options.repairs.is_named(MILLIMETRES)):
        link = large[0]
        away = f"moments of inertia of mass that is {_gyration(link.mass):.3g} m away: in {unit}?"
        message = _counted(away, len(large), "links")
        draft.suspect(link.mass.element, message, MILLIMETRES, f"a link of {link.reach:.3g} m")
        return
    whole = [link for link in links if _gyration(link.mass) > 0.0] if 2 * len(large) > len(links) else large
    for link in whole:
        link.mass.tensor = frames.vector6(moment * UNITS[unit] for moment in link.mass.tensor or (0.0,) * 6)
        what = f"the moments of inertia are in {unit}"
        draft.repaired(MILLIMETRES, link.mass.element, what, (*link.path, "inertia"))


def _counted(message: str, count: int, what: str) -> str:
    return message if count == 1 else f"{message} (and {count - 1} more {what})"


def _share(link: LinkSize) -> float:
    """Radius of gyration by the size of the link; 0 where it is no larger than that of what is no robot's part."""
    gyration = _gyration(link.mass)
    return gyration / (link.reach or 1.0) if gyration > GYRATION else 0.0


def _gyration(mass: UrdfMass) -> float:
    if mass.mass <= 0.0 or mass.tensor is None:
        return 0.0
    return math.sqrt(max(0.0, principal_moments(mass.tensor)[2]) / mass.mass)
