"""MuJoCo's mode ``friction: coulomb``: improvements over MuJoCo's native friction, and motion that it must not change."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.kit.operations import OPERATIONS
from simspec.engines.mujoco import stepping as mujoco_coulomb
from simspec.engines.mujoco.engine import MuJoCo
from simspec.proof.checks import inventory_checks
from simspec.proof.comparator import compare
from simspec.proof.contact import leaning, run
from simspec.proof.contact.probe import TrialMotion
from simspec.proof.contact.worlds import drive_of
from simspec.world.reach import MaterialReach
from simspec.world.types import Body, Hardness, Inertial, Joint, Material, Pose, Shape
from tests import worlds
from tests.proof.contact_probing import law, world_of

pytest.importorskip("mujoco")
FREE = (1.0, 0.0, 0.0, 0.0)
G = 9.81
DT = 0.001


def coulomb(world, **settings):
    given = (("friction", "coulomb"), *settings.items())
    accept = tuple(name for name in world.options("mujoco").accept if name != "contact.friction.impact")
    return worlds.with_options(world, "mujoco", settings=tuple(sorted(given)), accept=accept)


@pytest.fixture
def load(load_files):
    """A function that compiles and loads a world."""
    return lambda world: load_files(MuJoCo, compile_world(world, ["mujoco"])["mujoco"].files)


def scene(*bodies, friction=0.5, restitution=0.0, cone="elliptic", floor=True, **more):
    """Free bodies on a floor, all of one material."""
    ground = Body(
        "floor",
        "floor",
        Inertial(0.0),
        Joint("floor_joint", "fixed"),
        (Shape("floor_0", "box", (40.0, 40.0, 2.0), Pose((0.0, 0.0, -1.0)), "default"),),
    )
    world = worlds.ball_with_law(friction=friction, restitution=restitution, **more)
    contact = dataclasses.replace(world.contact, friction_cone=cone, materials=(Material("default"),))
    bodies = (ground, *bodies) if floor else bodies
    accept = ("contact.friction.impact", "contact.cone.pyramid-inscribed", "material.restitution")
    world = dataclasses.replace(world, name="coulomb", bodies=bodies, contact=contact)
    return worlds.with_options(world, "mujoco", accept=accept)


def box(name, at, velocity=(0.0, 0.0, 0.0), size=(0.2, 0.2, 0.04), mass=1.0, turn=FREE):
    x, y, z = (edge * edge for edge in size)
    moments = (mass / 12.0 * (y + z), mass / 12.0 * (x + z), mass / 12.0 * (x + y))
    joint = Joint(f"{name}_joint", "free", position=(*at, *turn), velocity=(*velocity, 0.0, 0.0, 0.0))
    return Body(
        name,
        name,
        Inertial(mass, inertia=(*moments, 0.0, 0.0, 0.0)),
        joint,
        (Shape(f"{name}_0", "box", size, Pose(), "default"),),
    )


def ball(name, at, velocity=(0.0, 0.0, 0.0), radius=0.1, mass=1.0):
    joint = Joint(f"{name}_joint", "free", position=(*at, *FREE), velocity=(*velocity, 0.0, 0.0, 0.0))
    moment = 0.4 * mass * radius * radius
    shape = Shape(f"{name}_0", "sphere", (radius,), Pose(), "default")
    return Body(name, name, Inertial(mass, inertia=(moment,) * 3 + (0.0,) * 3), joint, (shape,))


def landed(engine, drop):
    """The state just after the impact of a body that falls from ``drop`` (m), and the speed with which it arrived."""
    engine.step(int(math.sqrt(2.0 * drop / G) / DT) - 3)
    for _ in range(8):
        before = engine.body_states()[1][-1].copy()
        engine.step(1)
        after = engine.body_states()[1][-1]
        if after[2] - before[2] > 0.5:
            return -before[2], before, after
    raise AssertionError("nothing landed")


# --- impacts ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cone", ["elliptic", "pyramid-inscribed"])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize(("friction", "along"), [(0.05, 1.0), (0.5, 1.0), (0.3, 5.0), (1.0, 5.0)])
def test_the_tangential_impulse_of_an_impact_follows_coulomb(load, friction, along, restitution, cone):
    """The examination's drop from 0.4 m: Δv = min(μ (1 + e) v_n, s v), s = 2/7 of a ball and 1 of a flat box."""
    for body, share in (
        (ball("one", (0.0, 0.0, 0.5), (along, 0.0, 0.0)), 2 / 7),
        (box("one", (0.0, 0.0, 0.42), (along, 0.0, 0.0)), 1.0),
    ):
        engine = load(coulomb(scene(body, friction=friction, restitution=restitution, cone=cone)))
        normal, before, after = landed(engine, 0.4)
        expected = min(friction * ((1.0 + restitution) * normal + G * DT), share * along)
        assert before[0] - after[0] == pytest.approx(expected, rel=0.03)
        assert after[2] == pytest.approx(restitution * normal, abs=0.012 * normal)  # nothing is thrown up
        if share < 1.0:
            assert after[4] - before[4] == pytest.approx(2.5 / 0.1 * expected, rel=0.03)


def test_an_off_centre_hit_of_balls_of_unequal_mass(load):
    """Each has the whole of the one impulse: along the line of centres (1 + e) m v_n, across μ times that, and its spin."""
    angle, friction, e, speed, masses = math.asin(0.5), 0.3, 0.5, 2.0, (1.0, 3.0)
    start = -0.2 * math.cos(angle) - speed * DT * 3.5
    entry, other = ball("one", (start, 0.0, 5.0), (speed, 0.0, 0.0)), ball("two", (0.0, 0.1, 5.0), mass=masses[1])
    engine = load(coulomb(scene(entry, other, friction=friction, restitution=e, floor=False)))
    engine.step(8)
    _, velocity = engine.body_states()
    reduced = masses[0] * masses[1] / sum(masses)
    normal = (1.0 + e) * reduced * speed * math.cos(angle)
    across = min(friction * normal, 2 / 7 * reduced * speed * math.sin(angle))
    for index, mass in enumerate(masses):
        assert abs(velocity[index, 5]) == pytest.approx(2.5 * across / (mass * 0.1), rel=0.03)
    line = np.array([math.cos(angle), math.sin(angle), 0.0])
    assert (velocity[1, :3] - velocity[0, :3]) @ line == pytest.approx(e * speed * math.cos(angle), rel=0.03)


def test_a_single_solve_is_not_sufficient(load, monkeypatch):
    """The loop is what does it: without it a third of an impact's friction is wrong, and bodies are thrown up or sink."""
    monkeypatch.setattr(mujoco_coulomb, "MOST_FRICTION_SOLVES", 1)
    engine = load(coulomb(scene(box("one", (0.0, 0.0, 0.42), (5.0, 0.0, 0.0)), friction=1.0)))
    normal, before, after = landed(engine, 0.4)
    assert abs((before[0] - after[0]) / (1.0 * (normal + G * DT)) - 1.0) > 0.3
    assert abs(after[2]) > 0.3
    (line,) = [line for line in engine.log() if "coulomb" in line]
    assert "ended unconverged after 1 solves" in line


def test_a_sudden_push_does_not_lift_a_resting_body(load):
    """A resting body is solved once; the effect of a force in its first step must be found (8 mm otherwise)."""
    engine = load(coulomb(scene(box("one", (0.0, 0.0, 0.02)), friction=1.0)))
    engine.step(100)
    height = engine.body_states()[0][1, 2]
    engine.step(1, np.array([100.0 * G, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert abs(engine.body_states()[1][1, 2]) < 1e-3
    engine.step(20)
    assert engine.body_states()[0][1, 2] - height < 1e-5


# --- pushes, stops, creep, rest -----------------------------------------------------------------------------------


def probed(load, probe, wanted):
    (trial,) = probe.trials(wanted)
    engine = load(coulomb(world_of(wanted, trial)))
    operation = drive_of(world_of(wanted, trial), trial)
    _, arrays = OPERATIONS["drive"].do(engine, dict(operation.arrays), dict(operation.parameters))
    names = [body.name for body in trial.bodies]
    motion = TrialMotion(
        arrays["time"],
        {name: arrays["pose"][:, index] for index, name in enumerate(names)},
        {name: arrays["velocity"][:, index] for index, name in enumerate(names)},
    )
    return probe.figures(wanted, [motion]), motion, engine


@pytest.mark.parametrize("timestep", [0.001, 0.004])
@pytest.mark.parametrize("value", [0.1, 0.3, 0.4])
def test_a_clamp_that_jams_under_the_pyramid_stands(load, value, timestep):
    """It creeps within the tolerance at rest; separated by it, a side loses contact within 46 steps of 1 ms at 0.3."""
    wanted = dataclasses.replace(
        law(timestep, friction=value), friction_cone="pyramid-inscribed", reach=MaterialReach(jams=True)
    )
    for probe in (leaning.Jam(), leaning.LightJam()):
        figures, _, _ = probed(load, probe, wanted)
        assert [figure.passed for figure in figures] == [True]


@pytest.mark.parametrize("value", [0.2, 1.0])
def test_pushes_stops_and_creep(load, value):
    """Pushes within 0.1 %, stops within 1 %, creep below 0.1 µm/s, and nothing hops by more than 20 µm."""
    wanted = law(friction=value)
    for name, share in (("push", 1e-3), ("push-oblong", 1e-3), ("stop", 1e-2), ("stop-oblong", 1e-2)):
        (figure,), motion, engine = probed(load, run.PROBES[name], wanted)
        assert abs(figure.measured - figure.expected) <= share * figure.expected
        rise = max(float(pose[:, 2].max() - pose[0, 2]) for body, pose in motion.pose.items() if body != "floor")
        assert rise < 2e-5
        assert engine.log() == []
    (figure,), _, _ = probed(load, run.PROBES["stick"], wanted)
    assert figure.measured < 1e-7


def test_stacked_boxes_do_not_sink(load):
    """0.1 mm in 1 s, where MuJoCo's own friction has them lie 0.9 mm deep on its cushion."""
    engine = load(
        coulomb(scene(*(box(f"box_{i}", (0.0, 0.0, 0.05 + 0.1 * i), size=(0.1, 0.1, 0.1)) for i in range(10))))
    )
    engine.step(1000)
    pose, _ = engine.body_states()
    assert 0.95 - pose[-1, 2] < 1.5e-4
    assert np.abs(pose[1:, :2]).max() < 1e-5


# --- what it leaves alone -----------------------------------------------------------------------------------------


def motion_of(engine, steps=400):
    rows = []
    for _ in range(steps // 20):
        engine.step(20)
        rows.append(np.concatenate(engine.get_state()))
    return np.array(rows)


def test_without_friction_nothing_is_changed_by_a_bit(load):
    """The same solver on both sides: balls alone have another by default, which the loop cannot use."""
    world = worlds.spheres(8)
    plain = worlds.with_options(world, "mujoco", settings=(("solver", "newton"),))
    np.testing.assert_array_equal(motion_of(load(coulomb(world)), 800), motion_of(load(plain), 800))


def test_native_contact_stays_out_of_it(load):
    body = box("one", (0.0, 0.0, 0.021), (1.0, 0.3, 0.0))
    world = scene(body, hardness=Hardness("native"))
    accept = ("contact.hardness.native",)
    local = worlds.with_options(world, "mujoco", accept=accept)
    options = worlds.with_options(world, "mujoco", accept=accept, settings=(("friction", "coulomb"),))
    np.testing.assert_array_equal(motion_of(load(options)), motion_of(load(local)))


def heap(**settings):
    """Boxes that tumble over each other: enough for the order of contacts to matter."""
    turned = (math.cos(0.3), math.sin(0.3) * 0.6, math.sin(0.3) * 0.8, 0.0)
    bodies = [
        box(f"box_{i}", (0.03 * i, 0.02 * i, 0.3 + 0.25 * i), (0.5, 0.0, 0.0), (0.2, 0.1, 0.1), turn=turned)
        for i in range(4)
    ]
    return coulomb(scene(*bodies, restitution=0.2), **settings)


def test_repeated_runs_give_the_same_bits_with_any_queries_between_steps(load):
    requested, quiet = load(heap()), load(heap())
    begin = requested.get_state()
    rows = []
    for engine, curious in ((requested, True), (quiet, False)):
        found = []
        for _ in range(400):
            engine.step(1)
            if curious:
                engine.contacts(), engine.energy(), engine.mass_matrix(), engine.bias_force(), engine.detect_contacts()
            found.append(np.concatenate(engine.get_state()))
        rows.append(found)
    np.testing.assert_array_equal(*rows)
    # and from its beginning again, without a memory
    requested.set_state(*begin)
    again = []
    for _ in range(400):
        requested.step(1)
        again.append(np.concatenate(requested.get_state()))
    np.testing.assert_array_equal(again, rows[0])


@pytest.mark.parametrize("settings", [{"island": True}, {"sleeping": True}, {"solver": "cg"}, {"warmstart": False}])
def test_it_works_with_other_settings(load, settings):
    """The same drop, with groups of bodies solved separately, with sleep, with another solver."""
    bodies = [ball("far", (5.0, 0.0, 0.5)), ball("one", (0.0, 0.0, 0.5), (5.0, 0.0, 0.0))]
    engine = load(coulomb(scene(*bodies, friction=0.3), **settings))
    normal, before, after = landed(engine, 0.4)
    assert before[0] - after[0] == pytest.approx(0.3 * (normal + G * DT), rel=0.03)
    engine.step(1000)
    assert engine.body_states()[1][1, 2] == pytest.approx(0.0, abs=1e-3)


def test_actuation_steps_the_same(load):
    """Step by step under efforts, as controllers do it, and many steps at once."""
    body = box("one", (0.0, 0.0, 0.02))
    effort = np.array([8.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    once, single = load(coulomb(scene(body))), load(coulomb(scene(body)))
    once.step(50, effort)
    joints = single.actuate(np.array([0]), np.array([0]))
    for _ in range(50):
        joints.read()
        joints.give(effort[:1])
        joints.step()
    np.testing.assert_array_equal(np.concatenate(once.get_state()), np.concatenate(single.get_state()))


def test_files_say_the_mode_and_its_numbers(tmp_path):
    """No cushion, no pairs for friction's sake, and the mode by name."""
    world = coulomb(scene(box("one", (0.0, 0.0, 0.02)), restitution=0.3))
    files = compile_world(world, ["mujoco"])["mujoco"].files
    sidecar = json.loads(files["sidecar.json"])
    assert sidecar["settings"]["friction"] == "coulomb"
    assert sidecar["explicit_pairs"] is True
    assert "<pair " not in files["model.xml"].split("</default>")[-1]
    assert "0.01 0.999 0.0001" not in files["model.xml"]
    local = compile_world(scene(box("one", (0.0, 0.0, 0.02))), ["mujoco"])["mujoco"].files
    assert "0.01 0.999 0.0001" in local["model.xml"]
    assert json.loads(local["sidecar.json"])["settings"]["friction"] == "native"


def test_the_engine_stores_the_values_of_the_mode(load):
    """Every number of the engine, as part of the proof compares it."""
    body = box("one", (0.0, 0.0, 0.02))
    for world in (scene(body), scene(body, restitution=0.3), scene(body, cone="pyramid-inscribed")):
        for entry in (world, coulomb(world)):
            engine = load(entry)
            back = engine.read_back()
            checks = compare(entry, back, MuJoCo.RULES, MuJoCo.LAYERS)
            checks += inventory_checks(MuJoCo.expected_inventory(entry, back.neutral), back.inventory)
            assert [check for check in checks if not check.passed] == []


def test_unconverged_steps_are_counted_and_reported(load, monkeypatch):
    monkeypatch.setattr(mujoco_coulomb, "MOST_FRICTION_SOLVES", 2)
    engine = load(heap())
    engine.step(600)
    (line,) = engine.log()
    loop = engine._coulomb
    assert loop.stepped > loop.unsettled > 0
    assert f"of {loop.stepped} steps with friction in contact {loop.unsettled} ended unconverged after 2 solves" in line
