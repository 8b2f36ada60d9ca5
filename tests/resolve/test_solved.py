"""A program is solved once for each distinct model and program, and again for every other one."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.dynamics.tool import Tool
from simspec.language.overrides import Override
from simspec.resolve import programs
from simspec.resolve.actuators import grasps
from simspec.resolve.programs import ProgramSolution
from simspec.world.types import Joint

SPECS = Path(__file__).parents[2] / "specs"


@pytest.fixture(scope="module")
def reach():
    spec = simspec.load(SPECS / "ur10e-reach.yaml")
    return spec, spec.resolve()


def changed(spec, **values):
    return spec.with_overrides([Override(path.replace("__", "."), value, None, None) for path, value in values.items()])


def hash_of(spec):
    world = spec.resolve()
    return programs.hash_of(spec.source, world, grasps(spec.source, world)[0])


SAME = [
    {"physics.timestep": "2 ms"},
    {"physics.gravity": [0, 0, -1.6]},
    {"control.robot.natural_frequency": "20 rad/s"},
    {"trajectory.until": "1.2 s"},
    {"record.every": "20 ms"},
    {"engines.dart.settings.collision_detector": "ode"},
]
OTHER = [
    {"models.arm.positions.elbow": 1.06},
    {"models.arm.pose.xyz.2": 0.021},
    {"trajectory.tool.pose": {"xyz": [0, 0, 0.01]}},
    {"trajectory.interval": "40 ms"},
    {"trajectory.program.0.move.xyz.1": 0.81},
    {"trajectory.program.0.in": "1.3 s", "physics.duration": "7.3 s"},
]


@pytest.mark.parametrize("values", SAME, ids=lambda values: next(iter(values)))
def test_changes_without_effect_on_the_motion_share_the_solution(reach, values, monkeypatch):
    spec, world = reach
    monkeypatch.setattr(programs, "ProgramSolution", None)  # nothing may be solved
    other = changed(spec, **values, **({} if "trajectory.until" not in values else {"expect": []})).resolve()
    assert other.trajectory == world.trajectory


@pytest.mark.parametrize("values", OTHER, ids=lambda values: next(iter(values)))
def test_changes_of_the_motion_are_solved_again(reach, values):
    spec, world = reach
    other = changed(spec, **values, expect=[])
    assert hash_of(other) != hash_of(spec)
    resolved = other.resolve()
    rows = ProgramSolution(other.source, dataclasses.replace(resolved, trajectory=None), {}).solve()
    assert np.array_equal(np.array(resolved.trajectory.positions), np.array(rows.positions))
    assert resolved.trajectory != world.trajectory


VALUES = {
    "name": "other",
    "kind": "slide",
    "parent": "other",
    "origin": simspec.world.types.Pose((1.0, 0.0, 0.0)),
    "axis": (0.6, 0.8, 0.0),
    "position_limits": (-0.1, 0.1),
    "angle_limit": 0.5,
    "position": (0.5,),
}


def test_every_field_of_a_joint_counts_but_those_that_kinematics_do_not_have(reach):
    """New fields count without a change of the key."""
    _, world = reach
    body = next(body for body in world.bodies if body.joint.kind == "hinge")
    plain = programs._kinematics(body)
    assert {field.name for field in dataclasses.fields(Joint)} == VALUES.keys() | programs.WITHOUT_MOTION.keys()
    for name, value in VALUES.items():
        assert (
            programs._kinematics(dataclasses.replace(body, joint=dataclasses.replace(body.joint, **{name: value})))
            != plain
        )
    for name in programs.WITHOUT_MOTION:
        value = (1.0,) if name == "velocity" else 1.0
        assert (
            programs._kinematics(dataclasses.replace(body, joint=dataclasses.replace(body.joint, **{name: value})))
            == plain
        )


def test_few_solutions_are_kept(reach, monkeypatch):
    spec, _ = reach
    monkeypatch.setattr(programs, "MOST_KEPT", 1)
    monkeypatch.setattr(programs, "_SOLVED", {})
    spec.resolve()
    changed(spec, **{"trajectory.interval": "60 ms"}).resolve()
    assert len(programs._SOLVED) == 1


def test_failed_solutions_are_reported_every_time_and_not_cached(reach):
    spec, _ = reach
    far = changed(spec, **{"trajectory.program.0.move.xyz": [9, 9, 9]})
    for _ in range(2):
        with pytest.raises(simspec.SpecError, match=r"out of reach: the tool stays [\d.e+]+ mm .*\n.*\[9, 9, 9\] m"):
            far.resolve()


def test_a_path_that_leaves_the_reach_and_a_target_that_does_have_different_errors(reach, monkeypatch):
    """The target is written as the user wrote it, not the point on the way at which the solver stopped."""
    spec, _ = reach
    solve = Tool.solve

    def misses_on_the_way(self, place, *arguments, far=False, **keywords):
        found = solve(self, place, *arguments, far=far, **keywords)
        return found if far else dataclasses.replace(found, distance=0.065)

    monkeypatch.setattr(Tool, "solve", misses_on_the_way)
    monkeypatch.setattr(programs, "_SOLVED", {})
    with pytest.raises(simspec.SpecError, match=r"straight path to the target leaves the reach") as caught:
        changed(spec, **{"trajectory.interval": "20 ms"}).resolve()
    (problem,) = caught.value.problems
    assert "65 mm" in problem.message
    assert problem.found == "a target at [0.2, 0.8, 0.5] m"
    assert "straight: false" in problem.hint
