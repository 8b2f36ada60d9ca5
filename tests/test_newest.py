"""tools/newest.sh, where no newer Python is installed: it says so, and passes."""

from __future__ import annotations

import shutil
import subprocess
import tomllib
from pathlib import Path

from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).resolve().parent.parent
SCRIPT = ROOT / "tools" / "newest.sh"


def test_without_a_newer_python_the_step_says_so_and_passes(tmp_path):
    for name in ("bash", "dirname"):
        (tmp_path / name).symlink_to(shutil.which(name))
    environment = {"PATH": str(tmp_path), "PYENV_ROOT": str(tmp_path / "none")}
    words = [tmp_path / "bash", SCRIPT]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout == "no Python 3.13 or 3.12 is installed: simspec is not tested on a newer Python than 3.11\n"


def test_the_versions_of_the_step_are_those_that_the_package_names():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = {line.rpartition(" ")[2] for line in project["classifiers"] if "Python :: 3." in line}
    assert named == {"3.11", "3.12", "3.13"}
    assert all(SpecifierSet(project["requires-python"]).contains(version) for version in named)
    assert "for version in 3.13 3.12; do" in SCRIPT.read_text(encoding="utf-8")
    assert "\nmake --no-print-directory newest >" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
