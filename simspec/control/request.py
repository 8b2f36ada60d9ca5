"""What a law at work needs of a world, as plain data and arrays, to cross into the engine's process and back out there."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from simspec.control.forces import forces_to_request
from simspec.control.law import Control
from simspec.control.motions import motions_to_request
from simspec.control.reference import Piecewise, Reference, reference
from simspec.world.canonical import from_plain, to_plain
from simspec.world.types import Contact, Record, World

PREFIX = "control."


def to_request(world: World) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Parameters (JSON) and arrays that :func:`from_request`, ``forces_from_request`` and ``motions_from_request`` read;
    empty when the world has no controllers, no forces and no kinematic bodies.

    The polynomials are made here, so that the engine's environment needs no library for them, and all engines have the same.
    """
    forces, (motions, arrays) = forces_to_request(world), motions_to_request(world)
    given = {**forces, **motions}
    if not world.controllers:
        return given, arrays
    bare = dataclasses.replace(
        world, contact=Contact(), record=Record(), expectations=(), engines=(), trajectory=None, forces=(), motions=()
    )
    targets = reference(world)
    for name, part in (("position", targets.position), ("effort", targets.effort)):
        for field in dataclasses.fields(Piecewise):
            arrays[f"{PREFIX}{name}.{field.name}"] = getattr(part, field.name)
    return {**given, "control": {"world": to_plain(bare), "joints": list(targets.joints)}}, arrays


def from_request(parameters: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Control | None:
    """The control that a request asks for; None when it asks for none. Raises ControlError."""
    content = parameters.get("control")
    if content is None:
        return None
    parts = [
        Piecewise(*(arrays[f"{PREFIX}{name}.{field.name}"] for field in dataclasses.fields(Piecewise)))
        for name in ("position", "effort")
    ]
    return Control(from_plain(World, content["world"]), Reference(tuple(content["joints"]), *parts))
