"""The support matrix shows the kinds of declarations."""

from __future__ import annotations

import json

from simspec.report.matrix import engine_data, word
from simspec.support.declarations import Absence, Attempt, Level, Support, never, not_yet


def test_a_word_for_every_kind():
    assert word(never("no such thing")) == "no"
    assert word(not_yet("nobody wrote it", Attempt.READ_BACK)) == "not yet"
    assert word(Support(Level.EXACT, since="3.8")) == "exact, from 3.8"
    assert word(Support(Level.APPROXIMATE, "soft", since="3.8", until="5")) == "approximate, from 3.8, before 5"


def test_data_say_which_kind_of_absence():
    tables = [engine["support"] for engine in json.loads(json.dumps(engine_data())).values()]
    absent = [entry for table in tables for entry in table.values() if entry["level"] == "unsupported"]
    assert {entry["absence"] for entry in absent} == {absence.value for absence in Absence}
    assert not any("absence" in entry for table in tables for entry in table.values() if entry not in absent)
