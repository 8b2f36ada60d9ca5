"""A DART world loaded from ``world.skel``, with what the sidecar adds. Facts marked *measured*: dartpy 6.20.0."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.dart.sidecar import DartSidecar
from simspec.engines.dart.coordinates import NAME, DartCoordinates, DartEfforts, DartNodes, Turner, vector_of
from simspec.engines.kit.messages import captured
from simspec.errors import EngineError, not_importable
from simspec.formats.kit.mesh_reading import read_meshes
from simspec.formats.skel.format import WORLD
from simspec.formats.skel.reading import without_visual_shapes
from simspec.world.rotations import exponential_of, multiply_of

CONTACT_CAP = 1000
"""Contacts that DART takes in one step. Beyond that it leaves some out; dartpy gives no way to raise it (the collision
option that it returns is a copy)."""

MOST_DETECTED = 1_000_000
"""Contacts that one detection outside a step may find: a probe brings many pairs together at once."""

MESH_NAME = re.compile(r"<file_name>([^<]*)</file_name>")
NOT_IN_URI = {"#", "?"}
"""Letters of a path by which DART does not find a file: it makes a URI of the path, and does not escape them (measured)."""

ZERO_MASS = "A negative or zero mass [0]"
"""DART warns of bodies without mass, which simspec has only where they cannot move: that is no news."""


def import_dartpy() -> Any:
    """DART's module. Raises EngineError where it is not installed."""
    try:
        import dartpy
    except ImportError as error:
        raise not_importable(NAME, "dartpy", error) from error
    return dartpy


class DartSimulation:
    """A loaded world, in its initial state.

    Visual-only shapes are left out unless ``pictures`` are requested: DART carries them along in every step (measured: 59 of
    them cost 7 µs of 126). See :meth:`whole`.
    """

    def __init__(self, folder: Path, sidecar: DartSidecar, pictures: bool = False):
        self.dartpy = import_dartpy()
        self.sidecar = sidecar
        self.constraints, self.sums, self.passive = sidecar.constraints or (), sidecar.sums or (), sidecar.passive
        self.settings: Mapping[str, Any] = sidecar.settings
        self.log: list[str] = []
        self.excluded: list[tuple[str, str]] = []
        """The pairs of nodes that DART excludes from contact; it does not report them."""
        self.folder, self._blind = folder, False
        self.meshes: Mapping[str, tuple[float, ...]] = {}
        """The vertices (flat, m) of the files of meshes, by relative path."""
        self.world = self._read(folder / WORLD, pictures)
        self._check_detector()
        with captured(sys.stderr, self.log, (ZERO_MASS,)):
            self._set_solver()
        self.timestep: float = self.world.getTimeStep()
        self.nodes = DartNodes(self.world, sidecar)
        self.names, self.bodies = self.nodes.names, self.nodes.bodies
        self.body_of_shape = [self.nodes.place_of_body[shape.body] for shape in sidecar.shapes]
        """The index of the world's body that has each of the sidecar's shapes."""
        self.offsets = np.array([entry.frame_offset for entry in sidecar.bodies], dtype=float).reshape(-1, 3)
        self.coordinates = DartCoordinates(self.bodies, [entry.kind for entry in sidecar.bodies])
        self._set_limits()
        joints = {name: body.getParentJoint() for name, body in zip(self.names, self.bodies, strict=True)}
        self.efforts = DartEfforts(self.coordinates, joints, sidecar, self.timestep)
        self.nodes.set_surfaces()
        self._set_filter()
        self.solver.getCollisionGroup().setAutomaticUpdate(False)  # no shape comes, goes or changes: 1 µs a step
        self._moves = [body.isReactive() for body in self.bodies]
        self._may_touch = any(moves and self.nodes.solid(index) for index, moves in enumerate(self._moves))
        choice = self.settings["exact_rotation"]
        self.exact_rotation = choice == "always" or (choice == "auto" and not self._may_touch)
        self.set_state(*self.coordinates.get_state())

    # --- loading ----------------------------------------------------------------------------------------------

    def _read(self, path: Path, pictures: bool) -> Any:
        if not path.is_file():
            raise EngineError(NAME, f"the file {WORLD!r} is missing")
        # as text: DART takes a path for a URI, in which some characters of folders mean something else
        text = path.read_text(encoding="utf-8")
        if not pictures:
            text, self._blind = without_visual_shapes(text)
        named = set(MESH_NAME.findall(text))
        if named:
            self._read_meshes(path.parent, named)
        base = self.dartpy.common.Uri.createFromPath(str(path)) if named else self.dartpy.common.Uri()
        try:
            with captured(sys.stderr, self.log, (ZERO_MASS,)):
                world = self.dartpy.utils.SkelParser.readWorldXML(text, base)
        except (RuntimeError, ValueError) as error:
            raise EngineError(NAME, f"refuses {WORLD}: {error}") from error
        if world is None:
            raise EngineError(NAME, f"refuses {WORLD}: {' '.join(self.log) or 'no reason given'}")
        return world

    def _read_meshes(self, folder: Path, named: set[str]) -> None:
        """The meshes that a file names. DART takes whatever surface it finds for a solid, and crashes where it finds none
        (measured)."""
        unfit = sorted(NOT_IN_URI & set(str(folder)))
        if unfit:
            raise EngineError(NAME, f"does not support meshes in a folder whose path contains {' or '.join(unfit)}")
        try:
            self.meshes = read_meshes(folder)
        except ValueError as error:
            raise EngineError(NAME, str(error)) from error
        if missing := sorted(named - self.meshes.keys()):
            raise EngineError(NAME, f"{WORLD} names the mesh {missing[0][:60]!r}, which is missing")

    def whole(self) -> DartSimulation:
        """The files as they are, visual-only shapes included, in their initial state; DART's messages on those go into the
        log."""
        if not self._blind:
            return self
        found = DartSimulation(self.folder, self.sidecar, pictures=True)
        self.log.extend(line for line in found.log if line not in self.log)
        return found

    def _check_detector(self) -> None:
        """The file and the sidecar must ask for the same detector of contacts."""
        actual, given = self.world.getCollisionDetector().getType(), self.settings["collision_detector"]
        if actual != given:
            raise EngineError(NAME, f"holds the collision detector {actual} from {WORLD}, the sidecar says {given}")

    def _set_solver(self) -> None:
        dartpy, world, given = self.dartpy, self.world, self.settings
        options = world.getDeactivationOptions()
        # on by default; the setting is not there when off
        options.mEnabled = bool(given.get("sleeping", False))
        # DART tests speeds before it solves contact: a body at rest has the speed of the step's fall (measured)
        options.mLinearSpeedThreshold += math.dist((0.0, 0.0, 0.0), world.getGravity()) * world.getTimeStep()
        world.setDeactivationOptions(options)
        world.setNumSimulationThreads(1)
        kinds = dartpy.simulation.CollisionDetectorType
        world.setCollisionDetector(getattr(kinds, given["collision_detector"].upper()))
        self.solver = solver = world.getConstraintSolver()
        solver.setSplitImpulseEnabled(False)
        matrix_free = solver.getMatrixFreeContactSolverOptions()
        matrix_free.mEnabled = False  # another, approximate solver for many contacts
        solver.setMatrixFreeContactSolverOptions(matrix_free)
        if given["contact_solver"] == "dantzig":  # DART's default; dartpy has no constructor for it
            if not isinstance(solver.getBoxedLcpSolver(), dartpy.constraint.DantzigBoxedLcpSolver):
                raise EngineError(
                    NAME, f"starts with {type(solver.getBoxedLcpSolver()).__name__}, not Dantzig's solver"
                )
            return
        kind = dartpy.constraint.NsgsFrictionSolver
        chosen = kind.Options()
        chosen.law = kind.Law.Coulomb if self.sidecar.friction_cone == "elliptic" else kind.Law.Box
        chosen.maxSweeps = given["iterations"]
        chosen.tolerance = given["tolerance"]
        if self._has_dry_friction():
            chosen.tolerance = min(given["tolerance"], given["dry_friction_tolerance"])
        solver.setBoxedLcpSolver(kind(chosen))

    def _has_dry_friction(self) -> bool:
        """Whether a joint has dry friction."""
        skeletons = (self.world.getSkeleton(index) for index in range(self.world.getNumSkeletons()))
        joints = (joint for skeleton in skeletons for joint in skeleton.getJoints())
        return any(joint.getCoulombFriction(dof) for joint in joints for dof in range(joint.getNumDofs()))

    def _set_limits(self) -> None:
        joints = {name: body.getParentJoint() for name, body in zip(self.names, self.bodies, strict=True)}
        for name in self.sidecar.enforce_limits:
            joints[name].setLimitEnforcement(True)
        for entry in self.sidecar.effort_limits:  # held, not enforced: setForces does not clip (measured)
            joints[entry.body].setForceLowerLimit(0, -entry.value)
            joints[entry.body].setForceUpperLimit(0, entry.value)

    def _set_filter(self) -> None:
        """Every pair of bodies may touch, also in one tree, but for those that the sidecar excludes."""
        for index in range(self.world.getNumSkeletons()):
            skeleton = self.world.getSkeleton(index)
            skeleton.enableSelfCollisionCheck()
            skeleton.enableAdjacentBodyCheck()
        # the option is a copy, the filter in it is the solver's own (measured)
        add = self.solver.getCollisionOption().collisionFilter.addBodyNodePairToBlackList
        for node, other in self.nodes.excluded_pairs():
            self.excluded.append((node.getName(), other.getName()))
            add(node, other)

    # --- state ------------------------------------------------------------------------------------------------

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        return self.coordinates.get_state()

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        self.coordinates.set_state(q, v)
        self.solver.clearLastCollisionResult()

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them."""
        poses, velocities = np.zeros((len(self.bodies), 7)), np.zeros((len(self.bodies), 6))
        for index, body in enumerate(self.bodies):
            place = body.getWorldTransform()
            poses[index, :3], poses[index, 3:] = place.translation(), place.quaternion().wxyz()
            velocities[index, :3], velocities[index, 3:] = body.getLinearVelocity(), body.getAngularVelocity()
        poses[poses[:, 3] < 0.0, 3:] *= -1.0
        return poses, velocities

    # --- dynamics ---------------------------------------------------------------------------------------------

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The parts of M of each tree, armature included, with its places in v."""
        values, armature = [], self.efforts.armature
        for tree in self.coordinates.trees:
            turn = tree.velocity_map()
            values.append((tree.block, turn.T @ (tree.skeleton.getMassMatrix() + np.diag(armature[tree.dofs])) @ turn))
        return values

    def bias(self) -> np.ndarray:
        """h (nv,) in M v̇ + h = τ, damping and springs left out."""
        found = np.zeros(self.coordinates.nv)
        for tree in self.coordinates.trees:
            found[tree.block] = tree.velocity_map().T @ tree.skeleton.getCoriolisAndGravityForces()
        return found

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J), with those of armatures and springs."""
        kinetic, potential = self.efforts.energy()
        for tree in self.coordinates.trees:
            kinetic += tree.skeleton.computeKineticEnergy()
            potential += tree.skeleton.computePotentialEnergy()
        return kinetic, potential

    # --- contact ----------------------------------------------------------------------------------------------

    def contacts_of(self, result: Any) -> list[tuple[tuple[int, int], Any]]:
        """The contacts in DART's result of a collision detection, each with the places of its two shapes in the sidecar's list.

        DART detects contacts between bodies that both cannot move where one is in a tree that moves, and makes nothing
        of them; they are left out.
        """
        copy, moves, found = self.nodes.copy, self._moves, []
        bodies = self.body_of_shape
        for contact in result.getContacts():
            first, second = (
                copy(side.getShapeFrame().asShapeNode())[0]
                for side in (contact.collisionObject1, contact.collisionObject2)
            )
            if moves[bodies[first]] or moves[bodies[second]]:
                found.append(((first, second), contact))
        return found

    def detect_contacts(self) -> np.ndarray:
        """Pairs (n, 2) of the places, in the sidecar's list, of shapes that touch at the present state.

        Raises EngineError when two shapes touch by other copies than they should: the filter is wrong.
        """
        pairs, wrong = self._detected()
        if (
            wrong
        ):  # raised here: a traceback that held DART's contacts beyond its world would crash the process (measured)
            raise EngineError(NAME, wrong)
        return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)

    def _detected(self) -> tuple[set[tuple[int, int]], str]:
        """The pairs of shapes that touch, and what is wrong with the copies by which they do."""
        result = self.dartpy.collision.CollisionResult()
        option = self.solver.getCollisionOption()  # a copy (measured)
        option.maxNumContacts = MOST_DETECTED
        self.solver.getCollisionGroup().collide(option, result)
        pairs, wrong = set(), ""
        for shapes, contact in self.contacts_of(result):
            if self.sidecar.filter.layers and not wrong:
                sides = (contact.collisionObject1, contact.collisionObject2)
                wrong = self.nodes.wrong_meeting(*(side.getShapeFrame().asShapeNode() for side in sides))
            pairs.add(shapes)
        return pairs, wrong

    def disable_contact(self) -> None:
        """Switch contact off; without contact the exact rotations cost nothing that matters."""
        # the detectors do not ask a shape whether it may collide (measured); shapes outside of the solver's group cannot
        self.world.getConstraintSolver().getCollisionGroup().removeAllShapeFrames()
        if self.settings["exact_rotation"] != "never":
            self.exact_rotation = True

    def check_contact_cap(self) -> None:
        """Raises EngineError (or notes in the log) when the last step had more contacts than DART takes."""
        if self.world.getLastCollisionResult().getNumContacts() < CONTACT_CAP:
            return
        message = f"more than {CONTACT_CAP} contacts in a step: DART drops the others"
        if self.settings["contact_overflow"] == "error":
            raise EngineError(NAME, f"{message}; to continue anyway, use the setting contact_overflow: log")
        if message not in self.log:
            self.log.append(message)

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the efforts of the world's joints.

        Raises EngineError when the last step had more contacts than DART takes.
        """
        step = self.world.step
        driven, turners = self.efforts.give(effort), self.coordinates.turners
        if not driven and not turners:
            for _ in range(count):
                step()
            if self._may_touch:
                self.check_contact_cap()
            return
        if self.exact_rotation:
            for turner in turners:
                if turner.turn is None:
                    turner.turn = exponential_of(turner.joint.getPositions()[:3].tolist())
        else:
            if turners and turners[0].turn is not None:  # all are set together and cleared together
                for turner in turners:
                    turner.turn = None
            turners = []
        if not driven and not turners:
            for _ in range(count):
                step()
        else:
            apply, correct = self.efforts.apply, self._correct
            for _ in range(count):
                for tree in driven:
                    apply(tree)
                step()
                for turner in turners:
                    correct(turner)
        self.check_contact_cap()

    def plain_step(self) -> None:
        """One step under the forces that were set, where no rotation is to be corrected. ``check_contact_cap`` is the
        caller's to ask."""
        for turner in self.coordinates.turners:
            if turner.turn is None:
                break  # all are set together and cleared together
            turner.turn = None
        self.world.step()

    def _correct(self, turner: Turner) -> None:
        """Put a joint's rotation where the exponential of its velocity takes it.

        DART's own is a Taylor form for turns below 1e-3 rad in a step, off by up to 1.7e-10 (measured).
        """
        change = exponential_of([x * self.timestep for x in turner.joint.getVelocities()[:3].tolist()])
        if turner.turn is None:
            raise RuntimeError("the rotation before the step is not known")
        if turner.kind == "ball":
            turner.turn = multiply_of(turner.turn, change)
            turner.joint.setPositions(vector_of(turner.turn))
        else:
            turner.turn = multiply_of(change, turner.turn)
            turner.joint.setPositions([*vector_of(turner.turn), *turner.joint.getPositions()[3:].tolist()])

    def messages(self) -> list[str]:
        """DART's messages while loading, and the failures of its contact solver."""
        found = list(self.log)
        solver = self.solver.getBoxedLcpSolver()
        if isinstance(solver, self.dartpy.constraint.NsgsFrictionSolver):
            stats = solver.getStats()
            if stats.numFailed:
                found.append(f"{stats.numFailed} of {stats.numSolves} contact solves failed: DART used its PGS instead")
            if stats.numAcceptedAtCap:
                found.append(
                    f"{stats.numAcceptedAtCap} of {stats.numSolves} contact solves ended at the most sweeps, with a "
                    f"residual of at most {stats.maxViolation:.2g}"
                )
        return found

    def close(self) -> None:
        """Nothing to do: DART's world goes with this object."""
