"""NVIDIA Warp at work in an engine's process: its start, and where it keeps what it compiles.

Warp compiles its functions when they are first called, 0.1 to 30 s each, and keeps what it compiled by the text of the
function and the processor: in a folder of simspec's cache, so that processes share it. Warp itself removes none.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from simspec.engines.kit.messages import captured
from simspec.files import scratch_folder
from simspec.outputs.files import cache_folder, hold_folder

MADE = re.compile(r"wp_.*")
"""Names of Warp's folders of compiled functions."""
MOST = 2048
"""Folders of compiled functions that are kept, of all versions of Warp: some 170 MB."""
PROCESSOR = "cpu"
_begun: list[str] = []


def begin(warp: Any, folder: str, log: list[str]) -> tuple[str, ...]:
    """Start Warp, with what it compiles in ``folder`` of simspec's cache; the devices that it has, the first choice first. Its
    messages are added to ``log``, except that there is no CUDA."""
    if not _begun:
        warp.config.log_level = warp.LOG_WARNING
        warp.config.kernel_cache_dir = str(_place(folder, log))
        with captured(sys.stderr, log, known=("CUDA driver",)), captured(sys.stdout, log):
            warp.init()
        _begun.extend(str(device) for device in warp.get_cuda_devices())
        _begun.append(PROCESSOR)
    return tuple(_begun)


def share_kernels(phase: type, names: Iterable[str]) -> None:
    """Let functions that make kernels return one kernel for equal arguments: those by ``names`` in the module of ``phase``.

    Warp examines all kernels of a module when one is new: with a new one for each world that a process loads, a first step took
    0.4 s, and 0.1 s more with every world; with a shared one it takes 0.04 s (measured). Kernels and results are the same.
    """
    module = sys.modules[phase.__module__]
    for name in names:
        make = getattr(module, name)
        if not hasattr(make, "cache_info"):
            setattr(module, name, functools.cache(make))


def doubles(array: Any) -> np.ndarray:
    """The numbers of one of Warp's arrays."""
    found: np.ndarray = array.numpy().astype(float)
    return found


def _place(name: str, log: list[str]) -> Path:
    """Where Warp keeps what it compiles: in the user's cache; where the user has none that can be written, as long as this
    process lives."""
    folder = cache_folder(name)
    if folder is not None:
        try:
            hold_folder(folder, MADE, MOST)
        except OSError as error:
            log.append(f"programs that Warp compiles are not kept: {error}")
        else:
            return folder
    stack = contextlib.ExitStack()
    atexit.register(stack.close)
    return stack.enter_context(scratch_folder("kernels"))
