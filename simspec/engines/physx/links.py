"""Trees of bodies in PhysX: reduced-coordinate articulations of links, built from ``world.json``.

Each articulation begins with a link that is fixed to the world. A ball joint is three hinges about x, y and z, a free root
three slides and a ball, with links of next to no mass between them: an articulation on a fixed root steps as simspec's law of
motion does, an articulation with a free root does not (``docs/records/physx-joints.md``).

Facts marked *measured*: SAPIEN 3.0.3, PhysX 5.3.1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from simspec.engines.kit.arrays import checked_singles
from simspec.engines.kit.building import STATIC
from simspec.engines.physx.roles import MOST_LINKS
from simspec.engines.physx.roundings import joint_turn, principal_order
from simspec.engines.physx.units import FASTEST, FASTEST_LINEAR, LEAST, NAME, SCALE
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, FixedJoint, FreeJoint, Joint
from simspec.world import frames
from simspec.world.frames import quaternion, vector3
from simspec.world.inertia import principal_axes
from simspec.world.types import Pose, Quaternion, Vector3

if TYPE_CHECKING:
    from simspec.engines.physx.building import PhysxBuild

SHARE = 1e-10
"""Mass and moments of inertia of a link that stands for a massless body, as a share of those of the next body with mass that it
carries. From 1e-8 on motion is the same to round-off (measured: 20 chains of 2 to 8 joints)."""
STIFF = 1e12
"""Damping (N m s/rad, N s/m) of the drive that stands for dry friction: a joint at rest below its friction creeps at less than
1e-10 of the speed that the friction would give it (measured from 1e8 on)."""
UNLIMITED = (-math.inf, math.inf)
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class Coordinate(NamedTuple):
    """One joint coordinate of an articulation: the ``row`` of its body, its ``place`` among the velocities of the body's joint,
    and whether it is a slide."""

    row: int
    place: int
    slides: bool


@dataclass
class PhysxLinks:
    """The links of a build. ``of``: by row; ``joints``: SAPIEN's joints of each row, the parent's side first; ``coordinates``:
    by SAPIEN's joint; ``articulations``: in the order of ``Homes.trees``."""

    built: PhysxBuild
    bare: bool
    """Whether joints are without limits and dry friction."""
    of: dict[int, Any] = field(default_factory=dict)
    entities: dict[int, Any] = field(default_factory=dict)
    joints: dict[int, list[Any]] = field(default_factory=dict)
    coordinates: dict[Any, Coordinate] = field(default_factory=dict)
    spacers: dict[int, Any] = field(default_factory=dict)
    articulations: list[Any] = field(default_factory=list)
    _added: list[Any] = field(default_factory=list)

    def build(self, shapes: Mapping[int, Sequence[Any]]) -> None:
        """Make all articulations, with the shapes of each row."""
        for rows in self.built.homes.trees:
            anchor = self._link(None, 1.0, (1.0, 1.0, 1.0), Pose(), "anchor")
            anchor.joint.type = "fixed"
            self._added[0].pose = self.built.pose(self._base(rows[0]), "anchor")
            for row in rows:
                self._body(row, anchor, shapes.get(row, ()))
            if len(self._added) > MOST_LINKS:
                raise EngineError(NAME, f"has {MOST_LINKS} links in an articulation, not {len(self._added)}")
            for entity in self._added:
                self.built.scene.add_entity(entity)
            self._added.clear()
            self._finish(anchor.articulation)

    def _base(self, row: int) -> Pose:
        """The pose of the first link of an articulation: the frame of the joint of ``row``, its first body. PhysX turns the
        offset of a joint from its parent to and fro, and loses digits in proportion: 1e-6 m of 1.5 m (measured)."""
        placed = self.built.walk.bodies[row]
        if isinstance(placed.body.joint, FreeJoint):
            return Pose()
        base = Pose() if placed.parent == STATIC else self.built.walk.bodies[placed.parent].pose
        return frames.compose(base, placed.body.joint.origin)

    def _body(self, row: int, anchor: Any, shapes: Sequence[Any]) -> None:
        """Make the links of a body and its joint."""
        walk = self.built.walk
        body, joint, parent = walk.bodies[row].body, walk.bodies[row].body.joint, walk.bodies[row].parent
        origin, above = Pose(), anchor
        if parent != STATIC and walk.bodies[parent].moves and not isinstance(joint, FreeJoint):
            home = self.built.homes.of[parent]
            above, origin = self.of[home.row], frames.compose(home.pose, joint.origin)
            if self.built.touch(home.row, row):
                above = self.spacers[row] = self._link(above, *self._nearly_massless(row))
                self._fix(above.joint, origin)
                origin = Pose()
        axes = _axes(joint)
        for _ in axes[:-1]:
            above = self._link(above, *self._nearly_massless(row))
            self.joints.setdefault(row, []).append(above.joint)
        link = self.of[row] = self._link(above, *self._masses(row))
        self.entities[row] = self._added[-1]
        self.joints.setdefault(row, []).append(link.joint)
        link.name = link.joint.name = body.name
        for shape in shapes:
            link.attach(shape)
        # shapes that are attached change masses; frames come last, since PhysX computes them anew from those of another centre
        self._set_mass(link, *self._masses(row))
        if not axes:
            self._fix(link.joint, origin)
        for place, (slides, axis) in enumerate(axes):
            made = self.joints[row][place]
            limits = joint.position_limits if isinstance(joint, AxisJoint) else None
            turn = to_x(axis)
            if isinstance(joint, AxisJoint):
                ends = (end.cmass_local_pose.q.tolist() for end in (made.parent_link, made.child_link))
                above_axes, below_axes = (quaternion(axes) for axes in ends)
                turn = joint_turn(self.built.sapien, above_axes, below_axes, origin.quaternion, turn)
            self._axis(made, slides, turn, Pose() if place else origin, limits)
            self.coordinates[made] = Coordinate(row, place, slides)

    def _fix(self, joint: Any, origin: Pose) -> None:
        joint.type = "fixed"
        joint.pose_in_parent = self.built.pose(origin, "joint")

    def _axis(
        self, joint: Any, slides: bool, turn: Quaternion, origin: Pose, limits: tuple[float, float] | None
    ) -> None:
        joint.type = "prismatic" if slides else "revolute_unwrapped"
        ends: Sequence[float] = UNLIMITED
        if limits is not None and not self.bare:
            ends = checked_singles(NAME, ((SCALE if slides else 1.0) * end for end in limits), "limits")
        joint.limits = np.array([ends], dtype=np.float32)
        joint.pose_in_parent = self.built.pose(frames.compose(origin, Pose(quaternion=turn)), "joint")
        joint.pose_in_child = self.built.pose(Pose(quaternion=turn), "joint")

    def _link(self, parent: Any, mass: float, moments: Sequence[float], centre: Pose, name: str) -> Any:
        link = self.built.physx.PhysxArticulationLinkComponent(*(() if parent is None else (parent,)))
        self._set_mass(link, mass, moments, centre, name)
        entity = self.built.sapien.Entity()
        entity.add_component(link)
        self._added.append(entity)
        return link

    def _set_mass(self, link: Any, mass: float, moments: Sequence[float], centre: Pose, name: str) -> None:
        link.mass = checked_singles(NAME, (mass,), f"mass of {name}")[0]
        link.inertia = checked_singles(NAME, (SCALE * SCALE * moment for moment in moments), f"inertia of {name}")
        link.cmass_local_pose = self.built.pose(centre, f"centre of mass of {name}")

    def _masses(self, row: int) -> tuple[float, Vector3, Pose, str]:
        """The mass, moments and their frame of a body."""
        body = self.built.walk.bodies[row].body
        if not body.mass:
            return self._nearly_massless(row)
        moments, axes = principal_axes(body.inertia)
        if not min(moments) > 0.0:
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no inverse")
        order, axes = principal_order(self.built.sapien, axes)
        moments = vector3(moments[place] for place in order)
        return body.mass, moments, Pose(body.centre_of_mass, axes), body.name

    def _nearly_massless(self, row: int) -> tuple[float, Vector3, Pose, str]:
        """The same of what stands for a massless body that carries this one, or is it."""
        inside, name = {row}, self.built.walk.bodies[row].body.name
        for placed in self.built.walk.bodies[row:]:
            if placed.row in inside or placed.parent in inside:
                inside.add(placed.row)
                if placed.body.mass:
                    moment = SHARE * max(principal_axes(placed.body.inertia)[0])
                    return SHARE * placed.body.mass, (moment, moment, moment), Pose(), name
        raise EngineError(NAME, f"does not support {name!r}, which moves no mass")

    def _finish(self, articulation: Any) -> None:
        """Replace PhysX's defaults of an articulation, its links and its joints."""
        articulation.set_solver_position_iterations(self.built.iterations)
        articulation.set_solver_velocity_iterations(1)
        articulation.set_sleep_threshold(0.0)
        for link in articulation.links:
            link.linear_damping = link.angular_damping = 0.0
            link.max_angular_velocity, link.max_linear_velocity = FASTEST, FASTEST_LINEAR
            link.max_depenetration_velocity = SCALE * LEAST
        for joint in articulation.active_joints:
            coordinate = self.coordinates[joint]
            of = self.built.walk.bodies[coordinate.row].body.joint
            inertia = 1.0 if coordinate.slides else SCALE * SCALE
            joint.set_friction(0.0)
            joint.set_max_velocity(FASTEST_LINEAR)
            armature = of.armature if isinstance(of, AxisJoint) else 0.0
            values = checked_singles(NAME, (inertia * armature,), f"armature of {of.name}")
            joint.set_armature(np.array(values, dtype=np.float32))
            rough = of.dry_friction if isinstance(of, AxisJoint) and not self.bare else 0.0
            self.set_dry_friction(joint, rough)
        self.articulations.append(articulation)

    def set_dry_friction(self, joint: Any, most: float) -> None:
        """Give a joint a drive to the velocity zero with this largest effort (N m, N)."""
        slides = self.coordinates[joint].slides
        damping = STIFF * (1.0 if slides else SCALE * SCALE)
        limit = checked_singles(NAME, (most * (SCALE if slides else SCALE * SCALE),), "dry friction")[0]
        joint.set_drive_properties(0.0, damping if most else 0.0, limit, "force")
        joint.set_drive_velocity_target(0.0)


def _axes(joint: Joint) -> list[tuple[bool, Vector3]]:
    """The coordinates of a joint in PhysX, the parent's side first: whether they slide, and their axes."""
    turns = [(False, X), (False, Y), (False, Z)]
    if isinstance(joint, AxisJoint):
        return [(joint.kind == "slide", joint.axis)]
    if isinstance(joint, FixedJoint):
        return []
    return [(True, X), (True, Y), (True, Z), *turns] if isinstance(joint, FreeJoint) else turns


def to_x(axis: Vector3) -> Quaternion:
    """A rotation that takes x, the axis of PhysX's joints, to ``axis``."""
    x, y, z = axis
    helper = X if abs(x) < 0.9 else Y
    second = frames.direction(frames.cross(helper, (x, y, z)))
    third = frames.cross((x, y, z), second)
    return frames.from_matrix(tuple(zip((x, y, z), second, third, strict=True)))  # type: ignore[arg-type]
