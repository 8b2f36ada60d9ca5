"""What a scene of many bodies costs: 10 to 10,000 free balls that fall onto a plane, through every command, in every engine.

Each command is a process of its own with a deadline. Its figures are the processor time (s) and the largest memory (MB, all
processes together) of it and all that it starts, sampled ten times a second; ``–``: not tried, since compiling was refused.
``run`` makes 20 steps of 1 ms, recorded every 5, four times (repeats), without the proof, which ``verify`` makes. The last line
of a command that ends otherwise goes to standard error.

    python benchmarks/bodies.py                               all sizes, all installed engines: an hour on two cores
    python benchmarks/bodies.py --count 4096 --engine NAME    one of them
    python benchmarks/bodies.py --only check compile
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

from simspec.engines.kit.registry import engines

GRIDS = {10: (10, 1, 1), 100: (5, 5, 4), 1000: (10, 10, 10), 4096: (16, 16, 16), 10000: (20, 20, 25)}
COMMANDS = ("check", "compile", "verify", "run", "report")
SPEC = """\
simspec: 1
name: balls-{count}
physics: {{gravity: [0, 0, -9.81], timestep: 1 ms, duration: 20 ms}}
contact:
  friction_cone: elliptic
  materials: {{plain: {{friction: {friction}, restitution: 0}}}}
bodies:
  floor: {{fixed: true, shapes: [{{plane: {{}}, material: plain}}]}}
  ball:
    array: {{grid: [{grid}], spacing: 0.21}}
    pose: {{xyz: [0, 0, 0.1005]}}
    mass: 1 kg
    shapes: [{{sphere: {{radius: 0.1}}, material: plain}}]
record: {{every: 5 ms, channels: [pose, velocity, contacts]}}
"""


@dataclass(frozen=True)
class Cost:
    """Processor time (s), memory (MB), exit code (None: its deadline passed), and the last line that it printed."""

    seconds: float
    megabytes: float
    code: int | None
    last: str


def measured(words: list[str], folder: Path, deadline: float) -> Cost:
    """What ``simspec`` with these words costs."""
    with open(folder / "printed.txt", "w+") as printed:
        process = subprocess.Popen(
            [sys.executable, "-m", "simspec", *words], cwd=folder, stdout=printed, stderr=subprocess.STDOUT
        )
        spent: dict[int, float] = {}
        most, started = 0.0, time.monotonic()
        while process.poll() is None and time.monotonic() - started < deadline:
            most = max(most, sample(process.pid, spent))
            time.sleep(0.1)
        if process.poll() is None:
            for one in [*psutil.Process(process.pid).children(recursive=True), psutil.Process(process.pid)]:
                one.kill()
        done = process.wait()
        printed.seek(0)
        lines = [line.strip() for line in printed.read().splitlines() if line.strip()]
    late = time.monotonic() - started >= deadline
    return Cost(sum(spent.values()), most, None if late else done, lines[-1] if lines else "")


def sample(pid: int, spent: dict[int, float]) -> float:
    """Note the processor time of a process and its descendants; their memory (MB)."""
    total = 0.0
    try:
        family = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
    except psutil.NoSuchProcess:
        return 0.0
    for one in family:
        try:
            times, memory = one.cpu_times(), one.memory_info()
        except (psutil.NoSuchProcess, psutil.ZombieProcess):
            continue
        spent[one.pid] = max(spent.get(one.pid, 0.0), times.user + times.system)
        total += memory.rss / 1e6
    return total


def words_of(command: str, count: int, engine: str) -> list[str]:
    spec = f"balls-{count}.yaml"
    given = ["--engine", engine, "--accept", "all"]
    return {
        "check": ["check", spec],
        "compile": ["compile", spec, *given, "--out", f"out/{engine}"],
        "verify": ["verify", spec, *given, "--out", f"out/{engine}"],
        "run": ["run", spec, *given, "--no-verify", "--out", f"runs/{engine}"],
        "report": ["report", f"runs/{engine}/balls-{count}"],
    }[command]


def row(count: int, engine: str, only: list[str], folder: Path, deadline: float) -> list[str]:
    cells, why = [], ""
    for command in only:
        if why:
            cells.append("–")
            continue
        cost = measured(words_of(command, count, engine), folder, deadline)
        ended = cost.code in (0, 1)  # 1: a check or an expectation did not hold
        cells.append(f"{cost.seconds:.1f}, {cost.megabytes:.0f}" if ended else f"**{cost.code or 'deadline'}**")
        if not ended or cost.code == 1:
            print(f"{count} {engine} {command}: {cost.code}, {cost.last}", file=sys.stderr)
        why = "" if ended or command == "verify" else cost.last or "no word"
    return cells


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, nargs="*", default=list(GRIDS), choices=list(GRIDS))
    parser.add_argument("--engine", nargs="*", default=[name for name, kind in engines().items() if kind.version()])
    parser.add_argument("--only", nargs="*", default=list(COMMANDS), choices=COMMANDS)
    parser.add_argument("--friction", type=float, default=0.5)
    parser.add_argument("--deadline", type=float, default=600.0, help="s of wall time of a command")
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        print(f"| balls | engine | {' | '.join(words.only)} |", f"|---|---|{'---|' * len(words.only)}", sep="\n")
        for count in words.count:
            grid = ", ".join(map(str, GRIDS[count]))
            text = SPEC.format(count=count, grid=grid, friction=words.friction)
            (folder / f"balls-{count}.yaml").write_text(text)
            for engine in words.engine:
                cells = row(count, engine, words.only, folder, words.deadline)
                print(f"| {count:,} | {engine} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
