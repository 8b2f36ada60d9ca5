"""Processes: how the command line ends, how interpreters are started, requests to child processes, processor time.

Exit codes ``130``, ``143`` and ``129`` for interrupt, terminate and hang up, as shells have them; ``70`` for a bug in simspec.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from types import FrameType
from typing import IO, TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    import subprocess


# How a command line ends on signals, when its output is not read, and when it meets a bug.
#
# ``130``, ``143`` and ``129`` for interrupt, terminate and hang up, as shells say it; ``70`` for a bug in simspec.

EXIT_BUG = 70
"""Something happened that simspec does not know of. (EX_SOFTWARE of sysexits.h; 0 to 3 are answers.)"""
DEBUG = "SIMSPEC_DEBUG"
"""Environment variable: when set, a bug's traceback is shown, not kept in a file."""
SIGNALS = tuple(
    number for name in ("SIGINT", "SIGTERM", "SIGHUP") if (number := getattr(signal, name, None)) is not None
)


class Ended(SystemExit):
    """A signal requests the end of this process. Passes through every block, which ends engines and removes what is
    temporary."""

    def __init__(self, number: int):
        self.number = number
        super().__init__(128 + number)


_signalled: list[int] = []
"""The signal that requested the end of this process, once there was one."""
AGAIN = 0.01
"""s after which the request to end is raised again where the first exception got lost."""


def run_until_signalled(run: Callable[[], int]) -> int:
    """The exit code of ``run``, which the signals that ask a process to end make end in order, once; those that are ignored
    stay so. Once there was such a signal it is what ``run`` ended by, whatever it returned or raised: blocks that
    :class:`Ended` passes through may replace it by another exception (the import of a compiled module) or by none (a
    destructor)."""
    try:
        for number in SIGNALS:
            if signal.getsignal(number) is not signal.SIG_IGN:  # nohup, or a shell's background job
                signal.signal(number, _end)
        sys.unraisablehook = _lost
        code = run()
        _ignore()  # nothing is left to be ended
    except BaseException:
        if not _signalled:
            raise
    if not _signalled:
        return code
    say(f"ended by {signal.Signals(_signalled[0]).name}")
    return 128 + _signalled[0]


def exit_if_signalled() -> None:
    """Raise Ended where a signal requested the end of this process: other errors are then not the reason."""
    if _signalled:
        raise Ended(_signalled[0])


def _end(number: int, frame: FrameType | None) -> None:
    _ignore()  # an orderly end in progress is not to be cut short
    _signalled[:] = [number]
    raise Ended(number)


def _ignore() -> None:
    for entry in SIGNALS:
        signal.signal(entry, signal.SIG_IGN)


def _lost(unraisable: Any) -> None:
    """Where an exception cannot go on (a destructor, a callback): it is raised again a moment later, if it is an end."""
    if not isinstance(unraisable.exc_value, Ended):
        sys.__unraisablehook__(unraisable)
        return
    signal.signal(signal.SIGALRM, lambda *_: exit_if_signalled())
    signal.setitimer(signal.ITIMER_REAL, AGAIN)


def say(line: str) -> None:
    """One line on standard error, if anybody is there."""
    try:
        sys.stderr.write(f"simspec: {line}\n")
        sys.stderr.flush()
    except (OSError, ValueError):
        return  # closed, or full: there is nowhere left to say it


def finish(failure: OSError | None = None) -> int:
    """Write out what was said. Returns 0, or 2 where it cannot be written (a full device): then a line says so.

    ``failure``: the error of an earlier write.
    """
    try:
        if failure is not None:
            raise failure
        sys.stdout.flush()
    except BrokenPipeError:
        _give_up_stdout()
        return 1  # the reader has closed the pipe: not an error
    except (OSError, ValueError) as error:
        _give_up_stdout()
        say(("" if failure is not None else "standard output: ") + str(getattr(error, "strerror", None) or error))
        return 2
    return 0


def _give_up_stdout() -> None:
    """Discard the rest of the buffer, so that the interpreter does not try again when it ends."""
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
    except (OSError, ValueError):
        return  # not a real file


def in_order(run: Callable[[], int]) -> int:
    """The exit code of ``run``, when all that it said is written out. An unexpected exception is reported as a bug."""
    try:
        code = run()
    except BaseException as error:
        exit_if_signalled()
        code = _code(error)
    exit_if_signalled()
    return max(code, finish())


def _code(error: BaseException) -> int:
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else 2
    if isinstance(error, BrokenPipeError):
        return 1
    if isinstance(error, OSError):  # of what it says: all else knows its file, and was caught
        return finish(error)
    if isinstance(error, Exception):
        return bug(error)
    raise error


def bug(error: BaseException) -> int:
    """Say that this is simspec's own mistake, and keep the traceback; the exit code."""
    import traceback

    trace = "".join(traceback.format_exception(error))
    what = f"{type(error).__name__}: {error}".encode("unicode_escape").decode("ascii")[:300]
    if os.environ.get(DEBUG):
        say(f"{what}; this is a bug in simspec")
        sys.stderr.write(trace)
        return EXIT_BUG
    say(f"{what}; this is a bug in simspec: please report it with {_kept(trace)} (or set {DEBUG}=1 to print it)")
    return EXIT_BUG


def _kept(trace: str) -> str:
    """Where the traceback is kept."""
    import tempfile

    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="simspec-bug-", suffix=".txt", delete=False, encoding="utf-8", errors="backslashreplace"
        ) as file:
            file.write(trace)
    except OSError:
        return "its traceback"
    return file.name


# A request to a child process by its standard input, and the answer by its standard output: in bounded time and memory.


def exchange(process: subprocess.Popen[bytes], request: bytes, seconds: float, most: int) -> tuple[bytes, str]:
    """The answer of a process, and why it is cut off: "late" after ``seconds`` by the clock, "large" beyond ``most`` bytes; ""
    where the process has ended by itself. Otherwise it is killed."""
    import selectors
    import subprocess
    import threading

    source, sink = process.stdout, process.stdin
    assert source is not None
    assert sink is not None
    writer = threading.Thread(target=_send, args=(sink, request), daemon=True)
    writer.start()
    until, parts, size, why = time.monotonic() + seconds, [], 0, ""
    try:
        with selectors.DefaultSelector() as selector:
            selector.register(source, selectors.EVENT_READ)
            while not why:
                left = until - time.monotonic()
                if left <= 0.0 or not selector.select(left):
                    why = "late"
                    break
                part = os.read(source.fileno(), 2**20)
                if not part:
                    break
                size += len(part)
                parts.append(part)
                why = "large" if size > most else ""
        if not why:
            process.wait(max(0.0, until - time.monotonic()))
    except subprocess.TimeoutExpired:
        why = "late"
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        writer.join()
        source.close()
    return b"".join(parts), why


def _send(sink: IO[bytes], request: bytes) -> None:
    with contextlib.suppress(BrokenPipeError), sink:  # the process has ended; its answer shows it
        sink.write(request)


# How a Python interpreter is started: so that no file of the folder that a command is started in is imported.
#
# ``python -m``, ``python -c`` and ``python script`` put the working folder, or the script's, before the standard library: a
# ``json.py`` or ``pip.py`` there would be run. Every start of an interpreter in simspec goes through one of the two forms here,
# in a working folder other than the user's (``tests/test_isolated.py``).

ELSEWHERE: Final = "/"
"""A working folder for interpreters that need none."""


def isolated(*words: str, python: str | None = None) -> list[str]:
    """The words that start an interpreter (None: this one) in isolated mode, ``-I``: neither the working folder, nor the user's
    own packages, nor any variable ``PYTHON...`` has an effect."""
    return [python or sys.executable, "-I", *words]


def with_search_path(*words: str, python: str | None = None) -> list[str]:
    """The same for an interpreter that has to import an engine or a reader of files, which some users have by ``PYTHONPATH``
    alone (libraries that are built from source): ``-P`` and ``-s`` leave out the working folder and the user's own packages.
    The environment must be one of :func:`search_environment`."""
    return [python or sys.executable, "-P", "-s", *words]


def search_environment(environment: Mapping[str, str]) -> dict[str, str]:
    """An environment whose ``PYTHONPATH`` has absolute paths alone: an empty entry is the working folder, as
    ``PYTHONPATH=$PYTHONPATH:/more`` leaves it behind, and a relative one is below it."""
    paths = [path for path in environment.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(path)]
    cleaned = {name: value for name, value in environment.items() if name != "PYTHONPATH"}
    return {**cleaned, "PYTHONNOUSERSITE": "1", **({"PYTHONPATH": os.pathsep.join(paths)} if paths else {})}


# Processor time of this process and of the programs that work for it, which the system counts for themselves alone.

Clock = Callable[[], float]
"""Gives seconds."""
_others: list[Clock] = []


def processor_clock() -> Clock:
    """The clock of all that work here now: of this process alone, as the system has it, where nothing else works."""
    if not _others:
        return time.process_time
    return lambda: time.process_time() + sum(other() for other in _others)


@contextlib.contextmanager
def counted(other: Clock) -> Iterator[None]:
    """Count what ``other`` says to the processor time of this process, within the block."""
    _others.append(other)
    try:
        yield
    finally:
        _others.remove(other)
