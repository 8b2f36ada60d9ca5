"""One case in a process of its own: the import of a file as the command does it, and what was wrong with how it went.

Right is: an error (exit code 2) whose problems each have a place, or a spec that says the same world when it is read again, all
of it finite; within bounds of time and memory; without opening a file that it may not.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import select
import signal
import struct
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

CPU_SECONDS, MEMORY = 10.0, 2**20
"""Most processor time (s) and memory (kB) of a case, with all processes that it starts."""
WALL = 90.0
"""s by the clock, on a busy machine, after which a case hangs."""
IN_OPEN, IN_ACCESS = 0x20, 0x1


class Watch:
    """Says whether a folder's files are opened, by whatever process (inotify)."""

    def __init__(self, folder: Path):
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._descriptor = self._libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        if (
            self._descriptor < 0
            or self._libc.inotify_add_watch(self._descriptor, os.fsencode(folder), IN_OPEN | IN_ACCESS) < 0
        ):
            raise OSError(ctypes.get_errno(), "inotify")

    def close(self) -> None:
        """Watch no more."""
        os.close(self._descriptor)

    def opened(self) -> list[str]:
        """Names of files that were opened since the last question; opening the folder itself is not reading a file."""
        names = []
        while select.select([self._descriptor], [], [], 0)[0]:
            data = os.read(self._descriptor, 65_536)
            place = 0
            while place < len(data):
                _, mask, _, length = struct.unpack_from("iIII", data, place)
                name = data[place + 16 : place + 16 + length].rstrip(b"\0").decode("utf-8", "replace")
                if name and not mask & 0x40000000:  # a folder
                    names.append(name)
                place += 16 + length
        return names


def judged(project: Path, name: str, watch: Watch) -> tuple[str, list[str]]:
    """The outcome of the file ``name`` (``accepted``, ``refused: ...``), and its defects."""
    reader, writer = os.pipe()
    scratch = project.parent / "tmp"
    watch.opened()
    inherited = _resident()
    child = os.fork()
    if child == 0:
        os.close(reader)
        os.setsid()
        _attempt(project, name, scratch, writer)
        os._exit(0)
    os.close(writer)
    answer, late = _answer(reader, child)
    os.close(reader)
    _, status, used = os.wait4(child, 0)
    _end_group(child)
    wrong = list(answer.get("wrong", []))
    if late:
        wrong.append(f"hangs: no end within {WALL:g} s")
    elif "outcome" not in answer:
        wrong.append(f"ended by status {os.waitstatus_to_exitcode(status)} without an answer")
    seconds = used.ru_utime + used.ru_stime
    if seconds > CPU_SECONDS:
        wrong.append(f"{seconds:.1f} s of processor time")
    if used.ru_maxrss - inherited > MEMORY:
        wrong.append(f"{(used.ru_maxrss - inherited) / 1024:.0f} MB of memory")
    if opened := sorted(set(watch.opened())):
        wrong.append(f"opened what is outside: {opened}")
    if left := sorted(path.name for path in scratch.iterdir() if not path.name.startswith("simspec-bug-")):
        wrong.append(f"left behind in the folder of temporary files: {left[:3]}")
    if list(project.rglob("pwned")):
        wrong.append("ran a command")
    return str(answer.get("outcome", "none")), wrong


def _resident() -> int:
    """The memory (kB) of this process, which a forked process has from the beginning."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024


def _answer(reader: int, child: int) -> tuple[dict[str, Any], bool]:
    until, content = time.monotonic() + WALL, b""
    while True:
        left = until - time.monotonic()
        if left <= 0 or not select.select([reader], [], [], left)[0]:
            _end_group(child)
            return {}, True
        piece = os.read(reader, 65_536)
        if not piece:
            break
        content += piece
    try:
        return dict(json.loads(content)), False
    except ValueError:
        return {}, False


def _end_group(child: int) -> None:
    try:
        os.killpg(child, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        return


def _attempt(project: Path, name: str, scratch: Path, writer: int) -> None:
    """In the child: the import, and its answer."""
    resource.setrlimit(resource.RLIMIT_CPU, (40, 41))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_DATA, (3 * 2**30,) * 2)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    os.environ["TMPDIR"] = tempfile.tempdir = str(scratch)
    os.chdir(project)
    opened: list[str] = []
    _watch_python(project, scratch, opened)
    try:
        answer = _imported(Path(name))
    except BaseException:
        answer = {"outcome": "traceback", "wrong": [traceback.format_exc()[-3000:]]}
    answer["wrong"] += [f"opened {path}" for path in sorted(set(opened))]
    with os.fdopen(writer, "w") as stream:
        stream.write(json.dumps(answer))


def _watch_python(project: Path, scratch: Path, opened: list[str]) -> None:
    """Note what Python opens of the user's files outside the project; modules and the cache are not the user's."""
    mine = str(project.parent)
    allowed = (str(project) + os.sep, str(scratch))
    unexpected = ("/etc/passwd", "/etc/shadow", "/proc/self/environ", "/dev/zero", "/root/secret")

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        if event != "open" or not isinstance(arguments[0], (str, bytes)):
            return
        path = os.path.realpath(os.fsdecode(arguments[0]))
        if path in unexpected or (path.startswith(mine) and not path.startswith(allowed)):
            opened.append(path)

    sys.addaudithook(watch)


def _imported(file: Path) -> dict[str, Any]:
    from simspec.errors import SpecError
    from simspec.language.foreign import is_foreign
    from simspec.language.load import load
    from simspec.world.canonical import sha256

    wrong: list[str] = []
    try:
        spec = load(file)
        world = spec.resolve()
        spec.warnings(world)
    except SpecError as error:
        return {"outcome": f"refused: {error.problems[0].message[:60]}", "wrong": _problem_lines(error)}
    wrong += _not_finite(world)
    if is_foreign(file.name):
        try:
            again = load(_written(spec.source.imported, file)).resolve()
        except SpecError as error:
            return {"outcome": "accepted", "wrong": [*wrong, f"accepted, and yet: {str(error)[:600]}"]}
        if sha256(again) != sha256(world):
            wrong.append("the spec that is written says another world than the file")
    else:
        spec.to_yaml()
    return {"outcome": "accepted", "wrong": wrong}


def _written(imported: Any, file: Path) -> Path:
    """The spec that the command writes, with copies of the meshes, as a file."""
    from simspec.imports.writing import copies, spec_text

    sources, called = copies(imported, Path("written-meshes"), Path())
    out = Path("written.yaml")
    out.write_text(spec_text(imported, file.name, called))
    Path("written-meshes").mkdir()
    for name, source in sources.items():
        Path("written-meshes", name).write_bytes(source.read_bytes())
    return out


def _problem_lines(error: Any) -> list[str]:
    """Defects of an error."""
    wrong = []
    text = str(error)
    if any(problem.location is None for problem in error.problems):
        wrong.append(f"a problem without a place: {text[:300]}")
    elif not all(problem.location.line >= 1 and problem.location.file for problem in error.problems):
        wrong.append(f"a place that is none: {text[:300]}")
    if len(text) > 100_000:
        wrong.append(f"an error of {len(text):,} characters")
    for word in ("Traceback", "0x7f", "Error('", "object at"):
        if word in text:
            wrong.append(f"an error in Python's words: {text[:300]}")
    return wrong


def _not_finite(world: Any) -> list[str]:
    from simspec.world.canonical import canonical_json

    text = canonical_json(world)
    found = [word for word in ("NaN", "Infinity") if word in text]
    return [f"the world has {' and '.join(found)}"] if found else []
