"""Tables of sweeps that are known cell by cell."""

from __future__ import annotations

import statistics

import pytest

from simspec.analysis.tables import ResultTable, grouped, sweep_table
from simspec.experiments.index import RunRow
from simspec.experiments.plan import Cell


def cell(index: int, engine: str, step: str, repeat: int = 0) -> Cell:
    return Cell(
        index, engine, None, (("physics.timestep", step),), None, repeat, 0.0, None, f"{engine} {step} {repeat}"
    )


def row(seconds: float, failed: str | None = None) -> RunRow:
    about = ("key", "cell", "", "a world", "", "", "name", "first", "1.0", failed, 0.002, 500)
    return RunRow(
        *about, seconds, 0.5, None, 0.0, None, 0, "", 2, 3, 100, '{"energy at the end": 1.5, "spread": "inf"}'
    )


CELLS = [cell(0, "first", "2 ms"), cell(1, "second", "2 ms"), cell(2, "first", "2 ms", 1), cell(3, "first", "4 ms")]
DONE = {"first 2 ms 0": row(0.5), "first 2 ms 1": row(0.25), "second 2 ms 0": row(1.0, failed="it fell over")}


def test_every_cell_has_a_row():
    table = sweep_table(CELLS, DONE.get)
    assert len(table) == 4
    assert table["state"] == ["done", "failed", "done", "missing"]
    assert table["physics.timestep"] == ["2 ms", "2 ms", "2 ms", "4 ms"]
    assert table["real_time_factor"] == [2.0, 1.0, 4.0, None]
    assert table["cpu_factor"] == [2.0, 2.0, 2.0, None]
    assert table["end_to_end_factor"] == [None] * 4
    assert table["simulated"] == [1.0, 1.0, 1.0, None]
    assert table["energy at the end"] == [1.5, 1.5, 1.5, None]
    assert table["spread"] == [None] * 4  # not finite
    assert table["failed"][1] == "it fell over"


def test_groups():
    table = grouped(
        sweep_table(CELLS, DONE.get), ["engine", "physics.timestep"], ["real_time_factor"], statistics.median
    )
    assert list(table.rows()) == [
        {"engine": "first", "physics.timestep": "2 ms", "count": 2, "done": 2, "real_time_factor": 3.0},
        {"engine": "second", "physics.timestep": "2 ms", "count": 1, "done": 0, "real_time_factor": None},
        {"engine": "first", "physics.timestep": "4 ms", "count": 1, "done": 0, "real_time_factor": None},
    ]


def test_values_of_a_spec_that_are_lists_are_grouped():
    table = ResultTable({"a": [[1, 2], [1, 2], {"b": 1}], "x": [1.0, 2.0, 3.0]})
    assert [len(group) for group in table.groups("a").values()] == [2, 1]
    assert table.where(x=2.0)["a"] == [[1, 2]]


def test_an_arrow_table():
    columns = {"n": [1, None, 2.5], "words": ["a", None, "b"], "mixed": [1, "2 ms", None], "none": [None] * 3}
    arrow = ResultTable(columns).to_arrow()
    assert arrow.column("n").to_pylist() == [1.0, None, 2.5]
    assert arrow.column("words").to_pylist() == ["a", None, "b"]
    assert arrow.column("mixed").to_pylist() == ["1", "2 ms", None]
    assert arrow.column("none").to_pylist() == [None] * 3


def test_columns_have_equal_lengths():
    with pytest.raises(ValueError, match="lengths"):
        ResultTable({"a": [1], "b": []})
