"""The page's table of the complete self-test."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from simspec.engines.kit.registry import engines, find_engine

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tools"))

import selftest  # noqa: E402 - a script beside the package

from tests.installed import INSTALLED  # noqa: E402

ROW = dict(zip(selftest.COLUMNS, (5, 3, 1, 1, 0), strict=True))
RESULTS = {
    "one": {
        "version": "1.2",
        "date": "2026-01-02",
        "minutes": 3,
        "rows": [{"engine": "one", "kind": "scaled", **ROW}, {"engine": "one", "kind": "all", **ROW}],
        "inert": [{"engine": "one", "reason": "a name", "count": 1}],
    }
}


def test_the_table_stands_between_its_marks_and_nothing_else_changes():
    page = f"before\n{selftest.BEGIN}\nold\n{selftest.END}\nafter\n"
    made = selftest.with_table(page, RESULTS)
    assert made.startswith(f"before\n{selftest.BEGIN}\n")
    assert made.endswith(f"{selftest.END}\nafter\n")
    assert "| **one 1.2** | all | 5 | 3 | 1 | 1 | 0 |" in made
    assert "| one | a name | 1 |" in made
    assert "2026-01-02 (one, 3 min)" in made
    assert "old" not in made
    with pytest.raises(ValueError, match="has no"):
        selftest.with_table("no marks", RESULTS)


def test_the_page_has_what_was_measured_and_nothing_was_missed():
    if not selftest.RESULTS.exists():
        pytest.skip("not measured yet")
    results = json.loads(selftest.RESULTS.read_text(encoding="utf-8"))
    assert selftest.page_table(results) in selftest.PAGE.read_text(encoding="utf-8")
    assert set(results) == set(engines())
    for name, one in results.items():
        if name in INSTALLED:
            assert one["version"] == find_engine(name).version(), f"{name} has another version: make selftest"
        (total,) = (row for row in one["rows"] if row["kind"] == "all")
        assert total["missed"] == 0
        assert total["planted"] > 1000
        assert total["planted"] == sum(total[column] for column in selftest.COLUMNS[1:])
