"""The page docs/records/coupled-contact.md, from the figures that ``deviations.py`` has measured."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from deviation_grid import RATIOS, bounces

from simspec.engines.kit.registry import find_engine
from simspec.proof.contact import stacks
from simspec.proof.contact.normal import DROP_RESTITUTION

SUNK = (stacks.Stack.NAME, stacks.Stack.SIDEWAYS)
"""Of the tables of stacks that are left alone."""
PAGE_COLUMNS = (
    "rod",
    "clamp",
    "jam",
    "jam-light",
    "squeeze",
    "pile",
    "strike",
    "row",
    "edge",
    "stack",
    "stack-slides",
    "cross",
    "carrier",
    "slide-spin",
)
"""Of the table: figures of what slips, of energy and of what moves sideways count as their probe's."""


def page(rows: Sequence[Mapping[str, Any]], date: str) -> str:
    """The tables, from rows that were measured until ``date``."""
    names = dict.fromkeys(row["engine"] for row in rows)
    versions = ", ".join(f"{find_engine(name).TITLE} {find_engine(name).version()}" for name in names)
    lines = [
        "# Contact of several bodies, measured",
        "",
        "> With this page you can look up how exactly an engine solves contacts of several bodies.",
        "",
        "Each cell: the figure that is furthest off, in units of its tolerance; `ok` within it. Frictions 0.05 to 1.2, "
        "restitutions 0 to 1; `stack` up to a ratio of masses of 100. A dash: the engine refuses all of it.",
        "The probes are defined in [proof.md](../concepts/proof.md). "
        "Command: `python tools/deviations.py --engine NAME --timestep 1 --timestep 2 "
        "… --json FILE` for each engine, then `--page FILE …`.",
        f"Measured on {date} with {versions}.",
    ]
    usual = [row for row in rows if "seconds" not in row]
    for timestep in sorted({row["timestep"] for row in usual}):
        lines += ["", f"## {timestep:g} ms", "", "| engine | setting | cone | " + " | ".join(PAGE_COLUMNS) + " |"]
        lines.append("|---|---|---|" + "---:|" * len(PAGE_COLUMNS))
        kinds = dict.fromkeys((row["engine"], _words(row["settings"]), row["cone"]) for row in usual)
        for kind in kinds:
            mine = [
                row
                for row in usual
                if (row["engine"], _words(row["settings"]), row["cone"]) == kind and row["timestep"] == timestep
            ]
            if mine:
                cells = [_cell([row for row in mine if _column(row) == name]) for name in PAGE_COLUMNS]
                lines.append(f"| {' | '.join((kind[0], kind[1] or 'default', kind[2], *cells))} |")
    for seconds in dict.fromkeys(row.get("seconds", stacks.TIME) for row in rows):
        lines += _stacks(seconds, [row for row in rows if row.get("seconds", stacks.TIME) == seconds])
    return "\n".join(lines) + "\n"


BOUNCING = "\n## Coupled probes with restitution\n"
BOUNCING_COLUMNS = ("rod", "clamp", "jam", "jam-light", "squeeze", "pile", "cross", "carrier", "slide-spin")


def page_bouncing(rows: Sequence[Mapping[str, Any]], date: str) -> str:
    """The table of coupled probes with restitution, measured until ``date``: the last part of the page."""
    frictions, restitutions = (
        "/".join(f"{value:g}" for value in sorted({row[name] for row in rows})) for name in ("friction", "restitution")
    )
    lines = [
        BOUNCING,
        f"The tables above have these probes at restitution 0. Frictions {frictions}, restitutions {restitutions} (0.35 "
        "and 0.7: MuJoCo and PyBullet, up to 8 ms; `cross`: "
        f"up to {DROP_RESTITUTION:g}), measured on {date} with `--bouncing`. Exact engines would have the same figures with "
        "and without restitution, since bodies at rest and sliding bodies do not bounce. Two causes are in the engines. "
        "Without a `restitution_threshold`, they apply restitution to the speed that a force gives a body in one step. With a "
        "threshold of 0.05 m/s, PyBullet and ODE have the figures of restitution 0, but for fingers, which reach 0.2 m/s. DART "
        "and Gazebo have a fixed threshold of 0.1 m/s, MuJoCo has none. MuJoCo's native friction lifts sliding bodies, and "
        "contacts with restitution have no soft layer to hold them. This does not decrease with the timestep; "
        "`friction: coulomb` removes "
        "most of it.",
        "",
        "| ms | engine | setting | cone | " + " | ".join(BOUNCING_COLUMNS) + " |",
        "|---:|---|---|---|" + "---:|" * len(BOUNCING_COLUMNS),
    ]
    for timestep in sorted({row["timestep"] for row in rows}):
        kinds: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
        for row in rows:
            if row["timestep"] == timestep:
                kinds.setdefault((row["engine"], _words(row["settings"]), row["cone"]), []).append(row)
        for (engine, setting, cone), some in sorted(kinds.items()):
            cells = [_cell([row for row in some if _column(row) == name]) for name in BOUNCING_COLUMNS]
            lines.append(f"| {timestep:g} | {' | '.join((engine, setting or 'default', cone, *cells))} |")
    return "\n".join(lines) + "\n"


def whole_page(stored: str, rows: Sequence[Mapping[str, Any]], date: str) -> str:
    """The page, of which the parts that ``rows`` have nothing of remain as they are stored."""
    bouncing = [row for row in rows if bounces(row["probe"], row["restitution"])]
    usual = [row for row in rows if not bounces(row["probe"], row["restitution"])]
    first, heading, last = stored.partition(BOUNCING)
    return (page(usual, date) if usual else first) + (page_bouncing(bouncing, date) if bouncing else heading + last)


def _stacks(seconds: float, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The table of stacks that were left for some seconds."""
    ratios = [ratio for ratio in RATIOS if ratio > 1.0]
    lines = ["", f"## Heavy on light for {seconds:g} s", ""]
    lines += ["Depth and sideways motion (mm) at 1 ms, the worst cone; three layers share the ratio.", ""]
    lines.append(
        "| engine | setting | " + " | ".join(f"{n} layers, {ratio:g}" for n in (2, 3) for ratio in ratios) + " |"
    )
    lines.append("|---|---|" + "---:|" * (2 * len(ratios)))
    stacks = [row for row in rows if row["probe"] in SUNK and row["timestep"] == 1.0]
    for engine, settings in dict.fromkeys((row["engine"], _words(row["settings"])) for row in stacks):
        cells = []
        for layers, ratio in itertools.product((2, 3), ratios):
            some = [
                row
                for row in stacks
                if (row["engine"], _words(row["settings"]), row["ratio"]) == (engine, settings, ratio)
                and row["case"].count(" on ") == layers - 1
            ]
            cells.append(
                " / ".join(
                    _worst([row for row in some if row["probe"] == name]) for name in ("stack", "stack-sideways")
                )
            )
        lines.append(f"| {' | '.join((engine, settings or 'default', *cells))} |")
    return lines


def _words(settings: Mapping[str, Any]) -> str:
    return " ".join(f"{name}: {value}" for name, value in settings.items())


def _column(row: Mapping[str, Any]) -> str:
    if row["probe"].startswith("stack") and row["ratio"] > 100.0:
        return ""
    return (
        str(row["probe"])
        .removesuffix("-slips")
        .removesuffix("-energy")
        .removesuffix("-sideways")
        .removesuffix("-turns")
        .replace("-stays", "-slides")
        .removesuffix("-plane")
    )


def _cell(rows: Sequence[Mapping[str, Any]]) -> str:
    if not rows:
        return "–"
    worst = max(row["off"] for row in rows)
    return "ok" if worst <= 1.0 else f"{worst:.2g}" if worst < 1e6 else "not finite"


def _worst(rows: Sequence[Mapping[str, Any]]) -> str:
    values = [abs(row["measured"]) for row in rows if row["measured"] is not None]
    return f"{1e3 * max(values):.2g}" if values else "–"
