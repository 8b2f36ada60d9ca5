"""A third-party engine: a package and a suite of three lines (``fake/``), in an interpreter with numpy and nothing more.

It runs in a separate process, as it would in another repository: entry points are read once in a process.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).with_name("fake")
LONGEST = 150


def link_numpy(site: Path) -> None:
    """Put numpy, as it is installed here, and nothing else into an environment."""
    spec = importlib.util.find_spec("numpy")
    assert spec is not None
    assert spec.origin is not None
    here = Path(spec.origin).parent.parent
    names = ["numpy", "numpy.libs", f"numpy-{importlib.metadata.version('numpy')}.dist-info"]
    for name in names:
        if (here / name).exists():  # wheels of some systems have no folder of libraries
            (site / name).symlink_to(here / name)


@pytest.fixture(scope="module")
def python(tmp_path_factory) -> Path:
    """An interpreter that has numpy and the engine."""
    place = tmp_path_factory.mktemp("environment")
    venv.create(place, with_pip=False, symlinks=True)
    (site,) = place.glob("lib/python*/site-packages")
    link_numpy(site)
    (site / "toy.pth").write_text(f"{REPOSITORY}\n")
    return place / "bin" / "python"


def in_its_repository(python: Path, *command: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "TOY_PYTHON": str(python), "PYTHONPATH": str(REPOSITORY)}
    return subprocess.run(
        [sys.executable, *command],
        cwd=REPOSITORY,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_it_has_numpy_and_nothing_of_simspec(python):
    done = subprocess.run(
        [str(python), "-I", "-c", "import numpy, simspec"], capture_output=True, text=True, check=False
    )
    assert "No module named 'simspec'" in done.stderr


def test_it_is_small():
    assert len((REPOSITORY / "toy_engine" / "__init__.py").read_text().splitlines()) < LONGEST


def test_it_passes_the_shipped_suite(python):
    done = in_its_repository(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", ".", "toy_suite.py")
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]
    assert "skipped" not in done.stdout
    assert int(done.stdout.split(" passed")[0].split()[-1]) > 140


PROVE = """
import dataclasses, json, sys
from simspec.proof.judge import judge
from simspec.proof.verify import verify
from simspec.testing import worlds
world = worlds.hinges()
name = sys.argv[2]
certificate = verify(world, [name], pythons={name: sys.argv[1]})
proof = certificate.engines[name]
print(json.dumps({
    "valid": certificate.valid,
    "verdict": proof.verdict,
    "not_checked": proof.not_checked,
    "levels": sorted({check.level for check in proof.checks}),
    "judged": judge(certificate, world),
    "failed": [[check.level, check.name, check.worst] for check in proof.checks if not check.passed],
    "motion": [[check.worst, check.tolerance] for check in proof.level("L6")],
    "of doubles": judge(dataclasses.replace(certificate, engines={"toy": proof}), world),
}))
"""


def proven(python: Path, engine: str) -> dict[str, Any]:
    done = in_its_repository(python, "-c", PROVE, str(python), engine)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_its_certificate_is_valid_and_lists_omitted_checks(python):
    said = proven(python, "toy")
    assert said["valid"]
    assert said["judged"] == []
    assert said["levels"] == ["L0", "L1", "L2", "L3", "L4", "L6"]  # L3 by accelerations of one step
    assert "L3" not in said["not_checked"]
    assert said["verdict"].startswith("valid; not checked: L4 ")


def test_an_engine_in_single_precision_is_judged_by_single_precision(python):
    """Its motion is off by what its numbers make of it, 1000 times what doubles may be, and well within its own floor; that it
    is called an engine of doubles is seen."""
    said = proven(python, "singletoy")
    assert said["failed"] == []
    assert said["valid"]
    assert said["judged"] == []
    assert said["verdict"].startswith("valid in single precision; not checked: L4 ")
    ((worst, tolerance),) = said["motion"]
    assert 1e-6 < worst < tolerance / 5.0 < 2e-4
    assert "it was held to single precision, toy computes in double" in "".join(said["of doubles"])
