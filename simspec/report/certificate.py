"""Certificates of proofs and self-tests, as tables and notes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rich.text import Text

from simspec.engines.kit.capabilities import DOUBLE
from simspec.proof.contact.probe import ProbeFigure
from simspec.report.matrix import link, short_reason
from simspec.report.table import BAD, DIM, GOOD, WARNING, Table, TableCell, passed_cell, shortened

if TYPE_CHECKING:
    from simspec.proof.certificate import Certificate, EngineProof
    from simspec.proof.checks import Check
    from simspec.proof.complete import CompleteTest
    from simspec.proof.selftest import DefectOutcome, SelfTest
    from simspec.report.console import Screen


MEASURED = "L5"
"""The level whose deviations are in units of each figure's tolerance."""
SHOWN_FAILURES = 12
"""Failed checks that the terminal lists; the certificate has all."""


LEVEL_WORDS = {
    "L0": "text",
    "L1": "mass",
    "L2": "kinematics",
    "L3": "dynamics",
    "L4": "geometry, contact law",
    "L5": "contact, measured",
    "L6": "contact-free motion",
    "L7": "control, step response",
}
"""Of each level what it checks, as far as ``PART_WORDS`` does not say it of its parts."""
PART_WORDS = {
    "L6": {
        "motion": "contact-free motion",
        "dry friction": "dry friction",
        "limits of sums": "limits of sums",
        "limits of balls": "limits of balls",
    },
    "L7": {
        "step response": "control, step response",
        "applied forces": "applied forces",
        "prescribed motion": "prescribed motion",
    },
}
"""Of levels of several parts the words of each; names of checks begin with that of their part."""


def level_title(level: str, checks: Iterable[Check]) -> str:
    """The name of a level's row, from the subjects of ``checks``: those of the level in all engines."""
    parts = {check.name.partition(",")[0] for check in checks}
    words = [word for part, word in PART_WORDS.get(level, {}).items() if part in parts]
    return f"{level} {'; '.join(words) or LEVEL_WORDS.get(level, '')}".strip()


def certificate_tables(certificate: Certificate) -> list[Table]:
    """Model: largest deviations: one row per level, one column per engine; then what failed."""
    deviations = Table("Model: largest deviations", "level", "tolerance", *certificate.engines, right=(1,))
    proofs = certificate.engines.values()
    levels = {check.level for proof in proofs for check in proof.checks}
    levels |= {name for proof in proofs for name in (*proof.not_compared, *proof.unchecked) if " " not in name}
    for level in sorted(levels):
        blocks = [proof.level(level) for proof in proofs]
        # of checks with different tolerances, the one nearest to its tolerance stands for the level
        tightest = [max(checks, key=strain, default=None) for checks in blocks]
        tolerances = sorted({check.tolerance for check in tightest if check is not None and check.tolerance})
        deviations.add(
            level_title(level, (check for checks in blocks for check in checks)),
            _tolerance_cell(level, tolerances) or ("exact" if any(blocks) else "–"),
            *(
                _level_cell(checks, worst, level in proof.unchecked)
                for checks, worst, proof in zip(blocks, tightest, proofs, strict=True)
            ),
        )
    deviations.add("comparisons", "", *(f"{sum(check.count for check in proof.checks):,}" for proof in proofs))
    if any(proof.declared.declared for proof in proofs):
        deviations.add("by declared deviation", "", *map(_declared, proofs))
    deviations.add("verdict", "", *map(_verdict, proofs))
    return [deviations, *_failures(certificate)]


def _verdict(proof: EngineProof) -> TableCell:
    """Valid or not, and which parts that does not speak of."""
    levels = [name for name in proof.not_compared if " " not in name]
    more = [] if proof.precision == DOUBLE else [f"{proof.precision} precision"]
    more += [f"{', '.join(levels)} not compared"] if levels else []
    more += [f"not checked: {', '.join(proof.unchecked)}"] if proof.unchecked else []
    if proof.passed and proof.files_alone:
        return TableCell("NOT PROVEN\nfiles only (L0)", WARNING, "\n".join(more))
    return replace(passed_cell(proof.valid, "valid", "NOT VALID"), more="\n".join(more))


def _declared(proof: EngineProof) -> TableCell:
    """How many contact figures pass by a declared deviation alone, the widest of these, and which effects are absent."""
    found = proof.declared
    if not found.declared:
        return TableCell("–", DIM)
    absent = f"\nabsent: {', '.join(found.absent)}" if found.absent else ""
    return TableCell(f"{found.declared} of {found.figures}\nwidest: {found.width}{absent}", WARNING)


def strain(check: Check) -> float:
    """The worst deviation of a check as a share of its tolerance; infinite where something differs in kind."""
    if check.worst is None:
        return math.inf
    if check.tolerance:
        return check.worst / check.tolerance
    return math.inf if check.worst else 0.0


def _level_cell(checks: list[Check], worst: Check | None, unchecked: bool) -> TableCell:
    bad = sum(not check.passed for check in checks)
    if bad:
        return TableCell(f"{bad} FAILED", BAD)
    if worst is None:
        return TableCell("not checked" if unchecked else "not compared", DIM)
    if worst.level == MEASURED and worst.worst:
        return TableCell(f"{100.0 * worst.worst:.0f} %", GOOD)
    return TableCell(f"{worst.worst:.1e}" if worst.worst else "equal", GOOD)


def _tolerance_cell(level: str, tolerances: Iterable[float]) -> str:
    """The tolerances of a level: those of contact differ by figure, and its deviations are shares of them."""
    return "by figure" if level == MEASURED else ", ".join(f"{value:.1e}" for value in tolerances)


def _failures(certificate: Certificate) -> list[Table]:
    failures = certificate.failures()
    if not failures:
        return []
    failed = Table("Failed checks", "engine", "check", "deviation", "where", "found", right=(2,))
    for engine, check in failures[:SHOWN_FAILURES]:
        worst = f"{check.worst:.1e}" if check.worst is not None else "different kind" if check.count else "not compared"
        failed.add(engine, f"{check.level} {check.name}", worst, check.where, shortened(check.detail))
    if len(failures) > SHOWN_FAILURES:
        failed.note = f"and {len(failures) - SHOWN_FAILURES} more checks"
    return [failed]


def certificate_notes(certificate: Certificate) -> list[str]:
    """Facts that qualify the verdict: levels that were not compared and why, the noise of the motion, approximations, fields
    that are not readable back."""
    proofs = certificate.engines.values()
    reasons: dict[str, dict[str, None]] = {}
    for proof in proofs:
        for name, why in proof.not_compared.items():
            reasons.setdefault(why, {})[name] = None
    notes = [f"not compared: {'; '.join(names)}: {why}" for why, names in reasons.items()]
    motion = [check.detail for proof in proofs for check in proof.level("L6") if check.detail]
    notes += [f"motion: {detail}" for detail in dict.fromkeys(motion)]
    if any(proof.contact for proof in proofs):
        notes.append("contact: the largest deviation of each engine, relative to its tolerance (--contact prints all)")
    for name, proof in certificate.engines.items():
        for feature, said in proof.approximations.items():
            why = short_reason(name, feature, said)
            notes.append(f"{name}: accepted approximation ({feature}): {why} ({link(name, feature)})")
        notes += [f"{name}: {words}" for words in proof.contact_words]
        if cached := proof.declared.cached:
            cached_words = f"{cached} of {proof.declared.figures} contact figures from the cache"
            notes.append(f"{name}: {cached_words} (--no-cache measures all)")
        declared: dict[str, dict[str, None]] = {}
        for figure in proof.contact:
            if figure.deviation:
                declared.setdefault(figure.deviation, {})[figure.probe] = None
        notes += [f"{name}: known deviation ({', '.join(of)}): {why}" for why, of in declared.items()]
        if proof.files_alone:
            notes.append(f"{name}: not checked: {', '.join(proof.unchecked)}: {proof.not_checked['L1']}")
        else:
            notes += [f"{name}: not checked: {part}: {why}" for part, why in proof.unchecked.items()]
        if fields := [field for field in proof.not_checked if field not in proof.unchecked]:
            notes.append(f"{name}: not readable back: {', '.join(fields)}")
    if any(figure.deviation for proof in proofs for figure in proof.contact):
        notes.append("measured deviations: docs/records/contact.md")
    return notes


def show_certificate(certificate: Certificate, screen: Screen) -> None:
    """The tables of a certificate and its notes."""
    for part in certificate_tables(certificate):
        screen.print(part)
    for note in certificate_notes(certificate):
        screen.note(note, "dim")


def self_test_table(result: SelfTest) -> Table:
    """One row per planted defect, one column per engine: the levels that noticed it, or why it cannot be held."""
    engines = list(dict.fromkeys(outcome.engine for outcome in result.outcomes))
    defects = Table("Self-test: planted defects", "defect", *engines)
    for defect in dict.fromkeys(outcome.defect for outcome in result.outcomes):
        cells = {outcome.engine: outcome for outcome in result.outcomes if outcome.defect == defect}
        defects.add(defect, *(_outcome_cell(cells[engine]) if engine in cells else Text("–") for engine in engines))
    return defects


def _outcome_cell(outcome: DefectOutcome) -> TableCell:
    if outcome.caught is None:
        return TableCell(f"not representable: {outcome.reason}", DIM)
    if not outcome.caught:
        return TableCell(f"MISSED {outcome.first}".strip(), BAD)
    return TableCell(", ".join(outcome.by), GOOD)


# Contact figures: a table for each probe, engines side by side.

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


def contact_table(figures: Mapping[str, Sequence[ProbeFigure]]) -> list[Table]:
    """A table for each probe: the case, the expected value, and the measured value of each engine. ``figures`` by engine."""
    probes: dict[str, dict[tuple[str, str, str], dict[str, ProbeFigure]]] = {}
    for engine, of_engine in figures.items():
        for figure in of_engine:
            key = (figure.subject, figure.case, figure.quantity)
            probes.setdefault(figure.probe, {}).setdefault(key, {})[engine] = figure
    columns = ("materials", "case", "expected", *figures)
    tables = []
    for probe, rows in probes.items():
        tables.append(Table(TITLES.get(probe, probe), *columns, right=range(2, len(columns))))
        for (subject, case, quantity), by_engine in rows.items():
            first = next(iter(by_engine.values()))
            cells = [_cell(by_engine.get(engine)) for engine in figures]
            tables[-1].add(subject, f"{case}, {quantity}", _number(first.expected, first), *cells)
    return tables


def _number(value: float, figure: ProbeFigure) -> str:
    return f"{value:.{FEW_DIGITS}g} {figure.unit}".rstrip()


def _cell(figure: ProbeFigure | None) -> TableCell:
    """The measured value; how far it is off where the figure is one of deviation; a mark where it is declared or wrong."""
    if figure is None:
        return TableCell("–", DIM)
    if figure.measured is None:
        return TableCell("no value", BAD)
    shown = _number(figure.measured, figure)
    if figure.expected and abs(off := 100 * (figure.measured / figure.expected - 1)) >= LEAST_PERCENT:
        shown += f" ({off:+.2g} %)" if abs(off) < 100 else ""
    if not figure.passed:
        return TableCell(f"{shown} FAILED", BAD)
    return TableCell(f"{shown} known deviation", WARNING) if figure.deviation else TableCell(shown)


def deviations(figures: Mapping[str, Sequence[ProbeFigure]]) -> list[str]:
    """Each declared deviation that counted, once, with its engine."""
    all_figures = [(engine, figure) for engine, of_engine in figures.items() for figure in of_engine]
    declared = [f"{engine}, {figure.probe}: {figure.deviation}" for engine, figure in all_figures if figure.deviation]
    return list(dict.fromkeys(declared))


# Complete self-tests: the verdict of every change, as a table and as data.

COLUMNS = ("planted", "caught", "refused", "inert", "missed")
SHOWN = 40
"""Missed changes that the terminal lists; ``--json`` has all."""


def complete_data(result: CompleteTest) -> dict[str, Any]:
    """A complete self-test as plain data."""
    return {
        **{name: getattr(result, name) for name in ("passed", "versions", "seconds", "skipped")},
        "rows": [
            {"engine": engine, "kind": kind, **dict(zip(COLUMNS, counts, strict=True))}
            for engine, kind, counts in result.rows()
        ],
        "inert": [{"engine": engine, "reason": why, "count": count} for engine, why, count in inert_reasons(result)],
        "unused": result.unused,
        "mutations": result.verdicts,
    }


def show_complete(result: CompleteTest, screen: Screen) -> None:
    """Print the table, and what was missed and skipped."""
    screen.print(complete_table(result))
    for verdict in result.missed[:SHOWN]:
        place = f"{verdict.engine}, {verdict.world}: {verdict.file} {verdict.place}"
        screen.print(f"MISSED {place}: {verdict.kind} {verdict.change} {verdict.why}", markup=False)
    if len(result.missed) > SHOWN:
        screen.print(f"and {len(result.missed) - SHOWN} more (--json lists all)")
    for where, why in result.skipped.items():
        screen.print(f"{where}: {why}", markup=False)
    for engine, rows in result.unused.items():
        for row in rows:
            screen.print(f"{engine}: declared inert, and no change needs it: {row}", markup=False)
    planted, missed = result.count(), len(result.missed)
    screen.print(f"missed {missed} of {planted} changes, in {result.seconds / 60.0:.0f} min")


def complete_table(result: CompleteTest) -> Table:
    """A row for each engine and kind of change."""
    rows = [(engine, kind, *counts) for engine, kind, counts in result.rows()]
    return Table("Complete self-test", "engine", "change", *COLUMNS, right=range(2, 7), rows=rows)


def inert_reasons(result: CompleteTest) -> list[tuple[str, str, int]]:
    """(engine, reason, how many) of what is declared inert and was seen to be."""
    counts = Counter((verdict.engine, verdict.why) for verdict in result.verdicts if verdict.verdict == "inert")
    ordered = sorted(counts.items(), key=lambda row: (row[0][0], -row[1]))
    return [(engine, why, count) for (engine, why), count in ordered]
