"""What a sweep costs beside its engines: 100 runs of 1 s, one at a time and two side by side.

*Bare* is what the engines' own processes took: loading, stepping, recording; *starts* is the time of as many processes that
are asked for nothing, and of importing the engine once. Targets on a quiet machine: one at a time at most 1.15 times bare and
starts, two side by side at least 1.8 times as fast as one at a time. The rounds take turns, and of each the fastest counts;
processor time is that of the sweep's own process, and of all processes of its engines.

    python benchmarks/sweep.py [--engine mujoco] [--runs 100] [--rounds 3] [SPEC ...]
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import simspec
from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.process import Operation, start
from simspec.engines.kit.warm import WarmProcesses
from simspec.experiments.executors import LocalExecutor
from simspec.experiments.plan import plan_sweep
from simspec.experiments.store import Store
from simspec.experiments.sweep import sweep
from simspec.experiments.timing import versions_of
from simspec.files import find_spec

SCENARIOS = ("spheres-216", "bouncing-ball")
"""A second of work, and a hundredth of one: nothing but starts and the sweep's own part."""
BARE, TWO = 1.15, 1.8
"""The targets."""
NOTHING = 20
"""Processes that are asked for nothing, to see what a start takes."""


@dataclass(frozen=True)
class Took:
    """Seconds of a sweep: wall time; processor time of its own process and of its engines' workers; and the wall time of
    loading and running in them."""

    wall: float
    own: float
    workers: float
    bare: float


def plan_of(name: str, engine: str, runs: int):
    data = dict(simspec.load(find_spec(name)).source.document.data)
    data |= {"physics": {**data["physics"], "duration": "1 s"}, "expect": []}
    data["sweep"] = {"perturb": {"amount": 1e-9, "seeds": runs - 1}}
    spec = simspec.Spec.from_data(data)
    return plan_sweep(spec, engines=[engine], versions=versions_of([engine], {}))


def done(plan, jobs: int) -> Took:
    """The whole sweep, into a store that is removed."""
    with tempfile.TemporaryDirectory(prefix="simspec-benchmark-") as folder:
        store = Store.open(Path(folder) / "store", create=True)
        wall, own = time.perf_counter(), time.process_time()
        outcome = sweep(
            plan,
            store,
            lambda supplies: LocalExecutor(supplies, jobs, warm=WarmProcesses()),
            verify=False,
            deadline=600.0,
        )
        wall, own = time.perf_counter() - wall, time.process_time() - own
        told = [store.facts(row.key).circumstances for _, row in outcome.rows() if row is not None]
    if len(told) != len(plan):
        raise SystemExit(f"{len(told)} of {len(plan)} runs were done")
    workers = sum(one["usage"]["cpu_user"] + one["usage"]["cpu_system"] for one in told)
    return Took(wall, own, workers, sum(one["seconds"]["load"] + one["seconds"]["run"] for one in told))


def starts(plan, engine: str) -> tuple[float, float]:
    """s of a forked process that is asked for nothing, and of the first one, which imports the engine."""
    world = plan.spec.resolve()
    with tempfile.TemporaryDirectory(prefix="simspec-benchmark-") as folder, WarmProcesses() as warm:
        artifacts = Path(folder) / "artifacts"
        write_folder(compile_world(world, [engine])[engine].files, artifacts)
        seconds = []
        for _ in range(1 + NOTHING):
            begun = time.perf_counter()
            with start(engine, artifacts, list[Operation](), warm=warm) as running:
                running.wait()
            seconds.append(time.perf_counter() - begun)
    return statistics.median(seconds[1:]), seconds[0]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specs", nargs="*", default=SCENARIOS, metavar="SPEC")
    parser.add_argument("--engine", default="mujoco")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=3)
    words = parser.parse_args()
    reached = True
    for name in words.specs:
        plan = plan_of(name, words.engine, words.runs)
        each, first = starts(plan, words.engine)
        one, two = [], []
        for _ in range(words.rounds):
            one.append(done(plan, 1))
            two.append(done(plan, 2))
        alone, pair = min(one, key=lambda took: took.wall), min(two, key=lambda took: took.wall)
        floor = alone.bare + first + each * (words.runs - 1)
        ratio, gain = alone.wall / floor, alone.wall / pair.wall
        reached = reached and ratio <= BARE and gain >= TWO
        print(f"{name} in {words.engine}, {words.runs} runs of 1 s, fastest of {words.rounds} rounds")
        print(f"  bare {alone.bare:.2f} s, starts {floor - alone.bare:.2f} s ({1e3 * each:.1f} ms each)")
        print(f"  one at a time {alone.wall:.2f} s: {ratio:.3f} of bare and starts (target: at most {BARE})")
        print(f"  two side by side {pair.wall:.2f} s: {gain:.2f} times as fast (target: at least {TWO})")
        for told, takes in (("one at a time", one), ("two side by side", two)):
            own = min(took.own for took in takes) / words.runs
            workers = min(took.workers for took in takes) / words.runs
            print(f"  processor time a run, {told}: sweep {1e3 * own:.1f} ms, workers {1e3 * workers:.1f} ms")
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
