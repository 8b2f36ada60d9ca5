"""Defects planted into ``world.wbt`` and its sidecar."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from simspec.dialects.kit.defects import (
    BELTS,
    CONSTRAINTS,
    FRAMES,
    GROUND,
    MARGINS,
    NAMES,
    PASSIVE,
    STEP,
    SUMS,
    Files,
    Plant,
    floats,
    nudged,
    scaled,
    sidecar,
    turned_axis,
)
from simspec.dialects.kit.mutations import FileAddition, Inert, MutationTable
from simspec.formats.kit.text import numbers
from simspec.formats.wbt.format import WORLD
from simspec.formats.wbt.reading import WbtNode, parse

Change = Callable[[str], str]


def _edit(find: Callable[[list[WbtNode]], tuple[WbtNode, str]], change: Change) -> Plant:
    """A defect in the numbers of one field, which stand in a line of their own."""

    def plant(files: Files) -> dict[str, str]:
        node, name = find(list(parse(files[WORLD], WORLD).walk()))
        lines = files[WORLD].split("\n")
        at = node.field(name).line - 1
        before, _, values = lines[at].partition(name)
        bare = values.strip("[ ]")
        new = change(bare)
        if new == bare:
            raise ValueError(f"the defect changed nothing in {WORLD}")
        lines[at] = f"{before}{name} " + (f"[ {new} ]" if "[" in values else new)
        return {**files, WORLD: "\n".join(lines)}

    return plant


def _body(nodes: list[WbtNode], name: str) -> WbtNode:
    return next(node for node in nodes if node.kind == "Solid" and node.text("name") == name)


def _of(body: str, name: str, change: Change) -> Plant:
    """A defect in a field of a body's Solid."""
    return _edit(lambda nodes: (_body(nodes, body), name), change)


def _in(body: str, inside: str, name: str, change: Change) -> Plant:
    """A defect in a field of the node that another field of a body's Solid holds, or of the first of a kind below it."""

    def find(nodes: list[WbtNode]) -> tuple[WbtNode, str]:
        solid = _body(nodes, body)
        return next(node for node in solid.walk() if node.kind == inside), name

    return _edit(find, change)


def _joint(body: str, name: str, change: Change) -> Plant:
    """A defect in the parameters of a body's joint."""

    def find(nodes: list[WbtNode]) -> tuple[WbtNode, str]:
        number = _body(nodes, body).label.removeprefix("body")
        joint = next(node for node in nodes if node.label == f"joint{number}")
        parameters = joint.node("jointParameters")
        if parameters is None:
            raise LookupError(f"{body} has no parameters")
        return parameters, name

    return _edit(find, change)


def _physics(body: str, name: str, change: Change) -> Plant:
    def find(nodes: list[WbtNode]) -> tuple[WbtNode, str]:
        physics = _body(nodes, body).node("physics")
        if physics is None:
            raise LookupError(f"{body} has no Physics")
        return physics, name

    return _edit(find, change)


def _bounding(body: str, kind: str, name: str, change: Change) -> Plant:
    """A defect in a node of what is solid of a body."""

    def find(nodes: list[WbtNode]) -> tuple[WbtNode, str]:
        bounding = _body(nodes, body).node("boundingObject")
        if bounding is None:
            raise LookupError(f"{body} has no boundingObject")
        return next(node for node in bounding.walk() if node.kind == kind), name

    return _edit(find, change)


def _law(name: str, change: Change, first: str = "", second: str = "") -> Plant:
    """A defect in the law of two materials; of the first where none are named."""

    def find(nodes: list[WbtNode]) -> tuple[WbtNode, str]:
        laws = (node for node in nodes if node.kind == "ContactProperties")
        matching = (
            law for law in laws if not first or {law.text("material1"), law.text("material2")} == {first, second}
        )
        return next(matching), name

    return _edit(find, change)


def _info(name: str, change: Change) -> Plant:
    return _edit(lambda nodes: (next(node for node in nodes if node.kind == "WorldInfo"), name), change)


def _cut(find: Callable[[list[WbtNode]], WbtNode], by: Callable[[str], str] = lambda block: "") -> Plant:
    """A defect in which the lines of a node are replaced."""

    def plant(files: Files) -> dict[str, str]:
        node = find(list(parse(files[WORLD], WORLD).walk()))
        lines = files[WORLD].split("\n")
        start = end = node.line - 1
        depth = 0
        while True:
            depth += lines[end].count("{") - lines[end].count("}")
            if depth == 0:
                break
            end += 1
        block = "\n".join(lines[start : end + 1])
        return {**files, WORLD: "\n".join([*lines[:start], by(block), *lines[end + 1 :]])}

    return plant


def _cube_shape(nodes: list[WbtNode]) -> WbtNode:
    bounding = _body(nodes, "cube").node("boundingObject")
    return next(node for node in (bounding.walk() if bounding else ()) if node.kind == "Box")


def _cube_solid(nodes: list[WbtNode]) -> WbtNode:
    bounding = _body(nodes, "cube").node("boundingObject")
    if bounding is None:
        raise LookupError("the cube is not solid")
    return bounding


def _listed(block: str, key: str, body: str, by: float = STEP) -> Plant:
    """Move a number of one body's entry in a list of the sidecar."""

    def edit(content: dict[str, Any]) -> None:
        entry = next(entry for entry in content[block] if entry["body"] == body)
        entry[key] += by

    return sidecar(edit)


def _reversed(text: str) -> str:
    return numbers(-x for x in floats(text))


_NO_FILTER = "Webots has no filter that a file could have wrong"
_NO_CONSTRAINTS = "simspec gives Webots no constraints outside the tree"
_NO_ARMATURE = "Webots has no armature"

DEFECTS: Mapping[str, Plant | str] = {
    **dict.fromkeys(CONSTRAINTS, _NO_CONSTRAINTS),
    **{name: plant for name, plant in SUMS.items() if NAMES[name] == "sums"},
    **dict.fromkeys(("sum, dry friction", "sum, limit", "sum, limits dropped"), _NO_CONSTRAINTS),
    **PASSIVE,
    **dict.fromkeys(FRAMES, "Webots gets no frames"),
    **dict.fromkeys(GROUND, "simspec gives Webots no height fields"),
    **dict.fromkeys(MARGINS, "Webots' contact begins where shapes touch"),
    **dict.fromkeys(BELTS, "simspec gives Webots no surfaces that move"),
    **{name: "simspec gives Webots no meshes" for name in NAMES if name.startswith("mesh")},
    **dict.fromkeys(("ball limit", "ball limit dropped"), "Webots has no limits of a ball's whole angle"),
    **dict.fromkeys(("armature", "ball armature", "free armature"), _NO_ARMATURE),
    "mass": _physics("lower", "mass", scaled),
    "centre of mass": _physics("lower", "centerOfMass", nudged),
    "inertia, diagonal": _physics("lower", "inertiaMatrix", scaled),
    "inertia, sign of a product": _physics("lower", "inertiaMatrix", lambda text: scaled(text, 3, -1.0)),
    "body dropped": _cut(lambda nodes: _body(nodes, "cube")),
    "joint type": _cut(
        lambda nodes: next(node for node in nodes if node.kind == "HingeJoint"),
        lambda block: block.replace("HingeJoint {", "SliderJoint {", 1),
    ),
    "axis": _joint("upper", "axis", turned_axis),
    "axis reversed": _joint("upper", "axis", _reversed),
    "joint origin, position": _of("lower", "translation", nudged),
    "joint origin, orientation": _of("lower", "rotation", lambda text: nudged(text, 3)),
    "position limit": _joint("upper", "maxStop", nudged),
    "position limit dropped": _joint("upper", "maxStop", lambda text: "-1.5"),
    "velocity limit": _listed("velocity_limits", "value", "upper"),
    "effort limit": _listed("effort_limits", "value", "upper"),
    "damping": _listed("damping", "value", "upper"),
    "spring stiffness": _listed("springs", "stiffness", "lower"),
    "spring rest": _listed("springs", "rest", "lower"),
    "dry friction": _joint("upper", "staticFriction", scaled),
    "ball damping": _listed("damping", "value", "bob"),
    "ball spring": _listed("springs", "stiffness", "bob"),
    "initial position": _joint("upper", "position", nudged),
    "initial velocity": _of("upper", "angularVelocity", nudged),
    "shape type": _cut(_cube_shape, lambda block: "Sphere {\nradius 0.05\nsubdivision 3\nico TRUE\n}"),
    "shape size": _bounding("ball", "Sphere", "radius", scaled),
    "shape position": _bounding("lower", "Pose", "translation", nudged),
    "shape orientation": _bounding("lower", "Pose", "rotation", lambda text: nudged(text, 3)),
    "shape not solid": _cut(_cube_solid, lambda block: "boundingObject NULL"),
    "friction": _law("coulombFriction", lambda text: nudged(text, by=-STEP)),
    "restitution": _law("bounce", lambda text: nudged(text, by=-STEP)),
    "pair value": _law("coulombFriction", lambda text: scaled(text, by=0.5), "ice", "rubber"),
    "cone": sidecar(lambda content: content.update(friction_cone="pyramid-circumscribed")),
    "hardness": _law("softERP", lambda text: scaled(text, by=0.1)),
    "copy filter": _cut(
        lambda nodes: next(
            node
            for node in nodes
            if node.kind == "ContactProperties"
            and (node.text("material1"), node.text("material2")) == ("ice", "rubber")
        ),
        lambda block: block.replace('material1 "ice"', 'material1 "rubber"'),
    ),
    "passing pair": "Webots has no contact of two materials without contact",
    "torsional friction": _law("rollingFriction", lambda text: scaled(text, 2, 0.5)),
    "rolling friction": _law("rollingFriction", lambda text: scaled(text, 0, 0.5)),
    **dict.fromkeys(
        (
            *("excluded pair dropped", "excluded pair too many", "collision group", "group filter dropped"),
            *("excluded pair of a mechanism dropped", "excluded pair of a mechanism too many"),
        ),
        _NO_FILTER,
    ),
    "gravity": _info("gravity", nudged),
    "timestep": _info("basicTimeStep", scaled),
}

# Changes of a .wbt and its sidecar that move nothing, for the complete self-test; see ``dialects/kit/mutations.py``.

_COLOUR = "colours move nothing"
_LABEL = "a label of the files; the engine's process, where there is one, learns it by other means"
_NEXT = "the order of bodies, shapes or laws"
_SYMMETRIC = "a number for two bodies, in either order"

ADDITIONS = (FileAddition("settings", "true", "sleeping"), FileAddition("", "9.81", "strength"))

TABLE = MutationTable(
    integers=frozenset(("schema", "settings.contact_points")),
    additions={"sidecar.json": ADDITIONS},
    inert=(
        Inert("WorldInfo/title", "the name of the world", ("word",)),
        Inert("PBRAppearance/baseColor", _COLOUR),
        Inert("PBRAppearance/transparency", _COLOUR, ("scaled", "moved", "sign")),
        Inert("Solid/rotation", "half a turn, which is the same to both sides", ("sign",), place="*BallJoint*"),
        Inert("passive.around.boxes.*.box.edges.*", "a box has no sign", ("sign",), "sidecar.json"),
        Inert("engine", _LABEL, ("word",), "sidecar.json"),
        Inert("world", _LABEL, ("word",), "sidecar.json"),
        Inert("format", _LABEL, ("word",), "sidecar.json"),
        Inert("joints.*", "the name of a joint that does not move", ("word", "swapped"), "sidecar.json"),
        Inert("shapes.*.name", "the name of a shape", ("word",), "sidecar.json"),
        *(
            Inert(
                f"settings.{name}",
                "acts in contacts, whose numbers are compared with it",
                ("scaled", "sign"),
                "sidecar.json",
            )
            for name in ("softness", "contact_points")
        ),
        *(
            Inert(site, _NEXT, ("swapped",), "sidecar.json")
            for site in (
                "shapes.*",
                "velocity_limits.*",
                "effort_limits.*",
                "damping.*",
                "springs.*",
                "untold_limits.*",
                "starts.*",
            )
        ),
        *(
            Inert(site, _SYMMETRIC, ("swapped",), "sidecar.json")
            for site in ("passive.gravity_scales.*", "passive.around.boxes.*", "passive.free_damping.*")
        ),
    ),
)
