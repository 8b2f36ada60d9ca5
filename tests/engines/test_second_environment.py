"""An engine lives in another virtual environment that holds another version of it, and is compared like another engine."""

from __future__ import annotations

import dataclasses
import subprocess
import venv

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.contract import find_engine
from simspec.engines.kit.process import Operation, call
from simspec.proof.comparator import inventory_checks
from simspec.world.canonical import from_plain
from simspec.world.types import ReadBack
from tests import worlds

OTHER_VERSION = "3.3.7"


@pytest.mark.slow
def test_another_version_in_another_environment_holds_the_same_model(tmp_path):
    venv.create(tmp_path / "other", with_pip=True)
    python = str(tmp_path / "other" / "bin" / "python")
    subprocess.run(
        [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", f"mujoco=={OTHER_VERSION}"],
        check=True,
    )
    world = worlds.every_joint()
    write_folder(compile_world(world, ["mujoco"])["mujoco"].files, tmp_path / "artifacts")
    here = call("mujoco", tmp_path / "artifacts", [Operation("read_back")])
    there = call("mujoco", tmp_path / "artifacts", [Operation("read_back")], python=python)
    assert there.versions["engine_version"] == OTHER_VERSION
    assert here.versions["engine_version"] == find_engine("mujoco").version() != OTHER_VERSION
    one, other = (from_plain(ReadBack, reply.answers[0].result) for reply in (here, there))
    for held in (one, other):  # each by its own version's fields and defaults
        (check,) = inventory_checks(find_engine("mujoco").expected_inventory(world, held.neutral), held.inventory)
        assert check.passed, check.detail
    plain = (dataclasses.replace(held, inventory={}, neutral={}) for held in (one, other))
    assert len({repr(held) for held in plain}) == 1
