"""Motion that no engine follows to round-off for long."""

from __future__ import annotations

import dataclasses

from simspec.world.types import World
from tests import worlds


def at_4_ms(kinds: list[str], seed: int, parents: list[int] | None = None, **joint: float) -> World:
    """A tree at 4 ms, for all engines."""
    physics = dataclasses.replace(worlds.every_joint().physics, timestep=0.004)
    return worlds.world(worlds.tree(kinds, seed, parents, **joint), physics=physics)


WILD = [
    (["free", "ball", "hinge"], 284, [-1, 0, 0], {}, "round-off alone"),
    # stiff for its timestep, and far from its springs' rest at first: a gentler beginning is found. Divergence ends with
    # whole turns in a step, and PyBullet turns nothing by more than π/4
    (["fixed", "hinge", "ball", "ball", "ball", "hinge"], 148, None, {"spring_stiffness": 20.0}, "turns by more than"),
    # flung out to 100 m, where one step of PyBullet is off by 1e-8
    (["free", "hinge", "hinge", "hinge", "slide"], 311, None, {"damping": 0.3}, "slides more than"),
    (["fixed", *["hinge"] * 7], 21, None, {}, ""),
]
