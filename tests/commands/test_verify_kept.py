"""``simspec verify`` of engines in turn: its messages about kept proofs, and the basis of its verdict."""

from __future__ import annotations

import json
import re

import pytest

from simspec import cli
from simspec.errors import EXIT_ENGINE, EXIT_FAILED, EXIT_OK, EXIT_WRONG
from tests.installed import INSTALLED

pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 0.1 s}
bodies:
  ball: {mass: 1, inertia: {principal: [0.01, 0.01, 0.01]}, pose: {xyz: [0, 0, 1]}}
engines: {webots: {accept: [joint.free]}}
"""
FIRST = "mujoco"
SECOND = "rapier" if "rapier" in INSTALLED else "pybullet"
"""Where it is there, one whose numbers are single: the motion of an oracle is planned by those of the engine that is first."""
SECONDS = re.compile(r'"seconds": [0-9.]+|^  "sha256": "\w+",$', re.MULTILINE)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.yaml").write_text(SPEC)
    return tmp_path


@pytest.fixture
def verify(folder, capsys):
    def call(*words: str, code: int = EXIT_OK):
        capsys.readouterr()
        assert cli.main(["verify", "fall.yaml", *words]) == code
        done = capsys.readouterr()
        return json.loads(done.out) if "--json" in words else " ".join((done.out + done.err).split())

    return call


def test_engines_verified_in_turn_give_the_same_file_as_together(folder, verify):
    path = folder / "generated/fall/certificate.json"
    answer = verify("--engine", FIRST, "--json")
    assert answer["stored"] == {"kept": {}, "dropped": {}, "unread": None}
    answer = verify("--engine", SECOND, "--json")
    assert list(answer["stored"]["kept"]) == [FIRST]
    assert answer["stored"]["kept"][FIRST]["valid"] is True
    assert list(answer["certificate"]["engines"]) == [SECOND]
    in_turn = path.read_text()
    assert json.loads(in_turn)["engines"].keys() == {FIRST, SECOND}
    for order in ((FIRST, SECOND), (SECOND, FIRST)):
        path.unlink()
        verify(*(word for name in order for word in ("--engine", name)))
        assert SECONDS.sub("", path.read_text()) == SECONDS.sub("", in_turn)
    assert cli.main(["compile", "fall.yaml", "--check", "--engine", FIRST, "--engine", SECOND]) == EXIT_OK


def test_the_verdict_is_of_the_requested_engines(folder, verify, monkeypatch):
    """A kept proof that is not valid says so, and neither decides the exit code nor counts as one of now."""
    said = verify("--engine", "webots", code=EXIT_ENGINE)
    assert "kept" not in said
    said = verify("--engine", FIRST)
    assert "kept from before, not verified now: webots none (NOT PROVEN)" in said
    assert said.count("NOT PROVEN") == 1
    answer = verify("--engine", FIRST, "--json")
    assert (answer["valid"], answer["stored"]["kept"]["webots"]["valid"]) == (True, False)
    assert cli.main(["compile", "fall.yaml", "--check", "--engine", FIRST]) == EXIT_OK
    assert cli.main(["compile", "fall.yaml", "--check", "--engine", "webots"]) == EXIT_FAILED
    # another world: nothing of it holds
    (folder / "fall.yaml").write_text(SPEC.replace("mass: 1", "mass: 2"))
    said = verify("--engine", FIRST)
    assert "dropped: webots: of another world" in said
    assert "kept" not in said
    # compiling alone says the same of all
    (folder / "fall.yaml").write_text(SPEC)
    assert cli.main(["compile", "fall.yaml", "--engine", FIRST]) == EXIT_OK
    assert not (folder / "generated/fall/certificate.json").exists()


def test_a_certificate_that_is_none_is_replaced_and_that_is_said(folder, verify):
    verify("--engine", FIRST)
    path = folder / "generated/fall/certificate.json"
    path.write_text("{")
    assert "dropped: all that was there: cannot be read" in verify("--engine", FIRST)
    assert json.loads(path.read_text())["valid"] is True


@pytest.mark.parametrize("words", [("verify", "--engine", FIRST), ("run", "--engine", FIRST)])
def test_a_foreign_file_is_an_error_before_any_work(folder, capsys, monkeypatch, words):
    place = folder / ("generated" if words[0] == "verify" else "runs") / "fall"
    place.mkdir(parents=True)
    kind = "compiled" if words[0] == "verify" else "study"
    (place / "simspec-folder.json").write_text(json.dumps({"simspec_folder": 1, "kind": kind, "files": []}))
    (place / "certificate.json").write_text("mine")
    monkeypatch.setattr("simspec.proof.verify.verify", None)
    monkeypatch.setattr("simspec.generated.build", None)
    assert cli.main([words[0], "fall.yaml", *words[1:]]) == EXIT_WRONG
    assert "exists, and simspec did not write it" in " ".join(capsys.readouterr().err.split())
    assert (place / "certificate.json").read_text() == "mine"
    assert sorted(path.name for path in place.iterdir()) == ["certificate.json", "simspec-folder.json"]
