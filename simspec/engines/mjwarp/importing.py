"""MuJoCo Warp and Warp, imported, and the device that they compute on.

Warp compiles its functions when they are first called, 0.1 to 15 s each, and keeps what it compiled by the text of the function
and the processor: in a folder of simspec's cache, so that processes share it. That grows by models, for which Warp writes texts
of functions anew: of one there are 26 forms after all worlds of the self-test and simspec's own specs (242 folders of 20 kB to
1.1 MB, 20 MB; measured). Warp itself removes none.
"""

from __future__ import annotations

import atexit
import contextlib
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simspec.engines.kit.captured import captured
from simspec.errors import EngineError
from simspec.outputs.cache import cache_folder
from simspec.outputs.filled import hold
from simspec.scratch import scratch_folder

ENGINE = "mjwarp"
FOLDER = "mjwarp"
MADE = re.compile(r"wp_.*")
"""Names of Warp's folders of compiled functions."""
MOST = 2048
"""Folders of compiled functions that are kept, of all versions of Warp: some 170 MB."""
AUTO, PROCESSOR = "auto", "cpu"
"""Values of the setting ``device``: what Warp takes first, and the processor."""


@dataclass(frozen=True)
class Modules:
    """The modules that the engine works with."""

    mujoco: Any
    warp: Any
    solver: Any
    """``mujoco_warp``."""


_imported: list[Modules] = []
_begun: list[str] = []


def import_modules() -> Modules:
    """The modules, imported once; no thread is started. Raises EngineError where one of them is not installed."""
    if not _imported:
        try:
            import mujoco
            import mujoco_warp
            import warp
        except ImportError as error:
            raise EngineError(ENGINE, f"not installed: simspec engines install mjwarp --yes ({error})") from error
        _imported.append(Modules(mujoco, warp, mujoco_warp))
    return _imported[0]


def begin(log: list[str]) -> Modules:
    """The modules, and Warp at work. What it says of itself meanwhile is added to ``log``, but that there is no CUDA."""
    modules = import_modules()
    if not _begun:
        warp = modules.warp
        warp.config.log_level = warp.LOG_WARNING
        warp.config.kernel_cache_dir = str(_place(log))
        with captured(sys.stderr, log, known=("CUDA driver",)), captured(sys.stdout, log):
            warp.init()
        _begun.extend(str(device) for device in warp.get_cuda_devices())
        _begun.append(PROCESSOR)
    return modules


def _place(log: list[str]) -> Path:
    """Where Warp keeps what it compiles: in the user's cache; where the user has none that can be written, as long as this
    process lives."""
    folder = cache_folder(FOLDER)
    if folder is not None:
        try:
            hold(folder, MADE, MOST)
        except OSError as error:
            log.append(f"what Warp compiles is not kept: {error}")
        else:
            return folder
    stack = contextlib.ExitStack()
    atexit.register(stack.close)
    return stack.enter_context(scratch_folder("kernels"))


def chosen_device(modules: Modules, settings: Mapping[str, Any]) -> Any:
    """The device that a setting names; ``auto``: the first of CUDA, where there is one, else the processor. Raises EngineError
    where there is no such device."""
    named = str(settings["device"])
    name = _begun[0] if named == AUTO else named
    if name not in _begun:
        raise EngineError(ENGINE, f"there is no device {name!r} here, but {', '.join(_begun)}")
    return modules.warp.get_device(name)
