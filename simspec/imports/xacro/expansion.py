"""A xacro file as the text that it expands to: a process of its own computes, and asks here for the files that it names.

What the process may not do it cannot do (``child.py``): it has no files, no network and no environment. Which texts it gets is
decided by :class:`simspec.imports.files.Files`, as for every other foreign file.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import mmap
import os
import re
import selectors
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from simspec import numerals
from simspec.confinement import walls
from simspec.errors import Location, Problem, SpecError
from simspec.imports.elements import Element
from simspec.imports.files import Files, is_missing
from simspec.imports.xacro.limits import CPU_SECONDS, LARGEST_TEXT, PLACE_NOW, SECONDS
from simspec.isolated import ELSEWHERE, isolated

LARGEST_ANSWER: Final = 4 * LARGEST_TEXT
"""Bytes from the process: a text of the largest size, each character escaped."""


VALUE: Final = re.compile(r"""(?:value|default)\s*=\s*(["'])([^"'<]*)\1""")
"""What a property or an argument is given: xacro reads as a number what Python does."""
HALF: Final = re.compile(r"[\ud800-\udfff]")
"""What no file holds by itself: a program can make it."""
TOO_MUCH: Final = "needs more computing time or memory than a robot takes"


@dataclass
class Expanded:
    """What a xacro file expands to."""

    text: str
    names: list[str]
    """Files by their numbers in places, as messages call them."""
    warnings: list[tuple[Location, str]] = field(default_factory=list)
    declared: list[str] = field(default_factory=list)
    """Arguments that the files declare."""


def expand(files: Files, arguments: Mapping[str, str]) -> Expanded:
    """The text that the file expands to. Raises SpecError with file and line for all that stands in the way."""
    text = _decoded(files.content(), files.shown, Location(files.shown, 1, 1))
    expansion = _Expansion(files, [files.shown])
    for name, value in arguments.items():
        if (why := numerals.like_a_number(value)) is not None:
            raise SpecError([Problem(f"the argument {name}: {value[:40]!r} is no number: {why}")])
    if importlib.util.find_spec("xacro") is None:
        hint = 'pip install "simspec[import]"'
        raise SpecError([Problem(f"{files.shown}: the package xacro is not installed", hint=hint)])
    with tempfile.TemporaryFile() as memory:
        memory.write(bytes(PLACE_NOW.size))
        memory.flush()
        with mmap.mmap(memory.fileno(), PLACE_NOW.size) as now, _process(memory.fileno()) as process:
            request = {"files": expansion.names, "text": text, "arguments": dict(arguments), "seconds": CPU_SECONDS}
            request["walls"] = None if walls().calls else walls().why
            expansion.send(process, request)
            return expansion.answer(process, now)


@contextlib.contextmanager
def _process(memory: int) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        isolated("-m", "simspec.imports.xacro.child", str(memory)),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={},
        cwd=ELSEWHERE,
        pass_fds=(memory,),
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()


@dataclass
class _Expansion:
    """The talk with the process of one file."""

    files: Files
    names: list[str]

    def send(self, process: subprocess.Popen[bytes], message: Mapping[str, Any]) -> None:
        """A message to the process; of one that has ended, reading tells."""
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps(message).encode() + b"\n")
            process.stdin.flush()

    def answer(self, process: subprocess.Popen[bytes], now: mmap.mmap) -> Expanded:
        """What the process makes of the file; its questions are answered meanwhile."""
        for line in self._lines(process, now):
            try:
                said = _message(line)
            except ValueError:
                raise _refused("xacro gave an answer of an unknown form", self._now(now)) from None
            if "ask" in said:
                self._ask(process, said)
            elif "text" in said:
                return self._expanded(said)
            else:
                raise _refused(_whole(said.get("failed")), self._place(said.get("place")))
        code = process.wait()
        why = TOO_MUCH if code < 0 else "xacro ended without a result"
        raise _refused(why, self._now(now))

    def _expanded(self, said: Mapping[str, Any]) -> Expanded:
        text, warnings = str(said["text"]), [(self._place(place), _whole(text)) for place, text in said["warnings"]]
        half = HALF.search(text)
        if half is not None:
            raise _refused(f"expands to half a character: {half.group()!a}", Location(self.names[0], 1, 1))
        return Expanded(text, self.names, warnings, [str(name) for name in said["declared"]])

    def _lines(self, process: subprocess.Popen[bytes], now: mmap.mmap) -> Iterator[bytes]:
        """Whole lines from the process, until it ends."""
        assert process.stdout is not None
        until, waiting, total = time.monotonic() + SECONDS, b"", 0
        descriptor = process.stdout.fileno()
        with selectors.DefaultSelector() as selector:
            selector.register(descriptor, selectors.EVENT_READ)
            while True:
                left = until - time.monotonic()
                if left <= 0 or not selector.select(left):
                    raise _refused(TOO_MUCH, self._now(now))
                piece = os.read(descriptor, 2**20)
                total += len(piece)
                if not piece:
                    return
                if total > LARGEST_ANSWER:
                    raise _refused("expands to too much", self._now(now))
                *lines, waiting = (waiting + piece).split(b"\n")
                yield from lines

    def _ask(self, process: subprocess.Popen[bytes], said: Mapping[str, Any]) -> None:
        """Give the process a text that it asks for, or say that there is no such file. Raises SpecError for all else."""
        name = _whole(said["ask"]).replace("file://package://", "package://")
        place = self._place(said.get("place"))
        element = Element("xacro:include", {"filename": name}, place, "", None)
        try:
            path = self.files.find(name, element)
        except SpecError as error:
            if not is_missing(error):
                raise
            self.send(process, {"missing": error.problems[0].message + f": {name}"})
            return
        text = _decoded(self.files.bytes_of(path, element), path.name, place)
        self.names.append(self.files.options.shown(path))
        self.send(process, {"text": text})

    def _place(self, place: Any) -> Location:
        numbers = isinstance(place, list) and len(place) == 2 and all(isinstance(one, int) for one in place)
        number, line = place if numbers else (0, 1)
        return Location(self.names[number if 0 <= number < len(self.names) else 0], max(1, int(line)), 1)

    def _now(self, now: mmap.mmap) -> Location:
        return self._place(list(PLACE_NOW.unpack_from(now, 0)))


def _decoded(content: bytes, name: str, place: Location) -> str:
    if len(content) > LARGEST_TEXT:
        raise _refused(f"{name}: the file is too large", place)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise _refused(f"{name}: not UTF-8", place) from None
    for found in () if text.isascii() else VALUE.finditer(text):
        if (why := numerals.like_a_number(found[2])) is not None:
            line = 1 + text.count("\n", 0, found.start())
            raise _refused(f"{found[2][:40]!r} is no number: {why}", Location(name, line, 1))
    return text


def _whole(value: object) -> str:
    """A text from the process, in which half a character is a question mark: such a text could not be printed."""
    return HALF.sub("?", str(value))


def _message(line: bytes) -> dict[str, Any]:
    """What the process says, of the form that child.py documents. Raises ValueError for all else."""
    try:
        message = json.loads(line)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if not isinstance(message, dict) or not {"ask", "text", "failed"} & message.keys():
        raise ValueError("no message")
    if "text" in message:
        warnings, declared = message.get("warnings"), message.get("declared")
        if not isinstance(declared, list) or not isinstance(warnings, list):
            raise ValueError("no result")
        if not all(isinstance(one, list) and len(one) == 2 for one in warnings):
            raise ValueError("no warnings")
    return message


def _refused(why: str, place: Location) -> SpecError:
    return SpecError([Problem(f"xacro: {why}", location=place)])
