"""Runs made by hand, whose every measure has a known value."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simspec.engines.kit.arrays import CONTACT_FIELDS, empty_contacts
from simspec.runner.run import SCHEMA, Run
from simspec.world.canonical import sha256
from simspec.world.kinematics import layout
from simspec.world.types import Body, Contact, Expectation, Inertial, Joint, Physics, World

SPHERE = (0.4, 0.4, 0.4, 0.0, 0.0, 0.0)


def free_body(
    name: str, mass: float = 2.0, centre: tuple[float, ...] = (0.0, 0.0, 0.0), inertia: tuple = SPHERE
) -> Body:
    """A free body at the origin."""
    joint = Joint(f"{name}_joint", "free", position=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)
    return Body(name, name, Inertial(mass, centre, inertia), joint)


def world(*bodies: Body, expect: tuple[Expectation, ...] = (), steps: int = 100, gravity: float = -10.0) -> World:
    """A world of ``bodies`` at a timestep of 10 ms, without contact laws."""
    return World(
        "synthetic",
        bodies,
        contact=Contact(),
        physics=Physics((0.0, 0.0, gravity), 0.01, steps),
        expectations=expect,
    )


def run(
    of: World,
    place: Callable[[str, np.ndarray], np.ndarray] | None = None,
    speed: Callable[[str, np.ndarray], np.ndarray] | None = None,
    engine: str = "first",
    contacts: list[tuple[int, int, int, float, float]] | None = None,
    **facts: object,
) -> Run:
    """A run of ``of`` in which body ``name`` is at ``place(name, t)`` (rows, 3) or (rows, 7) with velocity
    ``speed(name, t)`` (rows, 3) or (rows, 6); ``contacts`` are (row, body, body, distance, force)."""
    step = np.arange(0, of.physics.steps + 1, 10)
    time = step * of.physics.timestep
    bodies = of.bodies
    pose = np.zeros((len(time), len(bodies), 7))
    pose[..., 3] = 1.0
    velocity = np.zeros((len(time), len(bodies), 6))
    for index, body in enumerate(bodies):
        for function, target in ((place, pose), (speed, velocity)):
            if function is not None:
                values = np.asarray(function(body.name, time))
                target[:, index, : values.shape[1]] = values
    size = layout(bodies)
    arrays = {
        "step": step,
        "time": time,
        "q": np.zeros((len(time), size.nq)),
        "v": np.zeros((len(time), size.nv)),
        "pose": pose,
        "velocity": velocity,
        "energy": np.zeros((len(time), 2)),
    }
    rows = contacts or []
    arrays["contact.row"] = np.array([row[0] for row in rows], dtype=np.int64)
    empty = empty_contacts()
    for name in CONTACT_FIELDS:
        arrays[f"contact.{name}"] = np.zeros((len(rows), *CONTACT_FIELDS[name]), dtype=empty[name].dtype)
    arrays["contact.body"] = np.array([row[1:3] for row in rows], dtype=np.int64).reshape(-1, 2)
    arrays["contact.distance"] = np.array([row[3] for row in rows], dtype=float)
    arrays["contact.normal_force"] = np.array([row[4] for row in rows], dtype=float)
    provenance = {
        "schema": SCHEMA,
        "world_sha256": sha256(of),
        "engine": engine,
        "engine_version": "1.0",
        "steps": of.physics.steps,
        "seconds": {"step": 0.5, "cpu": 0.25, "process": 2.0},
        **facts,
    }
    spent = np.outer(np.arange(len(step)), (0.5, 0.25, 0.0, 0.0, 0.1, 0.1)) / max(1, len(step) - 1)
    return Run(of, engine, arrays, provenance, seconds=spent)


def column(*values: np.ndarray | float) -> np.ndarray:
    """Columns from arrays over time and constants."""
    rows = max(np.size(value) for value in values)
    return np.stack([np.broadcast_to(np.asarray(value, dtype=float), (rows,)) for value in values], axis=-1)
