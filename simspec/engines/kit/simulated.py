"""The common part of engines that work by a simulation object: made when artifacts are loaded, dropped when closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from simspec.dialects.kit.joints import Passive
from simspec.engines.kit.arrays import pick_blocks, restore_velocities
from simspec.engines.kit.contract import Engine, enter
from simspec.engines.kit.efforts import BeforeSteps
from simspec.world.actions import JointSum
from simspec.world.types import Constraint, ReadBack


class Simulated(Protocol):
    """A loaded world, in the engine's own terms; its results are as :class:`Engine` says."""

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


# The common part of engines that receive efforts before each of their steps, for features that they do not have.


class Given(Simulated, Protocol):
    """A loaded world that is stepped under an effort. The members below are the engine's, without these efforts."""

    @property
    def passive(self) -> Passive | None:
        """The forces that act at all times and that it is given."""
        ...

    @property
    def constraints(self) -> Sequence[Constraint]:
        """The constraints whose forces it is given."""
        ...

    @property
    def sums(self) -> Sequence[JointSum]:
        """The springs and dampers along sums of positions that it is given."""
        ...

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero."""
        ...


class Stepped(Given, Protocol):
    """The same of an engine that reports masses, forces of inertia and energies."""

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The parts of M at the present state, armature included, each with its places in v: the entries between them are
        zero."""
        ...

    def bias(self) -> np.ndarray:
        """h (nv,) at the present state, in M v̇ + h = τ."""
        ...

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J)."""
        ...


G = TypeVar("G", bound=Given)
T = TypeVar("T", bound=Stepped)


class GivenEngine(SimulatedEngine[G], Generic[G], abstract=True):
    """An engine whose simulation is given, before every step, the forces that it does not have (:class:`BeforeSteps`)."""

    def __init__(self) -> None:
        super().__init__()
        self._before: BeforeSteps | None = None

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        self._before = None
        super().load(folder, sidecar)
        simulation = self._simulation
        before = BeforeSteps(self, simulation.passive, simulation.constraints, simulation.sums)
        self._before = before if before.needed else None

    def _read_model(self) -> ReadBack:
        """The engine's model, with its inventory and its neutral values."""
        raise NotImplementedError

    def read_back(self) -> ReadBack:
        back = self._read_model()
        return back if self._before is None else self._before.completed(back)

    def step(self, count: int, effort: np.ndarray | None = None) -> None:
        if self._before is None:
            self._simulation.advance(count, effort)
            return
        for _ in range(count):
            self._simulation.advance(1, self._before.effort(effort))


class SteppedEngine(GivenEngine[T], Generic[T], abstract=True):
    """The same of an engine that reports masses, forces of inertia and energies."""

    def mass_blocks(self, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
        return pick_blocks(blocks, self._simulation.mass_parts())

    def bias_force(self) -> np.ndarray:
        bias = self._simulation.bias()
        return bias if self._before is None else self._before.bias_force(bias)

    def energy(self) -> tuple[float, float]:
        kinetic, potential = self._simulation.energy()
        return kinetic, potential + (0.0 if self._before is None else self._before.potential())
