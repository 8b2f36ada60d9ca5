"""Contacts of one body that act on each other: friction that changes the normal force by which it is bound, and one body that
hits two at once."""

from __future__ import annotations

import math

import numpy as np
import pytest

import simspec
from tests.installed import INSTALLED

pytestmark = pytest.mark.usefixtures("warm_engines")

ACCEPT = {"gazebo": ["contact.cone.elliptic"], "dart": ["shape.capsule"], "rapier": ["contact.cone.elliptic"]}
DIRECT = ("ode", "gazebo", "dart")
"""Engines whose direct solver bounds friction by the normal forces of the problem without friction."""
PYRAMID = "pyramid-circumscribed"


def _run(engine, bodies, pairs, materials, cone=PYRAMID, duration=0.4, gravity=9.81):
    if engine not in INSTALLED:
        pytest.skip(f"{engine} is not installed")
    spec = {
        "simspec": 1,
        "name": "coupled",
        "physics": {"timestep": 1e-3, "duration": duration, "gravity": [0, 0, -gravity]},
        "contact": {"friction_cone": cone, "materials": materials, "pairs": pairs},
        "bodies": bodies,
        "record": {"every": 1e-2, "channels": ["pose", "velocity"]},
        "engines": {engine: {"accept": ACCEPT.get(engine, [])}},
    }
    return simspec.run(simspec.Spec.from_data(spec).resolve(), engine)


def _moved(run, body):
    places = run.arrays["pose"][:, run.index[body], :3]
    return float(np.linalg.norm(places[-1] - places[0]))


def _leaning(engine, share, degrees=60.0):
    """How far a rod moves that leans on a smooth wall, with ``share`` of the friction that it needs, 1 / (2 tan θ)."""
    angle = math.radians(degrees)
    friction, radius = share / (2.0 * math.tan(angle)), 0.02
    x, z = math.cos(angle), math.sin(angle)
    static = [
        {"box": {"size": [9, 9, 1]}, "pose": {"xyz": [0, 0, -0.5]}, "material": "floor"},
        {"box": {"size": [1, 9, 9]}, "pose": {"xyz": [x + radius + 0.5, 0, 4]}, "material": "wall"},
    ]
    pose = {"xyz": [x / 2, 0, z / 2 + radius], "rpy": [0, math.pi / 2 - angle, 0]}
    rod = {"mass": 2, "pose": pose, "shapes": [{"capsule": {"radius": radius, "length": 1}, "material": "rod"}]}
    pairs = [
        {"between": ["floor", "rod"], "friction": friction},
        {"between": ["wall", "rod"], "friction": 0},
        {"between": ["floor", "wall"], "friction": 0},
    ]
    materials = {"floor": {"friction": friction}, "wall": {"friction": 0}, "rod": {"friction": friction}}
    return _moved(_run(engine, {"still": {"fixed": True, "shapes": static}, "rod": rod}, pairs, materials), "rod")


@pytest.mark.parametrize("engine", DIRECT)
def test_a_rod_leans_on_a_smooth_wall_where_friction_is_enough(engine):
    assert _leaning(engine, 1.12) < 1e-4
    assert _leaning(engine, 0.9) > 1e-2


def _clamp(engine, share, cone):
    """How far a body falls that holds itself by two balls on both sides of a post, 0.2 m different in height, its centre of
    mass 0.2 m to the side: without friction nothing presses them on. They overlap the post by 10 µm."""
    sides = [[-0.2 - 0.07 + 1e-5, 0, 0.1], [-0.2 + 0.07 - 1e-5, 0, -0.1]]
    post = {"fixed": True, "shapes": [{"box": {"size": [0.1, 0.1, 2]}, "material": "m"}]}
    shapes = [{"sphere": {"radius": 0.02}, "pose": {"xyz": side}, "material": "m"} for side in sides]
    clamped = {"mass": 1, "inertia": {"principal": [0.02] * 3}, "pose": {"xyz": [0.2, 0, 0]}, "shapes": shapes}
    run = _run(engine, {"post": post, "held": clamped}, [], {"m": {"friction": 0.5 * share}}, cone, duration=0.2)
    return _moved(run, "held")


@pytest.mark.parametrize(("engine", "cone"), [("ode", PYRAMID), ("ode", "elliptic"), ("gazebo", PYRAMID)])
def test_a_clamp_holds_by_its_weight(engine, cone):
    assert _clamp(engine, 1.1, cone) < 1e-4
    assert _clamp(engine, 0.9, cone) > 1e-2


@pytest.mark.parametrize("engine", ["rapier", "ode"])
@pytest.mark.parametrize("restitution", [0.5, 1.0])
def test_a_ball_that_hits_two_at_once_makes_no_energy(engine, restitution):
    """By symmetry each struck ball leaves along its line of centres, at 30° to the vertical, by P = (1 + e) v cos 30° /
    (1 + 2 cos² 30°), and the first keeps v − 2 P cos 30°."""
    radius, speed, slant = 0.1, 2.0, math.cos(math.pi / 6)

    def ball(x, z, fall):
        shapes = [{"sphere": {"radius": radius}, "material": "b"}]
        return {"mass": 1, "pose": {"xyz": [x, 0, z]}, "velocity": {"linear": [0, 0, -fall]}, "shapes": shapes}

    height = radius * math.sqrt(3.0) + 1e-3
    bodies = {"left": ball(-radius, 0, 0), "right": ball(radius, 0, 0), "top": ball(0, height, speed)}
    law = {"friction": 0, "restitution": restitution}
    run = _run(engine, bodies, [{"between": ["b", "b"], **law}], {"b": law}, "elliptic", 0.05, gravity=0.0)
    last = {name: run.arrays["velocity"][-1, row, :3] for name, row in run.index.items()}
    push = (1.0 + restitution) * speed * slant / (1.0 + 2.0 * slant**2)
    assert last["top"][2] == pytest.approx(-speed + 2.0 * push * slant, abs=0.01)
    for name in ("left", "right"):
        assert np.linalg.norm(last[name]) == pytest.approx(push, rel=0.01)
    assert sum(0.5 * v @ v for v in last.values()) <= 0.5 * speed**2 * 1.001
