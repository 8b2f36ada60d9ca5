"""Random worlds of contact of several bodies, each drawn by a seed: stacks, leaners, piles, clamps, carriers, grasps, impacts.

All motion is in the plane of x and z, but for piles on three balls and carriers that turn, so that a pyramid's axes are the
same in all engines. Bodies that may stand or fall are drawn far from the threshold. Laws and ratios of masses come from
short lists, so that level L5 measures each of them once.
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

Data = dict[str, Any]
Point = tuple[float, float]
"""x and z (m), from the centre of mass."""
T = TypeVar("T")


@dataclass(frozen=True)
class Law:
    """Of all pairs in a world; the timestep in ms."""

    friction: float
    timestep: float
    friction_cone: str = "elliptic"
    restitution: float = 0.0


CIRCUMSCRIBED, INSCRIBED = "pyramid-circumscribed", "pyramid-inscribed"
LAWS = (
    *(Law(friction, 1.0) for friction in (0.05, 0.3, 0.8)),
    *(Law(friction, 2.0) for friction in (0.2, 0.5, 1.2)),
    *(Law(friction, 4.0) for friction in (0.1, 0.5, 0.8)),
    Law(0.3, 1.0, CIRCUMSCRIBED),
    Law(0.8, 2.0, CIRCUMSCRIBED),
    Law(0.5, 4.0, CIRCUMSCRIBED),
    Law(0.5, 1.0, INSCRIBED),
    Law(0.3, 2.0, INSCRIBED),
)
BOUNCING = (
    Law(0.3, 1.0, restitution=0.5),
    Law(0.5, 2.0, restitution=0.3),
    Law(0.2, 4.0, restitution=0.8),
    Law(0.5, 1.0, CIRCUMSCRIBED, restitution=0.5),
)
RATIOS = (1.0, 3.0, 10.0, 30.0, 100.0, 200.0)
"""Ratios of masses, even in their logarithm."""
FALLS, STANDS = (0.6, 0.95), (1.05, 1.7)
"""Friction over the least that holds."""
GRAVITY = 9.81
TOUCH = 1e-6
"""m: overlap of what touches at the start."""
ANGLES = (math.radians(15.0), math.radians(78.0))
"""Between a leaner and the floor."""
PILED = (math.radians(37.0), math.radians(75.0))
"""Of a pile, from the vertical between centres."""


class Draw:
    """The choices of a seed, and the spec that grows from them."""

    def __init__(self, seed: int):
        self._random = random.Random(f"simspec coupled world {seed}")
        self.bodies: Data = {}
        self.more: Data = {}
        self.kind = list(KINDS)[seed % len(KINDS)]
        laws = (*BOUNCING, *LAWS[::4]) if self.kind == "strike" else LAWS
        self.law = self.choice(laws)
        self.gravity = GRAVITY
        self.duration = 0.6
        self.said: list[str] = []
        """A description of the draws."""

    def choice(self, choices: Iterable[T]) -> T:
        return self._random.choice(list(choices))

    def number(self, low: float, high: float) -> float:
        return round(self._random.uniform(low, high), 4)

    def chance(self, share: float) -> bool:
        return self._random.random() < share

    def share(self, feasible: Callable[[float], bool] = lambda _: True) -> float:
        """Friction over the least that holds, on the side that is feasible, or on either."""
        sides = [side for side in (FALLS, STANDS) if feasible(side[0]) and feasible(side[1])]
        return self.number(*self.choice(sides or [STANDS]))

    def masses(self, count: int) -> list[float]:
        """Of some bodies (kg), with two values alone."""
        ratio = self.choice(RATIOS)
        found = [1.0] * count
        for heavy in self._random.sample(range(count), self.choice(range(1, count))):
            found[heavy] = ratio
        self.say(f"masses {', '.join(f'{mass:g}' for mass in found)} kg")
        return found

    def say(self, text: str) -> None:
        self.said.append(text)

    def say_share(self, share: float) -> None:
        self.say(f"friction {share:.3g} × the least that holds")

    # --- bodies ---------------------------------------------------------------------------------------------------

    def fixed(self, name: str, size: Iterable[float], x: float, z: float) -> None:
        self.bodies[name] = {"fixed": True, "pose": {"xyz": [x, 0, z]}, "shapes": [{"box": {"size": list(size)}}]}

    def floor(self) -> None:
        self.fixed("floor", (8, 8, 0.4), 0.0, -0.2)

    def wall(self, x: float) -> None:
        """One whose face is at ``x``, beyond it."""
        self.fixed("wall", (0.4, 2.0, 4.0), x + math.copysign(0.2, x), 2.0)

    def free(self, name: str, shape: Data, mass: float, x: float, z: float, y: float = 0.0, turn: float = 0.0) -> Data:
        """``turn`` (rad): from the x axis to the z axis."""
        pose: Data = {"xyz": [x, y, z], **({"rpy": [0, -turn, 0]} if turn else {})}
        self.bodies[name] = {"pose": pose, "mass": mass, "shapes": [shape]}
        found: Data = self.bodies[name]
        return found

    def ball(self, name: str, radius: float, mass: float, x: float, z: float, y: float = 0.0) -> Data:
        return self.free(name, {"sphere": {"radius": radius}}, mass, x, z, y)

    def box(self, name: str, size: Iterable[float], mass: float, x: float, z: float, turn: float = 0.0) -> Data:
        return self.free(name, {"box": {"size": list(size)}}, mass, x, z, turn=turn)


def stack(draw: Draw) -> None:
    """Boxes and plates on each other, each with its centre and that of all above it over the one below; or balls between
    two walls."""
    draw.floor()
    if draw.chance(0.25):
        tube(draw)
        return
    count = draw.choice((2, 3, 3, 4, 5))
    masses = draw.masses(count)
    sizes = [(draw.number(0.1, 0.25), draw.number(0.1, 0.25), draw.choice((0.03, 0.1, 0.15))) for _ in masses]
    places, z = [0.0], 0.0
    for below, above in itertools.pairwise(sizes):
        places.append(places[-1] + draw.number(-0.2, 0.2) * min(below[0], above[0]))
    for level in range(count - 1, 0, -1):  # the bodies above stay over the middle half of each box
        weight = sum(masses[level:])
        centre = sum(mass * x for mass, x in zip(masses[level:], places[level:], strict=True)) / weight
        reach = 0.3 * min(sizes[level - 1][0], sizes[level][0])
        off = centre - places[level - 1]
        moved = max(-reach, min(reach, off)) - off
        places[level:] = [x + moved for x in places[level:]]
    for level, (size, mass, x) in enumerate(zip(sizes, masses, places, strict=True)):
        draw.box(f"box_{level}", size, mass, x, z + size[2] / 2.0)
        z += size[2]


def tube(draw: Draw) -> None:
    """Balls that rest on each other between two walls, to the left and to the right."""
    draw.say("balls between walls")
    radius, shift, z = 0.1, draw.number(0.03, 0.08), 0.1
    draw.fixed("left", (0.4, 2, 4), -radius - shift - 0.2 + TOUCH, 2.0)
    draw.fixed("right", (0.4, 2, 4), radius + shift + 0.2 - TOUCH, 2.0)
    for number, mass in enumerate(draw.masses(draw.choice((2, 3)))):
        draw.ball(f"ball_{number}", radius, mass, shift if number % 2 else -shift, z)
        z += math.sqrt((2.0 * radius) ** 2 - (2.0 * shift) ** 2) - TOUCH


def _rod(angle: float, length: float, radius: float) -> tuple[Point, Point]:
    c, s = length / 2.0 * math.cos(angle), length / 2.0 * math.sin(angle)
    return (-c, -s - radius), (c + radius, s)


def _plank(angle: float, length: float, thickness: float) -> tuple[Point, Point]:
    c, s, half = length / 2.0 * math.cos(angle), length / 2.0 * math.sin(angle), thickness / 2.0
    across = (half * math.sin(angle), -half * math.cos(angle))
    return (-c + across[0], -s + across[1]), (c + across[0], s + across[1])


def least(points: tuple[Point, Point]) -> float:
    """The friction at which a body that touches floor and wall there is about to slip at both: the root of
    x₁ − μ z₁ + μ (μ x₂ + z₂) = 0, the moment about its centre with N₂ = μ N₁."""
    (x, z), (top_x, top_z) = points
    linear = top_z - z
    return (-linear + math.sqrt(linear * linear - 4.0 * top_x * x)) / (2.0 * top_x)


LEANERS: Mapping[str, Callable[[float, float, float], tuple[Point, Point]]] = {
    "ladder": _rod,
    "rod": _rod,
    "plank": _plank,
}


def _bisect(value: Callable[[float], float], low: float, high: float) -> float:
    """Where a function that grows is zero."""
    for _ in range(60):
        middle = (low + high) / 2.0
        low, high = (middle, high) if value(middle) < 0.0 else (low, middle)
    return (low + high) / 2.0


def leaner(draw: Draw) -> None:
    """A ladder (two balls), rod (capsule) or plank (box) on a wall, or a plank on a free box."""
    draw.floor()
    form = draw.choice(LEANERS)
    length, width = draw.number(0.6, 1.2), draw.number(0.03, 0.06)
    points, friction = LEANERS[form], draw.law.friction
    lowest, highest = (least(points(angle, length, width)) for angle in reversed(ANGLES))
    if form == "plank" and draw.chance(0.4):
        draw.say("a plank on a free box")
        angle, masses = draw.number(0.7, 1.1), draw.masses(2)
        face = points(angle, length, width)
        height = 1.2 * length
        middle = length * math.cos(angle) / 2.0 + width * math.sin(angle) / 2.0
        draw.box("block", (0.5 * length, 0.4, height), masses[1], middle + 0.25 * length - TOUCH, height / 2.0)
        draw.box("leaner", (length, 0.2, width), masses[0], 0.0, -face[0][1] - TOUCH, angle)
        return
    share = draw.share(lambda ratio: lowest < friction / ratio < highest or (ratio > 1.0 and friction / ratio > lowest))
    angle = _bisect(lambda at: friction / share - least(points(at, length, width)), *ANGLES)
    foot, top = points(angle, length, width)
    draw.say(f"a {form} at {math.degrees(angle):.1f}°")
    draw.say_share(friction / least((foot, top)))
    draw.wall(top[0] - TOUCH)
    if form == "plank":
        draw.box("leaner", (length, 0.2, width), 1.0, 0.0, -foot[1] - TOUCH, angle)
    elif form == "rod":
        shape: Data = {"capsule": {"radius": width, "length": length}, "pose": {"rpy": [0, math.pi / 2.0, 0]}}
        draw.free("leaner", shape, 1.0, 0.0, -foot[1] - TOUCH, turn=angle)
    else:
        body = draw.free("leaner", {}, 1.0, 0.0, -foot[1] - TOUCH, turn=angle)
        ends = ({"xyz": [side * length / 2.0, 0, 0]} for side in (-1, 1))
        body["shapes"] = [{"sphere": {"radius": width}, "pose": end} for end in ends]


def pile(draw: Draw) -> None:
    """A ball on two or three others: it stands up to the angle φ from the vertical with tan(φ/2) = μ."""
    draw.floor()
    friction, radius, count = draw.law.friction, 0.1, draw.choice((2, 3))
    low, high = (math.tan(angle / 2.0) for angle in PILED)
    share = draw.share(lambda ratio: low < friction / ratio < high or (ratio > 1.0 and friction / ratio > low))
    angle = max(PILED[0], min(PILED[1], 2.0 * math.atan(friction / share)))
    draw.say(f"one on {count} at {math.degrees(angle):.1f}°")
    draw.say_share(friction / math.tan(angle / 2.0))
    ratio = draw.choice(RATIOS[:4])
    out, up = (2.0 * radius * part(angle) for part in (math.sin, math.cos))
    for number in range(count):
        turn = 2.0 * math.pi * number / count
        draw.ball(f"low_{number}", radius, 1.0, out * math.cos(turn), radius, out * math.sin(turn))
    draw.ball("top", radius, ratio, 0.0, radius + up - TOUCH)
    draw.say(f"masses 1 and {ratio:g} kg")


def clamp(draw: Draw) -> None:
    """Two balls of one body at opposite faces of a post, under its weight and a moment; or plates pressed to a wall."""
    friction = draw.law.friction
    if draw.chance(0.5):
        share = draw.share()
        draw.say_share(share)
        height, radius, gain = 0.4, 0.05, draw.number(0.2, 0.6)
        arm = gain * height / (2.0 * friction)
        draw.fixed("post", (0.2, 1, 8), 0.0, 0.0)
        body = draw.free("clamp", {}, 1.0, arm, 0.0)
        body["inertia"] = {"principal": [1.0, 1.0, 1.0]}
        side = 0.1 + radius - TOUCH
        ends = ([-side - arm, 0, height / 2.0], [side - arm, 0, -height / 2.0])
        body["shapes"] = [{"sphere": {"radius": radius}, "pose": {"xyz": end}} for end in ends]
        moment = GRAVITY * (height * share / (2.0 * friction) - arm)
        draw.more["forces"] = [{"body": "clamp", "torque": [0, moment, 0]}]
        return
    share, masses = draw.share(), draw.masses(2)
    draw.say("pressed to a wall")
    draw.say_share(share)
    draw.wall(1.0)
    for number, (name, mass) in enumerate(zip(("plate", "box"), masses, strict=True)):
        draw.box(name, (0.1, 0.2, 0.4), mass, 0.95 - 0.1 * number + TOUCH * (1 - number), 2.0)
    force = share * sum(masses) * GRAVITY / friction
    draw.more["forces"] = [{"body": "box", "force": [force, 0, 0]}]


def carrier(draw: Draw) -> None:
    """Boxes on a platform that speeds up along x, or turns."""
    draw.duration = 0.8
    share = draw.number(*draw.choice(((0.4, 0.9), (1.1, 1.7))))
    time, limit = draw.choice((0.4, 0.7)), share * draw.law.friction * GRAVITY
    draw.say(f"largest acceleration {share:g} × the limit of friction")
    shapes: list[Data] = [{"box": {"size": [4, 4, 0.2]}}]
    draw.bodies["platform"] = {"kinematic": True, "pose": {"xyz": [0, 0, -0.1]}, "shapes": shapes}
    x = 0.0
    if draw.chance(0.5):
        x = draw.number(0.2, 0.6)
        angle = _bisect(lambda at: _turning(at, time, x) - limit, 0.0, 2.5)
        end: Data = {"rpy": [0, 0, angle]}
        draw.say(f"turns by {angle:.2f} rad")
    else:
        end = {"xyz": [limit * time * time / 5.7735, 0, -0.1]}
    draw.more["motion"] = {"platform": {"interpolation": "quintic", "points": [{"at": 0}, {"at": time, **end}]}}
    masses, z = draw.masses(2), 0.0
    for number, mass in enumerate(masses[: draw.choice((1, 2))]):
        draw.box(f"load_{number}", (0.2, 0.2, 0.1), mass, x, z + 0.05)
        z += 0.1


def _turning(angle: float, time: float, radius: float) -> float:
    """The largest acceleration (m/s²) at this radius of a turn by minimum jerk."""
    found = 0.0
    for step in range(101):
        u = step / 100.0
        rate = angle / time * 30.0 * u * u * (1.0 - u) ** 2
        change = angle / time**2 * 60.0 * u * (1.0 - 3.0 * u + 2.0 * u * u)
        found = max(found, radius * math.hypot(rate * rate, change))
    return found


def grasp(draw: Draw) -> None:
    """Two fingers on slides press on a box, ball or cylinder by a constant effort or by their position, and lift it."""
    draw.floor()
    draw.duration = 0.8
    shapes: Mapping[str, Data] = {
        "box": {"box": {"size": [0.06, 0.06, 0.08]}},
        "ball": {"sphere": {"radius": 0.03}},
        "cylinder": {"cylinder": {"radius": 0.03, "length": 0.08}},
    }
    form, share, rise = draw.choice(shapes), draw.share(), draw.number(0.05, 0.12)
    draw.say_share(share)
    z, mass = 0.03 if form == "ball" else 0.04, draw.number(0.1, 0.5)
    draw.free("held", shapes[form], mass, 0.0, z)
    largest = GRAVITY + (6.0 * rise / 0.6**2 if share > 1.0 else 0.0)
    force = share * mass * largest / (2.0 * draw.law.friction)
    bare: Data = {"mass": 5.0, "inertia": {"principal": [0.05, 0.05, 0.05]}}
    draw.bodies["hand"] = {**bare, "joint": {"type": "slide", "axis": [0, 0, 1], "origin": {"xyz": [0, 0, z]}}}
    for name, side in (("left", -1.0), ("right", 1.0)):
        joint = {"type": "slide", "axis": [-side, 0, 0], "origin": {"xyz": [side * (0.04 - TOUCH), 0, 0]}}
        pad = {"box": {"size": [0.02, 0.05, 0.05]}}
        draw.bodies[name] = {"parent": "hand", "joint": joint, "mass": 0.3, "shapes": [pad]}
    lift: Data = {"law": "computed-torque", "joints": ["hand_joint"], "natural_frequency": 40}
    draw.more["control"] = {"lift": {**lift, "discretisation": "implicit"}}
    fingers, fingers_at_zero = ["left_joint", "right_joint"], {"left_joint": 0.0, "right_joint": 0.0}
    points: list[Data] = [
        {"at": at, "positions": {"hand_joint": up, **fingers_at_zero}} for at, up in ((0.1, 0.0), (0.7, rise))
    ]
    if draw.chance(0.5):
        draw.say(f"{form}, pressed by {force:.3g} N")
        draw.more["control"]["squeeze"] = {"joints": fingers, "actuator": "effort"}
        for point in points:
            point["efforts"] = {"hand_joint": 0.0, "left_joint": force, "right_joint": force}
        points.insert(0, {**points[0], "at": 0.0})
    else:
        draw.say(f"{form}, squeezed by position, {force:.3g} N")
        law = {"joints": fingers, "kp": force / 0.01, "kd": 2.0 * math.sqrt(0.3 * force / 0.01)}
        draw.more["control"]["squeeze"] = {**law, "discretisation": "implicit"}
        for point in points:
            point["positions"] |= {"left_joint": 0.01, "right_joint": 0.01}
    draw.more["trajectory"] = {"interpolation": "cubic", "points": points}


def strike(draw: Draw) -> None:
    """A ball falls on two, rolls against a row of two, or meets two without gravity; or a tilted box lands on an edge."""
    draw.duration = 0.5
    radius, form = 0.1, draw.choice(("falls", "row", "free", "edge"))
    ratio, speed = draw.choice((1.0, 3.0, 10.0)), draw.number(0.5, 2.0)
    draw.say(f"{form}, mass {ratio:g} kg, {speed:g} m/s")
    if form != "free":
        draw.floor()
    if form == "edge":
        tilt = draw.number(0.15, 0.5)
        lowest = 0.1 * math.sin(tilt) + 0.05 * math.cos(tilt)
        body = draw.box("box", (0.2, 0.2, 0.1), ratio, 0.0, lowest + 0.05 * speed, tilt)
        body["velocity"] = {"linear": [0, 0, -speed]}
    elif form == "row":
        body = draw.ball("striker", radius, ratio, -2.5 * radius, radius)
        body["velocity"] = {"linear": [speed, 0, 0], "angular": [0, speed / radius, 0]}
        for number in range(2):
            draw.ball(f"struck_{number}", radius, 1.0, 2.0 * radius * number, radius)
    else:
        draw.gravity = 0.0 if form == "free" else GRAVITY
        off = 0.0 if form == "falls" else draw.number(-0.04, 0.04)
        body = draw.ball("striker", radius, ratio, off, 2.75 * radius + 0.03 * speed)
        body["velocity"] = {"linear": [0, 0, -speed]}
        for number, side in enumerate((-1.0, 1.0)):
            draw.ball(f"struck_{number}", radius, 1.0, side * radius, radius)


KINDS: Mapping[str, Callable[[Draw], None]] = {
    "stack": stack,
    "leaner": leaner,
    "pile": pile,
    "clamp": clamp,
    "carrier": carrier,
    "grasp": grasp,
    "strike": strike,
}


def coupled(seed: int) -> tuple[Data, str, str]:
    """The spec of a seed, its kind, and what was drawn, in words."""
    draw = Draw(seed)
    KINDS[draw.kind](draw)
    law = draw.law
    timestep = law.timestep / 1e3
    material = {"friction": law.friction, "restitution": law.restitution}
    spec = {
        "simspec": 1,
        "name": f"coupled-{seed}",
        "physics": {"timestep": timestep, "duration": draw.duration, "gravity": [0, 0, -draw.gravity]},
        "contact": {"friction_cone": law.friction_cone, "materials": {"all": material}},
        "bodies": draw.bodies,
        "record": {"every": 0.02, "channels": ["pose"]},
        "engines": {},
        **draw.more,
    }
    words = [f"μ {law.friction:g}", f"e {law.restitution:g}", f"{law.timestep:g} ms", law.friction_cone, *draw.said]
    return spec, draw.kind, ", ".join(words)
