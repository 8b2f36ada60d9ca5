"""Additions to a random scenario after its bodies are drawn: meshes, constraints, kinematic bodies, forces, states,
margins, pairs that touch, models in separate files. They are drawn by a separate generator from the scenario's seed."""

from __future__ import annotations

import json
import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.world.hull import hull

Data = dict[str, Any]

SOLIDS: Mapping[str, tuple[tuple[float, float, float], ...]] = {
    "wedge": (
        (-0.06, -0.05, -0.04),
        (0.07, -0.05, -0.04),
        (-0.06, 0.06, -0.04),
        (0.07, 0.06, -0.04),
        (-0.05, 0.0, 0.08),
    ),
    "gem": (
        (0.06, 0.0, 0.01),
        (-0.05, 0.01, 0.0),
        (0.0, 0.07, -0.01),
        (0.01, -0.06, 0.0),
        (0, 0.01, 0.09),
        (0.01, 0, -0.05),
    ),
    "brick": tuple((x, y, z) for x in (-0.05, 0.06) for y in (-0.04, 0.04) for z in (-0.03, 0.05)),
    "corner": ((0.0, 0.0, 0.0), (0.12, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.08)),
}
"""Corners of solids (m), most of them without symmetries."""
SCALAR = ("hinge", "slide")


def _mesh_file(corners: tuple[tuple[float, float, float], ...], scale: float) -> str:
    """An OBJ file of a solid, closed and wound outwards."""
    points = np.array(corners)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (points * scale).tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in hull(points).triangles.tolist()]
    return "\n".join([*lines, ""])


class Words:
    """Additions to the plain data of a scenario; ``files``: text of the files that it names, by path."""

    def __init__(self, seed: int, data: Data):
        self._random = random.Random(f"simspec random words {seed}")
        self.data = data
        self.files: dict[str, str] = {}
        self.bodies: Data = data.get("bodies", {})
        self.models: Data = data.get("models", {})
        self.materials = list(data["contact"]["materials"])

    def chance(self, share: float) -> bool:
        return self._random.random() < share

    def choice(self, choices: Any) -> Any:
        return self._random.choice(list(choices))

    def number(self, low: float, high: float) -> float:
        return round(self._random.uniform(low, high), 4)

    def vector(self, reach: float) -> list[float]:
        return [self.number(-reach, reach) for _ in range(3)]

    # --- what there is --------------------------------------------------------------------------------------------

    def everywhere(self) -> list[tuple[str, Data]]:
        """All bodies that are written, with their full names; those of arrays have others, and none here ("")."""
        found = [("" if "array" in body else name, body) for name, body in self.bodies.items()]
        for name, model in self.models.items():
            found += [
                ("" if "array" in model else f"{name}/{body}", joint_body)
                for body, joint_body in model["bodies"].items()
            ]
        return found

    def named(self) -> list[tuple[str, Data]]:
        return [(name, body) for name, body in self.everywhere() if name]

    def root_of(self, name: str) -> str:
        model, slash, root = name.rpartition("/")
        bodies = self.models[model]["bodies"] if slash else self.bodies
        while "parent" in bodies[root]:
            root = bodies[root]["parent"]
        return f"{model}{slash}{root}"

    def joints(self) -> list[tuple[str, Data, str]]:
        """Hinges and slides that are alone on their body and that no controller drives: full name, data, the tree's root."""
        driven = {joint for law in self.data.get("control", {}).values() for joint in law["joints"]}
        found = []
        for name, body in self.named():
            joint = body.get("joint", {})
            model, slash, body_name = name.rpartition("/")
            full = f"{model}{slash}{joint.get('name', f'{body_name}_joint')}"
            if joint.get("type") in SCALAR and full not in driven:
                found.append((full, joint, self.root_of(name)))
        return found

    def take_velocities(self, root: str) -> None:
        """Take the initial velocities of a tree."""
        for name, body in self.named():
            if self.root_of(name) == root:
                body.pop("velocity", None)
                for joint in (body.get("joint", {}), *body.get("joints", ())):
                    joint.pop("velocity", None)

    # --- words ----------------------------------------------------------------------------------------------------

    def meshes(self) -> None:
        if not self.chance(0.25):
            return
        for _, body in self.everywhere():
            for shape in body.get("shapes", ()):
                if "plane" in shape or "ellipsoid" in shape or not self.chance(0.4):
                    continue
                kind = next(key for key in ("sphere", "box", "cylinder", "capsule") if key in shape)
                solid, millimetres = self.choice(SOLIDS), self.chance(0.3)
                path = f"meshes/{solid}{'_mm' if millimetres else ''}.obj"
                self.files[path] = _mesh_file(SOLIDS[solid], 1000.0 if millimetres else 1.0)
                mesh: Data = {"file": path}
                if millimetres:
                    mesh["unit"] = "mm"
                if self.chance(0.4):
                    mesh["scale"] = self.choice((1.5, [1, -1, 1], [-1, 1, 0.7], 0.6))
                if self.chance(0.3):
                    mesh["up"] = self.choice("xyz")
                if self.chance(0.3):
                    mesh["mass_from"] = "hull"
                if self.chance(0.2) and len(SOLIDS[solid]) > 5:
                    mesh["max_vertices"] = 5
                del shape[kind]
                shape["mesh"] = mesh

    def margins(self) -> None:
        if not self.chance(0.08):
            return
        for _, body in self.everywhere():
            for shape in body.get("shapes", ()):
                if shape.get("collision", True) and self.chance(0.6):
                    shape["margin"] = self.number(0.0005, 0.004)

    def ball_armature(self) -> None:
        if not self.chance(0.15):
            return
        for _, body in self.everywhere():
            for joint in (body.get("joint", {}), *body.get("joints", ())):
                if joint.get("type") == "ball" and self.chance(0.7):
                    joint["armature"] = self.number(0.01, 0.1)

    def fluid(self) -> None:
        if not self.chance(0.25):
            return
        self.data["physics"]["fluid"] = {
            "density": self.number(0.5, 40.0),
            "viscosity": self.number(0.0, 0.05),
            **({"velocity": self.vector(2.0)} if self.chance(0.6) else {}),
        }

    def follow(self) -> Data:
        joints = self.joints()
        if len(joints) < 2 or not self.chance(0.35):
            return {}
        (name, joint, _), (leader, led, _) = self._random.sample(joints, 2)
        ratio = self.choice((-1.0, 1.0, self.number(0.3, 2.0), -self.number(0.2, 0.9)))
        offset = joint.pop("position", 0.0) - ratio * led.get("position", 0.0)
        joint.pop("velocity", None)
        return {"mirror": {"follow": {"joint": name, "leader": leader, "ratio": ratio, "offset": offset}}}

    def loop(self) -> Data:
        roots = {name: self.root_of(name) for name, _ in self.named()}
        moving = [name for name, body in self.named() if not body.get("fixed") and name != "ground"]
        if not moving or len(roots) < 2 or not self.chance(0.25):
            return {}
        first = self.choice(moving)
        second = self.choice([name for name in roots if name != first])
        for name in (first, second):
            self.take_velocities(roots[name])
        if self.chance(0.5):
            return {"glue": {"weld": {"bodies": [first, second]}}}
        return {"pin": {"connect": {"bodies": [first, second], "at": self.vector(0.2)}}}

    def constraints(self) -> None:
        found = {**self.follow(), **self.loop()}
        if found:
            self.data["constraints"] = found

    def kinematic(self) -> None:
        loose = [name for name, body in self.named() if name.startswith("loose") and "velocity" not in body]
        joined = str(self.data.get("constraints", {}))
        loose = [name for name in loose if f"'{name}'" not in joined]
        if not loose or not self.chance(0.25):
            return
        name = self.choice(loose)
        self.bodies[name]["kinematic"] = True
        if self.chance(0.8):
            at, points = 0.0, []
            for _ in range(self._random.randint(2, 4)):
                point: Data = {"at": at}
                if self.chance(0.7) or not at:
                    point["xyz"] = [
                        a + b for a, b in zip(self.bodies[name]["pose"]["xyz"], self.vector(0.05), strict=True)
                    ]
                if self.chance(0.5):
                    point["rpy"] = self.vector(0.4)
                points.append(point)
                at = round(at + self.choice((0.03, 0.06, 0.1)), 3)
            self.data["motion"] = {
                name: {"points": points, "interpolation": self.choice(("linear", "cubic", "quintic"))}
            }

    def forces(self) -> None:
        free = [
            name
            for name, body in self.named()
            if not body.get("fixed") and name != "ground" and not body.get("kinematic")
        ]
        anchored = {name for name in free if self._anchored(name)}
        free = [name for name in free if name not in anchored]
        if not free or not self.chance(0.25):
            return
        listed = []
        for _ in range(self._random.randint(1, 3)):
            force: Data = {"body": self.choice(free)}
            if self.chance(0.7):
                force["force"] = self.vector(10.0)
            if "force" not in force or self.chance(0.4):
                force["torque"] = self.vector(1.0)
            if "force" in force and self.chance(0.5):
                force["at"] = self.vector(0.1)
            if self.chance(0.6):
                force["from"] = self.number(0.0, 0.05)
            if self.chance(0.6):
                force["until"] = round(force.get("from", 0.0) + self.number(0.003, 0.1), 4)
            listed.append(force)
        self.data["forces"] = listed

    def _anchored(self, name: str) -> bool:
        """Whether a body is fixed to the world through fixed joints."""
        model, slash, ancestor = name.rpartition("/")
        bodies = self.models[model]["bodies"] if slash else self.bodies
        while True:
            body = bodies[ancestor]
            if body.get("fixed") or (slash and "parent" not in body and self.models[model].get("fixed")):
                return True
            if "parent" not in body or body.get("joint", {}).get("type") != "fixed":
                return False
            ancestor = body["parent"]

    def touch(self) -> None:
        joined = []
        for name, body in self.named():
            model, slash, _ = name.rpartition("/")
            kinds = [joint["type"] for joint in (body.get("joint"), *body.get("joints", ())) if joint]
            if "parent" in body and kinds and "fixed" not in kinds:
                joined.append(sorted((name, f"{model}{slash}{body['parent']}")))
        excluded = self.data["contact"].get("exclude", [])
        joined = [pair for pair in joined if pair not in excluded]
        if joined and self.chance(0.2):
            self.data["contact"]["touch"] = self._random.sample(joined, min(len(joined), self._random.randint(1, 2)))

    def every(self) -> None:
        for law in self.data.get("control", {}).values():
            if law["law"] != "native" and self.chance(0.3):
                law["every"] = self.choice((2, 5)) * self.data["physics"]["timestep"]

    def states(self) -> None:
        for model in self.models.values():
            joints = {
                body["joint"].get("name", f"{name}_joint"): body["joint"]
                for name, body in model["bodies"].items()
                if body.get("joint", {}).get("type") in SCALAR
            }
            if not joints or "constraints" in self.data or not self.chance(0.5):
                continue
            ready = {
                name: self.number(*joint["limits"]["position"])
                if "position" in joint.get("limits", {})
                else self.number(-0.3, 0.3)
                for name, joint in joints.items()
            }
            model["states"] = {"home": {}, "ready": {"positions": ready}}
            if self.chance(0.7):
                model["state"] = self.choice(("home", "ready"))

    def files_of_models(self) -> None:
        """Put models into files of their own; self_collision is a word of such files."""
        for name, model in self.models.items():
            if not self.chance(0.6):
                continue
            inner = {key: model.pop(key) for key in ("bodies", "states", "frames", "actuators") if key in model}
            contact: Data = {
                "materials": {material: self.data["contact"]["materials"][material] for material in self.materials}
            }
            if self.chance(0.6) and name not in str(self.data["contact"].get("touch", "")):
                contact["self_collision"] = False
            path = f"models/{name}.yaml"
            text = {"simspec": 1, "name": name, "contact": contact, "model": inner}
            for body in inner["bodies"].values():
                for shape in body.get("shapes", ()):
                    if "mesh" in shape:
                        shape["mesh"]["file"] = f"../{shape['mesh']['file']}"
            self.instance(name, model, inner)
            self.files[path] = json.dumps(text, indent=1)
            model["use"] = path

    def instance(self, name: str, model: Data, inner: Data) -> None:
        """Mirror a file's model, and make the mass of a body of it a parameter."""
        light = random.Random(
            f"simspec random words {name} {self.data['name']}, instance"
        )  # leaves the others as they were
        if light.random() < 0.5:
            model["mirror"] = light.choice("xyz")
        heavy = [body for body in inner["bodies"].values() if isinstance(body.get("mass"), float)]
        if heavy and light.random() < 0.5:
            inner["parameters"] = {"mass": {"dimension": "mass", "default": 1}}
            model["with"] = {"mass": 2.0 * heavy[0]["mass"]}
            heavy[0]["mass"] = "$mass / 2"

    def rough_ground(self) -> None:
        """Uneven ground in place of a slab, nowhere above it."""
        ground = self.bodies.get("ground", {})
        slab = next((shape for shape in ground.get("shapes", ()) if "box" in shape), None)
        if slab is None or not self.chance(0.3):
            return
        rows, columns = self._random.randint(2, 6), self._random.randint(2, 6)
        heights = [[self.number(-0.2, 0.0) for _ in range(columns)] for _ in range(rows)]
        del slab["box"]
        slab["heightfield"] = {"rows": heights, "size": [8, 8], "base": 0.4}
        slab["pose"] = {}
        if self.chance(0.3):
            slab["heightfield"]["heights"] = [-0.1, 0]
        self.data["engines"].setdefault("mujoco", {}).setdefault("accept", []).append("shape.heightfield")


def with_words(seed: int, data: Data) -> tuple[Data, dict[str, str]]:
    """``data`` with words put into it, and the files that it names."""
    words = Words(seed, data)
    words.meshes()
    words.margins()
    words.ball_armature()
    words.constraints()
    words.kinematic()
    words.forces()
    words.touch()
    words.every()
    words.states()
    from tests.random_newer_words import NewerWords  # its class is derived from Words

    NewerWords(seed, data).put()
    words.files_of_models()
    words.fluid()
    words.rough_ground()
    return data, words.files


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write what a scenario names into its folder."""
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    folder.mkdir(parents=True, exist_ok=True)
