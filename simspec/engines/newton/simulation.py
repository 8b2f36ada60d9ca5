"""A world in Newton: stepping, efforts, contact.

Newton's solver Steel steps as simspec's law of motion does, v before q, but for three parts that simspec adds: springs, the
gyroscopic term of single free bodies, and the last of each rotation. A step is recorded once, as the sequence of functions
that it calls, and repeated at once: of two hinges in 0.02 ms, not 1.8 (measured).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.newton import NewtonSidecar
from simspec.engines.kit.arrays import checked_singles, empty_contacts
from simspec.engines.kit.building import Walk
from simspec.engines.kit.link_contacts import ContactPoints, ContactRoom
from simspec.engines.kit.links import LinkCoordinates, LinkSimulation, Midpoint
from simspec.engines.kit.messages import doing
from simspec.engines.kit.servos import ArrayServos, driven_at
from simspec.engines.kit.warp import doubles
from simspec.engines.newton.building import NAME, NewtonBuild, imported
from simspec.errors import EngineError


@dataclasses.dataclass
class RecordedStep:
    """A solver with its contacts, and its step as Warp recorded it."""

    solver: Any
    contacts: Any
    observed: Any
    graph: Any
    overflow: np.ndarray
    """Whether contacts or rows had no room."""


def shapes_of(contacts: Any) -> np.ndarray:
    """Pairs (n, 2) of Newton's numbers of the shapes of contacts (None: nothing may touch)."""
    if contacts is None:
        return np.zeros((0, 2), dtype=np.int64)
    count = int(contacts.rigid_contact_count.numpy()[0])
    ends = (contacts.rigid_contact_shape0, contacts.rigid_contact_shape1)
    return np.stack([end.numpy()[:count] for end in ends], axis=1).astype(np.int64)


class NewtonSimulation(LinkSimulation[NewtonSidecar]):
    """A loaded world."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        super().__init__(NAME, NewtonSidecar, folder, sidecar)
        if self.constraints:
            raise EngineError(NAME, "does not support constraints between bodies")
        self._log: list[str] = []
        self.walk = Walk.of(self.document)
        modules = imported(self._log)
        self.newton, self.wp, self._origins = modules
        try:
            with doing("Warp compiles parts of Newton at first"):
                self.built = NewtonBuild(modules, self.walk, self.typed)
        except (KeyError, ValueError) as error:
            raise EngineError(NAME, f"Newton refuses the world: {error}") from error
        model = self.built.model
        self.room = ContactRoom.first(self.walk)
        self.timestep = checked_singles(NAME, (self.document.timestep,), "timestep")[0]
        self.state, self._next, self.control = model.state(), model.state(), model.control()
        starts = [array.numpy() for array in (model.joint_q_start, model.joint_qd_start)]
        alone = [self.built.links[row] for row in self.walk.single]
        midpoint = Midpoint(alone, doubles(model.body_inertia), *starts)
        places = LinkCoordinates(self.document, *(start[self.built.links] for start in starts))
        self._contact = bool(len(self.built.pairs))
        self._recorded: RecordedStep | None = None
        arrays = (self.state.joint_q, self.state.joint_qd, self.control.joint_f)
        q, v, effort = (array.numpy() for array in arrays)  # the memory itself
        self.begin(places, q, v, effort, midpoint)

    # --- state ------------------------------------------------------------------------------------------------

    def place(self) -> None:
        """Let Newton compute the poses and velocities of its links."""
        model, links = self.built.model, self.built.centred
        self.newton.eval_fk(model, self.state.joint_q, self.state.joint_qd, self.state)
        if len(links):
            inputs = [self.state.body_q, model.body_com, links]
            self.wp.launch(self._origins.follow, dim=len(links), inputs=inputs, device="cpu")

    def forget_contacts(self) -> None:
        """Begin the next step without the contact impulses of the step before."""
        if self.built.warm_start and self._recorded is not None:
            self._recorded.solver.reset(self.state)

    def link_arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the links, in the order of the bodies."""
        at, speed = (doubles(array)[self.built.links] for array in (self.state.body_q, self.state.body_qd))
        return at, speed

    def of_bodies(self, name: str) -> np.ndarray:
        """An array of the links, in the order of the bodies."""
        return doubles(getattr(self.built.model, f"body_{name}"))[self.built.links]

    def inertials(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Masses (n,), centres of mass (n, 3) and inertias (n, 3, 3) of the links, in the order of the bodies."""
        return self.of_bodies("mass"), self.of_bodies("com"), self.of_bodies("inertia")

    @property
    def rotors(self) -> np.ndarray:
        """The armature (nv,) of the joints."""
        return doubles(self.built.model.joint_armature)

    # --- steps ------------------------------------------------------------------------------------------------

    def launch(self) -> int | None:
        """One step by Newton; where contacts or rows had no room, for how many contacts it had."""
        recorded = self.recorded()
        self.wp.capture_launch(recorded.graph)
        return len(shapes_of(recorded.contacts)) if recorded.overflow.any() else None

    def make_anew(self) -> None:
        """Record the next step anew."""
        self._recorded = None

    def recorded(self) -> RecordedStep:
        """The step, recorded at first."""
        if self._recorded is None:
            with doing("Warp compiles parts of Newton at first"):
                self._recorded = self._record()
        return self._recorded

    def _record(self) -> RecordedStep:
        wp, kinds = self.wp, self.newton.solvers.SolverSteel.ObservableKind
        solver = self.built.solver(self.room)
        pipeline = self.built.pipeline(self.room) if self._contact else None
        contacts = pipeline.contacts() if pipeline is not None else None
        observed = solver.observables([kinds.CONTACT_F], contacts=contacts) if contacts is not None else None

        def step() -> None:
            self.place()
            if pipeline is not None:
                pipeline.collide(self.state, contacts)
            solver.step(self.state, self._next, self.control, contacts, self.timestep, observables=observed)
            wp.copy(self.state.joint_q, self._next.joint_q)
            wp.copy(self.state.joint_qd, self._next.joint_qd)

        begins = self.their_q.copy(), self.their_v.copy()
        step()  # Warp loads what it compiled
        solver.reset(self.state)
        with wp.ScopedCapture(device="cpu") as capture:
            step()
        solver.reset(self.state)
        self.their_q[:], self.their_v[:] = begins
        return RecordedStep(solver, contacts, observed, capture.graph, solver.constraint_overflow.numpy())

    def track(self, v: np.ndarray) -> ArrayServos:
        """Drive the joints with their velocities at the places ``v`` (n,) by Newton's own controllers, from now on."""
        rows = [row for row, _, _ in driven_at(self, self.walk, v)]
        self.built.drives.switch(True)
        self.make_anew()
        starts = self.built.model.joint_target_q_start.numpy()[self.built.links]
        targets = (self.control.joint_target_q.numpy(), self.control.joint_target_qd.numpy())  # the memory itself
        return ArrayServos(*targets, starts[rows], self.built.dofs[rows])

    def disable_contact(self) -> None:
        """Nothing touches anything."""
        self._contact = False
        self.make_anew()

    # --- answers ----------------------------------------------------------------------------------------------

    @property
    def gravity(self) -> np.ndarray:
        """As Newton has it (3,), in m/s²."""
        return np.array(doubles(self.built.model.gravity)[0])

    def bias(self) -> np.ndarray:
        """Coriolis, centrifugal and gravity forces (nv,)."""
        self.place()
        weight, inertial = (self.wp.zeros(self.nv, dtype=float, device="cpu") for _ in range(2))
        self.newton.eval_inverse_dynamics_passive(
            self.built.model, self.state, gravity_force=weight, coriolis_force=inertial
        )
        found = self.places.velocities_of(self.get_state()[0], doubles(weight) + doubles(inertial))
        return self.with_single_bias(found, self.walk.single)  # Newton's has the round-off of momenta about the origin

    # --- contact ----------------------------------------------------------------------------------------------

    def touched(self) -> np.ndarray:
        """The links that the contacts of the last step are of."""
        return np.array(self.built.model.shape_body.numpy()[shapes_of(self.recorded().contacts).ravel()])

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used."""
        if not self.stepped or not self._contact:
            return empty_contacts()
        points = self._points(self.recorded().contacts)
        forces = doubles(self.recorded().observed.contact_f)[
            : len(points.units), :3
        ]  # on the first shape, with friction
        return points.arrays(-np.einsum("ni,ni->n", forces, points.normals), [body for body, _ in self.units()])

    def _points(self, contacts: Any) -> ContactPoints:
        """Newton's contacts, of the poses that its links have."""
        shapes, poses = shapes_of(contacts), doubles(self.state.body_q)
        links = self.built.model.shape_body.numpy()[shapes]

        def of(name: str) -> np.ndarray:
            return doubles(getattr(contacts, f"rigid_contact_{name}"))[: len(shapes)]

        places = [of(f"point{end}") + of(f"offset{end}") for end in range(2)]
        return ContactPoints.between(self.built.unit_of[shapes], poses[links], places, of("normal"))

    def touching(self) -> np.ndarray:
        """Pairs (n, 2) of the numbers of copies that touch at the present state."""
        if not self._contact:
            return np.zeros((0, 2), dtype=np.int64)
        self.place()
        pipeline = self.built.pipeline(self.room)
        contacts = pipeline.contacts()
        pipeline.collide(self.state, contacts)
        if len(shapes_of(contacts)) >= self.room.contacts:
            self.grow(self.room.contacts)
            return self.touching()
        points = self._points(contacts)
        return points.units[points.distances <= 0.0]

    def messages(self) -> list[str]:
        """Messages of Warp at its start."""
        return list(self._log)
