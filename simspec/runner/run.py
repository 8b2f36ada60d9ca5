"""One execution of one world in one engine: arrays, and where they came from."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from simspec.artifacts import Artifacts
from simspec.compiler import compile_world, write_folder
from simspec.control.request import to_request
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.kit import process
from simspec.engines.kit.answers import RECORDED_BYTES, Operation
from simspec.engines.kit.identity import engine_name
from simspec.engines.kit.process import DEADLINE, PROGRESS_FILE, Reply, Running, start
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import resolve_settings
from simspec.errors import EngineError, Problem, SpecError
from simspec.language.strict import near
from simspec.mapped import parts, zeros
from simspec.scratch import scratch_folder
from simspec.world.canonical import sha256
from simspec.world.coordinates import Coordinates, coordinates
from simspec.world.kinematics import initial_state, layout_of
from simspec.world.types import Record, World

SCHEMA = 3
"""Version of the provenance and of the files of a saved run. 2: columns of q, v, targets and efforts by name. 3: hashes."""


@dataclass(frozen=True)
class Run:
    """What one engine made of one world.

    ``arrays``: step, time (s), q, v, pose, velocity, and as recorded energy (kinetic, potential; by the engine) and
    ``contact.*`` (ragged; ``contact.row`` says to which row each belongs) and, where joints are driven, ``control.target``
    (q*) and ``control.effort`` (of the step before the row; columns: ``provenance["control"]["joints"]``); one row per recorded
    time, the initial state first; units and frames as in :mod:`simspec.engines.kit.contract`. Empty when the engine gave none.
    ``provenance``: what is needed to do it again: hashes, versions, settings, accepted approximations, seconds.
    ``failed``: None, or why there is no (whole) result: a crash, a hang, a state that stopped being finite.
    """

    world: World
    engine: str
    arrays: Mapping[str, np.ndarray] = field(repr=False)
    provenance: Mapping[str, Any] = field(repr=False)
    failed: str | None = None

    def __repr__(self) -> str:
        rows = f"{len(self.time)} records" if self.recorded else "nothing recorded"
        return f"<Run of {self.world.name!r} in {self.label}: {rows}{', failed' if self.failed is not None else ''}>"

    @property
    def time(self) -> np.ndarray:
        """The recorded times (rows,), s."""
        return self.arrays["time"]

    @property
    def recorded(self) -> bool:
        """Whether there are arrays to look at (also a run that failed on the way may have some)."""
        return bool(len(self.arrays.get("time", ())))

    @cached_property
    def index(self) -> Mapping[str, int]:
        """The index of every body in the arrays, by its name."""
        return {body.name: k for k, body in enumerate(self.world.bodies)}

    @cached_property
    def coordinates(self) -> Coordinates:
        """The names of the columns of q and v (:mod:`simspec.world.coordinates`)."""
        return coordinates(self.world)

    def q(self, name: str) -> np.ndarray:
        """The recorded positions of a joint or of one coordinate, by name: (rows,) for a hinge, a slide, or one column
        (``elbow``, ``base.x``); (rows, 4) for a ball joint, (rows, 7) for a free body. Raises SpecError when there is none."""
        return self._column("q", self.coordinates.q_columns, name)

    def v(self, name: str) -> np.ndarray:
        """The recorded velocities by name: (rows,) for a hinge, a slide, or one column (``elbow``, ``base.wx``); (rows, 3) for
        a ball joint, (rows, 6) for a free body. Raises SpecError when there is none."""
        return self._column("v", self.coordinates.v_columns, name)

    def target(self, name: str) -> np.ndarray:
        """The position q* (rows,) that a driven joint was asked for, by its name. Raises SpecError when there is none."""
        return self._driven("control.target", name)

    def effort(self, name: str) -> np.ndarray:
        """The effort (rows,) that a driven joint was given in the step before each row, by its name (N m, N; NaN where the
        engine's own controller drives it). Raises SpecError when there is none."""
        return self._driven("control.effort", name)

    def _column(self, array: str, columns: Mapping[str, slice], name: str) -> np.ndarray:
        if name not in columns:
            raise SpecError([Problem(f"there is no coordinate {name!r}", found=name, hint=near(name, columns))])
        part = columns[name]
        values = self.arrays[array][:, part]
        return values[:, 0] if part.stop - part.start == 1 else values

    def _driven(self, array: str, name: str) -> np.ndarray:
        joints = list(self.provenance.get("control", {}).get("joints", ()))
        if name not in joints:
            raise SpecError([Problem(f"no controller drives {name!r}", found=name, hint=near(name, joints))])
        return self.arrays[array][:, joints.index(name)]

    @property
    def label(self) -> str:
        """Engine and version, as tables show it."""
        return f"{self.engine} {self.provenance.get('engine_version', '')}".strip()

    @property
    def real_time_factor(self) -> float | None:
        """Simulated time over the sum of the step calls' wall time (Körber et al. 2021); None without a result."""
        return self._factor("step")

    @property
    def cpu_factor(self) -> float | None:
        """Simulated time over the step calls' processor time (all threads)."""
        return self._factor("cpu")

    @property
    def end_to_end_factor(self) -> float | None:
        """Simulated time over the wall time of the engine's whole process: start, load, step, record, hand over."""
        return self._factor("process")

    def save(self, folder: Path | str) -> Path:
        """Write the run as the whole content of ``folder``: Parquet tables, world.json, provenance.json."""
        from simspec.runner.store import save_run

        return save_run(self, Path(folder))

    def _factor(self, name: str) -> float | None:
        seconds = self.provenance.get("seconds", {}).get(name)
        steps = self.provenance.get("steps", 0)
        return steps * self.world.physics.timestep / seconds if seconds and steps else None


def perturbed_state(world: World, amount: float) -> tuple[np.ndarray, np.ndarray]:
    """The world's initial (q, v), moved by ``amount``, a relative change: for the noise floor, 1e-15.

    Every coordinate x becomes x (1 + amount), and a position of exactly zero becomes ``amount`` (it would otherwise stay
    as it is, and a pendulum let go from zero would look free of round-off). Of a quaternion the vector part is moved, and
    the whole made of unit length again.
    """
    q, v = initial_state(world)
    moved = np.where(q == 0.0, amount, q * (1.0 + amount))
    for body, part in zip(world.bodies, layout_of(world).position, strict=True):
        if body.joint.kind in ("ball", "free"):
            turn = slice(part.stop - 4, part.stop)
            moved[part.stop - 4] = q[part.stop - 4]
            moved[turn] /= np.linalg.norm(moved[turn])
    return moved, v * (1.0 + amount)


@contextlib.contextmanager
def compiled_folder(world: World, engine: str, artifacts: Path | None = None) -> Iterator[Path]:
    """The folder of the engine's artifacts: the one given (checked to be of this world), or a temporary one.

    Raises UnsupportedError when the world cannot be compiled for the engine, SpecError when ``artifacts`` are not of it.
    """
    if artifacts is None:
        with scratch_folder(engine) as place:
            folder = place / engine
            write_folder(compile_world(world, [engine])[engine].files, folder)
            yield folder
        return
    try:
        found = read_sidecar(artifacts).get("world")
    except (OSError, ValueError) as error:
        raise SpecError([Problem(f"{artifacts} holds no readable artifacts: {error}")]) from None
    if found != sha256(world):
        raise SpecError([Problem(f"{artifacts} was compiled from another world", hint="compile it again")])
    yield artifacts


@contextlib.contextmanager
def start_run(
    world: World,
    engine: str,
    artifacts: Path,
    *,
    python: str | None = None,
    deadline: float = DEADLINE,
    perturb: float = 0.0,
    record: Record | None = None,
    source: Mapping[str, Any] | None = None,
) -> Iterator[PendingRun]:
    """Start one engine process and give a handle to wait on, so that several may work side by side.

    ``record`` replaces the world's own; ``perturb`` moves the initial state (see :func:`perturbed_state`); ``source`` goes
    into the provenance as ``spec``.
    """
    record = record or world.record
    parameters = {"steps": world.physics.steps, "every": record.every_steps, "channels": list(record.channels)}
    parameters["most"] = RECORDED_BYTES
    parameters["progress"] = {"file": PROGRESS_FILE, "every": 2.0 * process.LOOK_EVERY}
    asked, arrays = to_request(world)
    parameters |= asked
    if perturb:
        arrays["q"], arrays["v"] = perturbed_state(world, perturb)
    started = datetime.now(UTC)
    with start(
        engine, artifacts, [Operation("run", parameters, arrays, world)], python=python, deadline=deadline
    ) as running:
        facts = {
            "schema": SCHEMA,
            "simspec": version("simspec"),
            "started": started.isoformat(timespec="seconds"),
            "world_sha256": sha256(world),
            "artifacts_sha256": Artifacts.read(artifacts).sha256,
            "engine": engine,
            "settings": resolve_settings(find_engine(engine), world),
            "accepted": list(world.options(engine_name(engine)).accept),
            "outside": list(world.options(engine_name(engine)).outside),
            "record": {"every_steps": record.every_steps, "channels": list(record.channels)},
            "perturb": perturb,
            "spec": dict(source or {}),
        }
        yield PendingRun(world, engine, running, facts)


@dataclass(frozen=True)
class PendingRun:
    """A run at work in its process."""

    world: World
    engine: str
    running: Running
    facts: Mapping[str, Any]

    def wait(self, progress: Callable[[float], None] | None = None) -> Run:
        """The run, when it has ended; ``progress`` is told the share that is done. Raises EngineError when the process crashed,
        hung or refused."""
        reply = self.running.wait(progress)
        return _finish(self.world, self.engine, self.facts, reply)


def _finish(world: World, engine: str, facts: Mapping[str, Any], reply: Reply) -> Run:
    answer = reply.answers[0]
    arrays = dict(answer.arrays)
    arrays["time"] = zeros(arrays["step"].shape)
    for part in parts(len(arrays["step"]), 16, arrays["step"], arrays["time"]):
        arrays["time"][part] = arrays["step"][part] * world.physics.timestep
    provenance = {
        **facts,
        **reply.versions,
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
        "warnings": answer.log,
    }
    if answer.result["control"] is not None:
        provenance["control"] = answer.result["control"]
    return Run(world, engine, arrays, provenance, _not_finite(world, answer.result["failed"]))


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
    record: Record | None = None,
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
    with (
        compiled_folder(world, engine, artifacts) as folder,
        start_run(
            world, engine, folder, python=python, deadline=deadline, perturb=perturb, record=record, source=source
        ) as pending,
    ):
        return pending.wait(progress)


def failed_run(world: World, engine: str, error: EngineError) -> Run:
    """The run of an engine that gave nothing: the error is its result."""
    facts = {
        "schema": SCHEMA,
        "simspec": version("simspec"),
        "world_sha256": sha256(world),
        "engine": engine,
        "engine_version": find_engine(engine).version() or "not installed",
    }
    return Run(world, engine, {}, facts, str(error).removeprefix(f"{engine}: "))


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
    found: dict[str, Run] = {}
    for engine in engines:
        if progress is not None:
            progress(engine)
        try:
            found[engine] = run(
                world,
                engine,
                artifacts=(artifacts or {}).get(engine),
                python=(pythons or {}).get(engine),
                deadline=deadline,
            )
        except EngineError as error:
            found[engine] = failed_run(world, engine, error)
    return found


def run_jobs(
    jobs: Sequence[tuple[str, Path, float]],
    world: World,
    *,
    pythons: Mapping[str, str] | None = None,
    deadline: float = DEADLINE,
    at_once: int = 2,
    progress: Callable[[str], None] | None = None,
) -> list[Run]:
    """Run several (engine, artifacts, perturb) of one world, ``at_once`` side by side: for repeats, whose timing does
    not count. Engines that fail give failed runs; the order is that of ``jobs``."""
    found: list[Run] = []
    for first in range(0, len(jobs), at_once):
        with contextlib.ExitStack() as stack:
            pending: list[PendingRun | Run] = []
            for engine, folder, perturb in jobs[first : first + at_once]:
                if progress is not None:
                    progress(engine)
                try:
                    pending.append(
                        stack.enter_context(
                            start_run(
                                world,
                                engine,
                                folder,
                                python=(pythons or {}).get(engine),
                                deadline=deadline,
                                perturb=perturb,
                            )
                        )
                    )
                except EngineError as error:
                    pending.append(failed_run(world, engine, error))
            found.extend(_wait(one) for one in pending)
    return found


def _wait(one: PendingRun | Run) -> Run:
    if isinstance(one, Run):
        return one
    try:
        return one.wait()
    except EngineError as error:
        return failed_run(one.world, one.engine, error)
