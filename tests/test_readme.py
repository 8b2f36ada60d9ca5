"""The README is correct: its commands run, its spec is the library's, its Python works."""

from __future__ import annotations

import functools
import io
import itertools
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import simspec
from simspec.engines.kit.registry import engines, find_engine
from simspec.report.console import Screen
from simspec.report.problems import show_not_taken
from simspec.selection import available

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tools"))

import readme  # noqa: E402 - a script outside the package

FIRST = "simspec run specs/double-pendulum.yaml --all-engines"
"""The command of the first comparison."""
PRINTED_COUNTS = """
from simspec.report.certificate import certificate_notes
counts = {name: sum(check.count for check in proof.checks) for name, proof in certificate.engines.items()}
import json
print(json.dumps([counts, certificate_notes(certificate)]))
"""
"""Appended to the Python of the README: it prints the counts that the first comparison reports of the same proof."""
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(marker: str) -> str:
    """The fenced block after a marker."""
    found = re.search(re.escape(f"<!-- {marker} -->") + r"\n```\w*\n(.*?)```", README, re.DOTALL)
    assert found, f"the README has no block after {marker!r}"
    return found.group(1)


@pytest.fixture
def place(tmp_path):
    """An empty folder with the library in it."""
    (tmp_path / "specs").symlink_to(ROOT / "specs")
    return tmp_path


@pytest.mark.parametrize("command", block("commands: tested").splitlines())
def test_a_command_of_the_readme_runs(command, place):
    name, *words = shlex.split(command)
    assert name == "simspec"
    done = subprocess.run(
        [sys.executable, "-m", "simspec", *words], cwd=place, capture_output=True, text=True, check=False
    )
    # diff ends with 1 where it finds differences, as diff does
    assert done.returncode == (1 if words[0] == "diff" else 0), done.stdout + done.stderr
    assert done.stdout.strip()
    assert "Traceback" not in done.stderr


def test_the_spec_in_the_readme_is_the_library_s():
    assert block("file: specs/double-pendulum.yaml") == (ROOT / "specs" / "double-pendulum.yaml").read_text()


def words(text: str) -> list[str]:
    """Lines without the widths of columns."""
    return [line for line in (re.sub(r"[\s─]+", " ", line).strip() for line in text.splitlines()) if line]


@functools.cache
def first_comparison() -> dict[str, list[str]]:
    """The parts of the first comparison's block by their titles, and after each its lines without the widths of columns."""
    titles = ("Not run", "Model:", "Results", "Final state", "Expectations", "Repeatability", "Differences")
    parts: dict[str, list[str]] = {"": []}
    for line in words(block(f"output: {FIRST}")):
        title = next((title for title in titles if line.startswith(title)), "")
        if title:
            parts[title] = []
        else:
            next(reversed(parts.values())).append(line)
    return parts


def the_page_s_engines_or_skip() -> None:
    """Skip a test, and say why, where the engines of this machine are not those of the page."""
    installed = [name for name, engine in engines().items() if engine.version() is not None]
    if wrong := readme.other_engines(installed):
        pytest.skip("; ".join(wrong))


def test_the_first_comparison_has_the_engines_that_its_command_takes(place, monkeypatch):
    """Parts of the output that need no run (half a minute): compared and omitted engines with reasons, and expectations."""
    the_page_s_engines_or_skip()
    monkeypatch.chdir(place)
    spec = simspec.load("specs/double-pendulum.yaml")
    world = spec.resolve()
    selection = available({}).for_world(world, spec.locate, least=2)
    sections = first_comparison()
    screen = Screen(file=io.StringIO(), width=120, no_color=True, force_terminal=False)
    show_not_taken(selection, screen)
    assert sections["Not run"] == words(screen.file.getvalue())[1:], "python tools/readme.py README.md"
    assert sections["Results"][0] == " ".join(f"{name} {find_engine(name).version()}" for name in selection.engines)
    bounds = {expectation.kind: dict(expectation.parameters)["tolerance"] for expectation in world.expectations}
    rows = [line.split() for line in sections["Expectations"][1:]]
    assert [row[:3] for row in rows] == [[kind, name, "ok"] for kind in bounds for name in selection.engines]
    for row in rows:
        assert f"{bounds[row[0]]:.4g}" in row[4:6], row
    assert [line.split()[0] for line in sections["Repeatability"][1:]] == list(selection.engines)
    lines = [line.split() for line in sections["Differences"]]
    pairs = [(line[0], after[0]) for line, after in itertools.pairwise(lines) if line[1:2] == ["–"]]
    assert pairs == list(itertools.combinations(selection.engines, 2))


def test_the_python_of_the_readme_runs_and_proves_what_the_first_comparison_says(place):
    code = re.search(r"## From Python\n\n```python\n(.*?)```", README, re.DOTALL)
    assert code
    command = [sys.executable, "-c", code.group(1) + PRINTED_COUNTS]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    *printed, last = done.stdout.splitlines()
    assert printed
    sections, (counts, notes) = first_comparison(), json.loads(last)
    shown = dict(zip(sections["Model:"][0].split()[2:], counts_of(sections["Model:"]), strict=True))
    assert counts.items() <= shown.items(), "python tools/readme.py README.md"
    # the floor of the motion is a figure of the machine; other engines have notes of their own
    assert {line for line in words("\n".join(notes)) if not line.startswith("motion:")} <= set(sections["Model:"])


def counts_of(lines: list[str]) -> list[int]:
    """The numbers of comparisons by engine."""
    return [
        int(word.replace(",", "")) for line in lines if line.startswith("comparisons ") for word in line.split()[1:]
    ]


def test_a_page_is_not_filled_where_other_engines_are_installed():
    assert not readme.other_engines(readme.ENGINES)
    missing, other = readme.other_engines([*(set(readme.ENGINES) - {"drake"}), "mjx"])
    assert missing.startswith("drake: not installed")
    assert other.startswith("mjx: installed")


def test_commands_of_a_page_see_nothing_of_the_user_s_and_say_why_they_fail(place, monkeypatch):
    """A failed command once showed its exit code only, and engines of the user's data folder were in the page."""
    monkeypatch.setenv("XDG_DATA_HOME", str(place))
    assert readme.environment(place / "empty")["XDG_DATA_HOME"] == str(place / "empty")
    with pytest.raises(SystemExit, match=r"exit code 2\n\n.*nowhere\.yaml"):
        readme.simspec(["check", "nowhere.yaml"], place)


def test_the_readme_says_how_to_run_the_command():
    """``make setup`` makes an environment, and a shell that does not know of it finds no simspec."""
    steps = re.search(r"```\n(make setup .*?)```", README, re.DOTALL)
    assert steps
    first, second, *others = (line.partition("#")[0].strip() for line in steps.group(1).splitlines())
    assert (first, second) == ("make setup", "source .venv/bin/activate")
    assert "BIN := .venv/bin\n" in (ROOT / "Makefile").read_text(encoding="utf-8")
    assert others[0].startswith("simspec ")


def test_every_page_it_links_to_exists():
    for link in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / link).exists(), link
