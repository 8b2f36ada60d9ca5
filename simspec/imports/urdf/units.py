"""Lengths and moments of inertia in millimetres: told by what is many times larger than the robot that it is of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from simspec import numerals
from simspec.imports.draft import Draft
from simspec.imports.elements import Element
from simspec.imports.urdf.joints import Joint
from simspec.imports.urdf.masses import Mass
from simspec.imports.urdf.shapes import Shape
from simspec.language.document import Path_
from simspec.language.moments import principal_moments

MILLIMETRES: Final = "millimetres"
RULES: Final = {
    MILLIMETRES: "what is many times larger than its robot is in millimetres: joints and shapes, meshes, moments of inertia"
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
LENGTHS: Final[Mapping[str, Sequence[str]]] = {
    "origin": ("xyz",),
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "ellipsoid": ("a", "b", "c"),
}
"""Attributes of elements that are lengths; those of limits are so for slides only."""


@dataclass
class Link:
    """What a link's moments of inertia are compared with."""

    path: Path_
    mass: Mass
    reach: float
    """m: the furthest that anything of the link is from its centre of mass."""


# --- the whole file ---------------------------------------------------------------------------------------------------


def scale_file(root: Element, draft: Draft) -> None:
    """Where joints are further apart than any robot's, all lengths of the file become metres by the rule, or it is told."""
    far = [joint for joint in root.look("joint") if _origin(joint) > FURTHEST_JOINT]
    if not far:
        return
    shown = f"{_origin(far[0]):g} m from its parent's frame"
    if not draft.repairing(MILLIMETRES):
        draft.suspect(
            far[0],
            "a joint is further away than any robot's: lengths in millimetres?",
            MILLIMETRES,
            RULES[MILLIMETRES],
            shown,
        )
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
    """m between a joint's frame and its parent's; 0 for one that is no number, which is told where it is read."""
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


# --- meshes -----------------------------------------------------------------------------------------------------------


def large_meshes(shapes: Sequence[Shape], joints: Sequence[Joint], draft: Draft) -> list[Shape]:
    """The shapes whose meshes are many times larger than the robot, with others of the same factors: by the rule they are
    millimetres now, and have to be read again. Without it none, and it is told."""
    apart = max((math.hypot(*joint.origin.position) for joint in joints), default=0.0)
    least = max(LARGEST_MESH, MESH_SHARE * apart) if apart > 0.0 else FURTHEST_JOINT
    far = [shape for shape in shapes if shape.mesh is not None and shape.radius > least]
    # without joints the rule has to be named, since a ground may be of any size
    if not far or (apart == 0.0 and not draft.options.repairs.is_named(MILLIMETRES)):
        return []
    shown = f"{far[0].radius:.3g} m from its origin"
    if not draft.repairing(MILLIMETRES):
        message = _counted("a mesh is many times larger than its robot: in millimetres?", len(far), "meshes")
        _tell(far[0].element, message, shown, draft)
        return []
    factors = {shape.mesh.scale for shape in far if shape.mesh is not None}
    large = [shape for shape in shapes if shape.mesh is not None and shape.mesh.scale in factors]
    for shape in large:
        assert shape.mesh is not None
        x, y, z = shape.mesh.scale
        shape.mesh = replace(shape.mesh, scale=(x * THOUSANDTH, y * THOUSANDTH, z * THOUSANDTH))
        shape.data["mesh"] = shape.mesh.data()
        draft.repaired(MILLIMETRES, shape.element, "the mesh is in millimetres", ("model", "bodies"))
    return large


# --- moments of inertia -----------------------------------------------------------------------------------------------


def reach(shapes: Sequence[Shape], mass: Mass, joints: Sequence[Joint]) -> float:
    """m: how far the shapes of a link, or the joints that lead from it, are from its centre of mass; 0 where it has none."""
    ends = [shape.radius + math.dist(shape.data.get("pose", {}).get("xyz", (0, 0, 0)), mass.centre) for shape in shapes]
    ends += [math.dist(joint.origin.position, mass.centre) for joint in joints]
    return max((end for end in ends if math.isfinite(end)), default=0.0)


def scale_moments(links: Sequence[Link], draft: Draft) -> None:
    """Moments of inertia that are many times those of the links become kg m² by the rule, or it is told."""
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
        _tell(link.mass.element, _counted(away, len(large), "links"), f"a link of {link.reach:.3g} m", draft)
        return
    whole = [link for link in links if _gyration(link.mass) > 0.0] if 2 * len(large) > len(links) else large
    for link in whole:
        six = link.mass.tensor or (0.0,) * 6
        factor = UNITS[unit]
        link.mass.tensor = (
            six[0] * factor, six[1] * factor, six[2] * factor, six[3] * factor, six[4] * factor, six[5] * factor
        )  # fmt: skip
        what = f"the moments of inertia are in {unit}"
        draft.repaired(MILLIMETRES, link.mass.element, what, (*link.path, "inertia"))


def _tell(element: Element, message: str, found: str, draft: Draft) -> None:
    draft.suspect(element, message, MILLIMETRES, RULES[MILLIMETRES], found)


def _counted(message: str, count: int, what: str) -> str:
    return message if count == 1 else f"{message} (and {count - 1} more {what})"


def _share(link: Link) -> float:
    """Radius of gyration by the size of the link; 0 where it is no larger than that of what is no robot's part."""
    gyration = _gyration(link.mass)
    return gyration / (link.reach or 1.0) if gyration > GYRATION else 0.0


def _gyration(mass: Mass) -> float:
    if mass.mass <= 0.0 or mass.tensor is None:
        return 0.0
    return math.sqrt(max(0.0, principal_moments(mass.tensor)[2]) / mass.mass)
