"""Solver settings of the wrong kind are located errors before anything is written, whatever the engine and the setting."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest

from simspec.cli import main
from simspec.compiler import compile_world
from simspec.engines.kit.registry import engines, find_engine
from simspec.engines.kit.settings import Setting, SettingGroup, check_settings, finer_settings, idle_settings
from simspec.errors import Location, UnsupportedError
from simspec.proof import mutation_worlds
from simspec.world.types import Contact, EngineOptions
from tests import worlds

EVERY = [(name, setting) for name, engine in engines().items() for setting in engine.SETTINGS]
WRONG: list[Any] = [
    *(math.nan, math.inf, -math.inf, -1, -1.0, 0.5, 10**400, -(10**400), 2**31, 1e308, 5e-324),
    *(True, False, "", "Newton", "newton ", "1", "nan", "\x1b[31m", "x" * 100_000, None, (), (1,)),
]


def allowed(setting: Setting, value: Any) -> bool:
    """Whether a value is of the setting's kind and within its bounds, said once more and in another way."""
    kind = type(setting.default)
    if isinstance(value, bool) or kind is bool:
        return isinstance(value, bool) and kind is bool
    if kind is str:
        return isinstance(value, str) and (not setting.choices or value in setting.choices)
    if not isinstance(value, (int,) if kind is int else (int, float)) or not -(2.0**31) < value < 1e309:
        return False
    if isinstance(value, int) and value >= 2**31:
        return False
    low = -math.inf if setting.minimum is None else setting.minimum
    high = math.inf if setting.maximum is None else setting.maximum
    return math.isfinite(value) and low <= value <= high


@pytest.mark.parametrize(("engine", "name"), EVERY)
def test_wrong_values_are_located_errors_before_anything_is_written(engine, name):
    setting = find_engine(engine).SETTINGS[name]
    base = worlds.spheres(2)
    place = Location("spec.yaml", 7, 3)
    refused = 0
    for value in WRONG:
        options = EngineOptions(engine, ((name, value),))
        world = dataclasses.replace(base, engines=(options,))
        if allowed(setting, value):
            alongside = [(setting.needs[0], setting.needs[1][0])] if setting.needs else []
            assert not check_settings(find_engine(engine), [*options.settings, *alongside])
            continue
        with pytest.raises(UnsupportedError) as caught:
            compile_world(world, [engine], lambda path: place)
        assert all(problem.location == place for problem in caught.value.problems)
        assert caught.value.problems[0].path == f"engines.{engine}.settings.{name}"
        assert len(str(caught.value)) < 3000
        refused += 1
    assert refused >= 15


@pytest.mark.parametrize("engine", engines())
def test_all_wrong_settings_are_reported_at_once(engine):
    given = tuple((name, (1,)) for name in find_engine(engine).SETTINGS)
    spheres = worlds.spheres(2)
    bodies = tuple(dataclasses.replace(body, shapes=()) for body in spheres.bodies)  # which no engine refuses
    world = worlds.accepting(dataclasses.replace(spheres, bodies=bodies, contact=Contact()), engine)
    world = worlds.with_options(world, engine, settings=(*given, ("solvr", 1)))
    with pytest.raises(UnsupportedError) as caught:
        compile_world(world, [engine])
    assert len(caught.value.problems) == len(given) + 1


# --- settings without effect under another ------------------------------------------------------------------------

IDLE = [
    (engine, name, other, value)
    for engine, name in EVERY
    if (needs := find_engine(engine).SETTINGS[name].needs)
    for other in [needs[0]]
    for value in find_engine(engine).SETTINGS[other].choices or (True, False)
    if value not in needs[1]
]
SAID = {
    ("dart", "dry_friction_tolerance", "contact_solver", "dantzig"),
    ("dart", "iterations", "contact_solver", "dantzig"),
    ("dart", "tolerance", "contact_solver", "dantzig"),
    ("drake", "dissipation", "contact_approximation", "sap"),
    ("drake", "hydroelastic_modulus", "hydroelastic_faces", False),
    ("drake", "stiction_tolerance", "contact_approximation", "sap"),
    ("mujoco", "friction_cushion", "friction", "coulomb"),
    ("mujoco", "friction_rate", "friction", "coulomb"),
    ("mujoco", "friction_share", "friction", "coulomb"),
    ("mujoco", "island", "sleeping", True),
    ("mujoco", "ls_iterations", "solver", "pgs"),
    ("mujoco", "ls_tolerance", "solver", "pgs"),
    ("mujoco", "sleep_tolerance", "sleeping", False),
    ("ode", "iterations", "solver", "step"),
}


def test_a_dependent_setting_names_the_required_setting_and_its_values():
    assert set(IDLE) == SAID
    for engine, name, other, _ in IDLE:
        settings = find_engine(engine).SETTINGS
        setting = settings[name]
        assert all(not check_settings(find_engine(engine), [(other, value)]) for value in setting.needs[1])
        assert settings[other].needs is None, "a chain of needs would need more than one look"


@pytest.mark.parametrize(("engine", "name", "other", "value"), IDLE)
def test_a_setting_without_effect_under_another_is_a_located_error(engine, name, other, value):
    known = find_engine(engine)
    default, needs = known.SETTINGS[name].default, known.SETTINGS[name].needs
    place = Location("spec.yaml", 7, 3)
    options = EngineOptions(engine, ((name, default), (other, value)), ("contact.cone.elliptic",))
    world = dataclasses.replace(worlds.spheres(2), engines=(options,))
    with pytest.raises(UnsupportedError) as caught:
        compile_world(world, [engine], lambda path: place)
    (problem,) = caught.value.problems
    assert problem.path == f"engines.{engine}.settings.{name}"
    assert problem.location == place
    assert f"has no effect with {other}: {str(value).lower()}" in problem.message
    assert all(str(value).lower() in problem.hint for value in needs[1])
    assert not check_settings(known, [(name, default), (other, needs[1][0])])
    assert not check_settings(known, [(other, value)])


@pytest.mark.parametrize("name", ["friction_cushion", "friction_rate", "friction_share"])
def test_settings_declared_without_effect_have_no_effect(name, monkeypatch):
    """Written without the settings that it needs, it changes only its value in the sidecar; with them it changes the file."""
    known = find_engine("mujoco")
    setting = dataclasses.replace(known.SETTINGS[name], needs=None)
    monkeypatch.setattr(known, "SETTINGS", {**known.SETTINGS, name: setting})

    def model(friction: str, *given: tuple[str, float]) -> str:
        settings = (("friction", friction), *given)
        world = mutation_worlds.WORLDS["choices"]("mujoco")  # a ball on a floor, with friction
        options = dataclasses.replace(world.options("mujoco"), settings=settings)
        return compile_world(dataclasses.replace(world, engines=(options,)), ["mujoco"])["mujoco"].files["model.xml"]

    other = (name, setting.default / 20.0)
    assert model("coulomb", other) == model("coulomb")
    assert model("native", other) != model("native")


def test_the_command_refuses_it_and_names_it(tmp_path, capsys):
    spec = "specs/contact/oblique-impact.yaml"
    given = ["--set", "engines.mujoco.settings={friction: coulomb, friction_rate: 50}"]
    assert main(["compile", spec, "--engine", "mujoco", "--out", str(tmp_path / "out"), *given]) == 2
    said = capsys.readouterr().err
    assert "engines.mujoco.settings.friction_rate" in said
    assert "has no effect with friction: coulomb" in said
    assert not (tmp_path / "out").exists()


def test_defaults_without_effect_are_known_and_no_error():
    settings = {name: setting.default for name, setting in find_engine("mujoco").SETTINGS.items()}
    assert set(idle_settings(find_engine("mujoco"), settings)) == {"sleep_tolerance"}
    assert {"friction_rate", "friction_share", "friction_cushion"} <= set(
        idle_settings(find_engine("mujoco"), {**settings, "friction": "coulomb"})
    )


@pytest.mark.parametrize(("engine", "name"), EVERY)
def test_every_setting_names_its_features_and_its_finer_value_is_valid(engine, name):
    setting = find_engine(engine).SETTINGS[name]
    assert setting.group is not SettingGroup.OTHER
    if setting.finer is not None:
        assert type(setting.finer) is type(setting.default)
        assert allowed(setting, setting.finer)


@pytest.mark.parametrize("engine", engines())
def test_settings_that_are_fine_enough_are_kept(engine):
    kind = find_engine(engine)
    defaults = {name: setting.default for name, setting in kind.SETTINGS.items()}
    finer = finer_settings(kind, defaults)
    assert finer == {
        name: setting.finer
        for name, setting in kind.SETTINGS.items()
        if setting.finer is not None and setting.finer != setting.default
    }
    assert not finer_settings(kind, defaults | finer)
    beyond = {name: value * (10 if value > kind.SETTINGS[name].default else 0.1) for name, value in finer.items()}
    assert not finer_settings(kind, defaults | beyond)
