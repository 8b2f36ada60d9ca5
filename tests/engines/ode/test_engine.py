"""ODE: its read-back, its refusals, stops and dry friction as rows, steps that it cannot solve."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.engines.ode.engine import Ode
from simspec.errors import EngineError, UnsupportedError
from simspec.formats.kit.text import json_text
from simspec.formats.world import WORLD
from simspec.proof.checks import inventory_checks
from simspec.proof.selftest_worlds import WORLDS
from simspec.testing import worlds as shipped
from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Physics, Pose, World
from tests import worlds
from tests.engines.drake.scenes import boxes
from tests.planted import SHARED

pytestmark = pytest.mark.skipif(Ode.version() is None, reason="ODE or a C compiler is not installed")
REFUSED = ("ground",)
DT = 0.001


@pytest.fixture
def load(load_files):
    """A function that compiles and loads a world, with its files changed on the way."""

    def of(world, change=lambda content, sidecar: None):
        files = dict(compile_world(world, ["ode"])["ode"].files)
        content, sidecar = json.loads(files[WORLD]), json.loads(files[SIDECAR])
        change(content, sidecar)
        return load_files(Ode, files | {WORLD: json_text(content), SIDECAR: json_text(sidecar)})

    return of


def joint_world(**fields):
    """A wheel of 1 kg m² on a hinge, or 1 kg on a slide."""
    joint = Joint("j", fields.pop("kind", "hinge"), None, Pose(), (0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    inertial = Inertial(1.0, inertia=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    body = Body("b", "b", inertial, dataclasses.replace(joint, **fields))
    return World("joint", (body,), physics=Physics(gravity=(0.0, 0.0, 0.0), timestep=DT, steps=10))


@pytest.mark.parametrize("name", [name for name in SHARED if name not in REFUSED])
def test_the_inventory_equals_the_expectation_of_the_world(name, load):
    world = WORLDS[name]("ode")
    back = load(world).read_back()
    (check,) = inventory_checks(Ode.expected_inventory(world, back.neutral), back.inventory)
    assert check.passed, check.detail
    assert check.count > 30


@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_stops_at_its_limit_within_the_step(kind, side, load):
    engine = load(joint_world(kind=kind, position_limits=(-0.0105, 0.0105), velocity=(2.0 * side,)))
    engine.step(5)
    assert engine.get_state()[0] == pytest.approx(0.01 * side)  # no step begins within reach of it
    engine.step(1)
    q, v = engine.get_state()
    assert q == pytest.approx(0.0105 * side, abs=1e-9)
    assert v == pytest.approx(0.5 * side, abs=1e-6)  # of the remaining distance
    engine.step(10, np.array([3.0 * side]))
    q, v = engine.get_state()
    assert q == pytest.approx(0.0105 * side, abs=1e-9)
    assert v == pytest.approx(0.0, abs=1e-8)
    engine.step(1, np.array([-3.0 * side]))  # it leaves at once
    assert engine.get_state()[1] == pytest.approx(-3.0 * DT * side, rel=1e-6)


@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_dry_friction_holds_and_brakes(kind, load):
    engine = load(joint_world(kind=kind, dry_friction=2.0))
    engine.step(10, np.array([1.9]))
    assert engine.get_state()[1] == pytest.approx(0.0, abs=1e-15)
    engine.step(10, np.array([5.0]))
    assert engine.get_state()[1] == pytest.approx(0.03, rel=1e-12)
    engine.disable_dry_friction(np.array([0]))
    engine.step(10, np.array([5.0]))
    assert engine.get_state()[1] == pytest.approx(0.08, rel=1e-12)


def test_armature_is_felt_by_stops_and_efforts(load):
    engine = load(joint_world(armature=3.0))
    engine.step(10, np.array([8.0]))
    assert engine.get_state()[1] == pytest.approx(0.02, rel=1e-12)
    assert engine.mass_matrix() == pytest.approx(np.array([[4.0]]), rel=1e-12)


def accepted(world, *kinds):
    return worlds.with_options(world, "ode", accept=tuple(f"shape.{kind}" for kind in kinds))


def test_line_contacts_with_a_single_point_must_be_accepted_where_they_may_occur():
    with pytest.raises(UnsupportedError, match="contacts of cylinders with cylinders"):
        compile_world(boxes(2, kind="cylinder"), ["ode"])
    compile_world(accepted(boxes(2, kind="cylinder"), "cylinder"), ["ode"])
    compile_world(boxes(1, kind="cylinder"), ["ode"])


def test_cylinders_stand_on_each_other_in_eight_points(load):
    engine = load(accepted(boxes(3, kind="cylinder"), "cylinder"))
    engine.step(400)
    q, _ = engine.get_state()
    heights = q.reshape(3, 7)[:, :3]
    stacked = np.array([[0.0, 0.0, 0.05 + 0.1 * index] for index in range(3)])
    assert heights == pytest.approx(stacked, abs=9.81 * DT**2)  # the first step, in which nothing overlaps yet
    contacts = engine.contacts()
    assert len(contacts["normal"]) == 8 * 3
    assert np.abs(np.abs(contacts["normal"][:, 2]) - 1.0).max() < 1e-9


def with_moments(world, friction, torsional, rolling, velocity):
    """``world`` with one law of all friction, and every body at a velocity."""
    contact = Contact(
        world.contact.friction_cone,
        (Material("a", friction, torsional_friction=torsional, rolling_friction=rolling),),
        (PairContact("a", "a", friction, 0.0, torsional, rolling),),
    )
    bodies = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, velocity=velocity))
        if body.joint.kind == "free"
        else body
        for body in world.bodies
    )
    return dataclasses.replace(world, bodies=bodies, contact=contact)


@pytest.mark.parametrize("cone", ["elliptic", "pyramid-circumscribed"])
@pytest.mark.parametrize(
    ("kind", "axis", "friction"),
    [("box", 5, 0.0), ("sphere", 5, 0.0), ("sphere", 4, 0.0), ("sphere", 5, 0.5), ("sphere", 4, 0.5)],
)
def test_friction_moments_slow_rotations_by_c_n_on_any_number_of_points(kind, axis, cone, friction, load):
    """A box spins on four points whose rows of torsion are the same, a ball on one; without sliding friction the law has one
    torque alone, and with it what rolls slows down as much as friction needs."""
    c, inertia, speed = 0.002, 0.00166, 3.0
    velocity = [0.0] * 6
    velocity[axis] = speed
    slower = c * 9.81 / inertia
    if friction and axis == 4:  # rolls: m a = -F, I alpha = F r - c N
        velocity[0] = speed * 0.05
        slower = c * 9.81 / (inertia + 0.05**2)
    world = with_moments(boxes(1, kind=kind), friction, c, c, tuple(velocity))
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, friction_cone=cone))
    engine = load(world)
    engine.step(51)
    before = engine.get_state()[1][axis]
    engine.step(50)
    assert before - engine.get_state()[1][axis] == pytest.approx(slower * 50 * DT, rel=2e-3)
    assert engine.log() == []


def test_rolling_friction_acts_against_the_turning_and_is_a_disc(load):
    """At 45° to the axes the torque is c N, not √2 c N."""
    turning = (0.0, 0.0, 0.0, 3.0, 3.0, 0.0)
    engine = load(with_moments(boxes(1, kind="sphere"), 0.0, 0.0, 0.002, turning))
    engine.step(51)
    before = engine.get_state()[1][3:]
    engine.step(50)
    lost = before - engine.get_state()[1][3:]
    assert np.hypot(*lost[:2]) == pytest.approx(0.002 * 9.81 / 0.00166 * 50 * DT, rel=1e-3)
    assert lost[0] == pytest.approx(lost[1], rel=1e-6)


def test_steps_of_redundant_points_at_their_limits_are_solved(load):
    """Ten steps of these were left without a solution before points were separated by a small distance."""
    engine = load(with_moments(boxes(3), 0.5, 0.001, 0.001, (0.3, 0.1, 0.0, 0.0, 0.0, 5.0)))
    engine.step(300)
    assert not [line for line in engine.log() if "did not solve" in line]
    assert np.isfinite(engine.get_state()[0]).all()


def _moving_plane(content, _):
    content["bodies"][1]["shapes"][0].update(kind="plane", size=[])


def _no_inverse(content, _):
    content["bodies"][1]["inertia"] = [0.0] * 6


def _inertia_without_mass(content, _):
    content["bodies"][1]["mass"] = 0.0


def _additional_numbers(_, sidecar):
    sidecar["laws"][0]["hardness"].update(damping=0.01)


def _soft(_, sidecar):
    sidecar["laws"][0]["hardness"].update(kind="stiffness", stiffness=1e4)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_moving_plane, "plane 'b0_0' on a body that moves"),
        (_no_inverse, "inertia of 'b0'"),
        (_inertia_without_mass, "inertia of 'b0', which has no mass"),
        (_soft, "hardness stiffness"),
        (_additional_numbers, "numbers that deviate from the common hardness"),
        (lambda content, sidecar: sidecar["settings"].pop("softness"), "softness"),
        (lambda content, sidecar: sidecar["settings"].update(solver="slow"), "solver|slow"),
    ],
)
def test_features_that_ode_lacks_are_rejected_on_load(change, said, load):
    with pytest.raises(EngineError, match=said):
        load(boxes(1), change)


BY_SWEEPS = ("material.friction",)
"""Accepted of quick-step where bodies can lean on each other."""


def test_quick_step_is_accepted_by_name_where_bodies_can_lean():
    stacked = worlds.with_options(boxes(2), "ode", settings=(("solver", "quick-step"),))
    with pytest.raises(UnsupportedError, match=r"material.friction only approximately: With `solver: quick-step`"):
        compile_world(stacked, ["ode"])
    alone = worlds.with_options(boxes(1), "ode", settings=(("solver", "quick-step"),))
    assert compile_world(alone, ["ode"])


def test_the_setting_selects_quick_step(load):
    def settled(**settings):
        world = worlds.with_options(boxes(2), "ode", settings=tuple(settings.items()), accept=BY_SWEEPS)
        engine = load(world)
        engine.step(100)
        return engine.read_back().inventory["solver"], engine.get_state()[0][[2, 9]]

    solver, exact = settled()
    quick, near = settled(solver="quick-step", iterations=500)
    assert (solver, quick) == ("step", "quick-step")
    assert near == pytest.approx(exact, abs=1e-5)
    assert not np.array_equal(near, exact)


def test_a_quick_step_depends_on_the_state_alone(load):
    """ODE shuffles its rows, by one generator for all worlds of a process."""
    settings = (("solver", "quick-step"), ("iterations", 9))
    engine = load(worlds.with_options(boxes(3), "ode", settings=settings, accept=BY_SWEEPS))
    start, ends = engine.get_state(), []
    for _ in range(3):
        engine.set_state(*start)
        engine.step(30)
        ends.append(engine.get_state()[0])
    assert np.array_equal(ends[0], ends[1])
    assert np.array_equal(ends[0], ends[2])


def test_a_box_on_a_ramp_of_redundant_points_feels_friction_in_every_step(load):
    """With four points one is redundant: steps that ODE cannot solve would lack friction."""
    world = boxes(1, friction=1.0)
    tilted = dataclasses.replace(world.physics, gravity=(9.81 * math.sin(0.5), 0.0, -9.81 * math.cos(0.5)))
    engine = load(dataclasses.replace(world, physics=tilted))
    engine.step(500)
    assert abs(engine.get_state()[0][0]) < 9.81 * DT**2  # the first step, in which nothing overlaps yet
    assert engine.log() == []


@pytest.mark.parametrize("part", ["mass", "moments"])
@pytest.mark.parametrize(("ratio", "taken"), [(1e6, True), (1e8, False)])
def test_trees_of_masses_out_of_all_proportion_are_refused(part, ratio, taken):
    """There the mass matrix is more than 1e-9 off: joints are constraints between bodies."""
    world = shipped.hinges()
    heavy, light = world.bodies[1], world.bodies[2]
    inertial = dataclasses.replace(heavy.inertial, mass=1.0, inertia=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    share = {"mass": 1.0 / ratio} if part == "mass" else {"inertia": tuple(value / ratio for value in inertial.inertia)}
    local = dataclasses.replace(inertial, **share)
    bodies = (
        world.bodies[0],
        dataclasses.replace(heavy, inertial=inertial),
        dataclasses.replace(light, inertial=local),
        *world.bodies[3:],
    )
    world = dataclasses.replace(world, bodies=bodies)
    if taken:
        compile_world(world, ["ode"])
        return
    with pytest.raises(UnsupportedError, match=f"ODE loses digits .*here 1e\\+08: {light.name!r} has [13]e-08 kg"):
        compile_world(world, ["ode"])
