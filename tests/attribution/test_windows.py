"""Windows: their length, their classes, which of them are looked at, and what is averaged."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from simspec.attribution.windows import (
    ALL,
    CLASSES,
    Windows,
    _kinds,
    _sample,
    exact,
    gaps,
    map_states,
    ordered_poses,
    window_length,
)
from simspec.engines.kit.process import Answer
from simspec.errors import SpecError
from simspec.world.types import Physics
from tests.attribution.planted import world


def stepping(*timesteps):
    return [dataclasses.replace(world(), physics=Physics(timestep=timestep, steps=100)) for timestep in timesteps]


@pytest.mark.parametrize(
    ("timesteps", "length"),
    [
        ((0.001,), Fraction(1, 100)),
        ((0.001, 0.002), Fraction(1, 100)),
        ((0.001, 0.003), Fraction(12, 1000)),
        ((0.004, 0.006), Fraction(12, 1000)),
        ((1 / 240, 1 / 480), Fraction(3, 240)),
        ((0.048,), Fraction(48, 1000)),
    ],
)
def test_a_window_is_a_whole_number_of_steps_of_both(timesteps, length):
    assert window_length(stepping(*timesteps), Fraction(1)) == length


def test_timesteps_without_a_common_window_are_an_error():
    with pytest.raises(SpecError, match="no window"):
        window_length(stepping(0.001009, 0.001013), Fraction(1))
    with pytest.raises(SpecError, match="no window"):
        window_length(stepping(0.002, 0.003), Fraction(5, 1000))


def test_a_window_is_no_longer_than_the_run():
    assert window_length(stepping(0.001), Fraction(7, 1000)) == Fraction(7, 1000)


def test_timesteps_are_exact():
    assert exact(1 / 240) == Fraction(1, 240)
    assert exact(0.1) == Fraction(1, 10)


def touching(rows, pairs, bodies=4):
    count = len(rows)
    arrays = {
        "pose": np.zeros((1, bodies, 7)),
        "contact.row": np.array(rows),
        "contact.body": np.array(pairs),
        "contact.normal_force": np.ones(count),
        "contact.distance": np.zeros(count),
    }
    return Answer({}, arrays, 0.0, 0.0, [])


def test_windows_are_impacts_where_a_pair_touches_that_did_not():
    # windows of two rows: rows 1, 2 | 3, 4 | 5, 6 | 7, 8; bodies bounce within one row, too
    answer = touching([2, 3, 4, 5, 5], [(0, 1), (1, 0), (0, 1), (0, 1), (2, 3)])
    assert [CLASSES[kind] for kind in _kinds(answer, 4, 2)] == ["impact", "contact", "impact", "free"]


def test_the_sample_is_spread_and_keeps_rare_mutations():
    kinds = np.zeros(1000, dtype=np.int64)
    kinds[[100, 500]] = 1
    kinds[600:] = 2
    chosen = _sample(kinds, 100)
    assert len(chosen) == 100
    assert {100, 500} <= set(chosen.tolist())
    assert np.array_equal(_sample(kinds[:50], 100), np.arange(50))


def windows(kinds, counts):
    kinds = np.array(kinds)
    nothing = np.zeros((len(kinds), 0))
    return Windows(
        world(), Fraction(1, 100), np.arange(len(kinds)), nothing, nothing, kinds, counts, (nothing, nothing)
    )


def test_means_weigh_each_class_as_the_run_has_it():
    sample = windows([0, 0, 1, 2], {"free": 2, "impact": 1, "contact": 97})
    means = sample.means(np.array([1.0, 3.0, 10.0, 5.0]), np.ones(4, dtype=bool))
    assert means == {"free": 2.0, "impact": 10.0, "contact": 5.0, ALL: pytest.approx((2 * 2.0 + 10.0 + 97 * 5.0) / 100)}
    quiet = np.array([True, False, True, False])
    means = sample.means(np.array([1.0, 3.0, 10.0, 5.0]), quiet)
    assert (means["free"], means["contact"]) == (1.0, 5.0)


def test_gaps_are_of_places_and_of_turns():
    here = world()
    pose = np.zeros((1, len(here.bodies), 7))
    pose[..., 3] = 1.0
    moved, turned = pose.copy(), pose.copy()
    index = [body.name for body in here.bodies].index("ball")
    moved[0, index, 0] = 0.01
    angle = 1e-3
    turned[0, index, 3:5] = np.cos(angle / 2), np.sin(angle / 2)
    assert gaps(here, pose, moved)[0, index] == pytest.approx(0.01)
    # of a solid ball of 0.1 m: √(3/5) · 0.1 m
    assert gaps(here, pose, turned)[0, index] == pytest.approx(angle * np.sqrt(0.6) * 0.1, rel=1e-6)


def test_states_follow_their_bodies():
    here = world()
    other = dataclasses.replace(here, bodies=(here.bodies[0], here.bodies[2], here.bodies[1], *here.bodies[3:]))
    size = sum(len(body.joint.position) for body in here.bodies)
    speeds = sum(len(body.joint.velocity) for body in here.bodies)
    q, v = np.arange(size, dtype=float)[None], np.arange(speeds, dtype=float)[None]
    there = map_states(here, other, q, v)
    assert not np.array_equal(there[0], q)
    back = map_states(other, here, *there)
    assert np.array_equal(back[0], q)
    assert np.array_equal(back[1], v)
    poses = np.arange(len(here.bodies) * 7, dtype=float).reshape(1, -1, 7)
    assert np.array_equal(ordered_poses(other, here, ordered_poses(here, other, poses)), poses)
