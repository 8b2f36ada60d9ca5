"""A world in gz sim: states, steps, efforts.

Two servers run it. One steps it. The other has no gravity, friction and limits, steps a nanosecond at a time, and says where
links are in a given state: gz sim has no state that could be set and read without a step. Velocities are written there a
million times smaller, so that nothing moves by a readable amount, and are read as many times larger.

A server's state is set by commands before a step, which hold at its beginning. Its physics system takes up the commands in
this order: joints, wrenches, poses, velocities. Forces are for one step. A pose holds at the beginning of the next step, too,
at whose end it is removed together with all commands in between: so a step of another pose goes before. Velocities are
commanded in the axes that the link had in the server's components *before* the pose that is commanded with them.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.dialects.kit.world import WorldSidecar
from simspec.engines.gazebo.building import losses, proper, sdf_joint, sdf_text
from simspec.engines.gzsim.bindings import NAME, bindings
from simspec.engines.kit.arrays import empty_contacts
from simspec.engines.kit.building import Walk, refuse
from simspec.engines.kit.world_simulation import WorldSimulation
from simspec.errors import EngineError
from simspec.files import scratch_folder
from simspec.formats.sdf.format import WORLD
from simspec.formats.sdf.tree import SdfSystem
from simspec.formats.world import AxisJoint, FreeJoint, initial_coordinates
from simspec.world.rotations import conjugate, multiply, rotate

# The SDF text for gz sim: that for Gazebo, with the physics system that a server needs, and without shapes.

PHYSICS: Final = SdfSystem("gz-sim-physics-system", "gz::sim::systems::Physics")
MOMENT: Final = 1e-9
"""s: gz sim's shortest step, in which nothing moves that is slow."""
WHOLE: Final = 2.5e-10
"""s: added to a timestep, which gz sim truncates to whole nanoseconds: 0.3 ms would be 299,999 of them."""


def check(walk: Walk) -> None:
    """Raise EngineError for the first part of a document that simspec does not write for gz sim."""
    refuse(walk, NAME, joints=("fixed", "hinge", "slide", "free"), servos=False)
    for placed in walk.bodies:
        body = placed.body
        if isinstance(body.joint, AxisJoint) and body.joint.armature:
            raise EngineError(NAME, f"does not support the armature of joint {body.joint.name!r}")
        if placed.moves and not proper(body):
            raise EngineError(
                NAME, f"does not support bodies without mass or with a singular inertia, as {body.name!r}"
            )
    if walk.shapes:
        raise EngineError(NAME, f"does not support contact, and {walk.shapes[0].owner.body.name!r} has a solid shape")


def stepped_world(walk: Walk, smooth: Collection[int] = ()) -> str:
    """The SDF text of a document; the joints of the bodies ``smooth`` (rows) have no dry friction."""
    joints = [(placed.row, placed.body.joint) for placed in walk.bodies]
    numbers = {
        row: {
            "position_limits": joint.position_limits,
            "effort_limit": joint.effort_limit,
            "dry_friction": 0.0 if row in smooth else joint.dry_friction,
        }
        for row, joint in joints
        if isinstance(joint, AxisJoint)
    }
    return _text(walk, numbers, timestep=walk.document.timestep + WHOLE)


def static_world(walk: Walk) -> str:
    """The same without gravity, limits and friction, in steps of ``MOMENT``: bodies stay where they are put."""
    return _text(walk, {}, timestep=MOMENT + WHOLE, gravity=(0.0, 0.0, 0.0))


def _text(walk: Walk, numbers: Mapping[int, Mapping[str, Any]], **changes: Any) -> str:
    joints = {
        row: sdf_joint(walk, row, **numbers.get(row, {}))
        for row, placed in enumerate(walk.bodies)
        if not isinstance(placed.body.joint, FreeJoint)
    }
    return sdf_text(walk, joints, systems=(PHYSICS,), real_time_factor=0.0, **changes)


NO_PHYSICS: Final = "has no physics system that steps: gz-sim-physics-system is not installed, or has no engine"
Before = Callable[[Any, Any, int], None]
"""Called before a step with the information of the update, the components and the number of the step."""


class Server:
    """A server of gz sim with the world of ``sim``, written as the SDF ``text``."""

    def __init__(self, sim: GzSimSimulation, text: str):
        self._sim, self._modules = sim, bindings()
        self._files = contextlib.ExitStack()
        file = self._files.enter_context(scratch_folder(NAME)) / WORLD
        file.write_text(text, encoding="utf-8")
        self.links: dict[int, Any] = {}
        self.joints: dict[int, Any] = {}
        self._models: dict[int, Any] = {}
        self.world: Any = None
        self._before: Before = lambda info, components, step: None
        self._after: Callable[[Any], None] = lambda components: None
        self._begun, self._done = 0, 0
        self._failed: BaseException | None = None
        self._fixture = self._modules.sim.TestFixture(str(file))
        self._fixture.on_pre_update(self._pre)
        self._fixture.on_post_update(self._post)
        self._fixture.finalize()
        self._server = self._fixture.server()

    def run(self, count: int, before: Before, after: Callable[[Any], None] = lambda components: None) -> None:
        """Step ``count`` times; ``before`` and ``after`` are called at each."""
        if not count:
            return
        self._before, self._after = before, after
        self._begun, self._done, self._failed = 0, 0, None
        ended = self._server.run(True, count, False)
        if self._failed is not None:
            raise self._failed
        if not ended or self._done != count or self._begun != count:
            raise EngineError(NAME, f"made {self._done} steps of {count}: it refuses the world, or was stopped")

    def _pre(self, info: Any, components: Any) -> None:
        # the server's own loop cannot pass an exception on
        if self._failed is None:
            try:
                if self.world is None:
                    self._find(components)
                self._before(info, components, self._begun)
                self._begun += 1
            except BaseException as error:
                self._failed = error

    def _post(self, info: Any, components: Any) -> None:
        if self._failed is None:
            try:
                self._after(components)
                self._done += 1
            except BaseException as error:
                self._failed = error

    def _find(self, components: Any) -> None:
        """Look up the entities of models, links and joints."""
        gz = self._modules.sim
        self.world = gz.World(gz.world_entity(components))

        def known(entity: Any) -> Any:
            if not entity.valid(components):
                raise EngineError(NAME, "has another world than the SDF text: a model, link or joint is missing")
            return entity

        for root, rows in self._sim.walk.trees.items():
            model = self._models[root] = known(gz.Model(self.world.model_by_name(components, f"t{root}")))
            for row in rows:
                self.links[row] = known(gz.Link(model.link_by_name(components, f"b{row}")))
                if row not in self._sim.free:
                    self.joints[row] = known(gz.Joint(model.joint_by_name(components, f"j{row}")))

    def watch(self, components: Any) -> None:
        """Let the server report the state of links and joints from the next step on."""
        for link in self.links.values():
            link.enable_velocity_checks(components, True)
        for row in self._sim.axes:
            self.joints[row].enable_position_check(components, True)
            self.joints[row].enable_velocity_check(components, True)

    def put(self, components: Any, q: np.ndarray, v: np.ndarray) -> None:
        """Let the next step, before which poses were commanded elsewhere, begin at (q, v)."""
        sim, math = self._sim, self._modules.math
        for row in sim.free:
            place = q[sim.q_places[row]]
            turn = math.Quaterniond(*place[3:].tolist())
            self._models[row].set_world_pose_cmd(components, math.Pose3d(self._vector(place[:3]), turn))
        for row in sim.free:
            rate, link = v[sim.v_places[row]], self.links[row]
            back = conjugate(self.pose(components, row)[3:])
            link.set_linear_velocity(components, self._vector(rotate(back, rate[:3])))
            spin = rotate(q[sim.q_places[row]][3:], rate[3:])
            link.set_angular_velocity(components, self._vector(rotate(back, spin)))
        for row in sim.axes:
            self.joints[row].reset_position(components, q[sim.q_places[row]].tolist())
            self.joints[row].reset_velocity(components, v[sim.v_places[row]].tolist())

    def push(self, components: Any, q: np.ndarray, effort: np.ndarray) -> None:
        """Let an effort (nv,) act in the next step, which begins at ``q``."""
        sim = self._sim
        for row in sim.axes:
            self.joints[row].set_force(components, effort[sim.v_places[row]].tolist())
        for row in sim.free:  # its link has its frame at its centre of mass
            force = effort[sim.v_places[row]]
            if force.any():
                torque = rotate(q[sim.q_places[row]][3:], force[3:])
                self.links[row].add_world_wrench(components, self._vector(force[:3]), self._vector(torque))

    def _vector(self, values: np.ndarray) -> Any:
        return self._modules.math.Vector3d(*values.tolist())

    def state(self, components: Any) -> tuple[np.ndarray, np.ndarray]:
        """(q, v) after a step."""
        sim = self._sim
        q, v = np.zeros(sim.nq), np.zeros(sim.nv)
        for row in sim.free:
            pose, rate = self.pose(components, row), self.velocity(components, row)
            q[sim.q_places[row]] = pose
            v[sim.v_places[row]] = [*rate[:3], *rotate(conjugate(pose[3:]), rate[3:])]
        for row in sim.axes:
            joint = self.joints[row]
            q[sim.q_places[row]] = _coordinate(joint.position(components))
            v[sim.v_places[row]] = _coordinate(joint.velocity(components))
        return q, v

    def pose(self, components: Any, row: int) -> np.ndarray:
        """x y z w x y z of a link's frame."""
        pose = self.links[row].world_pose(components)
        place, turn = pose.pos(), pose.rot()
        return np.array([place.x(), place.y(), place.z(), turn.w(), turn.x(), turn.y(), turn.z()])

    def velocity(self, components: Any, row: int) -> np.ndarray:
        """Linear velocity of a link's origin, then angular velocity, in world axes."""
        link = self.links[row]
        linear, angular = link.world_linear_velocity(components), link.world_angular_velocity(components)
        if linear is None or angular is None:
            raise EngineError(NAME, NO_PHYSICS)
        return np.array([linear.x(), linear.y(), linear.z(), angular.x(), angular.y(), angular.z()])

    def close(self) -> None:
        self._fixture = self._server = None
        self._files.close()


def _coordinate(values: Any) -> float:
    """The number of a joint of one coordinate."""
    if values is None or not len(values):
        raise EngineError(NAME, NO_PHYSICS)
    if len(values) != 1:
        raise EngineError(NAME, f"has {len(values)} coordinates of a joint with one axis")
    return float(values[0])


SLOW: Final = 1e-6
"""Factor of velocities where nothing may move."""
ASIDE: Final = 0.5
"""m, rad: how far bodies are displaced before they are put where they belong. gz sim updates poses and velocities of those
links alone that have moved by 1e-6 since the last update."""
_TURN = np.array([np.cos(0.25), 0.0, np.sin(0.25), 0.0])
NOT_FINITE = "a state or effort is not finite"


class GzSimSimulation(WorldSimulation[WorldSidecar]):
    """A loaded world. Coordinates are those of ``world/kinematics.py``."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        super().__init__(NAME, WorldSidecar, folder, sidecar)
        self.walk = Walk.of(self.document)
        check(self.walk)
        bodies = self.document.bodies
        self.axes = [row for row, body in enumerate(bodies) if isinstance(body.joint, AxisJoint)]
        self.free = [row for row, body in enumerate(bodies) if isinstance(body.joint, FreeJoint)]
        self._q_axes = np.array([self.q_places[row].start for row in self.axes], dtype=np.intp)
        self._v_axes = np.array([self.v_places[row].start for row in self.axes], dtype=np.intp)
        self._damping, self._stiffness, self._rest, _ = losses(self.document)[self.axes].T
        self._smooth: frozenset[int] = frozenset()
        self._static = Server(self, static_world(self.walk))
        self._moving: Server | None = None
        self.set_state(*map(np.array, initial_coordinates(self.document)))

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Let the next step begin at (q, v). Raises EngineError for a state that is not finite."""
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise EngineError(NAME, NOT_FINITE)
        self._q, self._v = self.normalised(q), np.array(v, dtype=float)
        self._pending = True

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v) after the last step; of a state that was set, as the static server has it."""
        return self._look()[:2] if self._pending else (self._q.copy(), self._v.copy())

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them, at the present coordinates."""
        return self._look()[2:]

    def _look(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(q, v), poses and velocities of the static server at the present coordinates."""
        aside = self._aside()
        # each by another length, so that no two of them bring a link back to where it was
        aside[self._q_axes] += ASIDE * (1.0 + np.arange(len(self.axes)) / math.e)
        server, found = self._static, []

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
        """The present coordinates with all free roots displaced."""
        found = self._q.copy()
        for row in self.free:
            place = self.q_places[row]
            found[place.start : place.start + 3] += ASIDE
            found[place.stop - 4 : place.stop] = multiply(found[place.stop - 4 : place.stop], _TURN)
        return found

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the damping and springs of the joints."""
        constant = np.zeros(self.nv) if effort is None else np.asarray(effort, dtype=float)
        if not np.isfinite(constant).all():
            raise EngineError(NAME, NOT_FINITE)
        if self._moving is None:
            self._moving = self._stepping_server()
        server = self._moving
        if self._pending and self.free and count:
            # a step whose result is discarded: links that have not moved since an earlier state would not be reported, and
            # commanded poses hold at the beginning of the next step, too
            aside, at_rest = self._aside(), np.zeros(self.nv)
            server.run(1, lambda info, components, step: server.put(components, aside, at_rest))

        def before(info: Any, components: Any, step: int) -> None:
            if self._pending:
                server.watch(components)
                server.put(components, self._q, self._v)
            total, at = constant.copy(), self._v_axes
            spring = self._stiffness * (self._q[self._q_axes] - self._rest)
            total[at] += -self._damping * self._v[at] - spring
            server.push(components, self._q, total)

        def after(components: Any) -> None:
            self._q, self._v = server.state(components)
            self._pending = False

        server.run(count, before, after)
        if not (np.isfinite(self._q).all() and np.isfinite(self._v).all()):
            raise EngineError(NAME, "a step led to a state that is not finite")

    def _stepping_server(self) -> Server:
        return Server(self, stepped_world(self.walk, self._smooth))

    def query(self, ask: Callable[[Server, Any, Any], None]) -> None:
        """Call ``ask`` with a new server, before its first step: links are where SDF has them, joints at 0."""
        server = self._stepping_server()
        try:
            server.run(1, lambda info, components, step: ask(server, info, components))
        finally:
            server.close()

    def contacts(self) -> dict[str, np.ndarray]:
        """None: gz sim has no shapes."""
        return empty_contacts()

    def disable_contact(self) -> None:
        """Nothing to do: there is no contact."""

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """Remove the dry friction of the joints at the places ``v`` (n,), by a new server."""
        smooth = self._smooth | set(self.rows_at(v))
        if smooth != self._smooth:
            self._smooth, self._pending = smooth, True
            self._drop()

    def messages(self) -> list[str]:
        return ["simspec's queries of gz sim were tested with a stand-in alone: see docs/reference/engines/gzsim.md"]

    def _drop(self) -> None:
        moving, self._moving = self._moving, None
        if moving is not None:
            moving.close()

    def close(self) -> None:
        self._drop()
        self._static.close()
