"""``simspec explain`` on a terminal: the verdict, the steps that led to it, and a table of all swaps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from rich.table import Table

from simspec.attribution.candidates import Kind
from simspec.attribution.explanation import Explanation
from simspec.attribution.judge import Swap
from simspec.attribution.measure import RUN
from simspec.attribution.models import model_lines
from simspec.attribution.verdict import WORDS, percent, verdict
from simspec.attribution.windows import ALL, CLASSES
from simspec.report.kit import table
from simspec.report.plain import plain
from simspec.report.screen import console

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
    shown = table(title, "what is changed", "from", "to", *(WORDS[name] for name in classes), right=list(right))
    for one in explanation.declared:
        if one.predicted:
            cells = ["" if name not in one.share else percent(one.share[name]) for name in classes]
            shown.add_row(f"{one.acts}, as declared", one.engine, "predicted", *cells)
    swaps = [*_ranked(explanation.causes), *_ranked(explanation.probes)]
    if any(share < 0.0 for swap in swaps[:MOST_ROWS] for share in swap.share.values()):
        shown.caption = "negative: the gap grows by this share with the change"
    for swap in swaps[:MOST_ROWS]:
        cells = ["" if name not in swap.share else percent(swap.share[name]) for name in classes]
        if swap.failed is not None:
            cells = ["not possible"] + [""] * (len(classes) - 1) if classes else []
        elif not swap.share and classes:
            cells[0] = "none"
        before, after = swap.values if swap.kind != Kind.DIFFERENCE.value else swap.values[::-1]
        shown.add_row(swap.name, before, after, *cells)
    if len(swaps) > MOST_ROWS:
        shown.add_row(f"and {len(swaps) - MOST_ROWS} more (--json)", "", "", *[""] * len(classes))
    return shown


def _ranked(swaps: Sequence[Swap]) -> list[Swap]:
    return sorted(swaps, key=lambda swap: (swap.failed is not None, -swap.largest))
