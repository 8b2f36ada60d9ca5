"""docs/guide/sweeps.md is correct: its spec is valid, its commands run, one after the other, and its Python works on their
results."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from simspec import cli

pytestmark = pytest.mark.usefixtures("warm_engines")

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "guide" / "sweeps.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"<!-- (spec|output): (.*?) -->\n```\w*\n(.*?)```", re.DOTALL)
TIMES = re.compile(r"[\d.,]+ ×|about .*|\d+ verified now")
"""Text that differs at each run: speeds, and the proofs that this test leaves out."""


def stable_lines(text: str) -> list[str]:
    """The lines of an output without the text that differs at each run, and without the widths of columns."""
    return [re.sub(r"[\s─]+", " ", TIMES.sub("", line)).strip() for line in text.splitlines()]


def test_the_page_s_commands_print_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "110")
    blocks = BLOCK.findall(PAGE)
    assert [kind for kind, _, _ in blocks] == ["spec", "output", "output", "output"]
    for kind, what, text in blocks:
        if kind == "spec":
            (tmp_path / what).write_text(text)
            continue
        name, *words = shlex.split(what)
        assert name == "simspec"
        done = CliRunner().invoke(cli.app, words if "--dry-run" in words else [*words, "--no-verify"])
        assert done.exit_code == 0, done.output
        lines = [line for line in stable_lines(done.stdout) if line and not line.startswith("proof:")]
        assert lines == [line for line in stable_lines(text)[1:] if line and not line.startswith("proof:")]
    code = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert code is not None
    exec(compile(code[1], "docs/guide/sweeps.md", "exec"), {})
    assert len(capsys.readouterr().out.splitlines()) == 24
