"""The page of a scene that was not run: its content, and in a browser sliders that move the model."""

from __future__ import annotations

import dataclasses
import json
import math
import re

import pytest

from simspec.report.page.model import contacts, model_data
from simspec.report.page.scene import scene_page
from simspec.world.actions import Force
from simspec.world.types import Body, ConnectConstraint, Contact, FollowConstraint, Inertial, Joint, Pose, Shape
from tests import browser
from tests.report.page import samples

LINK = 0.5
POSITION = "body => window.simspec.players[0].stage.position(0, body)"


def link(name: str, parent: str | None, **joint) -> Body:
    """A link of 0.5 m along x, on a hinge about y at the end of its parent."""
    origin = Pose((0.0 if parent is None else LINK, 0.0, 0.0))
    made = Joint(f"{name}_joint", "hinge", parent, origin, (0.0, 1.0, 0.0), position=(0.0,), velocity=(0.0,), **joint)
    return Body(name, "chain", Inertial(1.0), made, (Shape(f"{name}_rod", "box", (LINK, 0.05, 0.05)),))


def a_chain():
    """Three links, of which the last follows the first; the second ends on a point of the world's body."""
    floor = samples.floor_body()
    bodies = (floor, link("upper", None, position_limits=(-1.0, 0.5)), link("lower", "upper"), link("tip", "lower"))
    loop = ConnectConstraint("closed", "floor", "lower", (2 * LINK, 0.0, 0.0), (LINK, 0.0, 0.0))
    return dataclasses.replace(
        samples.a_world(),
        bodies=bodies,
        constraints=(loop, FollowConstraint("mimic", "tip_joint", "upper_joint", -2.0, 0.25)),
        forces=(Force("lower", (3.0, 0.0, 0.0)),),
        controllers=(),
        trajectory=None,
        expectations=(),
    )


def scene_in(page: str) -> dict:
    (found,) = re.findall(r'<script type="application/json" id="scenes">(.*?)</script>', page, re.DOTALL)
    (scene,) = json.loads(found)["scenes"]
    return scene


def test_it_says_what_there_is_and_loads_nothing():
    page = scene_page(a_chain(), notes=("One note & more.",))
    assert page == scene_page(a_chain(), notes=("One note & more.",))
    assert "Initial state, not run: 4 bodies, 3 kg; 3 hinges and 1 fixed joint." in page
    assert "-1 to 0.5 rad" in page
    assert '<p class="note">One note &amp; more.</p>' in page
    assert "default-src &#39;none&#39;" in page
    assert "Provenance" not in page
    scene = scene_in(page)
    assert scene["runs"] == []
    assert scene["moving"] == [1, 2, 3]
    assert [joint["limits"] for joint in scene["model"]["joints"]] == [None, [-1.0, 0.5], None, None]
    assert scene["model"]["follows"] == [{"body": 3, "leader": 1, "ratio": -2.0, "offset": 0.25}]


def test_names_that_are_markup_stay_text():
    page = scene_page(samples.a_world(samples.HOSTILE_BODIES, samples.HOSTILE[4]))
    assert samples.HOSTILE[0] not in page
    assert samples.HOSTILE[1] not in page


def test_bodies_that_may_touch_the_same_others_share_a_class():
    balls = tuple(
        Body(f"ball{k}", f"ball{k}", Inertial(1.0), Joint(f"free{k}", "free", position=(0, 0, k, 1, 0, 0, 0)),
             (Shape(f"s{k}", "sphere", (0.1,)),))
        for k in range(4)
    )  # fmt: skip
    world = dataclasses.replace(
        samples.a_world(), bodies=(samples.floor_body(), *balls), contact=Contact(excluded_bodies=(("ball2", "ball3"),))
    )
    found = contacts(world)
    assert found["classes"] == [[0], [1, 2], [3, 4]] or found["classes"] == [[0, 1, 2], [3, 4]]
    assert found["bodies"] == 5
    touching = {
        frozenset((a, b))
        for first, second in found["pairs"]
        for a in found["classes"][first]
        for b in found["classes"][second]
        if a != b
    }
    assert touching == {frozenset((a, b)) for a in range(5) for b in range(a) if {a, b} != {3, 4}}


def test_a_report_of_runs_has_no_free_and_fixed_joints():
    assert [joint["name"] for joint in model_data(samples.a_world())["joints"]] == ["elbow"]


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.html"
    path.write_text(scene_page(a_chain()), encoding="utf-8")
    with browser.browsers() as start, browser.opened(start(*browser.SOFTWARE), path) as (page, messages):
        yield page, messages


def move(page, slider: int, value: float) -> None:
    page.locator(".joint input").nth(slider).evaluate(
        f"e => {{ e.value = {value}; e.dispatchEvent(new Event('input')); }}"
    )


@pytest.mark.browser
def test_sliders_move_the_model_within_limits_and_followers_follow(shown):
    page, messages = shown
    page.get_by_role("button", name="initial state").click()
    first, _, tip = page.locator(".joint input").all()
    assert (first.get_attribute("min"), first.get_attribute("max")) == ("-1", "0.5")
    assert tip.is_disabled()
    assert page.evaluate(POSITION, 2) == pytest.approx([LINK, 0.0, 0.0], abs=1e-6)
    move(page, 0, 0.4)
    turned = [LINK * math.cos(0.4), 0.0, -LINK * math.sin(0.4)]
    assert page.evaluate(POSITION, 2) == pytest.approx(turned, abs=2e-3)  # sliders have 1000 steps
    assert page.locator(".joint output").all_inner_texts() == ["22.9°", "0.0°", "−31.5°"]
    assert "loop “closed” is open by" in page.locator(".broken").inner_text()
    move(page, 0, 9.0)
    assert page.locator(".joint output").first.inner_text() == "28.6°"
    page.get_by_role("button", name="initial state").click()
    assert page.locator(".broken").inner_text() == ""
    assert not messages


@pytest.mark.browser
def test_layers_marks_and_contact_partners_change_the_picture(shown):
    page, messages = shown
    stage = page.locator(".stage")

    def picture() -> bytes:
        page.wait_for_timeout(100)
        return stage.screenshot()

    seen = [picture()]
    page.get_by_label("shapes").select_option("both")
    seen.append(picture())
    for name in ("frames", "joint axes", "loads"):
        page.get_by_label(name, exact=True).click()
        seen.append(picture())
    page.get_by_label("contact partners").select_option("upper")
    seen.append(picture())
    assert len(set(seen)) == len(seen)
    assert not messages
