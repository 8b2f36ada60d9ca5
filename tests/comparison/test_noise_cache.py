"""Noise of an earlier run with the same bits is taken from the cache, and of no other."""

from __future__ import annotations

import base64
import dataclasses
import json
import zlib

import numpy as np
import pytest

from simspec.comparison.noise_cache import ENTRIES, noise_key, read_noise, write_noise
from simspec.comparison.study import study
from simspec.language.load import Spec
from tests.caches import cache_home

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINE = "mujoco"


def pendulum(mass: float):
    body = {
        "mass": mass,
        "inertia": {"principal": [0.1, 0.1, 0.01]},
        "centre_of_mass": [0.2, 0, 0],
        "joint": {"type": "hinge", "axis": [0, 1, 0], "origin": {"xyz": [0, 0, 1]}},
    }
    physics = {"timestep": 0.002, "duration": 0.1}
    return Spec.from_data({"simspec": 1, "name": "pendulum", "physics": physics, "bodies": {"rod": body}}).resolve()


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A cache folder without noise."""
    patch = pytest.MonkeyPatch()
    patch.setenv("XDG_CACHE_HOME", cache_home(tmp_path_factory.mktemp("noise")))
    yield ENTRIES.folder()
    patch.undo()


@pytest.fixture(scope="module")
def first(cache):
    """The first study of the pendulum."""
    return measured(1.0)


def measured(mass: float, **options):
    return study(pendulum(mass), [ENGINE], prove=False, **options)


def test_the_second_study_of_a_world_takes_its_noise_from_the_cache(first):
    again = measured(1.0)
    assert (first.floors[ENGINE].cached, len(first.repeats[ENGINE])) == (False, 2)
    assert (again.floors[ENGINE].cached, again.repeats) == (True, {})
    for name in ("time", "position", "angle"):
        assert np.array_equal(getattr(again.floors[ENGINE], name), getattr(first.floors[ENGINE], name))
    assert first.floors[ENGINE].angle[-1].max() > 0
    assert dataclasses.replace(again.floors[ENGINE], cached=False).bitwise is first.floors[ENGINE].bitwise
    assert again.floors[ENGINE].perturbation == first.floors[ENGINE].perturbation


def test_without_the_cache_noise_is_measured(first):
    again = measured(1.0, cache=False)
    assert not again.floors[ENGINE].cached
    assert len(again.repeats[ENGINE]) == 2


def test_noise_of_other_bits_files_and_cases_is_not_taken(first):
    run = first.runs[ENGINE]
    entry = noise_key(run)
    moved = {**run.arrays, "pose": run.arrays["pose"] + 1e-15}
    others = [
        dataclasses.replace(run, arrays=moved),
        dataclasses.replace(run, provenance={**run.provenance, "artifacts_sha256": "0" * 64}),
        dataclasses.replace(run, provenance={**run.provenance, "case": "0" * 64}),
    ]
    keys = [noise_key(other) for other in others]
    assert len({entry, *keys}) == 4
    assert read_noise(run, entry) is not None
    assert [read_noise(other, name) for other, name in zip(others, keys, strict=True)] == [None] * 3


@pytest.mark.parametrize(
    "change",
    [
        lambda entry: {**entry, "numbers": entry["numbers"][:40]},
        lambda entry: {**entry, "numbers": "no base64 of anything"},
        lambda entry: {**entry, "sha256": "0" * 64},
        lambda entry: {**entry, "key": "0" * 64},
        lambda entry: {**entry, "simspec_noise": 0},
        lambda entry: {name: value for name, value in entry.items() if name != "bitwise"},
    ],
)
def test_a_damaged_entry_is_not_used(first, change):
    run, floor = first.runs[ENGINE], first.floors[ENGINE]
    name = noise_key(run)
    assert write_noise(floor, name)
    path = ENTRIES.folder() / f"{name}.json"
    path.write_text(json.dumps(change(json.loads(path.read_text()))))
    assert read_noise(run, name) is None
    assert write_noise(floor, name)
    assert read_noise(run, name).cached


def test_numbers_that_unpack_to_more_than_the_run_has_are_refused(first):
    run, name = first.runs[ENGINE], noise_key(first.runs[ENGINE])
    assert write_noise(first.floors[ENGINE], name)
    path = ENTRIES.folder() / f"{name}.json"
    entry = json.loads(path.read_text())
    entry["numbers"] = base64.b64encode(zlib.compress(bytes(50_000_000))).decode()
    path.write_text(json.dumps(entry))
    assert read_noise(run, name) is None
    assert write_noise(first.floors[ENGINE], name)
