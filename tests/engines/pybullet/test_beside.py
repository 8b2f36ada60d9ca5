"""Trees that are too large for PyBullet, of which most bodies are nothing but frames."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.dialects.pybullet.sidecar import MOST_LINKS, frames_alongside
from simspec.engines.kit.process import Operation, call
from simspec.errors import UnsupportedError
from simspec.proof.verify import verify
from simspec.world import frames
from simspec.world.kinematics import bare_frames, initial_state, poses
from simspec.world.types import Body, ConnectConstraint, EngineOptions, Inertial, Joint, Physics, Pose, World

pytestmark = pytest.mark.usefixtures("warm_engines")

TURNED = frames.from_axis_angle((2.0 / 7.0, 3.0 / 7.0, 6.0 / 7.0), 0.4)
HEAVY = Inertial(1.5, (0.02, -0.01, 0.03), (0.02, 0.03, 0.04, 0.001, 0.002, 0.0))


def robot(count: int = 130, outside: tuple[str, ...] = ("tree.size",)) -> World:
    """A free base with three hinges below it, and ``count`` frames: on all of them, and on one another."""
    start = (0.3, -0.2, 1.0, *TURNED)
    bodies = [
        Body("base", "robot", HEAVY, Joint("base", "free", position=start, velocity=(0.1, 0.2, 0.0, 0.5, -0.3, 0.2)))
    ]
    for number, above in enumerate(("base", "arm0", "arm1")):
        origin = Pose((0.1, 0.02 * number, 0.2), TURNED)
        joint = Joint(f"arm{number}", "hinge", above, origin, (0.0, 0.6, 0.8), position=(0.3,), velocity=(0.7,))
        bodies.append(Body(f"arm{number}", "robot", HEAVY, joint))
    for number in range(count):
        above = bodies[number % 4].name if number % 3 else bodies[-1].name
        fixed = Joint(f"to{number}", "fixed", above, Pose((0.01, 0.002 * number, -0.03), TURNED))
        bodies.append(Body(f"frame{number}", "robot", Inertial(0.0), fixed))
    return World(
        "large", tuple(bodies), physics=Physics(steps=500), engines=(EngineOptions("pybullet", outside=outside),)
    )


def test_frames_of_large_trees_are_in_the_sidecar_on_request():
    world = robot()
    assert frames_alongside(world) == bare_frames(world) == {f"frame{number}" for number in range(130)}
    assert not frames_alongside(robot(MOST_LINKS - 4)), "there is room"
    with pytest.raises(UnsupportedError, match=r"simspec can compute it outside the engine.*nothing but frames"):
        compile_world(robot(outside=()), ["pybullet"])
    checks = verify(world, ["pybullet"], levels=("L0", "L1", "L2", "L4")).engines["pybullet"]
    assert [check for check in checks.checks if not check.passed] == []
    assert "tree.size" in checks.approximations
    assert {"pose, position", "body velocity"} <= {check.name for check in checks.checks if check.level == "L2"}


def test_a_body_with_dependents_is_not_a_frame():
    world = robot(4)
    assert len(bare_frames(world)) == 4
    heavy = dataclasses.replace(world.bodies[-1], inertial=HEAVY)
    carried = dataclasses.replace(world, bodies=(*world.bodies[:-1], heavy))
    above = heavy.joint.parent
    assert not {heavy.name, above} & bare_frames(carried)
    connect = ConnectConstraint("loop", "frame1", "arm2", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert "frame1" not in bare_frames(dataclasses.replace(world, constraints=(connect,)))


def test_bodies_with_mass_are_as_many_as_ever():
    world = robot()
    bodies = tuple(
        dataclasses.replace(body, inertial=HEAVY) if body.name.startswith("frame") else body for body in world.bodies
    )
    with pytest.raises(UnsupportedError, match="at most 127 links"):
        compile_world(dataclasses.replace(world, bodies=bodies), ["pybullet"])


def test_frames_move_with_their_carriers_and_a_wrong_frame_is_found(tmp_path):
    world = robot()
    compile_world(world, ["pybullet"])["pybullet"].artifacts.write(tmp_path / "files")
    q, v = (array[None] for array in initial_state(world))
    (answer,) = call("pybullet", tmp_path / "files", [Operation("kinematics", {}, {"q": q, "v": v})]).answers
    wanted = poses(world)
    actual = answer.arrays["pose"][0]
    for row, body in zip(actual, world.bodies, strict=True):
        np.testing.assert_allclose(row[:3], wanted[body.name].position, atol=1e-12)
        assert abs(np.dot(row[3:], wanted[body.name].quaternion)) == pytest.approx(1.0, abs=1e-12)
    sidecar = json.loads((tmp_path / "files" / "sidecar.json").read_text())
    sidecar["frames"][7]["pose"]["position"][0] += 1e-6
    (tmp_path / "files" / "sidecar.json").write_text(json.dumps(sidecar))
    (answer,) = call("pybullet", tmp_path / "files", [Operation("read_back")]).answers
    moved = {body.name: body.joint.origin.position for body in answer.read_back.bodies}
    wrong = [
        body.name for body in world.bodies if not np.allclose(moved[body.name], body.joint.origin.position, atol=1e-9)
    ]
    assert wrong == [sidecar["frames"][7]["name"]]
