"""Defects planted into .skel files and their sidecar."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from simspec.dialects.kit.defects import (
    BELTS,
    CONSTRAINTS,
    FRAMES,
    GROUND,
    MARGINS,
    PASSIVE,
    SUMS,
    Plant,
    floats,
    nudged,
    one,
    scaled,
    sidecar,
    turned_axis,
    xml,
)
from simspec.dialects.kit.mesh_defects import FILES, reordered
from simspec.formats.kit.text import numbers
from simspec.formats.skel.format import WORLD

LOWER = ".//body[@name='lower']"
HINGE = ".//joint[@name='upper_joint']"


def _text(path: str, change: Callable[[str | None], str]) -> Plant:
    def edit(root: Element) -> None:
        element = one(root, path)
        element.text = change(element.text)

    return xml(WORLD, edit)


def _drop_cube(root: Element) -> None:
    world = one(root, "world")
    world.remove(one(world, "skeleton[@name='cube']"))


def _slide_for_hinge(root: Element) -> None:
    joint = one(root, HINGE)
    joint.set("type", "prismatic")


def _not_limited(root: Element) -> None:
    axis = one(root, f"{HINGE}/axis")
    axis.remove(one(axis, "limit"))


def _sphere_for_box(root: Element) -> None:
    for kind in ("visualization_shape", "collision_shape"):
        geometry = one(root, f".//body[@name='cube']/{kind}/geometry")
        geometry.remove(one(geometry, "box"))
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
    layer = next(layer for one, other, layer in content["filter"]["layers"] if (one, other) == ("ice", "rubber"))
    wrong = 1 - layer
    content["filter"]["apart"].remove([f"ice.{wrong}", f"rubber.{wrong}"])
    content["filter"]["apart"].append([f"ice.{layer}", f"rubber.{layer}"])


def _passing_pair(content: dict[str, Any]) -> None:
    apart = content["filter"]["apart"]
    apart[:] = [pair for pair in apart if {name.rpartition(".")[0] for name in pair} != {"ghost", "ice"}]


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
    **dict.fromkeys(FRAMES, "DART is told no frames"),
    "free armature": "DART has no armature of free bodies",
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
    "ball armature": "DART has no armature of balls",
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
    "torsional friction": "DART has no torsional friction, and a world that asks for it is refused",
    "rolling friction": "DART has no rolling friction, and a world that asks for it is refused",
    "gravity": _text(".//physics/gravity", lambda text: nudged(text, 2)),
    "timestep": _text(".//physics/time_step", scaled),
}
