"""Trajectories of the world: results of points, tables and programs, compared with geometry and closed forms."""

from __future__ import annotations

import copy
import importlib
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import simspec
from simspec.control.reference import positions
from simspec.dynamics.oracle import Oracle
from simspec.errors import SpecError
from simspec.language.load import Spec, load
from simspec.world import frames
from simspec.world.canonical import canonical_json, from_plain, sha256, to_plain
from simspec.world.kinematics import initial_state, layout_of
from simspec.world.types import World

SPECS = Path(__file__).parents[2] / "specs"
SOLID = {"mass": 1, "inertia": {"principal": [0.1, 0.1, 0.1]}}


def joined(parent: str, name: str, kind: str, **joint: object) -> dict[str, object]:
    return {**SOLID, "parent": parent, "joint": {"name": name, "type": kind, "axis": [0, 0, 1], **joint}}


BODIES = {
    "post": {"fixed": True},
    "upper": joined("post", "shoulder", "hinge", position=0.5, limits={"velocity": 3}),
    "fore": joined("upper", "elbow", "hinge", position=0.5, origin={"xyz": [0.5, 0, 0]}),
    "left": joined("fore", "jaw", "slide", axis=[0, 1, 0], position=0.04, origin={"xyz": [0.3, 0, 0]}),
    "right": joined("fore", "thumb", "hinge", origin={"xyz": [0.3, 0, 0]}),
}
GRASPS = {
    "pinch": {
        "open": {"jaw": 0.05, "thumb": -0.5},
        "closed": {"jaw": 0.01, "thumb": -0.1},
        "forces": [
            {"body": "left", "at": [0.1, 0, 0.02], "force": [1, -3, 0]},
            {"body": "right", "at": [0.1, 0.02, 0], "force": [0.5, 3, 1]},
        ],
    }
}
CONTROL = {"law": "computed-torque", "joints": ["*"], "natural_frequency": 30, "discretisation": "implicit"}
TOOL = {"body": "arm/fore", "pose": {"xyz": [0.3, 0, 0]}}


def spec(trajectory: dict, folder: Path = SPECS, **control: object) -> Spec:
    data = {
        "name": "x",
        "models": {"arm": {"bodies": copy.deepcopy(BODIES), "grasps": copy.deepcopy(GRASPS)}},
        "control": {"robot": {**CONTROL, **control}},
        "trajectory": trajectory,
    }
    return Spec.from_data(data, folder=folder)


def solved(*steps: dict, **more: object) -> World:
    return spec({"tool": TOOL, "program": list(steps), **more}).resolve()


def column(world: World, joint: str) -> np.ndarray:
    trajectory = world.trajectory
    return np.array(trajectory.positions)[:, trajectory.joints.index(joint)]


def effort(world: World, joint: str) -> np.ndarray:
    trajectory = world.trajectory
    return np.array(trajectory.efforts)[:, trajectory.joints.index(joint)]


def states(world: World, rows: np.ndarray) -> np.ndarray:
    """Whole states of a world whose joints stand where the rows say."""
    starts = {body.joint.name: part.start for body, part in zip(world.bodies, layout_of(world).position, strict=True)}
    found = np.tile(initial_state(world)[0], (len(rows), 1))
    found[:, [starts[name] for name in world.trajectory.joints]] = rows
    return found


def places(world: World, rows: np.ndarray, body: str) -> np.ndarray:
    """Poses of a body by the oracle, which knows nothing of tools."""
    oracle = Oracle(world)
    index = [body.name for body in world.bodies].index(body)
    return np.array([oracle.body_poses(q)[index] for q in states(world, rows)])


def tip(world: World, rows: np.ndarray) -> np.ndarray:
    """The planar arm's tool (n, 2), by hand."""
    names = world.trajectory.joints
    shoulder = rows[:, names.index("arm/shoulder")]
    both = shoulder + rows[:, names.index("arm/elbow")]
    return np.stack([0.5 * np.cos(shoulder) + 0.3 * np.cos(both), 0.5 * np.sin(shoulder) + 0.3 * np.sin(both)], axis=1)


def jerk_free(u: np.ndarray) -> np.ndarray:
    return 10 * u**3 - 15 * u**4 + 6 * u**5


# --- points and tables ---


def test_points_in_their_units_and_in_the_order_of_the_bodies():
    points = [
        {
            "at": "500 ms",
            "positions": {"arm/thumb": "30 deg", "arm/jaw": "2 cm"},
            "efforts": {"arm/jaw": "2 N", "arm/thumb": 3},
        },
        {"at": 1, "positions": {"arm/jaw": 0.03, "arm/thumb": 0}, "efforts": {"arm/thumb": "4 N m", "arm/jaw": 0}},
    ]
    found = spec({"points": points, "interpolation": "linear"}).resolve().trajectory
    assert found.joints == ("arm/jaw", "arm/thumb")
    assert found.times == (0.5, 1.0)
    assert found.positions == ((0.02, math.pi / 6), (0.03, 0.0))
    assert found.efforts == ((2.0, 3.0), (0.0, 4.0))
    assert (found.velocities, found.accelerations, found.interpolation) == ((), (), "linear")


def test_points_csv_and_npz_are_the_same_world(tmp_path):
    times = [0.0, 0.25, 1.5]
    tables = {
        name: np.random.default_rng(number).uniform(-0.1, 0.1, (3, 2))
        for number, name in enumerate(("positions", "velocities", "accelerations", "efforts"))
    }
    joints = ["arm/elbow", "arm/shoulder"]
    points = [
        {
            "at": time,
            **{name: dict(zip(joints, map(float, table[row]), strict=True)) for name, table in tables.items()},
        }
        for row, time in enumerate(times)
    ]
    suffix = {"positions": "", "velocities": ":velocity", "accelerations": ":acceleration", "efforts": ":effort"}
    columns = {joint + suffix[name]: table[:, at] for name, table in tables.items() for at, joint in enumerate(joints)}
    names = sorted(columns)  # any order
    lines = [",".join(["time", *names])]
    lines += [
        ",".join(map(repr, [time, *(float(columns[name][row]) for name in names)])) for row, time in enumerate(times)
    ]
    (tmp_path / "table.csv").write_text("\ufeff" + " \n".join(lines) + "\n\n", encoding="utf-8")
    np.savez(tmp_path / "table.npz", time=np.array(times), joints=np.array(joints), **tables)
    worlds = [
        spec({**way, "interpolation": "quintic"}, tmp_path).resolve()
        for way in ({"points": points}, {"file": "table.csv"}, {"file": "table.npz"})
    ]
    assert worlds[0].trajectory.velocities
    assert canonical_json(worlds[0]) == canonical_json(worlds[1]) == canonical_json(worlds[2])


def test_a_world_with_a_trajectory_reads_back_from_its_text():
    world = solved(
        {"move": {"xyz": [0.5, 0.3, 0], "free_orientation": True}, "in": 1}, {"grip": 1, "in": 1, "squeeze": 1}
    )
    assert world.trajectory.efforts
    assert from_plain(World, to_plain(world)) == world


def test_a_jump_under_hold_interpolation_has_no_speed():
    points = [{"at": 0, "positions": {"arm/shoulder": 0}}, {"at": 0.01, "positions": {"arm/shoulder": 1}}]
    assert spec({"points": points, "interpolation": "hold"}).resolve().trajectory.interpolation == "hold"
    with pytest.raises(SpecError, match="exceeds its velocity limit"):
        spec({"points": points, "interpolation": "linear"}).resolve()


@pytest.mark.parametrize("limits", [{"velocity_limit": 0.9}, {"velocity_limit": 90, "gear": 100}])
def test_a_controllers_speed_limit_counts(limits):
    numbers = {name: {"*shoulder": value, "*elbow": 1e3, "*jaw": 1e3, "*thumb": 1e3} for name, value in limits.items()}
    ramp = [{"at": 0, "positions": {"arm/shoulder": 0}}, {"at": 1, "positions": {"arm/shoulder": 1}}]
    with pytest.raises(SpecError) as caught:
        spec({"points": ramp, "interpolation": "linear"}, **numbers).resolve()
    (problem,) = caught.value.problems
    assert (problem.found, problem.allowed) == ("1 rad/s, 1.11 times its limit", "up to 0.9 rad/s")
    ramp[1]["at"] = 1.0 / 0.9
    assert spec({"points": ramp, "interpolation": "linear"}, **numbers).resolve().trajectory is not None


@given(st.floats(0.1, 10), st.floats(0.1, 2.5) | st.floats(-2.5, -0.1))
def test_the_fastest_moment_of_a_cubic_is_found(lasting, way):
    """From rest to rest it is half way through, at 1.5 times the mean speed; the limit is 3 rad/s."""
    points = [{"at": 0, "positions": {"arm/shoulder": 0}}, {"at": lasting, "positions": {"arm/shoulder": way}}]
    fastest = 1.5 * abs(way) / lasting
    assume(abs(fastest - 3.0) > 1e-9)  # at the limit itself rounding decides
    if fastest <= 3.0:
        assert spec({"points": points}).resolve().trajectory.times == (0.0, lasting)
        return
    with pytest.raises(SpecError) as caught:
        spec({"points": points}).resolve()
    number, unit, *_ = caught.value.problems[0].found.split()
    assert unit == "rad/s,"
    assert math.isclose(float(number), fastest, rel_tol=5.1e-4), "four digits, the last of which rounding decides"


# --- programs ---


def test_a_program_begins_at_the_joints_and_keeps_unmoved_joints_in_place():
    world = solved({"wait": 0.3}, {"move": {"xyz": [0.5, 0.3, 0], "free_orientation": True}, "in": 0.5})
    found = world.trajectory
    assert found.joints == ("arm/shoulder", "arm/elbow", "arm/jaw", "arm/thumb")
    assert found.positions[0] == (0.5, 0.5, 0.04, 0.0)
    assert set(column(world, "arm/jaw")) == {0.04}
    assert set(column(world, "arm/thumb")) == {0.0}
    assert found.efforts == ()
    assert found.times[-1] == 0.8
    assert found.interpolation == "cubic"


def test_times_of_many_steps_add_up():
    found = solved(*[{"wait": 0.1}] * 30, {"grip": 0.5, "in": 0.1}).trajectory
    assert found.times[-1] == 3.1
    assert {0.1, 0.3, 0.7, 2.9} <= set(found.times)


@pytest.mark.parametrize("interval", [0.05, 0.1])
def test_a_straight_move_is_straight_and_of_minimum_jerk(interval):
    way = {"move": {"xyz": [0.3, 0.5, 0], "free_orientation": True}, "in": 2}
    world = solved({"move": {"xyz": [0.5, 0.3, 0], "free_orientation": True}, "in": 1}, way, interval=interval)
    rows, times = np.array(world.trajectory.positions), np.array(world.trajectory.times)
    begin, end = np.array([0.5, 0.3]), np.array([0.3, 0.5])
    share = jerk_free((times[times >= 1.0] - 1.0) / 2.0)
    assert tip(world, rows)[times >= 1.0] == pytest.approx(begin + share[:, None] * (end - begin), abs=2e-8)
    between = np.linspace(1.0, 3.0, 4001)
    path = tip(world, positions(world.trajectory).at(between)[0])
    across = (path - begin) @ np.array([1.0, 1.0]) / math.sqrt(2)
    assert np.abs(across).max() < (1e-5 if interval < 0.1 else 1e-4)
    assert path == pytest.approx(begin + jerk_free((between - 1.0) / 2.0)[:, None] * (end - begin), abs=1e-4)


def test_the_robots_square_is_straight_between_points_of_a_tenth_of_a_second():
    """Of the committed scenario, with twice its interval: off the line by less than 0.1 mm, turned by less than 0.1 mrad."""
    world = load(SPECS / "ur10e-reach.yaml", sets=["trajectory.interval=0.1 s"]).resolve()
    corners = np.array([[0.2, 0.8, 0.5], [0.2, 0.8, 0.9], [-0.2, 0.8, 0.9], [-0.2, 0.8, 0.5], [0.2, 0.8, 0.5]])
    first = places(world, np.array(world.trajectory.positions[:1]), "arm/tool0")[0]
    for side in range(4):
        begun = 1.4 * (side + 1)
        times = np.linspace(begun, begun + 1.2, 121)
        found = places(world, positions(world.trajectory).at(times)[0], "arm/tool0")
        begin, end = corners[side], corners[side + 1]
        wanted = begin + jerk_free((times - begun) / 1.2)[:, None] * (end - begin)
        along = (end - begin) / np.linalg.norm(end - begin)
        off = found[:, :3] - begin
        assert np.linalg.norm(off - np.outer(off @ along, along), axis=1).max() < 1e-4
        assert np.linalg.norm(found[:, :3] - wanted, axis=1).max() < 1e-4
        turned = 2 * np.arccos(np.clip(np.abs(found[:, 3:] @ first[3:]), 0, 1))
        assert turned.max() < 1e-4


def test_a_turn_is_the_shortest_and_goes_with_the_move():
    """200 degrees about y is 160 the other way; half of the way through, the tool has turned half of that."""
    text = (SPECS / "ur10e-reach.yaml").read_text()
    head = text[: text.index("trajectory:")]
    document = simspec.language.document.parse(head, "x").data
    document["models"]["arm"]["use"] = str(SPECS / "models" / "ur10e.yaml")

    def world(*steps: dict) -> World:
        data = {**document, "trajectory": {"tool": {"body": "arm/tool0"}, "program": list(steps)}}
        return Spec.from_data(data, folder=SPECS, allow_outside=True).resolve()

    def turned(angle: float, lasting: float) -> dict:
        return {"move": {"rpy": ["-90 deg", 0, f"{angle} deg"]}, "in": lasting}

    ready = {"move": {"xyz": [0.2, 0.8, 0.6], "rpy": ["-90 deg", 0, 0]}, "in": 3, "straight": False}
    found = world(ready, turned(100, 4), turned(-100, 8))
    rows, times = np.array(found.trajectory.positions), list(found.trajectory.times)
    poses = places(found, rows[[times.index(at) for at in (3.0, 7.0, 11.0, 15.0)]], "arm/tool0")
    for pose, turn in zip(poses, (0, 100, 180, -100), strict=True):
        wanted = frames.from_rpy(math.radians(-90), 0, math.radians(turn))
        assert abs(np.dot(pose[3:], wanted)) == pytest.approx(1.0, abs=1e-12)
        assert pose[:3] == pytest.approx([0.2, 0.8, 0.6], abs=3e-8)


def test_joints_move_independently_without_a_straight_path():
    move = {"move": {"xyz": [0.3, 0.5, 0], "free_orientation": True}, "in": 2, "straight": False}
    world = solved(move)
    rows, times = np.array(world.trajectory.positions), np.array(world.trajectory.times)
    assert tip(world, rows)[-1] == pytest.approx([0.3, 0.5], abs=2e-8)
    share = jerk_free(times / 2.0)[:, None]
    assert rows == pytest.approx(rows[0] + share * (rows[-1] - rows[0]), abs=2e-8)


def test_quantities_that_a_move_omits_are_constant():
    """Only the orientation, about the tool's own point: on three hinges in a plane."""
    bodies = {**BODIES, "left": joined("fore", "jaw", "hinge", origin={"xyz": [0.3, 0, 0]})}
    data = {
        "name": "x",
        "models": {"arm": {"bodies": bodies}},
        "control": {"robot": CONTROL},
        "trajectory": {
            "tool": {"body": "arm/left", "pose": {"xyz": [0.1, 0, 0]}},
            "program": [{"move": {"rpy": [0, 0, 1.2]}, "in": 2}, {"move": {"xyz": [0.5, 0.4, 0]}, "in": 2}],
        },
    }
    world = Spec.from_data(data).resolve()
    turns = np.array(world.trajectory.positions)[:, :3].sum(axis=1)
    times = np.array(world.trajectory.times)
    assert turns == pytest.approx(np.where(times <= 2, 1.0 + 0.2 * jerk_free(np.minimum(times / 2, 1)), 1.2), abs=3e-8)
    poses = places(world, np.array(world.trajectory.positions), "arm/left")
    tool = poses[:, :2] + 0.1 * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    assert tool[times <= 2] == pytest.approx(np.tile(tool[0], (sum(times <= 2), 1)), abs=3e-8)
    assert tool[-1] == pytest.approx([0.5, 0.4], abs=3e-8)


def test_a_way_past_a_singular_pose_is_refused():
    """Two links of half a metre, past their pivot at 2 mm: the shoulder turns by half a turn within a point or two."""
    data = {"tool": {**TOOL, "pose": {"xyz": [0.5, 0, 0]}}}
    ready = {"move": {"xyz": [0.4, 0.002, 0], "free_orientation": True}, "in": 3, "straight": False}
    past = {"move": {"xyz": [-0.4, 0.002, 0], "free_orientation": True}, "in": 3}
    with pytest.raises(SpecError) as caught:
        spec({**data, "program": [ready, past]}).resolve()
    (problem,) = caught.value.problems
    assert problem.path == "trajectory.program.1.move"
    assert problem.message.startswith("arm/shoulder jumps by ")
    assert problem.message.endswith(" between two points of this move 1.5 s into it")
    assert spec({**data, "program": [ready, {**past, "straight": False}]}).resolve().trajectory.times[-1] == 6.0


def test_joints_are_at_rest_during_a_wait():
    """A spline that ran on from the move's last points would swing for as long as the wait lasts."""
    world = solved(
        {"move": {"xyz": [0.5, 0.3, 0], "free_orientation": True}, "in": 1},
        {"wait": 20},
        {"move": {"xyz": [0.3, 0.5, 0], "free_orientation": True}, "in": 1},
    )
    assert len(world.trajectory.times) < 80
    values = positions(world.trajectory).at(np.linspace(1.0, 21.0, 20_001))[0]
    assert np.abs(values - values[0]).max() < 2e-5
    middle = positions(world.trajectory).at(np.linspace(1.5, 20.5, 20_001))[0]
    assert np.abs(middle - values[0]).max() < 2e-7


# --- grips ---


def test_a_grip_is_a_share_of_the_way_from_open_to_closed():
    world = solved({"grip": 0.25, "in": 1}, {"grip": 1, "in": 2}, {"grip": 0, "in": 1})
    times = world.trajectory.times
    for at, share in ((1.0, 0.25), (3.0, 1.0), (4.0, 0.0)):
        row = times.index(at)
        assert column(world, "arm/jaw")[row] == pytest.approx(0.05 - 0.04 * share, abs=1e-8)
        assert column(world, "arm/thumb")[row] == pytest.approx(-0.5 + 0.4 * share, abs=1e-8)
    inside = np.array([time for time in times if 1.0 <= time <= 3.0])
    jaw = column(world, "arm/jaw")[[times.index(time) for time in inside]]
    assert jaw == pytest.approx(0.04 - 0.03 * jerk_free((inside - 1) / 2), abs=2e-8)
    assert set(column(world, "arm/shoulder")) == {0.5}
    assert world.trajectory.efforts == ()


def test_squeezing_presses_with_the_forces_of_the_grasp_until_it_ends():
    """The slide along y takes F_y; the hinge about z takes (r × F)_z; neither depends on where the arm is."""
    move = {"move": {"xyz": [0.5, 0.3, 0], "free_orientation": True}, "in": 1}
    world = solved({"grip": 1, "in": 1, "squeeze": 0.5}, move, {"grip": 1, "in": 2, "squeeze": 1}, {"grip": 0, "in": 1})
    times = np.array(world.trajectory.times)
    share = np.interp(times, [0, 1, 2, 4, 5], [0, 0.5, 0.5, 1, 0])
    assert effort(world, "arm/jaw") == pytest.approx(-3.0 * share, abs=1e-7)
    assert effort(world, "arm/thumb") == pytest.approx((0.1 * 3 - 0.02 * 0.5) * share, abs=1e-7)
    assert not effort(world, "arm/shoulder").any()
    assert not effort(world, "arm/elbow").any()


def test_forces_turn_with_the_closed_posture():
    """A force in the axes of a body two hinges away: the first one's lever depends on how far the second is closed."""
    bodies = {**copy.deepcopy(BODIES), "right": joined("fore", "thumb", "hinge")}
    bodies["nail"] = joined("right", "knuckle", "hinge", origin={"xyz": [0.2, 0, 0]})
    grasp = {
        "open": {"thumb": 0, "knuckle": 0},
        "closed": {"thumb": 0.3, "knuckle": 0.7},
        "forces": [{"body": "nail", "at": [0.1, 0, 0], "force": [0, 2, 0]}],
    }
    data = {
        "name": "x",
        "models": {"arm": {"bodies": bodies, "grasps": {"poke": grasp}}},
        "control": {"robot": CONTROL},
        "trajectory": {"program": [{"grip": 1, "in": 1, "squeeze": 1}]},
    }
    world = Spec.from_data(data).resolve()
    assert effort(world, "arm/knuckle")[-1] == pytest.approx(0.1 * 2, abs=1e-7)
    assert effort(world, "arm/thumb")[-1] == pytest.approx((0.1 + 0.2 * math.cos(0.7)) * 2, abs=1e-7)


def test_hands_of_model_files_and_of_arrays_by_name(tmp_path):
    hand = {"simspec": 1, "name": "hand", "model": {"bodies": BODIES, "grasps": GRASPS}}
    import json

    (tmp_path / "hand.yaml").write_text(json.dumps(hand))
    row = {"use": "hand.yaml", "array": {"line": 2, "step": [2, 0, 0]}}
    more = {"bodies": {"post": {"fixed": True}}}

    def resolved(**trajectory: object) -> World:
        data = {
            "name": "x",
            "models": {"row": row, "more": more},
            "control": {"robot": CONTROL},
            "trajectory": trajectory,
        }
        return Spec.from_data(data, folder=tmp_path).resolve()

    with pytest.raises(SpecError) as caught:
        resolved(program=[{"grip": 1, "in": 1}])
    assert caught.value.problems[0].allowed == "row_0/pinch, row_1/pinch"
    world = resolved(program=[{"grip": 1, "in": 1, "squeeze": 1}], grasp="row_1/pinch")
    assert effort(world, "row_1/jaw")[-1] == pytest.approx(-3)
    assert not effort(world, "row_0/jaw").any()
    alone = {**hand, "control": {"robot": CONTROL}, "trajectory": {"program": [{"grip": 1, "in": 1}], "grasp": "pinch"}}
    assert column(Spec.from_data(alone).resolve(), "jaw")[-1] == pytest.approx(0.01)


def test_a_placement_may_add_grasps_but_not_change_them(tmp_path):
    import json

    (tmp_path / "hand.yaml").write_text(
        json.dumps({"simspec": 1, "name": "hand", "model": {"bodies": BODIES, "grasps": GRASPS}})
    )

    def resolved(name: str) -> World:
        placed = {"use": "hand.yaml", "grasps": {name: {"open": {"jaw": 0.02}, "closed": {"jaw": 0.01}}}}
        trajectory = {"program": [{"grip": 0, "in": 1}], "grasp": f"arm/{name}"}
        data = {"name": "x", "models": {"arm": placed}, "control": {"robot": CONTROL}, "trajectory": trajectory}
        return Spec.from_data(data, folder=tmp_path).resolve()

    assert column(resolved("hold"), "arm/jaw")[-1] == pytest.approx(0.02)
    with pytest.raises(SpecError, match="the model has a grasp 'pinch' already"):
        resolved("pinch")


# --- what must hold of all of them ---


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-2.5, 2.5), min_size=6, max_size=6), st.booleans())
def test_every_place_that_the_robot_can_have_is_reached(angles, quaternion):
    head = load(SPECS / "ur10e.yaml")
    base = head.resolve()
    names = [body.joint.name for body in base.bodies if body.joint.kind == "hinge"]
    q = initial_state(base)[0]
    q[:] = angles
    pose = Oracle(base).body_poses(q)[[body.name for body in base.bodies].index("arm/tool0")]
    turn = tuple(map(float, pose[3:]))
    orientation = {"quat": turn} if quaternion else {"rpy": frames.to_rpy(turn)}
    data = {
        "name": "x",
        "models": {"arm": {"use": "models/ur10e.yaml", "pose": {"xyz": [0, 0, 0.02]}}},
        "control": {"robot": CONTROL},
        "trajectory": {
            "tool": {"body": "arm/tool0"},
            "program": [{"move": {"xyz": pose[:3].tolist(), **orientation}, "in": 60, "straight": False}],
        },
    }
    world = Spec.from_data(data, folder=SPECS, allow_outside=True).resolve()
    assert world.trajectory.joints == tuple(names)
    found = places(world, np.array(world.trajectory.positions[-1:]), "arm/tool0")[0]
    assert found[:3] == pytest.approx(pose[:3], abs=1e-7)
    assert abs(found[3:] @ pose[3:]) == pytest.approx(1.0, abs=1e-12)


def test_the_same_world_every_time_and_on_machines_that_round_differently(monkeypatch):
    """The effect of another linear algebra library: every Jacobian and every error differ in the last digit."""
    from simspec.dynamics.tool import Tool

    path = SPECS / "ur10e-reach.yaml"
    first = load(path).resolve()
    assert canonical_json(load(path).resolve()) == canonical_json(first)
    numbers, whole = np.random.default_rng(0), Tool.jacobian
    monkeypatch.setattr(Tool, "jacobian", lambda self, q: whole(self, q) * (1 + 2e-16 * numbers.normal(size=6)))
    assert sha256(load(path).resolve()) == sha256(first)


def test_without_the_library_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    monkeypatch.setattr(simspec, "dynamics", importlib.import_module("simspec.dynamics"))  # put back after it
    for name in [name for name in sys.modules if name.startswith("simspec.dynamics")]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(SpecError) as caught:
        solved({"move": {"xyz": [0.5, 0.3, 0], "free_orientation": True}, "in": 1})
    assert caught.value.problems[0].hint == "pip install 'simspec-physics[pin]'"
    assert caught.value.problems[0].path == "trajectory"
