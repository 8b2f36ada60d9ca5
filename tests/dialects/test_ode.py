"""A world is lowered to ODE and raised again: nothing of the model is lost, and the table of laws is the world's."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import target_of
from simspec.dialects.kit.world import LawSidecar
from simspec.dialects.ode import OdeDialect
from simspec.engines.ode.engine import Ode
from simspec.proof.comparator import compare
from simspec.proof.selftest_worlds import WORLDS
from tests import worlds
from tests.planted import SHARED


def lowered(world):
    return OdeDialect().lower(world, target_of(world, Ode))


def failures(world, model):
    checks = compare(world, model, Ode.RULES, Ode.LAYERS, text=True)
    assert len(checks) > 5
    return [(check.name, check.where, check.detail) for check in checks if not check.passed]


@pytest.mark.parametrize("world", [*SHARED.values(), lambda _: worlds.every_joint()])
def test_lower_and_raise_are_inverse(world):
    world = world("ode")
    given = lowered(world)
    assert failures(world, OdeDialect().raise_(given.tree, given.sidecar)) == []


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda laws: laws[1:], "laws of materials"),
        (lambda laws: (laws[0], *laws), "laws of materials"),
        (lambda laws: (dataclasses.replace(laws[0], friction=laws[0].friction + 1e-3), *laws[1:]), "friction"),
        (lambda laws: (dataclasses.replace(laws[0], rolling_friction=1e-3), *laws[1:]), "rolling friction"),
        (lambda laws: (dataclasses.replace(laws[0], restitution_threshold=1e-3), *laws[1:]), "restitution threshold"),
        (lambda laws: (dataclasses.replace(laws[0], collide=False), *laws[1:]), "kind of law"),
        (lambda laws: (dataclasses.replace(laws[0], margin=0.01), *laws[1:]), "kind of law"),
    ],
)
def test_a_table_that_differs_is_seen(change, name):
    world = WORLDS["surfaces"]("ode")
    given = lowered(world)
    model = OdeDialect().raise_(given.tree, given.sidecar)
    assert {found for found, _, _ in failures(world, dataclasses.replace(model, laws=change(model.laws)))} == {name}


def test_a_plan_with_pairs_that_cannot_meet_is_written_whole():
    """As in probes of two materials, of which not all pairs meet."""
    world = WORLDS["surfaces"]("ode")
    names = [body.name for body in world.bodies]
    pairs = tuple((name, other) for name in sorted(names) for other in sorted(names) if name < other)
    separate = dataclasses.replace(world, contact=dataclasses.replace(world.contact, excluded_bodies=pairs))
    lower = OdeDialect().lower(separate, target_of(world, Ode))
    assert lower.sidecar.laws == lowered(world).sidecar.laws
    assert OdeDialect().raise_(lower.tree, lower.sidecar).laws == lower.sidecar.laws


def test_numbers_of_shapes_that_nothing_goes_by_are_refused():
    given = lowered(WORLDS["surfaces"]("ode"))
    body = next(body for body in given.tree.bodies if body.shapes)
    copy = dataclasses.replace(body.shapes[0].copies[0], friction=0.5)
    shape = dataclasses.replace(body.shapes[0], copies=(copy,))
    bodies = tuple(
        dataclasses.replace(entry, shapes=(shape,)) if entry is body else entry for entry in given.tree.bodies
    )
    with pytest.raises(ValueError, match="has numbers in addition"):
        OdeDialect().raise_(dataclasses.replace(given.tree, bodies=bodies), given.sidecar)


def test_laws_are_those_of_the_materials_that_meet():
    given = lowered(WORLDS["surfaces"]("ode"))
    with pytest.raises(ValueError, match=r"not those of sidecar\.laws"):
        OdeDialect().raise_(given.tree, dataclasses.replace(given.sidecar, laws=given.sidecar.laws[1:]))
    content = given.sidecar.plain()
    content["laws"][0] |= {"first": content["laws"][0]["second"] + "z"}
    with pytest.raises(ValueError, match="not sorted"):
        LawSidecar.of(content)
