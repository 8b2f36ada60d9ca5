"""Runs that are timed: each alone, in a process of its own, on one processor; the engines take turns.

Slow changes, a processor's temperature or another user's work, then affect all engines alike, and a figure's spread is over
processes, which includes differences from start to start (addresses, the layout of memory).
"""

from __future__ import annotations

import contextlib
import functools
import os
import platform
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from simspec.engines.kit.process import DEADLINE
from simspec.engines.kit.registry import instances
from simspec.errors import EngineError
from simspec.experiments.executors import DoRun, Task
from simspec.plugins import simspec_version
from simspec.runner.execution import failed_run, start_case
from simspec.runner.run import Case, Run

# The description of this machine, as far as speed depends on it, and whether anything else is at work on it.

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
"""Properties that must be equal for speeds to be comparable; and memory, nearly."""


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
        texts = [f"{name}: {first} and {second}" for name, (first, second) in pairs.items() if first != second]
        if abs(self.memory - other.memory) > MEMORY_SHARE * max(self.memory, other.memory):
            texts.append(f"memory: {self.memory / 2**30:.1f} GiB and {other.memory / 2**30:.1f} GiB")
        return texts

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
    words = {_word(path) for path in cpus.glob("cpu[0-9]*/cpufreq/scaling_governor")}
    return words - {""}


def _word(path: Path) -> str:
    """The content of a file of the system; "" where there is none to read."""
    try:
        return path.read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return ""


def scaling(cpus: Path = CPUS) -> list[str]:
    """In words, why a processor's frequency may change between two measurements; empty where nothing says so."""
    texts = [f"the frequency governor is {name!r}, not {STEADY!r}" for name in sorted(governors(cpus) - {STEADY})]
    if any(_word(cpus / name) == value for name, value in BOOST.items()):
        texts.append("processors may run above their nominal frequency")
    return texts


@dataclass(frozen=True, slots=True)
class Clocks:
    """Readings, in s: wall time, processor time of all that runs here and of this process with its ended children, and what the
    host of a virtual machine kept for itself."""

    wall: float
    busy: float
    process: float
    stolen: float

    @classmethod
    def read(cls) -> Clocks:
        """Now."""
        import psutil

        times, local = psutil.cpu_times(), os.times()
        busy = sum(getattr(times, name, 0.0) for name in ("user", "nice", "system", "irq", "softirq"))
        spent = local.user + local.system + local.children_user + local.children_system
        return cls(time.perf_counter(), busy, spent, getattr(times, "steal", 0.0))

    def others_since(self, earlier: Clocks) -> Others:
        """The load by others since ``earlier``."""
        wall = max(self.wall - earlier.wall, 1e-9)
        others = (self.busy - earlier.busy) - (self.process - earlier.process)
        return Others(max(0.0, others / wall), max(0.0, (self.stolen - earlier.stolen) / wall))


@dataclass(frozen=True, slots=True)
class Others:
    """Load that was not this process's: ``cores``' worth of other work, and of time that the host kept (``stolen``)."""

    cores: float
    stolen: float

    def words(self) -> list[str]:
        """Why that disturbs a measurement; empty where it does not."""
        given = [f"other processes use {self.cores:.2g} cores"] if self.cores > BUSY else []
        return given + ([f"the host keeps {self.stolen:.2g} cores' time"] if self.stolen > STOLEN else [])


def disturbances(window: float = WINDOW) -> list[str]:
    """In words, why what is timed on this machine now says little: other work, its load, a frequency that changes.

    Watches for ``window`` seconds. Empty where the machine is quiet.
    """
    before, used = Clocks.read(), _by_process()
    time.sleep(window)
    others = Clocks.read().others_since(before)
    words = others.words()
    if others.cores > BUSY and (largest := _largest(used, _by_process(), window)):
        words[0] += f" ({largest})"
    return words + load_words(_load(), os.cpu_count() or 1) + scaling()


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
    name, seconds = max(spent.values(), key=lambda entry: entry[1], default=("", 0.0))
    return f"most of it {name}, {seconds / window:.2g}" if seconds > 0.0 else ""


def processors() -> Sequence[int]:
    """The processors that this thread may use, by number; empty where the system does not say."""
    return sorted(os.sched_getaffinity(0)) if sys.platform.startswith("linux") else []


TIMED = "timed"
"""Where a run's provenance says how it was timed."""
_alone = threading.Lock()
"""Held while a run is timed: never two at a time in one process."""


@dataclass(frozen=True, slots=True)
class TimedCase:
    """A case, the folder of its compiled files, and the interpreter that has its engine (None: this one)."""

    case: Case
    folder: Path
    python: str | None = None


def core_for_timing() -> int | None:
    """The processor for engines that are timed: the last one that may be used, as interrupts mostly go to the first. None where
    the system cannot bind a process to one."""
    allowed = processors()
    return allowed[-1] if allowed else None


@contextlib.contextmanager
def bound_to(core: int | None) -> Iterator[None]:
    """Processes that this thread starts in the block run on one processor, and what they start as well; the thread itself is
    let go at the end. Nothing is done for None."""
    if core is None:
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def timed_run(
    case: Case,
    folder: Path,
    *,
    core: int | None,
    python: str | None = None,
    deadline: float = DEADLINE,
    source: Mapping[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Run a case alone, on ``core``, in a new process; arguments and errors as of :func:`simspec.runner.execution.run_case`.

    The run's provenance says under "timed" which processor it had (``core``: None, not bound to one), how many cores' worth of
    other work went on meanwhile (``others``, and ``stolen``: by the host of a virtual machine), and what ``machine`` it was.
    """
    with _alone, contextlib.ExitStack() as stack:
        before = Clocks.read()
        with bound_to(core):
            pending = stack.enter_context(start_case(case, folder, python=python, deadline=deadline, source=source))
        run = pending.wait(progress)
    others = Clocks.read().others_since(before)
    facts = {"core": core, "others": round(others.cores, 3), "stolen": round(others.stolen, 3)}
    return replace(run, provenance={**run.provenance, TIMED: {**facts, "machine": _machine().plain()}})


@functools.cache
def _machine() -> Machine:
    return this_machine()


def timed_tasks(pythons: Mapping[str, str]) -> DoRun:
    """How the runs of a sweep are done where speed is measured, for an executor of one job; ``pythons``: interpreters by
    label. The plan's order, engines innermost, has the engines take turns."""
    core = core_for_timing()

    def do_run(case: Case, folder: Path, task: Task) -> Run:
        python = pythons.get(task.engine)
        return timed_run(case, folder, core=core, python=python, deadline=task.deadline, source=task.source)

    return do_run


def timed_runs(
    cases: Sequence[TimedCase],
    repeats: int,
    *,
    deadline: float = DEADLINE,
    source: Mapping[str, Any] | None = None,
    progress: Callable[[str, float], None] = lambda text, share: None,
) -> Iterator[Run]:
    """Time every case ``repeats`` times, in turn: A B C A B C. An engine that fails gives a failed run."""
    core = core_for_timing()
    count = repeats * len(cases)
    for index in range(count):
        timed = cases[index % len(cases)]
        progress(f"timing {timed.case.engine}", index / count)
        try:
            yield timed_run(timed.case, timed.folder, core=core, python=timed.python, deadline=deadline, source=source)
        except EngineError as error:
            yield failed_run(timed.case.resolved, timed.case.engine, error, timed.python)


def disturbed(run: Run) -> list[str]:
    """In words, the load of the machine during a timed run; empty where nothing did, or the run was not timed."""
    facts = run.provenance.get(TIMED)
    return Others(facts["others"], facts["stolen"]).words() if facts else []


# Versions in use by each engine of a sweep: parts of the key under which its runs are stored.

UNKNOWN_VERSIONS = "not queried"


def versions_of(labels: Iterable[str], pythons: Mapping[str, str] = MappingProxyType({})) -> dict[str, dict[str, str]]:
    """By label: the versions of simspec, of the engine, and of the numpy installed with it, by the names that a run's
    provenance gives them. An engine whose interpreter is not to be started (``pythons`` contains it, without a value) has the
    version ``UNKNOWN``, under which nothing is stored. Raises EngineError for an engine that is not there."""
    labels = list(labels)
    used = {label: python for label in labels if (python := pythons.get(label)) is not None}
    closed = [label for label in labels if label in pythons and label not in used]
    known = {
        instance.label: instance for instance in instances(used, [label for label in labels if label not in closed])
    }
    versions = {label: {"simspec": simspec_version(), "engine_version": UNKNOWN_VERSIONS} for label in closed}
    for label in labels:
        if label in closed:
            continue
        entry = known[label]
        if entry.version is None or entry.problem is not None:
            raise EngineError(label, entry.problem or "not installed")
        versions[label] = {"simspec": simspec_version(), "engine_version": entry.version}
        if entry.numpy is not None:
            versions[label]["numpy_version"] = entry.numpy
    return versions
