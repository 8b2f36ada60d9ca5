"""Pairs of shapes are brought together by real geometry: coal against closed forms, states against plain geometry."""

from __future__ import annotations

import dataclasses
import itertools
import math
import random

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle, random_states
from simspec.proof.touch import mechanisms, plan
from simspec.proof.touch import plan as free
from simspec.proof.touch.geometry import CollisionSolid, gap, transform, transforms, wanted_depth
from simspec.proof.touch.plan import SEEN, touch_checks
from simspec.proof.touch.scene import POSES, Overlaps
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.frames import sorted_pair
from simspec.world.kinematics import rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Contact, Inertial, Joint, PairContact, Pose, Shape, World
from tests import worlds

KINDS = tuple(worlds.SIZES)


def solid(kind: str, size: tuple[float, ...] | None = None, number: int = 0) -> CollisionSolid:
    shape = Shape(f"{kind}_{number}", kind, worlds.SIZES[kind] if size is None else size)
    kind = SHAPES[shape.kind]
    return CollisionSolid(
        number, number, shape, (number, ""), kind.inner_radius(shape.size), kind.outer_radius(shape.size)
    )


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0, turn=frames.IDENTITY) -> np.ndarray:
    return transform(Pose((x, y, z), turn))


# --- coal against closed forms ------------------------------------------------------------------------------------

BLOCK = tuple(x for corner in itertools.product((-0.1, 0.1), (-0.2, 0.2), (-0.3, 0.3)) for x in corner)
"""The corners of a box."""
CLOSED_FORMS = [
    # shapes in line along x: the distance (sum of half widths) at which they touch
    ("sphere", (0.1,), "sphere", (0.2,), 0.3),
    ("sphere", (0.1,), "box", (0.2, 0.4, 0.6), 0.2),
    ("sphere", (0.1,), "cylinder", (0.2, 0.5), 0.3),
    ("sphere", (0.1,), "capsule", (0.2, 0.5), 0.3),
    ("sphere", (0.1,), "ellipsoid", (0.2, 0.3, 0.4), 0.3),
    ("box", (0.2, 0.4, 0.6), "box", (0.4, 0.4, 0.4), 0.3),
    ("box", (0.2, 0.4, 0.6), "cylinder", (0.2, 0.5), 0.3),
    ("box", (0.2, 0.4, 0.6), "capsule", (0.2, 0.5), 0.3),
    ("box", (0.2, 0.4, 0.6), "ellipsoid", (0.2, 0.3, 0.4), 0.3),
    ("cylinder", (0.1, 0.5), "cylinder", (0.2, 0.5), 0.3),
    ("cylinder", (0.1, 0.5), "capsule", (0.2, 0.5), 0.3),
    ("cylinder", (0.1, 0.5), "ellipsoid", (0.2, 0.3, 0.4), 0.3),
    ("capsule", (0.1, 0.5), "capsule", (0.2, 0.5), 0.3),
    ("capsule", (0.1, 0.5), "ellipsoid", (0.2, 0.3, 0.4), 0.3),
    ("ellipsoid", (0.1, 0.3, 0.2), "ellipsoid", (0.2, 0.3, 0.4), 0.3),
    ("sphere", (0.2,), "mesh", BLOCK, 0.3),
    ("box", (0.4, 0.4, 0.4), "mesh", BLOCK, 0.3),
    ("mesh", BLOCK, "mesh", BLOCK, 0.2),
]
ITERATED = 2e-6
"""coal's tolerance where it iterates (1e-6, relative to sizes of 1 m)."""


@pytest.mark.parametrize(("kind", "size", "other", "other_size", "reach"), CLOSED_FORMS)
@pytest.mark.parametrize("distance", [0.05, -0.02, -0.08])
def test_signed_distances_are_those_of_closed_forms(kind, size, other, other_size, reach, distance):
    entry, two = solid(kind, size), solid(other, other_size, 1)
    found = gap(entry, at(), two, at(reach + distance))
    assert found.distance == pytest.approx(distance, abs=ITERATED)
    assert found.normal[0] == pytest.approx(1.0, abs=1e-3)
    assert found.normal @ (found.second - found.first) == pytest.approx(distance, abs=ITERATED)
    back = gap(two, at(reach + distance), entry, at())
    assert back.distance == pytest.approx(distance, abs=ITERATED)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "plane"])
@pytest.mark.parametrize("distance", [0.05, -0.02])
def test_a_plane_is_solid_below(kind, distance):
    turn = frames.from_rpy(0.3, -1.1, 0.7)
    half = {"sphere": 0.05, "box": 0.15, "cylinder": 0.1, "capsule": 0.115, "ellipsoid": 0.11, "mesh": 0.11}[kind]
    tilted = transform(Pose((1.0, 2.0, 3.0), turn))
    found = gap(solid("plane"), tilted, solid(kind, number=1), tilted @ at(5.0, -7.0, half + distance))
    assert found.distance == pytest.approx(distance, abs=ITERATED)
    np.testing.assert_allclose(found.normal, tilted[:3, 2], atol=1e-6)


def test_planes_never_meet():
    assert gap(solid("plane"), at(), solid("plane", number=1), at(0.0, 0.0, -1.0)).distance == math.inf


def support(kind: str, size: tuple[float, ...], normal: np.ndarray) -> float:
    """How far a shape reaches along a direction."""
    x, y, z = normal
    return {
        "sphere": lambda: size[0],
        "box": lambda: 0.5 * float(np.abs(normal) @ size),
        "cylinder": lambda: size[0] * math.hypot(x, y) + size[1] / 2.0 * abs(z),
        "capsule": lambda: size[0] + size[1] / 2.0 * abs(z),
        "ellipsoid": lambda: float(np.linalg.norm(normal * size)),
        "mesh": lambda: float((np.reshape(size, (-1, 3)) @ normal).max()),
    }[kind]()


@pytest.mark.parametrize(
    ("kind", "other"), list(itertools.combinations_with_replacement([k for k in KINDS if k != "plane"], 2))
)
def test_in_any_pose_the_distance_is_the_largest_gap_over_all_directions(kind, other):
    generator = np.random.default_rng(len(kind) * 31 + len(other))
    entry, two = solid(kind), solid(other, number=1)
    for _ in range(20):
        pose = np.concatenate([generator.normal(size=3) * 0.12, generator.normal(size=4)])
        pose[3:] /= np.linalg.norm(pose[3:])
        (there,) = transforms(pose[None])
        found = gap(entry, at(), two, there)

        def separation(normal: np.ndarray, there=there) -> float:
            value = support(kind, entry.shape.size, normal)
            return float(normal @ there[:3, 3]) - value - support(other, two.shape.size, there[:3, :3].T @ normal)

        assert separation(found.normal) == pytest.approx(found.distance, abs=1e-3)
        for _ in range(50):
            direction = found.normal + generator.normal(size=3) * 0.3
            assert separation(direction / np.linalg.norm(direction)) <= found.distance + 1e-3


@pytest.mark.parametrize(
    ("kind", "other"),
    [pair for pair in itertools.combinations_with_replacement(KINDS, 2) if pair != ("plane", "plane")],
)
@pytest.mark.parametrize("scale", [1.0, 20.0])
def test_shapes_are_put_where_they_overlap_clearly(kind, other, scale):
    entry = solid(kind, tuple(scale * x for x in worlds.SIZES[kind]))
    two = solid(other, number=1)
    base, guest = (entry, two) if entry.outer >= two.outer else (two, entry)
    overlaps = Overlaps(0.5)
    wanted, enough = wanted_depth(base, guest)
    places = min(overlaps.places(base), 30)
    assert places >= 4
    for place, pose in itertools.product(range(places), range(POSES)):
        found = overlaps.relative(base, guest, place, pose)
        assert found is not None
        depth = -gap(base, at(), guest, found).distance
        assert depth >= (enough if pose == POSES - 1 else wanted - 1e-9)


# --- states -------------------------------------------------------------------------------------------------------


def deepest(world: World, oracle: Oracle, q: np.ndarray, meetings: plan.Meetings) -> dict[tuple[int, int], float]:
    """How deep every two shapes of two bodies overlap in a state, in shares of what is wanted."""
    poses = transforms(oracle.body_poses(q))
    place = [poses[entry.body] @ entry.pose for entry in meetings.solids]
    return {
        (a.number, b.number): -gap(a, place[a.number], b, place[b.number]).distance / wanted_depth(a, b)[0]
        for a, b in itertools.combinations(meetings.solids, 2)
        if a.body != b.body and not a.shape.kind == b.shape.kind == "plane"
    }


def check_states(world: World, oracle: Oracle, meetings: plan.Meetings) -> set[tuple[int, int]]:
    """Every tried pair overlaps clearly in its state; returns the pairs."""
    for number, q in enumerate(meetings.q):
        depth = deepest(world, oracle, q, meetings)
        for state, i, j, _ in meetings.tried.tolist():
            if state == number:
                assert depth[i, j] >= 0.39, (meetings.solids[i].name, meetings.solids[j].name)
    return {(i, j) for _, i, j, _ in meetings.tried.tolist()}


@pytest.mark.parametrize("count", [1, 2, 7, 8])
def test_free_spheres_all_meet_each_other_and_the_floor(count):
    world = worlds.spheres(count)
    oracle = Oracle(world)
    meetings = plan.plan(world, oracle)
    assert check_states(world, oracle, meetings) == set(itertools.combinations(range(count + 1), 2))
    assert meetings.pairs == math.comb(count + 1, 2)
    assert not meetings.separate
    assert meetings.untried == meetings.rigid == 0
    assert max(deepest(world, oracle, meetings.q[0], meetings).values()) < 0.0, "as built nothing overlaps"


@pytest.mark.parametrize("kinds", [KINDS[:3], KINDS[3:]])
def test_shapes_of_all_kinds_meet(kinds):
    world = worlds.shapes_world(tuple(kind for kind in kinds if kind != "plane"))
    oracle = Oracle(world)
    meetings = plan.plan(world, oracle)
    assert len(check_states(world, oracle, meetings)) == meetings.pairs


def arm_of_spheres() -> World:
    """A planar arm of two hinges and a fixed tip, a post in its reach, and one beyond it."""
    solid, z = Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0)), (0.0, 0.0, 1.0)

    def ball(name: str, x: float) -> tuple[Shape, ...]:
        return (Shape(f"{name}_0", "sphere", (0.1,), Pose((x, 0.0, 0.0)), "default"),)

    def post(name: str, x: float) -> Body:
        return Body(
            name, name, Inertial(0.0), Joint(f"{name}_joint", "fixed", origin=Pose((x, 0.0, 0.0))), ball(name, 0.0)
        )

    hinge = {"kind": "hinge", "axis": z, "position": (0.0,), "velocity": (0.0,), "position_limits": (-3.0, 3.0)}
    bodies = (
        Body("upper", "upper", solid, Joint("upper_joint", parent=None, **hinge), ball("upper", 0.5)),
        Body(
            "lower",
            "upper",
            solid,
            Joint("lower_joint", parent="upper", origin=Pose((1.0, 0.0, 0.0)), **hinge),
            ball("lower", 0.5),
        ),
        Body("tip", "upper", solid, Joint("tip_joint", "fixed", "lower", Pose((1.0, 0.05, 0.0))), ball("tip", 0.0)),
        post("near", -1.3),
        post("far", 9.0),
    )
    contact = Contact(
        materials=(worlds.MATERIAL,),
        pairs=(PairContact("default", "default", 0.4, 0.0),),
        excluded_bodies=worlds.parent_pairs(bodies),
    )
    return worlds.world(bodies, "arm-of-spheres", contact=contact)


def test_joints_are_searched_until_shapes_meet_or_cannot():
    world = arm_of_spheres()
    oracle = Oracle(world)
    meetings = plan.plan(world, oracle)
    assert (np.abs(meetings.q) <= 3.0).all(), "inside the limits"
    names = [entry.name.removesuffix("_0") for entry in meetings.solids]
    met = {frozenset((names[i], names[j])) for i, j in check_states(world, oracle, meetings)}
    reachable = [("near", "lower"), ("near", "tip"), ("upper", "lower")]
    assert met == {frozenset(pair) for pair in reachable}
    # upper and near: 0.5 m from the axis, not 1.3; upper and tip: at least 0.5 m distant; upper, lower and tip with far
    assert len(meetings.separate) == 5
    groups = rigid_groups(world)
    assert groups["lower"] == groups["tip"]
    assert meetings.rigid == 2, "lower with tip, near with far"
    assert meetings.pairs == 3 + 5 + 2


def random_mechanism(seed: int) -> World:
    """A tree of five bodies on random joints, two capsules, boxes or cylinders each, and a post."""
    generator = random.Random(seed)
    kinds = [generator.choice(["hinge", "hinge", "slide", "ball", "fixed"]) for _ in range(5)]
    parents = [-1, *(generator.randrange(index) for index in range(1, 5))]
    bodies = [*worlds.tree(kinds, seed, parents), *worlds.tree(["fixed"], seed + 1, prefix="post")]
    for index, body in enumerate(bodies):
        shapes = tuple(
            Shape(f"{body.name}_{k}", kind, worlds.SIZES[kind], worlds.pose(generator, 0.2), "default")
            for k, kind in enumerate(generator.choices(["capsule", "box", "cylinder", "sphere"], k=2))
        )
        joint = body.joint
        if joint.kind in ("hinge", "slide"):
            joint = dataclasses.replace(joint, position_limits=(joint.position[0] - 1.5, joint.position[0] + 1.0))
        bodies[index] = dataclasses.replace(body, shapes=shapes, joint=joint)
    contact = Contact(
        materials=(worlds.MATERIAL,),
        pairs=(PairContact("default", "default", 0.4, 0.0),),
        excluded_bodies=worlds.parent_pairs(tuple(bodies)),
    )
    return worlds.world(tuple(bodies), f"mechanism-{seed}", contact=contact)


@pytest.mark.parametrize("seed", range(6))
def test_pairs_planned_as_separate_are_separate_in_random_states(seed):
    world = random_mechanism(seed)
    oracle = Oracle(world)
    meetings = plan.plan(world, oracle)
    tried = check_states(world, oracle, meetings)
    assert len(tried) + len(meetings.separate) + meetings.rigid == meetings.pairs
    for q in random_states(world, 300, seed=7)[0]:
        depth = deepest(world, oracle, q, meetings)
        for pair in meetings.separate:
            assert depth[pair] < 0.4, [meetings.solids[number].name for number in pair]


def test_effort_is_bounded_and_the_remainder_is_reported(monkeypatch):
    monkeypatch.setattr(free, "EFFORT", 9 * 3)
    monkeypatch.setattr(free, "CROWD", 4)
    world = worlds.spheres(8)
    oracle = Oracle(world)
    meetings = plan.plan(world, oracle)
    assert len(meetings.q) == 4, "three states, and one with all pairs separate"
    tried = check_states(world, oracle, meetings)
    assert {number for pair in tried for number in pair} == set(range(9)), "every shape is tried"
    assert meetings.untried == 36 - len(tried)
    (check,) = touch_checks(world, meetings, *perfect(meetings))
    assert check.passed
    assert f"{meetings.untried} not tried, as they are too many: " in check.detail
    assert " more" in check.detail


def test_the_search_is_bounded_too(monkeypatch):
    monkeypatch.setattr(mechanisms, "LOOKS", 1)
    meetings = plan.plan(arm_of_spheres(), Oracle(arm_of_spheres()))
    assert meetings.untried > 0
    assert len({(i, j) for _, i, j, _ in meetings.tried.tolist()}) + meetings.untried + len(meetings.separate) == 8


# --- what an engine reports ---------------------------------------------------------------------------------------


def perfect(meetings: plan.Meetings, world: World | None = None) -> tuple[list, np.ndarray]:
    """The report of an engine that distinguishes all shapes and filters correctly (None: filters nothing)."""
    units = [(entry.body, (entry.name,)) for entry in meetings.solids]
    wrong = set() if world is None else forbidden(world, meetings)
    rows = [(state, i, j) for state, i, j, _ in meetings.tried.tolist() if (i, j) not in wrong]
    return units, np.array(rows, dtype=np.int64).reshape(-1, 3)


def forbidden(world: World, meetings: plan.Meetings) -> set[tuple[int, int]]:
    """The tried pairs of the gripper that must not touch: the fingers, and the palm with all."""
    names = [entry.name for entry in meetings.solids]
    return {
        (i, j)
        for _, i, j, _ in meetings.tried.tolist()
        if {names[i], names[j]} == {"left_0", "right_0"} or "palm_0" in (names[i], names[j])
    }


@pytest.fixture
def gripper():
    world = worlds.gripper()
    meetings = plan.plan(world, Oracle(world))
    return world, meetings, *perfect(meetings, world)


def test_the_right_filter_passes(gripper):
    world, meetings, units, touching = gripper
    (check,) = touch_checks(world, meetings, units, touching)
    assert check.passed
    assert check.count == 4  # both fingers and the palm with the bar, one finger with the other
    assert check.detail == (
        "2 pairs of shapes touch, 2 do not; 2 the joints cannot bring together: palm_0 – left_0, palm_0 – right_0"
    )


def test_a_contact_that_is_missing_is_found(gripper):
    world, meetings, units, touching = gripper
    for row in range(len(touching)):
        (check,) = touch_checks(world, meetings, units, np.delete(touching, row, axis=0))
        assert not check.passed
        assert check.worst == 1.0
        assert "this one should touch" in check.detail


def test_copies_of_two_shapes_meet_once(gripper):
    """A second pair of copies of the same two shapes would add the forces of its own law."""
    world, meetings, units, touching = gripper
    state, entry, other = touching[0].tolist()
    copies = [*units, units[entry], units[other]]
    second = [state, len(units), len(units) + 1]
    (check,) = touch_checks(world, meetings, copies, np.array([second, *touching[1:].tolist()]))
    assert check.passed
    (check,) = touch_checks(world, meetings, copies, np.array([second, *touching.tolist()]))
    assert not check.passed
    assert "this one should touch once, not by several pairs of their copies" in check.detail


def test_a_contact_that_should_be_filtered_is_found(gripper):
    world, meetings, _, _ = gripper
    (check,) = touch_checks(world, meetings, *perfect(meetings))
    assert not check.passed
    assert check.worst == 2.0
    assert "this one should not touch" in check.detail
    assert check.where.startswith("shapes ")


def test_unknown_shapes_must_not_touch(gripper):
    world, meetings, units, touching = gripper
    for unknown in ((-1, ("x",)), (0, ("x",)), (0, ())):
        (check,) = touch_checks(world, meetings, [*units, unknown], np.vstack([touching, (0, 3, len(units))]))
        assert not check.passed


def test_a_forbidden_contact_counts_wherever_it_shows():
    """Parts of one rigid group cannot be brought together, yet an engine may let them touch; so for shapes of one body."""
    world = arm_of_spheres()
    meetings = plan.plan(world, Oracle(world))
    units, touching = perfect(meetings)
    assert len(touching) == 3
    allowed = np.array(
        [row for row in touching.tolist() if {"upper_0", "lower_0"} != {meetings.solids[k].name for k in row[1:]}]
    )
    assert touch_checks(world, meetings, units, allowed)[0].passed
    lower, tip = (
        next(entry.number for entry in meetings.solids if entry.name == name) for name in ("lower_0", "tip_0")
    )
    (check,) = touch_checks(world, meetings, units, np.vstack([allowed, (0, lower, tip)]))
    assert not check.passed
    assert check.where == "shapes lower_0, tip_0"


def test_contacts_reported_only_for_groups_of_shapes_are_listed():
    """Two shapes in one place: a touching link is one of them."""
    base = worlds.spheres(1)
    ball = base.bodies[1]
    twin = dataclasses.replace(ball.shapes[0], name="twin")
    world = dataclasses.replace(base, bodies=(base.bodies[0], dataclasses.replace(ball, shapes=(*ball.shapes, twin))))
    meetings = plan.plan(world, Oracle(world))
    units = [(0, ("floor_0",)), (1, ("ball_0_0", "twin"))]
    touching = np.array([(state, 0, 1) for state in sorted({row[0] for row in meetings.tried.tolist()})])
    (check,) = touch_checks(world, meetings, units, touching)
    assert check.passed
    assert (
        "2 reported only together with other shapes of the same bodies: floor_0 – ball_0_0, floor_0 – twin"
        in check.detail
    )


def test_bodies_of_a_single_rigid_group_are_queried_too():
    world = arm_of_spheres()
    joint = Joint("j", "fixed", "upper", Pose((0.45, 0.0, 0.0)))
    bodies = (world.bodies[0], dataclasses.replace(world.bodies[3], joint=joint))
    contact = dataclasses.replace(world.contact, excluded_bodies=worlds.parent_pairs(bodies))
    world = dataclasses.replace(world, bodies=bodies, contact=contact)
    meetings = plan.plan(world, Oracle(world))
    units, touching = perfect(meetings)
    assert len(meetings.q) == len(touching) == 1
    assert not touch_checks(world, meetings, units, touching)[0].passed
    assert touch_checks(world, meetings, units, np.zeros((0, 3), np.int64))[0].passed


def test_where_nothing_can_meet_nothing_is_compared():
    world = arm_of_spheres()
    bodies = (world.bodies[0], world.bodies[-1])
    world = dataclasses.replace(world, bodies=bodies)
    assert plan.nothing_to_try(world) == "the joints bring no two of 1 pairs of collision shapes together"
    meetings = plan.plan(world, Oracle(world))
    units = [(0, ("upper_0",)), (1, ("far_0",))]
    assert touch_checks(world, meetings, units, np.zeros((0, 3), np.int64)) == []
    (check,) = touch_checks(world, meetings, [*units, (1, ("x",))], np.array([(0, 0, 2)]))
    assert not check.passed
    assert plan.nothing_to_try(worlds.spheres(1)) == ""
    assert plan.nothing_to_try(arm_of_spheres()) == ""
    alone = dataclasses.replace(world, bodies=bodies[:1])
    assert plan.nothing_to_try(alone) == "there are no two bodies with collision shapes"


def test_known_missed_contacts_are_reported_while_they_are_rare():
    world = random_mechanism(0)
    meetings = plan.plan(world, Oracle(world))
    rules = CollisionFilter(world)
    owner = [world.bodies[entry.body].name for entry in meetings.solids]
    units, touching = perfect(meetings)
    touching = np.array([row for row in touching.tolist() if rules.may_touch(owner[row[1]], owner[row[2]])])
    (check,) = touch_checks(world, meetings, units, touching)
    assert check.passed
    kinds = [sorted_pair(*(meetings.solids[number].shape.kind for number in row[1:])) for row in touching.tolist()]
    met = {
        kind: {tuple(row[1:]) for row, local in zip(touching.tolist(), kinds, strict=True) if local == kind}
        for kind in kinds
    }
    common, pairs = max(met.items(), key=lambda item: len(item[1]))
    missed, *others = sorted(pairs)
    left = touching[[tuple(row[1:]) != missed for row in touching.tolist()]]
    assert not touch_checks(world, meetings, units, left)[0].passed
    assert not touch_checks(world, meetings, units, left, {("mesh", "mesh")})[0].passed
    (check,) = touch_checks(world, meetings, units, left, {common})
    assert check.passed is (len(others) >= SEEN)
    few = left[[tuple(row[1:]) not in others[SEEN - 1 :] for row in left.tolist()]]
    assert not touch_checks(world, meetings, units, few, {common})[0].passed


def narrow_leg() -> World:
    """A cylinder on two hinges next to a block."""
    block = Shape("block_0", "box", (0.13, 0.2, 0.13), Pose((0.0, 0.0, 0.0)), "default")
    leg = Shape("leg_0", "cylinder", (0.05, 0.2), Pose((0.0, 0.0, -0.2)), "default")
    inertial = Inertial(1.0, inertia=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    hip = Joint("hip", "hinge", "block", Pose((0.25, 0.0, 0.1)), (0.0, 1.0, 0.0), (-0.2, 1.0), position=(0.0,))
    hip = dataclasses.replace(hip, velocity=(0.0,))
    turn = Joint("turn", "hinge", "thigh", Pose(), (1.0, 0.0, 0.0), (-0.3, 0.3), position=(0.0,), velocity=(0.0,))
    bodies = (
        Body("block", "block", Inertial(0.0), Joint("block_joint", "fixed"), (block,)),
        Body("thigh", "block", inertial, hip),
        Body("leg", "block", inertial, turn, (leg,)),
    )
    contact = Contact(materials=(worlds.MATERIAL,), pairs=(PairContact("default", "default", 0.4, 0.0),))
    return worlds.world(bodies, "narrow-leg", contact=contact)


def test_poses_of_a_pair_differ(monkeypatch):
    """Where all searches end in one place, others are looked for around it."""
    world, oracle = narrow_leg(), Oracle(narrow_leg())
    monkeypatch.setattr(mechanisms, "random_states", lambda world, count: (np.zeros((count, 2)), None))

    def axes() -> np.ndarray:
        tried = plan.plan(world, oracle)
        assert {tuple(row[1:3]) for row in tried.tried.tolist()} == {(0, 1)}
        return np.array([transforms(oracle.body_poses(q))[2, :3, 2] for q in tried.q[tried.tried[:, 0]]])

    with monkeypatch.context() as patch:
        patch.setattr(mechanisms, "SHAKES", 0)
        alike = axes()
    unlike = axes()
    assert len(alike) == POSES
    assert np.ptp(alike, axis=0).max() < mechanisms.UNLIKE
    assert len(unlike) == POSES + 2
    assert np.ptp(unlike, axis=0).max() > mechanisms.UNLIKE
