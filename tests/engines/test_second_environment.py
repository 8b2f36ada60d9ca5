"""An engine lives in another virtual environment that holds another version of it, and is compared like another engine."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import venv

import pytest
from typer.testing import CliRunner

import simspec
from simspec import cli
from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError
from simspec.generated import read_certificate
from simspec.proof.checks import inventory_checks
from simspec.world.canonical import from_plain
from simspec.world.types import ReadBack
from tests import worlds

OTHER_VERSION = "3.8.1"
HERE = find_engine("mujoco").version()


@pytest.fixture(scope="module")
def python(tmp_path_factory) -> str:
    """The interpreter of an environment with another version."""
    place = tmp_path_factory.mktemp("other")
    venv.create(place)
    second = str(place / "bin" / "python")
    # this environment's pip, and nothing compiled that is never imported
    pip = [sys.executable, "-m", "pip", "--python", second, "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--quiet", "--no-compile", f"mujoco=={OTHER_VERSION}"], check=True)
    return second


@pytest.mark.slow
def test_another_version_in_another_environment_stores_the_same_model(python, tmp_path):
    world = worlds.every_joint()
    write_folder(compile_world(world, ["mujoco"])["mujoco"].files, tmp_path / "artifacts")
    here = call("mujoco", tmp_path / "artifacts", [Operation("read_back")])
    there = call("mujoco", tmp_path / "artifacts", [Operation("read_back")], python=python)
    assert there.versions["engine_version"] == OTHER_VERSION
    assert here.versions["engine_version"] == find_engine("mujoco").version() != OTHER_VERSION
    first, second = (from_plain(ReadBack, reply.answers[0].result) for reply in (here, there))
    for stored in (first, second):  # each by its own version's fields and defaults
        (check,) = inventory_checks(find_engine("mujoco").expected_inventory(world, stored.neutral), stored.inventory)
        assert check.passed, check.detail
    plain = (dataclasses.replace(actual, inventory={}, neutral={}) for actual in (first, second))
    assert len({repr(actual) for actual in plain}) == 1


@pytest.mark.slow
def test_two_versions_and_another_engine_in_a_single_run(python, tmp_path, monkeypatch):
    """Each is an engine with a label: a certificate and a run of its own, and every pair in the table of differences."""
    monkeypatch.chdir(tmp_path)
    requested = ["--engine", "mujoco", "--engine", f"mujoco@3.8={python}", "--engine", "dart"]
    done = CliRunner().invoke(cli.app, ["run", "double-pendulum", *requested, "-v", "--set", "physics.duration=0.2"])
    assert done.exit_code == 0, done.output
    report = json.loads((tmp_path / "runs" / "double-pendulum" / "report.json").read_text())
    assert list(report["runs"]) == ["mujoco", "mujoco@3.8", "dart"]
    certificate = read_certificate(tmp_path / "runs" / "double-pendulum")
    versions = {label: proof.version for label, proof in certificate.engines.items()}
    assert versions == {"mujoco": HERE, "mujoco@3.8": OTHER_VERSION, "dart": find_engine("dart").version()}
    assert certificate.valid
    assert len(report["diffs"]) == 3
    second = simspec.load_run(tmp_path / "runs" / "double-pendulum" / "mujoco@3.8")
    assert second.label == f"mujoco@3.8 {OTHER_VERSION}"
    assert "mujoco –" in done.output  # a label that is longer than its column is continued below
    assert "mujoco@3.8" in done.output


@pytest.mark.slow
def test_the_version_of_a_label_is_compared_with_the_installed_version(python, tmp_path):
    write_folder(compile_world(worlds.every_joint(), ["mujoco"])["mujoco"].files, tmp_path / "artifacts")
    with pytest.raises(EngineError, match=rf"mujoco@3\.80: is version {OTHER_VERSION}, not 3\.80"):
        call("mujoco@3.80", tmp_path / "artifacts", [Operation("read_back")], python=python)
