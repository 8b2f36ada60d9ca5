"""Random scenarios in the language: everything it has, drawn by a seed. Any of them must compile, verify and run, or be refused
by an engine with a named cause."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any

Data = dict[str, Any]

SPRING: Data = {"time_constant": 0.02, "damping_ratio": 1.0}
PALETTES: tuple[Data, ...] = (
    {"materials": {"rubber": {"friction": 0.8}, "ice": {}, "steel": {"friction": 0.3}}, "combine": "max"},
    {
        "materials": {"rubber": {"friction": 0.8}, "steel": {"friction": 0.3}, "ghost": {"friction": 0.3}},
        "pairs": [
            {"between": ["rubber", "steel"], "friction": 0.5},
            {"between": ["ghost", "steel"], "collide": False},
        ],
    },
    {"materials": {"ball": {"restitution": 0.5}, "wall": {"restitution": 0.8}}, "combine": "product"},
    {
        "materials": {"a": {"friction": 0.4, "restitution": 0.3}, "b": {"friction": 0.6}, "c": {}},
        "pairs": [
            {"between": ["a", "b"], "friction": 0.5, "restitution": 0.2},
            {"between": ["c", "c"], "collide": False},
        ],
    },
    {
        "materials": {
            "felt": {"friction": 0.5, "torsional_friction": 0.005, "rolling_friction": 0.001},
            "wood": {"friction": 0.5},
        }
    },
    {"materials": {"slick": {}}},
    {"materials": {"slick": {}, "soft": {}}, "pairs": [{"between": ["soft", "soft"], "hardness": SPRING}]},
    {"materials": {"rubber": {"friction": 0.5}}, "friction_cone": "pyramid-circumscribed"},
    {"materials": {"rubber": {"friction": 0.5}}, "friction_cone": "pyramid-inscribed"},
    {"materials": {"hard": {"friction": 0.3}}, "hardness": "native"},
)
"""Contact laws: few, so that what is measured of them is measured once."""


class Draw:
    """A spec's random choices."""

    def __init__(self, seed: int):
        self._random = random.Random(f"simspec random world {seed}")
        self._light = random.Random(f"simspec random world {seed}, light")  # leaves the others' draws as they were
        self.seed = seed
        self.bodies: Data = {}
        self.palette = self.choice(PALETTES[:6] if seed % 4 else PALETTES)
        self.materials = list(self.palette["materials"])
        self.groups: set[str] = set()
        self.models: Data = {}

    def choice(self, choices: Any) -> Any:
        return self._random.choice(list(choices))

    def chance(self, share: float) -> bool:
        return self._random.random() < share

    def number(self, low: float, high: float) -> float:
        return round(self._random.uniform(low, high), 4)

    def count(self, low: int, high: int) -> int:
        return self._random.randint(low, high)

    def vector(self, reach: float) -> list[float]:
        return [self.number(-reach, reach) for _ in range(3)]

    def turn(self) -> Data:
        if self.chance(0.5):
            return {"rpy": self.vector(3.0)}
        w, x, y, z = (self._random.gauss(0.0, 1.0) for _ in range(4))
        length = math.sqrt(w * w + x * x + y * y + z * z)
        return {"quat": [w / length, x / length, y / length, z / length]}

    def pose(self, reach: float) -> Data:
        found: Data = {"xyz": self.vector(reach)}
        return {**found, **self.turn()} if self.chance(0.7) else found

    # --- parts ----------------------------------------------------------------------------------------------------

    def shape(self, reach: float = 0.15, density: bool = False) -> Data:
        kind = self.choice(("sphere", "box", "box", "cylinder", "capsule"))
        if self.seed % 10 == 9:  # PyBullet has none: the others are seen with them
            kind = self.choice((kind, "ellipsoid"))
        size: Callable[[], float] = lambda: self.number(0.02, 0.15)  # noqa: E731
        sizes = {
            "sphere": lambda: {"radius": size()},
            "box": lambda: {"size": [size(), size(), size()]},
            "cylinder": lambda: {"radius": size(), "length": 2 * size()},
            "capsule": lambda: {"radius": size() / 2, "length": 2 * size()},
            "ellipsoid": lambda: {"radii": [size(), size(), size()]},
        }
        found: Data = {kind: sizes[kind](), "pose": self.pose(reach)}
        if self.chance(0.8) or len(self.materials) > 1:
            found["material"] = self.choice(self.materials)
        if density:
            found["density"] = self.number(300.0, 3000.0)
        elif self.chance(0.15):
            found["collision"] = False
        if self.chance(0.2) and found.get("collision", True):
            found["visual"] = False
        if self.chance(0.3):
            found["colour"] = [self.number(0.0, 1.0) for _ in range(self.count(3, 4))]
        if not found.get("collision", True):
            found.pop("material", None)
        return found

    def mass(self) -> Data:
        """Mass, centre and inertia of its own, a full tensor as often as not."""
        mass = self.number(0.3, 3.0)
        parts = [mass * self.number(0.002, 0.02) for _ in range(3)]
        found: Data = {
            "mass": mass,
            "inertia": {"principal": [parts[1] + parts[2], parts[0] + parts[2], parts[0] + parts[1]]},
        }
        if self.chance(0.6):
            found["inertia"].update(self.turn())
        if self.chance(0.6):
            found["centre_of_mass"] = self.vector(0.1)
        return found

    def matter(self, shapes: int) -> Data:
        """Shapes, and where the mass comes from."""
        way = self.choice(("own", "own", "density", "mass")) if shapes else "own"
        found: Data = {"shapes": [self.shape(density=way == "density") for _ in range(shapes)]} if shapes else {}
        if way == "own":
            return {**found, **self.mass()}
        if way == "mass":
            found["mass"] = self.number(0.3, 3.0)
        if way == "mass" and not any(shape.get("collision", True) for shape in found["shapes"]):
            return {**found, **self.mass()}
        return found

    def joint(self, kind: str) -> Data:
        found: Data = {"type": kind, "origin": self.pose(0.3)}
        if kind in ("hinge", "slide"):
            reach = 1.5 if kind == "hinge" else 0.3
            found["axis"] = self.choice(([0, 0, 1], [0, 1, 0], [1, 0, 0], self.vector(1.0)))
            position = self.number(-reach / 2, reach / 2)
            found["position"], found["velocity"] = position, self.number(-0.5, 0.5)
            limits: Data = {}
            if self.chance(0.5):
                limits["position"] = [position - self.number(0.2, reach), position + self.number(0.2, reach)]
            if self.chance(0.3):
                limits["velocity"] = self.number(1.0, 5.0)
            if self.chance(0.3):
                limits["effort"] = self.number(10.0, 100.0)
            if limits:
                found["limits"] = limits
            if self.chance(0.2) and self.seed % 3 == 0:
                found["dry_friction"] = self.number(0.05, 0.5)
            if self.chance(0.2) and self.seed % 5 == 1:
                found["armature"] = self.number(0.01, 0.1)
        elif kind == "ball":
            found["position"] = self.turn()
            found["velocity"] = self.vector(0.5)
        if kind != "fixed":
            if self.chance(0.5):
                found["damping"] = self.number(0.01, 0.2)
            if self.chance(0.3):
                found["spring"] = {"stiffness": self.number(0.5, 5.0)}
                if kind != "ball" and self.chance(0.5):
                    found["spring"]["rest"] = self.number(-0.3, 0.3)
        return found

    def group(self, body: Data) -> None:
        if self.chance(0.3):
            body["collision_group"] = self.choice(("alpha", "beta"))
            self.groups.add(body["collision_group"])

    # --- bodies ---------------------------------------------------------------------------------------------------

    def ground(self) -> None:
        if self.chance(0.1):
            return
        material = {"material": self.choice(self.materials)}
        if self.chance(0.5):
            shapes = [{"plane": {}, **material}]
        else:
            shapes = [{"box": {"size": [8, 8, 0.4]}, "pose": {"xyz": [0, 0, -0.2]}, **material}]
        if self.chance(0.4):
            post = {
                "box": {"size": [0.2, 0.2, 1]},
                "pose": {"xyz": [3, 3, 0.5]},
                "material": self.choice(self.materials),
            }
            shapes.append(post)
        self.bodies["ground"] = {"fixed": True, "shapes": shapes}
        self.group(self.bodies["ground"])

    def loose(self, number: int) -> None:
        body: Data = {
            "pose": {"xyz": [1.5 * number, 0, 1.5], **self.turn()},
            **self.matter(self.count(1, 3)),
        }
        if self.chance(0.5):
            body["velocity"] = {"linear": self.vector(1.0), "angular": self.vector(2.0)}
        if self.chance(0.2):
            body["array"] = {"line": self.count(2, 3), "step": [0, 1.5, 0]}
        self.group(body)
        self.bodies[f"loose{number}"] = body

    def tree(self, number: int) -> None:
        """Two to five bodies; the root is fixed, free, or on a joint to the world."""
        names = [f"tree{number}_{k}" for k in range(self.count(2, 5))]
        place = {"xyz": [1.5 * number, -3, 1.5], **self.turn()}
        for k, name in enumerate(names):
            body = self.matter(self.count(0, 2))
            kind = self.choice(("hinge", "hinge", "slide", "ball", "fixed"))
            if k == 0:
                root = self.choice(("fixed", "free", "hinge", "slide", "ball"))
                if root == "fixed":
                    body.update(fixed=True, pose=place)
                elif root == "free":
                    body["pose"] = place
                else:
                    body["joint"] = {**self.joint(root), "origin": place}
            else:
                body.update(parent=names[self.count(0, k - 1)], joint=self.joint(kind))
            self.group(body)
            self.bodies[name] = body
        self.lighten(names)
        self.several(names)
        if self.chance(0.25):  # the same as a placed model, perhaps several times
            bodies = {name: self.bodies.pop(name) for name in names}
            root = bodies[names[0]]
            model: Data = {"bodies": bodies, "pose": {"xyz": [0, -3 * number, 0.2], **self.turn()}}
            if root.get("fixed") and self.chance(0.5):
                root.pop("fixed")
                model["fixed"] = self.chance(0.5)
                if "mass" not in root and not any("density" in entry for entry in root.get("shapes", ())):
                    root.update(self.mass())
            if self.chance(0.3):
                model["array"] = {"ring": self.count(2, 3), "radius": 4.0, "face": self.chance(0.5)}
            self.models[f"model{number}"] = model

    def several(self, names: list[str]) -> None:
        """Give some bodies on a hinge or slide a further joint: two hinges make a universal joint, a ball ends."""
        for name in names[1:]:
            joint = self.bodies[name].get("joint", {})
            if joint.get("type") not in ("hinge", "slide") or self._light.random() < 0.7:
                continue
            further: Data = {
                "hinge": {"type": "hinge", "axis": [0, 1, 0]},
                "slide": {"type": "slide", "axis": [0, 1, 0], "damping": round(self._light.uniform(0.1, 0.5), 4)},
                "ball": {"type": "ball", "velocity": [0.3, -0.2, 0.1]},
            }
            kinds = ("hinge", "slide") if joint["type"] == "hinge" else ("hinge", "slide", "ball")
            second = {**further[self._light.choice(kinds)], "name": f"{name}_second", "origin": {"xyz": [0.05, 0, 0.1]}}
            del self.bodies[name]["joint"]
            self.bodies[name]["joints"] = [{**joint, "axis": [0, 0, 1], "name": f"{name}_first"}, second]

    def lighten(self, names: list[str]) -> None:
        """Of bodies that are fixed to each other take the mass of one, or make one a point mass."""
        done: set[str] = set()
        for name in names[1:]:
            body, parent = self.bodies[name], self.bodies[name]["parent"]
            way = self._light.choice(("as it is", "child", "parent", "point"))
            if body["joint"]["type"] != "fixed" or way == "as it is" or done & {name, parent}:
                continue
            done |= {name, parent}
            light = self.bodies[parent] if way == "parent" else body
            for key in ("mass", "inertia", "centre_of_mass"):
                light.pop(key, None)
            for shape in light.get("shapes", ()):
                shape.pop("density", None)
            if way == "point":
                light.update(mass=round(self._light.uniform(0.1, 1.0), 4), inertia={"principal": [0, 0, 0]})

    def contact(self) -> Data:
        found = dict(self.palette)
        if self.groups:
            ignored = sorted(self.groups | {"default"})
            found["groups"] = {name: {"ignores": [self.choice(ignored)]} for name in sorted(self.groups)}
        names = [name for name, body in self.bodies.items() if "array" not in body]
        for name, model in self.models.items():
            names += [f"{name}/{body}" for body in model["bodies"] if "array" not in model]
        if len(names) > 1 and self.chance(0.4):
            first, second = sorted(self._random.sample(names, 2))
            found["exclude"] = [[first, second]]
        return found

    def _plain(self, name: str) -> bool:
        """Whether a body's tree has hinges, slides and fixed joints alone; trees are named after their number."""
        tree = name.rpartition("_")[0]
        return all(
            body.get("fixed") or body.get("joint", {}).get("type") in ("hinge", "slide", "fixed")
            for other, body in self.bodies.items()
            if other.rpartition("_")[0] == tree
        )

    def _gains(self, joints: list[str], most: float) -> Data:
        """Of each joint its own: one number with a unit is never one for hinges and slides."""
        return {
            "kp": {joint: self.number(most / 4, most) for joint in joints},
            "kd": {joint: self.number(most / 40, most / 10) for joint in joints},
        }

    def control(self) -> Data:
        joints = [
            f"{name}_joint"
            for name, body in self.bodies.items()
            if body.get("joint", {}).get("type") in ("hinge", "slide")
            and not body["joint"].get("dry_friction")
            and not body["joint"].get("armature")
        ]
        if not joints or not self.chance(0.3):
            return {}
        # laws with the robot's dynamics need trees of hinges and slides on a fixed base
        plain = all(self._plain(name.removesuffix("_joint")) for name in joints)
        law: Data = {"joints": joints}
        if plain and self.chance(0.5):
            law.update(law="computed-torque", natural_frequency=self.number(5.0, 20.0), discretisation="implicit")
        elif plain:
            law.update(law="pd", **self._gains(joints, 20.0), discretisation="implicit")
        else:
            law.update(law="pd", **self._gains(joints, 0.5))
        return {"drive": law}


def spec(seed: int) -> Data:
    """The spec of a seed, as plain data."""
    draw = Draw(seed)
    draw.ground()
    for number in range(draw.count(0, 3)):
        draw.loose(number)
    for number in range(draw.count(0 if draw.bodies else 1, 2)):
        draw.tree(number)
    contact = draw.contact()
    control = draw.control()
    timestep = draw.choice((0.0005, 0.001, 0.001, 0.002))
    found: Data = {
        "simspec": 1,
        "name": f"random-{seed}",
        "physics": {
            "timestep": timestep,
            "duration": 0.2,
            "gravity": draw.choice(([0, 0, -9.81], [0.5, -0.3, -9.0], [0, 0, 0])),
        },
        "contact": contact,
        "bodies": draw.bodies,
        "record": {"every": 0.02, "channels": ["pose", "velocity", "energy", "contacts"]},
        "engines": {
            "dart": {
                "accept": [f"shape.{kind}" for kind in ("box", "capsule", "cylinder", "ellipsoid", "plane", "sphere")]
            },
            **{name: {"accept": ["contact.cone.elliptic"]} for name in ("pybullet", "rapier")},
            "physx": {"accept": ["contact.cone.elliptic", "shape.box", "shape.mesh"]},
        },
    }
    if draw.models:
        found["models"] = draw.models
    if not draw.bodies:
        del found["bodies"]
    if control:
        found["control"] = control
    return found
