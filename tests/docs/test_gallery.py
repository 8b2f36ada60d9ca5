"""The gallery is current: a page, a picture and figures of each scenario of the library, without an engine or a browser."""

from __future__ import annotations

import sys

from tests.docs.blocks import ROOT

sys.path.insert(0, str(ROOT / "tools"))

import gallery


def test_pages_pictures_and_figures_are_current():
    assert gallery.stale() == []


def test_pictures_are_small():
    sizes = [path.stat().st_size for path in gallery.PLACE.glob("*.webp")]
    assert len(sizes) == sum(map(gallery.has_picture, gallery.scenarios().values()))
    assert sum(sizes) < 1_500_000


def test_figures_of_another_spec_and_stale_pages_are_noticed(monkeypatch):
    figures = gallery.stored()
    figures["box-on-ramp"] = {**figures["box-on-ramp"], "spec": "of yesterday", "date": "2020-01-01"}
    monkeypatch.setattr(gallery, "stored", lambda: figures)
    found = gallery.stale()
    assert [line.partition(":")[0] for line in found] == ["box-on-ramp.md", "box-on-ramp"]


def test_an_expectation_that_is_not_met_stands_out():
    outcome = {"passed": False, "measured": 0.0123, "unit": "m"}
    assert gallery.result(outcome) == "**not met**, 0.0123 m"
