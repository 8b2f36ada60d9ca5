"""Words that random scenarios were taught later: weights, free damping, sums, actuators, frames, limits of balls, margins of
pairs, surfaces that move. They have draws of their own, so that those of the other words stay as they are."""

from __future__ import annotations

import copy
import random
from typing import Any

from simspec.language.joints import angle_of
from simspec.language.shapes import Orientation
from tests.random_words import Words

Data = dict[str, Any]


class NewerWords(Words):
    """The words that are put into the plain data of a scenario, after all others but files of models."""

    def __init__(self, seed: int, data: Data):
        super().__init__(seed, data)
        self._random = random.Random(f"simspec newer random words {seed}")

    def kinds(self, body: Data) -> list[str]:
        return [joint["type"] for joint in (body.get("joint"), *body.get("joints", ())) if joint]

    def followers(self) -> set[str]:
        constraints = self.data.get("constraints", {}).values()
        return {
            constraint["follow"][end]
            for constraint in constraints
            if "follow" in constraint
            for end in ("joint", "leader")
        }

    def weights(self) -> None:
        """Of whole trees, or of single bodies where none is fixed to another: rigid groups have one scale of gravity."""
        if not self.chance(0.15):
            return
        trees: dict[str, list[Data]] = {}
        for name, body in self.named():
            trees.setdefault(self.root_of(name), []).append(body)
        for bodies in trees.values():
            if any(body.get("kinematic") for body in bodies) or not self.chance(0.6):
                continue
            alone = not any("fixed" in self.kinds(body) for body in bodies)
            scale = self.choice((0, 0.25, -1, 0.5))
            for body in bodies:
                if not alone or self.chance(0.6):
                    body["gravity_scale"] = scale if not alone else self.choice((0, 0.25, -1, 0.7))

    def free_bodies(self) -> list[Data]:
        return [
            body
            for name, body in self.named()
            if not {"parent", "fixed", "joint", "joints", "kinematic"} & body.keys() and "/" not in name
        ]

    def free_damping(self) -> None:
        if not self.chance(0.15):
            return
        for body in self.free_bodies():
            if self.chance(0.6):
                low = self.number(0.0001, 0.001)
                parts = {"linear": self.choice((low, self.number(0.01, 0.1))), "angular": low}
                body["joint"] = {"type": "free", "damping": parts}
                if self.chance(0.15):
                    body["joint"]["armature"] = {"linear": 0.02, "angular": 0.02}

    def sums(self) -> None:
        followers = self.followers()
        joints = [(name, joint) for name, joint, _ in self.joints() if name not in followers]
        if len(joints) < 2 or not self.chance(0.6):
            return
        chosen = self._random.sample(joints, min(len(joints), self.choice((2, 2, 3))))
        weights = {name: self.choice((1.0, -1.0, self.number(0.3, 1.5))) for name, _ in chosen}
        along: Data = {"joints": weights}
        if self.chance(0.7):
            along |= {"stiffness": self.number(0.1, 2.0), "rest": self.number(-0.2, 0.2)}
        if self.chance(0.6) or "stiffness" not in along:
            along["damping"] = self.number(0.001, 0.02)
        if self.chance(0.2):
            start = sum(weight * dict(chosen)[name].get("position", 0.0) for name, weight in weights.items())
            along["limits"] = {"position": [start - self.number(0.05, 0.4), start + self.number(0.05, 0.4)]}
        self.data.setdefault("constraints", {})["tendon"] = {"sum": along}

    def pair_margins(self) -> None:
        if not self.chance(0.06):
            return
        contact = self.data["contact"] = copy.deepcopy(self.data["contact"])  # palettes are shared
        between = [self.choice(self.materials), self.choice(self.materials)]
        pairs = contact.setdefault("pairs", [])
        if not any(sorted(pair["between"]) == sorted(between) for pair in pairs):
            pairs.append({"between": between, "margin": self.choice((0, self.number(0.0005, 0.003)))})

    def belts(self) -> None:
        if not self.chance(0.06):
            return
        for _, body in self.named():
            for shape in body.get("shapes", ()):
                if body.get("fixed") and shape.get("collision", True):
                    shape["surface_velocity"] = {"linear": [self.number(-0.5, 0.5), self.number(-0.5, 0.5), 0]}

    def actuators(self) -> None:
        if "trajectory" in self.data or not self.chance(0.5):
            return
        followers, named = self.followers(), []
        for name, joint, _ in self.joints():
            model, slash, joint_name = name.rpartition("/")
            if not slash or name in followers or "array" in self.models[model] or not self.chance(0.6):
                continue
            servo: Data = {"joint": joint_name, "gear": self.choice((1, 2, -1))}
            if self.chance(0.7):
                servo |= {"kp": self.number(0.1, 2.0), "kd": self.number(0.0, 0.01), "command": self.number(-0.2, 0.2)}
            else:
                servo |= {"law": "effort", "command": self.number(-0.1, 0.1)}
            if joint["type"] == "hinge" and self.chance(0.4):
                servo["effort_limit"] = self.number(0.05, 1.0)
            self.models[model].setdefault("actuators", {})[f"servo_{joint_name}"] = servo
            named.append(f"{model}/servo_{joint_name}")
        if named:
            self.data.setdefault("control", {})["servos"] = {"actuators": named}

    def frames(self) -> None:
        if not self.chance(0.4):
            return
        at = []
        for index, (name, _) in enumerate(self.named()):
            if not self.chance(0.3):
                continue
            model, slash, body_name = name.rpartition("/")
            holder = self.models[model] if slash else self.data
            holder.setdefault("frames", {})[f"mark_{index}"] = {
                "body": body_name,
                "pose": {"xyz": self.vector(0.2), "rpy": self.vector(1.0)},
            }
            at.append((f"{model}{slash}mark_{index}", name))
        for force in self.data.get("forces", ()):
            there = [frame for frame, body in at if body == force["body"]]
            if there and self.chance(0.7):
                force["body"] = self.choice(there)

    def ball_limits(self) -> None:
        if not self.chance(0.12):
            return
        for _, body in self.named():
            for joint in (body.get("joint", {}), *body.get("joints", ())):
                if joint.get("type") == "ball":
                    start = angle_of(Orientation.model_validate(joint.get("position", {})))
                    joint["limits"] = {"angle": min(3.1, round(start + self.number(0.2, 1.5), 4))}

    def put(self) -> None:
        """Put all of them in."""
        self.weights()
        self.free_damping()
        self.sums()
        self.pair_margins()
        self.belts()
        self.actuators()
        self.frames()
        self.ball_limits()
