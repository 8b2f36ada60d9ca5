"""The search for the version that changed a figure: it halves, measures each version once, and goes around what fails."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError, Problem, SpecError, UnsupportedError
from simspec.experiments import bisect
from simspec.experiments.bisect import Reading, Versions, search
from simspec.experiments.store import Store
from tests import worlds

pytestmark = pytest.mark.usefixtures("warm_engines")

FIGURE = "deepest penetration"


def reading(version: str, value: float, noise: float = 1e-6) -> Reading:
    return Reading(version, value, "m", noise, 1.5 * noise)


class Measured:
    """Figures by version; those that are not there fail. ``asked``: the versions, in order."""

    def __init__(self, values: dict[str, float], noise: float = 1e-6):
        self.values, self.noise, self.queried = values, noise, []

    def __call__(self, version: str) -> Reading:
        self.queried.append(version)
        if version not in self.values:
            raise EngineError(f"engine@{version}", "cannot be installed: no wheel")
        return reading(version, self.values[version], self.noise)


@st.composite
def histories(draw):
    """Versions, the first one after the change, and those in between that fail."""
    count = draw(st.integers(2, 40))
    changed = draw(st.integers(1, count - 1))
    broken = draw(st.sets(st.integers(1, count - 2), max_size=count)) if count > 2 else set()
    return [f"1.{number}" for number in range(count)], changed, broken


@given(histories())
def test_the_change_is_found_between_neighbours_that_were_measured(history):
    versions, changed, broken = history
    values = {
        version: 1.0 if number < changed else 2.0 for number, version in enumerate(versions) if number not in broken
    }
    measure = Measured(values)
    done = search(FIGURE, versions, measure)
    assert done.found
    last = max(number for number in range(changed) if number not in broken)
    first = min(number for number in range(changed, len(versions)) if number not in broken)
    assert (done.before.version, done.after.version) == (versions[last], versions[first])
    assert list(done.between) == versions[last + 1 : first]
    assert set(done.between) <= set(done.not_measured)
    assert len(measure.queried) == len(set(measure.queried)), "nothing is measured twice"
    if not broken:
        assert len(measure.queried) <= 2 + math.ceil(math.log2(len(versions)))
    assert done.notes == ()


def test_no_change_is_reported_after_the_ends_are_measured():
    measure = Measured({"1": 1.0, "2": 9.0, "3": 1.0 + 2.9e-6})
    done = search(FIGURE, ["1", "2", "3"], measure)
    assert not done.found
    assert measure.queried == ["1", "3"]
    assert search(FIGURE, ["1", "3"], Measured({"1": 1.0, "3": 1.0 + 3.1e-6})).found


def test_a_version_whose_noise_hides_the_change_is_left_out():
    def measure(version: str) -> Reading:
        return reading(version, float(version), 10.0 if version == "3" else 1e-6)

    done = search(FIGURE, ["1", "2", "3", "4", "5"], measure)
    assert "hides the change" in done.not_measured["3"]
    assert done.found


def test_several_changes_are_said():
    done = search(FIGURE, ["1", "2", "3", "4", "5"], Measured({"1": 1.0, "2": 2.0, "3": 2.0, "4": 3.0, "5": 3.0}))
    assert (done.before.version, done.after.version) == ("1", "2")
    assert "more than once" in done.notes[0]


def test_an_end_that_fails_is_an_error_and_what_fails_between_is_named():
    with pytest.raises(EngineError, match="engine@1: cannot be installed"):
        search(FIGURE, ["1", "2"], Measured({"2": 1.0}))

    def refusing(version: str) -> Reading:
        if version == "2":
            raise UnsupportedError([Problem("does not support it")])
        return reading(version, float(version))

    done = search(FIGURE, ["1", "2", "3"], refusing)
    assert done.not_measured == {"2": "does not support it"}
    assert done.between == ("2",)
    done = search(FIGURE, ["1", "2", "3"], Measured({"1": 1.0, "3": 3.0}))
    assert done.not_measured == {"2": "cannot be installed: no wheel"}


HERE = find_engine("mujoco").version()


def test_a_version_is_run_once_and_is_stored(tmp_path, monkeypatch):
    world = worlds.spheres(1)
    store = Store.open(tmp_path / "store", create=True)
    passed: list[str] = []
    measure = Versions(world, "mujoco", "energy at the start", store, lambda label: None, tell=passed.append)
    with store.writing():
        first = measure(HERE)
    assert not first.stored
    assert any("3 times" in line for line in passed)
    assert math.isfinite(first.value)
    assert first.half >= 1.5 * first.noise

    def never(*args, **keywords):
        raise AssertionError("it is stored")

    with monkeypatch.context() as patch, store.writing():
        patch.setattr(bisect, "run_jobs", never)
        again = measure(HERE)
    assert (again.value, again.noise, again.stored) == (first.value, first.noise, True)

    # one run is lost: it alone is made again
    key = next(iter(store.keys()))
    passed.clear()
    with store.writing():
        store.drop(key)
        assert measure(HERE).value == first.value
    assert any("1 times" in line for line in passed)


def test_a_version_that_is_not_at_work_is_an_error(tmp_path):
    store = Store.open(tmp_path / "store", create=True)
    measure = Versions(worlds.spheres(1), "mujoco", "energy at the end", store, lambda label: None)
    with store.writing(), pytest.raises(EngineError, match=r"mujoco@0\.1"):
        measure("0.1")
    assert list(store.keys()) == []


def test_a_figure_that_a_run_does_not_have_is_an_error(tmp_path):
    store = Store.open(tmp_path / "store", create=True)
    measure = Versions(worlds.spheres(1), "mujoco", "largest error of a driven hinge", store, lambda label: None)
    with store.writing(), pytest.raises(SpecError, match="has no largest error of a driven hinge"):
        measure(HERE)
