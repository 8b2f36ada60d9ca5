"""Commands load what they need: the modules of simspec and the large packages that a fresh interpreter has after each."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from simspec.commands.files import STARTER
from simspec.commands.help_format import COMMAND_GROUPS

ROOT = Path(__file__).resolve().parents[1]
LARGE = {"dask", "jinja2", "numpy", "packaging", "pandas", "pinocchio", "pint", "pyarrow", "rich", "ruamel", "scipy"}
"""Packages that take longer to import than all else that a small command does."""
SPEC = str(ROOT / "specs/ball-pendulum.yaml")
PROGRAM = """
import json, sys
sys.argv = ["simspec", *sys.argv[1:]]
from simspec.__main__ import main
try:
    code = main()
except SystemExit as error:
    code = error.code
print(json.dumps([code or 0, sorted(sys.modules)]), file=sys.stderr)
"""


def loaded(*words: str) -> tuple[set[str], set[str]]:
    """The modules of simspec, and the large packages, that a command loads."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, cwd=ROOT, check=True)
    code, modules = json.loads(done.stderr.splitlines()[-1])
    assert code == 0, done.stderr
    return {name for name in modules if name.partition(".")[0] == "simspec"}, LARGE & {
        name.partition(".")[0] for name in modules
    }


@pytest.mark.parametrize("command", [*" ".join(COMMAND_GROUPS.values()).split(), "engines doctor", "engines install"])
def test_help_loads_options_alone(command):
    modules, large = loaded(*command.split(), "--help")
    assert len(modules) <= 12
    assert not large


@pytest.mark.parametrize("contact", [False, True])
def test_check_loads_no_engine(contact, tmp_path):
    starter = tmp_path / "starter.yaml"
    starter.write_text(STARTER.replace("NAME", "starter"))
    modules, large = loaded("check", str(starter) if contact else SPEC)
    assert len(modules) <= 150
    assert large == {"numpy", "ruamel"} | ({"pinocchio"} if contact else set())  # the mass of a damped joint's tree
    parts = {".".join(name.split(".")[1:3]) for name in modules if name.count(".") > 1}
    assert not {part for part in parts if part.startswith(("dialects.", "formats."))}
    classes = {name for name in modules if name.startswith("simspec.engines.") and name.count(".") > 2}
    assert {name.split(".")[2] for name in classes} == {"kit"}


def test_compiling_for_an_engine_loads_no_other(tmp_path):
    modules, large = loaded("compile", SPEC, "--engine", "mujoco", "--out", str(tmp_path / "one"))
    assert len(modules) <= 230
    assert large == {"jinja2", "numpy", "ruamel"}
    for part in ("engines", "dialects", "formats"):
        named = {name.split(".")[2] for name in modules if name.startswith(f"simspec.{part}.")}
        assert named <= {"kit", "mujoco", "mjcf"}, part


def test_compiling_for_all_engines_loads_no_package_of_an_engine(tmp_path):
    modules, large = loaded("compile", SPEC, "--out", str(tmp_path / "all"))
    assert len(modules) <= 400
    assert large == {"jinja2", "numpy", "ruamel"}


def test_the_comparison_of_stored_runs_loads_no_engine(tmp_path):
    pytest.importorskip("mujoco")
    for name in ("a", "b"):
        words = ["run", SPEC, "--engine", "mujoco", "--no-verify", "--set", "physics.duration=0.1s"]
        subprocess.run([sys.executable, "-m", "simspec", *words, "--out", tmp_path / name], cwd=ROOT, check=True)
    runs = [str(next((tmp_path / name).rglob("provenance.json")).parent) for name in ("a", "b")]
    modules, large = loaded("diff", *runs)
    assert len(modules) <= 130
    assert large <= {"numpy", "pandas", "pyarrow", "rich"}
