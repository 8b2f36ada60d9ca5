"""The engine's side of the folder contract: read a request, work, write a result. Started by ``keeper.py`` in the same folder.

It works in any environment that has numpy and the engine: this file makes its own ``simspec`` package importable without
putting the rest of simspec's environment on the path, so the engine may live in another interpreter.

FOLDER/request.json   schema; engine (its name); program ("module:Class"); operations (a list, see operations.py; each with its
                      folder of artifacts, relative to FOLDER, and the kind and shape of each of its arrays; it may be an
                      ``attempt``, see :func:`attempt`)
FOLDER/at_work.txt    the number of the operation that is at work
FOLDER/request.bin    the arrays of the operations: little-endian, one after the other, in their order
FOLDER/artifacts/     the artifacts
FOLDER/result.json    schema, status (ok | error), error, versions, one entry per operation; an entry's ``arrays`` says the
                      kind (f8, i8) and shape of each array of its result, and where it is
FOLDER/result.bin     the arrays that are ``stored`` there: little-endian, one after the other, in the order of the entries
FOLDER/<index>.<name>.bin   an array that was written row by row, while the operation was at work

The result is written to a temporary name and renamed: a result that exists is whole. The answer of each operation is defined in
``answer_forms.py``; the other side checks all of it.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.util
import itertools
import json
import math
import os
import platform
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simspec.engines.kit.contract import Engine
    from simspec.engines.kit.foreign import ForeignSession
    from simspec.engines.kit.session import Session


SCHEMA = 3
REQUEST, REQUEST_ARRAYS = "request.json", "request.bin"
AT_WORK = "at_work.txt"
KINDS = {"f": "f8", "i": "i8", "b": "i8", "u": "i8"}
"""Kinds of arrays as they are written, by numpy's kinds."""
LINES, LINE, MESSAGE = 200, 2000, 8000
"""Lines of an engine's log, characters of each, and characters of an error or a refusal, that are passed on."""


def _make_simspec_importable() -> None:
    if "simspec" in sys.modules:
        return
    package = Path(__file__).resolve().parents[2]
    spec = importlib.util.spec_from_file_location(
        "simspec", package / "__init__.py", submodule_search_locations=[str(package)]
    )
    if spec is None or spec.loader is None:
        raise ImportError(f"no package at {package}")
    module = importlib.util.module_from_spec(spec)
    sys.modules["simspec"] = module
    spec.loader.exec_module(module)


def _confine_files(folder: Path, request: dict[str, Any]) -> None:
    """Where an operation loads a file of unknown origin: let this process open that file's folders, Python and the request's
    folder alone, before anything starts a thread. System calls are confined when the engine is imported (``foreign.py``)."""
    foreign = [operation for operation in request["operations"] if operation["op"] == "foreign"]
    if foreign:
        from simspec.confinement import confine_files, of_python

        tempfile.tempdir = str(folder)
        roots = [root for operation in foreign for root in operation["roots"]]
        confine_files([*of_python(), *roots], [str(folder), os.devnull])


def _work(folder: Path, request: dict[str, Any]) -> tuple[dict[str, Any], list[Any]]:
    _confine_files(folder, request)
    import numpy as np

    from simspec.engines.kit.messages import tell_into

    tell_into(folder)
    if request.get("schema") != SCHEMA:
        raise ValueError(f"request schema {request.get('schema')!r}, this worker reads {SCHEMA}")
    module, _, name = request["program"].partition(":")
    engine_class = getattr(importlib.import_module(module), name)
    entries: list[dict[str, Any]] = []
    stored: list[Any] = []
    sessions = _Sessions(engine_class)
    placed = [
        {**operation, "artifacts": folder / operation["artifacts"], "place": folder / f"{index}."}
        for index, operation in enumerate(request["operations"])
    ]
    arrays = _requested(folder, request)
    index = 0
    while index < len(placed):
        operation = placed[index]
        (folder / AT_WORK).write_text(str(index), encoding="ascii")
        if operation.get("attempt", False):
            engine_class.prepare()
            belongs = functools.partial(_belongs, engine_class, operation)
            alike = list(itertools.takewhile(belongs, placed[index:]))
            begin = functools.partial(_alone, engine_class, alike, list(itertools.islice(arrays, len(alike))))
            answers = list(attempt(begin, alike, folder, MESSAGE))
        else:
            answers = [sessions.entry(operation, next(arrays))]
        index += len(answers)
        if index == len(placed) or not sessions.shares(placed[index]):
            sessions.close()  # while this operation is said to be at work: a crash in closing is its own
        for entry, local in answers:
            entries.append(entry)
            stored += local
    return (
        {
            "status": "ok",
            "engine": engine_class.NAME,
            "engine_version": engine_class.version(),
            "numpy_version": np.__version__,
            "python_version": platform.python_version(),
            "platform": platform.platform(),
            "machine": platform.machine(),
            "operations": entries,
        },
        stored,
    )


def _requested(folder: Path, request: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The arrays of each operation of a request."""
    import numpy as np

    with open(folder / REQUEST_ARRAYS, "rb") as file:
        for operation in request["operations"]:
            arrays = {}
            for name, form in operation["arrays"].items():
                count = math.prod(form["shape"])
                arrays[name] = np.fromfile(file, dtype=f"<{form['kind']}", count=count).reshape(form["shape"])
            yield arrays


def _belongs(engine_class: type[Engine], first: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether an operation is attempted in the same process as the one before it: on the same artifacts, or in an engine for
    which what it has compiled is worth keeping."""
    same = other["artifacts"] == first["artifacts"] or engine_class.COMPILING > 0.0
    return bool(other.get("attempt", False)) and same


def _alone(
    engine_class: type[Engine], operations: Sequence[dict[str, Any]], arrays: Sequence[dict[str, Any]]
) -> Callable[[int], tuple[dict[str, Any], list[Any]]]:
    """A function that does the operation at a place in the list, with separate sessions."""
    sessions = _Sessions(engine_class)
    placed = [{**operation, "attempt": False} for operation in operations]

    def work(place: int) -> tuple[dict[str, Any], list[Any]]:
        entry = sessions.entry(placed[place], arrays[place])
        if place + 1 == len(placed) or not sessions.shares(placed[place + 1]):
            sessions.close()
        return entry

    return work


class _Sessions:
    """The session that operations share where they may (see ``operations.Named``); else each loads anew."""

    def __init__(self, engine_class: type[Engine]):
        self._engine_class = engine_class
        self._session: Session | ForeignSession | None = None

    def entry(self, operation: dict[str, Any], arrays: dict[str, Any]) -> tuple[dict[str, Any], list[Any]]:
        """What result.json says of one operation, and the arrays to be stored."""
        from simspec.engines.kit.foreign import ForeignSession
        from simspec.engines.kit.operations import OPERATIONS
        from simspec.engines.kit.session import Session

        loading = 0.0
        if OPERATIONS[operation["op"]].bare:
            self.close()
            self._session = ForeignSession(self._engine_class)
        elif not self.shares(operation):
            self.close()
            self._session = Session(self._engine_class, operation["artifacts"])
            loading = self._session.load_seconds
        session = self._session
        if session is None:
            raise RuntimeError("no session")
        started = time.perf_counter()
        try:
            result, answer = OPERATIONS[operation["op"]].do(session, arrays, operation)
            stored: list[Any] = []
            entry = {
                "op": operation["op"],
                "load_seconds": loading,
                "seconds": time.perf_counter() - started,
                "log": [line[:LINE] for line in session.log()[:LINES]],
                "result": result,
                "arrays": {key: _described(value, stored) for key, value in answer.items()},
            }
        except BaseException:
            # an error from closing must not hide the first error
            with contextlib.suppress(Exception):
                self.close()
            raise
        return entry, stored

    def shares(self, operation: dict[str, Any]) -> bool:
        """Whether an operation may go on with what is loaded."""
        from simspec.engines.kit.operations import OPERATIONS
        from simspec.engines.kit.session import Session

        session = self._session
        return (
            isinstance(session, Session)
            and not OPERATIONS[operation["op"]].bare
            and not operation.get("attempt", False)
            and session.artifacts == operation["artifacts"]
            and session.condition <= OPERATIONS[operation["op"]].needs
        )

    def close(self) -> None:
        """Close what is loaded."""
        session, self._session = self._session, None
        if session is not None:
            session.close()


def _described(value: Any, stored: list[Any]) -> dict[str, Any]:
    """What result.json says of an array; those that are not in a file yet are added to ``stored``."""
    import numpy as np

    if isinstance(value, dict):  # written row by row: see the recorder
        return {**value, "stored": False}
    kind = KINDS.get(np.asarray(value).dtype.kind)
    if kind is None:
        raise TypeError(f"an array of {np.asarray(value).dtype}, not of numbers")
    stored.append(np.ascontiguousarray(value, dtype=f"<{kind}"))
    return {"kind": kind, "shape": list(stored[-1].shape), "stored": True}


def main(folder: Path) -> int:
    """Work off the request in ``folder``; 0 when a result with status ok was written."""
    _make_simspec_importable()
    request = json.loads((folder / REQUEST).read_text(encoding="utf-8"))
    stored: list[Any] = []
    try:
        result, stored = _work(folder, request)
        text = json.dumps({**result, "schema": SCHEMA})
    except Exception as error:  # recorded, whole, as this run's result: the other side decides what it means
        stored = []
        result = {
            "status": "error",
            "error": f"{type(error).__name__}: {error}"[:MESSAGE],
            "traceback": traceback.format_exc()[-MESSAGE:],
        }
        text = json.dumps({**result, "schema": SCHEMA})
    with open(folder / "result.bin.part", "wb") as file:
        for value in stored:
            value.tofile(file)
    os.replace(folder / "result.bin.part", folder / "result.bin")
    (folder / "result.json.part").write_text(text, encoding="utf-8")
    os.replace(folder / "result.json.part", folder / "result.json")
    return 0 if result["status"] == "ok" else 1


# Operations that may end the engine: in a process of its own, forked from the worker when the engine is imported. Those that
# follow one another on the same artifacts share one, as operations share the worker; in an engine that compiles what it
# computes (``Engine.COMPILING``), others too. An exception is then the operation's answer, as ``{"refused": message}``, and
# so is a crash, or more than ``cpu_seconds`` of CPU time, which end that process alone; the next operations have another one.
# An operation that ends a process after other artifacts is tried once more in a separate process. Forking takes some
# milliseconds; a new worker takes a second.

Entry = tuple[dict[str, Any], list[Any]]
"""What result.json says of an operation, and its arrays."""
Work = Callable[[int], Entry]
"""Does the operation of that place in a list."""


def attempt(
    begin: Callable[[], Work], operations: Sequence[dict[str, Any]], folder: Path, most: int
) -> Iterator[Entry]:
    """The results of the work for each of ``operations``, or its refusal, of at most ``most`` characters. ``begin`` is called
    in each process anew. Its files are in ``folder``."""
    at = 0
    while at < len(operations):
        for place in range(at, len(operations)):
            _text(folder, place).unlink(missing_ok=True)
        started, first = time.perf_counter(), at
        child = os.fork()
        if child == 0:
            code = 1
            try:
                _work_off(begin, operations, range(at, len(operations)), folder, most)
                code = 0
            finally:
                os._exit(code)
        _, status = os.waitpid(child, 0)
        while at < len(operations) and _text(folder, at).exists():
            entry: dict[str, Any] = json.loads(_text(folder, at).read_text(encoding="utf-8"))
            refusal = entry.get("refused")
            spent = time.perf_counter() - started
            yield (
                (entry, _arrays(entry, _numbers(folder, at)))
                if refusal is None
                else _refusal(operations[at], refusal, spent)
            )
            at += 1
        if status and operations[at].get("artifacts") == operations[first].get("artifacts"):
            yield _refusal(operations[at], f"the engine's process {_ending(status)}", time.perf_counter() - started)
            at += 1


def _refusal(operation: dict[str, Any], why: str, spent: float) -> Entry:
    about = {"op": operation["op"], "load_seconds": 0.0, "seconds": spent, "log": [], "arrays": {}}
    return {**about, "result": {"refused": why}}, []


def _text(folder: Path, place: int) -> Path:
    return folder / f"attempt.{place}.json"


def _numbers(folder: Path, place: int) -> Path:
    return folder / f"attempt.{place}.bin"


def _work_off(
    begin: Callable[[], Work], operations: Sequence[dict[str, Any]], places: range, folder: Path, most: int
) -> None:
    """Write what the work gives for the operations at these places, up to the first that is refused."""
    work = begin()
    for place in places:
        # CPU time, and a signal without a handler: no other signal reaches an engine in an endless loop
        signal.setitimer(signal.ITIMER_PROF, operations[place].get("cpu_seconds", 0.0))
        try:
            entry, local = work(place)
        except Exception as error:  # a refusal is this operation's answer
            entry, local = {"refused": f"{type(error).__name__}: {error}"[:most]}, []
        with open(_numbers(folder, place), "wb") as file:
            for value in local:
                value.tofile(file)
        # the text last, and whole: it says that the operation is done
        path = folder / "attempt.part"
        path.write_text(json.dumps(entry), encoding="utf-8")
        path.replace(_text(folder, place))
        if "refused" in entry:
            return


def _arrays(entry: dict[str, Any], numbers: Path) -> list[Any]:
    """The arrays of an entry that are ``stored``, in its order."""
    import numpy as np

    found = []
    with open(numbers, "rb") as file:
        for array in entry["arrays"].values():
            if array["stored"]:
                count = int(np.prod(array["shape"], dtype=np.int64))
                found.append(np.fromfile(file, dtype=f"<{array['kind']}", count=count))
    return found


def _ending(status: int) -> str:
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        return f"was ended by signal {number} ({signal.Signals(number).name})"
    return f"ended with code {os.waitstatus_to_exitcode(status)}"
