"""A session: an engine stepped in this process, with the artifacts that it has loaded.

>>> engine = next(iter(simspec.known_engines()))
>>> with Session(engine, Path("generated/double-pendulum") / engine) as session:
...     session.step(1000)
...     poses, velocities = session.body_states()
...     session.reset()

States, shapes, units and frames are those of :class:`simspec.engines.kit.contract.Engine`, whose methods a session passes on.
It keeps account of what was done since the artifacts were loaded (:class:`Condition`), so that questions can share one load.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from simspec.control.reference import Servos
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.kit.arrays import CollisionUnit
from simspec.engines.kit.contract import Actuation, Engine
from simspec.world.types import ReadBack


class Condition(IntEnum):
    """The latest action on an engine since it was loaded; each includes those before it."""

    FRESH = 0
    """Nothing: it is as it was loaded."""
    QUERIED = 1
    """Questions only: it is in the initial state, and nothing of it was changed."""
    PLACED = 2
    """It was put into states and queried there; never stepped."""
    CHANGED = 3
    """It was stepped, or something of it was switched off or on."""


class Session:
    """An engine that holds the artifacts of one world, in the world's initial state after loading.

    ``engine`` is a name, a class, or whatever else makes an :class:`Engine` when it is called; ``artifacts`` is the folder of
    its compiled files, which ``reset`` loads again. Raises EngineError when the engine is not known or not installed, or
    refuses a file, FileNotFoundError where there is no sidecar, and ValueError for one that cannot be read.
    """

    def __init__(self, engine: str | Callable[[], Engine], artifacts: Path):
        self._make = _maker(engine)
        self.artifacts = artifacts
        self.sidecar: Mapping[str, Any] = read_sidecar(artifacts)
        self.load_seconds = 0.0
        """Wall time of the last loading."""
        self.condition = Condition.FRESH
        self._engine: Engine | None = None
        self.reset()

    # --- life ---------------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Return to the initial state, by loading the artifacts anew into another engine: memory of an engine would otherwise
        be an invisible difference."""
        self.close()
        started = time.perf_counter()
        engine = self._make()
        try:
            engine.load(self.artifacts, self.sidecar)
        except BaseException:
            # an error from closing a half-loaded engine must not hide why it could not be loaded
            with contextlib.suppress(Exception):
                engine.close()
            raise
        self._engine, self.condition = engine, Condition.FRESH
        self.load_seconds = time.perf_counter() - started

    def close(self) -> None:
        """Free what the engine holds; nothing can be queried after that, but ``reset`` loads again."""
        if self._engine is not None:
            engine, self._engine = self._engine, None
            engine.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with contextlib.suppress(*((Exception,) if error is not None else ())):
            self.close()

    @property
    def clean(self) -> bool:
        """Whether nothing was changed since loading."""
        return self.condition <= Condition.QUERIED

    @property
    def name(self) -> str:
        """The engine's name."""
        return self._at(self.condition).NAME

    def lend(self) -> Engine:
        """The live engine itself, to do anything with: the session counts as changed from now on."""
        return self._at(Condition.CHANGED)

    def _at(self, condition: Condition) -> Engine:
        """The live engine, with which is done what makes it ``condition``."""
        if self._engine is None:
            raise RuntimeError("the session is closed; reset() loads again")
        self.condition = max(self.condition, condition)
        return self._engine

    # --- questions ----------------------------------------------------------------------------------------------------

    def read_back(self) -> ReadBack:
        """The model as the engine holds it."""
        return self._at(Condition.QUERIED).read_back()

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """The state (q (nq,), v (nv,))."""
        return self._at(Condition.QUERIED).get_state()

    def body_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (bodies, 7) and velocities (bodies, 6) of the world's body frames."""
        return self._at(Condition.QUERIED).body_states()

    def frame_poses(self) -> np.ndarray | None:
        """Poses (frames, 7) of the world's named frames; None of engines that have none."""
        return self._at(Condition.QUERIED).frame_poses()

    def mass_blocks(self, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
        """The parts of the mass matrix at the present state, for places in v."""
        return self._at(Condition.QUERIED).mass_blocks(blocks)

    def mass_matrix(self) -> np.ndarray:
        """M (nv, nv) at the present state, armature included."""
        return self._at(Condition.QUERIED).mass_matrix()

    def bias_force(self) -> np.ndarray:
        """h (nv,) at the present state, in M v̇ + h = τ."""
        return self._at(Condition.QUERIED).bias_force()

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J)."""
        return self._at(Condition.QUERIED).energy()

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used, as arrays with ``CONTACT_FIELDS``."""
        return self._at(Condition.QUERIED).contacts()

    def collision_units(self) -> Sequence[CollisionUnit]:
        """The units of the engine's collision detection."""
        return self._at(Condition.QUERIED).collision_units()

    def detect_units(self) -> np.ndarray:
        """Pairs (n, 2) of indices into ``collision_units`` that touch at the present state."""
        return self._at(Condition.QUERIED).detect_units()

    def detect_contacts(self) -> np.ndarray:
        """Pairs (n, 2) of indices of bodies that touch at the present state."""
        return self._at(Condition.QUERIED).detect_contacts()

    def log(self) -> list[str]:
        """Warnings of the engine since loading."""
        return self._at(self.condition).log()

    # --- changes ------------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q (nq,), v (nv,))."""
        self._at(Condition.PLACED).set_state(q, v)

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into a state near the present one; contact points of earlier steps stay, where the engine keeps
        any."""
        self._at(Condition.CHANGED).move_to(q, v)

    def step(self, count: int = 1, effort: np.ndarray | None = None) -> None:
        """Advance ``count`` steps under a constant generalised effort (nv,) held over all of them (None = zero)."""
        self._at(Condition.CHANGED).step(count, effort)

    def ready(self) -> None:
        """Do what the first step would do once, so that steps can be timed without it."""
        self._at(Condition.QUERIED).ready()

    def actuate(self, q: np.ndarray, v: np.ndarray) -> Actuation:
        """Quick access to some hinges and slides, to read and drive them at every step."""
        return self._at(Condition.CHANGED).actuate(q, v)

    def track(
        self, q: np.ndarray, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ) -> Servos:
        """Let the engine's own controllers drive some hinges and slides, until ``reset``."""
        return self._at(Condition.CHANGED).track(q, v, stiffness, damping, limit)

    def set_timestep(self, timestep: float) -> None:
        """Step by another timestep (s), until ``reset``."""
        self._at(Condition.CHANGED).set_timestep(timestep)

    def disable_contact(self) -> None:
        """Switch all contact off, until ``reset``."""
        self._at(Condition.CHANGED).disable_contact()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """Take the dry friction of the joints at the places ``v`` (n,) away, until ``reset``; without any, nothing is done."""
        if len(v):
            self._at(Condition.CHANGED).disable_dry_friction(v)


def _maker(engine: str | Callable[[], Engine]) -> Callable[[], Engine]:
    if not isinstance(engine, str):
        return engine
    # the registry looks through all installed packages, which an engine's own process need not do
    from simspec.engines.kit.registry import find_engine

    return find_engine(engine)
