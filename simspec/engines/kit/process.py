"""simspec's side of the folder contract: an engine at work in a process of its own, under a deadline.

A crash, a hang, an answer to something else (``answers.py`` reads them all): each becomes an :class:`EngineError` that says so,
with the end of the engine's own output, and stays there. Nothing that such a process does is an exception of any
other kind here, and nothing of it is left when the block is left, or when this process ends, however it does (``keeper.py``).
"""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from simspec.confinement import ANY_LOCALE
from simspec.engines.kit import keeper, worker
from simspec.engines.kit.answers import read_answers
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.messages import DOING
from simspec.engines.kit.registry import demand_version, find_engine, not_installed, program_of
from simspec.engines.kit.request import Answer, BadAnswerError, Operation, write_request
from simspec.engines.kit.warm import Forked, WarmProcesses
from simspec.errors import EngineError, clipped, visible
from simspec.files import RECORDED_BYTES, NotReadableError, parse_json, read_bytes, scratch_folder
from simspec.processes import exit_if_signalled, search_environment, with_search_path

__all__ = [
    "DEADLINE",
    "PROGRESS_FILE",
    "SINGLE_THREAD",
    "Answer",
    "Operation",
    "Reply",
    "Running",
    "at_work",
    "call",
    "side_by_side",
    "start",
]

DEADLINE = 600.0
"""Seconds that one engine process may take when the caller does not say: ten minutes, more than any library scenario."""
PROGRESS_FILE = "progress.txt"
"""Where an operation may write the share of its work that is done, in the process's own folder."""
LOOK_EVERY = 0.5
"""s between two looks at it; it is written half as often."""
SINGLE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of an engine's process, unless the user's says otherwise: engines run side by side on few cores, and a threaded
BLAS changes sums from run to run (and one engine is 2 to 5 % slower with its idle threads: measured)."""
GRACE = 2.0
"""s that the keeper waits beyond the deadline: the waiting process kills the engine and says why; this is the fallback."""
DOING_BYTES = 200
"""Bytes of what an engine says that it does."""
LOG_TAIL = 2000
"""Characters of the engine's own output that an error quotes."""
LOG_BYTES = 100_000
"""Of the beginning and of the end of the engine's own output, that are kept."""
LOG_PATIENCE = 1.0
"""s to wait for the end of that output when the process has ended: something else may hold the pipe open."""
_at_work: set[Running] = set()
"""Every engine process that this process has started and not yet collected."""
_given_up = threading.Event()
"""Set while threads are being ended (``side_by_side``): no engine is started then."""


@contextmanager
def side_by_side(count: int) -> Iterator[ThreadPoolExecutor]:
    """``count`` threads that call engines. Leaving the block by an exception (a signal, an error of one of them) ends what
    the others wait for: their engines are killed, and they can start no more (CancelledError)."""
    with ThreadPoolExecutor(count) as pool:
        try:
            yield pool
        except BaseException:
            _given_up.set()
            try:
                pool.shutdown(wait=False, cancel_futures=True)
                for running in list(_at_work):
                    running.kill()
                pool.shutdown(wait=True)
            finally:
                _given_up.clear()
            raise


@dataclass(frozen=True)
class Reply:
    """All answers of one process, with versions (``engine_version``, ``python_version``, ``numpy_version``,
    ``platform``, ``machine``), the wall time from start to end, the engine's own output, and what the process took, measured
    from outside of it: ``cpu_user`` and ``cpu_system`` (s), ``peak_memory`` (bytes); empty where it was not measured."""

    answers: list[Answer]
    versions: dict[str, str]
    wall_seconds: float
    output: str
    usage: dict[str, float]


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


@functools.cache
def _installed(version: Callable[[], str | None]) -> str:
    """The version of an engine that is installed here, by the method that gives it: reading it takes 10 ms. Raises LookupError,
    which is not kept, where it is not installed."""
    here = version()
    if here is None:
        raise LookupError
    return here


@contextmanager
def start(
    engine: str,
    artifacts: Path,
    operations: Sequence[Operation],
    *,
    python: str | None = None,
    deadline: float = DEADLINE,
    warm: WarmProcesses | None = None,
) -> Iterator[Running]:
    """As :func:`call`, but not waiting: several engines may work side by side. Leaving the block kills what still runs.

    With ``warm``, the process is forked from one that has imported the engine, where that is possible.
    """
    engine_class = find_engine(engine)
    if python is None:
        try:
            _installed(engine_class.version)
        except LookupError:
            raise EngineError(engine, not_installed(engine_class)) from None
    with scratch_folder(engine) as folder:
        try:
            write_request(folder, engine_class, artifacts, operations)
        except (FileNotFoundError, NotADirectoryError) as error:
            raise EngineError(engine, f"its artifacts are missing: {error.filename}") from None
        command = engine_class.command(folder)
        if command is not None and python is not None:
            raise EngineError(engine, "is a separate program: --python does not apply to it")
        exit_if_signalled()
        running = Running(engine, folder, operations, python or sys.executable, deadline, command, warm)
        _at_work.add(running)
        try:
            if _given_up.is_set():  # checked after it is on the list: one of the two sees the other
                raise CancelledError(f"{engine}: the requesting process has ended")
            yield running
        finally:
            running.kill()
            _at_work.discard(running)


def begin(engine: str, python: str | None, warm: WarmProcesses | None) -> None:
    """Have the warm process of an engine started that requests will be forked from, without waiting for it; nothing of one that
    is a program of its own, or without ``warm``."""
    kind = find_engine(engine)
    is_program = getattr(kind.command, "__func__", None) is not Engine.command.__func__  # type: ignore[attr-defined]
    if warm is not None and not is_program:
        warm.begin(kind, program_of(python or sys.executable), _environment())


def _environment() -> dict[str, str]:
    """The environment of engines' processes."""
    return search_environment({**SINGLE_THREAD, **os.environ, **ANY_LOCALE})


def at_work(say: Callable[[str], None], work: str, doing: str) -> None:
    """Say what an engine does that takes long (:meth:`Running.wait`), in the course of ``work``."""
    say(f"{work}: {doing}" if doing else work)


class Running:
    """An engine process at work: a keeper (``keeper.py``), and below it whatever the engine makes of it."""

    def __init__(
        self,
        engine: str,
        folder: Path,
        operations: Sequence[Operation],
        python: str,
        deadline: float,
        command: Sequence[str] | None = None,
        warm: WarmProcesses | None = None,
    ):
        self.engine = engine
        self._folder = folder
        self._operations = tuple(operations)
        self._started = time.perf_counter()
        self._ends = self._started + deadline
        self._deadline = deadline
        self._doing = ""
        environment = _environment()
        # the process itself starts in its own folder
        program = program_of(python)
        given = (str(folder), str(deadline + GRACE), str(RECORDED_BYTES), *(command or ()))
        words = with_search_path(keeper.__file__, *given, python=program)
        forked = None
        if warm is not None and command is None:
            requested = (program, deadline + GRACE, RECORDED_BYTES)
            forked = warm.fork(find_engine(engine), folder, requested, environment)
        self._process = forked or self._new(words, environment, python)
        self._log = _Log(self._process.stdout)

    def _new(self, words: list[str], environment: dict[str, str], python: str) -> subprocess.Popen[bytes]:
        try:
            return subprocess.Popen(
                words,
                stdin=subprocess.PIPE,  # never written: it closes when this process ends, which the keeper notices
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                cwd=self._folder,
                env=environment,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise EngineError(self.engine, f"{python} cannot be started: {reason}") from None

    def wait(
        self, progress: Callable[[float], None] | None = None, doing: Callable[[str], None] | None = None
    ) -> Reply:
        """Wait for the result; ``progress`` is called with the share that is done, where an operation says it
        (``PROGRESS_FILE``), and ``doing`` with what the engine begins that takes long and is no step (``messages.py``), and
        with "" when it is done. Raises EngineError, whatever came back or did not."""
        while (progress is not None or doing is not None) and self._ends - time.perf_counter() > LOOK_EVERY:
            try:
                self._process.wait(timeout=LOOK_EVERY)
                break
            except subprocess.TimeoutExpired:
                self._tell(progress, doing)
        try:
            code = self._process.wait(timeout=max(0.0, self._ends - time.perf_counter()))
        except subprocess.TimeoutExpired:
            self.kill()
            at, text = self._at_work()
            raise EngineError(
                self.engine,
                f"no result within its deadline of {self._deadline:g} s{text}; killed{self._tail()}",
                at,
            ) from None
        wall = time.perf_counter() - self._started
        self.kill()  # remaining processes must not change the files that are read now
        try:
            answers, versions, refused = read_answers(self._folder, self._operations)
        except FileNotFoundError:
            at, text = self._at_work()
            raise EngineError(
                self.engine, f"the process {_ending(code)} without a result{text}{self._tail()}", at
            ) from None
        except BadAnswerError as error:
            raise EngineError(self.engine, f"{error}; the process {_ending(code)}{self._tail()}") from None
        if refused is not None:
            said = refused
            for kind in ("EngineError", "CompileError"):  # the second is no answer of the engine to what it was given
                said = said.removeprefix(f"{kind}: {self.engine}: ")
            message = clipped(said, LOG_TAIL)
            raise EngineError(self.engine, message, refused=refused.startswith("EngineError: "))
        demand_version(self.engine, versions["engine_version"])
        return Reply(answers, versions, wall, self._log.text(), self._usage())

    def _usage(self) -> dict[str, float]:
        """The resource usage of the process, from the keeper."""
        try:
            took = parse_json(read_bytes(self._folder / keeper.USAGE, 1000))
        except (OSError, NotReadableError):
            return {}
        names = ("cpu_user", "cpu_system", "peak_memory")
        if not isinstance(took, dict) or not all(isinstance(took.get(name), int | float) for name in names):
            return {}
        return {name: float(took[name]) for name in names}

    def _tell(self, progress: Callable[[float], None] | None, doing: Callable[[str], None] | None) -> None:
        """Pass on the current activity, and the completed share. It is optional: unreadable reports are ignored."""
        if doing is not None and (text := self._activity()) != self._doing:
            self._doing = text
            doing(text)
        if progress is None:
            return
        try:
            share = float(read_bytes(self._folder / PROGRESS_FILE, 64))
        except (OSError, ValueError):
            return  # nothing said yet: the next look will find it
        if 0.0 <= share <= 1.0:
            progress(share)

    def _activity(self) -> str:
        """The activity that the engine reports, on one line; "" where it reports none."""
        try:
            said = read_bytes(self._folder / DOING, DOING_BYTES).decode("utf-8", "replace")
        except (OSError, NotReadableError):
            return ""
        return " ".join(said.split())

    def kill(self) -> None:
        """End the process and everything it started, if anything is left of it."""
        process = self._process
        if process.stdin is not None and not process.stdin.closed:
            process.stdin.close()  # the keeper ends all that the engine started, also what left its process group
        if process.poll() is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=keeper.PATIENCE)
        if (
            not isinstance(process, Forked) or process.returncode is None
        ):  # no process holds the number of one that has ended
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        self._log.end()

    def _at_work(self) -> tuple[int | None, str]:
        """The number of the operation that the process was at, and words for it; None and none where it does not say."""
        try:
            at = int(read_bytes(self._folder / worker.AT_WORK, 64))
        except (OSError, ValueError):
            return None, ""
        if not 0 <= at < len(self._operations):
            return None, ""
        return at, f", at work on '{self._operations[at].op}' (operation {at + 1} of {len(self._operations)})"

    def _tail(self) -> str:
        output = visible(self._log.text().strip(), lines=True)  # invisible characters take more room as escapes
        return f"; its last output: {output[-LOG_TAIL:]}" if output else ""


class _Log:
    """An engine's own output: read while it runs, whatever its length; the beginning and the end are kept."""

    def __init__(self, pipe: IO[bytes] | None):
        self._first, self._last, self._left_out = b"", b"", 0
        self._pipe = pipe
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        pipe = self._pipe
        if pipe is None:
            return
        while block := os.read(pipe.fileno(), 65536):
            if len(self._first) < LOG_BYTES:
                self._first += block
                continue
            self._last += block
            if len(self._last) > 2 * LOG_BYTES:
                self._left_out += len(self._last) - LOG_BYTES
                self._last = self._last[-LOG_BYTES:]

    def end(self) -> None:
        """All who could write are gone, or are given up: wait for the rest of what they wrote."""
        self._thread.join(LOG_PATIENCE)
        if not self._thread.is_alive() and self._pipe is not None:
            self._pipe.close()

    def text(self) -> str:
        """The stored text."""
        gap = f"\n… {self._left_out:,} bytes left out …\n".encode() if self._left_out else b""
        return (self._first + gap + self._last).decode("utf-8", errors="replace")


def _ending(code: int) -> str:
    if code < 0:
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = "a real-time signal"
        return f"was ended by signal {-code} ({name})"
    return f"ended with code {code}"
