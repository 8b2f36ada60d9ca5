"""Compiled files: bytes with one hash, in memory and on a disk."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.outputs.writing import Artifacts

FILES = {"model.xml": "<größe/>\n", "meshes/part.stl": bytes(range(256)), "empty": ""}


def test_written_artifacts_are_read_with_the_same_hash(tmp_path):
    artifacts = Artifacts(FILES)
    artifacts.write(tmp_path / "folder")
    again = Artifacts.read(tmp_path / "folder")
    assert dict(again) == dict(artifacts)
    assert again.sha256 == artifacts.sha256
    assert again["model.xml"] == FILES["model.xml"].encode()


def test_the_hash_depends_on_names_and_contents_and_not_on_the_order():
    whole = Artifacts(FILES).sha256
    assert Artifacts(dict(reversed(FILES.items()))).sha256 == whole
    others = (
        {**FILES, "empty": "x"},
        {**FILES, "another": ""},
        {name: content for name, content in FILES.items() if name != "empty"},
        {"model.xml": FILES["model.xml"], "meshes/part.stl": FILES["meshes/part.stl"], "void": ""},
        {"a": "b\0001\0c"},
    )
    hashes = {whole, *(Artifacts(other).sha256 for other in others)}
    assert len(hashes) == 1 + len(others)


def test_neighbouring_names_and_contents_are_distinguished():
    assert Artifacts({"a": "bc"}).sha256 != Artifacts({"ab": "c"}).sha256


def test_texts_are_those_of_text_files():
    assert Artifacts({"a": "größe"}).texts == {"a": "größe"}
    with pytest.raises(UnicodeDecodeError):
        Artifacts(FILES).texts  # noqa: B018


@pytest.mark.parametrize("name", ["../a", "/a", "a/../../b"])
def test_no_name_leaves_the_folder(tmp_path, name):
    with pytest.raises(SpecError):
        Artifacts({name: "x"}).write(tmp_path / "folder")


def test_a_link_is_not_read(tmp_path):
    Artifacts({"a": "x"}).write(tmp_path / "folder")
    (tmp_path / "folder" / "b").symlink_to("/etc/hostname")
    with pytest.raises(SpecError, match="b: "):
        Artifacts.read(tmp_path / "folder")
