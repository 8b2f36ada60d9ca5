"""Tool frames: against closed forms of planar arms, against the oracle, against finite differences."""

from __future__ import annotations

import functools
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import simspec
from simspec.dynamics.oracle import Oracle
from simspec.dynamics.tool import REACHED, Tool, joints_to, tree_of
from simspec.language.load import Spec
from simspec.world import frames
from simspec.world.kinematics import initial_state, layout_of
from simspec.world.types import Pose, World

SPECS = Path(__file__).parents[2] / "specs"
SOLID = {"mass": 1, "inertia": {"principal": [0.1, 0.1, 0.1]}}
ARM = tuple(f"arm/{name}" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"))
OFFSET = Pose((0.01, 0.1986, -0.02), frames.from_rpy(0.3, -0.2, 0.5))
LENGTHS = (0.5, 0.3, 0.2)


def planar(*lengths: float, limits: tuple[float, float] | None = None) -> World:
    """Links in the plane z = 0, each turning about z; the last body's frame is at its hinge."""
    bodies = {"base": {"fixed": True}}
    before, at = "base", 0.0
    for number, length in enumerate(lengths):
        joint = {"name": f"j{number}", "type": "hinge", "axis": [0, 0, 1], "origin": {"xyz": [at, 0, 0]}}
        if limits is not None:
            joint["limits"] = {"position": list(limits)}
        bodies[f"link{number}"] = {**SOLID, "parent": before, "joint": joint}
        before, at = f"link{number}", length
    return Spec.from_data({"name": "planar", "bodies": bodies}).resolve()


def planar_tool(count: int, limits: tuple[float, float] | None = None) -> Tool:
    names = [f"j{number}" for number in range(count)]
    world = planar(*LENGTHS[:count], limits=limits)
    return Tool(world, f"link{count - 1}", Pose((LENGTHS[count - 1], 0.0, 0.0)), names)


@functools.cache
def robot() -> tuple[World, Tool, Oracle]:
    world = simspec.load(SPECS / "ur10e-hand.yaml").resolve()
    return world, Tool(world, "arm/tool0", OFFSET, ARM), Oracle(world)


def at(x: float, y: float, z: float = 0.0) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def columns(world: World) -> list[int]:
    starts = dict(
        zip((body.joint.name for body in world.bodies), (part.start for part in layout_of(world).position), strict=True)
    )
    return [starts[name] for name in ARM]


# --- where the frame is, how it moves ---

ANGLES = st.lists(st.floats(-3.1, 3.1), min_size=6, max_size=6)


@given(ANGLES)
def test_places_are_those_of_the_oracle(angles):
    world, tool, oracle = robot()
    q = initial_state(world)[0]
    q[columns(world)] = angles
    body = [body.name for body in world.bodies].index("arm/tool0")
    row = oracle.body_poses(q)[body]
    wanted = frames.compose(Pose(tuple(row[:3]), tuple(row[3:])), OFFSET)
    found = tool.place(q)
    assert found.translation == pytest.approx(wanted.position, abs=1e-12)
    assert found.rotation == pytest.approx(np.array(frames.matrix(wanted.quaternion)), abs=1e-12)


def test_the_jacobian_is_the_derivative_of_the_place():
    world, tool, _ = robot()
    q = initial_state(world)[0]
    found = tool.jacobian(q)
    assert found.shape == (6, 6)
    for number, column in enumerate(columns(world)):
        ahead, behind = q.copy(), q.copy()
        ahead[column] += 1e-6
        behind[column] -= 1e-6
        slope = pin.log6(tool.place(behind).actInv(tool.place(ahead))).vector / 2e-6
        assert found[:, number] == pytest.approx(slope, abs=1e-8)


def test_efforts_do_the_work_of_the_force():
    """τ · dq = F · dp for every small motion; F and its point stand in the frame's axes."""
    world, tool, _ = robot()
    q = initial_state(world)[0]
    point, force = np.array([0.02, -0.03, 0.05]), np.array([1.0, -2.0, 3.0])
    found = tool.efforts(q, point, force)
    in_world = tool.place(q).rotation @ force
    for number, column in enumerate(columns(world)):
        ahead, behind = q.copy(), q.copy()
        ahead[column] += 1e-6
        behind[column] -= 1e-6
        moved = (tool.place(ahead).act(point) - tool.place(behind).act(point)) / 2e-6
        assert found[number] == pytest.approx(in_world @ moved, abs=1e-8)


# --- inverse kinematics ---


@given(st.floats(0.21, 0.79), st.floats(-3.1, 3.1), st.sampled_from([-1, 1]))
def test_two_links_against_the_closed_form(distance, direction, side):
    """cos q2 = (r² − a² − b²) / 2ab; the branch is that of the start."""
    first, second = LENGTHS[:2]
    elbow = side * math.acos((distance**2 - first**2 - second**2) / (2 * first * second))
    shoulder = direction - math.atan2(second * math.sin(elbow), first + second * math.cos(elbow))
    target = at(distance * math.cos(direction), distance * math.sin(direction))
    found = planar_tool(2).solve(target, np.array([shoulder + 0.02, 0.97 * elbow]), turning=False)
    assert found.reached
    # the closed form itself loses digits where the arm is nearly stretched or folded
    assert np.sin(found.positions - [shoulder, elbow]) == pytest.approx([0, 0], abs=1e-7)
    assert np.cos(found.positions - [shoulder, elbow]) == pytest.approx([1, 1], abs=1e-7)


@settings(max_examples=60)
@given(ANGLES, st.integers(0, 5))
@example([0.0] * 6, 0)
@example([1.0, -1.0, 0.0, 0.5, 0.0, 0.3], 1)
@example([0.0, 0.0, 0.5, -1.0, 5.96e-08, 0.0], 0)
@example([0.0, 0.0, 0.5, -1.0, 5.96e-08, 0.0], 5)
@example([0.7, -0.4, 3e-8, 0.2, 1.0, -0.6], 2)
@example([0.7, -0.4, 1e-6, 0.2, -3e-7, -0.6], 3)
@example([-1.192092896e-07, 0.028, -0.2208865379041205, 0.028, -1.192092896e-07, 0.0], 0)
def test_every_place_that_the_arm_can_have_is_found(angles, seed):
    world, tool, _ = robot()
    q = initial_state(world)[0]
    start = q.copy()
    start[columns(world)] = np.random.default_rng(seed).uniform(-3, 3, 6)
    q[columns(world)] = angles
    target = tool.place(q)
    found = tool.solve(target, start, far=True)
    place = tool.place(found.positions)
    assert found.reached
    assert np.linalg.norm(place.translation - target.translation) <= REACHED
    assert np.linalg.norm(pin.log3(place.rotation.T @ target.rotation)) <= 1.1 * REACHED
    by_name = {body.joint.name: body.joint.position_limits for body in world.bodies}
    for name, value in zip(ARM, found.positions[columns(world)], strict=True):
        assert by_name[name][0] <= value <= by_name[name][1]
    others = np.setdiff1d(np.arange(len(q)), columns(world))
    assert np.array_equal(found.positions[others], start[others])


@given(st.lists(st.floats(-0.02, 0.02), min_size=6, max_size=6))
def test_a_near_place_is_reached_by_a_small_motion(change):
    """Continuity: from the scenarios' working pose, which is far from singular ones, the very posture is found again."""
    world, tool, _ = robot()
    start = initial_state(world)[0]
    goal = start.copy()
    goal[columns(world)] += change
    found = tool.solve(tool.place(goal), start)
    assert found.reached
    assert found.positions == pytest.approx(goal, abs=1e-6)


@pytest.mark.parametrize("beyond", [1e-6, 0.01, 5.0])
def test_the_distance_of_an_unreachable_place_agrees_with_geometry(beyond):
    found = planar_tool(2).solve(at(0.48 + beyond, 0.64), np.array([0.3, 0.4]), turning=False)
    wanted = math.hypot(0.48 + beyond, 0.64) - 0.8
    assert not found.reached
    assert found.distance == pytest.approx(wanted, rel=1e-5, abs=1e-9)
    assert found.angle == 0.0


def test_bodies_out_of_the_plane_stay_out_of_it():
    found = planar_tool(3).solve(at(0.4, 0.3, 0.07), np.array([0.3, 0.4, 0.5]))
    assert not found.reached
    assert found.distance == pytest.approx(0.07, abs=1e-6)


def test_joints_stop_at_their_limits():
    """Both hinges within ±0.5: the outermost the tool gets sideways is with both at +0.5."""
    tool = planar_tool(2, limits=(-0.5, 0.5))
    far = at(0.0, 2.0)
    found = tool.solve(far, np.array([0.0, 0.1]), turning=False, far=True)
    assert found.positions.tolist() == [0.5, 0.5]
    assert found.at_limit == ("j0", "j1")
    tip = np.array([0.5 * math.cos(0.5) + 0.3 * math.cos(1.0), 0.5 * math.sin(0.5) + 0.3 * math.sin(1.0)])
    assert found.distance == pytest.approx(math.hypot(tip[0], 2.0 - tip[1]), abs=1e-12)


@pytest.mark.parametrize("back", [1e-6, 0.01, 0.3])
def test_a_stretched_arm_comes_back(back):
    """No small motion shortens it: the derivative is zero where it begins."""
    found = planar_tool(2).solve(at(0.8 - back, 0.0), np.zeros(2), turning=False)
    assert found.reached


def test_another_branch_is_taken_only_when_that_is_wanted():
    """Both hinges within ±1.5. The place needs the elbow on the other side; on this one the shoulder would turn too far."""
    tool = planar_tool(2, limits=(-1.5, 1.5))
    q, start = np.array([1.05, 0.97]), np.array([-0.3, -0.1])
    along = np.array([math.cos(q[0]), math.sin(q[0])]), np.array([math.cos(q.sum()), math.sin(q.sum())])
    target = at(*(0.5 * along[0] + 0.3 * along[1]))
    near, far = tool.solve(target, start, turning=False), tool.solve(target, start, turning=False, far=True)
    assert far.reached
    assert far.positions == pytest.approx(q, abs=1e-8)
    assert not near.reached
    assert near.at_limit == ("j0",)


# --- joints to spare ---


def test_an_arm_with_a_joint_to_spare_stays_near_its_posture():
    """Three hinges, two wishes: for every angle of the first one the closed form of the other two gives two postures; the
    nearest of all of them to the nominal one is found."""
    tool, nominal = planar_tool(3), np.array([0.4, 0.6, -0.3])
    found = tool.solve(at(0.5, 0.4), nominal, turning=False)
    assert found.reached
    _, second, third = LENGTHS
    nearest = math.inf
    for angle in np.linspace(-1.0, 2.0, 30_001):
        x, y = 0.5 - 0.5 * math.cos(angle), 0.4 - 0.5 * math.sin(angle)
        cosine = (x * x + y * y - second**2 - third**2) / (2 * second * third)
        for side in (-1, 1) if abs(cosine) <= 1 else ():
            last = side * math.acos(cosine)
            middle = math.atan2(y, x) - math.atan2(third * math.sin(last), second + third * math.cos(last)) - angle
            nearest = min(nearest, float(np.linalg.norm(nominal - [angle, middle, last])))
    # next to the minimum the distance is a parabola: 1e-4 rad of the grid are nothing
    assert np.linalg.norm(nominal - found.positions) == pytest.approx(nearest, abs=1e-6)


def test_a_closed_way_ends_where_it_began():
    tool, nominal = planar_tool(3), np.array([0.4, 0.6, -0.3])
    q, first = nominal, None
    for turn in np.linspace(0.0, 2.0 * math.pi, 61):
        found = tool.solve(
            at(0.5 + 0.1 * math.cos(turn), 0.3 + 0.1 * math.sin(turn)), q, turning=False, nominal=nominal
        )
        assert found.reached
        if first is None:
            first = found.positions
        else:
            assert np.abs(found.positions - q).max() < 0.1
        q = found.positions
    assert q == pytest.approx(first, abs=1e-5)


# --- the rest ---


def test_the_same_bytes_every_time():
    world, tool, _ = robot()
    start = initial_state(world)[0]
    goal = start.copy()
    goal[columns(world)] += 0.7
    target = tool.place(goal)
    again = Tool(world, "arm/tool0", OFFSET, ARM)
    assert tool.solve(target, start).positions.tobytes() == again.solve(target, start).positions.tobytes()


def test_trees_and_ways():
    world, _, _ = robot()
    bodies = tree_of(world, "hand/middle_link_3")
    assert len(bodies) == len(world.bodies)
    way = [body.joint.name for body in joints_to(bodies, "arm/tool0") if body.joint.kind == "hinge"]
    assert way == list(ARM)
    with pytest.raises(KeyError):
        tree_of(world, "nothing")
