"""What the elements and attributes of a language become: rows of data, which the documentation is written from.

An importer with such a table offers it as ``table``, a function that gives rows, and its rules of repair by name as ``rules``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from simspec.language.foreign import Fate, Severity


@dataclass(frozen=True, slots=True)
class Row:
    """One element, or one attribute (``/@name``), by its tags below the outermost element."""

    where: str
    becomes: str = ""
    """The words of the spec; "" for what is not carried."""
    fate: Fate = Fate.CARRIED
    severity: Severity = Severity.PHYSICS
    reason: str = ""
    hint: str = ""
    when: str = ""
    """In which case only; "" for always."""


def markdown(rows: Iterable[Row]) -> Iterator[str]:
    """The lines of the table of a language; attributes of one element that become the same stand in one row."""
    yield "| element or attribute | becomes | where it is not carried |"
    yield "|---|---|---|"
    groups: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        groups.setdefault(
            (row.where.rpartition("/@")[0] if "@" in row.where else "", row.becomes, _fate(row)), []
        ).append(row.where)
    for (_, becomes, fate), places in groups.items():
        yield f"| {', '.join(f'`{place}`' for place in places)} | {_cell(becomes)} | {_cell(fate)} |"


def _fate(row: Row) -> str:
    if row.fate is Fate.CARRIED and not row.when:
        return ""
    changes = f" ({row.severity.value})" if row.fate is Fate.LOST else ""
    said = f"{row.fate.value}{changes}: {row.reason}" + (f"; {row.hint}" if row.hint else "")
    return f"{row.when}: {said}" if row.when else said


def losses_markdown(losses: Sequence[tuple[str, Severity, str, str]]) -> Iterator[str]:
    """What a language has and a spec does not say, as a table: where files say it, what that changes, why, and the way out."""
    yield "| element or attribute | changes | why it is not carried |"
    yield "|---|---|---|"
    for words, severity, reason, hint in losses:
        where = ", ".join(f"`{word}`" for word in words.split())
        yield f"| {where} | {severity.value} | {reason}{f'; `{hint}`' if hint else ''} |"


def rules_markdown(rules: Mapping[str, str]) -> Iterator[str]:
    """The lines of the table of rules of repair."""
    yield "| rule | what it does |"
    yield "|---|---|"
    for name, meaning in rules.items():
        yield f"| `{name}` | {_cell(meaning)} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
