"""Keeper of an engine's process: starts the worker, and ends it and all that it started, when its time has come; and a warm
process, which forks keepers.

``python keeper.py FOLDER SECONDS BYTES [COMMAND ...]``: forks the worker (``worker.py`` in this folder; or starts COMMAND in
FOLDER, an engine that is a program of its own), and ends with it. Before that it ends it when SECONDS have passed, or when the
process that started the keeper is gone, however that ended: then its end of the pipe that is the keeper's standard input is
closed. No file of the worker may become longer than BYTES.

The keeper is a process, not a thread: an engine's own code may hold the interpreter for as long as it likes, and the keeper
goes on where the starting process is stopped. Nothing but the standard library, and nothing that starts threads: it forks.

``python keeper.py --warm MODULE:CLASS DESCRIPTOR``: imports one engine and forks a keeper for each request that it is given.
DESCRIPTOR is a Unix socket (SOCK_SEQPACKET) to the process that started it. It first writes, as JSON, ``{"ready": true}`` or
``{"error": why}``. Each message that it receives is ``{"folder", "seconds", "bytes"}``, what a keeper is started with, and
brings three descriptors: the keeper's standard input, its output, and a pipe to which the keeper writes how it ended. It
answers ``{"pid": number}``. It ends when the other end of the socket is closed. Keepers that are still at work then end their
engines, as they do whenever their parent is gone. An engine whose import starts threads is refused.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import importlib.util
import json
import os
import resource
import select
import signal
import stat
import sys
import threading
import time
from pathlib import Path
from typing import Any

LOOK_EVERY = 0.5
"""s between two looks at whether the parent is still there, for where something else holds the other end of the pipe."""
PATIENCE = 2.0
"""s for everything to be gone after it was killed."""
USAGE = "usage.json"
"""CPU time (s) and largest resident memory (bytes) of the worker, in the folder of the request."""
PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
"""Of Linux's prctl(2)."""
WARM = "--warm"
LATER = ("numpy.ma", "pinocchio")
"""Packages that some requests import at work: ``numpy.unique`` the first, control laws with the mass matrix the second."""
MESSAGE, DESCRIPTORS = 65536, 3
"""Bytes of a message to a warm process, at most, and its descriptors."""


def keep(folder: Path, seconds: float, most: int, command: list[str], ending: int | None = None) -> int:
    """Start the worker, or ``command``, on ``folder`` and see it through; its exit code. Ends by the signal that ended it.

    How it ended is also written to the descriptor ``ending``: a status as of wait(2), in four bytes, little-endian.
    Its resource usage (``USAGE``) is left in the folder.
    """
    ends = time.monotonic() + seconds
    parent, keeper = os.getppid(), os.getpid()
    _prctl(PR_SET_CHILD_SUBREAPER, 1)  # remaining child processes of the engine become the keeper's
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    heard, given = os.pipe()
    alive, actual = os.pipe()
    os.set_blocking(given, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(given)
    child = os.fork()
    if child == 0:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for descriptor in (heard, given, actual, *([] if ending is None else [ending])):
            os.close(descriptor)
        _begin(keeper, alive, most)
        _work(folder, command)
    os.close(alive)
    watched = [heard, *([0] if stat.S_ISFIFO(os.fstat(0).st_mode) else [])]
    status = None
    try:
        while status is None:
            done, found, usage = os.wait4(child, os.WNOHANG)
            if done:
                status = found
                _leave_usage(folder, usage)
                break
            left = ends - time.monotonic()
            if left <= 0.0 or os.getppid() != parent:
                break
            readable = select.select(watched, [], [], min(left, LOOK_EVERY))[0]
            if 0 in readable and not os.read(0, 4096):
                break
            if heard in readable:
                os.read(heard, 4096)
    finally:
        _end(child, status is not None)
    if ending is not None:
        given_status = status if status is not None else (128 + signal.SIGKILL) << 8
        os.write(ending, given_status.to_bytes(4, "little"))
    if status is None:
        return 128 + signal.SIGKILL
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        if number != signal.SIGKILL:
            signal.signal(number, signal.SIG_DFL)
        os.kill(keeper, number)
    return os.waitstatus_to_exitcode(status)


def _leave_usage(folder: Path, usage: resource.struct_rusage) -> None:
    """The resource usage of the worker and of its ended children, from outside of it: optional, as the folder may be gone."""
    scale = 1 if sys.platform == "darwin" else 1024
    took = {"cpu_user": usage.ru_utime, "cpu_system": usage.ru_stime, "peak_memory": usage.ru_maxrss * scale}
    with contextlib.suppress(OSError):
        (folder / USAGE).write_text(json.dumps(took), encoding="ascii")


def _begin(keeper: int, alive: int, most: int) -> None:
    """First actions of the worker's process: a separate process group, no input, an end with its keeper."""
    os.setpgid(0, 0)
    if not _prctl(PR_SET_PDEATHSIG, signal.SIGKILL):
        threading.Thread(target=_end_with, args=(alive,), daemon=True).start()
    if os.getppid() != keeper:  # the keeper ended before the request for a signal
        os._exit(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_FSIZE, (allowed, hard))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # writing more is then an error that says so


def _end_with(alive: int) -> None:
    """Where the system has no signal for it: end when the keeper's end of the pipe is closed."""
    os.read(alive, 1)
    os.killpg(0, signal.SIGKILL)


def _work(folder: Path, command: list[str]) -> None:
    """Run the worker, or ``command``; never returns."""
    code = 1
    try:
        if command:
            signal.signal(signal.SIGXFSZ, signal.SIG_DFL)  # Python's programs alone make an error of it
            os.chdir(folder)
            os.execvp(command[0], command)
        code = _worker().main(folder)
    except BaseException:  # any error ends this process and no other
        import traceback

        traceback.print_exc()
    finally:
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)  # engines' own exit handlers have been seen to crash after all work was done


def _worker() -> Any:
    place = Path(__file__).with_name("worker.py")
    spec = importlib.util.spec_from_file_location("simspec_worker", place)
    if spec is None or spec.loader is None:
        raise ImportError(f"no module at {place}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _end(child: int, ended: bool) -> None:
    """Kill the worker and everything that it started, and collect them."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        try:
            done, _ = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return  # no process is left
        if not done:
            # those that left the process group and lost their parent: they are the keeper's now
            for pid in _children():
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.005)


def _children() -> list[int]:
    """The keeper's children, where the system says."""
    number, found = os.getpid(), []
    if not sys.platform.startswith("linux"):
        return found
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                with open(f"/proc/{name}/stat", "rb") as file:
                    fields = file.read().rpartition(b")")[2].split()
            except OSError:
                continue  # ended meanwhile
            if int(fields[1]) == number:
                found.append(int(name))
    return found


def _prctl(option: int, value: int) -> bool:
    """Whether the system has the option and took it."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        import ctypes

        return bool(ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0) == 0)
    except (ImportError, OSError, AttributeError):
        return False  # a Python without ctypes, a C library without prctl


def _prepare(program: str) -> dict[str, Any]:
    """Import all that an engine's process imports, and return the report on it."""
    gc.disable()
    module, _, name = program.partition(":")
    engine = getattr(importlib.import_module(module), name)
    for part in ("operations", "session"):
        importlib.import_module(f"simspec.engines.kit.{part}")
    engine.prepare()
    for part in LATER:
        with contextlib.suppress(ImportError):  # an engine's environment need not have it
            importlib.import_module(part)
    engine.version()  # finds its package, whose place is then known
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
    """Be a warm process of the engine ``program``; ``descriptor``: of its socket."""
    import socket  # not for keepers

    with socket.socket(fileno=descriptor) as connection:
        _worker()._make_simspec_importable()
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
                _keep_forked(json.loads(message), descriptors)
            for each in descriptors:
                os.close(each)
            connection.send(json.dumps({"pid": child}).encode())


def _keep_forked(requested: dict[str, Any], descriptors: list[int]) -> None:
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
        code = keep(Path(requested["folder"]), requested["seconds"], requested["bytes"], [], ending)
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
    if sys.argv[1] == WARM:
        serve(sys.argv[2], int(sys.argv[3]))
    else:
        sys.exit(keep(Path(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]))
