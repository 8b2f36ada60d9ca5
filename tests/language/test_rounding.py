"""Times that are rounded up to whole steps."""

from __future__ import annotations

import copy
import math
import random

import pytest

from simspec.experiments.cases import concerned, rounded_up
from simspec.language.load import Spec
from simspec.language.overrides import Override
from tests.experiments.swept import DATA

EXPECT = [
    {"position": {"body": "ball", "xyz": [1, 0, 1], "tolerance": 9, "at": "10 ms"}},
    {"comes_to_rest": {"speed": 9, "before": "20 ms"}},
    {"keeps_place": {"body": "ball", "within": "rod", "after": "0 s", "until": "18 ms", "distance": 9}},
]


def data(timestep, duration="20 ms", every="10 ms", expect=EXPECT, **more):
    made = {**copy.deepcopy(dict(DATA)), **more, "expect": expect}
    made["physics"] = {"timestep": timestep, "duration": duration}
    made["record"] = {"every": every}
    return made


def taken(of):
    return {rounded.path: rounded.taken for rounded in rounded_up(of)}


def test_whole_multiples_stay_unchanged():
    assert rounded_up(data("1 ms", expect=EXPECT[:2])) == ()
    assert rounded_up({"bodies": {}}) == ()
    assert taken(data("1 ms")) == {"expect.2.keeps_place.until": 0.02}, "a time that no record is of"


def test_times_are_taken_at_the_next_step_and_those_of_expectations_at_the_next_record():
    assert taken(data("3 ms")) == {
        "physics.duration": 0.021,
        "record.every": 0.012,
        "expect.0.position.at": 0.012,
        "expect.1.comes_to_rest.before": 0.021,
        "expect.2.keeps_place.until": 0.021,
    }
    until = data("3 ms", "200 ms", trajectory={"until": "16 ms", "points": []})
    assert taken(until)["trajectory.until"] == 0.018
    assert taken(until)["expect.0.position.at"] == 0.012
    assert taken(until)["expect.1.comes_to_rest.before"] == 0.024, "after the cut: at a record of the whole run"
    short = data("3 ms", "200 ms", expect=EXPECT[:1], trajectory={"until": "10 ms", "points": []})
    assert taken(short)["expect.0.position.at"] == 0.012, "the end of the run that is cut short"
    # an interval below a step is a step
    assert taken(data("7 ms", every="2 ms"))["record.every"] == 0.007


@pytest.mark.parametrize("seed", range(40))
def test_any_times_become_a_spec_that_is_valid(seed):
    draw = random.Random(seed)
    timestep = draw.choice([0.001, 0.0007, 1 / 300, 0.01, draw.uniform(1e-4, 0.03)])
    duration = draw.uniform(0.02, 0.4)
    of = data(timestep, duration, draw.uniform(1e-3, 0.1), expect=copy.deepcopy(EXPECT[:2]))
    of["expect"][0]["position"]["at"], of["expect"][1]["comes_to_rest"]["before"] = (
        draw.uniform(0, duration),
        duration,
    )
    base = Spec.from_data(data("1 ms"))
    given = [Override(name, of[name], None, None) for name in ("physics", "record", "expect")]
    rounded = rounded_up(of)
    world = base.with_overrides(
        [*given, *(Override(entry.path, entry.taken, None, None) for entry in rounded)]
    ).resolve()
    assert world.physics.steps == math.ceil(duration / timestep - 1e-9)
    for entry in rounded:
        assert entry.taken > entry.written
        most = timestep if not entry.path.startswith("expect") else world.record.every_steps * timestep
        assert entry.taken - entry.written < most * (1 + 1e-9)


def test_values_that_are_not_times_are_left_to_the_checks():
    assert rounded_up(data("1 kg")) == ()
    assert rounded_up(data(0)) == ()
    assert rounded_up(data(1e-300, 1e300)) == ()
    assert rounded_up({"physics": 3, "record": [], "expect": {"a": 1}}) == ()
    unexpected = data("3 ms", expect=[3, {"position": {"at": "soon"}}, {"position": None}, {"position": {"at": "5 s"}}])
    assert list(taken(unexpected)) == ["physics.duration", "record.every"], (
        "a time after the end is an error, not rounded"
    )


def test_which_values_times_depend_on():
    assert all(
        map(concerned, ["physics", "physics.timestep", "record.every", "record", "expect.3.position.at", "expect"])
    )
    assert not any(map(concerned, ["bodies.rod.mass", "physics.gravity", "record.channels", "engines"]))
