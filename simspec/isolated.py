"""How a Python interpreter is started: so that no file of the folder that a command is started in is imported.

``python -m``, ``python -c`` and ``python script`` put the working folder, or the script's, before the standard library: a
``json.py`` or ``pip.py`` there would be run. Every start of an interpreter in simspec goes through one of the two forms here,
in a working folder other than the user's (``tests/test_isolated.py``).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from typing import Final

ELSEWHERE: Final = "/"
"""A working folder for interpreters that need none."""


def isolated(*words: str, python: str | None = None) -> list[str]:
    """The words that start an interpreter (None: this one) in isolated mode, ``-I``: neither the working folder, nor the user's
    own packages, nor any variable ``PYTHON...`` has an effect."""
    return [python or sys.executable, "-I", *words]


def with_search_path(*words: str, python: str | None = None) -> list[str]:
    """The same for an interpreter that has to import an engine or a reader of files, which some users have by ``PYTHONPATH``
    alone (libraries that are built from source): ``-P`` and ``-s`` leave out the working folder and the user's own packages.
    The environment must be one of :func:`search_environment`."""
    return [python or sys.executable, "-P", "-s", *words]


def search_environment(environment: Mapping[str, str]) -> dict[str, str]:
    """An environment whose ``PYTHONPATH`` has absolute paths alone: an empty entry is the working folder, as
    ``PYTHONPATH=$PYTHONPATH:/more`` leaves it behind, and a relative one is below it."""
    paths = [path for path in environment.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(path)]
    cleaned = {name: value for name, value in environment.items() if name != "PYTHONPATH"}
    return {**cleaned, "PYTHONNOUSERSITE": "1", **({"PYTHONPATH": os.pathsep.join(paths)} if paths else {})}
