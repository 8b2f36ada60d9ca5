"""Defects planted into MJCF."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from xml.etree.ElementTree import Element, SubElement

from simspec.formats.base import numbers
from simspec.formats.defects import Plant, flipped_product, floats, nudged, one, scaled, turned_axis, xml
from simspec.formats.mjcf import MODEL

BODY = ".//body[@name='{}']"
INERTIAL = ".//body[@name='lower']/inertial"
HINGE = ".//joint[@name='upper_joint']"
SLIDE = ".//joint[@name='lower_joint']"
KEY = "keyframe/key"


def _attribute(path: str, name: str, change: Callable[[str], str]) -> Plant:
    def edit(root: Element) -> None:
        element = one(root, path)
        element.set(name, change(element.attrib[name]))

    return xml(MODEL, edit)


def _flip(root: Element) -> None:
    element = one(root, INERTIAL)
    moments, turn = floats(element.attrib.pop("diaginertia")), floats(element.attrib.pop("quat"))
    element.set("fullinertia", numbers(flipped_product(tuple(moments), tuple(turn))))


def _drop_cube(root: Element) -> None:
    one(root, "worldbody").remove(one(root, BODY.format("cube")))
    contact = one(root, "contact")
    for element in list(contact):
        if "cube" in " ".join(element.attrib.values()):
            contact.remove(element)
    key = one(root, KEY)
    qpos, qvel = floats(key.attrib["qpos"]), floats(key.attrib["qvel"])
    key.set("qpos", numbers(qpos[:9] + qpos[16:]))
    key.set("qvel", numbers(qvel[:8] + qvel[14:]))


def _not_limited(root: Element) -> None:
    joint = one(root, HINGE)
    joint.set("limited", "false")


def _sphere_for_box(root: Element) -> None:
    geom = one(root, ".//geom[@name='cube_0']")
    geom.set("type", "sphere")


def _not_solid(root: Element) -> None:
    geom = one(root, ".//geom[@name='cube_0']")
    geom.set("contype", "0")
    geom.set("conaffinity", "0")
    contact = one(root, "contact")
    for pair in contact.findall("pair"):
        if "cube_0" in pair.attrib.values():
            contact.remove(pair)


def _drop_exclude(root: Element) -> None:
    contact = one(root, "contact")
    contact.remove(one(contact, "exclude[@body1='ball']"))


def _exclude_too_many(root: Element) -> None:
    contact = one(root, "contact")
    for pair in contact.findall("pair"):
        if set(pair.attrib.values()) >= {"floor_0", "ball_0"}:
            contact.remove(pair)
    SubElement(contact, "exclude", {"body1": "ball", "body2": "floor"})


def _group(root: Element) -> None:
    geom = one(root, ".//geom[@name='quiet_0']")
    same = one(root, ".//geom[@name='cube_0']")
    geom.set("contype", same.attrib["contype"])
    geom.set("conaffinity", same.attrib["conaffinity"])


DEFECTS: Mapping[str, Plant | str] = {
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
    "ball spring": _attribute(".//joint[@name='bob_joint']", "stiffness", scaled),
    "initial position": _attribute(KEY, "qpos", nudged),
    "initial velocity": _attribute(KEY, "qvel", nudged),
    "shape type": xml(MODEL, _sphere_for_box),
    "shape size": _attribute(".//geom[@name='ball_0']", "size", scaled),
    "shape position": _attribute(".//geom[@name='lower_0']", "pos", nudged),
    "shape orientation": _attribute(".//geom[@name='lower_0']", "quat", lambda text: nudged(text, 1)),
    "shape not solid": xml(MODEL, _not_solid),
    "friction": _attribute("contact/pair[@geom2='ball_0']", "friction", lambda text: scaled(scaled(text, 0), 1)),
    "restitution": _attribute("contact/pair[@geom2='ball_0']", "solref", lambda text: scaled(text, 1)),
    "excluded pair dropped": xml(MODEL, _drop_exclude),
    "excluded pair too many": xml(MODEL, _exclude_too_many),
    "collision group": xml(MODEL, _group),
    "pair value": "not planted yet",
    "cone": "not planted yet",
    "hardness": "not planted yet",
    "copy filter": "not planted yet",
    "passing pair": "not planted yet",
    "torsional friction": "not planted yet",
    "rolling friction": "not planted yet",
    "gravity": _attribute("option", "gravity", lambda text: nudged(text, 2)),
    "timestep": _attribute("option", "timestep", scaled),
}
