"""What machine this is, as far as speed depends on it, and whether anything else is at work on it."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

UNKNOWN = "unknown"
CPUS = Path("/sys/devices/system/cpu")
BOOST = {"cpufreq/boost": "1", "intel_pstate/no_turbo": "0"}
"""Files below :data:`CPUS`, and what they say where cores may run above their nominal frequency."""
STEADY = "performance"
"""The frequency governor under which a core's frequency does not follow its load."""
MEMORY_SHARE = 0.05
"""Machines of one kind report totals that differ by what firmware and kernel reserve: 1 to 3 % between kernels."""
BUSY = 0.15
"""Cores' worth of other work from which a machine is not quiet. An idle desktop uses up to 0.05; clock ticks of 10 ms make
0.1 of a window of 0.2 s uncertain."""
STOLEN = 0.02
"""Share of a core's time that a virtual machine's host may keep: beyond it, processor time is no measure either."""
WINDOW = 0.5
"""s over which the machine is watched."""

HARDWARE = ("cpu", "architecture", "cores", "threads", "governor")
"""What must be the same for speeds to be comparable; and memory, nearly."""


@dataclass(frozen=True, slots=True)
class Machine:
    """A machine.

    ``cores``: physical; ``threads``: logical processors; ``memory`` in bytes; ``governor``: of the processors' frequency,
    all that are in use, "unknown" where the system does not say (as in most virtual machines).
    """

    cpu: str
    architecture: str
    cores: int
    threads: int
    governor: str
    memory: int
    kernel: str
    python: str

    def differences(self, other: Machine) -> list[str]:
        """In words, why speeds of the two machines are not comparable; empty where they are.

        Kernel and Python do not count: they are software, whose speed is measured as the engines' is.
        """
        pairs = {name: (getattr(self, name), getattr(other, name)) for name in HARDWARE}
        told = [f"{name}: {first} and {second}" for name, (first, second) in pairs.items() if first != second]
        if abs(self.memory - other.memory) > MEMORY_SHARE * max(self.memory, other.memory):
            told.append(f"memory: {self.memory / 2**30:.1f} GiB and {other.memory / 2**30:.1f} GiB")
        return told

    def plain(self) -> dict[str, Any]:
        """As data of JSON."""
        return asdict(self)


def this_machine() -> Machine:
    """The machine that this process runs on."""
    import psutil

    return Machine(
        cpu=_cpu(),
        architecture=platform.machine() or UNKNOWN,
        cores=psutil.cpu_count(logical=False) or psutil.cpu_count() or 0,
        threads=psutil.cpu_count() or 0,
        governor=", ".join(sorted(governors())) or UNKNOWN,
        memory=int(psutil.virtual_memory().total),
        kernel=f"{platform.system()} {platform.release()}".strip() or UNKNOWN,
        python=f"{platform.python_implementation()} {platform.python_version()}",
    )


def _cpu() -> str:
    """The processor's model."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or UNKNOWN  # not Linux
    names = [line.partition(":")[2].strip() for line in lines if line.startswith(("model name", "Model"))]
    return names[0] if names and names[0] else platform.processor() or UNKNOWN


def governors(cpus: Path = CPUS) -> set[str]:
    """The frequency governors of all processors; empty where the system does not say."""
    told = {_word(path) for path in cpus.glob("cpu[0-9]*/cpufreq/scaling_governor")}
    return told - {""}


def _word(path: Path) -> str:
    """The content of a file of the system; "" where there is none to read."""
    try:
        return path.read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return ""


def scaling(cpus: Path = CPUS) -> list[str]:
    """In words, why a processor's frequency may change between two measurements; empty where nothing says so."""
    told = [f"the frequency governor is {name!r}, not {STEADY!r}" for name in sorted(governors(cpus) - {STEADY})]
    if any(_word(cpus / name) == value for name, value in BOOST.items()):
        told.append("processors may run above their nominal frequency")
    return told


@dataclass(frozen=True, slots=True)
class Clocks:
    """Readings, in s: wall time, processor time of all that runs here and of this process with its ended children, and what the
    host of a virtual machine kept for itself."""

    wall: float
    busy: float
    own: float
    stolen: float

    @classmethod
    def read(cls) -> Clocks:
        """Now."""
        import psutil

        times, own = psutil.cpu_times(), os.times()
        busy = sum(getattr(times, name, 0.0) for name in ("user", "nice", "system", "irq", "softirq"))
        spent = own.user + own.system + own.children_user + own.children_system
        return cls(time.perf_counter(), busy, spent, getattr(times, "steal", 0.0))

    def others_since(self, earlier: Clocks) -> Others:
        """What others took since ``earlier``."""
        wall = max(self.wall - earlier.wall, 1e-9)
        others = (self.busy - earlier.busy) - (self.own - earlier.own)
        return Others(max(0.0, others / wall), max(0.0, (self.stolen - earlier.stolen) / wall))


@dataclass(frozen=True, slots=True)
class Others:
    """What was not this process's own: ``cores``' worth of work beside it, and of time that the host kept (``stolen``)."""

    cores: float
    stolen: float

    def words(self) -> list[str]:
        """Why that disturbs a measurement; empty where it does not."""
        told = [f"other processes use {self.cores:.2g} cores"] if self.cores > BUSY else []
        return told + ([f"the host keeps {self.stolen:.2g} cores' time"] if self.stolen > STOLEN else [])


def disturbances(window: float = WINDOW) -> list[str]:
    """In words, why what is timed on this machine now says little: other work, its load, a frequency that changes.

    Watches for ``window`` seconds. Empty where the machine is quiet.
    """
    before, used = Clocks.read(), _by_process()
    time.sleep(window)
    others = Clocks.read().others_since(before)
    told = others.words()
    if others.cores > BUSY and (largest := _largest(used, _by_process(), window)):
        told[0] += f" ({largest})"
    return told + load_words(_load(), os.cpu_count() or 1) + scaling()


def load_words(load: float, processors: int) -> list[str]:
    """Whether a load average of the last minute, in which this process's own work is 1, says that others were at work."""
    most = 1.0 + 0.5 * processors
    return [f"the load of the last minute is {load:.1f} on {processors} processors"] if load > most else []


def _load() -> float:
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0


def _by_process() -> dict[tuple[int, float], tuple[str, float]]:
    """Name and processor time (s) of every process that may be seen, but this one, by number and start."""
    import psutil

    used = {}
    for process in psutil.process_iter(("pid", "name", "create_time", "cpu_times")):
        times = process.info["cpu_times"]
        if times is not None and process.info["pid"] != os.getpid():
            key = (process.info["pid"], process.info["create_time"] or 0.0)
            used[key] = (process.info["name"] or UNKNOWN, times.user + times.system)
    return used


def _largest(
    before: Mapping[tuple[int, float], tuple[str, float]],
    after: Mapping[tuple[int, float], tuple[str, float]],
    window: float,
) -> str:
    """The process that used most; "" where none of those that may be seen used any."""
    spent = {key: (name, time_after - before[key][1]) for key, (name, time_after) in after.items() if key in before}
    name, seconds = max(spent.values(), key=lambda one: one[1], default=("", 0.0))
    return f"most of it {name}, {seconds / window:.2g}" if seconds > 0.0 else ""


def processors() -> Sequence[int]:
    """The processors that this thread may use, by number; empty where the system does not say."""
    return sorted(os.sched_getaffinity(0)) if sys.platform.startswith("linux") else []
