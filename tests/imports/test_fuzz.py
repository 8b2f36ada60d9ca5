"""tools/fuzz: its cases are the same everywhere, and it notices what no importer may do."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from simspec.errors import Problem, SpecError
from simspec.imports.sdf.importer import SdfImporter
from simspec.meshes.child import READERS
from simspec.meshes.reading import MeshError, open_mesh, read_surfaces

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "tools" / "fuzz"))

import judge  # noqa: E402 - a script outside the package
from cases import Fuzz  # noqa: E402
from seeds import MESHES, SUFFIX, seeds  # noqa: E402

CASES = range(15)


def test_a_case_is_its_number(tmp_path):
    for language in ("sdf", "usd"):
        entry, other = (Fuzz(language, tmp_path / name) for name in "ab")
        assert [entry.files(case) for case in range(5)] == [other.files(case) for case in range(5)]
    assert entry.files(0)[1] != entry.files(1)[1]


def test_every_reader_of_meshes_begins_with_files_that_are_read(tmp_path):
    files = []
    for kind in MESHES:
        for number, seed in enumerate(seeds(kind)):
            file = tmp_path / f"seed{number}{SUFFIX[kind]}"
            file.write_bytes(seed.content)
            files.append(open_mesh(file))
    assert not [answer for answer in read_surfaces(files) if isinstance(answer, MeshError)]
    assert {SUFFIX[kind] for kind in MESHES} == set(READERS)


def test_importers_of_xml_stand_some_cases(tmp_path):
    for language in ("sdf", "urdf"):
        fuzz = Fuzz(language, tmp_path / language)
        attempts = [fuzz.attempt(case) for case in CASES]
        assert not [finding for _, finding in attempts if finding is not None]
        assert {outcome.partition(":")[0] for outcome, _ in attempts} == {"accepted", "refused"}


def verdict(fuzz):
    project, _, _ = fuzz.place(0)
    (project / "a.sdf").write_text("<sdf version='1.9'/>")
    with contextlib.closing(judge.Watch(fuzz.folder / "outside")) as watch:
        return judge.judged(project, "a.sdf", watch)


def raises(error):
    def plant(self, path, shown, options):
        raise error

    return plant


def reads(path):
    with open(path.parent.parent / "outside/secret.sdf") as stream:
        stream.read()


def reads_elsewhere(path):
    subprocess.run(["cat", path.parent.parent / "outside/secret.sdf"], stdout=subprocess.DEVNULL, check=True)


def works(path):
    until = time.process_time() + 0.4
    while time.process_time() < until:
        pass


def leaves(path):
    (path.parent.parent / "tmp/left").touch()


@pytest.mark.parametrize(
    ("act", "given"),
    [
        (reads, "opened"),
        (reads_elsewhere, "opened what is outside"),
        (works, "of processor time"),
        (leaves, "left behind"),
        (lambda path: os._exit(3), "ended by status 3"),
        (lambda path: time.sleep(60), "hangs"),
    ],
)
def test_forbidden_acts_of_an_importer_are_noticed(act, given, tmp_path, monkeypatch):
    def plant(self, path, shown, options):
        act(path.resolve())
        raise SpecError([Problem("refused", location=None)])

    monkeypatch.setattr(SdfImporter, "read", plant)
    monkeypatch.setattr(judge, "CPU_SECONDS", 0.3)
    monkeypatch.setattr(judge, "WALL", 2.0 if given == "hangs" else 60.0)
    _, wrong = verdict(Fuzz("sdf", tmp_path / "case"))
    assert any(given in entry for entry in wrong), wrong


@pytest.mark.parametrize(
    ("error", "given"),
    [(KeyError("x"), "KeyError"), (RecursionError(), "Recursion"), (SpecError([Problem("here")]), "without a place")],
)
def test_errors_of_another_form_are_noticed(error, given, tmp_path, monkeypatch):
    monkeypatch.setattr(SdfImporter, "read", raises(error))
    _, wrong = verdict(Fuzz("sdf", tmp_path / "case"))
    assert any(given in entry for entry in wrong), wrong
    monkeypatch.undo()
    assert verdict(Fuzz("sdf", tmp_path / "case")) == ("refused: this file has no model and no world", [])
