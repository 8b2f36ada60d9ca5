"""The law in files: probe worlds get the values read, the worst shape counts, and invalid values are rejected by name."""

from __future__ import annotations

import dataclasses
import math
from xml.etree import ElementTree

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.contact import contact_plan
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.kit.registry import find_engine
from simspec.errors import UnsupportedError
from simspec.proof.contact import worlds as module
from simspec.proof.contact.worlds import law_of_files, of_pair
from simspec.proof.selftest_worlds import WORLDS
from simspec.world.contact_pairs import meeting_laws
from simspec.world.types import Hardness, PairContact
from tests import worlds
from tests.declared import TOUCHING

ENGINES = TOUCHING
PAIRS = {("ice", "ice"): 0.1, ("ice", "rubber"): 0.3, ("rubber", "rubber"): 0.2}
"""A table that no combination rule gives."""


def written(world, engine, folder):
    """The artifacts of ``world``."""
    write_folder(compile_world(worlds.accepting(world, engine), [engine])[engine].files, folder)
    return folder


def law(found, first, second):
    """The law of two materials as probe worlds get it: the numbers combined, or the explicit pair."""
    return next(pair for pair in found.contact.pairs if (pair.first, pair.second) == (first, second))


@pytest.mark.parametrize("engine", ENGINES)
def test_sound_files_hold_the_world(engine, tmp_path):
    world = worlds.table(PAIRS)
    kind = find_engine(engine)
    found = law_of_files(world, kind, written(world, engine, tmp_path / engine))
    plan = contact_plan(world, kind.RULES, kind.LAYERS)
    assert found.contact == world.contact
    assert found.timestep == world.physics.timestep
    idle = {name for name, setting in kind.SETTINGS.items() if setting.needs is not None}
    settings = read_sidecar(tmp_path / engine)["settings"]
    assert dict(found.options.settings).items() <= settings.items()
    assert settings.keys() - dict(found.options.settings).keys() <= idle, "settings without effect are omitted"
    assert found.plan.layer_of == plan.layer_of
    assert found.plan.missed == plan.missed
    for key, surface in plan.numbers.items():
        assert found.plan.numbers[key].friction == pytest.approx(surface.friction, rel=1e-12)
    assert set(found.plan.explicit) <= set(meeting_laws(world))
    assert set(plan.missed) <= set(found.plan.explicit)


@pytest.mark.parametrize("engine", ENGINES)
def test_files_of_another_law_are_measured(engine, tmp_path):
    world = worlds.table(PAIRS)
    other = worlds.table({**PAIRS, ("rubber", "rubber"): 0.15})
    kind = find_engine(engine)
    found = law_of_files(world, kind, written(other, engine, tmp_path / engine))
    plan, real = ((contact_plan(entry, kind.RULES, kind.LAYERS)) for entry in (world, other))
    changed = {key for key in plan.numbers if plan.numbers[key].friction != real.numbers[key].friction}
    assert bool(changed) is (kind.RULES.friction != "table")
    for key in changed:
        assert found.plan.numbers[key].friction == pytest.approx(real.numbers[key].friction, rel=1e-12)
    if not changed or ("rubber", "rubber") in found.plan.explicit:
        assert law(found, "rubber", "rubber").friction == pytest.approx(0.15)


class Stub:
    """A format with a given result of its reader."""

    def __init__(self, read):
        self._read = read

    def read(self, folder):
        return self._read


def stored_after(monkeypatch, world, engine, folder, change):
    """The stored law when the read-back of the files is changed by ``change``."""
    kind = find_engine(engine)
    files = written(world, engine, folder)
    said = change(dialects()[kind.DIALECT].read(files))
    monkeypatch.setattr(module, "dialects", lambda: {kind.DIALECT: Stub(said)})
    return law_of_files(world, kind, files)


def with_surface(read, name, **values):
    """The read-back with other numbers in all copies of one shape."""
    return dataclasses.replace(
        read,
        bodies=tuple(
            dataclasses.replace(
                body,
                shapes=tuple(
                    dataclasses.replace(
                        shape, surfaces=tuple(dataclasses.replace(surface, **values) for surface in shape.surfaces)
                    )
                    if body.name == name
                    else shape
                    for shape in body.shapes
                ),
            )
            for body in read.bodies
        ),
    )


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("body", ["sphere_0", "sphere_3"])
def test_a_single_wrong_shape_is_found_among_others(engine, body, tmp_path, monkeypatch):
    world = worlds.spheres(4)
    names = [body.name for body in world.bodies if body.joint.kind == "free"]
    wrong = names[0] if body == "sphere_0" else names[-1]
    found = stored_after(
        monkeypatch, world, engine, tmp_path / engine, lambda read: with_surface(read, wrong, friction=3.0)
    )
    material = next(body for body in world.bodies if body.name == wrong).shapes[0].material
    assert {surface.friction for (name, _), surface in found.plan.numbers.items() if name == material} == {3.0}


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("quantity", ["friction", "restitution"])
@pytest.mark.parametrize("engine", ENGINES)
def test_numbers_that_are_none_are_refused_by_name(engine, quantity, value, tmp_path, monkeypatch):
    world = worlds.spheres(2)
    moving = next(body for body in world.bodies if body.joint.kind == "free")
    with pytest.raises(UnsupportedError) as caught:
        stored_after(
            monkeypatch,
            world,
            engine,
            tmp_path / engine,
            lambda read: with_surface(read, moving.name, **{quantity: value}),
        )
    assert f"impossible {quantity} of {moving.shapes[0].material}" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"timestep": math.nan}, "impossible timestep"),
        ({"timestep": 0.0}, "impossible timestep"),
        ({"friction_cone": "round"}, "unknown friction cone"),
    ],
)
def test_a_world_that_cannot_be_is_refused_by_name(change, words, tmp_path, monkeypatch):
    engine = ENGINES[0]
    with pytest.raises(UnsupportedError, match=words):
        stored_after(
            monkeypatch,
            worlds.spheres(2),
            engine,
            tmp_path / engine,
            lambda read: dataclasses.replace(read, **change, unreadable={}),
        )


def test_the_timestep_of_the_files_counts(tmp_path, monkeypatch):
    engine = ENGINES[0]
    found = stored_after(
        monkeypatch,
        worlds.spheres(2),
        engine,
        tmp_path / engine,
        lambda read: dataclasses.replace(read, timestep=0.004, unreadable={}),
    )
    assert found.timestep == 0.004


def test_an_explicit_pair_that_is_missing_is_not_put_back(tmp_path, monkeypatch):
    """Then it is the shapes' numbers that act, and these are measured."""
    world = worlds.table(PAIRS)
    whole = law_of_files(world, find_engine("mujoco"), written(world, "mujoco", tmp_path / "whole"))
    assert ("ice", "rubber") in whole.plan.explicit

    def drop(read):
        material = {shape.name: shape.material for body in world.bodies for shape in body.shapes}
        mixed = [pair for pair in read.pairs if {material[pair.first], material[pair.second]} == {"ice", "rubber"}]
        return dataclasses.replace(read, pairs=tuple(pair for pair in read.pairs if pair != mixed[-1]))

    found = stored_after(monkeypatch, world, "mujoco", tmp_path / "one less", drop)
    assert set(whole.plan.explicit) - set(found.plan.explicit) == {("ice", "rubber")}


def pairs_in_probe(world, folder):
    """Explicit pairs in a MuJoCo world that is compiled as probes are, and its options."""
    files = written(world, "mujoco", folder)
    whole = law_of_files(world, find_engine("mujoco"), files)
    names = [material.name for material in world.contact.materials]
    pair = of_pair(whole, names[0], names[0])
    probe = dataclasses.replace(world, contact=dataclasses.replace(pair.contact), engines=(pair.options,))
    only = tuple(
        body for body in world.bodies if all(shape.material == names[0] for shape in body.shapes if shape.collision)
    )
    probe = dataclasses.replace(probe, bodies=only)
    text = compile_world(probe, ["mujoco"], plans={"mujoco": pair.plan})["mujoco"].files["model.xml"]
    root = ElementTree.fromstring(text)
    return len(root.findall("contact/pair")), root.find("option").attrib


def test_probes_have_explicit_pairs_where_the_scenario_has_them(tmp_path):
    """MuJoCo lists pairs with friction only up to a limit; beyond it, what slides hops, and L5 must see that."""
    world = worlds.table(dict.fromkeys(PAIRS, 0.3))
    count, _ = pairs_in_probe(world, tmp_path / "listed")
    assert count > 0
    # too few for the scenario, enough for what one material alone has
    few = worlds.with_options(world, "mujoco", settings=(("explicit_pairs_limit", 5),))
    count, _ = pairs_in_probe(few, tmp_path / "not listed")
    assert count == 0


def test_probes_have_the_world_wide_numbers_of_the_scenario(tmp_path):
    """MuJoCo's impratio is one number for the world, and follows from all laws; a probe has only one of them."""
    world = worlds.table(PAIRS)
    _, plain = pairs_in_probe(world, tmp_path / "plain")
    rolling = tuple(
        dataclasses.replace(pair, rolling_friction=1e-4) if pair.first != pair.second else pair
        for pair in world.contact.pairs
    )
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=rolling))
    world = worlds.with_options(world, "mujoco", accept=("contact.friction.impact", "material.friction.rolling"))
    files = written(world, "mujoco", tmp_path / "scenario")
    option = ElementTree.fromstring((files / "model.xml").read_text()).find("option")
    _, found = pairs_in_probe(world, tmp_path / "rolling")
    assert found["impratio"] == option.attrib["impratio"] != plain["impratio"]


def test_a_pair_is_independent_of_the_rest_of_the_scenario():
    """Other parts of a scenario do not change the values that probes of two materials get."""
    pairs = (
        PairContact("a", "a", 0.1, 0.0),
        PairContact("a", "b", 0.2, 0.0),
        PairContact("a", "c", 0.3, 0.0, hardness=Hardness("native")),
        PairContact("b", "b", 0.4, 0.0),
        PairContact("b", "c", 0.5, 0.0),
        PairContact("c", "c", 0.6, 0.0),
    )
    frictions = {(pair.first, pair.second): pair.friction for pair in pairs}
    world = worlds.table(frictions)
    kind = find_engine(ENGINES[0])
    whole = module.FileLaw(
        dataclasses.replace(world.contact, pairs=pairs),
        contact_plan(world, kind.RULES, kind.LAYERS),
        world.options(kind.NAME),
        0.001,
    )
    entry = of_pair(whole, "a", "b")
    assert {(pair.first, pair.second) for pair in entry.contact.pairs} == {("a", "a"), ("a", "b"), ("b", "b")}
    assert {material.name for material in entry.contact.materials} == {"a", "b"}
    assert {name for name, _ in entry.plan.numbers} == {"a", "b"}
    assert set(entry.plan.layer_of) <= {("a", "a"), ("a", "b"), ("b", "b")}


def test_settings_are_those_that_the_engine_runs_with(tmp_path):
    """What model.xml says counts, though the sidecar says otherwise."""
    world = WORLDS["bouncing"]("mujoco")
    folder = tmp_path / "files"
    write_folder(compile_world(world, ["mujoco"])["mujoco"].files, folder)
    path = folder / "model.xml"
    text = path.read_text()
    for before, after in (
        ('iterations="100"', 'iterations="7"'),
        ('solver="Newton"', 'solver="CG"'),
        ('impratio="1000"', 'impratio="5"'),
    ):
        assert before in text
        text = text.replace(before, after, 1)
    path.write_text(text)
    settings = dict(law_of_files(world, find_engine("mujoco"), folder).options.settings)
    assert [settings[name] for name in ("iterations", "solver", "impratio", "high_impratio")] == [7, "cg", 5.0, 5.0]
    assert settings["friction_rate"] == 100.0, "values that are no options are in the sidecar"
