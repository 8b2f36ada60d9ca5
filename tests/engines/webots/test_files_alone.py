"""An engine that is proven by its files only: where that is said, and that nothing calls it valid."""

from __future__ import annotations

import dataclasses
import json

import pytest

from simspec import cli
from simspec.commands.scenario_options import VerifyOptions
from simspec.commands.verify import verify as verify_command
from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.registry import not_installed
from simspec.engines.webots.engine import Webots, excluded_by_joints
from simspec.errors import EXIT_ENGINE, EXIT_FAILED, EXIT_OK, UnsupportedError
from simspec.language.load import load
from simspec.proof.certificate import Certificate
from simspec.proof.judge import judge
from simspec.proof.verify import verify
from simspec.testing.worlds import accepting
from simspec.world.types import Body, Inertial, Joint, Pose, Shape
from tests.dialects.webots.worlds import every

WORLD = every()["bouncing"]
TENSOR = (0.1, 0.1, 0.1, 0.0, 0.0, 0.0)


def test_it_says_why_it_is_not_queried(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert Webots.version() is None
    why = "there is none: no webots on the path, and WEBOTS_HOME is not set"
    assert not_installed(Webots) == f"not installed ({why}): {Webots.NEEDS.elsewhere}"
    assert Webots.files_alone() == "no Webots is installed: files only (.wbt, R2023b)"
    (tmp_path / "fall.yaml").write_text(SPEC, encoding="utf-8")
    for words in (("run", "fall.yaml"), ("verify", "--self-test")):
        assert cli.main([*words, "--engine", "webots"]) == EXIT_ENGINE
        assert f"webots: not installed ({why})" in " ".join(capsys.readouterr().err.split())
    assert cli.main(["compile", "fall.yaml", "--engine", "webots"]) == EXIT_OK
    assert (tmp_path / "generated" / "fall" / "webots" / "world.wbt").is_file()
    assert cli.main(["engines", "install", "webots"]) == EXIT_ENGINE
    assert Webots.NEEDS.elsewhere in " ".join(capsys.readouterr().out.split())
    assert cli.main(["engines", "doctor", "webots"]) == EXIT_ENGINE
    assert "files only" in " ".join(capsys.readouterr().out.split())


def test_the_files_are_proven_and_nothing_else():
    certificate = verify(WORLD, ["webots"])
    proof = certificate.engines["webots"]
    assert {check.level for check in proof.checks} == {"L0"}
    assert (proof.passed, proof.files_alone, proof.valid, certificate.valid) == (True, True, False, False)
    assert proof.verdict.startswith(
        "not proven: the files hold the world (L0); not checked: L1, L2, L3, L4, L5, L6 (no Webots"
    )
    assert proof.version == "none"
    assert Certificate.from_json(certificate.to_json()) == certificate.timeless()
    faults = judge(certificate, WORLD)
    assert faults == [f"webots: {proof.verdict}"]


def test_a_part_that_is_hidden_is_a_fault():
    certificate = verify(WORLD, ["webots"])
    proof = certificate.engines["webots"]
    hidden = {name: why for name, why in proof.not_checked.items() if name != "L3"}
    changed = dataclasses.replace(proof, not_checked=hidden)
    faults = judge(dataclasses.replace(certificate, engines={"webots": changed}), WORLD)
    assert any("L3" in fault and "neither checked nor listed" in fault for fault in faults)


def test_no_other_engine_may_be_proven_by_its_files():
    certificate = verify(WORLD, ["webots"])
    proof = certificate.engines["webots"]
    faults = judge(dataclasses.replace(certificate, engines={"mujoco": proof}), WORLD)
    assert any("L1 is listed as not checked" in fault for fault in faults)


def test_files_that_are_wrong_are_not_valid(tmp_path):
    compiled = compile_world(WORLD, ["webots"])
    write_folder({**compiled["webots"].files, "world.wbt": "#VRML_SIM R2023b utf8\nWorldInfo {\n"}, tmp_path)
    proof = verify(WORLD, ["webots"], compiled=compiled, artifacts={"webots": tmp_path}).engines["webots"]
    assert (proof.passed, proof.verdict) == (False, "not valid")
    assert "world.wbt:2: WorldInfo of line 2 does not end" in proof.checks[0].detail


SPEC = """
simspec: 1
name: fall
bodies:
  ball:
    pose: {xyz: [0, 0, 1]}
    mass: 1 kg
    inertia: {principal: [0.1, 0.1, 0.1]}
engines: {webots: {accept: [joint.free]}}
"""


def run(tmp_path, capsys, spec, engines, as_json=False):
    path = tmp_path / "fall.yaml"
    path.write_text(spec, encoding="utf-8")
    code = verify_command(
        VerifyOptions(
            spec=str(path), engine=engines, no_cache=True, out=tmp_path / "out", deadline=60.0, as_json=as_json
        )
    )
    return code, capsys.readouterr().out


def test_the_command_says_so_and_ends_with_the_code_of_a_missing_engine(tmp_path, capsys):
    code, said = run(tmp_path, capsys, SPEC, ["webots"])
    assert code == EXIT_ENGINE
    assert "NOT PROVEN" in said
    assert "not checked: L1, L2, L3, L4, L6: no Webots is installed" in " ".join(said.split())
    assert " valid" not in said


def test_json_says_so(tmp_path, capsys):
    code, said = run(tmp_path, capsys, SPEC, ["webots"], as_json=True)
    content = json.loads(said)
    assert (code, content["valid"]) == (EXIT_ENGINE, False)
    assert set(content["certificate"]["engines"]["webots"]["not_checked"]) >= {"L1", "L2", "L3", "L4", "L6"}


def test_a_defect_in_the_engine_module_is_a_failure_and_no_missing_engine(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("simspec.dialects.webots.dialect.ALWAYS", 1.0)
    assert run(tmp_path, capsys, SPEC, ["webots"])[0] == EXIT_FAILED


# --- what touches --------------------------------------------------------------------------------------------------


def solid(name, kind, parent, at, material="rubber"):
    """A ball on a joint."""
    shape = Shape(name, "sphere", (0.05,), material=material)
    axis = (0.0, 1.0, 0.0) if kind in ("hinge", "slide") else (0.0, 0.0, 0.0)
    state = {"hinge": (0.0,), "slide": (0.0,), "ball": (1.0, 0.0, 0.0, 0.0)}.get(kind, ())
    rate = {"hinge": (0.0,), "slide": (0.0,), "ball": (0.0, 0.0, 0.0)}.get(kind, ())
    joint = Joint(f"{name}_joint", kind, parent, Pose(at), axis, position=state, velocity=rate)
    mass = Inertial(0.0) if kind == "fixed" else Inertial(1.0, inertia=TENSOR)
    return Body(name, "arm", mass, joint, (shape,))


def arm(*kinds, steps=None, excluded=()):
    """A chain over a floor, with parents and children that do not touch."""
    floor, ball = WORLD.bodies
    bodies, parent = [], None
    for index, kind in enumerate(kinds):
        place = (0.3, 0.0, 0.0) if steps is None else steps[index]
        bodies.append(solid(f"b{index}", kind, parent, (0.0, 0.0, 1.0) if parent is None else place))
        parent = f"b{index}"
    joined = [(f"b{index}", f"b{index + 1}") for index in range(len(kinds) - 1)]
    contact = dataclasses.replace(WORLD.contact, excluded_bodies=tuple(sorted([*joined, *excluded])))
    return dataclasses.replace(WORLD, bodies=(floor, ball, *bodies), contact=contact)


@pytest.mark.parametrize(
    ("world", "excluded"),
    [
        (arm("fixed", "hinge"), {("b1", "floor")}),  # a joint to the ground is one to all of it
        (arm("fixed", "hinge", "hinge", steps=((), (0.3, 0.0, 0.0), (0.4, 0.0, 0.0))), {("b1", "floor")}),
        (arm("fixed", "hinge", "hinge"), {("b1", "floor")}),  # two anchors that are one, and the ground at their end
        (arm("fixed", "slide", "slide"), {("b1", "floor")}),
        (arm("fixed", "hinge", "hinge", "hinge"), {("b1", "floor"), ("b1", "b3")}),
        (arm("fixed", "hinge", "ball", "ball"), {("b1", "floor"), ("b1", "b3")}),
        (arm("fixed", "hinge", "slide", "hinge"), {("b1", "floor"), ("b1", "b3")}),
        (
            arm("fixed", "hinge", "hinge", "hinge", steps=((), (0.3, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.3, 0.0))),
            {("b1", "floor")},
        ),
        (arm("fixed", "fixed", "hinge"), {("b2", "floor"), ("b0", "b2")}),
    ],
)
def test_pairs_that_webots_excludes_are_known(world, excluded):
    """By its collision callback: joined bodies, what is joined to the ground, and chains whose hinges have one anchor."""
    assert set(excluded_by_joints(world)) == excluded


def test_excluded_pairs_are_reported_with_the_approximation():
    world = accepting(arm("fixed", "hinge"), "webots")
    compiled = compile_world(world, ["webots"])["webots"]
    (text,) = [decision.how for decision in compiled.decisions if decision.feature.value == "joint.hinge"]
    assert "'b1' never touches 'floor', since Webots excludes joined bodies" in text


def test_bodies_that_no_joint_joins_cannot_be_excluded():
    with pytest.raises(UnsupportedError, match="no collision filter of bodies, and 'ball' would touch 'floor'"):
        accepting(arm("fixed", "hinge", excluded=(("ball", "floor"),)), "webots")
    compile_world(accepting(arm("fixed", "hinge", excluded=(("b1", "floor"),)), "webots"), ["webots"])


def test_the_library_of_scenarios_is_refused_or_accepted_by_name():
    with pytest.raises(UnsupportedError, match="only approximately: Webots' copy of ODE"):
        compile_world(load("specs/tumbling-body.yaml").resolve(), ["webots"])
