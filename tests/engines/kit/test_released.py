"""The released versions of an engine, listed by the client of the package index outside the user's folder."""

from __future__ import annotations

import subprocess
import sys

import pytest

from simspec.engines.kit import environments
from simspec.engines.kit.environments import in_order, released_versions, same_version
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError
from tests.files import program

SCRIPT = """#!/bin/sh
echo "$PWD $@" >> {log}
case "$8" in
mujoco) echo 'mujoco (4.0.0)'; echo 'Available versions: 4.0.0, 3.10.0, 3.9.0, 3.9.0rc1, 3.4.0, 3.3.7';;
mujoco-core) echo 'mujoco-core (4.0.1)'; echo 'Available versions: 4.0.1, 4.0.0'; echo '  INSTALLED: 4.0.1';;
*) echo 'ERROR: No matching distribution found' >&2; exit 1;;
esac
"""
MUJOCO = find_engine("mujoco")


@pytest.fixture
def log(tmp_path, monkeypatch):
    """The requests to a client of the test."""
    text = SCRIPT.format(log=tmp_path / "log")
    monkeypatch.setattr(sys, "executable", str(program(tmp_path / "python", text)))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "log"


def test_versions_come_in_their_order_without_previews(log):
    assert released_versions(MUJOCO, "3.3.7", "3.10.0") == ["3.3.7", "3.4.0", "3.9.0", "3.10.0"]
    assert log.read_text() == "/ -I -m pip --disable-pip-version-check --no-input index versions mujoco\n"


def test_each_package_gives_the_versions_that_it_brings(log):
    assert released_versions(MUJOCO, "3.9.0", "4.0.1") == ["3.9.0", "3.10.0", "4.0.0", "4.0.1"]
    assert len(log.read_text().splitlines()) == 2
    log.unlink()
    assert released_versions(MUJOCO, "4.0.0", "4.0.1") == ["4.0.0", "4.0.1"]
    assert log.read_text().endswith("versions mujoco-core\n")
    assert len(log.read_text().splitlines()) == 1


def test_the_message_of_the_client_is_reported(log):
    with pytest.raises(EngineError, match=r"ended with code 1: ERROR: No matching .*--versions"):
        released_versions(find_engine("dart"), "6.0", "7.0")


def test_a_client_that_hangs_or_is_not_there_is_an_error(log, monkeypatch):
    def hanging(*args, **keywords):
        raise subprocess.TimeoutExpired("pip", 1.0)

    with monkeypatch.context() as patch:
        patch.setattr(environments.subprocess, "run", hanging)
        with pytest.raises(EngineError, match="gave no versions of mujoco within"):
            released_versions(MUJOCO, "3.3.7", "3.4.0")
    monkeypatch.setattr(sys, "executable", "/no/python")
    with pytest.raises(EngineError, match="pip cannot be started"):
        released_versions(MUJOCO, "3.3.7", "3.4.0")


def test_an_engine_that_no_package_brings_has_no_versions(log):
    with pytest.raises(EngineError, match="one version there"):
        released_versions(find_engine("ode"), "0.15", "0.16")
    assert not log.exists()


def test_words_are_versions_and_are_ordered_as_such():
    assert in_order(MUJOCO, ["3.10", "3.9", "3.10.0"]) == ["3.9", "3.10.0"]
    assert same_version("3.4", "3.4.0")
    assert not same_version("3.4", "3.40")
    assert not same_version("none", "3.4")
    with pytest.raises(EngineError, match="not a version"):
        in_order(MUJOCO, ["3.x"])
