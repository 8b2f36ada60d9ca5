"""Two runs held against each other: deviations with known answers, the noise floor, and chaos."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.comparison.floor import FLOOR_FACTOR, Floor, deviations, load_floor, measure_floor, save_floor
from simspec.comparison.runs import INCONCLUSIVE, OUT, WITHIN, diff, summary
from simspec.errors import SpecError
from simspec.report.console import Screen
from simspec.report.differences import differences
from simspec.report.screen import diff_data
from simspec.world import frames
from simspec.world.types import Body, Joint
from tests.runner.synthetic import column, free_body, run, world

TWO = world(free_body("still"), free_body("mover"))


def drifting(rate):
    return lambda name, t: column(rate * t * (name == "mover"), 0, 0)


def quiet(entry, size: float = 0.0) -> Floor:
    shape = entry.arrays["pose"].shape[:2]
    return Floor(entry.engine, entry.time, np.full(shape, size), np.zeros(shape), True, 1e-15)


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
    values = np.array([[[0, 0, 0, *turn]]])
    other = np.array([[[0, 0, 0, *more]]])
    assert deviations(values, other)[1][0, 0] == pytest.approx(angle, rel=1e-3 if angle < 1e-9 else 1e-9)
    # q and −q are one orientation
    other[..., 3:] *= -1
    assert deviations(values, other)[1][0, 0] == pytest.approx(angle, rel=1e-3 if angle < 1e-9 else 1e-9)


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
    floor = measure_floor(a, [run(TWO), run(TWO, growing(40.0), perturb=1e-15)])
    found = diff(a, b, tolerance=1e-3, floor=[floor, quiet(b)])
    assert found.horizon == pytest.approx(0.6)
    assert found.compared_until == pytest.approx(0.5)
    assert found.within
    assert found.worst.position_largest < 1e-3
    # without the floor the same two runs look like disagreement, and a note says what is missing
    blind = diff(a, b, tolerance=1e-3)
    assert not blind.within
    assert "noise floor of first and second was not measured" in blind.notes[0]


def test_a_difference_above_the_floor_counts_even_in_noise():
    a, b = pair(0.01)
    floor = quiet(a, 1e-4)
    found = diff(a, b, tolerance=1e-6, floor=[floor, quiet(b)])
    # the noise stays at 0.1 mm, above the tolerance: differences beyond three times that are reported, at 0.1 s
    assert (found.horizon, found.compared_until) == (None, 1.0)
    assert found.verdict == OUT
    assert found.first_out.first_out == pytest.approx(0.1)
    # the other body does not deviate, and its differences below the noise cannot be distinguished
    assert found.bodies[1].verdict == INCONCLUSIVE
    assert not diff(a, b, tolerance=2 * FLOOR_FACTOR * 1e-4, floor=[floor, quiet(b)]).within


def test_a_tolerance_below_the_noise_inconclusive_note():
    a = run(TWO)
    b = run(TWO, lambda n, t: column(0 * t + 2e-15, 0, 0), engine="second")
    found = diff(a, b, tolerance=1e-16, floor=[quiet(a, 1e-15), quiet(b)])
    assert (found.horizon, found.compared_until) == (None, 1.0)
    assert (found.verdict, found.within) == (INCONCLUSIVE, False)
    assert (found.inconclusive_body.floor, found.inconclusive_body.inconclusive_from) == (1e-15, 0.0)
    # a tolerance above the noise can be
    assert diff(a, b, tolerance=4e-15, floor=[quiet(a, 1e-15), quiet(b)]).verdict == WITHIN


FINE = dataclasses.replace(TWO, physics=dataclasses.replace(TWO.physics, steps=2000))
"""20 s, 201 records."""


def noise_of(engine: str, size) -> Floor:
    """A floor of ``mover`` that is ``size(t)``."""
    entry = run(FINE, engine=engine)
    position = np.stack([0.0 * entry.time, np.maximum.accumulate(size(entry.time))], axis=-1)
    return Floor(engine, entry.time, position, 0.0 * position, True, 1e-15)


LEVEL = 4e-6
BOUNDED = {
    "a jump at the first impact": lambda t: np.where(t < 0.25, 1e-15, LEVEL),
    "a late jump": lambda t: np.where(t < 15.0, 1e-15, LEVEL),
    "two jumps": lambda t: np.where(t < 0.25, 1e-15, np.where(t < 6.0, 0.6 * LEVEL, LEVEL)),
    "growth that ends": lambda t: np.minimum(LEVEL, 1e-15 * np.exp(6.0 * t)),
    "linear drift": lambda t: LEVEL * t / 20.0,
    "quadratic drift": lambda t: LEVEL * (t / 20.0) ** 2,
}
CHAOTIC = {
    "exponential": lambda t: 1e-15 * np.exp(1.6 * t),
    "exponential, late": lambda t: 1e-15 * np.exp(1.25 * t),
    "exponential, run its course": lambda t: np.minimum(0.3, 1e-15 * np.exp(6.0 * t)),
    "in steps": lambda t: 1e-15 * 5.0 ** np.floor(t),
}


@pytest.mark.parametrize("noise", BOUNDED.values(), ids=BOUNDED)
def test_bounded_noise_hides_no_difference_above_it(noise):
    """At a distance of 127 µm and noise of 4 µm, tolerances between them and below the noise both show it."""
    a = run(FINE)
    b = run(FINE, lambda name, t: column(np.where(name == "mover", 1.27e-4 * t / 20.0, 0.0), 0, 0), engine="second")
    floors = [noise_of("first", noise), noise_of("second", noise)]
    for tolerance in (2e-5, 1e-5, 1e-6):
        found = diff(a, b, tolerance=tolerance, floor=floors)
        assert (found.horizon, found.verdict) == (None, OUT), tolerance
        assert found.worst.position_largest == pytest.approx(1.27e-4)
        threshold = np.maximum(tolerance, FLOOR_FACTOR * floors[0].position[:, 1])
        expected = a.time[np.argmax(1.27e-4 * a.time / 20.0 > threshold)]
        assert found.first_out.first_out == expected
    # where the two do not differ, a tolerance below the noise cannot be judged, a tolerance above it can
    assert diff(a, run(FINE, engine="second"), tolerance=1e-6, floor=floors).verdict == INCONCLUSIVE
    assert diff(a, run(FINE, engine="second"), tolerance=2e-5, floor=floors).verdict == WITHIN
    # nor can a deviation above the tolerance that is not above three times the noise
    near = run(FINE, lambda name, t: column(np.where(name == "mover", 2.5 * noise(t), 0.0), 0, 0), engine="second")
    assert diff(a, near, tolerance=5e-6, floor=floors).verdict == INCONCLUSIVE


def metre_between(name, t):
    """Two bodies at a distance of one metre."""
    return column(float(name == "mover") + 0 * t, 0, 0)


@pytest.mark.parametrize("noise", CHAOTIC.values(), ids=CHAOTIC)
def test_growing_noise_ends_the_comparison_where_it_passes_the_tolerance(noise):
    a = run(FINE, metre_between)
    b = run(FINE, lambda name, t: metre_between(name, t) + column((name == "mover") * noise(t), 0, 0), engine="second")
    floors = [noise_of("first", noise), noise_of("second", noise)]
    found = diff(a, b, tolerance=1e-9, floor=floors)
    past = int(np.argmax(FLOOR_FACTOR * noise(a.time) > 1e-9))
    assert past
    assert found.horizon == a.time[past]
    assert found.compared_until == a.time[past - 1]
    assert found.verdict == WITHIN


def test_a_chaotic_body_does_not_hide_the_bounded_noise_of_an_earlier_body():
    """The horizon is that of the body whose noise grows, not the time at which another's noise reaches its level."""
    a = run(FINE, metre_between)
    b = run(
        FINE,
        lambda name, t: metre_between(name, t) + column(np.where(name == "still", 1e-4 * (t > 1.0), 0.0), 0, 0),
        engine="b",
    )
    position = np.stack(
        [np.where(a.time < 0.25, 1e-15, LEVEL), np.maximum.accumulate(1e-15 * np.exp(1.6 * a.time))], axis=-1
    )
    floor = Floor("first", a.time, position, 0.0 * position, True, 1e-15)
    found = diff(a, b, tolerance=1e-5, floor=[floor])
    assert found.horizon == a.time[np.argmax(FLOOR_FACTOR * position[:, 1] > 1e-5)]
    assert found.first_out.body == "still"


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


def test_non_finite_values_are_out_of_tolerance():
    a = run(TWO)
    b = run(TWO, lambda n, t: column(np.where((t > 0.65) & (n == "mover"), np.nan, 0.0), 0, 0), engine="second")
    found = diff(a, b, tolerance=1.0, floor=[quiet(a), quiet(b)])
    assert found.first_out.body == "mover"
    assert found.first_out.first_out == pytest.approx(0.7)


def test_runs_recorded_at_different_times_are_compared_at_common_times():
    a = run(TWO)
    fine = dataclasses.replace(TWO, physics=dataclasses.replace(TWO.physics, timestep=0.005, steps=200))
    b = run(fine, drifting(0.01), engine="second")
    found = diff(a, b, tolerance=1e-3)
    assert found.worst.position_largest == pytest.approx(0.01)
    assert "different worlds" in found.notes[0]


def test_only_common_moving_bodies_are_compared():
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
    found = {quantity.name: (quantity.first, quantity.second) for quantity in diff(a, b).quantities}
    assert found["deepest penetration"] == (0.003, 0.0)
    assert found["contact force, mean"] == (1.0, 0.0)
    assert found["linear momentum at the end"] == (0.0, pytest.approx(2 * 2.0 * 3.0))
    assert found["energy at the end"] == (0.0, pytest.approx(2 * 0.5 * 2.0 * 9.0))
    assert summary(a)["speed at the end"] == 0.0


@pytest.mark.filterwarnings("error")
def test_a_state_without_bound_has_an_infinite_energy_and_no_warning():
    b = run(TWO, None, lambda n, t: column(0 * t + 1e200, 0, 0))
    assert summary(b)["energy at the end"] == math.inf
    assert summary(b)["linear momentum at the end"] >= 1e200


def shifted(entry, by: float):
    """The run as if recorded ``by`` seconds later, but for the first row."""
    time = entry.time + by * (np.arange(len(entry.time)) > 0)
    return dataclasses.replace(entry, arrays={**entry.arrays, "time": time})


@pytest.mark.parametrize("steps", [0.6, 1.0, 3.0, 5.0])
def test_rows_that_differ_by_more_than_half_a_step_are_not_simultaneous(steps):
    """A body at 1 m/s is 10 mm further after each step: rows of neighbouring steps are not comparable."""
    a, b = run(TWO, drifting(1.0)), shifted(run(TWO, drifting(1.0), engine="second"), steps * TWO.physics.timestep)
    with pytest.raises(SpecError, match="no recorded time in common but the beginning"):
        diff(a, b)  # the first rows alone are of one time
    late = dataclasses.replace(
        b, arrays={name: values[1:] for name, values in b.arrays.items() if "contact" not in name}
    )
    with pytest.raises(SpecError, match="have no recorded time in common"):
        diff(a, late)


def test_records_with_few_common_times_are_compared_there_with_a_note():
    """Records every second at 1 ms, and every 1.001 s at 7 ms: as of a sweep that rounds times up."""
    a = run(TWO, drifting(1.0))
    where = [k for k in range(len(a.time)) if k % 3 == 0]
    few = {name: values[where] for name, values in a.arrays.items() if "contact" not in name}
    few["time"] = few["time"] + 0.6 * TWO.physics.timestep * (np.arange(len(where)) % 2)
    b = dataclasses.replace(a, arrays=few)
    made = diff(a, b)
    common = sum(k % 2 == 0 for k in range(len(where)))
    assert made.within
    assert f"{common} recorded times are common, of {where[-1] + 1} and {len(where)}" in " ".join(made.notes)
    every_third = dataclasses.replace(b, arrays={**few, "time": a.time[where]})
    assert not any("are common" in note for note in diff(a, every_third).notes), (
        "all of the other run's times are compared"
    )


def test_rows_within_half_a_step_are_simultaneous():
    a, b = run(TWO, drifting(1.0)), shifted(run(TWO, drifting(1.0), engine="second"), 0.4 * TWO.physics.timestep)
    assert diff(a, b).compared_until == 1.0


def saved_with_floor(folder, engine: str = "first"):
    from simspec.comparison.floor import FLOOR_FILE

    entry = run(TWO, engine=engine)
    entry.save(folder)
    flat = np.zeros(entry.arrays["pose"].shape[:2])
    save_floor(Floor(engine, entry.time, flat + 1e-15, flat, True, 1e-15), folder)
    return folder / FLOOR_FILE


def test_a_floor_is_accepted_only_with_the_run_that_it_belongs_to(tmp_path):
    import pyarrow as pa
    from pyarrow import parquet

    path = saved_with_floor(tmp_path / "run")
    assert load_floor(tmp_path / "run").largest == 1e-15
    table = parquet.read_table(path)
    # larger noise would hide differences
    larger = pa.FixedSizeListArray.from_arrays(pa.array(np.full(2 * len(table), 1.0)), 2)
    parquet.write_table(table.set_column(1, "position", larger), path)
    with pytest.raises(SpecError, match=r"floor.parquet: was edited"):
        load_floor(tmp_path / "run")
    other = saved_with_floor(tmp_path / "other", engine="second")
    path.write_bytes(other.read_bytes())
    with pytest.raises(SpecError, match=r"floor.parquet: belongs to another run"):
        load_floor(tmp_path / "run")
    parquet.write_table(table.replace_schema_metadata({}), path)
    with pytest.raises(SpecError, match=r"floor.parquet"):
        load_floor(tmp_path / "run")
    parquet.write_table(table.drop_columns(["angle"]), path)
    with pytest.raises(SpecError, match=r"floor.parquet.*angle"):
        load_floor(tmp_path / "run")


# --- angles and joint coordinates ----------------------------------------------------------------------------------


def linkage():
    """A link on a hinge through its origin, a slide on it and a ball joint on that."""
    solid = free_body("link").inertial
    joints = [
        Joint("turn", "hinge", None, axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,)),
        Joint("lift", "slide", "link", axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,)),
        Joint("eye", "ball", "tip", position=(1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 3),
    ]
    names = ("link", "tip", "eye")
    return world(*(Body(name, "m", solid, joint) for name, joint in zip(names, joints, strict=True)))


def moved_by(columns, place=None, engine="first"):
    """A run in which the coordinates are ``columns`` (rows, 6)."""
    made = run(linkage(), place, engine=engine)
    q = made.arrays["q"].copy()
    q[:, 2] = 1.0
    for column_number, values in columns.items():
        q[:, column_number] = values(made.time)
    return dataclasses.replace(made, arrays={**made.arrays, "q": q})


def test_angles_and_joint_coordinates_are_named_with_their_times(capsys):
    """The link turns about its own origin: its position is the same in both runs."""

    def turning(name, t):
        return np.array([[0, 0, 0, *frames.from_axis_angle((0.0, 0, 1.0), 0.4 * x * (name == "link"))] for x in t])

    a = moved_by({})
    turns = {0: lambda t: 0.4 * t, 1: lambda t: np.where(t == 0.5, -3e-3, 1e-4), 3: np.sin, 2: np.cos}
    found = diff(a, moved_by(turns, turning, "second"), tolerance=1.0)
    assert found.worst.position_largest == 0.0
    assert (found.worst_angle.body, found.worst_angle.time_of_largest_angle) == ("link", 1.0)
    assert found.worst_angle.angle_largest == pytest.approx(0.4)
    joints = {joint.joint: (joint.unit, joint.largest, joint.time) for joint in found.joints}
    assert joints == {
        "eye": ("rad", pytest.approx(2.0), 1.0),
        "turn": ("rad", pytest.approx(0.4), 1.0),
        "lift": ("m", pytest.approx(3e-3), 0.5),
    }
    assert found.worst_joint.joint == "eye"
    data = diff_data(found)
    assert [joint["joint"] for joint in data["joints"]] == ["eye", "turn", "lift"]
    Screen(width=80, no_color=True).print(differences([found]))
    shown = capsys.readouterr().out
    assert all(len(line) <= 80 for line in shown.splitlines())
    for words in ("0.4 rad: link at 1 s", "2 rad: joint eye at 1 s", "3 mm: joint lift at 0.5 s"):
        assert words in " ".join(shown.split()).replace("second ", "")


def test_a_turn_more_is_a_difference_of_the_joint_alone():
    a, b = moved_by({}), moved_by({0: lambda t: 2.0 * np.pi * t}, engine="second")
    found = diff(a, b)
    assert found.worst_angle.angle_largest == 0.0
    assert found.worst_joint.largest == pytest.approx(2.0 * np.pi)


def test_a_coordinate_that_is_not_finite_is_the_largest():
    b = moved_by({0: lambda t: np.where(t > 0.45, np.nan, 0.0)}, engine="second")
    (worst, *_) = diff(moved_by({}), b).joints
    assert (worst.joint, worst.largest, worst.time) == ("turn", np.inf, pytest.approx(0.5))
