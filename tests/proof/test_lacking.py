"""Missing capabilities of an engine are reported as not checked, and no other check can be omitted under this name."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle, random_states
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.process import Operation
from simspec.engines.kit.registry import find_engine
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


def test_missing_capabilities_are_not_requested_and_are_in_the_certificate(lacking):
    operations = {operation.op: operation for operation in prepare(WORLD).operations(lacking)}
    assert operations["dynamics"].parameters["quantities"] == ["bias_force"]
    proof = verify(WORLD, [NAME]).engines[NAME]
    assert proof.valid
    assert proof.verdict == f"valid; not checked: L3 mass matrix ({WHY})"
    assert "mass matrix" not in {check.name for check in proof.level("L3")}
    assert judge_proof(NAME, proof, WORLD) == []


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
