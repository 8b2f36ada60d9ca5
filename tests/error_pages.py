"""The examples of the pages of errors: read from the page, done in a folder of their own, as a user would."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from simspec import cli
from simspec.errors import SimspecError, SpecError

ROOT = Path(__file__).resolve().parents[1]
PAGES = ROOT / "docs" / "errors"
BLOCK = re.compile(r"^```(?P<kind>\w+)(?: (?P<name>\S+))?\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
NOT_RUN = re.compile(r"^<!-- not run: (?P<why>.+) -->$", re.MULTILINE)
WAY_OUT = "\n## The way out\n"
HEAD = "simspec: 1\nname: example\n"
BALL = "bodies: {ball: {mass: 1 kg, inertia: {principal: [0.1, 0.1, 0.1]}}}\n"
DURATION = "physics: {duration: 1 s}\n"
REPORTED = re.compile(r"\b(?:error|warning)\[([\w.-]+)\]")


@dataclass
class Example:
    """One half of a page: files by name, and what is done with them, in order; ``reports``: the messages that it shows."""

    files: dict[str, str] = field(default_factory=dict)
    steps: list[tuple[str, str]] = field(default_factory=list)
    reports: list[str] = field(default_factory=list)


def example(text: str) -> Example:
    """The example of a part of a page."""
    found = Example()
    for block in BLOCK.finditer(text):
        kind, name, content = block["kind"], block["name"], block["text"]
        if kind == "text" and name is None:
            found.reports += content.splitlines()
        elif kind == "console":
            found.steps += [("command", line[2:]) for line in content.splitlines() if line.startswith("$ ")]
        elif kind == "python" and name is None:
            found.steps.append(("python", content))
        else:
            found.files[name or "spec.yaml"] = content if name else completed(content)
    return found


def completed(text: str) -> str:
    """A part of a spec with what a whole one needs after it; the lines keep their numbers."""
    keys = set(re.findall(r"^(\w+):", text, re.MULTILINE))
    if "simspec" in keys:
        return text
    more = HEAD if "name" not in keys else HEAD.partition("\n")[0] + "\n"
    if not keys & {"bodies", "models", "model"}:
        more += BALL
    if not keys & {"physics", "model"}:
        more += DURATION
    return text + more


def halves(page: str) -> tuple[Example, Example]:
    """The example that is refused or warned of, and the mended one, with the files and the commands of the first where
    it has none. Without commands the spec is checked."""
    first, _, second = page.partition(WAY_OUT)
    wrong, right = example(first), example(second)
    wrong.steps = wrong.steps or [("command", "simspec check spec.yaml")]
    right.files = {**wrong.files, **right.files}
    right.steps = right.steps or wrong.steps
    return wrong, right


_DONE: dict[tuple[str, ...], Path] = {}
"""Folders after a run of an engine, by files and commands up to it: pages of stored runs begin with the same."""


def done(given: Example, folder: Path) -> str:
    """All that an example writes to the terminal, done in ``folder``, without the folder's name; and errors of Python."""
    for name, text in given.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    said = io.StringIO()
    key: tuple[str, ...] = tuple(f"{name}\n{text}" for name, text in sorted(given.files.items()))
    for kind, text in given.steps:
        key = (*key, text)
        with contextlib.chdir(folder), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            if kind == "python":
                _python(text, said)
            elif text.startswith("simspec run ") and key in _DONE:
                shutil.copytree(_DONE[key], folder, dirs_exist_ok=True)
            else:
                _command(text, said)
        if text.startswith("simspec run ") and key not in _DONE:
            _DONE[key] = Path(tempfile.mkdtemp(prefix="error-pages-")) / "done"
            shutil.copytree(folder, _DONE[key])
    return said.getvalue().replace(f"{folder}/", "")


def forget() -> None:
    """Remove the kept folders."""
    for folder in _DONE.values():
        shutil.rmtree(folder.parent)
    _DONE.clear()


def _command(line: str, said: io.StringIO) -> None:
    if line.startswith("simspec "):
        import shlex

        try:
            cli.main(shlex.split(line)[1:])
        except SystemExit:
            return
        except SimspecError as error:
            said.write(f"error[{error.code}]: {error}\n")
    else:
        subprocess.run(["bash", "-ec", line], check=True)


def _python(text: str, said: io.StringIO) -> None:
    try:
        exec(compile(text, "example.py", "exec"), {})
    except SpecError as error:
        for problem in error.problems:
            said.write(f"error[{problem.code}]: {problem}\n")
    except SimspecError as error:
        said.write(f"error[{error.code}]: {error}\n")


def reported(said: str) -> set[str]:
    """The codes of the messages."""
    return set(REPORTED.findall(said))


def not_said(reports: list[str], said: str) -> list[str]:
    """Lines that a page shows and that were not printed; ``…`` at the end stands for more of the line."""
    lines = said.splitlines()
    return [
        line
        for line in reports
        if line and not any(other == line or (line.endswith("…") and other.startswith(line[:-1])) for other in lines)
    ]
