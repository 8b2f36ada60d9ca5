"""Links without weight: plain URDF has none, Gazebo's extension says it."""

from __future__ import annotations

from collections.abc import Container
from typing import Final

from simspec.imports.elements import Element

OFF: Final = {"gravity": ("0", "false"), "turnGravityOff": ("1", "true")}
"""The elements of a <gazebo> that say it, and the texts by which they do."""


def weightless(root: Element, links: Container[str]) -> frozenset[str]:
    """Those of ``links`` on which a <gazebo> says that gravity does not act; the element that says it is taken."""
    named = set()
    for gazebo in root.look("gazebo"):
        name = gazebo.attributes.get("reference", "").strip()
        for child in gazebo.look(*OFF) if name in links else ():
            if child.attributes.get("value", child.text).strip().lower() in OFF[child.tag]:
                child.take()
                child.word("value")
                named.add(name)
    return frozenset(named)
