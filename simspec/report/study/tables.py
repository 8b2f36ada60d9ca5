"""Tables of a study by word, with those of contact and of quantities, and the circumstances of its runs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from simspec.comparison.runs import QUANTITIES
from simspec.experiments.cases import world_of
from simspec.experiments.plan import Cell
from simspec.proof.certificate import Certificate
from simspec.proof.contact.probe import ProbeFigure
from simspec.proof.contact.run import laws
from simspec.report.certificate import TITLES
from simspec.report.explain import attribution_tables
from simspec.report.study.motion import (
    conservation_tables,
    consistency_tables,
    displacement_tables,
    distributions_tables,
    divergence_tables,
    penetration_tables,
)
from simspec.report.study.pages import playback_tables
from simspec.report.study.runs import (
    PLAIN,
    Done,
    StudyTable,
    Variant,
    finite,
    milliseconds,
    timesteps_of,
    unsupported_table,
    variants,
)
from simspec.report.study.sentences import said_of
from simspec.report.study.speed import (
    case_cost_tables,
    cost_tables,
    load_tables,
    over_time_tables,
    speed_tables,
    unequal_tables,
)
from simspec.report.study.validity import (
    cases_tables,
    certified_tables,
    determinism_tables,
    failures_tables,
    validity_tables,
)
from simspec.report.table import BAD, DIM, WARNING, TableCell, length, number, two_digits
from simspec.world.types import PairContact

# Contact figures (level L5) of the proofs of a sweep: a table for each probe, over timesteps.


@dataclass(frozen=True)
class FigureForm:
    """How a probe's figures are shown.

    share     as a share of the expected value in per cent, else in ``unit`` (``factor`` of them in the figure's own)
    by_case   a row for each case of the probe, else the worst of all cases
    quantity  the one that is shown, where the probe has several that cannot be compared; "": all
    """

    share: bool = False
    factor: float = 1.0
    unit: str = ""
    by_case: bool = False
    quantity: str = ""


FORMS: Mapping[str, FigureForm] = {
    probe: form
    for probes, form in (
        ("push push-oblong stop stop-oblong carry oblique", FigureForm(share=True)),
        ("torsional rolling", FigureForm(share=True, quantity="deceleration")),
        ("compliance compliance-shape slide-spin", FigureForm(share=True, by_case=True)),
        ("strike row edge stack-slides stack-slides-plane", FigureForm(share=True, by_case=True)),
        ("restitution threshold", FigureForm(by_case=True)),
        ("oblique-separation", FigureForm()),
        ("stick", FigureForm(factor=1e6, unit="µm/s")),
        ("size", FigureForm(factor=1e6, unit="µm")),
        ("steady", FigureForm(factor=1e6, unit="µm/s", by_case=True)),
        ("rest", FigureForm(factor=1e6, unit="µm", by_case=True)),
        ("overlap", FigureForm(factor=1e3, unit="mm/s", by_case=True)),
        ("rod clamp jam jam-light squeeze pile carrier", FigureForm(factor=1e3, unit="mm", by_case=True)),
        ("stack stack-stays stack-stays-plane cross", FigureForm(factor=1e3, unit="mm", by_case=True)),
    )
    for probe in probes.split()
}
"""By probe. One that is not named here has a row for each case, in the figure's own unit."""
NOTE = (
    "The largest deviation from the analytic value. Italic, yellow: beyond what simspec promises at 1 ms, and within what the "
    "engine declares; bold, red: beyond that too"
)
Measured = Mapping[tuple[str, str], Sequence[ProbeFigure]]
"""The figures of one proof, by the law in words and the probe."""


def contact_tables(done: Done) -> list[StudyTable]:
    """``contact``: a table for each probe that has figures, ``contact.PROBE``, and ``contact.unsupported``: variants without
    figures."""
    made = variants(done)
    steps = timesteps_of(made)
    rows: dict[tuple[str, str, str], dict[int, dict[float, list[ProbeFigure]]]] = {}
    unmeasured: list[str] = []
    for index, variant in enumerate(made):
        for step, runs in variant.runs.items():
            measured = _measured(done, runs[0][0])
            if measured is None and not variant.refusals():
                unmeasured.append(f"{variant.engine} at {milliseconds(step)} ({variant.label})")
            for (law, probe), figures in (measured or {}).items():
                for figure in figures:
                    case = figure.case if FORMS.get(probe, FigureForm(by_case=True)).by_case else ""
                    rows.setdefault((probe, law, case), {}).setdefault(index, {}).setdefault(step, []).append(figure)
    note = "; ".join([NOTE, *([f"not verified: {', '.join(unmeasured)}"] if unmeasured else [])])
    probes = dict.fromkeys(probe for probe, _, _ in rows)
    ordered = {
        key: rows[key]
        for key in sorted(rows, key=lambda key: [float(element) for element in re.findall(r"\d+(?:\.\d+)?", key[1])])
    }
    shown = [_shown(done, made, steps, probe, ordered, note) for probe in probes]
    if not shown and unmeasured:
        shown = [StudyTable(done, "contact", note, "nothing was measured")]
    return [*shown, unsupported_table(done, "contact", made)]


def _shown(
    done: Done,
    made: Sequence[Variant],
    steps: Sequence[float],
    probe: str,
    rows: Mapping[tuple[str, str, str], Mapping[int, Mapping[float, list[ProbeFigure]]]],
    note: str,
) -> StudyTable:
    form = FORMS.get(probe, FigureForm(by_case=True))
    unit = " (% of the expected value)" if form.share else f" ({form.unit})" if form.unit else ""
    by_case = any(case for name, _, case in rows if name == probe)
    heads = ["law", *(["probed"] if by_case else []), "settings", "engine"]
    columns, right = [*heads, *map(milliseconds, steps)], range(len(heads), len(heads) + len(steps))
    title = f"{TITLES.get(probe, probe)}: deviation{unit}"
    shown = StudyTable(done, f"contact.{probe}", title, *columns, right=right, note=note)
    for (name, law, case), row in rows.items():
        for index, by_step in row.items() if name == probe else ():
            variant = made[index]
            shown.records += [
                {"law": law, "case": case, "settings": variant.label, "engine": variant.engine, "timestep": step}
                | {"deviation": finite(_worst(form, figures)), "passed": all(figure.passed for figure in figures)}
                | {"declared": any(bool(figure.deviation) for figure in figures)}
                for step, figures in by_step.items()
            ]
            cells = [_cell(form, by_step.get(step)) for step in steps]
            shown.add(law, *([case] if by_case else []), variant.label, variant.engine, *cells)
    return shown


def _worst(form: FigureForm, figures: Sequence[ProbeFigure]) -> float:
    """The largest deviation; infinite where one is NaN."""
    deviations = [_deviation(form, figure) for figure in figures]
    return max(math.inf if math.isnan(deviation) else deviation for deviation in deviations)


def _measured(done: Done, cell: Cell) -> Measured | None:
    """The figures of the proof of a cell's model; None where it has none. Raises SpecError where it is damaged."""
    key = done.outcome.index.certificates.get(cell.key)
    text = done.store.certificate_text(key) if key is not None else None
    if text is None:
        return None
    proof = Certificate.from_json(text, f"the certificate {key}").engines[cell.engine]
    words = {law.subject: law_words(law.pair) for law in laws(world_of(done.outcome.plan, cell))}
    measured: dict[tuple[str, str], list[ProbeFigure]] = {}
    for figure in proof.contact:
        wanted = FORMS.get(figure.probe, FigureForm()).quantity
        if not wanted or figure.quantity == wanted or figure.measured is None:
            measured.setdefault((words.get(figure.subject, figure.subject), figure.probe), []).append(figure)
    return measured


def law_words(pair: PairContact) -> str:
    """A law in words: its friction, and what else it has."""
    given = [f"μ {pair.friction:g}"]
    given += [f"e {pair.restitution:g}"] if pair.restitution else []
    given += [f"torsional {length(pair.torsional_friction)}"] if pair.torsional_friction else []
    given += [f"rolling {length(pair.rolling_friction)}"] if pair.rolling_friction else []
    given += [f"threshold {pair.restitution_threshold:g} m/s"] if pair.restitution_threshold else []
    hardness = pair.hardness
    if hardness.kind == "time-constant":
        given.append(f"T {1e3 * hardness.time_constant:g} ms, ζ {hardness.damping_ratio:g}")
    elif hardness.kind == "stiffness":
        given.append(f"k {hardness.stiffness:g} N/m, c {hardness.damping:g} N s/m")
    elif hardness.kind != "common":
        given.append(f"{hardness.kind} hardness")
    return ", ".join(given)


def _cell(form: FigureForm, figures: Sequence[ProbeFigure] | None) -> TableCell:
    """The worst of some figures."""
    if not figures:
        return TableCell(PLAIN, DIM)
    worst = _worst(form, figures)
    if math.isinf(worst):
        return TableCell("no value", BAD)
    if not all(figure.passed for figure in figures):
        return TableCell(two_digits(worst), BAD)
    return TableCell(two_digits(worst), WARNING if any(figure.deviation for figure in figures) else "")


def _deviation(form: FigureForm, figure: ProbeFigure) -> float:
    if figure.measured is None:
        return math.inf
    off = abs(figure.measured - figure.expected)
    if not form.share:
        return form.factor * off
    if not figure.expected:
        return 0.0 if not off else math.inf
    return 100.0 * off / abs(figure.expected)


# Quantities at the end of runs, by case, engine and timestep.


def quantities_tables(done: Done) -> list[StudyTable]:
    """``quantities``."""
    rows = [
        (variant, timestep, {name: _median(row.quantities.get(name) for _, row in runs) for name, _ in QUANTITIES})
        for variant in variants(done)
        for timestep, runs in variant.runs.items()
    ]
    shown = [(name, unit) for name, unit in QUANTITIES if any(medians[name] is not None for _, _, medians in rows)]
    heads = [f"{name}, {unit}" if unit else name for name, unit in shown]
    columns = ("settings", "engine", "timestep", *heads)
    note = "Medians over the runs that have a finite value"
    made = StudyTable(done, "quantities", "Results of runs", *columns, right=range(2, len(columns)), note=note)
    for variant, step, medians in rows:
        record = {"settings": variant.label, "case": variant.case, "engine": variant.engine, "timestep": step} | medians
        cells = [number(medians[name]) for name, _ in shown]
        made.add(variant.label, variant.engine, milliseconds(step), *cells, record=record)
    return [made]


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None and abs(value) < float("inf")]
    return median(known) if known else None


# All tables of a study, by word.

SHOWN: Mapping[str, Callable[[Done], list[StudyTable]]] = {
    "speed": speed_tables,
    "load": load_tables,
    "validity": validity_tables,
    "over_time": over_time_tables,
    "determinism": determinism_tables,
    "playback": playback_tables,
    "quantities": quantities_tables,
    "unequal": unequal_tables,
    "contact": contact_tables,
    "certified": certified_tables,
    "failures": failures_tables,
    "cases": cases_tables,
    "cost": cost_tables,
    "displacement": displacement_tables,
    "case_cost": case_cost_tables,
    "divergence": divergence_tables,
    "distributions": distributions_tables,
    "consistency": consistency_tables,
    "conservation": conservation_tables,
    "penetration": penetration_tables,
    "attribution": attribution_tables,
}
"""By the words of :data:`simspec.language.sweep.SHOWN`. A table's name begins with the word."""


def shown_of(done: Done) -> list[StudyTable]:
    """All tables that the study shows of a sweep, with their sentences."""
    tables = [table for word in done.sweep.words.show for table in SHOWN[word](done)]
    for table in tables:
        table.said = table.said or said_of(table.name, table.records)
    return tables


# Machine, versions and dates of the runs of a study.

GIB = 2**30


def measured(done: Sequence[Done], command: str) -> list[dict[str, str]]:
    """The circumstances, line by line: ``what`` and ``value``."""
    began: set[str] = set()
    machines: dict[str, None] = {}
    versions: dict[str, dict[str, None]] = {}
    seen: set[str] = set()
    for entry in done:
        for _, row in entry.outcome.rows():
            if row is None or row.key in seen:
                continue
            seen.add(row.key)
            facts = entry.store.facts(row.key)
            circumstances, provenance = facts.circumstances, facts.result.provenance
            began |= {str(circumstances["started"])} if "started" in circumstances else set()
            timed = circumstances.get("timed")
            if isinstance(timed, Mapping) and isinstance(timed.get("machine"), Mapping):
                machines[_machine(timed["machine"])] = None
            for name in ("engine_version", "simspec"):
                label = row.engine if name == "engine_version" else name
                if provenance.get(name) is not None:
                    versions.setdefault(label, {})[str(provenance[name])] = None
    lines = {
        "command": command,
        "measured": _dates(began),
        "versions": ", ".join(f"{label} {' and '.join(local)}" for label, local in sorted(versions.items())),
        "machine, where speed was measured": "; ".join(machines),
        "runs": f"{len(seen):,}",
        "models": _models(done),
    }
    return [{"what": what, "value": value} for what, value in lines.items() if value]


def _models(done: Sequence[Done]) -> str:
    """How many models are proven, and how many are not, each counted once in the study; "" where nothing was verified."""
    outcomes = [outcome for entry in done for outcome in (entry.outcome, *(second for _, second in entry.moved))]
    verified = [outcome for outcome in outcomes if outcome.verified]
    keys = {outcome.index.certificates.get(cell.key) for outcome in verified for cell, row in outcome.rows() if row}
    unproven = {key for outcome in verified for key in outcome.unproven}
    by_contact = {key for outcome in verified for key in outcome.by_contact}
    if not verified:
        return ""
    given = [f"{len(keys - unproven - {None}):,} proven"]
    given += [f"proof FAILED for {len(unproven - by_contact):,}"] if unproven - by_contact else []
    given += [f"contact beyond the tolerances of L5 for {len(by_contact):,} (tables: certified)"] if by_contact else []
    return "; ".join(given)


def counted(count: int, what: str) -> str:
    """``1 model``, ``2 models``."""
    return f"{count:,} {what}{'' if count == 1 else 's'}"


def _dates(began: Iterable[str]) -> str:
    """The first and the last day: 2026-11-22."""
    days = sorted(text[:10] for text in began)
    return days[0] if days and days[0] == days[-1] else f"{days[0]} to {days[-1]}" if days else ""


def _machine(plain: Mapping[str, Any]) -> str:
    memory = plain.get("memory")
    parts = [plain.get("cpu"), f"{plain.get('cores')} cores", plain.get("kernel"), plain.get("python")]
    parts += [f"{memory / GIB:.0f} GiB"] if isinstance(memory, int | float) else []
    return ", ".join(str(part) for part in parts if part)
