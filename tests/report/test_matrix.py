"""The support matrix shows the kinds of declarations."""

from __future__ import annotations

import json

import pytest

from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.registry import find_engine
from simspec.report.matrix import Notes, engine_data, markdown, tier, word
from simspec.support.declarations import Absence, Attempt, Level, Support, never, not_yet


def test_a_word_for_every_kind():
    assert word(never("no such thing")) == "no"
    assert word(not_yet("not written yet", Attempt.READ_BACK)) == "not yet"
    assert word(Support(Level.EXACT, since="3.8")) == "exact, from 3.8"
    assert word(Support(Level.APPROXIMATE, "soft", since="3.8", until="5")) == "approximate, from 3.8, before 5"


def test_data_say_which_kind_of_absence():
    tables = [engine["support"] for engine in json.loads(json.dumps(engine_data())).values()]
    absent = [entry for table in tables for entry in table.values() if entry["level"] == "unsupported"]
    assert {entry["absence"] for entry in absent} == {absence.value for absence in Absence}
    assert not any("absence" in entry for table in tables for entry in table.values() if entry not in absent)


def test_a_reason_is_a_single_note_for_all_its_engines_and_features():
    notes = Notes()
    assert notes.mark("soft", "a", "joint.hinge") == " [1]"
    assert notes.mark("", "a", "joint.free") == ""
    assert notes.mark("not written", "a", "joint.ball") == " [2]"
    assert notes.mark("soft", "b", "joint.slide") == notes.mark("soft", "b", "joint.hinge") == " [1]"
    assert notes.lines(anchors=True)[0] == (
        '1. <a id="a-joint-hinge"></a><a id="b-joint-slide"></a><a id="b-joint-hinge"></a>soft '
        "(a: `joint.hinge`; b: `joint.slide`, `joint.hinge`)"
    )
    assert len(notes.lines()) == 2


def test_no_reason_of_the_page_is_printed_twice():
    page = markdown()
    reasons = [
        line.rsplit(" (", 1)[0].split("</a>")[-1] for line in page.splitlines() if line.partition(".")[0].isdigit()
    ]
    assert len(reasons) > 100
    assert len(set(reasons)) == len(reasons)


@pytest.mark.parametrize(
    ("lacks", "files", "expected"),
    [
        ((), "", "complete"),
        ((Capability.CONTACT_OFF,), "", "complete"),
        ((Capability.INVENTORY,), "", "proven"),
        ((Capability.MASS_MATRIX, Capability.INVENTORY), "", "runs"),
        ((), "not installed", "files only"),
    ],
)
def test_the_tier_follows_from_the_declared_capabilities(lacks, files, expected):
    engine = type("Some", (find_engine("mujoco"),), {"LACKS": dict.fromkeys(lacks, "why"), "FILES_ALONE": files})
    assert tier(engine) == expected
