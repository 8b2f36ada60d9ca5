"""Results of a sweep as a tidy table: a row for each run, a column for each axis and each figure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from simspec.runner.run import factor

if TYPE_CHECKING:
    import pyarrow as pa


PLACE = ("index", "engine", "case", "sample", "perturb", "seed", "repeat")
"""Columns that say which cell of the plan a row is of; those of the overrides follow, by their paths."""
STATE = ("state", "failed", "passed", "expected", "engine_version", "world", "timestep", "simulated")
"""Columns that say what became of it. ``state``: done, failed, or missing (not run yet); ``simulated``: s."""
FACTORS = {"real_time_factor": "step_seconds", "cpu_factor": "cpu_seconds", "end_to_end_factor": "process_seconds"}
"""Columns of speed, and the seconds that each is of (:mod:`simspec.analysis.speed`)."""


class RequestedCell(Protocol):
    """The data of a cell of a plan that a table needs (``experiments/plan.py``)."""

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
    """The data of a row of a store's index that a table needs (``experiments/index.py``)."""

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
            [row for row, given in enumerate(self.rows()) if all(given[k] == v for k, v in values.items())]
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


def sweep_table(cells: Iterable[RequestedCell], done: Callable[[str], StoredRow | None]) -> ResultTable:
    """The table of a sweep: ``cells`` of its plan, and the run of each by the cell's key (``Index.done``); of a cell that was
    not run yet, figures are None and ``state`` is ``missing``. Nothing of the plan is left out."""
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
    given = {
        name: getattr(row, name) for name in ("failed", "passed", "expected", "engine_version", "world", "timestep")
    }
    given |= {"state": "done" if row.failed is None else "failed", "simulated": simulated}
    given |= {name: factor(row.steps, row.timestep, getattr(row, seconds)) for name, seconds in FACTORS.items()}
    return given | {name: value if math.isfinite(value) else None for name, value in row.quantities.items()}


def grouped(
    table: ResultTable, by: Sequence[str], names: Sequence[str], figure: Callable[[Sequence[float]], Any]
) -> ResultTable:
    """One row for each group of equal values in ``by``: how many rows (``count``), how many of them are done, and ``figure``
    of the values of each column in ``names`` (:func:`statistics.median`, :func:`simspec.analysis.tables.spread`, …); None
    where there are none. Rows that failed have no part in it."""
    columns: dict[str, list[Any]] = {name: [] for name in (*by, "count", "done", *names)}
    for values, group in table.groups(*by).items():
        whole = group.where(state="done")
        for name, value in zip(by, values, strict=True):
            columns[name].append(value)
        columns["count"].append(len(group))
        columns["done"].append(len(whole))
        for name in names:
            given = [value for value in whole[name] if value is not None]
            columns[name].append(figure(given) if given else None)
    return ResultTable(columns)


# Confidence intervals of shares of trials and of positive figures over processes. A process is the unit: within a process speed
# hardly varies; between processes it often has two modes (memory layout).

LEVEL = 0.95
"""Of every interval, unless another is requested."""
FEWEST = 2
"""Processes from which a spread can be estimated."""


@dataclass(frozen=True, slots=True)
class Interval:
    """``lower`` ≤ ``value`` ≤ ``upper`` at the confidence ``level``; ``trials``: the number of independent values."""

    value: float
    lower: float
    upper: float
    trials: int
    level: float = LEVEL

    def __str__(self) -> str:
        return f"{self.value:.3g} [{self.lower:.3g}, {self.upper:.3g}]"


def share(successes: int, trials: int, level: float = LEVEL) -> Interval:
    """The share of successes with its exact interval (Clopper and Pearson 1934): with 10 of 10 it begins at 0.69.

    Raises ValueError without trials, or where there are more successes than trials.
    """
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials")
    from scipy.stats import beta

    tail = (1.0 - level) / 2.0
    lower = float(beta.ppf(tail, successes, trials - successes + 1)) if successes else 0.0
    upper = float(beta.ppf(1.0 - tail, successes + 1, trials - successes)) if successes < trials else 1.0
    return Interval(successes / trials, lower, upper, trials, level)


@dataclass(frozen=True, slots=True)
class Spread:
    """A positive figure of several processes: ``values`` in the order of the processes.

    ``mean``: the geometric mean with Student's t interval of the logarithms (what disturbs a process makes it slower by a
    factor); None of fewer than two processes, which have no spread.
    """

    values: tuple[float, ...]
    mean: Interval | None

    @property
    def processes(self) -> int:
        """The number of processes."""
        return len(self.values)

    @property
    def median(self) -> float:
        """The middle value."""
        return float(np.median(self.values))

    @property
    def least(self) -> float:
        """The smallest value."""
        return min(self.values)

    @property
    def most(self) -> float:
        """The largest value."""
        return max(self.values)

    def __str__(self) -> str:
        """The median, the interval of the mean, and how many processes there were."""
        if self.mean is None:
            return f"{self.median:.3g} (1 process, spread unknown)"
        return f"{self.median:.3g} [{self.mean.lower:.3g}, {self.mean.upper:.3g}] ({self.processes} processes)"


def spread(values: Sequence[float], level: float = LEVEL) -> Spread:
    """The spread of a positive figure over processes. Raises ValueError without values, or where one is not positive."""
    given = tuple(float(value) for value in values)
    if not given or not all(math.isfinite(value) and value > 0.0 for value in given):
        raise ValueError(f"a spread needs positive values: {given}")
    if len(given) < FEWEST:
        return Spread(given, None)
    logarithms = np.log(given)
    half = _t(level, len(given) - 1) * float(logarithms.std(ddof=1)) / math.sqrt(len(given))
    return Spread(given, _of_logarithm(float(logarithms.mean()), half, len(given), level))


def ratio(first: Spread, second: Spread, level: float = LEVEL) -> Interval | None:
    """How many times larger the first figure is than the second: ratio of the geometric means, with Welch's interval.
    None where either has fewer than two processes."""
    if first.processes < FEWEST or second.processes < FEWEST:
        return None
    logarithms = [np.log(spread.values) for spread in (first, second)]
    errors = [float(values.var(ddof=1)) / len(values) for values in logarithms]
    centre = float(logarithms[0].mean() - logarithms[1].mean())
    total = sum(errors)
    half = 0.0
    if total > 0.0:  # equal values in every process have no spread
        freedom = total**2 / sum(error**2 / (len(values) - 1) for error, values in zip(errors, logarithms, strict=True))
        half = _t(level, freedom) * math.sqrt(total)
    return _of_logarithm(centre, half, first.processes + second.processes, level)


def _t(level: float, freedom: float) -> float:
    from scipy.stats import t

    return float(t.ppf(0.5 + level / 2.0, freedom))


def _of_logarithm(centre: float, half: float, trials: int, level: float) -> Interval:
    return Interval(math.exp(centre), math.exp(centre - half), math.exp(centre + half), trials, level)
