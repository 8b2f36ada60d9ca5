"""Audits of models whose mass an engine fixes, of tensors that no body has, and of implausible files."""

from __future__ import annotations

import dataclasses
import json

import pytest
from typer.testing import CliRunner

from simspec import cli
from simspec.audit import FindingSeverity, What
from simspec.audit.audit import plausibility_of
from simspec.audit.compare import FileComparison
from simspec.audit.meaning import Meaning, meaning_of
from simspec.language.foreign import ImportOptions
from simspec.world.types import Body, Inertial, Joint, ReadBack
from tests.plausibility.files import urdf

ROOT = Inertial(0.9, (0.0, 0.0, 0.0), (0.01, 0.01, 0.01, 0.0, 0.0, 0.0))
FREE = Joint("root_joint", "free", position=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)


def rotor(mass: float) -> Body:
    joint = Joint("spin", "hinge", "root", axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    return Body("rotor", "drone", Inertial(mass, (0.0, 0.0, 0.0), (1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0)), joint)


def merged(tmp_path, mass: float, world: bool):
    """The finding about the root of a drone with one rotor of ``mass``, in an engine that fixes the root to the world, as a
    part of it (``world``) or as a body of its own."""
    bodies = (Body("root", "drone", ROOT, FREE), rotor(mass))
    actual_rotor = bodies[1]
    fixed = dataclasses.replace(bodies[0], joint=Joint("root_joint", "fixed"))
    actual = (fixed, actual_rotor)
    if world:
        actual = (dataclasses.replace(actual_rotor, joint=dataclasses.replace(actual_rotor.joint, parent=None)),)
    meaning = Meaning(tmp_path / "drone.urdf", "urdf", bodies=bodies)
    found = FileComparison("engine", meaning, ReadBack(actual, (0.0, 0.0, -9.81), 0.001), {}).run().findings
    return [finding for finding in found if finding.element == "root" and finding.quantity in ("body", "joint.type")]


@pytest.mark.parametrize("world", [True, False])
@pytest.mark.parametrize(("rotor_mass", "severity"), [(0.09, FindingSeverity.PHYSICS), (0.11, FindingSeverity.DEFAULT)])
def test_a_free_model_whose_mass_is_fixed_is_another_model(tmp_path, world, rotor_mass, severity):
    found = merged(tmp_path, rotor_mass, world)
    assert [entry.severity for entry in found] == [severity]
    assert found[0].what is (What.MERGED if world else What.CHANGED)
    if severity is FindingSeverity.PHYSICS:
        assert "0.9 kg of 0.99 kg cannot move" in found[0].why


def impossible(tmp_path) -> Meaning:
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(tip_inertia="0.001 0.001 0.01", centre="0 0 -0.05"), encoding="utf-8")
    return meaning_of(path, ImportOptions())


@pytest.mark.parametrize(
    ("actual", "what"),
    [
        ((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), What.DROPPED),
        ((0.007, 0.007, 0.0004, 0.0, 0.0, 0.0), What.CHANGED),
        ((0.001, 0.001, 0.01, 0.0, 0.0, 0.0), None),
    ],
)
def test_tensors_that_no_body_has(tmp_path, actual, what):
    meaning = impossible(tmp_path)
    assert meaning.defects
    bodies = tuple(
        dataclasses.replace(body, inertial=dataclasses.replace(body.inertial, inertia=actual))
        if body.name == "tip"
        else body
        for body in meaning.bodies
    )
    found = FileComparison("engine", meaning, ReadBack(bodies, (0.0, 0.0, -9.81), 0.001), {}).run().findings
    tensors = [finding for finding in found if finding.element == "tip" and finding.quantity == "inertia"]
    assert [tensor.what for tensor in tensors] == ([what] if what else [])
    assert all(tensor.silent and "in silence" in tensor.why for tensor in tensors)


def test_repaired_values_are_not_judged(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(tip_inertia="0.00001 0.00001 0.03", centre="0 0 -0.05"), encoding="utf-8")
    found = plausibility_of(meaning_of(path, ImportOptions()))
    assert {(finding.rule, finding.element) for finding in found.findings} == {("mass-outside", "arm")}


@pytest.mark.usefixtures("warm_engines")
def test_an_audit_has_what_is_implausible(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(centre="0 0 -0.05"), encoding="utf-8")
    words = ["audit", str(path), "--engine", "mujoco", "--no-verify"]
    result = CliRunner().invoke(cli.app, words)
    assert "plausibility: 1 warning" in result.stdout
    assert "  warning mass-outside: 50 mm, arm, line 7" in result.stdout
    data = json.loads(CliRunner().invoke(cli.app, [*words, "--json"]).stdout)
    assert [finding["rule"] for finding in data["files"][0]["plausibility"]["findings"]] == ["mass-outside"]
