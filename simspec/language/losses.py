"""What an import does not carry, and what it repaired, for people: counted, grouped, and as warnings."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from simspec.errors import Problem
from simspec.language.foreign import Account, Fate, Imported, Repair, Severity

if TYPE_CHECKING:
    from simspec.language.sources import Source

_IN_BRACKETS: Final = re.compile(r"\[[^\]]*\]")
ORDER: Final = (Severity.PHYSICS, Severity.APPEARANCE, Severity.INFORMATION)


@dataclass(frozen=True, slots=True)
class Group:
    """Accounts that say the same of the same kind of thing; the first of them stands for all."""

    first: Account
    count: int


def kind_of(account: Account) -> str:
    """What an account is of, without names: ``joint/mimic/@multiplier``."""
    return _IN_BRACKETS.sub("", account.what)


def grouped(accounts: Iterable[Account]) -> list[Group]:
    """Losses by kind and reason, those that change physics first, each kind in the order of the file."""
    groups: dict[tuple[Any, ...], list[Account]] = {}
    for account in accounts:
        key = (kind_of(account), account.severity, account.reason)
        groups.setdefault(key, []).append(account)
    rows = [Group(members[0], len(members)) for members in groups.values()]
    return sorted(rows, key=lambda group: ORDER.index(group.first.severity))


def counts(imported: Imported) -> dict[str, int]:
    """How many elements and attributes have which fate, and how many of the lost ones change physics."""
    fates = Counter(account.fate for account in imported.accounts)
    physics = sum(account.severity is Severity.PHYSICS for account in imported.losses())
    return {
        "carried": fates[Fate.CARRIED],
        "carried_but_unused": fates[Fate.UNUSED],
        "lost": fates[Fate.LOST],
        "lost_of_physics": physics,
    }


def of_physics(imported: Imported) -> list[Account]:
    """The losses that change physics."""
    return [account for account in imported.losses() if account.severity is Severity.PHYSICS]


def problems(accounts: Sequence[Account]) -> Iterator[Problem]:
    """Losses as problems, of each kind the first with the number of the others."""
    for group in grouped(accounts):
        account, more = group.first, group.count - 1
        counted = f" (and {more} more)" if more else ""
        message = f"the import loses {kind_of(account)}{counted}: {account.reason}"
        yield Problem(message, account.what, account.location, hint=account.hint or None)


def repaired(sources: Iterable[Source]) -> list[Repair]:
    """The repairs of all files of other languages among ``sources``, each once."""
    return list(
        dict.fromkeys(repair for source in sources if source.imported is not None for repair in source.imported.repairs)
    )


def repairs_data(repairs: Iterable[Repair]) -> list[dict[str, Any]]:
    """Repairs as plain data: the rule, the place, what was changed, and where the spec has it."""
    return [
        {
            "rule": repair.rule,
            "file": repair.location.file,
            "line": repair.location.line,
            "what": repair.what,
            "path": repair.path,
        }
        for repair in repairs
    ]
