"""Trials in parts: every body once, what meets or is joined together, and the same figures as in one world."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.registry import find_engine
from simspec.proof.contact import run, size
from simspec.proof.contact.probe import Phase, ProbeTrial, TrialMotion
from simspec.proof.contact.worlds import joined, split
from simspec.world.types import Body, Inertial, Joint
from tests import worlds
from tests.proof.contact_probing import law

pytestmark = pytest.mark.usefixtures("warm_engines")


def body(name, parent=None, kind="free", group="probe"):
    return Body(name, name, Inertial(1.0), Joint(f"{name}_joint", kind, parent), (), group)


FLOOR = body("floor", kind="fixed")


def names(parts):
    return [[entry.name for entry in part.bodies] for part in parts]


def test_free_bodies_are_split_and_each_part_has_the_floor():
    trial = ProbeTrial((FLOOR, *(body(name) for name in "abcde")), (Phase(3, 1, {"a": (1.0,) * 6, "e": (2.0,) * 6}),))
    parts = split(trial, 2)
    assert names(parts) == [["floor", "a", "b"], ["floor", "c", "d"], ["floor", "e"]]
    assert [dict(part.phases[0].effort) for part in parts] == [{"a": (1.0,) * 6}, {}, {"e": (2.0,) * 6}]
    assert split(trial, None) == split(trial, 5) == [trial]


def test_joined_or_touching_bodies_stay_together():
    chain = (body("a"), body("b", "a", "hinge"), body("c", "floor", "hinge"))
    couple = (body("d", group="one"), body("e"), body("f", group="other"))
    trial = ProbeTrial((FLOOR, *chain, *couple), (Phase(1),), (("one", "other"),))
    parts = split(trial, 1)
    assert names(parts) == [["floor", "a", "b"], ["floor", "c"], ["floor", "d", "f"], ["floor", "e"]]
    assert [part.meets for part in parts] == [(), (), (("one", "other"),), ()]


def test_motions_of_parts_are_joined_and_must_be_of_the_same_times():
    motion, other = (TrialMotion(np.arange(3.0), {name: np.ones((3, 7))}, {name: np.ones((3, 6))}) for name in "ab")
    assert set(joined([motion, other]).pose) == {"a", "b"}
    with pytest.raises(ValueError, match="different times"):
        joined([motion, dataclasses.replace(other, time=np.arange(3.0) + 1.0)])


@pytest.mark.parametrize("probe", ["push-oblong", "oblique"])
def test_every_probe_keeps_all_its_bodies(probe):
    for trial in run.PROBES[probe].trials(law()):
        for most in (1, 3, 4):
            parts = split(trial, most)
            actual = [entry.name for part in parts for entry in part.bodies if entry.name != "floor"]
            assert sorted(actual) == sorted(entry.name for entry in trial.bodies if entry.name != "floor")


@pytest.mark.parametrize("engine", ["mujoco", "drake"])
def test_figures_equal_those_of_the_unsplit_world(engine, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "PROBES", {name: run.PROBES[name] for name in ("push", "oblique")})
    monkeypatch.setattr(size, "size_trial", lambda world: None)
    world = worlds.table({("a", "a"): 0.4})
    actual = {}
    for most in (None, 4):
        monkeypatch.setattr(find_engine(engine), "PROBED_TOGETHER", most)
        folder = tmp_path / f"{most}"
        write_folder(compile_world(world, [engine])[engine].files, folder)
        with run.measure(world, engine, folder, None, 120.0, False) as measuring:
            actual[most] = measuring.wait()[0]
    assert len(actual[None]) == len(actual[4]) > 5
    for figure, other in zip(actual[None], actual[4], strict=True):
        assert (figure.probe, figure.quantity, figure.expected, figure.tolerance) == (
            other.probe,
            other.quantity,
            other.expected,
            other.tolerance,
        )
        assert figure.measured == pytest.approx(other.measured, rel=1e-3, abs=1e-6)
