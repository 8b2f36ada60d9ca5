"""One execution of one world in one engine: arrays, and where they came from."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit.registry import engine_name, find_engine
from simspec.engines.kit.settings import resolve_settings
from simspec.errors import Problem, SpecError, html_table
from simspec.language.strict import near
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.plugins import Method
from simspec.world.canonical import canonical_json, derived, to_plain
from simspec.world.kinematics import Coordinates, coordinates, initial_state, layout_of
from simspec.world.types import RecordOptions, World

if TYPE_CHECKING:
    import pandas as pd

    from simspec.runner.unphysical import Unphysical


SCHEMA = 3
"""Version of the provenance and of the files of a saved run. 2: columns of q, v, targets and efforts by name. 3: hashes."""


@dataclass(frozen=True)
class Run:
    """The result of an engine for a world.

    ``arrays``: step, time (s), q, v, pose, velocity, and as recorded energy (kinetic, potential; by the engine) and
    ``contact.*`` (ragged; ``contact.row`` says to which row each belongs; ``contact.shape`` is there where the engine reports
    shapes, see :mod:`simspec.runner.labels`) and, where joints are driven, ``control.target`` (q*) and ``control.effort`` (of
    the step before the row; columns: ``provenance["control"]["joints"]``); one row per recorded time, the initial state first;
    units and frames as in :mod:`simspec.engines.kit.contract`. Empty when the engine gave none. ``provenance``: the data needed
    to repeat it: hashes, versions, settings, accepted approximations, seconds. ``failed``: None, or why there is no (whole)
    result: a crash, a hang, a state that stopped being finite. ``seconds``: no result, as a repetition gives others: for each
    recorded row the wall and processor time (s) spent until then (rows, columns :data:`simspec.engines.kit.arrays.SECONDS`);
    None where the engine's program does not say.
    """

    world: World
    engine: str
    arrays: Mapping[str, np.ndarray] = field(repr=False)
    provenance: Mapping[str, Any] = field(repr=False)
    failed: str | None = None
    seconds: NDArray[np.float64] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        rows = f"{len(self.time)} records" if self.recorded else "nothing recorded"
        return f"<Run of {self.world.name!r} in {self.label}: {rows}{', failed' if self.failed is not None else ''}>"

    def _repr_html_(self) -> str:
        """For notebooks: the engine, the world, the simulated time and the speed."""
        rows: list[tuple[str, object]] = [("engine", self.label), ("bodies", len(self.world.bodies))]
        rows += [("timestep, s", f"{self.world.physics.timestep:g}"), ("steps", self.provenance.get("steps", "–"))]
        rows.append(("records", f"{len(self.time)}, to {self.time[-1]:.4g} s" if self.recorded else "none"))
        factors = {"real-time factor": self.real_time_factor, "CPU factor": self.cpu_factor}
        factors["end-to-end factor"] = self.end_to_end_factor
        rows += [(name, f"{value:.4g}") for name, value in factors.items() if value is not None]
        if self.failed is not None:
            rows.append(("failed", self.failed))
        return html_table(f"Run of {self.world.name}", (), rows)

    @property
    def time(self) -> np.ndarray:
        """The recorded times (rows,), s."""
        return self.arrays["time"]

    @property
    def recorded(self) -> bool:
        """Whether there are arrays to look at (also a run that failed on the way may have some)."""
        return bool(len(self.arrays.get("time", ())))

    @property
    def columns(self) -> Mapping[str, np.ndarray]:
        """All that is stored in tables: ``arrays``, and ``seconds`` where they were measured."""
        return self.arrays if self.seconds is None else {**self.arrays, "seconds": self.seconds}

    @cached_property
    def index(self) -> Mapping[str, int]:
        """The index of every body in the arrays, by its name."""
        return {body.name: k for k, body in enumerate(self.world.bodies)}

    @cached_property
    def unphysical(self) -> Unphysical:
        """Motions of the run that are impossible for a mechanism (:mod:`simspec.runner.unphysical`)."""
        from simspec.runner.unphysical import unphysical

        return unphysical(self)

    @cached_property
    def coordinates(self) -> Coordinates:
        """The names of the columns of q and v (:mod:`simspec.world.kinematics`)."""
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
        """The position q* (rows,) that was requested of a driven joint, by its name. Raises SpecError when there is none."""
        return self._driven("control.target", name)

    def effort(self, name: str) -> np.ndarray:
        """The effort (rows,) that a driven joint was given in the step before each row, by its name (N m, N; NaN where the
        engine's own controller drives it). Raises SpecError when there is none."""
        return self._driven("control.effort", name)

    def _column(self, array: str, columns: Mapping[str, slice], name: str) -> np.ndarray:
        if name not in columns:
            raise SpecError(
                [Problem(f"there is no coordinate {name!r}", found=name, hint=near(name, columns), code="R107")]
            )
        part = columns[name]
        values = self.arrays[array][:, part]
        return values[:, 0] if part.stop - part.start == 1 else values

    def _driven(self, array: str, name: str) -> np.ndarray:
        joints = list(self.provenance.get("control", {}).get("joints", ()))
        if name not in joints:
            raise SpecError(
                [Problem(f"no controller drives {name!r}", found=name, hint=near(name, joints), code="R107")]
            )
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

    diff = Method("simspec.comparison.runs:diff")
    show = Method("simspec.report.notebook:show_run")
    plot = Method("simspec.report.run_plots:plot_run")

    def save(self, folder: Path | str) -> Path:
        """Write the run as the whole content of ``folder``: Parquet tables, world.json, provenance.json."""
        from simspec.runner.store import save_run

        return save_run(self, Path(folder))

    def to_pandas(self, table: str = "bodies") -> pd.DataFrame:
        """A table of the run as a pandas data frame, with the columns of its Parquet file: ``bodies`` (a row for each time and
        body), ``states``, and as recorded ``contacts``, ``energy``, ``control`` and ``seconds``. Raises SpecError where that
        was not recorded, or pandas is not installed."""
        from simspec.runner.labels import labels_of
        from simspec.runner.tables import arrow_table

        if not self.recorded:
            raise SpecError([Problem(f"{self.label} recorded nothing: {self.failed}", code="R106")])
        try:
            import pandas
        except ImportError as error:
            hint = "pip install 'simspec-physics[pandas]'"
            raise SpecError([Problem("to_pandas needs pandas", found=str(error), hint=hint, code="C110")]) from None
        del pandas  # pyarrow imports it by itself
        return arrow_table(self.world, self.columns, labels_of(self.provenance), table).to_pandas()

    def _factor(self, name: str) -> float | None:
        seconds = self.provenance.get("seconds", {}).get(name)
        return factor(self.provenance.get("steps", 0), self.world.physics.timestep, seconds)


def factor(steps: int, timestep: float, seconds: float | None) -> float | None:
    """Simulated time over seconds spent; None where no step was done or no time was measured."""
    return steps * timestep / seconds if seconds and steps else None


# The unit that is run: one world in one engine, with what is changed for this run alone.

KEY_SCHEMA = 1
"""Version of what a key is made of."""


@derived
def shared_world(world: World) -> World:
    """The common part of the runs of several engines, settings and specs: the world without its name, its expectations and its
    options of engines."""
    return dataclasses.replace(world, name="", expectations=(), engines=())


@derived
def _shared_json(world: World) -> str:
    return canonical_json(shared_world(world))


@dataclass(frozen=True)
class Case:
    """A world in an engine, to be run, repeated and stored.

    ``engine`` is a label. ``settings`` replace solver settings of the spec, (name, value), for this engine. ``perturb`` moves
    the initial state by this relative change (see :func:`perturbed_state`), with ``seed`` in directions drawn from it.
    ``record`` replaces the world's own.
    """

    world: World
    engine: str
    settings: tuple[tuple[str, bool | int | float | str], ...] = ()
    perturb: float = 0.0
    seed: int | None = None
    record: RecordOptions | None = None

    def __repr__(self) -> str:
        changed = f", perturbed by {self.perturb:g}" if self.perturb else ""
        return f"<Case: {self.world.name!r} in {self.engine}{changed}>"

    @cached_property
    def resolved(self) -> World:
        """The world that is compiled: with the settings and the record of this case."""
        world = self.world
        if self.settings:
            local = world.options(engine_name(self.engine))
            settings = tuple(sorted({**dict(local.settings), **dict(self.settings)}.items()))
            others = tuple(options for options in world.engines if options.engine != local.engine)
            engines = (*others, dataclasses.replace(local, settings=settings))
            world = dataclasses.replace(world, engines=tuple(sorted(engines, key=lambda options: options.engine)))
        return world if self.record in (None, world.record) else dataclasses.replace(world, record=self.record)

    @property
    def initial_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v) at the beginning."""
        if not self.perturb:
            return initial_state(self.world)
        return perturbed_state(self.world, self.perturb, self.seed)

    def key(self, versions: Mapping[str, str]) -> str:
        """A hash that distinguishes this case from every other that would run differently (SHA-256).

        Left out is what no run depends on: the world's name, its expectations, and what the spec says to other engines.
        ``versions``: of all that is at work (simspec, the engine, numpy, …), by name.
        """
        world, name = self.resolved, engine_name(self.engine)
        options = world.options(name)
        pairs = {"pairs": to_plain(options.pairs)} if options.pairs else {}
        text = canonical_json(
            {
                "schema": KEY_SCHEMA,
                "engine": name,
                "settings": dict(sorted(resolve_settings(find_engine(name), world).items())),
                "accept": sorted(options.accept),
                "outside": sorted(options.outside),
                "perturb": self.perturb,
                "seed": self.seed if self.perturb else None,
                "versions": dict(sorted(versions.items())),
                **pairs,
            }
        )
        # the world's text is made once for all cases of it; its name comes last in the order of canonical JSON
        return hashlib.sha256(f'{text[:-1]},"world":{_shared_json(world)}}}'.encode()).hexdigest()


def perturbed_state(world: World, amount: float, seed: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The world's initial (q, v), moved by ``amount``, a relative change: for the noise floor, 1e-15.

    Every coordinate x becomes x (1 + amount), and a position of exactly zero becomes ``amount`` (it would otherwise stay
    as it is, and a pendulum let go from zero would look free of round-off). Of a quaternion the vector part is moved, and
    the whole made of unit length again. With a ``seed`` each coordinate has an amount of its own, drawn evenly from
    −amount to amount.
    """
    q, v = initial_state(world)
    dq, dv = np.full(len(q), amount), np.full(len(v), amount)
    if seed is not None:
        generator = np.random.default_rng(seed)
        dq, dv = generator.uniform(-amount, amount, len(q)), generator.uniform(-amount, amount, len(v))
    return moved_states(world, q, v, dq, dv)


def moved_states(
    world: World, q: np.ndarray, v: np.ndarray, dq: np.ndarray | float, dv: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """States q (..., nq), v (..., nv) moved by relative changes, in the way of :func:`perturbed_state`."""
    moved = np.where(q == 0.0, dq, q * (1.0 + dq))
    for body, part in zip(world.bodies, layout_of(world).position, strict=True):
        if body.joint.kind in QUATERNION_JOINTS:
            turn = slice(part.stop - 4, part.stop)
            moved[..., part.stop - 4] = q[..., part.stop - 4]
            moved[..., turn] /= np.linalg.norm(moved[..., turn], axis=-1, keepdims=True)
    return moved, v * (1.0 + dv)
