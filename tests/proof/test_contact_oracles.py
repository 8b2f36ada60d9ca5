"""Every number that a contact scene expects, computed again here from the world's own laws, speeds and timestep."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.world.types import PairContact, World

SCENES = Path(__file__).resolve().parents[2] / "specs" / "contact"
GRAVITY = 9.81


@lru_cache
def scene(name: str) -> World:
    return simspec.load(SCENES / f"{name}.yaml").resolve()


def expected(name: str, kind: str) -> dict[str, dict]:
    """The parameters of the expectations of one kind, by body."""
    found = [dict(expectation.parameters) for expectation in scene(name).expectations if expectation.kind == kind]
    by_body = {entry["body"]: entry for entry in found}
    assert len(by_body) == len(found) > 0
    return by_body


def material(name: str, body: str) -> str:
    """The material of a body's shapes that take part in contact."""
    (entry,) = (entry for entry in scene(name).bodies if entry.name == body)
    (found,) = {shape.material for shape in entry.shapes if shape.collision}
    return found


def law(name: str, body: str, other: str) -> PairContact:
    two = {material(name, body), material(name, other)}
    (found,) = (pair for pair in scene(name).contact.pairs if {pair.first, pair.second} == two)
    return found


def velocity(name: str, body: str) -> np.ndarray:
    (entry,) = (entry for entry in scene(name).bodies if entry.name == body)
    return np.array(entry.joint.velocity)


def from_rest(name: str, acceleration: float) -> float:
    """The way in the scene's duration, by semi-implicit Euler steps."""
    physics = scene(name).physics
    return acceleration * physics.timestep**2 * physics.steps * (physics.steps + 1) / 2


def test_slide_24():
    dt = scene("slide-24").physics.timestep
    found = expected("slide-24", "displacement")
    for degrees in range(0, 360, 15):
        body = f"box_{degrees}"
        way = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0.0])
        np.testing.assert_allclose(velocity("slide-24", body)[:3], way, atol=1e-6)
        distance = 1.0 / (2 * law("slide-24", body, "floor").friction * GRAVITY) - dt / 2
        np.testing.assert_allclose(found[body]["xyz"], distance * way, atol=1e-6)
        assert found[body]["tolerance"] <= 0.015 * distance
    assert len(found) == 24


def test_ramp_grid():
    found = expected("ramp-grid", "displacement")
    slides = 0
    for body, entry in found.items():
        degrees = 25 if body in ("box_below", "box_above") else int(body.split("_")[1])
        friction = law("ramp-grid", body, "ramp_15").friction
        angle = math.radians(degrees)
        acceleration = GRAVITY * (math.sin(angle) - friction * math.cos(angle))
        assert entry["distance"] == pytest.approx(from_rest("ramp-grid", max(0.0, acceleration)), abs=1e-5), body
        slides += acceleration > 0.0
    assert (slides, len(found)) == (7, 14)


def test_the_boxes_near_the_limit_are_within_3_percent_of_it():
    limit = math.tan(math.radians(25))
    assert 0.965 < law("ramp-grid", "box_below", "ramp_15").friction / limit < 0.975
    assert 1.025 < law("ramp-grid", "box_above", "ramp_15").friction / limit < 1.035


def test_rolling_ramp():
    angle, radius, duration = math.radians(20), 0.1, 0.5
    grip, slick = (law("rolling-ramp", f"{name}_ball", "ramp").friction for name in ("grip", "slick"))
    assert slick < 2 / 7 * math.tan(angle) < grip
    rolls = 5 / 7 * GRAVITY * math.sin(angle)
    slips = GRAVITY * (math.sin(angle) - slick * math.cos(angle))
    wanted = {
        "grip_ball": (rolls, rolls / radius),
        "slick_ball": (slips, 5 * slick * GRAVITY * math.cos(angle) / (2 * radius)),
    }
    for body, (acceleration, angular) in wanted.items():
        way = from_rest("rolling-ramp", acceleration) * np.array([math.cos(angle), 0.0, -math.sin(angle)])
        np.testing.assert_allclose(expected("rolling-ramp", "displacement")[body]["xyz"], way, atol=1e-5)
        speed = expected("rolling-ramp", "angular_speed")[body]["speed"]
        assert speed == pytest.approx(angular * duration, abs=1e-4)


def test_bouncing_row():
    radius, drop = 0.1, 1.0
    for body, entry in expected("bouncing-row", "apex_height").items():
        ratio = law("bouncing-row", body, "floor").restitution
        assert entry["height"] == pytest.approx(radius + ratio**2 * drop)
        if ratio:  # 0.05 in e, which is what is promised
            assert entry["tolerance"] <= (ratio + 0.05) ** 2 * drop - ratio**2 * drop + 1e-3
        assert entry["after"] > math.sqrt(2 * drop / GRAVITY)


def test_oblique_impact():
    """Steps of one millisecond: flight, an impulse in the step after bodies overlap, and what friction may take of the slip."""
    name = "oblique-impact"
    dt, steps = scene(name).physics.timestep, scene(name).physics.steps
    moved, turned = expected(name, "displacement"), expected(name, "angular_speed")
    for body in ("grip_ball", "slip_ball", "box", "live_ball"):
        pair, share, lowest = law(name, body, "floor"), 1.0 if body == "box" else 2 / 7, 0.4
        (along,) = velocity(name, body)[:1]
        speed, fall, height, way, spin = along, 0.0, lowest, 0.0, {}
        bounced = False
        for step in range(steps):
            fall -= GRAVITY * dt
            impulse = 0.0
            if height < 0.0 and not (bounced and pair.restitution):
                after = 0.0 if bounced else -pair.restitution * (fall + GRAVITY * dt)
                impulse, fall, bounced = after - fall, after, True
            left = speed - (1.0 - share) * along  # the rest remains where the contact grips
            speed -= min(left, pair.friction * impulse)
            height, way = height + dt * fall, way + dt * speed
            spin[step + 1] = 2.5 / 0.1 * (along - speed)
        high = -lowest if not pair.restitution else height - lowest
        np.testing.assert_allclose(moved[body]["xyz"], (way, 0.0, high), atol=5e-4)
        if body != "box":
            assert turned[body]["at"] == pytest.approx(0.3)
            assert turned[body]["speed"] == pytest.approx(spin[300], abs=1e-3)
            assert turned[body]["tolerance"] <= 0.031 * spin[300]
    pair, reduced = law(name, "striker", "struck"), 0.75
    places = {body.name: np.array(body.joint.position[:3]) for body in scene(name).bodies if body.joint.position}
    values, other, relative = places["striker"], places["struck"], velocity(name, "striker")[:3]
    free = math.ceil(
        ((other - values)[0] - math.sqrt(0.2**2 - 0.1**2)) / (relative[0] * dt)
    )  # steps until they overlap
    line = other - values - free * dt * relative
    normal = line / np.linalg.norm(line)
    across = relative - (relative @ normal) * normal
    most = pair.friction * (1 + pair.restitution) * (relative @ normal)
    change = (1 + pair.restitution) * (relative @ normal) * normal
    change = change + across * min(2 / 7, most / np.linalg.norm(across))
    fallen = np.array([0.0, 0.0, -GRAVITY * dt**2 * steps * (steps + 1) / 2])
    for body, mass, sign in (("striker", 1.0, -1.0), ("struck", 3.0, 1.0)):
        way = velocity(name, body)[:3] * steps * dt + sign * reduced / mass * change * (steps - free) * dt + fallen
        np.testing.assert_allclose(moved[body]["xyz"], way, atol=3e-4)
        spin = 2.5 / 0.1 * reduced / mass * np.linalg.norm(change - (change @ normal) * normal)
        assert turned[body]["speed"] == pytest.approx(spin, abs=1e-3)
        assert turned[body]["tolerance"] <= 0.0305 * spin


def test_newtons_cradle():
    length, pivot = 0.4, 1.0
    found = expected("newtons-cradle", "apex_height")
    handed = (1 + law("newtons-cradle", "ball_1", "ball_2").restitution) / 2
    rise = handed**8 * length * (1 - math.cos(math.radians(30)))
    assert found["tip_5"]["height"] == pytest.approx(pivot - length + rise, abs=2e-5)


def test_card_house():
    """The card as one angle: its upper edge stays on the plane of symmetry, its foot slides out on the floor."""
    length, radius, mass, inertia, tilt = 0.4, 0.02, 0.5, 0.0075, math.radians(25)
    limit = 0.5 * length * math.sin(tilt) / (radius + length * math.cos(tilt))
    friction = law("card-house", "slick_left", "floor").friction
    assert friction < limit < law("card-house", "rough_left", "floor").friction
    half = length / 2

    def push(angle: float, rate: float, bend: float) -> float:
        """The residual torque about the centre for the second derivative ``bend`` of the angle; linear in it."""
        sine, cosine = math.sin(angle), math.cos(angle)
        normal = mass * (GRAVITY - half * (sine * bend + cosine * rate**2))
        wall = friction * normal + mass * half * (cosine * bend - sine * rate**2)
        torque = normal * (half * sine - friction * (half * cosine + radius)) - wall * half * cosine
        return torque - inertia * bend

    def rates(state: np.ndarray) -> np.ndarray:
        value = push(*state, 0.0)
        return np.array([state[1], value / (value - push(*state, 1.0))])

    state, step = np.array([tilt, 0.0]), 1e-3
    for _ in range(round(0.3 / step)):  # Runge and Kutta's fourth order
        values = rates(state)
        two = rates(state + step / 2 * values)
        three = rates(state + step / 2 * two)
        state = state + step / 6 * (values + 2 * two + 2 * three + rates(state + step * three))
    out, down = half * (math.sin(state[0]) - math.sin(tilt)), half * (math.cos(tilt) - math.cos(state[0]))
    found = expected("card-house", "displacement")
    np.testing.assert_allclose(found["slick_left"]["xyz"], [-out, 0.0, -down], atol=2e-4)
    np.testing.assert_allclose(found["slick_right"]["xyz"], [out, 0.0, -down], atol=2e-4)
    assert found["slick_left"]["at"] == 0.3
    assert found["rough_left"]["distance"] == found["rough_right"]["distance"] == 0.0


def test_spinning_disc():
    """Three feet at R: torque μ m g R, against the inertia ½ m R² of a disc."""
    friction, radius, duration = law("spinning-disc", "disc", "floor").friction, 0.1, 0.2
    (body,) = (body for body in scene("spinning-disc").bodies if body.name == "disc")
    assert body.inertial.inertia[2] == pytest.approx(body.inertial.mass * radius**2 / 2)
    spin = velocity("spinning-disc", "disc")[5] - 2 * friction * GRAVITY / radius * duration
    assert expected("spinning-disc", "angular_speed")["disc"]["speed"] == pytest.approx(spin, abs=1e-3)


def test_six_materials_agree_to_1_percent():
    physics = scene("six-materials").physics
    found = expected("six-materials", "displacement")
    pairs = set()
    for body, entry in found.items():
        assert velocity("six-materials", body)[:3] == pytest.approx([0.0, 1.0, 0.0])
        pair = law("six-materials", body, f"{body.split('_on_')[1]}_tile")
        lost = from_rest("six-materials", pair.friction * GRAVITY)
        way = physics.steps * physics.timestep - lost
        np.testing.assert_allclose(entry["xyz"], [0.0, way, 0.0], atol=1e-6)
        assert entry["tolerance"] <= 0.0101 * lost
        pairs.add((pair.first, pair.second))
    assert len(pairs) == 21
