"""Videos of a playback: the frames, what they show, and that the same page gives the same frames."""

from __future__ import annotations

import io
import itertools
from pathlib import Path

import numpy as np
import pytest

from simspec.errors import SpecError
from simspec.report.page.document import page as page_of
from simspec.report.page.scene import scene_page
from simspec.report.studies import StoredStudy
from simspec.report.viewer import video
from simspec.report.viewer.video import GIF, MP4, VideoOptions, checked, film, frame_times, is_video, parse_size
from tests import browser
from tests.report.page import samples

SMALL = VideoOptions(fps=5, size=(192, 108), speed=2.0)


def said(words: list[str]):
    return lambda text, share=None: words.append(text)


def test_frames_are_evenly_spaced_in_simulated_time():
    assert frame_times(0.0, 1.0, 4, 1.0) == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert frame_times(0.0, 1.0, 4, 2.0) == [0.0, 0.5, 1.0]
    assert frame_times(0.5, 0.9, 10, 1.0) == pytest.approx([0.5, 0.6, 0.7, 0.8, 0.9])
    assert frame_times(0.3, 0.3, 30, 1.0) == [0.3]


def test_too_many_frames_are_refused_with_the_speed_that_fits():
    with pytest.raises(SpecError, match=r"60 s at --speed 0.1 are 18,001 frames") as raised:
        frame_times(0.0, 60.0, 30, 0.1)
    (problem,) = raised.value.problems
    speed = float(problem.hint.removeprefix("--speed "))
    assert len(frame_times(0.0, 60.0, 30, speed)) <= video.MOST_FRAMES


@pytest.mark.parametrize(
    "text", ["1280", "1280x", "x720", "1281x720", "1280x720x3", "-2x4", "0x0", "9999x720", "²x720", ""]
)
def test_a_wrong_size_is_refused(text):
    with pytest.raises(SpecError, match="--size is not a size"):
        parse_size(text)


def test_sizes_and_names():
    assert parse_size("640x360") == parse_size("640X360") == (640, 360)
    checked(SMALL, {MP4: Path("a.mp4"), GIF: Path("b.GIF")})
    with pytest.raises(SpecError, match=r"--video a.gif: the name should end in .mp4"):
        checked(SMALL, {MP4: Path("a.gif")})
    with pytest.raises(SpecError, match="--speed is out of range"):
        checked(VideoOptions(speed=float("nan")), {})


def test_a_missing_library_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(SpecError, match=r"imageio_ffmpeg, which"):
        film("", [MP4], SMALL, said([]))


def test_without_chromium_the_command_that_installs_it_is_named(monkeypatch):
    pytest.importorskip("playwright", reason="playwright is not installed (extra video)")
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setenv("PLAYWRIGHT_BROWSERS_PATH", "/nonexistent")
    with pytest.raises(SpecError, match=r"there is no Chromium\n.*python -m playwright install chromium"):
        film("", [GIF], SMALL, said([]))


@pytest.fixture(scope="module")
def page():
    return page_of([StoredStudy(samples.a_study(engines=("first",)), Path(), ())])


@pytest.mark.browser
def test_a_video_has_the_frames_and_is_the_same_each_time(page, tmp_path):
    if browser.chromium() is None:
        pytest.skip("no browser is installed")
    reader = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed (extra video)")
    image = pytest.importorskip("PIL.Image", reason="pillow is not installed (extra video)")
    words: list[str] = []
    made = film(page, [MP4, GIF], SMALL, said(words))
    assert all(map(is_video, made.values()))
    assert words == [f"{kind}: frame {number} of 6" for kind in ("mp4", "gif") for number in range(1, 7)]
    path = tmp_path / "video.mp4"
    path.write_bytes(made[MP4])
    frames = reader.read_frames(str(path))
    facts = next(frames)
    assert (facts["size"], facts["fps"]) == ((192, 108), 5.0)
    pictures = [np.frombuffer(frame, np.uint8).astype(int) for frame in frames]
    assert len(pictures) == 6
    assert all(np.abs(after - before).max() > 60 for before, after in itertools.pairwise(pictures))
    with image.open(io.BytesIO(made[GIF])) as animation:
        assert (animation.n_frames, animation.size, animation.info["duration"]) == (6, (192, 108), 200)
    assert film(page, [GIF], SMALL, said([])) == {GIF: made[GIF]}


@pytest.mark.browser
def test_a_page_without_a_run_has_no_video():
    if browser.chromium() is None:
        pytest.skip("no browser is installed")
    pytest.importorskip("playwright", reason="playwright is not installed (extra video)")
    with pytest.raises(SpecError, match="there is no video: the page has no run"):
        film(scene_page(samples.a_world()), [GIF], SMALL, said([]))
