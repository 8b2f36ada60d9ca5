"""The live scene in a browser: sliders move the model; without the token, and from other sites, nothing is to be had."""

from __future__ import annotations

import http.client
import time
from urllib.parse import urlsplit

import pytest

import simspec
from tests import browser

viser = pytest.importorskip("viser", reason="viser is not installed (extra view)")
client = pytest.importorskip("websockets.sync.client")

from simspec.report.viewer.guard import serving  # noqa: E402
from simspec.report.viewer.scene import GROUPS, LiveScene  # noqa: E402

PROTOCOL = f"viser-v{viser.__version__}"
PATIENCE = 60.0


@pytest.fixture(scope="module")
def live():
    """The scene of a gripper, and the address of its page."""
    world = simspec.load(simspec.find_spec("coupled-gripper")).resolve()
    with serving(0, world.name) as (server, address):
        yield LiveScene(server, world), address


def answer(address: str, path: str, **headers: str) -> tuple[int, bytes]:
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=PATIENCE)
    try:
        connection.request("GET", path, headers=headers)
        response = connection.getresponse()
        return response.status, response.read()
    finally:
        connection.close()


def first_message(address: str, path: str, **options) -> bytes:
    """The first thing that the websocket at ``path`` sends."""
    parts = urlsplit(address)
    with client.connect(f"ws://{parts.netloc}{path}", subprotocols=[PROTOCOL], proxy=None, **options) as connection:
        return connection.recv(timeout=PATIENCE)


def eventually(check) -> None:
    """Wait until a check holds."""
    end = time.monotonic() + PATIENCE
    while not check():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.parametrize(
    "path", ["/", "/index.html", "/wrong-token/", "/../index.html", "/favicon.ico", "/?token={token}"]
)
def test_without_the_token_no_file_is_served(live, path):
    _, address = live
    token = urlsplit(address).path.strip("/")
    assert answer(address, path.format(token=token)) == (403, b"")
    assert answer(address, path.format(token=token), Upgrade="websocket", Connection="Upgrade") == (403, b"")


@pytest.mark.parametrize(
    "headers", [{"Host": "example.org"}, {"Origin": "http://example.org"}, {"Origin": "null"}, {"Origin": ""}]
)
def test_another_site_gets_no_file_even_with_the_token(live, headers):
    _, address = live
    assert answer(address, urlsplit(address).path, **headers) == (403, b"")


def test_with_the_token_the_page_is_served_and_may_load_nothing_from_elsewhere(live):
    _, address = live
    status, content = answer(address, urlsplit(address).path)
    assert status == 200
    assert b"<html" in content[:200].lower()
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=PATIENCE)
    connection.request("GET", parts.path)
    policy = connection.getresponse().headers["Content-Security-Policy"]
    connection.close()
    assert policy.startswith("default-src 'none';")
    assert f"ws://{parts.netloc}" in policy
    assert answer(address, f"{parts.path}../infra/_infra.py")[0] == 404


def test_the_websocket_demands_the_token_and_the_pages_origin(live):
    _, address = live
    parts = urlsplit(address)
    allowed = parts.path.rstrip("/")
    for path, options in (
        ("", {}),
        ("/", {}),
        ("/wrong-token", {}),
        (f"/?token={allowed.strip('/')}", {}),
        (allowed, {"origin": "http://example.org"}),
        (allowed, {"origin": "null"}),
        (allowed, {"origin": f"http://localhost:{parts.port}"}),
    ):
        with pytest.raises(Exception, match="403"):
            first_message(address, path, **options)
    assert first_message(address, allowed)
    assert first_message(address, allowed, origin=f"http://{parts.netloc}")


def test_a_page_cannot_have_the_scene_shared_on_the_internet(live):
    scene, _ = live
    assert scene.server.request_share_url() is None
    assert scene.server._share_tunnel is None


def test_every_group_is_switched_on_and_off(live):
    scene, _ = live
    for group in GROUPS:
        shown = group in scene._shown
        scene.show(group, not shown)
        nodes = [entry.node for entry in scene._groups.get(group, ())]
        assert all(node.visible is not shown for node in nodes)
        scene.show(group, shown)
        assert all(node.visible is shown for node in nodes)
    assert scene._groups.keys() | {"contact pairs"} == set(GROUPS)


@pytest.fixture(scope="module")
def running():
    with browser.browsers() as start:
        yield start(*browser.SOFTWARE)


@pytest.mark.browser
def test_sliders_move_the_model(live, running):
    scene, address = live
    names = [body.name for body in scene.world.bodies]
    before = dict(scene.placed)
    page = running.new_page()
    page.goto(address)
    sliders = page.get_by_role("slider")
    sliders.nth(1).wait_for(timeout=browser.PATIENCE)
    sliders.nth(1).focus()
    page.keyboard.press("End")
    eventually(lambda: scene.positions["left_slide"] == (0.05,))
    eventually(lambda: scene._bodies["right"].node.position[0] != pytest.approx(before["right"].position[0]))
    moved = {name: scene._bodies[name].node.position - before[name].position for name in names}
    shift = 0.05 - scene.world.bodies[names.index("left")].joint.position[0]
    assert moved["left"] == pytest.approx((shift, 0.0, 0.0))
    assert moved["right"] == pytest.approx((-shift, 0.0, 0.0))  # it follows
    assert moved["bar"] == pytest.approx((0.0, 0.0, 0.0))
    page.get_by_role("button", name="Initial state").click()
    eventually(lambda: scene.placed == before)
    eventually(lambda: sliders.nth(1).get_attribute("aria-valuenow") != "0.05")
    other = running.new_page()
    with pytest.raises(Exception, match="ERR_HTTP_RESPONSE_CODE_FAILURE"):  # refused, and empty
        other.goto(address.replace(urlsplit(address).path, "/"))


@pytest.mark.browser
def test_the_page_in_a_notebook_works_in_a_frame_that_reaches_nothing_else(live, running, tmp_path):
    scene, _ = live
    path = tmp_path / "notebook.html"
    path.write_text(f"<h1>notebook</h1>{scene.world.show(width=500, height=400)._repr_html_()}", encoding="utf-8")
    page = running.new_page()
    page.goto(path.as_uri())
    box = page.locator("iframe").bounding_box()
    assert (box["width"], box["height"]) == (500, 400)
    frame = page.frames[1]
    frame.wait_for_selector("html[data-state=ready]", state="attached", timeout=browser.PATIENCE)
    assert frame.get_by_role("slider").count() > 1
    assert frame.evaluate("() => { try { return parent.document.title } catch (error) { return error.name } }") == (
        "SecurityError"
    )
