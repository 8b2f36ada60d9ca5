"""The wheel works anywhere: built, installed into a fresh environment outside the repository, and run there."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

from tests.nightly import NIGHTLY

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENT = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | {
    "PIP_CONSTRAINT": str(ROOT / "constraints.txt"),
    "PIP_DISABLE_PIP_VERSION_CHECK": "1",
}


def run(*command: object, cwd: Path) -> str:
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=NIGHTLY)], ids=["alone", "with its dependencies"])
def test_the_wheel_runs_in_a_fresh_environment(tmp_path, whole):
    """``whole``: with the dependencies that it declares, installed anew; else with the packages of this environment."""
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path / "dist", ROOT, cwd=tmp_path)
    (wheel,) = (tmp_path / "dist").glob("simspec_physics-*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    for part in (
        "_resources/templates/",
        "_resources/specs/spheres-216.yaml",
        "_resources/schema/",
        "help.txt",
        "_resources/docs/errors/S101.md",
    ):
        assert any(part in name for name in names), part
    for part in ("_resources/page/bundle/report.js", "licenses/page/bundle/LICENSE-three.txt"):
        assert any(name.endswith(part) for name in names), part
    (metadata,) = [name for name in names if name.endswith(".dist-info/METADATA")]
    assert b"\nLicense-Expression: Apache-2.0 AND MIT\n" in zipfile.ZipFile(wheel).read(metadata)
    venv.create(tmp_path / "fresh")
    scripts = tmp_path / "fresh" / "bin"
    # this environment's pip, and nothing compiled that is never imported
    pip = (sys.executable, "-m", "pip", "--python", scripts / "python")
    if whole:
        run(*pip, "install", "--quiet", "--no-compile", f"{wheel}[mujoco]", cwd=tmp_path)
    else:
        run(*pip, "install", "--quiet", "--no-compile", "--no-deps", wheel, cwd=tmp_path)
        (site,) = (tmp_path / "fresh").glob("lib/python*/site-packages")
        # after its own folder, and without what the installed packages' own .pth files name: simspec is the wheel's
        (site / "others.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
    work = tmp_path / "elsewhere"
    work.mkdir()
    assert "simspec" in run(scripts / "simspec", "--help", cwd=work)
    origin = run(scripts / "python", "-c", "import simspec; print(simspec.__file__)", cwd=work)
    assert origin.startswith(str(tmp_path / "fresh"))
    run(scripts / "simspec", "compile", "ur10e", "--engine", "mujoco", cwd=work)
    assert (work / "generated" / "ur10e" / "mujoco" / "model.xml").exists()
    run(scripts / "simspec", "run", "bouncing-ball", "--engine", "mujoco", "--no-verify", "--report", cwd=work)
    assert "<script>" in (work / "runs" / "bouncing-ball" / "report.html").read_text(encoding="utf-8")
