"""Kernels compiled by Warp are kept up to a number of folders; no folder is removed while another process uses it."""

from __future__ import annotations

import fcntl
import os

import pytest

from simspec.engines.kit import warp
from simspec.engines.mjwarp import programs
from simspec.engines.mjwarp.engine import MjWarp
from simspec.outputs import files

installed = pytest.mark.skipif(MjWarp.version() is None, reason="mujoco-warp is not installed")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Six sets of functions of two versions, the first made first."""
    monkeypatch.setattr(files, "_locks", [])
    place = tmp_path / "mjwarp"
    for index in range(6):
        entry = place / ("1.18.0" if index < 2 else "1.19.0") / f"wp_{index}"
        entry.mkdir(parents=True)
        (entry / "functions.o").write_bytes(b"code")
        os.utime(entry, (1000 + index, 1000 + index))
    yield place
    for lock in files._locks:
        os.close(lock)


def there(folder) -> list[str]:
    return sorted(path.name for path in folder.glob("*/wp_*"))


def test_those_made_last_stay(folder):
    files.hold_folder(folder, warp.MADE, 6)
    assert len(there(folder)) == 6
    os.close(files._locks.pop())
    files.hold_folder(folder, warp.MADE, 3)
    assert there(folder) == ["wp_3", "wp_4", "wp_5"]


def test_foreign_files_in_the_warp_cache_are_kept(folder):
    (folder / "1.18.0" / "mine").mkdir()
    files.hold_folder(folder, warp.MADE, 1)
    assert there(folder) == ["wp_5"]
    assert (folder / "1.18.0" / "mine").is_dir()


def test_a_folder_that_others_can_write_is_not_used(folder):
    folder.chmod(0o777)
    with pytest.raises(PermissionError, match="all users can write"):
        files.hold_folder(folder, warp.MADE, 1)
    assert len(there(folder)) == 6


def test_nothing_is_removed_while_another_uses_it(folder):
    files.hold_folder(folder, warp.MADE, 6)
    files.hold_folder(folder, warp.MADE, 3)  # flock is of an open file: in one process as in two
    assert len(there(folder)) == 6
    while files._locks:
        os.close(files._locks.pop())
    files.hold_folder(folder, warp.MADE, 3)
    assert len(there(folder)) == 3


def test_it_is_used_as_long_as_the_process_lives(folder):
    files.hold_folder(folder, warp.MADE, 6)
    lock = os.open(folder / files.LOCK_FILLED, os.O_RDWR)
    with pytest.raises(BlockingIOError):
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(files._locks.pop())
    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(lock)


def test_an_unwritable_cache_is_reported_and_not_used(tmp_path, monkeypatch):
    (tmp_path / "simspec").write_text("a file")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    said: list[str] = []
    place = warp._place(programs.FOLDER, said)
    assert place.is_dir()
    assert not place.is_relative_to(tmp_path / "simspec")
    (line,) = said
    assert line.startswith("programs that Warp compiles are not kept: ")


@installed
def test_an_engine_at_work_says_so():
    programs.begin([])
    assert files._locks
