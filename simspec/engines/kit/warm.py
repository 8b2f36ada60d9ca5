"""Warm processes: one for each engine and interpreter, which has imported the engine and forks a process for each request.

Isolation stays what it is: each request has a process of its own, with its keeper, deadline and limits (``process.py``), that
has never loaded anything. This saves the start of Python and the import of the engine. Where that is not possible (a program of
its own, a system that cannot pass descriptors, an engine that starts threads when it is imported) there is a new process each.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from simspec.engines.kit import keeper
from simspec.engines.kit.contract import Engine
from simspec.processes import ELSEWHERE, search_environment, with_search_path

START = 60.0
"""s that a warm process may take to import its engine: the slowest takes 2 on a quiet machine."""
STATUS = 4
"""Bytes in which a keeper reports how it ended."""


class Forked:
    """A keeper that was forked from a warm process: the part of :class:`subprocess.Popen` that ``process.Running`` needs."""

    def __init__(self, pid: int, stdin: IO[bytes], stdout: IO[bytes], ending: int):
        self.pid, self.stdin, self.stdout = pid, stdin, stdout
        self.returncode: int | None = None
        self._ending: int | None = ending

    def poll(self) -> int | None:
        """Its exit code, negative for a signal; None while it works."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its exit code. Raises subprocess.TimeoutExpired."""
        if self.returncode is not None or self._ending is None:
            return self.returncode if self.returncode is not None else -signal.SIGKILL
        if not select.select([self._ending], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired("keeper", timeout or 0.0)
        status = os.read(self._ending, STATUS)
        os.close(self._ending)
        self._ending = None
        # a keeper that says nothing was killed
        code = os.waitstatus_to_exitcode(int.from_bytes(status, "little")) if len(status) == STATUS else -signal.SIGKILL
        self.returncode = code
        return code


class _Server:
    """One warm process."""

    def __init__(self, program: str, python: str, environment: Mapping[str, str]):
        self._lock = threading.Lock()
        self._connection, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with other:
            self._process = subprocess.Popen(
                with_search_path(keeper.__file__, keeper.WARM, program, str(other.fileno()), python=python),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd=ELSEWHERE,
                env=search_environment(environment),
                pass_fds=[other.fileno()],
                start_new_session=True,
            )
        self._connection.settimeout(START)
        self._ready: bool | None = None

    @property
    def usable(self) -> bool:
        """Whether it has imported its engine; waits until it says so at its first request."""
        with self._lock:
            if self._ready is None:
                self._ready = bool(self._heard().get("ready"))
            return self._ready

    def _heard(self) -> dict[str, Any]:
        """Its message; empty when it is gone or says nothing sensible in time."""
        try:
            content = json.loads(self._connection.recv(keeper.MESSAGE))
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}

    def fork(self, folder: Path, seconds: float, most: int) -> Forked | None:
        """A keeper at work on a request; None where the process is gone."""
        with contextlib.ExitStack() as passed, contextlib.ExitStack() as kept:
            ends = []
            for local_writes in (True, False, False):
                reading, writing = os.pipe()
                mine, theirs = (writing, reading) if local_writes else (reading, writing)
                kept.callback(os.close, mine)
                passed.callback(os.close, theirs)
                ends.append((mine, theirs))
            message = json.dumps({"folder": str(folder), "seconds": seconds, "bytes": most}).encode()
            with self._lock:
                try:
                    socket.send_fds(self._connection, [message], [theirs for _, theirs in ends])
                except OSError:
                    self._ready = False
                    return None
                pid = self._heard().get("pid")
            if not isinstance(pid, int):
                self._ready = False
                return None
            kept.pop_all()
            (stdin, _), (stdout, _), (ending, _) = ends
            return Forked(pid, os.fdopen(stdin, "wb", 0), os.fdopen(stdout, "rb", 0), ending)

    def close(self) -> None:
        """End it."""
        self._connection.close()
        try:
            self._process.wait(START)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class WarmProcesses:
    """Warm processes, started when they are first needed and ended with the block.

    >>> with WarmProcesses() as warm, start(engine, folder, operations, warm=warm) as running:  # doctest: +SKIP
    ...     reply = running.wait()
    """

    def __init__(self) -> None:
        self._servers: dict[tuple[str, str], _Server | None] = {}
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def fork(
        self, engine: type[Engine], folder: Path, words: Sequence[Any], environment: Mapping[str, str]
    ) -> Forked | None:
        """A keeper of a request in ``folder``, forked from the engine's warm process in an interpreter; ``words``: interpreter,
        seconds and bytes. None where there can be none, and a new process must be started."""
        python, seconds, most = words
        server = self._server(engine, python, environment)
        return server.fork(folder, seconds, most) if server is not None and server.usable else None

    def begin(self, engine: type[Engine], python: str, environment: Mapping[str, str]) -> None:
        """Start an engine's warm process and do not wait for it: it imports the engine while other things are done."""
        self._server(engine, python, environment)

    def _server(self, engine: type[Engine], python: str, environment: Mapping[str, str]) -> _Server | None:
        program = f"{engine.__module__}:{engine.__qualname__}"
        with self._lock:
            if (program, python) not in self._servers:
                self._servers[program, python] = _start(program, python, environment)
            return self._servers[program, python]

    def close(self) -> None:
        """End all warm processes."""
        with self._lock:
            for server in self._servers.values():
                if server is not None:
                    server.close()
            self._servers.clear()


def _start(program: str, python: str, environment: Mapping[str, str]) -> _Server | None:
    if not hasattr(socket, "send_fds") or not hasattr(socket, "SOCK_SEQPACKET") or not hasattr(os, "fork"):
        return None
    try:
        return _Server(program, python, environment)
    except OSError:
        return None  # the process that is started instead says what is wrong with the interpreter
