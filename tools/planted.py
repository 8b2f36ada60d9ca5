"""Defects planted in the coupled contact probes, in every engine and cone: docs/records/proof-figures.md and
docs/records/planted-contact.md.

python tools/planted.py [--engine NAME ...] [--json FILE]
python tools/planted.py --page FILE ...

One defect at a time is in the compiled files: a number of the law, the cone, the timestep, a setting, a body of the probe's
world. The figures are judged as level L5 does, by the law without it and with the engine's declared deviations. Defects that no
coupled probe sees are given to the probes of one pair. --json keeps the results; from such files --page writes both pages.
Exits 1 when the unchanged law fails somewhere, or when no probe at all sees a defect.
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import itertools
import json
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import planted_pages
from planted_defects import DEFECTS, LAWS, MASS, SLICK, UNCHANGED, Defect

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.process import Answer, Operation, call
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.contact import run
from simspec.proof.contact.probe import GRAVITY, Probe, ProbeFigure, ProbeLaw, ProbeTrial, TrialMotion
from simspec.proof.contact.run import deviating
from simspec.proof.contact.worlds import EVERYTHING, drive_of, joined, motion_of, split, world_of_trial
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.world.types import Body, Contact, EngineOptions, Material, Physics, World

SHAPE = "compliance-shape"
COUPLED: Mapping[str, Probe] = {**run.COUPLED, SHAPE: run.PROBES[SHAPE]}
SINGLE_PAIR: Mapping[str, Probe] = {
    name: probe for name, probe in run.PROBES.items() if name not in (*COUPLED, "torsional", "rolling")
}
CONES = ("elliptic", "pyramid-circumscribed", "pyramid-inscribed")
DEADLINE = 600.0
"""s: of one process; those of an engine and a cone take half a minute."""
SETTINGS: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "mujoco": ({"friction": "native"}, {"friction": "coulomb"}),
    "pybullet": ({},),
    "dart": ({"contact_solver": "nsgs"},),
    "drake": ({"contact_approximation": "tamsi"},),
    "ode": ({"solver": "step"},),
    "rapier": ({},),
    "gazebo": ({"contact_solver": "dantzig"},),
    "physx": ({},),
}
"""Settings by engine that the figures are judged under; the first is what an engine does by default."""


@dataclass(frozen=True)
class Job:
    """One probe with one defect in an engine: the true law, and of each trial its worlds and what drives them."""

    defect: Defect
    law: ProbeLaw
    probe: Probe
    settings: Mapping[str, Any]
    worlds: list[list[World]]
    operations: list[list[Operation]]

    @property
    def key(self) -> tuple[ProbeLaw, str]:
        """The part that it shares with the same probe of the unchanged law."""
        return self.law, self.probe.NAME


Found = list[list[TrialMotion]] | EngineError | UnsupportedError
"""Of each trial the motions of its worlds, or why there are none."""


@dataclass(frozen=True)
class Tried:
    """The results of a job in an engine."""

    job: Job
    found: Found
    figures: Sequence[ProbeFigure]

    @property
    def fails(self) -> list[str]:
        """Names of figures that fail."""
        return list(dict.fromkeys(figure.probe for figure in self.figures if not figure.passed))


@dataclass
class Result:
    """The stored result of a defect in an engine, under a setting and a cone.

    verdict   fails: a figure of the unchanged law does. seen: a figure of a coupled probe fails. hidden: declared deviations
              alone let all pass, though the defect moves a figure by more than the probe's tolerance. blind: all pass, though
              bodies move otherwise. inert: they do not, to the last bit. refused: by the engine
    seen      names of figures that fail; ``blind``: coupled probes in which bodies move otherwise and all passes
    single_pair  the probes of one pair that see what no coupled probe does, or else that level L1 does
    why       the declared deviations that hide it; why it is refused
    """

    engine: str
    version: str
    setting: str
    cone: str
    defect: str
    verdict: str = ""
    seen: list[str] = field(default_factory=list)
    blind: list[str] = field(default_factory=list)
    single_pair: list[str] = field(default_factory=list)
    why: str = ""
    date: str = field(default_factory=lambda: datetime.datetime.now(datetime.UTC).date().isoformat())


def altered(trial: ProbeTrial, probe: str, defect: Defect) -> ProbeTrial:
    heavier, slick = (re.compile(some.get(probe, "(?!)")) for some in (defect.heavier, defect.slick))

    def body_of(body: Body) -> Body:
        if heavier.fullmatch(body.name):
            body = dataclasses.replace(
                body, inertial=dataclasses.replace(body.inertial, mass=MASS * body.inertial.mass)
            )
        if slick.fullmatch(body.name):
            shapes = tuple(dataclasses.replace(shape, material=SLICK) for shape in body.shapes)
            body = dataclasses.replace(body, shapes=shapes)
        return body

    return ProbeTrial(tuple(map(body_of, trial.bodies)), trial.phases, () if defect.no_contact else trial.meets)


def job(engine: str, judged: Mapping[str, Any], cone: str, defect: Defect, probe: Probe) -> Job | None:
    """None where there is nothing to plant. Raises UnsupportedError where the engine refuses it."""
    law = dataclasses.replace(LAWS[defect.law], friction_cone=cone)
    choice = engine, str(next(iter(judged.values()), ""))
    if not probe.applies(law) or defect.cone == cone or (defect.settings and choice not in defect.settings):
        return None
    pair = dataclasses.replace(law.pair, **defect.pair)
    materials = [Material(name, pair.friction, pair.restitution) for name in (pair.first, pair.second)]
    if probe.NAME in defect.slick:
        materials.append(Material(SLICK, 0.0, pair.restitution))
    pairs = tuple(
        dataclasses.replace(
            pair,
            first=first.name,
            second=second.name,
            friction=0.0 if SLICK in (first.name, second.name) else pair.friction,
        )
        for first, second in itertools.combinations_with_replacement(materials, 2)
    )
    contact = Contact(defect.cone or cone, tuple(materials), pairs)
    physics = Physics((0.0, 0.0, -GRAVITY), defect.timestep * law.timestep)
    settings = {**judged, **defect.settings.get(choice, {})}
    options = EngineOptions(engine, tuple(sorted(settings.items())), EVERYTHING)
    worlds: list[list[World]] = []
    operations: list[list[Operation]] = []
    for trial in probe.trials(law):
        parts = split(altered(trial, probe.NAME, defect), find_engine(engine).PROBED_TOGETHER)
        worlds.append([world_of_trial(part, contact, physics, options) for part in parts])
        operations.append([drive_of(world, part) for world, part in zip(worlds[-1], parts, strict=True)])
    return Job(defect, law, probe, judged, worlds, operations)


def measured(engine: str, jobs: Sequence[Job]) -> list[Found]:
    """Of each job its motions, or why there are none: all of one process."""
    found: dict[int, Found] = {}
    written: dict[int, list[Operation]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number, planned in enumerate(jobs):
            try:
                written[number] = _written(engine, planned, Path(folder) / str(number))
            except UnsupportedError as error:
                found[number] = error
        for number, answer in _answered(engine, Path(folder), written).items():
            if isinstance(answer, EngineError):
                found[number] = answer
            else:
                left = iter(answer)
                found[number] = [[motion_of(world, next(left)) for world in worlds] for worlds in jobs[number].worlds]
    return [found[number] for number in range(len(jobs))]


def _answered(engine: str, place: Path, some: Mapping[int, list[Operation]]) -> dict[int, list[Answer] | EngineError]:
    """By number the answers to some operations. If a process fails, its halves are repeated, to find the failing operation."""
    numbers = list(some)
    if not numbers:
        return {}
    try:
        answers = iter(call(engine, place, list(itertools.chain(*some.values())), deadline=DEADLINE).answers)
    except EngineError as error:
        if len(numbers) == 1:
            return {numbers[0]: error}
        halves = numbers[: len(numbers) // 2], numbers[len(numbers) // 2 :]
        parts = [_answered(engine, place, {number: some[number] for number in half}) for half in halves]
        return parts[0] | parts[1]
    return {number: [next(answers) for _ in operations] for number, operations in some.items()}


def _written(engine: str, planned: Job, place: Path) -> list[Operation]:
    pairs = zip(itertools.chain(*planned.worlds), itertools.chain(*planned.operations), strict=True)
    found = []
    for number, (world, operation) in enumerate(pairs):
        artifacts = place / str(number)
        write_folder(compile_world(world, [engine])[engine].files, artifacts)
        parameters = {**operation.parameters, "artifacts": str(artifacts)}
        found.append(dataclasses.replace(operation, parameters=parameters))
    return found


def figures(planned: Job, engine: str, found: Found) -> list[ProbeFigure]:
    """Figures of level L5; an engine that fails gives a failed figure, and a refused job gives none."""
    if isinstance(found, UnsupportedError):
        return []
    if isinstance(found, EngineError):
        return [ProbeFigure(planned.probe.NAME, "", str(found).splitlines()[0], "", "", 0.0, None, 0.0)]
    kind = find_engine(engine)
    with np.errstate(invalid="ignore"):  # bodies that never meet have no impact: NaN, which fails
        raw = planned.probe.figures(planned.law, [joined(parts) for parts in found])
    return [deviating(figure, planned.law, kind, planned.settings, kind.version()) for figure in raw]


def tried(
    engine: str, settings: Mapping[str, Any], cone: str, defects: Sequence[Defect], probes: Mapping[str, Probe]
) -> list[Tried]:
    """Every probe with every defect that it can have."""
    jobs = [
        planned
        for defect in defects
        for name, probe in probes.items()
        if not (defect.probes and name in COUPLED and name not in defect.probes)
        and (planned := job(engine, settings, cone, defect, probe)) is not None
    ]
    found = measured(engine, jobs)
    return [Tried(planned, some, figures(planned, engine, some)) for planned, some in zip(jobs, found, strict=True)]


def results(engine: str, settings: Mapping[str, Any], cone: str) -> list[Result]:
    """Of every defect, and of each unchanged law that fails. Nothing where the engine refuses the cone."""
    jointed = find_engine(engine).SUPPORT[Feature.JOINT_SLIDE].level is not Level.UNSUPPORTED
    probes = {name: probe for name, probe in COUPLED.items() if jointed or name != "squeeze"}
    everything = tried(engine, settings, cone, [*UNCHANGED, *DEFECTS], probes)
    before = {first_try.job.key: first_try for first_try in everything if first_try.job.defect in UNCHANGED}
    if all(isinstance(first_try.found, UnsupportedError) for first_try in before.values()):
        return []
    label = " ".join(f"{name}: {value}" for name, value in settings.items())
    about = (engine, str(find_engine(engine).version()), label, cone)
    failing = [
        Result(*about, attempt.job.defect.name, planted_pages.FAILS, attempt.fails)
        for attempt in before.values()
        if attempt.fails
    ]
    mine = {}
    for defect in DEFECTS:
        if attempts := [attempt for attempt in everything if attempt.job.defect is defect]:
            mine[defect.name] = Result(*about, defect.name)
            judge(mine[defect.name], engine, attempts, before)
    left = [defect for defect in DEFECTS if defect.name in mine and mine[defect.name].verdict in ("hidden", "blind")]
    for attempt in tried(engine, settings, cone, left, SINGLE_PAIR):
        mine[attempt.job.defect.name].single_pair += attempt.fails
    for defect in left:
        if not mine[defect.name].single_pair and any(
            reads(attempt.job) for attempt in everything if attempt.job.defect is defect
        ):
            mine[defect.name].single_pair.append("masses that are read back (L1)")
    return [*failing, *mine.values()]


def judge(result: Result, engine: str, attempts: Sequence[Tried], before: Mapping[tuple[ProbeLaw, str], Tried]) -> None:
    """Say in ``result`` what the coupled probes show of a defect; ``before``: the same without it."""
    acts, rows = False, list[str]()
    for attempt in attempts:
        unchanged = before[attempt.job.key]
        for some in (unchanged.found, attempt.found):
            if isinstance(some, UnsupportedError):
                result.verdict, result.why = "refused", some.problems[0].message
                return
        result.seen += attempt.fails
        if not same(attempt.found, unchanged.found):
            acts = True
            if not attempt.fails:
                result.blind.append(attempt.job.probe.NAME)
                rows += hiding(attempt, engine, unchanged)
    result.verdict = "seen" if result.seen else "hidden" if rows else "blind" if acts else "inert"
    result.why = ", ".join(dict.fromkeys(rows))


def same(found: Found, unchanged: Found) -> bool:
    """Whether two answers are the same motion, to the last bit."""
    if not (isinstance(found, list) and isinstance(unchanged, list)):
        return False
    pairs = zip(itertools.chain(*found), itertools.chain(*unchanged), strict=True)
    return all(
        first.pose.keys() == second.pose.keys()
        and all(np.array_equal(first.pose[name], second.pose[name], equal_nan=True) for name in first.pose)
        and all(np.array_equal(first.velocity[name], second.velocity[name], equal_nan=True) for name in first.velocity)
        for first, second in pairs
    )


def reads(planned: Job) -> bool:
    """Whether a mass that an engine reads back differs from the probe's own."""
    given = {body.name: body.inertial.mass for trial in planned.probe.trials(planned.law) for body in trial.bodies}
    with tempfile.TemporaryDirectory() as folder:
        for number, world in enumerate(itertools.chain(*planned.worlds)):
            (engine,) = (options.engine for options in world.engines)
            place = Path(folder) / str(number)
            write_folder(compile_world(world, [engine])[engine].files, place)
            read = call(engine, place, [Operation("read_back", world=world)]).answers[0].read_back
            if read is None:
                raise EngineError(engine, "nothing was read back")
            masses = {body.name: body.inertial.mass for body in read.bodies}
            if any(abs(masses[name] - mass) > 1e-3 * mass for name, mass in given.items() if name in masses):
                return True
    return False


def hiding(attempt: Tried, engine: str, unchanged: Tried) -> Iterator[str]:
    """The declared deviations by which figures pass, with the defect or without it, although it moves them by more than the
    probe's tolerance."""
    law, kind = attempt.job.law, find_engine(engine)
    for figure, old in zip(attempt.figures, unchanged.figures, strict=False):
        promised = figure.promised or old.promised
        if promised is None or figure.measured is None or old.measured is None:
            continue
        if abs(figure.measured - old.measured) > promised:
            conditions = (
                law.pair,
                law.friction_cone,
                law.timestep,
                attempt.job.settings,
                law.reach.ratio,
                kind.version(),
            )
            rows = [row for row in kind.CONTACT_DEVIATIONS if row.probe == figure.probe and row.counts_for(*conditions)]
            widest = max(rows, key=lambda row: row.size)
            yield " ".join(
                filter(None, (widest.probe, widest.friction_cone, f"{widest.size:.3g}", "" if widest.relative else "m"))
            )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--engine", action="append", choices=sorted(SETTINGS))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", nargs="+", type=Path, help="files of --json")
    given = parser.parse_args()
    if given.page:
        planted_pages.write([row for file in given.page for row in json.loads(file.read_text())])
        return 0
    kept: list[dict[str, Any]] = []
    for engine in given.engine or SETTINGS:
        if find_engine(engine).version() is None:
            print(f"{engine} is not installed", file=sys.stderr)
            continue
        for settings, cone in itertools.product(SETTINGS[engine], CONES):
            clock = time.monotonic()
            found = results(engine, settings, cone)
            kept += [dataclasses.asdict(result) for result in found]
            if found:
                counts = ", ".join(
                    f"{name} {count}" for name, count in Counter(result.verdict for result in found).items()
                )
                print(f"{engine} {found[0].setting} {cone}: {counts}; {time.monotonic() - clock:.0f} s", flush=True)
    bad = [row for row in kept if planted_pages.missed(row) or row["verdict"] == planted_pages.FAILS]
    for row in bad:
        print(
            "BAD",
            *(row[name] for name in ("engine", "setting", "cone", "defect", "verdict", "why")),
            row["seen"],
            sep="  ",
        )
    if given.json:
        given.json.write_text(json.dumps(kept, indent=1))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
