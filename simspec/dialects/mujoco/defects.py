"""Defects planted into MJCF."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from xml.etree.ElementTree import Element, SubElement

from simspec.dialects.kit.defects import (
    FILES,
    Plant,
    element_at,
    flipped_product,
    floats,
    nudged,
    reordered,
    scaled,
    turned_axis,
    xml,
)
from simspec.formats.kit.text import number, numbers
from simspec.formats.mjcf.format import MODEL

BODY = ".//body[@name='{}']"
INERTIAL = ".//body[@name='lower']/inertial"
BELT = ".//geom[@name='floor_0']"
HINGE = ".//joint[@name='upper_joint']"
SLIDE = ".//joint[@name='lower_joint']"
KEY = "keyframe/key"
TIP = ".//site[@name='tip']"


def _attribute(path: str, name: str, change: Callable[[str], str]) -> Plant:
    def edit(root: Element) -> None:
        element = element_at(root, path)
        element.set(name, change(element.attrib[name]))

    return xml(MODEL, edit)


def _flip(root: Element) -> None:
    element = element_at(root, INERTIAL)
    moments, turn = floats(element.attrib.pop("diaginertia")), floats(element.attrib.pop("quat"))
    element.set("fullinertia", numbers(flipped_product(tuple(moments), tuple(turn))))


def _drop_cube(root: Element) -> None:
    element_at(root, "worldbody").remove(element_at(root, BODY.format("cube")))
    contact = element_at(root, "contact")
    for element in list(contact):
        if "cube" in " ".join(element.attrib.values()):
            contact.remove(element)
    key = element_at(root, KEY)
    qpos, qvel = floats(key.attrib["qpos"]), floats(key.attrib["qvel"])
    key.set("qpos", numbers(qpos[:9] + qpos[16:]))
    key.set("qvel", numbers(qvel[:8] + qvel[14:]))


def _not_limited(root: Element) -> None:
    joint = element_at(root, HINGE)
    joint.set("limited", "false")


def _sphere_for_box(root: Element) -> None:
    geom = element_at(root, ".//geom[@name='cube_0']")
    geom.set("type", "sphere")


def _not_solid(root: Element) -> None:
    geom = element_at(root, ".//geom[@name='cube_0']")
    geom.set("contype", "0")
    geom.set("conaffinity", "0")
    contact = element_at(root, "contact")
    for pair in contact.findall("pair"):
        if "cube_0" in pair.attrib.values():
            contact.remove(pair)


def _drop_exclude(root: Element) -> None:
    contact = element_at(root, "contact")
    contact.remove(element_at(contact, "exclude[@body1='ball']"))


def _exclude_too_many(root: Element) -> None:
    contact = element_at(root, "contact")
    for pair in contact.findall("pair"):
        if set(pair.attrib.values()) >= {"floor_0", "ball_0"}:
            contact.remove(pair)
    SubElement(contact, "exclude", {"body1": "ball", "body2": "floor"})


def _moved_frame(root: Element) -> None:
    site = element_at(root, TIP)
    element_at(root, BODY.format("tail")).remove(site)
    element_at(root, BODY.format("kite")).append(site)


def _drop_linked(root: Element) -> None:
    contact = element_at(root, "contact")
    contact.remove(element_at(contact, "exclude[@body1='lower']"))


def _linked_too_many(root: Element) -> None:
    """An explicit pair passes by exclusions."""
    contact = element_at(root, "contact")
    for pair in contact.findall("pair"):
        if {pair.get("geom1"), pair.get("geom2")} == {"lower_0", "ball_0"}:
            contact.remove(pair)
    SubElement(contact, "exclude", {"body1": "ball", "body2": "lower"})


def _no_groups(root: Element) -> None:
    for geom in root.iter("geom"):
        if geom.get("class") != "visual":
            for name in ("contype", "conaffinity"):
                geom.attrib.pop(name, None)


def _group(root: Element) -> None:
    geom = element_at(root, ".//geom[@name='quiet_0']")
    same = element_at(root, ".//geom[@name='cube_0']")
    geom.set("contype", same.attrib["contype"])
    geom.set("conaffinity", same.attrib["conaffinity"])


def _pair_value(root: Element) -> None:
    """The friction of ice with rubber, in every explicit pair of the two."""
    for pair in _explicit(root, {"floor_ice", "rubber_cube_0"}, {"floor_rubber", "ice_cube_0"}):
        sliding, other, *rest = floats(pair.attrib["friction"])
        pair.set("friction", numbers((sliding / 2.0, other / 2.0, *rest)))


def _explicit(root: Element, *pairs: set[str]) -> list[Element]:
    found = [
        pair
        for pair in element_at(root, "contact").findall("pair")
        if {pair.attrib["geom1"], pair.attrib["geom2"]} in pairs
    ]
    if len(found) != len(pairs):
        raise LookupError(f"{len(found)} explicit pairs of {pairs}")
    return found


def _soft(root: Element) -> None:
    """All contact takes back a tenth of what it should: pairs and classes of materials."""
    for element in element_at(root, "default").iter():
        if "solref" in element.attrib:
            element.set("solref", scaled(element.attrib["solref"], 0, 0.1))


def _wrong_pair(root: Element) -> None:
    """An explicit pair that names another shape than it should."""
    (pair,) = _explicit(root, {"floor_ice", "rubber_cube_0"})
    pair.set("geom1" if pair.attrib["geom1"] == "rubber_cube_0" else "geom2", "ghost_cube_0")


def _ghost_touches(root: Element) -> None:
    """The ghost has the masks of rubber."""
    ghost, rubber = (
        element_at(root, ".//geom[@name='ghost_cube_0']"),
        element_at(root, ".//geom[@name='rubber_cube_0']"),
    )
    for name in ("contype", "conaffinity"):
        ghost.set(name, rubber.attrib[name])


def _height(text: str) -> str:
    """One of the elevations between the least and the greatest, changed."""
    values = floats(text)
    index = next(index for index, value in enumerate(values) if 0.1 < value < 0.9)
    return nudged(text, index)


def _mirrored(root: Element) -> None:
    field = element_at(root, "asset/hfield")
    columns, values = int(field.attrib["ncol"]), floats(field.get("elevation"))
    rows = [values[start : start + columns][::-1] for start in range(0, len(values), columns)]
    field.set("elevation", numbers(value for row in rows for value in row))


def _no_field(root: Element) -> None:
    assets = element_at(root, "asset")
    assets.remove(element_at(assets, "hfield"))


def _mesh_margin(root: Element) -> None:
    for geom in root.iter("geom"):
        if geom.get("type") == "mesh":
            geom.set("margin", "0.001")
    for pair in element_at(root, "contact").findall("pair"):
        pair.set("margin", "0.001")


def _without_surface_velocity(root: Element) -> None:
    for geom in root.iter("geom"):
        geom.attrib.pop("surfacevel", None)


def _separate_margin(root: Element) -> None:
    """The sum of the margins of two shapes, where their materials have a margin of their own."""
    for pair in _explicit(root, {"floor_0", "pebble_0"}, {"ball_0", "pebble_0"}):
        pair.set("margin", number(0.002 if "floor_0" in pair.attrib.values() else 0.004))


def _no_margin(root: Element) -> None:
    for item in root.iter():
        if item.tag in ("geom", "pair"):
            item.attrib.pop("margin", None)


def _whole_weight(root: Element) -> None:
    del element_at(root, BODY.format("tail")).attrib["gravcomp"]


def _equality(name: str, key: str, change: Callable[[str], str]) -> Plant:
    return _attribute(f"equality/*[@name='{name}']", key, change)


def _no_equality(name: str) -> Plant:
    """Without an equality, and without the sites that it is of."""

    def edit(root: Element) -> None:
        equality = element_at(root, "equality")
        equality.remove(element_at(equality, f"*[@name='{name}']"))
        for parent in root.iter():
            for site in [child for child in parent if child.tag == "site" and f"/{name}/" in child.attrib["name"]]:
                parent.remove(site)

    return xml(MODEL, edit)


def _vacuum(root: Element) -> None:
    option = element_at(root, "option")
    for name in ("density", "viscosity", "wind"):
        del option.attrib[name]


DEFECTS: Mapping[str, Plant | str] = {
    "coupling, ratio": _equality("mirror", "polycoef", lambda text: scaled(text, 1)),
    "coupling, offset": _equality("mirror", "polycoef", nudged),
    "coupling, sign": _equality("mirror", "polycoef", lambda text: scaled(text, 1, -1.0)),
    "coupling, leader": _equality("mirror", "joint2", lambda _: "crank_joint"),
    "held point": _attribute(".//site[@name='constraint/pin/1']", "pos", nudged),
    "weld, orientation": _attribute(".//site[@name='constraint/glue/1']", "quat", lambda text: nudged(text, 1)),
    "constraint dropped": _no_equality("glue"),
    "sum, coefficient": _attribute("tendon/fixed/joint", "coef", nudged),
    "sum, stiffness": _attribute("tendon/fixed", "stiffness", scaled),
    "sum, rest": _attribute("tendon/fixed", "springlength", nudged),
    "sum, damping": _attribute("tendon/fixed", "damping", scaled),
    "sum dropped": xml(MODEL, lambda root: root.remove(element_at(root, "tendon"))),
    "sum, dry friction": _attribute("tendon/fixed", "frictionloss", scaled),
    "sum, limit": _attribute("tendon/fixed", "range", lambda text: nudged(text, 1)),
    "sum, limits dropped": _attribute("tendon/fixed", "limited", lambda _: "false"),
    "mass": _attribute(INERTIAL, "mass", scaled),
    "centre of mass": _attribute(INERTIAL, "pos", nudged),
    "inertia, diagonal": _attribute(INERTIAL, "diaginertia", scaled),
    "inertia, sign of a product": xml(MODEL, _flip),
    "body dropped": xml(MODEL, _drop_cube),
    "joint type": _attribute(HINGE, "type", lambda _: "slide"),
    "axis": _attribute(HINGE, "axis", turned_axis),
    "axis reversed": _attribute(HINGE, "axis", lambda text: numbers(-x for x in floats(text))),
    "joint origin, position": _attribute(BODY.format("lower"), "pos", nudged),
    "joint origin, orientation": _attribute(BODY.format("lower"), "quat", lambda text: nudged(text, 1)),
    "position limit": _attribute(HINGE, "range", lambda text: nudged(text, 1)),
    "position limit dropped": xml(MODEL, _not_limited),
    "velocity limit": _attribute(HINGE, "user", lambda text: nudged(text, 0)),
    "effort limit": _attribute(HINGE, "user", lambda text: nudged(text, 1)),
    "damping": _attribute(HINGE, "damping", scaled),
    "spring stiffness": _attribute(SLIDE, "stiffness", scaled),
    "spring rest": _attribute(SLIDE, "springref", nudged),
    "dry friction": _attribute(HINGE, "frictionloss", scaled),
    "armature": _attribute(HINGE, "armature", scaled),
    "ball damping": _attribute(".//joint[@name='bob_joint']", "damping", scaled),
    "gravity scale": _attribute(BODY.format("kite"), "gravcomp", nudged),
    "gravity scale dropped": xml(MODEL, _whole_weight),
    "free damping": _attribute(".//joint[@name='kite_joint']", "damping", scaled),
    "free damping, of rotation": "MJCF has one number for translation and rotation",
    "fluid, density": _attribute("option", "density", scaled),
    "fluid, viscosity": _attribute("option", "viscosity", scaled),
    "fluid, velocity reversed": _attribute("option", "wind", lambda text: numbers(-x for x in floats(text))),
    "fluid, a box": "MuJoCo's boxes are those of the inertia in the file",
    "fluid, axes of a box": "MuJoCo's boxes are those of the inertia in the file",
    "fluid dropped": xml(MODEL, _vacuum),
    "free armature": _attribute(".//joint[@name='kite_joint']", "armature", scaled),
    "ball armature": _attribute(".//joint[@name='bob_joint']", "armature", scaled),
    "ball spring": _attribute(".//joint[@name='bob_joint']", "stiffness", scaled),
    "initial position": _attribute(KEY, "qpos", nudged),
    "initial velocity": _attribute(KEY, "qvel", nudged),
    "shape type": xml(MODEL, _sphere_for_box),
    "shape size": _attribute(".//geom[@name='ball_0']", "size", scaled),
    "shape position": _attribute(".//geom[@name='lower_0']", "pos", nudged),
    "shape orientation": _attribute(".//geom[@name='lower_0']", "quat", lambda text: nudged(text, 1)),
    "shape not solid": xml(MODEL, _not_solid),
    **FILES,
    "mesh, margin": xml(MODEL, _mesh_margin),
    "height field, a height": _attribute("asset/hfield", "elevation", _height),
    "height field, length": _attribute("asset/hfield", "size", scaled),
    "height field, base": _attribute("asset/hfield", "size", lambda text: scaled(text, 3)),
    "height field, mirrored": xml(MODEL, _mirrored),
    "height field missing": xml(MODEL, _no_field),
    "meshes in another order": reordered(MODEL, ' mesh="([^"]*)"'),
    "margin": _attribute(".//geom[@name='ball_0']", "margin", scaled),
    "margin of a pair": _attribute("contact/pair[@geom1='ball_0']", "margin", scaled),
    "margin dropped": xml(MODEL, _no_margin),
    "margin of two materials": xml(MODEL, _separate_margin),
    "surface velocity": _attribute(BELT, "surfacevel", scaled),
    "surface velocity, sign": _attribute(BELT, "surfacevel", lambda text: scaled(scaled(text, 0, -1.0), 1, -1.0)),
    "surface velocity dropped": xml(MODEL, _without_surface_velocity),
    "surface velocity, angular": _attribute(".//geom[@name='turntable']", "surfacevel", lambda text: scaled(text, 5)),
    "friction": _attribute("contact/pair[@geom1='ball_0']", "friction", lambda text: scaled(scaled(text, 0), 1)),
    "restitution": _attribute("contact/pair[@geom1='ball_0']", "solref", lambda text: scaled(text, 1)),
    "excluded pair dropped": xml(MODEL, _drop_exclude),
    "excluded pair too many": xml(MODEL, _exclude_too_many),
    "collision group": xml(MODEL, _group),
    "excluded pair of a mechanism dropped": xml(MODEL, _drop_linked),
    "excluded pair of a mechanism too many": xml(MODEL, _linked_too_many),
    "group filter dropped": xml(MODEL, _no_groups),
    "pair value": xml(MODEL, _pair_value),
    "cone": _attribute("option", "cone", lambda _: "pyramidal"),
    "hardness": xml(MODEL, _soft),
    "copy filter": xml(MODEL, _wrong_pair),
    "passing pair": xml(MODEL, _ghost_touches),
    "torsional friction": _attribute("contact/pair", "friction", lambda text: scaled(text, 2, 0.5)),
    "rolling friction": _attribute("contact/pair", "friction", lambda text: scaled(scaled(text, 3, 0.5), 4, 0.5)),
    "ball limit": _attribute(".//joint[@name='bob_joint']", "range", lambda text: nudged(text, 1)),
    "ball limit dropped": _attribute(".//joint[@name='bob_joint']", "limited", lambda _: "false"),
    "frame, position": _attribute(TIP, "pos", nudged),
    "frame, orientation": _attribute(TIP, "quat", lambda text: nudged(text, 1)),
    "frame on another body": xml(MODEL, _moved_frame),
    "frame dropped": xml(MODEL, lambda root: element_at(root, BODY.format("tail")).remove(element_at(root, TIP))),
    "gravity": _attribute("option", "gravity", lambda text: nudged(text, 2)),
    "timestep": _attribute("option", "timestep", scaled),
}
