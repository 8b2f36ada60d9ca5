"""Bad input is a located error with exit code 2, in bounded time and memory, whatever its size and kind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

HEAD = "simspec: 1\nname: a\nphysics: {gravity: [0, 0, -9.81], timestep: 1 ms, duration: 1 s}\n"
BALL = "bodies:\n  b: {mass: 1 kg, inertia: {principal: [1, 1, 1]}, joint: {type: free}}\n"
CPU, MEMORY = 20, 500_000
"""s and kB that a command may take for input that it refuses; a second counts double where another job has half of the core.
10 s were not enough on a busy machine of half the speed (measured)."""

BAD = {
    "wrong units": (
        HEAD + BALL + "contact:\n  exclude: [" + "1 furlong, " * 200_000 + "]\n",
        "too many keys and values",
    ),
    "unknown keys": (HEAD + BALL + "".join(f"kye{i}: 1\n" for i in range(100_000)), "too many keys and values"),
    "fewer unknown keys": (HEAD + BALL + "".join(f"kye{i}: 1\n" for i in range(20_000)), "unknown key"),
    "a long key": (HEAD + BALL + "? " + "k" * 1_000_000 + "\n: 1\n", "unknown key"),
    "a long value": (HEAD + BALL.replace("1 kg", "k" * 1_000_000), "found no number"),
    "no step": (HEAD.replace("1 s", "1e-20 s") + BALL, "bad.yaml:3:"),
    "digits of another script": (HEAD + BALL.replace("1 kg", "١٢ kg"), "found no number"),
    "wide digits": (HEAD + BALL.replace("1 kg", "１２"), "found no number"),
    "too much to record": (HEAD.replace("1 s", "1000000 s") + BALL, "216 GiB"),
    "a huge number": (HEAD + BALL + "engines: {mujoco: {settings: {iterations: %s}}}\n" % ("9" * 5000), "bad.yaml:6:"),
    "a large setting": (
        HEAD + BALL + "engines: {mujoco: {settings: {iterations: 99999999999999999999}}}\n",
        "too large",
    ),
    "shapes of an array": (
        HEAD
        + "contact: {materials: {m: {friction: 1}}}\nbodies:\n  b:\n    mass: 1 kg\n"
        + "    array: {grid: [100, 100, 10], spacing: 1}\n    shapes: ["
        + "{sphere: {radius: 1}}, " * 1000
        + "]\n",
        "bad.yaml:6:3: error[S109]: bodies.b: too many shapes in one scenario\n"
        "  found:   100,000 × 1,000\n  allowed: up to 200,000",
    ),
    "shapes of an array of models": (
        HEAD
        + "contact: {materials: {m: {friction: 1}}}\nmodels:\n  m:\n    array: {line: 50000, step: [1, 0, 0]}\n"
        + "    bodies: {b: {mass: 1 kg, shapes: ["
        + "{sphere: {radius: 1}}, " * 5
        + "]}}\n",
        "bad.yaml:6:3: error[S109]: models.m: too many shapes in one scenario",
    ),
    "a long name": (HEAD + BALL.replace("  b:", "  ? " + "b" * 300 + "\n  :"), "too long a name"),
    "a long material": (
        HEAD + BALL + "contact: {materials: {? " + "m" * 300 + " : {friction: 1}}}\n",
        "too long a name",
    ),
    "a long joint name": (HEAD + BALL.replace("free}", "free, name: " + "b" * 300 + "}"), "too long a name"),
    "a name with a bell": (HEAD.replace("name: a", 'name: "a\\a"') + BALL, "not a valid name"),
    "a long path": (HEAD + "models: {m: {use: " + "k" * 5000 + "}}\n", "too long a text"),
    "a long part of a path": (HEAD + "models: {m: {use: " + "k" * 500 + "}}\n", "this path does not exist"),
    "a path with an escape": (HEAD + 'models: {m: {use: "a\\e[31m"}}\n', "paths cannot contain such characters"),
    "a setting in words": (HEAD + BALL + "engines: {mujoco: {settings: {iterations: many}}}\n", "a whole number"),
}


SERVER = """
import json, os, resource, sys
import simspec.__main__, simspec.cli, simspec.commands.compile, simspec.commands.compile, simspec.commands.files
import rich.table, ruamel.yaml, simspec.dynamics.oracle, simspec.language.load, simspec.resolve.scenario
from simspec.engines.kit.registry import engines
from simspec.language.foreign import importers

[*engines().values(), *importers().values()]

def command(words, place, limit, before):
    os.chdir(place)
    for number, name in enumerate((os.devnull, "said.out", "said.err")):
        os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | os.O_TRUNC), number)
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    exec(before, {})
    sys.argv = ["simspec", *words]
    sys.exit(simspec.__main__.main())

def used(*arguments):
    child = os.fork()
    if child == 0:
        command(*arguments)
    _, status, usage = os.wait4(child, 0)
    return os.waitstatus_to_exitcode(status), usage.ru_maxrss

for line in sys.stdin:
    print(json.dumps(used(*json.loads(line))), flush=True)
"""
"""Imports simspec once and forks each command, which has the limits of one by itself: its own time, and the memory of all that
was imported before. Linux counts for a process also what it was before it became another program, and the process of the
tests may be a large one: therefore none of its own is forked."""


@pytest.fixture(scope="module")
def simspec():
    """A command's end (exit code, output, errors), and the memory (kB) that it took: its own, and of nothing else."""
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    )

    def run(
        place: Path, *words: str, python: str = "", limit: int = CPU
    ) -> tuple[subprocess.CompletedProcess[str], int]:
        server.stdin.write(json.dumps([words, str(place), limit, python]) + "\n")
        code, used = json.loads(server.stdout.readline())
        said = [(place / name).read_text() for name in ("said.out", "said.err")]
        return subprocess.CompletedProcess(words, code, *said), used

    with server:
        yield run
        server.stdin.close()


def test_the_measured_memory_is_that_of_the_command(simspec, tmp_path):
    large = b"x" * 200_000_000
    done, used = simspec(tmp_path, "check", "there-is-none.yaml")
    assert done.returncode == 2
    assert 5_000 < used < 160_000 < len(large) / 1024


def test_excessive_time_and_memory_are_measured(simspec, tmp_path):
    """The limits are those of the one command: its time, its memory."""
    done, used = simspec(tmp_path, "check", "there-is-none.yaml", python="x = b'x' * 600_000_000")
    assert used > MEMORY
    done, _ = simspec(tmp_path, "check", "there-is-none.yaml", python="while True: pass", limit=1)
    assert -done.returncode in (signal.SIGXCPU, signal.SIGKILL)


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_spec_is_refused_in_bounded_work(simspec, tmp_path, kind):
    content, message = BAD[kind]
    (tmp_path / "bad.yaml").write_text(content)
    done, used = simspec(tmp_path, "check", "bad.yaml")
    assert done.returncode == 2, done.stderr[:2000]
    assert message in done.stderr
    assert "bad.yaml:" in done.stderr
    assert len(done.stderr) < 200_000
    assert used < MEMORY


@pytest.mark.parametrize("command", [("check",), ("fmt",), ("fmt", "--check"), ("compile",)])
@pytest.mark.parametrize("target", ["fifo", "/dev/zero", "folder", "large.yaml"])
def test_files_that_are_not_specs_are_refused_without_waiting(simspec, tmp_path, command, target):
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "folder").mkdir()
    with open(tmp_path / "large.yaml", "wb") as file:
        file.truncate(100_000_000)
    done, used = simspec(tmp_path, *command, target)
    assert used < MEMORY
    assert done.returncode == 2, done.stderr
    assert target in done.stderr


USED = "simspec: 1\nname: part\n%smodel:\n  bodies:\n    b0: {fixed: true}\n"


def test_models_of_many_bodies_are_counted_before_they_are_looked_at(simspec, tmp_path):
    """2,000 models of a file of 9,000 bodies, and models in an array each with excluded pairs."""
    chain = "".join(f"    b{index}: {{parent: b0, joint: {{type: fixed}}}}\n" for index in range(1, 9000))
    (tmp_path / "part.yaml").write_text(USED % "" + chain)
    models = "".join(f"  m{index}: {{use: part.yaml}}\n" for index in range(2000))
    (tmp_path / "bad.yaml").write_text(HEAD + "models:\n" + models)
    done, used = simspec(tmp_path, "check", "bad.yaml")
    assert done.returncode == 2
    assert (
        "bad.yaml:16:3: error[S109]: models.m11: too many bodies in one scenario\n  found:   9,000, after 99,000"
        in done.stderr
    )
    assert used < MEMORY


def test_copies_of_excluded_pairs_are_counted(simspec, tmp_path):
    names = [f"b{index}" for index in range(100)]
    pairs = "".join(f"[{a}, {b}], " for a in names for b in names if a < b)
    rest = "".join(f"    {name}: {{parent: b0, joint: {{type: fixed}}}}\n" for name in names[1:])
    (tmp_path / "part.yaml").write_text(USED % f"contact: {{exclude: [{pairs}]}}\n" + rest)
    (tmp_path / "bad.yaml").write_text(HEAD + "models:\n  m: {use: part.yaml, array: {line: 1000, step: [1, 0, 0]}}\n")
    done, used = simspec(tmp_path, "check", "bad.yaml")
    assert done.returncode == 2
    assert "too many excluded pairs in one scenario\n  found:   1,000 × 4,950" in done.stderr
    assert used < MEMORY


def test_overrides_and_files_are_shown_in_part(simspec, tmp_path):
    (tmp_path / "good.yaml").write_text(HEAD + BALL)
    for words in (
        ("good.yaml", "--set", "k" * 90_000 + "=1"),
        ("good.yaml", "--set", "name=" + "k" * 90_000),
        ("good.yaml", "--set", 'name="a\\e[31m"'),
        ("k" * 90_000,),
        ("k/" * 45_000,),
        ("good.yaml", "--engine", "k" * 90_000),
    ):
        done, _ = simspec(tmp_path, "check", *words)
        assert done.returncode in (2, 3)
        assert len(done.stderr) < 5_000
        assert "\x1b" not in done.stderr
