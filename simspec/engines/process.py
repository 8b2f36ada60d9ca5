"""simspec's side of the folder contract: an engine at work in a process of its own, under a deadline.

A crash, a hang, an unreadable result: each becomes an :class:`EngineError` that says so, with the end of the engine's own
output, and is nobody else's problem.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from simspec.engines import worker
from simspec.engines.base import find_engine
from simspec.errors import EngineError

DEADLINE = 600.0
"""Seconds that one engine process may take when the caller does not say: ten minutes, more than any library scenario."""
PROGRESS_FILE = "progress.txt"
"""Where an operation may write the share of its work that is done, in the process's own folder."""
LOOK_EVERY = 0.5
"""s between two looks at it; it is written half as often."""
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of an engine's process, unless the user's says otherwise: engines run side by side on few cores, and a threaded
BLAS changes sums from run to run (and DART is 2 to 5 % slower beside its idle threads: measured)."""
LOG_TAIL = 2000
"""Characters of the engine's own output that an error quotes."""


@dataclass(frozen=True)
class Operation:
    """One thing to do in the engine's process (see ``engines/worker.py``): name, parameters, arrays."""

    op: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Answer:
    """What an operation gave: plain data, arrays, seconds for loading and for the work, the engine's warnings."""

    result: dict[str, Any]
    arrays: dict[str, np.ndarray]
    load_seconds: float
    seconds: float
    log: list[str]


@dataclass(frozen=True)
class Reply:
    """All answers of one process, with versions (``engine_version``, ``python_version``, ``numpy_version``,
    ``platform``, ``machine``), the wall time from start to end, and the engine's own output."""

    answers: list[Answer]
    versions: dict[str, str]
    wall_seconds: float
    output: str


def call(
    engine: str,
    artifacts: Path,
    operations: Sequence[Operation],
    *,
    python: str | None = None,
    deadline: float = DEADLINE,
) -> Reply:
    """Load ``artifacts`` in ``engine``, in a new process, and do the ``operations`` (a fresh load for each).

    ``python`` is the interpreter to use (default: this one); it needs numpy and the engine, not simspec.
    Raises EngineError when the engine is missing, refuses, crashes, or exceeds ``deadline`` (s).
    """
    with start(engine, artifacts, operations, python=python, deadline=deadline) as running:
        return running.wait()


@contextmanager
def start(
    engine: str,
    artifacts: Path,
    operations: Sequence[Operation],
    *,
    python: str | None = None,
    deadline: float = DEADLINE,
) -> Iterator[Running]:
    """As :func:`call`, but not waiting: several engines may work side by side. Leaving the block kills what still runs."""
    engine_class = find_engine(engine)
    if python is None and engine_class.version() is None:
        raise EngineError(engine, f"not installed: pip install 'simspec[{engine_class.EXTRA}]'")
    with tempfile.TemporaryDirectory(prefix=f"simspec-{engine}-") as name:
        folder = Path(name)
        request = {
            "schema": worker.SCHEMA,
            "engine": f"{engine_class.__module__}:{engine_class.__qualname__}",
            "artifacts": str(Path(artifacts).resolve()),
            "operations": [{"op": operation.op, **operation.parameters} for operation in operations],
        }
        (folder / "request.json").write_text(json.dumps(request), encoding="utf-8")
        arrays = {
            f"{index}.{key}": np.asarray(value)
            for index, operation in enumerate(operations)
            for key, value in operation.arrays.items()
        }
        if arrays:
            np.savez(folder / "request.npz", **arrays)  # type: ignore[arg-type]
        running = Running(engine, folder, len(operations), python or sys.executable, deadline)
        try:
            yield running
        finally:
            running.kill()


class Running:
    """An engine process at work."""

    def __init__(self, engine: str, folder: Path, operations: int, python: str, deadline: float):
        self.engine = engine
        self._folder = folder
        self._operations = operations
        self._started = time.perf_counter()
        self._ends = self._started + deadline
        self._deadline = deadline
        environment = {**ONE_THREAD, **os.environ, "PYTHONNOUSERSITE": "1"}
        with open(folder / "log.txt", "wb") as log:
            self._process = subprocess.Popen(
                [python, worker.__file__, str(folder)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=folder,
                env=environment,
                start_new_session=True,
            )

    def wait(self, progress: Callable[[float], None] | None = None) -> Reply:
        """Wait for the result; ``progress`` is told the share that is done, where an operation says it (``PROGRESS_FILE``).
        Raises EngineError."""
        while progress is not None and self._ends - time.perf_counter() > LOOK_EVERY:
            try:
                self._process.wait(timeout=LOOK_EVERY)
                break
            except subprocess.TimeoutExpired:
                self._tell(progress)
        try:
            code = self._process.wait(timeout=max(0.0, self._ends - time.perf_counter()))
        except subprocess.TimeoutExpired:
            self.kill()
            raise EngineError(
                self.engine, f"no result within its deadline of {self._deadline:g} s; killed{self._tail()}"
            ) from None
        wall = time.perf_counter() - self._started
        if not (self._folder / "result.json").exists():
            raise EngineError(self.engine, f"the process {_ending(code)} without a result{self._tail()}")
        result = json.loads((self._folder / "result.json").read_text(encoding="utf-8"))
        if result.get("schema") != worker.SCHEMA:
            raise EngineError(self.engine, f"its result has schema {result.get('schema')!r}, not {worker.SCHEMA}")
        if result["status"] != "ok":
            raise EngineError(self.engine, result["error"].removeprefix(f"EngineError: {self.engine}: "))
        with np.load(self._folder / "result.npz", allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
        if len(result["operations"]) != self._operations:
            raise EngineError(self.engine, f"{len(result['operations'])} answers to {self._operations} operations")
        answers = []
        for index, entry in enumerate(result["operations"]):
            prefix = f"{index}."
            own = {key[len(prefix) :]: value for key, value in arrays.items() if key.startswith(prefix)}
            answers.append(Answer(entry["result"], own, entry["load_seconds"], entry["seconds"], entry["log"]))
        names = ("engine_version", "python_version", "numpy_version", "platform", "machine")
        return Reply(answers, {name: str(result[name]) for name in names}, wall, self._output())

    def _tell(self, progress: Callable[[float], None]) -> None:
        try:
            progress(float((self._folder / PROGRESS_FILE).read_text(encoding="ascii")))
        except FileNotFoundError:
            return  # nothing said yet: the next look will find it

    def kill(self) -> None:
        """End the process and everything it started."""
        if self._process.poll() is None:
            try:
                os.killpg(self._process.pid, signal.SIGKILL)
            except ProcessLookupError:
                return  # it ended by itself in between
            self._process.wait()

    def _output(self) -> str:
        return (self._folder / "log.txt").read_text(encoding="utf-8", errors="replace")

    def _tail(self) -> str:
        output = self._output().strip()
        return f"; its last output: {output[-LOG_TAIL:]}" if output else ""


def _ending(code: int) -> str:
    if code < 0:
        return f"was ended by signal {-code} ({signal.Signals(-code).name})"
    return f"ended with code {code}"
