"""Warm processes for readers of files of unknown origin: each has imported the libraries of one reader, and forks a process for
each file. Reading a small file takes a tenth of the time that starting Python and importing its reader takes.

``python readers.py DESCRIPTOR MODULE...`` is such a process. DESCRIPTOR is a Unix socket (SOCK_SEQPACKET). Each message is what
``subprocess.Popen`` is given (``words``, ``folder``, ``environment``) with three descriptors: standard input, standard output,
and a pipe for how the process ended. It answers with the number of the process. The forked process then does what a new process
does: it limits and confines itself before it reads the first byte.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from simspec.engines.kit.warm import Forked
from simspec.imports import child
from simspec.meshes import reading
from simspec.processes import ELSEWHERE, search_environment, with_search_path

LIBRARIES = {
    "simspec.meshes.child": ("numpy", "trimesh", "collada"),
    "usd/child.py": ("numpy", "pxr.Sdf", "pxr.Tf", "pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics"),
    "model_compiler.py": ("numpy", "mujoco"),
}
"""The reader, by a word of its command, and the modules that it imports before it is confined."""
MESSAGE = 65536


class WarmReaders:
    """Stands for the module ``subprocess`` where readers are started. A reader that is not in ``LIBRARIES``, or a request that
    is too long for a message, has a new process."""

    PIPE, DEVNULL = subprocess.PIPE, subprocess.DEVNULL

    def __init__(self) -> None:
        self._servers: dict[str, tuple[socket.socket, subprocess.Popen[bytes]]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        for connection, server in self._servers.values():
            connection.close()
            server.wait()

    def Popen(self, words: Sequence[str], **options: Any) -> ForkedReader | subprocess.Popen[bytes]:
        words = list(words)
        kind = next((kind for kind in LIBRARIES if any(word.endswith(kind) for word in words)), None)
        message = json.dumps(
            {"words": words[3:], "folder": str(options["cwd"]), "environment": options["env"]}
        ).encode()
        if kind is None or len(message) > MESSAGE:
            return subprocess.Popen(words, **options)
        connection = self._server(kind, options["env"])
        pipes = [os.pipe() for _ in range(3)]
        theirs = [pipes[0][0], pipes[1][1], pipes[2][1]]
        socket.send_fds(connection, [message], theirs)
        pid = int(connection.recv(MESSAGE))
        for end in theirs:
            os.close(end)
        return ForkedReader(pid, os.fdopen(pipes[0][1], "wb", 0), os.fdopen(pipes[1][0], "rb", 0), pipes[2][0])

    def _server(self, kind: str, environment: Mapping[str, str]) -> socket.socket:
        if kind not in self._servers:
            mine, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with other:
                server = subprocess.Popen(
                    with_search_path(__file__, str(other.fileno()), *LIBRARIES[kind]),
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    cwd=ELSEWHERE,
                    env=search_environment({**environment, "PYTHONPATH": str(Path(__file__).resolve().parent.parent)}),
                    pass_fds=[other.fileno()],
                )
            self._servers[kind] = mine, server
        return self._servers[kind][0]


class ForkedReader(Forked):
    """A reader at work."""

    def kill(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)


def patched(patch: Any, warm: WarmReaders) -> None:
    """Let readers be forked as long as ``patch`` (pytest's) lasts."""
    patch.setattr(child, "subprocess", warm)
    patch.setattr(reading, "subprocess", warm)


def serve(connection: socket.socket) -> None:
    """Fork a process for each message, until the other end is closed."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # no process waits for those that wait for a reader
    while True:
        message, descriptors, _, _ = socket.recv_fds(connection, MESSAGE, 3)
        if not message:
            return
        if os.fork() == 0:
            _wait_for_reader(connection, json.loads(message), descriptors)
        for descriptor in descriptors:
            os.close(descriptor)


def _wait_for_reader(connection: socket.socket, request: dict[str, Any], descriptors: list[int]) -> None:
    """Fork the reader, and write how it ends."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    pid = os.fork()
    if pid == 0:
        connection.close()
        _read(request, descriptors)
    for descriptor in descriptors[:2]:
        os.close(descriptor)
    connection.send(str(pid).encode())
    connection.close()
    _, status = os.waitpid(pid, 0)
    os.write(descriptors[2], status.to_bytes(4, "little"))
    os._exit(0)


def _read(request: dict[str, Any], descriptors: list[int]) -> None:
    """Be a new process that was started with these words."""
    code = 1
    try:
        os.setsid()
        os.chdir(request["folder"])
        os.dup2(descriptors[0], 0)
        os.dup2(descriptors[1], 1)
        for descriptor in descriptors:
            os.close(descriptor)
        os.environ.clear()
        os.environ.update(request["environment"])
        module, *_ = words = request["words"]
        if module == "-m":
            sys.argv[:] = words[1:]
            importlib.import_module(words[1]).main()
        else:
            sys.argv[:] = words
            child.main()
        sys.stdout.flush()
        code = 0
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 1
    finally:  # neither the server's loop nor its handlers at exit are this process's
        os._exit(code)


if __name__ == "__main__":
    for name in sys.argv[2:]:
        with contextlib.suppress(ImportError):  # the answer says so
            importlib.import_module(name)
    serve(socket.socket(fileno=int(sys.argv[1])))
