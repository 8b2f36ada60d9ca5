"""The page of a study in a browser: plots with intervals that are linked, by mouse and by keyboard; names stay text."""

from __future__ import annotations

import pytest

from simspec.report.page.document import page as page_of
from simspec.report.studies import load_study
from simspec.report.study.pages import study_section
from tests import browser
from tests.report.page import samples, study_samples

pytestmark = pytest.mark.browser
SHOWN = "(index) => window.simspec.charts[0].shown(index)"
PLOTS = 6
"""Speed, validity, speed over time, contacts over time, equal models, unequal ones."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A study whose page has a playback too, and one whose every name is markup."""
    folder = tmp_path_factory.mktemp("study-pages")
    played = load_study(samples.stored(samples.a_study(), folder / "played"))
    hostile = study_samples.study_tables(samples.HOSTILE[:2], samples.HOSTILE[4])
    made = {"usual": [study_section(study_samples.study_tables()), played], "hostile": [study_section(hostile)]}
    for name, parts in made.items():
        (folder / f"{name}.html").write_text(page_of(parts), encoding="utf-8")
    return {name: folder / f"{name}.html" for name in made}


@pytest.fixture(scope="module")
def start():
    with browser.browsers() as starter:
        yield starter


@pytest.fixture(scope="module")
def running(start):
    return start(*browser.SOFTWARE)


@pytest.mark.parametrize(
    ("size", "scheme"), [((1280, 900), "light"), ((820, 1180), "dark"), ((390, 844), "light")], ids=str
)
def test_it_opens_without_a_word_and_fits(running, files, size, scheme):
    with browser.opened(running, files["usual"], *size, color_scheme=scheme) as (page, said):
        assert page.get_attribute("html", "data-state") == "ready"
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
        assert page.locator(".charts .uplot").count() == PLOTS
        assert page.locator(".stage canvas").count() == 1
        page.emulate_media(media="print")
        assert page.locator(".charts canvas").first.is_visible()
        assert page.pdf().startswith(b"%PDF")
    assert not said


def test_plots_with_a_common_axis_are_zoomed_together(running, files):
    with browser.opened(running, files["usual"]) as (page, said):
        whole = [page.evaluate(SHOWN, index) for index in range(PLOTS)]
        assert whole[0] == pytest.approx([1 / 1.15, 8 * 1.15])
        over = page.locator(".charts .u-over").first
        over.scroll_into_view_if_needed()
        place = over.bounding_box()
        page.mouse.move(place["x"] + 0.4 * place["width"], place["y"] + 50)
        page.mouse.down()
        page.mouse.move(place["x"] + 0.8 * place["width"], place["y"] + 50, steps=4)
        page.mouse.up()
        zoomed = [page.evaluate(SHOWN, index) for index in range(PLOTS)]
        assert zoomed[0][0] > 1.5
        assert zoomed[1] == pytest.approx(zoomed[0])  # both over the timestep
        assert zoomed[2] == whole[2]  # over time
        page.locator(".charts figure").first.focus()
        page.keyboard.press("Escape")
        assert [page.evaluate(SHOWN, index) for index in range(PLOTS)] == whole
    assert not said


def test_arrow_keys_read_the_figures_out(running, files):
    with browser.opened(running, files["usual"]) as (page, said):
        figure = page.locator(".charts figure").first
        figure.focus()
        page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowRight")
        page.wait_for_timeout(200)
        legend = figure.locator(".u-legend").inner_text()
        assert "2 ms" in legend
        assert "8 (7.2 to 8.8)" in legend
        page.keyboard.press("ArrowLeft")
        page.wait_for_timeout(200)
        assert "4 (3.6 to 4.4)" in figure.locator(".u-legend").inner_text()
    assert not said


def test_without_webgl_the_plots_are_there(start, files):
    with browser.opened(start(*browser.WITHOUT_WEBGL), files["usual"]) as (page, said):
        assert page.locator(".charts .uplot").count() == PLOTS
    assert not said


def test_without_javascript_the_sentences_and_tables_are_there(running, files):
    window = running.new_context(java_script_enabled=False)
    page = window.new_page()
    page.goto(files["usual"].as_uri())
    assert "first: all that is expected holds up to 4 ms" in page.locator(".verdict").first.inner_text()
    assert page.locator("table").count() > 5
    window.close()


def test_markup_in_names_is_text(running, files):
    with browser.opened(running, files["hostile"]) as (page, said):
        assert page.get_attribute("html", "data-state") == "ready"
        assert page.locator("script").count() == 3
        assert page.locator("img").count() == 0
        assert page.locator("[onmouseover], [onerror]").count() == 0
        assert samples.HOSTILE[0] in page.locator(".charts").inner_text()
        page.locator(".charts").hover()
        assert "owned" not in page.title()
    assert not said
