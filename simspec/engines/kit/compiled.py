"""Parts of an engine in C or C++: a library or a program of a few sources, compiled on first use and kept in the cache.

Compiler and libraries are the machine's own. The key of what is kept is a hash of the sources, the flags, the compiler with its
version, and the versions of the libraries, so that a change of any of these compiles anew and nothing else does. Runs in an
engine's process too, in whatever interpreter: no package but the standard library is imported.
"""

from __future__ import annotations

import contextlib
import ctypes
import enum
import functools
import hashlib
import json
import os
import platform
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from simspec.errors import EngineError
from simspec.outputs.files import built, cache_folder
from simspec.processes import ELSEWHERE, isolated

SCHEMA = 1
"""Of the key."""
DEADLINE = 300.0
"""s that a compiler may take: a hundred times what the sources of an engine take, which are a few hundred lines."""
PATIENCE = 20.0
"""s that a compiler may take to say its version, or pkg-config to answer: a thousand times what they take."""
MOST_SAID = 2000
"""Characters of what a compiler says that an error quotes: its first error, and some of the next."""
MOST_READ = 65536
"""Bytes of it that are read."""
COMPILERS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "C": ("CC", ("cc", "gcc", "clang")),
    "C++": ("CXX", ("c++", "g++", "clang++")),
}
"""By language the environment variable that names the compiler, as make knows it, and the names that are sought else."""
HEADER = re.compile(r"fatal error: '?([^'\n]+?)'?(?:: No such file or directory| file not found)")
"""GCC's and Clang's words, in the locale C."""
LIBRARY = re.compile(r"cannot find -l(\S+?):?(?:\s|$)|library (?:not found for -l|'?-l)(\S+?)'?(?:\s|$)")
"""The same of GNU's linker and others'."""


class Missing(enum.Enum):
    """Why something could not be compiled."""

    COMPILER = "no compiler"
    PKG_CONFIG = "no pkg-config"
    PACKAGE = "no such library"
    """pkg-config does not know it: its development files are not installed, or they are too old."""
    HEADER = "no such header"
    LIBRARY = "nothing to link with"
    SOURCE = "compile error"
    TIME = "no result in time"
    PLACE = "no place to keep it"
    LOADS = "does not load"


class CompileError(EngineError):
    """A part of an engine could not be compiled, or loaded, for the reason ``missing``."""

    def __init__(self, engine: str, missing: Missing, message: str):
        self.missing = missing
        super().__init__(engine, message)


@dataclass(frozen=True)
class NativeBinary:
    """A library, or a program, that an engine compiles for itself.

    ``engine``: its name, for errors. ``name``: of its folder in the cache. ``sources``: files of the engine's package.
    ``language``: "C" or "C++". ``headers``: further files that the sources include, and that the key depends on.
    ``packages``: names for pkg-config, with a bound where one is needed (``"NAME >= 0.16"``). ``flags``: for the compiler,
    before the sources; ``links``: after them, for libraries without pkg-config. ``program``: an executable, and no library.
    """

    engine: str
    name: str
    sources: tuple[Path, ...]
    language: str = "C"
    headers: tuple[Path, ...] = ()
    packages: tuple[str, ...] = ()
    flags: tuple[str, ...] = ("-O2",)
    links: tuple[str, ...] = ()
    program: bool = False

    def file(self, deadline: float = DEADLINE) -> Path:
        """The compiled file; it is compiled where the cache does not have it. Raises CompileError, whose message has the
        compiler's words, where it cannot be, or takes longer than ``deadline`` (s)."""
        return self._file(deadline)

    def load(self, deadline: float = DEADLINE) -> ctypes.CDLL:
        """The library, loaded into this process. One that does not load, since it was damaged or the library that it needs has
        been replaced by another of the same version, is compiled once more. Raises CompileError."""
        file = self._file(deadline)
        try:
            return ctypes.CDLL(str(file))
        except OSError:
            file = self._file(deadline, anew=True)
        try:
            return ctypes.CDLL(str(file))
        except OSError as error:
            raise self._error(Missing.LOADS, f"its library {file} does not load: {error}") from None

    def check(self, deadline: float = DEADLINE) -> None:
        """Compile it, and load a library in a process of its own: the libraries of two engines may clash in one process, which
        they never leave. Raises CompileError as :meth:`load` does."""
        file = self._file(deadline)
        if self.program or not _why_not_loaded(file, deadline):
            return
        file = self._file(deadline, anew=True)
        if why := _why_not_loaded(file, deadline):
            raise self._error(Missing.LOADS, f"its library {file} does not load: {why}")

    def lacking(self) -> CompileError | None:
        """Why it cannot be compiled here, as far as that is known without doing it; None where nothing is known to lack."""
        try:
            _recipe(self, tuple(sorted(os.environ.items())))
        except CompileError as error:
            return error
        return None

    def _file(self, deadline: float, anew: bool = False) -> Path:
        recipe = _recipe(self, tuple(sorted(os.environ.items())))
        folder = cache_folder("compiled")
        if folder is None:
            raise self._error(Missing.PLACE, "there is no cache folder: set XDG_CACHE_HOME to one")
        place = folder / self.name / (recipe.key if self.program else f"{recipe.key}.so")
        try:
            return built(place, lambda part: self._compile(recipe, part, deadline), 2.0 * deadline, anew)
        except TimeoutError as error:
            raise self._error(Missing.TIME, str(error)) from None
        except OSError as error:
            why = f"{place.parent}: {error.strerror}" if error.strerror else str(error)
            raise self._error(
                Missing.PLACE, f"compiled files cannot be kept: {why} (XDG_CACHE_HOME names another folder)"
            ) from None

    def _compile(self, recipe: _Recipe, part: Path, deadline: float) -> None:
        said = part.with_name("said.txt")
        kind = () if self.program else ("-shared", "-fPIC")
        words = [*recipe.compiler, *kind, *recipe.flags, "-o", str(part), *map(str, self.sources), *recipe.links]
        # remains of a killed compiler are removed with the folder
        code = _run(words, {"TMPDIR": str(part.parent)}, said, deadline)
        if code is None:
            raise self._error(Missing.TIME, f"{recipe.compiler[0]} gave no result within {deadline:g} s")
        with open(said, "rb") as file:
            text = file.read(MOST_READ).decode(errors="replace").strip()
        if code == 0 and part.is_file():
            return
        header, library = HEADER.search(text), LIBRARY.search(text)
        if header:
            missing, why = Missing.HEADER, f"the header {header[1]} is not installed"
        elif library:
            missing, why = Missing.LIBRARY, f"the library {library[1] or library[2]} is not installed"
        else:
            missing, why = Missing.SOURCE, f"{recipe.compiler[0]} ended with code {code}"
        raise self._error(missing, f"{why}\n{text[:MOST_SAID]}")

    def _error(self, missing: Missing, why: str) -> CompileError:
        names = ", ".join(source.name for source in self.sources)
        return CompileError(self.engine, missing, f"{self.name} ({names}) cannot be compiled: {why}")


_LOAD = "import ctypes, sys\ntry:\n    ctypes.CDLL(sys.argv[1])\nexcept OSError as error:\n    sys.exit(str(error))"


def _why_not_loaded(file: Path, deadline: float) -> str:
    """Why a fresh process does not load a library; empty where it does."""
    try:
        done = subprocess.run(
            isolated("-c", _LOAD, str(file)),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            cwd=ELSEWHERE,
            timeout=deadline,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no end within {deadline:g} s"
    return (
        (done.stderr.strip()[:MOST_SAID] or f"the process ended with code {done.returncode}") if done.returncode else ""
    )


@dataclass(frozen=True)
class _Recipe:
    """How something is compiled on this machine: the words of the compiler, the flags before and after the sources."""

    compiler: tuple[str, ...]
    flags: tuple[str, ...]
    links: tuple[str, ...]
    key: str


@functools.lru_cache(maxsize=64)
def _recipe(what: NativeBinary, environment: tuple[tuple[str, str], ...]) -> _Recipe:
    """The recipe, queried from the machine once for each environment. Raises CompileError."""
    known = dict(environment)
    variable, names = COMPILERS[what.language]
    given = _words(what, Missing.COMPILER, f"the environment variable {variable}", known.get(variable, ""))
    found = [shutil.which(name) for name in (given[:1] or names)]
    program = next((entry for entry in found if entry is not None), None)
    if program is None:
        sought = f"{given[0]} (the environment variable {variable})" if given else " or ".join(names)
        raise what._error(Missing.COMPILER, f"no {what.language} compiler: {sought} is not on the path")
    compiler = (program, *given[1:])
    flags, links = list(what.flags), list(what.links)
    versions: dict[str, str | None] = {}
    if what.packages:
        answer = _pkg_config("--print-errors", "--exists", *what.packages)
        if answer is None:
            raise what._error(Missing.PKG_CONFIG, "pkg-config is not on the path")
        if answer[0]:
            why = f"pkg-config has no {', '.join(what.packages)}: its development files are not installed\n"
            raise what._error(Missing.PACKAGE, why + answer[1][:MOST_SAID])
        for option, words in (("--cflags", flags), ("--libs", links)):
            code, said = _pkg_config(option, *what.packages) or (None, "")
            if code != 0:
                raise what._error(Missing.PACKAGE, f"pkg-config {option} ended with code {code}\n{said[:MOST_SAID]}")
            words += _words(what, Missing.PACKAGE, f"the output of pkg-config {option}", said)
        versions = {name: package_version(name) for name in what.packages}
    try:
        release = subprocess.run(
            [*compiler, "--version"], capture_output=True, stdin=subprocess.DEVNULL, timeout=PATIENCE, check=False
        ).stdout
        texts = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in (*what.sources, *what.headers)}
    except subprocess.TimeoutExpired:
        raise what._error(Missing.TIME, f"{program} gave no version within {PATIENCE:g} s") from None
    except FileNotFoundError as error:
        raise what._error(Missing.SOURCE, f"{error.filename} is missing: simspec is not installed whole") from None
    except OSError as error:
        raise what._error(Missing.COMPILER, f"{program} cannot be started: {error.strerror}") from None
    parts = [SCHEMA, what.language, what.program, texts, compiler, release.decode(errors="replace"), flags, links]
    text = json.dumps([*parts, versions, sys.platform, platform.machine()])
    return _Recipe(compiler, tuple(flags), tuple(links), hashlib.sha256(text.encode()).hexdigest())


def _words(what: NativeBinary, missing: Missing, source: str, text: str) -> list[str]:
    """The words of a command, as a shell splits them. Raises CompileError where quotes are not closed."""
    try:
        return shlex.split(text)
    except ValueError as error:
        raise what._error(missing, f"{source} is no list of words: {error}: {text[:MOST_SAID].strip()}") from None


def package_version(package: str) -> str | None:
    """The version of a library as pkg-config knows it (``"NAME"``, or with a bound, which must hold); None where it does not,
    or is not there itself."""
    return _package_version(package, tuple(sorted(os.environ.items())))


@functools.lru_cache(maxsize=64)
def _package_version(package: str, environment: tuple[tuple[str, str], ...]) -> str | None:
    answer = _pkg_config("--modversion", package)
    return answer[1].strip() if answer and answer[0] == 0 else None


def forget_packages() -> None:
    """Query pkg-config again from now on: a package manager has been at work."""
    _package_version.cache_clear()
    _recipe.cache_clear()


def _pkg_config(*words: str) -> tuple[int, str] | None:
    """Exit code and words of pkg-config; None where there is none that can be started and ends in time."""
    program = shutil.which("pkg-config") or shutil.which("pkgconf")
    if program is None:
        return None
    try:
        done = subprocess.run(
            [program, *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=PATIENCE,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.returncode, done.stdout.decode(errors="replace")


def _run(words: Sequence[str], more: Mapping[str, str], said: Path, deadline: float) -> int | None:
    """The exit code of a program whose output goes to the file ``said``; None where it takes longer than ``deadline`` (s).
    Nothing that it started is left, however this ends."""
    with open(said, "xb") as output:
        process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, "LC_ALL": "C", **more},
            start_new_session=True,
        )
        try:
            return process.wait(deadline)
        except subprocess.TimeoutExpired:
            return None
        finally:
            if process.returncode is None:  # no process holds the number of one that has ended
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()


# Requirements of an engine on the machine in addition to packages of Python, as data: libraries, a compiler, packages of
# Debian.


class InstalledProgram(Protocol):
    """A program that is installed by its own makers' means."""

    def version(self) -> str | None:
        """Its version; None where it is not installed, or cannot be used."""
        ...

    def lacking(self) -> EngineError | None:
        """Why it cannot be used; None where it can."""
        ...


@dataclass(frozen=True)
class Needs:
    """Requirements of an engine on the machine.

    ``library``: the library that brings the engine where no package of Python does, as pkg-config knows it, with a bound where
    one is needed (``"NAME >= 1.2"``): its version is the engine's. ``parts``: the parts that the engine compiles on first use.
    ``debian``: packages of Debian and Ubuntu that bring the library, the compiler of the parts, and the rest, each by name with
    its purpose. ``program``: one that is the engine, and whose version is the engine's. ``elsewhere``: further required
    installations that no package brings, in words.
    """

    library: str = ""
    parts: tuple[NativeBinary, ...] = ()
    debian: tuple[tuple[str, str], ...] = ()
    program: InstalledProgram | None = None
    elsewhere: str = ""

    def version(self) -> str | None:
        """The version of the library or program; None where there is none, or where what compiles the parts is not there."""
        if self.lacking():
            return None
        if self.program is not None:
            return self.program.version()
        return package_version(self.library) if self.library else None

    def lacking(self) -> tuple[EngineError, ...]:
        """Why parts cannot be compiled, as far as that is known without doing it: compiler, pkg-config, libraries; and why the
        program cannot be used."""
        requested = (*self.parts, *(() if self.program is None else (self.program,)))
        return tuple(error for entry in requested if (error := entry.lacking()) is not None)

    @property
    def packages(self) -> Mapping[str, str]:
        """The packages of Debian, by name."""
        return dict(self.debian)
