"""The first sentences of a study's page: few, each from the figures of its tables; the rest stands under the tables."""

from __future__ import annotations

import json
from typing import Any

import pytest

from simspec.errors import SpecError
from simspec.report.page.document import page
from simspec.report.study.pages import study_section
from simspec.report.study.sentences import limits, said_of, verdict
from simspec.report.study.speed import ranking
from simspec.stored import StudyTables
from tests.report.page import study_samples as samples

SWEEP = "made-up"


def changed(**records: Any) -> StudyTables:
    """The tables of the made-up study with some others: by name, with ``_`` in place of ``.``; None takes one away."""
    plain = json.loads(samples.study_tables().model_dump_json(by_alias=True))
    tables = {table["name"]: table for table in plain["sweeps"][SWEEP]}
    plain["bad"] = []
    for word, new in records.items():
        name = word.replace("__", ".")
        if new is None:
            del tables[name]
        else:
            tables[name] = {**tables["validity"], "name": name, "records": new}
    plain["sweeps"][SWEEP] = list(tables.values())
    return StudyTables.model_validate_json(json.dumps(plain))


def texts(tables: StudyTables) -> list[str]:
    return [sentence.text for sentence in verdict(tables)]


def missed(engine: str, value: float, limit: float | None = 0.001, failed: float = 0.0) -> list[dict[str, Any]]:
    first = 0.002 if limit else 0.001
    record = {"engine": engine, "limit": limit, "first_invalid": first, "runs": 6, "failure": "?", "later_valid": []}
    record |= {"missed": "no_penetration_deeper_than", "measured": value, "bound": 0.006, "unit": "m"}
    shares = [{"engine": engine, "timestep": 0.001, "share": 1.0, "runs": 3}] if limit else []
    return [record, *shares, {"engine": engine, "timestep": first, "share": failed, "runs": 3}]


def test_the_verdict_is_a_few_sentences_in_order():
    assert texts(changed()) == [
        "1 sweep, all done.",
        "made-up, equal models, by processor time: at 1 ms first is 2 × as fast as second; "
        "at 8 ms first is 2 × as fast as second.",
        "made-up, at 1 ms: with equal models first is 2 × as fast as second. Models that are NOT EQUAL change the order: "
        "made-up (second is 2 × as fast as first).",
        "made-up: first: all that is expected holds up to 4 ms (10 of 10 runs); it fell; "
        "second: not valid at any timestep; it fell.",
    ]


def test_problems_come_first():
    sentences = verdict(samples.study_tables())
    assert [(sentence.tone, sentence.text) for sentence in sentences[:2]] == [
        ("bad", "1 sweep, and something is wrong."),
        ("bad", "made-up: proof FAILED"),
    ]


def test_processor_time_is_reported_only_where_its_order_differs():
    same = samples.speeds(("first", "second"))
    other = samples.speeds(("second", "first"))
    assert "by wall time and by processor time" in texts(changed(speed__real_time_factor=same))[1]
    assert not any("by wall time:" in text for text in texts(changed(speed__real_time_factor=same)))
    sentences = texts(changed(speed__real_time_factor=other))
    assert [text for text in sentences if "equal models, by" in text] == [
        "made-up, equal models, by wall time: at 1 ms second is 2 × as fast as first; "
        "at 8 ms second is 2 × as fast as first.",
        "made-up, equal models, by processor time: at 1 ms first is 2 × as fast as second; "
        "at 8 ms first is 2 × as fast as second.",
    ]


def test_unequal_models_that_leave_the_order():
    sentences = texts(changed(**{"unequal__models__made-up": samples.comparison(("first", "second"), (9.0, 3.0))}))
    assert sentences[2].endswith("leave the order as it is: made-up (first is 3 × as fast as second).")


def test_engines_of_the_same_limit_share_a_sentence():
    records = missed("a", 0.00875) + missed("b", 0.00879) + missed("c", 0.0091, failed=1 / 3)
    assert limits(records) == [
        (
            "a and b",
            "all that is expected holds up to 1 ms (3 of 3 runs each); "
            "at 2 ms 3 of 3 runs each are not valid: overlap 8.75 mm to 8.79 mm, bound 6 mm",
        ),
        (
            "c",
            "all that is expected holds up to 1 ms (3 of 3 runs); "
            "at 2 ms 2 of 3 runs are not valid: overlap 9.1 mm, bound 6 mm",
        ),
    ]
    assert said_of("validity", missed("a", 0.00875, None)) == (
        "a: not valid at any timestep; at 1 ms 3 of 3 runs are not valid: overlap 8.75 mm, bound 6 mm.",
    )


@pytest.mark.parametrize(
    ("limit", "first_invalid", "proven", "words"),
    [
        (0.002, 0.004, False, "a and b up to 2 ms"),
        (0.002, None, True, "a and b up to at least 2 ms"),
        (None, 0.001, False, "a and b at no timestep"),
        (None, 0.001, None, "a and b not verified"),
    ],
)
def test_certified_timesteps_are_reported_with_valid_timesteps(limit, first_invalid, proven, words):
    limits = [{"engine": engine, "limit": limit, "first_invalid": first_invalid} for engine in "ab"]
    checks = [{"engine": engine, "timestep": 0.001, "proven": proven} for engine in "ab"]
    assert texts(changed(certified=limits, certified__checks=checks))[-1].endswith(f". Certified: {words}.")


def test_an_order_within_intervals_is_said_to_be():
    factors, near = {"a": 4.0, "b": 3.0, "c": 1.0}, {"a": (3.0, 5.0), "b": (2.0, 3.5), "c": (0.9, 1.1)}
    assert ranking(factors, near) == "a is 1.3 × as fast as b (intervals overlap), b 3 × as fast as c"
    assert ranking({"a": 1.0, "b": 1.0}) == "a is as fast as b"
    assert ranking({"a": 1.0, "b": 0.0}) == "a is ∞ × as fast as b"
    assert ranking({"a": 1.0}) == "a"
    assert ranking({}) == ""


def test_figures_that_were_edited_are_an_error():
    with pytest.raises(SpecError, match="the figures of made-up are damaged: KeyError"):
        verdict(changed(validity=[{"engine": "a", "limit": 0.001}]))


def test_the_page_has_the_name_of_the_study_its_description_and_sentences_under_their_tables():
    tables = samples.study_tables()
    tables = tables.model_copy(update={"study": "the-name", "description": "A description"})
    part = study_section(tables)
    playback = study_section(samples.study_tables(name="playback"))
    object.__setattr__(playback, "description", None)
    text = page([part, playback])
    assert "<title>the-name: simspec report</title>" in text
    assert "<h1>the-name</h1>\n<p>A description</p>" in text
    under = text[text.index("made-up: over_time</caption>") :]
    assert under.index("first: slowest 2 × real time") < under.index("made-up: unequal.equal</caption>")
    verdict_list = text[text.index('<ul class="verdict">') : text.index("</ul>")]
    assert "slowest" not in verdict_list
    assert verdict_list.count("<li") == 5
