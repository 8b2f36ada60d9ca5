"""What is refused of releases of MuJoCo that are older than the installed one. That others hold the same model is tested in
``tests/engines/test_second_environment.py``, in an environment made for it.
"""

from __future__ import annotations

import pytest

from simspec.compiler import compile_world
from simspec.errors import UnsupportedError
from simspec.testing import worlds as shipped
from tests import worlds

FACES = "3.4"
"""The first release in which boxes touch as deep as they are."""


def test_contact_is_refused_before_the_release_that_has_it_right():
    assert compile_world(worlds.spheres(1), [f"mujoco@{FACES}"])
    with pytest.raises(UnsupportedError, match=r"MuJoCo has it from version 3\.4 on, and 3\.3\.7 is at work"):
        compile_world(worlds.spheres(1), ["mujoco@3.3.7"])


def test_motion_without_contact_is_not():
    assert compile_world(shipped.hinges(), ["mujoco@3.3"])
