"""Where the engines of a sweep differ from its first one, and what of that has a cause: what ``simspec explain`` finds of each
(``docs/guide/explain.md``)."""

from __future__ import annotations

from rich.text import Text

from simspec.attribution.candidates import Kind
from simspec.attribution.judge import Swap, acting, useful
from simspec.attribution.measure import RUN
from simspec.attribution.verdict import WORDS, percent, ranged, verdict
from simspec.attribution.windows import CLASSES
from simspec.report.kit import table
from simspec.report.study.done import Done, Record, Shown, finite

MOST = 3
"""Causes, and choices beside them, that the table names of an engine; the records have all."""
TITLE = "Where each engine differs from the first, within windows"
CAUSES = "What of that difference is closed by which value or choice"
NOTE = (
    "Both engines begin each window in the first one's states. Gap: mean distance at its end, over all bodies; unexplained: "
    "the share that no value, setting or choice closes"
)


def attribution_tables(done: Done) -> list[Shown]:
    """``attribution`` and ``attribution.causes``."""
    classes = [
        name
        for name in (*CLASSES, RUN)
        if any(one.found is not None and name in one.found.gap for one in done.explained)
    ]
    heads = [f"gap, {WORDS[name]}" for name in classes]
    gaps = table(f"{done.sweep.name}: {TITLE}", "engine", *heads, "unexplained", right=list(range(1, 1 + len(heads))))
    causes = table(f"{done.sweep.name}: {CAUSES}", "engine", "what", "from", "to", "closes")
    records: list[Record] = []
    own: list[Record] = []
    said: list[str] = []
    for one in done.explained:
        found = one.found
        if found is None:
            gaps.add_row(one.engine, *(["–"] * len(heads)), Text(one.refused, style="dim"))
            records.append({"engine": one.engine, "first": one.first, "refused": one.refused})
            continue
        telling = found.telling
        cells = [_length(found.gap.get(name), name in telling) for name in classes]
        left = {name: share for name, share in found.unexplained.items() if name in (*CLASSES, RUN)}
        told = ", ".join(f"{percent(max(share, 0.0))} {WORDS[name]}" for name, share in left.items())
        gaps.add_row(one.engine, *cells, told or "nothing to explain")
        records.append(
            {"engine": one.engine, "first": one.first, "windows": found.looked_at, "length": found.length}
            | {f"gap.{name}": finite(value) for name, value in found.gap.items()}
            | {f"unexplained.{name}": finite(value) for name, value in left.items()}
        )
        for swap in _told(found.causes, found.probes):
            before, after = swap.values
            causes.add_row(one.engine, swap.name, before, after, _shares(swap))
            own.append(
                {"engine": one.engine, "first": one.first, "what": swap.name, "from": before, "to": after}
                | {"kind": swap.kind}
                | {f"share.{name}": finite(share) for name, share in swap.share.items()}
            )
        said += [f"{one.engine} beside {one.first}: {line}" for line in verdict(found)[:MOST]]
    gaps.caption = NOTE
    return [
        Shown("attribution", gaps, records, tuple(said)),
        Shown("attribution.causes", causes, own),
    ]


def _told(causes: tuple[Swap, ...], probes: tuple[Swap, ...]) -> list[Swap]:
    """What acts of what differs, what helps of the engines' other choices, and what has to be there for them to differ; of
    each the largest first."""
    ranked = sorted(useful(probes), key=lambda swap: -swap.largest)
    chosen = [swap for swap in ranked if swap.kind != Kind.REMOVAL.value]
    places = [swap for swap in ranked if swap.kind == Kind.REMOVAL.value]
    return [*acting(causes)[:MOST], *chosen[:MOST], *places[:MOST]]


def _length(value: float | None, tells: bool) -> str:
    if value is None:
        return "–"
    return f"{value:.2g} m" if tells else "the same"


def _shares(swap: Swap) -> str:
    shares = {name: share for name, share in swap.share.items() if name in (*CLASSES, RUN)}
    return (
        ", ".join(f"{ranged(share, swap.interval.get(name))} {WORDS[name]}" for name, share in shares.items()) or "none"
    )
