"""Explanations of differences: simspec explain on a terminal, and as tables of a study."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from simspec.attribution.candidates import Kind
from simspec.attribution.configuration import model_lines
from simspec.attribution.explanation import WORDS, Explanation, percent, ranged, verdict
from simspec.attribution.measure import RUN, Swap, acting, useful
from simspec.attribution.windows import ALL, CLASSES
from simspec.report.plain import plain
from simspec.report.screen import console
from simspec.report.study.runs import Done, StudyTable, finite
from simspec.report.table import DIM, Table, TableCell

# ``simspec explain`` on a terminal: the verdict, the steps that led to it, and a table of all swaps.

MOST_ROWS = 12
"""Swaps in the table; the others are counted."""


def explanation_data(explanation: Explanation) -> dict[str, Any]:
    """The explanation as plain data, with its verdict."""
    data: dict[str, Any] = plain(explanation)
    return {"verdict": list(verdict(explanation)), **data}


def show_explanation(explanation: Explanation, notes: Sequence[str] = ()) -> None:
    """Print an explanation."""
    screen = console()
    for line in verdict(explanation):
        screen.print(line, soft_wrap=True)
    screen.print("")
    screen.print(f"A: {explanation.first}", soft_wrap=True)
    screen.print(f"B: {explanation.second}", soft_wrap=True)
    for line in (*steps(explanation), *explanation.notes, *notes):
        screen.print(line, soft_wrap=True)
    if explanation.causes or explanation.probes:
        screen.print(swaps_table(explanation))


def steps(explanation: Explanation) -> Iterator[str]:
    """The steps, one line each: models, smooth motion, what was given differently, windows, first contact."""
    yield from model_lines(explanation.models, explanation.same_world, "; --verify proves it")
    given = [swap.name for swap in explanation.causes]
    yield f"given differently: {', '.join(given) if given else 'nothing'}"
    looked = sum(explanation.counts.values())
    sample = f", {explanation.looked_at} looked at" if explanation.looked_at < looked else ""
    sample += f", {explanation.hidden} left out, in which noise hides the gap" if explanation.hidden else ""
    yield f"windows: {looked} of {explanation.length:g} s, all from A's states{sample}"
    for name in (*CLASSES, RUN):
        if name in explanation.gap:
            yield f"  {_gap(explanation, name)}"
    contact = explanation.contact
    if contact is None:
        yield "first contact: none in A's run" if not _touches(explanation) else "first contact: not comparable"
        return
    told = f"first contact: {' and '.join(contact.bodies)}, both from A's state before it"
    yield f"{told}: {contact.differs or 'nothing'} differs first"
    units = {"depth": (1e6, " µm"), "normal force": (1.0, " N"), "points": (1.0, "")}
    for name, values in contact.quantities.items():
        factor, unit = units[name]
        one, other = ("no contact" if value is None else f"{value * factor:.5g}{unit}" for value in values)
        yield f"  {name}: {one} in A, {other} in B"


def _touches(explanation: Explanation) -> bool:
    return any(explanation.counts[name] for name in ("impact", "contact"))


def _gap(explanation: Explanation, name: str) -> str:
    count = explanation.counts.get(name)
    gap, floor = explanation.gap[name], explanation.floor.get(name, 0.0)
    words = f"{WORDS[name]} ({count})" if count is not None else WORDS[name]
    same = "" if name in explanation.telling else ": the same, to round-off"
    return f"{words}: mean gap {gap:.3g} m, noise {floor:.2g} m{same}"


def swaps_table(explanation: Explanation) -> Table:
    """The swaps with their shares by class, the largest first."""
    classes = [name for name in explanation.telling if name != ALL] + ([ALL] if ALL in explanation.telling else [])
    title = "swaps: one thing changed, and the share of the gap that it closes"
    right = range(3, 3 + len(classes))
    shown = Table(title, "what is changed", "from", "to", *(WORDS[name] for name in classes), right=list(right))
    for one in explanation.declared:
        if one.predicted:
            cells = ["" if name not in one.share else percent(one.share[name]) for name in classes]
            shown.add(f"{one.acts}, as declared", one.engine, "predicted", *cells)
    swaps = [*_ranked(explanation.causes), *_ranked(explanation.probes)]
    if any(share < 0.0 for swap in swaps[:MOST_ROWS] for share in swap.share.values()):
        shown.note = "negative: the gap grows by this share with the change"
    for swap in swaps[:MOST_ROWS]:
        cells = ["" if name not in swap.share else percent(swap.share[name]) for name in classes]
        if swap.failed is not None:
            cells = ["not possible"] + [""] * (len(classes) - 1) if classes else []
        elif not swap.share and classes:
            cells[0] = "none"
        before, after = swap.values if swap.kind != Kind.DIFFERENCE.value else swap.values[::-1]
        shown.add(swap.name, before, after, *cells)
    if len(swaps) > MOST_ROWS:
        shown.add(f"and {len(swaps) - MOST_ROWS} more (--json)", "", "", *[""] * len(classes))
    return shown


def _ranked(swaps: Sequence[Swap]) -> list[Swap]:
    return sorted(swaps, key=lambda swap: (swap.failed is not None, -swap.largest))


# Where the engines of a sweep differ from its first one, and what of that has a cause: what ``simspec explain`` finds of each
# (``docs/guide/explain.md``).

MOST = 3
"""Causes, and choices beside them, that the table names of an engine; the records have all."""
TITLE = "Where each engine differs from the first, within windows"
CAUSES = "What of that difference is closed by which value or choice"
NOTE = (
    "Both engines begin each window in the first one's states. Gap: mean distance at its end, over all bodies; unexplained: "
    "the share that no value, setting or choice closes"
)


def attribution_tables(done: Done) -> list[StudyTable]:
    """``attribution`` and ``attribution.causes``."""
    classes = [
        name
        for name in (*CLASSES, RUN)
        if any(one.found is not None and name in one.found.gap for one in done.explained)
    ]
    heads = [f"gap, {WORDS[name]}" for name in classes]
    right = range(1, 1 + len(heads))
    gaps = StudyTable(done, "attribution", TITLE, "engine", *heads, "unexplained", right=right)
    causes = StudyTable(done, "attribution.causes", CAUSES, "engine", "what", "from", "to", "closes")
    for one in done.explained:
        found = one.found
        if found is None:
            record: dict[str, Any] = {"engine": one.engine, "first": one.first, "refused": one.refused}
            gaps.add(one.engine, *(["–"] * len(heads)), TableCell(one.refused, DIM), record=record)
            continue
        telling = found.telling
        cells = [_length(found.gap.get(name), name in telling) for name in classes]
        left = {name: share for name, share in found.unexplained.items() if name in (*CLASSES, RUN)}
        unexplained = ", ".join(f"{percent(max(share, 0.0))} {WORDS[name]}" for name, share in left.items())
        record = {"engine": one.engine, "first": one.first, "windows": found.looked_at, "length": found.length}
        record |= {f"gap.{name}": finite(value) for name, value in found.gap.items()}
        record |= {f"unexplained.{name}": finite(value) for name, value in left.items()}
        gaps.add(one.engine, *cells, unexplained or "nothing to explain", record=record)
        for swap in _told(found.causes, found.probes):
            before, after = swap.values
            record = {"engine": one.engine, "first": one.first, "what": swap.name, "from": before, "to": after}
            record |= {"kind": swap.kind} | {f"share.{name}": finite(share) for name, share in swap.share.items()}
            causes.add(one.engine, swap.name, before, after, _shares(swap), record=record)
        gaps.said += tuple(f"{one.engine} beside {one.first}: {line}" for line in verdict(found)[:MOST])
    gaps.note = NOTE
    return [gaps, causes]


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
