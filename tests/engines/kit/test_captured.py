"""Output of native code is captured from either stream, and the streams are restored."""

from __future__ import annotations

import ctypes
import os
import sys

import pytest

from simspec.engines.kit.messages import captured


def put(text: str) -> None:
    """Print as C code does: into the C library's buffer of standard output."""
    ctypes.CDLL(None).puts(text.encode())


def test_output_of_c_is_captured_and_no_other_output_is_lost(capfd):
    put("before")
    lines: list[str] = []
    with captured(sys.stdout, lines, ("build time",)):
        put("built, build time: now")
        put("\x1b[31mred\x1b[0m")
        put("   ")
        os.write(2, b"an error\n")
    put("after")
    ctypes.CDLL(None).fflush(None)
    assert lines == ["red"]
    out, err = capfd.readouterr()
    assert (out, err) == ("before\nafter\n", "an error\n")


def test_standard_error_is_captured_separately(capfd):
    lines: list[str] = []
    with captured(sys.stderr, lines):
        os.write(2, b"one\ntwo\n")
        os.write(1, b"output\n")
    os.write(2, b"after\n")
    assert lines == ["one", "two"]
    assert tuple(capfd.readouterr()) == ("output\n", "after\n")


def test_an_error_leaves_the_streams_as_they_were(capfd):
    lines: list[str] = []

    def fail() -> None:
        with captured(sys.stderr, lines):
            os.write(2, b"told\n")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    os.write(2, b"after\n")
    assert lines == ["told"]
    assert capfd.readouterr().err == "after\n"
