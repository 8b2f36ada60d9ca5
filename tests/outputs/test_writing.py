"""Folders and files are written whole or not at all, and nothing that simspec did not write is touched."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from simspec.errors import SpecError
from simspec.outputs import staging
from simspec.outputs.targets import COMPILED, MARKER_FILE, NEVER, RUN, STUDY, file_problem, folder_problem, read_marker
from simspec.outputs.writing import (
    add_file,
    build_folder,
    change_file,
    open_folder,
    put,
    remove_file,
    update_folder,
    write_file,
    write_folder,
    write_private,
)
from tests.outputs.surroundings import KINDS, MINE, picture, stray

OLD = {"a.txt": "old a", "engine/model.xml": "old model", "gone/away.txt": "old"}
NEW = {"a.txt": "new a", "engine/model.xml": "new model", "engine/more.xml": "more"}


@pytest.fixture
def root(tmp_path, monkeypatch):
    place = tmp_path / "work" / "here"
    place.mkdir(parents=True)
    monkeypatch.chdir(place)
    return place


def content(folder: Path) -> dict[str, str]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_text() for path in files if path.name != MARKER_FILE}


@pytest.mark.parametrize("kind", KINDS)
def test_foreign_folders_are_refused_before_any_work(root, kind):
    target = Path(KINDS[kind](root))
    before = picture(root.parent)
    problem = folder_problem(target, COMPILED)
    assert problem is not None
    assert problem.hint
    assert str(target)[:20] in f"{problem.message} {Path.cwd()}"
    with pytest.raises(SpecError):
        write_folder(NEW, target, COMPILED)
    assert picture(root.parent) == before


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_for_files(root, kind):
    target = Path(KINDS[kind](root))
    before = picture(root.parent)
    with pytest.raises(SpecError):
        write_file(target, "text", lambda old: b"simspec" in old)
    assert picture(root.parent) == before


def test_a_folder_that_holds_the_spec_is_refused(root):
    write_folder(OLD, root / "out", COMPILED)
    spec = root / "out" / "spec.yaml"
    spec.write_text(MINE)
    assert "contains the spec" in folder_problem(root / "out", COMPILED, [spec]).message
    assert "contains the spec" in folder_problem(root / "out", COMPILED, [Path("out/../out/spec.yaml")]).message
    assert folder_problem(root / "out", COMPILED, [root / "spec.yaml"]) is None


def test_a_folder_of_another_kind_is_refused(root):
    write_folder(OLD, Path("out"), RUN)
    assert "of kind 'run'" in folder_problem(Path("out"), COMPILED).message
    assert content(root / "out") == OLD


def test_a_link_that_leads_down_is_no_way_out(root):
    (root / "deep" / "er").mkdir(parents=True)
    (root / "short").symlink_to("deep/er")
    write_folder(NEW, Path("short/out"), COMPILED)
    assert content(root / "deep" / "er" / "out") == NEW


@pytest.mark.parametrize("there", ["nothing", "an empty folder", "an old one"])
def test_a_folder_is_written_as_a_whole(root, there):
    if there == "an empty folder":
        (root / "out").mkdir()
    elif there == "an old one":
        write_folder(OLD, Path("out"), COMPILED)
    write_folder(NEW, Path("out"), COMPILED)
    assert content(root / "out") == NEW
    assert read_marker(root / "out").files == set(NEW)
    assert not (root / "out" / "gone").exists()
    assert [path.name for path in root.iterdir()] == ["out"]


FOREIGN = {"notes.txt": MINE, "engine/hand-made.xml": MINE, "mine/deep/er.txt": MINE, "gone/also-mine.txt": MINE}


def foreign(folder: Path) -> None:
    for name, text in FOREIGN.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    (folder / "link").symlink_to("notes.txt")
    (folder / "link-to-folder").symlink_to("mine")
    (folder / "empty").mkdir(mode=0o700)
    os.mkfifo(folder / "pipe")


@pytest.mark.parametrize("exchange", [True, False])
@pytest.mark.parametrize("links", [True, False])
def test_files_of_others_in_a_folder_stay(root, monkeypatch, exchange, links):
    if not exchange:
        monkeypatch.setattr(staging, "exchange", lambda entry, other: False)
    if not links:

        def refuse(*_, **__):
            raise PermissionError(1, "no hard links here")

        monkeypatch.setattr(os, "link", refuse)
    write_folder(OLD, Path("out"), COMPILED)
    foreign(root / "out")
    before = {name: kind for name, kind in picture(root / "out").items() if name not in (*OLD, MARKER_FILE)}
    write_folder(NEW, Path("out"), COMPILED)
    after = picture(root / "out")
    assert {name: after.get(name) for name in before} == before
    assert {name: (root / "out" / name).read_text() for name in FOREIGN} == FOREIGN
    assert {name: (root / "out" / name).read_text() for name in NEW} == NEW
    assert not (root / "out" / "gone" / "away.txt").exists()
    assert not stray(root)
    assert (root / "out" / "notes.txt").stat().st_nlink == 1


def test_a_foreign_file_is_never_overwritten(root):
    write_folder(OLD, Path("out"), COMPILED)
    (root / "out" / "engine" / "more.xml").write_text(MINE)
    before = picture(root)
    with pytest.raises(SpecError, match=r"engine/more\.xml.*was not written by simspec"):
        write_folder(NEW, Path("out"), COMPILED)
    assert picture(root) == before


def test_an_edited_file_of_simspecs_is_simspecs(root):
    """By its name in the marker: a merge conflict in generated/ is repaired by compiling again."""
    write_folder(OLD, Path("out"), COMPILED)
    (root / "out" / "a.txt").write_text("<<<<<<< HEAD\n")
    write_folder(NEW, Path("out"), COMPILED)
    assert content(root / "out") == NEW


@pytest.mark.parametrize("name", ["../x", "/x", "a/../../x", "", "a//b", "./a", MARKER_FILE])
def test_names_that_leave_the_folder_are_refused(root, name):
    for write in (
        lambda: write_folder({name: "x"}, Path("out"), COMPILED),
        lambda: write_private({name: "x"}, root / "p"),
    ):
        with pytest.raises(SpecError):
            write()
    assert list(root.rglob("x")) == []


def test_a_private_folder_must_be_fresh(root):
    (root / "p").mkdir()
    (root / "p" / "mine").write_text(MINE)
    with pytest.raises(SpecError, match="not empty"):
        write_private({"a": "x"}, root / "p")
    assert picture(root / "p").keys() == {"mine"}


def test_an_update_sees_what_is_there_and_may_leave_it(root):
    assert update_folder(lambda found: {"a": "1"} if found is None else None, Path("out"), COMPILED) == {"a": "1"}
    before = os.stat(root / "out").st_ino, os.stat(root).st_mtime_ns
    assert update_folder(lambda found: None, Path("out"), COMPILED) is None
    assert (os.stat(root / "out").st_ino, os.stat(root).st_mtime_ns) == before


def test_files_are_added_changed_and_removed_individually(root):
    open_folder(Path("study"), STUDY)
    add_file(Path("study"), STUDY, "report.json", "1")
    assert change_file(Path("study"), STUDY, "report.json", lambda old: old + b"2")
    assert not change_file(Path("study"), STUDY, "report.json", lambda old: None)
    assert content(root / "study") == {"report.json": "12"}
    (root / "study" / "certificate.json").write_text(MINE)
    with pytest.raises(SpecError, match="simspec did not write it"):
        add_file(Path("study"), STUDY, "certificate.json", "x")
    assert not remove_file(Path("study"), STUDY, "certificate.json")
    assert remove_file(Path("study"), STUDY, "report.json")
    assert content(root / "study") == {"certificate.json": MINE}
    assert read_marker(root / "study").files == frozenset()
    assert not stray(root)


def test_a_single_file_keeps_its_mode_and_is_only_replaced_where_it_is_ours(root):
    ours = lambda old: old.startswith(b"simspec")  # noqa: E731
    write_file(Path("deep/er/file"), "simspec 1", ours)
    os.chmod(root / "deep/er/file", 0o640)
    write_file(Path("deep/er/file"), "simspec 2", ours)
    assert (root / "deep/er/file").read_text() == "simspec 2"
    assert (root / "deep/er/file").stat().st_mode & 0o777 == 0o640
    assert file_problem(Path("deep/er/file"), NEVER) is not None
    assert not stray(root)


def test_a_new_file_never_replaces_a_file_that_has_just_appeared(root, monkeypatch):
    real = staging.begin

    def late(target, *more):
        target.write_text(MINE)
        return real(target, *more)

    monkeypatch.setattr(staging, "begin", late)
    with pytest.raises(SpecError, match="created by another process"):
        write_file(Path("new"), "text", NEVER)
    assert picture(root).keys() == {"new"}
    assert (root / "new").read_text() == MINE


def test_an_error_while_building_leaves_the_old(root):
    write_folder(OLD, Path("out"), COMPILED)
    before = picture(root)

    def build(fresh):
        put(fresh / "a.txt", "half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        build_folder(build, Path("out"), COMPILED)
    assert picture(root) == before


@pytest.mark.parametrize("call", ["fsync", "pwrite"])
def test_an_error_of_the_system_names_the_target(root, monkeypatch, call):
    write_folder(OLD, Path("out"), COMPILED)

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as failing:  # undone here: undo() of the whole would leave the test's folder, too
        failing.setattr(os, call, full)
        for write in (
            lambda: write_folder(NEW, Path("out"), COMPILED),
            lambda: build_folder(lambda fresh: [], Path("out"), COMPILED),
            lambda: update_folder(lambda found: NEW, Path("out"), COMPILED),
            lambda: add_file(Path("out"), COMPILED, "report.json", "1"),
            lambda: write_file(Path("file"), "text", NEVER),
        ):
            with pytest.raises(OSError, match="No space left") as caught:
                write()
            assert Path(caught.value.filename).name in ("out", "file")
    assert content(root / "out") in (OLD, OLD | {"report.json": "1"})
    assert not stray(root)


# --- killed at every point ------------------------------------------------------------------------------------------------

CALLS = ("mkdir", "open", "fsync", "rename", "replace", "link", "unlink", "rmdir", "pwrite", "chmod")
"""Operations of writing on a disk, including the exchange."""


def killed_at(point: int, work) -> bool:
    """Do ``work`` in a process of its own that ends at the ``point``-th call, without any cleaning up; whether it ended."""
    child = os.fork()
    if child == 0:
        left = [point]

        def ending(real):
            def call(*args, **more):
                if left[0] == 0:
                    os._exit(77)
                left[0] -= 1
                return real(*args, **more)

            return call

        try:
            for name in CALLS:
                setattr(os, name, ending(getattr(os, name)))
            staging.exchange = ending(staging.exchange)
            work()
        except BaseException:
            os._exit(1)
        os._exit(0)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code in (0, 77)
    return code == 77


@pytest.fixture
def quick(monkeypatch):
    """The next process finds the files of a killed process, synced or not."""
    monkeypatch.setattr(os, "fsync", lambda handle: None)


def whole_folder():
    write_folder(NEW, Path("out"), COMPILED)


def added_file():
    add_file(Path("out"), COMPILED, "report.json", "new")


@pytest.mark.parametrize("exchange", [True, False])
def test_killed_at_any_point_a_folder_is_the_old_or_the_new(root, quick, monkeypatch, exchange):
    if not exchange:
        monkeypatch.setattr(staging, "exchange", lambda entry, other: False)
    point, seen = 0, set()
    while True:
        write_folder(OLD, Path("out"), COMPILED)
        (root / "out" / "notes.txt").write_text(MINE)
        ended = killed_at(point, whole_folder)
        if exchange or (root / "out").exists():
            found = content(root / "out")
            assert found in (OLD | {"notes.txt": MINE}, NEW | {"notes.txt": MINE}), point
            seen.add("new" if found["a.txt"] == "new a" else "old")
        # the next call in the same folder, for whatever target, leaves nothing stray and everything whole
        write_folder({"x": "x"}, Path("other"), COMPILED)
        assert not stray(root), point
        found = content(root / "out")
        assert found in (OLD | {"notes.txt": MINE}, NEW | {"notes.txt": MINE}), point
        assert (root / "out" / "notes.txt").stat().st_nlink == 1
        write_folder(NEW, Path("out"), COMPILED)
        assert content(root / "out") == NEW | {"notes.txt": MINE}
        if not ended:
            break
        point += 1
    assert seen == {"old", "new"}
    assert point > 25  # it was interrupted at each of its steps


@pytest.mark.parametrize("work", [whole_folder, added_file])
def test_killed_at_any_point_a_first_writing_is_nothing_or_all(root, quick, work):
    point = 0
    while killed_at(point, work):
        if work is whole_folder:
            assert not (root / "out").exists() or content(root / "out") == NEW, point
        work()
        assert not stray(root), point
        assert content(root / "out") == (NEW if work is whole_folder else {"report.json": "new"})
        for path in sorted((root / "out").rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()
        (root / "out").rmdir()
        point += 1
    assert point > 10


def test_killed_at_any_point_a_file_is_the_old_or_the_new(root, quick):
    ours = lambda old: old in (b"old", b"new")  # noqa: E731
    point = 0
    while True:
        (root / "file").write_text("old")
        ended = killed_at(point, lambda: write_file(Path("file"), "new", ours))
        assert (root / "file").read_text() in ("old", "new")
        write_file(Path("file"), "new", ours)
        assert picture(root).keys() == {"file"}, point
        if not ended:
            break
        point += 1
    assert point > 8


def test_a_stage_of_the_living_is_left_alone(root):
    write_folder(OLD, Path("out"), COMPILED)
    with staging.staged(root / "out") as stage:
        os.mkdir(stage.fresh)
        write_folder(NEW, Path("other"), COMPILED)
        assert stage.fresh.is_dir()
    assert not stray(root)


# --- several at a time ----------------------------------------------------------------------------------------------------

WRITER = """
import sys
from pathlib import Path
from simspec.outputs.writing import add_file, change_file, write_folder
name = sys.argv[1]
for turn in range(15):
    write_folder({"a": name, "b/c": name, f"d{turn}": name}, Path("out"), "compiled")
    change_file(Path("study"), "study", "count", lambda old: str(int(old or b"0") + 1))
    add_file(Path("out"), "compiled", f"from-{name}", name)
"""


def test_concurrent_writers_of_a_folder_do_not_break_each_other(root):
    (root / "out").mkdir()
    several = [subprocess.Popen([sys.executable, "-c", WRITER, who]) for who in ("one", "other", "third")]
    assert [process.wait(timeout=120) for process in several] == [0, 0, 0]
    found = content(root / "out")
    assert found["a"] == found["b/c"] == found["d14"]
    assert content(root / "study") == {"count": "45"}
    assert not stray(root)


def test_where_folders_cannot_be_locked_a_file_is(root, monkeypatch):
    import fcntl

    real = fcntl.flock

    def flock(handle, how):
        if os.path.isdir(f"/proc/self/fd/{handle}"):
            raise OSError(9, "Bad file descriptor")
        return real(handle, how)

    monkeypatch.setattr(fcntl, "flock", flock)
    write_folder(OLD, Path("out"), COMPILED)
    write_folder(NEW, Path("out"), COMPILED)
    monkeypatch.setattr(staging, "PATIENCE", 0.0)
    with staging.locked(root), pytest.raises(SpecError, match="another simspec"), staging.locked(root):
        pass
    assert content(root / "out") == NEW
    assert not stray(root)
