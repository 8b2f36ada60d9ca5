"""A warm process: it has imported one engine and forks a keeper (``keeper.py``) for each request that it is given.

``python warm_server.py MODULE:CLASS DESCRIPTOR``: DESCRIPTOR is a Unix socket (SOCK_SEQPACKET) to the process that started it.
It first writes, as JSON, ``{"ready": true}`` or ``{"error": why}``. Each message that it receives is ``{"folder", "seconds",
"bytes"}``, what a keeper is started with, and brings three descriptors: the keeper's standard input, its output, and a pipe to
which the keeper writes how it ended. It answers ``{"pid": number}``. It ends when the other end of the socket is closed.
Keepers that are still at work then end their engines, as they do whenever their parent is gone.

It has one thread, as a process that forks must have: an engine whose import starts threads is refused.
"""

from __future__ import annotations

import gc
import importlib
import importlib.util
import json
import os
import signal
import socket
import sys
from pathlib import Path
from typing import Any

MESSAGE = 65536
"""Bytes of a message, at most."""
DESCRIPTORS = 3


def _module(name: str) -> Any:
    """A module in the folder of this file, under a name of its own."""
    place = Path(__file__).with_name(f"{name}.py")
    spec = importlib.util.spec_from_file_location(f"simspec_{name}", place)
    if spec is None or spec.loader is None:
        raise ImportError(f"no module at {place}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _prepare(program: str) -> dict[str, Any]:
    """Import all that an engine's process imports, and return the report on it."""
    gc.disable()
    module, _, name = program.partition(":")
    engine = getattr(importlib.import_module(module), name)
    for part in ("attempts", "operations", "session"):
        importlib.import_module(f"simspec.engines.kit.{part}")
    engine.prepare()
    threads = len(os.listdir("/proc/self/task")) if sys.platform.startswith("linux") else 1
    if threads > 1:
        return {
            "error": f"importing it starts {threads - 1} threads, and a process with threads cannot be forked safely"
        }
    gc.collect()
    gc.freeze()  # existing objects are shared by all forked processes, and no collection touches them
    gc.enable()
    return {"ready": True}


def serve(program: str, descriptor: int) -> None:
    """See the module."""
    with socket.socket(fileno=descriptor) as connection:
        worker, keeper = _module("worker"), _module("keeper")
        worker._make_simspec_importable()
        try:
            prepare = _prepare(program)
        except Exception as error:  # any error: the starting process takes a process for each request, which reports it
            prepare = {"error": f"{type(error).__name__}: {error}"[:2000]}
        connection.send(json.dumps(prepare).encode())
        if "error" in prepare:
            return
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # no process waits for keepers: they report how they ended
        while True:
            message, descriptors, _, _ = socket.recv_fds(connection, MESSAGE, DESCRIPTORS)
            if not message:
                return
            child = os.fork()
            if child == 0:
                connection.close()
                _keep(keeper, json.loads(message), descriptors)
            for each in descriptors:
                os.close(each)
            connection.send(json.dumps({"pid": child}).encode())


def _keep(keeper: Any, requested: dict[str, Any], descriptors: list[int]) -> None:
    """Become the keeper of one request; never returns."""
    code = 1
    try:
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        os.setsid()
        given, output, ending = descriptors
        os.dup2(given, 0)
        os.dup2(output, 1)
        os.dup2(output, 2)
        for each in (given, output):
            os.close(each)
        os.chdir(requested["folder"])
        code = keeper.keep(Path(requested["folder"]), requested["seconds"], requested["bytes"], [], ending)
    except BaseException:  # any error ends this process and no other
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    if not sys.flags.safe_path:
        sys.path.pop(0)  # this script's own folder: a module of it would shadow an engine's package of the same name
    serve(sys.argv[1], int(sys.argv[2]))
