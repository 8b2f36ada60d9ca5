"""What is installed in another interpreter."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping

from simspec.engines.kit.contract import Engine
from simspec.errors import EngineError

PATIENCE = 30.0
"""s that an interpreter may take to say what it has: a cold disk needs a few."""
_ASK = """
import importlib.metadata, json, sys
try:
    version = importlib.metadata.version(sys.argv[1])
except importlib.metadata.PackageNotFoundError:
    version = None
json.dump({"version": version}, sys.stdout)
"""


def version_in(python: str, engine: type[Engine]) -> str | None:
    """The version of ``engine`` that the interpreter ``python`` has; None: it has none. Raises EngineError where it cannot be
    asked."""
    try:
        done = subprocess.run(
            [python, "-c", _ASK, engine.DISTRIBUTION],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=PATIENCE,
            check=False,
        )
    except OSError as error:
        raise EngineError(engine.NAME, f"{python} cannot be started: {error.strerror or error}") from None
    except subprocess.TimeoutExpired:
        raise EngineError(engine.NAME, f"{python} gave no version within {PATIENCE:g} s") from None
    try:
        answer = json.loads(done.stdout)
    except ValueError:
        answer = None
    if done.returncode or not isinstance(answer, Mapping) or not isinstance(answer.get("version"), str | None):
        tail = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        raise EngineError(engine.NAME, f"{python} gave no version: {tail[0][:200]}")
    return answer["version"]
