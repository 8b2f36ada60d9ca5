"""The table of an engine's deviations: limits, reasons, and what the engines declare."""

from __future__ import annotations

from pathlib import Path

import pytest

from simspec.engines.kit import capabilities
from simspec.engines.kit.capabilities import BETWEEN_VALUES, COLUMNS, Reason, read_deviations
from simspec.engines.kit.registry import engines
from simspec.world.types import PairContact

FOLDER = Path(capabilities.__file__).resolve().parents[1]
ENGINES = sorted(path.parent.name for path in FOLDER.glob("*/contact_deviations.csv"))
LOCAL = "friction=native,elliptic,rod,0.5,0.9,,,1,4,2,10,0.0125,no"
PAIR = PairContact("base", "body", 0.5, 0.0)
WHY = Reason("*", "few steps")


def rows(tmp_path, lines, *reasons):
    table = tmp_path / "contact_deviations.csv"
    table.write_text(",".join(COLUMNS) + "\n" + "".join(f"{line}\n" for line in lines), encoding="utf-8")
    return read_deviations(table, reasons)


def sizes(rows, timestep, ratio=0.0, settings=None, cone="elliptic", pair=PAIR):
    return [row.size for row in rows if row.counts_for(pair, cone, timestep, settings or {}, ratio)]


def test_a_row_counts_from_its_timestep_on(tmp_path):
    found = rows(tmp_path, [",,rod,,,,,,,,,0.001,no", ",,rod,,,,,1.05,,,,0.004,no"], WHY)
    assert sizes(found, 0.0005) == sizes(found, 0.001) == [0.001]
    assert sizes(found, 0.00106) == sizes(found, 0.016) == [0.001, 0.004]
    assert not found[0].relative
    assert not found[0].is_local


def test_settings_cones_restitutions_and_ratios_are_conditions(tmp_path):
    lines = ["solver=quick,elliptic,stack,,,,,,,10.01,,0.001,no", ",,edge,,,0.01,,,,,,0.2,yes"]
    stack, edge = rows(tmp_path, lines, WHY)
    assert sizes([stack], 0.001, 11.0, {"solver": "quick"}) == [stack.size]
    assert not sizes([stack], 0.001, 10.0, {"solver": "quick"})
    assert not sizes([stack], 0.001, 11.0, {"solver": "step"})
    assert not sizes([stack], 0.001, 11.0, {"solver": "quick"}, "pyramid-inscribed")
    assert not sizes([edge], 0.001)
    assert sizes([edge], 0.001, pair=PairContact("base", "body", 0.5, 0.5)) == [edge.size]
    assert edge.relative


def test_a_switch_that_is_not_written_is_off(tmp_path):
    on, off = rows(tmp_path, ["warm=true,,rod,,,,,,,,,0.001,no", "warm=false,,rod,,,,,,,,,0.002,no"], WHY)
    for settings, counting in (({"warm": True}, on), ({"warm": False}, off), ({}, off)):
        assert sizes([on, off], 0.001, settings=settings) == [counting.size]


@pytest.mark.parametrize(
    ("friction", "timestep", "ratio", "cone", "mode", "counts"),
    [
        (0.5, 2e-3, 5.0, "elliptic", "native", True),
        (0.89, 1e-3, 2.0, "elliptic", "native", True),
        (0.49, 2e-3, 5.0, "elliptic", "native", False),
        (0.9, 2e-3, 5.0, "elliptic", "native", False),
        (0.5, 0.9e-3, 5.0, "elliptic", "native", False),
        (0.5, 4e-3, 5.0, "elliptic", "native", False),
        (0.5, 2e-3, 1.9, "elliptic", "native", False),
        (0.5, 2e-3, 10.0, "elliptic", "native", False),
        (0.5, 2e-3, 5.0, "pyramid-inscribed", "native", False),
        (0.5, 2e-3, 5.0, "elliptic", "coulomb", False),
    ],
)
def test_a_local_row_counts_between_its_limits(tmp_path, friction, timestep, ratio, cone, mode, counts):
    (row,) = rows(tmp_path, [LOCAL])
    assert row.counts_for(PairContact("a", "b", friction, 0.0), cone, timestep, {"friction": mode}, ratio) is counts
    assert row.is_local


def test_the_first_reason_that_covers_a_row_is_given(tmp_path):
    reasons = [Reason("stack*", "sweeps", "solver=quick"), Reason("stack*", "deep"), Reason("rod clamp", "leans")]
    probes = ["solver=quick,,stack", "solver=step,,stack-sideways", ",,clamp"]
    found = rows(tmp_path, [f"{probe},,,,,,,,,0.1,no" for probe in probes], *reasons)
    assert [row.why for row in found] == ["sweeps", "deep", "leans"]


def test_a_reason_of_materials_with_restitution_covers_their_rows_alone(tmp_path):
    reasons = [Reason("rod", "bounces", bounces=True), Reason("rod", "leans")]
    leans, bounces = rows(tmp_path, [",,rod,,,,,,,,,0.1,no", ",,rod,,,0.01,,,,,,0.2,no"], *reasons)
    assert (leans.why, bounces.why) == ("leans", "bounces")
    assert sizes([leans, bounces], 0.001) == [leans.size]
    assert sizes([leans, bounces], 0.001, pair=PairContact("a", "b", 0.5, 0.3)) == [leans.size, bounces.size]


def test_a_row_without_a_reason_and_a_reason_without_a_row_are_errors(tmp_path):
    rod = ",,rod,,,,,,,,,0.1,no"
    with pytest.raises(ValueError, match=r"no reason is given for rod"):
        rows(tmp_path, [rod], Reason("clamp", "leans"))
    with pytest.raises(ValueError, match="no row is of the reason for clamp"):
        rows(tmp_path, [rod], WHY, Reason("clamp", "leans"))
    with pytest.raises(ValueError, match="no row is of the reason for rod"):
        rows(tmp_path, [LOCAL], Reason("rod", "leans"))


def test_a_local_row_has_the_reason_of_its_probe_or_a_general_reason(tmp_path):
    everywhere = [",,jam,,,,,,,,,0.1,no", ",,rod,,,,,,,,,0.1,no"]
    local, *_ = rows(tmp_path, [LOCAL, *everywhere], Reason("jam*", "jams"), Reason("rod*", "leans"))
    assert (local.why, local.relative, local.size) == ("leans", False, 0.0125)
    local, _ = rows(tmp_path, [LOCAL, everywhere[0]], Reason("jam*", "jams"))
    assert local.why == BETWEEN_VALUES


@pytest.mark.parametrize("name", ENGINES)
def test_the_table_of_an_engine_is_of_figures_that_there_are(name):
    """Each local row counts for some value."""
    assert engines()[name].CONTACT_DEVIATIONS
    local = [row for row in engines()[name].CONTACT_DEVIATIONS if row.is_local]
    assert local or name == "newton", "its contact was not measured between the values of its table"
    for row in local:
        least = (row.friction, row.restitution, row.timestep, row.ratio)
        assert all(low < below for low, below in zip(least, row.below, strict=True)), row
        assert row.size > 0.0
    assert max((row.timestep for row in local), default=0.0) <= 0.02
