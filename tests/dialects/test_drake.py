"""A world is lowered to Drake and raised again: nothing of the model is lost."""

from __future__ import annotations

import dataclasses
import re

import pytest

from simspec.compiler import target_of
from simspec.dialects.drake import DrakeDialect
from simspec.engines.drake.engine import Drake
from simspec.formats.world import JsonWorld
from simspec.proof.comparator import compare
from simspec.proof.selftest_worlds import WORLDS
from simspec.world.types import Inertial, World
from tests import worlds
from tests.planted import SHARED


def lowered(world: World):
    return DrakeDialect().lower(world, target_of(world, Drake))


@pytest.mark.parametrize("world", [*SHARED.values(), lambda _: worlds.every_joint()])
def test_lower_and_raise_are_inverse(world):
    world = world("drake")
    given = lowered(world)
    model = DrakeDialect().raise_(given.tree, given.sidecar)
    checks = compare(world, model, Drake.RULES, Drake.LAYERS, text=True)
    assert len(checks) > 5
    assert [(check.name, check.where, check.detail) for check in checks if not check.passed] == []


def test_free_roots_stand_at_their_centres_of_mass():
    given = lowered(WORLDS["model"]("drake"))
    moved = given.sidecar.offsets
    assert moved
    for body in given.tree.bodies:
        if body.name in moved:
            assert body.joint.kind == "free"
            assert body.centre_of_mass == (0.0, 0.0, 0.0)


def _offset(document: JsonWorld, sidecar):
    first = dataclasses.replace(sidecar.bodies[0], frame_offset=(0.1, 0.0, 0.0))
    return document, dataclasses.replace(sidecar, bodies=(first, *sidecar.bodies[1:]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda document, sidecar: (document, dataclasses.replace(sidecar, bodies=sidecar.bodies[1:])), "names"),
        (lambda document, sidecar: (dataclasses.replace(document, friction_cone="pyramid-inscribed"), sidecar), "cone"),
    ],
)
def test_a_document_and_a_sidecar_of_different_worlds_are_rejected(change, said):
    given = lowered(WORLDS["surfaces"]("drake"))
    with pytest.raises(ValueError, match=said):
        DrakeDialect().raise_(*change(given.tree, given.sidecar))


def test_frames_of_free_roots_alone_are_moved():
    given = lowered(WORLDS["surfaces"]("drake"))
    assert given.sidecar.bodies[0].kind == "fixed"
    _, sidecar = _offset(given.tree, given.sidecar)
    with pytest.raises(ValueError, match=re.escape("which is not a free root")):
        type(sidecar).of(sidecar.plain())


def test_a_plan_that_lacks_a_number_is_an_error():
    world = WORLDS["surfaces"]("drake")
    target = target_of(world, Drake)
    key, numbers = next(iter(target.plan.numbers.items()))
    plan = dataclasses.replace(
        target.plan, numbers={**target.plan.numbers, key: dataclasses.replace(numbers, friction=None)}
    )
    with pytest.raises(ValueError, match="lacks the friction"):
        DrakeDialect().lower(world, dataclasses.replace(target, plan=plan))


def test_a_fixed_massless_body_has_no_moments():
    """Drake refuses moments without mass; a spec may write them on what is fixed to the world."""
    world = WORLDS["model"]("drake")
    floor = dataclasses.replace(
        world.bodies[0], inertial=Inertial(0.0, (0.1, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    )
    body = lowered(dataclasses.replace(world, bodies=(floor, *world.bodies[1:]))).tree.bodies[0]
    assert floor.joint.kind == "fixed"
    assert (body.mass, body.centre_of_mass, body.inertia) == (0.0, (0.0,) * 3, (0.0,) * 6)
