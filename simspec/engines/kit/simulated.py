"""What engines share whose work a simulation object of their own does: made when artifacts are loaded, dropped when closed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from simspec.engines.kit.arrays import restore_velocities
from simspec.engines.kit.beside import enter
from simspec.engines.kit.contract import Engine


class Simulated(Protocol):
    """A loaded world, in the engine's own terms; what it returns is as :class:`Engine` says."""

    offsets: np.ndarray
    """(bodies, 3): where the file's frame of each body stands in the world's."""

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None: ...

    def get_state(self) -> tuple[np.ndarray, np.ndarray]: ...

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (bodies, 7) and velocities (bodies, 6) of the *file's* body frames."""
        ...

    def disable_contact(self) -> None: ...

    def messages(self) -> list[str]: ...

    def close(self) -> None: ...


S = TypeVar("S", bound=Simulated)


class SimulatedEngine(Engine, Generic[S], abstract=True):
    """An engine that passes on to its simulation what needs nothing else."""

    def __init__(self) -> None:
        self._sim: S | None = None

    @property
    def _simulation(self) -> S:
        if self._sim is None:
            raise RuntimeError("load first")
        return self._sim

    def _make(self, folder: Path, sidecar: Mapping[str, Any]) -> S:
        """The simulation of the artifacts, in the world's initial state. Raises EngineError when the engine refuses a file."""
        raise NotImplementedError

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        self.close()
        enter(type(self))
        self._sim = self._make(folder, sidecar)

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        self._simulation.set_state(q, v)

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        return self._simulation.get_state()

    def body_states(self) -> tuple[np.ndarray, np.ndarray]:
        sim = self._simulation
        return restore_velocities(*sim.file_frames(), sim.offsets)

    def disable_contact(self) -> None:
        self._simulation.disable_contact()

    def log(self) -> list[str]:
        return self._simulation.messages()

    def close(self) -> None:
        sim, self._sim = self._sim, None
        if sim is not None:
            sim.close()
