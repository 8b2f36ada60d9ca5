"""Entries of the user's cache folder: bounded in size, the oldest leave, and what simspec did not write stays."""

from __future__ import annotations

import os

import pytest

from simspec.outputs.collection import Entries

HEAD = '{"simspec_try": '
SIZE = 100


@pytest.fixture
def entries(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return Entries("try", HEAD.encode(), largest=1000, bound=10 * SIZE)


def key(number, first="f"):
    return f"{first}{number:063x}"


def text(number):
    return f"{HEAD}{number}}}".ljust(SIZE)


def fill(entries, count, start=1000.0):
    for number in range(count):
        assert entries.write(key(number), text(number))
        os.utime(entries.folder() / f"{key(number)}.json", (start + number, start + number))


def test_a_written_entry_is_read(entries):
    assert entries.read(key(1)) is None
    assert entries.write(key(1), text(1))
    assert entries.read(key(1)) == text(1).encode()
    assert entries.write(key(1), text(2)), "an entry is written again where it was damaged"
    assert entries.read(key(1)) == text(2).encode()


def test_the_oldest_leave_when_all_are_too_large(entries):
    fill(entries, 12)
    assert entries.read(key(0)) is not None, "it is the one that was used last now"
    assert len(os.listdir(entries.folder())) == 12, "not every key looks after the bound"
    assert entries.write(key(12, "0"), text(12))
    left = {number for number in range(12) if entries.read(key(number)) is not None}
    assert left == {0, 7, 8, 9, 10, 11}, "three quarters of the bound, with the new one"
    assert entries.read(key(12, "0")) is not None


def test_foreign_entries_stay(entries):
    fill(entries, 12)
    folder = entries.folder()
    unknown, note, link = folder / f"{key(99)}.json", folder / "note.txt", folder / f"{key(98)}.json"
    unknown.write_text("mine".ljust(SIZE))
    note.write_text("n" * 5000)
    link.symlink_to(note)
    for path in (unknown, note):
        os.utime(path, (1.0, 1.0))
    entries.write(key(12, "0"), text(12))
    assert unknown.exists()
    assert note.exists()
    assert link.is_symlink()
    assert entries.read(key(98)) is None
    assert not entries.write(key(99), text(99))
    assert unknown.read_text().startswith("mine")


def test_no_folder_and_no_right_to_write(entries, monkeypatch, tmp_path):
    (tmp_path / "simspec").write_text("a file")
    assert not entries.write(key(1), text(1))
    assert entries.read(key(1)) is None
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert entries.folder() == tmp_path / "home" / ".cache" / "simspec" / "try"
