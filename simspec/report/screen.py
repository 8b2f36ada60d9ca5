"""Output on terminals: names from specs are text, never markup and never control characters; progress of long work; and
results as plain data, for ``--json`` and ``report.json``."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from simspec.errors import (
    MOST_PROBLEMS,
    MOST_WORDS,
    UNSEEN_CHARACTERS,
    EngineError,
    SimspecError,
    SpecError,
    UnsupportedError,
    clipped,
    visible,
)

if TYPE_CHECKING:
    from simspec.comparison.floor import Floor
    from simspec.comparison.runs import Diff
    from simspec.comparison.study import Study
    from simspec.proof.certificate import Certificate, EngineProof
    from simspec.report.console import Screen
    from simspec.runner.expectations import Outcome
    from simspec.runner.run import Run


PIPE_WIDTH = 120
"""Columns where neither a terminal nor COLUMNS says how many there are."""
NARROWEST, WIDEST = 40, 120


def say(line: str, error: bool = False) -> None:
    """One line on standard output, or standard error, now, as long as it is."""
    print(visible(line), file=sys.stderr if error else sys.stdout, flush=True)


def console(error: bool = False) -> Screen:
    """The console for standard output (or standard error): rich detects the terminal, NO_COLOR and the pipe; COLUMNS counts for
    both."""
    from simspec.report.console import Screen

    stream = sys.stderr if error else sys.stdout
    terminal = stream.isatty()
    given = os.environ.get("COLUMNS", "")
    if given.isascii() and given.isdigit() and int(given) > 0:
        wanted = int(given)
    else:
        wanted = Screen(file=stream).width if terminal else PIPE_WIDTH
    width = min(max(wanted, NARROWEST), WIDEST)
    return (
        Screen(file=stream, width=width)
        if terminal
        else Screen(file=stream, width=width, no_color=True, force_terminal=False)
    )


# Progress: on a terminal as it goes, elsewhere a line now and then.

EVERY = 10.0
"""s between two lines where there is no terminal: a run of a minute leaves six, and silence never means that it hangs."""
FROM_SHARE = 0.02
"""Share of the work from which the remaining time is shown: before, it is a guess."""


class Progress(Protocol):
    """Receives the current work in words, and the share of it that is done, where that is known."""

    def __call__(self, text: str, share: float | None = None, /) -> None: ...


class Latest:
    """The latest report of progress, as a line: ``running x: 45 %, about 20 s left``. ``clock`` gives seconds.

    Another text is another work, unless the share goes on growing: ``3 of 40 runs`` and ``4 of 40 runs`` are one.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._text, self._share, self._since = "", 0.0, clock()

    def __call__(self, text: str, share: float | None = None, /) -> None:
        goes_on = bool(share and self._share and share >= self._share)
        if text != self._text and not goes_on:
            self._since = self._clock()
        self._text, self._share = text, share or 0.0

    def line(self) -> str:
        """The line to show now."""
        passed = self._clock() - self._since
        text = visible(self._text)
        if self._share <= 0.0:
            return f"{text}, for {duration(passed)}" if passed >= 1.0 else text
        given = f"{text}: {self._share:.0%}"
        if self._share < FROM_SHARE:
            return given
        return f"{given}, about {duration(passed * (1.0 - self._share) / self._share)} left"


def duration(seconds: float) -> str:
    """A time for reading: ``40 s``, ``3 min``, ``2 h 10 min``."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"


@contextmanager
def progress(enabled: bool = True) -> Iterator[Progress]:
    """A function to say what is being done, and how far it is: shown on standard error, with a spinner on a terminal,
    elsewhere as a line every ``EVERY`` seconds. Nothing at all where not ``enabled``."""
    screen = console(error=True)
    given = Latest()
    if not enabled:
        yield given
    elif screen.is_terminal:
        from rich.text import Text

        with screen.status("") as status:

            def show(text: str, share: float | None = None, /) -> None:
                given(text, share)
                status.update(Text(given.line()))

            yield show
    else:
        ended = threading.Event()
        teller = threading.Thread(target=_tell, args=(given, ended), daemon=True, name="simspec-progress")
        teller.start()
        try:
            yield given
        finally:
            ended.set()
            teller.join()


def _tell(given: Latest, ended: threading.Event) -> None:
    while not ended.wait(EVERY):
        say(given.line(), error=True)


# Results as plain data: the same facts as the tables, in SI units, whole.

REPORT_SCHEMA = 1
REPORT_FILE = "report.json"
"""Where a study's folder has it."""
NOT_RUN = "left_out"
"""Its key for the requested engines that did not run, with the reasons."""
PAGE_FILE = "report.html"
"""Where the folder of a study, or of a run, has its page."""


def plain(value: Any) -> Any:
    """Dataclasses, tuples, numpy numbers and paths as JSON data. Numbers that are not finite are null: JSON has no word for
    them."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        kept = [field.name for field in dataclasses.fields(value) if not field.metadata.get("unstored")]
        return {name: plain(getattr(value, name)) for name in kept}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if (numpy := sys.modules.get("numpy")) is not None and isinstance(value, numpy.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def text(value: Any) -> str:
    """JSON text with two spaces and a newline at the end."""
    encoded = json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False)
    # characters that JSON leaves raw and a terminal obeys, and halves of characters (names of files that are no text), as
    # escapes
    return UNSEEN_CHARACTERS.sub(_escaped, encoded) + "\n"


def _escaped(match: re.Match[str]) -> str:
    character = match.group()
    return character if character == "\n" else f"\\u{ord(character):04x}"


def error_data(error: SimspecError) -> dict[str, Any]:
    """An error with its problems: the first of them, and the number of all, where there are very many."""
    data: dict[str, Any] = {"kind": type(error).__name__, "message": str(error), "exit_code": error.exit_code}
    if isinstance(error, SpecError):
        data["problems"] = [
            {
                name: clipped(value, MOST_WORDS) if isinstance(value, str) else value
                for name, value in plain(problem).items()
            }
            for problem in error.problems[:MOST_PROBLEMS]
        ]
        if error.more:
            data["problem_count"] = len(error.problems)
    if isinstance(error, UnsupportedError) and error.ways_out is not None:
        data["ways_out"] = plain(error.ways_out)
    if isinstance(error, EngineError):
        data["engine"] = error.engine
    if error.code:
        data["code"] = error.code
    return {"error": data}


def run_data(run: Run, outcomes: tuple[Outcome, ...] = ()) -> dict[str, Any]:
    """One run without its arrays."""
    from simspec.comparison.runs import summary

    return {
        "engine": run.engine,
        "failed": run.failed,
        "provenance": plain(run.provenance),
        "real_time_factor": run.real_time_factor,
        "cpu_factor": run.cpu_factor,
        "end_to_end_factor": run.end_to_end_factor,
        "quantities": plain(summary(run)),
        "expectations": plain(outcomes),
        "unphysical": [{**plain(finding), "what": finding.short} for finding in run.unphysical.findings],
        "not_judged": run.unphysical.not_judged,
    }


def certificate_data(certificate: Certificate) -> dict[str, Any]:
    """A certificate, whole, with each engine's verdict and what its contact figures rest on."""
    data: dict[str, Any] = plain(certificate)
    for name, proof in certificate.engines.items():
        data["engines"][name] |= proof_data(proof)
    return data


def proof_data(proof: EngineProof) -> dict[str, Any]:
    """The verdict of one engine's proof, and what its contact figures rest on."""
    declared = {"declared": plain(proof.declared.data()), "contact_scope": proof.contact_scope} if proof.contact else {}
    return {"valid": proof.valid, "verdict": proof.verdict, **declared}


def diff_data(diff: Diff) -> dict[str, Any]:
    """One comparison, whole."""
    bodies = [{**plain(body), "verdict": body.verdict} for body in diff.bodies]
    return {**plain(diff), "bodies": bodies, "within": diff.within, "verdict": diff.verdict}


def floor_data(floor: Floor) -> dict[str, Any]:
    """An engine's own noise without the arrays."""
    return {
        "engine": floor.engine,
        "bitwise": floor.bitwise,
        "perturbation": floor.perturbation,
        "largest": plain(floor.largest),
        "cached": floor.cached,
    }


def study_data(study: Study) -> dict[str, Any]:
    """One study: what ``report.json`` holds."""
    return {
        "schema": REPORT_SCHEMA,
        "world": study.world.name,
        "exit_code": study.exit_code,
        "certificate_valid": study.certificate.valid if study.certificate is not None else None,
        "proofs": {
            name: proof_data(proof)
            for name, proof in (study.certificate.engines.items() if study.certificate is not None else ())
        },
        "runs": {name: run_data(run, study.outcomes.get(name, ())) for name, run in study.runs.items()},
        "floors": {name: floor_data(floor) for name, floor in study.floors.items()},
        "diffs": [diff_data(diff) for diff in study.diffs],
    }
