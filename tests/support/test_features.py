"""Declarations are total; negotiation finds everything, and approximates only what was accepted by name."""

from __future__ import annotations

import pytest

from simspec.dialects.kit.contract import dialects
from simspec.engines.kit.registry import engines
from simspec.errors import Location, UnsupportedError
from simspec.support.declarations import (
    EXACT,
    Level,
    Support,
    approximate,
    check_total,
    combine,
    outside,
    unsupported,
    via_api,
)
from simspec.support.features import MEANING, Feature
from simspec.support.needs import needs
from simspec.support.negotiation import negotiate
from tests import worlds

TABLE = dict.fromkeys(Feature, EXACT)


def test_every_format_and_engine_declares_every_feature_and_says_why():
    for owner in (*dialects().values(), *engines().values()):
        check_total(owner.NAME, owner.SUPPORT)
        for feature, support in owner.SUPPORT.items():
            assert support.how or support.level is Level.EXACT, f"{owner.NAME}: {feature} says nothing"


def test_every_feature_has_a_meaning():
    assert set(MEANING) == set(Feature)


def test_a_missing_declaration_is_an_error_when_the_class_is_made():
    with pytest.raises(TypeError, match=r"joint\.armature"):
        check_total("x", {feature: EXACT for feature in Feature if feature is not Feature.ARMATURE})


def test_the_weaker_of_format_and_engine_holds():
    file = TABLE | {Feature.DAMPING: via_api("beside"), Feature.SPRING: unsupported("no")}
    engine = TABLE | {Feature.DAMPING: approximate("soft"), Feature.SPRING: via_api("set")}
    both = combine(file, engine)
    assert both[Feature.DAMPING].level is Level.APPROXIMATE
    assert both[Feature.SPRING].level is Level.UNSUPPORTED
    assert both[Feature.ARMATURE].level is Level.EXACT


def test_of_one_level_both_texts_are_kept_but_for_one_reason_why_not():
    file = TABLE | {Feature.DAMPING: via_api("beside"), Feature.SPRING: unsupported("no"), Feature.GRAVITY: EXACT}
    engine = TABLE | {
        Feature.DAMPING: via_api("by a call"),
        Feature.SPRING: unsupported("not at all"),
        Feature.GRAVITY: Support(Level.EXACT, "any direction"),
    }
    both = combine(file, engine)
    assert both[Feature.DAMPING].how == "beside; by a call"
    assert both[Feature.SPRING].how == "no"
    assert both[Feature.GRAVITY].how == "any direction"
    assert combine(file, file)[Feature.DAMPING].how == "beside"


def test_what_is_approximate_elsewhere_needs_no_acceptance_where_it_is_exact():
    world = worlds.damped_springs()
    asked = []

    def reason(given):
        asked.append(given)
        return "nothing here shows it" if len(asked) == 1 else None

    table = TABLE | {Feature.DAMPING: approximate("soft", exact_if=reason)}
    found = {one.feature: one for one in negotiate(world, "engine", table)}
    assert (found[Feature.DAMPING].level, found[Feature.DAMPING].how) == (Level.VIA_API, "nothing here shows it")
    with pytest.raises(UnsupportedError, match="only approximately: soft"):
        negotiate(world, "engine", table)
    accepting = worlds.with_options(world, "engine", accept=(Feature.DAMPING.value,))
    found = {one.feature: one for one in negotiate(accepting, "engine", table)}
    assert (found[Feature.DAMPING].level, found[Feature.DAMPING].how) == (Level.APPROXIMATE, "soft")
    assert asked == [world, world, accepting]


def test_all_problems_come_at_once_with_their_places():
    world = worlds.damped_springs()
    table = TABLE | {
        Feature.DAMPING: unsupported("no damper"),
        Feature.SPRING: approximate("a soft one"),
        Feature.BALL_SPRING: outside("at each step"),
    }
    with pytest.raises(UnsupportedError) as caught:
        negotiate(world, "engine", table, lambda path: Location("robot.yaml", 3, 5))
    text = str(caught.value)
    assert len(caught.value.problems) == 3
    assert caught.value.exit_code == 2
    for part in (
        "no damper",
        "accept: [joint.spring]",
        "outside: [joint.ball.spring]",
        "robot.yaml:3:5",
        "bodies.link1",
    ):
        assert part in text


def test_what_was_accepted_or_asked_for_by_name_is_decided():
    table = TABLE | {Feature.SPRING: approximate("soft"), Feature.BALL_SPRING: outside("at each step")}
    world = worlds.with_options(
        worlds.damped_springs(), "engine", accept=("joint.spring",), outside=("joint.ball.spring",)
    )
    levels = {decision.feature: decision.level for decision in negotiate(world, "engine", table)}
    assert levels[Feature.SPRING] is Level.APPROXIMATE
    assert levels[Feature.BALL_SPRING] is Level.OUTSIDE


def test_outside_is_refused_where_it_would_not_be_exact():
    table = TABLE | {Feature.SPRING: outside("at each step", lambda world: f"{world.name} may touch something")}
    world = worlds.with_options(worlds.damped_springs(), "engine", outside=("joint.spring",))
    with pytest.raises(UnsupportedError, match="damped-springs may touch something"):
        negotiate(world, "engine", table)


def test_needs_name_the_places():
    found = {need.feature: need.paths for need in needs(worlds.gripper())}
    assert found[Feature.COLLISION_GROUPS] == ("contact.groups",)
    assert found[Feature.EXCLUDED_PAIRS] == ("contact.exclude",)
    assert Feature.DAMPING not in found
    assert found[Feature.JOINT_SLIDE] == ("bodies.palm.joint", "bodies.left.joint", "bodies.right.joint")


def test_long_chains_and_large_trees_are_features():
    world = worlds.world(worlds.tree(["fixed"] + ["hinge"] * 401, 1))
    found = {need.feature: need.paths for need in needs(world)}
    assert found[Feature.TREE_SIZE] == ("bodies.link0",)
    assert found[Feature.TREE_DEPTH] == ("bodies.link400",)
