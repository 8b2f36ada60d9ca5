"""The README is correct: its commands run, its spec is the library's, its Python works."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import simspec
from simspec import cli
from simspec.engines.kit.registry import engines
from simspec.report.verdict import LABEL, grouped
from simspec.selection import available
from tests.nightly import EVERYTHING, WHY

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tools"))

import readme  # noqa: E402 - a script outside the package

pytestmark = pytest.mark.usefixtures("warm_engines")

FIRST = "simspec run specs/double-pendulum.yaml --all-engines"
"""The command of the first comparison."""
PRINTED = """
import json
valid = {name: proof for name, proof in certificate.engines.items() if proof.valid}
print(json.dumps({name: sum(check.count for check in proof.checks) for name, proof in valid.items()}))
"""
"""Appended to the Python of the README: it prints the number of comparisons of each valid proof."""
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")


def block(marker: str, page: str = README) -> str:
    """The fenced block after a marker."""
    found = re.search(re.escape(f"<!-- {marker} -->") + r"\n```\w*\n(.*?)```", page, re.DOTALL)
    assert found, f"the page has no block after {marker!r}"
    return found.group(1)


@pytest.fixture
def place(tmp_path):
    """An empty folder with the library in it."""
    (tmp_path / "specs").symlink_to(ROOT / "specs")
    return tmp_path


@pytest.mark.parametrize("command", block("commands: tested", COMMANDS).splitlines())
def test_a_command_of_the_documentation_runs(command, place, monkeypatch, capsys):
    monkeypatch.chdir(place)
    name, *words = shlex.split(command)
    assert name == "simspec"
    code = cli.main(words)
    said = capsys.readouterr()
    # diff ends with 1 where it finds differences, as diff does
    assert code == (1 if words[0] == "diff" else 0), said.out + said.err
    assert said.out.strip()
    assert "Traceback" not in said.err


def test_the_spec_in_the_readme_is_the_library_s():
    assert block("file: specs/double-pendulum.yaml") == (ROOT / "specs" / "double-pendulum.yaml").read_text()


def first_comparison() -> dict[str, str]:
    """The parts of the verdict in the README by label, each on one line."""
    parts: dict[str, str] = {}
    label = ""
    for line in block(f"output: {FIRST}").splitlines()[1:]:
        label = line[:LABEL].strip() or label
        parts[label] = f"{parts.get(label, '')} {line[LABEL:]}".strip()
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
    parts = first_comparison()
    assert parts["model"].startswith(f"same in all {len(selection.engines)} engines (")
    assert parts["motion"].startswith(f"{', '.join(selection.engines)} agree within ")
    assert parts["expectations"] == f"{len(world.expectations)} of {len(world.expectations)} met"
    assert parts.get("not run", "") == grouped(selection.not_taken)
    assert all(name in parts["speed"] for name in selection.engines)


@pytest.mark.slow
@pytest.mark.skipif(not EVERYTHING, reason=WHY)
def test_the_first_comparison_has_the_number_of_comparisons_of_today(place):
    the_page_s_engines_or_skip()
    printed = readme.simspec(shlex.split(FIRST)[1:], place)
    model = next(line for line in printed.splitlines() if line.startswith("model"))
    assert model in block(f"output: {FIRST}"), "python tools/readme.py README.md"


def test_the_readme_is_short():
    assert len(README.splitlines()) <= 120


def test_the_python_of_the_readme_runs_and_proves_both_engines(place):
    code = re.search(r"## From Python\n\n```python\n(.*?)```", README, re.DOTALL)
    assert code
    command = [sys.executable, "-c", code.group(1) + PRINTED]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    *printed, last = done.stdout.splitlines()
    assert printed
    counts = json.loads(last)
    assert list(counts) == ["mujoco", "dart"]
    shown = re.search(r"\(([\d,]+) comparisons\)", first_comparison()["model"])
    assert shown
    assert sum(counts.values()) < int(shown[1].replace(",", ""))


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
