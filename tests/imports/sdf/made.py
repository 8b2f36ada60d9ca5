"""Files of SDF made at random: trees of links with frames, nested models and all ways to say a pose."""

from __future__ import annotations

import random


def numbers(values) -> str:
    return " ".join(repr(value) for value in values)


class Maker:
    """One file of one model, by a seed. ``version`` decides which ways of saying a pose there are."""

    def __init__(self, seed: int, version: str):
        self.random = random.Random(f"{seed} {version}")
        self.version = version
        self.new = tuple(map(int, version.split("."))) >= (1, 7)
        self.newest = tuple(map(int, version.split("."))) >= (1, 9)
        self.joints: list[str] = []

    def pose(self, relative_to: list[str] | None = None) -> str:
        draw = self.random
        if draw.random() < 0.15:
            return ""
        xyz = [round(draw.uniform(-1, 1), 3) for _ in range(3)]
        rpy = [round(draw.uniform(-3, 3), 3) for _ in range(3)]
        words = ""
        if relative_to and self.new and draw.random() < 0.7:
            words = f' relative_to="{draw.choice(relative_to)}"'
        if self.newest and draw.random() < 0.3:
            degrees = [round(value * 50, 2) for value in rpy]
            return f'<pose degrees="true"{words}>{numbers(xyz)} {numbers(degrees)}</pose>'
        if self.newest and draw.random() < 0.3:
            return f'<pose rotation_format="quat_xyzw"{words}>{numbers(xyz)} 0.5 -0.5 0.5 0.5</pose>'
        return f"<pose{words}>{numbers(xyz)} {numbers(rpy)}</pose>"

    def inertial(self) -> str:
        draw = self.random
        if draw.random() < 0.15:
            return ""
        a, b, c = (draw.uniform(0.1, 0.2) for _ in range(3))
        ixy, ixz = draw.uniform(-0.02, 0.02), draw.uniform(-0.02, 0.02)
        moments = f"<ixx>{a!r}</ixx><iyy>{b!r}</iyy><izz>{c!r}</izz><ixy>{ixy!r}</ixy><ixz>{ixz!r}</ixz><iyz>0</iyz>"
        return f"<inertial>{self.pose()}<mass>{draw.uniform(0.5, 2)!r}</mass><inertia>{moments}</inertia></inertial>"

    def axis(self, frames: list[str]) -> str:
        draw = self.random
        xyz = numbers([round(draw.uniform(-1, 1), 2), round(draw.uniform(-1, 1), 2), 1.0])
        if self.new and draw.random() < 0.5:
            return f'<axis><xyz expressed_in="{draw.choice(frames)}">{xyz}</xyz></axis>'
        if self.version in ("1.5", "1.6"):
            flag = draw.choice(["true", "false"])
            return f"<axis><xyz>{xyz}</xyz><use_parent_model_frame>{flag}</use_parent_model_frame></axis>"
        return f"<axis><xyz>{xyz}</xyz></axis>"

    def model(self, name: str, prefix: str = "", depth: int = 0) -> str:
        draw = self.random
        links = [f"{prefix}link{i}" for i in range(draw.randint(2, 5))]
        parts: list[str] = []
        frames: list[str] = ["__model__"]
        parents: list[str] = []
        if depth == 0 and self.new and draw.random() < 0.7:
            parts.append(self.model("inner", "inner_", 1))
            parents.append("inner::inner_link0")
            frames.append("inner")
        for i, link in enumerate(links):
            parts.append(f'<link name="{link}">{self.pose(frames)}{self.inertial()}</link>')
            frames.append(link)
            if self.new and draw.random() < 0.4:
                attached = draw.choice(frames)
                parts.append(f'<frame name="{link}_frame" attached_to="{attached}">{self.pose(frames)}</frame>')
                frames.append(f"{link}_frame")
            if i == 0 and not parents:
                parents.append(link)
                continue
            kind = draw.choice(["revolute", "prismatic", "continuous", "fixed", "revolute"])
            if kind == "continuous" and not self.new:
                kind = "revolute"
            joint = f"{prefix}joint{i}"
            axis = "" if kind == "fixed" else self.axis(frames)
            body = f"<parent>{draw.choice(parents)}</parent><child>{link}</child>{self.pose(frames)}{axis}"
            parts.append(f'<joint name="{joint}" type="{kind}">{body}</joint>')
            if kind != "fixed":
                self.joints.append(joint)
            parents.append(link)
            frames.append(joint)
        if depth == 0:
            base = parents[0]
            parts.append(f'<joint name="to_world" type="fixed"><parent>world</parent><child>{base}</child></joint>')
        placement = ""
        if self.new and depth and self.version != "1.7" and draw.random() < 0.7:
            placement = f' placement_frame="{draw.choice(links)}"'
        return f'<model name="{name}"{placement}>{self.pose()}{"".join(parts)}</model>'

    def file(self) -> str:
        return f'<?xml version="1.0"?>\n<sdf version="{self.version}">\n{self.model("robot")}\n</sdf>\n'
