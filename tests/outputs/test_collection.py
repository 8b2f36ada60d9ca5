"""Growing folders: a named entry is complete whenever a writer dies, and one process writes at a time."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys

import pytest

from simspec.errors import SpecError
from simspec.outputs import collection as module
from simspec.outputs.collection import open_collection
from simspec.outputs.writing import put

KIND = "store"


@pytest.fixture
def there(tmp_path):
    return open_collection(tmp_path / "grown", KIND, {"form.json": "1\n"})


def build(fresh):
    put(fresh / "a.txt", "a")
    put(fresh / "b.txt", "b")


def test_a_folder_is_placed_once(there):
    with there.alone("me"):
        assert there.place("runs/ab/abc", build)
        assert not there.place("runs/ab/abc", lambda fresh: pytest.fail("built again"))
    assert sorted(os.listdir(there.path / "runs/ab/abc")) == ["a.txt", "b.txt"]
    assert os.listdir(there.path / "tmp") == []


def test_who_is_second_in_the_same_moment_changes_nothing(there):
    def slowly(fresh):
        build(fresh)
        there.place("runs/ab/abc", lambda other: put(other / "first.txt", "1"))

    with there.alone("me"):
        assert not there.place("runs/ab/abc", slowly)
    assert os.listdir(there.path / "runs/ab/abc") == ["first.txt"]
    assert os.listdir(there.path / "tmp") == []


@pytest.mark.parametrize("moment", ["build", "sync", "rename"])
def test_on_a_full_disk_nothing_is_half_written_and_the_next_try_works(there, monkeypatch, moment):
    full = OSError(errno.ENOSPC, "No space left on device")

    def fail(*arguments):
        raise full

    def half(fresh):
        put(fresh / "a.txt", "a")
        fail()

    with there.alone("me"):
        with monkeypatch.context() as patch:
            if moment == "sync":
                patch.setattr(module, "_sync_all", fail)
            elif moment == "rename":
                patch.setattr(module.os, "rename", fail)
            with pytest.raises(OSError, match="No space left") as caught:
                there.place("runs/ab/abc", half if moment == "build" else build)
        assert caught.value.filename == str(there.shown)
        assert not there.has("runs/ab/abc")
        assert os.listdir(there.path / "tmp") == []
        assert there.place("runs/ab/abc", build)


HOLD = """
import sys, time
from pathlib import Path
from simspec.outputs.collection import open_collection
there = open_collection(Path(sys.argv[1]), "store", {})
with there.alone("process of a test"):
    (there.path / "tmp" / "left").mkdir()
    (there.path / "tmp" / "left" / "file").write_text("half")
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_lock_admits_a_single_writer_and_ends_with_its_process(there):
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(there.shown)], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with (
            pytest.raises(SpecError, match=r"another process is writing here \(process of a test\)"),
            there.alone("me"),
        ):
            pytest.fail("two at a time")
        assert os.listdir(there.path / "tmp") == ["left"], "files of the other writer stay"
        holder.send_signal(signal.SIGKILL)
        with there.alone("me", wait=True):
            assert os.listdir(there.path / "tmp") == []
    finally:
        holder.kill()
        holder.communicate()


def test_foreign_links_are_not_followed(there, tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    (there.path / "runs").symlink_to(outside)
    with there.alone("me"), pytest.raises(SpecError, match="a symbolic link, not a folder"):
        there.place("runs/ab/abc", build)
    assert os.listdir(outside) == []
    (there.path / "lock").unlink()
    (there.path / "lock").symlink_to(outside / "lock")
    with pytest.raises(SpecError, match="lock cannot be opened"), there.alone("me"):
        pytest.fail("locked through a link")
    assert os.listdir(outside) == []


@pytest.mark.parametrize("name", ["../out", "/out", "a/../../out", "simspec-folder.json"])
def test_names_stay_inside(there, name):
    with there.alone("me"), pytest.raises(SpecError):
        there.place(name, build)


def test_a_foreign_folder_stays_as_it_is(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    with pytest.raises(SpecError, match="simspec did not make it"):
        open_collection(tmp_path / "mine", KIND, {"form.json": "1\n"})
    assert os.listdir(tmp_path / "mine") == ["notes.txt"]


def test_replaced_files_are_kept_under_unique_names(there):
    with there.alone("me"):
        for text in ("one", "two"):
            there.place("runs/ab/abc", lambda fresh, text=text: put(fresh / "a.txt", text))
            there.set_aside("runs/ab/abc")
        assert not there.has("runs/ab/abc")
    assert [(there.path / "damaged" / name / "a.txt").read_text() for name in ("abc", "abc-2")] == ["one", "two"]
    with there.alone("me"):
        there.place("runs/ab/abc", build)
        there.drop("runs/ab/abc")
    assert not there.has("runs/ab/abc")
    assert os.listdir(there.path / "tmp") == []
