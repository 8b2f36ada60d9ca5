"""Named frames on bodies: their fields in a spec, copies, and places where a frame stands for its body."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import simspec
from simspec.compiler import compile_world
from simspec.errors import SpecError
from simspec.language.load import load
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.world import frames
from simspec.world.canonical import canonical_json, from_plain, to_plain
from simspec.world.kinematics import poses
from simspec.world.types import ConnectConstraint, Frame, Pose, WeldConstraint, World

HALF = 0.7071067811865476
LIGHT = {"mass": 0.2, "inertia": {"principal": [0.001, 0.001, 0.001]}}
TIP = {"body": "link", "pose": {"xyz": [0.5, 0, 0], "rpy": [0, "90 deg", 0]}}
HINGE = {"name": "elbow", "type": "hinge", "axis": [0, 1, 0], "position": "30 deg"}
ARM = {
    "fixed": True,
    "bodies": {"base": {}, "link": {"parent": "base", "joint": HINGE, **LIGHT}},
    "frames": {"tip": TIP},
}
DATA = {
    "simspec": 1,
    "name": "framed",
    "physics": {"timestep": 0.001, "duration": 0.1},
    "models": {"arm": ARM},
    "bodies": {"ball": {**LIGHT, "pose": {"xyz": [0, 3, 0]}}},
}


def resolved(**more) -> World:
    return simspec.Spec.from_data({**copy.deepcopy(DATA), **more}).resolve()


def wrong(**more) -> str:
    with pytest.raises(SpecError) as refused:
        resolved(**more)
    return str(refused.value)


def place_of(world: World, name: str) -> Pose:
    frame = next(frame for frame in world.frames if frame.name == name)
    return frames.compose(poses(world)[frame.body], frame.pose)


def test_frames_of_models_and_scenarios_have_full_names_and_change_nothing_else():
    world = resolved(frames={"mark": {"body": "arm/link"}})
    assert [frame.name for frame in world.frames] == ["arm/tip", "mark"]
    np.testing.assert_allclose(world.frames[0].pose.position, (0.5, 0, 0))
    np.testing.assert_allclose(world.frames[0].pose.quaternion, (HALF, 0, HALF, 0))
    assert world.frames[1] == Frame("mark", "arm/link", Pose())
    assert from_plain(World, to_plain(world)) == world
    assert [need.paths for need in needs(world) if need.feature is Feature.FRAME] == [("frames.arm/tip", "frames.mark")]
    bare = resolved(models={"arm": {key: value for key, value in ARM.items() if key != "frames"}})
    assert "frames" not in to_plain(bare)
    assert canonical_json(bare.bodies) == canonical_json(world.bodies)


def test_frames_are_copied_with_arrays():
    ball = {**LIGHT, "pose": {"xyz": [0, 3, 0]}, "array": {"line": 3, "step": [0.5, 0, 0]}}
    models = {"arm": {**ARM, "array": {"line": 2, "step": [0, 1, 0]}}}
    pin = {"connect": {"bodies": ["top", "nut"], "at": [0, 0, 0]}}
    nut = {**LIGHT, "parent": "ball", "joint": {"type": "hinge", "axis": [0, 0, 1]}}
    world = resolved(
        bodies={"ball": ball, "nut": nut},
        models=models,
        frames={"top": {"body": "ball", "pose": {"xyz": [0, 0, 0.1]}}},
        constraints={"pin": pin},
    )
    assert [frame.name for frame in world.frames] == ["arm_0/tip", "arm_1/tip", "top_0", "top_1", "top_2"]
    np.testing.assert_allclose(place_of(world, "top_2").position, (1, 3, 0.1))
    assert [(constraint.name, constraint.first, constraint.first_point) for constraint in world.constraints] == [
        (f"pin_{index}", f"ball_{index}", (0, 0, 0.1)) for index in range(3)
    ]


def test_the_nearer_of_two_frames_with_equal_names_is_used(tmp_path):
    (tmp_path / "arm.yaml").write_text(
        "simspec: 1\nname: arm\nmodel:\n  bodies:\n    base: {fixed: true}\n"
        "    link: {parent: base, joint: {type: hinge, axis: [0, 0, 1]}, mass: 1, inertia: {principal: [1, 1, 1]}}\n"
        "  frames:\n    tip: {body: link}\n    root: {body: base}\n"
    )
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "simspec: 1\nname: scene\nmodels:\n  arm:\n    use: arm.yaml\n    fixed: true\n"
        "    frames:\n      tip: {body: link, pose: {xyz: [0, 0, 2]}}\n"
    )
    world = load(scene).resolve()
    assert {frame.name: frame.pose.position for frame in world.frames} == {"arm/root": (0, 0, 0), "arm/tip": (0, 0, 2)}
    assert [frame.name for frame in load(tmp_path / "arm.yaml").resolve().frames] == ["root", "tip"]


def test_a_force_at_a_frame_acts_where_the_frame_is():
    force = {"force": [0, 0, 1], "at": [0.1, 0, 0]}
    by_frame = resolved(forces=[{"body": "arm/tip", **force}])
    by_body = resolved(forces=[{"body": "arm/link", **force, "at": [0.5, 0, -0.1]}])
    assert by_frame.forces[0].body == "arm/link"
    np.testing.assert_allclose(by_frame.forces[0].at, by_body.forces[0].at, atol=1e-15)


def test_a_model_is_attached_to_a_frame():
    hand = {"attach": "arm/tip", "pose": {"xyz": [0, 0, 0.1]}, "bodies": {"palm": LIGHT}}
    world = resolved(models={"arm": ARM, "hand": hand})
    palm = next(body for body in world.bodies if body.name == "hand/palm")
    assert palm.joint.parent == "arm/link"
    there = frames.compose(place_of(world, "arm/tip"), Pose((0, 0, 0.1)))
    np.testing.assert_allclose(poses(world)["hand/palm"].position, there.position, atol=1e-15)
    np.testing.assert_allclose(poses(world)["hand/palm"].quaternion, there.quaternion, atol=1e-15)


def test_loops_are_closed_at_frames():
    turned = {"xyz": [0, 0, 0.1], "rpy": [0, 0, "90 deg"]}
    local = {"body": "ball", "pose": turned}
    tip = place_of(resolved(), "arm/tip")
    ball = frames.compose(tip, frames.inverse(Pose((0, 0, 0.1), (HALF, 0, 0, HALF))))
    bodies = {"ball": {**LIGHT, "pose": {"xyz": list(ball.position), "quat": list(ball.quaternion)}}}
    for kind, said in (("connect", {"at": [0, 0, 0], "second_at": [0, 0, 0]}), ("weld", {"pose": {}})):
        actual = {"latch": {kind: {"bodies": ["arm/tip", "knob"], **said}}}
        world = resolved(bodies=bodies, frames={"knob": local}, constraints=actual)
        (latch,) = world.constraints
        assert (latch.first, latch.second) == ("arm/link", "ball")
        if isinstance(latch, ConnectConstraint):
            np.testing.assert_allclose(latch.first_point, (0.5, 0, 0), atol=1e-15)
            np.testing.assert_allclose(latch.second_point, (0, 0, 0.1), atol=1e-15)
        else:
            assert isinstance(latch, WeldConstraint)
            link = frames.compose(poses(world)["arm/link"], latch.pose)
            np.testing.assert_allclose(link.position, ball.position, atol=1e-14)


def test_the_tool_of_a_program_is_a_frame():
    more = {
        "control": {"robot": {"law": "pd", "joints": ["arm/*"], "kp": 10, "kd": 1}},
        "trajectory": {
            "tool": {"body": "arm/tip", "pose": {"xyz": [0, 0, 0.1]}},
            "program": [{"move": {"xyz": [0.6, 0, 0], "free_orientation": True}, "in": "50 ms", "straight": False}],
        },
    }
    by_frame = resolved(**more).trajectory
    same = {"body": "arm/link", "pose": {"xyz": [0.6, 0, 0], "rpy": [0, "90 deg", 0]}}
    by_body = resolved(control=more["control"], trajectory={**more["trajectory"], "tool": same}).trajectory
    assert by_frame is not None
    assert by_body is not None
    np.testing.assert_allclose(by_frame.positions, by_body.positions, atol=1e-12)
    assert by_frame.positions[-1][0] == pytest.approx(0.0, abs=1e-8)


def test_a_grasp_presses_with_a_frame():
    def efforts(force):
        grasp = {"open": {"elbow": 0}, "closed": {"elbow": 0.5}, "forces": [force]}
        world = resolved(
            models={"arm": {**ARM, "grasps": {"pinch": grasp}}},
            control={"robot": {"law": "pd", "joints": ["arm/*"], "kp": 10, "kd": 1}},
            trajectory={"program": [{"grip": 1, "squeeze": 1, "in": "50 ms"}]},
        )
        assert world.trajectory is not None
        return world.trajectory.efforts[-1][0]

    by_frame = efforts({"body": "tip", "at": [0.1, 0, 0], "force": [2, 0, 3]})
    # x of the frame is -z of the link, z is its x
    assert by_frame == pytest.approx(efforts({"body": "link", "at": [0.5, 0, -0.1], "force": [3, 0, -2]}))
    assert abs(by_frame) > 0.5


def test_errors_are_reported_at_their_location():
    assert "there is no body 'linc'" in wrong(models={"arm": {**ARM, "frames": {"tip": {**TIP, "body": "linc"}}}})
    assert "there is a body 'ball' already" in wrong(frames={"ball": {"body": "arm/link"}})
    assert "there is no body 'arm/tipp'" in wrong(forces=[{"body": "arm/tipp", "force": [1, 0, 0]}])
    hand = {"attach": "arm/top", "bodies": {"palm": LIGHT}}
    assert "no model has a body or a frame 'arm/top'" in wrong(models={"arm": ARM, "hand": hand})
    assert "frames: {NAME: {body: BODY" in wrong(sites={"mark": {"body": "ball"}})
    assert "frames of a model stand in the model itself" in wrong(
        bodies={}, models={}, model={"bodies": {"one": LIGHT}}, frames={"mark": {"body": "one"}}
    )


def test_frames_stand_in_the_file_of_their_engine():
    world = resolved(frames={"mark": {"body": "ball", "pose": {"xyz": [0.1, 0, 0]}}})
    assert 'site name="mark" pos="0.1 0 0"' in compile_world(world, ["mujoco"])["mujoco"].files["model.xml"]
