"""The examples of robots at work: short, and those of packages that are installed here resolve without a flag."""

from __future__ import annotations

from pathlib import Path

import pytest

from simspec.language.load import load

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "examples" / "robots"
EXAMPLES = sorted(FOLDER.glob("*.yaml"))


def test_there_are_ten_of_less_than_40_lines():
    assert len(EXAMPLES) == 10
    assert all(len(path.read_text(encoding="utf-8").splitlines()) < 40 for path in EXAMPLES)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_of_an_installed_package(path):
    assert "use: package://" in path.read_text(encoding="utf-8")


def test_a_quadruped_of_an_installed_package_is_found():
    world = load(FOLDER / "a1.yaml").resolve()
    assert {"dog/FR_upper", "dog/RL_toe"} <= {body.name for body in world.bodies}
    assert len(world.controllers[0].joints) == 12
