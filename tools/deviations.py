"""Contact of several bodies in every engine, solver and cone: docs/records/coupled-contact.md and ``contact_deviations.csv``.

python tools/deviations.py --json FILE [--between] [--bouncing] [--engine NAME ...] [--timestep MS ...] [--cone CONE ...]
                           [--probe NAME ...]
python tools/deviations.py --page FILE ...
python tools/deviations.py --declare FILE ...

Measures at the points of a grid, prints the figures that are furthest beyond their tolerance, and appends every figure to
FILE as a line. The first grid has the probes of several bodies at frictions of 0.05 to 1.2, restitutions of 0, 0.5 and 1 and
ratios of masses of 1 to 1000; the grid ``--between`` has all probes at values between and beyond those. ``--bouncing``
measures the points of a grid at which coupled probes have restitution, and no others. From such files --page writes the page,
and --declare the engines' tables: a row for each size of the first grid, which counts from its values on, and for what these
and the engine's other deviations do not cover a row that counts around its own points alone (declare the first grid before
the other, and coupled probes without restitution before those with it). Parts of the page and rows that the files have
nothing of remain as they are. Declared deviations do not change what is measured.
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import itertools
import json
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from deviation_grid import BETWEEN, TABLES, bounces
from deviation_page import whole_page
from deviation_tables import PARTS, declare, off, setting_words

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.contact import stacks
from simspec.proof.contact.probe import GRAVITY, Probe, ProbeFigure, ProbeLaw, ProbeTrial
from simspec.proof.contact.run import COUPLED, PROBES
from simspec.proof.contact.worlds import EVERYTHING, drive_of, motion_of, world_of_trial
from simspec.world.types import Contact, EngineOptions, Material, Physics, World

SOLVERS: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "mujoco": ({"friction": "native"}, {"friction": "coulomb"}),
    "pybullet": ({},),
    "dart": ({"contact_solver": "nsgs"}, {"contact_solver": "dantzig"}),
    "drake": ({"contact_approximation": "tamsi"}, {"contact_approximation": "sap"}),
    "ode": ({"solver": "step"}, {"solver": "quick-step"}),
    "gazebo": ({"contact_solver": "dantzig"}, {"contact_solver": "pgs"}),
    "rapier": ({},),
    "physx": ({},),
    "newton": ({"warm_start": False}, {"warm_start": True}),
}
"""Settings by engine: each solver that a setting can choose."""
ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "records" / "coupled-contact.md"
KEPT = ("probe", "case", "expected", "measured", "tolerance", "unit", "worst")
"""The stored row of a figure."""
CONES = ("elliptic", "pyramid-circumscribed", "pyramid-inscribed")


def worlds(engine: str, law: ProbeLaw, trials: Sequence[ProbeTrial], settings: Mapping[str, Any]) -> list[World]:
    pair = law.pair
    materials = tuple(Material(name, pair.friction, pair.restitution) for name in (pair.first, pair.second))
    pairs = tuple(
        dataclasses.replace(pair, first=first.name, second=second.name)
        for first, second in itertools.combinations_with_replacement(materials, 2)
    )
    options = EngineOptions(engine, tuple(sorted(settings.items())), EVERYTHING)
    contact = Contact(law.friction_cone, materials, pairs)
    return [world_of_trial(trial, contact, Physics((0.0, 0.0, -GRAVITY), law.timestep), options) for trial in trials]


def measure(
    engine: str, settings: Mapping[str, Any], jobs: Sequence[tuple[Probe, ProbeLaw]]
) -> list[tuple[ProbeLaw, ProbeFigure]] | str:
    """Every figure of some probes under their laws, all of one process; or why the engine refuses."""
    operations: list[Operation] = []
    tried: list[tuple[Probe, ProbeLaw, list[World]]] = []
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
    parser.add_argument("--between", action="store_true", help="the grid between the values of the tables, all probes")
    parser.add_argument("--bouncing", action="store_true", help="only the points of coupled probes with restitution")
    given = parser.parse_args()
    if files := [*(given.page or ()), *(given.declare or ())]:
        rows = [json.loads(line) for file in files for line in file.read_text(encoding="utf-8").splitlines()]
        if given.page:
            latest = max(file.stat().st_mtime for file in given.page)
            date = datetime.date.fromtimestamp(latest).isoformat()
            page_rows = [row for row in rows if not row["local"]]
            PAGE.write_text(whole_page(PAGE.read_text(encoding="utf-8"), page_rows, date), encoding="utf-8")
        for part in PARTS if given.declare else ():
            of_part = [row for row in rows if (row["local"], bounces(row["probe"], row["restitution"])) == part]
            declare(of_part, part)
        return 0
    if given.seconds:
        stacks.TIME = given.seconds
    grid = BETWEEN if given.between else TABLES
    if given.bouncing:
        grid = grid.bouncing()
    for engine in given.engine or SOLVERS:
        if find_engine(engine).version() is None:
            print(f"{engine} is not installed", file=sys.stderr)
            continue
        for settings, cone, timestep in itertools.product(
            SOLVERS[engine], given.cone or CONES, given.timestep or grid.timesteps
        ):
            probes = [
                probe
                for name, probe in PROBES.items()
                if (not given.probe or name in given.probe)
                and (not grid.local or timestep in grid.coupled_timesteps or name not in COUPLED)
            ]
            laws = [(probe, law) for probe in probes for law in grid.laws(probe, cone, timestep / 1e3)]
            found = measure(engine, settings, laws)
            label = f"{engine} {setting_words(settings)}".strip()
            if isinstance(found, str):
                print(f"{label:32} {cone:22} {timestep:g} ms: {found[:120]}", flush=True)
                continue
            if given.json:
                with given.json.open("a", encoding="utf-8") as lines:
                    for law, figure in found:
                        if not grid.local or off(figure) > 1.0:
                            place = {"engine": engine, "settings": dict(settings), "cone": cone, "timestep": timestep}
                            if given.seconds:
                                place["seconds"] = given.seconds
                            lines.write(json.dumps(place | record(law, figure, grid.local)) + "\n")
            for law, worst in worst_by_probe(found):
                where = f"mu {law.pair.friction:g} e {law.pair.restitution:g} ratio {law.reach.ratio:g}"
                measured = "not finite" if worst.measured is None else f"{worst.measured:.4g}"
                print(
                    f"{label:32} {cone[:16]:16} {timestep:g} ms {worst.probe:15} {off(worst):9.3g}  {measured} for "
                    f"{worst.expected:.4g} {worst.unit}; {worst.case}; {where}",
                    flush=True,
                )
    return 0


def record(law: ProbeLaw, figure: ProbeFigure, local: bool) -> dict[str, Any]:
    numbers = {"friction": law.pair.friction, "restitution": law.pair.restitution, "ratio": law.reach.ratio}
    return {"local": local, **numbers, "off": off(figure), **{name: getattr(figure, name) for name in KEPT}}


def worst_by_probe(found: Sequence[tuple[ProbeLaw, ProbeFigure]]) -> Iterator[tuple[ProbeLaw, ProbeFigure]]:
    """Of each probe's figures beyond their tolerance the one that is furthest off."""
    by_probe: dict[str, list[tuple[ProbeLaw, ProbeFigure]]] = {}
    for law, figure in found:
        by_probe.setdefault(figure.probe, []).append((law, figure))
    for some in by_probe.values():
        worst = max(some, key=lambda entry: off(entry[1]))
        if off(worst[1]) > 1.0:
            yield worst


if __name__ == "__main__":
    sys.exit(main())
