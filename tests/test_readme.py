"""The README tells the truth: its commands run, its spec is the library's, its Python works."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
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


def test_the_python_of_the_readme_runs(place):
    code = re.search(r"## From Python\n\n```python\n(.*?)```", README, re.DOTALL)
    assert code
    done = subprocess.run([sys.executable, "-c", code.group(1)], cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_every_page_it_links_to_exists():
    for link in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / link).exists(), link
