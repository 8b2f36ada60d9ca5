"""Contacts and overlaps with known times, impulses and depths."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec import mapped
from simspec.analysis.contacts import compare_contacts, total_jaccard, touches
from simspec.analysis.penetration import penetration
from simspec.errors import SpecError
from tests.runner.synthetic import free_body, run, world

WORLD = world(free_body("floor"), free_body("ball"), free_body("cube"))
"""11 records, 0.1 s apart."""
FLOOR, BALL, CUBE = range(3)


def touching(*contacts, **facts):
    return run(WORLD, contacts=sorted(contacts), **facts)


@pytest.fixture(params=["whole", "in blocks"])
def blocks(request, monkeypatch):
    """Long recordings are gone through block by block: the same comes out."""
    if request.param == "in blocks":
        monkeypatch.setattr(mapped, "BLOCK_BYTES", 400)


@pytest.mark.usefixtures("blocks")
def test_the_impulse_is_the_integral_of_the_force():
    """10 N at three points over rows 2 … 4 (0.3 s): 9 N s; the order of a pair does not matter."""
    rows = [(row, *pair, -0.01, 10.0) for row in (2, 3, 4) for pair in ((FLOOR, BALL), (BALL, FLOOR), (FLOOR, BALL))]
    told = touches(touching(*rows, (9, CUBE, BALL, -0.01, 5.0)))
    assert set(told) == {("ball", "floor"), ("ball", "cube")}
    floor, cube = told["ball", "floor"], told["ball", "cube"]
    assert (floor.impulse, floor.seconds, floor.first) == pytest.approx((9.0, 0.3, 0.2))
    assert (cube.impulse, cube.seconds, cube.first) == pytest.approx((0.5, 0.1, 0.9))


def test_the_initial_state_lasts_no_time():
    told = touches(touching((0, FLOOR, BALL, -0.01, 10.0)))
    assert (told["ball", "floor"].impulse, told["ball", "floor"].seconds) == (0.0, 0.0)


@pytest.mark.usefixtures("blocks")
def test_contacts_are_matched_by_pair_and_time():
    """Rows 1 … 4 in one, 3 … 6 in the other: 0.2 s of 0.6 s. The second world lists its bodies in another order."""
    one = touching(*((row, FLOOR, BALL, -0.01, 10.0) for row in range(1, 5)))
    turned = world(free_body("cube"), free_body("ball"), free_body("floor"))
    rows = [(row, 2, 1, -0.01, 20.0) for row in range(3, 7)]
    other = run(turned, contacts=[*rows, (8, 0, 1, -0.01, 30.0)], engine="second")
    first, second = compare_contacts(one, other)
    assert first.pair == ("ball", "floor")
    assert (first.first_seconds, first.second_seconds, first.both_seconds) == pytest.approx((0.4, 0.4, 0.2))
    assert (first.first_impulse, first.second_impulse) == pytest.approx((4.0, 8.0))
    assert first.jaccard == pytest.approx(1 / 3)
    assert (second.pair, second.jaccard, second.second_impulse) == (("ball", "cube"), 0.0, pytest.approx(3.0))
    assert total_jaccard((first, second)) == pytest.approx(2 / 7)
    assert total_jaccard(()) is None


def test_equal_runs_touch_alike():
    one = touching(*((row, FLOOR, BALL, -0.01, 10.0) for row in (2, 3, 3, 5)))
    (only,) = compare_contacts(one, one)
    assert only.jaccard == 1.0
    assert only.first_impulse == only.second_impulse == pytest.approx(4.0)


def test_contacts_must_be_recorded():
    bare = touching()
    bare = dataclasses.replace(bare, arrays={k: v for k, v in bare.arrays.items() if not k.startswith("contact.")})
    for call in (touches, penetration, lambda one: compare_contacts(one, touching())):
        with pytest.raises(SpecError, match="did not record contacts"):
            call(bare)


@pytest.mark.usefixtures("blocks")
def test_depths():
    """1 mm in rows 2 and 3, 4 mm in row 4, a gap of 1 mm in row 6."""
    one = touching(
        (2, FLOOR, BALL, -0.001, 1.0),
        (3, FLOOR, BALL, -0.001, 1.0),
        (3, FLOOR, CUBE, -0.0005, 1.0),
        (4, FLOOR, CUBE, -0.004, 1.0),
        (6, FLOOR, BALL, 0.001, 0.0),
    )
    told = penetration(one)
    assert (told.deepest.depth, told.deepest.time) == pytest.approx((0.004, 0.4))
    assert told.depth == pytest.approx(np.array([0, 0, 1, 1, 4, 0, 0, 0, 0, 0, 0]) * 1e-3)
    assert told.pairs == pytest.approx({("ball", "floor"): 0.001, ("cube", "floor"): 0.004})
    assert told.mean == pytest.approx(0.002)
    assert told.share_deeper(0.0) == pytest.approx(0.3)
    assert told.share_deeper(0.002) == pytest.approx(0.1)


def test_what_is_no_number_is_the_deepest():
    told = penetration(touching((2, FLOOR, BALL, math.nan, 1.0), (3, FLOOR, BALL, -0.001, 1.0)))
    assert math.isnan(told.deepest.depth)
    assert told.depth.max() == math.inf


def test_nothing_overlaps():
    told = penetration(touching())
    assert (told.deepest.depth, told.mean, told.pairs, told.share_deeper(0.0)) == (0.0, 0.0, {}, 0.0)
