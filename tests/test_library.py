"""The scenario library: every world's hash is pinned, every scenario says what it shows and expects something."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import simspec
from simspec.engines.kit.registry import engines
from simspec.selection import supporting
from simspec.world.canonical import sha256

ROOT = Path(__file__).resolve().parent.parent
SPECS = sorted((ROOT / "specs").glob("*.yaml"))
HASHES = json.loads((Path(__file__).parent / "library_hashes.json").read_text())
"""World hashes of the library, equal on every machine. A change here is a change of a world: say why in the commit."""


def test_scenarios_are_found_by_name_wherever_they_are_in_the_library():
    for path in (*SPECS, *sorted((ROOT / "specs" / "contact").glob("*.yaml"))):
        assert simspec.find_spec(path.stem).samefile(path)


def test_the_library_holds_what_it_promises():
    assert sorted(spec.stem for spec in SPECS) == sorted(HASHES)


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_world_hash(path):
    spec = simspec.load(path)
    world = spec.resolve()
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
    spec = simspec.load(path)
    requested = [name for name, engine in sorted(engines().items()) if not engine.FILES_ALONE]
    assert sorted(certificate["engines"]) == list(supporting(spec.resolve(), requested, spec.locate)[0])
