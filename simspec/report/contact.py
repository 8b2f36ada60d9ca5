"""The figures of contact probes, as tables: one for each probe, engines side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.table import Table
from rich.text import Text

from simspec.proof.contact.probe import Figure
from simspec.report.kit import table

TITLES: Mapping[str, str] = {
    "push": "Friction: force of a slider pushed in 24 directions at 1.6 times the limit",
    "push-oblong": "Friction: force of an oblong slider pushed in 24 directions at 1.6 times the limit",
    "stop": "Friction: sliding distance in 24 directions",
    "stop-oblong": "Friction: final position of an oblong slider, in 24 directions",
    "carry": "Friction: how far a moving surface carries a slider that is put down at rest",
    "stick": "Friction: creep at 0.8 times the limit, in 24 directions",
    "restitution": "Restitution: separation speed over approach speed",
    "threshold": "Restitution below and above the threshold speed",
    "rest": "Rest: penetration of a cube (1 kg, 10 cm) and a ball (10 kg)",
    "steady": "Rest: residual speed of the same bodies",
    "overlap": "Hardness: separation speed from an initial overlap",
    "compliance": "Hardness: rest penetration and bounce of compliant contact",
    "torsional": "Torsional friction: spin-down of a ball",
    "rolling": "Rolling friction: a ball rolling to rest",
    "size": "Shape sizes, measured by contact",
}
"""Of each probe what its table answers; a probe that is not named here has its name."""
FEW_DIGITS = 4
LEAST_PERCENT = 0.01
"""Deviations below this many per cent are not worth a reader's time; the certificate has them."""


def contact_table(figures: Mapping[str, Sequence[Figure]]) -> list[Table]:
    """A table for each probe: what was asked, what is right, what each engine did. ``figures`` by engine."""
    probes = dict.fromkeys(figure.probe for of_engine in figures.values() for figure in of_engine)
    return [_table(probe, figures) for probe in probes]


def _table(probe: str, figures: Mapping[str, Sequence[Figure]]) -> Table:
    engines = list(figures)
    rows: dict[tuple[str, str, str], dict[str, Figure]] = {}
    for engine, of_engine in figures.items():
        for figure in of_engine:
            if figure.probe == probe:
                rows.setdefault((figure.subject, figure.case, figure.quantity), {})[engine] = figure
    rows_shown = table(
        TITLES.get(probe, probe), "materials", "case", "expected", *engines, right=range(2, 3 + len(engines))
    )
    for (subject, case, quantity), by_engine in rows.items():
        first = next(iter(by_engine.values()))
        cells = [_cell(by_engine.get(engine)) for engine in engines]
        rows_shown.add_row(subject, f"{case}, {quantity}", _number(first.expected, first), *cells)
    return rows_shown


def _number(value: float, figure: Figure) -> str:
    return f"{value:.{FEW_DIGITS}g} {figure.unit}".rstrip()


def _cell(figure: Figure | None) -> Text:
    """The measured value; how far it is off where the figure is one of deviation; a mark where it is declared or wrong."""
    if figure is None:
        return Text("–", style="dim")
    if figure.measured is None:
        return Text("no value", style="bold red")
    shown = _number(figure.measured, figure)
    if figure.expected and abs(off := 100 * (figure.measured / figure.expected - 1)) >= LEAST_PERCENT:
        shown += f" ({off:+.2g} %)" if abs(off) < 100 else ""
    if not figure.passed:
        return Text(f"{shown} FAILED", style="bold red")
    return Text(f"{shown} known deviation", style="yellow") if figure.deviation else Text(shown)


def deviations(figures: Mapping[str, Sequence[Figure]]) -> list[str]:
    """Each declared deviation that counted, once, with its engine."""
    declared = {
        f"{engine}, {figure.probe}: {figure.deviation}": None
        for engine, of_engine in figures.items()
        for figure in of_engine
        if figure.deviation
    }
    return list(declared)
