"""A stand-in of gz sim's Python bindings: the functions that simspec calls, as they are documented, over simspec's own oracle.

It does in each step what gz sim's physics system does, in its order: joints are reset, forces taken, poses commanded (in this
step and the next), velocities commanded (in the axes that the link had in the components before), all stepped; then what has
moved by 1e-6 is updated, and forces are cleared. It has no contact and no limits, and dry friction
of one joint alone. The environment variable GZ_STAND_IN selects a fault for a test.
"""

import dataclasses
import datetime
import os
import sys
import time
import xml.etree.ElementTree as ET

import numpy as np
from gz.math7 import Inertiald, Pose3d, Quaterniond, Vector3d
from sdformat14 import JointAxis, JointType

from simspec.dynamics.oracle import Oracle
from simspec.world import frames
from simspec.world.rotations import conjugate, matrices, rotate
from simspec.world.types import Body, Inertial, Physics, Pose
from simspec.world.types import Joint as WorldJoint
from simspec.world.types import World as Scenario

K_NULL_ENTITY = 0
REPORTED = 1e-6
KINDS = {"fixed": "fixed", "revolute": "hinge", "prismatic": "slide"}
FAULT = os.environ.get("GZ_STAND_IN", "")
if FAULT == "no library":
    raise ImportError("libgz-sim8.so.8: cannot open shared object file: No such file or directory")


def _numbers(text):
    return tuple(map(float, text.split()))


def _pose(element):
    if element is None:
        return Pose()
    x, y, z, *turn = _numbers(element.text)
    if element.get("rotation_format") == "quat_xyzw":
        return Pose((x, y, z), (turn[3], *turn[:3]))
    assert turn == [0.0, 0.0, 0.0], "angles are not written"
    return Pose((x, y, z))


class _Components:
    """A world as it was read: the server's components, and its physics."""

    def __init__(self, path):
        world = ET.parse(path).getroot().find("world")
        assert [element.get("filename") for element in world.findall("plugin")] == ["gz-sim-physics-system"]
        physics = world.find("physics")
        assert float(physics.find("real_time_factor").text) == 0.0
        self.gravity = _numbers(world.find("gravity").text)
        self.timestep = int(float(physics.find("max_step_size").text) * 1e9) / 1e9
        self.names, self.axes, self.types = [], {}, {}
        bodies = []
        for model in world.findall("model"):
            self.names.append(("model", model.get("name")))
            bodies += self._model(model)
        self.oracle = Oracle(Scenario("w", tuple(bodies), physics=Physics(self.gravity, self.timestep)))
        self.bodies = bodies
        self.rows = {body.name: row for row, body in enumerate(bodies)}
        layout = self.oracle.layout
        self.q_of = dict(zip([body.name for body in bodies], layout.position, strict=True))
        self.v_of = dict(zip([body.name for body in bodies], layout.velocity, strict=True))
        self.q, self.v = np.zeros(layout.nq), np.zeros(layout.nv)
        for body in bodies:
            if body.joint.kind == "free":
                self.q[self.q_of[body.name]] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        self.poses, self.velocities = self._frames()
        self.effort = np.zeros(layout.nv)
        self.watched, self.resets, self.rates, self.twists = set(), {}, {}, {}
        self.commands, self.again, self.wrenches = {}, set(), []
        self.tells = {}

    def _model(self, model):
        assert _pose(model.find("pose")) == Pose()
        joints = {joint.find("child").text: joint for joint in model.findall("joint")}
        for link in model.findall("link"):
            name, inertial = link.get("name"), link.find("inertial")
            self.names.append(("link", name))
            place = link.find("pose")
            tensor = tuple(
                float(inertial.find("inertia").find(part).text) for part in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            )
            mass = Inertial(float(inertial.find("mass").text), _pose(inertial.find("pose")).position, tensor)
            joint = joints.get(name)
            if joint is None:
                assert _pose(place) == Pose()
                yield Body(
                    name, "m", mass, WorldJoint(name, "free", position=(0, 0, 0, 1, 0, 0, 0), velocity=(0,) * 6), ()
                )
                continue
            self.names.append(("joint", joint.get("name")))
            parent, kind = joint.find("parent").text, joint.get("type")
            assert place.get("relative_to") == (None if parent == "world" else parent)
            assert joint.find("pose") is None
            made = WorldJoint(joint.get("name"), KINDS[kind], None if parent == "world" else parent, _pose(place))
            self.types[joint.get("name")] = JointType(kind)
            if kind != "fixed":
                axis = joint.find("axis")
                made = dataclasses.replace(made, axis=_numbers(axis.find("xyz").text), position=(0.0,), velocity=(0.0,))
                said = {entry.tag: float(entry.text) for part in ("limit", "dynamics") for entry in axis.find(part)}
                said.setdefault("effort", float("inf"))
                self.axes[joint.get("name")] = JointAxis(Vector3d(*made.axis), said)
            yield Body(name, "m", mass, made, ())

    def _frames(self):
        return self.oracle.body_poses(self.q), self.oracle.body_velocities(self.q, self.v)

    def _step(self):
        before = self.q
        self.q, self.v = self.oracle.step(self.q, self.v, self.effort)
        (friction,) = [axis.friction() for axis in self.axes.values()] if len(self.v) == 1 else (0.0,)
        if friction:
            most = friction * self.timestep / self.oracle.mass_matrix(before)[0, 0]
            self.v = np.sign(self.v) * np.maximum(np.abs(self.v) - most, 0.0)
            self.q = before + self.timestep * self.v

    def update(self, paused):
        """An update of the physics system."""
        for name, (place, rate) in self.resets.items():
            self.q[self.q_of[name]] = place if place is not None else self.q[self.q_of[name]]
            self.v[self.v_of[name]] = rate if rate is not None else self.v[self.v_of[name]]
        for name, pose in self.commands.items():
            self.q[self.q_of[name]] = pose
        over, self.again = self.again, set(self.commands)
        for name in over:
            self.commands.pop(name, None)
        for name, (linear, angular) in self.twists.items():
            actual = self.poses[self.rows[name]][3:]
            turn = self.q[self.q_of[name]][3:]
            self.v[self.v_of[name]] = [*rotate(actual, linear), *rotate(conjugate(turn), rotate(actual, angular))]
        for name, force, torque in self.wrenches:
            turn = self.q[self.q_of[name]][3:]
            self.effort[self.v_of[name]] += [*force, *rotate(conjugate(turn), torque)]
        if not paused and FAULT != "still":
            self._step()
        poses, velocities = self._frames()
        moved = np.abs(poses - self.poses).max(axis=1) > REPORTED
        moved |= np.array([name not in self.tells for _, name in enumerate(body.name for body in self.bodies)])
        for row in np.nonzero(moved)[0]:
            self.poses[row], self.velocities[row] = poses[row], velocities[row]
            self.tells[self.bodies[row].name] = True
        self.effort[:] = 0.0
        self.resets, self.twists, self.wrenches = {}, {}, []


class _Entity:
    """The base of the classes of entities: its number, which is 1 + its place among the names."""

    kind = ""

    def __init__(self, entity):
        self._entity = entity

    def entity(self):
        return self._entity

    def _name(self, components):
        return components.names[self._entity - 1][1]

    def valid(self, components):
        return self._entity != K_NULL_ENTITY and components.names[self._entity - 1][0] == self.kind


def _entity(components, kind, name):
    return components.names.index((kind, name)) + 1 if (kind, name) in components.names else K_NULL_ENTITY


class World(_Entity):
    def gravity(self, ecm):
        return Vector3d(*ecm.gravity)

    def model_by_name(self, ecm, name):
        return _entity(ecm, "model", name)


class Model(_Entity):
    kind = "model"

    def link_by_name(self, ecm, name):
        return _entity(ecm, "link", name)

    def joint_by_name(self, ecm, name):
        return _entity(ecm, "joint", name)

    def set_world_pose_cmd(self, ecm, pose):
        root = "b" + self._name(ecm)[1:]
        ecm.commands[root] = np.array([*pose.pos().values, *pose.rot().values])


class Link(_Entity):
    kind = "link"

    def _row(self, ecm):
        return ecm.rows[self._name(ecm)]

    def enable_velocity_checks(self, ecm, enable=True):
        ecm.watched.add(self._name(ecm))

    def world_pose(self, ecm):
        x, y, z, *turn = ecm.poses[self._row(ecm)]
        return Pose3d(Vector3d(x, y, z), Quaterniond(*turn))

    def _reported(self, ecm, part):
        return Vector3d(*ecm.velocities[self._row(ecm)][part]) if self._name(ecm) in ecm.watched else None

    def world_linear_velocity(self, ecm):
        return self._reported(ecm, slice(0, 3))

    def world_angular_velocity(self, ecm):
        return self._reported(ecm, slice(3, 6))

    def set_linear_velocity(self, ecm, velocity):
        ecm.twists.setdefault(self._name(ecm), [np.zeros(3), np.zeros(3)])[0] = velocity.values

    def set_angular_velocity(self, ecm, velocity):
        ecm.twists.setdefault(self._name(ecm), [np.zeros(3), np.zeros(3)])[1] = velocity.values

    def add_world_wrench(self, ecm, force, torque):
        """At the link's origin, which has to be the centre of mass of a free body."""
        name = self._name(ecm)
        assert ecm.bodies[ecm.rows[name]].joint.kind == "free"
        ecm.wrenches.append((name, force.values, torque.values))

    def world_inertial(self, ecm):
        row = self._row(ecm)
        mass = ecm.bodies[row].inertial
        x, y, z, *turn = ecm.poses[row]
        centre = frames.compose(Pose((x, y, z), tuple(turn)), Pose(mass.centre_of_mass))
        xx, yy, zz, xy, xz, yz = mass.inertia
        axes = matrices(np.array(turn))
        given = axes @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ axes.T
        return Inertiald(mass.mass, Pose3d(Vector3d(*centre.position), Quaterniond(*centre.quaternion)), given)


class Joint(_Entity):
    kind = "joint"

    def _body(self, ecm):
        return "b" + self._name(ecm)[1:]

    def _joint(self, ecm):
        return ecm.bodies[ecm.rows[self._body(ecm)]].joint

    def parent_link_name(self, ecm):
        return self._joint(ecm).parent or "world"

    def child_link_name(self, ecm):
        return self._body(ecm)

    def type(self, ecm):
        return ecm.types[self._name(ecm)]

    def pose(self, ecm):
        return Pose3d(Vector3d(), Quaterniond())

    def axis(self, ecm):
        return [ecm.axes[self._name(ecm)]]

    def enable_position_check(self, ecm, enable=True):
        ecm.watched.add(("position", self._name(ecm)))

    def enable_velocity_check(self, ecm, enable=True):
        ecm.watched.add(("velocity", self._name(ecm)))

    def position(self, ecm):
        return ecm.q[ecm.q_of[self._body(ecm)]].tolist() if ("position", self._name(ecm)) in ecm.watched else None

    def velocity(self, ecm):
        return ecm.v[ecm.v_of[self._body(ecm)]].tolist() if ("velocity", self._name(ecm)) in ecm.watched else None

    def reset_position(self, ecm, positions):
        ecm.resets[self._body(ecm)] = (positions, ecm.resets.get(self._body(ecm), (None, None))[1])

    def reset_velocity(self, ecm, velocities):
        ecm.resets[self._body(ecm)] = (ecm.resets.get(self._body(ecm), (None, None))[0], velocities)

    def set_force(self, ecm, forces):
        ecm.effort[ecm.v_of[self._body(ecm)]] = forces


if FAULT == "old":
    del Link.world_inertial


def world_entity(ecm):
    return len(ecm.names) + 1


class _Info:
    def __init__(self, timestep):
        self.dt = datetime.timedelta(seconds=timestep)
        self.paused = False


class _Server:
    def __init__(self, fixture):
        self._fixture = fixture

    def run(self, blocking, iterations, paused):
        assert blocking is True
        assert paused is False, "such a run never ends"
        fixture = self._fixture
        for step in range(iterations):
            fixture.before(_Info(fixture.components.timestep), fixture.components)
            if FAULT == "hangs":
                time.sleep(1000.0)
            if FAULT == "dies":
                os._exit(7)
            if FAULT == "garbage":
                sys.stdout.write("\\x00\\xff not for anyone\\n")
                fixture.components.v[:] = np.nan
            if FAULT == "stops" and step:
                return False
            fixture.components.update(paused)
            fixture.after(_Info(fixture.components.timestep), fixture.components)
        return True


class TestFixture:
    __test__ = False

    def __init__(self, path):
        self.components = _Components(path)

    def on_pre_update(self, call):
        self.before = call

    def on_post_update(self, call):
        self.after = call

    def finalize(self):
        self.final = True

    def server(self):
        assert self.final
        return _Server(self)
