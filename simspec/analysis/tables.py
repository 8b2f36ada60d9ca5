"""Results of a sweep as a tidy table: a row for each run, a column for each axis and each figure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from simspec.runner.run import factor

if TYPE_CHECKING:
    import pyarrow as pa

PLACE = ("index", "engine", "case", "sample", "perturb", "seed", "repeat")
"""Columns that say which cell of the plan a row is of; those of the overrides follow, by their paths."""
STATE = ("state", "failed", "passed", "expected", "engine_version", "world", "timestep", "simulated")
"""Columns that say what became of it. ``state``: done, failed, or missing (not run yet); ``simulated``: s."""
FACTORS = {"real_time_factor": "step_seconds", "cpu_factor": "cpu_seconds", "end_to_end_factor": "process_seconds"}
"""Columns of speed, and the seconds that each is of (:mod:`simspec.analysis.speed`)."""


class AskedCell(Protocol):
    """What a table needs of a cell of a plan (``experiments/plan.py``)."""

    @property
    def index(self) -> int: ...
    @property
    def engine(self) -> str: ...
    @property
    def case(self) -> str | None: ...
    @property
    def overrides(self) -> tuple[tuple[str, Any], ...]: ...
    @property
    def sample(self) -> int | None: ...
    @property
    def repeat(self) -> int: ...
    @property
    def perturb(self) -> float: ...
    @property
    def seed(self) -> int | None: ...
    @property
    def key(self) -> str: ...


class StoredRow(Protocol):
    """What a table needs of a row of a store's index (``experiments/index.py``)."""

    @property
    def engine_version(self) -> str: ...
    @property
    def world(self) -> str: ...
    @property
    def failed(self) -> str | None: ...
    @property
    def timestep(self) -> float: ...
    @property
    def steps(self) -> int: ...
    @property
    def step_seconds(self) -> float | None: ...
    @property
    def cpu_seconds(self) -> float | None: ...
    @property
    def process_seconds(self) -> float | None: ...
    @property
    def passed(self) -> int: ...
    @property
    def expected(self) -> int: ...
    @property
    def quantities(self) -> dict[str, float]: ...


@dataclass(frozen=True)
class ResultTable:
    """Columns of one length by name; None where there is no value."""

    columns: Mapping[str, Sequence[Any]]

    def __post_init__(self) -> None:
        lengths = {len(values) for values in self.columns.values()}
        if len(lengths) > 1:
            raise ValueError(f"columns of several lengths: {sorted(lengths)}")

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __getitem__(self, name: str) -> Sequence[Any]:
        """A column. Raises KeyError."""
        return self.columns[name]

    def rows(self) -> Iterator[dict[str, Any]]:
        """Each row by the names of the columns."""
        for values in zip(*self.columns.values(), strict=True):
            yield dict(zip(self.columns, values, strict=True))

    def where(self, **values: Any) -> ResultTable:
        """The rows whose columns have these values."""
        return self._chosen(
            [row for row, told in enumerate(self.rows()) if all(told[k] == v for k, v in values.items())]
        )

    def groups(self, *by: str) -> dict[tuple[Any, ...], ResultTable]:
        """The rows in groups of equal values in some columns, in the order of their first rows."""
        chosen: dict[tuple[Any, ...], list[int]] = {}
        for row, values in enumerate(zip(*(map(_comparable, self.columns[name]) for name in by), strict=True)):
            chosen.setdefault(values, []).append(row)
        return {values: self._chosen(rows) for values, rows in chosen.items()}

    def _chosen(self, rows: Sequence[int]) -> ResultTable:
        return ResultTable({name: [values[row] for row in rows] for name, values in self.columns.items()})

    def to_arrow(self) -> pa.Table:
        """The same as an Arrow table. Columns whose values have several types become text."""
        import pyarrow as pa

        arrays = {}
        for name, values in self.columns.items():
            kinds = {type(value) for value in values if value is not None}
            plain = kinds <= {int, float} or (len(kinds) == 1 and kinds <= {bool, str})
            arrays[name] = pa.array(
                [float(value) if value is not None and kinds == {int, float} else value for value in values]
                if plain
                else [None if value is None else str(value) for value in values]
            )
        return pa.table(arrays)


def _comparable(value: Any) -> Any:
    """Lists and tables of a spec, as something that a group may be named by."""
    return value if value.__hash__ is not None else repr(value)


def sweep_table(cells: Iterable[AskedCell], done: Callable[[str], StoredRow | None]) -> ResultTable:
    """The table of a sweep: ``cells`` of its plan, and the run of each by the cell's key (``Index.done``); of a cell
    that was not
    run yet, figures are None and ``state`` is ``missing``. Nothing of the plan is left out."""
    pairs = [(cell, done(cell.key)) for cell in cells]
    paths = dict.fromkeys(path for cell, _ in pairs for path, _ in cell.overrides)
    quantities = dict.fromkeys(name for _, row in pairs if row is not None for name in row.quantities)
    columns: dict[str, list[Any]] = {name: [] for name in (*PLACE, *paths, *STATE, *FACTORS, *quantities)}
    for cell, row in pairs:
        values = {name: getattr(cell, name) for name in PLACE} | dict(cell.overrides) | _result(row)
        for name, column in columns.items():
            column.append(values.get(name))
    return ResultTable(columns)


def _result(row: StoredRow | None) -> dict[str, Any]:
    if row is None:
        return {"state": "missing"}
    simulated = row.steps * row.timestep
    told = {
        name: getattr(row, name) for name in ("failed", "passed", "expected", "engine_version", "world", "timestep")
    }
    told |= {"state": "done" if row.failed is None else "failed", "simulated": simulated}
    told |= {name: factor(row.steps, row.timestep, getattr(row, seconds)) for name, seconds in FACTORS.items()}
    return told | {name: value if math.isfinite(value) else None for name, value in row.quantities.items()}


def grouped(
    table: ResultTable, by: Sequence[str], names: Sequence[str], figure: Callable[[Sequence[float]], Any]
) -> ResultTable:
    """One row for each group of equal values in ``by``: how many rows (``count``), how many of them are done, and ``figure``
    of the values of each column in ``names`` (:func:`statistics.median`, :func:`simspec.analysis.intervals.spread`, …); None
    where there are none. Rows that failed have no part in it."""
    columns: dict[str, list[Any]] = {name: [] for name in (*by, "count", "done", *names)}
    for values, group in table.groups(*by).items():
        whole = group.where(state="done")
        for name, value in zip(by, values, strict=True):
            columns[name].append(value)
        columns["count"].append(len(group))
        columns["done"].append(len(whole))
        for name in names:
            told = [value for value in whole[name] if value is not None]
            columns[name].append(figure(told) if told else None)
    return ResultTable(columns)
