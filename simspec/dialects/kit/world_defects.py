"""Defects planted into ``world.json``, for the dialects of all engines that read it.

A dialect's table is ``{**DEFECTS, ...}`` with a row for each name of :data:`UNSAID`: the sentence that says why its engine's
files cannot have it, or a defect where they have more.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from simspec.dialects.kit.defects import (
    BELTS,
    CONSTRAINTS,
    FRAMES,
    GROUND,
    MARGINS,
    PASSIVE,
    STEP,
    SUMS,
    Files,
    Plant,
    sidecar,
)
from simspec.formats.kit.text import json_text
from simspec.formats.world import WORLD
from simspec.world import frames


def world(change: Callable[[dict[str, Any]], None]) -> Plant:
    """A defect made by changing the content of ``world.json``."""

    def plant(files: Files) -> dict[str, str]:
        content = json.loads(files[WORLD])
        change(content)
        text = json_text(content)
        if text == files[WORLD]:
            raise ValueError(f"the defect changed nothing in {WORLD}")
        return {**files, WORLD: text}

    return plant


def body_of(content: Mapping[str, Any], name: str) -> Any:
    return next(body for body in content["bodies"] if body["name"] == name)


def number(body: str, *path: str | int, by: float = STEP, times: float = 1.0) -> Plant:
    """Move, or scale, a number of a body."""

    def edit(content: dict[str, Any]) -> None:
        place = body_of(content, body)
        for step in path[:-1]:
            place = place[step]
        place[path[-1]] = place[path[-1]] * times if times != 1.0 else place[path[-1]] + by

    return world(edit)


def _turned(vector: list[float]) -> list[float]:
    """A quaternion turned a little about its own x axis."""
    return list(frames.multiply(tuple(vector), frames.from_axis_angle((1.0, 0.0, 0.0), STEP)))  # type: ignore[arg-type]


def orientation(body: str, *path: str | int) -> Plant:
    def edit(content: dict[str, Any]) -> None:
        place = body_of(content, body)
        for step in path:
            place = place[step]
        place["quaternion"] = _turned(place["quaternion"])

    return world(edit)


def _axis(content: dict[str, Any]) -> None:
    joint = body_of(content, "upper")["joint"]
    joint["axis"] = list(frames.rotate(frames.from_axis_angle((1.0, 0.0, 0.0), STEP), tuple(joint["axis"])))


def _reversed(content: dict[str, Any]) -> None:
    joint = body_of(content, "upper")["joint"]
    joint["axis"] = [-x for x in joint["axis"]]


def joint_field(body: str, part: str, field: str, value: Any) -> Plant:
    def edit(content: dict[str, Any]) -> None:
        body_of(content, body)[part][field] = value

    return world(edit)


def _drop_cube(content: dict[str, Any]) -> None:
    content["bodies"].remove(body_of(content, "cube"))
    content["apart"]["bodies"] = [pair for pair in content["apart"]["bodies"] if "cube" not in pair]


def _sphere_for_box(content: dict[str, Any]) -> None:
    body_of(content, "cube")["shapes"][0].update(kind="sphere", size=[0.05])


def _not_solid(content: dict[str, Any]) -> None:
    body_of(content, "cube")["shapes"][0]["copies"].clear()


def _hull(by: tuple[float, float, float]) -> Plant:
    """Scale a hull along its axes."""

    def edit(content: dict[str, Any]) -> None:
        shape = body_of(content, "stone")["shapes"][0]
        shape["size"] = [value * by[index % 3] for index, value in enumerate(shape["size"])]

    return world(edit)


def _other_hull(content: dict[str, Any]) -> None:
    body_of(content, "stone")["shapes"][0]["size"] = body_of(content, "toy")["shapes"][1]["size"]


def _no_hull(content: dict[str, Any]) -> None:
    body_of(content, "stone")["shapes"][0]["size"].clear()


def _exchanged(content: dict[str, Any]) -> None:
    """Two shapes of a body exchange their hulls."""
    first, second = body_of(content, "toy")["shapes"]
    first["size"], second["size"] = second["size"], first["size"]


def _pair_value(content: dict[str, Any]) -> None:
    """Halve ice's number in the layer where it meets rubber."""
    layer = next(layer for entry, other, layer in content["meets"] if {entry, other} == {"ice", "rubber"})
    copies = body_of(content, "ice_cube")["shapes"][0]["copies"]
    next(copy for copy in copies if copy["layer"] == layer)["friction"] *= 0.5


def _cone(content: dict[str, Any]) -> None:
    content["friction_cone"] = "pyramid-circumscribed"


def _copy_filter(content: dict[str, Any]) -> None:
    """Ice and rubber meet in another layer."""
    entry = next(entry for entry in content["meets"] if {entry[0], entry[1]} == {"ice", "rubber"})
    entry[2] = 1 - entry[2]


def _passing_pair(content: dict[str, Any]) -> None:
    content["meets"].append(["ghost", "ice", 0])


def _exclusions(*, drop: tuple[str, str] | None = None, add: tuple[str, str] | None = None) -> Plant:
    def edit(content: dict[str, Any]) -> None:
        if drop:
            content["apart"]["bodies"].remove(list(drop))
        if add:
            content["apart"]["bodies"].append(list(add))

    return world(edit)


def _no_groups(content: dict[str, Any]) -> None:
    content["apart"]["groups"].clear()


def _group(content: dict[str, Any]) -> None:
    body_of(content, "quiet")["group"] = "default"
    content["apart"]["groups"] = [["arm", "default"]]


def _gravity(content: dict[str, Any]) -> None:
    content["gravity"][2] += STEP


def _timestep(content: dict[str, Any]) -> None:
    content["timestep"] *= 1.0 + STEP


UNSAID = ("hardness", "mesh, margin", *MARGINS, *BELTS, *GROUND)
"""What ``world.json`` has no number for."""

DEFECTS: Mapping[str, Plant | str] = {
    **CONSTRAINTS,
    **SUMS,
    **PASSIVE,
    **dict.fromkeys(("ball limit", "ball limit dropped"), "world.json has no limits of balls"),
    **dict.fromkeys(FRAMES, "world.json has no frames: engines that read it receive none"),
    "mass": number("lower", "mass", times=1.0 + STEP),
    "centre of mass": number("lower", "centre_of_mass", 0),
    "inertia, diagonal": number("lower", "inertia", 0, times=1.0 + STEP),
    "inertia, sign of a product": number("lower", "inertia", 3, times=-1.0),
    "body dropped": world(_drop_cube),
    "joint type": joint_field("upper", "joint", "kind", "slide"),
    "axis": world(_axis),
    "axis reversed": world(_reversed),
    "joint origin, position": number("lower", "joint", "origin", "position", 0),
    "joint origin, orientation": orientation("lower", "joint", "origin"),
    "position limit": number("upper", "joint", "position_limits", 1),
    "position limit dropped": joint_field("upper", "joint", "position_limits", None),
    "velocity limit": number("upper", "joint", "velocity_limit"),
    "effort limit": number("upper", "joint", "effort_limit"),
    "damping": number("upper", "joint", "damping"),
    "spring stiffness": number("lower", "joint", "spring_stiffness"),
    "spring rest": number("lower", "joint", "spring_rest"),
    "dry friction": number("upper", "joint", "dry_friction", times=1.0 + STEP),
    "armature": number("upper", "joint", "armature"),
    "free armature": number("kite", "mass", times=1.0 + STEP),
    "ball armature": number("bob", "inertia", 0, times=1.0 + STEP),
    "ball damping": number("bob", "joint", "damping"),
    "ball spring": number("bob", "joint", "spring_stiffness"),
    "initial position": number("upper", "joint", "position", 0),
    "initial velocity": number("upper", "joint", "velocity", 0),
    "shape type": world(_sphere_for_box),
    "shape size": number("ball", "shapes", 0, "size", 0, times=1.0 + STEP),
    "shape position": number("lower", "shapes", 0, "pose", "position", 0),
    "shape orientation": orientation("lower", "shapes", 0, "pose"),
    "shape not solid": world(_not_solid),
    "mesh, a vertex": number("stone", "shapes", 0, "size", 0),
    "mesh, scale": _hull((1.0 + STEP, 1.0 + STEP, 1.0 + STEP)),
    "mesh, mirrored": _hull((-1.0, 1.0, 1.0)),
    "mesh of another shape": world(_other_hull),
    "mesh missing": world(_no_hull),
    "meshes in another order": world(_exchanged),
    "friction": number("ball", "shapes", 0, "copies", 0, "friction", by=-STEP),
    "restitution": number("ball", "shapes", 0, "copies", 0, "restitution", by=-STEP),
    "pair value": world(_pair_value),
    "cone": world(_cone),
    "copy filter": world(_copy_filter),
    "passing pair": world(_passing_pair),
    "torsional friction": number("ball", "shapes", 0, "copies", 0, "torsional_friction", times=0.5),
    "rolling friction": number("ball", "shapes", 0, "copies", 0, "rolling_friction", times=0.5),
    "excluded pair dropped": _exclusions(drop=("ball", "cube")),
    "excluded pair too many": _exclusions(add=("ball", "floor")),
    "collision group": world(_group),
    "excluded pair of a mechanism dropped": _exclusions(drop=("lower", "upper")),
    "excluded pair of a mechanism too many": _exclusions(add=("ball", "lower")),
    "group filter dropped": world(_no_groups),
    "gravity": world(_gravity),
    "timestep": world(_timestep),
}

# Defects planted into a table of laws (``world_laws.py``), for the dialects of all engines that have one.

ADDED_LAW = '{"first": "nothing", "second": "nothing", "friction": 0.5, "restitution": 0}'
"""A law of what is not there, which a complete self-test adds."""


def _law(names: set[str], change: Callable[[dict[str, Any]], None]) -> Plant:
    """A defect in the law of two materials."""

    def edit(content: dict[str, Any]) -> None:
        change(next(law for law in content["laws"] if {law["first"], law["second"]} == names))

    return sidecar(edit)


def _first(change: Callable[[dict[str, Any]], None]) -> Plant:
    """A defect in the first law."""
    return sidecar(lambda content: change(content["laws"][0]))


def _number(name: str, by: float = 0.0, times: float = 1.0) -> Callable[[dict[str, Any]], None]:
    return lambda law: law.update({name: law[name] * times + by})


def _exchanged_laws(content: dict[str, Any]) -> None:
    """Ice and rubber, and rubber with itself, have each other's law."""
    entry = next(law for law in content["laws"] if {law["first"], law["second"]} == {"ice", "rubber"})
    other = next(law for law in content["laws"] if law["first"] != law["second"] and law is not entry)
    names = ("first", "second")
    for key in {*entry, *other} - set(names):
        entry[key], other[key] = other[key], entry[key]


LAW_DEFECTS: Mapping[str, Plant | str] = {
    **DEFECTS,
    "friction": _first(_number("friction", by=-STEP)),
    "restitution": _first(_number("restitution", by=-STEP)),
    "pair value": _law({"ice", "rubber"}, _number("friction", times=0.5)),
    "torsional friction": _first(_number("torsional_friction", times=0.5)),
    "rolling friction": _first(_number("rolling_friction", times=0.5)),
    "copy filter": sidecar(_exchanged_laws),
    **dict.fromkeys(BELTS, "world.json has no surfaces that move by themselves"),
}
"""Defects of all of them; ``GROUND``, margins and hardness are each engine's own."""
