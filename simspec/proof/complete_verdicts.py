"""What became of the mutations of the complete self-test, and its counts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from simspec.dialects.kit.mutations import KINDS, MutationTable

VERDICTS = ("caught", "refused", "inert", "missed")


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of one mutation: ``verdict`` is one of ``VERDICTS``, ``by`` the first level that noticed, ``why`` what it
    said, or what the engine refused it with, or the reason that is declared for its being inert; ``row`` names the row of
    the dialect's table that declares it."""

    engine: str
    world: str
    file: str
    kind: str
    site: str
    place: str
    change: str
    verdict: str
    by: str = ""
    why: str = ""
    row: str = ""


@dataclass(frozen=True)
class CompleteTest:
    """All verdicts; ``skipped``: worlds that an engine was not tested with, with the reason, by "engine, world"; ``versions``
    by engine; ``seconds`` in all; ``unused``: by engine the rows of its dialect's table that declare something inert and no
    change needed, known only when every world and every change was tried."""

    verdicts: tuple[Verdict, ...]
    skipped: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    unused: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def count(self, engine: str | None = None, kind: str | None = None, verdict: str | None = None) -> int:
        """How many there are of an engine, a kind of change, a verdict (None: all)."""
        return sum(
            engine in (None, entry.engine) and kind in (None, entry.kind) and verdict in (None, entry.verdict)
            for entry in self.verdicts
        )

    @property
    def engines(self) -> tuple[str, ...]:
        """The engines, in the order in which they were tested."""
        return tuple(dict.fromkeys(verdict.engine for verdict in self.verdicts))

    @property
    def missed(self) -> tuple[Verdict, ...]:
        """What went unseen."""
        return tuple(verdict for verdict in self.verdicts if verdict.verdict == "missed")

    @property
    def passed(self) -> bool:
        """Whether something was planted and nothing missed."""
        return bool(self.verdicts) and not self.missed

    def rows(self) -> list[tuple[str, str, tuple[int, ...]]]:
        """(engine, kind, (planted, caught, refused, inert, missed)) for each that occurs, and a sum ("all") per engine."""
        rows = []
        for engine in self.engines:
            for kind in (*KINDS, None):
                counts = tuple(self.count(engine, kind, verdict) for verdict in (None, *VERDICTS))
                if counts[0]:
                    rows.append((engine, kind or "all", counts))
        return rows


def unused_rows(table: MutationTable, verdicts: Iterable[Verdict]) -> tuple[str, ...]:
    """The rows of ``table`` that declare something inert, and by which none of ``verdicts`` is."""
    used = {verdict.row for verdict in verdicts if verdict.verdict == "inert"}
    return tuple(dict.fromkeys(row.name for row in table.inert if row.name not in used))
