"""Worlds under an engine's own controllers, driven in this process."""

from __future__ import annotations

import numpy as np

from simspec.control.law import Control
from simspec.control.reference import reference
from simspec.engines.kit.contract import Actuation, Engine
from simspec.world.types import World


def at_work(engine: Engine, world: World, quick: bool = True):
    """A function that does so many steps more, and the control that it does them under."""
    control = Control(world, reference(world))
    joints = (engine.actuate if quick else lambda q, v: Actuation(engine, q, v))(control.q_places, control.v_places)
    native, at = control.native, control.native_places
    servos = engine.track(control.q_places[at], control.v_places[at], native.stiffness, native.damping, native.limit)
    done = 0

    def advance(count: int) -> np.ndarray:
        nonlocal done
        control.advance(joints, done, count, servos)
        done += count
        return joints.read()[0].copy()

    return advance, control
