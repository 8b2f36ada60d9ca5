"""Newton: its read-back and inventory, limits, springs, rotations, room for contacts, refusals."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.dynamics.oracle import Oracle
from simspec.engines.newton.engine import Newton
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.checks import PRECISIONS, inventory_checks
from simspec.testing import worlds as shipped
from simspec.world.kinematics import initial_state
from simspec.world.types import Body, Inertial, Joint, Physics, Pose, World
from tests import worlds
from tests.engines.free_bodies import DT, ball, check_inventory, loader, of, scene, shared

installed = pytest.mark.skipif(Newton.version() is None, reason="newton is not installed")
DIGITS = 1e-6


@pytest.fixture
def load(load_files):
    return loader(Newton, load_files)


@installed
def test_worlds_in_a_process_share_kernels(load):
    kernels = []
    for _ in range(2):
        engine = load(scene(ball("one", (0.0, 0.0, 0.1))))
        engine.step(1)
        pipeline = engine._simulation.built.pipeline(engine._simulation.room)
        kernels.append((pipeline.narrow_phase.primitive_kernel, pipeline.narrow_phase.narrow_phase_kernel))
    assert kernels[0] == kernels[1]


def joint_world(**fields):
    """A wheel of 1 kg m² on a hinge, or 1 kg on a slide."""
    joint = Joint("j", fields.pop("kind", "hinge"), None, Pose(), (0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    inertial = Inertial(1.0, inertia=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    body = Body("b", "b", inertial, dataclasses.replace(joint, **fields))
    return World("joint", (body,), physics=Physics(gravity=(0.0, 0.0, 0.0), timestep=DT, steps=10))


def wrist(root: Joint) -> World:
    """A long arm on a root, and at its end a light body: 0.2 kg at 1.2 m, of 1e-4 kg m² about its hinge."""
    base = Body("base", "base", Inertial(4.0, (0.3, 0.0, 0.0), (0.01, 0.01, 0.01, 0.0, 0.0, 0.0)), root)
    shoulder = Joint("shoulder", "hinge", "base", Pose(), (0.0, 1.0, 0.0), position=(0.3,), velocity=(1.0,))
    arm = Body("arm", "base", Inertial(10.0, (0.6, 0.0, 0.0), (0.1, 1.0, 1.0, 0.0, 0.0, 0.0)), shoulder)
    turn = Joint("turn", "hinge", "arm", Pose((1.2, 0.0, 0.0)), (0.0, 1.0, 0.0), position=(0.7,), velocity=(-2.0,))
    hand = Body("hand", "base", Inertial(0.2, (0.01, 0.0, 0.0), (1e-4, 8e-5, 1e-4, 0.0, 0.0, 0.0)), turn)
    return World("wrist", (base, arm, hand), physics=Physics(timestep=DT, steps=10))


STANDING = Joint("base_joint", "fixed", None, Pose((0.1, 0.2, 0.5)))


# --- what is stored ---------------------------------------------------------------------------------------------


@installed
@pytest.mark.parametrize("name", list(shared("newton")))
def test_the_inventory_equals_the_expectation_of_the_world(name, load):
    check_inventory(name, Newton, load, 50)


CHANGES = {
    "damping of free bodies": lambda sim: sim.built.model.steel.rigid_body_angular_damping.fill_(0.05),
    "a bound of their speed": lambda sim: sim.built.model.steel.rigid_body_max_angular_velocity.fill_(100.0),
    "torsional friction": lambda sim: sim.built.model.shape_material_mu_torsional.fill_(0.005),
    "a gap": lambda sim: sim.built.model.shape_gap.fill_(0.1),
    "armature of a free body": lambda sim: sim.built.model.joint_armature.fill_(0.1),
    "a drive": lambda sim: sim.built.model.joint_target_kd.fill_(1.0),
    "the solver's error reduction": lambda sim: setattr(sim.recorded().solver, "baumgarte", 0.2),
    "the solver's relaxation": lambda sim: setattr(sim.recorded().solver, "relaxation", 0.9),
}


@installed
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_any_other_change_in_the_live_engine_is_found(change, load):
    world = scene(ball("ball", (0.0, 0.0, 0.1)), law=(0.5, 0.5))
    engine = load(world)
    change(engine._simulation)
    back = engine.read_back()
    (check,) = inventory_checks(Newton.expected_inventory(world, back.neutral), back.inventory, PRECISIONS["single"])
    assert not check.passed


# --- joints -----------------------------------------------------------------------------------------------------


@installed
@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_stops_at_its_limit_within_the_step(kind, side, load):
    engine = load(joint_world(kind=kind, position_limits=(-0.0105, 0.0105), velocity=(2.0 * side,)))
    engine.step(5)
    assert engine.get_state()[0] == pytest.approx(0.01 * side, rel=DIGITS)  # no step begins within reach of it
    engine.step(1)
    q, v = engine.get_state()
    assert q == pytest.approx(0.0105 * side, rel=DIGITS)
    assert v == pytest.approx(0.5 * side, abs=1e-5)  # of the remaining distance
    engine.step(10, np.array([3.0 * side]))
    q, v = engine.get_state()
    assert q == pytest.approx(0.0105 * side, rel=DIGITS)
    assert v == pytest.approx(0.0, abs=1e-5)
    engine.step(1, np.array([-3.0 * side]))  # it leaves at once
    assert engine.get_state()[1] == pytest.approx(-3.0 * DT * side, abs=1e-5)


@installed
def test_springs_act_as_the_law_has_them_although_newton_leaves_them_out(load):
    world = joint_world(kind="slide", spring_stiffness=200.0, spring_rest=0.1)
    engine = load(world)
    engine.step(1)
    assert engine.get_state()[1] == pytest.approx(200.0 * 0.1 * DT, rel=DIGITS)
    assert engine._simulation.built.model.joint_stiffness.numpy().tolist() == [0.0]


@installed
def test_the_rest_of_a_joint_is_read_back_without_a_spring_too(load):
    joint = load(joint_world(spring_rest=0.1)).read_back().bodies[0].joint
    assert (joint.spring_stiffness, joint.spring_rest) == (0.0, 0.1)


@installed
@pytest.mark.parametrize("make", [shipped.every_joint, shipped.fall], ids=["joints", "fall"])
def test_a_step_from_any_state_is_that_of_the_law(make, load):
    world = make()
    engine, oracle = load(world), Oracle(world)
    engine.disable_contact()
    q, v = engine.get_state()
    v = np.random.default_rng(1).normal(size=len(v))
    engine.set_state(q, v)
    engine.step(1)
    expected = oracle.motion(q, v, None, 1, 1)[1][-1]
    assert engine.get_state()[1] == pytest.approx(expected, abs=2e-6 * np.abs(expected).max())


@installed
def test_light_links_far_from_a_root_that_cannot_move_keep_their_digits(load):
    world = wrist(STANDING)
    engine, oracle = load(world), Oracle(world)
    q, v = engine.get_state()
    for number, turned in enumerate((0.0, 1.5)):
        q = q + turned
        engine.set_state(q, v)
        engine.step(1)
        expected = oracle.motion(q, v, None, 1, 1)[1][-1] - v
        assert engine.get_state()[1] - v == pytest.approx(expected, abs=1e-5 * np.abs(expected).max()), number


@installed
def test_the_origin_of_a_tree_follows_its_lightest_link(load):
    engine = load(wrist(STANDING))
    q, v = engine.get_state()
    engine.set_state(q + 1.0, v)
    model, state = engine._simulation.built.model, engine._simulation.state
    centres, poses = model.body_com.numpy(), state.body_q.numpy()
    at = poses[0, :3] + centres[0]  # the base is not turned
    x, y, z, w = poses[2, 3:]
    along = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)
    assert at == pytest.approx(poses[2, :3] + 0.01 * np.array(along), abs=1e-6)
    assert model.body_mass.numpy()[0] == 0.0


def test_light_links_far_from_a_root_that_moves_are_accepted_by_name():
    compile_world(wrist(STANDING), ["newton"])
    loose = wrist(Joint("base_joint", "free", position=(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6))
    with pytest.raises(UnsupportedError, match="light links far from it lose digits"):
        compile_world(loose, ["newton"])
    compile_world(worlds.with_options(loose, "newton", accept=("body.inertia",)), ["newton"])


@installed
def test_a_body_that_turns_fast_turns_by_the_exponential_map(load):
    spin = 40.0
    turning = ball("ball", (0.0, 0.0, 5.0), velocity=(0.0, 0.0, 0.0, 0.0, 0.0, spin))
    engine = load(dataclasses.replace(scene(turning), physics=Physics(gravity=(0.0, 0.0, 0.0), timestep=DT, steps=10)))
    engine.step(1000)
    w, _, _, z = engine.get_state()[0][3:7]
    turned = 2.0 * np.arctan2(z, w)
    lag = 1000 * (spin * DT) ** 3 / 12.0
    assert abs((turned - spin + np.pi) % (2.0 * np.pi) - np.pi) < 0.05 * lag


# --- contact ----------------------------------------------------------------------------------------------------


@installed
def test_a_step_is_repeated_with_more_room_where_contacts_had_none(load):
    from simspec.engines.kit.link_contacts import ContactRoom

    world = scene(*(ball(f"b{i}", (0.5 * i, 0.0, 0.099), kind="box", size=(0.2, 0.2, 0.2)) for i in range(4)))
    enough, scarce = load(world), load(world)
    scarce._simulation.room = ContactRoom(2, 2)
    enough.step(20)
    scarce.step(20)
    assert scarce._simulation.room == ContactRoom(16, 2)
    assert scarce.get_state()[0].tobytes() == enough.get_state()[0].tobytes()


@installed
def test_a_step_is_repeated_with_more_room_where_rows_of_trees_had_none(load):
    from simspec.engines.kit.link_contacts import ContactRoom

    arm, box = joint_world(position_limits=(-1.0, 1.0)), ball("box", (0.3, 0.0, 0.1))
    world = dataclasses.replace(scene(box), bodies=(*scene(box).bodies, *arm.bodies))
    enough, scarce = load(world), load(world)
    assert enough._simulation.room.rows >= 64
    assert load(scene(box))._simulation.room.rows == 1  # which costs time, and is for trees alone
    scarce._simulation.room = ContactRoom(64, 1)
    for engine in (enough, scarce):
        engine.step(20)
    assert scarce._simulation.room == ContactRoom(64, 2)
    assert scarce.get_state()[0].tobytes() == enough.get_state()[0].tobytes()


@installed
def test_contacts_of_a_box_at_rest_carry_its_weight(load):
    engine = load(scene(ball("box", (0.0, 0.0, 0.1), kind="box", size=(0.2, 0.2, 0.2))))
    engine.step(200)
    contacts = engine.contacts()
    mass = engine.read_back().bodies[-1].inertial.mass
    assert contacts["normal_force"].sum() == pytest.approx(9.81 * mass, rel=1e-4)
    assert np.abs(contacts["distance"]).max() < 1e-5
    assert np.abs(np.abs(contacts["normal"][:, 2]) - 1.0).max() < DIGITS


def tower(*masses, warm=True, **more):
    """Boxes of these masses (kg) on each other, of which the first step begins cold."""
    boxes = (
        ball(str(row), (0.0, 0.0, 0.1 + 0.2 * row), kind="box", size=(0.2, 0.2, 0.2)) for row in range(len(masses))
    )
    weighed = [
        dataclasses.replace(box, inertial=Inertial(mass, inertia=(mass / 150.0,) * 3 + (0.0,) * 3))
        for box, mass in zip(boxes, masses, strict=True)
    ]
    return shipped.with_options(scene(*weighed, **more), "newton", settings=(("warm_start", warm),))


@installed
@pytest.mark.parametrize("ratio", [10.0, 100.0])
def test_with_warm_start_a_tower_sinks_by_its_regularisation_alone(ratio, load):
    """By g dt2 / beta times 1e-3, and the load of each contact over the lighter mass; at 100 ten times as deep without."""
    sunk = []
    for warm in (True, False):
        engine = load(shipped.accepting(tower(1.0, ratio, warm=warm), "newton"))
        engine.step(1000)
        sunk.append(0.3 - engine.get_state()[0][9])
    assert sunk[0] == pytest.approx(1e-3 * 9.81 * DT**2 / 0.01 * (ratio + 1.0 + ratio), rel=0.03)
    assert ratio < 100.0 or sunk[1] > 10.0 * sunk[0]


@installed
@pytest.mark.parametrize("timestep", [DT / 2, DT, 4 * DT])
def test_warm_start_keeps_the_common_law_of_contact(timestep, load):
    """An overlap shrinks by beta in a step, less the 0.1 % of the weight that its regularisation leaves."""
    sphere = ball("ball", (0.0, 0.0, 0.1 - 5e-5))
    engine = load(shipped.with_options(scene(sphere, timestep=timestep), "newton", settings=(("warm_start", True),)))
    engine.step(1)
    assert engine.get_state()[1][2] == pytest.approx(
        0.01 * 5e-5 / timestep - 1e-3 * 9.81 * timestep, rel=2e-3, abs=2e-7
    )


@installed
def test_states_that_are_set_forget_contact_impulses_and_states_that_are_moved_to_do_not(load):
    world = tower(2.0, 2.0, 2.0, 2.0)
    engine, fresh = load(world), load(world)
    engine.step(50)
    q, v = engine.get_state()
    for entry in (engine, fresh):
        entry.set_state(q, v)
        entry.step(1)
    cold = engine.get_state()[1]
    assert cold.tobytes() == fresh.get_state()[1].tobytes()
    engine.set_state(*initial_state(world))
    engine.step(50)
    assert engine.get_state()[0].tobytes() == q.tobytes()
    engine.move_to(q, v)
    engine.step(1)
    assert np.abs(engine.get_state()[1] - cold).max() > 1e-6


@installed
def test_warm_start_is_read_back(load):
    world = tower(2.0)
    back = load(world).read_back()
    expected = Newton.expected_inventory(world, back.neutral)
    assert (back.inventory["solver.contact_warmstart"], back.inventory["solver.contact_regularization"]) == (True, 1e-3)
    (check,) = inventory_checks(expected, back.inventory, PRECISIONS["single"])
    assert check.passed, check.detail
    (check,) = inventory_checks(expected, load(tower(2.0, warm=False)).read_back().inventory, PRECISIONS["single"])
    assert not check.passed


# --- refusals ---------------------------------------------------------------------------------------------------


def test_dry_friction_of_joints_is_refused_by_name():
    with pytest.raises(UnsupportedError, match="dry friction of joints on graphics processors alone"):
        compile_world(joint_world(dry_friction=1.0), ["newton"])


def test_cylinders_that_may_meet_more_than_round_shapes_and_planes_are_accepted_by_name():
    world = scene(*(ball(f"c{i}", (0.5 * i, 0.0, 1.0), kind="cylinder", size=(0.1, 0.2)) for i in range(2)))
    with pytest.raises(UnsupportedError, match="normals at curved sides"):
        compile_world(world, ["newton"])
    compile_world(worlds.with_options(world, "newton", accept=("shape.cylinder",)), ["newton"])


def test_several_thresholds_of_restitution_are_refused():
    world = scene(ball("a", (0.0, 0.0, 1.0)), ball("b", (0.0, 0.0, 2.0)), law=(0.5, 0.5))
    pairs = tuple(
        dataclasses.replace(pair, restitution_threshold=0.1 * number) for number, pair in enumerate(world.contact.pairs)
    )
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))
    with pytest.raises(UnsupportedError, match="one restitution threshold"):
        compile_world(world, ["newton"])


@installed
def test_files_with_what_newton_does_not_have_are_refused(load):
    def rolling(content, sidecar):
        of("ball")(content)["shapes"][0]["copies"][0]["rolling_friction"] = 0.1

    with pytest.raises(EngineError, match="more than friction and restitution"):
        load(scene(ball("ball", (0.0, 0.0, 1.0))), rolling)

    def massless(content, sidecar):
        of("ball")(content).update(mass=0.0, inertia=[0.0] * 6)

    with pytest.raises(EngineError, match="has no mass"):
        load(scene(ball("ball", (0.0, 0.0, 1.0))), massless)

    def shrunk(content, sidecar):
        of("ball")(content)["shapes"][0]["size"] = [1e-46]

    with pytest.raises(EngineError, match="single precision"):
        load(scene(ball("ball", (0.0, 0.0, 1.0))), shrunk)


@installed
def test_another_timestep_is_that_of_a_world_that_has_it(load):
    world = scene(ball("b", (0.0, 0.0, 0.1), (1.0, 0.0, -1.0, 0.0, 0.0, 0.0)))
    half = load(dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=DT / 2.0)))
    changed = load(world)
    changed.step(1)
    changed.set_timestep(DT / 2.0)
    changed.set_state(*half.get_state())
    for engine in (half, changed):
        engine.step(40)
    assert changed.read_back().timestep == half.read_back().timestep
    assert [part.tobytes() for part in changed.get_state()] == [part.tobytes() for part in half.get_state()]
