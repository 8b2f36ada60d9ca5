"""MuJoCo's settings of pairs of materials: written, read from the files, held by the engine, and noticed when wrong."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.cli import main
from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.sidecar import SIDECAR, read_sidecar
from simspec.dialects.mujoco.sidecar import MujocoSidecar
from simspec.engines.kit.registry import find_engine
from simspec.engines.mujoco.engine import SETTINGS, MuJoCo
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.checks import inventory_checks
from simspec.proof.contact.worlds import law_of_files, of_pair
from simspec.proof.mutation_worlds import WORLDS
from simspec.runner.run import Case
from simspec.support.features import Feature
from simspec.world.types import EngineOptions, Hardness, PairSettings
from tests import worlds

mujoco = pytest.importorskip("mujoco")

LAWS = {("finger", "finger"): 0.3, ("finger", "wood"): 0.5, ("wood", "wood"): 0.4}
BY_PAIR = [name for name, setting in SETTINGS.items() if setting.by_pair]


NAMES = ("solref", "solimp", "solreffriction")


def world_of(local, **options):
    """Two materials in all ways, with settings of pairs: {(first, second): {name: value}}."""
    pairs = tuple(PairSettings(*pair, tuple(sorted(values.items()))) for pair, values in sorted(local.items()))
    return worlds.with_options(worlds.table(LAWS), "mujoco", pairs=pairs, **options)


def written(world, folder):
    write_folder(compile_world(world, ["mujoco"])["mujoco"].files, folder)
    return folder


def numbers(world):
    """The numbers of explicit pairs by their materials, as the file has them (its defaults filled in)."""
    root = ElementTree.fromstring(compile_world(world, ["mujoco"])["mujoco"].files["model.xml"])
    material = {shape.name: shape.material for body in world.bodies for shape in body.shapes}
    defaults = root.find("default/pair").attrib
    laws = {(law.first, law.second): law for law in world.contact.pairs}
    found: dict[tuple[str, ...], list[dict[str, list[float]]]] = {}
    for pair in root.findall("contact/pair"):
        key = tuple(sorted((material[pair.get("geom1")], material[pair.get("geom2")])))
        values = {**defaults, **pair.attrib}
        actual_numbers = {name: [float(x) for x in values[name].split()] for name in NAMES}
        found.setdefault(key, []).append(actual_numbers)
    for key, rows in found.items():  # but for stiffness, which depends on masses, pairs of shapes have the same numbers
        if (law := laws[key]).hardness.kind != "stiffness":
            assert rows == [rows[0]] * len(rows), law
    return {key: rows[0] for key, rows in found.items()}


def test_the_settings_of_a_pair_are_those_of_its_contacts_alone():
    plain = numbers(world_of({}))
    local = {
        "contact_impedance": 0.997,
        "contact_error_reduction": 0.25,
        "friction_cushion": 0.0,
        "friction_rate": 50.0,
    }
    changed = numbers(world_of({("finger", "wood"): local}))
    assert {pair for pair in plain if changed[pair] != plain[pair]} == {("finger", "wood")}
    dt = 0.001
    pair = changed["finger", "wood"]
    assert pair["solref"] == pytest.approx([-0.25 / dt**2, -1 / dt], rel=1e-14)
    assert pair["solimp"] == [0.997, 0.997, 0.001, 0.5, 2.0]
    assert pair["solreffriction"] == [0.0, -50.0]


NUMBERS = {
    "contact_error_reduction": st.floats(0.0, 1.0),
    "contact_impedance": st.floats(1e-4, 0.9999),
    "friction_cushion": st.floats(0.0, 0.01),
    "friction_rate": st.floats(1e-3, 1e4),
    "friction_share": st.floats(1e-3, 1.0),
}
settings_by_pair = st.dictionaries(
    st.sampled_from(sorted(LAWS)), st.fixed_dictionaries({}, optional=NUMBERS).filter(bool), max_size=3
)


def test_all_settings_by_pair_are_tried():
    assert set(NUMBERS) == set(BY_PAIR)


@settings(max_examples=40, deadline=None)
@given(settings_by_pair, st.sampled_from(["elliptic", "pyramid-inscribed"]), st.sampled_from(["native", "coulomb"]))
def test_the_reader_and_the_engine_store_any_pair_settings(local, cone, friction):
    """The reader of files finds the world's laws, and all numbers that the engine holds are those expected."""
    if friction == "coulomb":
        local = {
            pair: {n: v for n, v in values.items() if not n.startswith("friction")} for pair, values in local.items()
        }
        local = {pair: values for pair, values in local.items() if values}
    accept = ("contact.friction.impact", f"contact.cone.{cone}")
    world = world_of(local, settings=(("friction", friction),), accept=accept)
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, friction_cone=cone))
    with TemporaryDirectory() as place:
        folder = written(world, Path(place) / "files")
        material = {shape.name: shape.material for body in world.bodies for shape in body.shapes}
        read = dialects()["mujoco"].read(folder)
        engine = MuJoCo()
        engine.load(folder, read_sidecar(folder))
        try:
            back = engine.read_back()
        finally:
            engine.close()
    for pairs in (read.pairs, back.pairs):
        there = {tuple(sorted((material[pair.first], material[pair.second]))) for pair in pairs}
        assert there >= set(local)
        for pair in pairs:
            law = LAWS[tuple(sorted((material[pair.first], material[pair.second])))]
            assert pair.surface.hardness == Hardness("common")
            assert pair.surface.friction == law
    (check,) = inventory_checks(find_engine("mujoco").expected_inventory(world, back.neutral), back.inventory)
    assert check.passed, check.detail


DEFECTS = {
    "impedance": (r'solimp="0.01 0.997', 'solimp="0.01 0.998', "L0"),
    "the engine's own impedance": (r'solimp="0.01 0.997', 'solimp="0.01 0.999', "L0"),
    "error reduction": (r'solref="-250000', 'solref="-240000', "L0"),
    "the engine's own error reduction": (r'solref="-250000 -1000" ', "", "L0"),
    "cushion": (r"0.997 0.0002", "0.997 0.0001", "L0"),
    "rate": (r'solreffriction="0 -50"', 'solreffriction="0 -60"', "L4"),
    "the engine's own rate": (r' solreffriction="0 -50"', "", "L4"),
}
FINGER_ON_WOOD = {
    "contact_impedance": 0.997,
    "contact_error_reduction": 0.25,
    "friction_cushion": 2e-4,
    "friction_rate": 50.0,
}


@pytest.mark.parametrize("name", DEFECTS)
def test_a_defect_in_the_settings_of_a_single_pair_is_found(name, tmp_path):
    before, after, level = DEFECTS[name]
    world = world_of({("finger", "wood"): FINGER_ON_WOOD})
    folder = written(world, tmp_path / "files")
    path = folder / "model.xml"
    text = path.read_text()
    changed = re.sub(before, after, text, count=1)
    assert changed != text
    path.write_text(changed)
    hardness = {pair.surface.hardness.kind for pair in dialects()["mujoco"].read(folder).pairs}
    assert (hardness == {"common"}) == (level != "L0")
    engine = MuJoCo()
    engine.load(folder, read_sidecar(folder))
    try:
        back = engine.read_back()
    finally:
        engine.close()
    (check,) = inventory_checks(find_engine("mujoco").expected_inventory(world, back.neutral), back.inventory)
    assert not check.passed


def test_numbers_of_another_pair_are_no_common_law(tmp_path):
    """Each pair is read with its own settings, so that two that are exchanged do not pass."""
    local = {("finger", "wood"): {"contact_impedance": 0.997}, ("wood", "wood"): {"contact_impedance": 0.995}}
    folder = written(world_of(local), tmp_path / "files")
    path = folder / "model.xml"
    text = path.read_text()
    swapped = text.replace("0.997", "@").replace("0.995", "0.997").replace("@", "0.995")
    assert swapped != text
    path.write_text(swapped)
    assert "stiffness" in {pair.surface.hardness.kind for pair in dialects()["mujoco"].read(folder).pairs}


SIDECAR_DAMAGE = {
    "a setting of all contacts": (
        lambda local: local["settings"].update(iterations=3),
        "iterations is no setting of a pair",
    ),
    "another kind": (
        lambda local: local["settings"].update(friction_rate="fast"),
        "friction_rate is no setting of a pair",
    ),
    "three materials": (lambda local: local["between"].append("x"), "between"),
    "no shapes": (lambda local: local.pop("shapes"), "shapes"),
}


@pytest.mark.parametrize("name", SIDECAR_DAMAGE)
def test_a_damaged_sidecar_is_refused(name, tmp_path):
    change, message = SIDECAR_DAMAGE[name]
    folder = written(world_of({("finger", "wood"): FINGER_ON_WOOD}), tmp_path / "files")
    content = json.loads((folder / SIDECAR).read_text())
    change(content["pair_settings"][0])
    (folder / SIDECAR).write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message):
        dialects()["mujoco"].read(folder)
    with pytest.raises(EngineError, match=message):
        MuJoCo().load(folder, content)


def test_the_order_of_two_shapes_does_not_matter(tmp_path):
    folder = written(world_of({("finger", "wood"): FINGER_ON_WOOD}), tmp_path / "files")
    sidecar = MujocoSidecar.of(read_sidecar(folder))
    (pair,) = sidecar.pair_settings
    entry, other = (names[0] for names in pair.shapes)
    for ends in ((entry, other), (other, entry)):
        assert sidecar.settings_between(*ends) == {**sidecar.settings, **FINGER_ON_WOOD}
    assert sidecar.settings_between(entry, entry) == sidecar.settings_between(other, other) == sidecar.settings


def test_a_sidecar_of_a_world_without_them_says_nothing_of_them():
    assert "pair_settings" not in compile_world(world_of({}), ["mujoco"])["mujoco"].files[SIDECAR]


def test_more_pairs_of_shapes_than_are_listed_are_refused():
    """Numbers of shapes cannot give a pair its own settings."""
    larger = worlds.table({("finger", "finger"): 0.3, ("finger", "wood"): 0.4, ("wood", "wood"): 0.4})
    limited = worlds.with_options(larger, "mujoco", settings=(("explicit_pairs_limit", 1),))
    compile_world(limited, ["mujoco"])
    local = (PairSettings("finger", "wood", (("contact_impedance", 0.997),)),)
    with pytest.raises(UnsupportedError, match="settings of their own"):
        compile_world(worlds.with_options(limited, "mujoco", pairs=local), ["mujoco"])


def test_probes_of_a_pair_have_its_settings(tmp_path):
    world = world_of({("finger", "wood"): FINGER_ON_WOOD, ("wood", "wood"): {"contact_impedance": 0.99}})
    whole = law_of_files(world, find_engine("mujoco"), written(world, tmp_path / "files"))
    (local,) = of_pair(whole, "wood", "wood").options.pairs
    assert local == PairSettings("wood", "wood", (("contact_impedance", 0.99),))
    assert len(of_pair(whole, "finger", "wood").options.pairs) == 2
    assert of_pair(whole, "finger", "finger").options.pairs == ()
    law = next(pair for pair in world.contact.pairs if (pair.first, pair.second) == ("finger", "wood"))
    assert law in whole.contact.pairs


KINDS = {
    "rigid": {},
    "without friction": {"friction": 0.0},
    "bouncing": {"restitution": 0.5},
    "time constant": {"hardness": Hardness("time-constant", time_constant=0.02, damping_ratio=1.0)},
    "stiffness": {"hardness": Hardness("stiffness", stiffness=2000.0, damping=10.0)},
    "native": {"hardness": Hardness("native")},
}


@pytest.mark.parametrize("cone", ["elliptic", "pyramid-inscribed"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", BY_PAIR)
def test_a_setting_has_an_effect_exactly_in_the_contacts_that_its_declaration_says(name, kind, cone):
    """The numbers in the file follow from it, but for a reference of friction where MuJoCo ignores it."""
    everything = tuple(sorted(feature.value for feature in Feature))

    def pair_numbers(value):
        base = world_of({("finger", "wood"): {"contact_impedance": 0.5, name: value}}, accept=everything)
        pairs = tuple(
            dataclasses.replace(pair, **KINDS[kind]) if pair.first != pair.second else pair
            for pair in base.contact.pairs
        )
        contact = dataclasses.replace(base.contact, friction_cone=cone, pairs=pairs)
        world = dataclasses.replace(base, contact=contact)
        law = next(pair for pair in pairs if pair.first != pair.second)
        actual_numbers = numbers(world)["finger", "wood"]
        if cone != "elliptic" or not law.friction:
            del actual_numbers["solreffriction"]
        return actual_numbers, SETTINGS[name].by_pair.idle(law, cone)

    if kind in ("time constant", "stiffness") and cone != "elliptic":
        with pytest.raises(UnsupportedError, match="pyramid"):
            pair_numbers(0.01)
        return
    (first, why), (second, _) = pair_numbers(0.005), pair_numbers(0.01)
    assert (first == second) == bool(why)


def test_settings_of_pairs_that_do_nothing_are_warnings(tmp_path, capsys):
    path = tmp_path / "m.yaml"
    path.write_text(SLICK, encoding="utf-8")
    assert main(["check", str(path)]) == 0
    err = capsys.readouterr().err
    assert (
        "m.yaml:19:58: warning[E106]: engines.mujoco.pairs.0.settings.friction_rate: friction_rate has no effect" in err
    )
    assert "found:   no friction" in err
    assert (
        "m.yaml:23:13: warning[E106]: engines.mujoco.at_timestep.0.pairs.0: no shapes of wood and wood can touch" in err
    )
    assert err.count("warning") == 2
    assert main(["check", str(path), "--strict"]) == 2
    wrong = "engines.mujoco.at_timestep.0.pairs.0.settings.iterations"
    assert main(["check", str(path), "--set", f"{wrong}=3"]) == 2
    assert (
        f"error[E105]: {wrong}: mujoco's setting 'iterations' has one value for all contacts" in capsys.readouterr().err
    )


SLICK = """\
simspec: 1
name: m
physics: {timestep: 1 ms, duration: 1 s}
contact:
  materials:
    ice: {friction: 0}
    wood: {friction: 0.5}
bodies:
  floor:
    fixed: true
    shapes: [{box: {size: [1, 1, 0.1]}, material: ice}]
  cube:
    pose: {xyz: [0, 0, 1]}
    mass: 1
    shapes: [{box: {size: [0.1, 0.1, 0.1]}, material: wood}]
engines:
  mujoco:
    pairs:
      - {between: [ice, wood], settings: {friction_rate: 50, contact_impedance: 0.99}}
    at_timestep:
      - above: 8 ms
        pairs:
          - {between: [wood, wood], settings: {friction_rate: 50}}
"""

WRONG = {
    "of all contacts": ({"iterations": 5}, "has one value for all contacts"),
    "unknown": ({"contact_impedence": 0.9}, "no setting 'contact_impedence'"),
    "out of range": ({"contact_impedance": 2.0}, "wrong value"),
    "without effect": ({"friction_rate": 5.0}, "has no effect with friction: coulomb"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_settings_of_a_pair_are_errors_at_their_place(name):
    local, message = WRONG[name]
    chosen = (("friction", "coulomb"),) if name == "without effect" else ()
    with pytest.raises(UnsupportedError, match=message) as error:
        compile_world(world_of({("finger", "wood"): local}, settings=chosen), ["mujoco"])
    assert [problem.path for problem in error.value.problems] == [
        f"engines.mujoco.pairs.finger.wood.{next(iter(local))}"
    ]


@pytest.mark.parametrize("engine", ["pybullet", "dart", "drake"])
def test_engines_without_settings_of_pairs_refuse_them(engine):
    world = WORLDS["pairs"](engine)
    with pytest.raises(UnsupportedError, match="none for each pair"):
        compile_world(world, [engine])


def test_a_run_with_them_is_another_case_and_keeps_them():
    plain, local = world_of({}), world_of({("finger", "wood"): FINGER_ON_WOOD})
    versions = {"engine_version": "1"}
    assert Case(plain, "mujoco").key(versions) != Case(local, "mujoco").key(versions)
    others = tuple(options for options in local.engines if options.engine != "mujoco")
    without = dataclasses.replace(local, engines=(EngineOptions("mujoco"), *others))
    assert Case(local, "pybullet").key(versions) == Case(without, "pybullet").key(versions)
    changed = Case(local, "mujoco", (("iterations", 7),)).resolved
    assert changed.options("mujoco").pairs == local.options("mujoco").pairs
