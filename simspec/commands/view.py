"""``simspec view``: a scene live in the browser or as a page, the report of a study or a run in the browser, videos of runs."""

from __future__ import annotations

import os
import sys
import time
import webbrowser
from collections.abc import Mapping
from pathlib import Path

from simspec.commands.experiment_options import ViewOptions
from simspec.commands.options import print_json
from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.outputs.targets import demand, file_problem
from simspec.outputs.writing import write_file
from simspec.processes import exit_if_signalled
from simspec.report.screen import progress, say
from simspec.world.types import World

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Variables that name the display, on systems that need one."""
LISTENING = 0.5
"""s between two looks for a signal that requests the end."""
GET_VISER = "sliders on the page move the joints, too; a live view: pip install 'simspec-physics[view]'"


def view(options: ViewOptions) -> int:
    """Show a scene, or the report of stored runs, or make videos of them."""
    if not Path(options.seen).is_dir():
        return view_spec(options)
    if options.port is not None:
        raise SpecError([_without_effect("--port", "the report of runs is a file")])
    options.robot_files.check_effect()
    if options.sets:
        raise SpecError([_without_effect("--set", "these are stored runs")])
    if options.video is not None or options.gif is not None:
        return make_videos(options)
    _demand_no_video(options)
    return view_runs(options)


def _demand_no_video(options: ViewOptions) -> None:
    """Raise SpecError for options of videos where none is made."""
    given = {"--fps": options.fps, "--size": options.size, "--speed": options.speed}
    named = [option for option, value in given.items() if value is not None]
    demand(_without_effect(option, "no --video or --gif") for option in named)


def _without_effect(option: str, why: str) -> Problem:
    return Problem(f"{option} is without effect: {why}", hint="leave it out", code="C109")


# --- runs ---------------------------------------------------------------------------------------------------------------------


def view_runs(options: ViewOptions) -> int:
    """Write the page of a study or a run where it is not current, and open it in a browser, or say why it was not opened."""
    from simspec.commands.reports import write_page

    if options.page is not None and options.out is not None:
        raise SpecError([_without_effect("--out", "--page names the file")])
    path = write_page([Path(options.seen)], options.page or options.out)
    if options.page is not None:
        return _written(path, options)
    return _opened(path, options)


def make_videos(options: ViewOptions) -> int:
    """Write the playback of a study or a run as videos."""
    from simspec.commands.reports import page_of
    from simspec.report.viewer.video import (
        GIF,
        MP4,
        VideoOptions,
        checked,
        demand_libraries,
        film,
        is_video,
        parse_size,
    )

    if options.page is not None or options.out is not None:
        raise SpecError([_without_effect("--page or --out", "--video and --gif write no page")])
    files = {kind: path for kind, path in ((MP4, options.video), (GIF, options.gif)) if path is not None}
    size = VideoOptions.size if options.size is None else parse_size(options.size)
    how = VideoOptions(
        options.fps or VideoOptions.fps, size, VideoOptions.speed if options.speed is None else options.speed
    )
    checked(how, files)
    demand(file_problem(path, is_video) for path in files.values())
    demand_libraries(list(files))
    page = page_of([Path(options.seen)])
    with progress(not options.as_json) as tell:
        made = film(page, list(files), how, tell)
    written = [write_file(files[kind], content, is_video) for kind, content in made.items()]
    if options.as_json:
        print_json({"files": [{"file": path, "bytes": path.stat().st_size} for path in written]})
    else:
        for path in written:
            say(f"written: {path} ({path.stat().st_size / 1e6:.1f} MB)")
    return EXIT_OK


# --- a scene ------------------------------------------------------------------------------------------------------------------


def view_spec(options: ViewOptions) -> int:
    """Show the initial state of a spec's world: live until the user ends it, or as a page."""
    from simspec.commands.loading import load_spec
    from simspec.report.page.document import is_page

    if options.video is not None or options.gif is not None:
        hint = f"simspec run {options.seen} first, then simspec view runs/NAME"
        raise SpecError([Problem("a video is of a run, and this is a spec", hint=hint, code="C102")])
    if options.out is not None:
        raise SpecError([Problem("--out is without effect on a spec", hint="use --page FILE", code="C109")])
    _demand_no_video(options)
    if options.page is not None:
        demand([file_problem(options.page, is_page)])
    world = load_spec(options, options.seen, warn=False).world
    if options.page is not None:
        return _written(write_file(options.page, scene_text(world), is_page), options)
    if (missing := _missing_viser()) is not None:
        if options.port is not None:
            raise SpecError([_without_effect("--port", missing)])
        code = _opened(write_file(Path(f"{world.name}.html"), scene_text(world), is_page), options)
        say(GET_VISER, error=True)
        return code
    return serve(world, options)


def scene_text(world: World) -> str:
    """The page of a scene."""
    from simspec.report.page.scene import scene_page

    return scene_page(world)


def _missing_viser() -> str | None:
    from importlib.util import find_spec

    return None if find_spec("viser") is not None else "viser is not installed: pip install 'simspec-physics[view]'"


def serve(world: World, options: ViewOptions) -> int:
    """Serve the scene on this machine until a signal ends the process, and open it in the browser."""
    from simspec.report.viewer.guard import serving
    from simspec.report.viewer.scene import LiveScene

    with serving(options.port or 0, world.name) as (server, address):
        LiveScene(server, world)
        why = "--no-browser" if options.no_browser else _open(address)
        if options.as_json:
            print_json({"address": address, "opened": why is None, "reason": why})
            sys.stdout.flush()
        else:
            note = "" if why is None or options.no_browser else f", not opened: {why}"
            say(f"{address}  (Ctrl-C ends it{note})")
        while True:
            # a signal that another thread receives does not end the wait of this one
            time.sleep(LISTENING)
            exit_if_signalled()


# --- the browser --------------------------------------------------------------------------------------------------------------


def _written(path: Path, options: ViewOptions) -> int:
    if options.as_json:
        print_json({"file": path, "opened": False, "reason": "--page"})
    else:
        say(f"written: {path}")
    return EXIT_OK


def _opened(path: Path, options: ViewOptions) -> int:
    why = "--no-browser" if options.no_browser else _open(path.absolute().as_uri())
    if options.as_json:
        print_json({"file": path, "opened": why is None, "reason": why})
    else:
        say(f"{path}: opened" if why is None else f"written: {path} (not opened: {why})")
    return EXIT_OK


def _open(address: str) -> str | None:
    """Open an address in the user's browser; None, or why it was not opened."""
    if (why := no_display(os.environ, sys.platform)) is not None:
        return why
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return "no browser is installed"
    return None if browser.open(address) else "the browser did not start"


def no_display(environment: Mapping[str, str], platform: str) -> str | None:
    """Why nothing can be shown here; None where it can. A browser that the user names (``BROWSER``) is believed."""
    if platform in ("darwin", "win32") or any(environment.get(name) for name in (*DISPLAYS, "BROWSER")):
        return None
    return "there is no display"
