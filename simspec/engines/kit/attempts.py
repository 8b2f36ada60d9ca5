"""Operations that may end the engine: in a process of its own, forked from the worker when the engine is imported.

Those that follow one another on the same artifacts share one, as operations share the worker; in an engine that compiles what
it computes (``Engine.COMPILING``), others too. An exception is then the operation's answer, as ``{"refused": message}``, and so
is a crash, or more than ``cpu_seconds`` of CPU time, which end that process alone; the next operations have another one. An
operation that ends a process after other artifacts is tried once more in a separate process. Forking takes some milliseconds; a
new worker takes a second.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

Entry = tuple[dict[str, Any], list[Any]]
"""What result.json says of an operation, and its arrays."""
Work = Callable[[int], Entry]
"""Does the operation of that place in a list."""


def attempt(
    begin: Callable[[], Work], operations: Sequence[dict[str, Any]], folder: Path, most: int
) -> Iterator[Entry]:
    """The results of the work for each of ``operations``, or its refusal, of at most ``most`` characters. ``begin`` is called
    in each process anew. Its files are in ``folder``."""
    at = 0
    while at < len(operations):
        for place in range(at, len(operations)):
            _text(folder, place).unlink(missing_ok=True)
        started, first = time.perf_counter(), at
        child = os.fork()
        if child == 0:
            code = 1
            try:
                _work_off(begin, operations, range(at, len(operations)), folder, most)
                code = 0
            finally:
                os._exit(code)
        _, status = os.waitpid(child, 0)
        while at < len(operations) and _text(folder, at).exists():
            entry: dict[str, Any] = json.loads(_text(folder, at).read_text(encoding="utf-8"))
            refusal = entry.get("refused")
            spent = time.perf_counter() - started
            yield (
                (entry, _arrays(entry, _numbers(folder, at)))
                if refusal is None
                else _refusal(operations[at], refusal, spent)
            )
            at += 1
        if status and operations[at].get("artifacts") == operations[first].get("artifacts"):
            yield _refusal(operations[at], f"the engine's process {_ending(status)}", time.perf_counter() - started)
            at += 1


def _refusal(operation: dict[str, Any], why: str, spent: float) -> Entry:
    about = {"op": operation["op"], "load_seconds": 0.0, "seconds": spent, "log": [], "arrays": {}}
    return {**about, "result": {"refused": why}}, []


def _text(folder: Path, place: int) -> Path:
    return folder / f"attempt.{place}.json"


def _numbers(folder: Path, place: int) -> Path:
    return folder / f"attempt.{place}.bin"


def _work_off(
    begin: Callable[[], Work], operations: Sequence[dict[str, Any]], places: range, folder: Path, most: int
) -> None:
    """Write what the work gives for the operations at these places, up to the first that is refused."""
    work = begin()
    for place in places:
        # CPU time, and a signal without a handler: no other signal reaches an engine in an endless loop
        signal.setitimer(signal.ITIMER_PROF, operations[place].get("cpu_seconds", 0.0))
        try:
            entry, local = work(place)
        except Exception as error:  # a refusal is this operation's answer
            entry, local = {"refused": f"{type(error).__name__}: {error}"[:most]}, []
        with open(_numbers(folder, place), "wb") as file:
            for value in local:
                value.tofile(file)
        # the text last, and whole: it says that the operation is done
        path = folder / "attempt.part"
        path.write_text(json.dumps(entry), encoding="utf-8")
        path.replace(_text(folder, place))
        if "refused" in entry:
            return


def _arrays(entry: dict[str, Any], numbers: Path) -> list[Any]:
    """The arrays of an entry that are ``stored``, in its order."""
    found = []
    with open(numbers, "rb") as file:
        for array in entry["arrays"].values():
            if array["stored"]:
                count = int(np.prod(array["shape"], dtype=np.int64))
                found.append(np.fromfile(file, dtype=f"<{array['kind']}", count=count))
    return found


def _ending(status: int) -> str:
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        return f"was ended by signal {number} ({signal.Signals(number).name})"
    return f"ended with code {os.waitstatus_to_exitcode(status)}"
