"""Genesis, imported and begun: once in a process, in double precision, on the processor."""

from __future__ import annotations

import os
from types import SimpleNamespace
from typing import Any

from simspec.errors import EngineError

NAME = "genesis"
ENVIRONMENT = {"NUMBA_DISABLE_JIT": "1", "MUJOCO_GL": "disable"}
"""Genesis lets Numba compile small functions when they are first called, which takes 12 s of processor time (the functions
take less than a second, measured) and executable memory. MuJoCo, which it imports, starts a program to find the version of a
library of windows. A process that reads an untrusted file may have neither."""
PROCESSOR = SimpleNamespace(get_cpu_info=lambda: {"brand_raw": "the processor"})
"""In place of a module that starts a program to learn the processor's name, which Genesis then prints."""
_begun: list[Any] = []


def imported() -> Any:
    """The module ``genesis``, which starts no thread before it begins. Raises EngineError where it, or torch, which it imports
    and does not require, is not installed."""
    os.environ.update(ENVIRONMENT)
    try:
        import genesis
    except ImportError as error:
        raise EngineError(NAME, f"not installed: simspec engines install genesis --yes ({error})") from error
    return genesis


def begun() -> Any:
    """The module at work: its compiler has threads, so that a process that is forked from then on hangs (measured)."""
    genesis = imported()
    if not _begun:
        genesis.utils.misc.cpuinfo = PROCESSOR
        genesis.init(backend=genesis.cpu, precision="64", logging_level="warning", seed=0)
        _begun.append(genesis)
    return genesis
