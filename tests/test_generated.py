"""The committed output: when it is current, when not, and when a certificate still belongs to it."""

from __future__ import annotations

import dataclasses
import json

import pytest

from simspec import generated
from simspec.compiler import Compiled
from simspec.errors import SpecError
from simspec.generated import CERTIFICATE_FILE, Built, certificate_mismatch, check, read_certificate, write_certificate
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import Check
from simspec.world.canonical import canonical_json, sha256
from tests import worlds

WORLD = worlds.spheres(2)


def built(world=WORLD, engines=("first", "second"), text: str = "<model/>\n") -> Built:
    """A compiled world of made-up engines, whose files are what the real ones' are: a model and a sidecar."""
    sidecar = json.dumps({"schema": 1, "world": sha256(world)})
    compiled = {name: Compiled(name, "xml", {"model.xml": text, "sidecar.json": sidecar}, ()) for name in engines}
    files = {"world.json": canonical_json(world) + "\n"}
    files |= {f"{name}/{path}": content for name, one in compiled.items() for path, content in one.files.items()}
    return Built(world, compiled, files)


def proof(one: Built, worst: float = 1e-15, seconds: float = 1.0, version: str = "1.0") -> Certificate:
    checks = (Check("L1", "mass", 3, 1e-9, worst, "bodies.ball_0"),)
    engines = {name: EngineProof(version, part.sha256, checks, {}, {}, seconds) for name, part in one.compiled.items()}
    return Certificate(one.world.name, sha256(one.world), "pinocchio 4", engines)


def test_a_folder_that_was_just_written_is_current(tmp_path):
    one, folder = built(), tmp_path / "spheres"
    assert len(check(one, folder)) == len(one.files) + 1
    assert generated.write(one, folder).changed
    assert [line.split(" (")[0] for line in check(one, folder)] == [f"missing: {folder / CERTIFICATE_FILE}"]
    assert write_certificate(proof(one), folder)
    assert check(one, folder) == []
    again = generated.write(one, folder)
    assert (again.changed, again.dropped) == (False, None)
    assert check(one, folder) == []


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (built(worlds.spheres(3)), "another world"),
        (built(text="<other/>\n"), "other files of first"),
        (built(engines=("first", "second", "third")), "does not cover third"),
    ],
)
def test_a_certificate_of_something_else_is_stale_and_goes(tmp_path, other, why):
    folder = tmp_path / "spheres"
    generated.write(built(), folder)
    write_certificate(proof(built()), folder)
    (stale,) = [line for line in check(other, folder) if CERTIFICATE_FILE in line]
    assert why in stale
    assert why in generated.write(other, folder).dropped
    assert not (folder / CERTIFICATE_FILE).exists()


@pytest.mark.parametrize("text", ["", "{}", '{"schema": 1}', '{"schema": 99, "engines": {}}', "[]"])
def test_a_damaged_certificate_is_stale(tmp_path, text):
    folder = tmp_path / "spheres"
    generated.write(built(), folder)
    (folder / CERTIFICATE_FILE).write_text(text)
    with pytest.raises(SpecError, match=CERTIFICATE_FILE):
        read_certificate(folder)
    assert "cannot be read" in certificate_mismatch(built(), folder)


def test_a_certificate_that_is_not_valid_does_not_count(tmp_path):
    folder = tmp_path / "spheres"
    generated.write(built(), folder)
    write_certificate(proof(built(), worst=1.0), folder)
    assert any("it is not valid" in line for line in check(built(), folder))


def test_a_certificate_is_written_again_only_when_something_that_matters_changed(tmp_path):
    one, folder = built(), tmp_path / "spheres"
    generated.write(one, folder)
    write_certificate(proof(one), folder)
    first = (folder / CERTIFICATE_FILE).read_bytes()
    assert not write_certificate(proof(one, worst=2e-15, seconds=9.0), folder)
    assert (folder / CERTIFICATE_FILE).read_bytes() == first
    assert write_certificate(proof(one, version="1.1"), folder)
    assert write_certificate(proof(one, worst=1.0, version="1.1"), folder)
    assert (folder / CERTIFICATE_FILE).read_bytes() != first


def test_engines_of_the_same_world_stay_and_others_go(tmp_path):
    folder = tmp_path / "spheres"
    generated.write(built(), folder)
    (folder / "notes").mkdir()
    (folder / "notes" / "mine.txt").write_text("not an engine")
    generated.write(built(engines=("first",), text="<new/>\n"), folder)
    assert (folder / "second" / "model.xml").read_text() == "<model/>\n"
    generated.write(built(worlds.spheres(3), engines=("first",)), folder)
    assert not (folder / "second").exists()
    assert (folder / "notes" / "mine.txt").read_text() == "not an engine"  # simspec did not write it


def test_a_changed_byte_is_seen(tmp_path):
    one, folder = built(), tmp_path / "spheres"
    generated.write(one, folder)
    write_certificate(proof(one), folder)
    (folder / "first" / "model.xml").write_bytes(b"<model/>\r\n")
    assert check(one, folder) == [f"stale: {folder}/first/model.xml"]
    assert generated.write(one, folder).changed
    assert check(one, folder) == []


def test_a_file_name_that_leaves_the_folder_is_refused(tmp_path):
    bad = dataclasses.replace(built(), files={"../escape.txt": "x"})
    with pytest.raises(SpecError, match="leaves the output folder"):
        generated.write(bad, tmp_path / "spheres")
    assert not (tmp_path / "escape.txt").exists()
