"""The worlds of the self-test that stand in for another where an engine refuses that one: with fewer joints, or none."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.proof.selftest_worlds import WORLDS, model
from simspec.world.types import Body, EngineOptions, Joint, World


def loose(engine: str) -> World:
    """What is left of :func:`model` for an engine without joints: its bodies, free, with their shapes and filters."""

    def freed(body: Body, row: int) -> Body:
        if body.joint.kind not in SCALAR_JOINTS:
            return body
        at = (0.1 * row, -0.5, 0.9, 0.8, 0.0, 0.6, 0.0)
        free = Joint(body.joint.name, "free", position=at, velocity=(0.1, 0.2, 0.0, 0.3, -0.2, 0.1))
        return dataclasses.replace(body, joint=free)

    whole = model(engine)
    bodies = tuple(freed(body, row) for row, body in enumerate(whole.bodies))
    return dataclasses.replace(whole, name="self-test-loose", bodies=bodies, engines=(EngineOptions(engine),))


EVERY: Mapping[str, Callable[[str], World]] = {**WORLDS, "loose": loose}
"""Those of the self-test by name, and what stands in for them alone."""
_OF_BODIES = (
    *("mass", "centre of mass", "inertia, diagonal", "inertia, sign of a product", "body dropped"),
    *("initial position", "initial velocity", "gravity", "timestep"),
)
_OF_JOINTS = ("joint type", "axis", "axis reversed", "joint origin, position", "joint origin, orientation")
_OF_SHAPES = (
    *("shape type", "shape size", "shape position", "shape orientation", "shape not solid"),
    *("excluded pair dropped", "excluded pair too many", "collision group", "group filter dropped"),
)
SMALLER: Mapping[str, tuple[str, frozenset[str]]] = {
    "model": ("core", frozenset((*_OF_BODIES, *_OF_JOINTS))),
    "core": ("loose", frozenset((*_OF_BODIES, *_OF_SHAPES))),
}
"""The world that takes another's place where an engine refuses that one, and the defects that it can hold."""
