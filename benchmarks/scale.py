"""What a million runs on a thousand workers take, from what each part is measured to take here.

Measured, in processor time but where it says otherwise: a cell of a plan; a world (resolved, compiled for an engine); a task
in a parcel; a batch on its way through a real scheduler and back (client and scheduler); the scheduler's memory for a batch
that waits; a result that is unpacked and stored. The plan is simulated: many sets of values in one engine, each from MEMBERS
initial states. Everything else is multiplication.

    python benchmarks/scale.py [--engine mujoco] [--runs 1000000] [--workers 1000] [--seconds 1] [SPEC...]
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import psutil
from distributed import Client

from simspec.experiments.cases import case_of
from simspec.experiments.certify import LocalSupplies
from simspec.experiments.dask import BATCH_BYTES, BATCH_SECONDS, LARGEST_BATCH, WINDOW
from simspec.experiments.executors import Task
from simspec.experiments.index import RunRow, row_of
from simspec.experiments.plan import Plan, plan_sweep
from simspec.experiments.remote import batch_parcel, do_batch, results_of, wanted_versions
from simspec.experiments.store import Store
from simspec.experiments.sweep import cell_data, stored_key
from simspec.experiments.timing import versions_of
from simspec.files import find_spec
from simspec.language.load import Spec, load
from simspec.world.canonical import sha256

MEMBERS = 50
"""Initial states of each world in the simulated plan."""
SAMPLE = 6
"""Worlds that are resolved and compiled, and runs that are made, for the figures of one."""
BATCHES = 500
"""Batches that are sent for the figures of one."""


def echo(parcel: bytes) -> bytes:
    """In place of the runs: as many bytes as they come to, for the way alone."""
    return bytes(int.from_bytes(parcel[:8], "big"))


def processor(work: Callable[[], Any]) -> tuple[Any, float]:
    """What ``work`` gives, and the processor time (s) of this process."""
    started = time.process_time()
    value = work()
    return value, time.process_time() - started


def plan_of(name: str, engine: str, runs: int, seconds: float) -> Plan:
    """A plan of so many runs of a spec for so many simulated seconds: worlds that differ in gravity, each from several
    initial states."""
    data = dict(load(find_spec(name)).source.document.data)
    data["physics"] = {**data["physics"], "duration": seconds}
    data["expect"] = []
    worlds = max(2, runs // MEMBERS)
    over = {"physics.gravity.2": {"from": -9.9, "to": -9.7, "count": worlds}}
    sweep = {"over": over, "perturb": {"amount": 1e-9, "seeds": MEMBERS - 1}}
    return plan_sweep(Spec.from_data({**data, "sweep": sweep}), engines=[engine], versions=versions_of([engine], {}))


def measure_runs(plan: Plan, engine: str, folder: Path) -> dict[str, float]:
    """Figures of a world and of a run."""
    supplies, store = LocalSupplies(), Store.open(folder, create=True)
    ahead, *firsts = itertools.islice(plan, 0, MEMBERS * (SAMPLE + 1), MEMBERS)
    supplies.prepare(case_of(plan, ahead))  # imports
    figures: dict[str, float] = {}
    cases, spent = processor(lambda: [case_of(plan, cell) for cell in firsts])
    figures["world"] = spent / len(firsts)
    prepared, spent = processor(lambda: [supplies.prepare(case) for case in cases])
    figures["compile"] = spent / len(firsts)
    cells = list(itertools.islice(plan, MEMBERS, MEMBERS + SAMPLE))
    tasks = [
        supplies.hold(
            Task(
                stored_key(case_of(plan, cell), cell, plan.versions[engine]),
                engine,
                sha256(cases[0].resolved),
                prepared[0].compiled.sha256,
                cell.perturb,
                cell.seed,
                cell.repeat,
                600.0,
                cell_data(plan, cell),
                {},
            )
        )
        for cell in cells
    ]
    wanted = wanted_versions(plan.versions)[engine]
    parcel, spent = processor(lambda: batch_parcel(tasks, supplies, wanted))
    figures["parcel"], figures["parcel_bytes"] = spent / len(tasks), len(parcel)
    do_batch(batch_parcel(tasks[:1], supplies, wanted))  # the process that runs are forked from is there after it
    reply, own = processor(lambda: do_batch(parcel))
    figures["result_bytes"] = len(reply) / len(tasks)
    (results, _), spent = processor(lambda: results_of(reply, tasks, supplies))
    world = cases[0].resolved
    started = time.perf_counter()
    _, stored = processor(lambda: [store.publish(result, world) for result in results])
    figures["store_wall"] = (time.perf_counter() - started) / len(tasks)
    rows, told = processor(lambda: [row_of(store, task.key, store.facts(task.key), 1e-3) for task in tasks])
    figures["store"] = (spent + stored + told) / len(tasks)
    figures["row_bytes"] = _bytes_of(rows[0])
    engines = sum(one.circumstances["usage"][name] for one in results for name in ("cpu_user", "cpu_system"))
    figures["run"] = (own + engines) / len(tasks)
    figures["stored_bytes"] = sum(store.size(task.key) for task in tasks) / len(tasks)
    supplies.close()
    return figures


def _bytes_of(row: RunRow) -> float:
    """Memory that a row of the index takes."""
    text = json.dumps(asdict(row))
    tracemalloc.start()
    rows = [RunRow(**json.loads(text)) for _ in range(1000)]
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return taken / len(rows)


def measure_way(parcel: int, result: int) -> dict[str, float]:
    """Figures of a batch of so many bytes there and back, on a scheduler and a worker of this machine."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "scheduler.json")
        common = ["--no-dashboard"]
        start = [sys.executable, "-m"]
        words = ["--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file), *common]
        scheduler = subprocess.Popen([*start, "distributed.cli.dask_scheduler", *words], stderr=subprocess.DEVNULL)
        while not file.exists():
            time.sleep(0.1)
        words = ["--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--resources", "here=1", *common]
        worker = subprocess.Popen(
            [*start, "distributed.cli.dask_worker", *words],
            stderr=subprocess.DEVNULL,
            cwd=folder,
        )
        try:
            with Client(scheduler_file=str(file), timeout=60) as client:
                client.wait_for_workers(1)
                return _way(client, psutil.Process(scheduler.pid), result.to_bytes(8, "big") + os.urandom(parcel - 8))
        finally:
            for process in (worker, scheduler):
                process.kill()
                process.wait()


def _way(client: Client, scheduler: psutil.Process, parcel: bytes) -> dict[str, float]:
    figures = {}
    used, busy, own = scheduler.memory_info().rss, sum(scheduler.cpu_times()[:2]), time.process_time()
    waiting = [
        client.submit(echo, parcel + bytes([n % 256]) * 8, key=f"w-{n}", resources={"nobody": 1})
        for n in range(BATCHES)
    ]
    time.sleep(3.0)  # messages are on their way
    figures["waiting_bytes"] = (scheduler.memory_info().rss - used) / BATCHES
    client.cancel(waiting)
    busy, own = sum(scheduler.cpu_times()[:2]), time.process_time()
    for first in range(0, BATCHES, 100):
        futures = [client.submit(echo, parcel, key=f"h-{first + n}", resources={"here": 1}) for n in range(100)]
        for future in futures:
            future.result()
    figures["client"] = (time.process_time() - own) / BATCHES
    figures["scheduler"] = (sum(scheduler.cpu_times()[:2]) - busy) / BATCHES
    return figures


def batch_of(figures: dict[str, float]) -> int:
    """How many runs the executor puts into a batch."""
    most = min(BATCH_SECONDS / figures["run"], BATCH_BYTES / figures["result_bytes"], LARGEST_BATCH)
    return max(1, int(most))


def table(name: str, engine: str, plan: Plan, cell: float, figures: dict[str, float], workers: int) -> list[str]:
    """Lines of a table in Markdown."""
    runs, worlds = len(plan), plan.worlds
    batch = batch_of(figures)
    batches = runs / batch
    client = {
        "plan, gone through three times": 3 * cell * runs,
        "worlds: values put in, validated, resolved": figures["world"] * worlds,
        "worlds: compiled": figures["compile"] * worlds,
        "parcels": figures["parcel"] * runs,
        "batches sent, results fetched": figures["client"] * batches,
        "results unpacked and stored": figures["store"] * runs,
    }
    total = sum(client.values())
    work = figures["run"] * runs / workers
    window = WINDOW * workers
    rows = [
        ("a run on a worker, s of processor time", f"{figures['run']:.3f}"),
        ("runs in a batch; batches", f"{batch}; {batches:,.0f}"),
        *((f"client: {what}, h", f"{seconds / 3600:.3f}") for what, seconds in client.items()),
        ("**client, h of one core**", f"**{total / 3600:.1f}**"),
        (f"**{workers:,} workers, h of each**", f"**{work / 3600:.2f}**"),
        ("runs per second: client; workers", f"{runs / total:,.0f}; {workers / figures['run']:,.0f}"),
        ("workers that the client keeps busy", f"{runs / total * figures['run']:,.0f}"),
        ("storing one result, ms of wall time, most of it the disk's", f"{1e3 * figures['store_wall']:.1f}"),
        ("client: memory for the index, GB", f"{figures['row_bytes'] * runs / 1e9:.1f}"),
        ("scheduler: processor, h", f"{figures['scheduler'] * batches / 3600:.2f}"),
        (f"scheduler: memory for {window:,} batches, GB", f"{figures['waiting_bytes'] * window / 1e9:.2f}"),
        ("scheduler: memory if all were sent one by one at once, GB", f"{figures['waiting_bytes'] * runs / 1e9:,.0f}"),
        ("a parcel; a result, kB", f"{figures['parcel_bytes'] / 1e3:.1f}; {figures['result_bytes'] / 1e3:.1f}"),
        ("results through the scheduler and in the store, GB", f"{figures['stored_bytes'] * runs / 1e9:,.0f}"),
    ]
    head = f"{name} in {engine}, {runs:,} runs of {worlds:,} worlds"
    return [f"| {head} | |", "|---|---|", *(f"| {what} | {value} |" for what, value in rows), ""]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("spec", nargs="*", default=["bouncing-ball", "spheres-216"])
    parser.add_argument("--engine", default="mujoco")
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=1.0, help="simulated time of a run")
    parser.add_argument("--workers", type=int, default=1000)
    words = parser.parse_args()
    for name in words.spec:
        plan = plan_of(name, words.engine, words.runs, words.seconds)
        count, spent = processor(lambda plan=plan: sum(1 for _ in itertools.islice(plan, 100_000)))
        with tempfile.TemporaryDirectory() as folder:
            figures = measure_runs(plan, words.engine, Path(folder, "store"))
        batch = batch_of(figures)
        figures |= measure_way(int(figures["parcel_bytes"]), int(batch * figures["result_bytes"]))
        print("\n".join(table(name, words.engine, plan, spent / count, figures, words.workers)))
        print({key: round(value, 6) for key, value in figures.items()}, file=sys.stderr)


if __name__ == "__main__":
    main()
