"""Warnings of what follows from the numbers of a world and is wrong in every engine alike."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.dynamics import stability
from simspec.dynamics.oracle import Oracle
from simspec.dynamics.stability import THRESHOLD, gains
from simspec.errors import Problem
from simspec.resolve.timestep_warnings import passages
from simspec.world.kinematics import initial_state

ROOT = Path(__file__).resolve().parents[2]

TOP = """
simspec: 1
name: top
physics: {{gravity: [0, 0, 0], timestep: {step}, duration: {duration}}}
bodies:
  top:
    mass: 1
    velocity: {{angular: [{across}, 0, {along}]}}
    inertia: {{principal: [{x}, 0.02, 0.03]}}
"""


def loaded(tmp_path: Path, text: str, *sets: str) -> simspec.Spec:
    path = tmp_path / "spec.yaml"
    path.write_text(text)
    return simspec.load(path, sets=sets)


def top(
    tmp_path: Path,
    along: float = 300.0,
    across: float = 30.0,
    step: str = "1 ms",
    x: float = 0.02,
    duration: str = "0.1 s",
) -> simspec.Spec:
    return loaded(tmp_path, TOP.format(along=along, across=across, step=step, x=x, duration=duration))


def recommended(problem: Problem) -> str:
    found = re.search(r"up to ([0-9.e-]+) s", problem.allowed or "")
    assert found is not None
    return f"physics.timestep={found[1]} s"


def energy(spec: simspec.Spec) -> list[float]:
    world = spec.resolve()
    oracle = Oracle(world)
    states, speeds = oracle.motion(*initial_state(world), None, world.physics.steps, 1)
    return [oracle.energy(q, v)[0] for q, v in zip(states, speeds, strict=True)]


@pytest.mark.parametrize(("along", "x"), [(300.0, 0.02), (200.0, 0.011), (120.0, 0.012)])
def test_the_gain_of_a_rotation_is_the_oracle_s(tmp_path, along, x):
    spec = top(tmp_path, along, x=x)
    (gain,) = gains(spec.resolve())
    given = energy(spec)
    assert gain.gain == pytest.approx(max(given) / given[0] - 1.0, rel=0.02)
    assert gain.gain > THRESHOLD
    (problem,) = spec.warnings()
    assert str(problem.location).endswith("spec.yaml:8:16")
    assert "rad in a step" in problem.message
    # a whole number of steps: the duration is one of theirs
    slower = loaded(tmp_path, (tmp_path / "spec.yaml").read_text(), recommended(problem))
    assert max(given := energy(slower)) / given[0] - 1.0 < 1.05 * THRESHOLD


def test_a_rotation_that_diverges_says_when(tmp_path):
    spec = top(tmp_path, 1000.0)
    (problem,) = spec.warnings()
    (gain,) = gains(spec.resolve())
    assert math.isinf(gain.gain)
    assert "diverges after" in problem.message
    with np.errstate(over="ignore", invalid="ignore"):
        values = np.array(energy(spec))
    assert values[int(gain.time / 1e-3) + 15] > 50 * values[0]
    assert values[int(0.3 * gain.time / 1e-3)] < 3 * values[0]


def test_slow_uniform_and_principal_axis_rotations_cause_no_warning(tmp_path):
    assert top(tmp_path, 30.0).warnings() == []
    assert top(tmp_path, 3000.0, across=0.0).warnings() == []
    equal = TOP.replace("0.02, 0.03]", "0.02, 0.02]").format(
        step="1 ms", across=30, along=1000, x=0.02, duration="0.1 s"
    )
    assert loaded(tmp_path, equal).warnings() == []


@pytest.mark.parametrize("kind", ["child", "ball"])
def test_bodies_of_several_parts_and_ball_joints_are_followed_by_the_oracle(tmp_path, kind):
    text = TOP.format(step="1 ms", across=30, along=300, x=0.02, duration="0.1 s")
    if kind == "child":
        text += (
            "  part: {parent: top, joint: {type: fixed}, mass: 0.001, inertia: {principal: [1.0e-7, 1.0e-7, 1.0e-7]}}\n"
        )
    else:
        text = text.replace("velocity: {angular: [30, 0, 300]}", "joint: {type: ball, velocity: [30, 0, 300]}")
    (gain,) = gains(loaded(tmp_path, text).resolve())
    assert gain.body == "top"
    assert gain.gain == pytest.approx(0.045, abs=0.02)


WALL = """
simspec: 1
name: wall
physics: {{gravity: [0, 0, {gravity}], timestep: {step}, duration: 1 s}}
contact: {{materials: {{stone: {{friction: 0.5}}}}{more}}}
bodies:
  wall: {{fixed: true, pose: {{xyz: {wall}}}, shapes: [{{box: {{size: {size}}}}}]}}
  ball:
    mass: 1
    pose: {{xyz: [0, 0, {height}]}}
    velocity: {{linear: [{speed}, 0, 0]}}
    shapes: [{{sphere: {{radius: 0.05}}}}]
"""


def wall(tmp_path: Path, speed: float, **changed: object) -> simspec.Spec:
    values = {
        "gravity": 0,
        "step": "10 ms",
        "wall": "[5.5, 0, 0]",
        "size": "[0.2, 4, 4]",
        "height": 0,
        "more": "",
    } | changed
    return loaded(tmp_path, WALL.format(speed=speed, **values))


def test_a_step_that_is_longer_than_a_wall_is_thick_is_warned_of(tmp_path):
    (problem,) = wall(tmp_path, 100.0).warnings()
    assert str(problem.location).endswith("spec.yaml:11:16")
    assert "'wall' is in its way" in problem.message
    assert wall(tmp_path, 14.0).warnings() == []
    assert wall(tmp_path, 16.0).warnings() != []
    text = (tmp_path / "spec.yaml").read_text().replace("[16.0,", "[100,")
    assert loaded(tmp_path, text, recommended(problem)).warnings() == []


def test_obstacles_outside_the_path_cause_no_warning(tmp_path):
    assert wall(tmp_path, -100.0).warnings() == []
    assert wall(tmp_path, 100.0, wall="[5.5, 9, 0]").warnings() == []
    assert wall(tmp_path, 100.0, size="[4, 4, 4]").warnings() == [], "a thick wall stops it"
    past = "  before: {fixed: true, pose: {xyz: [3, 0, 0]}, shapes: [{box: {size: [2.5, 4, 4]}}]}\n"
    assert wall(tmp_path, 100.0).warnings() != []
    assert loaded(tmp_path, (tmp_path / "spec.yaml").read_text() + past).warnings() == [], "it is stopped before"
    assert wall(tmp_path, 100.0, more=", exclude: [[ball, wall]]").warnings() == []


def test_the_speed_of_a_fall_counts(tmp_path):
    sheet = {"wall": "[0, 0, 0]", "size": "[4, 4, 0.01]", "gravity": -9.81}
    (problem,) = wall(tmp_path, 0.0, height=4, **sheet).warnings()
    assert "falls 0.0" in problem.message
    assert str(problem.location).endswith("spec.yaml:10:5")
    assert wall(tmp_path, 0.0, height=0.5, **sheet).warnings() == []
    (passage,) = passages(wall(tmp_path, 0.0, height=4, **sheet).resolve())
    assert passage.speed == pytest.approx(math.sqrt(2 * 9.81 * 3.95), rel=0.02)


def test_bodies_that_slide_on_the_ground_are_checked(tmp_path):
    wall(tmp_path, 100.0, gravity=-9.81, height=0.05)
    text = (tmp_path / "spec.yaml").read_text() + "  ground: {fixed: true, shapes: [{plane: {}}]}\n"
    assert [passage.obstacle for passage in passages(loaded(tmp_path, text).resolve())] == ["wall"]


DRAG = """
simspec: 1
name: leaf
physics:
  gravity: [0, 0, 0]
  timestep: 10 ms
  duration: 1 s
  fluid: {{density: 1000, velocity: [{wind}, 0, 0]}}
bodies:
  leaf:
    mass: 0.1
    velocity: {{linear: [{speed}, 0, 0], angular: [0, 0, {turn}]}}
    inertia: {{principal: [1.0e-4, 1.0e-4, 1.0e-4]}}
"""


@pytest.mark.parametrize("axis", ["speed", "wind", "turn"])
def test_drag_that_makes_faster_is_warned_of(tmp_path, axis):
    def spec_at(value: float) -> simspec.Spec:
        return loaded(tmp_path, DRAG.format(**{"speed": 0, "wind": 0, "turn": 0} | {axis: value}))

    def after(value: float) -> float:
        """The relative speed to the fluid after a step, and before it."""
        world = spec_at(value).resolve()
        q, v = initial_state(world)
        values = np.array([*world.physics.fluid.velocity, 0.0, 0.0, 0.0])
        _, then = Oracle(world).step(q, v, np.zeros(6))
        return float(np.linalg.norm(then - values) / np.linalg.norm(v - values))

    low, high = 1e-3, 1e5
    while high > 1.001 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if after(middle) > 1.0 else (middle, high)
    drag = [warning for warning in spec_at(1.01 * high).warnings() if "drag" in warning.message]
    assert len(drag) == 1
    assert not [warning for warning in spec_at(0.99 * low).warnings() if "drag" in warning.message]
    assert str(drag[0].location).startswith(f"{tmp_path}/spec.yaml:12:")


@pytest.mark.parametrize("name", ["tumbling-body", "bouncing-ball", "contact/newtons-cradle", "motion/moving-platform"])
def test_the_library_is_quiet(name):
    assert simspec.load(ROOT / "specs" / f"{name}.yaml").warnings() == []


@pytest.mark.parametrize(
    ("velocity", "more"),
    [((0.5, -1.0, 3.0), {}), ((5.0, -10.0, 3.0), {"damping": 0.01, "armature": 0.02})],
)
def test_a_body_on_a_ball_joint_turns_as_in_the_oracle(velocity, more):
    world = simspec.load(ROOT / "specs/ball-pendulum.yaml").resolve()
    body = world.bodies[0]
    body = dataclasses.replace(body, joint=dataclasses.replace(body.joint, velocity=velocity, **more))
    physics = dataclasses.replace(world.physics, gravity=(0.0, 0.0, 0.0))
    oracle = Oracle(dataclasses.replace(world, bodies=(body,), physics=physics))
    q, v = initial_state(oracle.world)
    states, speeds = oracle.motion(q, v, None, 2000, 20)
    energies = np.array([sum(oracle.energy(*state)) for state in zip(states, speeds, strict=True)])
    expected = energies / sum(oracle.energy(q, v)) - 1.0
    assert stability._about_pivot(body, physics.timestep, 2000, 20) == pytest.approx(expected, abs=1e-12)
