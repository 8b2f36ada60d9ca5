"""Defects planted into URDF files and their sidecar, and mutations of them for the complete self-test."""

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
from simspec.dialects.kit.file_mutations import INERT as OF_MESHES
from simspec.dialects.kit.mutations import PASSIVE_BY_NAME, FileAddition, Inert, MutationTable
from simspec.dialects.urdf.defects import ARM, BALL, HINGE, INERTIAL, LANGUAGE, attribute, sidecar_number
from simspec.formats.kit.text import FIELDS, number
from simspec.language.vocabulary import JOINT_KINDS
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
    **LANGUAGE,
    "inertia, sign of a product": xml(ARM, _flip),
    "position limit dropped": xml(ARM, _not_limited),
    "ball damping": attribute("joint[@name='bob_joint']/dynamics", "damping", scaled, BOB),
    "ball armature": attribute("link[@name='bob']/inertial/inertia", "ixx", scaled, BOB),
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

# Additions to URDF files, and changes declared inert (``dialects/kit/mutations.py``). The elements and attributes are those
# that PyBullet's reader supports (its UrdfParser), and some of plain URDF and SDF that it does not.

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical")
MASSLESS = '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
HEAVY = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
SPHERE = '<geometry><sphere radius="0.3"/></geometry>'

URDF_ADDITIONS = (
    # a link's
    FileAddition("contact", '<friction_anchor value="1"/>'),
    FileAddition("contact", '<inertia_scaling value="2"/>'),
    FileAddition("contact", '<stiffness value="1000"/>'),
    FileAddition("contact", '<damping value="10"/>'),
    FileAddition("contact", '<contact_cfm value="0.1"/>'),
    FileAddition("contact", '<contact_erp value="0.5"/>'),
    FileAddition("link", f"<collision>{SPHERE}</collision>"),
    FileAddition("link", f'<collision group="2" mask="0">{SPHERE}</collision>'),
    FileAddition("link", f"<visual>{SPHERE}</visual>"),
    FileAddition("link", "<self_collide>0</self_collide>"),
    FileAddition("link", '<audio_source filename="none.wav"><gain>1.0</gain></audio_source>'),
    FileAddition("link", "immobile", "type"),
    FileAddition("link", "true", "kinematic"),
    FileAddition("collision", "2", "group"),
    FileAddition("collision", "0", "mask"),
    FileAddition("collision", "yes", "concave"),
    FileAddition("collision", "0.05", "margin"),
    FileAddition("collision", '<contact_coefficients mu="0.1" kp="10" kd="1"/>'),
    FileAddition("geometry", '<box size="0.3 0.3 0.3"/>'),
    FileAddition("inertial", '<mass value="9"/>'),
    FileAddition("sphere", "2 2 2", "scale"),
    FileAddition("box", "2 2 2", "scale"),
    FileAddition("origin", "0.5 0.5 0.5 0.5", "quat"),
    FileAddition("material", '<texture filename="none.png"/>'),
    # a joint's
    FileAddition("joint", '<limit lower="-0.1" upper="0.1" effort="1" velocity="0.1"/>'),
    FileAddition("joint", '<limit lower="-0.1" upper="0.1" twist="0.1" effort="1" velocity="0.1"/>'),
    FileAddition("joint", '<dynamics damping="3" friction="2"/>'),
    FileAddition("joint", '<mimic joint="{joint[0]}" multiplier="2" offset="0.1"/>'),
    FileAddition(
        "joint", '<safety_controller k_velocity="10" k_position="15" soft_lower_limit="-1" soft_upper_limit="1"/>'
    ),
    FileAddition("joint", '<calibration rising="0.1"/>'),
    FileAddition("joint", '<drive type="force" stiffness="10" damping="1"/>'),
    FileAddition("limit", "-0.1", "lower"),
    FileAddition("limit", "0.1", "upper"),
    FileAddition("limit", "1.5", "effort"),
    FileAddition("limit", "0.5", "velocity"),
    FileAddition("limit", "0.1", "twist"),
    FileAddition("limit", "100", "stiffness"),
    FileAddition("dynamics", "50", "spring_stiffness"),
    FileAddition("dynamics", "0.5", "spring_reference"),
    # the whole file's
    FileAddition("robot", f'<link name="one-more">{HEAVY}</link>'),
    FileAddition(
        "robot",
        f'<link name="one-more">{HEAVY}</link><joint name="one-more" type="fixed"><parent link="{{link[0]}}"/>'
        '<child link="one-more"/></joint>',
    ),
    FileAddition(
        "robot",
        f'<link name="one-more">{MASSLESS}<collision>{SPHERE}</collision></link><joint name="one-more" type="fixed">'
        '<parent link="{link[0]}"/><child link="one-more"/></joint>',
    ),
    FileAddition(
        "robot", '<joint name="loop" type="fixed"><parent link="{link[0]}"/><child link="{link[1]}"/></joint>'
    ),
    FileAddition("robot", '<material name="paint"><color rgba="1 0 0 1"/></material>'),
    FileAddition("robot", "<gazebo><static>true</static></gazebo>"),
    FileAddition("robot", '<transmission name="drive"><joint name="{joint[0]}"/></transmission>'),
    FileAddition("robot", '<deformable name="cloth"><collision_margin value="0.01"/></deformable>'),
    FileAddition("robot", '<self_collision value="false"/>'),
)

SIDECAR_ADDITIONS = (
    FileAddition("", "[]", "sleepers"),
    FileAddition("", "9.81", "strength"),
    FileAddition("settings", "true", "sleeping"),
    FileAddition("settings", "0.5", "global_cfm"),
    FileAddition("instances.*", "true", "fixed"),
    FileAddition("instances.*", "2.0", "scale"),
    FileAddition("springs", '{"body": "absent", "stiffness": 1.0, "rest": 0.0}'),
    FileAddition("armature", '{"body": "absent", "armature": 1.0}'),
    FileAddition("collision_filter.classes", '{"group": 64, "mask": 64, "links": []}'),
    FileAddition("collision_filter.excluded", '["absent", "nothing"]'),
)

FIRST_ONLY = "PyBullet reads only the first of repeated elements"
ABSENT = "the value in the file is PyBullet's default"
NAMED = "a name; only links are found by name, shapes, joints and models by their order"
SEEN = "visual only: a colour, a material, or a visual of a collision shape, which PyBullet shows in any case"
UNKNOWN = "PyBullet's reader ignores it"
ELSEWHERE = "overwritten from the sidecar while loading"
ORDER = "the order of elements that are found by name"
DROPPED = "for a link that cannot move: PyBullet drops the mass and inertia of a fixed base"

QUANTISED = 2e-2
"""How far motion may depart where a vertex moves by less than PyBullet's whole numbers distinguish, which the read-back does
not see. Measured: of 18 vertices moved by up to 1e-4 of their hull's extent, in any direction, motions of 600 steps with
impacts depart by 8.3e-3 (m/s or rad/s) at most, 12 of them by less than 1e-4."""

FIRST = (
    *(
        "axis",
        "box",
        "capsule",
        "child",
        "color",
        "contact",
        "cylinder",
        "damping",
        "dynamics",
        "geometry",
        "inertia",
        "inertial",
    ),
    *(
        "lateral_friction",
        "limit",
        "mass",
        "material",
        "mesh",
        "origin",
        "parent",
        "plane",
        "restitution",
        "rolling_friction",
        "sphere",
    ),
    *("spinning_friction", "stiffness"),
)
"""Elements of which the first counts."""

UNKNOWN_IN = (
    *(
        "contact/contact_cfm",
        "contact/contact_erp",
        "link/self_collide",
        "link@type",
        "link@kinematic",
        "collision@margin",
    ),
    *(
        "collision/contact_coefficients",
        "sphere@scale",
        "box@scale",
        "origin@quat",
        "joint/mimic",
        "joint/safety_controller",
    ),
    *("joint/calibration", "joint/drive", "limit@stiffness", "dynamics@spring_stiffness", "dynamics@spring_reference"),
    *("robot/gazebo", "robot/transmission", "robot/self_collision"),
)
"""Elements of URDF and SDF that PyBullet's reader ignores."""

TABLE = MutationTable(
    words={
        "joint@type": JOINT_TYPES,
        "friction_cone": ("elliptic", "pyramid-circumscribed", "pyramid-inscribed", "something-else"),
        "instances.*.root": ("free", "fixed", "world link", "something-else"),
        "bodies.*.kind": (*JOINT_KINDS, "something-else"),
    },
    additions={"*.urdf": URDF_ADDITIONS, "sidecar.json": SIDECAR_ADDITIONS},
    inert=(
        *OF_MESHES,
        Inert(
            "obj/v",
            "a vertex moved by less than PyBullet holds of it, 2e-4 of the extent: motion departs by less than 2e-2",
            ("scaled",),
            "*.obj",
            within=QUANTISED,
        ),
        Inert(
            "obj/v",
            "a vertex that no triangle of a height field has",
            ("element added", "element doubled"),
            "fields/*.obj",
        ),
        *(Inert(tag, FIRST_ONLY, ("element doubled",), "*.urdf") for tag in FIRST),
        *(
            Inert(site, FIRST_ONLY, ("element added",), "*.urdf")
            for site in (
                *("geometry/box", "inertial/mass", "joint/limit", "joint/dynamics", "contact/stiffness"),
                "contact/damping",
            )
        ),
        *(
            Inert(site, ABSENT, ("attribute removed", "element removed", "number dropped"), "*.urdf")
            for site in (
                *(
                    "origin",
                    "origin@*",
                    "inertia@ix*",
                    "inertia@iy*",
                    "dynamics@*",
                    "limit@*",
                    "axis",
                    "contact",
                    "dynamics",
                ),
                *("restitution", "rolling_friction", "spinning_friction"),
            )
        ),
        Inert("joint@type", "PyBullet treats a floating joint below another link as fixed", ("word",), "*.urdf"),
        Inert("axis*", "the axis of a fixed or ball joint, which uses none", (), "*.urdf"),
        *(
            Inert(site, NAMED, (), "*.urdf")
            for site in ("robot@name", "joint@name", "visual@name", "collision@name", "material@name")
        ),
        Inert("plane@normal", "for a visual-only plane; for others PyBullet normalises it", (), "*.urdf"),
        Inert("color*", SEEN, (), "*.urdf"),
        Inert("material", SEEN, ("element removed",), "*.urdf"),
        Inert("material/texture", SEEN, ("element added",), "*.urdf"),
        Inert("robot/material", SEEN, ("element added",), "*.urdf"),
        Inert("visual", SEEN, ("element removed", "element doubled"), "*.urdf"),
        Inert("link/visual", SEEN, ("element added",), "*.urdf"),
        Inert("link/audio_source", "audio only", ("element added",), "*.urdf"),
        Inert("sphere@radius", SEEN, ("moved",), "*.urdf"),
        Inert("mass@value", DROPPED, ("moved",), "*.urdf"),
        Inert("inertia@i*", DROPPED, ("moved",), "*.urdf"),
        Inert("inertial", DROPPED, ("element removed",), "*.urdf"),
        Inert("contact/inertia_scaling", DROPPED, ("element added",), "*.urdf"),
        Inert(
            "origin@rpy", "a rotation within a shape's symmetry, or of the inertial frame of a fixed base", (), "*.urdf"
        ),
        Inert("contact/friction_anchor", "for a link without shapes", ("element added",), "*.urdf"),
        Inert("limit@twist", "for ball joints only", ("attribute added",), "*.urdf"),
        *(
            Inert(f"limit@{end}", "a lower limit above the upper one is none", ("scaled",), "*.urdf")
            for end in ("lower", "upper")
        ),
        Inert("collision@concave", "for meshes only", ("attribute added",), "*.urdf"),
        Inert("collision@group", ELSEWHERE, ("attribute added",), "*.urdf"),
        Inert("collision@mask", ELSEWHERE, ("attribute added",), "*.urdf"),
        *(Inert(site, UNKNOWN, ("element added", "attribute added"), "*.urdf") for site in UNKNOWN_IN),
        *(
            Inert(site, ORDER, ("swapped",), "sidecar.json")
            for site in (
                *("collision_filter.classes.*", "collision_filter.classes.*.links.*", "collision_filter.excluded.*"),
                *("collision_filter.excluded.*.*", "sleepers.*", "springs.*", "armature.*"),
            )
        ),
        *PASSIVE_BY_NAME,
        Inert("constraints.*", "the solver's order, which round-off shows", ("swapped",), "sidecar.json", within=1e-9),
        Inert(
            "collision_filter.classes.*.mask",
            "a single link does not collide with itself",
            ("scaled",),
            "sidecar.json",
        ),
        Inert("collision_filter.classes.*.mask", "links collide where both masks allow it", ("moved",), "sidecar.json"),
        Inert(
            "collision_filter.excluded.*", "a pair that the masks exclude, too", ("element removed",), "sidecar.json"
        ),
        Inert("collision_filter.excluded.*.*", "a pair that the masks exclude, too", ("word",), "sidecar.json"),
        Inert(
            "instances.*.base.quaternion.*",
            "the negated quaternion is the same rotation",
            ("sign",),
            "sidecar.json",
        ),
    ),
)
