"""The scenario of docs/guide/import.md: a robot file as it is found picks a cube, in two engines."""

from __future__ import annotations

import json
import re
import shutil
from importlib.util import find_spec
from pathlib import Path

from simspec import cli

PAGE = Path(__file__).resolve().parent.parent.parent / "docs" / "guide" / "import.md"


def test_a_panda_with_meshes_and_coupled_fingers_picks_a_cube(tmp_path, monkeypatch):
    found = re.search(r"<!-- import: panda-pick.yaml -->\n```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (package,) = find_spec("pybullet_data").submodule_search_locations
    shutil.copytree(Path(package) / "franka_panda", tmp_path / "franka_panda")
    (tmp_path / "panda-pick.yaml").write_text(found.group(1), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    engines = ["--engine", "mujoco", "--engine", "pybullet"]
    assert cli.main(["run", "panda-pick.yaml", *engines, "--no-repeats", "--no-verify"]) == 0
    runs = json.loads(Path("runs/panda-pick/report.json").read_text(encoding="utf-8"))["runs"]
    assert {name: [expectation["passed"] for expectation in run["expectations"]] for name, run in runs.items()} == {
        "mujoco": [True],
        "pybullet": [True],
    }


def test_meshes_without_the_packages_that_read_them_give_a_single_error(tmp_path, monkeypatch, capsys):
    from simspec.meshes import load

    (package,) = find_spec("pybullet_data").submodule_search_locations
    shutil.copytree(Path(package) / "franka_panda", tmp_path / "franka_panda")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(load, "not_installed", lambda: ["trimesh"])
    monkeypatch.setattr(load, "read", lambda name: None)
    monkeypatch.setattr(load, "_remembered", {})
    assert cli.main(["import", "franka_panda/panda.urdf", "-o", "panda.yaml"]) == 2
    said = capsys.readouterr().err
    assert said.count("error[") == said.count("error[C110]") == 1
    assert "pip install 'simspec-physics[meshes]'" in said
    assert "missing-meshes" not in said
