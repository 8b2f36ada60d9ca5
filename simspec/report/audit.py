"""``simspec audit`` on a terminal, as plain data, as a test report, and as a part of a page: the same tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from simspec.audit import AuditFinding, EngineAudit, FileAudit, FindingGroup, FindingSeverity, What, grouped
from simspec.audit.audit import PairAudit
from simspec.errors import clipped, visible
from simspec.report.page.document import Section
from simspec.report.page.sentences import Sentence
from simspec.report.problems import plausibility_data, plausibility_lines
from simspec.report.screen import console, plain
from simspec.report.table import BAD, DIM, GOOD, PLAIN, WARNING, Table, TableCell
from simspec.report.tested import Status, TestedEntry, TestedSuite

TONES = {FindingSeverity.PHYSICS: BAD, FindingSeverity.RATING: WARNING, FindingSeverity.APPEARANCE: WARNING}
LONGEST_VALUE = 46
"""Characters of a value in a table; JSON has it whole."""
MOST_DEFECTS = 5
SHARES = ("mass", "inertia", "joint.damping", "joint.dry_friction", "joint.armature", "joint.effort_limit")
"""Quantities whose differences are shown as shares."""


def audit_data(audits: Sequence[FileAudit]) -> dict[str, Any]:
    """Audits as plain data."""
    files = [
        plain(audit) | {"plausibility": plausibility_data(audit.plausibility), "clean": audit.clean, "died": audit.died}
        for audit in audits
    ]
    return {"clean": all(audit.clean for audit in audits), "files": files}


def show_audit(audit: FileAudit, details: bool = False, interrupted: bool = False) -> None:
    """Print an audit; ``details``: every finding on its own row; ``interrupted``: it is part of an audit, without a verdict."""
    screen = console()
    about = f"{audit.language}, {audit.bodies} bodies; compared with {audit.meaning}"
    screen.note(f"{audit.file}: {about}")
    for defect in audit.defects[:MOST_DEFECTS]:
        screen.note(f"simspec refuses it: {defect.splitlines()[0]}")
    if audit.losses:
        screen.print(f"simspec's own import loses {audit.losses} elements or attributes (simspec import lists them)")
    for part in audit_tables(audit, details):
        screen.print(part)
    for line in choices(audit):
        screen.note(line)
    for name, why in audit.skipped.items():
        screen.note(f"{name}: not loaded: {why}")
    for line in plausibility_lines(audit.plausibility, details):
        screen.note(line)
    if interrupted:
        left = f"no result of {', '.join(audit.missing)}" if audit.missing else "the compiled files are not proven"
        screen.note(f"interrupted: {left}")
        return
    screen.note(verdict(audit)[0].text)


def engine_line(engine: EngineAudit) -> str:
    """The result of one engine as a line."""
    if not engine.loaded:
        why = engine.findings[0].why.splitlines()[0] if engine.findings else ""
        return f"{engine.engine} {'dies' if engine.died else 'refuses the file'} ({engine.seconds:.1f} s): {clipped(why, 120)}"
    silent = len(engine.silent)
    rest = f"{len(engine.findings) - silent} other findings, {engine.compared} values compared, {engine.seconds:.1f} s"
    return f"{engine.engine} loads it: {silent} changed in silence, {rest}"


def audit_tables(audit: FileAudit, details: bool = False) -> list[Table]:
    """The tables of an audit: the engines, then their findings."""
    return [_engines(audit), *([_findings(audit, details)] if _shown(audit, details) else [])]


def _shown(audit: FileAudit, details: bool) -> list[FindingGroup]:
    """The groups of findings of a table. Values that the file leaves open are lines, unless ``details`` are requested."""
    groups = [group for engine in audit.engines for group in grouped(engine.findings)]
    return [group for group in groups if details or group.severity is not FindingSeverity.DEFAULT]


def choices(audit: FileAudit) -> list[str]:
    """A line for each engine with the values that it chooses where the file leaves them open."""
    lines = []
    for engine in audit.engines:
        texts = [
            f"{'' if finding.element == 'the file' else f'{finding.element} '}{finding.quantity.replace('_', ' ')} "
            f"{finding.engine_value}"
            for finding in engine.findings
            if finding.severity is FindingSeverity.DEFAULT
        ]
        if texts:
            lines.append(f"{engine.engine} chooses what the file leaves open: {', '.join(texts)}")
    return lines


def _engines(audit: FileAudit) -> Table:
    compiled = {compiled.engine: compiled for compiled in audit.compiled}
    columns = ("engine", "loads it", "changed in silence", "other", "compared", "seconds", "compiled by simspec")
    shown = Table("Engines", *columns, right=(2, 3, 4, 5))
    for engine in audit.engines:
        proof = compiled.get(engine.engine)
        silent = len(engine.silent) if engine.loaded else 0
        shown.add(
            f"{engine.engine} {engine.version}".strip(),
            TableCell("yes", GOOD) if engine.loaded else TableCell("dies" if engine.died else "refuses", BAD),
            TableCell(str(silent), BAD if silent else GOOD) if engine.loaded else "–",
            str(len(engine.findings) - silent) if engine.loaded else "–",
            str(engine.compared) if engine.loaded else "–",
            f"{engine.seconds:.1f}",
            _proof_cell(proof.valid if proof else None, proof.why if proof else "not compiled"),
        )
    return shown


def _proof_cell(valid: bool | None, why: str) -> TableCell:
    if valid:
        return TableCell("certified", GOOD)
    if valid is None:
        return TableCell(clipped(why, 120), DIM)
    return TableCell(clipped(f"FAILED: {why}", 160), BAD)


def _findings(audit: FileAudit, details: bool) -> Table:
    title = "Values of the file that engines read differently"
    shown = Table(title, "engine", "what", "value", "where", "file → engine", "how much, or why")
    for group in _shown(audit, details):
        for finding in group.findings if details else (group.worst,):
            name = finding.quantity.replace("_", " ").replace("joint.", "joint ")
            values = (clipped(value, LONGEST_VALUE) for value in (finding.file_value, finding.engine_value))
            shown.add(
                group.engine,
                TableCell(f"{group.what}", TONES.get(group.severity, DIM)),
                name if finding.silent else f"{name} ({group.severity})",
                _where(finding, 0 if details else len(group.findings) - 1),
                "" if finding.what in (What.REFUSED, What.DIED) else " → ".join(values),
                _how_much(finding),
            )
    return shown


def _where(finding: AuditFinding, more: int) -> str:
    place = f":{finding.location.line}" if finding.location is not None else ""
    others = f" and {more} more" if more else ""
    return f"{finding.element}{place}{others}"


def _how_much(finding: AuditFinding) -> str:
    if finding.what in (What.REFUSED, What.DIED):
        return clipped(finding.why, 200)
    size = ""
    if finding.size is not None and finding.what is What.CHANGED and math.isfinite(finding.size):
        shares = finding.quantity in SHARES
        size = f"by {100.0 * finding.size:.3g} %" if shares else f"by {finding.size:.2g}"
    return "; ".join(part for part in (size, finding.why) if part)


def verdict(audit: FileAudit) -> list[Sentence]:
    """The result of an audit in sentences, a summary first."""
    silent = [engine for engine in audit.engines if engine.loaded and engine.silent]
    refused = [engine.engine for engine in audit.engines if not engine.loaded and not engine.died]
    died = [engine.engine for engine in audit.engines if engine.died]
    count = len(audit.engines)
    if not count:
        return [Sentence(WARNING, "none of the selected engines reads this language")]
    parts = []
    if silent:
        text = ", ".join(f"{audit.engine} {len(audit.silent)}" for audit in silent)
        parts.append(f"{len(silent)} of {count} engines change the model in silence ({text} values)")
    if refused:
        parts.append(f"{', '.join(refused)} refuse{'s' if len(refused) == 1 else ''} it")
    if died:
        parts.append(f"{', '.join(died)} die{'s' if len(died) == 1 else ''} of it")
    failed = [compiled.engine for compiled in audit.compiled if compiled.valid is False]
    good = [entry.engine for entry in audit.compiled if entry.valid]
    if failed:
        parts.append(f"compiled by simspec, the proof fails in {', '.join(failed)}")
    text = "; ".join(parts) or f"all {count} engines hold what the file says"
    sentences = [Sentence(BAD if parts else GOOD, text)]
    if good:
        sentences.append(Sentence(GOOD, f"compiled by simspec, {', '.join(good)} hold the same model (L0-L4, L6)"))
    sentences += [Sentence(WARNING, f"simspec refuses the file: {defect.splitlines()[0]}") for defect in audit.defects]
    sentences.append(Sentence(PLAIN, f"compared with {audit.meaning}"))
    return sentences


# Test reports and pages.


def audit_suites(audits: Sequence[FileAudit]) -> list[TestedSuite]:
    """One suite for each file and engine: an entry for each kind of finding, and one for the compiled model."""
    suites = []
    for audit in audits:
        compiled = {compiled.engine: compiled for compiled in audit.compiled}
        for engine in audit.engines:
            entries = list(_entries(engine))
            proof = compiled.get(engine.engine)
            if proof is not None:
                status = Status.PASSED if proof.valid else Status.SKIPPED if proof.valid is None else Status.FAILED
                entries.append(TestedEntry("compiled by simspec", status, proof.why))
            suites.append(TestedSuite(audit.file, engine.engine, tuple(entries)))
        for name, why in audit.skipped.items():
            suites.append(TestedSuite(audit.file, name, (TestedEntry("loads the file", Status.SKIPPED, why),)))
    return suites


def _entries(audit: EngineAudit) -> list[TestedEntry]:
    if not audit.loaded:
        finding = audit.findings[0]
        status = Status.ERROR if audit.died else Status.FAILED
        about = (clipped(finding.why), finding.why)
        return [TestedEntry("loads the file", status, *about, seconds=audit.seconds, excess=math.inf)]
    entries = [TestedEntry("loads the file", Status.PASSED, seconds=audit.seconds)]
    for group in grouped(audit.findings):
        worst = group.worst
        values = (worst.file_value or "nothing", worst.engine_value or "nothing")
        text = f"{worst.element}: {values[0]} in the file, {values[1]} in {audit.engine}"
        status = Status.FAILED if worst.silent else Status.SKIPPED
        detail = "\n".join(f"{each.element}: {each.file_value} -> {each.engine_value}" for each in group.findings)
        name = f"{group.quantity} {group.what}"
        entries.append(TestedEntry(name, status, clipped(text), detail, worst.location, excess=worst.size or 1.0))
    return entries


def audit_section(audit: FileAudit) -> Section:
    """The part of a page about a file."""
    rows = [(engine.engine, f"{engine.version or '–'}, {engine.how}") for engine in audit.engines]
    rows += [(f"{engine.engine} warned", line) for engine in audit.engines for line in engine.log[:20]]
    return Section(
        name=visible(audit.file),
        description="How physics engines read a robot file, compared with the meaning of the file.",
        verdict=tuple(Sentence(sentence.tone, visible(sentence.text)) for sentence in verdict(audit)),
        notes=tuple(map(visible, (*choices(audit), *plausibility_lines(audit.plausibility)))),
        certificate=(),
        certificate_notes=(),
        results=tuple(audit_tables(audit)),
        details=(_findings(audit, True),) if any(engine.findings for engine in audit.engines) else (),
        provenance=Table("How each engine loaded the file", "engine", "", rows=rows),
        scene=None,
        caption="",
    )


# Pairs of files.


def show_pair(pair: PairAudit) -> None:
    """Print how two files of one robot differ."""
    screen = console()
    screen.note(f"A: {pair.first}")
    screen.note(f"B: {pair.second}")
    screen.print(f"{pair.matched} bodies have the same name in both; {pair.compared} values were compared")
    for side, names in (("A", pair.only_first), ("B", pair.only_second)):
        if names:
            screen.note(f"only in {side} ({len(names)}): {clipped(', '.join(names), 600)}")
    if pair.findings:
        shown = Table("Differences", "value", "where", "A", "B", "how much")
        for group in grouped(pair.findings):
            worst = group.worst
            shown.add(
                TableCell(group.quantity, TONES.get(group.severity, DIM)),
                _where(worst, len(group.findings) - 1),
                clipped(worst.file_value, LONGEST_VALUE),
                clipped(worst.engine_value, LONGEST_VALUE),
                _how_much(worst),
            )
        screen.print(shown)
    same = not pair.findings and not pair.only_first and not pair.only_second
    screen.note("both mean the same model" if same else "the two mean different models")


def pair_data(pair: PairAudit) -> dict[str, Any]:
    """A pair as plain data."""
    return {**plain(pair), "same": pair.same}
