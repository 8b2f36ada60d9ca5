"""Defects planted into .skel files and their sidecar."""

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
    turned_axis,
    xml,
)
from simspec.dialects.kit.file_mutations import INERT as OF_MESHES
from simspec.dialects.kit.mutations import PASSIVE_BY_NAME, FileAddition, Inert, MutationTable
from simspec.formats.kit.text import numbers
from simspec.formats.skel.format import WORLD
from simspec.language.vocabulary import JOINT_KINDS

LOWER = ".//body[@name='lower']"
HINGE = ".//joint[@name='upper_joint']"


def _text(path: str, change: Callable[[str | None], str]) -> Plant:
    def edit(root: Element) -> None:
        element = element_at(root, path)
        element.text = change(element.text)

    return xml(WORLD, edit)


def _drop_cube(root: Element) -> None:
    world = element_at(root, "world")
    world.remove(element_at(world, "skeleton[@name='cube']"))


def _slide_for_hinge(root: Element) -> None:
    joint = element_at(root, HINGE)
    joint.set("type", "prismatic")


def _not_limited(root: Element) -> None:
    axis = element_at(root, f"{HINGE}/axis")
    axis.remove(element_at(axis, "limit"))


def _sphere_for_box(root: Element) -> None:
    for kind in ("visualization_shape", "collision_shape"):
        geometry = element_at(root, f".//body[@name='cube']/{kind}/geometry")
        geometry.remove(element_at(geometry, "box"))
        SubElement(SubElement(geometry, "sphere"), "radius").text = "0.05"


def _listed(block: str, key: str, body: str, by: float = 1e-3) -> Plant:
    """Move a number of one body's entry in a list of the sidecar."""

    def edit(content: dict[str, Any]) -> None:
        entry = next(entry for entry in content[block] if entry["body"] == body)
        entry[key] += by

    return sidecar(edit)


def _surface(quantity: str) -> Plant:
    def edit(content: dict[str, Any]) -> None:
        next(entry for entry in content["shapes"] if entry["body"] == "ball")["surfaces"][0][quantity] -= 1e-3

    return sidecar(edit)


def _pair_value(content: dict[str, Any]) -> None:
    """Ice has its highest number where it meets rubber."""
    copies = next(entry for entry in content["shapes"] if entry["body"] == "ice_cube")["surfaces"]
    max(copies, key=lambda copy: copy["friction"])["friction"] *= 0.5


def _cone(content: dict[str, Any]) -> None:
    content["friction_cone"] = "pyramid-circumscribed"


def _copy_filter(content: dict[str, Any]) -> None:
    """Ice and rubber meet in each other's wrong layer."""
    layer = next(layer for entry, other, layer in content["filter"]["layers"] if (entry, other) == ("ice", "rubber"))
    wrong = 1 - layer
    content["filter"]["apart"].remove([f"ice.{wrong}", f"rubber.{wrong}"])
    content["filter"]["apart"].append([f"ice.{layer}", f"rubber.{layer}"])


def _passing_pair(content: dict[str, Any]) -> None:
    separate = content["filter"]["apart"]
    separate[:] = [pair for pair in separate if {name.rpartition(".")[0] for name in pair} != {"ghost", "ice"}]


def _not_solid(content: dict[str, Any]) -> None:
    next(entry for entry in content["shapes"] if entry["body"] == "cube")["surfaces"].clear()


def _drop_exclude(content: dict[str, Any]) -> None:
    content["excluded"].remove(["ball", "cube"])


def _exclude_too_many(content: dict[str, Any]) -> None:
    content["excluded"].append(["ball", "floor"])


def _drop_linked(content: dict[str, Any]) -> None:
    content["excluded"].remove(["lower", "upper"])


def _linked_too_many(content: dict[str, Any]) -> None:
    content["excluded"].append(["ball", "lower"])


def _no_groups(content: dict[str, Any]) -> None:
    content["ignored_groups"], content["groups"] = [], {}


def _group(content: dict[str, Any]) -> None:
    content["ignored_groups"].clear()


DEFECTS: Mapping[str, Plant | str] = {
    **CONSTRAINTS,
    **SUMS,
    **PASSIVE,
    **dict.fromkeys(("ball limit", "ball limit dropped"), "DART has no limits of balls"),
    **dict.fromkeys(FRAMES, "DART receives no frames"),
    "free armature": _text(".//body[@name='kite']/inertia/mass", scaled),
    "mass": _text(f"{LOWER}/inertia/mass", scaled),
    "centre of mass": _text(f"{LOWER}/inertia/offset", nudged),
    "inertia, diagonal": _text(f"{LOWER}/inertia/moment_of_inertia/ixx", scaled),
    "inertia, sign of a product": _text(f"{LOWER}/inertia/moment_of_inertia/ixy", lambda text: scaled(text, by=-1.0)),
    "body dropped": xml(WORLD, _drop_cube),
    "joint type": xml(WORLD, _slide_for_hinge),
    "axis": _text(f"{HINGE}/axis/xyz", turned_axis),
    "axis reversed": _text(f"{HINGE}/axis/xyz", lambda text: numbers(-x for x in floats(text))),
    "joint origin, position": _text(f"{LOWER}/transformation", nudged),
    "joint origin, orientation": _text(f"{LOWER}/transformation", lambda text: nudged(text, 4)),
    "position limit": _text(f"{HINGE}/axis/limit/upper", nudged),
    "position limit dropped": xml(WORLD, _not_limited),
    "velocity limit": "DART would enforce it together with the position limits, so the rating stays outside the engine",
    "effort limit": _listed("effort_limits", "value", "upper"),
    "damping": _listed("damping", "value", "upper"),
    "spring stiffness": _listed("springs", "stiffness", "lower"),
    "spring rest": _listed("springs", "rest", "lower"),
    "dry friction": _text(f"{HINGE}/axis/dynamics/friction", scaled),
    "armature": _listed("armature", "value", "upper"),
    "ball damping": _listed("damping", "value", "bob"),
    "ball armature": _text(".//body[@name='bob']/inertia/moment_of_inertia/ixx", scaled),
    "ball spring": _listed("springs", "stiffness", "bob"),
    "initial position": _text(f"{HINGE}/init_pos", nudged),
    "initial velocity": _text(f"{HINGE}/init_vel", nudged),
    "shape type": xml(WORLD, _sphere_for_box),
    "shape size": _text(".//body[@name='ball']/collision_shape/geometry/sphere/radius", scaled),
    "shape position": _text(f"{LOWER}/collision_shape/transformation", nudged),
    "shape orientation": _text(f"{LOWER}/collision_shape/transformation", lambda text: nudged(text, 4)),
    "shape not solid": sidecar(_not_solid),
    **FILES,
    "mesh, margin": "DART has no margin of its own around shapes, and no file has a number for one",
    **dict.fromkeys(MARGINS, "DART's contact begins where shapes touch"),
    **dict.fromkeys(GROUND, "simspec gives DART no height fields"),
    **dict.fromkeys(BELTS, ".skel has no surfaces that move by themselves"),
    "meshes in another order": reordered(WORLD, "<file_name>([^<]*)</file_name>"),
    "friction": _surface("friction"),
    "restitution": _surface("restitution"),
    "excluded pair dropped": sidecar(_drop_exclude),
    "excluded pair too many": sidecar(_exclude_too_many),
    "collision group": sidecar(_group),
    "excluded pair of a mechanism dropped": sidecar(_drop_linked),
    "excluded pair of a mechanism too many": sidecar(_linked_too_many),
    "group filter dropped": sidecar(_no_groups),
    "pair value": sidecar(_pair_value),
    "cone": sidecar(_cone),
    "hardness": "DART's contacts are rigid by a rule of its own: no file has a number for it",
    "copy filter": sidecar(_copy_filter),
    "passing pair": sidecar(_passing_pair),
    "torsional friction": "DART has no torsional friction, and a world that requests it is refused",
    "rolling friction": "DART has no rolling friction, and a world that requests it is refused",
    "gravity": _text(".//physics/gravity", lambda text: nudged(text, 2)),
    "timestep": _text(".//physics/time_step", scaled),
}

# Additions to .skel files, and changes declared inert, for the complete self-test.
#
# The elements and attributes are those that DART's reader supports (its SkelParser), and some that it might be expected to. See
# ``dialects/kit/mutations.py``.

JOINT_TYPES = (
    *(
        "weld",
        "prismatic",
        "revolute",
        "universal",
        "ball",
        "euler",
        "translational",
        "translational2d",
        "planar",
        "screw",
    ),
    "free",
)
BALL = "<geometry><sphere><radius>0.3</radius></sphere></geometry>"
HERE = "<transformation>0 0 0 0 0 0</transformation>"
BODY = (
    f'<body name="one-more">{HERE}<inertia><mass>1</mass><moment_of_inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz><ixy>0</ixy>'
    "<ixz>0</ixz><iyz>0</iyz></moment_of_inertia></inertia></body>"
)
DOF = '<dof local_index="0">'

SKEL_ADDITIONS = (
    # the world's
    FileAddition("physics", "<sub_steps>4</sub_steps>"),
    FileAddition("physics", "<solver>pgs</solver>"),
    FileAddition("physics", "<split_impulse>true</split_impulse>"),
    FileAddition("physics", "<max_contacts>1</max_contacts>"),
    FileAddition("world", f'<skeleton name="one-more">{BODY}</skeleton>'),
    FileAddition(
        "world",
        f'<skeleton name="one-more">{BODY}<joint type="free" name="one-more"><parent>world</parent><child>one-more</child>'
        "</joint></skeleton>",
    ),
    FileAddition("world", "<wind>1 0 0</wind>"),
    # a skeleton's
    FileAddition("skeleton", "<transformation>0 0 0.1 0 0 0</transformation>"),
    FileAddition("skeleton", "<self_collision>false</self_collision>"),
    FileAddition("skeleton", "<gravity>0 0 0</gravity>"),
    FileAddition("skeleton", BODY),
    FileAddition("skeleton", "false", "mobile"),
    # a body's
    FileAddition("body", "<self_collide>false</self_collide>"),
    FileAddition("body", "<collidable>false</collidable>"),
    FileAddition("body", "<friction_coeff>0.1</friction_coeff>"),
    FileAddition("body", "<restitution_coeff>0.9</restitution_coeff>"),
    FileAddition("body", '<marker name="mark"><offset>0 0 0.1</offset></marker>'),
    FileAddition("body", f"<collision_shape>{HERE}{BALL}</collision_shape>"),
    FileAddition("body", f"<visualization_shape>{HERE}{BALL}</visualization_shape>"),
    FileAddition(
        "body",
        f"<soft_shape><total_mass>1</total_mass>{HERE}<geometry><box><size>0.1 0.1 0.1</size><frags>3 3 3</frags></box>"
        "</geometry>"
        "<kv>500</kv><ke>10</ke><damp>5</damp></soft_shape>",
    ),
    FileAddition("body", "soft", "type"),
    FileAddition("collision_shape", "<collidable>false</collidable>"),
    FileAddition("collision_shape", "<friction>0.1</friction>"),
    FileAddition("collision_shape", "<secondary_friction>0.1</secondary_friction>"),
    FileAddition("collision_shape", "<restitution>0.9</restitution>"),
    FileAddition("visualization_shape", "<hidden>true</hidden>"),
    FileAddition("inertia", "<offset>0.1 0 0</offset>"),
    # a joint's
    *(
        FileAddition("joint", kind, "actuator")
        for kind in ("force", "passive", "servo", "mimic", "acceleration", "velocity", "locked")
    ),
    FileAddition("joint", "<init_acc>1</init_acc>"),
    FileAddition("joint", "<init_force>1</init_force>"),
    FileAddition("joint", "<axis2><xyz>1 0 0</xyz></axis2>"),
    FileAddition("joint", "<axis><xyz>1 0 0</xyz><dynamics><damping>3</damping></dynamics></axis>"),
    FileAddition("joint", '<mimic joint="{joint[0]}"><multiplier>2</multiplier><offset>0.1</offset></mimic>'),
    FileAddition("joint", f'{DOF}<position lower="-0.1" upper="0.1" initial="0.05"/></dof>'),
    FileAddition("joint", f'{DOF}<velocity lower="-0.1" upper="0.1"/></dof>'),
    FileAddition("joint", f'{DOF}<acceleration lower="-0.1" upper="0.1"/></dof>'),
    FileAddition("joint", f'{DOF}<force lower="-0.1" upper="0.1"/></dof>'),
    FileAddition("joint", f"{DOF}<damping>3</damping></dof>"),
    FileAddition("joint", f"{DOF}<friction>2</friction></dof>"),
    FileAddition("joint", f"{DOF}<spring_stiffness>50</spring_stiffness></dof>"),
    FileAddition("joint", f"{DOF}<spring_rest_position>0.3</spring_rest_position></dof>"),
    FileAddition("axis", "<limit><lower>-0.1</lower><upper>0.1</upper></limit>"),
    FileAddition("axis", "<damping>3</damping>"),
    FileAddition("limit", "<velocity>0.1</velocity>"),
    FileAddition("limit", "<force>0.1</force>"),
)

SIDECAR_ADDITIONS = (
    FileAddition("", "9.81", "strength"),
    FileAddition("settings", "true", "sleeping"),
    FileAddition("settings", "true", "split_impulse"),
    FileAddition("damping", '{"body": "absent", "value": 1.0}'),
    FileAddition("springs", '{"body": "absent", "stiffness": 1.0, "rest": 0.0}'),
    FileAddition("enforce_limits", '"absent"'),
    FileAddition("excluded", '["absent", "nothing"]'),
    FileAddition("groups", "[]", "one-more"),
    FileAddition("filter.classes", "[]", "one-more"),
    FileAddition("filter.apart", '["absent", "nothing"]'),
)

FIRST_ONLY = "DART reads only the first of repeated elements"
ABSENT = "the value in the file is DART's default"
NAMED = "a name that nothing refers to"
SEEN = "visual only"
UNKNOWN = "DART's reader ignores it"
CHECKED = "only names the layer in which copies of shapes should collide, for the check of the collision matrix"
ORDER = "the order of elements that are found by name"

FIRST = (
    *("axis", "box", "capsule", "child", "collision_detector", "color", "cylinder", "damping", "dynamics", "file_name"),
    "friction",
    *(
        "geometry",
        "gravity",
        "height",
        "inertia",
        "init_pos",
        "init_vel",
        "ixx",
        "ixy",
        "ixz",
        "iyy",
        "iyz",
        "izz",
        "limit",
    ),
    *(
        "lower",
        "mass",
        "mesh",
        "mobile",
        "moment_of_inertia",
        "normal",
        "offset",
        "parent",
        "physics",
        "plane",
        "radius",
        "scale",
        "size",
        "sphere",
    ),
    *("spring_rest_position", "spring_stiffness", "time_step", "transformation", "upper", "world", "xyz"),
)
"""Elements of which the first counts."""

UNKNOWN_IN = (
    *(
        "physics/sub_steps",
        "physics/solver",
        "physics/split_impulse",
        "physics/max_contacts",
        "world/wind",
        "skeleton@mobile",
    ),
    *("skeleton/self_collision", "body/self_collide", "body/collidable", "body/friction_coeff"),
    *("body/restitution_coeff", "body@type", "collision_shape/friction", "joint/mimic"),
    *("collision_shape/secondary_friction", "collision_shape/restitution", "visualization_shape/hidden", "joint/axis2"),
    *("axis/damping", "limit/velocity", "limit/force"),
)
"""Elements that DART's reader ignores."""

TABLE = MutationTable(
    words={
        "joint@type": JOINT_TYPES,
        "collision_detector/text()": ("dart", "ode", "bullet", "fcl", "fcl_mesh", "something-else"),
        "friction_cone": ("elliptic", "pyramid-circumscribed", "pyramid-inscribed", "something-else"),
        "bodies.*.kind": (*JOINT_KINDS, "something-else"),
        "settings.contact_solver": ("auto", "nsgs", "dantzig", "something-else"),
        "settings.collision_detector": ("auto", "dart", "ode", "bullet", "fcl", "something-else"),
        "settings.exact_rotation": ("auto", "always", "never", "something-else"),
        "settings.contact_overflow": ("error", "log", "something-else"),
    },
    additions={"*.skel": SKEL_ADDITIONS, "sidecar.json": SIDECAR_ADDITIONS},
    inert=(
        *OF_MESHES,
        *(Inert(tag, FIRST_ONLY, ("element doubled",), "*.skel") for tag in FIRST),
        *(
            Inert(site, FIRST_ONLY, ("element added",), "*.skel")
            for site in ("inertia/offset", "joint/axis", "axis/limit", "skeleton/gravity")
        ),
        *(
            Inert(site, ABSENT, ("element removed", "number dropped"), "*.skel")
            for site in (
                *("transformation", "transformation/text()", "dynamics", "damping", "friction", "spring_stiffness"),
                *("spring_rest_position", "gravity", "init_vel", "mobile", "offset"),
            )
        ),
        Inert("*/text()", ABSENT, ("number dropped",), "*.skel"),
        Inert("time_step*", "DART's default timestep of 1 ms is the world's", ("sign", "element removed"), "*.skel"),
        Inert("parent", "for a root, whose parent is the world", ("element removed",), "*.skel"),
        Inert("body", "DART ignores a second element of the same name", ("element doubled",), "*.skel"),
        Inert("joint", "DART ignores a second element for the same body", ("element doubled",), "*.skel"),
        Inert("skeleton/body", "DART ignores a body without a joint", ("element added",), "*.skel"),
        Inert("body@name", "for copies of one body, which are welded to it in the same place", ("swapped",), "*.skel"),
        *(Inert(site, NAMED, (), "*.skel") for site in ("world@name", "skel@version", "joint@name")),
        Inert("body/visualization_shape", SEEN, ("element added",), "*.skel"),
        Inert("normal/text()", "DART normalises it", ("scaled",), "*.skel"),
        Inert("color*", SEEN, (), "*.skel"),
        Inert("transformation/text()", "a rotation within a shape's symmetry", (), "*.skel"),
        *(Inert(site, UNKNOWN, ("element added", "attribute added"), "*.skel") for site in UNKNOWN_IN),
        Inert(
            "joint@actuator", "for a joint without coordinates, or the default, force", ("attribute added",), "*.skel"
        ),
        Inert("joint/init_acc", "of the first instant only, and set to zero", ("element added",), "*.skel"),
        Inert("joint/init_force", "of the first instant only, and set to zero", ("element added",), "*.skel"),
        Inert(
            "collision_detector*",
            "DART's default for an unknown word is the detector in use; its mesh variant is set by the API",
            ("word", "element removed"),
            "*.skel",
        ),
        Inert(
            "damping/text()", "overwritten while loading, by the value that realises the armature", ("moved",), "*.skel"
        ),
        Inert("joint/dof", "for a joint without coordinates", ("element added",), "*.skel"),
        Inert("offset/text()", "the centre of mass of a body without mass", ("moved",), "*.skel"),
        Inert("xyz/text()", "DART normalises an axis", ("scaled",), "*.skel"),
        Inert("axis", "DART's default axis is z", ("element removed",), "*.skel"),
        *PASSIVE_BY_NAME,
        Inert("filter.layers*", CHECKED, (), "sidecar.json"),
        Inert("constraints.*", "the order of equations, but for round-off", ("swapped",), "sidecar.json", within=1e-9),
        *(
            Inert(site, ORDER, ("swapped",), "sidecar.json")
            for site in (
                *(
                    "filter.apart.*",
                    "filter.apart.*.*",
                    "filter.classes.*.*",
                    "excluded.*",
                    "excluded.*.*",
                    "groups.*.*",
                ),
                *("ignored_groups.*", "ignored_groups.*.*", "damping.*", "armature.*", "springs.*", "effort_limits.*"),
                *("velocity_limits.*", "enforce_limits.*", "copies.*", "shapes.*", "shapes.*.surfaces.*"),
            )
        ),
    ),
)
