"""Defects planted into URDF files and their sidecar."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final
from xml.etree.ElementTree import Element

from simspec.dialects.kit.defects import (
    BELTS,
    CONSTRAINTS,
    FRAMES,
    MARGINS,
    PASSIVE,
    STEP,
    SUMS,
    Files,
    Plant,
    element_at,
    flipped_product,
    floats,
    scaled,
    sidecar,
    text_of,
    xml,
)
from simspec.dialects.urdf.defects import ARM, BALL, HINGE, INERTIAL, LANGUAGE, attribute, sidecar_number
from simspec.formats.kit.text import FIELDS, number
from simspec.world import frames

# Defects of height fields: in the file of the surface, and in what names it.

Rows = list[list[str]]
"""The lines of a file, by their words."""


def _field(files: Files) -> str:
    """The name of the one file of a height field. Raises LookupError where there is not one."""
    names = [name for name in files if name.startswith(f"{FIELDS}/")]
    if len(names) != 1:
        raise LookupError(f"{len(names)} height fields, not one")
    return names[0]


def _edited(change: Callable[[Rows, Rows], None]) -> Plant:
    """A defect in the file; ``change`` gets its vertices and its triangles."""

    def plant(files: Files) -> dict[str, str]:
        name = _field(files)
        rows = [line.split() for line in files[name].splitlines() if not line.startswith("#")]
        change([row for row in rows if row[0] == "v"], [row for row in rows if row[0] == "f"])
        return {**files, name: "".join(" ".join(row) + "\n" for row in rows)}

    return plant


def _raised(vertices: Rows, triangles: Rows) -> None:
    lowest = min(float(row[3]) for row in vertices)
    inner = next(row for row in vertices[5:] if float(row[3]) > lowest)
    inner[3] = number(float(inner[3]) + STEP)


def _longer(vertices: Rows, triangles: Rows) -> None:
    for row in vertices:
        row[1] = number(float(row[1]) * (1.0 + STEP))


def _thicker(vertices: Rows, triangles: Rows) -> None:
    lowest = min(float(row[3]) for row in vertices)
    for row in vertices:
        if float(row[3]) == lowest:
            row[3] = number(lowest * (1.0 + STEP))


def _mirrored(vertices: Rows, triangles: Rows) -> None:
    for row in vertices:
        row[1] = number(-float(row[1]) + 0.0)
    for row in triangles:
        row[1:] = row[:0:-1]


def _missing(files: Files) -> dict[str, str]:
    missing = _field(files)
    return {name: text for name, text in files.items() if name != missing}


GROUND_DEFECTS: Final[Mapping[str, Plant]] = {
    "height field, a height": _edited(_raised),
    "height field, length": _edited(_longer),
    "height field, base": _edited(_thicker),
    "height field, mirrored": _edited(_mirrored),
    "height field missing": _missing,
}

BOB = "bob.urdf"


def _flip(root: Element) -> None:
    origin, inertia = element_at(root, f"{INERTIAL}/origin"), element_at(root, f"{INERTIAL}/inertia")
    turn = frames.from_rpy(*floats(origin.attrib["rpy"]))
    moments = tuple(float(inertia.attrib[name]) for name in ("ixx", "iyy", "izz"))
    origin.set("rpy", "0 0 0")
    for name, value in zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), flipped_product(moments, turn), strict=True):
        inertia.set(name, text_of(value))


def _not_limited(root: Element) -> None:
    joint = element_at(root, HINGE)
    joint.set("type", "continuous")
    for name in ("lower", "upper"):  # PyBullet keeps the limits of a continuous joint that has some (measured)
        del element_at(joint, "limit").attrib[name]


def _drop_exclude(content: dict[str, Any]) -> None:
    content["collision_filter"]["excluded"].remove(["ball", "cube"])


def _exclude_too_many(content: dict[str, Any]) -> None:
    content["collision_filter"]["excluded"].append(["ball", "floor"])


def _drop_linked(content: dict[str, Any]) -> None:
    content["collision_filter"]["excluded"].remove(["lower", "upper"])


def _linked_too_many(content: dict[str, Any]) -> None:
    content["collision_filter"]["excluded"].append(["ball", "lower"])


def _no_groups(content: dict[str, Any]) -> None:
    classes = content["collision_filter"]["classes"]
    for entry in classes:
        entry["mask"] = sum(other["group"] for other in classes)


def _group(content: dict[str, Any]) -> None:
    """The quiet body goes into the class of the cube."""
    classes = content["collision_filter"]["classes"]
    for class_ in classes:
        if "quiet" in class_["links"]:
            class_["links"].remove("quiet")
    next(single_class for single_class in classes if "cube" in single_class["links"])["links"].append("quiet")


def _class_of(content: dict[str, Any], link: str) -> dict[str, Any]:
    entry: dict[str, Any] = next(entry for entry in content["collision_filter"]["classes"] if link in entry["links"])
    return entry


def _copy_filter(content: dict[str, Any]) -> None:
    """The rubber cube and its copy change places in the filter."""
    instance = next(instance for instance in content["instances"] if instance["bodies"] == ["rubber_cube"])
    text, copy = "rubber_cube", instance["copies"][0]["link"]
    for single_class in content["collision_filter"]["classes"]:
        single_class["links"] = [{text: copy, copy: text}.get(link, link) for link in single_class["links"]]


def _passing(content: dict[str, Any]) -> None:
    ghost, ice = (_class_of(content, link) for link in ("ghost_cube", "ice_cube"))
    ghost["mask"] |= ice["group"]
    ice["mask"] |= ghost["group"]


def _cone(content: dict[str, Any]) -> None:
    content["friction_cone"] = "pyramid-circumscribed"


def _softer(content: dict[str, Any]) -> None:
    content["settings"]["contact_erp"] /= 10.0


def _margin(content: dict[str, Any]) -> None:
    content["settings"]["collision_margin"] = 1e-3  # which is PyBullet's own


def _gravity(content: dict[str, Any]) -> None:
    content["gravity"][2] += 1e-3


def _timestep(content: dict[str, Any]) -> None:
    content["timestep"] *= 1.001


def halved(text: str | None) -> str:
    return scaled(text, by=0.5)


DEFECTS: Mapping[str, Plant | str] = {
    **CONSTRAINTS,
    **SUMS,
    **PASSIVE,
    **dict.fromkeys(("ball limit", "ball limit dropped"), "PyBullet has no limits of balls"),
    **dict.fromkeys(FRAMES, "PyBullet receives no frames"),
    "free armature": "PyBullet has no armature of free bodies",
    **LANGUAGE,
    "inertia, sign of a product": xml(ARM, _flip),
    "position limit dropped": xml(ARM, _not_limited),
    "ball damping": attribute("joint[@name='bob_joint']/dynamics", "damping", scaled, BOB),
    "ball armature": "PyBullet has no armature of balls",
    "ball spring": sidecar_number("springs", "stiffness"),
    "mesh, margin": sidecar(_margin),
    **dict.fromkeys(MARGINS, "PyBullet's contact begins where shapes touch"),
    **GROUND_DEFECTS,
    **dict.fromkeys(BELTS, "PyBullet's surfaces move with their bodies alone"),
    "friction": attribute("link/contact/lateral_friction", "value", scaled, BALL),
    "restitution": attribute("link/contact/restitution", "value", scaled, BALL),
    "excluded pair dropped": sidecar(_drop_exclude),
    "excluded pair too many": sidecar(_exclude_too_many),
    "collision group": sidecar(_group),
    "excluded pair of a mechanism dropped": sidecar(_drop_linked),
    "excluded pair of a mechanism too many": sidecar(_linked_too_many),
    "group filter dropped": sidecar(_no_groups),
    "pair value": attribute("link/contact/lateral_friction", "value", halved, "rubber_cube.urdf"),
    "cone": sidecar(_cone),
    "hardness": sidecar(_softer),
    "copy filter": sidecar(_copy_filter),
    "passing pair": sidecar(_passing),
    "torsional friction": attribute("link/contact/spinning_friction", "value", halved, BALL),
    "rolling friction": attribute("link/contact/rolling_friction", "value", halved, BALL),
    "gravity": sidecar(_gravity),
    "timestep": sidecar(_timestep),
}
