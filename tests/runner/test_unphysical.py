"""Unphysical motion in runs of any engine: found in runs made by hand, and in no run that could be real."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.comparison.runs import diff
from simspec.report.screen import run_data
from simspec.runner.run import Run
from simspec.runner.unphysical import ENERGY, GONE, PASSED, SINKS, together
from simspec.world.actions import JointController
from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Pose, Shape, World
from tests.runner.synthetic import column, free_body, run, world

STONE = Contact(materials=(Material("stone"),), pairs=(PairContact("stone", "stone", 0.5, 0.5),))
BALL = Shape("ball_0", "sphere", (0.1,), material="stone")


def ball(name: str = "ball", at: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Body:
    body = free_body(name, 1.0)
    shape = dataclasses.replace(BALL, name=f"{name}_0")
    return dataclasses.replace(
        body, shapes=(shape,), joint=dataclasses.replace(body.joint, position=(*at, 1.0, 0.0, 0.0, 0.0))
    )


def static(kind: str, size: tuple[float, ...], at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Body:
    shape = Shape("wall_0", kind, size, material="stone")
    return Body("wall", "wall", Inertial(0.0), Joint("wall_joint", "fixed", origin=Pose(at)), (shape,))


def made(of: World, way, speed=None, **more) -> Run:
    """The ball goes ``way(t)`` (rows, 3); the others rest where they are."""
    values = {body.name: np.array((*body.joint.origin.position, 0, 0, 0)) for body in of.bodies}

    def place(name: str, t: np.ndarray) -> np.ndarray:
        return way(t) if name == "ball" else np.tile(values[name][:3], (len(t), 1))

    def fast(name: str, t: np.ndarray) -> np.ndarray:
        if name != "ball":
            return np.zeros((len(t), 3))
        return np.gradient(way(t), t, axis=0) if speed is None else speed(t)

    return run(of, place, fast, **more)


def scene(*bodies: Body, gravity: float = 0.0, steps: int = 1000) -> World:
    return dataclasses.replace(world(*bodies, gravity=gravity, steps=steps), contact=STONE)


def kinds(entry: Run) -> list[str]:
    return [finding.kind for finding in entry.unphysical.findings]


def straight(speed: float, start: float = -5.0):
    return lambda t: column(start + speed * t, 0.0, 0.0)


@pytest.mark.parametrize(("share", "found"), [(0.03, []), (0.08, [ENERGY]), (1e6, [ENERGY])])
def test_energy_that_grows_without_a_drive_is_found(share, found):
    of = scene(free_body("ball"))
    grown = made(of, lambda t: column(t, 0.0, 0.0), lambda t: column(np.sqrt(1.0 + share * t / t[-1]), 0.0, 0.0))
    assert kinds(grown) == found
    for finding in grown.unphysical.findings:
        assert f"{share:.3g} of what there was" in finding.text
        assert finding.short == "energy grows though nothing drives the world"
    lost = made(of, lambda t: column(t, 0.0, 0.0), lambda t: column(np.sqrt(1.0 + share * (1.0 - t / t[-1])), 0.0, 0.0))
    assert kinds(lost) == []


def test_the_energy_of_driven_bodies_is_not_judged_with_a_reason():
    of = scene(free_body("ball"))
    driven = dataclasses.replace(of, controllers=(JointController("c", ("ball_joint",), "native"),))
    entry = made(driven, lambda t: column(t, 0.0, 0.0), lambda t: column(1.0 + t, 0.0, 0.0))
    assert kinds(entry) == []
    assert entry.unphysical.not_judged[ENERGY] == "the world has controllers"
    assert run_data(entry)["not_judged"] == entry.unphysical.not_judged


def test_only_a_bounce_that_gains_energy_is_found():
    top, g = 1.0, 10.0
    hit = math.sqrt(2 * top / g)
    of = scene(free_body("ball"), gravity=-g, steps=80)

    def bouncing(e: float) -> Run:
        up = e * g * hit

        def height(t: np.ndarray) -> np.ndarray:
            after = t - hit
            return column(0.0, 0.0, np.where(t < hit, top - 0.5 * g * t * t, up * after - 0.5 * g * after * after))

        return made(of, height, lambda t: column(0.0, 0.0, np.where(t < hit, -g * t, up - g * (t - hit))))

    assert kinds(bouncing(1.1)) == [ENERGY]
    assert kinds(bouncing(0.9)) == kinds(bouncing(1.0)) == []


def test_energy_returned_by_contact_is_no_gain_and_later_energy_is():
    """A ball without gravity that a compliant wall stops and throws back: at the turn all energy is in the contact."""
    of = scene(ball(at=(-1.0, 0.0, 0.0)), static("box", (0.2, 4.0, 4.0)))

    def thrown(e: float, contacts: list) -> Run:
        def speed(t: np.ndarray) -> np.ndarray:
            return column(np.where(t < 5.0, 1.0, np.where(t < 5.15, 0.0, -e)), 0.0, 0.0)

        return made(of, lambda t: column(-1.0 + 0.0 * t, 0.0, 0.0), speed, contacts=contacts)

    touching = [(row, 0, 1, -0.01, 1.0) for row in (50, 51)]
    assert kinds(thrown(1.0, touching)) == []
    assert kinds(thrown(0.9, touching)) == []
    assert kinds(thrown(1.1, touching)) == [ENERGY]
    assert kinds(thrown(0.5, [])) == [ENERGY], "nothing touched while it had none"


def test_non_finite_and_distant_bodies_have_left_the_world():
    of = scene(ball())
    lost = made(of, lambda t: column(np.where(t > 5.0, np.nan, 0.0), 0.0, 0.0), lambda t: column(0.0 * t, 0.0, 0.0))
    assert kinds(lost) == [GONE]
    assert "not at a finite place from 5.1 s on" in lost.unphysical.findings[0].text
    far = made(of, lambda t: column(1e3 * t * t, 0.0, 0.0), lambda t: column(0.0 * t, 0.0, 0.0))
    assert kinds(far) == [GONE]
    assert kinds(made(of, lambda t: column(1e3 * t, 0.0, 0.0))) == [], "its initial speed leads there"


def test_a_body_that_passes_a_wall_between_two_records_is_found():
    of = scene(ball(), static("box", (0.2, 4.0, 4.0)))
    (finding,) = made(of, straight(10.0)).unphysical.findings
    assert finding.kind == PASSED
    assert finding.short == "ball passes through what cannot move"
    assert "wall" in finding.text
    assert kinds(made(of, lambda t: column(-abs(5.0 - 10.0 * t) - 0.2, 0.0, 0.0))) == [], "it bounces"
    other = dataclasses.replace(of, contact=dataclasses.replace(STONE, excluded_bodies=(("ball", "wall"),)))
    assert kinds(made(other, straight(10.0))) == [], "they do not touch each other"


def test_a_body_inside_of_something_or_below_a_plane_is_found():
    of = scene(ball(), static("box", (4.0, 4.0, 1.0), (0.0, 0.0, -0.5)))
    sunk = made(of, lambda t: column(0.0, 0.0, 0.1 - 0.03 * t))
    assert kinds(sunk) == [PASSED]
    assert sunk.unphysical.findings[0].time == pytest.approx(3.4, abs=0.11)
    plane = scene(ball(), static("plane", ()))
    assert kinds(made(plane, lambda t: column(0.0, 0.0, 0.1 - 0.03 * t))) == [PASSED]
    assert kinds(made(plane, lambda t: column(0.0, 0.0, 0.1 + 0.0 * t))) == []


@pytest.mark.parametrize("kind", ["sphere", "cylinder", "capsule"])
def test_the_largest_ball_inside_other_shapes_counts(kind):
    size = {"sphere": (1.0,), "cylinder": (1.0, 4.0), "capsule": (1.0, 2.0)}[kind]
    of = scene(ball(), static(kind, size))
    assert kinds(made(of, straight(10.0))) == [PASSED]
    assert kinds(made(of, lambda t: column(-5.0 + 10.0 * t, 1.2, 0.0))) == []


@settings(max_examples=60, deadline=None)
@given(
    radius=st.floats(0.85, 3.0),
    turns=st.floats(-3.0, 3.0),
    begin=st.floats(0.0, 6.3),
    rows=st.integers(2, 40),
)
def test_no_way_around_a_wall_is_taken_for_a_passage(radius, turns, begin, rows):
    """A ball that goes around a box in circles, recorded seldom: lines between records cross the box."""
    of = scene(ball(), static("box", (1.0, 1.0, 1.0)), steps=10 * rows)
    rate = turns * 2.0 * math.pi / (0.1 * rows)

    def way(t: np.ndarray) -> np.ndarray:
        return column(radius * np.cos(begin + rate * t), radius * np.sin(begin + rate * t), 0.0)

    def speed(t: np.ndarray) -> np.ndarray:
        return column(0.0, radius * rate + 0.0 * t, 0.0)

    assert PASSED not in kinds(made(of, way, speed))


def test_a_body_that_falls_off_a_table_has_left_the_world_and_on_a_plane_has_not():
    table = scene(ball(), static("box", (1.0, 1.0, 0.1)), gravity=-10.0)
    falls = made(table, lambda t: column(2.0, 0.0, 1.0 - 5.0 * t * t), lambda t: column(0.0, 0.0, -10.0 * t))
    assert kinds(falls) == [GONE]
    assert "below everything that cannot move" in falls.unphysical.findings[0].text
    alone = dataclasses.replace(table, bodies=table.bodies[:1])
    assert kinds(made(alone, lambda t: column(2.0, 0.0, 1.0 - 5.0 * t * t))) == [], "nothing is there to fall on"


def sinking(depth, slides: float = 0.0) -> Run:
    of = scene(ball(), static("plane", ()))
    rows = 101
    contacts = [(row, 0, 1, -float(depth(row / (rows - 1))), 1.0) for row in range(rows)]
    return made(of, lambda t: column(slides * t, 0.0, 0.1 + 0.0 * t), contacts=contacts)


def test_endless_sinking_is_found_and_settling_is_not():
    (finding,) = sinking(lambda share: 0.01 * share).unphysical.findings
    assert finding.kind == SINKS
    assert "sinks by 0.001 m/s" in finding.text
    assert kinds(sinking(lambda share: 0.05 * (1.0 - math.exp(-5.0 * share)))) == [], "it slows down"
    assert kinds(sinking(lambda share: 0.01 + 1e-6 * share)) == [], "a hundred thousandth of its radius"
    assert kinds(sinking(lambda share: 0.01)) == []
    assert kinds(sinking(lambda share: 0.01 * share, slides=0.1)) == [], "it does not rest"


def test_engines_that_agree_on_it_share_a_line_and_the_comparison_reports_it():
    of = scene(ball(), static("box", (0.2, 4.0, 4.0)))
    first, second = made(of, straight(10.0)), made(of, straight(10.0), engine="second")
    (line,) = together({"first": first.unphysical, "second": second.unphysical})
    assert line.startswith("ball passes through wall")
    assert line.endswith("(in every engine)")
    assert any("both runs show a motion that is not physical: ball" in note for note in diff(first, second).notes)
    sound = made(of, lambda t: column(-5.0 + 0.1 * t, 0.0, 0.0), engine="second")
    (line,) = together({"first": first.unphysical, "second": sound.unphysical})
    assert line.endswith("(in first)")
    assert not any("not physical" in note for note in diff(first, sound).notes)
    assert run_data(first)["unphysical"][0]["kind"] == PASSED
