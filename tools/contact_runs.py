"""What docs/contact.md is made from: contact probes and towers, run in every engine at every timestep."""

from __future__ import annotations

import dataclasses
import itertools
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.process import Operation, Reply, call
from simspec.engines.kit.registry import engines, find_engine
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.contact.probe import GRAVITY, Figure, Law, Motion, Phase, Probe, Trial
from simspec.proof.contact.split import joined, split
from simspec.support.features import Feature
from simspec.world.kinematics import layout_of
from simspec.world.types import (
    Body,
    Contact,
    EngineOptions,
    Inertial,
    Joint,
    Material,
    PairContact,
    Physics,
    Pose,
    Shape,
    World,
)

Settings = tuple[tuple[str, bool | int | float | str], ...]

ENGINES = tuple(engines())
RUNS: Mapping[str, tuple[str, Settings]] = {
    **{name: (name, ()) for name in ENGINES},
    "mujoco, coulomb": ("mujoco", (("friction", "coulomb"),)),
    "drake, sap": ("drake", (("contact_approximation", "sap"),)),
}
"""What has rows of its own: engine and settings."""
ACCEPT = tuple(sorted(feature.value for feature in Feature))
"""Everything approximate is accepted: how approximate it is, is what the page says."""
DEADLINE = 1800.0
"""s for one engine's process."""

TOWER_TIME, TOWER_LOOKS = 10.0, 20
"""s, and looks per second."""
FALLEN = 0.5
"""A tower has fallen when a body is this share of its width off its place, or lies this share of its height lower over the
body below it. Layers that sink into one another a little all at once do not count."""
TOWERS = {
    "ten boxes": ("box", (0.1, 0.1, 0.1), 10, 1.0),
    "seven cylinders": ("cylinder", (0.02, 0.1), 7, 0.125),
}
"""Shape and size of a body (m; a cylinder's radius and length), how many, and the mass of each (kg)."""
TOWER_FRICTION = 0.5


@dataclasses.dataclass(frozen=True)
class Result:
    """Figures of one probe in one engine at one timestep, or why there are none."""

    figures: tuple[Figure, ...] = ()
    refused: str = ""
    failed: str = ""


def probe_world(law: Law, bodies: tuple[Body, ...], steps: int, run: str) -> World:
    """Bodies of two materials, every two of which have the law's pair, with the settings of that run."""
    pair = law.pair
    materials = tuple(
        Material(name, pair.friction, pair.restitution, pair.torsional_friction, pair.rolling_friction)
        for name in sorted({pair.first, pair.second})
    )
    pairs = tuple(
        dataclasses.replace(pair, first=one.name, second=other.name)
        for one, other in itertools.combinations_with_replacement(materials, 2)
    )
    physics = Physics((0.0, 0.0, -GRAVITY), law.timestep, steps)
    engine, settings = RUNS[run]
    options = (EngineOptions(engine, settings, ACCEPT),)
    return World("probe", bodies, Contact(law.friction_cone, materials, pairs), physics, engines=options)


def measure(run: str, jobs: Sequence[tuple[Probe, Law]]) -> list[Result]:
    """Run each probe under its law, all in one process of the run's engine."""
    engine = RUNS[run][0]
    with tempfile.TemporaryDirectory(prefix="simspec-contact-") as name:
        results: list[Result | None] = [None] * len(jobs)
        asked: list[tuple[int, list[World], list[Operation]]] = []
        parts: dict[int, list[int]] = {}  # of each job, in how many worlds each trial is driven
        for index, (probe, law) in enumerate(jobs):
            if not probe.applies(law):
                results[index] = Result(refused="the probe has nothing to measure here")
                continue
            try:
                worlds, operations = [], []
                trials = [split(trial, find_engine(engine).PROBED_TOGETHER) for trial in probe.trials(law)]
                parts[index] = [len(some) for some in trials]
                for number, trial in enumerate(part for some in trials for part in some):
                    world, operation = _prepared(run, law, trial, Path(name) / f"{index}-{number}")
                    worlds.append(world)
                    operations.append(operation)
                asked.append((index, worlds, operations))
            except UnsupportedError as error:
                results[index] = Result(refused=error.problems[0].message)
        for index, found in _called(engine, Path(name), asked):
            probe, law = jobs[index]
            if isinstance(found, str):
                results[index] = Result(failed=found)
            else:
                rest = iter(found)
                motions = [joined(list(itertools.islice(rest, count))) for count in parts[index]]
                results[index] = Result(tuple(probe.figures(law, motions)))
        return [result or Result(failed="not run") for result in results]


def _prepared(run: str, law: Law, trial: Trial, place: Path) -> tuple[World, Operation]:
    engine = RUNS[run][0]
    world = probe_world(law, trial.bodies, sum(phase.steps for phase in trial.phases), run)
    write_folder(compile_world(world, [engine])[engine].files, place)
    return world, _drive(world, trial.phases, place)


def _drive(world: World, phases: Sequence[Phase], place: Path) -> Operation:
    at = layout_of(world)
    names = [body.name for body in world.bodies]
    effort = np.zeros((len(phases), at.nv))
    for row, phase in zip(effort, phases, strict=True):
        for name, given in phase.effort.items():
            row[at.velocity[names.index(name)]] = given
    steps = [(phase.steps, phase.every) for phase in phases]
    parameters = {"artifacts": str(place), "timestep": world.physics.timestep, "phases": steps}
    return Operation("drive", parameters, {"effort": effort})


def _called(engine: str, place: Path, asked: list[tuple[int, list[World], list[Operation]]]):
    """(index, motions) of each job; one by one when the process with all of them fails, to see which one it is."""
    if not asked:
        return
    try:
        reply = _call(engine, place, [operation for _, _, operations in asked for operation in operations])
    except EngineError as error:
        if len(asked) == 1:
            yield asked[0][0], str(error)
            return
        for one in asked:
            yield from _called(engine, place, [one])
        return
    answers = iter(reply.answers)
    for index, worlds, _ in asked:
        yield index, [_motion(world, next(answers).arrays) for world in worlds]


def _call(engine: str, place: Path, operations: list[Operation]) -> Reply:
    return call(engine, place, operations, deadline=DEADLINE)


def _motion(world: World, arrays: dict[str, np.ndarray]) -> Motion:
    names = [body.name for body in world.bodies]
    return Motion(
        arrays["time"],
        {name: arrays["pose"][:, index] for index, name in enumerate(names)},
        {name: arrays["velocity"][:, index] for index, name in enumerate(names)},
    )


# --- towers -------------------------------------------------------------------------------------------------------


def tower(kind: str, timestep: float, friction_cone: str, run: str) -> World:
    """Bodies on one another, touching, on a big box."""
    shape, size, count, mass = TOWERS[kind]
    height = size[-1]
    if shape == "box":
        x, y, z = (edge * edge / 12.0 for edge in size)
        moments = (mass * (y + z), mass * (x + z), mass * (x + y))
    else:
        across = mass * (3.0 * size[0] ** 2 + size[1] ** 2) / 12.0
        moments = (across, across, mass * size[0] ** 2 / 2.0)
    ground = Shape("ground/solid", "box", (10.0, 10.0, 2.0), Pose((0.0, 0.0, -1.0)), "base")
    bodies = [Body("ground", "ground", Inertial(0.0), Joint("ground", "fixed"), (ground,))]
    for number in range(count):
        name = f"body_{number}"
        at = (0.0, 0.0, (number + 0.5) * height, 1.0, 0.0, 0.0, 0.0)
        joint = Joint(name, "free", position=at, velocity=(0.0,) * 6)
        solid = Shape(f"{name}/solid", shape, size, Pose(), "body")
        bodies.append(Body(name, name, Inertial(mass, inertia=(*moments, 0.0, 0.0, 0.0)), joint, (solid,)))
    law = Law(PairContact("base", "body", TOWER_FRICTION, 0.0), friction_cone, timestep)
    return probe_world(law, tuple(bodies), round(TOWER_TIME / timestep), run)


@dataclasses.dataclass(frozen=True)
class Stand:
    """When (s) a tower fell, None = it stood; how far (m) a body moved sideways, and the top one down, at most; or why it was
    not run."""

    fell: float | None = None
    drift: float = 0.0
    sunk: float = 0.0
    refused: str = ""


def stand(run: str, kind: str, timestep: float, friction_cone: str) -> Stand:
    """A tower for ``TOWER_TIME``."""
    engine = RUNS[run][0]
    world = tower(kind, timestep, friction_cone, run)
    shape, size, _, _ = TOWERS[kind]
    width, height = size[0] * (1.0 if shape == "box" else 2.0), size[-1]
    with tempfile.TemporaryDirectory(prefix="simspec-contact-") as name:
        place = Path(name) / "tower"
        try:
            write_folder(compile_world(world, [engine])[engine].files, place)
            steps = world.physics.steps
            phases = [Phase(steps, max(1, round(steps / (TOWER_TIME * TOWER_LOOKS))))]
            motion = _motion(world, _call(engine, place, [_drive(world, phases, place)]).answers[0].arrays)
        except UnsupportedError as error:
            return Stand(refused=error.problems[0].message)
        except EngineError as error:
            return Stand(refused=str(error))
        pose = np.array([motion.pose[body.name] for body in world.bodies if body.joint.kind == "free"])
        moved = np.linalg.norm(pose[:, :, :2] - pose[:, :1, :2], axis=2).max(axis=0)
        heights = np.concatenate([np.full((1, pose.shape[1]), -height / 2.0), pose[:, :, 2]])
        fallen = ~((moved < FALLEN * width) & (np.diff(heights, axis=0) > FALLEN * height).all(axis=0))
        if fallen.any():
            return Stand(fell=float(motion.time[int(np.argmax(fallen))]))
        return Stand(drift=float(moved.max()), sunk=float((pose[-1, 0, 2] - pose[-1, :, 2]).max()))
