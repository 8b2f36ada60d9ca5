"""A world's initial state, tree by tree, for sidecars."""

from __future__ import annotations

from collections.abc import Iterable

from simspec.world.kinematics import initial_state, layout
from simspec.world.types import Body, World


class Coordinates:
    """The world's initial state in generalised coordinates, by body."""

    def __init__(self, world: World):
        self._q, self._v = initial_state(world)
        self._places = layout(world.bodies)
        self._index = {body.name: index for index, body in enumerate(world.bodies)}

    def of(self, bodies: Iterable[Body]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """The positions and velocities of these bodies, one after the other."""
        q: list[float] = []
        v: list[float] = []
        for body in bodies:
            index = self._index[body.name]
            q.extend(self._q[self._places.position[index]].tolist())
            v.extend(self._v[self._places.velocity[index]].tolist())
        return tuple(q), tuple(v)
