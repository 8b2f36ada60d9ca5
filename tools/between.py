"""The contact law between the points of the declared tables, in every engine, solver and cone: ``between.csv`` of the engines.

python tools/between.py --engine NAME [--timestep MS ...] --json FILE      measures; goes on in the file
python tools/between.py --declare FILE ...                                 writes the tables ``between.csv``

Engines declare how far they are from the law at some timesteps, frictions, restitutions and ratios of masses. Scenarios have
others: imported robots above all. This measures at values between and beyond those, and declares what the tables do not cover,
each size around its own point alone (``simspec/engines/kit/between.py``).
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import coupled

from simspec.engines.kit.between import KEYS, LIMITS
from simspec.engines.kit.registry import find_engine
from simspec.proof.contact import sliding_stacks, stacking, together
from simspec.proof.contact.impact import DROP_RESTITUTION
from simspec.proof.contact.probe import Figure, Law, Probe
from simspec.proof.contact.run import PROBES, widened
from simspec.world.reach import Reach
from simspec.world.types import PairContact

TIMESTEPS = (20.0, 16.0, 12.5, 10.0, 8.0, 5.0, 4.0, 3.0, 2.0, 1.5, 1.0, 0.7, 0.5, 0.2)
"""ms; pairs of bodies at all, several bodies at ``COUPLED_TIMESTEPS``."""
COUPLED_TIMESTEPS = (20.0, 16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.2)
RATIOS = (1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0, 50.0, 100.0, 150.0, 300.0, 600.0, 1000.0)
FRICTIONS, RESTITUTIONS = (0.07, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0), (0.0, 0.25, 0.6, 0.9)
COUPLED_FRICTIONS = (0.25, 0.7, 0.9, 1.1, 1.5, 2.0)
IMPACT_FRICTIONS, IMPACT_RESTITUTIONS = (0.5, 0.8, 1.5), (0.0, 0.5)
STACK_FRICTIONS = (0.0, 0.25, 0.5, 0.8, 1.0, 1.5)
SLIDING_FRICTIONS = (0.2, 0.45, 0.8, 1.0, 1.5)
ALIKE = 1.5
"""Ratio of the sizes of neighbouring points up to which one row declares both."""
SEVERAL = dict(coupled.PROBES)
NEAR = 0.9
"""Share of a declared size from which on a figure is declared anew: beside it a little more is to be expected."""
LONGEST = 22.0
"""ms: rows of the largest timestep count below it."""


def points(probe: Probe) -> Iterator[tuple[float, float, float]]:
    """Friction, restitution and ratio of masses."""
    resting = (0.0, DROP_RESTITUTION)
    if probe.NAME in sliding_stacks.PROBES:
        yield from itertools.product(SLIDING_FRICTIONS, resting, RATIOS)
    elif probe.NAME in stacking.PROBES:
        yield from itertools.product(STACK_FRICTIONS, (0.0,), RATIOS)
        yield from itertools.product((0.5,), (DROP_RESTITUTION,), RATIOS)
    elif probe.NAME in together.PROBES:
        yield from itertools.product(IMPACT_FRICTIONS, IMPACT_RESTITUTIONS, (1.0,))
    elif probe.NAME in SEVERAL:
        yield from itertools.product(COUPLED_FRICTIONS, (0.0,), (1.0,))
    else:
        yield from itertools.product(FRICTIONS, RESTITUTIONS, (1.0,))


def law_of(friction: float, restitution: float, ratio: float, cone: str, timestep: float) -> Law:
    there = Reach(True, True, True, True, ratio, 3, crosses=True, jams=True, squeezes=True, plane=True)
    return Law(PairContact("base", "body", friction, restitution), cone, timestep, reach=there)


def laws(probe: Probe, cone: str, timestep: float) -> Iterator[Law]:
    some = (law_of(*point, cone, timestep) for point in points(probe))
    return (law for law in some if probe.applies(law))


def measure(engine: str, timesteps: Sequence[float], file: Path) -> None:
    """Every figure beyond its promise, a line each; cones and settings that the engine refuses have none."""
    coupled.laws, single = laws, [name for name in PROBES if name not in SEVERAL]
    coupled.PROBES = PROBES
    for settings, cone, timestep in itertools.product(coupled.SOLVERS[engine], coupled.CONES, timesteps):
        began = time.monotonic()
        names = [*single, *(SEVERAL if timestep in COUPLED_TIMESTEPS else ())]
        found = coupled.measure(engine, settings, cone, timestep / 1e3, names)
        if isinstance(found, str):
            print(engine, settings, cone, f"{timestep:g} ms: {found}", flush=True)
            continue
        with file.open("a", encoding="utf-8") as lines:
            for law, figure in found:
                if (off := coupled.off(figure)) > 1.0:
                    lines.write(json.dumps(_row(engine, settings, law, figure) | {"off": off}) + "\n")
        print(engine, settings, cone, f"{timestep:g} ms: {len(found)} in {time.monotonic() - began:.0f} s", flush=True)


def _row(engine: str, settings: Mapping[str, Any], law: Law, figure: Figure) -> dict[str, Any]:
    return {
        "engine": engine,
        "settings": settings,
        "cone": law.friction_cone,
        "timestep": 1e3 * law.timestep,
        "friction": law.pair.friction,
        "restitution": law.pair.restitution,
        "ratio": law.reach.ratio,
    } | {name: getattr(figure, name) for name in ("probe", "case", "expected", "measured", "tolerance")}


def uncovered(rows: Iterable[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """The rows that the engine's other declared deviations do not cover. What is not finite cannot be declared."""
    for row in rows:
        if row["measured"] is None or not math.isfinite(row["measured"]):
            continue
        engine = find_engine(row["engine"])
        settings = {name: setting.default for name, setting in engine.SETTINGS.items()} | row["settings"]
        law = law_of(row["friction"], row["restitution"], row["ratio"], row["cone"], row["timestep"] / 1e3)
        numbers = (row["expected"], row["measured"], row["tolerance"])
        figure = Figure(row["probe"], "", row["case"], "", "", *numbers)
        declared = [one for one in engine.CONTACT_DEVIATIONS if not one.is_local]
        covered = widened(figure, law, declared, settings, engine.version())
        if not covered.passed or (covered.deviation and coupled.off(covered) > NEAR):
            yield row


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The rows of one engine as its ``between.csv``."""
    lines = [",".join(KEYS)]
    groups: dict[tuple[Any, ...], dict[float, list[Mapping[str, Any]]]] = {}
    for row in rows:
        along = "ratio" if row["probe"].startswith("stack") else "friction"
        setting = " ".join(f"{name}={value}" for name, value in row["settings"].items())
        key = (setting, row["cone"], row["probe"], row["timestep"], bool(row["expected"]), along)
        groups.setdefault(key, {}).setdefault(row[along], []).append(row)
    for (setting, cone, probe, *_, along), by in groups.items():
        for some in _alike(by, [point[2 if along == "ratio" else 0] for point in points(_probe(probe))]):
            size, relative = max(_size(row) for row in some), bool(some[0]["expected"])
            cells = [_cell(name, some) for name in LIMITS]
            limits = (f"{limit:.6g}" for cell in cells for limit in cell)
            lines.append(",".join((setting, cone, probe, *limits, f"{size:.3g}", "yes" if relative else "no")))
    return "\n".join(lines) + "\n"


def _alike(
    by: Mapping[float, Sequence[Mapping[str, Any]]], values: Iterable[float]
) -> Iterator[list[Mapping[str, Any]]]:
    """Points that are neighbours, with deviations alike."""
    found: list[Mapping[str, Any]] = []
    for value in sorted(set(values)):
        some = by.get(value, ())
        sizes = [max(_size(row) for row in rows) for rows in (found, some) if rows]
        if found and (not some or max(sizes) > ALIKE * min(sizes)):
            yield found
            found = []
        found = [*found, *some]
    if found:
        yield found


def _probe(name: str) -> Probe:
    """A probe that is measured at the points of the figure ``name``: its own, or for figures of other names one of its kind."""
    if name in coupled.SLIDING:
        return next(iter(sliding_stacks.PROBES.values()))
    several = [probe for probe in SEVERAL.values() if name.startswith(probe.NAME)]
    return max(several, key=lambda probe: len(probe.NAME)) if several else PROBES["push"]


def _cell(name: str, rows: Sequence[Mapping[str, Any]]) -> tuple[float, float]:
    """From the measured value before these rows' to the one after them, exclusive."""
    probe = _probe(rows[0]["probe"])
    if name == "timestep":
        measured: Iterable[float] = COUPLED_TIMESTEPS if probe.NAME in SEVERAL else TIMESTEPS
    else:
        measured = (point[("friction", "restitution", "ratio").index(name)] for point in points(probe))
    values = sorted(set(measured))
    first = values.index(round(min(row[name] for row in rows), 9))
    last = values.index(round(max(row[name] for row in rows), 9))
    before = values[first - 1] * 1.0001 if first else 0.0
    if first and name in ("friction", "restitution") and values[first - 1] == 0.0:
        before = 1e-9
    after = values[last + 1] * 0.9999 if last + 1 < len(values) else LONGEST if name == "timestep" else math.inf
    return before, after


def _size(row: Mapping[str, Any]) -> float:
    size = abs(row["measured"] - row["expected"])
    return float(size / abs(row["expected"]) if row["expected"] else size)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--engine", choices=sorted(coupled.SOLVERS))
    parser.add_argument("--timestep", action="append", type=float, help="ms; default: all")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--declare", nargs="+", type=Path)
    arguments = parser.parse_args()
    if arguments.declare:
        read = [
            json.loads(line) for file in arguments.declare for line in file.read_text(encoding="utf-8").splitlines()
        ]
        for engine in dict.fromkeys(row["engine"] for row in read):
            rows = list(uncovered(row for row in read if row["engine"] == engine))
            place = coupled.ROOT / "simspec" / "engines" / engine / "between.csv"
            place.write_text(table(rows), encoding="utf-8")
            print(f"{engine}: {len(rows)} figures, {place.read_text(encoding='utf-8').count(chr(10)) - 1} rows")
    elif arguments.engine and arguments.json:
        measure(arguments.engine, arguments.timestep or TIMESTEPS, arguments.json)
    else:
        parser.error("--engine NAME --json FILE, or --declare FILE ...")
    return 0


if __name__ == "__main__":
    sys.exit(main())
