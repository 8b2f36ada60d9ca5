"""A stand-in for Webots: reads a .wbt, steps it by the Open Dynamics Engine as Webots does, without contact, and answers the
stand-in for its library of controllers. ``python world.py [OPTIONS] WORLD``; ``STAND_IN`` names what it does wrong."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import socket
import sys
import time
from pathlib import Path

import numpy as np

from simspec.formats.wbt.format import NODES
from simspec.formats.wbt.reading import WbtNode, parse

REAL, POINTER = ctypes.c_double, ctypes.c_void_p
SIZES = {"Vec2f": 2, "Vec3f": 3, "Rotation": 4, "Color": 3}
F_MAX = 5
"""ODE's number of a motor's largest effort; its speed is zero."""
FAULT = os.environ.get("STAND_IN", "")


def ode():
    """The library in double precision, with what is returned and taken."""
    lib = ctypes.CDLL(ctypes.util.find_library("ode"))
    lib.dInitODE2(0)
    made = "dWorldCreate dBodyCreate dJointCreateHinge dJointCreateSlider dJointCreateBall"
    for name in made.split():
        getattr(lib, name).restype = POINTER
    lib.dBodyCreate.argtypes = (POINTER,)
    for name in ("Hinge", "Slider", "Ball"):
        getattr(lib, f"dJointCreate{name}").argtypes = (POINTER, POINTER)
    for name, count in {
        "dWorldSetGravity": 3, "dWorldSetERP": 1, "dWorldSetCFM": 1, "dBodySetPosition": 3, "dBodySetLinearVel": 3,
        "dBodySetAngularVel": 3, "dBodyAddForce": 3, "dBodyAddTorque": 3, "dJointSetHingeAnchor": 3, "dJointSetHingeAxis": 3,
        "dJointSetSliderAxis": 3, "dJointSetBallAnchor": 3, "dWorldStep": 1,
    }.items():  # fmt: skip
        getattr(lib, name).argtypes = (POINTER, *[REAL] * count)
    for name in ("Hinge", "Slider"):
        getattr(lib, f"dJointSet{name}Param").argtypes = (POINTER, ctypes.c_int, REAL)
    lib.dJointAttach.argtypes = (POINTER, POINTER, POINTER)
    lib.dBodySetRotation.argtypes = (POINTER, ctypes.POINTER(REAL))
    lib.dBodySetMass.argtypes = (POINTER, POINTER)
    lib.dMassSetParameters.argtypes = (POINTER, *[REAL] * 10)
    for name in ("Position", "Rotation", "LinearVel", "AngularVel"):
        getattr(lib, f"dBodyGet{name}").restype = ctypes.POINTER(REAL)
        getattr(lib, f"dBodyGet{name}").argtypes = (POINTER,)
    return lib


def rotation(x, y, z, angle):
    """A matrix of an axis and an angle."""
    axis = np.array([x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.cos(angle) * np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * np.outer(axis, axis)


class Solid:
    """A Solid with where it stands at first; ``top``: the one whose body it is a part of, None of what cannot move."""

    def __init__(self, node, above, turn, place, joint):
        self.node, self.turn, self.place, self.joint, self.above = node, turn, place, joint, above
        moving = node.node("physics") is not None
        carried = joint is None and above is not None and above.top is not None
        self.top = above.top if carried else self if moving else None
        self.parts = []
        self.body = None


class World:
    """The world of a file."""

    def __init__(self, path):
        self.document = parse(Path(path).read_text(encoding="utf-8"), "world.wbt")
        self.lib = ode()
        info = self.document.only("WorldInfo")
        self.milliseconds, self.time = info.number("basicTimeStep"), 0.0
        self.world = self.lib.dWorldCreate()
        self.lib.dWorldSetGravity(self.world, 0.0, 0.0, -info.number("gravity"))
        self.lib.dWorldSetERP(self.world, info.number("ERP"))
        self.lib.dWorldSetCFM(self.world, info.number("CFM"))
        self.solids = {}
        for node in self.document.nodes:
            if node.kind in ("Solid", "Pose"):
                self._walk(node, None, np.eye(3), np.zeros(3), None)
        self._mass()
        for solid in self.solids.values():
            self._hold(solid)
        self.nodes, self.fields = [None], [None]

    def _walk(self, node, above, turn, place, joint):
        place = place + turn @ node.numbers("translation", 3)
        turn = turn @ rotation(*node.numbers("rotation", 4))
        if node.kind == "Solid":
            above = self.solids[node] = Solid(node, above, turn, place, joint)
            if above.top is not None:
                above.top.parts.append(above)
        for child in node.nodes("children"):
            if child.kind in ("Solid", "Pose"):
                self._walk(child, above, turn, place, None)
            elif child.kind.endswith("Joint"):
                self._walk(child.node("endPoint"), above, turn, place, child)

    def _mass(self):
        """One body of each group, at its centre of mass, with its inertia."""
        lib = self.lib
        for top in (solid for solid in self.solids.values() if solid.top is solid):
            given = []
            for part in top.parts:
                physics = part.node.node("physics")
                if physics is None:
                    continue
                xx, yy, zz, xy, xz, yz = physics.numbers("inertiaMatrix", 6)
                tensor = part.turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ part.turn.T
                given.append(
                    (physics.number("mass"), part.place + part.turn @ physics.numbers("centerOfMass", 3), tensor)
                )
            mass = sum(entry for entry, _, _ in given)
            top.centre = sum(entry * at for entry, at, _ in given) / mass
            whole = np.zeros((3, 3))
            for entry, at, tensor in given:
                away = at - top.centre
                whole += tensor + entry * (away @ away * np.eye(3) - np.outer(away, away))
            local = top.turn.T @ whole @ top.turn
            actual = (REAL * 32)()
            rows = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
            lib.dMassSetParameters(actual, mass, 0.0, 0.0, 0.0, *(local[row] for row in rows))
            top.body = lib.dBodyCreate(self.world)
            lib.dBodySetMass(top.body, actual)
            lib.dBodySetPosition(top.body, *top.centre)
            lib.dBodySetRotation(top.body, (REAL * 12)(*np.hstack([top.turn, np.zeros((3, 1))]).ravel()))
            lib.dBodySetLinearVel(top.body, *top.node.numbers("linearVelocity", 3))
            lib.dBodySetAngularVel(top.body, *top.node.numbers("angularVelocity", 3))

    def _hold(self, solid):
        """The joint of a Solid."""
        if solid.joint is None:
            return
        lib, given = self.lib, solid.joint.node("jointParameters")
        kind = solid.joint.kind.removesuffix("Joint")
        made = getattr(lib, f"dJointCreate{kind}")(self.world, None)
        top = solid.above.top
        lib.dJointAttach(made, solid.body, top.body if top is not None else None)
        around = solid.above
        if kind != "Slider":
            getattr(lib, f"dJointSet{kind}Anchor")(made, *(around.place + around.turn @ given.numbers("anchor", 3)))
        if kind == "Ball":
            return
        getattr(lib, f"dJointSet{kind}Axis")(made, *(around.turn @ given.numbers("axis", 3)))
        set_single = getattr(lib, f"dJointSet{kind}Param")
        low, high, at = given.number("minStop"), given.number("maxStop"), given.number("position")
        for number, value in [(0, low - at), (1, high - at)] if low != high else []:
            set_single(made, number, value)
        set_single(made, F_MAX, given.number("staticFriction"))

    # --- requests -----------------------------------------------------------------------------------------------------

    def frame(self, solid):
        """Where a Solid is now, and how it is turned."""
        if solid.top is None:
            return solid.place, solid.turn
        lib, top = self.lib, solid.top
        turned = np.array(lib.dBodyGetRotation(top.body)[:12]).reshape(3, 4)[:, :3] @ top.turn.T
        return np.array(lib.dBodyGetPosition(top.body)[:3]) + turned @ (solid.place - top.centre), turned @ solid.turn

    def number_of(self, table, what):
        """The number of a node or a field, which stands for a pointer."""
        if what is None:
            return 0
        if what not in table:
            table.append(what)
        return table.index(what)

    def answer(self, verb, words):
        """The line that answers a line."""
        if verb == "step":
            self.lib.dWorldStep(self.world, float(words[0]) / 1e3)
            self.time += float(words[0]) / 1e3
            return "-1" if FAULT == "ends" and self.time > 0.01 else "0"
        if verb in ("time", "timestep"):
            return repr(
                {"time": self.time + (0.001 if FAULT == "stepped" else 0.0), "timestep": self.milliseconds}[verb]
            )
        if verb == "root":
            return str(self.number_of(self.nodes, "root"))
        if verb == "def":
            return str(self.number_of(self.nodes, next((n for n in self.document.walk() if n.label == words[0]), None)))
        if verb in ("name", "kind", "count", "value"):
            return self.of_field(verb, *self.fields[int(words[0])], *map(int, words[1:]))
        node = self.nodes[int(words[0])]
        return self.of_root(verb) if node == "root" else self.of_node(verb, node, words[1:])

    def of_root(self, verb):
        kinds = {"fields": "1", "field": str(self.number_of(self.fields, ("root", "children", "MFNode")))}
        return kinds[verb]

    def of_node(self, verb, node, words):
        known = [name for name in NODES[node.kind] if name not in ("linearVelocity", "angularVelocity")]
        if FAULT == "newer" and node.kind == "Solid":
            known.append("colour")
        if verb in ("label", "type"):
            return {"label": node.label, "type": node.kind}[verb]
        if verb == "fields":
            return str(len(known))
        if verb == "field":
            name = known[int(words[0])]
            kind = "SFFloat" if name == "colour" else NODES[node.kind][name][0]
            return str(self.number_of(self.fields, (node, name, kind)))
        solid = self.solids[node]
        if verb in ("position", "orientation"):
            place, turn = self.frame(solid)
            return numbers(place if verb == "position" else turn.ravel())
        if verb == "velocity":
            lib = self.lib
            return numbers([*lib.dBodyGetLinearVel(solid.top.body)[:3], *lib.dBodyGetAngularVel(solid.top.body)[:3]])
        if solid is not solid.top or words[3] != "0":
            raise ValueError("a force on what is no topmost Solid, or in its own axes")
        push = {"force": self.lib.dBodyAddForce, "torque": self.lib.dBodyAddTorque}[verb]
        push(solid.body, *map(float, words[:3]))
        return "0"

    def of_field(self, verb, node, name, kind, index=0):
        if verb in ("name", "kind"):
            return {"name": name, "kind": kind}[verb]
        values = (
            list(self.document.nodes)
            if node == "root"
            else [0.5]
            if name == "colour"
            else list(node.field(name).values)
        )
        if FAULT == "mass" and name == "mass":
            values = [value * 1.001 for value in values]
        size = SIZES.get(kind[2:], 1)
        if verb == "count":
            return str(len(values) // size)
        if size > 1:
            return numbers(values[size * index : size * (index + 1)])
        value = values[index]
        if isinstance(value, WbtNode) or value is None:
            return str(self.number_of(self.nodes, value))
        return (
            repr(value)
            if isinstance(value, float) and kind[2:] == "Float"
            else str(int(value))
            if kind[2:] != "String"
            else value
        )


def numbers(values):
    """As text that nothing is lost in."""
    return " ".join(repr(float(value)) for value in values)


def main(words):
    """Load the world, say where, and answer."""
    if FAULT == "dies":
        print("ERROR: cannot find a screen", flush=True)
        return 3
    options = dict(word.removeprefix("--").partition("=")[::2] for word in words[:-1])
    expected = {"batch", "mode", "minimize", "no-rendering", "stdout", "stderr", "extern-urls", "port"}
    if set(options) != expected:
        print(f"ERROR: options {sorted(options)}", flush=True)
        return 2
    world = World(words[-1])
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]  # another than the requested one, as where that is taken
        print(f"WARNING: could not listen on port {options['port']}. Using port {port} instead.", flush=True)
        if FAULT == "hangs":
            time.sleep(600)
        address = "tcp://nowhere" if FAULT == "garbage" else f"ipc://{port}/simspec%20supervisor"
        print(address, flush=True)
        if FAULT == "garbage":
            return 0
        channel, _ = server.accept()
    with channel, channel.makefile("rw", encoding="utf-8", newline="\n") as file:
        for line in file:
            verb, *words = line.split()
            if FAULT == "dies in a step" and verb == "step":
                os._exit(9)
            file.write(world.answer(verb, words) + "\n")
            file.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
