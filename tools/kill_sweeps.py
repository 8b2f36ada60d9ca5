"""Kill a sweep at random moments, again and again, until it is done: the store equals that of an undisturbed sweep to the bit.

    python tools/kill_sweeps.py [--count 20] [--seed 1] [--engine NAME]... [--jobs 2] [--verify]

The sweep is done once undisturbed. Then it is started in a new store and ended by SIGKILL at a moment drawn between its
start and a part of its usual time, until it was killed ``count`` times (where it got to its end before that, it begins anew
in another store). At last it is let come to its end. Every run must be there, with the same result and the same tables to
the bit, times aside; nothing else may be in the store; the last call must have done what was missing and nothing else; and
no process may be left. Prints what it found; exit code 1 when anything differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import kills

SPEC = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 0.3 s}
bodies:
  ball: {mass: 1, inertia: {principal: [0.01, 0.01, 0.01]}, pose: {xyz: [0, 0, 1]}}
record: {every: 10 ms}
sweep:
  over: {bodies.ball.mass: {from: 1, to: 3, count: 8}}
  perturb: {amount: 1e-9, seeds: 2}
"""
DEADLINE = 600.0
GRACE = 15.0
"""s that processes have to notice that their parent is gone."""


class Sweeps:
    """Sweeps of one spec in a folder of their own."""

    def __init__(self, root: Path, engines: list[str], more: list[str]):
        self.root = root
        self.token = f"{root.name}-{os.getpid()}"
        (root / "fall.yaml").write_text(SPEC)
        (root / "temporary").mkdir()
        self.words = [word for name in engines for word in ("--engine", name)] + more

    def start(self, store: Path) -> subprocess.Popen[bytes]:
        """A sweep on its way."""
        environment = {**os.environ, "TMPDIR": str(self.root / "temporary"), kills.TOKEN: self.token}
        environment["XDG_CACHE_HOME"] = str(self.root / "cache")
        line = [sys.executable, "-m", "simspec", "sweep", "fall.yaml", "--store", str(store), "--json", *self.words]
        return subprocess.Popen(
            line,
            cwd=self.root,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    def finish(self, store: Path) -> dict[str, object]:
        """Run a sweep to its end; its JSON output. Raises AssertionError if it fails."""
        out, errors = self.start(store).communicate(timeout=DEADLINE)
        assert out, errors.decode(errors="replace")[-2000:]
        content: dict[str, object] = json.loads(out)
        assert content.get("exit_code") == 0, out.decode(errors="replace")[-2000:]
        return content

    def left_running(self) -> list[int]:
        """Processes of killed sweeps that are still there after they have had time to notice."""
        ends = time.monotonic() + GRACE
        while (running := kills.processes_with(self.token)) and time.monotonic() < ends:
            time.sleep(0.1)
        return running


def contents(store: Path) -> dict[str, object]:
    """Content that must be equal in two stores: of every run its result, its request, and the bytes of its tables (of those of
    circumstances, their existence); the bytes of worlds."""
    found: dict[str, object] = {}
    timed: set[Path] = set()
    for path in sorted(store.rglob("*"), key=lambda path: (path.name != "run.json", path)):
        name = path.relative_to(store).as_posix()
        if path.is_dir() or name in ("lock", "index.parquet", "cells.parquet"):
            continue
        if path.name == "run.json":
            facts = json.loads(path.read_text())
            found[name] = {part: facts[part] for part in ("key", "result", "asked", "result_sha256")}
            for table in facts.get("circumstance_tables", ()):
                timed.add(path.with_name(f"{table}.parquet"))
        elif name.startswith("certificates/"):
            found[name] = timeless(json.loads(path.read_text()))
        elif path in timed:
            found[name] = "there"
        else:
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def timeless(certificate: dict[str, object]) -> object:
    """A certificate without its times, and the hash over them."""
    if isinstance(certificate, dict):
        return {name: timeless(value) for name, value in certificate.items() if name not in ("seconds", "sha256")}
    return certificate


def kill_often(sweeps: Sweeps, count: int, dice: random.Random) -> list[str]:
    """Kill a sweep ``count`` times, then finish it; the differences from an undisturbed sweep."""
    began = time.monotonic()
    whole = sweeps.finish(sweeps.root / "whole")
    usual = time.monotonic() - began
    store = sweeps.root / "killed"
    found, kills, before = [], 0, 0
    while kills < count:
        process = sweeps.start(store)
        try:
            process.communicate(timeout=dice.uniform(0.0, usual * 0.6))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.communicate(timeout=DEADLINE)
            kills += 1
        else:
            # at its end before it was killed: it begins anew, and what it came to is looked at now
            found += compare(sweeps.root / "whole", store)
            store = sweeps.root / f"killed-{kills}"
            before = 0
        found += [f"kill {kills}: left running: {entry}" for entry in sweeps.left_running()]
        there = len(list(store.glob("runs/*/*/run.json")))
        if there < before:
            found.append(f"kill {kills}: {before - there} runs were lost")
        before = there
    finish = sweeps.finish(store)
    if finish["ran"] != (expected := len(list(store.glob("runs/*/*/run.json"))) - before):
        found.append(f"the last call did {finish['ran']} runs, where {expected} were missing")
    again = sweeps.finish(store)
    if again["ran"] != 0 or again["done_before"] != whole["ran"]:
        found.append(f"a call when all is done did {again['ran']} runs")
    found += compare(sweeps.root / "whole", store)
    if left := [str(path) for path in (sweeps.root / "temporary").iterdir()]:
        found.append(f"temporary files are left: {', '.join(left)}")
    print(
        f"{kills} kills within {0.6 * usual:.1f} s each, {before} runs there after the last, {len(found)} complaints",
        flush=True,
    )
    return found


def compare(whole: Path, other: Path) -> list[str]:
    """How two stores differ, a line each."""
    first, second = contents(whole), contents(other)
    return [
        f"{name}: {'differs' if name in first and name in second else 'in one store only'}"
        for name in sorted(first.keys() | second.keys())
        if first.get(name) != second.get(name)
    ]


def main() -> int:
    """Run all; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--engine", action="append", default=[])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--verify", action="store_true")
    given = parser.parse_args()
    more = ["--jobs", str(given.jobs), *([] if given.verify else ["--no-verify"])]
    with tempfile.TemporaryDirectory(prefix="kills-") as root:
        sweeps = Sweeps(Path(root).resolve(), given.engine or ["mujoco"], more)
        found = kill_often(sweeps, given.count, random.Random(given.seed))
    for line in found:
        print(line)
    if not found:
        print("nothing lost, nothing repeated, nothing left, equal to the bit")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
