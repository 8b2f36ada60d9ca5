"""The importer of xacro: a program in XML that makes URDF. It is expanded in a process of its own; the rest is URDF's importer.

Elements of the expanded text remember the file and the line that they were written at, so that messages name these.
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
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from simspec import numerals
from simspec.confinement import walls
from simspec.errors import Location, Problem, SpecError
from simspec.files import NotReadableError, read_bytes
from simspec.imports.elements import INFORMATION, UNUSED, Element, outermost, parse
from simspec.imports.files import Files, is_missing
from simspec.imports.urdf.importer import ROBOT, RULES, RobotReader, is_program
from simspec.imports.urdf.links import PARENTS, WORLD
from simspec.imports.xacro import CPU_SECONDS, LARGEST_TEXT, PLACE, PLACE_NOW, SECONDS, SUFFIXES
from simspec.language.foreign import Account, Imported, ImportOptions
from simspec.processes import ELSEWHERE, isolated

# Expansion: a process computes, and requests here the files that it names.

LARGEST_ANSWER: Final = 4 * LARGEST_TEXT
"""Bytes from the process: a text of the largest size, each character escaped."""


VALUE: Final = re.compile(r"""(?:value|default)\s*=\s*(["'])([^"'<]*)\1""")
"""The value of a property or an argument: xacro reads as a number all that Python does."""
HALF: Final = re.compile(r"[\ud800-\udfff]")
"""An attribute that no file has by itself: a program can make it."""
TOO_MUCH: Final = "needs more computing time or memory than a robot takes"


@dataclass
class Expanded:
    """The expansion of a xacro file."""

    text: str
    names: list[str]
    """Files by their numbers in places, as messages call them."""
    warnings: list[tuple[Location, str]] = field(default_factory=list)
    declared: list[str] = field(default_factory=list)
    """Arguments that the files declare."""


def expand(files: Files, arguments: Mapping[str, str]) -> Expanded:
    """The text that the file expands to. Raises SpecError with file and line for all that stands in the way."""
    text = _decoded(files.content(), files.shown, Location(files.shown, 1, 1))
    for name, value in arguments.items():
        if (why := numerals.like_a_number(value)) is not None:
            raise SpecError([Problem(f"the argument {name}: {value[:40]!r} is not a number: {why}", code="I111")])
    if importlib.util.find_spec("xacro") is None:
        hint = 'pip install "simspec-physics[import]"'
        raise SpecError([Problem(f"{files.shown}: the package xacro is not installed", hint=hint, code="C110")])
    with tempfile.TemporaryFile() as memory:
        memory.write(bytes(PLACE_NOW.size))
        memory.flush()
        with mmap.mmap(memory.fileno(), PLACE_NOW.size) as now, _process(memory.fileno()) as process:
            request = {"files": [files.shown], "text": text, "arguments": dict(arguments), "seconds": CPU_SECONDS}
            request["walls"] = None if walls().calls else walls().why
            expansion = _Expansion(files, [files.shown], process, now)
            expansion.send(request)
            return expansion.answer()


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
    process: subprocess.Popen[bytes]
    now: mmap.mmap
    """The place of the element that is being expanded."""

    def send(self, message: Mapping[str, Any]) -> None:
        """A message to the process; of one that has ended, reading reports it."""
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(json.dumps(message).encode() + b"\n")
            self.process.stdin.flush()

    def answer(self) -> Expanded:
        """The expansion by the process; its questions are answered meanwhile."""
        for line in self._lines():
            try:
                said = _message(line)
            except ValueError:
                raise self._refused_now("xacro gave an answer of an unknown form") from None
            if "ask" in said:
                self._ask(said)
            elif "text" in said:
                return self._expanded(said)
            else:
                raise _refused(_whole(said.get("failed")), self._place(said.get("place")))
        raise self._refused_now(TOO_MUCH if self.process.wait() < 0 else "xacro ended without a result")

    def _expanded(self, said: Mapping[str, Any]) -> Expanded:
        text, warnings = str(said["text"]), [(self._place(place), _whole(text)) for place, text in said["warnings"]]
        half = HALF.search(text)
        if half is not None:
            raise _refused(f"expands to half a character: {half.group()!a}", Location(self.names[0], 1, 1))
        return Expanded(text, self.names, warnings, [str(name) for name in said["declared"]])

    def _lines(self) -> Iterator[bytes]:
        """Whole lines from the process, until it ends."""
        assert self.process.stdout is not None
        until, waiting, total = time.monotonic() + SECONDS, b"", 0
        descriptor = self.process.stdout.fileno()
        with selectors.DefaultSelector() as selector:
            selector.register(descriptor, selectors.EVENT_READ)
            while True:
                left = until - time.monotonic()
                if left <= 0 or not selector.select(left):
                    raise self._refused_now(TOO_MUCH)
                piece = os.read(descriptor, 2**20)
                total += len(piece)
                if not piece:
                    return
                if total > LARGEST_ANSWER:
                    raise self._refused_now("expands to too much")
                *lines, waiting = (waiting + piece).split(b"\n")
                yield from lines

    def _ask(self, said: Mapping[str, Any]) -> None:
        """Give the process a text that it requests, or say that there is no such file. Raises SpecError for all else."""
        name = _whole(said["ask"]).replace("file://package://", "package://")
        place = self._place(said.get("place"))
        element = Element("xacro:include", {"filename": name}, place, "", None)
        try:
            path = self.files.find(name, element)
        except SpecError as error:
            if not is_missing(error):
                raise
            self.send({"missing": error.problems[0].message + f": {name}"})
            return
        text = _decoded(self.files.bytes_of(path, element), path.name, place)
        self.names.append(self.files.options.shown(path))
        self.send({"text": text})

    def _place(self, place: Any) -> Location:
        numbers = isinstance(place, list) and len(place) == 2 and all(isinstance(entry, int) for entry in place)
        number, line = place if numbers else (0, 1)
        return Location(self.names[number if 0 <= number < len(self.names) else 0], max(1, int(line)), 1)

    def _refused_now(self, why: str) -> SpecError:
        return _refused(why, self._place(list(PLACE_NOW.unpack_from(self.now, 0))))


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
            raise _refused(f"{found[2][:40]!r} is not a number: {why}", Location(name, line, 1))
    return text


def _whole(value: object) -> str:
    """A text from the process, in which half a character is a question mark: such a text could not be printed."""
    return HALF.sub("?", str(value))


def _message(line: bytes) -> dict[str, Any]:
    """The answer of the process, of the form that child.py documents. Raises ValueError for all else."""
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
        if not all(isinstance(warning, list) and len(warning) == 2 for warning in warnings):
            raise ValueError("no warnings")
    return message


def _refused(why: str, place: Location) -> SpecError:
    return SpecError([Problem(f"xacro: {why}", location=place, code="I111")])


ARGUMENT: Final = "xacro:arg"
MOST_NAMED: Final = 12
"""Arguments that a message lists."""
MANY: Final = ", "
_USE: Final = re.compile(rb"\$\(arg\s+([^\s()]{1,80})\s*\)")
_NO_VALUE: Final = re.compile(r"the argument '([^']{1,80})' has no value")
EXPANDED: Final = "expanded text of"
"""The text before the name of a file in places that are of no file."""
SCHEMES: Final = ("file://package://", "file:///package://")
"""How files of packages are named where `$(find PACKAGE)` stands in a URL."""


class XacroImporter:
    """Reads xacro by expanding it."""

    NAME: Final = "xacro"
    SUFFIXES = SUFFIXES

    def recognises(self, content: bytes) -> bool:
        """Whether a file of URDF has what xacro is to expand."""
        return outermost(content) == ROBOT and is_program(content)

    def rules(self) -> Mapping[str, str]:
        """Rules of repair, with what they do: those of what it expands to."""
        return RULES

    def read(self, path: Path, shown: str, options: ImportOptions) -> Imported:
        """The robot as a model file. Raises SpecError with file and line, also for what the program does not end of."""
        files = Files(path, shown, options)
        try:
            expanded = expand(files, options.arguments)
        except SpecError as error:
            raise _with_arguments(error, files) from None
        _check_arguments(expanded, files, options)
        root = parse(expanded.text.encode(), f"{EXPANDED} {shown}")
        _place(root, expanded)
        if root.tag != "robot":
            raise root.error(
                "does not expand to URDF: the outermost element is not <robot>", root.tag[:80], "robot", code="I111"
            )
        if not root.look("link"):
            message, hint = (
                "is a library: it expands to no links",
                "import the file that includes it and places its macros",
            )
            raise SpecError([Problem(f"{shown} {message}", location=root.location, hint=hint, code="I111")])
        if PARENTS not in options.repairs:
            _check_whole(root, shown)
        files.looks_above = True
        imported = RobotReader(root, files).imported()
        for place, text in expanded.warnings:
            imported.accounts.append(Account(place, "xacro", UNUSED, INFORMATION, f"xacro warns: {text}"))
        imported.read.update(files.read)
        return imported


def _is_place(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= numerals.MOST_DIGITS


def _place(root: Element, expanded: Expanded) -> None:
    """Give every element the place that it was written at; one that a program made keeps that in the expanded text."""
    waiting = [root]
    while waiting:
        element = waiting.pop()
        number, _, line = element.attributes.pop(PLACE, "").partition(":")
        if _is_place(number) and _is_place(line) and int(number) < len(expanded.names):
            element.location = Location(expanded.names[int(number)], max(1, int(line)), 1)
        for name, value in element.attributes.items():
            for scheme in SCHEMES:
                if value.startswith(scheme):
                    element.attributes[name] = value.replace(scheme, "package://", 1)
        waiting.extend(element.look())


def _check_arguments(expanded: Expanded, files: Files, options: ImportOptions) -> None:
    """An argument that no file declares or uses is an error: it would be without effect."""
    unknown = [name for name in options.arguments if name not in expanded.declared]
    if not unknown:
        return
    known = {
        *expanded.declared,
        *{name.decode(errors="replace") for content in _texts(files) for name in _USE.findall(content)},
    }
    problems = [
        Problem(
            f"{files.shown}: no argument is called {name!r}", allowed=MANY.join(sorted(known)) or "none", code="I111"
        )
        for name in unknown
        if name not in known
    ]
    if problems:
        raise SpecError(problems)


def _texts(files: Files) -> Iterator[bytes]:
    for path in list(files.read):
        with contextlib.suppress(NotReadableError, OSError):
            yield read_bytes(path, LARGEST_TEXT, links=True)


def _with_arguments(error: SpecError, files: Files) -> SpecError:
    """The same error, which says of an argument without a value how it is given, and which arguments the files declare."""
    problem = error.problems[0]
    missing = _NO_VALUE.search(problem.message)
    if missing is None:
        return error
    declared = _declared(files)
    listed = [f"{name}={default}" for name, default in declared.items()]
    hint = f"--arg {missing.group(1)}=VALUE, or in a scenario import: {{arguments: {{{missing.group(1)}: VALUE}}}}"
    allowed = f"{MANY.join(listed[:MOST_NAMED])}{' ...' if len(listed) > MOST_NAMED else ''}" or "none is declared"
    return SpecError([replace(problem, allowed=allowed, hint=hint)])


def _declared(files: Files) -> dict[str, str]:
    found: dict[str, str] = {}
    for content in _texts(files):
        try:
            root = parse(content, files.shown)
        except SpecError:
            continue  # not XML, such as a table of sizes
        for element in root.within():
            if element.tag == ARGUMENT and element.has("name"):
                found.setdefault(element.attributes["name"][:60], element.attributes.get("default", ""))
    return found


def _check_whole(root: Element, shown: str) -> None:
    """Refuse what is a part: all its links hang on links of the file that includes it."""
    links = {link.attributes.get("name", "").strip() for link in root.look("link")}
    ends = [(_end(joint, "parent"), _end(joint, "child")) for joint in root.look("joint")]
    above = {child: parent for parent, child in ends}
    missing = sorted({parent for parent in above.values() if parent not in links and parent not in above})
    if not missing or missing == [WORLD] or not links <= above.keys():
        return
    message = f"{shown} is a part: its joints lead from {', '.join(missing[:4])}, which it does not have"
    hint = f"import the file that includes it; simspec import --repair {PARENTS}: {RULES[PARENTS]}"
    raise SpecError([Problem(message, location=root.location, hint=hint, code="I111")])


def _end(joint: Element, tag: str) -> str:
    return next((part.attributes.get("link", "").strip() for part in joint.look(tag)), "")
