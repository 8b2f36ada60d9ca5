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
import csv
import dataclasses
import datetime
import itertools
import json
import math
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.capabilities import COLUMNS as KEYS
from simspec.engines.kit.capabilities import LIMITS, Deviation
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.refinements import SLIDING
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.contact import stacks
from simspec.proof.contact.normal import DROP_RESTITUTION
from simspec.proof.contact.probe import GRAVITY, Probe, ProbeFigure, ProbeLaw, ProbeTrial
from simspec.proof.contact.run import COUPLED, PROBES, widened
from simspec.proof.contact.worlds import EVERYTHING, drive_of, motion_of, world_of_trial
from simspec.world.reach import MaterialReach
from simspec.world.types import Contact, EngineOptions, Material, PairContact, Physics, World

SOLVERS: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "mujoco": ({"friction": "native"}, {"friction": "coulomb"}),
    "pybullet": ({},),
    "dart": ({"contact_solver": "nsgs"}, {"contact_solver": "dantzig"}),
    "drake": ({"contact_approximation": "tamsi"}, {"contact_approximation": "sap"}),
    "ode": ({"solver": "step"}, {"solver": "quick-step"}),
    "gazebo": ({"contact_solver": "dantzig"}, {"contact_solver": "pgs"}),
    "rapier": ({},),
    "physx": ({},),
    "newton": ({},),
}
"""Settings by engine: each solver that a setting can choose."""
ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "records" / "coupled-contact.md"
ALIKE = 1.3
"""Ratio of the largest to the smallest deviation up to which cones or settings share a row of a table."""
KEPT = ("probe", "case", "expected", "measured", "tolerance", "unit", "worst")
"""The stored row of a figure."""
SUNK = (stacks.Stack.NAME, stacks.Stack.SIDEWAYS)
"""Of the tables of stacks that are left alone."""
CONES = ("elliptic", "pyramid-circumscribed", "pyramid-inscribed")


@dataclass(frozen=True)
class Values:
    """Values that a probe is measured at: each friction with each restitution and ratio of masses, where the law applies."""

    frictions: Sequence[float]
    restitutions: Sequence[float] = (0.0,)
    ratios: Sequence[float] = (1.0,)


@dataclass(frozen=True)
class Grid:
    """Values by kind of probe (see ``kind_of``), and default timesteps (ms); ``local``: around single points."""

    values: Mapping[str, Sequence[Values]]
    timesteps: Sequence[float]
    coupled_timesteps: Sequence[float]
    local: bool = False

    def points(self, probe: Probe) -> list[tuple[float, float, float]]:
        """Friction, restitution and ratio of masses."""
        return [
            point
            for values in self.values.get(kind_of(probe), ())
            for point in itertools.product(values.frictions, values.restitutions, values.ratios)
        ]

    def bouncing(self) -> Grid:
        """The points at which coupled probes have restitution."""
        coupled = [values for values in self.values["coupled"] if min(values.restitutions) > 0.0]
        timesteps = BOUNCING_TIMESTEPS[self.local]
        return Grid({"coupled": coupled}, timesteps, timesteps, self.local)

    def without_bouncing(self) -> Grid:
        """The other points."""
        coupled = [values for values in self.values["coupled"] if min(values.restitutions) == 0.0]
        return dataclasses.replace(self, values={**self.values, "coupled": coupled})

    def laws(self, probe: Probe, cone: str, timestep: float) -> Iterator[ProbeLaw]:
        laws = (law_of(*point, cone, timestep) for point in self.points(probe))
        return (law for law in laws if probe.applies(law))


FIRST_RESTITUTION, LAST_RESTITUTION = 0.5, 0.9
"""Of coupled probes: the first grid has the former, 0.35, 0.7 and 1, where a bounce loses no energy; the other has 0.25 and the
latter. Engines but MuJoCo and PyBullet were measured without 0.35 and 0.7, MuJoCo and PyBullet with them at 1 to 8 ms."""
BOUNCING_TIMESTEPS = ((1.0, 2.0, 4.0, 8.0, 16.0), (20.0, 8.0, 2.0, 0.5))
"""ms, of coupled probes with restitution: of the first grid, and between."""
RATIOS = (1.0, 10.0, 100.0, 1000.0)
_RESTING = (0.0, DROP_RESTITUTION)
TABLES = Grid(
    {
        "impact": [Values((0.0, 0.1, 0.3, 0.6, 1.0), (0.0, 0.5, 1.0))],
        "stack": [Values((0.5,), _RESTING, RATIOS)],
        "sliding stack": [Values((0.05, 0.1, 0.3, 0.6, 1.2), _RESTING, (1.0, 4.0, *RATIOS[1:]))],
        "coupled": [
            Values((0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0, 1.2)),
            Values((0.05, 0.2, 0.5, 0.8, 1.2), (0.35, FIRST_RESTITUTION, 0.7, 1.0)),
        ],
    },
    (1.0, 4.0),
    (1.0, 4.0),
)
_BETWEEN_RATIOS = (1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0, 50.0, 100.0, 150.0, 300.0, 600.0, 1000.0)
BETWEEN = Grid(
    {
        "impact": [Values((0.5, 0.8, 1.5), (0.0, 0.5))],
        "stack": [
            Values((0.0, 0.25, 0.5, 0.8, 1.0, 1.5), (0.0,), _BETWEEN_RATIOS),
            Values((0.5,), (DROP_RESTITUTION,), _BETWEEN_RATIOS),
        ],
        "sliding stack": [Values((0.2, 0.45, 0.8, 1.0, 1.5), _RESTING, _BETWEEN_RATIOS)],
        "coupled": [
            Values((0.25, 0.7, 0.9, 1.1, 1.5, 2.0)),
            Values((0.07, 0.25, 0.7, 1.0, 1.5), (0.25, LAST_RESTITUTION)),
        ],
        "pair": [Values((0.07, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0), (0.0, 0.25, 0.6, 0.9))],
    },
    (20.0, 16.0, 12.5, 10.0, 8.0, 5.0, 4.0, 3.0, 2.0, 1.5, 1.0, 0.7, 0.5, 0.2),
    (20.0, 16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.2),
    local=True,
)
MARGIN, LOCAL_MARGIN = 1.15, 1.25
"""Declared over measured: figures at frictions between the measured ones differ by some percent; those between local points by
the median of what the tables miss between theirs."""
BOUNCING_MARGIN = 1.6
"""The same of both grids where coupled bodies have restitution: when a hop ends changes with every number (of 86 random points
between the measured ones 7 had a figure beyond the margins above, by 2 to 81 %; with this margin and more points 2 of 33)."""
ABOVE = 1.05
"""A row counts from this multiple of the timestep measured before it: at timesteps between, the larger size is declared."""
SOME = 0.01
"""Restitution from which rows of probes with restitution count."""
LOCAL_ALIKE = 1.5
"""Ratio of the sizes of neighbouring points up to which one local row declares both."""
NEAR = 0.9
"""Share of a declared size from which on a figure is declared again: next to it a little more is to be expected."""
LONGEST = 22.0
"""ms: local rows of the largest timestep count below it."""
IMPACTS = ("strike", "row", "edge")


def kind_of(probe: Probe) -> str:
    kinds = dict.fromkeys(IMPACTS, "impact") | {"stack": "stack", "stack-slides": "sliding stack"}
    return kinds.get(probe.NAME) or ("coupled" if probe.NAME in COUPLED else "pair")


def bounces(probe: str, restitution: float) -> bool:
    """Whether a figure, or a row that counts from a restitution on, is of a coupled probe with restitution."""
    return bool(restitution) and kind_of(_probe(probe)) == "coupled"


def law_of(friction: float, restitution: float, ratio: float, cone: str, timestep: float) -> ProbeLaw:
    reach = MaterialReach(True, True, True, True, ratio, 3, crosses=True, jams=True, squeezes=True, plane=True)
    return ProbeLaw(PairContact("base", "body", friction, restitution), cone, timestep, reach=reach)


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


def off(figure: ProbeFigure) -> float:
    if figure.measured is None or not math.isfinite(figure.measured):
        return math.inf
    return abs(figure.measured - figure.expected) / figure.tolerance


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


Sizes = tuple[float, ...]
"""Largest deviations beyond the tolerance, by timestep; 0 where there is none."""


def declare(rows: Sequence[Mapping[str, Any]], part: Part) -> None:
    """Write the rows of one part into the engines' tables; rows of the other parts stay."""
    local, bouncing = part
    for engine in dict.fromkeys(row["engine"] for row in rows):
        mine = [row for row in rows if row["engine"] == engine and "seconds" not in row]
        table = ROOT / "simspec" / "engines" / engine / "contact_deviations.csv"
        with table.open(newline="", encoding="utf-8") as lines:
            stored = list(csv.DictReader(lines))
        kept = [row for row in stored if _part_of(row) != part]
        if local:
            made = list(local_rows(uncovered(mine)))
        else:
            made = _without_repeats(table_rows(list(uncovered(mine)) if bouncing else mine, mine))
        with table.open("w", newline="", encoding="utf-8") as lines:
            writer = csv.DictWriter(lines, KEYS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(sorted([*kept, *made], key=_part_of))
        print(f"{engine}: {len(made)} rows, {len(kept)} others")


Part = tuple[bool, bool]
"""Of a table: whether its rows are local, and whether they are of coupled probes with restitution."""


PARTS: Sequence[Part] = ((False, False), (False, True), (True, False), (True, True))


def _part_of(row: Mapping[str, str]) -> Part:
    return any(row[f"{name}_below"] for name in LIMITS), bounces(row["probe"], float(row["restitution"] or 0.0))


def _without_repeats(rows: Iterable[dict[str, str]]) -> list[dict[str, str]]:
    """Rows of coupled probes with restitution only where no earlier row, which counts for all that they do, is as large."""
    found: list[dict[str, str]] = []
    for row in rows:
        limits = [float(row[name] or 0.0) for name in LIMITS]
        repeats = bounces(row["probe"], float(row["restitution"] or 0.0)) and any(
            all(row[name] == other[name] for name in ("probe", "relative"))
            and all(other[name] in ("", row[name]) for name in ("setting", "cone"))
            and all(float(other[name] or 0.0) <= limit for name, limit in zip(LIMITS, limits, strict=True))
            and float(other["size"]) >= float(row["size"])
            for other in found
        )
        if not repeats:
            found.append(row)
    return found


def _row(kind: tuple[str, str, str], limits: Mapping[str, float], size: float, relative: bool) -> dict[str, str]:
    written = {name: f"{limit:.6g}" for name, limit in limits.items() if limit and math.isfinite(limit)}
    end = {"size": f"{size:.3g}", "relative": "yes" if relative else "no"}
    return {**dict.fromkeys(KEYS, ""), **dict(zip(KEYS, kind, strict=False)), **written, **end}


def table_rows(
    rows: Sequence[Mapping[str, Any]], measured: Sequence[Mapping[str, Any]] = ()
) -> Iterator[dict[str, str]]:
    """The rows of one engine from the grid ``TABLES``: the largest size up to each timestep, at which a row begins.
    ``measured``: all rows that were measured, of which ``rows`` are some."""
    timesteps = sorted({row["timestep"] for row in measured or rows})
    kinds = list(dict.fromkeys((_setting(row["settings"]), row["cone"]) for row in measured or rows))
    for measured_kind in dict.fromkeys(_measured(row) for row in rows):
        probe, restitution, ratio, relative = measured_kind
        margin = BOUNCING_MARGIN if bounces(probe, restitution) else MARGIN
        some = [row for row in rows if _measured(row) == measured_kind and row["off"] > 1.0]
        sizes = {kind: [0.0] * len(timesteps) for kind in kinds}
        for row in some:
            column = timesteps.index(row["timestep"])
            sizes_of = sizes[_setting(row["settings"]), row["cone"]]
            sizes_of[column] = max(sizes_of[column], _size(row))
        for (setting, cone), shared in _shared({kind: tuple(sizes) for kind, sizes in sizes.items()}).items():
            largest = 0.0
            for before, size in zip((0.0, *timesteps), shared, strict=False):
                if size > largest:
                    largest = size
                    limits = {"timestep": ABOVE * before, "restitution": restitution, "ratio": ratio}
                    yield _row((setting, cone, probe), limits, margin * float(f"{size:.3g}"), relative)


def uncovered(rows: Iterable[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """The rows that the engine's other declared deviations do not cover. A value that is not finite cannot be declared."""
    for row in rows:
        if row["measured"] is None or not math.isfinite(row["measured"]):
            continue
        engine = find_engine(row["engine"])
        settings = {name: setting.default for name, setting in engine.SETTINGS.items()} | row["settings"]
        law = law_of(row["friction"], row["restitution"], row["ratio"], row["cone"], row["timestep"] / 1e3)
        figure = ProbeFigure(row["probe"], "", row["case"], "", "", row["expected"], row["measured"], row["tolerance"])
        bouncing = bounces(row["probe"], row["restitution"])
        declared = [
            deviation for deviation in engine.CONTACT_DEVIATIONS if _is_earlier(deviation, row["local"], bouncing)
        ]
        covered = widened(figure, law, declared, settings, engine.version())
        if not covered.passed or (covered.deviation and off(covered) > NEAR):
            yield row


def _is_earlier(deviation: Deviation, local: bool, bouncing: bool) -> bool:
    """Whether a deviation is of an earlier part of a table, or of the engine's module, than a row that is to be declared."""
    coupled = bounces(deviation.probe, deviation.restitution)
    return (not deviation.is_local and (local or not (bouncing and coupled))) or (local and bouncing and not coupled)


def local_rows(rows: Iterable[Mapping[str, Any]]) -> Iterator[dict[str, str]]:
    """The rows of one engine from the grid ``BETWEEN``: each counts up to the next measured values on both sides."""
    groups: dict[tuple[Any, ...], dict[float, list[Mapping[str, Any]]]] = {}
    for row in rows:
        along = "ratio" if row["probe"].startswith("stack") else "friction"
        bouncing = row["restitution"] if bounces(row["probe"], row["restitution"]) else 0.0
        key = (
            _setting(row["settings"]),
            row["cone"],
            row["probe"],
            row["timestep"],
            _is_share(row),
            along,
            bouncing,
        )
        groups.setdefault(key, {}).setdefault(row[along], []).append(row)
    for (setting, cone, name, _, relative, along, bouncing), by in groups.items():
        probe = _probe(name)
        grid = BETWEEN.bouncing() if bouncing else BETWEEN.without_bouncing()
        for some in _neighbours(by, [point[2 if along == "ratio" else 0] for point in grid.points(probe)]):
            limits = {}
            for limit in LIMITS:
                limits[limit], limits[f"{limit}_below"] = _limits(limit, probe, some, grid)
            size = float(f"{max(_size(row) for row in some):.3g}")
            yield _row((setting, cone, name), limits, (BOUNCING_MARGIN if bouncing else LOCAL_MARGIN) * size, relative)


def _neighbours(
    by: Mapping[float, Sequence[Mapping[str, Any]]], values: Iterable[float]
) -> Iterator[list[Mapping[str, Any]]]:
    """Points that are neighbours, with deviations alike."""
    found: list[Mapping[str, Any]] = []
    for value in sorted(set(values)):
        some = by.get(value, ())
        sizes = [max(_size(row) for row in rows) for rows in (found, some) if rows]
        if found and (not some or max(sizes) > LOCAL_ALIKE * min(sizes)):
            yield found
            found = []
        found = [*found, *some]
    if found:
        yield found


def _probe(name: str) -> Probe:
    """A probe that is measured at the points of the figure ``name``: for figures of other names one of its kind."""
    if name in SLIDING:
        return PROBES["stack-slides"]
    several = [probe for probe in COUPLED.values() if name.startswith(probe.NAME)]
    return max(several, key=lambda probe: len(probe.NAME)) if several else PROBES["push"]


def _limits(name: str, probe: Probe, rows: Sequence[Mapping[str, Any]], grid: Grid) -> tuple[float, float]:
    """From the measured value before these rows' to the one after them, exclusive."""
    if name == "timestep":
        measured: Iterable[float] = grid.coupled_timesteps if probe.NAME in COUPLED else grid.timesteps
    else:
        measured = {point[("friction", "restitution", "ratio").index(name)] for point in grid.points(probe)}
    values = sorted({*measured, *((FIRST_RESTITUTION,) if name == "restitution" and min(measured) > 0.0 else ())})
    first = values.index(round(min(row[name] for row in rows), 9))
    last = values.index(round(max(row[name] for row in rows), 9))
    before = values[first - 1] * 1.0001 if first else SOME if name == "restitution" and values[0] else 0.0
    if first and name in ("friction", "restitution") and values[first - 1] == 0.0:
        before = 1e-9
    after = values[last + 1] * 0.9999 if last + 1 < len(values) else LONGEST if name == "timestep" else math.inf
    return before, after


def _setting(settings: Mapping[str, Any]) -> str:
    return " ".join(f"{name}={value}" for name, value in settings.items())


def _measured(row: Mapping[str, Any]) -> tuple[str, float, float, bool]:
    """Probe, the restitution and ratio of masses from which its size counts (of a ratio from the one measured before), and
    whether the size is a share of the expected value. That at restitution 1 counts
    above the largest restitution of the other grid."""
    probe, relative = str(row["probe"]), _is_share(row)
    if bounces(probe, row["restitution"]):
        return probe, _from_restitution(row["restitution"]), 0.0, relative
    varied = probe.split("-")[0] in IMPACTS or probe in SLIDING
    ratio = 0.0
    if probe.startswith("stack"):
        ratios = TABLES.values["sliding stack" if probe in SLIDING else "stack"][0].ratios
        ratio = max((1.001 * size for size in ratios if size < row["ratio"]), default=0.0)
    return probe, SOME if varied and row["restitution"] else 0.0, ratio, relative


def _from_restitution(restitution: float) -> float:
    """From where on the size of a coupled probe at this restitution of the first grid counts."""
    if restitution <= FIRST_RESTITUTION:
        return SOME
    return 1.001 * (FIRST_RESTITUTION if restitution < 1.0 else LAST_RESTITUTION)


def _size(row: Mapping[str, Any]) -> float:
    """A share of the expected value, or where that is zero a value in the figure's unit."""
    if row["measured"] is None:
        raise SystemExit(f"the value to declare is not finite: {row}")
    size = abs(row["measured"] - row["expected"])
    return float(size / abs(row["expected"]) if _is_share(row) else size)


def _is_share(row: Mapping[str, Any]) -> bool:
    """Whether a size is a share of the expected value: not of a body that bounces on a carrier, which slips by millimetres
    whatever the hundredths of a millimetre that it is expected to slip."""
    return bool(row["expected"]) and not (row["probe"] == "carrier" and bounces("carrier", row["restitution"]))


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
            label = f"{engine} {_setting(settings)}".strip()
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
