"""Files and their models in engines: findings, their places, and the end of the command."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from simspec import cli
from simspec.audit import FileAudit, FindingSeverity, What
from simspec.audit.audit import audit
from simspec.audit.compare import FileComparison
from simspec.audit.meaning import Meaning, meaning_of
from simspec.engines.kit.registry import engines
from simspec.errors import SpecError
from simspec.language.foreign import ImportOptions
from simspec.processes import Ended
from simspec.world.types import ReadBack
from tests.audit.files import robot

pytestmark = pytest.mark.usefixtures("warm_engines")

READERS = [name for name, engine in engines().items() if "urdf" in engine.FOREIGN and engine.version() is not None]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> Path:
    path: Path = tmp_path_factory.mktemp("audit") / "tiny.urdf"
    path.write_text(robot(), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def audited(tiny) -> FileAudit:
    return audit(tiny, READERS, ImportOptions())


def silent(audited: FileAudit, engine: str) -> set[tuple[str, str, str]]:
    entry = next(entry for entry in audited.engines if entry.engine == engine)
    assert entry.loaded
    assert entry.compared > 20
    return {(finding.element, finding.quantity, finding.what.value) for finding in entry.silent}


def test_silent_changes_are_found(audited):
    added = {("the file", name, "added") for name in ("linear_damping", "joints_held_by_motors", "velocity_clamp")}
    inertia = {(name, "inertia", "changed") for name in ("base", "flange", "arm", "hand")}
    expected = {
        "mujoco": set(),
        "drake": {("arm", "joint.dry_friction", "dropped")},
        "dart": {("the file", "limits_enforced", "changed"), ("the file", "self_collision", "changed")},
        "pybullet": {
            *added,
            *inertia,
            ("arm", "shapes", "changed"),
            ("the file", "collision_margin", "added"),
            ("the file", "self_collision", "changed"),
        },
    }
    assert {name: silent(audited, name) for name in READERS} == {name: expected[name] for name in READERS}


def test_places_and_values(audited):
    findings = [finding for engine in audited.engines for finding in engine.findings]
    dropped = [finding for finding in findings if finding.quantity == "joint.dry_friction"]
    assert dropped
    line = next(number for number, text in enumerate(robot().splitlines(), 1) if 'friction="0.1"' in text)
    assert {finding.location.line for finding in dropped if finding.location is not None} == {line}
    assert {finding.file_value for finding in dropped} == {"0.1"}
    ratings = [finding for finding in findings if finding.quantity == "joint.velocity_limit"]
    assert ratings
    assert all(finding.severity is FindingSeverity.RATING for finding in ratings)


def test_merged_bodies_are_no_other_model(audited):
    engine = next(engine for engine in audited.engines if engine.engine == "mujoco")
    merged = {finding.element: finding.severity for finding in engine.findings if finding.what is What.MERGED}
    assert merged == {"base": FindingSeverity.DEFAULT, "flange": FindingSeverity.INFORMATION}


def test_the_compiled_model_is_proven(audited):
    proven = {entry.engine: entry.valid for entry in audited.compiled}
    assert proven == {name: None if name == "drake" else True for name in READERS}


def read_back_of(meaning: Meaning) -> ReadBack:
    return ReadBack(meaning.bodies, (0.0, 0.0, 0.0), 0.001)


def findings_of(meaning: Meaning, back: ReadBack) -> set[tuple[str, str]]:
    return {
        (finding.element, finding.quantity) for finding in FileComparison("an engine", meaning, back, {}).run().findings
    }


@pytest.mark.parametrize(
    ("quantity", "change"),
    [
        ("mass", lambda body: {"inertial": dataclasses.replace(body.inertial, mass=1.00001)}),
        (
            "centre_of_mass",
            lambda body: {"inertial": dataclasses.replace(body.inertial, centre_of_mass=(0.1, 0.0, 1e-5))},
        ),
        ("inertia", lambda body: {"inertial": dataclasses.replace(body.inertial, inertia=(0.02, 0.03, 0.04, 0, 0, 0))}),
        ("joint.axis", lambda body: {"joint": dataclasses.replace(body.joint, axis=(0.0, -1.0, 0.0))}),
        ("joint.limits", lambda body: {"joint": dataclasses.replace(body.joint, position_limits=(-1.0, 2.0001))}),
        ("joint.limits", lambda body: {"joint": dataclasses.replace(body.joint, position_limits=None)}),
        ("joint.damping", lambda body: {"joint": dataclasses.replace(body.joint, damping=0.0)}),
        ("joint.armature", lambda body: {"joint": dataclasses.replace(body.joint, armature=0.01)}),
        ("joint.type", lambda body: {"joint": dataclasses.replace(body.joint, kind="fixed")}),
        ("shapes", lambda body: {"shapes": ()}),
    ],
)
def test_each_value_is_compared(tiny, quantity, change):
    meaning = meaning_of(tiny, ImportOptions())
    assert not findings_of(meaning, read_back_of(meaning))
    bodies = tuple(dataclasses.replace(body, **change(body)) if body.name == "arm" else body for body in meaning.bodies)
    found = findings_of(meaning, dataclasses.replace(read_back_of(meaning), bodies=bodies))
    assert found == {("arm", quantity)}


def test_a_repaired_value_is_not_compared(tmp_path):
    path = tmp_path / "hole.urdf"
    path.write_text(robot(hand=""), encoding="utf-8")
    meaning = meaning_of(path, ImportOptions())
    assert meaning.defects
    assert meaning.bodies
    comparison = FileComparison("an engine", meaning, read_back_of(meaning), {})
    hand = next(body for body in meaning.bodies if body.name == "hand")
    assert not any(comparison.compares(hand, word) for word in ("mass", "centre_of_mass", "inertia"))
    assert comparison.compares(hand, "joint.type")


@pytest.mark.parametrize(
    ("name", "text", "wrong"),
    [
        ("a.urdf", "<robot", "not XML"),
        ("a.urdf", '<!DOCTYPE robot [<!ENTITY a "b">]><robot/>', "DOCTYPE"),
        ("a.urdf", "<html/>", "outermost element"),
        ("a.txt", "<robot/>", "no engine reads such files"),
    ],
)
def test_other_files_are_refused(tmp_path, name, text, wrong):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SpecError, match=wrong):
        audit(path, READERS, ImportOptions())


def test_the_command(tiny, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["audit", str(tiny), "--engine", "mujoco", "--no-verify"]
    done = CliRunner().invoke(cli.app, [*words, "--junit", "audit.xml", "--html", "audit.html", "--json"])
    assert done.exit_code == 0
    data = json.loads(done.stdout)
    assert data["clean"]
    assert [engine["engine"] for engine in data["files"][0]["engines"]] == ["mujoco"]
    assert "merged" in (tmp_path / "audit.xml").read_text(encoding="utf-8")
    page = (tmp_path / "audit.html").read_text(encoding="utf-8")
    assert "Values of the file that engines read differently" in page
    assert "default-src" in page


def test_two_files_of_a_robot(tiny, tmp_path):
    other = tmp_path / "other.urdf"
    other.write_text(robot(upper=0.5).replace('<link name="flange">', '<link name="flange"><!-- -->'), encoding="utf-8")
    done = CliRunner().invoke(cli.app, ["audit", str(tiny), str(other), "--pair", "--json"])
    assert done.exit_code == 1
    data = json.loads(done.stdout)
    assert [(finding["element"], finding["quantity"]) for finding in data["findings"]] == [("hand", "joint.limits")]
    assert data["matched"] == 4


TETRAHEDRON = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_packages_are_named(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "part.obj").write_text(TETRAHEDRON, encoding="utf-8")
    mesh = '<mesh filename="package://mine/part.obj"/>'
    (tmp_path / "own").mkdir()
    path = tmp_path / "own" / "robot.urdf"
    path.write_text(robot().replace('<sphere radius="0.1"/>', mesh), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    words = ["audit", str(path), "--engine", "mujoco", "--no-verify", "--json"]
    defects = [
        json.loads(CliRunner().invoke(cli.app, [*words, *more]).stdout)["files"][0]["defects"]
        for more in ([], ["--package", "mine=elsewhere"])
    ]
    assert "the package 'mine' is not found" in defects[0][0]
    assert not defects[1]
    assert CliRunner().invoke(cli.app, [*words, "--package", "mine"]).exit_code == 2


def test_each_engine_is_reported_when_it_has_finished(tiny):
    partial: list[FileAudit] = []
    whole = audit(tiny, READERS, ImportOptions(), prove=False, arrived=partial.append)
    assert [len(entry.engines) for entry in partial] == [*range(1, len(READERS) + 1)]
    assert {entry.engines[-1].engine for entry in partial} == {*READERS}
    assert {*partial[0].missing} == {*READERS} - {partial[0].engines[0].engine}
    assert [entry.engine for entry in whole.engines] == READERS
    finished = {entry.engine: entry.findings for entry in whole.engines}
    assert all(entry.engines[-1].findings == finished[entry.engines[-1].engine] for entry in partial)


def test_engines_that_compile_for_a_model_are_last(tiny, monkeypatch):
    first = READERS[0]
    monkeypatch.setattr(engines()[first], "COMPILING", 60.0)
    whole = audit(tiny, READERS, ImportOptions(), prove=False)
    assert [entry.engine for entry in whole.engines] == [*READERS[1:], first]


def test_an_interrupt_prints_the_results_so_far(audited, monkeypatch, capfd):
    def interrupted(*given, arrived, **keywords):
        arrived(dataclasses.replace(audited, engines=audited.engines[:1], missing=("slow", "slower")))
        raise Ended(2)

    monkeypatch.setattr("simspec.commands.verify.audit_file", interrupted)
    assert cli.main(["audit", "tiny.urdf", "-e", READERS[0]]) == Ended(2).code
    said = capfd.readouterr()
    assert f"tiny.urdf: {READERS[0]} loads it: " in said.err
    assert "Values of the file that engines read differently" in said.out
    assert "interrupted: no result of slow, slower" in said.out
    assert "certified" not in said.out.splitlines()[-1]


SPRUNG = """<mujoco>
  <option gravity="0 0 -3"/>
  <worldbody><body name="arm"><joint name="swing" axis="0 1 0" stiffness="3" springref="20"/>
    <geom type="sphere" size=".1"/></body></worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    ("rest", "stiffness", "gravity", "found"),
    [
        (1.0, 1.0, -3.0, set()),
        (0.0, 1.0, -3.0, {("arm", "joint.spring_rest", What.DROPPED)}),
        (2.0, 1.0, -3.0, {("arm", "joint.spring_rest", What.CHANGED)}),
        (0.0, 0.0, -3.0, {("arm", "joint.spring_stiffness", What.DROPPED)}),
        (1.0, 1.0, -9.81, {("the file", "gravity", What.CHANGED)}),
    ],
)
def test_gravity_and_the_rest_of_springs_are_compared(tmp_path, rest, stiffness, gravity, found):
    path = tmp_path / "sprung.xml"
    path.write_text(SPRUNG, encoding="utf-8")
    meaning = meaning_of(path, ImportOptions())
    (body,) = meaning.bodies
    joint = dataclasses.replace(
        body.joint,
        spring_rest=rest * body.joint.spring_rest,
        spring_stiffness=stiffness * body.joint.spring_stiffness,
    )
    back = ReadBack((dataclasses.replace(body, joint=joint),), (0.0, 0.0, gravity), 0.002)
    findings = FileComparison("mine", meaning, back, {}).run().findings
    silent = [finding for finding in findings if finding.silent]
    assert {(entry.element, entry.quantity, entry.what) for entry in silent} == found
    assert {entry.location.line for entry in silent if entry.quantity == "gravity"} <= {2}
