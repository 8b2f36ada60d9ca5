"""How far the bodies of a sweep's runs are moved from where they began: towers that stand, creep or fall."""

from __future__ import annotations

from rich.text import Text

from simspec.analysis.displacement import Displacement, displacement
from simspec.report.kit import table
from simspec.report.study.digits import two_digits
from simspec.report.study.done import Done, Record, Shown, finite, milliseconds
from simspec.report.study.variants import PLAIN, Variant, timesteps_of, unsupported_table, variants

TITLE = "How far free bodies are moved: sideways at most / down at the end (mm)"
NOTE = (
    "the furthest of all bodies and runs; a body has left its place when it is moved sideways by more than its size (the "
    "radius of the largest sphere in it)"
)


def displacement_tables(done: Done) -> list[Shown]:
    """``displacement``."""
    made = variants(done)
    steps = timesteps_of(made)
    shown = table(f"{done.sweep.name}: {TITLE}", "settings", "engine", *map(milliseconds, steps))
    records: list[Record] = []
    for one in made:
        if not one.supported:
            continue
        cells = []
        for step in steps:
            text, record = _at(done, one, step)
            cells.append(text)
            records += [record] if record is not None else []
        shown.add_row(one.label, one.engine, *cells)
    shown.caption = NOTE
    return [Shown("displacement", shown, records), Shown("displacement.unsupported", unsupported_table(done, made))]


def _at(done: Done, one: Variant, step: float) -> tuple[Text, Record | None]:
    """The worst of the runs of a timestep, as a cell and as data."""
    runs = one.runs.get(step, [])
    if not runs or any(one.refused(row) for _, row in runs):
        return Text(PLAIN, style="dim"), None
    record: dict[str, object] = {"settings": one.label, "engine": one.engine, "timestep": step, "runs": len(runs)}
    failed = next((row.failed for _, row in runs if row.failed is not None), None)
    if failed is not None:
        return Text("failed", style="bold red"), record | {"failed": failed}
    moved = [displacement(done.store.load(row.key)) for _, row in runs]
    first = min((entry.left for entry in moved if entry.left is not None), default=None)
    sideways, down = max(entry.sideways for entry in moved), max(entry.down for entry in moved)
    record |= {"sideways": finite(sideways), "down": finite(down), "left_at": first}
    return _told(moved, sideways, down, first), record


def _told(moved: list[Displacement], sideways: float, down: float, first: float | None) -> Text:
    if first is None:
        return Text(f"{two_digits(1e3 * sideways)} / {two_digits(1e3 * down)}")
    fell = sum(entry.left is not None for entry in moved)
    share = f" ({fell} of {len(moved)} runs)" if len(moved) > 1 else ""
    return Text(f"left its place at {first:.1f} s{share}", style="bold red")
