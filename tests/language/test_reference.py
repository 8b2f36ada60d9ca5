"""docs/reference/language.md: its tables are those of the models, every model has one."""

from __future__ import annotations

from pathlib import Path

import pytest

from simspec.language.document import parse
from simspec.language.expectations import KINDS
from simspec.language.load import Spec
from simspec.language.reference import missing, study_tables, tables, update
from simspec.runner.expectations import MEASURES

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "language.md"
STUDIES = PAGE.parents[1] / "guide" / "studies.md"


def test_the_tables_are_current():
    text = PAGE.read_text(encoding="utf-8")
    assert missing(text) == []
    assert update(text) == text, "stale: python -m simspec.language.reference writes them"


def test_the_tables_of_studies_are_current():
    text = STUDIES.read_text(encoding="utf-8")
    assert missing(text, study_tables()) == []
    assert update(text) == text, "stale: python -m simspec.language.reference writes them"
    assert "[Sweep](../reference/language.md#sweep)" in text


def test_the_tables_say_what_the_models_say():
    body = tables()["Body"]
    assert "| `mass` | a mass ≥ 0 | kg |" in body
    assert "[Joint](#joint)" in body
    assert tables()["Expectation"].count("\n| `") == len(KINDS)


def test_a_stale_table_is_noticed():
    text = PAGE.read_text(encoding="utf-8")
    assert update(text.replace("| kg |", "| g |", 1)) == text


def test_every_kind_of_expectation_is_measured():
    assert set(KINDS) == set(MEASURES)


def blocks():
    text = PAGE.read_text(encoding="utf-8")
    return [block.split("```")[0] for block in text.split("```yaml\n")[1:]]


@pytest.mark.parametrize("number", range(len(blocks())))
def test_the_examples_work(number):
    """Every example that is a whole spec resolves; the others are YAML."""
    document = parse(blocks()[number], "example")
    assert not document.problems
    if "simspec" in document.data:
        # laws that need a tree's dynamics have none with a ball joint: their arm has a hinge for a wrist
        folder = Path(__file__).parent / "data" / ("driven" if "control" in document.data else "")
        Spec.from_data(document.data, folder=folder).resolve()
