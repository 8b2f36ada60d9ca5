"""The page in a browser: it says nothing on the console, requests nothing from the network, and what is moved moves."""

from __future__ import annotations

import math

import pytest

from simspec.report.page.document import page as page_of
from simspec.report.studies import load_study
from tests import browser
from tests.report.page import samples

pytestmark = pytest.mark.browser
POSITION = "([run, body]) => window.simspec.players[0].stage.position(run, body)"
TITLE = "sample: simspec report"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A page of a usual study, and one whose every name and description is markup."""
    folder = tmp_path_factory.mktemp("pages")
    made = {}
    for name, of in (
        ("usual", samples.a_world()),
        ("hostile", samples.a_world(samples.HOSTILE_BODIES, samples.HOSTILE[4])),
    ):
        study = load_study(samples.stored(samples.a_study(of), folder / name))
        made[name] = folder / f"{name}.html"
        made[name].write_text(page_of([study]), encoding="utf-8")
    return made


@pytest.fixture(scope="module")
def start():
    with browser.browsers() as starter:
        yield starter


@pytest.fixture(scope="module")
def running(start):
    return start(*browser.SOFTWARE)


@pytest.fixture(scope="module")
def shared(running, files):
    """One window for the tests that only look, and put back what they move."""
    with browser.opened(running, files["usual"]) as window:
        yield window


@pytest.fixture
def usual(shared):
    """The page at its first time; a test in which it says anything fails."""
    page, said = shared
    page.locator("input.time").focus()
    page.keyboard.press("Home")
    yield page
    assert not said


@pytest.mark.parametrize(
    ("size", "scheme"), [((820, 1180), "dark"), ((390, 844), "light")], ids=["tablet, dark", "phone, light"]
)
def test_it_opens_without_a_word_and_fits(running, files, size, scheme):
    with browser.opened(running, files["usual"], *size, color_scheme=scheme) as (page, said):
        assert page.get_attribute("html", "data-state") == "ready"
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
        assert page.locator(".stage canvas").count() == 1
        assert page.locator(".uplot").count() == 5
        assert page.title() == TITLE
        stage, verdict = (page.locator(name).first.bounding_box()["y"] for name in (".stage", ".verdict"))
        assert (stage < verdict) == (size[0] < 600)  # a phone sees the playback first
        assert stage < size[1] / 2
    assert not said


def test_differences_can_be_drawn_larger(usual):
    usual.locator("input.time").focus()
    usual.keyboard.press("End")
    first, third = (usual.evaluate(POSITION, [run, 2]) for run in (0, 2))
    usual.select_option("select[aria-label='differences drawn larger']", "10")
    drawn = usual.evaluate(POSITION, [2, 2])
    assert usual.evaluate(POSITION, [0, 2]) == first
    assert drawn == pytest.approx([a + 10 * (b - a) for a, b in zip(first, third, strict=True)], abs=1e-5)
    assert math.dist(drawn, third) > 1.0
    usual.select_option("select[aria-label='differences drawn larger']", "1")
    assert usual.evaluate(POSITION, [2, 2]) == third


def test_the_slider_moves_bodies_and_marks(usual):
    end = int(usual.get_attribute("input.time", "max"))
    before = usual.evaluate(POSITION, [2, 2])
    mark = usual.locator(".now").first.bounding_box()["x"]
    picture = usual.locator(".stage canvas").screenshot()
    usual.locator("input.time").focus()
    usual.keyboard.press("End")
    after = usual.evaluate(POSITION, [2, 2])
    assert usual.input_value("input.time") == str(end)
    # of the third engine the second free body moves at 0.4 m/s for 2 s, along x alone
    assert after[0] - before[0] == pytest.approx(0.8, abs=1e-3)
    assert after[1:] == pytest.approx(before[1:], abs=1e-3)
    assert usual.evaluate(POSITION, [0, 2])[0] == pytest.approx(0.0, abs=1e-3)
    assert usual.locator(".now").first.bounding_box()["x"] > mark + 50
    assert usual.locator("output").inner_text() == "2.00 s"
    usual.wait_for_timeout(300)
    assert usual.locator(".stage canvas").screenshot() != picture


def test_it_plays_and_pauses_by_the_keyboard(usual):
    usual.locator("input.time").focus()
    usual.keyboard.press(" ")
    usual.wait_for_selector("button:text-is('Pause')", timeout=browser.PATIENCE)
    usual.wait_for_selector("button:text-is('Play')", timeout=browser.PATIENCE)  # at the end it stops by itself
    assert usual.locator("output").inner_text() == "2.00 s"


def test_shown_parts_are_chosen(usual):
    pictures = [usual.locator(".stage canvas").screenshot()]
    assert usual.locator(".tag").all_inner_texts() == ["first 1.0", "second 1.0", "third 1.0"]
    assert not usual.get_by_label("own colours").is_checked()  # on where a scene has visual meshes
    usual.get_by_label("own colours").check()
    usual.wait_for_timeout(300)
    pictures.append(usual.locator(".stage canvas").screenshot())
    usual.get_by_label("own colours").uncheck()
    for choice in ("button:text-is('side by side')", "button:text-is('top')", "label:has-text('second')"):
        usual.locator(choice).click()
        usual.wait_for_timeout(300)
        pictures.append(usual.locator(".stage canvas").screenshot())
    assert len(set(pictures)) == len(pictures)
    assert usual.locator(".tag").all_inner_texts() == ["first 1.0", "third 1.0"]
    assert usual.locator("label:has-text('target of driven joints')").count() == 1
    assert usual.locator("label:has-text('contact forces')").count() == 1
    usual.locator("button:text-is('overlaid')").click()
    usual.locator("label:has-text('second')").click()


def test_a_click_in_a_plot_is_a_time(usual):
    plot = usual.locator(".u-over").first
    plot.click(position={"x": 0.5 * plot.bounding_box()["width"], "y": 20})
    assert float(usual.locator("output").inner_text().split()[0]) == pytest.approx(1.0, abs=0.05)


def test_without_webgl_the_plots_and_tables_are_there(start, files):
    with browser.opened(start(*browser.WITHOUT_WEBGL), files["usual"]) as (page, said):
        assert page.get_attribute("html", "data-state") == "ready"
        assert "no WebGL" in page.locator(".stage").inner_text()
        assert page.locator(".uplot").count() == 5
        page.locator("input.time").focus()
        page.keyboard.press("End")
        assert page.locator("output").inner_text() == "2.00 s"
    assert not said


def test_without_javascript_the_verdict_and_the_tables_are_there(running, files):
    window = running.new_context(java_script_enabled=False)
    page = window.new_page()
    page.goto(files["usual"].as_uri())
    assert "motions part" in page.locator(".verdict li").first.inner_text()
    assert "need JavaScript" in page.locator("noscript").inner_text()
    assert page.locator("table").count() > 5
    window.close()


def test_markup_in_names_is_text(running, files):
    with browser.opened(running, files["hostile"]) as (page, said):
        assert page.get_attribute("html", "data-state") == "ready"
        assert page.title() == "line\\u2028separator\\u2029and \\x00 control: simspec report"
        # the program, and two blocks of data: no name has become an element
        assert page.locator("script").count() == 3
        assert page.locator("img").count() == 0
        assert page.locator("[onmouseover], [onerror]").count() == 0
        text = page.locator("main").inner_text()
        for name in samples.HOSTILE_BODIES[1:]:
            assert name in text
        page.locator(".verdict").first.hover()
        assert "owned" not in page.title()
    assert not said


def test_it_prints(usual):
    assert usual.pdf().startswith(b"%PDF")
    usual.emulate_media(media="print")
    assert usual.locator(".controls").is_hidden()
    assert usual.locator(".plots canvas").first.is_visible()
    usual.emulate_media(media="screen")
