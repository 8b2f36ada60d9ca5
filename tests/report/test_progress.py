"""Progress: percentage and time left, from an injected clock; lines without a terminal; silence where none is wanted."""

from __future__ import annotations

import threading

import pytest

from simspec.report import screen as module
from simspec.report.screen import Latest, duration, progress


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_the_share_and_the_time_left():
    clock = Clock()
    latest = Latest(clock)
    latest("running a", 0.0)
    clock.now += 5.0
    assert latest.line() == "running a, for 5 s"
    latest("running a", 0.01)
    assert latest.line() == "running a: 1%"  # too early to say how long
    latest("running a", 0.25)
    clock.now += 5.0
    assert latest.line() == "running a: 25%, about 30 s left"
    latest("running a", 0.5)
    assert latest.line() == "running a: 50%, about 10 s left"
    # another piece of work begins anew
    latest("verifying")
    assert latest.line() == "verifying"
    clock.now += 200.0
    assert latest.line() == "verifying, for 3 min"


def test_foreign_text_is_shown_as_it_is():
    latest = Latest(Clock())
    latest("running \x1b[31mred")
    assert "\x1b" not in latest.line()


@pytest.mark.parametrize(
    ("seconds", "shown"), [(0.2, "0 s"), (99.0, "99 s"), (100.0, "2 min"), (5400.0, "90 min"), (7800.0, "2 h 10 min")]
)
def test_durations(seconds, shown):
    assert duration(seconds) == shown


def test_without_a_terminal_lines_come_by_themselves(monkeypatch, capsys):
    """Lines are printed between messages: an engine reports nothing for minutes."""
    monkeypatch.setattr(module, "EVERY", 0.001)
    seen = threading.Event()
    monkeypatch.setattr("builtins.print", lambda line, **_: (lines.append(line), seen.set()))
    lines: list[str] = []
    with progress() as tell:
        tell("running dart", 0.5)
        seen.clear()
        assert seen.wait(30.0)
    assert any("running dart: 50%" in line for line in lines)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("simspec-progress")]


def test_none_where_none_is_wanted(monkeypatch, capsys):
    monkeypatch.setattr(module, "EVERY", 0.001)
    with progress(False) as tell:
        tell("running dart", 0.5)
    assert capsys.readouterr() == ("", "")
