"""Toy: an engine for plain URDF, written from ``docs/design/adding-an-engine.md`` alone: fixed joints, hinges and
free roots."""

from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np

from simspec.contact import Rules
from simspec.dialects.urdf.sidecar import UrdfSidecar
from simspec.engines.kit.arrays import empty_contacts, restore_velocities
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.support.declarations import EXACT, never
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.types import Body, Inertial, Joint, Pose, ReadBack

KINDS = {"fixed": ("fixed", 0, 0), "continuous": ("hinge", 1, 1), "free": ("free", 7, 6)}  # numbers in q and in v
HAS = "joint.fixed joint.hinge joint.free joint.position joint.velocity body.inertia body.inertia.full".split()  # noqa: SIM905
MORE = ("physics.gravity", "physics.timestep", "physics.integrator")
NONE, WHY = np.zeros(3), "Toy does not expose it"


def skew(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def numbers(element, *names):
    return NONE if element is None else np.array([float(x) for name in names for x in element.get(name).split()])


def place(element):
    """Position and rotation of an <origin>."""
    origin = element.find("origin")
    return numbers(origin, "xyz"), np.array(frames.matrix(frames.from_rpy(*numbers(origin, "rpy").tolist())))


class Toy(Engine):
    NAME, TITLE, DIALECT, DISTRIBUTION, EXTRA = "toy", "Toy", "urdf", "toy_engine", "toy"
    SUPPORT = {feature: EXACT if feature in (*HAS, *MORE) else never("Toy knows nothing of it") for feature in Feature}
    SETTINGS, RULES, LAYERS = {}, Rules("max", "max"), False
    UNREADABLE = {"control.native": WHY, "collision_group": WHY}
    LACKS = dict.fromkeys(set(Capability) - {Capability.CONTACT_OFF, Capability.CONTACTS}, WHY)
    LACKS[Capability.MASS_MATRIX] = "Toy gives motion only"

    def load(self, folder, sidecar):
        given = UrdfSidecar.of(sidecar)
        self.gravity, self.dt = np.array(given.gravity), given.timestep
        trees, q, v = {}, [], []
        for tree in given.instances:
            robot = ElementTree.parse(folder / tree.file).getroot()
            joints = {joint.find("child").get("link"): joint for joint in robot.iter("joint")}
            names, start = dict(zip([*tree.bodies], tree.joints, strict=True)), [*tree.position]
            speeds = [*tree.velocity]
            links = list(robot.iter("link"))[0 if tree.free else 1 :]
            here = dict(zip([link.get("name") for link in links], names, strict=True))
            for link, name in zip(links, names, strict=True):
                joint, inertial = joints.get(link.get("name")), link.find("inertial")
                # another kind is refused by KeyError
                kind, size, speed = KINDS["free" if joint is None else joint.get("type")]
                part = SimpleNamespace(name=name, model=tree.model, joint=names[name], kind=kind, parent=None)
                part.r, part.R, part.axis, part.m, part.c, part.I = NONE, np.eye(3), NONE, 0.0, NONE, np.zeros((3, 3))
                part.start, start = start[:size], start[size:]
                part.speed, speeds = speeds[:speed], speeds[speed:]
                if joint is not None:
                    part.parent, (part.r, part.R) = here.get(joint.find("parent").get("link")), place(joint)
                    part.axis = numbers(joint.find("axis"), "xyz")
                if inertial is not None:
                    part.c, turn = place(inertial)
                    (part.m,) = numbers(inertial.find("mass"), "value")
                    actual = numbers(inertial.find("inertia"), "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
                    part.I = turn @ actual[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]] @ turn.T
                trees[name] = part
        self.parts = [trees[body.name] for body in given.bodies]
        for part, body in zip(self.parts, given.bodies, strict=True):
            part.offset = np.array(body.frame_offset)
            part.q, part.v = (slice(len(x), len(x) + len(y)) for x, y in ((q, part.start), (v, part.speed)))
            q, v = q + part.start, v + part.speed
        self.set_state(q, v)

    def motion(self):
        """By body: position, rotation, Jacobians of turning and of the origin, velocities, accelerations without effort."""
        nothing = np.zeros((3, len(self.v)))
        known = {None: (NONE, np.eye(3), nothing, nothing, NONE, NONE, NONE, NONE)}
        for part in self.parts:
            p, R, Jw, Jv, w, v, aw, av = known[part.parent]
            q, speed = self.q[part.q], self.v[part.v]
            Jw, Jv = Jw.copy(), Jv.copy()
            if part.kind == "free":
                p, R, v = q[:3], np.array(frames.matrix(q[3:].tolist())), speed[:3]
                w, Jv[:, part.v], Jw[:, part.v] = R @ speed[3:], np.eye(3, 6), np.hstack([np.zeros((3, 3)), R])
            else:
                r, R = R @ part.r, R @ part.R
                p, Jv, v = p + r, Jv - skew(r) @ Jw, v + skew(w) @ r
                av = av + skew(aw) @ r + skew(w) @ (skew(w) @ r)
                if part.kind == "hinge":
                    turned, k = R @ part.axis, skew(part.axis)
                    w, aw = w + turned * speed[0], aw + skew(w) @ turned * speed[0]
                    R = R @ (np.eye(3) + np.sin(q[0]) * k + (1.0 - np.cos(q[0])) * k @ k)
                    Jw[:, part.v] = turned[:, None]
            known[part.name] = p, R, Jw, Jv, w, v, aw, av
        return [known[part.name] for part in self.parts]

    def step(self, count, effort=None):
        for _ in range(count):
            M, force = np.zeros((len(self.v),) * 2), np.zeros(len(self.v)) if effort is None else np.array(effort)
            for part, (_, R, Jw, Jv, w, _, aw, av) in zip(self.parts, self.motion(), strict=True):
                c, inertia = R @ part.c, R @ part.I @ R.T
                J, a = Jv - skew(c) @ Jw, av + skew(aw) @ c + skew(w) @ (skew(w) @ c) - self.gravity
                M += part.m * J.T @ J + Jw.T @ inertia @ Jw
                force -= part.m * J.T @ a + Jw.T @ (inertia @ aw + skew(w) @ (inertia @ w))
            self.v = self.v + self.dt * np.linalg.solve(M, force)
            for part in self.parts:
                q, way = self.q[part.q], self.dt * self.v[part.v]
                q[: min(3, len(way))] += way[:3]
                if part.kind == "free":
                    half = np.linalg.norm(way[3:]) / 2.0
                    turn = (float(np.cos(half)), *(np.sinc(half / np.pi) / 2.0 * way[3:]).tolist())
                    q[3:] = frames.normalise(frames.multiply(q[3:].tolist(), turn))

    def body_states(self):
        rows = np.array([[*p, *frames.from_matrix(R.tolist()), *v, *w] for p, R, _, _, w, v, _, _ in self.motion()])
        return restore_velocities(rows[:, :7], rows[:, 7:], np.array([part.offset for part in self.parts]))

    def set_state(self, q, v):
        self.q, self.v = np.array(q, dtype=float), np.array(v, dtype=float)

    def get_state(self):
        return self.q.copy(), self.v.copy()

    def disable_contact(self):
        pass  # it has none

    def contacts(self):
        return empty_contacts()

    def read_back(self):
        bodies, offsets = [], {None: NONE} | {part.name: part.offset for part in self.parts}
        for part, *state in zip(self.parts, *(rows.tolist() for rows in self.body_states()), strict=True):
            if part.kind != "free":
                state = self.q[part.q].tolist(), self.v[part.v].tolist()
            (xx, xy, xz), (_, yy, yz), (_, _, zz) = part.I.tolist()
            origin = Pose(tuple((part.r + offsets[part.parent]).tolist()), frames.from_matrix(part.R.tolist()))
            joint = (part.joint, part.kind, part.parent, origin, tuple(part.axis.tolist()))
            inertial = Inertial(part.m, tuple((part.c + part.offset).tolist()), (xx, yy, zz, xy, xz, yz))
            given = Joint(*joint, position=tuple(state[0]), velocity=tuple(state[1]))
            bodies.append(Body(part.name, part.model, inertial, given))
        return ReadBack(tuple(bodies), tuple(self.gravity.tolist()), self.dt, unreadable=dict(self.UNREADABLE))
