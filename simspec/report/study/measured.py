"""Where and when the runs of a study were made, from what they say of themselves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from simspec.report.study.done import Done

GIB = 2**30


def measured(done: Sequence[Done], command: str) -> list[dict[str, str]]:
    """What is said of it, line by line: ``what`` and ``value``."""
    began: set[str] = set()
    machines: dict[str, None] = {}
    versions: dict[str, dict[str, None]] = {}
    seen: set[str] = set()
    for one in done:
        for _, row in one.outcome.rows():
            if row is None or row.key in seen:
                continue
            seen.add(row.key)
            facts = one.store.facts(row.key)
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
        "versions": ", ".join(f"{label} {' and '.join(own)}" for label, own in sorted(versions.items())),
        "machine, where speed was measured": "; ".join(machines),
        "runs": f"{len(seen):,}",
        "models": _models(done),
    }
    return [{"what": what, "value": value} for what, value in lines.items() if value]


def _models(done: Sequence[Done]) -> str:
    """How many models are proven, and how many are not, each counted once in the study; "" where nothing was verified."""
    outcomes = [outcome for one in done for outcome in (one.outcome, *(second for _, second in one.moved))]
    verified = [outcome for outcome in outcomes if outcome.verified]
    keys = {outcome.index.certificates.get(cell.key) for outcome in verified for cell, row in outcome.rows() if row}
    unproven = {key for outcome in verified for key in outcome.unproven}
    by_contact = {key for outcome in verified for key in outcome.by_contact}
    if not verified:
        return ""
    told = [f"{len(keys - unproven - {None}):,} proven"]
    told += [f"proof FAILED for {len(unproven - by_contact):,}"] if unproven - by_contact else []
    told += [f"contact beyond the tolerances of L5 for {len(by_contact):,} (tables: certified)"] if by_contact else []
    return "; ".join(told)


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
