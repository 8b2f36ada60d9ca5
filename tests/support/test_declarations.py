"""Declarations are total, say why, and combine to the weaker of dialect and engine, in every world."""

from __future__ import annotations

import pytest

from simspec.dialects.kit.contract import dialects
from simspec.engines.kit.registry import engines
from simspec.language.vocabulary import SHAPE_KINDS
from simspec.support.declarations import (
    EXACT,
    Absence,
    Attempt,
    Level,
    Refinement,
    Support,
    approximate,
    check_total,
    combine,
    never,
    not_yet,
    outside,
    shape_kinds,
    unsupported_if,
    via_api,
)
from simspec.support.features import Feature
from tests import worlds

TABLE = dict.fromkeys(Feature, EXACT)
WORLD = worlds.damped_springs()


def test_every_dialect_and_engine_declares_every_feature_and_says_why():
    for owner in (*dialects().values(), *engines().values()):
        check_total(owner.NAME, owner.SUPPORT)
        for feature, support in owner.SUPPORT.items():
            assert support.how or support.level is Level.EXACT, f"{owner.NAME}: {feature} says nothing"


def test_a_missing_declaration_is_an_error_when_the_class_is_made():
    with pytest.raises(TypeError, match=r"joint\.armature"):
        check_total("x", {feature: EXACT for feature in Feature if feature is not Feature.ARMATURE})


def test_the_weaker_of_dialect_and_engine_holds():
    file = TABLE | {Feature.DAMPING: via_api("in a sidecar"), Feature.SPRING: never("no")}
    engine = TABLE | {Feature.DAMPING: approximate("soft"), Feature.SPRING: via_api("set")}
    both = combine(file, engine)
    assert both[Feature.DAMPING].level is Level.APPROXIMATE
    assert both[Feature.SPRING].level is Level.UNSUPPORTED
    assert both[Feature.ARMATURE].level is Level.EXACT


def test_at_equal_levels_both_texts_are_kept_and_a_single_absence_reason():
    file = TABLE | {Feature.DAMPING: via_api("in a sidecar"), Feature.SPRING: never("no"), Feature.GRAVITY: EXACT}
    engine = TABLE | {
        Feature.DAMPING: via_api("by a call"),
        Feature.SPRING: never("not at all"),
        Feature.GRAVITY: Support(Level.EXACT, "any direction"),
    }
    both = combine(file, engine)
    assert both[Feature.DAMPING].how == "in a sidecar; by a call"
    assert both[Feature.SPRING].how == "no"
    assert both[Feature.GRAVITY].how == "any direction"
    assert combine(file, file)[Feature.DAMPING].how == "in a sidecar"


def test_never_outweighs_not_yet():
    later = not_yet("not written", Attempt.CONTACT_PROBES)
    for file, engine in ((later, never("no such thing")), (never("no such thing"), later)):
        both = combine(TABLE | {Feature.SPRING: file}, TABLE | {Feature.SPRING: engine})[Feature.SPRING]
        assert (both.absence, both.how, both.attempt) == (Absence.NEVER, "no such thing", None)
    both = combine(TABLE | {Feature.SPRING: later}, TABLE | {Feature.SPRING: via_api("set")})[Feature.SPRING]
    assert (both.absence, both.attempt) == (Absence.NOT_YET, Attempt.CONTACT_PROBES)


@pytest.mark.parametrize(
    "wrong",
    [
        {"level": Level.UNSUPPORTED},
        {"level": Level.EXACT, "absence": Absence.NEVER},
        {"level": Level.UNSUPPORTED, "absence": Absence.NOT_YET},
        {"level": Level.UNSUPPORTED, "absence": Absence.NEVER, "attempt": Attempt.CONTACT_PROBES},
        {"level": Level.UNSUPPORTED, "absence": Absence.NEVER, "since": "3.1"},
        {"level": Level.EXACT, "since": "soon"},
        {"level": Level.EXACT, "since": "3.10", "until": "3.9"},
        {"level": Level.EXACT, "since": "3", "until": "3.0"},
    ],
    ids=str,
)
def test_declarations_that_contradict_themselves_are_errors(wrong):
    with pytest.raises(ValueError, match=r"version|unsupported|not built|bounds|release"):
        Support(**wrong)


def test_a_refinement_replaces_the_features_that_it_names():
    soft = approximate("soft", lambda world: Refinement(Level.VIA_API, f"not in {world.name}"), "a short one")
    there = soft.in_world(WORLD)
    assert (there.level, there.how, there.short, there.refine) == (Level.VIA_API, f"not in {WORLD.name}", "", None)
    noted = approximate("soft", lambda world: Refinement(note="mind the gap"), "a short one").in_world(WORLD)
    assert (noted.level, noted.how, noted.short) == (Level.APPROXIMATE, "soft; mind the gap", "a short one")
    refused = via_api("set", lambda world: unsupported_if("too large")).in_world(WORLD)
    assert (refused.level, refused.absence, refused.how) == (Level.UNSUPPORTED, Absence.NEVER, "too large")
    assert via_api("set", lambda world: unsupported_if(None)).in_world(WORLD) == via_api("set")


@pytest.mark.parametrize("swapped", [False, True])
def test_a_refinement_of_either_side_applies_under_any_declaration_of_the_other(swapped):
    """A dialect's "not in this world" must not be lost because the engine's declaration is the weaker one."""
    refusing = Support(Level.EXACT, refine=lambda world: unsupported_if("too many"))
    other = approximate("soft", lambda world: Refinement(Level.VIA_API, "nothing shows it"))
    pair = (other, refusing) if swapped else (refusing, other)
    tables = [TABLE | {Feature.SPRING: support} for support in pair]
    both = combine(*tables)[Feature.SPRING]
    assert both.level is Level.APPROXIMATE
    assert (both.in_world(WORLD).level, both.in_world(WORLD).how) == (Level.UNSUPPORTED, "too many")


def test_an_engine_that_is_exact_in_a_world_is_as_good_as_its_dialect_there():
    file = TABLE | {Feature.SPRING: outside("a force of simspec's")}
    engine = TABLE | {Feature.SPRING: approximate("soft", lambda world: Refinement(Level.EXACT, "hard"))}
    both = combine(file, engine)[Feature.SPRING]
    assert both.level is Level.APPROXIMATE
    there = both.in_world(WORLD)
    assert (there.level, there.how, there.requested) == (Level.OUTSIDE, "a force of simspec's", False)


def test_cases_estimate_the_cost_of_a_level():
    case = Refinement(Level.OUTSIDE, "by a loop", "a loop around the solver", requested=True)
    soft = approximate("soft", lambda world: case, "soft springs", cases=(case,))
    both = combine(TABLE, TABLE | {Feature.SPRING: soft})[Feature.SPRING]
    assert both.brief(Level.APPROXIMATE) == "soft springs"
    assert both.brief(Level.OUTSIDE) == "a loop around the solver"
    assert both.in_world(WORLD).requested


def test_bounds_of_both_sides_hold():
    file = TABLE | {Feature.SPRING: Support(Level.EXACT, since="3.9")}
    engine = TABLE | {Feature.SPRING: Support(Level.VIA_API, "set", since="3.10", until="5")}
    both = combine(file, engine)[Feature.SPRING]
    assert (both.level, both.since, both.until) == (Level.VIA_API, "3.10", "5")
    assert both.at_version("Engine", None) is both
    assert both.at_version("Engine", "4.0.1") is both
    for version, said in (("3.9.2", "from version 3.10 on, and 3.9.2"), ("5.0", "before version 5, and 5.0")):
        late = both.at_version("Engine", version)
        assert late.level is Level.UNSUPPORTED
        assert said in late.how
    none = combine(file, TABLE | {Feature.SPRING: never("no")})[Feature.SPRING]
    assert (none.since, none.until) == ("", "")


def test_a_kind_of_shape_that_a_table_lacks_is_refused_by_name():
    rows = shape_kinds("Engine", ("sphere", "plane"))
    assert {feature.value for feature in rows} == {f"shape.{kind}" for kind in SHAPE_KINDS}
    assert rows[Feature.SHAPE_SPHERE] is EXACT
    assert (rows[Feature.SHAPE_BOX].absence, rows[Feature.SHAPE_BOX].how) == (Absence.NEVER, "Engine has no box")
