"""Foreign files in simspec's folders are read in bounds, or are errors that name them."""

from __future__ import annotations

import os
import tracemalloc

import pytest

from simspec.errors import SpecError
from simspec.files import NotReadableError, parse_json
from simspec.outputs.files import files_below, read_bytes, read_text
from simspec.stored import FolderMarker, read_as


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not JSON"),
        ("{", "not JSON"),
        ("NaN", "NaN is not a number"),
        ('{"a": Infinity}', "Infinity is not a number"),
        ("[" * 100_000, "nested too deeply"),
        (b"\xff", "not JSON"),
        ("[" + "[]," * 5_000_000, "values, more than"),
        ("1" * 5000, "not JSON"),
    ],
)
def test_invalid_json_is_refused(text, words):
    tracemalloc.start()
    with pytest.raises(NotReadableError, match=words):
        parse_json(text)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 100e6


def test_models_say_where_it_does_not_fit():
    with pytest.raises(SpecError, match=r"some/file cannot be read: files\.1: .*string"):
        read_as(FolderMarker, '{"simspec_folder": 1, "kind": "run", "files": ["a", 2]}', "some/file")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (os.mkfifo, "a FIFO"),
        (os.mkdir, "a folder"),
        (lambda path: path.symlink_to("/dev/zero"), "a symbolic link"),
        (lambda path: path.symlink_to("nowhere"), "a symbolic link"),
        (lambda path: path.write_bytes(b"x" * 101), "more than the 100"),
        (lambda path: path.write_bytes(b"\xff"), "not UTF-8 at byte 0"),
    ],
)
def test_regular_files_of_bounded_size_alone_are_read(tmp_path, make, words):
    path = tmp_path / "file"
    make(path)
    with pytest.raises(SpecError, match=words) as caught:
        read_text(path, 100)
    assert str(path) in str(caught.value)


def test_no_link_leads_out_of_a_folder(tmp_path):
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "file").write_text("secret")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "engine").symlink_to("../secret")
    with pytest.raises(SpecError, match="symbolic link"):
        read_bytes(tmp_path / "folder" / "engine" / "file", root=tmp_path / "folder")
    with pytest.raises(SpecError, match="symbolic link"):
        files_below(tmp_path / "folder")


def test_a_folder_of_more_files_than_there_may_be(tmp_path):
    for name in range(5):
        (tmp_path / str(name)).touch()
    assert len(files_below(tmp_path, 5)) == 5
    with pytest.raises(SpecError, match="more than 4 files"):
        files_below(tmp_path, 4)
