"""Tables of differences: each engine's own noise, where runs differ, what changed between two worlds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from simspec.comparison.floor import FLOOR_FACTOR, Floor
from simspec.comparison.runs import (
    INCONCLUSIVE,
    OUT,
    QUANTITIES,
    SHOWN_BODIES,
    WITHIN,
    BodyDiff,
    Diff,
    out_words,
    summary,
)
from simspec.comparison.worlds import Change
from simspec.report.screen import console
from simspec.report.table import (
    BAD,
    DIM,
    GOOD,
    WARNING,
    Table,
    TableCell,
    csv_text,
    latex_text,
    length,
    number,
    passed_cell,
    records_table,
)

if TYPE_CHECKING:
    from simspec.comparison.study import Study

SHOWN_PER_GROUP = 8
"""Changes of one list or mapping that are listed; a row counts the others."""
SHOWN_CHANGES = 60
"""Rows of the table of changes."""
WIDTHS = (33, 17)
"""Characters of the columns of the largest differences and of what is out of tolerance, so that rows have 80."""
SHOWN_PAIRS = 3
"""Pairs that touch in one run only that a comparison lists."""


def repeatability(floors: Mapping[str, Floor]) -> Table | None:
    """Each engine's own noise."""
    if not floors:
        return None
    columns = ("engine", "repeated run", "initial state moved by", "largest deviation")
    repeats = Table("Repeatability", *columns, right=(2, 3))
    words = {True: "bitwise equal", False: "bits differ", None: "not run"}
    for name, floor in floors.items():
        moved = f"{floor.perturbation:g}" if floor.perturbation else "–"
        cached = " (cached)" if floor.cached else ""
        repeats.add(name, words[floor.bitwise] + cached, moved, length(floor.largest))
    return repeats


def differences(diffs: Sequence[Diff]) -> Table | None:
    """Where the engines differ: one row per pair of runs."""
    if not diffs:
        return None
    title = f"Differences between engines  (tolerance {tolerances(diffs[0])}, or {FLOOR_FACTOR:g} × noise)"
    pairs = Table(title, "runs", "largest", "out of tolerance", "noise,\nuntil", right=(3,))
    for column, width in zip(pairs.columns[1:3], WIDTHS, strict=True):
        column.width = width
    for diff in diffs:
        worst, out = diff.worst if has_figures(diff) else None, diff.first_out
        noise = (
            length(worst.floor) if worst else _noise(diff, diff.inconclusive_body) if diff.inconclusive_body else "–"
        )
        pairs.add(
            f"{diff.first.split()[0]} –\n{diff.second.split()[0]}",
            "\n".join(_largest(diff)) if worst else "–",
            TableCell(f"{out.body} at {out.first_out:.4g} s, {out.cause}:\n{out_words(out)}", WARNING)
            if out
            else _stays(diff),
            f"{noise}\n{diff.compared_until:.4g} s" + ("\n(chaos)" if diff.horizon is not None else ""),
        )
    for why in dict.fromkeys(diff.not_compared for diff in diffs if diff.not_compared):
        pairs.note = f"{pairs.note}\n{why}" if pairs.note else why
    return pairs


def matrix(diffs: Sequence[Diff]) -> Table | None:
    """The largest difference in position of each pair of engines, as a matrix; None for fewer than two pairs."""
    if len(diffs) < 2:
        return None
    names = list(dict.fromkeys(name for diff in diffs for name in (diff.first.split()[0], diff.second.split()[0])))
    cells = {}
    for diff in diffs:
        tone = {WITHIN: GOOD, OUT: BAD}.get(diff.verdict, WARNING)
        worst = diff.worst if has_figures(diff) else None
        cell = TableCell(length(worst.position_largest) if worst is not None else "–", tone)
        pair = diff.first.split()[0], diff.second.split()[0]
        cells[pair] = cells[pair[::-1]] = cell
    title = f"Largest difference in position  (tolerance {tolerances(diffs[0])})"
    rows = Table(title, "", *names, right=range(1, len(names) + 1))
    for name in names:
        rows.add(name, *(cells.get((name, other), TableCell("", DIM)) for other in names))
    return rows


def tolerances(diff: Diff) -> str:
    """The tolerances in position and angle of a comparison."""
    return f"{length(diff.tolerance)} and {diff.angle_tolerance:g} rad"


def has_figures(diff: Diff) -> bool:
    """Whether a comparison has figures that can be shown."""
    return not diff.not_compared or diff.first_out is not None


def _largest(diff: Diff) -> Iterator[str]:
    """The largest differences in position and angle of a body, and in the coordinate of a joint, and of what and when."""
    if (place := diff.worst) is not None:
        yield f"{length(place.position_largest)}: {place.body} at {place.time_of_largest:.4g} s"
    if (turn := diff.worst_angle) is not None:
        yield f"{angle(turn.angle_largest)}: {turn.body} at {turn.time_of_largest_angle:.4g} s"
    for unit in ("rad", "m"):
        joint = next((joint for joint in diff.joints if joint.unit == unit), None)
        if joint is not None:
            size = angle(joint.largest) if unit == "rad" else length(joint.largest)
            yield f"{size}: joint {joint.joint} at {joint.time:.4g} s"


def angle(value: float) -> str:
    """An angle (rad) for reading: three digits, of very small ones two."""
    return f"{value:.3g} rad" if not 0.0 < value < 1e-6 else f"{value:.1e} rad"


def _stays(diff: Diff) -> TableCell:
    """The cell of a comparison in which nothing is out of tolerance."""
    if diff.not_compared:
        return TableCell("inconclusive: nothing was compared", WARNING)
    if diff.inconclusive_body is not None:
        return TableCell(f"inconclusive: noise {_noise(diff, diff.inconclusive_body)}", WARNING)
    return _never(diff)


def _never(diff: Diff) -> TableCell:
    return passed_cell(True, "never" if diff.horizon is None else f"not before {diff.compared_until:.4g} s")


def _out(diff: Diff, body: BodyDiff) -> TableCell:
    """When a body was first out of tolerance."""
    if body.first_out is not None:
        return TableCell(f"{body.first_out:.4g} s ({body.cause}): {out_words(body)}", WARNING)
    if not body.compared or body.inconclusive_from is not None:
        return TableCell("inconclusive" if body.compared else "inconclusive: not compared", WARNING)
    return _never(diff)


def inconclusive_note(diff: Diff) -> str | None:
    """Advice about an inconclusive comparison; None for a conclusive one."""
    body = diff.inconclusive_body
    if body is None or diff.verdict != INCONCLUSIVE:
        return None
    if diff.not_compared:
        return f"{diff.first} – {diff.second}: {not_compared_words(diff)}"
    return (
        f"{diff.first} – {diff.second}: agreement within {tolerances(diff)} is inconclusive, because the engines' noise is "
        f"{_noise(diff, body)} ({body.body}, from {body.inconclusive_from:.4g} s on); use a tolerance above "
        f"{FLOOR_FACTOR:g} times the noise"
    )


def not_compared_words(diff: Diff) -> str:
    """That a comparison of nothing is inconclusive, why, and what to do about it."""
    text = f"agreement within {tolerances(diff)} is inconclusive, because {diff.not_compared}"
    advice = f"; use a shorter record.every, or a tolerance above {FLOOR_FACTOR:g} times it"
    return text + (advice if diff.horizon is not None else "")


def _noise(diff: Diff, body: BodyDiff) -> str:
    """The noise of a body, in position or in angle: the larger share of its tolerance."""
    place, turn = body.floor or 0.0, body.angle_floor or 0.0
    return number(turn, "rad") if turn * diff.tolerance > place * diff.angle_tolerance else length(place)


def diff_tables(diff: Diff) -> list[Table]:
    """One comparison in full: the bodies, then the quantities."""
    title = f"{diff.first} – {diff.second}, until {diff.compared_until:.4g} s  (tolerance {tolerances(diff)})"
    columns = ("body", "largest", "RMS", "angle, largest", "RMS", "noise", "first out of tolerance")
    bodies = Table(title, *columns, right=(1, 2, 3, 4, 5))
    for body in diff.bodies[:SHOWN_BODIES]:
        bodies.add(
            body.body,
            *(length(value if body.compared else None) for value in (body.position_largest, body.position_rms)),
            *(number(value if body.compared else None, "rad") for value in (body.angle_largest, body.angle_rms)),
            length(body.floor) if body.compared else _noise(diff, body),
            _out(diff, body),
        )
    if len(diff.bodies) > SHOWN_BODIES:
        bodies.note = f"and {len(diff.bodies) - SHOWN_BODIES} more bodies, with smaller differences"
    scalars = Table("Quantities", "", diff.first, diff.second, "difference", right=(1, 2, 3))
    for item in diff.quantities:
        gap = item.second - item.first if item.first is not None and item.second is not None else None
        if item.first is not None or item.second is not None:
            scalars.add(item.name, *(number(value, item.unit) for value in (item.first, item.second, gap)))
    if diff.first_contact is not None:
        name, other = (_pairs(pairs) for pairs in (diff.first_contact.first_only, diff.first_contact.second_only))
        scalars.add("first contact that differs", name, other, number(diff.first_contact.time, "s"))
    return [bodies, _joints(diff), scalars] if diff.joints and has_figures(diff) else [bodies, scalars]


def _joints(diff: Diff) -> Table:
    """The joints whose coordinates differ most, in rad and in m."""
    joints = Table("Joint coordinates", "joint", "largest", "at", right=(1, 2))
    for unit in ("rad", "m"):
        for entry in [joint for joint in diff.joints if joint.unit == unit][:SHOWN_BODIES]:
            size = angle(entry.largest) if unit == "rad" else length(entry.largest)
            joints.add(entry.joint, size, f"{entry.time:.4g} s")
    return joints


def _pairs(pairs: Sequence[tuple[str, str]]) -> str:
    """Pairs that touch in one run only: the first ones, and the number of the others."""
    text = "\n".join(" and ".join(pair) for pair in pairs[:SHOWN_PAIRS])
    return f"{text}\nand {len(pairs) - SHOWN_PAIRS} more" if len(pairs) > SHOWN_PAIRS else text or "–"


def changes(changed: Sequence[Change]) -> Table:
    """The changes between two worlds: the first ones of each list or mapping, and the number of the others. How many there
    are in all is the note; the JSON of the command lists every change."""
    result = Table("Changes of the world", "", "path", "before", "after")
    signs = {"added": TableCell("+", GOOD), "removed": TableCell("-", BAD), "changed": TableCell("~", WARNING)}
    groups: dict[str, list[Change]] = {}
    for change in changed:
        groups.setdefault(change.path.rpartition(".")[0], []).append(change)
    rows = 0
    for place, group in groups.items():
        shown = group if len(group) <= SHOWN_PER_GROUP + 1 else group[:SHOWN_PER_GROUP]
        for change in shown[: max(0, SHOWN_CHANGES - rows)]:
            values = change.before if change.after is None else change.after
            is_entry = isinstance(values, dict) or (values is True and change.kind != "changed")
            cells = ("", "") if is_entry else (_value(change.before), _value(change.after))
            result.add(signs[change.kind], f"{change.path}{f' ({change.joint})' if change.joint else ''}", *cells)
            rows += 1
        if len(shown) < len(group) and rows < SHOWN_CHANGES:
            result.add("", f"{place}: {len(group) - len(shown):,} more", "", "")
            rows += 1
    if any(len(group) > SHOWN_PER_GROUP + 1 for group in groups.values()) or rows < len(changed):
        result.note = f"{len(changed):,} changes in all; --json lists every one"
    return result


def _value(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, list):
        return f"[{', '.join(_value(item) for item in value)}]"
    return str(value)


# Tables of a study for papers and spreadsheets: CSV and LaTeX.


def runs_table(study: Study) -> Table:
    """A row for each run of a study: engine, failure, expectations, speed, and its quantities at the end."""
    rows = []
    for label, run in study.runs.items():
        outcomes, quantities = study.outcomes.get(label, ()), summary(run)
        rows.append(
            {"engine": label, "version": run.provenance.get("engine_version"), "failed": run.failed}
            | {"passed": sum(outcome.passed for outcome in outcomes), "expected": len(outcomes)}
            | {name: getattr(run, name) for name in ("real_time_factor", "cpu_factor", "end_to_end_factor")}
            | {f"{name}, {unit}" if unit else name: quantities.get(name) for name, unit in QUANTITIES}
        )
    return records_table(f"Runs of {study.world.name}", rows)


MEASURES = {
    "largest, m": "position_largest",
    "rms, m": "position_rms",
    "largest angle, rad": "angle_largest",
    "time of largest, s": "time_of_largest",
    "time of largest angle, s": "time_of_largest_angle",
}
"""Columns of figures that a body has where it was compared, with their names in a comparison."""


def differences_table(study: Study) -> Table:
    """A row for each pair of engines and body of a study."""
    rows = [
        {"first": diff.first, "second": diff.second, "body": body.body, "verdict": body.verdict}
        | {head: getattr(body, name) if body.compared else None for head, name in MEASURES.items()}
        | {"first out, s": body.first_out, "first out of": " and ".join(body.exceeded) or None}
        | {"cause": body.cause or None, "noise, m": body.floor, "compared until, s": diff.compared_until}
        for diff in study.diffs
        for body in diff.bodies
    ]
    return records_table(f"Differences between engines in {study.world.name}", rows)


def study_tables(study: Study, form: str) -> dict[str, str]:
    """Every table of a study by the name of its file: ``runs`` and ``differences``, as ``csv`` or ``tex``. Raises ValueError
    for another form."""
    if form not in ("csv", "tex"):
        raise ValueError(f"no form of tables: {form}")
    tables = {"runs": runs_table(study), "differences": differences_table(study)}
    return {
        f"{name}.{form}": csv_text(table) if form == "csv" else latex_text(table, label=f"tab:{name}")
        for name, table in tables.items()
        if table.rows
    }


def show_diff(diff: Diff) -> None:
    """Print the comparison of two runs."""
    screen = console()
    for table in diff_tables(diff):
        screen.print(table)
    for note in diff.notes:
        screen.note(f"note: {note}")
    show_inconclusive([diff])


def show_inconclusive(diffs: Sequence[Diff]) -> None:
    """Print on standard error why comparisons are inconclusive."""
    for diff in diffs:
        if (why := inconclusive_note(diff)) is not None:
            console(error=True).message(why, style="yellow")
