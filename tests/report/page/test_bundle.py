"""The committed program of the page is that of its sources: ``make page-bundle`` writes it and what it was made of."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from simspec.report.page.document import LIBRARIES, bundle

PAGE = Path(__file__).resolve().parents[3] / "page"
FACTS = json.loads((PAGE / "bundle" / "bundle.json").read_text(encoding="utf-8"))


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_every_source_has_the_hash_recorded_in_the_bundle():
    sources = [f"src/{path.name}" for path in (PAGE / "src").iterdir()]
    sources += ["build.mjs", "package.json", "package-lock.json", "tsconfig.json"]
    assert {name: digest(PAGE / name) for name in sources} == FACTS["sources"], f"stale: {FACTS['command']}"


def test_the_bundle_is_not_edited_by_hand():
    assert {name: digest(PAGE / "bundle" / name) for name in FACTS["files"]} == FACTS["files"], FACTS["command"]
    made = {path.name for path in (PAGE / "bundle").iterdir()}
    assert made == {*FACTS["files"], "bundle.json"}


def test_versions_are_those_that_are_locked():
    locked = json.loads((PAGE / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    assert {name: locked[f"node_modules/{name}"]["version"] for name in LIBRARIES} == FACTS["libraries"]
    assert not any("resolved" in package for package in locked.values())


@pytest.mark.parametrize("name", LIBRARIES)
def test_licences_are_next_to_the_bundle(name):
    assert "Permission is hereby granted" in bundle().licences[name]


def test_the_program_evaluates_no_text():
    script = bundle().script
    assert not any(
        word in script for word in ("eval(", "new Function", "innerHTML=", "insertAdjacentHTML", "document.write")
    )
