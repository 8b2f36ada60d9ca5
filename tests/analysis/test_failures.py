"""The first event of synthetic motions: each kind is distinguished from the others."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.analysis.validity import KINDS, first_failure
from simspec.runner.expectations import evaluate
from simspec.world.types import Expectation, Joint, Shape
from tests.runner.synthetic import column, free_body, run, world

END = 1.0
BALL = Shape("ball_1", "sphere", (0.1,))


def place(name: str, xyz: tuple[float, float, float], at: float | None = None, tolerance: float = 0.01) -> Expectation:
    given = {"targets": ((name, xyz),), "tolerance": tolerance} | ({"at": at} if at is not None else {})
    return Expectation("at_target", tuple(sorted(given.items())))


def carried(height, x=None, expect=None, other=None, contacts=None, **facts):
    """A cup whose height over time is given; it is to be 0.1 m up and 0.5 m aside at the end. A saucer stays at the origin."""
    bodies = [dataclasses.replace(free_body(name), shapes=(BALL,)) for name in ("cup", "saucer")]
    of = world(*bodies, expect=expect or (place("cup", (0.5, 0.0, 0.1)),))

    def path(name, t):
        if name == "saucer":
            return np.zeros((len(t), 3)) if other is None else other(t)
        along = 0.5 * t / END if x is None else np.interp(t, *x)
        return column(along, 0.0, np.interp(t, *height))

    return run(of, path, contacts=contacts, **facts)


def event(made):
    return first_failure(made, evaluate(made))


LIFTED = ([0, 0.3, 0.7, 1.0], [0, 0.3, 0.3, 0.1])


def test_nothing_failed():
    assert event(carried(LIFTED)) is None


@pytest.mark.parametrize(
    ("height", "x", "kind", "time"),
    [
        # comes down at 0.5 s, and stays there
        (([0, 0.3, 0.4, 0.45, 1.0], [0, 0.3, 0.3, 0, 0]), None, "dropped", 0.5),
        # is at its place from 0.5 s on, and falls from it at 0.8 s
        (([0, 0.3, 0.5, 0.71, 0.79, 1], [0, 0.3, 0.1, 0.1, 0, 0]), ([0, 0.5, 1], [0, 0.5, 0.5]), "left-its-place", 0.8),
        # is moved along the ground
        (([0, 1], [0, 0]), None, "not-lifted", 1.0),
        (([0, 1], [0, 0]), ([0, 1], [0, 0]), "not-moved", 1.0),
        # is carried to another place
        (LIFTED, ([0, 1], [0, 0.4]), "missed", 1.0),
        # is carried over its place and comes down next to it: it did not fall
        (([0, 0.3, 0.7, 1.0], [0, 0.5, 0.5, 0.09]), ([0, 1], [0, 0.47]), "missed", 1.0),
    ],
)
def test_the_event_of_a_body(height, x, kind, time):
    failure = event(carried(height, x))
    assert (failure.kind, failure.time) == (kind, pytest.approx(time))
    assert (failure.expected, failure.body, failure.at) == (0, "cup", None)
    last = np.array([np.interp(1.0, *(x or ([0, 1], [0, 0.5]))), 0, np.interp(1.0, *height)])
    assert failure.away == pytest.approx(np.linalg.norm(last - [0.5, 0, 0.1]))
    assert str(failure).startswith(KINDS[kind])


def test_without_gravity_nothing_falls():
    made = carried(([0, 0.3, 0.4, 0.45, 1.0], [0, 0.3, 0.3, 0, 0]))
    weightless = dataclasses.replace(
        made.world, physics=dataclasses.replace(made.world.physics, gravity=(0.0, 0.0, 0.0))
    )
    assert event(dataclasses.replace(made, world=weightless)).kind == "missed"


def test_the_body_that_is_farthest_and_the_first_expectation_that_fails():
    both = (("cup", (0.25, 0, 0.3)), ("saucer", (0, 0, 1)))
    expect = (
        place("cup", (0.5, 0.0, 0.1)),
        Expectation("at_target", (("at", 0.5), ("targets", both), ("tolerance", 0.01))),
        place("cup", (0.15, 0.0, 0.3), at=0.3),
    )
    failure = event(carried(([0, 0.3, 1], [0, 0.3, 0.3]), expect=expect))
    assert (failure.expected, failure.at, failure.body, failure.away) == (1, 0.5, "saucer", 1.0)
    assert failure.kind == "not-moved"


def test_a_deep_overlap_comes_first_where_it_did():
    """Balls of 10 cm: an overlap of more than 1 cm is deep. The cup is dropped at 0.5 s."""
    dropped = ([0, 0.3, 0.4, 0.45, 1.0], [0, 0.3, 0.3, 0, 0])

    def kind(*contacts):
        return event(carried(dropped, contacts=list(contacts)))

    assert kind((4, 0, 1, -0.0099, 1.0)).kind == "dropped"
    deep = kind((2, 0, 1, -0.0099, 1.0), (4, 1, 0, -0.02, 1.0), (6, 0, 1, -0.03, 1.0))
    assert (deep.kind, deep.time, deep.what) == ("overlap", 0.4, "20 mm with saucer")
    assert kind((4, 0, 1, float("nan"), 1.0)).kind == "overlap"
    assert kind((6, 0, 1, -0.03, 1.0)).kind == "dropped", "it had fallen before"
    # events before an expectation that was met have nothing to do with it
    actual = (place("cup", (0.15, 0, 0.3), at=0.3), place("cup", (0.5, 0, 0.1)))
    before = (2, 0, 1, -0.03, 1.0)
    assert event(carried(dropped, contacts=[before], expect=actual)).kind == "dropped"
    assert event(carried(dropped, contacts=[before, (4, 0, 1, -0.03, 1.0)], expect=actual)).kind == "dropped"
    assert event(carried(dropped, contacts=[before, (4, 0, 1, -0.04, 1.0)], expect=actual)).kind == "overlap"


def test_a_joint_that_is_off_its_trajectory():
    def driven(error, targets, why=None):
        made = carried(([0, 0.3, 0.4, 0.45, 1.0], [0, 0.3, 0.3, 0, 0]))
        arm = dataclasses.replace(
            free_body("arm"), joint=Joint("elbow", "hinge", axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
        )
        bodies = (*made.world.bodies, arm)
        arrays = dict(made.arrays)
        arrays["q"] = np.hstack([arrays["q"], np.zeros((len(made.time), 1))])
        arrays["pose"] = np.concatenate([arrays["pose"], arrays["pose"][:, :1]], axis=1)
        arrays["control.target"] = np.interp(made.time, *targets)[:, None]
        facts = {**made.provenance, "control": {"joints": ["elbow"], "error": [error], "clipped": [0]}}
        of = dataclasses.replace(made.world, bodies=bodies)
        return event(dataclasses.replace(made, world=of, arrays=arrays, provenance=facts, failed=why))

    first = driven(0.5, ([0, 0.25, 0.3, 1], [0, 0, 0.4, 0.4]))
    assert (first.kind, first.time, first.what) == ("off-trajectory", 0.3, "elbow by 0.4")
    later = driven(0.5, ([0, 0.65, 0.7, 1], [0, 0, 0.4, 0.4]))
    assert (later.kind, later.time) == ("dropped", 0.5)
    assert later.what == "elbow was up to 0.5 off its trajectory at some time"
    assert driven(0.1, ([0, 1], [0, 0.1])).what == ""
    assert driven(None, ([0, 1], [0, 0])).kind == "dropped"
    # also in a run that ended early
    ended = driven(0.5, ([0, 0.25, 0.3, 1], [0, 0, 0.4, 0.4]), "not finite")
    assert (ended.kind, ended.time) == ("off-trajectory", 0.3)
    assert ended.what == f"elbow by 0.4; {KINDS['no-result']}: not finite"
    unseen = driven(0.5, ([0, 1], [0, 0]), "not finite")
    assert (unseen.kind, unseen.time) == ("no-result", 1.0)
    assert unseen.what == "not finite; elbow was up to 0.5 off its trajectory at some time"


def test_expectations_without_a_place_and_runs_without_a_result():
    expect = (
        Expectation("comes_to_rest", (("before", 0.1), ("speed", 0.0))),
        Expectation("no_penetration_deeper_than", (("depth", 0.0),)),
    )
    made = carried(LIFTED, expect=expect, contacts=[(3, 0, 1, -0.02, 1.0)])
    failure = event(made)
    assert (failure.kind, failure.time, failure.body) == ("other", None, "")
    assert failure.what.startswith("no penetration deeper than: ")
    stopped = dataclasses.replace(made, failed="velocity is not finite after step 7")
    assert event(stopped).kind == "no-result"
    assert "velocity is not finite" in str(event(stopped))
    unknown = dataclasses.replace(
        made, world=dataclasses.replace(made.world, expectations=(place("nobody", (0, 0, 0)),))
    )
    assert event(unknown).kind == "not-recorded"
