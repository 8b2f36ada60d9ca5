"""Figures for papers: drawn, the same bytes each time, and with all that they were given."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest

from simspec.analysis.tables import spread
from simspec.comparison.floor import measure_floor
from simspec.errors import SpecError
from simspec.report import figures
from tests.runner.synthetic import column, free_body, run, world

WORLD = world(free_body("ball"))
PNG = b"\x89PNG\r\n"


def moved(by: float, engine: str, **facts):
    return run(WORLD, lambda name, t: column(by * t, 0.0, 0.0), engine=engine, contacts=[(2, 0, 0, 0.0, 1.0)], **facts)


def lines(monkeypatch, draw):
    """Contents of a figure: for each pair of axes, the points of each line by its label."""
    drawn = []

    def keep(chart, resolution):
        drawn.extend(
            {line.get_label(): np.array(line.get_xydata()) for line in axis.get_lines()} for axis in chart.get_axes()
        )
        return {}

    monkeypatch.setattr(figures, "saved", keep)
    draw()
    return drawn


def test_divergence_is_that_of_the_runs(monkeypatch):
    first, second = moved(0.0, "first"), moved(0.5, "second")
    floor = measure_floor(first, [moved(1e-9, "first", perturb=1e-15)])
    (axis,) = lines(monkeypatch, lambda: figures.divergence([first, second], [floor], 1e-3, 0.6))
    assert axis["first – second"][:, 1] == pytest.approx(np.maximum(0.5 * first.time, figures.LEAST))
    assert {"tolerance", "horizon"} <= set(axis)
    assert axis["horizon"][0, 0] == 0.6


def test_speed_over_the_timestep(monkeypatch):
    spreads = {"first": {0.002: spread([4.0, 5.0, 6.0]), 0.001: spread([2.0])}, "second": {0.001: spread([3.0])}}
    (axis,) = lines(monkeypatch, lambda: figures.speed_over_timestep(spreads, {"first": 0.001}))
    assert any(np.array_equal(points, [[1.0, 2.0], [2.0, 5.0]]) for points in axis.values())


def test_speed_over_time_with_contacts(monkeypatch):
    time = {"first": np.arange(3.0)}
    above, below = lines(
        monkeypatch,
        lambda: figures.speed_over_time(time, {"first": np.full(3, 1.0)}, {"first": np.array([0.0, 1.0, 2.0])}),
    )
    assert above["first"][:, 1].tolist() == [1.0, 1.0, 1.0]
    assert below["first"][:, 1].tolist() == [0.0, 1.0, 2.0]


def test_deviations_over_the_timestep(monkeypatch):
    """A failed check is a separate mark, at the top if it is beyond the axis, and no part of the line."""

    def record(engine, timestep, deviation, valid):
        return {"engine": engine, "timestep": timestep, "deviation": deviation, "valid": valid, "runs": 3}

    records = [record("first", 0.002, 0.004, 3), record("first", 0.001, 0.002, 3), record("first", 0.004, 5.0, 2)]
    records.append(record("second", 0.001, None, 0))
    seen = []
    monkeypatch.setattr(figures, "saved", lambda chart, resolution: seen.extend(chart.axes[0].get_lines()) or {})
    figures.deviation_over_timestep(records, 0.01)
    points = [np.column_stack([line.get_xdata(), line.get_ydata()]).tolist() for line in seen[:6]]
    np.testing.assert_allclose(points[0], [[1.0, 2.0], [2.0, 4.0], [4.0, np.nan]])
    np.testing.assert_allclose(points[1], [[1.0, 2.0], [2.0, 4.0]])
    np.testing.assert_allclose(points[2], [[4.0, 40.0]])
    np.testing.assert_allclose(points[5], [[1.0, 40.0]])
    assert seen[6].get_ydata()[0] == 10.0
    assert figures.deviation_over_timestep([], 0.01) == {}


def test_pictures_are_the_same_each_time_and_run_nothing():
    draw = lambda: figures.divergence([moved(0.0, "$\\input{x}$"), moved(0.5, "<script>")])  # noqa: E731
    first, second = draw(), draw()
    assert first == second
    assert first[".png"].startswith(PNG)
    assert b"<svg" in first[".svg"]
    assert not re.search(rb"<script", first[".svg"])


def test_nothing_to_draw():
    assert figures.divergence([moved(0.0, "first")]) == {}
    assert figures.speed_over_timestep({}) == {}
    assert figures.speed_over_time({}, {}, {}) == {}
    assert figures.contacts_over_time([]) == {}


def test_without_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(SpecError, match="plots need matplotlib"):
        figures.divergence([moved(0.0, "first"), moved(0.5, "second")])
