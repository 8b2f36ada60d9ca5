"""Asking about many files: workers side by side, a deadline for each file, a result in a file of its own as soon as there is
one."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import math
import os
import queue
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from models import ENGINES, Model, package_folders

HERE = Path(__file__).resolve().parent
STAGES = ("import", "certify", "apart", "audit")
DEADLINES = {"import": 90.0, "certify": 900.0, "apart": 900.0, "audit": 600.0}
"""s for one file."""
RENEWED = 60
"""Files after which a worker is replaced, which bounds the memory that libraries keep."""
FIRST = 120.0
"""s that a worker has for its start in addition to a deadline."""


@functools.cache
def code() -> str:
    """The hash of simspec's own modules, which identifies results of today's code."""
    digest = hashlib.sha256()
    package = HERE.parents[1] / "simspec"
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


class Worker:
    """A process that answers for files, started anew when it is gone."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._answers = -1
        self._answered = 0

    def ask(self, stage: str, model: Model, engines: Sequence[str]) -> dict[str, Any]:
        """The answer of a stage for a file, in ``engines`` (none: in all); ``late`` or ``died`` where there is none."""
        fresh = self._process is None
        process = self._process or self._start()
        folders = [str(folder) for folder in package_folders(model.root)]
        request = {"stage": stage, "file": str(model.path), "folders": folders, "engines": list(engines)}
        assert process.stdin is not None
        begun = time.monotonic()
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
        line = self._line(begun + DEADLINES[stage] + (FIRST if fresh else 0.0))
        self._answered += 1
        if line is None or not line.endswith(b"\n"):
            self.end()
            took = round(time.monotonic() - begun, 2)
            return {"late": took} if line is None else {"died": process.returncode, "seconds": took}
        if self._answered >= RENEWED:
            self.end()
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _start(self) -> subprocess.Popen[bytes]:
        self._answers, theirs = os.pipe()
        words = [sys.executable, str(HERE / "worker.py"), str(theirs)]
        self._process = subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs],
            start_new_session=True,
        )
        os.close(theirs)
        self._answered = 0
        return self._process

    def _line(self, ends: float) -> bytes | None:
        """A line of the answers; None when it is late, without an end of line when the process is gone."""
        read = b""
        while not read.endswith(b"\n"):
            if not select.select([self._answers], [], [], max(0.0, ends - time.monotonic()))[0]:
                return None
            block = os.read(self._answers, 65536)
            if not block:
                return read
            read += block
        return read

    def end(self) -> None:
        """End the process and what it started."""
        if self._process is None:
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._answers)
        self._process = None


def place(results: Path, stage: str, model: Model) -> Path:
    """Where a result is."""
    return results / stage / f"{model.key}.json"


def stored(results: Path, stage: str, model: Model) -> dict[str, Any] | None:
    """A result, if there is one."""
    try:
        result: dict[str, Any] = json.loads(place(results, stage, model).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    return result


def failed(answer: dict[str, Any]) -> bool:
    """Whether an answer is none, or has a proof that fails."""
    ended = any(word in answer for word in ("late", "died", "crash", "again"))
    return ended or any(entry["valid"] is False for entry in answer.get("proven") or ())


def needed(results: Path, stage: str, model: Model, again: str, among: Sequence[str] = ()) -> bool:
    """Whether a stage has to be run for a file. Files with a result of other code than today's are run again: all if ``again``
    is "anew", the failed ones if it is "failed", and if it is "open" also those that an engine refuses or never tried.
    Files that are not imported are not certified."""
    known = stored(results, stage, model)
    if known is not None and not (
        again and known["code"] != code() and _again(results, stage, model, known, again, among)
    ):
        return False
    if stage == "certify":
        imported = stored(results, "import", model)
        return imported is None or imported.get("imported") is True
    return stage != "apart" or bool(refusing(results, model))


def _again(
    results: Path, stage: str, model: Model, known: dict[str, Any], again: str, among: Sequence[str] = ()
) -> bool:
    """Whether a file with an answer of other code is run once more."""
    if again == "open" and known.get("proven"):
        return bool(undecided(results, stage, model, known, among))
    return again == "anew" or failed(known)


def undecided(results: Path, stage: str, model: Model, known: dict[str, Any], among: Sequence[str] = ()) -> list[str]:
    """The engines, of ``among`` (none: of all), that an answer leaves open: their proof fails, they refuse the file, or
    they never tried it."""
    if stage not in ("certify", "apart"):
        return []
    verdicts = {entry["engine"]: entry["valid"] for entry in known.get("proven") or ()}
    of = installed() if stage == "certify" else refusing(results, model)
    return [engine for engine in of if verdicts.get(engine) is not True and (not among or engine in among)]


@functools.cache
def installed() -> tuple[str, ...]:
    """The engines of the page that answer here."""
    from simspec.engines.kit.registry import engines

    return tuple(name for name in ENGINES if engines()[name].version() is not None)


def refusing(results: Path, model: Model) -> list[str]:
    """The engines that refuse, by name, what simspec would compile of a file."""
    certified = stored(results, "certify", model) or {}
    return [entry["engine"] for entry in certified.get("proven") or () if entry["valid"] is None]


def failing(known: dict[str, Any] | None) -> list[str]:
    """The engines whose proof fails by an answer; none where the answer is none for other reasons."""
    return [entry["engine"] for entry in (known or {}).get("proven") or () if entry["valid"] is False]


def completed(answer: dict[str, Any], known: dict[str, Any]) -> dict[str, Any]:
    """An answer of some engines, with those of the others as they are known, and of which states of the code these are."""
    renewed = {entry["engine"] for entry in answer["proven"]}
    kept = [entry for entry in known["proven"] if entry["engine"] not in renewed]
    proven = sorted([*answer["proven"], *kept], key=lambda entry: str(entry["engine"]))
    older = sorted({known["code"], *known.get("older", ())}) if kept else []
    return {**answer, "proven": proven, "older": older}


def ordered(models: Sequence[Model], results: Path, stage: str) -> list[Model]:
    """By classes of the number of bodies, each as spread as before; of a class first what failed, since it may be repaired by
    now."""

    def key(model: Model) -> tuple[int, bool]:
        known = stored(results, stage, model)
        bodies = (stored(results, "import", model) or {}).get("bodies", 1)
        return math.ceil(math.log2(max(bodies, 4))), known is None or not failed(known)

    return sorted(models, key=key)


def run(
    models: Sequence[Model],
    results: Path,
    stages: Sequence[str],
    workers: int,
    seconds: float,
    again: str,
    among: Sequence[str] = (),
) -> None:
    """Run one stage after the other, until all is done or time is up. ``among``: engines that open files are tried in."""
    ends = time.monotonic() + seconds
    for stage in stages:
        (results / stage).mkdir(parents=True, exist_ok=True)
        waiting: queue.SimpleQueue[Model] = queue.SimpleQueue()
        left = ordered([model for model in models if needed(results, stage, model, again, among)], results, stage)
        print(f"{stage}: {len(left)} files to ask", flush=True)
        for model in left:
            waiting.put(model)
        threads = [
            threading.Thread(target=_work, args=(stage, waiting, results, ends, again, among))
            for _ in range(min(workers, len(left)))
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()


def _work(
    stage: str,
    waiting: queue.SimpleQueue[Model],
    results: Path,
    ends: float,
    again: str,
    among: Sequence[str],
) -> None:
    worker = Worker()
    try:
        while time.monotonic() < ends:
            try:
                model = waiting.get_nowait()
            except queue.Empty:
                return
            known = stored(results, stage, model) if again in ("failed", "open") else None
            engines = failing(known)
            if known is not None and again == "open":
                engines = undecided(results, stage, model, known, among)
            engines = engines or (refusing(results, model) if stage == "apart" else [])
            answer = {**worker.ask(stage, model, engines), "code": code()}
            if known is not None and known.get("proven") and engines and answer.get("proven"):
                answer = completed(answer, known)
            target = place(results, stage, model)
            part = target.with_suffix(".part")
            part.write_text(json.dumps(answer), encoding="utf-8")
            part.replace(target)
            state = "late" if "late" in answer else "died" if "died" in answer else "crash" if "crash" in answer else ""
            print(f"{answer.get('seconds', 0.0):7.1f} s {state:5s} {model.package} {model.name}", flush=True)
    finally:
        worker.end()
