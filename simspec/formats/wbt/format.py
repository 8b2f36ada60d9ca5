"""The format ``wbt``: one file of VRML97, ``world.wbt``, without PROTO nodes.

Poses are a translation and a rotation as axis and angle, of a node in the one that it stands in, at the initial state.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final

from simspec.formats.kit.contract import Format
from simspec.formats.kit.text import environment
from simspec.formats.wbt.reading import Value as ReadingValue
from simspec.formats.wbt.reading import WbtDocument, WbtField, WbtNode

Value = object
"""Of a field: flags, numbers, texts and nodes; None is NULL; a tuple the numbers of a vector, or what stands in a list."""


@dataclass(frozen=True, slots=True)
class WbtNodeTree:
    """A node of a type of ``fields.py``. Fields that are not given get the language's default, which is written too.
    ``label`` is the name after DEF; "" none."""

    type: str
    fields: Mapping[str, object] = field(default_factory=dict)
    label: str = ""


@dataclass(frozen=True, slots=True)
class WbtWorld:
    """A whole file: its nodes in order, WorldInfo first."""

    nodes: tuple[WbtNodeTree, ...]


# --- nodes with every field and its default, as the reference manual of R2023b lists them ---
# All fields are written: no file depends on the defaults of a version.

VERSION: Final = "R2023b"
"""Of the language; the first word of a file is ``#VRML_SIM``, the second this."""

FieldDefault = tuple[str, object]
"""Its kind (``SF``: one value, ``MF``: a list), and its default."""

_POSE: Final[Mapping[str, FieldDefault]] = {
    "translation": ("SFVec3f", (0.0, 0.0, 0.0)),
    "rotation": ("SFRotation", (0.0, 0.0, 1.0, 0.0)),
    "children": ("MFNode", ()),
    "translationStep": ("SFFloat", 0.01),
    "rotationStep": ("SFFloat", 0.261799387),
}
_SOLID: Final[Mapping[str, FieldDefault]] = {
    **_POSE,
    "name": ("SFString", "solid"),
    "model": ("SFString", ""),
    "description": ("SFString", ""),
    "contactMaterial": ("SFString", "default"),
    "immersionProperties": ("MFNode", ()),
    "boundingObject": ("SFNode", None),
    "physics": ("SFNode", None),
    "locked": ("SFBool", False),
    "radarCrossSection": ("SFFloat", 0.0),
    "recognitionColors": ("MFColor", ()),
    "linearVelocity": ("SFVec3f", (0.0, 0.0, 0.0)),
    "angularVelocity": ("SFVec3f", (0.0, 0.0, 0.0)),
}
_AXIS: Final[Mapping[str, FieldDefault]] = {
    "position": ("SFFloat", 0.0),
    "minStop": ("SFFloat", 0.0),
    "maxStop": ("SFFloat", 0.0),
    "springConstant": ("SFFloat", 0.0),
    "dampingConstant": ("SFFloat", 0.0),
    "staticFriction": ("SFFloat", 0.0),
}
_ROUND: Final[Mapping[str, FieldDefault]] = {
    "bottom": ("SFBool", True),
    "height": ("SFFloat", 2.0),
    "radius": ("SFFloat", 1.0),
    "side": ("SFBool", True),
    "top": ("SFBool", True),
}

NODES: Final[Mapping[str, Mapping[str, FieldDefault]]] = {
    "WorldInfo": {
        "title": ("SFString", ""),
        "info": ("MFString", ()),
        "window": ("SFString", "<none>"),
        "gravity": ("SFFloat", 9.81),
        "CFM": ("SFFloat", 1e-5),
        "ERP": ("SFFloat", 0.2),
        "physics": ("SFString", ""),
        "basicTimeStep": ("SFFloat", 32.0),
        "FPS": ("SFFloat", 60.0),
        "optimalThreadCount": ("SFInt32", 1),
        "physicsDisableTime": ("SFFloat", 1.0),
        "physicsDisableLinearThreshold": ("SFFloat", 0.01),
        "physicsDisableAngularThreshold": ("SFFloat", 0.01),
        "defaultDamping": ("SFNode", None),
        "inkEvaporation": ("SFFloat", 0.0),
        "coordinateSystem": ("SFString", "ENU"),
        "gpsCoordinateSystem": ("SFString", "local"),
        "gpsReference": ("SFVec3f", (0.0, 0.0, 0.0)),
        "lineScale": ("SFFloat", 0.1),
        "dragForceScale": ("SFFloat", 30.0),
        "dragTorqueScale": ("SFFloat", 5.0),
        "randomSeed": ("SFInt32", 0),
        "contactProperties": ("MFNode", ()),
    },
    "ContactProperties": {
        "material1": ("SFString", "default"),
        "material2": ("SFString", "default"),
        "coulombFriction": ("MFFloat", (1.0,)),
        "frictionRotation": ("SFVec2f", (0.0, 0.0)),
        "rollingFriction": ("SFVec3f", (0.0, 0.0, 0.0)),
        "bounce": ("SFFloat", 0.5),
        "bounceVelocity": ("SFFloat", 0.01),
        "forceDependentSlip": ("MFFloat", (0.0,)),
        "softERP": ("SFFloat", 0.2),
        "softCFM": ("SFFloat", 0.001),
        "bumpSound": ("SFString", ""),
        "rollSound": ("SFString", ""),
        "slideSound": ("SFString", ""),
        "maxContactJoints": ("SFInt32", 10),
    },
    "Viewpoint": {
        "fieldOfView": ("SFFloat", 0.785398),
        "orientation": ("SFRotation", (0.0, 0.0, 1.0, 0.0)),
        "position": ("SFVec3f", (-10.0, 0.0, 0.0)),
        "description": ("SFString", ""),
        "near": ("SFFloat", 0.05),
        "far": ("SFFloat", 0.0),
        "exposure": ("SFFloat", 1.0),
        "follow": ("SFString", ""),
        "followType": ("SFString", "Tracking Shot"),
        "followSmoothness": ("SFFloat", 0.5),
        "lensFlare": ("SFNode", None),
        "ambientOcclusionRadius": ("SFFloat", 2.0),
        "bloomThreshold": ("SFFloat", 21.0),
    },
    "DirectionalLight": {
        "ambientIntensity": ("SFFloat", 0.0),
        "castShadows": ("SFBool", False),
        "color": ("SFColor", (1.0, 1.0, 1.0)),
        "direction": ("SFVec3f", (0.0, 0.0, -1.0)),
        "intensity": ("SFFloat", 1.0),
        "on": ("SFBool", True),
    },
    "Solid": _SOLID,
    "Robot": {
        **_SOLID,
        "name": ("SFString", "robot"),
        "controller": ("SFString", "<generic>"),
        "controllerArgs": ("MFString", ()),
        "customData": ("SFString", ""),
        "supervisor": ("SFBool", False),
        "synchronization": ("SFBool", True),
        "battery": ("MFFloat", ()),
        "cpuConsumption": ("SFFloat", 10.0),
        "selfCollision": ("SFBool", False),
        "window": ("SFString", "<generic>"),
        "remoteControl": ("SFString", "<none>"),
    },
    "Physics": {
        "density": ("SFFloat", 1000.0),
        "mass": ("SFFloat", -1.0),
        "centerOfMass": ("MFVec3f", ()),
        "inertiaMatrix": ("MFVec3f", ()),
        "damping": ("SFNode", None),
    },
    "HingeJoint": {"jointParameters": ("SFNode", None), "device": ("MFNode", ()), "endPoint": ("SFNode", None)},
    "SliderJoint": {"jointParameters": ("SFNode", None), "device": ("MFNode", ()), "endPoint": ("SFNode", None)},
    "BallJoint": {
        "jointParameters": ("SFNode", None),
        "jointParameters2": ("SFNode", None),
        "jointParameters3": ("SFNode", None),
        "device": ("MFNode", ()),
        "device2": ("MFNode", ()),
        "device3": ("MFNode", ()),
        "endPoint": ("SFNode", None),
    },
    "HingeJointParameters": {
        **_AXIS,
        "axis": ("SFVec3f", (1.0, 0.0, 0.0)),
        "anchor": ("SFVec3f", (0.0, 0.0, 0.0)),
        "suspensionSpringConstant": ("SFFloat", 0.0),
        "suspensionDampingConstant": ("SFFloat", 0.0),
        "suspensionAxis": ("SFVec3f", (1.0, 0.0, 0.0)),
        "stopERP": ("SFFloat", -1.0),
        "stopCFM": ("SFFloat", -1.0),
    },
    "JointParameters": {**_AXIS, "axis": ("SFVec3f", (0.0, 0.0, 1.0))},
    "BallJointParameters": {**_AXIS, "anchor": ("SFVec3f", (0.0, 0.0, 0.0))},
    "Group": {"children": ("MFNode", ())},
    "Pose": _POSE,
    "Shape": {
        "appearance": ("SFNode", None),
        "geometry": ("SFNode", None),
        "castShadows": ("SFBool", True),
        "isPickable": ("SFBool", True),
    },
    "PBRAppearance": {
        "baseColor": ("SFColor", (1.0, 1.0, 1.0)),
        "baseColorMap": ("SFNode", None),
        "transparency": ("SFFloat", 0.0),
        "roughness": ("SFFloat", 0.0),
        "roughnessMap": ("SFNode", None),
        "metalness": ("SFFloat", 1.0),
        "metalnessMap": ("SFNode", None),
        "IBLStrength": ("SFFloat", 1.0),
        "normalMap": ("SFNode", None),
        "normalMapFactor": ("SFFloat", 1.0),
        "occlusionMap": ("SFNode", None),
        "occlusionMapStrength": ("SFFloat", 1.0),
        "emissiveColor": ("SFColor", (0.0, 0.0, 0.0)),
        "emissiveColorMap": ("SFNode", None),
        "emissiveIntensity": ("SFFloat", 1.0),
        "textureTransform": ("SFNode", None),
        "name": ("SFString", "PBRAppearance"),
    },
    "Sphere": {"radius": ("SFFloat", 1.0), "subdivision": ("SFInt32", 1), "ico": ("SFBool", True)},
    "Box": {"size": ("SFVec3f", (2.0, 2.0, 2.0))},
    "Cylinder": {**_ROUND, "subdivision": ("SFInt32", 36)},
    "Capsule": {**_ROUND, "subdivision": ("SFInt32", 12)},
    "Plane": {"size": ("SFVec2f", (1.0, 1.0))},
}

WORLD: Final = "world.wbt"
DEEPEST: Final = 40
"""Levels that lines are indented by; deeper lines are indented no further, since a chain of bodies is nested body in body."""


class Wbt(Format):
    """The .wbt language, without what the program that reads it makes of it."""

    NAME: ClassVar[str] = "wbt"

    def write(self, tree: WbtWorld) -> dict[str, str]:
        """``world.wbt``, with every field of every node. Raises KeyError for nodes and fields that are not of ``fields.py``,
        and ValueError for numbers that are not finite and texts that no line can hold."""
        content = {"version": VERSION, "rows": list(_rows(tree.nodes))}
        return {WORLD: environment().get_template("wbt/world.wbt.j2").render(content)}

    def read(self, folder: Path) -> WbtDocument:
        """The document of ``world.wbt`` in ``folder``.

        Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file and line, where it is no .wbt,
        or beyond a bound.
        """
        from simspec.formats.wbt.reading import read_document

        return read_document(folder / WORLD)


Row = Mapping[str, Any]


def _rows(nodes: Sequence[WbtNodeTree]) -> Iterator[Row]:
    """The lines of the file: nodes in one another as a stack, however deep they are."""
    stack: list[tuple[int, str, object]] = [(0, "", node) for node in reversed(nodes)]
    while stack:
        depth, before, what = stack.pop()
        if not isinstance(what, WbtNodeTree):  # a bracket that closes
            yield _row(depth, str(what))
            continue
        known = NODES[what.type]
        if unexpected := what.fields.keys() - known.keys():
            raise KeyError(f"{what.type} has no field {', '.join(sorted(unexpected))}")
        label = f"DEF {what.label} " if what.label else ""
        yield _row(depth, f"{before}{label}{what.type} {{")
        below: list[tuple[int, str, object]] = []
        for name, (kind, default) in known.items():
            value = what.fields.get(name, default)
            if kind == "SFNode" and value is not None:
                below.append((depth + 1, f"{name} ", value))
            elif kind == "MFNode" and value:
                below.append((depth + 1, "", f"{name} ["))
                below += [(depth + 2, "", node) for node in value]  # type: ignore[attr-defined]
                below.append((depth + 1, "", "]"))
            else:
                yield _plain(depth + 1, name, kind, value)
        stack.append((depth, "", "}"))
        stack += reversed(below)


def _row(depth: int, text: str, numbers: Sequence[float] = (), end: str = "") -> Row:
    from markupsafe import Markup

    return {"indent": "  " * min(depth, DEEPEST), "text": Markup(text), "numbers": numbers, "end": end}


def _plain(depth: int, name: str, kind: str, value: Any) -> Row:
    """A field that holds no node."""
    if value is None:
        return _row(depth, f"{name} NULL")
    if kind == "SFBool":
        return _row(depth, f"{name} {'TRUE' if value else 'FALSE'}")
    if kind == "SFString":
        return _row(depth, f"{name} {quoted(value)}")
    if kind == "MFString":
        return _row(depth, f"{name} [{' '.join(map(quoted, value))}]")
    if kind in ("SFFloat", "SFInt32"):
        return _row(depth, name, (value,))
    if not kind.startswith("MF"):
        return _row(depth, name, value)
    flat = value if kind == "MFFloat" else [number for row in value for number in row]
    return _row(depth, f"{name} [", flat, " ]") if flat else _row(depth, f"{name} []")


def quoted(text: str) -> str:
    """A text as the language has it. Raises ValueError for one of several lines."""
    if any(ord(letter) < 32 for letter in text):
        raise ValueError(f"{text[:60]!r} has letters that no text of a .wbt may have")
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


# --- a read document as text, with other values in some fields ---

EXACT = 2.0**53
"""Whole numbers up to which doubles have all: fields of whole numbers stand without a point."""
Changes = Mapping[tuple[WbtNode, str], Sequence[ReadingValue]]
"""Values of fields, by node and name."""


def text_of(document: WbtDocument, changes: Changes) -> str:
    """The text of ``document`` with ``changes``, of which no number is rounded. Raises ValueError for a change of a field that
    is not there."""
    for node, name in changes:
        node.field(name)
    return "\n".join([f"#VRML_SIM {document.version} utf8", *_lines(document.nodes, changes), ""])


def _lines(nodes: Sequence[WbtNode], changes: Changes) -> Iterator[str]:
    stack: list[str | WbtNode] = list(reversed(nodes))
    while stack:
        what = stack.pop()
        if isinstance(what, str):
            yield what
            continue
        label = f"DEF {what.label} " if what.label else ""
        inner: list[str | WbtNode] = [f"{label}{what.kind} {{"]
        for item in what.fields:
            inner += _field(item, changes.get((what, item.name), item.values))
        stack += reversed([*inner[1:], "}"])
        yield str(inner[0])


def _field(field: WbtField, values: Sequence[ReadingValue]) -> list[str | WbtNode]:
    nodes = [value for value in values if isinstance(value, WbtNode)]
    words = [field.name, *(_word(value) for value in values if not isinstance(value, WbtNode))]
    if not nodes:
        return [f"{field.name} [ {' '.join(words[1:])} ]" if field.listed else " ".join(words)]
    return [f"{field.name} [", *nodes, "]"] if field.listed else [field.name, *nodes]


def _word(value: ReadingValue) -> str:
    if value is None:
        return "NULL"
    if isinstance(value, bool):
        return "TRUE" if value else "FALSE"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < EXACT else repr(value)
    raise TypeError(f"{value!r} is no value of a field")
