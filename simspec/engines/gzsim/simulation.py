"""A world in gz sim, in its initial state: states, steps, efforts.

Two servers hold it. One steps it. The other holds it without weight, friction and limits in steps of a nanosecond, and is asked
where its links are in a given state: gz sim has no state that could be set and read without a step. Velocities are put there
a million times smaller, so that nothing moves by what could be read, and read as many times larger.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.dialects.kit.world_sidecar import WorldSidecar
from simspec.engines.gzsim.bindings import NAME, bindings
from simspec.engines.gzsim.building import Plan
from simspec.engines.gzsim.server import Before, Server
from simspec.engines.kit.arrays import empty_contacts
from simspec.errors import EngineError
from simspec.formats.world.format import WorldJson
from simspec.formats.world.tree import AxisJoint, FreeJoint, initial_coordinates
from simspec.world.rotations import multiply, unit
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE

SLOW: Final = 1e-6
"""By which velocities are multiplied where nothing may move."""
ASIDE: Final = 0.5
"""m, rad: how far bodies are put aside before they are put where they are asked. gz sim tells poses and velocities of links
that have moved by 1e-6 since it last told them, and of no others."""
_TURN = np.array([np.cos(0.25), 0.0, np.sin(0.25), 0.0])
UNASKED = "tells nothing of its dynamics"
NOT_FINITE = "a state or effort is not finite"


class Simulation:
    """A loaded world. Coordinates are those of ``world/kinematics.py``."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        try:
            self.document = WorldJson().read(folder)
            told = WorldSidecar.of(sidecar)
            told.check_document(self.document)
        except (ValueError, FileNotFoundError) as error:
            raise EngineError(NAME, str(error)) from error
        self.constraints, self.sums, self.passive = told.constraints or (), told.sums or (), told.passive
        bodies = self.document.bodies
        self.names = [body.name for body in bodies]
        self.offsets = np.array([body.frame_offset for body in told.bodies], dtype=float).reshape(-1, 3)
        kinds = [body.joint.kind for body in bodies]
        q = np.cumsum([0, *(POSITION_SIZE[kind] for kind in kinds)])
        v = np.cumsum([0, *(VELOCITY_SIZE[kind] for kind in kinds)])
        self.q_places = [slice(a, b) for a, b in zip(q[:-1].tolist(), q[1:].tolist(), strict=True)]
        self.v_places = [slice(a, b) for a, b in zip(v[:-1].tolist(), v[1:].tolist(), strict=True)]
        self._nq, self._nv = int(q[-1]), int(v[-1])
        self._axes = [row for row, body in enumerate(bodies) if isinstance(body.joint, AxisJoint)]
        self._free = [row for row, body in enumerate(bodies) if isinstance(body.joint, FreeJoint)]
        self.plan = Plan(self.document)
        self._own()
        self._modules = bindings()
        self._smooth: frozenset[int] = frozenset()
        self._still = self._server(self.plan.still())
        self._moving: Server | None = None
        self.set_state(*map(np.array, initial_coordinates(self.document)))

    def _own(self) -> None:
        """Damping, stiffness and rest (nq, nv) of the joints, which gz sim is given as efforts."""
        self.damping, self._stiffness, self._rest = np.zeros(self._nv), np.zeros(self._nv), np.zeros(self._nv)
        self._at = np.array([self.q_places[row].start for row in self._axes], dtype=np.intp)
        self._in = np.array([self.v_places[row].start for row in self._axes], dtype=np.intp)
        for row in self._axes:
            joint, place = self.document.bodies[row].joint, self.v_places[row]
            assert isinstance(joint, AxisJoint)
            self.damping[place] = joint.damping
            self._stiffness[place], self._rest[place] = joint.spring_stiffness, joint.spring_rest

    def _server(self, text: str) -> Server:
        return Server(self._modules, text, self.document.bodies, self.plan.roots, self.q_places, self.v_places)

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Let the next step begin at (q, v). Raises EngineError for a state that is not finite."""
        q, v = np.array(q, dtype=float), np.array(v, dtype=float)
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise EngineError(NAME, NOT_FINITE)
        for row in self._free:
            turn = slice(self.q_places[row].stop - 4, self.q_places[row].stop)
            q[turn] = unit(q[turn])
        self._q, self._v = q, v
        self._pending = True

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v): what the last step told; of a state that was set, what the server that does not move tells of it."""
        if not self._pending:
            return self._q.copy(), self._v.copy()
        q, v, _, _ = self._look()
        return q, v

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them, at the present coordinates."""
        _, _, poses, velocities = self._look()
        return poses, velocities

    def _look(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(q, v), poses and velocities that the server which does not move tells at the present coordinates."""
        aside = self._aside()
        # each by another length, so that no two of them bring a link back to where it was
        aside[self._at] += ASIDE * (1.0 + np.arange(len(self._at)) / np.e)
        server, found = self._still, []

        def before(info: Any, components: Any, step: int) -> None:
            server.watch(components)
            server.put(components, *((self._q, self._v * SLOW) if step else (aside, np.zeros(self._nv))))

        def after(components: Any) -> None:
            rows = range(len(self.names))
            poses = np.array([server.pose(components, row) for row in rows]).reshape(-1, 7)
            velocities = np.array([server.velocity(components, row) for row in rows]).reshape(-1, 6)
            found.append((*server.state(components), poses, velocities))

        server.run(2, before, after)
        q, v, poses, velocities = found[-1]
        return q, v / SLOW, poses, velocities / SLOW

    def _aside(self) -> np.ndarray:
        """The present coordinates with all free roots put aside."""
        found = self._q.copy()
        for row in self._free:
            place = self.q_places[row]
            found[place.start : place.start + 3] += ASIDE
            found[place.stop - 4 : place.stop] = multiply(found[place.stop - 4 : place.stop], _TURN)
        return found

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the damping and springs of the joints."""
        given = np.zeros(self._nv) if effort is None else np.asarray(effort, dtype=float)
        if not np.isfinite(given).all():
            raise EngineError(NAME, NOT_FINITE)
        server = self._stepping()
        if self._pending and self._free and count:
            server.run(1, self._put_aside, lambda components: None)

        def before(info: Any, components: Any, step: int) -> None:
            if self._pending:
                server.watch(components)
                server.put(components, self._q, self._v)
            server.push(components, self._q, given + self._own_effort())

        server.run(count, before, self._take)
        if not (np.isfinite(self._q).all() and np.isfinite(self._v).all()):
            raise EngineError(NAME, "a step led to a state that is not finite")

    def _put_aside(self, info: Any, components: Any, step: int) -> None:
        """For a step whose end is of no use: what has not moved since a state before would not be told, and poses that are
        commanded would hold at the beginning of the next step, too (``server.py``)."""
        self._stepping().put(components, self._aside(), np.zeros(self._nv))

    def _take(self, components: Any) -> None:
        self._q, self._v = self._stepping().state(components)
        self._pending = False

    def _own_effort(self) -> np.ndarray:
        found: np.ndarray = -self.damping * self._v
        found[self._in] -= self._stiffness[self._in] * (self._q[self._at] - self._rest[self._in])
        return found

    def _stepping(self) -> Server:
        if self._moving is None:
            self._moving = self._server(self.plan.text(self._smooth))
        return self._moving

    def asked(self, ask: Callable[[Server, Any, Any], None]) -> None:
        """Have ``ask`` called with a new server, before its first step: links are where SDF has them, joints at 0."""
        server = self._server(self.plan.text(self._smooth))

        def before(info: Any, components: Any, step: int) -> None:
            ask(server, info, components)

        told: Before = before
        try:
            server.run(1, told, lambda components: None)
        finally:
            server.close()

    # --- what there is none of --------------------------------------------------------------------------------

    def contacts(self) -> dict[str, np.ndarray]:
        """None: gz sim is told no shapes."""
        return empty_contacts()

    def disable_contact(self) -> None:
        """There is none."""

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """Take the dry friction of the joints at the places ``v`` (n,) away: by a new server."""
        rows = {place.start: row for row, place in enumerate(self.v_places) if place.stop > place.start}
        smooth = self._smooth | {rows[place] for place in np.asarray(v, dtype=int).tolist()}
        if smooth != self._smooth:
            self._smooth, self._pending = smooth, True
            self._drop()

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Not to be asked."""
        raise EngineError(NAME, UNASKED)

    def bias(self) -> np.ndarray:
        """Not to be asked."""
        raise EngineError(NAME, UNASKED)

    def energy(self) -> tuple[float, float]:
        """Not to be asked."""
        raise EngineError(NAME, UNASKED)

    def messages(self) -> list[str]:
        return ["how simspec asks gz sim was tested with a stand-in alone: see docs/engines.md"]

    def _drop(self) -> None:
        moving, self._moving = self._moving, None
        if moving is not None:
            moving.close()

    def close(self) -> None:
        self._drop()
        self._still.close()
