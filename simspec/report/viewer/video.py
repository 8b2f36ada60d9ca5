"""Videos of a page's playback: the page in Chromium without a window, set to one time after another, a picture of each.

A frame shows the times of the run that it is at, whatever the machine takes for it: the same page gives the same frames.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from simspec.errors import Problem, SpecError, clipped, visible
from simspec.files import scratch_folder
from simspec.outputs.writing import write_private

if TYPE_CHECKING:
    from PIL import Image

Progress = Callable[[str, float | None], None]

MP4, GIF = ".mp4", ".gif"
OPTIONS: Final = {MP4: "--video", GIF: "--gif"}
"""By the kind of video, which is the end of its file's name."""
COMMENT: Final = "made by simspec"
"""In the file: one that has it may be replaced."""
MOST_FRAMES: Final = 3_000
LARGEST: Final = 2_160
SMALLEST: Final = 64
FASTEST: Final = 60
GIF_UNIT: Final = 100
"""Delays between frames of a GIF are whole hundredths of a second; browsers slow down delays of less than two."""
BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS: Final = (
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--hide-scrollbars",
)
PATIENCE: Final = 120_000
"""Milliseconds that the page and each of its frames may take."""
ENCODING: Final = ("-crf", "20", "-movflags", "+faststart", "-fflags", "+bitexact", "-flags:v", "+bitexact")
MISSING: Final = "pip install 'simspec-physics[video]'"

FILL = """() => {
  const stage = document.querySelector(".stage");
  const whole = {position: "fixed", inset: "0", width: "100vw", height: "100vh", "max-height": "none", "aspect-ratio": "auto",
    "border-radius": "0", "z-index": "9"};
  for (const [name, value] of Object.entries(whole)) stage.style.setProperty(name, value);
  const clock = document.createElement("div");
  clock.className = "tag";
  for (const [name, value] of Object.entries({left: "8px", bottom: "8px", background: "#000000a0", color: "#ffffff"}))
    clock.style.setProperty(name, value);
  stage.append(clock);
  window.simspec.clock = clock;
  const player = window.simspec.players[0];
  player.stage.look("fit");
  player.stage.draw();
}"""
"""The playback alone, on the whole window, with the time."""
SHOW = """([time, words]) => {
  const player = window.simspec.players[0];
  player.seek(time);
  player.stage.draw();
  window.simspec.clock.textContent = words;
}"""
STATE = """() => {
  const player = (window.simspec?.players ?? [])[0];
  if (document.documentElement.dataset.state !== "ready") return "the page does not start";
  if (player === undefined || player.scene.runs.length === 0) return "the page has no run";
  return player.stage === null ? "the browser has no WebGL" : "";
}"""
RANGE = "() => { const p = window.simspec.players[0]; return [p.times[0], p.times[p.times.length - 1]]; }"


@dataclass(frozen=True)
class VideoOptions:
    """Frames per second, width and height in pixels, and simulated seconds per second of the video."""

    fps: int = 30
    size: tuple[int, int] = (1280, 720)
    speed: float = 1.0


def parse_size(text: str) -> tuple[int, int]:
    """Width and height of ``1280x720``. Raises SpecError."""
    parts = text.lower().split("x")
    sizes = [int(part) for part in parts if part.isascii() and part.isdigit() and len(part) < 6]
    if len(parts) != 2 or len(sizes) != 2 or any(size % 2 or not SMALLEST <= size <= LARGEST for size in sizes):
        allowed = f"WIDTHxHEIGHT in even numbers of {SMALLEST} to {LARGEST}, e.g. 1280x720"
        raise SpecError([Problem("--size is not a size of a video", found=text, allowed=allowed, code="C103")])
    return sizes[0], sizes[1]


def checked(options: VideoOptions, files: Mapping[str, Path]) -> None:
    """Raise SpecError for numbers, and names of ``files`` (by kind), that no video has."""
    problems = []
    if not 1 <= options.fps <= FASTEST:
        problems.append(
            Problem("--fps is out of range", found=str(options.fps), allowed=f"1 to {FASTEST}", code="C103")
        )
    if not (math.isfinite(options.speed) and 0.001 <= options.speed <= 1000.0):
        problems.append(
            Problem("--speed is out of range", found=f"{options.speed:g}", allowed="0.001 to 1000", code="C103")
        )
    for kind, path in files.items():
        if path.suffix.lower() != kind:
            problems.append(Problem(f"{OPTIONS[kind]} {path}: the name should end in {kind}", code="C103"))
    if problems:
        raise SpecError(problems)


def is_video(content: bytes) -> bool:
    """Whether simspec wrote a file."""
    return (content[:4] == b"GIF8" or content[4:8] == b"ftyp") and COMMENT.encode() in content


def frame_times(first: float, last: float, fps: float, speed: float) -> list[float]:
    """The simulated times of the frames: evenly spaced, both ends among them but for less than a frame. Raises SpecError for
    too many."""
    step = speed / fps
    count = int((last - first) / step + 1e-9) + 1
    if count > MOST_FRAMES:
        least = (last - first) * fps / (MOST_FRAMES - 1)
        message = f"{last - first:.4g} s at --speed {speed:g} are {count:,} frames"
        raise SpecError(
            [
                Problem(
                    message,
                    allowed=f"{MOST_FRAMES:,} frames",
                    hint=f"--speed {math.ceil(least * 10.0) / 10.0:g}",
                    code="C103",
                )
            ]
        )
    return [min(first + index * step, last) for index in range(count)]


def film(page: str, kinds: list[str], options: VideoOptions, progress: Progress) -> dict[str, bytes]:
    """The playback of ``page`` (HTML) as videos: the content of a file for each of ``kinds`` (``.mp4``, ``.gif``).

    Raises SpecError where there is nothing to be seen or there are too many frames, and without Chromium or a library of the
    extra ``video``.
    """
    demand_libraries(kinds)
    made = {}
    with scratch_folder("video") as folder:
        write_private({"page.html": page}, folder / "page")
        with _opened(folder / "page" / "page.html", options) as shown:
            for kind in kinds:
                fps = GIF_UNIT / max(2, round(GIF_UNIT / options.fps)) if kind == GIF else float(options.fps)
                first, last = shown.evaluate(RANGE)
                times = frame_times(first, last, fps, options.speed)
                pictures = _pictures(shown, times, kind, options.speed, progress)
                write = _gif if kind == GIF else _mp4
                made[kind] = write(pictures, fps, options, folder / f"video{kind}")
    return made


def demand_libraries(kinds: list[str]) -> None:
    """Raise SpecError where a library is missing that videos of these kinds need."""
    from importlib.util import find_spec

    needed = {"playwright": True, "PIL": True, "imageio_ffmpeg": MP4 in kinds}
    if missing := [name for name, wanted in needed.items() if wanted and find_spec(name) is None]:
        message = f"videos need {', '.join(missing)}, which {'is' if len(missing) == 1 else 'are'} not installed"
        raise SpecError([Problem(message, hint=MISSING, code="C110")])


@contextlib.contextmanager
def _opened(path: Path, options: VideoOptions) -> Iterator[Any]:
    """The page in a browser, showing nothing but the playback."""
    from playwright.sync_api import Error, sync_playwright

    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(
                executable_path=program,
                headless=True,
                args=[*ARGUMENTS],
                chromium_sandbox=not hasattr(os, "geteuid") or os.geteuid() != 0,  # Chromium refuses it to root
                handle_sigint=False,
                handle_sigterm=False,
                handle_sighup=False,
            )
        except Error as error:
            if program is None:
                raise _browser_error("there is no Chromium", "python -m playwright install chromium") from error
            raise _browser_error(f"{program} does not start: {_first_line(error)}") from error
        with contextlib.closing(browser):
            try:
                size: Any = dict(zip(("width", "height"), options.size, strict=True))
                page = browser.new_page(viewport=size, color_scheme="light", offline=True)
                page.set_default_timeout(PATIENCE)
                page.goto(path.as_uri())
                page.wait_for_selector("html[data-state]", state="attached")
                if why := page.evaluate(STATE):
                    raise SpecError([Problem(f"there is no video: {why}", code="R103")])
                page.evaluate(FILL)
                yield page
            except Error as error:
                raise _browser_error(f"the browser failed: {_first_line(error)}") from error


def _browser_error(message: str, hint: str | None = None) -> SpecError:
    return SpecError([Problem(message, hint=hint, code="C119")])


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return visible(clipped(lines[0])) if lines else type(error).__name__


def _pictures(page: Any, times: list[float], kind: str, speed: float, progress: Progress) -> Iterator[Image.Image]:
    from PIL import Image

    factor = "" if speed == 1.0 else f", {speed:g} × real time"
    for index, time in enumerate(times):
        progress(f"{kind[1:]}: frame {index + 1} of {len(times)}", index / len(times))
        page.evaluate(SHOW, [time, f"{time:.2f} s{factor}"])
        with Image.open(io.BytesIO(page.screenshot(type="png"))) as picture:
            yield picture.convert("RGB")


def _mp4(pictures: Iterator[Image.Image], fps: float, options: VideoOptions, path: Path) -> bytes:
    import imageio_ffmpeg

    try:
        writer = imageio_ffmpeg.write_frames(
            str(path),
            options.size,
            fps=fps,
            codec="libx264",
            pix_fmt_in="rgb24",
            pix_fmt_out="yuv420p",
            macro_block_size=2,
            quality=None,
            ffmpeg_log_level="fatal",
            output_params=[*ENCODING, "-metadata", f"comment={COMMENT}"],
        )
        with contextlib.closing(writer):
            writer.send(None)
            for picture in pictures:
                writer.send(picture.tobytes())
    except (OSError, RuntimeError) as error:
        raise SpecError([Problem(f"ffmpeg failed: {_first_line(error)}", code="C110")]) from error
    return path.read_bytes()


def _gif(pictures: Iterator[Image.Image], fps: float, options: VideoOptions, path: Path) -> bytes:
    from PIL import Image

    delay = round(1000.0 / fps)
    first = next(pictures)
    # one palette for all frames: still parts do not flicker
    palette = first.quantize(colors=256)
    later = (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures)
    first.quantize(palette=palette, dither=Image.Dither.NONE).save(
        path, format="GIF", save_all=True, append_images=later, duration=delay, loop=0, comment=COMMENT, optimize=False
    )
    return path.read_bytes()
