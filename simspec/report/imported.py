"""Tables of an import: what it does not carry, and what it repaired."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from simspec.language.foreign import Repair
from simspec.language.losses import Group, kind_of
from simspec.report.kit import table


def losses_table(file: str, groups: Sequence[Group]) -> Table:
    """One row for each kind of loss, with the place of the first and the number of all."""
    rows = table(f"What the import of {file} does not carry", "what", "changes", "why", "line", "count", right=(3, 4))
    for group in groups:
        first = group.first
        why = f"{first.reason}; {first.hint}" if first.hint else first.reason
        rows.add_row(kind_of(first), first.severity.value, why, str(first.location.line), str(group.count))
    return rows


def repairs_table(repairs: Sequence[Repair]) -> Table:
    """One row for each repair."""
    rows = table("What was repaired", "rule", "what", "line", right=(2,))
    for repair in repairs:
        rows.add_row(repair.rule, repair.what, str(repair.location.line))
    return rows
