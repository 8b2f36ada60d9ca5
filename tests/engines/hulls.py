"""Hulls for tests of engines that hold convex hulls, and tests that all of these must pass."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.errors import EngineError
from simspec.proof.verify import read_back_checks
from simspec.testing.bench import failures
from simspec.world.hull import HullError, centred, corners, mesh_size
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Inertial, Pose, Shape
from tests.engines.free_bodies import ball, of, scene


def random_hull(seed: int, points: int = 20) -> tuple[float, ...]:
    """The hull of so many points on an ellipsoid, of 0.1 to 0.4 m, in its own principal frame."""
    draw = np.random.default_rng(seed)
    found = draw.normal(size=(points, 3))
    found *= draw.uniform(0.05, 0.2, 3) / np.linalg.norm(found, axis=1)[:, None]
    return mesh_size(centred(found[corners(found)])[1])


def prism(sides: int, radius: float = 0.1, height: float = 0.1) -> tuple[float, ...]:
    """A prism that stands along z."""
    turns = 0.1 + 2.0 * np.pi * np.arange(sides) / sides
    rim = np.stack([radius * np.cos(turns), radius * np.sin(turns)], axis=1)
    ends = [np.column_stack([rim, np.full(sides, end)]) for end in (-0.5 * height, 0.5 * height)]
    return mesh_size(np.concatenate(ends))


def cube(edge: float) -> tuple[float, ...]:
    """A cube as a hull."""
    signs = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return mesh_size(edge * signs)


def solid(name: str, size: tuple[float, ...], at: tuple[float, float, float], turn=(1.0, 0.0, 0.0, 0.0)) -> Body:
    """A free body of 2 kg that is a hull, or of three numbers a box."""
    kind = "box" if len(size) == 3 else "mesh"
    body = ball(name, at, kind=kind, size=size, turn=turn)
    return dataclasses.replace(body, inertial=Inertial(2.0, inertia=(*SHAPES[kind].moments(size, 2.0), 0.0, 0.0, 0.0)))


def static_body(name: str, kind: str, size: tuple[float, ...], at: tuple[float, float, float]) -> Body:
    """A fixed body, of the material of the moving bodies."""
    body = ball(name, at)
    joint = dataclasses.replace(body.joint, kind="fixed", origin=Pose(at), position=(), velocity=())
    shape = Shape(name, kind, size, material="m")
    return dataclasses.replace(body, joint=joint, inertial=Inertial(0.0), shapes=(shape,))


def check_corners(load, engine, size: tuple[float, ...]) -> None:
    """Hulls are read back as written, and a corner that is moved, omitted or added is found."""
    world = scene(solid("hull", size, (0.0, 0.0, 1.0)))
    back = load(world).read_back()
    assert failures(read_back_checks(world, engine, back)) == []
    stored = next(body for body in back.bodies if body.name == "hull").shapes[0].size
    assert sorted(np.float32(stored).reshape(-1, 3).tolist()) == sorted(np.float32(size).reshape(-1, 3).tolist())
    changes = {
        "moved": lambda points: points.__setitem__(4, points[4] * (1.0 + 1e-4)),
        "left out": lambda points: points.__delitem__(slice(0, 3)),
        "added": lambda points: points.extend([0.0, 0.0, 0.3]),
    }

    def seen(change) -> bool:
        """Whether the engine refuses it, or its read-back shows it."""
        try:
            other = load(world, lambda content, _: change(of("hull")(content)["shapes"][0]["size"]))
        except EngineError:
            return True
        return bool(failures(read_back_checks(world, engine, other.read_back())))

    assert [name for name, change in changes.items() if not seen(change)] == []


def check_stands(load, floor: Body | None, moving: list[Body], seconds: float = 0.5) -> None:
    """A body at rest on the floor stays in place within 10 µm and 1 mrad."""
    world = scene(*([floor] if floor else []), *moving)
    engine = load(world)
    before = engine.get_state()[0].reshape(-1, 7)
    engine.step(round(seconds / world.physics.timestep))
    after = engine.get_state()[0].reshape(-1, 7)
    assert after[:, :3] == pytest.approx(before[:, :3], abs=1e-5)
    assert after[:, 4:] == pytest.approx(before[:, 4:], abs=5e-4)


def many(count: int) -> list[tuple[float, ...]]:
    """Hulls of all forms and of 4 to 150 corners."""
    draw, found = np.random.default_rng(5), []
    while len(found) < count:
        points = draw.normal(size=(int(draw.integers(5, 150)), 3))
        match len(found) % 4:
            case 0:
                points /= np.linalg.norm(points, axis=1)[:, None]
            case 1:
                points[:, 2] = np.sign(points[:, 2])
            case 2:
                points = np.round(3.0 * points) / 3.0
        points *= draw.uniform(0.02, 1.0, 3) * 10.0 ** draw.uniform(-2.0, 0.0)
        try:
            found.append(mesh_size(centred(points[corners(points)])[1]))
        except HullError:
            continue
    return found
