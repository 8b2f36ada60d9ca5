"""Negotiation finds everything, and approximates only what was accepted by name."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.errors import Location, UnsupportedError
from simspec.support.declarations import (
    EXACT,
    Attempt,
    Level,
    Refinement,
    Support,
    approximate,
    combine,
    never,
    not_yet,
    outside,
    unsupported_if,
)
from simspec.support.features import Feature
from simspec.support.negotiation import negotiate
from tests import worlds

TABLE = dict.fromkeys(Feature, EXACT)


def test_exact_engines_need_no_acceptance_of_approximations_elsewhere():
    world = worlds.damped_springs()
    requested = []

    def reason(given):
        requested.append(given)
        return Refinement(Level.VIA_API, "nothing here shows it") if len(requested) == 1 else None

    table = TABLE | {Feature.DAMPING: approximate("soft", reason)}
    found = {decision.feature: decision for decision in negotiate(world, "engine", table)}
    assert (found[Feature.DAMPING].level, found[Feature.DAMPING].how) == (Level.VIA_API, "nothing here shows it")
    with pytest.raises(UnsupportedError, match="only approximately: soft"):
        negotiate(world, "engine", table)
    accepting = worlds.with_options(world, "engine", accept=(Feature.DAMPING.value,))
    found = {decision.feature: decision for decision in negotiate(accepting, "engine", table)}
    assert (found[Feature.DAMPING].level, found[Feature.DAMPING].how) == (Level.APPROXIMATE, "soft")
    assert requested == [world, world, accepting]


def test_all_problems_come_at_once_with_their_places():
    world = worlds.damped_springs()
    table = TABLE | {
        Feature.DAMPING: never("no damper"),
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


def test_accepted_and_requested_features_are_decided():
    table = TABLE | {Feature.SPRING: approximate("soft"), Feature.BALL_SPRING: outside("at each step")}
    world = worlds.with_options(
        worlds.damped_springs(), "engine", accept=("joint.spring",), outside=("joint.ball.spring",)
    )
    levels = {decision.feature: decision.level for decision in negotiate(world, "engine", table)}
    assert levels[Feature.SPRING] is Level.APPROXIMATE
    assert levels[Feature.BALL_SPRING] is Level.OUTSIDE


def test_outside_is_refused_where_it_would_not_be_exact():
    table = TABLE | {
        Feature.SPRING: outside("at each step", lambda world: unsupported_if(f"{world.name} may touch something"))
    }
    world = worlds.with_options(worlds.damped_springs(), "engine", outside=("joint.spring",))
    with pytest.raises(UnsupportedError, match="damped-springs may touch something"):
        negotiate(world, "engine", table)


def test_features_requested_by_a_setting_need_no_name_and_others_do():
    world = worlds.damped_springs()
    refinement = Refinement(Level.OUTSIDE, "a loop", requested=True)
    table = TABLE | {Feature.SPRING: approximate("soft", lambda world: refinement)}
    levels = {decision.feature: decision.level for decision in negotiate(world, "engine", table)}
    assert levels[Feature.SPRING] is Level.OUTSIDE
    table = TABLE | {
        Feature.SPRING: approximate("soft", lambda world: dataclasses.replace(refinement, requested=False))
    }
    with pytest.raises(UnsupportedError, match=r"outside the engine: a loop"):
        negotiate(world, "engine", table)


def test_messages_name_the_engine_as_its_makers_write_it_and_the_key_by_its_name():
    table = TABLE | {
        Feature.SPRING: never("no springs"),
        Feature.BALL_SPRING: not_yet("not written", Attempt.CONTACT_PROBES),
    }
    with pytest.raises(UnsupportedError) as caught:
        negotiate(worlds.damped_springs(), "engine", table, title="Engine")
    messages = [problem.message for problem in caught.value.problems]
    assert any(message.startswith("Engine does not support joint.spring: no springs") for message in messages)
    assert any(message.startswith("Engine does not support joint.ball.spring yet: not written") for message in messages)
    assert all(problem.hint.endswith("--engine engine") for problem in caught.value.problems)


def test_a_release_that_has_it_not_yet_is_refused_with_both_versions():
    world = worlds.damped_springs()
    table = TABLE | {Feature.SPRING: Support(Level.EXACT, since="3.8")}
    for version in (None, "3.8", "3.8.1", "4"):
        negotiate(world, "engine", table, version=version)
    with pytest.raises(
        UnsupportedError, match=r"joint\.spring: engine has it from version 3\.8 on, and 3\.7\.9 is at work"
    ):
        negotiate(world, "engine", table, version="3.7.9")


def test_an_earlier_release_may_have_a_feature_approximately():
    world = worlds.damped_springs()
    of_all = Support(
        Level.EXACT, "whole", since="3.4", before=lambda world: Refinement(Level.APPROXIMATE, "half", "1/2")
    )
    table = TABLE | {Feature.DAMPING: of_all}
    for version in (None, "3.4", "4.0"):
        found = {decision.feature: decision for decision in negotiate(world, "engine", table, version=version)}
        assert (found[Feature.DAMPING].level, found[Feature.DAMPING].how) == (Level.EXACT, "whole")
    with pytest.raises(UnsupportedError, match="only approximately: half") as caught:
        negotiate(world, "engine", table, version="3.3.7")
    assert "accept: [joint.damping]" in caught.value.problems[0].hint
    accepting = worlds.with_options(world, "engine", accept=(Feature.DAMPING.value,))
    found = {decision.feature: decision for decision in negotiate(accepting, "engine", table, version="3.3.7")}
    assert (found[Feature.DAMPING].level, found[Feature.DAMPING].short) == (Level.APPROXIMATE, "1/2")
    # in worlds that it says nothing of, earlier releases have it as it is declared
    table = TABLE | {Feature.DAMPING: Support(Level.EXACT, "whole", since="3.4", before=lambda world: None)}
    found = {decision.feature: decision for decision in negotiate(world, "engine", table, version="3.3.7")}
    assert found[Feature.DAMPING].level is Level.EXACT
    # a version that begins with no number is known to have nothing
    with pytest.raises(UnsupportedError, match=r"has it from 3\.4 on"):
        negotiate(world, "engine", table, version="main")


def test_support_in_earlier_releases_is_declared_for_files_and_engines():
    world = worlds.damped_springs()

    def half(world):
        return Refinement(Level.APPROXIMATE, "half")

    def level(file: Support, engine: Support, version: str) -> Level:
        both = combine(TABLE | {Feature.DAMPING: file}, TABLE | {Feature.DAMPING: engine})[Feature.DAMPING]
        return both.at_version("Engine", version).in_world(world).level

    bounded = Support(Level.EXACT, since="3.4", before=half)
    for support, other in ((EXACT, bounded), (bounded, EXACT), (bounded, bounded)):
        assert level(support, other, "3.3") is Level.APPROXIMATE
        assert level(support, other, "3.4") is Level.EXACT
    # the other one says that earlier releases do not have it
    for since in ("3.4", "3.2", "3.8"):
        for pair in ((Support(Level.EXACT, since=since), bounded), (bounded, Support(Level.EXACT, since=since))):
            assert level(*pair, "3.1") is Level.UNSUPPORTED
    # a feature refined by both has the weaker of the two levels
    refused = Support(Level.EXACT, refine=lambda world: unsupported_if("never here"))
    assert level(refused, bounded, "3.3") is Level.UNSUPPORTED
    with pytest.raises(ValueError, match="since"):
        Support(Level.EXACT, before=half)
