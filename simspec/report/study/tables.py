"""All tables that a study can show, by word, and where and when its runs were measured."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from simspec.report.explain import attribution_tables
from simspec.report.study.contact import contact_tables, quantities_tables
from simspec.report.study.motion import (
    conservation_tables,
    consistency_tables,
    displacement_tables,
    distributions_tables,
    divergence_tables,
    penetration_tables,
)
from simspec.report.study.pages import playback_tables
from simspec.report.study.runs import Done, StudyTable
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
"""By the words of :data:`simspec.language.study.SHOWN`. A table's name begins with the word."""


def shown_of(done: Done) -> list[StudyTable]:
    """All tables that the study shows of a sweep, with their sentences."""
    tables = [table for word in done.sweep.words.show for table in SHOWN[word](done)]
    for table in tables:
        table.said = table.said or said_of(table.name, table.records)
    return tables


# Machine, versions and dates of the runs of a study.

GIB = 2**30


def measured(done: Sequence[Done], command: str) -> list[dict[str, str]]:
    """What is said of it, line by line: ``what`` and ``value``."""
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
