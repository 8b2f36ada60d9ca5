"""The worlds of the complete self-test use whatever compiled files can say."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import pytest

from simspec.engines.kit.registry import engines, find_engine
from simspec.proof import mutation_worlds
from simspec.proof.mutation_worlds import WORLDS
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.world.types import World

NOT_IN_FILES = {
    **dict.fromkeys(("control", "forces", "body.kinematic"), "computed outside the engine, from the request"),
    **dict.fromkeys(("tree.size", "tree.depth"), "how large a tree is"),
    "contact.touch": "which shapes may touch at all, of worlds of any contact",
    "contact.mass-ratio": "how engines solve stacks: of worlds of any masses",
    "contact.friction.carried": "how engines hold what is carried: of worlds of any friction",
    "contact.friction.self-locking": "how engines make a clamp's normal force: of worlds of any friction",
    "contact.pressure": "how engines spread pressure over a face: of worlds of any friction",
    "contact.friction.impact": "how engines compute friction: of worlds of any friction",
    **dict.fromkeys(
        ("material.friction.pairs", "material.restitution.pairs", "contact.hardness.pairs"),
        "values that an engine's rule of combination cannot give: found by the plan of contact (the world “surfaces”)",
    ),
}
UNSAID = {
    "Physics.timestep": "written for any value",
    "Physics.integrator": "selects a setting of each engine, which is in their files",
    "Shape.rounding": "of engines, for a read-back",
    "Shape.drawn": "of pages",
    "Shape.surfaces": "of a read-back",
    **dict.fromkeys(
        ("World.expectations", "World.record", "RecordOptions.every_steps", "RecordOptions.channels"),
        "not of the model",
    ),
    **dict.fromkeys(("World.forces", "World.motions"), "computed outside the engine"),
    **dict.fromkeys(
        (f"JointTrajectory.{name}" for name in ("accelerations", "efforts", "interpolation", "velocities")),
        "computed outside the engine",
    ),
    **dict.fromkeys(
        (
            f"JointController.{name}"
            for name in ("damping_ratio", "discretisation", "every_steps", "gravity_compensation", "natural_frequency")
        ),
        "of laws that are computed outside the engine",
    ),
    **dict.fromkeys(("ConnectConstraint.kind", "FollowConstraint.kind", "WeldConstraint.kind"), "given by the class"),
}


def worlds() -> Iterator[World]:
    for engine in engines():
        for made in WORLDS.values():
            yield made(engine)


def fields_of(value: Any) -> Iterator[tuple[str, bool]]:
    """Each field of a value and of what is in it, and whether it is other than its default."""
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            actual = getattr(value, field.name)
            yield f"{type(value).__name__}.{field.name}", actual != field.default
            yield from fields_of(actual)
    elif isinstance(value, tuple):
        for part in value:
            yield from fields_of(part)


def test_every_feature_is_used():
    used = {need.feature.value for world in worlds() for need in needs(world)}
    missing = {feature.value for feature in Feature} - used
    assert missing == set(NOT_IN_FILES), "a new feature belongs into a world of proof/mutation_worlds.py"


def test_every_field_of_a_world_is_used_with_a_value_that_is_not_its_default():
    found: dict[str, bool] = {}
    for world in worlds():
        for name, other in fields_of(world):
            found[name] = found.get(name, False) or other
    assert {name for name, other in found.items() if not other} == set(UNSAID)


@pytest.mark.parametrize("engine", engines())
def test_other_values_of_settings_are_allowed(engine):
    """A value beyond its bound once made the world of settings one that the engine refuses: it was left out in silence."""
    for name, setting in find_engine(engine).SETTINGS.items():
        value = mutation_worlds._other(setting)
        assert setting.minimum is None or value >= setting.minimum, name
        assert setting.maximum is None or value <= setting.maximum, name
        assert value != setting.default or not mutation_worlds._free(setting), name
