"""``simspec view``: the report of a study or a run, in a browser."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Mapping
from pathlib import Path

from simspec.commands.report import write_page
from simspec.errors import EXIT_OK
from simspec.report.plain import text
from simspec.report.screen import say

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Variables that say where windows are shown, on systems that need to be told."""


def view(folder: Path, out: Path | None, as_json: bool) -> int:
    """Write the page of a study or a run where it is not current, and open it; where that is not possible, say so."""
    path = write_page([folder], out)
    why = _open(path)
    if as_json:
        sys.stdout.write(text({"file": path, "opened": why is None, "reason": why}))
    else:
        say(f"{path}: opened" if why is None else f"written: {path} (not opened: {why})")
    return EXIT_OK


def _open(path: Path) -> str | None:
    """Open a page in the user's browser; None, or why it was not opened."""
    if (why := no_display(os.environ, sys.platform)) is not None:
        return why
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return "no browser is installed"
    return None if browser.open(path.absolute().as_uri()) else "the browser did not start"


def no_display(environment: Mapping[str, str], platform: str) -> str | None:
    """Why nothing can be shown here; None where it can. A browser that the user names (``BROWSER``) is believed."""
    if platform in ("darwin", "win32") or any(environment.get(name) for name in (*DISPLAYS, "BROWSER")):
        return None
    return "there is no display"
