"""The worlds of the self-test that stand in for another where an engine refuses that one: with fewer joints, or none."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

from simspec.dialects.kit.defects import NAMES
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.proof.selftest_worlds import FRICTION, WORLDS, immersed, lifted, model
from simspec.world.types import Body, EngineOptions, Joint, World


def _freed(body: Body, row: int) -> Body:
    """A body on a hinge or slide as a free one; others as they are."""
    if body.joint.kind not in SCALAR_JOINTS:
        return body
    at = (0.1 * row, -0.5, 0.9, 0.8, 0.0, 0.6, 0.0)
    free = Joint(body.joint.name, "free", position=at, velocity=(0.1, 0.2, 0.0, 0.3, -0.2, 0.1))
    return dataclasses.replace(body, joint=free)


def without_joints(make: Callable[[str], World], name: str) -> Callable[[str], World]:
    """What is left of a world for an engine without joints: its bodies, free, with all that is theirs."""

    def made(engine: str) -> World:
        whole = make(engine)
        bodies = tuple(_freed(body, row) for row, body in enumerate(whole.bodies))
        # without joints bodies rub against each other
        options = EngineOptions(engine, accept=("contact.cone.elliptic", *FRICTION, "shape.box"))
        return dataclasses.replace(whole, name=name, bodies=bodies, engines=(options,))

    return made


loose = without_joints(model, "self-test-loose")

EVERY: Mapping[str, Callable[[str], World]] = {
    **WORLDS,
    "loose": loose,
    "loose and lifted": without_joints(lifted, "self-test-loose-lifted"),
    "loose and immersed": without_joints(immersed, "self-test-loose-immersed"),
}
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


def _planted_into(world: str) -> frozenset[str]:
    return frozenset(defect for defect, name in NAMES.items() if name == world)


SMALLER: Mapping[str, tuple[str, frozenset[str]]] = {
    "model": ("core", frozenset((*_OF_BODIES, *_OF_JOINTS))),
    "core": ("loose", frozenset((*_OF_BODIES, *_OF_SHAPES))),
    "lifted": ("loose and lifted", _planted_into("lifted")),
    "immersed": ("loose and immersed", _planted_into("immersed")),
}
"""The world that takes another's place where an engine refuses that one, and the defects that it can hold."""
