"""The scenario library: every world's hash is pinned, every scenario says what it shows and expects something."""

from __future__ import annotations

import functools
import json
import re
import shutil
from pathlib import Path

import pytest

import simspec
from simspec import selection
from simspec.engines.kit.registry import engines
from simspec.generated import build, compare, engine_hashes, owned_files, read_certificate
from simspec.proof.judge import holding_proofs
from simspec.selection import supporting
from simspec.world.canonical import sha256
from simspec.world.types import World

ROOT = Path(__file__).resolve().parent.parent
SPECS = sorted((ROOT / "specs").glob("*.yaml"))
HASHES = json.loads((Path(__file__).parent / "library_hashes.json").read_text())
"""World hashes of the library, equal on every machine. A change here is a change of a world: say why in the commit."""
LONG = re.search(r"^LONG := (.*)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)


@functools.cache
def resolved(path: Path) -> tuple[simspec.Spec, World]:
    """A spec and its world, which no test changes: a trajectory of tool moves is solved for a second."""
    spec = simspec.load(path)
    return spec, spec.resolve()


def test_scenarios_are_found_by_name_wherever_they_are_in_the_library():
    for path in (*SPECS, *sorted((ROOT / "specs" / "contact").glob("*.yaml"))):
        assert simspec.find_spec(path.stem).samefile(path)


def test_the_library_holds_what_it_promises():
    assert sorted(spec.stem for spec in SPECS) == sorted(HASHES)


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_world_hash(path):
    spec, world = resolved(path)
    assert sha256(world) == HASHES[path.stem]
    assert world.name == path.stem
    assert spec.data.description
    assert world.expectations
    assert path.read_text().startswith("# yaml-language-server: $schema=")


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_the_committed_certificate_is_valid_for_this_world(path):
    folder = ROOT / "generated" / path.stem
    certificate = json.loads((folder / "certificate.json").read_text())
    assert certificate["valid"] is True
    assert certificate["world_sha256"] == HASHES[path.stem]
    spec, world = resolved(path)
    requested = [name for name, engine in sorted(engines().items()) if not engine.FILES_ALONE]
    assert sorted(certificate["engines"]) == list(supporting(world, requested, spec.locate)[0])


def stale(name: str, folder: Path) -> list[str]:
    """How a folder of compiled files differs from what compiling would write, and which of its proofs do not hold; motions are
    not planned."""
    spec, world = resolved(ROOT / "specs" / f"{name}.yaml")
    built = build(world, selection.known().for_world(world, spec.locate), spec.locate)
    certificate = read_certificate(folder)
    assert certificate is not None
    assert certificate.world_sha256 == sha256(world)
    stored = holding_proofs(certificate, world, engine_hashes(owned_files(folder)))
    return [*compare(built.files, folder), *stored.dropped]


@pytest.mark.parametrize("name", LONG[1].split() if LONG else [])
def test_specs_that_make_check_leaves_out_are_compiled_and_certified(name):
    assert name in HASHES
    assert not stale(name, ROOT / "generated" / name)


def test_another_file_and_a_proof_of_other_files_are_found(tmp_path):
    folder = tmp_path / "four-bar-push"
    shutil.copytree(ROOT / "generated" / folder.name, folder)
    path = folder / "mujoco" / "model.xml"
    path.write_text(path.read_text(encoding="utf-8") + " ", encoding="utf-8")
    assert stale(folder.name, folder) == [f"stale: {path.as_posix()}", "mujoco"]
