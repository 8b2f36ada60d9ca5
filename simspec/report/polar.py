"""Friction by direction: the section of the cone that the spec asks for, and what each engine does, at a glance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from simspec.proof.contact.friction import PUSH
from simspec.proof.contact.probe import Figure, outline, project
from simspec.report.drawing import COLOURS, MARKERS, STYLE, pyplot, saved

PROBE = "push-oblong"
"""The oblong slider's: that friction has the right size and direction does not follow from a square one."""
ASIDE = 0.02
"""Of μ: what is further from the required force than this is joined to it by a stroke, and told."""
FEW, MANY = (4, 3.2), (7, 2.2)
"""Columns, and inches of a panel's side, of up to eight panels, and of more."""
LEAST_WIDTH = 6.4
"""Inches: the legend stands in one row above the panels."""
SHAPES = {"elliptic": "circle", "pyramid-inscribed": "diamond", "pyramid-circumscribed": "square"}


def polar_plot(figures: Mapping[str, Sequence[Figure]], cone: str) -> dict[str, bytes]:
    """Draw the ``push-oblong`` figures (by engine), one panel for each pair of materials with friction, as SVG and PNG.

    Returns the pictures by suffix (".svg", ".png"); the SVG's bytes depend on the figures alone. None when no pair has
    friction. Raises SpecError where matplotlib is not installed.
    """
    panels: dict[str, dict[str, Figure]] = {}
    for engine, some in figures.items():
        for figure in some:
            if figure.probe == PROBE and figure.expected and figure.points:
                panels.setdefault(figure.subject, {})[engine] = figure
    if not panels:
        return {}
    plot = pyplot()
    most, side = FEW if len(panels) <= 2 * FEW[0] else MANY
    columns = min(most, len(panels))
    rows = math.ceil(len(panels) / columns)
    with plot.rc_context(STYLE):
        chart, axes = plot.subplots(
            rows, columns, figsize=(max(side * columns, LEAST_WIDTH), side * rows + 0.7), squeeze=False
        )
        flat = [axis for row in axes for axis in row]
        engines = list(figures)
        reach = 1.15 * max(_largest(by_engine, cone) for by_engine in panels.values())
        for axis, (subject, by_engine) in zip(flat, panels.items(), strict=False):
            _panel(axis, subject, by_engine, engines, cone)
            # one scale for all: a small μ is a small circle
            axis.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        for axis in flat[::columns]:
            axis.set_ylabel("friction along y, over N")
        for axis in flat[max(0, len(panels) - columns) : len(panels)]:
            axis.set_xlabel("friction along x, over N")
        for axis in flat[len(panels) :]:
            axis.set_visible(False)
        # an engine may have no figure in some panels
        legend = {
            label: handle for axis in flat for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
        }
        labels = sorted(legend, key=lambda label: engines.index(label) if label in engines else -1)
        chart.legend(
            [legend[label] for label in labels],
            labels,
            loc="upper center",
            ncols=len(labels),
            frameon=False,
            fontsize=9,
        )
        chart.tight_layout(rect=(0, 0, 1, 1 - 0.5 / (side * rows + 0.7)))
        drawn = saved(chart)
        plot.close(chart)
    return drawn


def _panel(axis: Any, subject: str, by_engine: Mapping[str, Figure], engines: Sequence[str], cone: str) -> None:
    friction = _friction(next(iter(by_engine.values())), cone)
    required = outline(friction, cone)
    axis.plot(
        required[:, 0], required[:, 1], color="0.6", linewidth=2, label=f"required: {cone} ({SHAPES[cone]})", zorder=1
    )
    off: list[str] = []
    for index, engine in enumerate(engines):
        if engine in by_engine:
            points = by_engine[engine].points
            axis.scatter(
                [row[1] for row in points],
                [row[2] for row in points],
                s=34 if index == 0 else 26,
                marker=MARKERS[index % len(MARKERS)],
                linewidths=1.1,
                label=engine,
                zorder=2 + index,
                **_colours(index),
            )
            worst = _strokes(axis, points, friction, cone, COLOURS[index % len(COLOURS)])
            if worst > ASIDE:
                off.append(f"{engine}: {100 * worst:.2g} % of μ deviation")
    axis.text(0.03, 0.03, "\n".join(off), transform=axis.transAxes, fontsize=6, va="bottom")
    axis.set_title(f"{subject}   μ = {friction:.4g}")
    axis.axhline(0, color="0.85", linewidth=0.6, zorder=0)
    axis.axvline(0, color="0.85", linewidth=0.6, zorder=0)


def _strokes(axis: Any, points: Sequence[tuple[float, ...]], friction: float, cone: str, colour: str) -> float:
    """From the force that a direction requires to the one that was measured: on a circle, all points look right.

    Returns the largest distance, over μ."""
    worst = 0.0
    for angle, *measured in points:
        required = _required(angle, friction, cone)
        off = math.dist(required, measured) / friction
        worst = max(worst, off)
        if off > ASIDE:
            axis.plot(*zip(required, measured, strict=True), color=colour, linewidth=1.6, zorder=1.5)
    return worst


def _required(angle: float, friction: float, cone: str) -> tuple[float, float]:
    """The force, over N, on a slider pushed in this direction."""
    x, y = project(np.array([PUSH * math.cos(angle), PUSH * math.sin(angle)]), 1.0, cone)
    return friction * float(x), friction * float(y)


def _colours(index: int) -> dict[str, Any]:
    """The first marker is an open ring, so that the others show inside it."""
    colour = COLOURS[index % len(COLOURS)]
    filled = MARKERS[index % len(MARKERS)] in "xs^d+"
    return {"color": colour} if filled else {"facecolors": "none", "edgecolors": colour}


def _largest(by_engine: Mapping[str, Figure], cone: str) -> float:
    """The farthest coordinate of a panel: of the required section, or of what was measured."""
    measured = max(abs(value) for figure in by_engine.values() for row in figure.points for value in row[1:])
    return max(measured, _friction(next(iter(by_engine.values())), cone))


def _friction(figure: Figure, cone: str) -> float:
    """μ of a push figure, from its worst direction's required force: the push is 1.6 times μ in that direction."""
    if figure.angle is None:
        raise ValueError(f"{figure.probe} of {figure.subject} has no direction")
    return figure.expected / math.hypot(*_required(figure.angle, 1.0, cone))
