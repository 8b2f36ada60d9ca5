"""Cases: the changes of a case, and the inputs of its key."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import resolve_settings
from simspec.runner.execution import run_case
from simspec.runner.run import Case, perturbed_state
from simspec.world.canonical import sha256
from simspec.world.types import EngineOptions, Expectation, Physics, RecordOptions
from tests import worlds

VERSIONS = {"simspec": "1", "engine_version": "2"}
WORLD = dataclasses.replace(worlds.gripper(), engines=())
ENGINE = "mujoco"


def key(**changes) -> str:
    versions = changes.pop("versions", VERSIONS)
    return Case(**{"world": WORLD, "engine": ENGINE, **changes}).key(versions)


def of_world(**changes) -> str:
    return key(world=dataclasses.replace(WORLD, **changes))


@pytest.mark.parametrize(
    "same",
    [
        lambda: of_world(name="another"),
        lambda: of_world(expectations=(Expectation("no_nan"),)),
        lambda: of_world(engines=(EngineOptions("dart", (("solver", "pgs"),)),)),
        lambda: of_world(engines=(EngineOptions(ENGINE),)),
        lambda: key(engine=f"{ENGINE}@9"),
        lambda: key(record=WORLD.record),
        lambda: key(seed=3),
        lambda: key(versions=dict(reversed(VERSIONS.items()))),
    ],
)
def test_fields_without_effect_on_a_run_are_not_in_the_key(same):
    assert same() == key()


@pytest.mark.parametrize(
    "other",
    [
        lambda: of_world(physics=dataclasses.replace(WORLD.physics, timestep=WORLD.physics.timestep / 2)),
        lambda: of_world(bodies=WORLD.bodies[:1]),
        lambda: of_world(engines=(EngineOptions(ENGINE, (("iterations", 7),)),)),
        lambda: of_world(engines=(EngineOptions(ENGINE, (), ("contact.impact_friction",)),)),
        lambda: key(settings=(("iterations", 7),)),
        lambda: key(engine="pybullet"),
        lambda: key(record=RecordOptions(7)),
        lambda: key(perturb=1e-15),
        lambda: key(versions={**VERSIONS, "engine_version": "3"}),
    ],
)
def test_fields_that_change_a_run_change_its_key(other):
    assert other() != key()


def test_keys_of_perturbed_cases_differ_by_seed():
    keys = {key(perturb=1e-15, seed=seed) for seed in (None, 0, 1)}
    assert len(keys) == 3


def test_settings_of_a_case_are_settings_of_the_spec():
    """The key is that of what is at work, not of where it was said."""
    said = dataclasses.replace(WORLD, engines=(EngineOptions(ENGINE, (("iterations", 7),)),))
    case = Case(WORLD, ENGINE, (("iterations", 7),))
    assert case.resolved == said
    assert case.key(VERSIONS) == key(world=said)
    assert resolve_settings(find_engine(ENGINE), case.resolved)["iterations"] == 7
    both = Case(said, ENGINE, (("ls_iterations", 3),)).resolved
    assert dict(both.options(ENGINE).settings) == {"iterations": 7, "ls_iterations": 3}


def test_other_engines_keep_their_options():
    others = (EngineOptions("dart", (("solver", "pgs"),)), EngineOptions("pybullet"))
    case = Case(dataclasses.replace(WORLD, engines=others), ENGINE, (("iterations", 7),))
    assert {options.engine for options in case.resolved.engines} == {"dart", ENGINE, "pybullet"}
    assert case.resolved.options("dart") == others[0]


def test_a_case_without_changes_is_its_world():
    assert Case(WORLD, ENGINE).resolved is WORLD


@pytest.mark.parametrize("seed", [None, 0, 1])
def test_perturbed_states_are_near_and_turns_of_unit_length(seed):
    world = worlds.every_joint()
    array, moved = perturbed_state(world, 0.0), perturbed_state(world, 1e-6, seed)
    for entry, other in zip(array, moved, strict=True):
        assert 0.0 < np.max(np.abs(entry - other)) < 1e-5
    again = perturbed_state(world, 1e-6, seed)
    assert all(np.array_equal(values, other) for values, other in zip(moved, again, strict=True))


def test_a_seed_draws_other_directions():
    first, second = (perturbed_state(worlds.every_joint(), 1e-6, seed)[0] for seed in (0, 1))
    assert not np.array_equal(first, second)


def test_a_case_is_run_as_specified():
    world = dataclasses.replace(worlds.damped_springs(), physics=Physics(timestep=1e-3, steps=4))
    run = run_case(Case(world, ENGINE, (("iterations", 7),), perturb=1e-3, seed=5, record=RecordOptions(2, ("pose",))))
    assert run.provenance["settings"]["iterations"] == 7
    assert run.provenance["seed"] == 5
    assert len(run.time) == 3
    assert "energy" not in run.arrays
    np.testing.assert_array_equal(run.arrays["q"][0], perturbed_state(world, 1e-3, 5)[0])
    unchanged = run_case(Case(world, ENGINE))
    assert unchanged.provenance["case"] != run.provenance["case"]


def test_a_key_is_the_hash_of_all_that_it_is_of():
    """The text of the world is made once and put in its place: nothing else may come after it."""
    options = (EngineOptions(ENGINE, (("iterations", 7),), ("contact.impact_friction",)),)
    case = Case(dataclasses.replace(WORLD, engines=options), ENGINE, perturb=1e-9, seed=4)
    shared = dataclasses.replace(WORLD, name="", expectations=(), engines=())
    settings = dict(resolve_settings(find_engine(ENGINE), case.world))
    given = {
        "schema": 1,
        "world": shared,
        "engine": ENGINE,
        "settings": settings,
        "accept": ["contact.impact_friction"],
    }
    given |= {"outside": [], "perturb": 1e-9, "seed": 4, "versions": VERSIONS}
    assert case.key(VERSIONS) == sha256(given)
