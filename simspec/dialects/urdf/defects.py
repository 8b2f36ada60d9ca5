"""Defects planted into plain URDF files and their sidecar."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from simspec.dialects.kit.defects import (
    BELTS,
    CONSTRAINTS,
    FILES,
    FRAMES,
    GROUND,
    MARGINS,
    PASSIVE,
    SUMS,
    Plant,
    element_at,
    floats,
    nudged,
    reordered,
    scaled,
    sidecar,
    text_of,
    turned_axis,
    xml,
)
from simspec.dialects.kit.file_mutations import INERT as OF_MESHES
from simspec.dialects.kit.mutations import FileAddition, Inert, MutationTable
from simspec.formats.kit.text import numbers

ARM, BALL, CUBE = "base.urdf", "ball.urdf", "cube.urdf"
INERTIAL = "link[@name='lower']/inertial"
HINGE = "joint[@name='upper_joint']"
NO_BALL = "plain URDF has no ball joint"
NO_COPIES = "plain URDF has no copies of shapes"

RUBBER_ON_ICE = (("floor_ice", "rubber_cube_0"), ("floor_rubber", "ice_cube_0"), ("ice_cube_0", "rubber_cube_0"))
"""Shapes of rubber and ice in the world "surfaces"."""

Content = dict[str, Any]


def attribute(path: str, name: str, change: Callable[[str], str], file: str = ARM) -> Plant:
    """Change an attribute of every element at ``path``."""

    def edit(root: Element) -> None:
        for element in root.findall(path):
            element.set(name, change(element.attrib[name]))

    return xml(file, edit)


def drop_lower(root: Element) -> None:
    """Drop the last body of the arm."""
    root.remove(element_at(root, "link[@name='lower']"))
    root.remove(element_at(root, "joint[@name='lower_joint']"))


def sphere_for_box(root: Element) -> None:
    """A sphere instead of the cube's box."""
    for kind in ("visual", "collision"):
        geometry = element_at(root, f"link/{kind}/geometry")
        geometry.remove(element_at(geometry, "box"))
        SubElement(geometry, "sphere", {"radius": "0.05"})


def not_solid(root: Element) -> None:
    """Drop a collision shape."""
    link = element_at(root, "link")
    link.remove(element_at(link, "collision"))


def sidecar_number(block: str, key: str, by: float = 1e-3) -> Plant:
    """Move a number of the first entry of a list in the sidecar."""

    def edit(content: Content) -> None:
        content[block][0][key] += by

    return sidecar(edit)


def instance_number(key: str) -> Plant:
    """Move the first of an instance's numbers."""

    def edit(content: Content) -> None:
        arm = next(instance for instance in content["instances"] if instance["file"] == ARM)
        arm[key][0] += 1e-3

    return sidecar(edit)


def _surface(key: str, factor: float) -> Plant:
    """A number of every material, of every pair of shapes and of every law."""

    def edit(content: Content) -> None:
        for entry in (*content["materials"], *content["pairs"], *content["laws"]):
            entry[key] *= factor

    return sidecar(edit)


def _rubber_ice(content: Content) -> None:
    for entry in content["laws"]:
        if (entry["first"], entry["second"]) == ("ice", "rubber"):
            entry["friction"] /= 2.0
    for entry in content["materials"]:
        if entry["material"] == "rubber":
            entry["friction"] /= 2.0
    for entry in content["pairs"]:
        if (entry["first"], entry["second"]) in RUBBER_ON_ICE:
            entry["friction"] /= 2.0


def _drop_pair(*pair: str) -> Plant:
    return sidecar(lambda content: content["excluded"].remove(list(pair)))


def _add_pair(*pair: str) -> Plant:
    return sidecar(lambda content: content["excluded"].append(list(pair)))


def _group(content: Content) -> None:
    """The quiet body goes into the group of the cube."""
    names = [body["name"] for body in content["bodies"]]
    content["groups"][names.index("quiet")] = content["groups"][names.index("cube")]


def _no_groups(content: Content) -> None:
    content["ignored_groups"] = []


def _passing(content: Content) -> None:
    for law in content["laws"]:
        law["collide"] = True


def _cone(content: Content) -> None:
    cones = ("elliptic", "pyramid-circumscribed")
    content["friction_cone"] = cones[cones.index("elliptic") + (content["friction_cone"] == "elliptic")]


def _hardness(content: Content) -> None:
    for entry in (*content["materials"], *content["pairs"], *content["laws"]):
        entry["hardness"]["kind"] = "common" if entry["hardness"]["kind"] != "common" else "native"


def _gravity(content: Content) -> None:
    content["gravity"][2] += 1e-3


def _timestep(content: Content) -> None:
    content["timestep"] *= 1.001


LANGUAGE: Mapping[str, Plant] = {
    "mass": attribute(f"{INERTIAL}/mass", "value", scaled),
    "centre of mass": attribute(f"{INERTIAL}/origin", "xyz", nudged),
    "inertia, diagonal": attribute(f"{INERTIAL}/inertia", "ixx", scaled),
    "body dropped": xml(ARM, drop_lower),
    "joint type": attribute(HINGE, "type", lambda _: "prismatic"),
    "axis": attribute(f"{HINGE}/axis", "xyz", turned_axis),
    "axis reversed": attribute(f"{HINGE}/axis", "xyz", lambda text: numbers(-x for x in floats(text))),
    "joint origin, position": attribute("joint[@name='lower_joint']/origin", "xyz", nudged),
    "joint origin, orientation": attribute("joint[@name='lower_joint']/origin", "rpy", nudged),
    "position limit": attribute(f"{HINGE}/limit", "upper", nudged),
    "velocity limit": attribute(f"{HINGE}/limit", "velocity", nudged),
    "effort limit": attribute(f"{HINGE}/limit", "effort", nudged),
    "damping": attribute(f"{HINGE}/dynamics", "damping", scaled),
    "spring stiffness": sidecar_number("springs", "stiffness"),
    "spring rest": sidecar_number("springs", "rest"),
    "dry friction": attribute(f"{HINGE}/dynamics", "friction", scaled),
    "armature": sidecar_number("armature", "armature"),
    "free armature": attribute("link[@name='kite']/inertial/mass", "value", scaled, "kite.urdf"),
    "initial position": instance_number("position"),
    "initial velocity": instance_number("velocity"),
    "shape type": xml(CUBE, sphere_for_box),
    "shape size": attribute("link/collision/geometry/sphere", "radius", scaled, BALL),
    "shape position": attribute("link[@name='lower']/collision/origin", "xyz", nudged),
    "shape orientation": attribute("link[@name='lower']/collision/origin", "rpy", nudged),
    "shape not solid": xml(CUBE, not_solid),
    **FILES,
    "meshes in another order": reordered("toy.urdf", '<mesh filename="([^"]*)"'),
}
"""Defects of every dialect whose files are URDF."""

DEFECTS: Mapping[str, Plant | str] = {
    **LANGUAGE,
    **CONSTRAINTS,
    **SUMS,
    **PASSIVE,
    **dict.fromkeys(("ball limit", "ball limit dropped"), "plain URDF has no limits of balls"),
    **dict.fromkeys(FRAMES, "an engine that reads URDF receives no frames"),
    "inertia, sign of a product": attribute(f"{INERTIAL}/inertia", "ixy", lambda text: text_of(-float(text))),
    "position limit dropped": attribute(HINGE, "type", lambda _: "continuous"),
    **dict.fromkeys(MARGINS, "plain URDF has no margins"),
    **dict.fromkeys(GROUND, "plain URDF has no height fields"),
    **dict.fromkeys(BELTS, "URDF has no surfaces that move by themselves"),
    "mesh, margin": "plain URDF has no margins",
    "ball damping": NO_BALL,
    "ball armature": NO_BALL,
    "ball spring": NO_BALL,
    "friction": _surface("friction", 1.001),
    "restitution": _surface("restitution", 1.001),
    "pair value": sidecar(_rubber_ice),
    "cone": sidecar(_cone),
    "hardness": sidecar(_hardness),
    "copy filter": NO_COPIES,
    "passing pair": sidecar(_passing),
    "torsional friction": _surface("torsional_friction", 0.5),
    "rolling friction": _surface("rolling_friction", 0.5),
    "excluded pair dropped": _drop_pair("ball", "cube"),
    "excluded pair too many": _add_pair("ball", "floor"),
    "collision group": sidecar(_group),
    "excluded pair of a mechanism dropped": _drop_pair("lower", "upper"),
    "excluded pair of a mechanism too many": _add_pair("ball", "lower"),
    "group filter dropped": sidecar(_no_groups),
    "gravity": sidecar(_gravity),
    "timestep": sidecar(_timestep),
}

# Additions to plain URDF, and changes declared inert, for the complete self-test.
#
# Engines that use this dialect may read less than the whole language; the rows hold for those that follow it. See
# ``dialects/kit/mutations.py``.

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
HEAVY = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
BALL_MUTATIONS = '<geometry><sphere radius="0.3"/></geometry>'
NAMED = "a name; links are known by theirs, the model's and materials' say nothing"
SEEN = "visual only"

TABLE = MutationTable(
    words={"joint@type": JOINT_TYPES},
    additions={
        "*.urdf": (
            FileAddition("link", f"<collision>{BALL_MUTATIONS}</collision>"),
            FileAddition("link", f"<visual>{BALL_MUTATIONS}</visual>"),
            FileAddition("link", HEAVY),
            FileAddition("joint", '<limit lower="-0.1" upper="0.1" effort="1" velocity="0.1"/>'),
            FileAddition("joint", '<dynamics damping="3" friction="2"/>'),
            FileAddition("joint", '<mimic joint="{joint[0]}" multiplier="2" offset="0.1"/>'),
            FileAddition("robot", f'<link name="one-more">{HEAVY}</link>'),
        ),
        "sidecar.json": (
            FileAddition("", "9.81", "strength"),
            FileAddition("springs", '{"body": "absent", "stiffness": 1.0, "rest": 0.0}'),
            FileAddition("excluded", '["absent", "nothing"]'),
        ),
    },
    inert=(
        *OF_MESHES,
        *(Inert(site, NAMED, (), "*.urdf") for site in ("robot@name", "material@name")),
        *(Inert(site, SEEN, (), "*.urdf") for site in ("color*", "visual*", "link/visual", "material")),
    ),
)
