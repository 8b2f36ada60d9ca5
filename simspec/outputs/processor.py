"""The processor that a program runs on: what it was compiled for, and by whose instructions libraries choose."""

from __future__ import annotations

import platform
from pathlib import Path


def processor() -> list[str]:
    """The processor's model and instruction sets, as far as the system says."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    wanted = ("model name", "flags", "Features", "CPU part")
    told = dict.fromkeys(line for line in lines if line.split("\t")[0].split(":")[0].strip() in wanted)
    return [platform.machine(), platform.processor(), *told]
