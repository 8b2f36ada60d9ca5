"""The pages of errors: each example reports its code, and the mended example does not; generated pages are current."""

from __future__ import annotations

import re
import shutil

import pytest

from simspec.codes import CODES
from simspec.commands.help import wrapped
from simspec.report.error_pages import APPROXIMATE, NOTES, OUTSIDE, generated, notes_of, page_files, page_of
from tests import error_pages
from tests.error_pages import NOT_RUN, PAGES, done, forget, halves, not_said, reported
from tests.installed import INSTALLED

pytestmark = pytest.mark.usefixtures("warm_engines")

WITHOUT_RUN = {"C110", "C111", "C115", "C118", "C119", "E204", "I116", "P102"}
"""Codes whose example cannot be run in a test; their pages say why."""
WRITTEN = sorted(code for code in CODES if (PAGES / f"{code}.md").is_file())
NEEDS = {
    "mujoco": re.compile(r"simspec (run|explain) .*-e mujoco|\.run\(|arm\.xml"),
    "ode": re.compile(r"simspec run .*-e ode"),
    "xacro": re.compile(r"\.xacro"),
    "pinocchio": re.compile("largest_stable|law: computed|unstable|program:"),
}
"""Packages that an example needs, by words of its page that show it."""


def text_of(code: str) -> str:
    return (PAGES / f"{code}.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module", autouse=True)
def forgotten():
    """Stored runs of examples are removed at the end."""
    yield
    forget()


def test_each_code_has_a_page():
    assert not set(CODES) - set(WRITTEN)


def test_pages_have_the_titles_of_the_table():
    assert not [code for code in WRITTEN if not text_of(code).startswith(f"# {code}: {CODES[code]}\n")]


def test_no_page_is_of_an_unknown_code():
    known = {*page_files().values(), "index.md", "accept/notes.md"}
    assert not {path.relative_to(PAGES).as_posix() for path in PAGES.rglob("*.md")} - known


def test_pages_without_an_example_that_runs_say_why():
    assert {code for code in WRITTEN if NOT_RUN.search(text_of(code))} == WITHOUT_RUN


@pytest.mark.parametrize("code", [code for code in WRITTEN if code not in WITHOUT_RUN])
def test_an_example_reports_its_code_and_the_way_out_does_not(code, tmp_path):
    page = text_of(code)
    for name, words in NEEDS.items():
        if words.search(page) and name not in INSTALLED:
            pytest.importorskip(name)
    wrong, right = halves(page)
    (tmp_path / "wrong").mkdir()
    said = done(wrong, tmp_path / "wrong")
    assert code in reported(said), said
    assert not not_said(wrong.reports, said), said
    (tmp_path / "right").mkdir()
    mended = done(right, tmp_path / "right")
    assert not reported(mended), mended
    shutil.rmtree(tmp_path)


def test_an_example_is_completed_without_moving_its_lines():
    text = error_pages.completed("expect: []\n")
    assert text.startswith("expect: []\nsimspec: 1\n")
    assert {"bodies:", "physics:", "name:"} <= {line.split(" ")[0] for line in text.splitlines()}


def test_a_line_that_was_not_printed_is_found():
    assert not_said(["a: error[S101]: b", "a: error…"], "a: error[S102]: b\n") == ["a: error[S101]: b"]


# --- generated pages ----------------------------------------------------------------------------------------------------


def test_generated_pages_are_current():
    stale = {
        name
        for name, text in generated(PAGES).items()
        if not (PAGES / name).is_file() or (PAGES / name).read_text() != text
    }
    assert not stale, "python -m simspec.report.error_pages writes them"


def test_features_that_an_engine_approximates_have_a_note():
    notes = notes_of((PAGES / NOTES).read_text(encoding="utf-8"))
    pages = {word: page_of(word) or "" for word in page_files() if (PAGES / "accept" / f"{word}.md").is_file()}
    needed = {word for word, page in pages.items() if f"## {APPROXIMATE}" in page or f"## {OUTSIDE}" in page}
    assert len(needed) > 20
    assert needed <= notes.keys()


def test_a_note_of_an_unknown_feature_is_refused():
    assert notes_of("## `joint.damping`\n\nA note.\n") == {"joint.damping": "A note."}
    with pytest.raises(ValueError, match=r"joint\.dampin"):
        notes_of("## joint.dampin\n\nA note.\n")


@pytest.mark.parametrize("word", ["S101", "s101", "Material.Restitution", "mass-ratio"])
def test_pages_are_found_by_their_word(word):
    assert page_of(word)


def test_a_page_fits_the_terminal():
    page = (
        "# A: b\n\n<!-- not run: x -->\n\n"
        + "word " * 30
        + "\n\n- "
        + "item " * 20
        + "\n\n```text\n"
        + "x" * 90
        + "\n```\n"
    )
    lines = list(wrapped(page, 40))
    assert max(map(len, lines)) == 90
    assert all(len(line) <= 40 for line in lines if not line.startswith("x"))
    assert "not run" not in "\n".join(lines)
    assert "  item item" in "\n".join(lines)


def test_words_without_page_have_none():
    assert page_of("S1") is None
    assert page_of("../index") is None
