"""Running cases: each in a process of its own, one after the other, or several side by side where timing does not count."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from simspec.compiler import compile_world
from simspec.control.request import to_request
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.kit import process
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import DEADLINE, PROGRESS_FILE, Reply, Running, start
from simspec.engines.kit.registry import engine_name, find_engine, version_in
from simspec.engines.kit.request import Operation
from simspec.engines.kit.settings import resolve_settings
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, Problem, SpecError
from simspec.files import RECORDED_BYTES, parts, scratch_folder, zeros
from simspec.outputs.writing import Artifacts
from simspec.plugins import simspec_version
from simspec.runner.labels import GROUPS, contact_sides
from simspec.runner.run import SCHEMA, Case, Run
from simspec.world.canonical import sha256, to_plain
from simspec.world.types import RecordOptions, World


@contextlib.contextmanager
def compiled_folder(case: Case, artifacts: Path | None = None, python: str | None = None) -> Iterator[Path]:
    """The folder of a case's artifacts: the one given (checked to be of its world), or a temporary one.

    ``python``: the interpreter that has the engine, whose version counts for support.

    Raises UnsupportedError when the world cannot be compiled for the engine, SpecError when ``artifacts`` are not of it.
    """
    if artifacts is None:
        with scratch_folder(engine_name(case.engine)) as place:
            folder = place / "compiled"
            pythons = {} if python is None else {case.engine: python}
            compile_world(case.resolved, [case.engine], pythons=pythons)[case.engine].artifacts.write(folder)
            yield folder
        return
    try:
        compiled_of = read_sidecar(artifacts).get("world")
    except (OSError, ValueError) as error:
        raise SpecError([Problem(f"{artifacts} contains no readable artifacts: {error}", code="P103")]) from None
    if compiled_of != sha256(case.resolved):
        raise SpecError([Problem(f"{artifacts} was compiled from another world", hint="compile it again", code="P103")])
    yield artifacts


CHANNEL_NEEDS: Mapping[str, Capability] = {"energy": Capability.ENERGY, "contacts": Capability.CONTACTS}
"""The capability that a channel needs in addition to an engine's core."""


def unrecordable(channels: Iterable[str], engine: type[Engine]) -> dict[str, str]:
    """Those of ``channels`` that ``engine`` cannot give, with the reason that it declares."""
    return {
        channel: engine.LACKS[CHANNEL_NEEDS[channel]]
        for channel in channels
        if channel in CHANNEL_NEEDS and CHANNEL_NEEDS[channel] in engine.LACKS
    }


@contextlib.contextmanager
def start_case(
    case: Case,
    artifacts: Path,
    *,
    python: str | None = None,
    deadline: float = DEADLINE,
    source: Mapping[str, Any] | None = None,
    warm: WarmProcesses | None = None,
) -> Iterator[PendingRun]:
    """Start the engine's process of a case and give a handle to wait on, so that several may work side by side.

    ``source`` goes into the provenance as ``spec``; ``warm``: processes to fork from (``engines/kit/warm.py``).
    """
    world = case.resolved
    record, options = world.record, world.options(engine_name(case.engine))
    not_recorded = unrecordable(record.channels, find_engine(case.engine))
    channels = [channel for channel in record.channels if channel not in not_recorded]
    parameters = {"steps": world.physics.steps, "every": record.every_steps, "channels": channels}
    parameters["most"] = RECORDED_BYTES
    parameters["progress"] = {"file": PROGRESS_FILE, "every": 2.0 * process.LOOK_EVERY}
    control, arrays = to_request(world)
    parameters |= control
    if case.perturb:
        arrays["q"], arrays["v"] = case.initial_state
    started = datetime.now(UTC)
    operations = [Operation("run", parameters, arrays, world)]
    with start(case.engine, artifacts, operations, python=python, deadline=deadline, warm=warm) as running:
        facts = {
            "schema": SCHEMA,
            "simspec": simspec_version(),
            "started": started.isoformat(timespec="seconds"),
            "world_sha256": sha256(world),
            "artifacts_sha256": Artifacts.read(artifacts).sha256,
            "engine": case.engine,
            "settings": resolve_settings(find_engine(case.engine), world),
            **({"pair_settings": to_plain(options.pairs)} if options.pairs else {}),
            "accepted": list(options.accept),
            "outside": list(options.outside),
            "record": {"every_steps": record.every_steps, "channels": channels, "not_recorded": not_recorded},
            "perturb": case.perturb,
            "seed": case.seed,
            "spec": dict(source or {}),
        }
        yield PendingRun(case, running, facts)


@dataclass(frozen=True)
class PendingRun:
    """A run at work in its process."""

    case: Case
    running: Running
    facts: Mapping[str, Any]

    def wait(self, progress: Callable[[float], None] | None = None, doing: Callable[[str], None] | None = None) -> Run:
        """The run, when it has ended; ``progress``, ``doing``: as of :meth:`Running.wait`.

        Raises EngineError when the process crashed, hung or refused."""
        return _finish(self.case, self.facts, self.running.wait(progress, doing))


def _finish(case: Case, facts: Mapping[str, Any], reply: Reply) -> Run:
    world, answer = case.resolved, reply.answers[0]
    arrays = dict(answer.arrays)
    spent = arrays.pop("seconds", None)
    arrays["time"] = zeros(arrays["step"].shape)
    for part in parts(len(arrays["step"]), 16, arrays["step"], arrays["time"]):
        arrays["time"][part] = arrays["step"][part] * world.physics.timestep
    more: dict[str, Any] = {}
    if "contact.unit" in arrays:
        sides, groups = contact_sides(world, answer.result["contact_units"], arrays.pop("contact.unit"))
        arrays["contact.shape"], more[GROUPS] = sides, groups
    provenance = {
        **facts,
        **more,
        **reply.versions,
        "case": case.key({"simspec": facts["simspec"], **reply.versions}),
        "steps": answer.result["steps"],
        "seconds": {
            "step": answer.result["step_seconds"],
            "cpu": answer.result["cpu_seconds"],
            "control": answer.result["control_seconds"],
            "record": answer.result["record_seconds"],
            "load": answer.load_seconds,
            "run": answer.seconds,
            "process": reply.wall_seconds,
        },
        "usage": reply.usage,
        "warnings": answer.log,
    }
    if answer.result["control"] is not None:
        provenance["control"] = answer.result["control"]
    return Run(world, case.engine, arrays, provenance, _not_finite(world, answer.result["failed"]), spent)


PARTS = {
    "pose": (*"xyz", "qw", "qx", "qy", "qz"),
    "velocity": ("vx", "vy", "vz", "wx", "wy", "wz"),
    "energy": ("kinetic", "potential"),
}
"""Names of the numbers of a row of a channel."""


def _not_finite(world: World, failed: Mapping[str, Any] | None) -> str | None:
    """In words, what the recorder found to be no number: None, or the channel, whose it is, and when."""
    if failed is None:
        return None
    channel, place = failed["channel"], list(failed["place"])
    what = channel
    if channel in ("pose", "velocity") and len(place) == 2:
        what = f"{channel} of {world.bodies[place[0]].name} ({PARTS[channel][place[1]]})"
    elif channel == "energy" and len(place) == 1:
        what = f"{PARTS[channel][place[0]]} energy"
    elif place:
        what = f"{channel}[{', '.join(map(str, place))}]"
    step = failed["step"]
    return f"the state is not finite after step {step} ({step * world.physics.timestep:.6g} s): {what}"


def run(
    world: World,
    engine: str,
    *,
    artifacts: Path | None = None,
    python: str | None = None,
    deadline: float = DEADLINE,
    perturb: float = 0.0,
    record: RecordOptions | None = None,
    source: Mapping[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Run ``world`` in ``engine``, in a process of its own.

    world     a resolved world, from ``spec.resolve()``
    engine    its name: see ``simspec engines``
    artifacts the engine's folder, as ``simspec compile`` wrote it; compiled to a temporary folder when None
    python    interpreter of another environment that has numpy and the engine (perhaps in another version)
    deadline  seconds that the process may take
    perturb   relative change of the initial state, for the noise floor (1e-15)
    record    what to record, in place of the world's own ``record``
    source    where the world came from (file, hash, overrides): kept in the provenance as ``spec``
    progress  called about twice a second with the share of the steps that is done

    A state that stops being finite is the run's result (``Run.failed``). Raises EngineError when the engine is missing,
    crashes or hangs, and UnsupportedError when the world cannot be compiled for it.
    """
    case = Case(world, engine, perturb=perturb, record=record)
    return run_case(case, artifacts=artifacts, python=python, deadline=deadline, source=source, progress=progress)


def run_case(
    case: Case,
    *,
    artifacts: Path | None = None,
    python: str | None = None,
    deadline: float = DEADLINE,
    source: Mapping[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
    doing: Callable[[str], None] | None = None,
    warm: WarmProcesses | None = None,
) -> Run:
    """Run a case in a process of its own; arguments and errors as of :func:`run`, ``doing`` as of :meth:`Running.wait`,
    ``warm`` as of :func:`start_case`."""
    with (
        compiled_folder(case, artifacts, python) as folder,
        start_case(case, folder, python=python, deadline=deadline, source=source, warm=warm) as pending,
    ):
        return pending.wait(progress, doing)


def failed_run(world: World, engine: str, error: EngineError, python: str | None = None) -> Run:
    """The run of an engine that gave nothing: the error is its result. ``python``: the interpreter that has the engine, where
    it is another one; its version is that of the run, not the one installed here."""
    facts = {
        "schema": SCHEMA,
        "simspec": simspec_version(),
        "world_sha256": sha256(world),
        "engine": engine,
        "engine_version": _version(engine, python),
    }
    return Run(world, engine, {}, facts, str(error).removeprefix(f"{engine}: "))


def _version(engine: str, python: str | None) -> str:
    if python is None:
        return find_engine(engine).version() or "not installed"
    try:
        return version_in(python, engine)
    except EngineError:
        return "unknown"


def run_all(
    world: World,
    engines: Iterable[str],
    *,
    artifacts: Mapping[str, Path] | None = None,
    pythons: Mapping[str, str] | None = None,
    deadline: float = DEADLINE,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Run]:
    """Run ``world`` in each engine, one after the other (so that their timings do not disturb each other).

    An engine that is missing, crashes, or hangs has that as its result (``Run.failed``); the others go on.
    """
    runs: dict[str, Run] = {}
    for engine in engines:
        if progress is not None:
            progress(engine)
        try:
            runs[engine] = run(
                world,
                engine,
                artifacts=(artifacts or {}).get(engine),
                python=(pythons or {}).get(engine),
                deadline=deadline,
            )
        except EngineError as error:
            runs[engine] = failed_run(world, engine, error, (pythons or {}).get(engine))
    return runs


def run_jobs(
    jobs: Sequence[tuple[Case, Path]],
    *,
    pythons: Mapping[str, str] | None = None,
    deadline: float = DEADLINE,
    at_once: int = 2,
    warm: WarmProcesses | None = None,
) -> list[Run]:
    """Run several cases with their artifacts, ``at_once`` side by side: for repeats, whose timing does not count. Engines that
    fail give failed runs; the order is that of ``jobs``. ``warm``: processes to fork from."""
    runs: list[Run] = []
    for first in range(0, len(jobs), at_once):
        with contextlib.ExitStack() as stack:
            pending: list[PendingRun | Run] = []
            for case, folder in jobs[first : first + at_once]:
                python = (pythons or {}).get(case.engine)
                try:
                    begun = start_case(case, folder, python=python, deadline=deadline, warm=warm)
                    pending.append(stack.enter_context(begun))
                except EngineError as error:
                    pending.append(failed_run(case.resolved, case.engine, error, python))
            runs.extend(_wait(started, pythons or {}) for started in pending)
    return runs


def _wait(pending: PendingRun | Run, pythons: Mapping[str, str]) -> Run:
    if isinstance(pending, Run):
        return pending
    try:
        return pending.wait()
    except EngineError as error:
        case = pending.case
        return failed_run(case.resolved, case.engine, error, pythons.get(case.engine))
