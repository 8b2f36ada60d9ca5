"""What the sweep of the robot scenario has found (docs/stacking.json), and the page and picture made of it; see stacking.py."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pace import PARTS

from simspec.engines.kit.registry import engines

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "stacking.json"
PAGE = ROOT / "docs" / "stacking.md"
PICTURE = ROOT / "docs" / "images" / "stacking.png"

TIMESTEPS = (*range(1, 11), 12, 14, 16, 18, 20, 24, 28, 32, 48, 64)
"""ms: those of Körber et al. 2021."""
SEEDS = (0, 1, 2)
ASLEEP = (1.0, 4.0)
"""ms: timesteps of the runs with sleeping."""
COLOURS = {"dart": "#4c72b0", "mujoco": "#dd8452", "pybullet": "#55a868", "drake": "#c44e52"}
"""A colour for each engine."""


def key(engine: str, milliseconds: float, seed: int, kind: str = "run") -> str:
    """The name of a result among those kept."""
    return f"{kind} {engine} {milliseconds:g} {seed}"


def measured(known: Mapping[str, dict[str, Any]]) -> list[str]:
    """The engines that have results."""
    return [name for name in engines() if any(one.split()[1] == name for one in known)]


def load() -> dict[str, dict[str, Any]]:
    """Results that are kept."""
    return json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.is_file() else {}


def keep(known: dict[str, dict[str, Any]]) -> None:
    """Write the results, sorted."""
    text = json.dumps(dict(sorted(known.items())), indent=1, ensure_ascii=False)
    RESULTS.write_text(text + "\n", encoding="utf-8")


def cell(rows: Sequence[dict[str, Any] | None]) -> str:
    """All seeds of one engine at one timestep: the worst deviation (mm), or how many seeds fail."""
    there = [row for row in rows if row is not None]
    if not there:
        return ""
    failed = [row for row in there if row["failure"]]
    if failed:
        return f"**fails** ({len(failed)} of {len(there)})"
    return f"{1e3 * max(row['worst'] for row in there):.1f}"


def _verdict(row: dict[str, Any] | None) -> str:
    """One run: its worst deviation (mm), or what happened."""
    return "" if row is None else row["failure"] or f"{1e3 * row['worst']:.2f}"


def tables(known: Mapping[str, dict[str, Any]]) -> dict[str, str]:
    """The generated parts of the page, by name."""
    names = measured(known)
    lines = [f"| timestep | {' | '.join(names)} |", f"|---|{'---|' * len(names)}"]
    for step in TIMESTEPS:
        cells = [cell([known.get(key(name, step, seed)) for seed in SEEDS]) for name in names]
        lines.append(f"| {step} ms | {' | '.join(cells)} |")
    failures = ["| run | what happened first |", "|---|---|"]
    for step in TIMESTEPS:
        for name in names:
            for seed in SEEDS:
                row = known.get(key(name, step, seed))
                if row is not None and row["failure"]:
                    failures.append(f"| {name} {step} ms, seed {seed} | {row['failure']} |")
    speeds = [
        "| engine | RTF | median round | engine | law and joints | recording |",
        "|---|---|---|---|---|---|",
    ]
    for name in names:
        row = known.get(key(name, 1.0, 0, "speed"))
        if row is not None:
            parts = [f"{1e3 / row[of]['step']:.1f}" for of in ("quiet", "median")]
            parts += [f"{row['quiet'][part]:.1f} µs" for part in PARTS]
            speeds.append(f"| {name} | {' | '.join(parts)} |")
    asleep = ["| engine, timestep | awake | asleep | step awake | step asleep |", "|---|---|---|---|---|"]
    for name in names:
        for step in ASLEEP:
            rows = [known.get(key(name, step, 0, kind)) for kind in ("run", "asleep")]
            costs = ["" if row is None else f"{row['step_us']:.0f} µs" for row in rows]
            asleep.append(f"| {name}, {step:g} ms | {' | '.join([*map(_verdict, rows), *costs])} |")
    slippery = ["| engine | verdict |", "|---|---|"]
    for name in names:
        row = known.get(key(name, 2.0, 0, "slippery"))
        if row is not None:
            slippery.append(f"| {name} | {row['failure'] or 'valid'} |")
    parts = {"limits": lines, "failures": failures, "speed": speeds, "asleep": asleep, "slippery": slippery}
    return {name: "\n".join(rows) for name, rows in parts.items()}


def page(known: Mapping[str, dict[str, Any]], text: str) -> str:
    """The page with its generated parts made anew."""
    for name, table in tables(known).items():
        begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
        before, _, rest = text.partition(begin)
        _, _, after = rest.partition(end)
        if not rest:
            raise ValueError(f"{PAGE.name} has no {begin}")
        text = f"{before}{begin}\n{table}\n{end}{after}"
    return text


def picture(known: Mapping[str, dict[str, Any]]) -> None:
    """The largest deviation by timestep, a line for each engine, seeds as points; what fails stands at the top."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    axes = figure.subplots()
    top = 40.0
    for name, marker in zip(measured(known), "osD^v", strict=False):
        for seed in SEEDS:
            rows = [(step, known.get(key(name, step, seed))) for step in TIMESTEPS]
            there = [(step, row) for step, row in rows if row is not None]
            x = [step for step, _ in there]
            y = [top if row["failure"] else 1e3 * row["worst"] for _, row in there]
            colour = COLOURS.get(name, "black")
            label = name if seed == SEEDS[0] else None
            axes.plot(x, y, marker, color=colour, markersize=4, alpha=0.7, label=label)
        means = [
            (step, [known[key(name, step, seed)] for seed in SEEDS if key(name, step, seed) in known])
            for step in TIMESTEPS
        ]
        line = [
            (step, max(1e3 * row["worst"] for row in found))
            for step, found in means
            if found and not any(row["failure"] for row in found)
        ]
        if line:
            axes.plot(*zip(*line, strict=True), color=COLOURS.get(name, "black"), linewidth=1)
    axes.axhline(10.0, color="grey", linewidth=1, linestyle="--")
    axes.text(1.0, 10.6, "1 cm: the study's bound", color="grey", fontsize=8)
    axes.text(1.0, top * 1.05, "fails", color="grey", fontsize=8)
    axes.set(xscale="log", yscale="log", xlabel="timestep (ms)", ylabel="largest deviation (mm)", ylim=(0.05, 60.0))
    ticks = [1, 2, 4, 8, 16, 32, 64]
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.legend(frameon=False, fontsize=8, loc="lower right")
    figure.savefig(PICTURE, dpi=120, metadata={"Software": None})
