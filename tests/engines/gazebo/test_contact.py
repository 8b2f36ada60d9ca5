"""Contact under the one cone that Gazebo has: every probe of sliding and impacts measures the requested law."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.engines.gazebo.engine import Gazebo
from simspec.proof.contact import run
from tests import worlds

pytestmark = pytest.mark.skipif(Gazebo.version() is None, reason="gz-physics or a C++ compiler is not installed")
PAIRS = {("ice", "ice"): 0.05, ("ice", "rubber"): 0.7, ("rubber", "rubber"): 0.2}
"""No rule of two numbers gives these: they need copies of shapes in layers."""

SLIDING = ("push", "stop")
"""Probes that measure sliding friction, each in a motion of its own."""


def under_the_pyramid(world):
    contact = dataclasses.replace(world.contact, friction_cone="pyramid-circumscribed")
    return dataclasses.replace(world, contact=contact)


def measured(requested, actual, folder):
    """The figures of the world ``asked`` in the files of the world ``held``."""
    write_folder(compile_world(actual, ["gazebo"])["gazebo"].files, folder)
    with run.measure(requested, "gazebo", folder, None, 120.0, False) as measuring:
        return measuring.wait()[0]


def test_every_probe_measures_the_law_and_another_is_found(tmp_path, monkeypatch):
    requested = under_the_pyramid(worlds.table(PAIRS))
    found = measured(requested, requested, tmp_path / "asked")
    assert [figure for figure in found if not figure.passed] == []
    assert {"push", "push-oblong", "stop", "oblique", "overlap"} <= {figure.probe for figure in found}
    assert {figure.probe for figure in found if figure.deviation} == set()
    monkeypatch.setattr(run, "PROBES", {name: run.PROBES[name] for name in SLIDING})  # a third of the time of all
    other = under_the_pyramid(worlds.table({**PAIRS, ("rubber", "rubber"): 0.1}))
    wrong = {figure.subject for figure in measured(requested, other, tmp_path / "other") if not figure.passed}
    assert wrong == {"rubber, rubber"}
