"""Defaults that follow from a world without friction, and what they must leave alone."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import pytest

from simspec.compiler import compile_world
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.engines.kit.registry import engines, find_engine
from simspec.engines.kit.settings import check_settings, default_settings, resolve_settings
from simspec.errors import UnsupportedError
from simspec.report.matrix import engine_data
from simspec.world.contact_pairs import frictionless, only_free_spheres
from simspec.world.types import Body, EngineOptions, Inertial, Joint, PairContact, World
from tests import worlds

SLICK = {
    "mujoco": {"solver": "pgs", "tolerance": 1e-10},
    "pybullet": {"iterations": 50, "residual_threshold": 1e-7, "contact_breaking_threshold": 0.002},
    "dart": {"contact_solver": "dantzig"},
}
"""Values in the files of balls without friction that differ from the ordinary defaults."""


def without_friction(world: World) -> World:
    pairs = tuple(dataclasses.replace(pair, friction=0.0) for pair in world.contact.pairs)
    return dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))


def with_friction(world: World) -> World:
    pairs = tuple(dataclasses.replace(pair, friction=0.3) for pair in world.contact.pairs)
    return dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))


def stating(world: World, engine: str, *settings: tuple[str, Any]) -> World:
    accept = ("contact.cone.elliptic", "contact.friction.impact")
    return dataclasses.replace(world, engines=(EngineOptions(engine, settings, accept),))


def written(world: World, engine: str) -> dict[str, Any]:
    settings: dict[str, Any] = json.loads(compile_world(world, [engine])[engine].files[SIDECAR])["settings"]
    return settings


SLIPPERY = without_friction(worlds.spheres(3))
ROUGH = with_friction(SLIPPERY)


def test_which_worlds_are_without_friction():
    assert (frictionless(SLIPPERY), only_free_spheres(SLIPPERY)) == (True, True)
    assert (frictionless(ROUGH), only_free_spheres(ROUGH)) == (False, False)
    single_pair = (*SLIPPERY.contact.pairs, PairContact("moss", "moss", 0.1, 0.0))
    assert not frictionless(
        dataclasses.replace(SLIPPERY, contact=dataclasses.replace(SLIPPERY.contact, pairs=single_pair))
    )
    nothing_meets = dataclasses.replace(SLIPPERY, contact=dataclasses.replace(SLIPPERY.contact, pairs=()))
    assert not frictionless(nothing_meets)


def test_other_bodies_than_free_balls_keep_the_ordinary_defaults():
    moving = next(body for body in SLIPPERY.bodies if body.joint.kind == "free")
    oblong = dataclasses.replace(moving.shapes[0], kind="box", size=(0.2, 0.1, 0.1))
    changed = {
        "a box": dataclasses.replace(moving, shapes=(oblong,)),
        "a hinge": dataclasses.replace(moving, joint=dataclasses.replace(moving.joint, kind="hinge", parent=None)),
    }
    for name, body in changed.items():
        bodies = tuple(body if old is moving else old for old in SLIPPERY.bodies)
        world = dataclasses.replace(SLIPPERY, bodies=bodies)
        assert (frictionless(world), only_free_spheres(world)) == (True, False), name


def test_visual_and_fixed_shapes_may_be_of_any_kind():
    moving = next(body for body in SLIPPERY.bodies if body.joint.kind == "free")
    label = dataclasses.replace(moving.shapes[0], name="label", kind="box", size=(0.1, 0.1, 0.1), collision=False)
    marked = dataclasses.replace(moving, shapes=(*moving.shapes, label))
    world = dataclasses.replace(SLIPPERY, bodies=tuple(marked if old is moving else old for old in SLIPPERY.bodies))
    assert only_free_spheres(world)
    assert any(shape.kind != "sphere" for body in SLIPPERY.bodies for shape in body.shapes), "the floor"


def test_a_ball_that_carries_another_is_not_alone():
    moving = next(body for body in SLIPPERY.bodies if body.joint.kind == "free")
    joint = Joint("carried_joint", "hinge", moving.name, axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    carried = Body("carried", moving.model, Inertial(1.0, inertia=moving.inertial.inertia), joint)
    assert not only_free_spheres(dataclasses.replace(SLIPPERY, bodies=(*SLIPPERY.bodies, carried)))


@pytest.mark.parametrize("engine", SLICK)
def test_balls_without_friction_have_the_faster_settings(engine):
    slick, rough = (written(stating(world, engine), engine) for world in (SLIPPERY, ROUGH))
    assert {name: value for name, value in slick.items() if rough[name] != value} == SLICK[engine]
    defaults = {name: setting.default for name, setting in find_engine(engine).SETTINGS.items()}
    assert resolve_settings(find_engine(engine), ROUGH) == defaults


@pytest.mark.parametrize("engine", SLICK)
def test_settings_stated_in_a_spec_are_kept(engine):
    for name, value in SLICK[engine].items():
        ordinary = written(stating(ROUGH, engine), engine)[name]
        assert ordinary != value
        world = stating(SLIPPERY, engine, (name, ordinary))
        assert written(world, engine)[name] == ordinary


def test_a_stated_setting_keeps_its_requirements():
    """The line search is Newton's: a spec with its iterations gets Newton, and a spec with PGS and them is rejected."""
    mujoco = find_engine("mujoco")
    world = stating(SLIPPERY, "mujoco", ("ls_iterations", 20))
    assert resolve_settings(mujoco, world)["solver"] == "newton"
    assert written(world, "mujoco")["solver"] == "newton"
    other = stating(SLIPPERY, "mujoco", ("warmstart", False))
    assert resolve_settings(mujoco, other)["solver"] == "pgs"


def test_a_stated_law_of_friction_keeps_the_solver_that_it_needs():
    """PGS does not converge to Coulomb's law; MuJoCo's own friction, stated, changes nothing."""
    mujoco = find_engine("mujoco")
    settings = {
        law: resolve_settings(mujoco, stating(SLIPPERY, "mujoco", ("friction", law))) for law in ("coulomb", "native")
    }
    assert {law: setting["solver"] for law, setting in settings.items()} == {"coulomb": "newton", "native": "pgs"}
    assert {setting["tolerance"] for setting in settings.values()} == {1e-10}
    assert written(stating(SLIPPERY, "mujoco", ("friction", "coulomb")), "mujoco")["solver"] == "newton"


CONES = {"pybullet": (), "dart": (("contact_solver", "dantzig"),)}
"""Settings with which the engine has the elliptic cone approximately, where anything but balls has friction."""


@pytest.mark.parametrize("engine", CONES)
def test_without_friction_no_cone_is_an_approximation(engine):
    rough, slick = (
        dataclasses.replace(worlds.table({("a", "a"): friction}), engines=(EngineOptions(engine, CONES[engine]),))
        for friction in (0.3, 0.0)
    )
    assert compile_world(slick, [engine])
    with pytest.raises(UnsupportedError, match=r"contact\.cone\.elliptic only approximately"):
        compile_world(rough, [engine])


def test_the_defaults_are_listed_for_programs():
    listed = {name: data["settings"] for name, data in engine_data().items()}
    given = {
        engine: {name: entry["frictionless"] for name, entry in settings.items() if "frictionless" in entry}
        for engine, settings in listed.items()
    }
    chosen = {"dart"}  # auto: the chosen value is not a separate default
    assert {engine: given[engine] for engine in SLICK} == {
        engine: {} if engine in chosen else values for engine, values in SLICK.items()
    }
    conditions = [entry["frictionless_unless"] for entry in listed["mujoco"].values() if "frictionless_unless" in entry]
    assert conditions == [{"friction": "coulomb"}] == [listed["mujoco"]["solver"]["frictionless_unless"]]
    by_pair = {engine: [name for name in settings if settings[name]["by_pair"]] for engine, settings in listed.items()}
    for engine in ("mujoco", "mjx", "mjwarp"):  # of one dialect
        assert "contact_impedance" in by_pair.pop(engine)
    assert not any(by_pair.values())
    json.dumps(listed)


@pytest.mark.parametrize("engine", engines())
def test_frictionless_defaults_are_of_the_setting_s_kind_and_range(engine):
    known = find_engine(engine)
    for name, setting in known.SETTINGS.items():
        if setting.frictionless is not None:
            assert setting.frictionless != setting.default
            assert check_settings(known, [(name, setting.frictionless)]) == []
    assert default_settings(known, {"no_such_setting": 1}, True).keys() == known.SETTINGS.keys()
