"""Faces by hydroelastic contact, where a spec requests it: pairs with pressure, stored values, and results of the probes."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import SIDECAR, sidecar_text
from simspec.engines.drake.approximations import PRESSURE_SECONDS
from simspec.engines.drake.engine import Drake
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.checks import inventory_checks
from simspec.proof.contact import run, size
from simspec.proof.selftest_worlds import WORLDS
from simspec.testing import worlds as shipped
from simspec.world.types import Shape
from tests.engines.drake.scenes import boxes, with_settings

pytest.importorskip("pydrake")
from pydrake import geometry

pytestmark = pytest.mark.usefixtures("warm_engines")

HEIGHT = 0.1


@pytest.fixture
def load(load_files):
    return lambda world: load_files(Drake, compile_world(world, ["drake"])["drake"].files)


def pressed(world, solver="tamsi", **settings):
    return with_settings(world, contact_approximation=solver, hydroelastic_faces=True, **settings)


def check_of(world, engine):
    back = engine.read_back()
    (check,) = inventory_checks(Drake.expected_inventory(world, back.neutral), back.inventory)
    return check


@pytest.mark.parametrize("solver", ["sap", "tamsi"])
@pytest.mark.parametrize("floor", ["box", "plane"])
def test_boxes_stand_by_pressure_at_the_depth_of_their_modulus(load, solver, floor):
    engine = load(pressed(boxes(2, floor=floor), solver, hydroelastic_modulus=2e7))
    engine.step(1500)  # by SAP an e-fold takes 100
    contacts = engine.contacts()
    assert contacts["body"].tolist() == [[0, 1], [1, 2]], "one surface of each pair, no corner's point"
    weight = np.array([2.0, 1.0]) * 9.81
    np.testing.assert_allclose(contacts["normal_force"], weight, rtol=1e-4)
    area = HEIGHT**2
    first = weight[0] * HEIGHT / (2.0 * area * 2e7)  # on what is rigid
    second = weight[1] * HEIGHT / (area * 2e7)  # two that are compliant
    np.testing.assert_allclose(-contacts["distance"], [first, second], rtol=0.01)
    np.testing.assert_allclose(np.abs(contacts["normal"][:, 2]), 1.0, atol=1e-3)
    np.testing.assert_allclose(contacts["position"], [(0.0, 0.0, 0.0), (0.0, 0.0, HEIGHT)], atol=1e-4)
    z = engine.body_states()[0][1:, 2]
    np.testing.assert_allclose(z, [HEIGHT / 2 - first, 1.5 * HEIGHT - first - second], atol=0.02 * first)


def test_normals_are_as_those_of_points(load):
    normals = []
    for world in (with_settings(boxes(1), contact_approximation="tamsi"), pressed(boxes(1))):
        engine = load(world)
        engine.step(5)
        contacts = engine.contacts()
        sign = np.where(contacts["body"][:, 0] == 0, 1.0, -1.0)
        normals.append((sign * contacts["normal"][:, 2]).mean())
    assert normals[0] == pytest.approx(normals[1], abs=1e-3)
    assert abs(normals[0]) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("kind", ["cylinder", "sphere"])
def test_other_shapes_touch_boxes_at_points(load, kind):
    """On a box and below one: a box's corners are there for them."""
    world = boxes(2, kind=kind)
    top = dataclasses.replace(world.bodies[2], shapes=(Shape("b1_0", "box", (0.1, 0.1, 0.1), material="a"),))
    world = dataclasses.replace(world, bodies=(*world.bodies[:2], top))
    ends = []
    for requested in (with_settings(world, contact_approximation="tamsi"), pressed(world)):
        engine = load(requested)
        engine.step(100)
        ends.append(engine.get_state())
    for corners, pressure in zip(*ends, strict=True):
        assert (corners == pressure).all()


@pytest.mark.parametrize("name", ["model", "surfaces", "cylinder", "plane"])
def test_the_inventory_follows_the_choice(name, load):
    made = {
        "cylinder": lambda _: boxes(2, kind="cylinder"),
        "plane": lambda _: boxes(2, floor="plane"),
    }.get(name) or WORLDS[name]
    world = pressed(made("drake"), "tamsi", hydroelastic_modulus=3e7)
    check = check_of(world, load(world))
    assert check.passed, check.detail


def material(name, value):
    def change(sim):
        context = sim.built.scene.GetMyMutableContextFromRoot(sim.root)
        id_ = next(entry.id for entry in sim.built.geometries if entry.unit.of.owner.row == 1 and entry.part == "shape")
        properties = geometry.ProximityProperties(sim.query().inspector().GetProximityProperties(id_))
        properties.UpdateProperty("hydroelastic", name, value)
        sim.built.scene.AssignRole(context, sim.plant.get_source_id(), id_, properties, geometry.RoleAssign.kReplace)

    return change


@pytest.mark.parametrize("name", ["hydroelastic_modulus", "resolution_hint", "margin"])
def test_another_number_of_hydroelastic_contact_shows(name, load):
    world = pressed(boxes(1))
    engine = load(world)
    assert check_of(world, engine).passed
    material(name, 0.5)(engine._simulation)
    assert not check_of(world, engine).passed


def test_a_changed_choice_is_found_and_a_half_choice_is_rejected(load_files):
    """Files with the other choice, or the switch without the modulus."""
    corners, pressure = with_settings(boxes(1), contact_approximation="tamsi"), pressed(boxes(1))
    for world, other in ((corners, pressure), (pressure, corners)):
        assert not check_of(world, load_files(Drake, compile_world(other, ["drake"])["drake"].files)).passed
    files = dict(compile_world(pressure, ["drake"])["drake"].files)
    content = json.loads(files[SIDECAR])
    del content["settings"]["hydroelastic_modulus"]
    with pytest.raises(EngineError, match="hydroelastic_modulus"):
        load_files(Drake, files | {SIDECAR: sidecar_text(content)})


def test_the_files_of_who_does_not_ask_say_nothing_of_it():
    assert "hydroelastic" not in compile_world(boxes(1), ["drake"])["drake"].files[SIDECAR]


def test_sap_with_friction_is_supported_at_small_timesteps_alone():
    compile_world(pressed(boxes(2, PRESSURE_SECONDS), "sap"), ["drake"])
    compile_world(pressed(boxes(2, 0.008, friction=0.0), "sap"), ["drake"])
    compile_world(pressed(boxes(2, 0.008)), ["drake"])
    with pytest.raises(UnsupportedError, match="throws boxes off"):
        compile_world(pressed(boxes(2, 2.0 * PRESSURE_SECONDS), "sap"), ["drake"])


def test_tamsi_holds_a_tower_at_4_ms_that_fails_on_corners(load):
    engine = load(with_settings(boxes(6, 0.004), contact_approximation="tamsi"))
    with pytest.raises(EngineError, match="failed to converge"):
        engine.step(125)
    engine = load(pressed(boxes(6, 0.004)))
    start = engine.body_states()[0]
    engine.step(125)
    np.testing.assert_allclose(engine.body_states()[0][:, :3], start[:, :3], atol=1e-4)


@pytest.mark.parametrize("solver", ["tamsi", "sap"])
@pytest.mark.parametrize(("depth", "timestep"), [(1e-4, 0.001), (1e-3, 0.001), (1e-4, 0.008)])
def test_an_overlap_of_boxes_is_corrected_by_the_law_of_the_solver(load, solver, depth, timestep):
    """By SAP β of it in a step, by TAMSI 1/dissipation, as with corners: the modulus has no part in it."""
    world = boxes(1, timestep, friction=0.0)
    joint = dataclasses.replace(world.bodies[1].joint, position=(0.0, 0.0, HEIGHT / 2 - depth, 1.0, 0.0, 0.0, 0.0))
    world = dataclasses.replace(
        world,
        bodies=(world.bodies[0], dataclasses.replace(world.bodies[1], joint=joint)),
        physics=dataclasses.replace(world.physics, gravity=(0.0, 0.0, 0.0)),
    )
    engine = load(pressed(world, solver))
    engine.step(1)
    expected = 0.01 * depth / timestep if solver == "sap" else 1e-3
    assert engine.get_state()[1][2] == pytest.approx(expected, rel=0.01)


def test_the_probes_of_boxes_hold_without_a_deviation(tmp_path, monkeypatch):
    """By TAMSI at 1 ms: pushed, sliding to rest, held below the limit, resting."""
    monkeypatch.setattr(size, "size_trial", lambda world: None)
    monkeypatch.setattr(
        run, "PROBES", {name: run.PROBES[name] for name in ("push-oblong", "stop-oblong", "stick", "rest")}
    )
    world = pressed(shipped.table({("a", "a"): 0.5}))
    write_folder(compile_world(world, ["drake"])["drake"].files, tmp_path / "drake")
    with run.measure(world, "drake", tmp_path / "drake", None, 300.0, False) as measuring:
        figures, _ = measuring.wait()
    assert len(figures) >= 4
    assert [figure for figure in figures if not figure.passed or figure.deviation] == []
    assert all(figure.measured == pytest.approx(0.5, rel=1e-3) for figure in figures if figure.probe == "push-oblong")
