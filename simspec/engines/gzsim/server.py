"""One server of gz sim that holds one world, and what is told it and asked of it between its steps.

A server has no state that could be set without a step: what is commanded before a step holds at its beginning. Its physics
system takes up the commands in this order: joints, wrenches, poses, velocities. Forces are for one step. A pose holds at the
beginning of the next step, too, at whose end it is taken away with whatever was commanded in between: so a step of another pose
goes before. Velocities are commanded in the axes that the link had in the server's components *before* the pose that is
commanded with them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from simspec.engines.gzsim.bindings import NAME, Bindings
from simspec.errors import EngineError
from simspec.files import scratch_folder
from simspec.formats.sdf.format import WORLD
from simspec.formats.world.tree import AxisJoint, FreeJoint, JsonBody
from simspec.world.rotations import conjugate, rotate

UNTOLD: Final = "has no physics system that steps: gz-sim-physics-system is not installed, or has no engine"
Before = Callable[[Any, Any, int], None]
"""What is done before a step: given the information of the update, the components and the number of the step."""


class Server:
    """A world in gz sim. Coordinates are those of ``world/kinematics.py``."""

    def __init__(
        self,
        bindings: Bindings,
        text: str,
        bodies: Sequence[JsonBody],
        roots: Sequence[int],
        q: Sequence[slice],
        v: Sequence[slice],
    ):
        self._sim, self._math = bindings.sim, bindings.math
        self._bodies, self._roots, self._q, self._v = bodies, roots, q, v
        self._axes = [row for row, body in enumerate(bodies) if isinstance(body.joint, AxisJoint)]
        self._free = [row for row, body in enumerate(bodies) if isinstance(body.joint, FreeJoint)]
        self._place = contextlib.ExitStack()
        file = self._place.enter_context(scratch_folder(NAME)) / WORLD
        file.write_text(text, encoding="utf-8")
        self.links: dict[int, Any] = {}
        self.joints: dict[int, Any] = {}
        self._models: dict[int, Any] = {}
        self.world: Any = None
        self._before: Before = lambda info, components, step: None
        self._after: Callable[[Any], None] = lambda components: None
        self._begun, self._done = 0, 0
        self._failed: BaseException | None = None
        self._fixture = self._sim.TestFixture(str(file))
        self._fixture.on_pre_update(self._pre)
        self._fixture.on_post_update(self._post)
        self._fixture.finalize()
        self._server = self._fixture.server()

    # --- steps ------------------------------------------------------------------------------------------------

    def run(self, count: int, before: Before, after: Callable[[Any], None]) -> None:
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
        # an exception would go through the server's own loop, which does not know it
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
        """The entities of links and joints, and that their state is told."""
        sim = self._sim
        self.world = sim.World(sim.world_entity(components))
        for root in dict.fromkeys(self._roots):
            self._models[root] = self._known(sim.Model(self.world.model_by_name(components, f"t{root}")), components)
        for row, body in enumerate(self._bodies):
            model = self._models[self._roots[row]]
            self.links[row] = self._known(sim.Link(model.link_by_name(components, f"b{row}")), components)
            if not isinstance(body.joint, FreeJoint):
                self.joints[row] = self._known(sim.Joint(model.joint_by_name(components, f"j{row}")), components)

    def _known(self, entity: Any, components: Any) -> Any:
        if not entity.valid(components):
            raise EngineError(NAME, "holds another world than it was told: a model, link or joint is missing")
        return entity

    def watch(self, components: Any) -> None:
        """Let the state of links and joints be told from the next step on."""
        for link in self.links.values():
            link.enable_velocity_checks(components, True)
        for row in self._axes:
            self.joints[row].enable_position_check(components, True)
            self.joints[row].enable_velocity_check(components, True)

    # --- what is commanded ------------------------------------------------------------------------------------

    def put(self, components: Any, q: np.ndarray, v: np.ndarray) -> None:
        """Let the state at the beginning of the next step be (q, v): a step before which poses were put elsewhere."""
        for row in self._free:
            place = q[self._q[row]]
            turn = self._math.Quaterniond(*place[3:].tolist())
            self._models[row].set_world_pose_cmd(components, self._math.Pose3d(self._vector(place[:3]), turn))
        for row in self._free:
            rate, link = v[self._v[row]], self.links[row]
            held = self.pose(components, row)[3:]
            turn = q[self._q[row]][3:]
            link.set_linear_velocity(components, self._vector(rotate(conjugate(held), rate[:3])))
            link.set_angular_velocity(components, self._vector(rotate(conjugate(held), rotate(turn, rate[3:]))))
        for row in self._axes:
            self.joints[row].reset_position(components, q[self._q[row]].tolist())
            self.joints[row].reset_velocity(components, v[self._v[row]].tolist())

    def push(self, components: Any, q: np.ndarray, effort: np.ndarray) -> None:
        """Let an effort (nv,) act in the next step, which begins at ``q``."""
        for row in self._axes:
            self.joints[row].set_force(components, effort[self._v[row]].tolist())
        for row in self._free:  # whose link has its frame at its centre of mass
            force = effort[self._v[row]]
            if force.any():
                torque = rotate(q[self._q[row]][3:], force[3:])
                self.links[row].add_world_wrench(components, self._vector(force[:3]), self._vector(torque))

    def _vector(self, values: np.ndarray) -> Any:
        return self._math.Vector3d(*values.tolist())

    # --- what is told -----------------------------------------------------------------------------------------

    def state(self, components: Any) -> tuple[np.ndarray, np.ndarray]:
        """(q, v) after a step."""
        q = np.zeros(max((place.stop for place in self._q), default=0))
        v = np.zeros(max((place.stop for place in self._v), default=0))
        for row in self._free:
            q[self._q[row]], told = self.pose(components, row), self.velocity(components, row)
            v[self._v[row]] = [*told[:3], *rotate(conjugate(q[self._q[row]][3:]), told[3:])]
        for row in self._axes:
            joint = self.joints[row]
            q[self._q[row]] = _one(joint.position(components))
            v[self._v[row]] = _one(joint.velocity(components))
        return q, v

    def pose(self, components: Any, row: int) -> np.ndarray:
        """x y z w x y z of a link's frame."""
        told = self.links[row].world_pose(components)
        place, turn = told.pos(), told.rot()
        return np.array([place.x(), place.y(), place.z(), turn.w(), turn.x(), turn.y(), turn.z()])

    def velocity(self, components: Any, row: int) -> np.ndarray:
        """Linear of a link's origin, then angular, in world axes."""
        linear, angular = (
            self.links[row].world_linear_velocity(components),
            self.links[row].world_angular_velocity(components),
        )
        if linear is None or angular is None:
            raise EngineError(NAME, UNTOLD)
        return np.array([linear.x(), linear.y(), linear.z(), angular.x(), angular.y(), angular.z()])

    def close(self) -> None:
        self._fixture = self._server = None
        self._place.close()


def _one(told: Any) -> float:
    """The number of a joint of one coordinate."""
    if told is None or not len(told):
        raise EngineError(NAME, UNTOLD)
    if len(told) != 1:
        raise EngineError(NAME, f"tells {len(told)} coordinates of a joint that has one")
    return float(told[0])
