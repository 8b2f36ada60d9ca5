"""Ballistic: single rigid bodies that move freely under gravity, in plain NumPy."""

from xml.etree import ElementTree

import numpy as np

from simspec.contact import Rules
from simspec.dialects.urdf.sidecar import UrdfSidecar
from simspec.engines.kit.arrays import restore_velocities
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.support.declarations import EXACT, never
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.types import Body, Inertial, Joint, Pose, ReadBack

SUPPORTED = (
    *("joint.free", "joint.position", "joint.velocity", "body.inertia", "body.inertia.full"),
    *("physics.gravity", "physics.timestep", "physics.integrator"),
)


class Ballistic(Engine):
    NAME, TITLE, DIALECT, DISTRIBUTION, EXTRA = "ballistic", "Ballistic", "urdf", "ballistic", ""
    SUPPORT = {f: EXACT if f in SUPPORTED else never("Ballistic has free bodies only") for f in Feature}
    SETTINGS, RULES, LAYERS = {}, Rules("max", "max"), False
    UNREADABLE = {"control.native": "Ballistic has no controllers", "collision_group": "Ballistic has no contact"}
    LACKS = dict.fromkeys(set(Capability) - {Capability.CONTACT_OFF}, "not implemented")

    def load(self, folder, sidecar):
        given = UrdfSidecar.of(sidecar)
        self.gravity, self.dt = np.array(given.gravity), given.timestep
        self.trees = {tree.bodies[0]: tree for tree in given.instances}
        self.names = [body.name for body in given.bodies]
        self.offsets = np.array([body.frame_offset for body in given.bodies])
        self.mass, self.centre, self.inertia = [], [], []
        for name in self.names:
            inertial = ElementTree.parse(folder / self.trees[name].file).getroot().find("link/inertial")
            origin, moments = inertial.find("origin"), inertial.find("inertia")
            turn = np.array(frames.matrix(frames.from_rpy(*map(float, origin.get("rpy").split()))))
            xx, xy, xz, yy, yz, zz = (float(moments.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
            self.mass.append(float(inertial.find("mass").get("value")))
            self.centre.append([float(x) for x in origin.get("xyz").split()])
            self.inertia.append(turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T)
        first = [self.trees[name] for name in self.names]
        self.set_state(np.ravel([tree.position for tree in first]), np.ravel([tree.velocity for tree in first]))

    def set_state(self, q, v):
        self.q, self.v = np.array(q, float).reshape(-1, 7), np.array(v, float).reshape(-1, 6)

    def get_state(self):
        return self.q.ravel().copy(), self.v.ravel().copy()

    def step(self, count, effort=None):
        force = np.zeros(self.v.size) if effort is None else np.array(effort, float)
        force = force.reshape(-1, 6)
        for _ in range(count):
            for q, v, f, mass, inertia in zip(self.q, self.v, force, self.mass, self.inertia, strict=True):
                v[:3] += self.dt * (self.gravity + f[:3] / mass)
                v[3:] += self.dt * np.linalg.solve(inertia, f[3:] - np.cross(v[3:], inertia @ v[3:]))
                q[:3] += self.dt * v[:3]
                half = self.dt * v[3:] / 2.0
                angle = float(np.linalg.norm(half))
                turn = (float(np.cos(angle)), *(np.sinc(angle / np.pi) * half).tolist())
                q[3:] = frames.normalise(frames.multiply(q[3:].tolist(), turn))

    def body_states(self):
        turned = [np.array(frames.matrix(q[3:].tolist())) @ v[3:] for q, v in zip(self.q, self.v, strict=True)]
        return restore_velocities(self.q.copy(), np.hstack([self.v[:, :3], turned]), self.offsets)

    def disable_contact(self):
        pass  # there is none

    def read_back(self):
        bodies, (poses, velocities) = [], self.body_states()
        for i, name in enumerate(self.names):
            (xx, xy, xz), (_, yy, yz), (_, _, zz) = self.inertia[i].tolist()
            inertial = Inertial(
                self.mass[i], tuple((self.centre[i] + self.offsets[i]).tolist()), (xx, yy, zz, xy, xz, yz)
            )
            at, speed = tuple(poses[i].tolist()), tuple(velocities[i].tolist())
            joint = Joint(
                self.trees[name].joints[0], "free", None, Pose(), (0.0, 0.0, 0.0), position=at, velocity=speed
            )
            bodies.append(Body(name, self.trees[name].model, inertial, joint))
        return ReadBack(tuple(bodies), tuple(self.gravity.tolist()), self.dt, unreadable=dict(self.UNREADABLE))
