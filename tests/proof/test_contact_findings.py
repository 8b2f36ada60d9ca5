"""Results of the scenes for the engines (docs/concepts/scenes.md), each under its law. If a later version differs, the page is
wrong and these tests fail."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.runner.run import Run
from simspec.support.features import Feature
from tests.declared import with_the_cone

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = with_the_cone(Feature.RESTITUTION)

SCENES = Path(__file__).resolve().parents[2] / "specs" / "contact"
GRAVITY = 9.81
FRICTION = 0.5
OBLONG = (0.4, 0.1, 0.04)
"""m: four times as long as wide."""
DIRECTIONS = (0, 30, 45, 60, 90)


def world_of(name: str, duration: float, bodies: dict, *, accepting=()):
    """Bodies of one material on a floor; ``accepting``: approximations of PyBullet."""
    floor = {"box": {"size": [8, 8, 1]}, "pose": {"xyz": [0, 0, -0.5]}, "material": "floor"}
    data = {
        "simspec": 1,
        "name": name,
        "physics": {"timestep": 0.001, "duration": duration},
        "contact": {
            "friction_cone": "elliptic",
            "materials": {"floor": {"friction": FRICTION}},
            "groups": {"separate": {"ignores": ["separate"]}},
        },
        "bodies": {"ground": {"fixed": True, "shapes": [floor]}, **bodies},
        "record": {"every": 0.01, "channels": ["pose", "velocity", "contacts"]},
        "engines": {
            "mujoco": {"accept": ["contact.friction.impact"]},
            "pybullet": {"accept": ["contact.cone.elliptic", *accepting]},
            "physx": {"accept": ["contact.cone.elliptic", "shape.box"]},
        },
    }
    return simspec.Spec.from_data(data).resolve()


@lru_cache
def oblong(engine: str) -> Run:
    """Oblong boxes along x that slide at 1 m/s in several directions."""
    bodies = {}
    for index, degrees in enumerate(DIRECTIONS):
        way = [math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0]
        bodies[f"box_{degrees}"] = {
            "pose": {"xyz": [1.5 * (index - 2), 0, OBLONG[2] / 2]},
            "velocity": {"linear": way},
            "mass": 1,
            "shapes": [{"box": {"size": list(OBLONG)}, "material": "floor"}],
        }
    return simspec.run(world_of("oblong", 0.4, bodies), engine)


def moved(run: Run, body: str) -> np.ndarray:
    poses = run.arrays["pose"][:, run.index[body], :2]
    return poses[-1] - poses[0]


def slide(degrees: float, mobility: np.ndarray, step: float = 0.001) -> np.ndarray:
    """Way of a box at 1 m/s whose friction, of size μ m g, acts against the slip divided by ``mobility`` along each axis."""
    velocity = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    way = np.zeros(2)
    while np.linalg.norm(velocity) > FRICTION * GRAVITY * step:
        against = velocity / mobility
        velocity = velocity - FRICTION * GRAVITY * step * against / np.linalg.norm(against)
        way = way + velocity * step
    return way


def corner_mobility() -> np.ndarray:
    """How easily a unit impulse at a lower corner moves that corner along x and along y, 1/kg, of a box of 1 kg."""
    x, y, z = (edge / 2 for edge in OBLONG)
    about_x, about_y, about_z = (y * y + z * z) / 3, (x * x + z * z) / 3, (x * x + y * y) / 3
    return np.array([1 + z * z / about_y + y * y / about_z, 1 + z * z / about_x + x * x / about_z])


@pytest.mark.parametrize("engine", [name for name in ENGINES if name not in ("pybullet", "rapier")])
@pytest.mark.parametrize("degrees", DIRECTIONS)
def test_an_oblong_box_slides_straight(engine, degrees):
    way = slide(degrees, np.ones(2))
    np.testing.assert_allclose(moved(oblong(engine), f"box_{degrees}"), way, atol=0.015 * np.linalg.norm(way))


@pytest.mark.parametrize("degrees", DIRECTIONS)
def test_pybullets_oblong_box_curves_as_its_solver_makes_it(degrees):
    found = moved(oblong("pybullet"), f"box_{degrees}")
    np.testing.assert_allclose(found, slide(degrees, corner_mobility()), atol=5e-4)
    away = np.linalg.norm(found - slide(degrees, np.ones(2)))
    assert (away < 5e-4) if degrees % 90 == 0 else (away > 0.02)


@pytest.mark.parametrize(("engine", "further"), [("dart", 0.0), ("mujoco", 0.0), ("pybullet", 0.077)])
def test_a_turned_square_box_that_slides_obliquely(engine, further):
    """At 45°, turned by 22.5°: PyBullet's corners push one another aside, and brake too little together."""
    turn, way = math.radians(22.5) / 2, [math.sqrt(0.5), math.sqrt(0.5), 0]
    box = {
        "pose": {"xyz": [0, 0, 0.02], "quat": [math.cos(turn), 0, 0, math.sin(turn)]},
        "velocity": {"linear": way},
        "mass": 1,
        "shapes": [{"box": {"size": [0.2, 0.2, 0.04]}, "material": "floor"}],
    }
    run = simspec.run(world_of("turned", 0.4, {"box": box}), engine)
    distance = 1 / (2 * FRICTION * GRAVITY) - 0.0005
    assert moved(run, "box") @ way[:2] / distance - 1 == pytest.approx(further, abs=0.015)


@pytest.mark.parametrize("spin", [0, 10, 30])
def test_pybullets_tripod_goes_as_its_solver_makes_it(spin):
    """The same law at three feet that turn: nearer to it than to the equations of the scene."""
    friction, arm, inertia, duration, step = 0.3, 0.1, 0.01, 0.3, 1e-4
    feet = arm * np.array([[math.cos(a), math.sin(a)] for a in (0.0, 2 * math.pi / 3, 4 * math.pi / 3)])
    place, velocity, angle, rate = np.zeros(2), np.array([1.0, 0.0]), 0.0, float(spin)
    for _ in range(round(duration / step)):
        cosine, sine = math.cos(angle), math.sin(angle)
        levers = feet @ np.array([[cosine, sine], [-sine, cosine]])
        slip = velocity + rate * np.column_stack([-levers[:, 1], levers[:, 0]])
        against = slip / (1 + levers[:, ::-1] ** 2 / inertia)
        force = -friction * GRAVITY / 3 * against / np.linalg.norm(against, axis=1, keepdims=True)
        velocity = velocity + step * force.sum(axis=0)
        rate += step * float((levers[:, 0] * force[:, 1] - levers[:, 1] * force[:, 0]).sum()) / inertia
        place, angle = place + step * velocity, angle + step * rate
    run = simspec.run(simspec.load(SCENES / "tripod.yaml").resolve(), "pybullet")
    np.testing.assert_allclose(moved(run, f"tripod_{spin}"), place, atol=6e-4)


@pytest.mark.parametrize(
    ("engine", "arm", "tolerance"),
    [("dart", 1 / math.cos(math.pi / 8), 0.005), ("mujoco", 1.0, 0.005), ("pybullet", 0.974, 0.02)],
)
def test_where_the_contacts_of_a_flat_face_act(engine, arm, tolerance):
    """A flat disc's torque over μ m g R: DART's contacts are the corners of the octagon around the face, MuJoCo's lie on
    its rim; PyBullet's do too, with friction that is not quite against the slip."""
    radius, before, after = 0.1, 5, 15
    disc = {
        "pose": {"xyz": [0, 0, 0.01]},
        "velocity": {"angular": [0, 0, 20]},
        "mass": 1,
        "shapes": [{"cylinder": {"radius": radius, "length": 0.02}, "material": "floor"}],
    }
    world = world_of("flat-disc", 0.2, {"disc": disc}, accepting=("shape.cylinder",))
    run = simspec.run(world, engine)
    spin = run.arrays["velocity"][:, run.index["disc"], 5]
    slowing = (spin[before] - spin[after]) / (run.time[after] - run.time[before])
    assert slowing * radius / (2 * FRICTION * GRAVITY) == pytest.approx(arm, abs=tolerance)


STOOD = (0.9, 0.98, 1.05, 1.12)
"""How far the weight of an upright cylinder on a slope points from its axis at the face, over the radius; it tips beyond 1."""


@pytest.mark.parametrize(("engine", "stands"), [("dart", STOOD[:3]), ("mujoco", STOOD[:1]), ("pybullet", STOOD[:2])])
def test_when_a_cylinder_tips(engine, stands):
    """An octagon around the face carries DART's to 1.08 where a corner points downhill; MuJoCo's soft first layer lets it
    lean before it should."""
    angle, radius = math.radians(20), 0.05
    # not slipping wants μ ≥ tan 20° = 0.36
    tilt = [math.cos(angle / 2), 0, math.sin(angle / 2), 0]
    face = {"box": {"size": [8, 8, 0.2]}, "pose": {"xyz": [0, 0, -0.1]}, "material": "floor"}
    bodies = {"slope": {"fixed": True, "pose": {"xyz": [0, 0, 5], "quat": tilt}, "shapes": [face]}}
    for index, share in enumerate(STOOD):
        half = share * radius / math.tan(angle)
        bodies[f"cylinder_{index}"] = {
            "pose": {"xyz": [half * math.sin(angle), index - 1.5, 5 + half * math.cos(angle)], "quat": tilt},
            "mass": 1,
            "collision_group": "separate",
            "shapes": [{"cylinder": {"radius": radius, "length": 2 * half}, "material": "floor"}],
        }
    run = simspec.run(world_of("tipping", 0.6, bodies), engine)
    leaning = []
    for index in range(len(STOOD)):
        quaternion = run.arrays["pose"][-1, run.index[f"cylinder_{index}"], 3:]
        upward = 1 - 2 * (quaternion[1] ** 2 + quaternion[2] ** 2)
        leaning.append(math.degrees(math.acos(upward) - angle))
    assert tuple(share for share, lean in zip(STOOD, leaning, strict=True) if abs(lean) < 1) == stands
    assert all(abs(lean) < 1 or lean > 10 for lean in leaning)


def cradle(engine: str, gap: float) -> np.ndarray:
    """Speeds (5,) of the balls after the impacts, over that of the first before them: e = 1, gaps of ``gap`` (m)."""
    sets = [f"bodies.ball_{number + 1}.joint.origin.xyz=[{number * (0.05 + gap):.12f}, 0, 0]" for number in range(1, 5)]
    sets.append("contact.materials.steel.restitution=1")
    run = simspec.run(simspec.load(SCENES / "newtons-cradle.yaml", sets=sets).resolve(), engine)
    arrives = math.sqrt(2 * GRAVITY * 0.4 * (1 - math.cos(math.radians(30))))
    row = int(np.searchsorted(run.time, 0.34))  # it arrives at 0.32 s
    return np.array([run.arrays["velocity"][row, run.index[f"tip_{number}"], 0] for number in range(1, 6)]) / arrives


LAST_ALONE = [0, 0, 0, 0, 1]
ALL_AT_ONCE = [-0.6, 0.4, 0.4, 0.4, 0.4]
"""Newton's law at all contacts in one instant, where only the first two approach: they part at the speed of approach, and
the others, which press on each other, do not part."""


# Rapier has contacts from 1 µm on, its prediction distance; PhysX has no hinges
@pytest.mark.parametrize("engine", [name for name in ENGINES if name not in ("physx", "rapier")])
def test_balls_of_a_cradle_with_gaps_of_a_nanometre_collide_in_sequence(engine):
    np.testing.assert_allclose(cradle(engine, 1e-9), LAST_ALONE, atol=0.03)


@pytest.mark.parametrize(
    ("engine", "wanted"), [("dart", ALL_AT_ONCE), ("mujoco", LAST_ALONE), ("pybullet", LAST_ALONE)]
)
def test_the_balls_of_a_cradle_that_overlap_by_a_nanometre_are_up_to_the_engine(engine, wanted):
    """Why the scene has gaps: which law holds for simultaneous impacts is the engine's own."""
    np.testing.assert_allclose(cradle(engine, -1e-9), wanted, atol=0.03)
