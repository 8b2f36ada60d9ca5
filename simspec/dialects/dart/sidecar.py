"""The form of a .skel folder's sidecar, and whether its lists fit together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simspec.formats.kit.forms import (
    COMMON,
    ListOf,
    MapOf,
    check_common,
    check_distinct,
    check_fields,
    check_known,
)

RATED = ListOf({"body": str, "value": float})
PAIRS = ListOf(ListOf(str, 2), distinct=True)

FORM: Mapping[str, Any] = {
    **COMMON,
    "models": ListOf(str),
    "shapes": ListOf(
        {
            "name": str,
            "body": str,
            "visual": bool,
            "material": str,
            "surfaces": ListOf({"node": str, "layer": int, "friction": float, "restitution": float}),
        }
    ),
    "enforce_limits": ListOf(str, distinct=True),
    "velocity_limits": RATED,
    "effort_limits": RATED,
    "damping": RATED,
    "armature": RATED,
    "springs": ListOf({"body": str, "stiffness": float, "rest": float}),
    "ignored_groups": PAIRS,
    "groups": MapOf(ListOf(str, distinct=True)),
    "excluded": PAIRS,
    "copies": ListOf({"node": str, "body": str}),
    "filter": {"classes": MapOf(ListOf(str, distinct=True)), "apart": PAIRS, "layers": ListOf(ListOf(object, 3))},
}


def check_sidecar(content: Mapping[str, Any]) -> None:
    """Raise ValueError where a sidecar is not of the form, or its lists do not fit together."""
    check_fields(content, dict(FORM))
    bodies = check_common(content)
    if len(content["models"]) != len(content["bodies"]):
        raise ValueError(f"sidecar.models has {len(content['models'])} entries for {len(content['bodies'])} bodies")
    for name in ("velocity_limits", "effort_limits", "damping", "armature", "springs"):
        check_distinct((entry["body"] for entry in content[name]), f"sidecar.{name}")
        check_known((entry["body"] for entry in content[name]), bodies, f"sidecar.{name}")
    check_known(content["enforce_limits"], bodies, "sidecar.enforce_limits")
    check_known((name for pair in content["excluded"] for name in pair), bodies, "sidecar.excluded")
    check_known((name for held in content["groups"].values() for name in held), bodies, "sidecar.groups")
    _check_used(content["groups"], content["ignored_groups"], "sidecar.groups")
    check_distinct((copy["node"] for copy in content["copies"]), "sidecar.copies")
    check_known((copy["body"] for copy in content["copies"]), bodies, "sidecar.copies")
    check_known((shape["body"] for shape in content["shapes"]), bodies, "sidecar.shapes")
    for index, shape in enumerate(content["shapes"]):
        check_distinct((copy["layer"] for copy in shape["surfaces"]), f"sidecar.shapes.{index}.surfaces")
        if shape["material"] and not shape["surfaces"]:
            raise ValueError(f"sidecar.shapes.{index} has the material {shape['material']!r} and no surface of it")
    _check_filter(content["filter"])


def _check_filter(content: Mapping[str, Any]) -> None:
    classes = content["classes"]
    check_distinct((node for held in classes.values() for node in held), "sidecar.filter.classes")
    _check_used(classes, content["apart"], "sidecar.filter.classes")
    for one, other, layer in content["layers"]:
        if not (isinstance(one, str) and isinstance(other, str) and (layer is None or type(layer) is int)):
            raise ValueError(
                f"sidecar.filter.layers has {[one, other, layer]!r}, should be two materials and a layer or null"
            )
    check_distinct(((one, other) for one, other, _ in content["layers"]), "sidecar.filter.layers")


def _check_used(sets: Mapping[str, Any], pairs: Any, at: str) -> None:
    """Sets of names are there for pairs of them: those that pairs name, and none is empty."""
    used = {name for pair in pairs for name in pair}
    if set(sets) != used or not all(sets.values()):
        raise ValueError(f"{at} has {sorted(sets)}, none of them empty, for pairs of {sorted(used)}")
