"""The importer of xacro: a program in XML that makes URDF. It is expanded in a process of its own; the rest is URDF's importer.

Elements of the expanded text remember the file and the line that they were written at, so that messages name these.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from simspec import numerals
from simspec.errors import Location, Problem, SpecError
from simspec.imports.elements import Element, outermost, parse
from simspec.imports.files import Files
from simspec.imports.urdf.importer import ROBOT, is_program
from simspec.imports.urdf.robot import RULES, robot
from simspec.imports.urdf.tree import PARENTS, WORLD
from simspec.imports.xacro.expansion import Expanded, expand
from simspec.imports.xacro.limits import LARGEST_TEXT, PLACE
from simspec.language.foreign import Account, Fate, Imported, ImportOptions, Severity
from simspec.reading import NotReadableError, read_bytes

ARGUMENT: Final = "xacro:arg"
MOST_NAMED: Final = 12
"""Arguments that a message lists."""
MANY: Final = ", "
_USE: Final = re.compile(rb"\$\(arg\s+([^\s()]{1,80})\s*\)")
_NO_VALUE: Final = re.compile(r"the argument '([^']{1,80})' has no value")
EXPANDED: Final = "expanded text of"
"""What stands before the name of a file in places that are of no file."""
SCHEMES: Final = ("file://package://", "file:///package://")
"""How files of packages are named where `$(find PACKAGE)` stands in a URL."""


class Xacro:
    """Reads xacro by expanding it."""

    NAME: Final = "xacro"
    SUFFIXES: Final = (".xacro", ".urdf", ".xml")

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
        _check_kind(root, shown)
        if PARENTS not in options.repairs:
            _check_whole(root, shown)
        files.looks_above = True
        imported = robot(root, files, options)
        imported.accounts += [_warning(place, text) for place, text in expanded.warnings]
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
    known = {*expanded.declared, *_used(files)}
    problems = [
        Problem(f"{files.shown}: no argument is called {name!r}", allowed=MANY.join(sorted(known)) or "none")
        for name in unknown
        if name not in known
    ]
    if problems:
        raise SpecError(problems)


def _used(files: Files) -> set[str]:
    """The arguments that the files use which were read."""
    return {name.decode(errors="replace") for content in _texts(files) for name in _USE.findall(content)}


def _texts(files: Files) -> Iterator[bytes]:
    """The contents of the files that were read, as far as they can be read again."""
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
    told = [
        f"{name}={default}" if default is not None else f"{name} (no default)" for name, default in declared.items()
    ]
    hint = f"--arg {missing.group(1)}=VALUE, or in a scenario import: {{arguments: {{{missing.group(1)}: VALUE}}}}"
    allowed = f"{MANY.join(told[:MOST_NAMED])}{' ...' if len(told) > MOST_NAMED else ''}" or "none is declared"
    return SpecError([replace(problem, allowed=allowed, hint=hint)])


def _declared(files: Files) -> dict[str, str]:
    """The arguments that the files declare which were read so far, each with its default."""
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


def _check_kind(root: Element, shown: str) -> None:
    """Refuse what expands to no robot."""
    if root.tag != "robot":
        raise root.error("does not expand to URDF: the outermost element is not <robot>", root.tag[:80], "robot")
    if not root.look("link"):
        hint = "import the file that includes it and places its macros"
        raise SpecError([Problem(f"{shown} is a library: it expands to no links", location=root.location, hint=hint)])


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
    raise SpecError([Problem(message, location=root.location, hint=hint)])


def _end(joint: Element, tag: str) -> str:
    return next((part.attributes.get("link", "").strip() for part in joint.look(tag)), "")


def _warning(place: Location, text: str) -> Account:
    return Account(place, "xacro", Fate.UNUSED, Severity.INFORMATION, f"xacro warns: {text}")
