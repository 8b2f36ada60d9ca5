"""Kill compile, verify and run at random moments: no file lost, nothing stray, no process left, and the next call succeeds.

    python tools/kills.py [--count 20] [--seed 1] [--engine NAME]...

Each command is started ``count`` times in a folder with files of a user's own, and ended by SIGKILL, SIGTERM or SIGINT at a
moment drawn between its start and its usual end. After each kill the user's files must be as they were and every folder of
simspec's whole; after the next, undisturbed call nothing may be left in the folder, among temporary files, or running. Prints
one line a command; exit code 1 when anything was lost, stray or left.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from simspec.compiler import WORLD_FILE
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.errors import SpecError
from simspec.outputs.targets import read_marker
from simspec.runner.store import load_run

SPEC = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 0.2 s}
bodies:
  ball: {mass: 1, inertia: {principal: [0.01, 0.01, 0.01]}, pose: {xyz: [0, 0, 1]}}
record: {every: 10 ms}
"""
MINE = (
    "notes.txt",
    "generated/fall/notes.txt",
    "generated/fall/mine/deep.txt",
    "runs/fall/notes.txt",
    "runs/notes.txt",
)
"""Files of the user: inside simspec's folders, and next to them."""
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
TOKEN = "SIMSPEC_KILLS"
"""An environment variable by which every process that a command starts is known."""
DEADLINE = 300.0
GRACE = 10.0
"""s that processes have to notice that their parent is gone."""


def commands(engines: list[str]) -> dict[str, list[str]]:
    """The command lines, by name."""
    chosen = [word for name in engines for word in ("--engine", name)]
    return {
        "compile": ["compile", "fall.yaml", *chosen],
        "verify": ["verify", "fall.yaml", *chosen],
        "run": ["run", "fall.yaml", *chosen],
    }


def processes_with(token: str) -> list[int]:
    """Processes with this value of TOKEN in their environment (where the system lists them)."""
    processes = []
    for entry in Path("/proc").glob("[0-9]*/environ"):
        try:
            if f"{TOKEN}={token}".encode() in entry.read_bytes().split(b"\0"):
                processes.append(int(entry.parent.name))
        except OSError:
            continue  # ended meanwhile, or another user's
    return processes


class Sandbox:
    """A folder to work in, with temporary files and processes of its own."""

    def __init__(self, root: Path):
        self.place, self.temporary = root / "work", root / "temporary"
        self.token = f"{root.name}-{os.getpid()}"
        self.temporary.mkdir()
        self.place.mkdir()
        (self.place / "fall.yaml").write_text(SPEC)

    def start(self, words: list[str], mass: int) -> subprocess.Popen[bytes]:
        """A running command; ``mass``: of the body, to vary the world."""
        environment = {
            **os.environ,
            TOKEN: self.token,
            "TMPDIR": str(self.temporary),
            "XDG_CACHE_HOME": str(self.place.parent / "c"),
        }
        line = [sys.executable, "-m", "simspec", *words, "--set", f"bodies.ball.mass={mass}"]
        return subprocess.Popen(
            line,
            cwd=self.place,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )

    def place_files(self) -> None:
        """Put the user's files where they belong."""
        for name in MINE:
            path = self.place / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(name)

    def lost(self) -> list[str]:
        """The user's files that are not as they were."""
        spec = self.place / "fall.yaml"
        found = [] if spec.is_file() and spec.read_text() == SPEC else ["fall.yaml"]
        return found + [name for name in MINE if not self._same(name)]

    def _same(self, name: str) -> bool:
        path = self.place / name
        return path.is_file() and path.read_text() == name

    def broken(self) -> list[str]:
        """Folders of simspec's that are not whole."""
        found = []
        for marker in self.place.rglob("simspec-folder.json"):
            folder = marker.parent
            if any(part.startswith(".simspec-") for part in folder.relative_to(self.place).parts):
                continue  # a stage: the next call's to clean
            try:
                found += self._gaps(folder)
            except (SpecError, ValueError, OSError) as error:
                found.append(f"{folder}: {error}")
        return found

    def _gaps(self, folder: Path) -> list[str]:
        marked = read_marker(folder)
        if marked is None or marked.kind == "study":  # its files are added one by one
            return []
        gaps = [f"{folder}: {name} is missing" for name in marked.files if not (folder / name).is_file()]
        if marked.kind == "run":
            load_run(folder)
        else:
            world = hashlib.sha256((folder / WORLD_FILE).read_text().strip().encode()).hexdigest()
            for sidecar in folder.glob("*/sidecar.json"):
                if read_sidecar(sidecar.parent)["world"] != world:
                    gaps.append(f"{sidecar}: of another world than {WORLD_FILE}")
        return gaps

    def stray(self) -> list[str]:
        """Files that no finished command leaves."""
        found = [*self.place.rglob(".simspec*"), *self.temporary.iterdir()]
        # the report of a bug contains the traceback: the sandbox is deleted afterwards
        return [f"{path}: {path.read_text()[-2000:]}" if path.suffix == ".txt" else str(path) for path in found]

    def running(self) -> list[int]:
        """Processes that a command started and that are still there."""
        return processes_with(self.token)

    def left_running(self) -> list[int]:
        """The same, after they have had time to notice."""
        ends = time.monotonic() + GRACE
        while self.running() and time.monotonic() < ends:
            time.sleep(0.1)
        return self.running()


def kill_often(name: str, words: list[str], count: int, dice: random.Random) -> list[str]:
    """Kill a command ``count`` times; complaints about lost, stray or left files and failures."""
    found: list[str] = []
    with tempfile.TemporaryDirectory(prefix="kills-") as root:
        box = Sandbox(Path(root).resolve())
        before = time.monotonic()
        assert box.start(words, 1).wait(DEADLINE) == 0, f"{name} does not work undisturbed"
        usual = time.monotonic() - before
        interrupted = 0
        for turn in range(count):
            box.place_files()
            process, how = box.start(words, 2 + turn), SIGNALS[turn % len(SIGNALS)]
            try:
                process.wait(dice.uniform(0.0, 1.1 * usual))
            except subprocess.TimeoutExpired:
                process.send_signal(how)
                interrupted += 1
            process.communicate(timeout=DEADLINE)
            where = f"{name}, kill {turn + 1} ({how.name})"
            found += [f"{where}: left running: {entry}" for entry in box.left_running()]
            found += [f"{where}: lost: {entry}" for entry in box.lost()]
            found += [f"{where}: not whole: {problem}" for problem in box.broken()]
            again = box.start(words, 2 + turn)
            said = again.communicate(timeout=DEADLINE)[1]
            if again.returncode != 0:
                found.append(
                    f"{where}: the next call ended with {again.returncode}: {said.decode(errors='replace')[-500:]}"
                )
            found += [f"{where}: stray: {entry}" for entry in box.stray()]
            found += [f"{where}: lost by the next call: {problem}" for problem in box.lost()]
            found += [f"{where}: not whole after the next call: {entry}" for entry in box.broken()]
        print(
            f"{name}: {count} times, {interrupted} of them killed before their end, {len(found)} complaints", flush=True
        )
    return found


def main() -> int:
    """Run all; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--engine", action="append", default=[])
    given = parser.parse_args()
    dice = random.Random(given.seed)
    found = []
    for name, words in commands(given.engine or ["mujoco"]).items():
        found += kill_often(name, words, given.count, dice)
    if not found:
        print("nothing lost, nothing stray, nothing left")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
