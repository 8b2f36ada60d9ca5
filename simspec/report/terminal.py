"""Tables for people: one per question, 80 to 120 columns, plain in a pipe, no colour under NO_COLOR."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from simspec.comparison.runs import QUANTITIES, summary
from simspec.comparison.study import Study
from simspec.compiler import Compiled
from simspec.engines.kit.capabilities import DOUBLE, Capability
from simspec.errors import MOST_PROBLEMS, Problem, Refusal, SimspecError, SpecError, UnsupportedError
from simspec.report.differences import differences, repeatability
from simspec.report.final import final_table
from simspec.report.kit import length, number, table, verdict
from simspec.report.matrix import WORDS
from simspec.report.reasons import link, short_reason
from simspec.report.screen import console
from simspec.runner.expectations import Outcome
from simspec.runner.run import Run
from simspec.runner.unphysical import together
from simspec.selection import Selection
from simspec.support.declarations import Level
from simspec.support.features import Feature

if TYPE_CHECKING:
    from simspec.engines.kit.installed import Instance
    from simspec.proof.certificate import Certificate, EngineProof
    from simspec.proof.checks import Check
    from simspec.proof.selftest import Outcome as DefectOutcome
    from simspec.proof.selftest import SelfTest

SHOWN_FAILURES = 12
"""Failed checks that the terminal lists; the certificate has all."""


# --- errors -----------------------------------------------------------------------------------------------------------


def show_error(error: SimspecError) -> None:
    """Print an error on standard error: every problem, its place first."""
    screen = console(error=True)
    if not isinstance(error, SpecError):
        screen.print(Text("error: ", style="bold red") + Text(str(error)), soft_wrap=True)
        return
    brief = error.brief if isinstance(error, UnsupportedError) else ()
    for problem in error.problems[:MOST_PROBLEMS]:
        if not (brief and isinstance(problem, Refusal)):
            screen.print(_problem(problem, Text("error: ", style="bold red")), soft_wrap=True)
    for line in brief:
        screen.print(line, soft_wrap=True)
    for line in error.more if not brief else ():
        screen.print(line)
    count = len(error.problems)
    screen.print(Text(f"{count} problem{'s' if count > 1 else ''}", style="bold red"))
    for line in error.ending if isinstance(error, UnsupportedError) else ():
        screen.print(line, soft_wrap=True)


def show_warnings(warnings: Sequence[Problem]) -> None:
    """Print warnings on standard error, as errors are."""
    screen = console(error=True)
    for problem in warnings:
        screen.print(_problem(problem, Text("warning: ", style="bold yellow")), soft_wrap=True)


def _problem(problem: Problem, kind: Text) -> Text:
    first, *rest = str(problem).split("\n")
    place = f"{problem.location}: " if problem.location else ""
    text = Text(place, style="bold") + kind + Text(first.removeprefix(place))
    for line in rest:
        text.append("\n" + line)
    return text


# --- what came out ----------------------------------------------------------------------------------------------------


def results(runs: Mapping[str, Run]) -> Table:
    """What came out: one column per run, one row per quantity."""
    shown = list(runs.values())
    quantities = table("Results", "", *(run.label for run in shown), right=range(1, len(shown) + 1))
    values = [summary(run) for run in shown]
    for name, unit in QUANTITIES:
        cells = [values_of_run.get(name) for values_of_run in values]
        if any(cell is not None for cell in cells):
            quantities.add_row(name, *(length(cell) if unit == "m" else number(cell, unit) for cell in cells))
    quantities.add_row("real-time factor of the steps", *(number(run.real_time_factor) for run in shown))
    quantities.add_row("real-time factor end to end", *(number(run.end_to_end_factor) for run in shown))
    if any("control" in run.provenance for run in shown):
        quantities.add_row("control, µs per step", *(number(_per_step(run, "control")) for run in shown))
    failures = [run.failed for run in shown]
    if any(failures):
        quantities.add_row("failed", *(Text(_shorten(why), style="bold red") if why else "" for why in failures))
    return quantities


def _per_step(run: Run, part: str) -> float | None:
    """Microseconds that a part of a run took for each step."""
    seconds, steps = run.provenance.get("seconds", {}).get(part), run.provenance.get("steps")
    return 1e6 * seconds / steps if seconds is not None and steps else None


def _shorten(text: str, limit: int = 200) -> str:
    return text if len(text) <= limit else text[: limit - 1] + "…"


def expectations(outcomes: Mapping[str, Sequence[Outcome]]) -> Table | None:
    """The expectations: one row per expectation and engine. None when the spec has none."""
    if not any(outcomes.values()):
        return None
    rows = table("Expectations", "expectation", "engine", "", "measured", "bound", "", right=(3, 4))
    for index in range(max(len(run_outcomes) for run_outcomes in outcomes.values())):
        for engine, row in outcomes.items():
            outcome = row[index]
            rows.add_row(
                outcome.kind,
                engine,
                verdict(outcome.passed),
                number(outcome.measured, outcome.unit),
                number(outcome.bound, outcome.unit),
                _shorten(outcome.detail, 80),
            )
    return rows


# --- does the model agree ---------------------------------------------------------------------------------------------


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
    """The name of a level's row: what ``checks``, those of the level in all engines, are of."""
    parts = {check.name.partition(",")[0] for check in checks}
    words = [word for part, word in PART_WORDS.get(level, {}).items() if part in parts]
    return f"{level} {'; '.join(words) or LEVEL_WORDS.get(level, '')}".strip()


def certificate_tables(certificate: Certificate) -> list[Table]:
    """Model: largest deviations: one row per level, one column per engine; then what failed."""
    deviations = table("Model: largest deviations", "level", "tolerance", *certificate.engines, right=(1,))
    levels = sorted(
        {check.level for proof in certificate.engines.values() for check in proof.checks}
        | {name for proof in certificate.engines.values() for name in proof.not_compared if " " not in name}
        | {name for proof in certificate.engines.values() for name in proof.unchecked if " " not in name}
    )
    for level in levels:
        blocks = {name: proof.level(level) for name, proof in certificate.engines.items()}
        # of checks with tolerances of their own, the one nearest to its own stands for the level
        tightest = {name: max(checks, key=_strain) for name, checks in blocks.items() if checks}
        tolerances = sorted({level_check.tolerance for level_check in tightest.values() if level_check.tolerance})
        deviations.add_row(
            level_title(level, (check for checks in blocks.values() for check in checks)),
            ", ".join(f"{value:.1e}" for value in tolerances) or ("exact" if tightest else "–"),
            *(
                _level_cell(blocks[name], tightest.get(name), level in proof.unchecked)
                for name, proof in certificate.engines.items()
            ),
        )
    counts = [sum(check.count for check in proof.checks) for proof in certificate.engines.values()]
    deviations.add_row("comparisons", "", *(f"{count:,}" for count in counts))
    if any(proof.declared.declared for proof in certificate.engines.values()):
        deviations.add_row("by declared deviation", "", *(_declared(proof) for proof in certificate.engines.values()))
    deviations.add_row("verdict", "", *(_verdict(proof) for proof in certificate.engines.values()))
    return [deviations, *_failures(certificate)]


def _verdict(proof: EngineProof) -> Text:
    """Valid or not, and which parts that does not speak of."""
    levels = [name for name in proof.not_compared if " " not in name]
    more = Text() if proof.precision == DOUBLE else Text(f"\n{proof.precision} precision", style="dim")
    if levels:
        more += Text(f"\n{', '.join(levels)} not compared", style="dim")
    if proof.unchecked:
        more += Text(f"\nnot checked: {', '.join(proof.unchecked)}", style="dim")
    if proof.passed and proof.files_alone:
        return Text("NOT PROVEN\nits files alone (L0)", style="bold yellow") + more
    return verdict(proof.valid, "valid", "NOT VALID") + more


def _declared(proof: EngineProof) -> Text:
    """How many contact figures pass by a declared deviation alone, the widest of these, and which effects are absent."""
    found = proof.declared
    if not found.declared:
        return Text("–", style="dim")
    cell = Text(f"{found.declared} of {found.figures}\nwidest: {found.width}", style="yellow")
    return cell + Text(f"\nabsent: {', '.join(found.absent)}", style="bold yellow") if found.absent else cell


def _strain(check: Check) -> float:
    """How near a check came to its tolerance; beyond any number when something differs in kind."""
    if check.worst is None:
        return math.inf
    if check.tolerance:
        return check.worst / check.tolerance
    return math.inf if check.worst else 0.0


def _level_cell(checks: list[Check], worst: Check | None, unchecked: bool) -> Text:
    bad = sum(not check.passed for check in checks)
    if bad:
        return Text(f"{bad} FAILED", style="bold red")
    if worst is None:
        return Text("not checked" if unchecked else "not compared", style="dim")
    return Text(f"{worst.worst:.1e}" if worst.worst else "equal", style="green")


def _failures(certificate: Certificate) -> list[Table]:
    failures = certificate.failures()
    if not failures:
        return []
    failed = table("Failed checks", "engine", "check", "deviation", "where", "found", right=(2,))
    for engine, check in failures[:SHOWN_FAILURES]:
        worst = f"{check.worst:.1e}" if check.worst is not None else "different kind" if check.count else "not compared"
        failed.add_row(engine, f"{check.level} {check.name}", worst, check.where, _shorten(check.detail))
    if len(failures) > SHOWN_FAILURES:
        failed.caption = f"and {len(failures) - SHOWN_FAILURES} more checks"
    return [failed]


def certificate_notes(certificate: Certificate) -> list[str]:
    """What must be known beside the verdict: what was not compared and why, the motion's own floor, approximations, what could
    not be asked."""
    proofs = certificate.engines.values()
    reasons: dict[str, dict[str, None]] = {}
    for proof in proofs:
        for name, why in proof.not_compared.items():
            reasons.setdefault(why, {})[name] = None
    notes = [f"not compared: {'; '.join(names)}: {why}" for why, names in reasons.items()]
    motion = {
        check.detail: None for proof in certificate.engines.values() for check in proof.level("L6") if check.detail
    }
    notes += [f"motion: {detail}" for detail in motion]
    if any(proof.contact for proof in certificate.engines.values()):
        notes.append("contact: the largest deviation of each engine, relative to its tolerance (--contact prints all)")
    for name, proof in certificate.engines.items():
        for feature, said in proof.approximations.items():
            why = short_reason(name, feature, said)
            notes.append(f"{name}: accepted approximation ({feature}): {why} ({link(name, feature)})")
        notes += [f"{name}: {words}" for words in proof.contact_words]
        if proof.declared.cached:
            notes.append(
                f"{name}: {proof.declared.cached} of {proof.declared.figures} contact figures from the cache "
                "(--no-cache measures all)"
            )
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


def show_certificate(certificate: Certificate, screen: Console) -> None:
    """The tables of a certificate and its notes."""
    for part in certificate_tables(certificate):
        screen.print(part)
    for note in certificate_notes(certificate):
        screen.print(Text(note, style="dim"), soft_wrap=True)


def self_test_table(result: SelfTest) -> Table:
    """One row per planted defect, one column per engine: the levels that noticed it, or why it cannot be held."""
    engines = list(dict.fromkeys(outcome.engine for outcome in result.outcomes))
    defects = table("Self-test: planted defects", "defect", *engines)
    for defect in dict.fromkeys(outcome.defect for outcome in result.outcomes):
        cells = {outcome.engine: outcome for outcome in result.outcomes if outcome.defect == defect}
        defects.add_row(defect, *(_outcome_cell(cells[engine]) if engine in cells else Text("–") for engine in engines))
    return defects


def _outcome_cell(outcome: DefectOutcome) -> Text:
    if outcome.caught is None:
        return Text(f"not representable: {outcome.reason}", style="dim")
    if not outcome.caught:
        return Text(f"MISSED {outcome.first}".strip(), style="bold red")
    return Text(", ".join(outcome.by), style="green")


def decisions(compiled: Compiled) -> Table:
    """How each needed feature is realised in one engine."""
    features = table(f"Features in {compiled.engine} ({compiled.format})", "feature", "support", "realisation", "where")
    for decision in compiled.decisions:
        more = f" (and {len(decision.paths) - 1} more)" if len(decision.paths) > 1 else ""
        features.add_row(decision.feature.value, WORDS[decision.level], decision.how, decision.paths[0] + more)
    return features


def engine_tables(instances: Sequence[Instance], data: Mapping[str, Any], width: int) -> list[Table]:
    """The engines with their versions, and what each engine of ``data`` supports."""
    versions = table("Engines", "engine", "version", "format", "dialect", "python", "")
    for instance in instances:
        versions.add_row(
            instance.label,
            instance.version or Text("none", style="red"),
            instance.format,
            instance.dialect,
            Text(instance.python or "this one"),
            Text(instance.problem or "", style="red"),
        )
    levels = {
        name: [Level(facts["support"][feature.value]["level"]) for feature in Feature] for name, facts in data.items()
    }
    support = _side_by_side(
        "Supported features  (details: simspec engines --json)",
        "feature",
        [feature.value for feature in Feature],
        {name: [Text(WORDS[level], style=STYLES[level]) for level in own] for name, own in levels.items()},
        width,
    )
    has = {name: [facts["capabilities"][capability.value] for capability in Capability] for name, facts in data.items()}
    abilities = _side_by_side(
        "Capabilities",
        "capability",
        [capability.value for capability in Capability],
        {
            name: [Text("yes", style="green") if one else Text("no", style="red") for one in own]
            for name, own in has.items()
        },
        width,
    )
    reasons = table("Lacking capabilities", "engine", "capability", "reason")
    for name, facts in data.items():
        for lacking, reason in facts["lacks"].items():
            reasons.add_row(name, lacking, reason)
    return [versions, *support, *abilities, *([reasons] if reasons.row_count else [])]


GAP = 3
"""Columns between two cells of a table."""
EDGES = 2
"""Columns at both ends of a table."""


def _side_by_side(
    title: str, first: str, names: Sequence[str], columns: Mapping[str, Sequence[Text]], width: int
) -> list[Table]:
    """A row for each of ``names`` and a cell in each column: one table, or several where cells would not fit whole."""
    labels = EDGES + max(len(word) for word in (first, *names))
    tables: list[list[str]] = [[]]
    taken = labels
    for column, cells in columns.items():
        wide = GAP + max(len(text) for text in (column, *(cell.plain for cell in cells)))
        if taken + wide > width and tables[-1]:
            tables.append([])
            taken = labels
        tables[-1].append(column)
        taken += wide
    made: list[Table] = []
    for shown in tables:
        made.append(table(title if not made else f"{title.partition('  ')[0]}, continued", first, *shown))
        made[-1].columns[0].no_wrap = True
        for row, name in enumerate(names):
            made[-1].add_row(name, *(columns[column][row] for column in shown))
    return made


STYLES = {
    Level.EXACT: "green",
    Level.VIA_API: "green",
    Level.OUTSIDE: "cyan",
    Level.APPROXIMATE: "yellow",
    Level.UNSUPPORTED: "red",
}


LONGEST_REASON = 600
"""Characters of why an engine is left out: eight lines of a terminal; ``--json`` has the whole."""


def not_run_table(reasons: Mapping[str, str], places: Mapping[str, str] | None = None) -> Table | None:
    """The engines that were asked for and did not run, one row each; None without any."""
    if not reasons:
        return None
    not_run = table("Not run", "engine", "why")
    for name, reason in reasons.items():
        why = textwrap.shorten(reason, LONGEST_REASON, placeholder=" …")
        not_run.add_row(name, why + (places or {}).get(name, ""))
    return not_run


def show_not_taken(selection: Selection, screen: Console) -> None:
    """The engines that are left out since nobody named them, one row each; nothing where all are taken."""
    if not selection.not_taken:
        return
    places = {name: f"\n{one.location}" if one.location else "" for name, one in selection.not_taken.items()}
    screen.print(not_run_table({name: one.reason for name, one in selection.not_taken.items()}, places))
    if asked := [name for name, refusal in selection.not_taken.items() if refusal.acceptable]:
        screen.print(f"to accept by name what differs: simspec accept SPEC  ({', '.join(asked)})", soft_wrap=True)


def show_study(study: Study, screen: Console, show: Sequence[str] = ()) -> None:
    """All tables of one study, in the order of the questions."""
    for line in together({name: run.unphysical for name, run in study.runs.items() if run.recorded}):
        screen.print(Text(f"not physical: {line}", style="bold yellow"), soft_wrap=True)
    if study.certificate is not None:
        show_certificate(study.certificate, screen)
    for shown in (
        results(study.runs),
        final_table(study.runs, show),
        expectations(study.outcomes),
        repeatability(study.floors),
        differences(study.diffs),
    ):
        if shown is not None:
            screen.print(shown)
    for hint in dict.fromkeys(one.hint for own in study.outcomes.values() for one in own if one.hint):
        screen.print(hint, soft_wrap=True)
    for note in dict.fromkeys(note for diff in study.diffs for note in diff.notes):
        screen.print(f"note: {note}", soft_wrap=True)
