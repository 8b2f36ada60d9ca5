"""Pages of tools/planted.py: a summary in docs/records/proof-figures.md, all results in docs/records/planted-contact.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from planted_defects import DEFECTS

from simspec.engines.kit.registry import find_engine

ROOT = Path(__file__).resolve().parent.parent
PAGE, RECORD = ROOT / "docs" / "records" / "proof-figures.md", ROOT / "docs" / "records" / "planted-contact.md"
BEGIN, END = "<!-- planted in coupled probes: made by tools/planted.py -->", "<!-- end of planted in coupled probes -->"
FAILS = "fails"
"""Verdict of an unchanged law of which a figure fails."""
VERDICTS = ("seen", "hidden", "blind", "inert", "refused")
Row = Mapping[str, Any]
"""The fields of a ``planted.Result``."""

ABOUT = """\
# Defects planted in contact of several bodies

> With this page you can see which defects of contact the proof detects.

Each cell: the figures of coupled probes that fail, of the law at 1 ms with μ = 0.5, e = 0, masses 1 : 10, where a defect
does not name another. A dash: not planted, or refused.

- *hidden*: all pass, though the defect moves a figure by more than its probe's tolerance: of a figure that passes, with the
  defect or without it, by a declared deviation alone, which is named with its size;
- *blind*: all pass, though bodies move otherwise;
- behind both: the figures of probes of one pair that fail, or that level L1 reads another mass; **missed** where nothing does;
- *inert*: every motion is the same to the last bit. Gazebo makes the circumscribed pyramid of both its cones, as it declares.

`tools/planted.py` has the planted changes. Command: `python tools/planted.py --json FILE`, then `--page FILE`.
"""

REASONS = """
Why they do, where it is no declared deviation:

- friction × 0.9 to × 2: one ball on two grips from μ = 0.165 on, a box on one edge from 0.447 on, and nothing slips in a
  row; a body on a carrier needs half of its friction; nothing pushes a stack sideways. A structure that must stand also
  stands under more friction, so that of rods, clamps and piles those that slip show it;
- friction of 1: a rod at its flattest, 10°, needs 0.77, a pile at its widest, 70°, 0.70: both stand under 0.9 and 1.1, and
  neither has a case that slips; clamps have;
- restitution 0.6 in place of 0.5: the velocities of one ball on two change by 6 % of the speed of approach, and 6 % are
  allowed; its energy shows it;
- another cone: rods, clamps and piles of a pyramid move along its axes, where all cones agree, a clamp under the elliptic cone
  along the vertical; impacts and carriers grip;
- timestep doubled: an impact is over within a step, and what rests does so at any;
- mass × 1.05: velocities after impacts change by some 1 % of the speed of approach, of which 4 % are allowed; a body that
  stands, lies or slips by its weight alone moves alike with any mass. Level L1 compares masses;
- another solver, few sweeps: right in these probes, wrong in those that see it.
"""


def missed(row: Row) -> bool:
    """Whether no probe at all sees what acts."""
    return row["verdict"] in ("hidden", "blind") and not row["single_pair"]


def write(rows: Sequence[Row]) -> None:
    RECORD.write_text(record(rows), encoding="utf-8")
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8"), rows), encoding="utf-8")


def with_tables(page: str, rows: Sequence[Row]) -> str:
    """The page with its tables made anew. Raises ValueError where the marks are not there."""
    before, mark, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (mark and end):
        raise ValueError(f"{PAGE} has no {BEGIN} ... {END}")
    return f"{before}{BEGIN}\n{summary(rows)}\n{END}{after}"


def summary(rows: Sequence[Row]) -> str:
    """By engine the counts; by defect the counts and the figures that show it."""
    rows = _planted(rows)
    lines = _head("engine", "date", "planted", *VERDICTS, "missed", left=2)
    for engine, mine in _by(rows, "engine").items():
        lines.append(_line(f"{engine} {mine[0]['version']}", max(row["date"] for row in mine), *_counts(mine)))
    lines.append(_line("**all**", "", *_counts(rows)))
    lines += _head("defect", "figures that fail, and how often", "planted", *VERDICTS, "missed", left=2)
    for defect, mine in _by(sorted(rows, key=_number), "defect").items():
        lines.append(_line(defect, _often(name for row in mine for name in row["seen"]), *_counts(mine)))
    return "\n".join([*lines, ""])


def record(rows: Sequence[Row]) -> str:
    wrong = [f"{_kind(row)}, {row['defect']}: {', '.join(row['seen'])}" for row in rows if row["verdict"] == FAILS]
    lines = [ABOUT, f"Figures that fail under the unchanged law: {'; '.join(wrong) or 'none'}.", ""]
    rows = _planted(rows)
    for engine, mine in _by(rows, "engine").items():
        kinds = list(dict.fromkeys((row["setting"], row["cone"]) for row in mine))
        date = max(row["date"] for row in mine)
        lines += [f"## {find_engine(engine).TITLE} {mine[0]['version']}", "", f"Measured on {date}."]
        lines += _head("defect", *(", ".join(filter(None, kind)) for kind in kinds), left=1 + len(kinds))
        for defect, some in _by([row for row in mine if row["verdict"] != "refused"], "defect").items():
            cells = {(row["setting"], row["cone"]): _cell(row) for row in some}
            lines.append(_line(defect, *(cells.get(kind, "–") for kind in kinds)))
        refused = _often(row["defect"] for row in mine if row["verdict"] == "refused")
        lines += ["", f"Refused, and how often: {refused}.", ""] if refused else [""]
    lines += ["## Declared deviations that hide a defect in their own probe", ""]
    lines.append(
        "With their sizes, shares of the expected value or m; another probe sees the defect, but for what is hidden above."
    )
    lines += _head("engine", "deviation", "defects", left=3)
    for engine, mine in _by(rows, "engine").items():
        hide: dict[str, list[str]] = {}
        for row in mine:
            for entry in filter(None, row["why"].split(", ") if row["verdict"] != "refused" else ()):
                hide.setdefault(entry, []).append(row["defect"])
        lines += [_line(engine, name, ", ".join(dict.fromkeys(defects))) for name, defects in hide.items()]
    lines.append("")
    lines += ["## Probes that a defect leaves within their tolerances", ""]
    lines.append("How often all figures of a probe pass, by defect, although its bodies move otherwise:")
    lines += _head("defect", "probes", "planted", left=2)
    for defect, mine in _by(sorted(rows, key=_number), "defect").items():
        some = [row for row in mine if row["verdict"] != "refused"]
        if names := _often(name for row in some for name in row["blind"]):
            lines.append(_line(defect, names, len(some)))
    return "\n".join([*lines, REASONS])


def _planted(rows: Sequence[Row]) -> list[Row]:
    """Without unchanged laws, by engine, in the order of the table of defects."""
    return sorted((row for row in rows if row["verdict"] != FAILS), key=lambda row: (row["engine"], _number(row)))


def _number(row: Row) -> int:
    names = [defect.name for defect in DEFECTS]
    return names.index(row["defect"]) if row["defect"] in names else len(names)


def _kind(row: Row) -> str:
    return " ".join(filter(None, (row["engine"], row["setting"], row["cone"])))


def _cell(row: Row) -> str:
    text = ", ".join(row["seen"]) or f"*{row['verdict']}*"
    if row["verdict"] not in ("hidden", "blind"):
        return text
    behind = ", ".join(row["single_pair"]) or "**missed**"
    return f"{text} {row['why']}; {behind}" if row["why"] else f"{text}; {behind}"


def _by(rows: Sequence[Row], key: str) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row[key], []).append(row)
    return found


def _counts(rows: Sequence[Row]) -> list[int]:
    verdicts = Counter(row["verdict"] for row in rows)
    return [len(rows), *(verdicts[name] for name in VERDICTS), sum(map(missed, rows))]


def _often(names: Iterable[str]) -> str:
    return ", ".join(f"{name} ({count})" for name, count in Counter(names).most_common())


def _head(*names: str, left: int) -> list[str]:
    return ["", _line(*names), "|" + "---|" * left + "---:|" * (len(names) - left)]


def _line(*cells: object) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"
