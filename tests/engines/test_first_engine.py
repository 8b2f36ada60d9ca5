"""The example of ``docs/design/adding-an-engine.md``: an engine of the first tier in a package of its own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "engine"


@pytest.fixture
def package(tmp_path) -> Path:
    """A copy of the example with the metadata that pip would install."""
    folder = tmp_path / "engine"
    shutil.copytree(EXAMPLE, folder)
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    metadata = folder / f"{project['name']}-{project['version']}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    lines = [f"{name} = {place}" for name, place in project["entry-points"]["simspec.engines"].items()]
    (metadata / "entry_points.txt").write_text("\n".join(["[simspec.engines]", *lines, ""]))
    return folder


def run(folder: Path, *words: str) -> dict:
    done = subprocess.run(
        [sys.executable, "-m", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return json.loads(done.stdout)


def test_the_example_moves_as_mujoco_does(package):
    words = ("tumbling.yaml", "--engine", "ballistic", "--engine", "mujoco", "--no-repeats", "--json")
    report = run(package, "simspec", "run", *words)
    assert {name: proof["valid"] for name, proof in report["proofs"].items()} == {"ballistic": True, "mujoco": True}
    assert report["proofs"]["ballistic"]["verdict"].startswith("valid; not checked: L4 ")
    (brick,) = report["diffs"][0]["bodies"]
    assert brick["compared"]
    assert brick["position_largest"] < 1e-15
    assert brick["angle_largest"] < 1e-13


def test_the_page_says_its_length():
    page = EXAMPLE.parents[1] / "design" / "adding-an-engine.md"
    lines = len((EXAMPLE / "ballistic" / "__init__.py").read_text().splitlines())
    assert f"in {lines} lines" in page.read_text()
    assert len(page.read_text().splitlines()) <= 300
