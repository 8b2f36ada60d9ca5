"""A study shows where its engines differ from the first one, and goes on without engines that are absent, which it names."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from simspec.attribution.sentences import WORDS
from simspec.attribution.windows import ALL
from simspec.cli import app
from simspec.engines.kit.registry import find_engine

pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """\
simspec: 1
name: bounce
physics: {timestep: 2 ms, duration: 60 ms}
contact:
  materials:
    rubber: {friction: 0}
bodies:
  floor: {fixed: true, shapes: [{plane: {}, material: rubber}]}
  ball: {pose: {xyz: [0, 0, 0.105]}, mass: 1 kg, shapes: [{sphere: {radius: 0.1}, material: rubber}]}
record: {every: 10 ms, channels: [pose, velocity, contacts, energy]}
"""
STUDY = """\
simspec_study: 1
name: engines
sweeps:
  ball:
    spec: bounce.yaml
    set: {engines.pybullet.settings: {contact_erp: 0.2}}
    sweep: {engines: [mujoco, pybullet, "mujoco@9.9"]}
    show: [attribution]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "bounce.yaml").write_text(SPEC)
    (tmp_path / "study.yaml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def explained(*words, code=0):
    result = CliRunner().invoke(app, ["study", "study.yaml", "--no-verify", *words, "--json"])
    assert result.exit_code == code, result.output
    return json.loads(result.stdout)


def test_settings_that_differ_are_named_with_their_share_and_the_absent_engines(folder):
    data = explained()
    assert data["said"][0].startswith("without mujoco@9.9: is version ")
    gaps, causes = data["sweeps"]["ball"]
    assert (gaps["name"], causes["name"]) == ("attribution", "attribution.causes")
    [gap] = gaps["records"]
    assert (gap["engine"], gap["first"]) == ("pybullet", "mujoco")
    assert gap["gap.impact"] > 1e-6
    first = causes["records"][0]
    assert first["what"] == "PyBullet's contact_erp"
    assert first["kind"] == "default"
    assert first["share.contact"] > 0.5
    assert f"% {WORDS['contact']}" in str(causes["rows"][0][-1])
    assert WORDS[ALL] not in str(causes["rows"][0][-1])
    assert any(f"{gap['engine']} beside {gap['first']}: PyBullet's contact_erp" in line for line in gaps["said"])
    assert "without mujoco@9.9" in (folder / "runs" / "engines" / "study.md").read_text()


def test_missing_runs_and_versions_are_reported(folder, monkeypatch):
    """A run of the first engine that failed leaves nothing to begin windows with."""
    monkeypatch.setattr(find_engine("mujoco"), "version", classmethod(lambda cls: None))
    data = explained()
    assert [line.split(":")[0] for line in data["said"][:2]] == ["without mujoco", "without mujoco@9.9"]
    [gaps, _] = data["sweeps"]["ball"]
    assert gaps["records"] == []


def test_a_study_is_not_published_without_its_engines(folder):
    result = CliRunner().invoke(app, ["study", "study.yaml", "--publish", "docs/engines"])
    assert result.exit_code == 2
    assert "engines of the study are missing: mujoco@9.9" in result.output
    assert not (folder / "docs").exists()
