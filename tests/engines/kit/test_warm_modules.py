"""Modules of tests with ``warm_engines`` have forked engine processes, except for timed runs."""

from __future__ import annotations

import os

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.process import start
from simspec.engines.kit.warm import Forked
from simspec.experiments.timing import bound_to
from simspec.testing.bench import run_operation
from tests import worlds

pytestmark = pytest.mark.usefixtures("warm_engines")


def is_forked(folder):
    with start("mujoco", folder, [run_operation(worlds.world(()), 1)]) as running:
        assert len(running.wait().answers) == 1
        return isinstance(running._process, Forked)


def test_processes_are_forked_unless_they_are_bound_to_a_processor(tmp_path):
    write_folder(compile_world(worlds.world(()), ["mujoco"])["mujoco"].files, tmp_path)
    assert is_forked(tmp_path)
    with bound_to(max(os.sched_getaffinity(0))):
        assert not is_forked(tmp_path)
    assert is_forked(tmp_path)
