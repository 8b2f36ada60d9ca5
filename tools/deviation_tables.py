"""Tables of declared deviations, ``contact_deviations.csv`` of the engines, from figures that ``deviations.py`` measured."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from deviation_grid import (
    BETWEEN,
    FIRST_RESTITUTION,
    IMPACTS,
    LAST_RESTITUTION,
    LONGEST,
    SOME,
    TABLES,
    Grid,
    bounces,
    law_of,
    probe_of,
)

from simspec.engines.kit.capabilities import COLUMNS as KEYS
from simspec.engines.kit.capabilities import LIMITS, Deviation
from simspec.engines.kit.refinements import SLIDING
from simspec.engines.kit.registry import find_engine
from simspec.proof.contact.probe import Probe, ProbeFigure
from simspec.proof.contact.run import COUPLED, widened

ROOT = Path(__file__).resolve().parent.parent
ALIKE = 1.3
"""Ratio of the largest to the smallest deviation up to which cones or settings share a row of a table."""
MARGIN, LOCAL_MARGIN = 1.15, 1.25
"""Declared over measured: figures at frictions between the measured ones differ by some percent; those between local points by
the median of what the tables miss between theirs."""
BOUNCING_MARGIN = 1.6
"""The same of both grids where coupled bodies have restitution: when a hop ends changes with every number (of 86 random points
between the measured ones 7 had a figure beyond the margins above, by 2 to 81 %; with this margin and more points 2 of 33)."""
ABOVE = 1.05
"""A row counts from this multiple of the timestep measured before it: at timesteps between, the larger size is declared."""
LOCAL_ALIKE = 1.5
"""Ratio of the sizes of neighbouring points up to which one local row declares both."""
NEAR = 0.9
"""Share of a declared size from which on a figure is declared again: next to it a little more is to be expected."""
Sizes = tuple[float, ...]
"""Largest deviations beyond the tolerance, by timestep; 0 where there is none."""


def declare(rows: Sequence[Mapping[str, Any]], part: Part) -> None:
    """Write the rows of one part into the engines' tables; rows of the other parts stay."""
    local, bouncing = part
    for engine in dict.fromkeys(row["engine"] for row in rows):
        mine = [row for row in rows if row["engine"] == engine and "seconds" not in row]
        table = ROOT / "simspec" / "engines" / engine / "contact_deviations.csv"
        with table.open(newline="", encoding="utf-8") as lines:
            stored = list(csv.DictReader(lines))
        kept = [row for row in stored if _part_of(row) != part]
        if local:
            made = list(local_rows(uncovered(mine)))
        else:
            made = _without_repeats(table_rows(list(uncovered(mine)) if bouncing else mine, mine))
        with table.open("w", newline="", encoding="utf-8") as lines:
            writer = csv.DictWriter(lines, KEYS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(sorted([*kept, *made], key=_part_of))
        print(f"{engine}: {len(made)} rows, {len(kept)} others")


Part = tuple[bool, bool]
"""Of a table: whether its rows are local, and whether they are of coupled probes with restitution."""


PARTS: Sequence[Part] = ((False, False), (False, True), (True, False), (True, True))


def _part_of(row: Mapping[str, str]) -> Part:
    return any(row[f"{name}_below"] for name in LIMITS), bounces(row["probe"], float(row["restitution"] or 0.0))


def _without_repeats(rows: Iterable[dict[str, str]]) -> list[dict[str, str]]:
    """Rows of coupled probes with restitution only where no earlier row, which counts for all that they do, is as large."""
    found: list[dict[str, str]] = []
    for row in rows:
        limits = [float(row[name] or 0.0) for name in LIMITS]
        repeats = bounces(row["probe"], float(row["restitution"] or 0.0)) and any(
            all(row[name] == other[name] for name in ("probe", "relative"))
            and all(other[name] in ("", row[name]) for name in ("setting", "cone"))
            and all(float(other[name] or 0.0) <= limit for name, limit in zip(LIMITS, limits, strict=True))
            and float(other["size"]) >= float(row["size"])
            for other in found
        )
        if not repeats:
            found.append(row)
    return found


def _row(kind: tuple[str, str, str], limits: Mapping[str, float], size: float, relative: bool) -> dict[str, str]:
    written = {name: f"{limit:.6g}" for name, limit in limits.items() if limit and math.isfinite(limit)}
    end = {"size": f"{size:.3g}", "relative": "yes" if relative else "no"}
    return {**dict.fromkeys(KEYS, ""), **dict(zip(KEYS, kind, strict=False)), **written, **end}


def table_rows(
    rows: Sequence[Mapping[str, Any]], measured: Sequence[Mapping[str, Any]] = ()
) -> Iterator[dict[str, str]]:
    """The rows of one engine from the grid ``TABLES``: the largest size up to each timestep, at which a row begins.
    ``measured``: all rows that were measured, of which ``rows`` are some."""
    timesteps = sorted({row["timestep"] for row in measured or rows})
    kinds = list(dict.fromkeys((setting_words(row["settings"]), row["cone"]) for row in measured or rows))
    for measured_kind in dict.fromkeys(_measured(row) for row in rows):
        probe, restitution, ratio, relative = measured_kind
        margin = BOUNCING_MARGIN if bounces(probe, restitution) else MARGIN
        some = [row for row in rows if _measured(row) == measured_kind and row["off"] > 1.0]
        sizes = {kind: [0.0] * len(timesteps) for kind in kinds}
        for row in some:
            column = timesteps.index(row["timestep"])
            sizes_of = sizes[setting_words(row["settings"]), row["cone"]]
            sizes_of[column] = max(sizes_of[column], _size(row))
        for (setting, cone), shared in _shared({kind: tuple(sizes) for kind, sizes in sizes.items()}).items():
            largest = 0.0
            for before, size in zip((0.0, *timesteps), shared, strict=False):
                if size > largest:
                    largest = size
                    limits = {"timestep": ABOVE * before, "restitution": restitution, "ratio": ratio}
                    yield _row((setting, cone, probe), limits, margin * float(f"{size:.3g}"), relative)


def uncovered(rows: Iterable[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """The rows that the engine's other declared deviations do not cover. A value that is not finite cannot be declared."""
    for row in rows:
        if row["measured"] is None or not math.isfinite(row["measured"]):
            continue
        engine = find_engine(row["engine"])
        settings = {name: setting.default for name, setting in engine.SETTINGS.items()} | row["settings"]
        law = law_of(row["friction"], row["restitution"], row["ratio"], row["cone"], row["timestep"] / 1e3)
        figure = ProbeFigure(row["probe"], "", row["case"], "", "", row["expected"], row["measured"], row["tolerance"])
        bouncing = bounces(row["probe"], row["restitution"])
        declared = [
            deviation for deviation in engine.CONTACT_DEVIATIONS if _is_earlier(deviation, row["local"], bouncing)
        ]
        covered = widened(figure, law, declared, settings, engine.version())
        if not covered.passed or (covered.deviation and off(covered) > NEAR):
            yield row


def _is_earlier(deviation: Deviation, local: bool, bouncing: bool) -> bool:
    """Whether a deviation is of an earlier part of a table, or of the engine's module, than a row that is to be declared."""
    coupled = bounces(deviation.probe, deviation.restitution)
    return (not deviation.is_local and (local or not (bouncing and coupled))) or (local and bouncing and not coupled)


def local_rows(rows: Iterable[Mapping[str, Any]]) -> Iterator[dict[str, str]]:
    """The rows of one engine from the grid ``BETWEEN``: each counts up to the next measured values on both sides."""
    groups: dict[tuple[Any, ...], dict[float, list[Mapping[str, Any]]]] = {}
    for row in rows:
        along = "ratio" if row["probe"].startswith("stack") else "friction"
        bouncing = row["restitution"] if bounces(row["probe"], row["restitution"]) else 0.0
        key = (
            setting_words(row["settings"]),
            row["cone"],
            row["probe"],
            row["timestep"],
            _is_share(row),
            along,
            bouncing,
        )
        groups.setdefault(key, {}).setdefault(row[along], []).append(row)
    for (setting, cone, name, _, relative, along, bouncing), by in groups.items():
        probe = probe_of(name)
        grid = BETWEEN.bouncing() if bouncing else BETWEEN.without_bouncing()
        for some in _neighbours(by, [point[2 if along == "ratio" else 0] for point in grid.points(probe)]):
            limits = {}
            for limit in LIMITS:
                limits[limit], limits[f"{limit}_below"] = _limits(limit, probe, some, grid)
            size = float(f"{max(_size(row) for row in some):.3g}")
            yield _row((setting, cone, name), limits, (BOUNCING_MARGIN if bouncing else LOCAL_MARGIN) * size, relative)


def _neighbours(
    by: Mapping[float, Sequence[Mapping[str, Any]]], values: Iterable[float]
) -> Iterator[list[Mapping[str, Any]]]:
    """Points that are neighbours, with deviations alike."""
    found: list[Mapping[str, Any]] = []
    for value in sorted(set(values)):
        some = by.get(value, ())
        sizes = [max(_size(row) for row in rows) for rows in (found, some) if rows]
        if found and (not some or max(sizes) > LOCAL_ALIKE * min(sizes)):
            yield found
            found = []
        found = [*found, *some]
    if found:
        yield found


def _limits(name: str, probe: Probe, rows: Sequence[Mapping[str, Any]], grid: Grid) -> tuple[float, float]:
    """From the measured value before these rows' to the one after them, exclusive."""
    if name == "timestep":
        measured: Iterable[float] = grid.coupled_timesteps if probe.NAME in COUPLED else grid.timesteps
    else:
        measured = {point[("friction", "restitution", "ratio").index(name)] for point in grid.points(probe)}
    values = sorted({*measured, *((FIRST_RESTITUTION,) if name == "restitution" and min(measured) > 0.0 else ())})
    first = values.index(round(min(row[name] for row in rows), 9))
    last = values.index(round(max(row[name] for row in rows), 9))
    before = values[first - 1] * 1.0001 if first else SOME if name == "restitution" and values[0] else 0.0
    if first and name in ("friction", "restitution") and values[first - 1] == 0.0:
        before = 1e-9
    after = values[last + 1] * 0.9999 if last + 1 < len(values) else LONGEST if name == "timestep" else math.inf
    return before, after


def setting_words(settings: Mapping[str, Any]) -> str:
    words = {name: str(value).lower() if isinstance(value, bool) else value for name, value in settings.items()}
    return " ".join(f"{name}={value}" for name, value in words.items())


def _measured(row: Mapping[str, Any]) -> tuple[str, float, float, bool]:
    """Probe, the restitution and ratio of masses from which its size counts (of a ratio from the one measured before), and
    whether the size is a share of the expected value. That at restitution 1 counts
    above the largest restitution of the other grid."""
    probe, relative = str(row["probe"]), _is_share(row)
    if bounces(probe, row["restitution"]):
        return probe, _from_restitution(row["restitution"]), 0.0, relative
    varied = probe.split("-")[0] in IMPACTS or probe in SLIDING
    ratio = 0.0
    if probe.startswith("stack"):
        ratios = TABLES.values["sliding stack" if probe in SLIDING else "stack"][0].ratios
        ratio = max((1.001 * size for size in ratios if size < row["ratio"]), default=0.0)
    return probe, SOME if varied and row["restitution"] else 0.0, ratio, relative


def _from_restitution(restitution: float) -> float:
    """From where on the size of a coupled probe at this restitution of the first grid counts."""
    if restitution <= FIRST_RESTITUTION:
        return SOME
    return 1.001 * (FIRST_RESTITUTION if restitution < 1.0 else LAST_RESTITUTION)


def _size(row: Mapping[str, Any]) -> float:
    """A share of the expected value, or where that is zero a value in the figure's unit."""
    if row["measured"] is None:
        raise SystemExit(f"the value to declare is not finite: {row}")
    size = abs(row["measured"] - row["expected"])
    return float(size / abs(row["expected"]) if _is_share(row) else size)


def _is_share(row: Mapping[str, Any]) -> bool:
    """Whether a size is a share of the expected value: not of a body that bounces on a carrier, which slips by millimetres
    whatever the hundredths of a millimetre that it is expected to slip."""
    return bool(row["expected"]) and not (row["probe"] == "carrier" and bounces("carrier", row["restitution"]))


def _shared(sizes: Mapping[tuple[str, str], Sizes]) -> Mapping[tuple[str, str], Sizes]:
    """The rows of some settings and cones; one for all cones, or for all settings too, where they are alike."""
    if _alike(sizes.values()):
        return {("", ""): _largest(sizes.values())}
    found: dict[tuple[str, str], Sizes] = {}
    for setting in dict.fromkeys(setting for setting, _ in sizes):
        mine = {kind: some for kind, some in sizes.items() if kind[0] == setting}
        found |= {(setting, ""): _largest(mine.values())} if _alike(mine.values()) else mine
    return found


def _alike(some: Iterable[Sizes]) -> bool:
    return all(max(column) <= ALIKE * min(column) for column in zip(*some, strict=True))


def _largest(some: Iterable[Sizes]) -> Sizes:
    return tuple(max(column) for column in zip(*some, strict=True))


def off(figure: ProbeFigure) -> float:
    if figure.measured is None or not math.isfinite(figure.measured):
        return math.inf
    return abs(figure.measured - figure.expected) / figure.tolerance
