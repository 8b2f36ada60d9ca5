"""Long recordings: in blocks of any size everything comes out as from one, and no more than some blocks are in memory."""

from __future__ import annotations

import dataclasses
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec import files
from simspec.comparison.common import first_touches
from simspec.comparison.floor import load_floor, measure_floor, save_floor
from simspec.comparison.runs import diff, summary
from simspec.runner.expectations import MEASURES, evaluate
from simspec.runner.run import Run
from simspec.runner.store import load_run
from simspec.world.types import Expectation
from tests.nightly import EVERYTHING
from tests.runner.synthetic import free_body, run, world

NAMES = ("ball", "cube", "rod")
NEEDS_OTHERS = {"at_target", "angular_speed", "follows_oracle"}
"""Expectations that look at single rows, or at a motion that these runs do not follow."""
EXPECTED = tuple(
    Expectation(kind, tuple(sorted(parameters.items())))
    for kind, parameters in (
        ("energy_never_rises", {"tolerance": 0.1}),
        ("energy_conserved", {"tolerance": 0.1}),
        ("momentum_conserved", {"tolerance": 0.1}),
        ("no_penetration_deeper_than", {"depth": 0.1}),
        ("comes_to_rest", {"speed": 0.1, "before": 0.2}),
        ("position", {"body": "ball", "xyz": (0.0, 0.0, 0.0), "tolerance": 0.1, "at": 0.3}),
        ("displacement", {"body": "cube", "distance": 0.5, "tolerance": 0.1}),
        ("apex_height", {"body": "ball", "height": 1.0, "tolerance": 0.1, "after": 0.1}),
        ("stays_within", {"body": "ball", "lower": (-1.0, -1.0, -1.0), "upper": (0.3, 1.0, 1.0)}),
        ("keeps_place", {"body": "ball", "within": "cube", "after": 0.1, "distance": 0.1}),
        ("bodies_apart", {"first": "ball", "second": "cube", "at_least": 0.1}),
    )
)


def test_every_expectation_that_goes_through_all_rows_is_looked_at():
    assert {expectation.kind for expectation in EXPECTED} | NEEDS_OTHERS == set(MEASURES)


def made(seed: int, rows: int, noise: float = 0.0, contacts: float = 0.3, **facts: object) -> Run:
    """A run that wanders as ``seed`` says, and departs from that by ``noise``, growing, as ``facts`` (a name) say."""
    of = world(*(free_body(name) for name in NAMES), expect=EXPECTED, steps=10 * (rows - 1))
    default_rng = np.random.default_rng([seed, *str(facts).encode()])

    def place(name, t):
        common = np.random.default_rng([seed, NAMES.index(name)])
        found = np.cumsum(0.1 * common.normal(size=(len(t), 7)), axis=0)
        found[:, 3] += 9.0
        found += noise * np.exp(np.minimum(0.1 * t, 30.0))[:, None] * default_rng.normal(size=found.shape)
        found[:, 3:] /= np.linalg.norm(found[:, 3:], axis=1)[:, None]
        return found

    touching = np.random.default_rng([seed, 10])
    listed = [
        (int(row), *map(int, touching.choice(len(NAMES), 2, replace=False)), *touching.normal(size=2).tolist())
        for row in np.sort(touching.integers(0, rows, int(contacts * rows)))
        if noise == 0.0 or default_rng.random() < 0.99
    ]
    speed = np.random.default_rng([seed, 11]).normal(size=(rows, 6))
    return run(of, place, lambda name, t: speed, contacts=listed, **facts)


def all_of_it(seed: int, rows: int, noise: float, tolerance: float, folder) -> list[object]:
    """The result of a study of such runs."""
    a, b = made(seed, rows), made(seed, rows, 3.0 * noise, engine="second")
    floors = [measure_floor(a, [made(seed, rows), made(seed, rows, noise, perturb=1e-15)])]
    floors.append(measure_floor(b, [made(seed, max(2, rows - 3), noise, engine="second", perturb=1e-15)]))
    a.save(folder)
    save_floor(floors[0], folder)
    again = load_floor(folder)
    stored = load_run(folder)
    found: list[object] = [evaluate(a), [(floor.largest, floor.bitwise) for floor in floors]]
    found += [diff(a, b, tolerance=tolerance, floor=some) for some in (floors, floors[1:], [])]
    arrays = [values for floor in (*floors, again) for values in (floor.time, floor.position, floor.angle)]
    found += [values.tobytes() for values in (*arrays, *(stored.arrays[name] for name in sorted(stored.arrays)))]
    return [*found, summary(a), summary(b)]


def assert_same(found, expected):
    if dataclasses.is_dataclass(found):
        for field in dataclasses.fields(found):
            # sums of very many numbers depend on their order in the last bits
            inexact = field.name in ("position_rms", "angle_rms") or getattr(found, "name", "") == "contact force, mean"
            entry, other = getattr(found, field.name), getattr(expected, field.name)
            if inexact and isinstance(entry, float):
                assert entry == pytest.approx(other, rel=1e-12)
            else:
                assert_same(entry, other)
    elif isinstance(found, (list, tuple)):
        assert len(found) == len(expected)
        for entry, other in zip(found, expected, strict=True):
            assert_same(entry, other)
    elif isinstance(found, dict):
        assert found == {name: pytest.approx(value, rel=1e-12, abs=0) for name, value in expected.items()}
    else:
        assert found == expected


@settings(max_examples=8 if EVERYTHING else 3)
@given(
    seed=st.integers(0, 10**6),
    rows=st.integers(40, 150),
    noise=st.sampled_from([0.0, 1e-9, 1e-5, 1e-2]),
    tolerance=st.sampled_from([0.0, 1e-8, 1e-4, 0.1]),
    block=st.sampled_from([1, 1_000, 10_000, 50_000]),
)
def test_blocks_of_any_size_give_the_same_result(tmp_path_factory, seed, rows, noise, tolerance, block):
    folder = tmp_path_factory.mktemp("long")
    expected = all_of_it(seed, rows, noise, tolerance, folder / "one")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "BLOCK_BYTES", block)
        patch.setattr(files, "MAPPED_BYTES", 500)
        assert_same(all_of_it(seed, rows, noise, tolerance, folder / "many"), expected)


def on_disk(entry: Run) -> Run:
    arrays = {}
    for name, values in entry.arrays.items():
        arrays[name] = files.zeros(values.shape, values.dtype.type)
        arrays[name][...] = values
    return dataclasses.replace(entry, arrays=arrays)


def test_no_array_of_all_rows_is_ever_in_memory(tmp_path, monkeypatch):
    """Of 30,000 rows, a column of one number each has 240 kB, and all poses 5 MB."""
    rows = 30_000
    monkeypatch.setattr(files, "BLOCK_BYTES", 150_000)
    monkeypatch.setattr(files, "MAPPED_BYTES", 20_000)
    a = on_disk(made(1, rows))
    b = on_disk(made(1, rows, 1e-9, engine="second"))
    repeats = [on_disk(made(1, rows)), on_disk(made(1, rows, 1e-9, perturb=1e-15))]
    a.save(tmp_path / "run")  # modules imported and values cached once do not count
    tracemalloc.start()
    try:
        floor = measure_floor(a, repeats)
        found = diff(a, b, tolerance=1e-3, floor=[floor])
        outcomes = evaluate(a)
        assert summary(a)
        assert tracemalloc.get_traced_memory()[1] < 8 * rows
        a.save(tmp_path / "run")
        save_floor(floor, tmp_path / "run")
        again = load_floor(tmp_path / "run")
        stored = load_run(tmp_path / "run")
        # hashed files are read 1 MB at a time
        assert tracemalloc.get_traced_memory()[1] < 4_000_000 < a.arrays["pose"].nbytes
    finally:
        tracemalloc.stop()
    assert found.compared_until > 0.0
    assert all(outcome.measured is not None for outcome in outcomes)
    assert again.largest == floor.largest
    assert stored.arrays["pose"].shape == a.arrays["pose"].shape


def pairs_by_row(entry: Run) -> list[set[frozenset[str]]]:
    names = [body.name for body in entry.world.bodies]
    found: list[set[frozenset[str]]] = [set() for _ in entry.time]
    for row, pair in zip(entry.arrays["contact.row"], entry.arrays["contact.body"], strict=True):
        found[row].add(frozenset(names[index] for index in pair))
    return found


LISTED = st.lists(st.tuples(st.integers(0, 10), st.sampled_from([(0, 1), (1, 0), (1, 2), (2, 0)])), max_size=8)


@settings(max_examples=60)
@given(common=LISTED, first=LISTED, other=LISTED, block=st.sampled_from([1, 400, 10**6]), coarse=st.booleans())
def test_contacts_are_compared_pair_by_pair_at_every_common_time(common, first, other, block, coarse):
    a, b = (
        run(
            world(*(free_body(name) for name in names)),
            engine=engine,
            contacts=[(row, *pair, 0.0, 1.0) for row, pair in sorted(common + local)],
        )
        for engine, names, local in (("first", NAMES, first), ("second", NAMES, other))
    )
    rows = range(0, len(a.time), 2 if coarse else 1)
    if coarse:  # every second row alone is of a common time
        b = dataclasses.replace(b, arrays={**b.arrays, "time": b.time + 0.02 * (np.arange(len(b.time)) % 2)})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "BLOCK_BYTES", block)
        found = diff(a, b)
        touched = first_touches((a, b), NAMES)
    pairs = pairs_by_row(a), pairs_by_row(b)
    different = [a.time[row] for row in rows if pairs[0][row] != pairs[1][row]]
    assert found.contact_first_difference == (different[0] if different else None)
    for name in NAMES:
        times = [
            entry.time[row]
            for entry, listed in zip((a, b), pairs, strict=True)
            for row, there in enumerate(listed)
            if name in set().union(*there)
        ]
        assert touched.get(name) == min(times, default=None)
