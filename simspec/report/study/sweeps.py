"""The page of a sweep: recorded figures against the values that were swept, a curve for each engine, read from its store."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from simspec.comparison.runs import QUANTITIES
from simspec.errors import Problem, SpecError, visible
from simspec.experiments.index import Index, RunRow, refresh
from simspec.experiments.store import Store
from simspec.language.quantities import UnitError, parse, split
from simspec.proof.certificate import Certificate
from simspec.report.experiments import RunGroup, results_table, short_names
from simspec.report.page.document import Section
from simspec.report.page.packing import PackedNumbers
from simspec.report.page.sentences import Sentence
from simspec.report.study.pages import playback
from simspec.report.study.sentences import Colours
from simspec.report.table import BAD, GOOD, PLAIN, WARNING, Table, listed, number

SPEED = "simulated time over wall time"
MOST_CURVES = 8
"""Curves of a plot: with more, other values than that of its axis are put together."""
MOST_FIGURES = 8
"""Plots over one value."""
MOST_PROOFS = 200
"""Certificates that are read for a page."""
MOST_ROWS = 500
"""Rows of the table; the file of CSV of the command has all."""
WIDE = 8.0
"""Ratio of the ends of an axis from which on it is logarithmic."""
DIMENSIONS = ("time", "length", "mass", "angle", "velocity")
"""Of values that are written in several units."""
NOTE = (
    "Each point is the median of its runs, small dots are single runs. Plots over the same axis are linked: drag or press "
    "arrow keys; double-click or Escape: all of it; a click in the legend hides a line."
)

Value = tuple[str, Any]


@dataclass(frozen=True)
class SweptCase:
    """A run of a sweep: its values by path, without those of its sample, and its figures by name."""

    engine: str
    case: str | None
    values: tuple[Value, ...]
    row: RunRow

    @property
    def figures(self) -> dict[str, float]:
        """The figures of the run; none where it failed."""
        if self.row.failed is not None:
            return {}
        seconds = self.row.step_seconds
        speed = {SPEED: self.row.steps * self.row.timestep / seconds} if seconds else {}
        return {**self.row.quantities, **speed}


@dataclass(frozen=True)
class SweptAxis:
    """A value that was swept, as an axis: the place of each value on it."""

    path: str
    label: str
    unit: str
    places: Mapping[str, float]

    def data(self) -> dict[str, Any]:
        """As ``page/src/data.ts`` declares it."""
        low, high = min(self.places.values()), max(self.places.values())
        return {"label": visible(self.label), "unit": self.unit, "logarithmic": low > 0.0 and high >= WIDE * low}


def sweep_parts(store: Store) -> Callable[[PackedNumbers], list[Section]]:
    """A function that makes the parts of a sweep's page: its figures, and a playback of one set of values in all engines.
    Raises SpecError where the store has no runs, or they are damaged."""
    index = refresh(store, repair=False)
    names: dict[str, list[SweptCase]] = {}
    for name, swept in _cases(store, index):
        names.setdefault(name, []).append(swept)
    if not names:
        raise SpecError([Problem(f"{store.shown}: no runs are stored there", hint="simspec sweep SPEC", code="R103")])

    def parts(packed: PackedNumbers) -> list[Section]:
        made = []
        for name, cases in names.items():
            made += [_section(name, cases, store, index), *_playback(name, cases, store, index, packed)]
        return made

    return parts


def _cases(store: Store, index: Index) -> Iterator[tuple[str, SweptCase]]:
    """The runs with the names of their scenarios, ordered by values, then engines."""
    read = []
    for row in index.rows.values():
        request = store.facts(row.key).request
        cell = request.cell or {}
        values = tuple((str(path), value) for path, value in cell.get("overrides", ()))
        read.append((request.name, row, cell.get("case"), cell.get("sample"), values))
    drawn = _drawn((sample, values) for _, _, _, sample, values in read)
    cases = [
        (name, SweptCase(row.engine, case, tuple(entry for entry in values if entry[0] not in drawn), row))
        for name, row, case, _, values in read
    ]
    return iter(sorted(cases, key=lambda item: (item[0], item[1].case or "", _order(item[1].values), item[1].engine)))


def _order(values: tuple[Value, ...]) -> list[tuple[str, float, str]]:
    return [(path, _number(value)[0] if _number(value) is not None else 0.0, str(value)) for path, value in values]  # type: ignore[index]


def _drawn(samples: Any) -> set[str]:
    """The paths whose values are drawn for samples: each sample has another."""
    found: dict[str, set[str]] = {}
    numbers: set[Any] = set()
    for sample, values in samples:
        if sample is None:
            continue
        numbers.add(sample)
        for path, value in values:
            found.setdefault(path, set()).add(repr(value))
    return {path for path, values in found.items() if len(numbers) > 1 and len(values) >= len(numbers)}


def _number(value: Any) -> tuple[float, str] | None:
    """A value as a number and its unit; None where it is none."""
    if isinstance(value, bool):
        return None
    if isinstance(value, (int, float)):
        return float(value), ""
    if isinstance(value, str):
        try:
            size, unit = split(value)
        except UnitError:
            return None
        return float(size), unit.strip()
    return None


def axes(cases: Sequence[SweptCase]) -> list[SweptAxis]:
    """The values that differ between runs and are numbers, in the order of the spec."""
    values: dict[str, dict[str, Any]] = {}
    for swept in cases:
        for path, value in swept.values:
            values.setdefault(path, {})[repr(value)] = value
    labels = short_names(list(values))
    found = []
    for path, known in values.items():
        placed = _places(known) if len(known) > 1 else None
        if placed is not None and len(set(placed[0].values())) > 1:
            found.append(SweptAxis(path, labels[path], placed[1], placed[0]))
    return found


def _places(known: Mapping[str, Any]) -> tuple[dict[str, float], str] | None:
    """The places of values on an axis, and its unit; None where some are not numbers of the same unit."""
    numbers = {name: _number(value) for name, value in known.items()}
    read = {name: entry for name, entry in numbers.items() if entry is not None}
    if len(read) < len(numbers):
        return None
    units = {unit for _, unit in read.values()}
    if len(units) == 1:
        return {name: size for name, (size, _) in read.items()}, units.pop()
    for dimension in DIMENSIONS:
        try:
            return {name: parse(str(value), dimension) for name, value in known.items()}, ""
        except UnitError:
            continue
    return None


def charts(cases: Sequence[SweptCase]) -> list[dict[str, Any]]:
    """The plots, as ``page/src/data.ts`` declares them (``Chart``): of each axis, figures that differ between runs."""
    units = {**dict(QUANTITIES), SPEED: ""}
    colours = Colours()
    for engine in sorted({swept.engine for swept in cases}):
        colours.of(engine)
    made = []
    figures = _varying(cases)[:MOST_FIGURES]
    for axis in axes(cases):
        for name in figures:
            series = list(_series(cases, axis, name, colours))
            known = [mark["value"] for entry in series for mark in entry["marks"]]
            if not known:
                continue
            wide = min(known) > 0.0 and max(known) >= WIDE * min(known)
            made.append(
                {
                    "title": visible(f"{name[0].upper()}{name[1:]} over {axis.label}"),
                    "unit": units.get(name, ""),
                    "group": axis.path,
                    "x": axis.data(),
                    "logarithmic": wide,
                    "series": series,
                    "limits": [],
                }
            )
    return made


def _varying(cases: Sequence[SweptCase]) -> list[str]:
    """The figures that are not the same in all runs; speed last."""
    found: dict[str, set[float]] = {}
    for swept in cases:
        for name, value in swept.figures.items():
            found.setdefault(name, set()).add(value)
    names = [name for name, values in found.items() if len(values) > 1]
    return sorted(names, key=lambda name: name == SPEED)


def _series(cases: Sequence[SweptCase], axis: SweptAxis, figure: str, colours: Colours) -> Iterator[dict[str, Any]]:
    """A curve for each engine and set of the other values, of an engine alone where these are too many."""
    separate = {(swept.engine, _others(swept, axis)) for swept in cases}
    together = len(separate) > MOST_CURVES
    curves: dict[tuple[str, str], dict[float, list[float]]] = {}
    for swept in cases:
        place = axis.places.get(repr(dict(swept.values).get(axis.path)))
        value = swept.figures.get(figure)
        if place is not None and value is not None and math.isfinite(value):
            label = swept.engine if together else ", ".join(filter(None, (swept.engine, _others(swept, axis))))
            curves.setdefault((swept.engine, label), {}).setdefault(place, []).append(value)
    for dash, ((engine, label), places) in enumerate(sorted(curves.items())):
        marks = [
            {
                "x": place,
                "value": median(values),
                "low": None,
                "high": None,
                "values": values if len(values) > 1 else [],
            }
            for place, values in sorted(places.items())
        ]
        yield {"label": visible(label), "colour": colours.of(engine), "dash": dash, "kind": "measured", "marks": marks}


def _others(swept: SweptCase, axis: SweptAxis) -> str:
    """The values of a run besides that of an axis, in words."""
    values = [(path, value) for path, value in swept.values if path != axis.path]
    labels = short_names([path for path, _ in swept.values])
    return ", ".join([*([swept.case] if swept.case else []), *(f"{labels[path]} {value}" for path, value in values)])


def _section(name: str, cases: Sequence[SweptCase], store: Store, index: Index) -> Section:
    groups: dict[tuple[str, str | None, str], RunGroup] = {}
    for swept in cases:
        key = (swept.engine, swept.case, repr(swept.values))
        group = groups.setdefault(key, RunGroup(swept.engine, swept.case, swept.values))
        group.requested += 1
        group.rows.append(swept.row)
    table = results_table(list(groups.values()), MOST_ROWS)
    if len(groups) > MOST_ROWS:
        table.note = f"The first {MOST_ROWS} of {len(groups):,} rows; simspec sweep --csv FILE writes all."
    return Section(
        name=visible(name),
        description=f"A sweep of {len(cases):,} runs.",
        verdict=tuple(verdict(cases, list(groups.values()), _proofs(cases, store, index))),
        notes=tuple(map(visible, index.notes)),
        certificate=(),
        certificate_notes=(),
        results=(table,),
        details=(),
        provenance=_provenance(cases, store),
        scene=None,
        caption="",
        charts=tuple(charts(cases)),
        charts_note=NOTE,
    )


def verdict(cases: Sequence[SweptCase], groups: Sequence[RunGroup], proofs: Sentence) -> Iterator[Sentence]:
    """At most five sentences: runs, proofs, expectations, the largest difference between engines, the speed."""
    engines = sorted({swept.engine for swept in cases})
    failed = [swept for swept in cases if swept.row.failed is not None]
    sets = len({(group.case, repr(group.values)) for group in groups})
    text = f"{len(cases):,} runs of {sets:,} set{'s' if sets != 1 else ''} of values in {listed(engines)}"
    if failed:
        yield Sentence(
            BAD, f"{text}; {len(failed):,} failed: {failed[0].engine}: {visible(str(failed[0].row.failed))[:200]}."
        )
    else:
        yield Sentence(GOOD, f"{text}; none failed.")
    yield proofs
    passed, expected = (sum(getattr(swept.row, name) for swept in cases) for name in ("passed", "expected"))
    if expected:
        tone = GOOD if passed == expected else BAD
        yield Sentence(tone, f"Expectations: {passed:,} of {expected:,} met.")
    if (difference := _difference(cases)) is not None:
        yield Sentence(PLAIN, difference)
    speeds = {
        engine: median(values)
        for engine in engines
        if (values := [swept.figures[SPEED] for swept in cases if swept.engine == engine and SPEED in swept.figures])
    }
    if speeds:
        ordered = sorted(speeds.items(), key=lambda item: -item[1])
        yield Sentence(
            PLAIN, f"Speed (median): {', '.join(f'{name} {value:.3g}' for name, value in ordered)} × real time."
        )


def _difference(cases: Sequence[SweptCase]) -> str | None:
    """Where the engines differ most in a figure, relative to its largest value in the sweep; None for one engine."""
    units = dict(QUANTITIES)
    sets: dict[tuple[str | None, str], dict[str, dict[str, list[float]]]] = {}
    words: dict[tuple[str | None, str], str] = {}
    largest: dict[str, float] = {}
    for swept in cases:
        key = (swept.case, repr(swept.values))
        labels = short_names([path for path, _ in swept.values])
        words[key] = ", ".join([*([swept.case] if swept.case else []), *(f"{labels[p]} {v}" for p, v in swept.values)])
        for name, value in swept.figures.items():
            if name != SPEED and math.isfinite(value):
                sets.setdefault(key, {}).setdefault(name, {}).setdefault(swept.engine, []).append(value)
                largest[name] = max(largest.get(name, 0.0), abs(value))
    found = [
        ((max(middle.values()) - min(middle.values())) / largest[name], name, key, middle)
        for key, figures in sets.items()
        for name, engines in figures.items()
        if len(middle := {engine: median(values) for engine, values in engines.items()}) > 1 and largest[name]
    ]
    if not found:
        return None
    share, name, key, middle = max(found, key=lambda entry: entry[0])
    if not share:
        return "All figures are the same in all engines."
    where = f" ({visible(words[key])})" if words[key] else ""
    values = ", ".join(f"{engine} {number(value, units.get(name, ''))}" for engine, value in sorted(middle.items()))
    return f"The engines differ most in {name}{where}: {values}."


def _proofs(cases: Sequence[SweptCase], store: Store, index: Index) -> Sentence:
    """Whether the models of the runs are proven, by the certificates of the store."""
    certificates = {swept.row.key: index.certificates.get(swept.row.cell) for swept in cases}
    known = sorted({key for key in certificates.values() if key})[:MOST_PROOFS]
    valid = set()
    for key in known:
        text = store.certificate_text(key)
        if text is not None and Certificate.from_json(text, f"the certificate {key[:16]}…").valid:
            valid.add(key)
    proven = sum(key in valid for key in certificates.values())
    if proven == len(cases):
        return Sentence(GOOD, "Models: all proven equal to those of the spec.")
    refuted = sum(key is not None and key not in valid for key in certificates.values())
    if refuted and len(known) < MOST_PROOFS:
        return Sentence(BAD, f"Models: {refuted:,} of {len(cases):,} runs do not have the spec's model.")
    return Sentence(WARNING, f"Models: {proven:,} of {len(cases):,} runs are proven to have the spec's model.")


def _provenance(cases: Sequence[SweptCase], store: Store) -> Table:
    rows = Table("Provenance", "", "")
    for engine in sorted({swept.engine for swept in cases}):
        versions = sorted({swept.row.engine_version for swept in cases if swept.engine == engine})
        rows.add(f"version of {engine}", visible(", ".join(versions)))
    specs = {str(store.facts(swept.row.key).request.spec.get("file", "")) for swept in cases[:1]}
    rows.add("spec", visible(", ".join(filter(None, specs)) or "–"))
    rows.add("worlds", f"{len({swept.row.world for swept in cases}):,}")
    return rows


def _playback(
    name: str, cases: Sequence[SweptCase], store: Store, index: Index, packed: PackedNumbers
) -> Iterator[Section]:
    """The runs of the first set of values that most engines have, side by side."""
    sets: dict[tuple[str | None, str], dict[str, SweptCase]] = {}
    for swept in cases:
        if swept.row.failed is None and not swept.row.perturb:
            sets.setdefault((swept.case, repr(swept.values)), {}).setdefault(swept.engine, swept)
    if not sets:
        return
    chosen = max(sets.values(), key=len)
    records = [
        {"run": swept.row.key, "engine": engine, "certificate": index.certificates.get(swept.row.cell)}
        for engine, swept in sorted(chosen.items())
    ]
    labels = short_names([path for path, _ in next(iter(chosen.values())).values])
    values = [f"{labels[path]} {value}" for path, value in next(iter(chosen.values())).values]
    made = playback(name, ", ".join(values) or name, records, store, packed)
    if made is not None:
        yield made
