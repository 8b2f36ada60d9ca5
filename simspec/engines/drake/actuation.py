"""Drake's own PD controllers, which its actuators have: SAP solves for them in each step, with contact and limits."""

from __future__ import annotations

import numpy as np

from simspec.control.native import natives
from simspec.engines.drake.choice import asked_approximation
from simspec.engines.drake.simulation import Simulation
from simspec.errors import EngineError
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world.types import World

NATIVE = (
    "PD controllers of Drake's actuators, by SAP, implicit in time: clip(kp (q* − q − dt v') + kd (v* − v')) with the velocity "
    "v' after the step, to SAP's tolerance (3.5e-8 rad of a wheel of 0.02 kg m²; one at its effort limit loses up to 1e-6 of "
    "its momentum in each step; measured). The targets are those of the beginning of a step, so that it follows dt v* "
    "behind them. Drake weakens gains of which "
    "dt kd + dt² kp is above 3900 times the inertia, which take more than 99.97 % of the error back in a step"
)


def pd_controllers_hold(world: World) -> Refinement | None:
    """Not supported by TAMSI, nor with an effort limit of zero."""
    if asked_approximation(world) != "sap":
        return unsupported_if(
            "Drake's PD controllers work by SAP alone, and the spec asks for contact_approximation: tamsi"
        )
    for controller in natives(world):
        for joint, limit in zip(controller.joints, controller.effort_limits, strict=True):
            if limit == 0.0:
                return unsupported_if(f"Drake's actuators have an effort limit above zero, and that of {joint!r} is 0")
    return None


class JointServos:
    """Drake's PD controllers of the hinges and slides at the places ``v`` (n,). They act once their desired state is given."""

    def __init__(self, sim: Simulation, v: np.ndarray):
        plant, self._context = sim.plant, sim.context
        self._port = plant.get_desired_state_input_port(sim.built.drake.tree.default_model_instance())
        body_at = {int(place.start): index for index, place in enumerate(sim.coordinates.v_places)}
        places = []
        for dof in v.tolist():
            joint = sim.built.joints[body_at[dof]]
            servo = sim.servos.get(int(joint.index()))
            if servo is None:
                raise EngineError("drake", f"holds no controller of joint {joint.name()!r}")
            places.append(servo.input_start())
        self._places = np.array(places, dtype=np.intp)
        # first the positions, then the velocities of all actuators; those without a controller take none
        self._desired = np.zeros((2, plant.num_actuators()))

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._desired[:, self._places] = position, velocity
        self._port.FixValue(self._context, self._desired.ravel())
