"""One engine under test: worlds go in, answers of its own process come out, and what it refuses it must have declared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simspec.compiler import Compiled, compile_world, needed_decisions, write_folder
from simspec.control.request import to_request
from simspec.dialects.kit.contract import dialects
from simspec.engines.kit.capabilities import DOUBLE, SINGLE
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Answer, Operation, call
from simspec.engines.kit.registry import find_engine
from simspec.errors import Problem, UnsupportedError
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.proof.certificate import EngineProof
from simspec.proof.checks import PRECISIONS
from simspec.proof.verify import LEVELS, verify
from simspec.support.declarations import Level, Support, combine
from simspec.support.features import Feature
from simspec.testing.worlds import accepting, with_options
from simspec.world.rotations import rotation_error
from simspec.world.types import World

OF_SINGLES = PRECISIONS[SINGLE].model
"""What numbers of single precision are compared to where doubles are to some last bits."""
OWN = (Level.EXACT, Level.VIA_API)
"""Levels of support for which a spec has to say nothing."""


@dataclass(frozen=True)
class Bench:
    """``engine`` by name or label, the interpreter it lives in (None: this one), and a folder for artifacts."""

    engine: str
    python: str | None
    place: Path

    @property
    def kind(self) -> type[Engine]:
        """The engine's class."""
        return find_engine(self.engine)

    def near(self, double: float, single: float = OF_SINGLES) -> float:
        """A tolerance by the numbers that the engine computes with."""
        return double if self.kind.PRECISION == DOUBLE else single

    def lacks(self, capability: str) -> str:
        """Why the engine lacks a capability (by name); "" where it has it."""
        return {str(name): why for name, why in self.kind.LACKS.items()}.get(capability, "")

    @property
    def support(self) -> Mapping[Feature, Support]:
        """What engine and dialect declare together."""
        return combine(dialects()[self.kind.DIALECT].SUPPORT, self.kind.SUPPORT)

    def refusals(self, world: World) -> tuple[Problem, ...]:
        """The features of ``world`` that the engine declares not to support, each as the problem that a user is told."""
        every = tuple(feature.value for feature in Feature)
        try:
            needed_decisions(
                with_options(world, self.kind.NAME, accept=every, outside=every), self.engine, pythons=self.pythons
            )
        except UnsupportedError as error:
            return error.problems
        return ()

    def allowed(self, world: World) -> World | None:
        """``world`` with everything accepted that the engine has approximately or outside; None where the engine declares that
        it does not support it, after compiling was seen to raise the error that says so.

        A refusal that is not declared is raised, as the failure that it is.
        """
        declared = self.refusals(world)
        if not declared:
            return accepting(world, self.kind.NAME)
        try:
            self.compiled(world)
        except UnsupportedError as error:
            messages = [problem.message for problem in error.problems]
            for problem in declared:
                assert problem.message in messages, f"no error says: {problem.message}"
            return None
        raise AssertionError(f"{self.engine} declares {declared[0].message!r}, and compiles the world")

    @property
    def pythons(self) -> dict[str, str]:
        """Its interpreter, where it is not this one, by the engine's label."""
        return {} if self.python is None else {self.engine: self.python}

    def compiled(self, world: World) -> Compiled:
        """The files of ``world``."""
        return compile_world(world, [self.engine], pythons=self.pythons)[self.engine]

    def artifacts(self, world: World) -> Path:
        """A new folder with the files of ``world``."""
        folder = self.place / str(len(list(self.place.iterdir())))
        write_folder(self.compiled(world).files, folder)
        return folder

    def ask(self, world: World, *operations: Operation) -> list[Answer]:
        """The answers of the engine's process, each operation with ``world`` loaded anew."""
        return call(self.engine, self.artifacts(world), operations, python=self.python).answers

    def run(self, world: World, steps: int, every: int | None = None, *channels: str) -> Answer:
        """A recorded run of ``world``, under its controllers: see :func:`run_operation`."""
        (answer,) = self.ask(world, run_operation(world, steps, every, *channels))
        return answer

    def drive(self, world: World, *phases: tuple[int, np.ndarray | None]) -> Mapping[str, np.ndarray]:
        """Motion with contact through phases of (steps, effort (nv,) or None): time, pose, velocity, one row at the start and
        one at the end of each phase."""
        (answer,) = self.ask(world, drive_operation(world, *phases))
        return answer.arrays

    def proof(self, world: World, *levels: str) -> EngineProof:
        """What is proven of ``world`` in the engine, of these levels (none: all)."""
        return verify(world, [self.engine], pythons=self.pythons, levels=levels or LEVELS).engines[self.engine]


def run_operation(world: World, steps: int, every: int | None = None, *channels: str) -> Operation:
    """A run of ``steps``, recorded every ``every`` (None: at the start and at the end), with ``channels`` recorded too."""
    parameters: dict[str, Any] = {"steps": steps, "every": every or max(steps, 1), "channels": list(channels)}
    asked, arrays = to_request(world)
    return Operation("run", {**parameters, **asked}, arrays, world)


def windows_operation(world: World, run: Answer, *channels: str) -> Operation:
    """Windows from every recorded row of ``run`` but the last to the one after it; see ``_windows`` in ``operations.py``."""
    step = np.asarray(run.arrays["step"], dtype=np.int64)
    (steps,) = set(np.diff(step).tolist())
    asked, arrays = to_request(world)
    states = {name: np.ascontiguousarray(run.arrays[name][:-1]) for name in ("q", "v")}
    parameters: dict[str, Any] = {"starts": step[:-1].tolist(), "steps": steps, "channels": list(channels)}
    return Operation("windows", {**parameters, **asked}, {**arrays, **states}, world)


def drive_operation(world: World, *phases: tuple[int, np.ndarray | None]) -> Operation:
    """See :meth:`Bench.drive`."""
    still = np.zeros(sum(len(body.joint.velocity) for body in world.bodies))
    efforts = np.array([still if effort is None else effort for _, effort in phases])
    parameters = {"timestep": world.physics.timestep, "phases": [[steps, steps] for steps, _ in phases]}
    return Operation("drive", parameters, {"effort": efforts}, world)


def motion_operation(
    world: World, q: np.ndarray, v: np.ndarray, effort: np.ndarray, steps: int, every: int
) -> Operation:
    """Contact-free motion from a state under a constant effort."""
    arrays = {"q": q, "v": v, "effort": effort, "rubbing": np.zeros(0, dtype=np.int64)}
    return Operation("motion", {"steps": steps, "every": every}, arrays, world)


def touching_operation(world: World, q: np.ndarray) -> Operation:
    """Which bodies touch in the states q (k, nq)."""
    nv = sum(len(body.joint.velocity) for body in world.bodies)
    return Operation("touching", {}, {"q": q, "v": np.zeros((1, nv))}, world)


def state_error(world: World, measured: np.ndarray, expected: np.ndarray) -> float:
    """The largest difference of coordinates; quaternions as rotations (rad)."""
    worst, at = 0.0, 0
    for body in world.bodies:
        size = len(body.joint.position)
        one, other = measured[at : at + size], expected[at : at + size]
        at += size
        if body.joint.kind in QUATERNION_JOINTS:
            worst = max(worst, float(rotation_error(one[-4:], other[-4:])))
            one, other = one[:-4], other[:-4]
        worst = max(worst, float(np.abs(one - other).max(initial=0.0)))
    return worst


def failures(checks: Sequence[Any]) -> list[Any]:
    """The checks that did not pass."""
    return [check for check in checks if not check.passed]
