"""A world in Drake, in its initial state: stepping, efforts, contact."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.dialects.kit.world import WorldSidecar
from simspec.engines.drake.approximations import requested_approximation
from simspec.engines.drake.building import NAME, DrakeBuild, is_servo, warnings_into
from simspec.engines.drake.continuous import ContinuousSteps
from simspec.engines.drake.coordinates import DrakeCoordinates
from simspec.engines.drake.integrators import scheme
from simspec.engines.kit.arrays import empty_contacts
from simspec.engines.kit.building import Walk
from simspec.engines.kit.refinements import some_effort
from simspec.engines.kit.world_simulation import WorldSimulation, contact_table, unit_responses
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, BallJoint, initial_coordinates
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world.rotations import logarithm, unit
from simspec.world.types import World

UNSOLVED = "failed to converge"
"""Part of Drake's message for a step of which a contact solver finds no solution."""
WHOLE = 600
"""Velocities up to which the mass matrix is computed whole."""


class DrakeSimulation(WorldSimulation[WorldSidecar]):
    """A loaded world."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        super().__init__(NAME, WorldSidecar, folder, sidecar)
        self.log: list[str] = []
        self._touches = True
        self._build(self.document.timestep)
        self.set_state(*map(np.array, initial_coordinates(self.document)))

    def _build(self, timestep: float) -> None:
        """Build the plant for steps of a length (s)."""
        with warnings_into(self.log):
            try:
                self.built = DrakeBuild(Walk.of(self.document), self.settings, timestep)
            except KeyError as error:
                raise EngineError(NAME, f"the sidecar's settings lack, or have a wrong, {error}") from error
            self.root = self.built.diagram.CreateDefaultContext()
        self.plant = self.built.plant
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.coordinates = DrakeCoordinates(self.built, self.q_places, self.v_places)
        self._losses()
        self.continuous: ContinuousSteps | None = None
        if self.built.continuous:
            springs, name = (self.stiffness, self.rest), scheme(self.settings)
            self.continuous = ContinuousSteps(self.built, self.root, self.coordinates, springs, name, timestep)
        else:
            self._port = self.plant.get_applied_generalized_force_input_port()
            self._push(np.zeros(self.nv))
        self._pushed = False
        self._index()
        self.shape_of = {geometry.id: geometry.unit.of.number for geometry in self.built.geometries}
        self._contacts = self.plant.get_contact_results_output_port() if self.built.geometries else None
        self._results: Any = None

    @property
    def timestep(self) -> float:
        """The length of a step (s), as Drake has it."""
        return float(self.built.plant.time_step()) if self.continuous is None else self.continuous.described()[2]

    def set_timestep(self, timestep: float) -> None:
        """Step by another timestep: Drake's plants have one for good, so that the plant is built anew."""
        q, v = self.get_state()
        self._build(timestep)
        self.set_state(q, v)
        if not self._touches:
            self.disable_contact()

    def _index(self) -> None:
        """Drake's joints by the index of their child, and its actuators by the index of their joint, queried once."""
        plant = self.plant
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        self.inboard = {int(joint.child_body().index()): joint for joint in joints}
        actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
        self.actuators: dict[int, Any] = {}
        self.servos: dict[int, Any] = {}
        for actuator in actuators:
            by_joint = self.servos if is_servo(actuator) else self.actuators
            by_joint[int(actuator.joint().index())] = actuator

    def _losses(self) -> None:
        """Damping by simspec, springs and their rest, of every coordinate of v; of a ball the same for all three."""
        self.damping, self.stiffness, self.rest = np.zeros((3, self.nv))
        for body, at in zip(self.document.bodies, self.v_places, strict=True):
            joint = body.joint
            if isinstance(joint, (AxisJoint, BallJoint)):
                self.damping[at] = 0.0 if self.built.native else joint.damping
                self.stiffness[at] = joint.spring_stiffness
            if isinstance(joint, AxisJoint):
                self.rest[at] = joint.spring_rest
        self._losses_in_drake = self.coordinates.straight(self.damping, self.stiffness, self.rest)
        self._losing = bool(self.damping.any() or self.stiffness.any())

    # --- state ------------------------------------------------------------------------------------------------

    @property
    def x(self) -> np.ndarray:
        """Drake's state."""
        if self.continuous is not None:
            return np.array(self.plant.GetPositionsAndVelocities(self.context))
        return np.array(self.context.get_discrete_state_vector().value())

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v)."""
        x = self.coordinates.drake_state(np.asarray(q, dtype=float), np.asarray(v, dtype=float))
        self._write(x)
        self._results = None

    def _write(self, x: np.ndarray) -> None:
        """Put Drake's state and the rotations of the balls into the context."""
        if self.continuous is not None:
            self.plant.SetPositionsAndVelocities(self.context, x)
        else:
            self.context.SetDiscreteState(x)
        self.coordinates.write_turns(self.context)

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v)."""
        return self.coordinates.state(self.x)

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them."""
        count = len(self.built.bodies)
        poses, velocities = np.zeros((count, 7)), np.zeros((count, 6))
        free = self.coordinates.free
        x, start = self.x, self.coordinates.positions
        if len(free):
            place, motion = x[self.coordinates.free_drake_q], x[start:][self.coordinates.free_drake_v]
            poses[free] = np.concatenate([place[:, 4:], place[:, :4]], axis=1)
            velocities[free] = np.concatenate([motion[:, 3:], motion[:, :3]], axis=1)
        for index in sorted(set(range(count)) - set(free.tolist())):
            body = self.built.bodies[index]
            place, motion = body.EvalPoseInWorld(self.context), body.EvalSpatialVelocityInWorld(self.context)
            poses[index, :3], poses[index, 3:] = place.translation(), place.rotation().ToQuaternion().wxyz()
            velocities[index, :3], velocities[index, 3:] = motion.translational(), motion.rotational()
        poses[poses[:, 3] < 0.0, 3:] *= -1.0
        return poses, velocities

    # --- steps ------------------------------------------------------------------------------------------------

    def _push(self, effort: np.ndarray) -> None:
        """Apply an effort, in Drake's coordinates."""
        self._port.FixValue(self.context, effort)

    def _stretch(self, x: np.ndarray) -> np.ndarray:
        """q − rest of hinges, slides and balls (of these log R), in Drake's coordinates of v; zero of free bodies."""
        coordinates = self.coordinates
        stretch = np.zeros(self.nv)
        stretch[coordinates.drake_v] = x[coordinates.drake_q]
        if len(coordinates.ball):
            stretch[coordinates.ball_drake_v] = logarithm(unit(coordinates.turns))
        stretch -= self._losses_in_drake[2]
        return stretch

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the damping and springs of the joints.

        The loop is as short as the world allows: work common to all steps is done before it.
        """
        if self.continuous is not None:
            self._advance_continuous(self.continuous, count, effort)
            return
        coordinates, context = self.coordinates, self.context
        evaluate, set_state = self.plant.EvalUniquePeriodicDiscreteUpdate, context.SetDiscreteState
        moves = bool(len(coordinates.free) or len(coordinates.ball))
        # A free body's moment is in its own axes, which turn with it
        varies = self._losing or (effort is not None and bool(effort[coordinates.free_v[:, 3:]].any()))
        x = self.x if moves or varies or effort is not None else np.empty(0)
        native, timestep = self.built.native, self.timestep
        if not varies and (effort is not None or self._pushed):
            self._push(np.zeros(self.nv) if effort is None else coordinates.effort(x, effort))
        self._pushed = varies or effort is not None
        try:
            for left in range(count - 1, -1, -1):
                if varies:
                    self._push(self._effort_at(x, effort))
                after = evaluate(context).get_vector(0).value()
                if not left and self._contacts is not None:
                    # A copy, since Drake writes over its own. Evaluated at a later state, the step would be solved again
                    self._results = copy.copy(self._contacts.Eval(context))
                if moves or varies:
                    x = after = coordinates.settled(after) if native else coordinates.turned(x, after, timestep)
                set_state(after)
                if len(coordinates.ball):
                    coordinates.write_turns(context)
        except RuntimeError as error:
            raise EngineError(NAME, f"a step failed: {self._explained(error)}") from error

    def _advance_continuous(self, steps: ContinuousSteps, count: int, effort: np.ndarray | None) -> None:
        steps.set_effort(effort)
        coordinates, balls = self.coordinates, bool(len(self.coordinates.ball))
        try:
            for _ in range(count):
                steps.step()
                if balls:
                    self._write(coordinates.settled(self.x))
        except RuntimeError as error:
            raise EngineError(NAME, f"a step failed: {error}") from error

    def _explained(self, error: RuntimeError) -> str:
        """Drake's words. Of a step of which TAMSI, which need not converge, finds no solution: the first sentence, with advice
        for this world in place of Drake's for all."""
        said = str(error)
        if self.settings["contact_approximation"] != "tamsi" or UNSOLVED not in said:
            return said
        return (
            f"{said.partition('. ')[0].rstrip('.')}.\n"
            f"TAMSI found no solution at {1e3 * self.timestep:g} ms. Take a smaller timestep, or SAP, which always finds one: "
            "engines.drake.settings: {contact_approximation: sap}"
        )

    def _effort_at(self, x: np.ndarray, effort: np.ndarray | None) -> np.ndarray:
        """An effort with the damping and springs of the joints at a state, in Drake's coordinates."""
        coordinates = self.coordinates
        total: np.ndarray = np.zeros(self.nv) if effort is None else coordinates.effort(x, effort)
        damping, stiffness, _ = self._losses_in_drake
        total -= damping * x[coordinates.positions :] + stiffness * self._stretch(x)
        return total

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J), springs included."""
        springs = 0.5 * float(np.sum(self._losses_in_drake[1] * self._stretch(self.x) ** 2))
        return (
            float(self.plant.CalcKineticEnergy(self.context)),
            float(self.plant.CalcPotentialEnergy(self.context)) + springs,
        )

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The mass matrix in the coordinates v, as parts (places, M): whole, or of many bodies one part for each tree."""
        x, coordinates = self.x, self.coordinates
        if self.nv > WHOLE:
            return self._mass_by_trees(x)
        half = coordinates.effort_back(x, self.plant.CalcMassMatrix(self.context))
        return [(np.arange(self.nv), coordinates.effort_back(x, half.T))]

    def _mass_by_trees(self, x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """By inverse dynamics of unit accelerations, of all trees at once, which do not act on each other: Drake gives M whole
        alone, and that of 2,000 free bodies would be 1 GB."""
        trees, nothing = self.tree_places(), self.built.drake.tree.MultibodyForces(self.plant)

        def force(acceleration: np.ndarray) -> np.ndarray:
            found: np.ndarray = self.plant.CalcInverseDynamics(self.context, acceleration, nothing)
            return found

        static, coordinates = force(np.zeros(self.nv)), self.coordinates
        masses = unit_responses(
            trees, self.nv, lambda unit: coordinates.effort_back(x, force(coordinates.effort(x, unit)) - static)
        )
        return list(zip(trees, masses, strict=True))

    def bias(self) -> np.ndarray:
        """Coriolis, centrifugal and gravity forces (nv,)."""
        bias = self.plant.CalcBiasTerm(self.context) - self.plant.CalcGravityGeneralizedForces(self.context)
        return self.coordinates.effort_back(self.x, bias)

    # --- contact ----------------------------------------------------------------------------------------------

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used, as arrays with ``CONTACT_FIELDS``."""
        results = self._results
        if results is None:
            return empty_contacts()
        touches = [_point(results.point_pair_contact_info(index)) for index in range(results.num_point_pair_contacts())]
        touches += [
            _surface(results.hydroelastic_contact_info(index)) for index in range(results.num_hydroelastic_contacts())
        ]
        if not touches:
            return empty_contacts()
        units = np.array([[self.shape_of[side] for side in touch.ids] for touch in touches], dtype=np.int64)
        table = np.array([(*touch.position, *touch.normal, touch.depth, touch.force) for touch in touches])
        return contact_table(units, table, [row for row, _ in self.units()])

    def query(self) -> Any:
        """Drake's answers on geometry at the present state."""
        return self.plant.get_geometry_query_input_port().Eval(self.context)

    def touching(self) -> np.ndarray:
        """Pairs (n, 2) of the places of shapes that touch at the present state."""
        pairs = self.query().ComputePointPairPenetration()
        numbers = [(self.shape_of[pair.id_A], self.shape_of[pair.id_B]) for pair in pairs]
        return np.array(numbers, dtype=np.int64).reshape(-1, 2)

    def disable_contact(self) -> None:
        """Nothing touches anything."""
        self._touches = False
        geometry = self.built.drake.geometry
        every = geometry.GeometrySet(list(self.shape_of))
        manager = self.built.scene.collision_filter_manager(self.built.scene.GetMyMutableContextFromRoot(self.root))
        manager.Apply(geometry.CollisionFilterDeclaration().ExcludeWithin(every))

    def messages(self) -> list[str]:
        """Drake's messages while loading."""
        return list(self.log)


# Drake's contacts of the last step: points of two geometries, and surfaces of hydroelastic contact.

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DrakeContact:
    """One contact of the geometries ``ids`` (A, B): its position (m), the normal from B to A, the force on A along it (N), and
    the depth (m)."""

    ids: tuple[Any, Any]
    position: Vector
    normal: Vector
    force: float
    depth: float


def _point(info: Any) -> DrakeContact:
    pair = info.point_pair()
    on_first = -float(np.sum(pair.nhat_BA_W * info.contact_force()))  # Drake's is on the second
    return DrakeContact((pair.id_A, pair.id_B), info.contact_point(), pair.nhat_BA_W, on_first, float(pair.depth))


def _surface(info: Any) -> DrakeContact:
    """A contact surface as one contact, where its pressure acts together. Its normal is that of its faces, by their area."""
    surface = info.contact_surface()
    faces = range(surface.num_faces())
    normal = np.sum([surface.area(face) * surface.face_normal(face) for face in faces], axis=0)
    normal /= np.linalg.norm(normal)
    wrench = info.F_Ac_W()  # on the body of M, about the centroid
    force, torque = wrench.translational(), wrench.rotational()
    along = float(normal @ force)
    centre = np.cross(normal, torque) / along if along > 0.0 else np.zeros(3)
    return DrakeContact((surface.id_M(), surface.id_N()), surface.centroid() + centre, normal, along, _depth(surface))


def _depth(surface: Any) -> float:
    """How deep two shapes are in each other (m): pressure grows with depth, in a box by the same everywhere."""
    pressure = surface.poly_e_MN()
    largest = max(float(pressure.EvaluateAtVertex(vertex)) for vertex in range(surface.num_vertices()))
    slopes = [surface.EvaluateGradE_M_W(0)] if surface.HasGradE_M() else []
    slopes += [surface.EvaluateGradE_N_W(0)] if surface.HasGradE_N() else []
    return sum(largest / float(np.linalg.norm(slope)) for slope in slopes)


# Drake's own PD controllers, which its actuators have: SAP solves for them in each step, with contact and limits.

NATIVE = (
    "Drake's PD controllers are implicit in time, with SAP only: clip(kp (q* − q − dt v') + kd (v* − v')), "
    "where v' is the velocity after the step. They follow dt v* behind their targets, and Drake weakens gains "
    "with dt kd + dt² kp above 3900 times the inertia"
)


def pd_controllers_hold(world: World) -> Refinement | None:
    """Not supported by TAMSI, nor with an effort limit of zero."""
    if requested_approximation(world) != "sap":
        return unsupported_if("Drake's PD controllers need contact_approximation: sap, and the spec sets tamsi")
    return some_effort("Drake")(world)


class DrakeJointServos:
    """Drake's PD controllers of the hinges and slides at the places ``v`` (n,). They act once their desired state is given."""

    def __init__(self, sim: DrakeSimulation, v: np.ndarray):
        plant, self._context = sim.plant, sim.context
        self._port = plant.get_desired_state_input_port(sim.built.drake.tree.default_model_instance())
        body_at = {int(place.start): index for index, place in enumerate(sim.v_places)}
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
