"""The trust store: a path with its content, in a folder that no other user can write."""

from __future__ import annotations

import json
import os
import stat

import pytest

from simspec.errors import SpecError
from simspec.outputs import trust
from simspec.outputs.files import built, cache_folder, data_folder, written_by_others


@pytest.fixture
def data(tmp_path, monkeypatch):
    """The user's data folder, not made yet."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture
def file(tmp_path):
    place = tmp_path / "project" / "simspec.toml"
    place.parent.mkdir()
    place.write_bytes(b"one")
    return place


def test_a_path_is_trusted_with_its_recorded_content_only(data, file, tmp_path):
    assert trust.why_not(file, b"one") == "not trusted"
    trust.trust(file, b"one")
    assert trust.why_not(file, b"one") is None
    assert trust.why_not(file, b"one ") == "not trusted"
    assert trust.why_not(file.with_name("other.toml"), b"one") == "not trusted"
    (tmp_path / "link").symlink_to(file.parent)
    assert trust.why_not(tmp_path / "link" / "simspec.toml", b"one") is None, "the resolved path counts"


def test_new_content_replaces_old_content(data, file, tmp_path):
    other = tmp_path / "simspec.toml"
    for place, content in ((other, b"one"), (file, b"one"), (file, b"two")):
        trust.trust(place, content)
    assert trust.why_not(file, b"two") is None
    assert trust.why_not(file, b"one") == "not trusted"
    assert trust.why_not(other, b"one") is None
    assert [record.file for record in trust.records()] == sorted([file, other])


def test_trust_is_revoked(data, file):
    assert trust.revoke(file) == 0
    assert not data.exists(), "nothing is made to revoke nothing"
    trust.trust(file, b"one")
    assert trust.revoke(file) == 1
    assert trust.why_not(file, b"one") == "not trusted"
    assert trust.records() == []


def test_the_store_is_private_under_every_umask(data, file):
    old = os.umask(0)
    try:
        trust.trust(file, b"one")
    finally:
        os.umask(old)
    store = data / "simspec" / "trust"
    assert {stat.S_IMODE(place.stat().st_mode) for place in (data, data / "simspec", store)} == {0o700}
    assert trust.why_not(file, b"one") is None


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o1777])
def test_a_store_that_others_can_write_is_not_used(data, file, mode):
    trust.trust(file, b"one")
    store = data / "simspec" / "trust"
    store.chmod(mode)
    assert "can write" in str(trust.why_not(file, b"one"))
    with pytest.raises(SpecError, match="can write"):
        trust.trust(file, b"two")
    with pytest.raises(SpecError, match="can write"):
        trust.records()
    store.chmod(0o755)
    assert trust.why_not(file, b"one") is None


@pytest.mark.parametrize(("mode", "used"), [(0o777, False), (0o1777, True), (0o755, True)])
def test_a_world_writable_parent_must_be_sticky(data, file, mode, used):
    trust.trust(file, b"one")
    data.chmod(mode)
    why = trust.why_not(file, b"one")
    assert (why is None) == used
    assert used or f"all users can write {data}" in str(why)


@pytest.mark.parametrize(("mode", "used"), [(0o777, False), (0o1777, True)])
def test_compiled_programs_are_not_run_below_a_world_writable_folder(tmp_path, monkeypatch, mode, used):
    (tmp_path / "open").mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "open"))
    folder = cache_folder("compiled")
    assert folder is not None
    place = folder / "part" / ("0" * 64)
    built(place, lambda part: part.write_text("whole"), 1.0)
    (tmp_path / "open").chmod(mode)
    if used:
        built(place, lambda part: pytest.fail("made again"), 1.0)
        return
    for anew in (False, True):
        with pytest.raises(PermissionError, match="all users can write"):
            built(place, lambda part: pytest.fail("made again"), 1.0, anew)


def test_a_link_in_a_world_writable_folder_is_detected(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "open").mkdir()
    (tmp_path / "open" / "link").symlink_to(tmp_path / "mine")
    assert written_by_others(tmp_path / "open" / "link" / "store") is None
    (tmp_path / "open").chmod(0o777)
    assert written_by_others(tmp_path / "open" / "link" / "store") == f"all users can write {tmp_path / 'open'}"
    assert written_by_others(tmp_path / "mine" / "store") is None


def test_the_store_of_another_user_is_not_used(data, file, monkeypatch):
    trust.trust(file, b"one")
    user = os.geteuid() + 1 or 1
    os.chown(data / "simspec", 4242, -1)
    monkeypatch.setattr(os, "geteuid", lambda: user)
    assert "is another user's (uid 4242)" in str(trust.why_not(file, b"one"))


@pytest.mark.parametrize(
    "content",
    ["", "nonsense", "[]", json.dumps({"simspec_trust": 2, "file": "/a"}), '{"simspec_trust": 1, "file": "relative"}'],
)
def test_a_damaged_record_trusts_nothing_and_is_said(data, file, content):
    place = trust.trust(file, b"one")
    place.write_text(content)
    assert "is damaged" in str(trust.why_not(file, b"one"))
    assert [record.file for record in trust.records()] == [None]
    trust.trust(file, b"one")
    assert trust.why_not(file, b"one") is None


def test_a_record_of_another_file_does_not_count(data, file, tmp_path):
    place = trust.trust(file, b"one")
    place.write_text(json.dumps({"simspec_trust": 1, "file": str(tmp_path / "other")}))
    assert "of another file" in str(trust.why_not(file, b"one"))


@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo, lambda place: os.symlink("/etc/passwd", place)])
def test_a_record_that_is_no_file_trusts_nothing(data, file, make):
    place = trust.trust(file, b"one")
    place.unlink()
    make(place)
    assert "not trusted: " in str(trust.why_not(file, b"one"))


@pytest.mark.parametrize("home", [".", "", "here"])
def test_a_home_in_the_working_folder_is_no_home(file, monkeypatch, home):
    """A repository could bring its own trust store."""
    monkeypatch.delenv("XDG_DATA_HOME")
    monkeypatch.setenv("HOME", home)
    assert data_folder("trust") is None
    assert "no home folder" in str(trust.why_not(file, b"one"))
    with pytest.raises(SpecError, match="XDG_DATA_HOME"):
        trust.trust(file, b"one")


def test_without_home_the_folder_of_the_user_database_is_used(monkeypatch):
    monkeypatch.delenv("XDG_DATA_HOME")
    monkeypatch.delenv("HOME")
    folder = data_folder("trust")
    assert folder is None or folder.is_absolute()
