"""``simspec view``: scenes, reports and videos; ports in use, no viser, no display, an interrupt."""

from __future__ import annotations

import http.client
import json
import os
import re
import shutil
import signal
import socket
import stat
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from simspec import cli
from simspec.commands.view import no_display
from simspec.errors import EXIT_OK, EXIT_WRONG
from simspec.report.page.document import is_page
from simspec.report.screen import PAGE_FILE
from tests.report.page import samples

needs_viser = pytest.mark.skipif(find_spec("viser") is None, reason="viser is not installed (extra view)")


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return samples.stored(samples.a_study(), tmp_path_factory.mktemp("kept") / "sample")


@pytest.fixture
def folder(kept, tmp_path):
    return shutil.copytree(kept, tmp_path / "sample")


def call(*words: object) -> int:
    return cli.main([str(word) for word in words])


# --- reports ------------------------------------------------------------------------------------------------------------------


def test_view_opens_the_page_in_the_users_browser(folder, tmp_path, monkeypatch, capsys):
    browser, opened = tmp_path / "browser", tmp_path / "opened"
    browser.write_text(f'#!/bin/sh\nprintf %s "$1" > {opened}\n')
    browser.chmod(browser.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    assert call("view", folder) == EXIT_OK
    assert opened.read_text() == (folder / PAGE_FILE).absolute().as_uri()
    assert capsys.readouterr().out == f"{folder / PAGE_FILE}: opened\n"
    before = (folder / PAGE_FILE).stat().st_ino
    assert call("view", folder) == EXIT_OK
    assert (folder / PAGE_FILE).stat().st_ino == before  # it was current


def test_view_without_a_display_says_so_and_writes(folder, monkeypatch, capsys):
    for name in ("BROWSER", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert call("view", folder) == EXIT_OK
    assert capsys.readouterr().out == f"written: {folder / PAGE_FILE} (not opened: there is no display)\n"
    assert is_page((folder / PAGE_FILE).read_bytes())


@pytest.mark.parametrize(
    ("environment", "platform", "shown"),
    [
        ({}, "linux", False),
        ({"DISPLAY": ""}, "linux", False),
        ({"DISPLAY": ":0"}, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({"BROWSER": "w3m"}, "linux", True),
        ({}, "darwin", True),
        ({}, "win32", True),
    ],
)
def test_where_windows_can_be_shown(environment, platform, shown):
    assert (no_display(environment, platform) is None) is shown


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--port", "8080"), "--port is without effect: the report of runs is a file"),
        (("--set", "physics.timestep=2ms"), "--set is without effect: these are stored runs"),
        (("--arg", "a=1"), "--arg is without effect"),
        (("--fps", "30"), "--fps is without effect: no --video or --gif"),
        (("--gif", "a.gif", "--page", "a.html"), "--page or --out is without effect"),
        (("--gif", "a.png"), "--gif a.png: the name should end in .gif"),
        (("--video", "a.mp4", "--size", "wide"), "--size is not a size of a video"),
        (("--video", "a.mp4", "--speed", "0"), "--speed is out of range"),
    ],
)
def test_options_that_a_report_does_not_have_are_refused(folder, tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    assert call("view", folder, *words) == EXIT_WRONG
    assert said in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["sample"]


def test_a_file_of_another_program_is_not_replaced_by_a_video(folder, tmp_path, capsys):
    (tmp_path / "a.gif").write_bytes(b"GIF89a of mine")
    assert call("view", folder, "--gif", tmp_path / "a.gif") == EXIT_WRONG
    assert "a.gif" in capsys.readouterr().err
    assert (tmp_path / "a.gif").read_bytes() == b"GIF89a of mine"


def test_a_video_without_its_library_names_the_command(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "playwright", None)
    assert call("view", folder, "--video", tmp_path / "a.mp4") == EXIT_WRONG
    said = capsys.readouterr().err
    assert "videos need playwright" in said
    assert "pip install 'simspec-physics[video]'" in said
    assert not (tmp_path / "a.mp4").exists()


# --- scenes -------------------------------------------------------------------------------------------------------------------


def test_a_scene_is_written_as_a_page(tmp_path, capsys):
    path = tmp_path / "scene.html"
    assert call("view", "ball-pendulum", "--page", path) == EXIT_OK
    assert capsys.readouterr().out == f"written: {path}\n"
    assert is_page(path.read_bytes())
    before = path.read_bytes()
    assert call("view", "ball-pendulum", "--page", path, "--json") == EXIT_OK
    assert json.loads(capsys.readouterr().out) == {"file": str(path), "opened": False, "reason": "--page"}
    assert path.read_bytes() == before


def test_without_viser_the_scene_is_a_page(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    monkeypatch.chdir(tmp_path)
    assert call("view", "ball-pendulum", "--no-browser") == EXIT_OK
    said = capsys.readouterr()
    path = re.fullmatch(r"written: (.*) \(not opened: --no-browser\)\n", said.out).group(1)
    assert path == str(tmp_path / "ball-pendulum.html")
    assert is_page(Path(path).read_bytes())
    assert said.err.splitlines() == [
        "sliders on the page move the joints, too; a live view: pip install 'simspec-physics[view]'"
    ]
    assert call("view", "ball-pendulum", "--port", "8080") == EXIT_WRONG
    assert "viser is not installed: pip install 'simspec-physics[view]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--video", "a.mp4"), "a video is of a run, and this is a spec"),
        (("--out", "a.html"), "--out is without effect on a spec"),
        (("--speed", "2"), "--speed is without effect"),
    ],
)
def test_options_that_a_scene_does_not_have_are_refused(tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    assert call("view", "ball-pendulum", *words) == EXIT_WRONG
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_nothing_to_see(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert call("view", "runs/nowhere") == EXIT_WRONG
    assert "runs/nowhere: no such file" in capsys.readouterr().err


@needs_viser
def test_a_port_in_use_is_named_in_a_line(capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert call("view", "ball-pendulum", "--port", port, "--no-browser") == EXIT_WRONG
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines()[0].endswith(f"--port {port}: address already in use")


def started(*words: str, **options) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "simspec", "view", "ball-pendulum", "--no-browser", *words]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **options)


@needs_viser
def test_a_live_scene_is_served_until_it_is_interrupted():
    with started(stdout=subprocess.PIPE) as process:
        line = process.stdout.readline()
        address = re.fullmatch(r"(http://127\.0\.0\.1:\d+/[\w-]{32}/)  \(Ctrl-C ends it\)\n", line).group(1)
        parts = urlsplit(address)
        found = {}
        for path in (parts.path, "/"):
            connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=60.0)
            connection.request("GET", path)
            found[path] = connection.getresponse().status
            connection.close()
        assert found == {parts.path: 200, "/": 403}
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert (out, err) == ("", "simspec: ended by SIGINT\n")
    with socket.socket() as again:
        assert again.connect_ex((parts.hostname, parts.port))  # nothing listens


@needs_viser
def test_a_live_scene_prints_its_address_as_json(monkeypatch, capsys):
    monkeypatch.setattr("simspec.commands.view.exit_if_signalled", lambda: (_ for _ in ()).throw(SystemExit(0)))
    assert call("view", "ball-pendulum", "--no-browser", "--json") == EXIT_OK
    said = json.loads(capsys.readouterr().out)
    assert (said["opened"], said["reason"]) == (False, "--no-browser")
    assert said["address"].startswith("http://127.0.0.1:")


@needs_viser
def test_a_reader_that_is_gone_ends_it_without_a_traceback():
    read, write = os.pipe()
    os.close(read)
    with started(stdout=write) as process:
        os.close(write)
        _, err = process.communicate(timeout=60.0)
    assert process.returncode == 1
    assert err == ""
