"""A world in gz sim, in its initial state: states, steps, efforts.

Two servers hold it. One steps it. The other holds it without weight, friction and limits in steps of a nanosecond, and is asked
where its links are in a given state: gz sim has no state that could be set and read without a step. Velocities are put there
a million times smaller, so that nothing moves by what could be read, and read as many times larger.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.dialects.kit.world import WorldSidecar
from simspec.engines.gazebo.building import STANDS_FOR, proper
from simspec.engines.gzsim.bindings import NAME, bindings
from simspec.engines.gzsim.server import Before, Server
from simspec.engines.kit.arrays import empty_contacts
from simspec.engines.kit.world_simulation import WorldSimulation
from simspec.errors import EngineError
from simspec.formats.sdf import tree as sdf
from simspec.formats.sdf.format import WORLD, Sdf
from simspec.formats.world.tree import (
    AxisJoint,
    FixedJoint,
    FreeJoint,
    JsonBody,
    JsonWorld,
    initial_coordinates,
    rows_of,
)
from simspec.world.rotations import multiply
from simspec.world.types import Inertial, Pose

# A world as SDF for gz sim: as Gazebo's, with the physics system that a server needs, and without shapes.

PHYSICS: Final = sdf.SdfSystem("gz-sim-physics-system", "gz::sim::systems::Physics")
MOMENT: Final = 1e-9
"""s: gz sim's shortest step, in which nothing moves that is slow."""
WHOLE: Final = 2.5e-10
"""s: what is added to a timestep, since gz sim cuts it off to whole nanoseconds, by which 0.3 ms would be 299,999 of them."""


class Plan:
    """Of each body of a document its parent and the root of its tree, by rows; -1: the world."""

    def __init__(self, document: JsonWorld):
        self.document = document
        hanging = rows_of(document.bodies)
        self.parents, self.roots = hanging.parents, hanging.roots
        self.moves = [group >= 0 for group in hanging.groups]
        for body, moves in zip(document.bodies, self.moves, strict=True):
            self._check(body, moves)

    def _check(self, body: JsonBody, moves: bool) -> None:
        if not isinstance(body.joint, FixedJoint | AxisJoint | FreeJoint):
            raise EngineError(NAME, f"does not support the {body.joint.kind} joint {body.joint.name!r}")
        if isinstance(body.joint, AxisJoint) and (body.joint.servo is not None or body.joint.armature):
            raise EngineError(NAME, f"has no controller and no armature, which joint {body.joint.name!r} has")
        if moves and not proper(body):
            raise EngineError(NAME, f"takes no body without mass or with an inertia that is singular, as {body.name!r}")
        if any(shape.copies for shape in body.shapes):
            raise EngineError(NAME, f"is not told what touches, which {body.name!r} would")

    def text(self, smooth: Collection[int] = ()) -> str:
        """The world; the joints of the bodies ``smooth`` have no dry friction."""
        return self._text(
            self.document.timestep, self.document.gravity, [self._joint(row, smooth) for row in self._joined()]
        )

    def still(self) -> str:
        """The world without weight, limits and friction, in steps of no length: its bodies are where they are put."""
        joints = [
            sdf.SdfJoint(told.name, told.kind, told.parent, told.child, told.axis)
            for told in (self._joint(row) for row in self._joined())
        ]
        return self._text(MOMENT, (0.0, 0.0, 0.0), joints)

    def _joined(self) -> list[int]:
        return [row for row, body in enumerate(self.document.bodies) if not isinstance(body.joint, FreeJoint)]

    def _text(self, timestep: float, gravity: tuple[float, float, float], joints: list[sdf.SdfJoint]) -> str:
        members: dict[int, list[int]] = {}
        for row, root in enumerate(self.roots):
            members.setdefault(root, []).append(row)
        by_child = {joint.child: joint for joint in joints}
        models = tuple(
            sdf.SdfModel(
                f"t{root}",
                Pose(),
                False,
                False,
                tuple(self._link(row) for row in rows),
                tuple(by_child[f"b{row}"] for row in rows if f"b{row}" in by_child),
            )
            for root, rows in members.items()
        )
        return Sdf().write(sdf.SdfWorld("w", timestep + WHOLE, gravity, models, (PHYSICS,), 0.0))[WORLD]

    def _link(self, row: int) -> sdf.SdfLink:
        body, parent = self.document.bodies[row], self.parents[row]
        pose = Pose() if isinstance(body.joint, FreeJoint) else body.joint.origin
        inertial = Inertial(body.mass, body.centre_of_mass, body.inertia) if proper(body) else STANDS_FOR
        return sdf.SdfLink(f"b{row}", None if parent < 0 else f"b{parent}", pose, inertial, False, ())

    def _joint(self, row: int, smooth: Collection[int] = ()) -> sdf.SdfJoint:
        joint, parent = self.document.bodies[row].joint, self.parents[row]
        told = sdf.SdfJoint(f"j{row}", joint.kind, None if parent < 0 else f"b{parent}", f"b{row}")
        if not isinstance(joint, AxisJoint):
            return told
        return sdf.SdfJoint(
            told.name,
            joint.kind,
            told.parent,
            told.child,
            joint.axis,
            joint.position_limits,
            joint.effort_limit,
            dry_friction=0.0 if row in smooth else joint.dry_friction,
        )


SLOW: Final = 1e-6
"""By which velocities are multiplied where nothing may move."""
ASIDE: Final = 0.5
"""m, rad: how far bodies are put aside before they are put where they are asked. gz sim tells poses and velocities of links
that have moved by 1e-6 since it last told them, and of no others."""
_TURN = np.array([np.cos(0.25), 0.0, np.sin(0.25), 0.0])
UNASKED = "tells nothing of its dynamics"
NOT_FINITE = "a state or effort is not finite"


class Simulation(WorldSimulation[WorldSidecar]):
    """A loaded world. Coordinates are those of ``world/kinematics.py``."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        super().__init__(NAME, WorldSidecar, folder, sidecar)
        bodies = self.document.bodies
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
        self.damping, self._stiffness, self._rest = np.zeros(self.nv), np.zeros(self.nv), np.zeros(self.nv)
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
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise EngineError(NAME, NOT_FINITE)
        self._q, self._v = self.normalised(q), np.array(v, dtype=float)
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
            server.put(components, *((self._q, self._v * SLOW) if step else (aside, np.zeros(self.nv))))

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
        given = np.zeros(self.nv) if effort is None else np.asarray(effort, dtype=float)
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
        self._stepping().put(components, self._aside(), np.zeros(self.nv))

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
        smooth = self._smooth | set(self.rows_at(v))
        if smooth != self._smooth:
            self._smooth, self._pending = smooth, True
            self._drop()

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Not available, as bias force and energy."""
        raise EngineError(NAME, UNASKED)

    def bias(self) -> np.ndarray:
        raise EngineError(NAME, UNASKED)

    def energy(self) -> tuple[float, float]:
        raise EngineError(NAME, UNASKED)

    def messages(self) -> list[str]:
        return ["how simspec asks gz sim was tested with a stand-in alone: see docs/reference/engines/gzsim.md"]

    def _drop(self) -> None:
        moving, self._moving = self._moving, None
        if moving is not None:
            moving.close()

    def close(self) -> None:
        self._drop()
        self._still.close()
