"""The engines that installed packages offer (entry points ``simspec.engines``), the labels that stand for them, and their
versions, here and in other interpreters."""

from __future__ import annotations

import difflib
import functools
import json
import os
import platform
import re
import selectors
import shutil
import signal
import subprocess
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from types import MappingProxyType
from typing import IO, TYPE_CHECKING, Any

from simspec.errors import EngineError, Problem, SpecError, clipped, visible
from simspec.plugins import Plugins
from simspec.plugins import requirements as simspec_requirements
from simspec.processes import ELSEWHERE, search_environment, with_search_path
from simspec.support.declarations import is_wholly_before

if TYPE_CHECKING:
    from simspec.engines.kit.compiled import Needs
    from simspec.engines.kit.contract import Engine

# A *label* stands for an engine everywhere: in options of the command line, runs, certificates and tables. ``NAME`` is what
# is installed here; ``NAME@3.8`` is version 3.8 of it, wherever that is.

MARK = "@"
VERSION = re.compile(r"[0-9][0-9A-Za-z.+_-]{0,39}")
"""The form of a version in a label: it is a part of folders' names."""


STATED = re.compile(r"(?=[^0-9]*[0-9])[0-9A-Za-z][0-9A-Za-z .+_~!-]{0,63}")
"""The form of an engine's version that an interpreter or a process states: it stands in tables, keys and certificates."""


@dataclass(frozen=True, slots=True)
class EngineId:
    """An engine by name; ``version`` is the beginning of its version (``3.8`` for 3.8.1) or empty for any; ``python`` is the
    interpreter that has it, None for this one."""

    name: str
    version: str = ""
    python: str | None = None

    @property
    def label(self) -> str:
        """The name, or name and version: ``NAME@3.8``."""
        return f"{self.name}{MARK}{self.version}" if self.version else self.name


def parse(word: str) -> EngineId:
    """The engine that a word of the command line names: ``NAME``, ``NAME@VERSION``, each with ``=PYTHON`` or without. Raises
    SpecError for what is no version."""
    label, equals, python = word.partition("=")
    name, mark, version = label.partition(MARK)
    if (mark and not VERSION.fullmatch(version)) or (equals and not python) or not name:
        raise SpecError(
            [
                Problem(
                    f"{word!r} contains no engine name",
                    allowed="NAME, NAME@VERSION, NAME@VERSION=/path/to/python",
                    code="E107",
                )
            ]
        )
    return EngineId(name, version, python if equals else None)


def program_of(python: str) -> str:
    """The path that starts the interpreter ``python`` from any folder: a name alone is sought on the path, as a shell does."""
    return os.path.abspath(python) if os.sep in python else shutil.which(python) or python


def engine_name(label: str) -> str:
    """The name of the engine that a label stands for."""
    return label.partition(MARK)[0]


def engine_version(label: str) -> str:
    """The version that a label names, or its beginning; empty where it names none."""
    return label.partition(MARK)[2]


def other_version(label: str, version: str) -> str | None:
    """Why an engine of ``version`` is not what its label says; None when it is."""
    wanted = engine_version(label)
    if not wanted or re.match(re.escape(wanted) + r"(?![0-9A-Za-z])", version):
        return None
    way = f"simspec engines install {label} makes an environment with it"
    return (
        f"is version {version}, not {wanted}; {way}, --engine {label}=/path/to/python names an interpreter that has it"
    )


def demand_version(label: str, version: str) -> None:
    """Raise EngineError where an engine that is at work is not of the version that its label says."""
    if (why := other_version(label, version)) is not None:
        raise EngineError(label, why)


DECLARED = ("NAME", "DIALECT", "DISTRIBUTION", "EXTRA", "SUPPORT", "SETTINGS", "RULES", "LAYERS")
"""Required attributes of an engine's class."""


def _sound(name: str, engine: Any) -> type[Engine]:
    """The engine, if it is one that can be used. Raises TypeError, ValueError."""
    from simspec.dialects.kit.contract import dialects
    from simspec.engines.kit.contract import Engine

    if not (isinstance(engine, type) and issubclass(engine, Engine)):
        raise TypeError("it is not an Engine")
    missing = [word for word in DECLARED if not hasattr(engine, word)]
    if missing:
        raise ValueError(f"it does not define {', '.join(missing)}")
    if name != engine.NAME:
        raise ValueError(f"its NAME is {engine.NAME!r}")
    if engine.DIALECT not in dialects():
        raise ValueError(f"its DIALECT is {engine.DIALECT!r}, which is not a dialect")
    dialects()[engine.DIALECT].check_declared(engine.SETTINGS)
    engine.version()
    return engine


@functools.cache
def engines() -> Plugins[type[Engine]]:
    """Every known engine by name (entry points ``simspec.engines``), installed or not."""
    return Plugins("simspec.engines", _sound)


@functools.cache
def auditors() -> Plugins[type[Engine]]:
    """Engines by whose loaders ``simspec audit`` reads robot files, and in which simspec runs no world (entry points
    ``simspec.auditors``), by name. Their ``SUPPORT`` refuses every feature with the reason."""
    return Plugins("simspec.auditors", _sound)


def loaders() -> dict[str, type[Engine]]:
    """Every known engine that may load robot files: :func:`engines`, then :func:`auditors`."""
    return {**engines(), **auditors()}


def format_of(engine: type[Engine]) -> str:
    """The name of the format that an engine reads."""
    from simspec.dialects.kit.contract import dialects

    return dialects()[engine.DIALECT].FORMAT


def find_engine(name: str) -> type[Engine]:
    """The engine that a name or label (``identity.py``) stands for. Raises EngineError naming the known ones."""
    word = engine_name(name)
    found = engines().get(word) or auditors().get(word)
    if found is None:
        why = engines().broken().get(word) or auditors().broken().get(word)
        known = list(loaders())
        similar = difflib.get_close_matches(word, known, 1)
        hint = f"; did you mean {similar[0]!r}?" if similar else ""
        raise EngineError(name, why or f"no such engine; known: {', '.join(known)}{hint}")
    return found


# The engines that can be used, by label, and how others are installed.


def how_to_install(engine: type[Engine]) -> str:
    """The words that install an engine: of pip, of Debian's apt-get, what no package brings, or several of these."""
    words = (pip_words(engine), apt_words(engine.NEEDS), engine.NEEDS.elsewhere)
    return " and ".join(command for command in words if command)


def not_installed(engine: type[Engine]) -> str:
    """That an engine is not installed, what is missing where that is known, and how to install it."""
    lacking = engine.NEEDS.lacking()
    why = f" ({str(lacking[0]).splitlines()[0].removeprefix(f'{engine.NAME}: ')})" if lacking else ""
    how = how_to_install(engine)
    return f"not installed{why}" + (f": {how}" if how else "")


def pip_words(engine: type[Engine]) -> str:
    """The command that installs its packages of Python, here or in an environment of its own; empty where there are none."""
    if engine.SEPARATE_VERSION:
        return f"simspec engines install {engine.NAME} --yes"
    return f"pip install 'simspec-physics[{engine.EXTRA}]'" if engine.EXTRA else ""


def apt_words(needs: Needs) -> str:
    """The command that installs its packages of Debian; empty where there are none."""
    return f"apt-get install {' '.join(needs.packages)}" if needs.debian else ""


def why_not(engine: type[Engine], environment: dict[str, str] | None = None) -> str | None:
    """Why ``engine`` cannot be installed here: the requirement of its extra whose marker rules this Python out. None when it
    can be, or when simspec's metadata say nothing of it (an engine of a third party). ``environment`` overrides markers."""
    found = None
    if not engine.EXTRA:
        return None
    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    for line in simspec_requirements():
        requirement = Requirement(line)
        marker = requirement.marker
        if canonicalize_name(requirement.name) != canonicalize_name(engine.DISTRIBUTION) or marker is None:
            continue
        if f'"{engine.EXTRA}"' not in str(marker):
            continue
        if marker.evaluate({**(environment or {}), "extra": engine.EXTRA}):
            return None
        version = (environment or {}).get("python_version") or platform.python_version()
        rule = str(marker).replace(f' and extra == "{engine.EXTRA}"', "")
        found = f"cannot be installed on Python {version}: {requirement.name} has no wheels but for {rule}"
    return found


def left_out(environment: dict[str, str] | None = None) -> dict[str, str]:
    """The known engines that are not installed and cannot be on this Python, each with the reason."""
    return {
        name: why
        for name, engine in engines().items()
        if engine.version() is None and (why := why_not(engine, environment)) is not None
    }


PATIENCE = 30.0
"""s that all interpreters together may take to give their versions: a cold disk needs a few."""
MOST_OUTPUT = 64_000
"""Bytes that an interpreter may write for it."""
MOST_REASON = 200
"""Characters of its last line that a reason quotes."""
_ASK = """
import importlib.metadata, json, sys
def first(names):
    for name in names:
        try:
            return importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            pass
version, numpy = first(sys.argv[1:]), first(["numpy"])
print()
print(json.dumps({"version": version, "numpy": numpy}))
"""


class NoVersionError(ValueError):
    """An interpreter gave no version; the message is the reason."""


@dataclass(frozen=True)
class EngineInstance:
    """An engine by ``label``. ``version``: None where it cannot be used, for the reason ``problem``; ``python``: its
    interpreter, None for this one; ``numpy``: the version of numpy in it, None where there is none."""

    label: str
    engine: str
    version: str | None
    python: str | None
    dialect: str
    format: str
    problem: str | None = None
    numpy: str | None = None


def instances(
    interpreters: Mapping[str, str],
    labels: Iterable[str] = (),
    not_queried: Mapping[str, str] = MappingProxyType({}),
) -> list[EngineInstance]:
    """Every known engine and its versions that ``interpreters`` (by label) and ``labels`` name.

    Interpreters are queried in parallel, within ``PATIENCE``; one that gives no version is an instance with a problem.
    ``not_queried``: labels whose interpreter is not started, each with the reason, which is the problem of its instance.
    """
    named = dict.fromkeys([*interpreters, *not_queried, *labels])
    ordered = [
        word for name in loaders() for word in dict.fromkeys([name, *(w for w in named if engine_name(w) == name)])
    ]
    ends = time.monotonic() + PATIENCE
    with ExitStack() as stack:
        requested = {
            label: stack.enter_context(_started(interpreters[label], find_engine(label)))
            for label in ordered
            if label in interpreters and label not in not_queried
        }
        return [
            _closed(label, not_queried[label])
            if label in not_queried
            else _instance(label, interpreters.get(label), requested.get(label), ends)
            for label in ordered
        ]


def _closed(label: str, why: str) -> EngineInstance:
    """An engine whose interpreter is not started."""
    engine = find_engine(label)
    return EngineInstance(label, engine.NAME, None, None, engine.DIALECT, format_of(engine), why)


def _instance(label: str, python: str | None, interpreter: _Started | None, ends: float) -> EngineInstance:
    engine = find_engine(label)
    version, numpy, problem = None, None, None
    try:
        if interpreter is None:
            import numpy as np  # slow to import, and needed here alone

            version, numpy = engine.version(), np.__version__
        else:
            version, numpy = _answer(interpreter, ends)
        if not engine.distributions():
            version = engine.version()  # the machine's, whatever the interpreter
    except NoVersionError as error:
        problem = f"{python} {error}"
    else:
        if version is None:
            problem = _how_to_install(engine) if interpreter is None else _not_there(python, engine)
        else:
            problem = other_version(label, version) or too_old(engine, version)
    return EngineInstance(label, engine.NAME, version, python, engine.DIALECT, format_of(engine), problem, numpy)


@functools.cache
def version_in(python: str, label: str) -> str:
    """The version of an engine in the interpreter ``python``, which is queried once in the life of this process. Raises
    EngineError where it gives none, or another than the label names."""
    ends = time.monotonic() + PATIENCE
    with _started(python, find_engine(label)) as interpreter:
        instance = _instance(label, python, interpreter, ends)
    if instance.version is None or instance.problem is not None:
        raise EngineError(label, instance.problem or "gave no version")
    return instance.version


def version_of(label: str, python: str | None) -> str | None:
    """The version of an engine in an interpreter, None: this one; None where it is not there."""
    return find_engine(label).version() if python is None else version_in(python, label)


def too_old(engine: type[Engine], version: str) -> str | None:
    """Why a release of an engine is of no use: it does not read what simspec writes. None where it does."""
    if not engine.OLDEST or not is_wholly_before(version, engine.OLDEST):
        return None
    return f"is version {version}; {engine.TITLE or engine.NAME} reads the files that simspec writes from {engine.OLDEST} on"


def _not_there(python: str | None, engine: type[Engine]) -> str:
    return f"{python} does not have {engine.DISTRIBUTION}" if engine.DISTRIBUTION else not_installed(engine)


def _how_to_install(engine: type[Engine]) -> str:
    return left_out().get(engine.NAME) or not_installed(engine)


_Started = subprocess.Popen[bytes] | NoVersionError
"""An interpreter at work, or why it could not be started."""


@contextmanager
def _started(python: str, engine: type[Engine]) -> Iterator[_Started]:
    """The interpreter ``python``, started; nothing of it is left at the end of the block."""
    try:
        process = subprocess.Popen(
            with_search_path("-c", _ASK, *engine.distributions(), python=program_of(python)),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=ELSEWHERE,
            env=search_environment(os.environ),  # as an engine's process has it
            start_new_session=True,
        )
    except (OSError, ValueError) as error:
        yield NoVersionError(f"cannot be started: {getattr(error, 'strerror', None) or error}")
        return
    try:
        yield process
    finally:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def _answer(interpreter: _Started, ends: float) -> tuple[str | None, str | None]:
    """The versions of the engine and of numpy that an interpreter gives; None: it does not have it. Raises NoVersionError."""
    if isinstance(interpreter, NoVersionError):
        raise interpreter
    if interpreter.stdout is None:
        raise AssertionError("started with a pipe")
    lines = _output(interpreter.stdout, ends).decode(errors="replace").strip().splitlines() or [""]
    try:
        code = interpreter.wait(max(0.0, ends - time.monotonic()))
    except subprocess.TimeoutExpired:
        raise NoVersionError(f"gave no version within {PATIENCE:g} s") from None
    try:
        answer = json.loads(lines[-1])
    except (ValueError, RecursionError):
        answer = None
    version = answer.get("version", answer) if isinstance(answer, dict) else answer
    if code or not isinstance(answer, dict) or not (version is None or isinstance(version, str)):
        said = f": {clipped(visible(lines[-1]), MOST_REASON)}" if lines[-1] else ""
        raise NoVersionError(f"gave no version, exit code {code}{said}")
    if version is not None and STATED.fullmatch(version) is None:
        raise NoVersionError(f"gave no version: {clipped(visible(version), MOST_REASON)}")
    numpy = answer.get("numpy")
    return version, numpy if isinstance(numpy, str) else None


def _output(pipe: IO[bytes], ends: float) -> bytes:
    """The output of a process until it ends. Raises NoVersionError where that is too much, or takes too long."""
    output = b""
    with selectors.DefaultSelector() as selector:
        selector.register(pipe, selectors.EVENT_READ)
        while selector.select(max(0.0, ends - time.monotonic())):
            block = os.read(pipe.fileno(), MOST_OUTPUT)
            output += block
            if not block:
                return output
            if len(output) > MOST_OUTPUT:
                raise NoVersionError(f"wrote more than {MOST_OUTPUT:,} bytes instead of a version")
    raise NoVersionError(f"gave no version within {PATIENCE:g} s")
