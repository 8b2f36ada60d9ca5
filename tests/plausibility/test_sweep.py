"""Self-collision over the ranges of joints, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from simspec.plausibility import sweep as module
from simspec.plausibility.parts import lumps_of
from simspec.plausibility.sweep import positions, range_of, sweep
from simspec.world.overlap import separation
from simspec.world.types import Body, Contact, FollowConstraint, Inertial, Joint, Pose, Shape, World
from tests.plausibility.files import LANGUAGES, examined, of_rule

RADIUS = 0.05
LENGTH = 0.4


def chain(upper: float, exclude: tuple[tuple[str, str], ...] = (("a", "b"), ("b", "c")), follow: bool = False) -> World:
    """Three links of length 0.4 along z in the plane of x and z, on hinges about y; a ball at the end of the first and the
    third. The third's ball comes back to the first's as the hinges turn."""

    def body(name: str, parent: str | None, at: float, ball: float | None) -> Body:
        joint = Joint(
            f"{name}_joint",
            "hinge",
            parent,
            Pose((0.0, 0.0, at)),
            (0.0, 1.0, 0.0),
            (0.0, upper),
            position=(0.0,),
            velocity=(0.0,),
        )
        shapes = () if ball is None else (Shape(f"{name}_ball", "sphere", (RADIUS,), Pose((0.0, 0.0, ball)), "m"),)
        return Body(name, "arm", Inertial(1.0, (0.0, 0.0, 0.2), (0.02, 0.02, 0.001, 0.0, 0.0, 0.0)), joint, shapes)

    bodies = (body("a", None, 0.0, 0.0), body("b", "a", LENGTH, None), body("c", "b", LENGTH, LENGTH))
    actual = (FollowConstraint("same", "c_joint", "b_joint", 1.0),) if follow else ()
    return World("chain", bodies, Contact(excluded_bodies=exclude), constraints=actual)


def test_bodies_that_meet_when_all_joints_turn():
    # with both hinges at θ the end is at 0.4 (1 + 2 cos θ + ...) from the first ball: it comes back at 120°, a triangle
    world = chain(math.radians(130.0), follow=True)
    findings, sampling = sweep(world)
    found = [finding for finding in findings if finding.rule == "self-collision"]
    assert [finding.element for finding in found] == ["a and c"]
    # the closest sample of b alone: 16 positions over 130°, in steps of 8.67°, of which 121.3° is nearest to 120°
    angles = np.linspace(0.0, math.radians(130.0), module.ALONE)
    depth = max(2.0 * RADIUS - distance(angle) for angle in angles)
    assert found[0].value == pytest.approx(depth, abs=2e-4)
    assert found[0].positions["b_joint"] == pytest.approx(found[0].positions["c_joint"])
    assert sampling.joints == 2  # a, and b, which c follows
    assert sampling.positions == sampling.planned == 1 + 2 * module.ALONE + module.RANDOM


def distance(angle: float) -> float:
    """From the first ball to the third with both hinges at an angle (rad)."""
    x = LENGTH * (math.sin(angle) + math.sin(2.0 * angle))
    z = LENGTH * (1.0 + math.cos(angle) + math.cos(2.0 * angle))
    return math.hypot(x, z)


def test_nothing_within_ranges_that_end_before():
    findings, _ = sweep(chain(math.radians(100.0), follow=True))
    assert distance(math.radians(100.0)) > 2.0 * RADIUS
    assert [finding for finding in findings if finding.rule == "self-collision"] == []


def test_pairs_that_the_world_lets_pass_are_left_out():
    world = chain(math.radians(130.0), (("a", "b"), ("a", "c"), ("b", "c")), follow=True)
    assert sweep(world)[0] == []


def test_the_same_again():
    world = chain(math.radians(150.0))
    first, again = sweep(world), sweep(chain(math.radians(150.0)))
    assert first == again
    assert first[0]


def test_a_search_that_is_cut_short_says_so(monkeypatch):
    monkeypatch.setattr(module, "WORK", 50_000)
    findings, sampling = sweep(chain(math.radians(150.0)))
    assert 0 < sampling.positions < sampling.planned
    assert sampling.cut_short
    assert all(f"of {sampling.positions} positions" in finding.message for finding in findings)


def test_a_slide_without_an_end_and_a_loop_are_not_moved():
    from dataclasses import replace

    from simspec.world.types import ConnectConstraint

    world = chain(math.radians(150.0))
    slide = replace(world.bodies[2].joint, kind="slide", position_limits=None)
    _, sampling = sweep(replace(world, bodies=(*world.bodies[:2], replace(world.bodies[2], joint=slide))))
    assert sampling.left_out == {"c_joint": "a slide without limits"}
    loop = ConnectConstraint("closed", "a", "c", (0.0, 0.0, 0.0), (0.0, 0.0, LENGTH))
    _, sampling = sweep(replace(world, constraints=(loop,)))
    assert set(sampling.left_out) == {"b_joint", "c_joint"}


@given(lower=st.floats(-20.0, 0.0), upper=st.floats(0.0, 20.0), limited=st.booleans())
@settings(max_examples=40, deadline=None)
def test_ranges_lie_within_limits(lower, upper, limited):
    joint = Joint("j", "hinge", position_limits=(lower, upper) if limited else None, position=(0.0,))
    span = range_of(joint)
    assert span is not None
    assert span[1] - span[0] <= 2.0 * math.pi + 1e-12
    if limited and upper - lower <= 2.0 * math.pi:
        assert span == (lower, upper)
    if span[1] > span[0]:
        samples = positions([joint], {"j": span}, [], {})
        assert samples.values["j"].min() >= span[0] - 1e-12
        assert samples.values["j"].max() <= span[1] + 1e-12
        assert samples.values["j"][0] == 0.0


@pytest.mark.parametrize("language", LANGUAGES)
def test_planted_self_collision(tmp_path, language):
    """The tip folds back onto the base, two joints away; with a smaller range it does not reach it."""
    folded = {"tip_lower": "-3.1", "tip_upper": "3.1", "tip_box": "0.05 0.05 0.44", "tip_place": "0 0 0.22"}
    found = of_rule(examined(LANGUAGES[language](**folded), language, tmp_path), "self-collision")
    assert [finding.element for finding in found] == ["base and tip"]
    assert found[0].location is not None
    assert abs(found[0].positions["elbow"]) > 2.5
    shorter = {**folded, "tip_lower": "-1.5", "tip_upper": "1.5"}
    assert not of_rule(examined(LANGUAGES[language](**shorter), language, tmp_path), "self-collision")


@given(
    turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    place=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    kinds=st.tuples(*[st.sampled_from(["box", "cylinder", "capsule", "sphere", "ellipsoid"])] * 2),
)
@example(turn=(0.125, 2.5, 0.625), place=(0.125, 0.0, 0.0), kinds=("cylinder", "cylinder"))
@example(turn=(-2.875, 0.99380919, 0.0), place=(-0.25, 0.25, -0.05144734), kinds=("box", "capsule"))  # a gap
@settings(max_examples=60, deadline=None)
def test_depths_equal_those_of_the_search_of_the_world(turn, place, kinds):
    """The depths of many positions at once agree with the search for single pairs."""
    from simspec.world.frames import from_rpy

    sizes = {"box": (0.2, 0.3, 0.4), "cylinder": (0.1, 0.3), "capsule": (0.1, 0.2), "sphere": (0.15,)}
    sizes["ellipsoid"] = (0.1, 0.15, 0.2)
    joint = Joint("j", "fixed")
    pose = Pose(place, from_rpy(*turn))
    bodies = tuple(
        Body(name, name, Inertial(1.0), joint, (Shape(f"{name}_s", kind, sizes[kind], at, "m"),))
        for name, kind, at in zip("ab", kinds, (Pose(), pose), strict=True)
    )
    world = World("two", bodies)
    lumps = lumps_of(world)
    lump, other = lumps["a"][0], lumps["b"][0]
    tree = module.SweptTree(world, bodies, {})
    depth = tree._depths(lump, other, other.centre[None] - lump.centre, other.axes[None], 0.0)
    expected = max(-separation(lump, other), 0.0)
    # both searches give upper bounds of the depth; the coarser one stops within 1.1° of the best direction, and was at most
    # 0.2 mm off in 2,500 random cases
    assert depth[0] == pytest.approx(expected, abs=1e-3)
