"""Plots and sentences of a study, from the figures of its tables."""

from __future__ import annotations

import json

import pytest

from simspec.errors import SpecError
from simspec.report.study.sentences import charts, said_of
from simspec.stored import StudyTables
from tests.report.page import study_samples as samples


def made():
    return {chart["title"].partition(": ")[2]: chart for chart in charts(samples.study_tables())}


def test_every_figure_is_in_a_plot():
    speed = made()["Simulated time over the processor time of the steps"]
    by_label = {series["label"]: series for series in speed["series"]}
    assert list(by_label) == ["first", "second", "FIRST (elsewhere)", "Third (elsewhere)"]
    assert [mark["x"] for mark in by_label["first"]["marks"]] == [1.0, 2.0, 4.0, 8.0]
    mark = by_label["first"]["marks"][1]
    assert (mark["value"], mark["low"], mark["high"]) == pytest.approx((8.0, 7.2, 8.8))
    assert mark["values"] == pytest.approx([7.2, 8.0, 8.8])
    # an engine's figures from elsewhere have its colour, and are distinguished by their kind
    assert by_label["FIRST (elsewhere)"]["colour"] == by_label["first"]["colour"]
    assert by_label["FIRST (elsewhere)"]["kind"] == "elsewhere"
    assert by_label["Third (elsewhere)"]["colour"] not in (by_label["first"]["colour"], by_label["second"]["colour"])
    assert speed["logarithmic"]
    assert speed["x"]["logarithmic"]


def test_limits_of_validity_have_intervals_and_those_from_elsewhere():
    share = made()["Share of runs that do all that is expected"]
    assert [mark["value"] for mark in share["series"][0]["marks"]] == [1.0, 1.0, 1.0, 0.25]
    assert all(mark["low"] < mark["value"] for series in share["series"] for mark in series["marks"])
    assert [(limit["label"], limit["x"]) for limit in share["limits"]] == [("Third (elsewhere): 3 ms", 3.0)]


def test_speed_over_time_shares_its_time_axis_with_contacts():
    found = made()
    speed = found["Simulated time over processor time of the steps, timestep 1 ms"]
    contacts = found["Points of contact, mean, timestep 1 ms"]
    assert speed["group"] == contacts["group"] == "time"
    assert [mark["x"] for mark in contacts["series"][0]["marks"]] == [0.0, 0.5, 1.0, 1.5, 2.0]  # the last is an end
    assert [mark["value"] for mark in contacts["series"][0]["marks"]] == [0.0, 10.0, 20.0, 30.0, 30.0]


def test_unequal_models_are_named_as_such():
    assert [title for title in made() if "NOT EQUAL" in title] == [
        "Simulated time over processor time of the steps, NOT EQUAL: made-up"
    ]


def test_sentences_are_those_of_the_figures():
    said = {table.name: table.said for table in samples.study_tables().sweeps["made-up"]}
    assert said["speed.cpu_factor"] == [
        "At 1 ms, by processor time: first is 2 × as fast as second (fastest: 4 × real time). "
        "Elsewhere: Third is 3 × as fast as FIRST.",
        "At 8 ms, by processor time: first is 2 × as fast as second (fastest: 32 × real time).",
    ]
    assert said["validity"] == [
        "first: all that is expected holds up to 4 ms (10 of 10 runs); it fell.",
        "second: not valid at any timestep; it fell.",
    ]
    assert said["unequal.models.made-up"] == [
        "made-up, models that are NOT EQUAL, at 1 ms by processor time: second is 2 × as fast as first "
        "(fastest: 2 × real time)."
    ]
    assert said["over_time"][0] == (
        "first: slowest 2 × real time at 1.5 to 2 s, with 30 points of contact; "
        "fastest 8 × real time at 0 to 0.5 s, with 0 points of contact."
    )


def test_a_timestep_that_an_engine_lacks_has_no_order():
    records = [
        record for record in samples.speeds(("a", "b")) if not (record["engine"] == "b" and record["timestep"] == 0.001)
    ]
    assert said_of("speed.cpu_factor", records)[0].startswith("At 2 ms")
    assert said_of("speed.cpu_factor", []) == ()
    assert said_of("load", records) == ()


@pytest.mark.parametrize(
    "record",
    [
        {"timestep": 0.001},
        {"engine": "a", "quantity": "cpu_factor", "timestep": "much", "median": 1.0, "lower": 0.1, "upper": 2.0},
        {"engine": "a", "quantity": "cpu_factor", "timestep": None, "median": 1.0},
    ],
)
def test_figures_that_were_edited_are_an_error_that_names_the_table(record):
    plain = json.loads(samples.study_tables().model_dump_json(by_alias=True))
    plain["sweeps"]["made-up"][0]["records"].append(record)
    with pytest.raises(SpecError, match=r"the figures of made-up, speed\.cpu_factor"):
        charts(StudyTables.model_validate_json(json.dumps(plain)))
