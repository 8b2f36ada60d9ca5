"""Hints for editors in the JSON Schema: keywords of the YAML language server that validators ignore.

``markdownDescription``: meaning, type, unit and default of a field; ``enumDescriptions``: the meaning of each word;
``examples``: values with units; ``defaultSnippets``: common bodies, joints and shapes to start from.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from simspec.language.quantities import DIMENSIONS, Number
from simspec.language.vocabulary import COMBINATIONS, COMBINED_QUANTITIES

_LINK: Final = re.compile(r"\[(\w+)\]\([^)]*\)")
_COMBINED: Final = dict(
    zip(
        COMBINATIONS,
        (
            "the smaller of the two values",
            "the larger of the two values",
            "the product of the two values",
            "the arithmetic mean of the two values",
            "the square root of the product of the two values",
        ),
        strict=True,
    )
)
_HARDNESS: Final = {
    "common": "rigid; the law that all core engines can follow",
    "native": "the default hardness of each engine: depth and bounce are not comparable",
}
_INTEGRATOR: Final = {
    "common": "semi-implicit Euler: engines are compared step by step",
    "engine": "the usual method of each engine: engines are compared with the exact motion, and differ by their methods",
}
_DAMPING: Final = {
    "explicit": "an effort −d v, with the velocity v at the beginning of a step: high damping needs short steps",
    "implicit": "an effort −d v′, with the velocity v′ at the end of a step: stable at every timestep",
}
_INTERPOLATION: Final = {
    "hold": "each value remains until the next point",
    "linear": "straight lines between points",
    "cubic": "cubic polynomials, with continuous velocity",
    "quintic": "polynomials of the fifth degree, with continuous acceleration",
}
_AXIS: Final = {axis: f"the plane {axis} = 0" for axis in "xyz"}
MEANINGS: Final[Mapping[str, Mapping[str, str]]] = {
    **{f"Combine.{name}": _COMBINED for name in COMBINED_QUANTITIES},
    "Combine.restitution_threshold": _COMBINED,
    "Contact.combine": _COMBINED,
    "Contact.hardness": _HARDNESS,
    "Pair.hardness": _HARDNESS,
    "Controller.law": {
        "pd": "efforts kp (q* − q) + kd (v* − v) + feed-forward, computed by simspec for every engine",
        "computed-torque": "efforts by the mass matrix: the error of each joint is a damped oscillation",
        "native": "the engine's actuators, with kp and kd",
    },
    "Mesh.unit": {
        "m": "metre",
        "dm": "decimetre",
        "cm": "centimetre",
        "mm": "millimetre",
        "um": "micrometre",
        "in": "inch, 25.4 mm",
        "ft": "foot, 304.8 mm",
    },
    "Mesh.up": {axis: f"the {axis} axis of the file points upwards" for axis in "xyz"},
    "Mesh.mass_from": {
        "surface": "the solid that the closed surface encloses",
        "hull": "the convex hull of the mesh",
    },
    "Model.mirror": _AXIS,
    "Use.mirror": _AXIS,
    "ModelParameter.dimension": {
        name: f"in {unit}" if (unit := Number(name).unit()) else "without a dimension" for name in DIMENSIONS
    },
    "Motion.interpolation": {name: text for name, text in _INTERPOLATION.items() if name != "hold"},
    "Trajectory.interpolation": _INTERPOLATION,
    "Range.spacing": {
        "linear": "equal differences of neighbours",
        "logarithmic": "equal ratios of neighbours",
    },
    "Physics.integrator": _INTEGRATOR,
    "Physics.damping": _DAMPING,
    "Record.channels": {
        "pose": "position and orientation of each body",
        "velocity": "linear and angular velocity of each body",
        "contacts": "points, depths and forces of contact",
        "energy": "kinetic and potential energy",
    },
    "Sweep.times": {
        "exact": "a time between two steps is an error of that run",
        "round_up": "a time between two steps is the next step; of expectations the next record",
    },
}
"""Meanings of words whose field does not list them in its description, by model and field."""
EXAMPLES: Final[Mapping[str, str]] = {
    "m": "50 mm",
    "kg": "300 g",
    "s": "1 ms",
    "rad": "45 deg",
    "m/s": "0.5 m/s",
    "rad/s": "90 deg/s",
    "kg/m³": "1 g/cm^3",
    "kg/m^3": "1 g/cm^3",
    "N": "10 N",
    "N m": "2 N m",
}
"""A value with another unit for each SI unit."""
_SOLID: Final = {"box": {"size": [0.1, 0.1, 0.1]}, "density": 1000, "material": "MATERIAL"}
SNIPPETS: Final[Mapping[str, Sequence[tuple[str, str, Mapping[str, Any]]]]] = {
    "Body": (
        ("free body", "A body that moves freely", {"pose": {"xyz": [0, 0, 1]}, "shapes": [_SOLID]}),
        (
            "fixed floor",
            "A fixed box with its upper side at z = 0",
            {
                "fixed": True,
                "shapes": [{"box": {"size": [4, 4, 0.2]}, "pose": {"xyz": [0, 0, -0.1]}, "material": "MATERIAL"}],
            },
        ),
        (
            "link with a hinge",
            "A body that turns about an axis of its parent, with limits",
            {
                "parent": "PARENT",
                "joint": {
                    "type": "hinge",
                    "origin": {"xyz": [0, 0, 0.2]},
                    "axis": [0, 1, 0],
                    "limits": {"position": ["-90 deg", "90 deg"]},
                },
                "shapes": [_SOLID],
            },
        ),
        (
            "carriage on a slide",
            "A body that moves along an axis of its parent",
            {"parent": "PARENT", "joint": {"type": "slide", "axis": [1, 0, 0], "damping": 0.1}, "shapes": [_SOLID]},
        ),
    ),
    "Joint": (
        ("hinge", "Turns about an axis", {"type": "hinge", "axis": [0, 0, 1], "damping": 0.01}),
        ("slide", "Moves along an axis", {"type": "slide", "axis": [1, 0, 0], "damping": 0.1}),
        ("ball", "Turns about its origin", {"type": "ball"}),
    ),
    "Shape": (
        ("box", "A box by its edge lengths", _SOLID),
        ("sphere", "A sphere", {"sphere": {"radius": 0.05}, "density": 1000, "material": "MATERIAL"}),
        (
            "cylinder",
            "A cylinder along z",
            {"cylinder": {"radius": 0.05, "length": 0.2}, "density": 1000, "material": "MATERIAL"},
        ),
        (
            "mesh",
            "A mesh file, as its convex hull",
            {"mesh": {"file": "FILE.stl"}, "density": 1000, "material": "MATERIAL"},
        ),
    ),
}
"""Contents of new bodies, joints and shapes, by model: a label, a description and the content."""


def snippets(model: str) -> dict[str, Any]:
    """``defaultSnippets`` of a model."""
    found = SNIPPETS.get(model, ())
    return (
        {"defaultSnippets": [{"label": label, "description": text, "body": body} for label, text, body in found]}
        if found
        else {}
    )


def field_hints(schema: Mapping[str, Any], what: str, unit: str) -> dict[str, Any]:
    """``markdownDescription`` and ``examples`` of a field. ``what``: its type in words."""
    facts = [_LINK.sub(r"\1", what.replace("\\|", "|"))] if what and "enum" not in schema else []
    facts += [f"SI unit: {unit}"] if unit and not unit.startswith("by ") else []
    if schema.get("default", "") not in ("", []):
        facts.append(f"default: {_shown(schema['default'])}")
    text = str(schema.get("description", ""))
    hints: dict[str, Any] = {"markdownDescription": "  \n".join([text, *(f"*{fact}*" for fact in facts)])}
    if unit in EXAMPLES and schema.get("type") == ["number", "string"]:
        hints["examples"] = [EXAMPLES[unit]]
    return hints


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return f"[{', '.join(map(_shown, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def with_word_meanings(schema: Any, place: str, description: str) -> Any:
    """A part of the schema of a field, each list of words with the meaning of each word."""
    if isinstance(schema, list):
        return [with_word_meanings(part, place, description) for part in schema]
    if not isinstance(schema, Mapping):
        return schema
    made = {key: with_word_meanings(value, place, description) for key, value in schema.items()}
    if isinstance(schema.get("enum"), list):
        meanings = word_meanings(schema["enum"], place, description)
        made |= {"enumDescriptions": meanings} if meanings else {}
    return made


def word_meanings(words: Iterable[str], place: str, description: str) -> list[str]:
    """The meaning of each word: from the table, else from a description of the form ``word: meaning; word: meaning``."""
    words = list(words)
    if place in MEANINGS:
        return [MEANINGS[place][word] for word in words]
    found = []
    other = "|".join(map(re.escape, words))
    for word in words:
        part = re.search(rf"(?:^|[;.] )`?{re.escape(word)}`?: (.*?)(?=; `?(?:{other})`?: |$)", description)
        if part is None:
            return []
        found.append(part[1].partition("; not ")[0].rstrip("."))
    return found
