"""A world's bodies as a model of OpenSim, and its state in simspec's coordinates."""

from __future__ import annotations

import functools
import importlib.metadata
import math
import os
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import layout_of
from simspec.world.types import Body, Inertial, Joint, World

MISSING = None
try:
    importlib.metadata.version("opensim")
except importlib.metadata.PackageNotFoundError:
    MISSING = "the second oracle is not installed: pip install 'simspec-physics[second-oracle]'"
"""Why there is no Simbody here; None: there is."""


NO_MASS = 1e-200
"""kg; at zero OpenSim finds no order for several bodies without mass in a row. No digit of any sum sees it."""


@functools.cache
def opensim() -> Any:
    """The package, quiet, which leaves the environment and the working directory as they are."""
    before = dict(os.environ)
    try:
        import opensim as package
    finally:  # it writes SIMBODY_HOME, PATH and LD_LIBRARY_PATH, for programs of its own
        for name in {*os.environ} - {*before}:
            del os.environ[name]
        os.environ.update(before)
    package.Logger.setLevelString("Error")
    package.Logger.removeFileSink()  # else it writes opensim.log into the working directory
    return package


def turned(quaternion: Sequence[float]) -> Rotation:
    """Of w x y z."""
    w, x, y, z = quaternion
    return Rotation.from_quat((x, y, z, w))


def _angles(turn: Rotation) -> tuple[float, float, float]:
    """a, b, c with R = Rx(a) Ry(b) Rz(c). c is taken from what a leaves, so that R is kept to the last digits also where b is
    90° and only a + c or a − c is known."""
    r = turn.as_matrix()
    a = math.atan2(-r[1, 2], r[2, 2])
    b = math.atan2(r[0, 2], math.hypot(r[0, 0], r[0, 1]))
    sine, cosine = math.sin(a), math.cos(a)
    c = math.atan2(cosine * r[1, 0] + sine * r[2, 0], cosine * r[1, 1] + sine * r[2, 1])
    return a, b, c


def _onto(axis: np.ndarray, first: np.ndarray) -> Rotation:
    """A rotation that takes the unit vector ``first`` to ``axis``: half a turn about the middle of both. Where they are
    opposite ``first`` is turned over before, so that the middle is never short."""
    over = Rotation.identity()
    if first @ axis < 0.0:
        across = np.cross(first, np.eye(3)[int(np.argmin(np.abs(first)))])
        over, first = Rotation.from_rotvec(math.pi * across), -first
    middle = first + axis
    return Rotation.from_rotvec(math.pi * middle / np.linalg.norm(middle)) * over


def vector(values: Iterable[float]) -> Any:
    """OpenSim's, of three numbers."""
    return opensim().Vec3(*(float(value) for value in values))


class Model:
    """A world's bodies as OpenSim's model ``model`` with its ``state``; ``matter``: Simbody's part of it, ``bodies`` by name.

    Simbody's coordinates of a ball and of a free body are three angles here (then the position); its speeds are the angular
    velocity in the axes of the joint's frame, then the linear one.
    """

    def __init__(self, world: World):
        osim = opensim()
        self.world, self.layout = world, layout_of(world)
        self.nq, self.nv = self.layout.nq, self.layout.nv
        self.gravity = np.array(world.physics.gravity)
        self.model = osim.Model()
        self.model.setGravity(vector(world.physics.gravity))
        self.bodies: dict[str, Any] = {}
        self.at_rest: set[str] = set()
        """Names of the bodies that are fixed to the world."""
        joints = [self._add(index, body) for index, body in enumerate(world.bodies)]
        for body, made in zip(world.bodies, joints, strict=True):
            self._resist(body, made)
        self.state = self.model.initSystem()
        self.matter = self.model.getMatterSubsystem()
        if self.state.getNU() != self.nv:
            raise ValueError(f"Simbody has {self.state.getNU()} speeds for {self.nv} v")
        self.mobilized = {name: int(body.getMobilizedBodyIndex()) for name, body in self.bodies.items()}
        self._find_coordinates(joints)

    # --- the model ------------------------------------------------------------------------------------------------

    def _add(self, index: int, body: Body) -> Any:
        """The body and its joint."""
        osim, joint = opensim(), body.joint
        above = self.model.getGround() if joint.parent is None else self.bodies[joint.parent]
        if joint.kind == "fixed" and (joint.parent is None or joint.parent in self.at_rest):
            self.at_rest.add(body.name)
        mine = body.inertial if body.name not in self.at_rest else Inertial(0.0)  # so that its weight has no energy
        centre, inertia = vector(mine.centre_of_mass), osim.Inertia(*mine.inertia)
        local = osim.Body(f"b{index}", mine.mass or NO_MASS, centre, inertia)
        self.model.addBody(local)
        self.bodies[body.name] = local
        kind, turn, place = self._kind(joint)
        at = lumped_inertial(self.world, body).centre_of_mass if joint.kind == "free" else (0.0,) * 3
        origin = turned(joint.origin.quaternion) * turn
        made = kind(
            f"j{index}",
            above,
            vector(joint.origin.position),
            vector(_angles(origin)),
            local,
            vector(at),
            vector(_angles(place)),
        )
        self.model.addJoint(made)
        return made

    def _kind(self, joint: Joint) -> tuple[Any, Rotation, Rotation]:
        """OpenSim's class of joint, and how its frames are turned in the joint's frame and in the child's."""
        osim, none = opensim(), Rotation.identity()
        if joint.kind == "hinge":  # about z
            turn = _onto(np.array(joint.axis), np.array([0.0, 0.0, 1.0]))
            return osim.PinJoint, turn, turn
        if joint.kind == "slide":  # along x
            turn = _onto(np.array(joint.axis), np.array([1.0, 0.0, 0.0]))
            return osim.SliderJoint, turn, turn
        return {"fixed": osim.WeldJoint, "ball": osim.BallJoint, "free": osim.FreeJoint}[joint.kind], none, none

    def _resist(self, body: Body, made: Any) -> None:
        """The springs and dampers of a joint's coordinates, but for the springs of balls."""
        osim, joint = opensim(), body.joint
        turning = made.numCoordinates() == 6
        for index in range(made.numCoordinates()):
            damping = joint.angular_damping if turning and index < 3 else joint.damping
            stiffness = joint.spring_stiffness if made.numCoordinates() == 1 else 0.0
            if damping or stiffness:
                force = osim.SpringGeneralizedForce(made.get_coordinates(index).getName())
                force.setViscosity(damping)
                force.setStiffness(stiffness)
                force.setRestLength(joint.spring_rest)
                self.model.addForce(force)

    def _find_coordinates(self, joints: Sequence[Any]) -> None:
        """Where the coordinates of each joint stand in Simbody's q, which has room for quaternions, and in its u."""
        osim, state = opensim(), self.state
        self.at_q: list[np.ndarray] = []
        self.at_u: list[np.ndarray] = []
        for made in joints:
            all_q, all_u = [], []
            for index in range(made.numCoordinates()):
                state.setQ(osim.Vector(state.getNQ(), 0.0))
                state.setU(osim.Vector(state.getNU(), 0.0))
                made.get_coordinates(index).setValue(state, 1.0, False)
                made.get_coordinates(index).setSpeedValue(state, 1.0)
                (place,), (speed,) = (np.flatnonzero(part.to_numpy()) for part in (state.getQ(), state.getU()))
                all_q.append(int(place))
                all_u.append(int(speed))
            self.at_q.append(np.array(all_q, dtype=int))
            self.at_u.append(np.array(all_u, dtype=int))

    # --- states ---------------------------------------------------------------------------------------------------

    def put(self, q: np.ndarray, v: np.ndarray | None = None) -> np.ndarray:
        """Put Simbody into a state; returns T (nv, nv), orthogonal, by which its speeds are u = T v. Quantities linear in
        accelerations goes through T as well: Ṫ v = R (ω × ω) = 0."""
        osim = opensim()
        values, turn = np.zeros(self.state.getNQ()), np.zeros((self.nv, self.nv))
        for body, at_q, at_u, in_q, in_v in zip(
            self.world.bodies, self.at_q, self.at_u, self.layout.position, self.layout.velocity, strict=True
        ):
            kind, places = body.joint.kind, q[in_q]
            columns = np.arange(in_v.start, in_v.stop)
            if kind in ("hinge", "slide"):
                values[at_q] = places
                turn[at_u[0], columns[0]] = 1.0
            elif kind != "fixed":
                orientation = turned(places[-4:])
                values[at_q[:3]] = _angles(orientation)
                turn[np.ix_(at_u[:3], columns[-3:])] = orientation.as_matrix()
                if kind == "free":
                    values[at_q[3:]] = places[:3]
                    turn[at_u[3:], columns[:3]] = 1.0
        self.state.setQ(osim.Vector.createFromMat(values))
        self.state.setU(osim.Vector.createFromMat(np.zeros(self.nv) if v is None else turn @ v))
        return turn
