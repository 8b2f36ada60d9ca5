"""The robot scenario over timesteps and seeds: docs/stacking.md.

    python tools/stacking.py                                    all engines, 20 timesteps, three seeds, then the table
    python tools/stacking.py --only dart --timesteps 16 24      some of it; what is known already is kept
    python tools/stacking.py --page                             the page again, from docs/stacking.json
    python tools/stacking.py --speed                            real-time factors at 1 ms (nothing else must run)
    python tools/stacking.py --sleeping --control               with bodies that rest asleep; with slippery fingers

A run is valid when every placement and every final place is within 1 cm, as the scenario's own expectations say. Seed 0 is the
scenario as it is written; other seeds move every cylinder by up to 0.1 mm along x and y.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import dataclasses
import math
import random
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pace import measure, table, with_settings
from stacking_page import ASLEEP, PAGE, ROOT, SEEDS, TIMESTEPS, keep, key, load, page, picture

import simspec
from simspec.engines.kit.registry import engines
from simspec.errors import EngineError
from simspec.resolve.scenario import engines as options_at
from simspec.runner.execution import run
from simspec.runner.expectations import evaluate
from simspec.runner.run import Run
from simspec.world.types import Expectation, World

SPEC = ROOT / "specs" / "stack-cylinders.yaml"

JITTER = 1e-4
"""m, along x and y."""
EVERY = 0.25
"""s between two looks at a run, to the nearest step."""
DEADLINE = 3600.0
"""s for one run: the slowest has a real-time factor above 1 on two busy cores."""
LOST = 0.02
"""m below the highest place on its way: a cylinder that comes down by more while it is carried has slipped."""
LIFTED = 0.03
"""m: a cylinder that never rises so far was not lifted."""
TRACKING = 0.2
"""rad: an arm that is farther than this from its trajectory has lost control."""
DEEP = 1e-3
"""m: an overlap of a tenth of a pad's width that is no solver's rounding."""
SLIPPERY = 0.05
"""μ of the fingers in the negative control."""


@dataclasses.dataclass(frozen=True)
class Result:
    """One run: the worst deviation of any expectation (m) and how it ended; ``failure`` empty when it is valid."""

    worst: float
    failure: str
    step_us: float
    real_time_factor: float
    cpu_factor: float
    control_us: float
    record_us: float


def scenario(timestep: float, seed: int) -> World:
    """The world at a timestep (s), with the settings for it. Times that are no whole number of steps go to the next step."""
    spec = simspec.load(SPEC)
    world = spec.resolve()
    end = world.physics.steps * world.physics.timestep
    steps = math.ceil(end / timestep - 1e-9)
    every = max(1, round(EVERY / timestep))
    draw = random.Random(seed).uniform
    bodies = tuple(_moved(body, draw) if seed and body.name.startswith("cylinder") else body for body in world.bodies)
    asked = tuple(_at_a_record(one, timestep, steps, every) for one in world.expectations)
    return dataclasses.replace(
        world,
        bodies=bodies,
        physics=dataclasses.replace(world.physics, timestep=timestep, steps=steps),
        record=dataclasses.replace(world.record, every_steps=every),
        expectations=asked,
        engines=options_at(spec.data.engines, timestep),
    )


def _moved(body, draw):
    x, y, *rest = body.joint.position
    position = (x + draw(-JITTER, JITTER), y + draw(-JITTER, JITTER), *rest)
    return dataclasses.replace(body, joint=dataclasses.replace(body.joint, position=position))


def _at_a_record(one: Expectation, timestep: float, steps: int, every: int) -> Expectation:
    """The expectation at the nearest recorded time."""
    given = dict(one.parameters)
    step = min(steps, round(given["at"] / timestep / every) * every)
    given["at"] = step * timestep
    return dataclasses.replace(one, parameters=tuple(sorted(given.items())))


def _asleep(world: World) -> World:
    for engine in engines():
        world = with_settings(world, engine, {"sleeping": True})
    return world


def _slippery(world: World) -> World:
    contact = world.contact
    pairs = tuple(
        dataclasses.replace(pair, friction=SLIPPERY) if "finger" in (pair.first, pair.second) else pair
        for pair in contact.pairs
    )
    return dataclasses.replace(world, contact=dataclasses.replace(contact, pairs=pairs))


def one(engine: str, milliseconds: float, seed: int, changed: Callable[[World], World] = lambda world: world) -> Result:
    """Run the scenario once."""
    world = changed(scenario(milliseconds * 1e-3, seed))
    try:
        done = run(world, engine, deadline=DEADLINE)
    except EngineError as error:
        return Result(math.inf, f"no result: {error}", *([0.0] * 5))
    return result_of(done)


def result_of(done: Run) -> Result:
    """What a run amounts to."""
    found = evaluate(done)
    measured = [outcome.measured for outcome in found if outcome.measured is not None]
    worst = max(measured, default=math.inf)
    missed = [
        (dict(asked.parameters)["at"], outcome, asked)
        for asked, outcome in zip(done.world.expectations, found, strict=True)
        if not outcome.passed
    ]
    failure = ""
    if missed or done.failed:
        failure = why(done, min(missed, key=lambda entry: entry[0])) if missed else str(done.failed)
    seconds, steps = done.provenance["seconds"], max(1, done.provenance["steps"])
    return Result(
        float(worst) if math.isfinite(worst) else math.inf,
        failure,
        1e6 * seconds["cpu"] / steps,
        done.real_time_factor or 0.0,
        done.cpu_factor or 0.0,
        1e6 * seconds["control"] / steps,
        1e6 * seconds["record"] / steps,
    )


def why(done: Run, first: tuple[float, Any, Expectation]) -> str:
    """Which cylinder missed first, when, by how much, and what the recorded motion says of the reason."""
    at, _, asked = first
    if done.failed:
        return str(done.failed)
    row = int(np.abs(done.time - at).argmin())
    targets = dict(dict(asked.parameters)["targets"])
    away = {
        name: float(np.linalg.norm(done.arrays["pose"][row, done.index[name], :3] - np.array(place)))
        for name, place in targets.items()
    }
    name = max(away, key=lambda key: away[key])
    said = f"{name} {1e3 * away[name]:.0f} mm off at {at:.0f} s: "
    error = max((value for value in done.provenance["control"]["error"] if value is not None), default=0.0)
    if error > TRACKING:
        return said + f"controller: a joint is {error:.2g} rad off its trajectory"
    earlier = [dict(one.parameters)["at"] for one in done.world.expectations if dict(one.parameters)["at"] < at]
    begin = int(np.abs(done.time - max(earlier, default=0.0)).argmin())
    height = done.arrays["pose"][begin : row + 1, done.index[name], 2]
    if len(targets) > 1:
        return said + "fell or was moved after it had been placed"
    if height.max() - height[0] < LIFTED:
        return said + "slip: not lifted"
    peak = int(height.argmax())
    if height[peak] - height[peak:].min() > LOST + max(0.0, height[peak] - targets[name][2]):
        return said + "slip: lost on the way"
    deepest = _overlap(done, name, begin, row)
    if deepest > DEEP:
        return said + f"penetration of {1e3 * deepest:.1f} mm"
    return said + "put down beside its place, or fell from it"


def _overlap(done: Run, name: str, begin: int, row: int) -> float:
    """The deepest recorded overlap (m) of a body's contacts in some rows."""
    if "contact.distance" not in done.arrays:
        return 0.0
    rows, bodies = done.arrays["contact.row"], done.arrays["contact.body"]
    mine = (rows >= begin) & (rows <= row) & (bodies == done.index[name]).any(axis=1)
    return float(-done.arrays["contact.distance"][mine].min(initial=0.0))


def as_data(found: Result) -> dict[str, Any]:
    """A result as JSON holds it: no number that is not finite, and no more digits than mean something."""
    data = dataclasses.asdict(found)
    return {
        name: (None if not math.isfinite(value) else float(f"{value:.4g}")) if isinstance(value, float) else value
        for name, value in data.items()
    }


def sweep(chosen: Sequence[str], timesteps: Sequence[float], seeds: Sequence[int], jobs: int, again: bool) -> None:
    """Run what is not known yet, ``jobs`` at once; every result is kept as soon as it is there."""
    known = load()
    wanted = [
        (engine, step, seed)
        for step in sorted(timesteps, reverse=True)
        for engine in chosen
        for seed in seeds
        if again or key(engine, step, seed) not in known
    ]
    with concurrent.futures.ProcessPoolExecutor(jobs) as pool:
        running = {pool.submit(one, *job): job for job in wanted}
        for done in concurrent.futures.as_completed(running):
            engine, step, seed = running[done]
            found = done.result()
            known[key(engine, step, seed)] = as_data(found)
            keep(known)
            say(f"{engine} {step:g} ms seed {seed}", found)


def say(what: str, found: Result) -> None:
    """One line on a result."""
    verdict = found.failure or "valid"
    speed = f"RTF {found.real_time_factor:.1f}, {found.step_us:.0f} + {found.control_us:.0f} µs a step"
    print(f"{what}: {1e3 * found.worst:.2f} mm, {speed}: {verdict}", flush=True)


def speed(chosen: Sequence[str], rounds: int) -> None:
    """Real-time factors at 1 ms; engines take turns."""
    known = load()
    paces = measure(simspec.load(SPEC).resolve(), chosen, rounds)
    for engine, found in paces.items():
        parts = {"quiet": found.quiet, "median": found.median}
        rounded = {of: {name: float(f"{value:.4g}") for name, value in row.items()} for of, row in parts.items()}
        known[key(engine, 1.0, 0, "speed")] = rounded
        keep(known)
    print(table(paces), flush=True)


def sleeping(chosen: Sequence[str]) -> None:
    """The scenario with sleeping, at some timesteps."""
    known = load()
    for engine in chosen:
        for milliseconds in ASLEEP:
            found = one(engine, milliseconds, 0, _asleep)
            known[key(engine, milliseconds, 0, "asleep")] = as_data(found)
            keep(known)
            say(f"{engine} {milliseconds:g} ms, sleeping", found)


def control(chosen: Sequence[str]) -> None:
    """The negative control: slippery fingers, at 2 ms."""
    known = load()
    for engine in chosen:
        found = one(engine, 2.0, 0, _slippery)
        known[key(engine, 2.0, 0, "slippery")] = as_data(found)
        keep(known)
        say(f"{engine} with fingers of μ = {SLIPPERY}", found)


def main(arguments: Sequence[str] | None = None) -> int:
    """See the module's docstring."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=list(engines()), default=list(engines()), help="engines")
    parser.add_argument("--timesteps", nargs="+", type=float, default=list(TIMESTEPS), help="ms")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(SEEDS))
    parser.add_argument("--jobs", type=int, default=2, help="runs at once")
    parser.add_argument("--again", action="store_true", help="also what is known already")
    parser.add_argument("--speed", action="store_true", help="real-time factors at 1 ms, one run at a time")
    parser.add_argument("--rounds", type=int, default=3, help="of --speed")
    parser.add_argument("--sleeping", action="store_true", help="with bodies that rest asleep")
    parser.add_argument("--control", action="store_true", help="the negative control, with slippery fingers")
    parser.add_argument("--page", action="store_true", help="the page alone")
    parser.add_argument("--check", action="store_true", help="whether the page is what the results make of it")
    given = parser.parse_args(arguments)
    if given.check:
        text = PAGE.read_text(encoding="utf-8")
        stale = page(load(), text) != text
        print(f"{PAGE.relative_to(ROOT)} is {'stale: python tools/stacking.py --page' if stale else 'current'}")
        return int(stale)
    if given.speed:
        speed(given.only, given.rounds)
    if given.sleeping:
        sleeping(given.only)
    if given.control:
        control(given.only)
    if not (given.page or given.speed or given.sleeping or given.control):
        sweep(given.only, given.timesteps, given.seeds, given.jobs, given.again)
    PAGE.write_text(page(load(), PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    picture(load())
    return 0


if __name__ == "__main__":
    sys.exit(main())
