"""Deviations between the values of an engine's other tables: each row counts around its own points alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from simspec.engines.kit import between
from simspec.engines.kit.coupled import Reason
from simspec.engines.kit.registry import engines
from simspec.world.types import PairContact

FOLDER = Path(between.__file__).resolve().parents[1]
ENGINES = sorted(path.parent.name for path in FOLDER.glob("*/between.csv"))
ROW = "friction=native,elliptic,rod,0.5,0.9,0,inf,1,4,2,10,0.01,no\n"


def rows(tmp_path, *reasons):
    table = tmp_path / "between.csv"
    table.write_text(",".join(between.KEYS) + "\n" + ROW, encoding="utf-8")
    return between.between(table, reasons)


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
def test_a_row_counts_between_its_limits(tmp_path, friction, timestep, ratio, cone, mode, counts):
    (row,) = rows(tmp_path)
    pair = PairContact("a", "b", friction, 0.0)
    assert row.counts_for(pair, cone, timestep, {"friction": mode}, ratio) is counts
    assert row.is_local


def test_a_row_has_the_reason_of_its_probe_and_a_margin(tmp_path):
    (row,) = rows(tmp_path, Reason("jam*", "jams"), Reason("rod*", "leans"))
    assert (row.why, row.relative, row.size) == ("leans", False, pytest.approx(0.01 * between.MARGIN))
    (row,) = rows(tmp_path, Reason("jam*", "jams"))
    assert row.why == between.ELSEWHERE


@pytest.mark.parametrize("name", ENGINES)
def test_the_table_of_an_engine_is_of_figures_that_there_are(name):
    """Each row counts for some value, and is of a figure that a probe of the proof has."""
    local = [row for row in engines()[name].CONTACT_DEVIATIONS if row.is_local]
    assert local
    for row in local:
        least = (row.friction, row.restitution, row.timestep, row.ratio)
        assert all(low < below for low, below in zip(least, row.below, strict=True)), row
        assert row.size > 0.0
    assert max(row.timestep for row in local) <= 0.02
