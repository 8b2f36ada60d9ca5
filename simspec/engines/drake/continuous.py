"""Steps of a continuous plant by one of Drake's integrators, and the efforts at each of its stages."""

from __future__ import annotations

from typing import Any

import numpy as np

from simspec.engines.drake.building import DrakeBuild
from simspec.engines.drake.coordinates import DrakeCoordinates
from simspec.world.rotations import logarithm, multiply, rotate, unit


class ContinuousSteps:
    """Fixed steps of a continuous plant, from the time and state of a root context. Efforts of simspec and springs act at each
    stage in the axes that bodies have there: an effort constant in the world's axes would make every method first order."""

    def __init__(
        self,
        built: DrakeBuild,
        root: Any,
        coordinates: DrakeCoordinates,
        springs: tuple[np.ndarray, np.ndarray],
        scheme: str,
        timestep: float,
    ):
        """``springs``: stiffness and rest (nv,) of every coordinate of v."""
        self._coordinates, self._timestep = coordinates, timestep
        self._stiffness, self._rest = springs
        self._springs = bool(self._stiffness.any())
        analysis = built.drake.analysis
        built.efforts_at = self._efforts_at
        self._context = built.efforts.GetMyMutableContextFromRoot(root)
        self._port = built.efforts.get_input_port(1)
        self._port.FixValue(self._context, np.zeros(coordinates.nv))
        self._root = root
        self._simulator = analysis.Simulator(built.diagram, root)
        integrator = analysis.ResetIntegratorFromFlags(self._simulator, scheme, timestep)
        integrator.set_fixed_step_mode(True)
        self._simulator.Initialize()
        self._analysis, self.integrator = analysis, integrator

    def described(self) -> tuple[str, bool, float]:
        """The scheme, whether its steps are fixed, and their size (s), as Drake has them."""
        config = self._analysis.ExtractSimulatorConfig(self._simulator)
        return config.integration_scheme, self.integrator.get_fixed_step_mode(), self.integrator.get_maximum_step_size()

    def set_effort(self, effort: np.ndarray | None) -> None:
        """The effort (nv,) of the next steps, in simspec's coordinates; None: zero."""
        self._port.FixValue(self._context, np.zeros(self._coordinates.nv) if effort is None else np.asarray(effort))

    def step(self) -> None:
        """One step."""
        self._simulator.AdvanceTo(self._root.get_time() + self._timestep)

    def _efforts_at(self, x: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """The generalised forces, in Drake's coordinates, at a state of a stage."""
        if not self._springs and not effort.any():
            return np.zeros_like(effort)
        coordinates, total = self._coordinates, np.array(effort)
        places = coordinates.v
        total[places] -= self._stiffness[places] * (x[coordinates.drake_q] - self._rest[places])
        if not len(coordinates.ball):
            return coordinates.effort(x, total)
        swing, balls = coordinates.swing(x), coordinates.ball_v
        total[balls] -= self._stiffness[balls] * logarithm(unit(multiply(coordinates.turns, swing)))
        found = coordinates.effort(x, total)
        found[coordinates.ball_drake_v] = rotate(swing, total[balls])
        return found
