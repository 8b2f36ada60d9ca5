"""Every command that writes, with every kind of target: foreign files stay unchanged, and the command says why."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from simspec import cli, generated
from simspec.commands import run as run_command
from simspec.errors import SpecError
from simspec.proof import verify as proving
from simspec.runner.store import load_run
from tests.outputs.surroundings import KINDS, MINE, picture, stray
from tests.runner.synthetic import free_body, run, world

pytestmark = pytest.mark.usefixtures("warm_engines")

FALL = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 0.01 s}
bodies:
  ball: {mass: 1, inertia: {principal: [0.01, 0.01, 0.01]}, pose: {xyz: [0, 0, 1]}}
record: {every: 10 ms}
"""
ENGINE = "mujoco"


def invoke(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(cli.app, [str(word) for word in words])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, done.output


@pytest.fixture
def root(tmp_path, monkeypatch):
    place = tmp_path / "work" / "here"
    place.mkdir(parents=True)
    (place / "fall.yaml").write_text(FALL)
    (place.parent / "neighbour.txt").write_text(MINE)
    monkeypatch.chdir(place)

    def never(*_, **__):
        raise AssertionError("work was done before the targets were looked at")

    monkeypatch.setattr(proving, "verify", never)
    monkeypatch.setattr(run_command, "study", never)
    monkeypatch.setattr(generated, "build", never)
    return place


FOLDERS = {
    "compile --out": lambda target: ("compile", "fall.yaml", "--engine", ENGINE, "--out", target),
    "verify --out": lambda target: ("verify", "fall.yaml", "--engine", ENGINE, "--out", target),
}
FILES = {
    "schema --out": lambda target: ("schema", "--out", target),
    "engines --markdown --out": lambda target: ("engines", "--markdown", "--out", target),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", [*FOLDERS, *FILES])
def test_a_target_that_is_not_simspecs_is_refused(root, command, kind):
    target = KINDS[kind](root)
    before = picture(root.parent)
    code, said = invoke(*(FOLDERS | FILES)[command](target))
    assert code == 2, said
    assert "hint" in said or "too long" in said
    assert picture(root.parent) == before


NAMED = [
    kind
    for kind in KINDS
    if kind not in ("a name that is too long", "a path that is too long", "device", "full device")
]
"""Of commands whose target has a name below what is given: the scenario's, an engine's."""


def below(root: Path, kind: str, *, name: str) -> Path:
    """Something of this kind at ``name``, by moving it there; or None where it is not one thing that can be moved."""
    made = KINDS[kind](root)
    source = root / made
    if "/" in made or made in ("", ".", "..") or not os.path.lexists(source):
        pytest.skip("this target is a path, not a thing")
    place = root / name
    place.parent.mkdir(parents=True, exist_ok=True)
    source.rename(place)
    return place


THINGS = [
    kind for kind in NAMED if not kind.startswith(("below", "empty path", "working", "its parent", "parent", "grand"))
]
THINGS = [
    kind
    for kind in THINGS
    if kind not in ("root", "home", "through a folder that is missing", "looks like simspec's by its names")
]
INSIDE = {
    "compile": (("compile", "fall.yaml", "--engine", ENGINE), "generated/fall"),
    "compile two": (("compile", "fall.yaml", "more.yaml", "--engine", ENGINE, "--out", "out"), "out/more"),
    "verify": (("verify", "fall.yaml", "--engine", ENGINE), "generated/fall"),
    "verify --contact": (("verify", "fall.yaml", "--engine", ENGINE, "--contact"), "runs/fall"),
    "run": (("run", "fall.yaml", "--engine", ENGINE), "runs/fall"),
    "run --out": (("run", "fall.yaml", "--engine", ENGINE, "--out", "out"), "out/fall"),
    "run: an engine": (("run", "fall.yaml", "--engine", ENGINE), f"runs/fall/{ENGINE}"),
    "run: compiled": (("run", "fall.yaml", "--engine", ENGINE), "runs/fall/compiled"),
    "new": (("new", "other"), "other.yaml"),
}


@pytest.mark.parametrize("kind", THINGS)
@pytest.mark.parametrize("command", INSIDE)
def test_foreign_files_at_the_target_are_not_overwritten(root, command, kind):
    (root / "more.yaml").write_text(FALL.replace("name: fall", "name: more"))
    words, name = INSIDE[command]
    if name.count("/") == 2:  # in a folder that is simspec's
        (root / "runs" / "fall").mkdir(parents=True)
        (root / "runs" / "fall" / "simspec-folder.json").write_text(
            '{"simspec_folder": 1, "kind": "study", "files": []}'
        )
    below(root, kind, name=name)
    before = picture(root.parent)
    code, said = invoke(*words)
    assert code == 2, said
    assert picture(root.parent) == before


OUTS = [
    "file",
    "pipe",
    "socket",
    "link to a file",
    "dangling link",
    "link to itself",
    "below a file",
    "below a link that leads outside",
]


@pytest.mark.parametrize("kind", OUTS)
def test_run_writes_below_no_such_thing(root, kind):
    target = KINDS[kind](root)
    before = picture(root.parent)
    code, said = invoke("run", "fall.yaml", "--engine", ENGINE, "--out", target)
    assert code == 2, said
    assert picture(root.parent) == before


@pytest.mark.parametrize("kind", KINDS)
def test_saving_a_run_refuses_it_too(root, kind):
    target = KINDS[kind](root)
    before = picture(root.parent)
    with pytest.raises(SpecError):
        run(world(free_body("a"))).save(target)
    assert picture(root.parent) == before


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("file", "a name that is too long")])
def test_fmt_rewrites_regular_files_only(root, kind):
    target = KINDS[kind](root)
    before = picture(root.parent)
    code, said = invoke("fmt", target)
    assert code == 2, said
    assert picture(root.parent) == before


def test_fmt_keeps_the_mode_and_replaces_only_what_it_read(root, monkeypatch):
    ugly = root / "ugly.yaml"
    ugly.write_text(FALL.replace("{timestep: 1 ms, ", "{  timestep:   1 ms,"))
    ugly.chmod(0o640)
    assert invoke("fmt", "ugly.yaml")[0] == 0
    assert ugly.stat().st_mode & 0o777 == 0o640
    assert "{timestep: 1 ms, duration" in ugly.read_text()
    ugly.unlink()
    ugly.symlink_to("fall.yaml")
    assert invoke("fmt", "ugly.yaml")[0] == 2


def test_the_spec_is_never_in_a_folder_that_is_written(root):
    (root / "out").mkdir()
    (root / "out" / "fall.yaml").write_text(FALL)
    (root / "out" / "simspec-folder.json").write_text(
        '{"simspec_folder": 1, "kind": "compiled", "files": ["fall.yaml"]}'
    )
    before = picture(root.parent)
    for words in (
        ("compile", "out/fall.yaml", "--out", "out"),
        ("verify", "out/fall.yaml", "--engine", ENGINE, "--out", "out"),
    ):
        code, said = invoke(*words)
        assert code == 2
        assert "contains the spec" in said
    assert picture(root.parent) == before


def test_files_made_by_simspec_are_overwritten(tmp_path, monkeypatch):
    """Each command twice, with files of others in its folders; after that, all of these and nothing stray."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.yaml").write_text(FALL)
    mine = [
        "generated/fall/notes.txt",
        "generated/fall/mujoco/mine.xml",
        "runs/fall/notes.txt",
        f"runs/fall/{ENGINE}/notes.txt",
    ]
    for turn in range(2):
        more = ("--set", f"bodies.ball.mass={1 + turn}")
        for words in (
            ("compile", "fall.yaml", "--engine", ENGINE, *more),
            ("run", "fall.yaml", "--engine", ENGINE, "--no-repeats", "--no-verify", *more),
            ("schema", "--out", "s.json"),
            ("engines", "--markdown", "--out", "matrix.md"),
            ("fmt", "fall.yaml"),
        ):
            code, said = invoke(*words)
            assert code == 0, said
        for name in mine:
            (tmp_path / name).write_text(MINE)
    assert all((tmp_path / name).read_text() == MINE for name in mine)
    assert not stray(tmp_path)


# --- two at a time --------------------------------------------------------------------------------------------------------


def test_concurrent_runs_of_a_spec_are_both_kept(tmp_path):
    (tmp_path / "fall.yaml").write_text(FALL)
    words = [sys.executable, "-m", "simspec", "run", "fall.yaml", "--no-verify", "--no-repeats", "--json", "--engine"]
    several = [
        subprocess.Popen([*words, engine], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        for engine in ("mujoco", "dart")
    ]
    said = [process.communicate(timeout=120)[0] for process in several]
    assert [process.returncode for process in several] == [0, 0], said
    place = tmp_path / "runs" / "fall"
    assert all(load_run(place / engine).failed is None for engine in ("mujoco", "dart"))
    assert {path.name for path in (place / "compiled").iterdir()} >= {"world.json", "mujoco", "dart"}
    report = json.loads((place / "report.json").read_text())
    assert report["runs"].keys() == {"mujoco", "dart"}
    assert not stray(tmp_path)
    shutil.rmtree(tmp_path / "runs")
