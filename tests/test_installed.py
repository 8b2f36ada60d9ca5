"""Engines that tests do without are named, and those that have to be there are not left out."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from simspec.engines.kit.registry import engines
from tests.installed import DEMANDED, demanded

GHOST = '''
"""An engine that is known, and not installed."""
from simspec.engines.drake.engine import Drake
from simspec.engines.kit import registry

class Ghost(Drake):
    NAME, DISTRIBUTION, EXTRA = "ghost", "no-such-ghost", "ghost"

registry.engines()._loaded["ghost"] = Ghost
'''


def test_engines_of_make_setup_and_named_engines_are_required():
    class Rare(engines()["drake"]):
        NAME, EXTRA = "rare", "rare"

    known = [*engines().values(), Rare]
    # make setup installs Rapier in addition to them: environments that are older than it go on without; MJX and MuJoCo Warp
    # have their own
    usual = {name for name, engine in engines().items() if engine.DISTRIBUTION} - {
        "physx",
        "rapier",
        "newton",
        "mjx",
        "mjwarp",
    }
    assert demanded("", known) == usual >= {"dart", "drake", "mujoco", "pybullet"}
    assert demanded("rare", known) == {*usual, "rare"}
    assert demanded(" all ,", known) == {*engines(), "rare"}
    with pytest.raises(ValueError, match="names rar; known: all, "):
        demanded("rar", known)


@pytest.mark.parametrize(
    ("words", "code", "said"), [("", 0, "1 passed, 1 skipped"), ("ghost", 1, "1 failed, 1 passed")]
)
def test_an_engine_that_is_not_there_is_skipped_by_name_or_fails_where_it_is_demanded(tmp_path, words, code, said):
    (tmp_path / "ghost.py").write_text(GHOST)
    suite = "tests/engines/test_engine_suite.py::test_every_known_engine_is_in_the_suite"
    words = {**os.environ, DEMANDED: words, "PYTHONPATH": str(tmp_path)}
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "ghost",
        "-p",
        "no:cacheprovider",
        "-k",
        "ghost or drake",
        suite,
    ]
    done = subprocess.run(command, env=words, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    assert said in done.stdout
    assert "ghost: not installed: pip install 'simspec-physics[ghost]'" in done.stdout or code
