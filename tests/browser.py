"""A browser for tests: Chromium without a window, drawing WebGL in software, as good as cut off from any network."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WITHOUT_WEBGL = ("--disable-gpu", "--disable-3d-apis")
QUIET = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PATIENCE = 120_000
"""Milliseconds that a page may take on a busy machine; nothing is measured by it."""


def chromium() -> str | None:
    """The path of an installed Chromium."""
    return next(filter(None, map(shutil.which, NAMES)), None)


@contextlib.contextmanager
def browsers() -> Iterator[Callable[..., Any]]:
    """A function that starts browsers, with more arguments; the fixture ends them. Skips the test without a browser."""
    program = chromium()
    if program is None:
        pytest.skip(f"no browser is installed ({', '.join(NAMES)}): apt-get install chromium")
    driver = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra test)")
    with driver.sync_playwright() as playwright, contextlib.ExitStack() as running:

        def start(*arguments: str) -> Any:
            started = playwright.chromium.launch(executable_path=program, headless=True, args=[*QUIET, *arguments])
            running.callback(started.close)
            return started

        yield start


@contextlib.contextmanager
def opened(
    running: Any, path: Path, width: int = 1280, height: int = 900, **context: Any
) -> Iterator[tuple[Any, list[str]]]:
    """A page in a window of its own, ready, and the list of its console messages and network requests."""
    window = running.new_context(viewport={"width": width, "height": height}, **context)
    page = window.new_page()
    said: list[str] = []
    page.on("console", lambda message: said.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: said.append(f"error: {error}"))
    page.on("dialog", lambda dialog: (said.append(f"dialog: {dialog.message}"), dialog.dismiss()))
    address = path.absolute().as_uri()
    page.on("request", lambda request: said.append(f"request: {request.url}") if request.url != address else None)
    try:
        page.goto(address)
        # selectors, not functions: the page's policy forbids the evaluation of text
        page.wait_for_selector("html[data-state]", state="attached", timeout=PATIENCE)
        yield page, said
    finally:
        window.close()
