"""Operations that may end the engine: each in a process of its own, forked from the worker when the engine is imported.

An exception is then the operation's answer, as ``{"refused": message}``, and so is a crash, or more than ``cpu_seconds`` of CPU
time, which end that process alone; the next operation follows. Forking takes some milliseconds; a new worker takes a second.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Entry = tuple[dict[str, Any], list[Any]]
"""What result.json says of an operation, and its arrays."""


def attempt(work: Callable[[], Entry], operation: dict[str, Any], folder: Path, most: int) -> Entry:
    """What ``work`` gives, or its refusal, of at most ``most`` characters. Its files are in ``folder``."""
    text, numbers = folder / "attempt.json", folder / "attempt.bin"
    text.unlink(missing_ok=True)
    started = time.perf_counter()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            # CPU time, and a signal that nobody handles: an engine that is lost in a loop of its own hears of nothing else
            signal.setitimer(signal.ITIMER_PROF, operation.get("cpu_seconds", 0.0))
            _write(work, text, numbers, most)
            code = 0
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    if status == 0 and text.exists():
        entry: dict[str, Any] = json.loads(text.read_text(encoding="utf-8"))
        if "refused" not in entry:
            return entry, _arrays(entry, numbers)
        refusal = entry["refused"]
    else:
        refusal = f"the engine's process {_ending(status)}"
    spent = time.perf_counter() - started
    about = {"op": operation["op"], "load_seconds": 0.0, "seconds": spent, "log": [], "arrays": {}}
    return {**about, "result": {"refused": refusal}}, []


def _write(work: Callable[[], Entry], text: Path, numbers: Path, most: int) -> None:
    try:
        entry, own = work()
    except Exception as error:  # what it refuses is this operation's answer
        entry, own = {"refused": f"{type(error).__name__}: {error}"[:most]}, []
    with open(numbers, "wb") as file:
        for value in own:
            value.tofile(file)
    text.write_text(json.dumps(entry), encoding="utf-8")


def _arrays(entry: dict[str, Any], numbers: Path) -> list[Any]:
    """The arrays of an entry that are ``stored``, in its order."""
    found = []
    with open(numbers, "rb") as file:
        for one in entry["arrays"].values():
            if one["stored"]:
                count = int(np.prod(one["shape"], dtype=np.int64))
                found.append(np.fromfile(file, dtype=f"<{one['kind']}", count=count))
    return found


def _ending(status: int) -> str:
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        return f"was ended by signal {number} ({signal.Signals(number).name})"
    return f"ended with code {os.waitstatus_to_exitcode(status)}"
