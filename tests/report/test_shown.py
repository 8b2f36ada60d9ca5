"""``show()``: the page that a notebook displays, and the line that is printed elsewhere."""

from __future__ import annotations

import html
import re
import sys
from types import SimpleNamespace

import pytest

from simspec.errors import SpecError
from simspec.report.notebook import OUTSIDE, in_notebook
from simspec.report.page.document import is_page
from tests.report.page import samples


@pytest.fixture(scope="module")
def study():
    return samples.a_study(samples.a_world(samples.HOSTILE_BODIES, samples.HOSTILE[4]), engines=("first",))


def test_worlds_runs_and_studies_are_pages_in_separate_frames(study):
    for shown in (study.world.show(), study.runs["first"].show(width=700, height=300), study.show()):
        text = shown._repr_html_()
        source = html.unescape(re.search(r'srcdoc="([^"]*)"', text).group(1))
        assert is_page(source.encode())
        assert source == shown.html
        assert text.startswith('<iframe sandbox="allow-scripts" ')
        assert f'width="{shown.width}" height="{shown.height}"' in text
        assert text.count("<") == text.count(">") == 2  # a name in the page ends neither the attribute nor the frame
    assert (shown.width, shown.height) == (960, 620)


def test_outside_a_notebook_a_line_says_what_to_do(study, monkeypatch, capsys):
    shown = study.world.show()
    assert capsys.readouterr().err == f"{OUTSIDE}\n"
    assert OUTSIDE in repr(shown)
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=object())))
    assert in_notebook()
    study.world.show()
    assert capsys.readouterr().err == ""
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: None))
    assert not in_notebook()


def test_a_shown_page_is_saved_and_opened(study, tmp_path, monkeypatch):
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    path = study.world.show().open(tmp_path / "scene.html")
    assert opened == [path.as_uri()]
    assert is_page(path.read_bytes())
    (tmp_path / "mine.html").write_text("mine")
    with pytest.raises(SpecError, match=r"mine\.html"):
        study.world.show().save(tmp_path / "mine.html")


@pytest.mark.parametrize("size", [0, -3, 99, 10_001])
def test_a_size_that_nothing_has_is_refused(study, size):
    with pytest.raises(SpecError, match="height of a shown page"):
        study.world.show(height=size)
