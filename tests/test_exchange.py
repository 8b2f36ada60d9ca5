"""An exchange with a process ends at its deadline or limit under any behaviour of the process."""

from __future__ import annotations

import subprocess
import sys

import pytest

from simspec.processes import exchange

MANY = 2**20


@pytest.mark.parametrize(
    ("program", "input_", "answered"),
    [
        ("import sys; sys.stdout.write(sys.stdin.read()[::-1])", b"abc", (b"cba", "")),
        ("pass", b"a" * MANY, (b"", "")),
        ("import sys; sys.stdin.close(); sys.stdout.write('a')", b"a" * MANY, (b"a", "")),
        ("import os, sys; sys.stdin.read(); os.close(1); os._exit(3)", b"", (b"", "")),
    ],
)
def test_a_process_that_ends(program, input_, answered):
    process = begun(program)
    assert exchange(process, input_, 60.0, MANY) == answered
    assert process.returncode is not None


@pytest.mark.parametrize(
    ("program", "why"),
    [
        ("import time\nwhile True: time.sleep(1)", "late"),
        ("import os, time\nos.close(1)\nwhile True: time.sleep(1)", "late"),
        ("import os\nwhile True: os.write(1, bytes(65536))", "large"),
    ],
)
def test_a_process_that_does_not_end_is_killed(program, why):
    process = begun(program)
    output, found = exchange(process, b"a" * MANY, 2.0 if why == "late" else 60.0, MANY)
    assert found == why
    assert len(output) <= 2 * MANY
    assert process.returncode == -9


def begun(program):
    return subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
