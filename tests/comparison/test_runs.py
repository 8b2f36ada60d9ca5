"""Two runs held against each other: deviations with known answers, the noise floor, and chaos."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.comparison.floor import FLOOR_FACTOR, Floor, deviations, load_floor, measure_floor, save_floor
from simspec.comparison.runs import diff, summary
from simspec.errors import SpecError
from simspec.world import frames
from simspec.world.types import Joint
from tests.runner.synthetic import column, free_body, run, world

TWO = world(free_body("still"), free_body("mover"))


def drifting(rate):
    return lambda name, t: column(rate * t * (name == "mover"), 0, 0)


def quiet(one, size: float = 0.0) -> Floor:
    shape = one.arrays["pose"].shape[:2]
    return Floor(one.engine, one.time, np.full(shape, size), np.zeros(shape), True, 1e-15)


def pair(rate: float, **facts):
    return run(TWO), run(TWO, drifting(rate), engine="second", **facts)


def test_the_largest_and_the_rms_deviation_of_each_body():
    a, b = pair(0.01)
    found = diff(a, b, tolerance=0.0045, floor=[quiet(a), quiet(b)])
    worst = found.worst
    assert worst.body == "mover"
    assert worst.position_largest == pytest.approx(0.01)
    assert worst.position_rms == pytest.approx(0.01 * math.sqrt(np.mean(np.linspace(0, 1, 11) ** 2)))
    assert worst.time_of_largest == 1.0
    # at 0.4 s it is 4 mm away, at 0.5 s 5 mm
    assert worst.first_out == pytest.approx(0.5)
    assert not found.within
    other = found.bodies[1]
    assert (other.body, other.position_largest, other.first_out) == ("still", 0.0, None)
    assert found.notes == ()


def test_within_tolerance_is_within():
    a, b = pair(0.01)
    assert diff(a, b, tolerance=0.011, floor=[quiet(a), quiet(b)]).within


@pytest.mark.parametrize("angle", [1e-12, 1e-6, 0.5, 3.0])
def test_angles_keep_their_digits(angle):
    turn = frames.from_axis_angle((0.6, 0.0, 0.8), 1.0)
    more = frames.multiply(turn, frames.from_axis_angle((0.0, 1.0, 0.0), angle))
    one = np.array([[[0, 0, 0, *turn]]])
    other = np.array([[[0, 0, 0, *more]]])
    assert deviations(one, other)[1][0, 0] == pytest.approx(angle, rel=1e-3 if angle < 1e-9 else 1e-9)
    # q and −q are one orientation
    other[..., 3:] *= -1
    assert deviations(one, other)[1][0, 0] == pytest.approx(angle, rel=1e-3 if angle < 1e-9 else 1e-9)


def test_an_angle_alone_is_a_difference():
    a = run(TWO)
    b = run(
        TWO, lambda n, t: np.array([[0, 0, 0, *frames.from_axis_angle((0, 0, 1.0), 0.01 * x)] for x in t]), engine="b"
    )
    found = diff(a, b, tolerance=0.0055, floor=[quiet(a), quiet(b)])
    assert found.worst.position_largest == 0.0
    assert found.worst.angle_largest == pytest.approx(0.01)
    assert found.worst.first_out == pytest.approx(0.6)
    assert diff(a, b, tolerance=0.0055, angle_tolerance=0.02, floor=[quiet(a), quiet(b)]).within


def growing(rate: float):
    """A floor that passes 1 mm / FLOOR_FACTOR between 0.5 s and 0.6 s."""
    return lambda name, t: column((name == "mover") * 1e-3 / FLOOR_FACTOR * np.exp(rate * (t - 0.55)), 0, 0)


def test_chaos_is_not_disagreement():
    a, b = run(TWO), run(TWO, growing(40.0), engine="second")
    # the engine's own perturbed repeat departs just as the other engine does
    own = measure_floor(a, [run(TWO), run(TWO, growing(40.0), perturb=1e-15)])
    found = diff(a, b, tolerance=1e-3, floor=[own, quiet(b)])
    assert found.horizon == pytest.approx(0.6)
    assert found.compared_until == pytest.approx(0.5)
    assert found.within
    assert found.worst.position_largest < 1e-3
    # without the floor the same two runs look like disagreement, and a note says what is missing
    blind = diff(a, b, tolerance=1e-3)
    assert not blind.within
    assert "noise floor of first and second was not measured" in blind.notes[0]


def test_a_difference_above_the_floor_is_one_even_in_noise():
    a, b = pair(0.01)
    own = quiet(a, 1e-4)
    found = diff(a, b, tolerance=1e-6, floor=[own, quiet(b)])
    # the floor is above the tolerance from the start: nothing can be compared but the first row
    assert found.horizon == 0.0
    assert not diff(a, b, tolerance=2 * FLOOR_FACTOR * 1e-4, floor=[own, quiet(b)]).within


def test_a_tolerance_below_the_noise_of_the_first_row_claims_nothing():
    a = run(TWO)
    b = run(TWO, lambda n, t: column(0 * t + 2e-15, 0, 0), engine="second")
    found = diff(a, b, tolerance=1e-16, floor=[quiet(a, 1e-15), quiet(b)])
    assert (found.horizon, found.compared_until, found.within) == (0.0, 0.0, True)


def test_the_floor_only_grows():
    a = run(TWO)
    back = run(TWO, lambda n, t: column(1e-6 * np.sin(2 * math.pi * t), 0, 0), perturb=1e-15)
    floor = measure_floor(a, [back])
    assert (np.diff(floor.position, axis=0) >= 0).all()
    assert floor.largest == pytest.approx(1e-6, rel=0.1)
    assert floor.bitwise is None
    assert floor.perturbation == 1e-15


def test_a_bitwise_repeat_is_stated():
    a = run(TWO, drifting(0.3))
    assert measure_floor(a, [run(TWO, drifting(0.3))]).bitwise is True
    assert measure_floor(a, [run(TWO, drifting(0.3 * (1 + 1e-15)))]).bitwise is False


def test_a_repeat_that_broke_off_leaves_nothing_to_compare_after_it():
    a, b = pair(0.0)
    short = run(dataclasses.replace(TWO, physics=dataclasses.replace(TWO.physics, steps=50)), perturb=1e-15)
    found = diff(a, b, floor=[measure_floor(a, [short]), quiet(b)])
    assert found.compared_until == pytest.approx(0.5)


def test_a_floor_comes_back_bit_for_bit(tmp_path):
    a = run(TWO)
    floor = measure_floor(a, [run(TWO), run(TWO, growing(40.0), perturb=1e-15)])
    save_floor(floor, tmp_path)
    again = load_floor(tmp_path)
    assert np.array_equal(again.position, floor.position)
    assert np.array_equal(again.angle, floor.angle)
    assert np.array_equal(again.time, floor.time)
    assert (again.engine, again.bitwise, again.perturbation) == ("first", True, 1e-15)


def test_a_floor_that_is_not_there_or_damaged(tmp_path):
    assert load_floor(tmp_path) is None
    (tmp_path / "floor.parquet").write_bytes(b"PAR1")
    with pytest.raises(SpecError, match="cannot be read"):
        load_floor(tmp_path)


def test_no_repeats_no_floor():
    assert measure_floor(run(TWO), []) is None


def test_what_is_not_finite_is_out_of_tolerance():
    a = run(TWO)
    b = run(TWO, lambda n, t: column(np.where((t > 0.65) & (n == "mover"), np.nan, 0.0), 0, 0), engine="second")
    found = diff(a, b, tolerance=1.0, floor=[quiet(a), quiet(b)])
    assert found.first_out.body == "mover"
    assert found.first_out.first_out == pytest.approx(0.7)


def test_runs_recorded_at_other_times_are_compared_at_the_common_ones():
    a = run(TWO)
    fine = dataclasses.replace(TWO, physics=dataclasses.replace(TWO.physics, timestep=0.005, steps=200))
    b = run(fine, drifting(0.01), engine="second")
    found = diff(a, b, tolerance=1e-3)
    assert found.worst.position_largest == pytest.approx(0.01)
    assert "different worlds" in found.notes[0]


def test_only_common_bodies_are_compared_and_fixed_ones_are_not():
    wall = dataclasses.replace(free_body("wall"), joint=Joint("w", "fixed"))
    a = run(world(wall, free_body("mover"), free_body("gone")))
    b = run(world(free_body("new"), free_body("mover"), wall), drifting(0.01), engine="second")
    found = diff(a, b)
    assert [body.body for body in found.bodies] == ["mover"]
    assert found.worst.position_largest == pytest.approx(0.01)


def test_nothing_to_compare_is_an_error():
    with pytest.raises(SpecError, match="no moving body in common"):
        diff(run(world(free_body("a"))), run(world(free_body("b"))))
    nothing = dataclasses.replace(run(TWO), arrays={}, failed="crashed")
    with pytest.raises(SpecError, match="recorded nothing to compare: crashed"):
        diff(run(TWO), nothing)


@pytest.mark.parametrize(
    ("contacts", "cause"),
    [([], "free motion"), ([(3, 0, 1, -0.001, 1.0)], "contact"), ([(8, 0, 1, -0.001, 1.0)], "free motion")],
)
def test_a_departure_is_attributed(contacts, cause):
    a = run(TWO, contacts=contacts)
    b = run(TWO, drifting(0.01), engine="second", contacts=contacts)
    assert diff(a, b, tolerance=0.0045).first_out.cause == cause


def test_the_first_time_that_other_bodies_touch():
    a = run(TWO, contacts=[(2, 0, 1, 0.0, 1.0), (5, 1, 0, 0.0, 1.0)])
    same = run(TWO, engine="second", contacts=[(2, 1, 0, 0.0, 1.0), (2, 0, 1, 0.0, 1.0), (5, 0, 1, 0.0, 1.0)])
    later = run(TWO, engine="second", contacts=[(2, 1, 0, 0.0, 1.0), (6, 0, 1, 0.0, 1.0)])
    assert diff(a, same).contact_first_difference is None
    assert diff(a, later).contact_first_difference == pytest.approx(0.5)


def test_quantities_are_those_of_each_run():
    a = run(TWO, contacts=[(2, 0, 1, -0.003, 11.0)])
    b = run(TWO, None, lambda n, t: column(0 * t + 3.0, 0, 0), engine="second")
    found = {one.name: (one.first, one.second) for one in diff(a, b).quantities}
    assert found["deepest penetration"] == (0.003, 0.0)
    assert found["contact force, mean"] == (1.0, 0.0)
    assert found["linear momentum at the end"] == (0.0, pytest.approx(2 * 2.0 * 3.0))
    assert found["energy at the end"] == (0.0, pytest.approx(2 * 0.5 * 2.0 * 9.0))
    assert summary(a)["speed at the end"] == 0.0
