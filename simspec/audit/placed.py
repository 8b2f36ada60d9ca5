"""Bodies of a file and of an engine, made comparable: matched by name, placed in the world, folded where an engine
merges them."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from simspec.world import frames
from simspec.world.kinematics import joint_displacement
from simspec.world.types import Body, Inertial, Pose, Shape, Vector3

WORLD: Final = "world"
"""The name of what cannot move."""
Floats = NDArray[np.float64]


def parents_first(bodies: Sequence[Body]) -> list[Body]:
    """Bodies, each after its parent: engines keep orders of their own. Raises ValueError where a parent is missing, or
    bodies are parents of each other."""
    children: dict[str | None, list[Body]] = {}
    for body in bodies:
        children.setdefault(body.joint.parent, []).append(body)
    ordered: list[Body] = []
    waiting = list(reversed(children.get(None, [])))
    while waiting:
        body = waiting.pop()
        ordered.append(body)
        waiting.extend(reversed(children.get(body.name, [])))
    if len(ordered) != len(bodies):
        left = sorted({body.name for body in bodies} - {body.name for body in ordered})
        raise ValueError(f"bodies without a way to the world: {', '.join(left[:5])}")
    return ordered


def zero_poses(bodies: Sequence[Body]) -> dict[str, Pose]:
    """The pose of every body's frame in the world with all joints at zero; free roots where they start."""
    placed: dict[str, Pose] = {}
    for body in parents_first(bodies):
        joint = body.joint
        start = joint.origin if joint.parent is None else frames.compose(placed[joint.parent], joint.origin)
        if joint.kind == "free" and joint.position:
            start = frames.compose(start, joint_displacement(body, joint.position))
        placed[body.name] = start
    return placed


def groups_of(bodies: Sequence[Body]) -> dict[str, str]:
    """For every body the topmost one that it is rigidly joined to; ``WORLD`` where that cannot move."""
    group: dict[str, str] = {}
    for body in parents_first(bodies):
        joint = body.joint
        if joint.kind != "fixed":
            group[body.name] = body.name
        else:
            group[body.name] = WORLD if joint.parent is None else group[joint.parent]
    return group


def key_of(name: str) -> str:
    """A name without what importers and engines change in it."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def tail_of(name: str) -> str:
    """The name of a body without that of its model."""
    return key_of(re.split(r"/|::", name)[-1])


def _unique(key: Callable[[str], str], bodies: Sequence[Body]) -> dict[str, Body | None]:
    """Bodies by a key of their names; None where several have it."""
    found: dict[str, Body | None] = {}
    for body in bodies:
        name = key(body.name)
        found[name] = None if name in found else body
    return found


@dataclass(frozen=True)
class Matched:
    """Bodies of a file beside those of an engine.

    own       the engine's body for each of the file's, by name, where it has one
    carrier   for each of the file's bodies the one of them whose engine body has it: itself, or one that it is fixed to;
              ``WORLD`` for one that became a part of the world; None where it is nowhere
    extra     the engine's bodies that stand for none of the file's
    """

    own: dict[str, Body]
    carrier: dict[str, str | None]
    extra: tuple[Body, ...]


def match(bodies: Sequence[Body], held: Sequence[Body]) -> Matched:
    """Match by name: exactly, else without marks and case, else without the name of the model before it, where only one body of
    each side is called so; where no name fits, the only root of one with that of the other."""
    own: dict[str, Body] = {}
    taken: set[str] = set()
    for key in (str, key_of, tail_of):
        left = _unique(key, [body for body in bodies if body.name not in own])
        free = _unique(key, [body for body in held if body.name not in taken])
        for name, body in left.items():
            partner = free.get(name)
            if body is not None and partner is not None:
                own[body.name] = partner
                taken.add(partner.name)
    roots = [body for body in bodies if body.joint.parent is None]
    held_roots = [body for body in held if body.joint.parent is None]
    if not own and len(roots) == len(held_roots) == 1 and held_roots[0].name != WORLD:
        own[roots[0].name] = held_roots[0]  # one is named after its model
        taken.add(held_roots[0].name)
    carrier: dict[str, str | None] = {}
    for body in bodies:
        if body.name in own:
            carrier[body.name] = body.name
        elif body.joint.parent is None:
            carrier[body.name] = WORLD  # whether a root is fixed is often left open
        else:
            carrier[body.name] = carrier[body.joint.parent] if body.joint.kind == "fixed" else None
    return Matched(own, carrier, tuple(body for body in held if body.name not in taken))


def folded(parts: Sequence[Body], at: dict[str, Pose], onto: str) -> tuple[Inertial, tuple[Shape, ...]]:
    """The mass properties and shapes of several bodies as one, in the frame of ``onto``."""
    inverse = frames.inverse(at[onto])
    shapes: list[Shape] = []
    lumps: list[tuple[float, Vector3, Floats]] = []
    for body in parts:
        place = frames.compose(inverse, at[body.name])
        inertial = body.inertial
        centre = frames.add(place.position, frames.rotate(place.quaternion, inertial.centre_of_mass))
        lumps.append((inertial.mass, centre, full(frames.rotate_inertia(place.quaternion, inertial.inertia))))
        shapes += [dataclasses.replace(shape, pose=frames.compose(place, shape.pose)) for shape in body.shapes]
    mass = sum(lump[0] for lump in lumps)
    if len(lumps) == 1 or not mass:
        return Inertial(mass, lumps[0][1], six(sum((lump[2] for lump in lumps), np.zeros((3, 3))))), tuple(shapes)
    middle = np.sum([lump[0] * np.array(lump[1]) for lump in lumps], axis=0) / mass
    tensor = np.zeros((3, 3))
    for own, centre, moment in lumps:
        arm = np.array(centre) - middle
        tensor += moment + own * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    x, y, z = middle.tolist()
    return Inertial(mass, (x, y, z), six(tensor)), tuple(shapes)


def full(inertia: Sequence[float]) -> Floats:
    """A tensor (3, 3) from (Ixx, Iyy, Izz, Ixy, Ixz, Iyz)."""
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def six(tensor: Floats) -> tuple[float, float, float, float, float, float]:
    """The same back."""
    t = tensor.tolist()
    return (t[0][0], t[1][1], t[2][2], t[0][1], t[0][2], t[1][2])
