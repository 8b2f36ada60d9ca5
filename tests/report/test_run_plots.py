"""``run.plot``: a line for each joint, coordinate or body, and one clear error otherwise."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from simspec.errors import SpecError
from tests.report.page import samples
from tests.runner.synthetic import run


@pytest.fixture
def recorded(monkeypatch):
    pytest.importorskip("matplotlib").use("Agg")
    return run(samples.a_world())


def test_joints_bodies_and_energy_are_lines_over_time(recorded):
    axes = recorded.plot()
    (line,) = axes.get_lines()
    assert line.get_label() == f"elbow ({recorded.engine})"
    assert np.array_equal(line.get_xdata(), recorded.time)
    assert np.array_equal(line.get_ydata(), recorded.q("elbow"))
    assert recorded.plot("position", "mover", axes=axes, linestyle="--") is axes
    assert [line.get_label().split(" (")[0] for line in axes.get_lines()[1:]] == ["mover, x", "mover, y", "mover, z"]
    place = recorded.arrays["pose"][:, recorded.index["mover"], 2]
    assert np.array_equal(axes.get_lines()[3].get_ydata(), place)
    assert axes.get_ylabel() == "position of bodies, m"
    assert len(recorded.plot("v", ["mover_joint"]).get_lines()) == 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("speed",), "there is no channel 'speed'"),
        (("position", "nowhere"), "there is no body 'nowhere'"),
        (("q", "nowhere"), "there is no coordinate 'nowhere'"),
        (("target",), "has nothing to plot of the channel 'target'"),
    ],
)
def test_unknown_names_and_channels_are_errors(recorded, arguments, message):
    with pytest.raises(SpecError, match=message):
        recorded.plot(*arguments)


def test_without_matplotlib_the_error_names_the_extra(recorded, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(SpecError, match=r"plot needs matplotlib.*\n.*\n.*simspec-physics\[plots\]"):
        recorded.plot()
