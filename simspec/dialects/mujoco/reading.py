"""Read ``model.xml`` and its sidecar with the standard library's XML parser: neither the emitter nor MuJoCo (level L0).

It knows the part of MJCF that simspec writes (defaults and classes, nested bodies, one joint and one inertial per body,
primitive geoms, explicit pairs, one keyframe) and refuses, by ValueError, what it does not know.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from simspec.dialects.kit.sidecar import read_sidecar
from simspec.dialects.mujoco import dialect as mjcf
from simspec.dialects.mujoco.surface import CommonLaw, surface
from simspec.formats.kit.passes import restore_frames, tensor
from simspec.world import frames
from simspec.world.types import (
    POSITION_SIZE,
    VELOCITY_SIZE,
    Body,
    HeldPair,
    HeldServo,
    HeldValue,
    Inertial,
    Joint,
    Pose,
    Quaternion,
    ReadBack,
    Shape,
    Surface,
)

UNREADABLE = {"collision_group": "the file carries bit masks and excluded pairs, not the names of groups"}

# MJCF's own conventions, stated here again and not taken from the emitter, so that one error cannot hide another
HALVED = {
    "sphere": (False,),
    "box": (True, True, True),
    "cylinder": (False, True),
    "capsule": (False, True),
    "ellipsoid": (False, False, False),
}
"""Which numbers of a geom's size are half lengths."""
CONE_NAMES = {"elliptic": "elliptic", "pyramidal": "pyramid-inscribed"}
GROUP_IS_VISUAL = {"0": True, "2": True, "3": False, "4": False}

_ELEMENTS = {"inertial", "joint", "geom", "body"}


def read_folder(folder: Path) -> ReadBack:
    """The world as the files in ``folder`` say it. Raises ValueError, KeyError or ParseError for damaged files."""
    beside = read_sidecar(folder)
    reader = _Reader(ElementTree.parse(folder / mjcf.MODEL).getroot(), beside)
    bodies = reader.bodies()
    order = [entry["name"] for entry in beside["bodies"]]
    if sorted(order) != sorted(bodies):
        missing, unknown = sorted(set(order) - set(bodies)), sorted(set(bodies) - set(order))
        raise ValueError(f"{mjcf.MODEL}: bodies missing {missing}, not in the sidecar {unknown}")
    offsets = {entry["name"]: tuple(entry["frame_offset"]) for entry in beside["bodies"] if any(entry["frame_offset"])}
    found = tuple(
        dataclasses.replace(bodies[name], model=model) for name, model in zip(order, beside["models"], strict=True)
    )
    option = reader.section("option").attrib
    return ReadBack(
        restore_frames(found, offsets),
        _vector(option["gravity"]),
        reader.timestep,
        CONE_NAMES[option["cone"]],
        dict(UNREADABLE),
        reader.pairs(),
        reader.servos(),
        reader.settings(),
    )


def _floats(text: str) -> tuple[float, ...]:
    return tuple(float(part) for part in text.split())


def _vector(text: str) -> tuple[float, float, float]:
    x, y, z = _floats(text)
    return (x, y, z)


def _turn(text: str) -> Quaternion:
    w, x, y, z = _floats(text)
    return frames.normalise((w, x, y, z))


class _Reader:
    """One parsed file."""

    def __init__(self, root: ElementTree.Element, beside: Mapping[str, Any]):
        self._root = root
        self._fixed_joints = beside["fixed_joints"]
        if self.section("compiler").attrib["angle"] != "radian":
            raise ValueError("only files with angles in radian are read")
        self.timestep = float(self.section("option").attrib["timestep"])
        defaults = self.section("default")
        self._joint_defaults = self._one(defaults, "joint").attrib
        main = self._one(defaults, "geom").attrib
        self._classes = {
            found.attrib["class"]: {**main, **self._one(found, "geom").attrib} for found in defaults.findall("default")
        }
        key = self._one(self.section("keyframe"), "key")
        self._position, self._velocity = _floats(key.attrib["qpos"]), _floats(key.attrib["qvel"])
        self._nq = self._nv = 0
        self._settings = beside["settings"]
        self._law = CommonLaw.of(self.timestep, beside["settings"])
        self._pair_defaults = self._one(defaults, "pair").attrib

    def section(self, name: str) -> ElementTree.Element:
        return self._one(self._root, name)

    @staticmethod
    def _one(element: ElementTree.Element, name: str) -> ElementTree.Element:
        found = element.findall(name)
        if len(found) != 1:
            raise ValueError(f"<{element.tag}> has {len(found)} <{name}>, not one")
        return found[0]

    def bodies(self) -> dict[str, Body]:
        """Every body by name, in the file's frames; walks without recursion, since chains may be long."""
        found: dict[str, Body] = {}
        waiting: list[tuple[ElementTree.Element, str | None]] = [
            (element, None) for element in reversed(self.section("worldbody"))
        ]
        while waiting:
            element, parent = waiting.pop()
            if element.tag != "body" or {child.tag for child in element} - _ELEMENTS:
                raise ValueError(f"<{element.tag}> holds what is not read: {sorted({child.tag for child in element})}")
            body = self._body(element, parent)
            if body.name in found:
                raise ValueError(f"two bodies are called {body.name!r}")
            found[body.name] = body
            waiting.extend((child, body.name) for child in reversed(element.findall("body")))
        if (self._nq, self._nv) != (len(self._position), len(self._velocity)):
            raise ValueError(
                f"the keyframe holds {len(self._position)} positions and {len(self._velocity)} velocities, "
                f"the joints {self._nq} and {self._nv}"
            )
        return found

    def _body(self, element: ElementTree.Element, parent: str | None) -> Body:
        name = mjcf.world_name(element.attrib["name"])
        place = Pose(_vector(element.attrib["pos"]), _turn(element.attrib["quat"]))
        inertial = Inertial(0.0)
        if element.find("inertial") is not None:
            given = self._one(element, "inertial").attrib
            inertial = Inertial(
                float(given["mass"]),
                _vector(given["pos"]),
                tensor(_vector(given["diaginertia"]), _turn(given["quat"])),
            )
        return Body(
            name,
            "",
            inertial,
            self._joint(element, name, parent, place),
            tuple(self._shape(geom) for geom in element.findall("geom")),
        )

    def _joint(self, element: ElementTree.Element, name: str, parent: str | None, place: Pose) -> Joint:
        if element.find("joint") is None:
            return Joint(self._fixed_joints[name], "fixed", parent, place)
        given = {**self._joint_defaults, **self._one(element, "joint").attrib}
        kind = given["type"]
        if any(_floats(given["pos"])) or float(given["ref"]) != 0.0:
            raise ValueError(f"joint {given['name']!r} is not at its body's origin and zero")
        position = self._position[self._nq : self._nq + POSITION_SIZE[kind]]
        velocity = self._velocity[self._nv : self._nv + VELOCITY_SIZE[kind]]
        self._nq += POSITION_SIZE[kind]
        self._nv += VELOCITY_SIZE[kind]
        if kind == "free":
            position = (*position[:3], *frames.normalise(position[3:7]))
            velocity = (*velocity[:3], *frames.rotate(position[3:7], velocity[3:]))
        elif kind == "ball":
            position = frames.normalise(position)
        velocity_limit, effort_limit = (
            None if rating == mjcf.NO_RATING else rating for rating in _floats(given["user"])
        )
        lower, upper = _floats(given["range"]) if given["limited"] == "true" else (0.0, 0.0)
        return Joint(
            given["name"],
            kind,
            parent,
            Pose() if kind == "free" else place,
            _vector(given["axis"]) if kind in ("hinge", "slide") else (0.0, 0.0, 0.0),
            (lower, upper) if given["limited"] == "true" else None,
            velocity_limit,
            effort_limit,
            damping=float(given["damping"]),
            dry_friction=float(given["frictionloss"]),
            armature=float(given["armature"]),
            spring_stiffness=float(given["stiffness"]),
            spring_rest=float(given["springref"]),
            position=position,
            velocity=velocity,
        )

    def _shape(self, geom: ElementTree.Element) -> Shape:
        given = {**self._classes[geom.attrib["class"]], **geom.attrib}
        kind = given["type"]
        size: tuple[float, ...] = ()
        if kind != "plane":
            size = tuple(
                2.0 * value if halved else value
                for value, halved in zip(_floats(given["size"]), HALVED[kind], strict=True)
            )
        collides = given["contype"] != "0" or given["conaffinity"] != "0"
        surfaces: tuple[Surface, ...] = (self._surface(given, _floats(given["friction"])),) if collides else ()
        red, green, blue, alpha = _floats(given["rgba"])
        return Shape(
            given["name"],
            kind,
            size,
            Pose(_vector(given["pos"]), _turn(given["quat"])),
            "",
            collides,
            GROUP_IS_VISUAL[given["group"]],
            (red, green, blue, alpha),
            surfaces,
        )

    def _surface(self, given: Mapping[str, str], friction: tuple[float, ...], inverse_mass: float = 1.0) -> Surface:
        solref, solimp = _floats(given["solref"]), _floats(given["solimp"])
        return surface(int(given["condim"]), friction, solref, solimp, float(given["margin"]), self._law, inverse_mass)

    def pairs(self) -> tuple[HeldPair, ...]:
        """The explicit pairs, sorted."""
        inverse = self._inverse_masses()
        found = []
        for pair in self.section("contact").findall("pair"):
            given = {**self._pair_defaults, **pair.attrib}
            first, second = sorted((given["geom1"], given["geom2"]))
            one, two, torsion, roll, other_roll = _floats(given["friction"])
            if one != two or roll != other_roll:
                raise ValueError(f"the explicit pair of {first!r} and {second!r} is not isotropic")
            held = self._surface(given, (one, torsion, roll), inverse[first] + inverse[second])
            found.append(HeldPair(first, second, held))
        return tuple(sorted(found, key=lambda held: (held.first, held.second)))

    def settings(self) -> dict[str, HeldValue]:
        """The solver settings that the file itself holds, as ``settings.NAME``, whatever stands beside it."""
        option = self.section("option")
        given = option.attrib
        flags = self._one(option, "flag").attrib
        found: dict[str, HeldValue] = {"solver": given["solver"].lower()}
        found |= {name: int(given[name]) for name in ("iterations", "ls_iterations", "noslip_iterations")}
        found |= {name: float(given[name]) for name in ("tolerance", "ls_tolerance", "impratio")}
        found |= {name: flags[name] == "enable" for name in ("warmstart", "island", "multiccd")}
        if (
            found["impratio"] != self._settings["impratio"]
        ):  # the file has one, whichever of the two settings it comes from
            found["high_impratio"] = found["impratio"]
        return {f"settings.{name}": value for name, value in found.items()}

    def servos(self) -> tuple[HeldServo, ...]:
        """The actuators: position with kp and kv, velocity with kv; all on one joint, without gear."""
        if self._root.find("actuator") is None:
            return ()
        found = []
        for element in self.section("actuator"):
            given = element.attrib
            if element.tag not in ("position", "velocity") or given["ctrllimited"] != "false":
                raise ValueError(f"the actuator {given['name']!r} is not one that is read")
            if _floats(given["gear"]) != (1.0, 0.0, 0.0, 0.0, 0.0, 0.0) or ("kp" in given) != (
                element.tag == "position"
            ):
                raise ValueError(f"the actuator {given['name']!r} has a gear, or no or needless kp")
            limit = None
            if given["forcelimited"] == "true":
                lower, limit = _floats(given["forcerange"])
                if lower != -limit:
                    raise ValueError(f"the effort limit of the actuator {given['name']!r} is not the same both ways")
            found.append(HeldServo(given["joint"], float(given.get("kp", "0")), float(given["kv"]), limit))
        return tuple(found)

    def _inverse_masses(self) -> dict[str, float]:
        """1/m of the body of each geom; 0 of bodies without a joint up to the world."""
        found: dict[str, float] = {}
        waiting = [(body, False) for body in self.section("worldbody").findall("body")]
        while waiting:
            body, moves = waiting.pop()
            moves = moves or body.find("joint") is not None
            inertial = body.find("inertial")
            inverse = 1.0 / float(inertial.attrib["mass"]) if moves and inertial is not None else 0.0
            found.update((geom.attrib["name"], inverse) for geom in body.findall("geom"))
            waiting.extend((child, moves) for child in body.findall("body"))
        return found
