"""A world as SDF for gz sim: as Gazebo's, with the physics system that a server needs, and without shapes."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from simspec.engines.gazebo.building import STANDS_FOR, proper
from simspec.engines.gzsim.bindings import NAME
from simspec.errors import EngineError
from simspec.formats.sdf import tree as sdf
from simspec.formats.sdf.format import WORLD, Sdf
from simspec.formats.world.tree import AxisJoint, Body, Document, FixedJoint, FreeJoint, rows_of
from simspec.world.types import Inertial, Pose

PHYSICS: Final = sdf.System("gz-sim-physics-system", "gz::sim::systems::Physics")
MOMENT: Final = 1e-9
"""s: gz sim's shortest step, in which nothing moves that is slow."""
WHOLE: Final = 2.5e-10
"""s: what is added to a timestep, since gz sim cuts it off to whole nanoseconds, by which 0.3 ms would be 299,999 of them."""


class Plan:
    """Of each body of a document its parent and the root of its tree, by rows; -1: the world."""

    def __init__(self, document: Document):
        self.document = document
        hanging = rows_of(document.bodies)
        self.parents, self.roots = hanging.parents, hanging.roots
        self.moves = [group >= 0 for group in hanging.groups]
        for body, moves in zip(document.bodies, self.moves, strict=True):
            self._check(body, moves)

    def _check(self, body: Body, moves: bool) -> None:
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
            sdf.Joint(told.name, told.kind, told.parent, told.child, told.axis)
            for told in (self._joint(row) for row in self._joined())
        ]
        return self._text(MOMENT, (0.0, 0.0, 0.0), joints)

    def _joined(self) -> list[int]:
        return [row for row, body in enumerate(self.document.bodies) if not isinstance(body.joint, FreeJoint)]

    def _text(self, timestep: float, gravity: tuple[float, float, float], joints: list[sdf.Joint]) -> str:
        members: dict[int, list[int]] = {}
        for row, root in enumerate(self.roots):
            members.setdefault(root, []).append(row)
        by_child = {joint.child: joint for joint in joints}
        models = tuple(
            sdf.Model(
                f"t{root}",
                Pose(),
                False,
                False,
                tuple(self._link(row) for row in rows),
                tuple(by_child[f"b{row}"] for row in rows if f"b{row}" in by_child),
            )
            for root, rows in members.items()
        )
        return Sdf().write(sdf.World("w", timestep + WHOLE, gravity, models, (PHYSICS,), 0.0))[WORLD]

    def _link(self, row: int) -> sdf.Link:
        body, parent = self.document.bodies[row], self.parents[row]
        pose = Pose() if isinstance(body.joint, FreeJoint) else body.joint.origin
        inertial = Inertial(body.mass, body.centre_of_mass, body.inertia) if proper(body) else STANDS_FOR
        return sdf.Link(f"b{row}", None if parent < 0 else f"b{parent}", pose, inertial, False, ())

    def _joint(self, row: int, smooth: Collection[int] = ()) -> sdf.Joint:
        joint, parent = self.document.bodies[row].joint, self.parents[row]
        told = sdf.Joint(f"j{row}", joint.kind, None if parent < 0 else f"b{parent}", f"b{row}")
        if not isinstance(joint, AxisJoint):
            return told
        return sdf.Joint(
            told.name,
            joint.kind,
            told.parent,
            told.child,
            joint.axis,
            joint.position_limits,
            joint.effort_limit,
            dry_friction=0.0 if row in smooth else joint.dry_friction,
        )
