"""Missing capabilities of an engine are reported as not checked, and no other check can be omitted under this name."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle, random_states
from simspec.engines.kit.capabilities import DOUBLE, SINGLE, Capability
from simspec.engines.kit.process import Operation
from simspec.engines.kit.registry import find_engine
from simspec.proof.accelerations import BIAS, BY_STEPS, GRAVITY, MASS
from simspec.proof.accelerations import plan as plan_accelerations
from simspec.proof.checks import PRECISIONS
from simspec.proof.expected import left_out, not_checked_parts, shortfalls, unchecked
from simspec.proof.judge import judge_proof
from simspec.proof.probes import dynamics_checks
from simspec.proof.verify import prepare, verify
from simspec.testing import worlds
from tests.installed import INSTALLED

WORLD = worlds.hinges()
NAME = INSTALLED[0]
WHY = "it forms none"


@pytest.fixture
def lacking(monkeypatch):
    """An engine that says it lacks its mass matrix."""
    kind = find_engine(NAME)
    monkeypatch.setattr(kind, "LACKS", {**kind.LACKS, Capability.MASS_MATRIX: WHY})
    return kind


def test_missing_capabilities_are_not_requested_and_are_in_the_certificate(lacking, monkeypatch):
    operations = {operation.op: operation for operation in prepare(WORLD).operations(lacking)}
    assert operations["dynamics"].parameters["quantities"] == ["bias_force"]
    monkeypatch.setattr(lacking, "STEPS_UNMEASURED", "its steps were not measured")
    proof = verify(WORLD, [NAME]).engines[NAME]
    assert proof.valid
    assert proof.verdict == f"valid; not checked: L3 mass matrix ({WHY})"
    assert "mass matrix" not in {check.name for check in proof.level("L3")}
    assert judge_proof(NAME, proof, WORLD) == []


def test_accelerations_of_a_step_stand_for_missing_capabilities(lacking, monkeypatch):
    monkeypatch.setattr(lacking, "LACKS", {**lacking.LACKS, Capability.BIAS_FORCE: WHY})
    operations = {operation.op: operation for operation in prepare(WORLD).operations(lacking)}
    assert "dynamics" not in operations
    assert operations["accelerations"].arrays["q"].shape[0] > len(operations["kinematics"].arrays["q"])
    proof = verify(WORLD, [NAME]).engines[NAME]
    assert proof.verdict == "valid"
    assert {check.name: check.detail for check in proof.level("L3")} == dict.fromkeys(
        ("mass matrix", "bias force", "gravity force"), BY_STEPS
    )
    assert judge_proof(NAME, proof, WORLD) == []


@pytest.mark.parametrize("share", [1e-3, -1e-4])
def test_accelerations_of_a_step_show_a_moment_of_inertia(share):
    """Each principal moment of each moving body, in single precision 0.1 %."""
    oracle, numbers = Oracle(WORLD), PRECISIONS[SINGLE if share > 0.0 else DOUBLE]
    q, v = random_states(WORLD, 2)
    steps = plan_accelerations(oracle, q, v, numbers, (MASS, GRAVITY, BIAS))
    for number, body in enumerate(WORLD.bodies):
        if body.joint.kind == "fixed":
            continue
        for axis in range(3):
            inertia = list(body.inertial.inertia)
            inertia[axis] *= 1.0 + share
            other = dataclasses.replace(body, inertial=dataclasses.replace(body.inertial, inertia=tuple(inertia)))
            world = dataclasses.replace(WORLD, bodies=(*WORLD.bodies[:number], other, *WORLD.bodies[number + 1 :]))
            moved = Oracle(world)
            answer = [moved.step(*state)[1] for state in zip(steps.q, steps.v, steps.effort, strict=True)]
            checks = {check.name: check for check in steps.checks(WORLD, {"v": np.array(answer)}, numbers)}
            assert not checks[MASS].passed or not checks[BIAS].passed, (body.name, axis, checks[MASS].worst)


def test_a_certificate_that_omits_a_present_capability_is_not_valid():
    proof = verify(WORLD, [NAME]).engines[NAME]
    checks = tuple(check for check in proof.checks if check.name != "mass matrix")
    forged = dataclasses.replace(proof, checks=checks, not_checked={**proof.not_checked, "L3 mass matrix": WHY})
    said = judge_proof(NAME, forged, WORLD)
    assert any("does not declare" in line for line in said)
    assert any("mass matrix: no comparison was made" in line for line in said)


def test_an_engine_that_declares_a_capability_and_gives_nothing_fails():
    """No mass matrix in its answer: nothing was compared, and that is a failed check; one of zeros is another."""
    oracle = Oracle(WORLD)
    q, v = random_states(WORLD, 1)
    bias = oracle.bias_force(q[0], v[0])[None]
    values = oracle.bias_force(q[0], 0.0 * v[0])[None]
    given = {"bias_force": bias, "gravity_force": values}
    checks = dynamics_checks(WORLD, oracle, q, v, given)
    parts = not_checked_parts(WORLD, find_engine(NAME), left_out(WORLD))
    missing = shortfalls(WORLD, checks, {**left_out(WORLD), **parts})
    assert any("mass matrix" in check.detail for check in missing if check.level == "L3")
    zeros = np.zeros((1, sum(block.size**2 for block in oracle.blocks)))
    lies = dynamics_checks(WORLD, oracle, q, v, {**given, "mass": zeros})
    assert not next(check for check in lies if check.name == "mass matrix").passed


def test_parts_of_other_capabilities(lacking, monkeypatch):
    monkeypatch.setattr(lacking, "LACKS", dict.fromkeys(Capability, WHY))
    assert set(unchecked(WORLD, lacking)) >= {("L6", "motion"), ("L4", "collision matrix"), ("L3", "bias force")}
    assert {operation.op for operation in prepare(WORLD).operations(lacking)} == {"read_back", "kinematics"}
    assert isinstance(prepare(WORLD).operations(lacking)[0], Operation)
    assert set(not_checked_parts(WORLD, lacking, left_out(WORLD))) >= {"L3", "L6"}
