"""Programs of moves, solved once for each distinct model and program: worlds that differ in their timestep, their loose bodies
or their materials share the solution. Solving is nine tenths of the time that the library's robot takes to resolve."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any

from simspec.errors import Problem
from simspec.language.sources import Source
from simspec.resolve.grasps import Grasp
from simspec.resolve.moves import Program, Rows
from simspec.world.canonical import to_plain
from simspec.world.kinematics import trees
from simspec.world.types import Body, World

MOST_KEPT = 8
"""Solutions that are kept; the largest of the library takes 1 MB."""
WITHOUT_MOTION: Mapping[str, Any] = {
    "velocity_limit": None,
    "effort_limit": None,
    "damping": 0.0,
    "dry_friction": 0.0,
    "armature": 0.0,
    "spring_stiffness": 0.0,
    "spring_rest": 0.0,
    "velocity": (),
    "angular_damping": 0.0,
    "angular_armature": 0.0,
}
"""Fields of a joint that kinematics do not depend on, with the values that stand for all; every other field counts."""
OF_PROGRAMS = ("tool", "arm", "interval", "grasp", "program")
"""Fields of a trajectory that a program is solved from."""

_SOLVED: dict[str, Rows] = {}
"""The latest solutions by the hash of what they were solved from."""


def solve(source: Source, world: World, known: Mapping[str, Grasp]) -> tuple[Rows | None, list[Problem]]:
    """The points of a spec's program in its world (nobody changes them), or None with what is wrong. ``known``: the grasps of
    the models."""
    key = hash_of(source, world, known)
    rows = _SOLVED.pop(key, None)
    if rows is None:
        program = Program(source, world, known)
        rows = program.solve()
        if rows is None or program.problems:
            return rows, program.problems
    _SOLVED[key] = rows
    while len(_SOLVED) > MOST_KEPT:
        _SOLVED.pop(next(iter(_SOLVED)), None)
    return rows, []


def hash_of(source: Source, world: World, known: Mapping[str, Grasp]) -> str:
    """SHA-256 of all that a program's solution depends on: the program, and the kinematics and grasps of the driven trees."""
    driven = {joint for controller in world.controllers for joint in controller.joints}
    moved = [bodies for bodies in trees(world).values() if any(body.joint.name in driven for body in bodies)]
    names = {body.name for bodies in moved for body in bodies}
    trajectory = source.content.trajectory
    if trajectory is None:
        raise ValueError("a spec without a trajectory has no program")
    inputs = [
        trajectory.model_dump(include=set(OF_PROGRAMS)),
        [_kinematics(body) for body in world.bodies if body.name in names],
        to_plain(world.constraints),
        [to_plain(frame) for frame in world.frames if frame.body in names],
        sorted(driven),
        [_grasp(grasp) for grasp in known.values()],
    ]
    return hashlib.sha256(json.dumps(inputs, allow_nan=False).encode()).hexdigest()


def _kinematics(body: Body) -> list[Any]:
    return [
        body.name,
        to_plain(dataclasses.replace(body.joint, **WITHOUT_MOTION)),
        to_plain(body.inertial.centre_of_mass),
    ]


def _grasp(grasp: Grasp) -> list[Any]:
    forces = [[body, point.tolist(), force.tolist()] for body, point, force in grasp.forces]
    return [grasp.name, grasp.joints, grasp.open.tolist(), grasp.closed.tolist(), forces]
