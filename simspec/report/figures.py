"""Figures for papers, as PNG and SVG: speed over the timestep, speed and contacts over time, and how runs part.

Each function draws one figure from figures of ``analysis`` and gives its bytes by suffix (".svg", ".png"). They raise SpecError
where matplotlib is not installed, and give {} where there is nothing to draw.
"""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.analysis.tables import Spread
from simspec.comparison.common import Common, moving_in_common
from simspec.comparison.floor import FLOOR_FACTOR, Floor, deviations
from simspec.comparison.runs import TOLERANCE
from simspec.comparison.study import Study
from simspec.errors import Problem, SpecError, visible
from simspec.proof.contact.friction import PUSH
from simspec.proof.contact.probe import ProbeFigure, outline, project
from simspec.report.page.playback import LEAST
from simspec.runner import metrics
from simspec.runner.run import Run

MARKERS = ("o", "x", "+", "s", "^", "d")
"""One per engine, in order: readable on top of each other, and without colours."""
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))
"""The same for lines."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Distinguishable for colour-blind readers (Okabe and Ito)."""
STYLE: Any = MappingProxyType({"svg.hashsalt": "simspec", "svg.fonttype": "path", "font.size": 8})
"""An SVG's bytes depend on what is drawn alone."""


def saved(chart: Any, resolution: int = 110) -> dict[str, bytes]:
    """A figure of matplotlib as SVG and PNG, by suffix."""
    drawn = {}
    for suffix, more in ((".svg", {"metadata": {"Date": None}}), (".png", {"dpi": resolution})):
        picture = io.BytesIO()
        chart.savefig(picture, format=suffix[1:], **more)
        drawn[suffix] = picture.getvalue()
    return drawn


@contextmanager
def pyplot() -> Iterator[Any]:
    """matplotlib's pyplot, without a display, in the style of figures. Raises SpecError where it is not installed."""
    try:
        import matplotlib
    except ImportError as error:
        problem = Problem(
            "plots need matplotlib", found=str(error), hint="pip install 'simspec-physics[plots]'", code="C110"
        )
        raise SpecError([problem]) from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    with pyplot.rc_context(STYLE):
        yield pyplot


Numbers = NDArray[np.float64]
COLUMN_SIZE = (3.5, 2.6)
"""Inches: the width of a column of a paper."""
WIDE = (6.0, 2.8)
"""Inches: the width of a page of text."""
LIMIT_TICKS = (0.5, 1, 2, 4, 8, 16, 32, 64)
"""ms: timesteps that are named where there are many."""
RESOLUTION = 300
"""Dots per inch of a PNG."""
MOST_TICKS = 10
"""Timesteps that are named at the axis."""
PLAIN_FROM = 1e-3
"""Logarithmic axes that begin above this are labelled with plain numbers."""
MOST_POINTS = 2_000
"""Points of a line; of longer recordings, evenly spaced rows are drawn."""


def speed_over_timestep(
    spreads: Mapping[str, Mapping[float, Spread]],
    limits: Mapping[str, float | None] | None = None,
    name: str = "real-time factor",
) -> dict[str, bytes]:
    """A figure of speed by engine and timestep (s), both axes logarithmic: the median over processes, with a bar from the least
    to the largest. ``limits``: the largest valid timestep (s) by engine; marks of larger ones are pale, all marks of an engine
    whose limit is None."""
    if not any(spreads.values()):
        return {}
    with pyplot() as plot:
        chart, axis = plot.subplots(figsize=COLUMN_SIZE)
        for index, (engine, by_step) in enumerate(spreads.items()):
            steps = sorted(by_step)
            middle = np.array([by_step[step].median for step in steps])
            reach = np.array(
                [
                    [by_step[step].median - by_step[step].least for step in steps],
                    [by_step[step].most - by_step[step].median for step in steps],
                ]
            )
            look = _look(index)
            times = 1e3 * np.array(steps)
            axis.plot(times, middle, linewidth=0.8, alpha=0.5, **look)
            largest = (limits or {}).get(engine, math.inf)
            valid = np.array([largest is not None and step <= largest for step in steps])
            bars = {"fmt": MARKERS[index % len(MARKERS)], "markersize": 4, "color": look["color"], "capsize": 2}
            for chosen, alpha, label in ((valid, 1.0, visible(engine)), (~valid, 0.3, None)):
                if chosen.any() or label is not None:
                    about = {"alpha": alpha, "label": label, "linewidth": 0.8, **bars}
                    axis.errorbar(times[chosen], middle[chosen], reach[:, chosen], **about)
        axis.set(xscale="log", yscale="log", xlabel="timestep, ms", ylabel=name)
        tried = sorted({1e3 * step for by_step in spreads.values() for step in by_step})
        _timestep_ticks(axis, tried[:: -(-len(tried) // MOST_TICKS)])  # of many every second, third, … timestep
        return _finished(plot, chart, axis)


def deviation_over_timestep(
    records: Sequence[Mapping[str, Any]], tolerance: float, unit: str = "mm", factor: float = 1e3
) -> dict[str, bytes]:
    """A figure of the largest deviation by engine and timestep (s), both axes logarithmic, with the ``tolerance`` as a line.

    ``records``: engine, timestep, deviation (None where nothing was measured), and how many of ``runs`` are ``valid``
    (``validity.deviations`` of a study); deviations and the tolerance are shown ``factor`` times, in ``unit``. Where a run
    fails, the mark is hollow, at the top where its deviation is beyond it.
    """
    if not records:
        return {}
    top = 4.0 * factor * tolerance
    with pyplot() as plot:
        chart, axis = plot.subplots(figsize=WIDE)
        for index, engine in enumerate(dict.fromkeys(record["engine"] for record in records)):
            local = [record for record in records if record["engine"] == engine]
            local.sort(key=lambda record: record["timestep"])
            times = 1e3 * np.array([entry["timestep"] for entry in local])
            far = np.array([np.inf if entry["deviation"] is None else factor * entry["deviation"] for entry in local])
            valid = np.array([entry["valid"] == entry["runs"] for entry in local])
            look = _look(index)
            axis.plot(times, np.where(valid, far, np.nan), linewidth=0.8, **look)
            marked = {"marker": MARKERS[index % len(MARKERS)], "markersize": 4, "linestyle": "none"}
            axis.plot(times[valid], far[valid], color=look["color"], label=visible(engine), **marked)
            axis.plot(times[~valid], np.minimum(far, top)[~valid], color=look["color"], fillstyle="none", **marked)
        axis.axhline(factor * tolerance, color="0.4", linewidth=0.8, linestyle="--")
        axis.set(xscale="log", yscale="log", xlabel="timestep, ms", ylabel=f"largest deviation, {unit}")
        tried = sorted({1e3 * record["timestep"] for record in records})
        _timestep_ticks(axis, [step for step in tried if step in LIMIT_TICKS] or tried[:MOST_TICKS])
        return _finished(plot, chart, axis)


def _timestep_ticks(axis: Any, ticks: Sequence[float]) -> None:
    axis.set_xticks(ticks)
    axis.set_xticks([], minor=True)
    axis.xaxis.set_major_formatter(_plain)


def speed_over_time(
    time: Mapping[str, Numbers], factor: Mapping[str, Numbers], contacts: Mapping[str, Numbers]
) -> dict[str, bytes]:
    """The real-time factor over simulated time (s), with the number of contact points below it, by engine."""
    if not factor:
        return {}
    with pyplot() as plot:
        chart, (above, below) = plot.subplots(2, 1, sharex=True, figsize=(COLUMN_SIZE[0], 1.5 * COLUMN_SIZE[1]))
        for index, engine in enumerate(factor):
            for axis, values in ((above, factor), (below, contacts)):
                if engine in values:
                    rows = _rows(len(time[engine]))
                    axis.plot(
                        time[engine][rows], values[engine][rows], label=visible(engine), linewidth=0.9, **_look(index)
                    )
        above.set(yscale="log", ylabel="real-time factor")
        below.set(ylabel="contact points", xlabel="time, s")
        return _finished(plot, chart, above)


def divergence(
    runs: Sequence[Run], floors: Sequence[Floor] = (), tolerance: float | None = TOLERANCE, ends: float | None = None
) -> dict[str, bytes]:
    """The deviation of each pair of runs over time, the largest (m) of any moving body, with the range within
    ``FLOOR_FACTOR`` times the engines' noise shaded, the tolerance as a line, and a mark at ``ends`` (s), a horizon."""
    lines = _divergences(runs, floors)
    if not lines:
        return {}
    with pyplot() as plot:
        chart, axis = plot.subplots(figsize=COLUMN_SIZE)
        for index, (label, time, values, noise) in enumerate(lines):
            if floors:
                shade = {"color": "0.5", "alpha": 0.2, "linewidth": 0.0}
                shown = np.where(np.isfinite(noise), noise, np.nan)
                axis.fill_between(time, LEAST, np.maximum(FLOOR_FACTOR * shown, LEAST), **shade)
            axis.plot(time, np.maximum(values, LEAST), label=visible(label), linewidth=0.9, **_look(index))
        if floors:
            axis.fill_between([], [], [], color="0.5", alpha=0.2, label=f"{FLOOR_FACTOR:g} × noise")
        if tolerance:
            axis.axhline(tolerance, color="0.3", linewidth=0.6, linestyle=":", label="tolerance")
        if ends is not None:
            axis.axvline(ends, color="0.3", linewidth=0.6, label="horizon")
        axis.set(yscale="log", xlabel="time, s", ylabel="largest deviation, m")
        return _finished(plot, chart, axis)


def _divergences(runs: Sequence[Run], floors: Sequence[Floor]) -> list[tuple[str, Numbers, Numbers, Numbers]]:
    """For each pair its label, times (n,), deviations (n,) and noise (n,), m; pairs that have nothing in common are left
    out."""
    lines = []
    for a, b in itertools.combinations([run for run in runs if run.recorded], 2):
        try:
            names = moving_in_common(a, b)
            common = Common(a, b, names, [floor for floor in floors if floor.engine in (a.engine, b.engine)])
        except SpecError:
            continue  # said in the table of differences
        chosen = _rows(common.rows)
        columns = [np.array([run.index[name] for name in names], dtype=np.int64) for run in (a, b)]
        poses = [
            run.arrays["pose"][np.ix_(rows[chosen], values)]
            for run, rows, values in ((a, common.rows_a, columns[0]), (b, common.rows_b, columns[1]))
        ]
        position, _ = deviations(*poses)
        noise, _ = common.noise(chosen[:, None])
        lines.append((f"{a.engine} – {b.engine}", common.time(chosen), position.max(axis=1), noise.max(axis=1)))
    return lines


def contacts_over_time(runs: Sequence[Run]) -> dict[str, bytes]:
    """The number of contact points over time, by engine; {} where no run recorded them."""
    recorded = [run for run in runs if run.recorded and "contact.row" in run.arrays]
    if not recorded:
        return {}
    with pyplot() as plot:
        chart, axis = plot.subplots(figsize=COLUMN_SIZE)
        for index, run in enumerate(recorded):
            rows = _rows(len(run.time))
            counts = metrics.contact_counts(run.arrays)[rows]
            axis.plot(run.time[rows], counts, label=visible(run.engine), linewidth=0.9, **_look(index))
        axis.set(xlabel="time, s", ylabel="contact points")
        return _finished(plot, chart, axis)


def study_figures(study: Study) -> dict[str, bytes]:
    """Every figure of a study by the name of its file: ``divergence``, ``contacts``, as PNG and SVG. Raises SpecError where
    matplotlib is not installed."""
    runs = list(study.runs.values())
    ends = [diff.horizon for diff in study.diffs if diff.horizon is not None]
    tolerance = study.diffs[0].tolerance if study.diffs else None
    drawn = {
        "divergence": divergence(runs, list(study.floors.values()), tolerance, min(ends, default=None)),
        "contacts": contacts_over_time(runs),
    }
    return {f"{name}{suffix}": data for name, files in drawn.items() for suffix, data in files.items()}


def _rows(count: int) -> NDArray[np.int64]:
    """Rows of a recording that are drawn."""
    return np.unique(np.linspace(0, max(0, count - 1), min(count, MOST_POINTS)).astype(np.int64))


def _look(index: int) -> dict[str, Any]:
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": DASHES[index % len(DASHES)]}


def _plain(value: float, place: int | None = None) -> str:
    return f"{value:g}"


def _few(value: float, place: int | None = None) -> str:
    """Within a decade 2 and 5 are named: there is no room for all."""
    return f"{value:g}" if f"{value:e}"[0] in "25" else ""


def _finished(plot: Any, chart: Any, axis: Any) -> dict[str, bytes]:
    """A figure with the grid and the legend of ``axis``, as files by suffix."""
    if axis.get_yscale() == "log" and axis.get_ylim()[0] > PLAIN_FROM:
        axis.yaxis.set_major_formatter(_plain)
        axis.yaxis.set_minor_formatter(_few)
    axis.grid(visible=True, which="major", color="0.9", linewidth=0.5)
    axis.set_axisbelow(True)
    # matplotlib reads "$" in the names of engines as mathematics
    for text in axis.legend(frameon=True, framealpha=0.8, edgecolor="none", fontsize=6.5).get_texts():
        text.set_parse_math(False)
    chart.tight_layout()
    drawn = saved(chart, RESOLUTION)
    plot.close(chart)
    return drawn


# Friction by direction: the section of the friction cone of the spec, and the forces in each engine.

PROBE = "push-oblong"
"""The oblong slider's: that friction has the right size and direction does not follow from a square one."""
ASIDE = 0.02
"""Share of μ: a measured force that is further from the required one is joined to it by a stroke, and listed."""
FEW, MANY = (4, 3.2), (7, 2.2)
"""Columns, and inches of a panel's side, of up to eight panels, and of more."""
LEAST_WIDTH = 6.4
"""Inches: the legend stands in one row above the panels."""
SHAPES = {"elliptic": "circle", "pyramid-inscribed": "diamond", "pyramid-circumscribed": "square"}


def polar_plot(figures: Mapping[str, Sequence[ProbeFigure]], cone: str) -> dict[str, bytes]:
    """Draw the ``push-oblong`` figures (by engine), one panel for each pair of materials with friction, as SVG and PNG.

    Returns the pictures by suffix (".svg", ".png"); the SVG's bytes depend on the figures alone. None when no pair has
    friction. Raises SpecError where matplotlib is not installed.
    """
    panels: dict[str, dict[str, ProbeFigure]] = {}
    for engine, some in figures.items():
        for figure in some:
            if figure.probe == PROBE and figure.expected and figure.points:
                panels.setdefault(figure.subject, {})[engine] = figure
    if not panels:
        return {}
    most, side = FEW if len(panels) <= 2 * FEW[0] else MANY
    columns = min(most, len(panels))
    rows = math.ceil(len(panels) / columns)
    size = (max(side * columns, LEAST_WIDTH), side * rows + 0.7)
    with pyplot() as plot:
        chart, axes = plot.subplots(rows, columns, figsize=size, squeeze=False)
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
        named = [pair for axis in flat for pair in zip(*axis.get_legend_handles_labels(), strict=True)]
        legend = {label: handle for handle, label in named}
        labels = sorted(legend, key=lambda label: engines.index(label) if label in engines else -1)
        place = {"loc": "upper center", "ncols": len(labels), "frameon": False, "fontsize": 9}
        chart.legend([legend[label] for label in labels], labels, **place)
        chart.tight_layout(rect=(0, 0, 1, 1 - 0.5 / size[1]))
        drawn = saved(chart)
        plot.close(chart)
    return drawn


def _panel(axis: Any, subject: str, by_engine: Mapping[str, ProbeFigure], engines: Sequence[str], cone: str) -> None:
    friction = _friction(next(iter(by_engine.values())), cone)
    required = outline(friction, cone)
    axis.plot(*required[:, :2].T, color="0.6", linewidth=2, label=f"required: {cone} ({SHAPES[cone]})", zorder=1)
    off: list[str] = []
    for index, engine in enumerate(engines):
        if engine in by_engine:
            points, marker = by_engine[engine].points, MARKERS[index % len(MARKERS)]
            colour = COLOURS[index % len(COLOURS)]
            # the first marker is an open ring, so that the others show inside it
            fill = {"color": colour} if marker in "xs^d+" else {"facecolors": "none", "edgecolors": colour}
            mark = {"s": 34 if index == 0 else 26, "marker": marker, "linewidths": 1.1, "zorder": 2 + index}
            axis.scatter([row[1] for row in points], [row[2] for row in points], label=engine, **mark, **fill)
            worst = _strokes(axis, points, friction, cone, colour)
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


def _largest(by_engine: Mapping[str, ProbeFigure], cone: str) -> float:
    """The farthest coordinate of a panel: of the required section, or of what was measured."""
    measured = max(abs(value) for figure in by_engine.values() for row in figure.points for value in row[1:])
    return max(measured, _friction(next(iter(by_engine.values())), cone))


def _friction(figure: ProbeFigure, cone: str) -> float:
    """μ of a push figure, from its worst direction's required force: the push is 1.6 times μ in that direction."""
    if figure.angle is None:
        raise ValueError(f"{figure.probe} of {figure.subject} has no direction")
    return figure.expected / math.hypot(*_required(figure.angle, 1.0, cone))
