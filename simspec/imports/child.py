"""A program at work on a file of unknown origin: in a process of its own, of bounded time and memory, confined by the kernel.

This module is both ends of it: :func:`run` starts ``python child.py POLICY PROGRAM ARGUMENT...``, and :func:`main` is what that
process does: load the program, let it ``prepare()`` (imports and limits), confine the process, and let it do its ``main()``.
"""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from simspec.confinement import ANY_LOCALE, PROFILES, confine_calls, confine_files, of_python
from simspec.files import scratch_folder
from simspec.processes import exchange, exit_if_signalled, search_environment, with_search_path

SINGLE_THREADED: Final = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Threads take memory that counts."""
KEPT: Final = ("PATH", "HOME", "LD_LIBRARY_PATH", "PYTHONPATH", "TMPDIR", "VIRTUAL_ENV")
"""Variables of the environment that a child keeps: none that is of use to a file."""

LARGEST_ANSWER: Final = 2**30
"""Bytes of an answer; those of the largest files that are read have a tenth of it."""


@dataclass(frozen=True)
class Policy:
    """The limits that the kernel sets for a program: a profile of ``confinement.PROFILES``, the folders below which it may open
    files to read them (in addition to Python and its packages), and whether it may write into its own folder, which is
    empty."""

    profile: str
    read: tuple[str, ...] = ()
    writes: bool = False


class ChildError(ValueError):
    """The child gave no answer; the message says why."""


def run(program: Path, arguments: Sequence[str], request: bytes, seconds: float, policy: Policy) -> bytes:
    """The answer of a Python program to ``request`` within ``seconds``, in an empty folder. Raises ChildError where it does not
    end by itself, with code 0. The program limits its own CPU time and memory."""
    exit_if_signalled()
    environment = {name: value for name, value in os.environ.items() if name in KEPT}
    environment |= {**SINGLE_THREADED, **ANY_LOCALE, "PYTHONNOUSERSITE": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    with scratch_folder("import") as folder:
        process = subprocess.Popen(
            with_search_path(__file__, json.dumps(vars(policy)), str(program), *arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=folder,
            env=search_environment(environment),
            start_new_session=True,
        )
        try:
            answered, why = exchange(process, request, seconds, LARGEST_ANSWER)
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if why:
        raise ChildError(f"no answer within {seconds:g} s" if why == "late" else f"more than {LARGEST_ANSWER:,} bytes")
    if process.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        raise ChildError("it takes more time than is allowed")
    if process.returncode:
        raise ChildError(f"the process ended with code {process.returncode}")
    return answered


def main() -> None:
    """Be the process that :func:`run` starts."""
    policy = json.loads(sys.argv[1])
    program = Path(sys.argv[2])
    sys.argv[:] = sys.argv[2:]
    spec = importlib.util.spec_from_file_location("simspec_program", program)
    if spec is None or spec.loader is None:
        raise ImportError(f"no program at {program}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    profile = PROFILES[policy["profile"]]
    opens = "openat" in profile.calls
    if opens:  # before anything starts a thread: threads that are there stay as free as they are
        confine_files((*of_python(), *policy["read"]), (os.getcwd(),) if policy["writes"] else ())
    module.prepare()
    if not opens:
        confine_files()
    confine_calls(profile)
    module.main()


if __name__ == "__main__":
    main()
