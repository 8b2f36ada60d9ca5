"""The page's table of the complete self-test."""

from __future__ import annotations

import gzip
import json
import sys
from pathlib import Path

import pytest

from simspec.engines.kit.registry import engines, find_engine
from simspec.proof.complete import CompleteTest, Verdict

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tools"))

import selftest  # noqa: E402 - a script outside the package

from tests.installed import INSTALLED  # noqa: E402

ROW = dict(zip(selftest.COLUMNS, (5, 3, 1, 1, 0), strict=True))
NOT_RUN = {"gzsim", "webots"}
"""Engines of which no world of the complete self-test was run yet, which the page says."""
RESULTS = {
    "one": {
        world: {
            "version": "1.2",
            "date": "2026-01-02",
            "seconds": 3,
            "rows": {"scaled": ROW, "all": ROW},
            "inert": {"a name": 1},
        }
        for world in ("arm", "ball")
    }
}


def test_the_table_stands_between_its_marks_and_nothing_else_changes():
    page = f"before\n{selftest.BEGIN}\nold\n{selftest.END}\nafter\n"
    made = selftest.with_table(page, RESULTS)
    assert made.startswith(f"before\n{selftest.BEGIN}\n")
    assert made.endswith(f"{selftest.END}\nafter\n")
    assert "| one 1.2 | ball | 2026-01-02 | 3 | 5 | 3 | 1 | 1 | 0 |" in made
    assert "| **one** | all | 10 | 6 | 2 | 2 | 0 |" in made
    assert "| one | a name | 2 |" in made
    assert "old" not in made
    with pytest.raises(ValueError, match="has no"):
        selftest.with_table("no marks", RESULTS)


def test_the_page_has_what_was_measured_and_nothing_was_missed():
    if not selftest.RESULTS.exists():
        pytest.skip("not measured yet")
    results = json.loads(gzip.decompress(selftest.RESULTS.read_bytes()))
    assert selftest.page_table(results) in selftest.PAGE.read_text(encoding="utf-8")
    assert set(results) == set(engines()) - NOT_RUN
    for name, worlds in results.items():
        for world, entry in worlds.items():
            if name in INSTALLED:
                assert entry["version"] == find_engine(name).version(), (
                    f"{name}, {world}: another version: make selftest"
                )
            total = entry["rows"]["all"]
            assert total["missed"] == 0, f"{name}, {world}"
            assert total["planted"] == sum(total[column] for column in selftest.COLUMNS[1:])
        assert selftest.summed(results, name)["all"]["planted"] > 1000


def test_each_world_is_kept_as_soon_as_it_is_done_and_only_those_named(monkeypatch, tmp_path):
    """Rows of other worlds stay in the page; a whole run removes worlds that no longer exist."""
    page = tmp_path / "page.md"
    page.write_text(f"{selftest.BEGIN}{selftest.END}", encoding="utf-8")
    monkeypatch.setattr(selftest, "PAGE", page)
    monkeypatch.setattr(selftest, "RESULTS", tmp_path / "results.json")
    caught = Verdict("mujoco", "ball", "model.xml", "scaled", "a@b", "a@b", "1 to 2", "caught")

    def test(engines, worlds, done, progress, keep, pythons):
        assert not done
        keep("ball", [caught], 7.2)
        assert set(selftest.read()["mujoco"]) == {"gone", "ball"}, "written before the next world begins"
        return CompleteTest((caught,))

    monkeypatch.setattr(selftest, "complete_self_test", test)
    results = {"mujoco": {"gone": RESULTS["one"]["arm"]}}
    selftest.measure("mujoco", ["ball"], results)
    assert set(results["mujoco"]) == {"gone", "ball"}
    assert results["mujoco"]["ball"]["rows"]["all"]["caught"] == 1
    assert results["mujoco"]["ball"]["seconds"] == 7
    selftest.measure("mujoco", [], results)
    assert set(selftest.read()["mujoco"]) == {"ball"}
    assert "| ball |" in page.read_text(encoding="utf-8")


def test_a_run_that_was_stopped_goes_on_where_it_was(monkeypatch, tmp_path):
    """Kept results of another version, or with missed defects, are tried again."""
    page = tmp_path / "page.md"
    page.write_text(f"{selftest.BEGIN}{selftest.END}", encoding="utf-8")
    monkeypatch.setattr(selftest, "PAGE", page)
    monkeypatch.setattr(selftest, "RESULTS", tmp_path / "results.json")
    version = str(find_engine("mujoco").version())
    sound = RESULTS["one"]["arm"] | {"version": version}
    missing = sound | {"rows": {"all": ROW | {"missed": 1}}}
    results = {"mujoco": {"sound": sound, "older": RESULTS["one"]["arm"], "missing": missing}}
    caught = Verdict("mujoco", "missing", "model.xml", "scaled", "a@b", "a@b", "1 to 2", "caught")

    def test(engines, worlds, done, progress, keep, pythons):
        assert done == {"sound"}
        keep("missing", [caught], 1.0)
        return CompleteTest((caught,))

    monkeypatch.setattr(selftest, "complete_self_test", test)
    selftest.measure("mujoco", [], results, go_on=True)
    kept = selftest.read()["mujoco"]
    assert set(kept) == {"sound", "missing"}
    assert kept["missing"]["rows"]["all"]["missed"] == 0
