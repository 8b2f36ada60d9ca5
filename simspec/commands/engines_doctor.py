"""``simspec engines doctor``: what is there of each engine, what is missing and why, and whether it works."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from simspec.arguments import demand_trusted, print_json
from simspec.confinement import Walls, walls
from simspec.engines.kit.diagnosis import State, compile_parts, diagnose
from simspec.engines.kit.installed import instances
from simspec.engines.kit.registry import broken_engines, find_engine
from simspec.errors import EXIT_ENGINE, EXIT_OK, SimspecError
from simspec.project import load_project
from simspec.proof.fall import fall
from simspec.report.kit import table
from simspec.report.screen import console, say

WORKS, FAILS, NOT_TRUSTED = "works", "fails", "not trusted"


def doctor(labels: Sequence[str], every: bool, as_json: bool) -> int:
    """Examine engines (default: all). Exit code 3 where one that is installed does not work, or is so in part or in another
    version; where one that is named, or with ``every`` any, is not installed. Interpreters of a project file that is not
    trusted are not started: one that is named is an error, others are rows with the reason."""
    project = load_project()
    interpreters = project.known_interpreters()
    for label in labels:
        find_engine(label)
    demand_trusted(labels, interpreters)
    closed = {label: project.why_not_queried(label) for label in interpreters.not_trusted}
    wanted_labels = [label for label in interpreters if label not in closed and (not labels or label in labels)]
    started = {label: interpreters[label] for label in wanted_labels}
    known = instances(started, [*project.default_engines, *labels], closed)
    rows = {
        one.label: not_examined(one.label, closed[one.label])
        if one.label in closed
        else examined(one.label, one.python, one.problem)
        for one in known
        if not labels or one.label in labels
    }
    broken = {} if labels else dict(broken_engines())
    wanted = list(rows) if labels or every else []
    wrong = [
        label
        for label, row in rows.items()
        if row["state"] != WORKS
        and (label in wanted or row["state"] not in (State.ABSENT, State.IMPOSSIBLE, State.FILES, NOT_TRUSTED))
    ]
    code = EXIT_ENGINE if wrong or broken else EXIT_OK
    if as_json:
        print_json({"engines": rows, "broken": broken, "walls": walls()._asdict(), "exit_code": code})
        return code
    shown = table("Engines", "engine", "version", "state", "falling ball", "s", "missing or wrong, and the way out")
    for label, row in rows.items():
        way = [f"-> {row['install']}"] if row["problems"] and row["install"] else []
        off = "" if row["height_error"] is None else f"{row['speed_error']:.0e}, {row['height_error']:.1e} m off"
        took = "" if row["seconds"] is None else f"{row['seconds']:.1f}"
        shown.add_row(label, row["version"] or "none", row["state"], off, took, "\n".join([*row["problems"], *way]))
    console().print(shown)
    for name, why in broken.items():
        say(f"{name}: {why}")
    say(f"confinement of processes that read foreign files: {offered(walls())}")
    return code


def not_examined(label: str, why: str) -> dict[str, Any]:
    """The same of an engine whose interpreter is not started, for the reason ``why``."""
    nothing = dict.fromkeys(("version", "install", "python", "seconds", "speed_error", "height_error"))
    return {**nothing, "state": NOT_TRUSTED, "problems": [why]}


def offered(kernel: Walls) -> str:
    """What the kernel offers to confine processes, in words."""
    present = [f"Landlock {kernel.landlock}"] * bool(kernel.landlock) + ["seccomp"] * kernel.calls
    return "; ".join([*([" and ".join(present)] if present else []), *([kernel.why] if kernel.why else [])])


def examined(label: str, python: str | None, problem: str | None) -> dict[str, Any]:
    """What is found of an engine, as plain data."""
    engine = find_engine(label)
    found = diagnose(engine)
    state, problems = str(found.state), list(found.problems)
    if python is not None or found.state is State.WHOLE:
        problems = [problem] if problem is not None else list(compile_parts(engine))
    row: dict[str, Any] = {
        "version": found.version,
        "state": state,
        "problems": problems,
        "install": found.install,
        "python": python,
        "seconds": None,
        "speed_error": None,
        "height_error": None,
    }
    if problems:
        return row | {"state": FAILS if found.state is State.WHOLE or python is not None else state}
    try:
        seen = fall(label, python)
    except SimspecError as error:
        return row | {"state": FAILS, "problems": [str(error).removeprefix(f"{label}: ")]}
    measured = {"seconds": seen.seconds, "speed_error": seen.speed_error, "height_error": seen.height_error}
    return row | {"state": WORKS, "version": seen.version, **measured}
