"""A program at work on a stranger's file: in a process of its own, of bounded time and memory, told by pipes."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from simspec.ending import end_if_told
from simspec.isolated import search_environment, with_search_path
from simspec.scratch import scratch_folder

ONE_THREAD: Final = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Threads take memory that counts."""
KEPT: Final = ("PATH", "HOME", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "PYTHONPATH", "TMPDIR", "VIRTUAL_ENV")
"""What a child has of the environment: nothing that a file could ask it for."""


class ChildError(ValueError):
    """The child gave no answer; the message says why."""


def run(program: Path, arguments: Sequence[str], told: bytes, seconds: float) -> bytes:
    """What a Python program answers to ``told`` within ``seconds``, in an empty folder. Raises ChildError where it does not end
    by itself, with code 0. The program limits its own CPU time and memory."""
    end_if_told()
    environment = {name: value for name, value in os.environ.items() if name in KEPT}
    environment |= {**ONE_THREAD, "PYTHONNOUSERSITE": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    with scratch_folder("import") as folder:
        process = subprocess.Popen(
            with_search_path(str(program), *arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=folder,
            env=search_environment(environment),
            start_new_session=True,
        )
        try:
            answered, _ = process.communicate(told, timeout=seconds)
        except subprocess.TimeoutExpired:
            raise ChildError(f"no answer within {seconds:g} s") from None
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if process.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        raise ChildError("it takes more time than is allowed")
    if process.returncode:
        raise ChildError(f"the process ended with code {process.returncode}")
    return answered
