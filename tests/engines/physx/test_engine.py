"""PhysX: its read-back, its filter, its unit of length, how bodies turn, refusals."""

from __future__ import annotations

import dataclasses
import itertools
import math
import random

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.physx.engine import PhysX
from simspec.engines.physx.filter import exclusions, kinds, touches
from simspec.engines.physx.turning import turns
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.checks import PRECISIONS, inventory_checks
from tests.engines.free_bodies import (
    DT,
    GRAVITY,
    ball,
    check_inventory,
    check_parts,
    check_refused,
    cylinder,
    loader,
    moving_plane,
    of,
    scene,
    shared,
)

installed = pytest.mark.skipif(PhysX.version() is None, reason="sapien is not installed")


@pytest.fixture
def load(load_files):
    return loader(PhysX, load_files)


# --- what is held -----------------------------------------------------------------------------------------------


@installed
@pytest.mark.parametrize("name", list(shared("physx")))
def test_the_inventory_equals_the_expectation_of_the_world(name, load):
    check_inventory(name, PhysX, load, 50)


@installed
def test_the_inventory_has_every_field_of_the_installed_version():
    from simspec.engines.physx import inventory
    from simspec.engines.physx.units import imported

    physx = imported().physx

    def fields(of):
        methods = ("get_", "set_", "add_", "compute_")
        named = {name for name in dir(of) if name[0] != "_" and not name.startswith(methods)}
        return named - {"attach", "disable", "enable", "put_to_sleep", "wake_up"}

    assert fields(physx.PhysxSceneConfig()) == {*inventory.SCENE.table, "gravity"}
    elsewhere = (
        "angular_velocity cmass_local_pose collision_shapes entity entity_pose gpu_index gpu_pose_index inertia "
    )
    elsewhere += "kinematic_target linear_velocity locked_motion_axes mass max_depenetration_velocity name pose"
    assert fields(physx.PhysxRigidDynamicComponent()) == {*inventory.BODY.table, *elsewhere.split()} - {"locked"}
    shape = physx.PhysxCollisionShapeSphere(1.0, physx.PhysxMaterial(0.5, 0.5, 0.0))
    elsewhere = {"collision_groups", "local_pose", "physical_material", "radius"}
    assert fields(shape) == {*inventory.SHAPE.table, *elsewhere} - {"kind", "static_friction", "restitution"}
    assert fields(shape.physical_material) == {"static_friction", "dynamic_friction", "restitution"}


CHANGES = {
    "a body's damping": lambda sim: setattr(sim.bodies[0], "angular_damping", 1e-3),
    "a body's sweeps": lambda sim: setattr(sim.bodies[0], "solver_position_iterations", 4),
    "a body's weight": lambda sim: setattr(sim.bodies[0], "disable_gravity", True),
    "a body's axes": lambda sim: sim.bodies[0].set_locked_motion_axes([True, *[False] * 5]),
    "a body's sleep": lambda sim: setattr(sim.bodies[0], "sleep_threshold", 0.01),
    "a shape's reach": lambda sim: setattr(sim.built.shapes[1], "contact_offset", 0.02),
    "a shape's rest": lambda sim: setattr(sim.built.shapes[1], "rest_offset", 1e-3),
    "a shape's filter": lambda sim: sim.built.shapes[1].set_collision_groups([0, 0, 0, 0]),
    "static friction": lambda sim: setattr(sim.built.shapes[1].physical_material, "static_friction", 0.6),
}


@installed
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_any_other_change_in_the_live_engine_is_found(change, load):
    world = scene(ball("ball", (0.0, 0.0, 0.1)), law=(0.5, 0.5))
    engine = load(world)
    change(engine._simulation)
    back = engine.read_back()
    (check,) = inventory_checks(PhysX.expected_inventory(world, back.neutral), back.inventory, PRECISIONS["single"])
    assert not check.passed


# --- the filter -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_any_relation_of_few_kinds_is_encoded_in_bits(seed):
    chance = random.Random(seed)
    keys = list(range(chance.randint(1, 40)))
    kind = {key: chance.randrange(6) for key in keys}
    table = {(a, b): chance.random() < 0.5 for a in range(6) for b in range(a, 6)}

    def meet(key, other):
        return table[min(kind[key], kind[other]), max(kind[key], kind[other])]

    found = kinds(keys, meet)
    for index, other in itertools.combinations_with_replacement(keys, 2):
        assert touches((*found[index], 0, 0), (*found[other], 0, 0)) == meet(index, other)


@pytest.mark.parametrize("seed", range(20))
def test_any_pairs_of_bodies_are_excluded_by_bits(seed):
    chance = random.Random(seed)
    names = [f"b{number}" for number in range(12)]
    pairs = {tuple(sorted(chance.sample(names, 2))) for _ in range(chance.randint(1, 25))}
    found = exclusions(pairs)
    for pair in itertools.combinations(names, 2):
        words = [(1, 1, *found.get(name, (0, 0))) for name in pair]
        assert touches(*words) != (tuple(sorted(pair)) in pairs)


def test_bodies_that_all_exclude_each_other_take_a_single_bit_and_a_star_a_bit_for_each():
    names = [f"b{number}" for number in range(50)]
    assert {bits for bits, _ in exclusions(itertools.combinations(names, 2)).values()} == {1}
    with pytest.raises(ValueError, match="here it takes 49"):
        exclusions((names[0], other) for other in names[1:])


def test_more_than_the_filter_can_say_is_refused_by_name():
    bodies = [ball(f"b{number}", (float(number), 0.0, 0.1)) for number in range(40)]
    world = scene(*bodies)
    star = tuple(("b0", body.name) for body in bodies[1:])
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, excluded_bodies=star))
    with pytest.raises(UnsupportedError, match="SAPIEN's filter has 32 bits for bodies"):
        compile_world(world, ["physx"])


# --- motion -----------------------------------------------------------------------------------------------------


def test_the_torque_that_is_given_makes_the_term_of_physx_that_of_the_law():
    generator = np.random.default_rng(1)
    count, dt = 20, 1e-3
    axes = np.linalg.qr(generator.normal(size=(count, 3, 3)))[0]
    tensors = np.einsum("nij,nj,nkj->nik", axes, generator.uniform(0.01, 0.02, (count, 3)), axes)
    spin, torque = generator.normal(size=(count, 3)) * 20.0, generator.normal(size=(count, 3))
    turn = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    found = turns(np.arange(count), turn, spin, torque, tensors, dt)
    begins = np.einsum("nij,nj->ni", tensors, spin)
    given = begins + dt * found.torque
    values = np.linalg.solve(tensors, given[..., None])[..., 0]
    turned = given - dt * np.cross(values, given)
    made = turned * np.linalg.norm(given, axis=1, keepdims=True) / np.linalg.norm(turned, axis=1, keepdims=True)
    assert made == pytest.approx(begins + dt * (torque - np.cross(spin, begins)), abs=1e-12)
    assert np.einsum("nij,nj->ni", tensors, found.spin) == pytest.approx(made, abs=1e-12)


@installed
def test_touching_bodies_turn_as_in_physx_and_roll(load):
    """A ball with spin on the floor: friction takes it along until it rolls, at 2/7 of the rim's speed."""
    engine = load(scene(ball("ball", (0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 0.0, 10.0, 0.0))))
    engine.step(400)
    _, v = engine.get_state()
    inertia, mass, radius = 0.02, 2.0, 0.1
    rolling = 10.0 * inertia / (inertia + mass * radius**2) * radius
    assert v[0] == pytest.approx(rolling, rel=1e-3)
    assert v[4] * radius == pytest.approx(v[0], rel=1e-3)


# --- contact ----------------------------------------------------------------------------------------------------


@installed
@pytest.mark.parametrize("friction", [0.02, 0.5])
@pytest.mark.parametrize("degrees", [0.0, 30.0, 45.0])
def test_the_onset_of_sliding_meets_the_cone_and_not_a_square(friction, degrees, load):
    """In PhysX's unit nothing slides slower than the speed below which it has a square: 1.41 at 45° where that is the metre."""
    engine = load(scene(ball("box", (0.0, 0.0, 0.1), kind="box", size=(0.2, 0.2, 0.2)), law=(friction, 0.0)))
    engine.step(20)
    force = 1.6 * friction * 2.0 * GRAVITY
    effort = np.zeros(6)
    effort[:2] = force * math.cos(math.radians(degrees)), force * math.sin(math.radians(degrees))
    engine.step(5, effort)
    speed = float(np.linalg.norm(engine.get_state()[1][:2]))
    assert speed == pytest.approx(5 * DT * 0.6 * friction * GRAVITY, rel=2e-3)


@installed
@pytest.mark.parametrize("timestep", [5e-4, 4e-3])
def test_an_overlap_is_left_by_the_common_law_from_the_first_step_on(timestep, load):
    depth = 5e-4
    engine = load(scene(ball("ball", (0.0, 0.0, 0.1 - depth)), timestep=timestep))
    for _ in range(10):
        engine.step(1)
        q, v = engine.get_state()
        assert abs(v[2]) < 1e-6  # as is declared
        depth, before = 0.1 - q[2], depth
        assert depth == pytest.approx(0.99 * before, rel=5e-5)


@installed
def test_every_two_materials_have_a_law_by_copies(load):
    static = (0.0, 1.0, *[0.0] * 4)
    size = (0.2, 0.2, 0.2)
    boxes = [ball(name, (float(row), 0.0, 0.1), static, "box", size, name) for row, name in enumerate("abc")]
    world = scene(*boxes)
    mu = {"a": 0.2, "b": 0.4, "c": 0.7}
    pairs = tuple(
        dataclasses.replace(pair, friction=mu[pair.first]) if pair.second == "floor" and pair.first in mu else pair
        for pair in world.contact.pairs
    )
    engine = load(dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs)))
    assert len(engine._simulation.built.shapes) > 4
    engine.step(100)
    speeds = engine.get_state()[1].reshape(3, 6)[:, 1]
    assert speeds == pytest.approx([1.0 - value * GRAVITY * 0.1 for value in mu.values()], abs=1e-4)


@installed
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_an_impact_that_slips_has_the_friction_of_its_whole_impulse(restitution, load):
    velocity = (6.0, 0.0, -2.0, *[0.0] * 3)
    engine = load(scene(ball("ball", (0.0, 0.0, 0.1 + 1.5e-3), velocity), law=(0.5 / 2, restitution)))
    engine.step(4)
    slowed = 6.0 - engine.get_state()[1][0]
    assert slowed == pytest.approx(0.25 * (1.0 + restitution) * 2.0, rel=0.03)


@installed
def test_bodies_at_rest_do_not_hop_though_they_could_bounce(load):
    engine = load(scene(ball("box", (0.0, 0.0, 0.1), kind="box", size=(0.2, 0.2, 0.2)), law=(0.5, 0.9)))
    engine.step(50)
    assert engine.get_state()[0][2] == pytest.approx(0.1, abs=1e-6)


@installed
@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("timestep", [1e-3, 4e-3])
def test_small_drops_come_to_rest_at_any_timestep(restitution, timestep, load):
    engine = load(scene(ball("ball", (0.0, 0.0, 0.1013)), law=(0.5, restitution), timestep=timestep))
    engine.step(600)
    q, v = engine.get_state()
    assert q[2] == pytest.approx(0.1, abs=2e-5)
    assert abs(v[2]) < 1e-4


@installed
def test_approaches_slower_than_the_threshold_do_not_bounce(load):
    speeds = []
    for speed in (0.4, 0.6):
        entry = ball("ball", (0.0, 0.0, 0.1001), (0.0, 0.0, -speed, *[0.0] * 3))
        engine = load(scene(entry, law=(0.0, 0.5), restitution_threshold=0.5))
        engine.step(3)
        speeds.append(engine.get_state()[1][2])
    assert speeds[0] == pytest.approx(0.0, abs=0.02)
    assert speeds[1] == pytest.approx(0.3, abs=0.03)


@installed
def test_states_that_are_set_forget_and_states_that_are_moved_to_do_not(load):
    size = (0.2, 0.2, 0.2)
    world = scene(*(ball(str(row), (0.0, 0.0, 0.1 + 0.2 * row), kind="box", size=size) for row in range(4)))
    engine, fresh = load(world), load(world)
    engine.step(50)
    q, v = engine.get_state()
    fresh.set_state(q, v)
    engine.set_state(q, v)
    for entry in (engine, fresh):
        entry.step(5)
    assert engine.get_state()[1].tobytes() == fresh.get_state()[1].tobytes()
    engine.move_to(q, v)
    assert engine.get_state()[0] == pytest.approx(q, abs=1e-7)


@installed
def test_queries_of_contacts_change_nothing(load):
    size = (0.2, 0.2, 0.2)
    bodies = [ball(str(row), (0.01 * row, 0.0, 0.1 + 0.199 * row), kind="box", size=size) for row in range(4)]
    requested, quiet = load(scene(*bodies)), load(scene(*bodies))
    for _ in range(5):
        requested.step(10)
        quiet.step(10)
        assert 3 <= len(requested.detect_units()) <= 4
    assert [part.tobytes() for part in requested.get_state()] == [part.tobytes() for part in quiet.get_state()]


@installed
def test_shapes_of_massless_bodies_are_parts_of_their_carriers(load):
    check_parts(load)


# --- what is refused --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("change", "why"), [(moving_plane, "'plate' (does|moves)"), (cylinder, "prisms of 64 sides")])
def test_features_not_written_for_physx_are_refused_by_name(change, why):
    check_refused(change, why, "physx")


def numbers(**values):
    return lambda content: of("ball")(content)["shapes"][0]["copies"][0].update(values)


@installed
@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda content: of("ball")(content).update(mass=0.0), "moves and has no mass"),
        (lambda content: of("ball")(content).update(inertia=[0.02, 0.02, 0.0, 0.0, 0.0, 0.0]), "has no inverse"),
        (lambda content: of("ball")(content).update(mass=1e39), "there is no 1e[+]39"),
        (lambda content: of("ball")(content).update(mass=1e-42), "there is no 1e-42"),
        (lambda content: content.update(friction_cone="pyramid-inscribed"), "cone"),
        (lambda content: of("ball")(content)["shapes"][0].update(size=[-0.1]), "no sphere of the size -0.1"),
        (numbers(restitution=1.5), "numbers of 'ball': 0.5 and 1.5"),
        (numbers(friction=-0.1), "numbers of 'ball': -0.1 and 0"),
        (numbers(rolling_friction=0.1), "more than friction and restitution of 'ball'"),
    ],
)
def test_numbers_that_physx_takes_in_silence_are_refused(change, why, load):
    def edit(content, sidecar):
        change(content)
        sidecar["friction_cone"] = content["friction_cone"]

    with pytest.raises(EngineError, match=why):
        load(scene(ball("ball", (0.0, 0.0, 0.5))), edit)


@installed
def test_a_state_that_is_no_longer_finite_is_an_error(load):
    engine = load(scene(ball("ball", (0.0, 0.0, 0.5))))
    with pytest.raises(EngineError, match="there is no nan"):
        engine.set_state(np.full(7, math.nan), np.zeros(6))
    engine.set_state(np.array([0.0, 1e-59, 0.5, 1.0, 0.0, 0.0, 0.0]), np.full(6, -1e-200))  # zero, to 1e-38
    assert engine.get_state()[0][1] == pytest.approx(0.0, abs=1e-37)
    with pytest.raises(EngineError, match="the state of ball is no longer finite"):
        engine.step(3, np.array([0.0, 0.0, 0.0, 1e31, 1e31, 1e31]))
