"""Bad input is a located error with exit code 2, in bounded time and memory, whatever its size and kind."""

from __future__ import annotations

import os
import resource
import subprocess
import sys

import pytest

HEAD = "simspec: 1\nname: a\nphysics: {gravity: [0, 0, -9.81], timestep: 1 ms, duration: 1 s}\n"
BALL = "bodies:\n  b: {mass: 1 kg, inertia: {principal: [1, 1, 1]}, joint: {type: free}}\n"
CPU, MEMORY = 5, 500_000
"""s and kB that a command may take for input that it refuses."""

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
    "a setting in words": (HEAD + BALL + "engines: {mujoco: {settings: {iterations: many}}}\n", "a whole number"),
}


def limited():
    resource.setrlimit(resource.RLIMIT_CPU, (CPU, CPU))


def simspec(place, *words):
    return subprocess.run(
        [sys.executable, "-m", "simspec", *words],
        cwd=place,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limited,
    )


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_spec_is_refused_in_bounded_work(tmp_path, kind):
    content, message = BAD[kind]
    (tmp_path / "bad.yaml").write_text(content)
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    done = simspec(tmp_path, "check", "bad.yaml")
    assert done.returncode == 2, done.stderr[:2000]
    assert message in done.stderr
    assert "bad.yaml:" in done.stderr
    assert len(done.stderr) < 200_000
    assert max(before, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss) < MEMORY or before >= MEMORY


@pytest.mark.parametrize("command", [("check",), ("fmt",), ("fmt", "--check"), ("compile",)])
@pytest.mark.parametrize("target", ["fifo", "/dev/zero", "folder", "large.yaml"])
def test_what_is_no_spec_is_refused_without_waiting(tmp_path, command, target):
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "folder").mkdir()
    with open(tmp_path / "large.yaml", "wb") as file:
        file.truncate(100_000_000)
    done = simspec(tmp_path, *command, target)
    assert done.returncode == 2, done.stderr
    assert target in done.stderr
