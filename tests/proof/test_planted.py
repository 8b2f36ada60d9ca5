"""Defects planted in the coupled contact probes are seen, in two engines; tools/planted.py does so in all."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.proof.contact_probing import installed

sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent / "tools"))

import planted
import planted_pages
from planted_defects import DEFECTS, UNCHANGED

PROBES = {name: planted.COUPLED[name] for name in ("clamp", "strike", "row", "edge", "carrier")}
"""Those that take little time."""
SEEN_BY = {
    "friction × 0.9": {"clamp", "clamp-slips"},
    "restitution 0.6 in place of 0.5": {"strike-energy", "row", "row-energy", "edge", "edge-energy"},
    "moving bodies pass through": {"strike", "strike-energy", "row", "row-energy", "carrier"},
}
"""The figures that fail, by defect."""


@pytest.mark.parametrize("engine", ["dart", "ode"])
def test_planted_defects_are_seen(engine):
    if not installed(engine):
        pytest.skip(f"{engine} is not installed")
    some = [defect for defect in DEFECTS if defect.name in SEEN_BY]
    unchanged = [defect for defect in UNCHANGED if defect.law in {entry.law for entry in some}]
    tried = planted.tried(engine, planted.SETTINGS[engine][0], "elliptic", [*unchanged, *some], PROBES)
    before = {entry.job.key: entry for entry in tried if entry.job.defect in unchanged}
    assert [figure for entry in before.values() for figure in entry.figures if not figure.passed] == []
    for defect in some:
        found = planted.Result(engine, "", "", "elliptic", defect.name)
        planted.judge(found, engine, [entry for entry in tried if entry.job.defect is defect], before)
        assert (found.verdict, set(found.seen)) == ("seen", SEEN_BY[defect.name])


@pytest.mark.parametrize("engine", ["dart", "ode"])
def test_defects_without_effect_are_inert(engine):
    if not installed(engine):
        pytest.skip(f"{engine} is not installed")
    settings, probes = planted.SETTINGS[engine][0], {"row": PROBES["row"]}
    first, again = (planted.tried(engine, settings, "elliptic", UNCHANGED[:1], probes) for _ in range(2))
    found = planted.Result(engine, "", "", "elliptic", "nothing")
    planted.judge(found, engine, again, {entry.job.key: entry for entry in first})
    assert (found.verdict, found.seen, found.blind) == ("inert", [], [])


def row(verdict, pairs=(), **fields):
    entry = {"engine": "dart", "version": "1", "setting": "", "cone": "elliptic", "defect": "d", "date": "2026-01-01"}
    return {**entry, "verdict": verdict, "seen": [], "blind": [], "single_pair": list(pairs), "why": "", **fields}


def test_the_table_is_between_its_marks_and_counts_missed_defects():
    rows = [row("seen", seen=["rod"]), row("hidden", why="pile 0.1 m", pairs=["push"]), row("blind"), row("inert")]
    begin, end = planted_pages.BEGIN, planted_pages.END
    page = planted_pages.with_tables(f"before\n{begin}\nold\n{end}\nafter\n", rows)
    assert page.startswith(f"before\n{begin}\n")
    assert page.endswith(f"{end}\nafter\n")
    assert "old" not in page
    assert "| dart 1 | 2026-01-01 | 4 | 1 | 1 | 1 | 1 | 0 | 1 |" in page
    with pytest.raises(ValueError, match="has no"):
        planted_pages.with_tables("no marks", rows)


def test_the_record_lists_hidden_and_missed_defects():
    text = planted_pages.record([row("hidden", why="pile 0.1 m", pairs=["push"]), row("blind", cone="other")])
    assert "*hidden* pile 0.1 m; push" in text
    assert "*blind*; **missed**" in text
