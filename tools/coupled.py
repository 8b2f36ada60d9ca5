"""The coupled contact probes in every engine, solver and cone: docs/records/coupled-contact.md.

python tools/coupled.py [--engine NAME ...] [--timestep MS ...] [--cone CONE ...] [--probe NAME ...] [--seconds S] [--json FILE]
python tools/coupled.py --page FILE ...
python tools/coupled.py --declare FILE ...

Measures over frictions of 0.05 to 1.2, restitutions of 0, 0.5 and 1 and ratios of masses of 1 to 1000, and prints the
figures that are beyond their tolerance. --json keeps all of them. From such files --page writes the page, and --declare
the tables ``coupled.csv`` from which engines declare their deviations. Declared deviations do not change what is printed.
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import itertools
import json
import math
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.coupled import KEYS, LENGTHS, SLIDING
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.contact import carried, crossing, jamming, leaning, sliding_stacks, squeezing, stacking, together
from simspec.proof.contact.held import EVERYTHING
from simspec.proof.contact.impact import DROP_RESTITUTION
from simspec.proof.contact.probe import GRAVITY, Figure, Law, Probe, Trial
from simspec.proof.contact.run import drive_of, motion_of, world_of_trial
from simspec.world.reach import Reach
from simspec.world.types import Contact, EngineOptions, Material, PairContact, Physics, World

PROBES: Mapping[str, Probe] = {
    **leaning.PROBES,
    **jamming.PROBES,
    **squeezing.PROBES,
    **together.PROBES,
    **stacking.PROBES,
    **sliding_stacks.PROBES,
    **crossing.PROBES,
    **carried.PROBES,
}
FRICTIONS, IMPACT_FRICTIONS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0, 1.2), (0.0, 0.1, 0.3, 0.6, 1.0)
SLIDING_FRICTIONS = (0.05, 0.1, 0.3, 0.6, 1.2)
"""Of stacks that slide, which are measured at each ratio of masses."""
RESTITUTIONS, RATIOS = (0.0, 0.5, 1.0), (1.0, 10.0, 100.0, 1000.0)
SLIDING_RATIOS = (1.0, 4.0, 10.0, 100.0, 1000.0)
SOLVERS: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "mujoco": ({"friction": "native"}, {"friction": "coulomb"}),
    "pybullet": ({},),
    "dart": ({"contact_solver": "nsgs"}, {"contact_solver": "dantzig"}),
    "drake": ({"contact_approximation": "tamsi"}, {"contact_approximation": "sap"}),
    "ode": ({"solver": "step"}, {"solver": "quick-step"}),
    "gazebo": ({"contact_solver": "dantzig"}, {"contact_solver": "pgs"}),
    "rapier": ({},),
    "physx": ({},),
}
"""Settings by engine: each solver that a setting can choose."""
ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "records" / "coupled-contact.md"
ALIKE = 1.3
"""Ratio of the largest to the smallest deviation up to which cones or settings share a row of a table."""
KEPT = ("probe", "case", "expected", "measured", "tolerance", "unit", "worst")
"""What is kept of a figure."""
SUNK = (stacking.Stack.NAME, stacking.Stack.SIDEWAYS)
"""Of the tables of stacks that are left alone."""
CONES = ("elliptic", "pyramid-circumscribed", "pyramid-inscribed")


def laws(probe: Probe, cone: str, timestep: float) -> Iterator[Law]:
    """The laws that a probe is measured under: friction varies in all, restitution in impacts, the ratio in stacks."""
    impacts, stacks, sliding = (
        probe.NAME in probes for probes in (together.PROBES, stacking.PROBES, sliding_stacks.PROBES)
    )
    frictions = IMPACT_FRICTIONS if impacts else (0.5,) if stacks else SLIDING_FRICTIONS if sliding else FRICTIONS
    restitutions = RESTITUTIONS if impacts else (0.0, DROP_RESTITUTION) if stacks or sliding else (0.0,)
    ratios = RATIOS if stacks else SLIDING_RATIOS if sliding else (1.0,)
    for friction, restitution, ratio in itertools.product(frictions, restitutions, ratios):
        pair = PairContact("base", "body", friction, restitution)
        law = Law(
            pair,
            cone,
            timestep,
            reach=Reach(True, True, True, True, ratio, 3, crosses=True, jams=True, squeezes=True, plane=True),
        )
        if probe.applies(law):
            yield law


def worlds(engine: str, law: Law, trials: Sequence[Trial], settings: Mapping[str, Any]) -> list[World]:
    pair = law.pair
    materials = tuple(Material(name, pair.friction, pair.restitution) for name in (pair.first, pair.second))
    pairs = tuple(
        dataclasses.replace(pair, first=one.name, second=other.name)
        for one, other in itertools.combinations_with_replacement(materials, 2)
    )
    options = EngineOptions(engine, tuple(sorted(settings.items())), EVERYTHING)
    contact = Contact(law.friction_cone, materials, pairs)
    return [world_of_trial(trial, contact, Physics((0.0, 0.0, -GRAVITY), law.timestep), options) for trial in trials]


def measure(
    engine: str, settings: Mapping[str, Any], cone: str, timestep: float, probes: Sequence[str] = tuple(PROBES)
) -> list[tuple[Law, Figure]] | str:
    """Every figure of some probes, all of one process; or why the engine refuses."""
    jobs = [(PROBES[name], law) for name in probes for law in laws(PROBES[name], cone, timestep)]
    operations: list[Operation] = []
    tried: list[tuple[Probe, Law, list[World]]] = []
    refused = ""
    with tempfile.TemporaryDirectory() as folder:
        for probe, law in jobs:
            made = worlds(engine, law, probe.trials(law), settings)
            try:
                files = [compile_world(world, [engine])[engine].files for world in made]
            except UnsupportedError as error:
                refused = error.problems[0].message
                continue
            for world, trial, written in zip(made, probe.trials(law), files, strict=True):
                place = Path(folder) / str(len(operations))
                write_folder(written, place)
                operation = drive_of(world, trial)
                operations.append(
                    dataclasses.replace(operation, parameters={**operation.parameters, "artifacts": str(place)})
                )
            tried.append((probe, law, made))
        if not tried:
            return refused
        try:
            answers = iter(call(engine, Path(folder), operations, deadline=3000.0).answers)
        except EngineError as error:
            return str(error).splitlines()[0]
        found = []
        for probe, law, made in tried:
            motions = [motion_of(world, next(answers)) for world in made]
            found += [(law, figure) for figure in probe.figures(law, motions)]
        return found


def off(figure: Figure) -> float:
    if figure.measured is None or not math.isfinite(figure.measured):
        return math.inf
    return abs(figure.measured - figure.expected) / figure.tolerance


COLUMNS = (
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
        "Each cell: the figure that is furthest off, in units of its tolerance; `ok` within it. Frictions 0.05 to 1.2, "
        "restitutions 0 to 1; `stack` up to a ratio of masses of 100. A dash: the engine refuses all of it.",
        "The probes are defined in [proof.md](../proof.md). Command: `python tools/coupled.py --engine NAME --timestep 1 "
        "--timestep 2 … --json FILE` for each engine, then `--page FILE …`.",
        f"Measured on {date} with {versions}.",
    ]
    usual = [row for row in rows if "seconds" not in row]
    for timestep in sorted({row["timestep"] for row in usual}):
        lines += ["", f"## {timestep:g} ms", "", "| engine | setting | cone | " + " | ".join(COLUMNS) + " |"]
        lines.append("|---|---|---|" + "---:|" * len(COLUMNS))
        kinds = dict.fromkeys((row["engine"], _words(row["settings"]), row["cone"]) for row in usual)
        for kind in kinds:
            mine = [
                row
                for row in usual
                if (row["engine"], _words(row["settings"]), row["cone"]) == kind and row["timestep"] == timestep
            ]
            if mine:
                cells = [_cell([row for row in mine if _column(row) == name]) for name in COLUMNS]
                lines.append(f"| {' | '.join((kind[0], kind[1] or 'default', kind[2], *cells))} |")
    for seconds in dict.fromkeys(row.get("seconds", stacking.TIME) for row in rows):
        lines += _stacks(seconds, [row for row in rows if row.get("seconds", stacking.TIME) == seconds])
    return "\n".join(lines) + "\n"


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


Sizes = tuple[float, ...]
"""Largest deviations beyond the tolerance, by timestep; 0 where there is none."""


def tables(rows: Sequence[Mapping[str, Any]]) -> Mapping[str, str]:
    """Of each engine its table of deviations, as :mod:`simspec.engines.kit.coupled` reads it."""
    found = {}
    for engine in dict.fromkeys(row["engine"] for row in rows):
        mine = [row for row in rows if row["engine"] == engine and "seconds" not in row]
        timesteps = sorted({row["timestep"] for row in mine})
        kinds = list(dict.fromkeys((_setting(row["settings"]), row["cone"]) for row in mine))
        lines = [",".join((*KEYS, *(f"{timestep:g}" for timestep in timesteps)))]
        for measured in dict.fromkeys(_measured(row) for row in mine):
            sizes = {kind: [0.0] * len(timesteps) for kind in kinds}
            for row in mine:
                if _measured(row) == measured and row["off"] > 1.0:
                    mine_of = sizes[_setting(row["settings"]), row["cone"]]
                    column = timesteps.index(row["timestep"])
                    mine_of[column] = max(mine_of[column], _size(row))
            for (setting, cone), shared in _shared({kind: tuple(some) for kind, some in sizes.items()}).items():
                if any(shared):
                    cells = (f"{size:.3g}" if size else "" for size in shared)
                    lines.append(",".join((setting, cone, *measured, *cells)))
        found[engine] = "\n".join(lines) + "\n"
    return found


def _setting(settings: Mapping[str, Any]) -> str:
    return " ".join(f"{name}={value}" for name, value in settings.items())


def _measured(row: Mapping[str, Any]) -> tuple[str, str, str]:
    """Probe, restitution and ratio of masses, as a table has them."""
    probe = str(row["probe"])
    varied = probe.split("-")[0] in together.PROBES or probe in SLIDING
    restitution = (">0" if row["restitution"] else "0") if varied else ""
    return probe, restitution, f"{row['ratio']:g}" if probe.startswith("stack") else ""


def _size(row: Mapping[str, Any]) -> float:
    if row["measured"] is None:
        raise SystemExit(f"no number to declare: {row}")
    size = abs(row["measured"] - row["expected"])
    return float(size if row["probe"] in LENGTHS else size / abs(row["expected"]))


def _shared(sizes: Mapping[tuple[str, str], Sizes]) -> Mapping[tuple[str, str], Sizes]:
    """The rows of some settings and cones; one for all cones, or for all settings too, where they are alike."""
    if _alike(sizes.values()):
        return {("", ""): _largest(sizes.values())}
    found: dict[tuple[str, str], Sizes] = {}
    for setting in dict.fromkeys(setting for setting, _ in sizes):
        mine = {kind: some for kind, some in sizes.items() if kind[0] == setting}
        found |= {(setting, ""): _largest(mine.values())} if _alike(mine.values()) else mine
    return found


def _alike(some: Iterable[Sizes]) -> bool:
    return all(max(column) <= ALIKE * min(column) for column in zip(*some, strict=True))


def _largest(some: Iterable[Sizes]) -> Sizes:
    return tuple(max(column) for column in zip(*some, strict=True))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--engine", action="append", choices=sorted(SOLVERS))
    parser.add_argument("--timestep", action="append", type=float, help="ms; default 1 and 4")
    parser.add_argument("--cone", action="append", choices=CONES)
    parser.add_argument("--probe", action="append", choices=sorted(PROBES))
    parser.add_argument("--seconds", type=float, help="how long stacks are left alone; default that of the probe")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", nargs="+", type=Path, help="files of --json")
    parser.add_argument("--declare", nargs="+", type=Path, help="files of --json")
    given = parser.parse_args()
    kept = [row for file in (*(given.page or ()), *(given.declare or ())) for row in json.loads(file.read_text())]
    if given.page:
        latest = max(file.stat().st_mtime for file in given.page)
        PAGE.write_text(page(kept, datetime.date.fromtimestamp(latest).isoformat()))
    if given.declare:
        for engine, table in tables(kept).items():
            (ROOT / "simspec" / "engines" / engine / "coupled.csv").write_text(table)
    if kept:
        return 0
    if given.seconds:
        stacking.TIME = given.seconds
    rows: list[dict[str, Any]] = []
    for engine in given.engine or SOLVERS:
        if find_engine(engine).version() is None:
            print(f"{engine} is not installed", file=sys.stderr)
            continue
        for settings, cone, timestep in itertools.product(
            SOLVERS[engine], given.cone or CONES, given.timestep or (1.0, 4.0)
        ):
            found = measure(engine, settings, cone, timestep / 1e3, given.probe or tuple(PROBES))
            label = f"{engine} {' '.join(f'{name}={value}' for name, value in settings.items())}".strip()
            if isinstance(found, str):
                print(f"{label:32} {cone:22} {timestep:g} ms: {found[:120]}", flush=True)
                continue
            for law, figure in found:
                rows.append(
                    {
                        "engine": engine,
                        "settings": dict(settings),
                        "cone": cone,
                        "timestep": timestep,
                        "friction": law.pair.friction,
                        "restitution": law.pair.restitution,
                        "ratio": law.reach.ratio,
                        "off": off(figure),
                        **({"seconds": given.seconds} if given.seconds else {}),
                        **{name: getattr(figure, name) for name in KEPT},
                    }
                )
            by_probe: dict[str, list[tuple[Law, Figure]]] = {}
            for law, figure in found:
                by_probe.setdefault(figure.probe, []).append((law, figure))
            for probe, some in by_probe.items():
                law, worst = max(some, key=lambda entry: off(entry[1]))
                if off(worst) > 1.0:
                    where = f"mu {law.pair.friction:g} e {law.pair.restitution:g} ratio {law.reach.ratio:g}"
                    measured = "no number" if worst.measured is None else f"{worst.measured:.4g}"
                    print(
                        f"{label:32} {cone[:16]:16} {timestep:g} ms {probe:15} {off(worst):9.3g}  {measured} for "
                        f"{worst.expected:.4g} {worst.unit}; {worst.case}; {where}",
                        flush=True,
                    )
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
