"""Bounds of solver settings that follow from a world, and warnings of depths of contact relative to its smallest shape."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

import simspec
from simspec.compiler import compile_world
from simspec.engines.kit.registry import engines
from simspec.engines.kit.settings import of_mobility, of_thinnest, under_weight
from simspec.errors import EXIT_WRONG, SpecError
from simspec.option_checks import check_options, deep_contact
from simspec.world.contact_pairs import heaviest, thinnest
from simspec.world.types import World

SPEC = """
simspec: 1
name: cubes
physics: {{timestep: 2 ms, duration: 1 s}}
contact: {{materials: {{stone: {{friction: 0.5}}}}}}
bodies:
  ground: {{fixed: true, shapes: [{{plane: {{}}}}]}}
  cube:
    mass: 4
    pose: {{xyz: [0, 0, 1]}}
    shapes: [{{box: {{size: [{edge}, {edge}, {edge}]}}}}]
  light:
    mass: 1
    pose: {{xyz: [5, 0, 1]}}
    shapes: [{{sphere: {{radius: 0.5}}}}]
engines: {{{engines}}}
"""


def loaded(tmp_path: Path, edge: float = 0.1, engine: str = "", **settings: object) -> simspec.Spec:
    text = ", ".join(f"{name}: {str(value).lower()}" for name, value in settings.items())
    path = tmp_path / "spec.yaml"
    path.write_text(SPEC.format(edge=edge, engines=f"{engine}: {{settings: {{{text}}}}}" if engine else ""))
    return simspec.load(path)


def test_bounds_follow_from_the_smallest_shape_and_the_heaviest_body(tmp_path):
    world = loaded(tmp_path).resolve()
    assert (least := thinnest(world)) is not None
    assert (least.body, least.inner) == ("cube", 0.05)
    assert heaviest(world) == ("cube", 4.0)
    assert (limit := of_thinnest(0.1)(world)) is not None
    assert limit.value == pytest.approx(0.005)
    assert (limit := of_mobility(world)) is not None
    assert limit.value == pytest.approx(0.002 / 4.0)
    assert (limit := under_weight(world)) is not None
    assert limit.value == pytest.approx(4.0 * 9.81 / 0.005, rel=1e-3)


def test_a_world_without_shapes_or_weight_bounds_nothing(tmp_path):
    world = loaded(tmp_path).resolve()
    bare = dataclasses.replace(world, bodies=tuple(dataclasses.replace(body, shapes=()) for body in world.bodies))
    assert of_thinnest(0.1)(bare) is of_mobility(bare) is under_weight(bare) is None


@pytest.mark.parametrize(
    ("engine", "setting", "allowed", "refused"),
    [
        ("pybullet", "collision_margin", 0.0249, 0.0251),
        ("pybullet", "collision_margin", 0.001, 1e6),
        ("pybullet", "contact_slop", 0.0049, 0.0051),
        ("mujoco", "friction_cushion", 0.0249, 0.0251),
        ("mujoco", "ccd_tolerance", 0.0049, 0.0051),
        ("ode", "softness", 4.9e-4, 5.1e-4),
        ("ode", "softness", 1e-10, 1e6),
        ("webots", "softness", 4.9e-4, 5.1e-4),
        ("drake", "stiffness", 7900.0, 7800.0),
    ],
)
def test_a_setting_beyond_its_bound_is_an_error_with_its_place(tmp_path, engine, setting, allowed, refused):
    spec = loaded(tmp_path, engine=engine, **{setting: allowed})
    assert check_options(spec.resolve(), spec.locate) == []
    spec = loaded(tmp_path, engine=engine, **{setting: refused})
    (problem,) = check_options(spec.resolve(), spec.locate)
    assert setting in problem.message
    assert "in this world" in (problem.allowed or "")
    assert str(problem.location).startswith(f"{tmp_path}/spec.yaml:16:")
    with pytest.raises(SpecError) as error:
        compile_world(spec.resolve(), [engine], spec.locate)
    assert error.value.exit_code == EXIT_WRONG


def test_a_bound_holds_for_pairs_of_materials(tmp_path):
    spec = loaded(tmp_path, engine="mujoco", friction_cushion=1e-4)
    text = (tmp_path / "spec.yaml").read_text()
    pairs = "pairs: [{between: [stone, stone], settings: {friction_cushion: 0.03}}]"
    (tmp_path / "spec.yaml").write_text(text.replace("settings: {friction_cushion: 0.0001}", pairs))
    spec = simspec.load(tmp_path / "spec.yaml")
    (problem,) = check_options(spec.resolve(), spec.locate)
    assert "'friction_cushion' is too large" in problem.message


BOUNDLESS = {"iterations", "ls_iterations", "noslip_iterations", "explicit_pairs_limit", "contact_points"}
"""Counts, of which more cost time."""
WITHOUT_EFFECT = {"impratio", "high_impratio", "friction_rate"}
"""Beyond 1e6 and one over the timestep nothing changes any more (measured to 1e9)."""
SOFTER = {"hydroelastic_modulus", "joint_softness"}
"""To be bounded: the values at which they break a world were not measured."""


def test_every_number_has_an_upper_bound_or_a_reason_to_have_none():
    for name, engine in engines().items():
        for key, setting in engine.SETTINGS.items():
            if isinstance(setting.default, (bool, str)) or key in BOUNDLESS | WITHOUT_EFFECT | SOFTER:
                continue
            assert setting.maximum is not None or setting.at_most is not None, f"{name}.{key}"


def test_defaults_are_within_the_bounds_of_the_library():
    for path in sorted((Path(__file__).resolve().parents[2] / "specs").glob("*.yaml")):
        world: World = simspec.load(path).resolve()
        for name, engine in engines().items():
            for key, setting in engine.SETTINGS.items():
                for bound, sign in ((setting.at_most, 1.0), (setting.at_least, -1.0)):
                    limit = bound(world) if bound is not None else None
                    if limit is not None and isinstance(setting.default, float):
                        assert sign * setting.default <= sign * limit.value, f"{path.name}: {name}.{key}"


def test_a_margin_too_large_for_a_small_shape_causes_a_warning(tmp_path):
    spec = loaded(tmp_path, 0.01)
    assert deep_contact(spec, spec.resolve()) == []
    spec = loaded(tmp_path, 0.001)
    (problem,) = deep_contact(spec, spec.resolve())
    assert "friction_cushion" in problem.message
    assert "mujoco" in problem.message
    assert problem.found == "20%"
    assert str(problem.location).startswith(f"{tmp_path}/spec.yaml:11:")
    assert (problem.hint or "").startswith("friction_cushion: 5e-05 in ")
    assert "engines.mujoco.settings" in (problem.hint or "")
    spec = loaded(tmp_path, 0.001, engine="mujoco", friction="coulomb")
    assert not any(
        "mujoco," in problem.message or "mujoco by" in problem.message for problem in deep_contact(spec, spec.resolve())
    )
    spec = loaded(tmp_path, 0.1, engine="pybullet", collision_margin=0.01)
    (problem,) = deep_contact(spec, spec.resolve())
    assert "in pybullet, by the setting collision_margin" in problem.message


@pytest.mark.parametrize("name", engines())
def test_the_package_of_an_engine_states_the_depths_of_its_settings(name):
    """Largest default of each setting that is a depth, in any kind of world; a check of a spec relies on it."""
    stated = engines().stated(name, "DEPTHS")
    settings = {key: setting for key, setting in engines()[name].SETTINGS.items() if setting.depth}
    assert stated.keys() == settings.keys()
    for key, setting in settings.items():
        others = (setting.frictionless, setting.kinematic, setting.light)
        assert stated[key] == max(value for value in (setting.default, *others) if value is not None)
