"""Joints under an engine's own controllers, each alone on its base, and where the declared law takes them in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simspec.engines.kit.capabilities import ServoLaw
from simspec.testing import worlds
from simspec.world.actions import Controller, Trajectory
from simspec.world.types import Body, Inertial, Joint, Physics, World

GRAVITY = -9.81
END = 2.0
"""s at which the targets' motion ends; tests are shorter."""


@dataclass(frozen=True)
class Servo:
    """One joint with its controller. ``slide``: a vertical slide under gravity, with a mass in place of a moment of inertia."""

    name: str
    inertia: float = 0.02
    kp: float = 40.0
    kd: float = 3.0
    limit: float | None = None
    target: float = 0.5
    speed: float = 0.0
    """Of the target, rad/s."""
    slide: bool = False


SERVOS = (
    Servo("unlimited"),
    Servo("limited", limit=5.0),
    Servo("weak", limit=0.4),
    Servo("moving", target=0.0, speed=0.5),
    Servo("velocity", kp=0.0, target=0.0, speed=0.5),
    Servo("hanging", inertia=2.0, kp=1000.0, kd=100.0, target=0.1, slide=True),
)


def servo_world(timestep: float, servos: tuple[Servo, ...] = SERVOS) -> World:
    """All the servos side by side, each from rest at zero."""
    joints = tuple(f"{servo.name}_joint" for servo in servos)
    control = Controller(
        "all",
        joints,
        "native",
        kp=tuple(servo.kp for servo in servos),
        kd=tuple(servo.kd for servo in servos),
        effort_limits=tuple(servo.limit for servo in servos),
    )
    rows = tuple(tuple(servo.target + time * servo.speed for servo in servos) for time in (0.0, END))
    trajectory = Trajectory(joints, (0.0, END), rows, interpolation="linear")
    physics = Physics((0.0, 0.0, GRAVITY), timestep, round(END / timestep))
    return worlds.world(tuple(map(_body, servos)), physics=physics, controllers=(control,), trajectory=trajectory)


def _body(servo: Servo) -> Body:
    joint = Joint(
        f"{servo.name}_joint",
        "slide" if servo.slide else "hinge",
        axis=(0.0, 0.0, 1.0),
        position=(0.0,),
        velocity=(0.0,),
    )
    mass, moment = (servo.inertia, 0.1) if servo.slide else (1.0, servo.inertia)
    return Body(servo.name, servo.name, Inertial(mass, inertia=(moment, moment, moment, 0.0, 0.0, 0.0)), joint)


def closed_form(law: ServoLaw, servo: Servo, steps: int, dt: float) -> np.ndarray:
    """Positions of the joint at the start and after each step (steps + 1,), by what the law declares."""
    q = v = 0.0
    fall = GRAVITY if servo.slide else 0.0
    limit = math.inf if servo.limit is None else servo.limit
    kp, kd, inertia, speed = servo.kp, servo.kd, servo.inertia, servo.speed
    positions = [q]
    for step in range(steps):
        error = servo.target + speed * step * dt - q
        if law is ServoLaw.EXPLICIT_SPRING:
            effort = kp * error + kd * (speed - v)
        elif law is ServoLaw.IMPLICIT_SPRING:
            after = (v + dt * fall + dt / inertia * (kp * error + kd * speed)) / (1.0 + dt / inertia * (kd + dt * kp))
            effort = kp * (error - dt * after) + kd * (speed - after)
        else:
            effort = inertia * ((speed + kp / (kd + dt * kp) * error - v) / dt - fall)
        v += dt * (min(max(effort, -limit), limit) / inertia + fall)
        q += dt * v
        positions.append(q)
    return np.array(positions)
