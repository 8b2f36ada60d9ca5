"""Rapier: its read-back, its laws by a hook, numbers of single precision, refusals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from simspec.engines.rapier.engine import Rapier
from simspec.errors import EngineError
from simspec.proof.checks import PRECISIONS, inventory_checks
from simspec.world import frames
from simspec.world.types import Inertial, Joint, Pose
from tests.engines.free_bodies import (
    DT,
    GRAVITY,
    NOT_WRITTEN,
    ball,
    check_inventory,
    check_parts,
    check_refused,
    loader,
    of,
    scene,
    shared,
)

pytestmark = pytest.mark.skipif(Rapier.version() is None, reason="rapier3d is not installed")


@pytest.fixture
def load(load_files):
    return loader(Rapier, load_files)


@pytest.mark.parametrize("name", list(shared("rapier")))
def test_the_inventory_equals_the_expectation_of_the_world(name, load):
    check_inventory(name, Rapier, load, 60)


def test_the_inventory_has_every_field_of_the_installed_version():
    import rapier3d

    from simspec.engines.rapier import inventory

    def fields(of):
        return {name for name in dir(of) if name[0] != "_" and not callable(getattr(of, name))}

    world = rapier3d.PhysicsWorld()
    body = world.rigid_bodies[world.add_body(rapier3d.RigidBody.dynamic())]
    collider = world.colliders[world.add_collider(rapier3d.Collider.ball(1.0))]
    assert fields(world.integration_parameters) == {*inventory.PARAMETERS.table, *inventory.SEPARATE}
    elsewhere = (
        "activation angvel body_type center_of_mass colliders enabled_rotations enabled_translations inv_mass linvel "
    )
    elsewhere += (
        "is_dynamic is_fixed is_kinematic is_moving is_sleeping local_center_of_mass locked_axes mass mass_properties "
    )
    elsewhere += (
        "gravity_scale next_position position rotation soft_body soft_cluster translation user_force user_torque"
    )
    assert fields(body) == {*inventory.BODY.table, *elsewhere.split()} - {"type", "sleeps"}
    elsewhere = "deformable_mesh_ref mass mass_properties material parent position position_wrt_parent rotation "
    elsewhere += "rotation_wrt_parent shape translation translation_wrt_parent volume"
    assert fields(collider) == {*inventory.COLLIDER.table, *elsewhere.split()} - {"kind"}


CHANGES = {
    "sweeps": lambda world, body, shape: setattr(world.integration_parameters, "num_internal_pgs_iterations", 4),
    "stabilisation": lambda world, body, shape: setattr(
        world.integration_parameters, "num_internal_stabilization_iterations", 1
    ),
    "prediction": lambda world, body, shape: setattr(
        world.integration_parameters, "normalized_prediction_distance", 2e-6
    ),
    "a body's damping": lambda world, body, shape: setattr(body, "linear_damping", 1e-3),
    "a body's axes": lambda world, body, shape: setattr(body, "enabled_rotations", (True, True, False)),
    "gyroscopic forces": lambda world, body, shape: setattr(body, "gyroscopic_forces_enabled", True),
    "a skin": lambda world, body, shape: setattr(shape, "contact_skin", 1e-3),
    "a sensor": lambda world, body, shape: setattr(shape, "is_sensor", True),
    "a shape's friction": lambda world, body, shape: setattr(shape, "friction", 0.1),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_any_other_change_in_the_live_engine_is_found(change, load):
    world = scene(ball("ball", (0.0, 0.0, 0.1)), law=(0.5, 0.5))
    engine = load(world)
    sim = engine._simulation
    change(sim.world, sim.bodies.bodies[0], sim.world.colliders[sim.built.colliders[1]])
    back = engine.read_back()
    (check,) = inventory_checks(Rapier.expected_inventory(world, back.neutral), back.inventory, PRECISIONS["single"])
    assert not check.passed


def test_a_mass_of_a_fixed_body_is_found(load):
    world = scene(ball("ball", (0.0, 0.0, 0.1)))
    engine = load(world, lambda content, sidecar: of("floor")(content).update(mass=0.01))
    back = engine.read_back()
    (check,) = inventory_checks(Rapier.expected_inventory(world, back.neutral), back.inventory, PRECISIONS["single"])
    assert not check.passed
    assert "floor.mass" in check.detail or "floor.mass" in check.where


def test_every_two_materials_have_a_law(load):
    """Boxes that slide on a floor: each is braked by its own μ g, by the hook; with one law for all no hook is called."""
    boxes = [
        ball(name, (float(row), 0.0, 0.1), (1.0, *[0.0] * 5), "box", (0.2, 0.2, 0.2), name)
        for row, name in enumerate("abc")
    ]
    boxes = [
        dataclasses.replace(box, joint=dataclasses.replace(box.joint, velocity=(0.0, 1.0, *[0.0] * 4))) for box in boxes
    ]
    world = scene(*boxes)
    mu = {"a": 0.2, "b": 0.4, "c": 0.7}
    pairs = tuple(
        dataclasses.replace(pair, friction=mu[pair.first]) if pair.second == "floor" and pair.first in mu else pair
        for pair in world.contact.pairs
    )
    engine = load(dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs)))
    engine.step(100)
    speeds = engine.get_state()[1].reshape(3, 6)[:, 1]
    assert speeds == pytest.approx([1.0 - value * GRAVITY * 0.1 for value in mu.values()], abs=1e-4)
    assert load(world)._simulation.built.laws.uniform == (0.5, 0.0, 0.0)
    assert engine._simulation.built.laws.uniform is None


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_an_impact_that_slips_has_the_friction_of_its_whole_impulse(restitution, load):
    engine = load(scene(ball("ball", (0.0, 0.0, 0.1 + 1.5e-3), (6.0, 0.0, -2.0, *[0.0] * 3)), law=(0.5, restitution)))
    engine.step(4)
    slowed = 6.0 - engine.get_state()[1][0]
    assert slowed == pytest.approx(0.5 * (1.0 + restitution) * 2.0, rel=0.03)


def test_approaches_slower_than_the_threshold_do_not_bounce(load):
    speeds = []
    for speed in (0.4, 0.6):
        world = scene(
            ball("ball", (0.0, 0.0, 0.1001), (0.0, 0.0, -speed, *[0.0] * 3)), law=(0.0, 0.5), restitution_threshold=0.5
        )
        engine = load(world)
        engine.step(3)
        speeds.append(engine.get_state()[1][2])
    assert speeds[0] == pytest.approx(0.0, abs=0.02)
    assert speeds[1] == pytest.approx(0.3, abs=0.03)


def test_an_overlap_is_left_by_the_common_law(load):
    engine = load(scene(ball("ball", (0.0, 0.0, 0.1 - 5e-5))))
    engine.step(1)
    assert engine.get_state()[1][2] == pytest.approx(0.01 * 5e-5 / DT, rel=1e-3)


def test_states_that_are_set_forget_and_states_that_are_moved_to_do_not(load):
    world = scene(*(ball(str(row), (0.0, 0.0, 0.1 + 0.2 * row), kind="box", size=(0.2, 0.2, 0.2)) for row in range(4)))
    engine, fresh = load(world), load(world)
    engine.step(50)
    q, v = engine.get_state()
    fresh.set_state(q, v)
    engine.set_state(q, v)
    for entry in (engine, fresh):
        entry.step(1)
    assert engine.get_state()[1].tobytes() == fresh.get_state()[1].tobytes()
    engine.move_to(q, v)
    assert engine.get_state()[0] == pytest.approx(q, abs=1e-7)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_bodies_that_an_effort_turns_fast_are_rotated_fully(friction, load):
    """Rapier's own turn is 1.7e-4 rad short after this. Of balls without friction it is looked for only where it may be."""
    engine = load(scene(ball("ball", (0.0, 0.0, 20.0)), law=(friction, 0.0)))
    sim = engine._simulation
    assert bool(sim.bodies.watched) == bool(friction)
    engine.step(1)
    engine.step(300, np.array([0.0, 0.0, 0.0, 0.0, 2.0, 0.0]))
    gained = 2.0 / 0.02 * DT
    angle = gained * DT * 300 * 301 / 2
    q, v = engine.get_state()
    assert v[4] == pytest.approx(300 * gained, rel=1e-5)
    assert abs(2.0 * math.atan2(q[5], q[3])) == pytest.approx(angle, abs=1e-5)
    engine.set_state(q, 0.0 * v)
    assert bool(sim.bodies.watched) == bool(friction)


def test_shapes_of_massless_bodies_are_parts_of_their_carriers(load):
    check_parts(load)


@pytest.mark.parametrize(("change", "why"), [NOT_WRITTEN[1]])
def test_features_not_written_for_rapier_are_refused_by_name(change, why):
    check_refused(change, why, "rapier")


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda content: of("ball")(content).update(mass=0.0), "moves and has no mass"),
        (lambda content: of("ball")(content).update(inertia=[0.02, 0.02, 0.0, 0.0, 0.0, 0.0]), "has no inverse"),
        (lambda content: of("ball")(content).update(mass=1e39), "there is no 1e[+]39"),
        (lambda content: of("ball")(content).update(mass=1e-42), "there is no 1e-42"),
        (lambda content: content.update(friction_cone="pyramid-inscribed"), "cone"),
        (
            lambda content: of("ball")(content)["shapes"][0].update(kind="capsule", size=[0.1, -0.2]),
            "capsule of the size -0.2",
        ),
    ],
)
def test_numbers_that_rapier_takes_in_silence_are_refused(change, why, load):
    def edit(content, sidecar):
        change(content)
        sidecar["friction_cone"] = content["friction_cone"]

    with pytest.raises(EngineError, match=why):
        load(scene(ball("ball", (0.0, 0.0, 0.5))), edit)


def test_a_state_that_is_no_longer_finite_is_an_error(load):
    engine = load(scene(ball("ball", (0.0, 0.0, 0.5))))
    with pytest.raises(EngineError, match="there is no nan"):
        engine.set_state(np.full(7, math.nan), np.zeros(6))
    engine.set_state(np.array([0.0, 1e-59, 0.5, 1.0, 0.0, 0.0, 0.0]), np.full(6, -1e-200))  # zero, to 1e-38
    assert engine.get_state()[0][1] == pytest.approx(0.0, abs=1e-37)
    with pytest.raises(EngineError, match="the state of ball is no longer finite"):
        engine.step(3, np.array([0.0, 0.0, 0.0, 2e32, 2e32, 2e32]))


UNIT = st.floats(-1.0, 1.0).map(lambda share: round(share, 3))
TURN = st.tuples(UNIT, UNIT, UNIT, UNIT).filter(any).map(frames.normalise)
ALONE = {"max_examples": 60, "deadline": None, "suppress_health_check": [HealthCheck.function_scoped_fixture]}


@settings(**ALONE)
@given(
    edges=st.tuples(*[st.sampled_from((0.0, 1e-6, 1e-3, 0.3, 0.9, 1.0))] * 3),
    axes=TURN,
    kinds=st.lists(st.tuples(st.sampled_from(("sphere", "box", "capsule")), TURN, UNIT), min_size=1, max_size=3),
    size=st.sampled_from((1e-5, 1e-2, 4.0)),
)
def test_inertias_are_stored_for_all_shapes(edges, axes, kinds, size, load):
    """Rapier adds the masses of colliders, none here, and finds axes of the sum anew, by a formula that loses digits. The
    masses remain those of the bodies, also after steps, in a state that is set, and where nothing touches."""
    moments = tuple(
        size * (0.1 + of_edges) for of_edges in (edges[1] + edges[2], edges[0] + edges[2], edges[0] + edges[1])
    )
    inertia = frames.rotate_inertia(axes, (*moments, 0.0, 0.0, 0.0))
    sizes = {"sphere": (0.1,), "box": (0.1, 0.2, 0.3), "capsule": (0.1, 0.4)}
    shapes = tuple(
        dataclasses.replace(
            ball("body", (0.0, 0.0, 1.0)).shapes[0], name=f"body_{number}", kind=kind, size=sizes[kind], pose=pose
        )
        for number, (kind, turn, aside) in enumerate(kinds)
        for pose in (Pose((0.1 * aside, 0.0, 0.05), turn),)
    )
    body = dataclasses.replace(ball("body", (0.0, 0.0, 1.0)), inertial=Inertial(0.125, inertia=inertia), shapes=shapes)
    engine = load(scene(body))

    def actual():
        return next(body for body in engine.read_back().bodies if body.name == "body").inertial.inertia

    near = pytest.approx(inertia, rel=3e-7, abs=3e-7 * max(moments))
    assert actual() == near
    engine.step(3)
    assert actual() == near
    engine.set_state(*engine.get_state())
    engine.step(1)
    assert actual() == near
    engine.disable_contact()
    engine.step(1)
    assert actual() == near


def test_a_box_on_a_table_is_not_thrown_through_it(load):
    """Rapier keeps the normal of two shapes while they only move along it: also from where they were when it saw them first."""
    table = ball("table", (0.0, 0.0, 0.1))
    joint = Joint("table_joint", "fixed", origin=Pose((0.0, 0.0, 0.1)))
    top = dataclasses.replace(table.shapes[0], kind="box", size=(4.0, 4.0, 0.2))
    table = dataclasses.replace(table, joint=joint, inertial=Inertial(0.0), shapes=(top,))
    engine = load(scene(table, ball("box", (0.0, 0.0, 0.3), kind="box", size=(0.2, 0.2, 0.2))))
    for _ in range(2):
        engine.step(100)
        q, v = engine.get_state()
        assert q[2] == pytest.approx(0.3, abs=1e-6)
        engine.set_state(np.array([0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]), 0.0 * v)


def test_a_fixed_body_without_mass_may_have_moments(load):
    """SDF of a static model often has both so; Rapier keeps no moments without a mass, and nothing depends on them."""
    ground = dataclasses.replace(
        ball("ground", (0.0, 0.0, 0.0)),
        joint=Joint("ground_joint", "fixed", origin=Pose()),
        inertial=Inertial(0.0, inertia=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0)),
    )
    world = scene(ground, ball("ball", (0.0, 0.0, 1.0)))
    back = load(world).read_back()
    (check,) = inventory_checks(Rapier.expected_inventory(world, back.neutral), back.inventory, PRECISIONS["single"])
    assert check.passed, check.detail
