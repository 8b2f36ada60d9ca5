"""docs/guide/import.md and docs/guide/import-usd.md: their tables are those of the importers, and the example is
what simspec prints."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from simspec import cli
from simspec.imports.reference import PAGES, missing, update

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "import.md"
TEXT = PAGE.read_text(encoding="utf-8")


def block(title: str) -> str:
    found = re.search(rf"<!-- import: {title} -->\n```\w+\n(.*?)```", TEXT, re.DOTALL)
    assert found is not None, title
    return found[1]


def test_the_tables_are_current():
    texts = [page.read_text(encoding="utf-8") for page in sorted(PAGE.parents[2].glob(PAGES))]
    assert missing("".join(texts)) == []
    for text in texts:
        assert update(text) == text, "stale: python -m simspec.imports.reference writes them"


def test_a_stale_table_is_noticed():
    assert update(TEXT.replace("`joint.damping`", "`damping`")) == TEXT
    assert "elements of urdf" not in missing(TEXT)
    assert "elements of urdf" in missing(TEXT.replace("elements of urdf", "elements"))


@pytest.mark.parametrize(
    ("words", "out", "error"),
    [((), None, "the defect"), (("--repair", "triangle-inequality"), "the spec", "the losses")],
)
def test_the_example_is_what_simspec_prints(tmp_path, monkeypatch, words, out, error):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "crane.urdf").write_text(block("the file"))
    done = CliRunner().invoke(cli.app, ["import", "crane.urdf", *words])
    assert done.exit_code == (0 if out else 2)
    assert done.stdout == (block(out) if out else "")
    lines = lambda text: [line.rstrip() for line in text.splitlines() if line.strip()]  # noqa: E731
    assert lines(done.stderr) == lines(block(error))
