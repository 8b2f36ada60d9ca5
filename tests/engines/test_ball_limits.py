"""Largest angles of ball joints: read, imported, stopped at by MuJoCo, refused by name elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pytest

import simspec
from simspec.compiler import compile_world
from simspec.dynamics.oracle import angles_of, random_states, shortened
from simspec.errors import SpecError, UnsupportedError
from simspec.language.load import load
from simspec.testing import worlds

pytestmark = pytest.mark.usefixtures("warm_engines")

BOB = {
    "mass": 1,
    "inertia": {"principal": [0.02, 0.03, 0.04]},
    "centre_of_mass": [0, 0, -0.3],
    "pose": {"xyz": [0, 0, 1]},
}


def world_of(joint, **more):
    data = {"simspec": 1, "name": "balls", "physics": {"timestep": 0.001, "duration": 2}}
    bodies = {"bob": {**BOB, "joint": {"type": "ball", **joint}}}
    return simspec.Spec.from_data({**data, "bodies": bodies, **more}).resolve()


def wrong(joint) -> str:
    with pytest.raises(SpecError) as refused:
        world_of(joint)
    return str(refused.value)


def test_an_angle_is_a_limit_of_balls_alone():
    assert world_of({"limits": {"angle": "60 deg"}}).bodies[0].joint.angle_limit == pytest.approx(math.pi / 3)
    assert "the limits of a ball joint have no position" in wrong({"limits": {"position": [0, 1]}})
    assert "the limits of a hinge joint have no angle" in wrong(
        {"type": "hinge", "axis": [1, 0, 0], "limits": {"angle": 1}}
    )
    assert "must be above 0" in wrong({"limits": {"angle": 0}})
    assert "limits.angle" in wrong({"limits": {"angle": 4}})


@pytest.mark.parametrize("position", [{"rpy": ["50 deg", "40 deg", 0]}, {"quat": [0.8, 0, -0.6, 0]}])
def test_a_ball_begins_within_its_limit(position):
    assert "beyond the joint's limits" in wrong({"limits": {"angle": "60 deg"}, "position": position})
    assert world_of({"limits": {"angle": "75 deg"}, "position": position}).bodies[0].joint.angle_limit


def test_a_ball_begins_at_its_limit():
    """Their angle is known to the root of the last bit."""
    for angle in (1e-3, 0.7, 2.0, 3.1):
        turn = {"quat": [math.cos(angle / 2), 0, math.sin(angle / 2), 0]}
        assert world_of({"limits": {"angle": angle}, "position": turn}).bodies[0].joint.angle_limit == angle


def test_mujoco_stops_a_ball_at_its_angle():
    """It swings from rest, about an axis across gravity, into its stop: v dt beyond it at most, and comes to rest."""
    spin = {"limits": {"angle": "60 deg"}, "velocity": [3, 4, 0], "damping": 0.02}
    world = worlds.accepting(world_of(spin, record={"every": "10 ms"}), "mujoco")
    run = simspec.run(world, "mujoco")
    angles = angles_of(run.arrays["q"])
    assert 0.99 * math.pi / 3 < angles.max() < math.pi / 3 + 5 * 0.001
    free = simspec.run(
        worlds.accepting(world_of({**spin, "limits": {}}, record={"every": "10 ms"}), "mujoco"), "mujoco"
    )
    assert angles_of(free.arrays["q"]).max() > 1.15


@pytest.mark.parametrize("engine", ["pybullet", "dart", "drake"])
def test_engines_without_limits_of_balls_refuse_them(engine):
    with pytest.raises(UnsupportedError, match=r"joint\.limits\.angle"):
        compile_world(world_of({"limits": {"angle": 1}}), [engine])


def test_probes_stay_within_the_limit():
    q, _ = random_states(world_of({"limits": {"angle": 0.5}}), 20)
    assert 0.3 < angles_of(q).max() <= 0.5
    turn = np.array([-0.6, 0.0, 0.8, 0.0])
    np.testing.assert_allclose(angles_of(shortened(turn, 0.25)[None]), 0.25 * angles_of(turn[None]), atol=1e-15)


def test_ranges_of_balls_are_imported(tmp_path):
    (tmp_path / "bob.xml").write_text(
        '<mujoco><worldbody><body name="bob"><joint name="j" type="ball" range="0 45"/><geom size="0.1"/></body>'
        "</worldbody></mujoco>"
    )
    (tmp_path / "scene.yaml").write_text("simspec: 1\nname: s\nmodels:\n  bob: {use: bob.xml}\n")
    (body,) = load(tmp_path / "scene.yaml").resolve().bodies
    assert body.joint.angle_limit == pytest.approx(math.pi / 4)
