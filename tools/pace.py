"""What a scenario costs in each engine, on a machine that others disturb.

    python tools/pace.py specs/stack-cylinders.yaml                  three rounds of all of it
    python tools/pace.py specs/stack-cylinders.yaml --seconds 30     its first 30 s
    python tools/pace.py specs/stack-cylinders.yaml --only dart --setting dart.sleeping=true

A run is the same arithmetic every time, so that whatever makes one slower comes from outside. Engines take turns, a round each;
of every simulated second the fastest round counts (``quiet``), and the middle one stands beside it (``median``): when the two
are far apart, the machine was not quiet. Nothing else should run meanwhile.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import dataclasses
import json
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import simspec
from simspec.compiler import compile_world, write_folder
from simspec.control.request import from_request, to_request
from simspec.engines.kit.process import ONE_THREAD
from simspec.engines.kit.recorder import MOST_BYTES, Recording, Stepper
from simspec.engines.kit.registry import engines, find_engine
from simspec.engines.kit.session import Session
from simspec.world.types import EngineOptions, World

PARTS = ("step", "control", "record")
"""Inside the engine's step calls; the laws, and passing states and efforts; taking the rows that the scenario asks for."""


@dataclasses.dataclass(frozen=True)
class Pace:
    """µs a step, by part: the fastest round of every second, and the median one."""

    timestep: float
    quiet: Mapping[str, float]
    median: Mapping[str, float]

    def real_time_factor(self, of: str = "quiet") -> float:
        """Simulated time over time inside the step calls."""
        return 1e6 * self.timestep / getattr(self, of)["step"]


def once(world: World, engine: str) -> np.ndarray:
    """One run in this process: seconds spent, by simulated second and part."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / engine
        write_folder(compile_world(world, [engine])[engine].files, place)
        session = Session(engine, place)
        stepper = Stepper(session, from_request(*to_request(world)))
        recording = Recording(
            session, world.record.channels, stepper.control, f"{folder}/recorded-", MOST_BYTES, stepper.seconds
        )
        recording.take(0)
        rows, done = [], 0
        while done < world.physics.steps:
            before = (stepper.seconds["step"], stepper.seconds["control"], recording.seconds)
            for _ in range(max(1, round(1.0 / (world.physics.timestep * world.record.every_steps)))):
                count = min(world.record.every_steps, world.physics.steps - done)
                if count:
                    stepper.advance(done, count)
                    done += count
                    recording.take(done)
            after = (stepper.seconds["step"], stepper.seconds["control"], recording.seconds)
            rows.append(np.subtract(after, before))
        session.close()
    return np.array(rows)


@contextmanager
def one_thread() -> Iterator[None]:
    """Processes begun in this block work in one thread, as in a run, where the environment does not say otherwise."""
    new = {name: value for name, value in ONE_THREAD.items() if name not in os.environ}
    os.environ.update(new)
    try:
        yield
    finally:
        for name in new:
            del os.environ[name]


def measure(world: World, chosen: Sequence[str], rounds: int) -> dict[str, Pace]:
    """The pace of a world in engines, each run in a process of its own."""
    runs: dict[str, list[np.ndarray]] = {engine: [] for engine in chosen}
    begun_anew = multiprocessing.get_context("spawn")
    with one_thread():
        for _ in range(rounds):
            for engine in chosen:
                with concurrent.futures.ProcessPoolExecutor(1, mp_context=begun_anew) as pool:
                    runs[engine].append(pool.submit(once, world, engine).result())
    scale = 1e6 / world.physics.steps
    return {
        engine: Pace(
            world.physics.timestep,
            dict(zip(PARTS, (scale * np.min(found, axis=0).sum(axis=0)).tolist(), strict=True)),
            dict(zip(PARTS, (scale * np.median(found, axis=0).sum(axis=0)).tolist(), strict=True)),
        )
        for engine, found in runs.items()
    }


def with_settings(world: World, engine: str, given: Mapping[str, Any]) -> World:
    """A world with other settings of one engine."""
    there = {one.engine: one for one in world.engines}
    one = there.get(engine, EngineOptions(engine))
    there[engine] = dataclasses.replace(one, settings=tuple(sorted((dict(one.settings) | dict(given)).items())))
    return dataclasses.replace(world, engines=tuple(there.values()))


def table(found: Mapping[str, Pace]) -> str:
    """A row for each engine."""
    lines = [f"{'engine':10} {'RTF':>6} {'median':>7}   {'step':>7} {'control':>8} {'record':>7}  µs a step"]
    for engine, pace in found.items():
        factors = f"{pace.real_time_factor():6.1f} {pace.real_time_factor('median'):7.1f}"
        lines.append(
            f"{engine:10} {factors}   {pace.quiet['step']:7.1f} {pace.quiet['control']:8.1f} {pace.quiet['record']:7.1f}"
        )
    return "\n".join(lines)


def _setting(text: str) -> tuple[str, str, Any]:
    path, _, value = text.partition("=")
    engine, _, name = path.partition(".")
    if engine not in engines() or name not in find_engine(engine).SETTINGS:
        raise argparse.ArgumentTypeError(f"{text!r} is not ENGINE.NAME=VALUE, with a setting that the engine has")
    try:
        return engine, name, json.loads(value)
    except json.JSONDecodeError as error:
        raise argparse.ArgumentTypeError(f'{value!r} is no number, true, false or "text"') from error


def main(arguments: Sequence[str] | None = None) -> int:
    """See the module's docstring."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("spec", type=Path)
    parser.add_argument("--only", nargs="+", choices=list(engines()), default=list(engines()), help="engines")
    parser.add_argument("--seconds", type=float, help="of the scenario; all of it without")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--setting", type=_setting, action="append", default=[], metavar="ENGINE.NAME=VALUE")
    given = parser.parse_args(arguments)
    world = simspec.load(given.spec).resolve()
    for engine, name, value in given.setting:
        world = with_settings(world, engine, {name: value})
    if given.seconds:
        steps = min(world.physics.steps, round(given.seconds / world.physics.timestep))
        world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, steps=steps), expectations=())
    print(table(measure(world, given.only, given.rounds)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
