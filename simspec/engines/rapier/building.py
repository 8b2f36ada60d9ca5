"""A world in Rapier, built by calls of its API from ``world.json`` and its sidecar.

Static bodies are Rapier's fixed bodies; a free body with all massless bodies that are fixed to it is one dynamic body; other
trees are multibodies. The shapes of a rigid group belong to the body whose joint moves it. Colliders have no density: masses
are those of the bodies.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from simspec.engines.kit.arrays import checked_singles
from simspec.engines.kit.building import PlacedBody, PlacedShape, Walk, hull_triangles, refuse
from simspec.engines.kit.world_simulation import only_common, positive_definite
from simspec.engines.rapier.multibodies import ERROR_REDUCTION, Multibodies
from simspec.engines.rapier.units import NAME, SCALE, isometry, lengths, mass_properties
from simspec.errors import EngineError
from simspec.formats.world import JsonShape
from simspec.world import frames
from simspec.world.hull import mesh_vertices
from simspec.world.types import PairContact, Pose

RIGID = 1000.0
"""ω dt of contacts. With the damping ratio that :func:`configure` derives from it, a step takes back the share β of an overlap
(measured: the contact law to three digits from 0.5 to 8 ms)."""
PREDICTION = 1e-6
"""Distance (m) from which two shapes have a contact: from 1e-3 on, sliding bodies hop."""
FAR = 1e3
"""Distance (m) of bodies from each other while Rapier detects their colliders for the first time."""
FASTEST = 1e6
"""Bound (m/s) of all speeds, by default 400 m/s, and of those that take back overlaps, by default 3 m/s."""
SHAPES = ("sphere", "box", "cylinder", "capsule", "plane", "mesh")
Settings = Mapping[str, Any]


class Laws:
    """The hook that Rapier calls for pairs of colliders: which of them touch, and by which law.

    Rapier combines a number of each of two colliders; a table of materials has more numbers than such rules give. Where one
    law holds for all pairs, colliders have its numbers, and the hook is not called. Elsewhere the hook writes the numbers of
    the two materials into each pair before it is solved.

    The hook passes no restitution to Rapier, which would add it in one sweep after the others, with 12.5 % too much energy
    where a body hits two at once (measured). A point that approaches at c has, for the step, the overlap −e c dt / β in place
    of its own, which error reduction takes back at e c in the same sweeps.
    """

    def __init__(self, rapier: Any, walk: Walk, laws: Sequence[PairContact], colliders: Sequence[Any]):
        for law in laws:
            moments = "torsional or rolling friction" if law.rolling_friction or law.torsional_friction else None
            if lacking := only_common(law) or moments:
                raise EngineError(NAME, f"does not support {lacking} of {law.first} and {law.second}")
        self._walk, self.colliders, self._timestep = walk, list(colliders), walk.document.timestep
        self._flags, self._kinds = rapier.SolverFlags.COMPUTE_IMPULSES, rapier.ActiveHooks
        self.number = {handle: index for index, handle in enumerate(colliders)}
        self.materials = [solid.shape.material for solid in walk.shapes]
        self.table: dict[tuple[str, str], tuple[float, float, float]] = {}
        for law in laws:
            row = (law.friction, law.restitution, law.restitution_threshold)
            self.table[law.first, law.second] = self.table[law.second, law.first] = row
        self._ignored = {frozenset(pair) for pair in walk.document.excluded.groups}
        self._excluded = set(walk.excluded)
        used = set(self.materials)
        rows = {row for pair, row in self.table.items() if set(pair) <= used}
        friction, restitution, threshold = next(iter(rows)) if len(rows) == 1 else (0.0, 1.0, 0.0)
        self.uniform = None if restitution or threshold else (friction, restitution, threshold)
        """The law of all pairs, where there is only one, without restitution and threshold."""
        self.bounces = any(restitution for _, restitution, _ in rows)
        """Whether any two shapes bounce, so that the hook reads velocities of bodies."""

    def install(self, world: Any) -> None:
        """Let Rapier call the hook for the colliders for which its answer matters."""
        friction, restitution, _ = self.uniform or (0.0, 0.0, 0.0)
        used = set(self.materials)
        filtered = {name for pair in self._ignored for name in pair}
        excluded = {row for pair in self._excluded for row in pair}
        for handle, solid in zip(self.colliders, self._walk.shapes, strict=True):
            collider, material = world.colliders[handle], solid.shape.material
            collider.friction, collider.restitution = friction, restitution
            flags = None
            meets_all = all((material, other) in self.table for other in used)
            if not meets_all or solid.owner.body.group in filtered or solid.owner.row in excluded:
                flags = self._kinds.FILTER_CONTACT_PAIRS
            if self.uniform is None:
                modify = self._kinds.MODIFY_SOLVER_CONTACTS
                flags = modify if flags is None else flags | modify
            if flags is not None:
                collider.active_hooks = flags
        world.physics_hooks = self

    def excluded(self, first_number: int, second_number: int) -> bool:
        """Whether two colliders, by their numbers, do not touch."""
        first, second = self._walk.shapes[first_number].owner, self._walk.shapes[second_number].owner
        return (
            first.carrier == second.carrier
            or frozenset((first.body.group, second.body.group)) in self._ignored
            or (min(first.row, second.row), max(first.row, second.row)) in self._excluded
            or (self.materials[first_number], self.materials[second_number]) not in self.table
        )

    def frictionless(self, material: str) -> bool:
        """Whether a material has friction with no other."""
        return not any(friction for pair, (friction, *_) in self.table.items() if material in pair)

    # --- called by Rapier ---------------------------------------------------------------------------------------

    def filter_contact_pair(self, ctx: Any) -> Any:
        return None if self.excluded(self.number[ctx.collider1], self.number[ctx.collider2]) else self._flags

    def filter_intersection_pair(self, ctx: Any) -> bool:
        return False

    def modify_solver_contacts(self, ctx: Any) -> None:
        index, other = self.number[ctx.collider1], self.number[ctx.collider2]
        friction, restitution, threshold = self.table[self.materials[index], self.materials[other]]
        ctx.friction, ctx.restitution = friction, 0.0
        if restitution:
            self._bounce(ctx, restitution, threshold)

    def _bounce(self, ctx: Any, restitution: float, threshold: float) -> None:
        """Have every point of a pair that approaches at ``threshold`` (m/s) or more, and arrives in this step, leave at
        ``restitution`` times that speed. Rapier's point of attack, halfway between the two surfaces, stays."""
        pair = [ctx.bodies[handle] for handle in (ctx.rigid_body1, ctx.rigid_body2)]
        normal = ctx.normal.to_tuple()
        for number, contact in enumerate(ctx.solver_contacts):
            points = (contact.point, contact.point2)  # in the world
            speeds = [body.velocity_at_point(point).to_tuple() for body, point in zip(pair, points, strict=True)]
            closing = sum((a - b) * n for a, b, n in zip(*speeds, normal, strict=True))
            if closing <= 0.0 or closing < SCALE * threshold or contact.dist > closing * self._timestep:
                continue
            gap = -restitution * closing * self._timestep / ERROR_REDUCTION
            if gap < contact.dist:
                shift = tuple(0.5 * (gap - contact.dist) * n for n in normal)
                entry, other = (point.to_tuple() for point in points)
                ctx.set_solver_contact(
                    number, point=frames.subtract(entry, shift), point2=frames.add(other, shift), dist=gap
                )


class RapierBuild:
    """``world``: Rapier's. ``bodies``: the handle of the rigid body that has the mass of each body of the document;
    ``multibodies``: the trees with joints; ``colliders``: the handle of the collider of each shape of ``walk``.
    ``gravity_scales``: by the names of bodies whose weight is not mass × gravity."""

    def __init__(
        self,
        rapier: Any,
        walk: Walk,
        settings: Settings,
        laws: Sequence[PairContact],
        gravity_scales: Mapping[str, float],
    ):
        refuse(walk, NAME, cones=("elliptic",), shapes=SHAPES, moving_planes=False)
        self.rapier, self.walk = rapier, walk
        self.world = rapier.PhysicsWorld(gravity=rapier.Vec3(*lengths(walk.document.gravity, "gravity")))
        self.world.set_num_threads(1)
        timestep = checked_singles(NAME, (walk.document.timestep,), "timestep")[0]
        configure(rapier, self.world, timestep, settings)
        self.multibodies = Multibodies(rapier, self.world, walk, timestep)
        self.bodies: list[Any] = []
        for placed in walk.bodies:
            self.bodies.append(self._body(placed))
            if (scale := gravity_scales.get(placed.body.name, 1.0)) != 1.0:
                scale = checked_singles(NAME, (scale,), f"gravity scale of {placed.body.name}")[0]
                self.world.rigid_bodies[self.bodies[-1]].gravity_scale = scale
        self.colliders = [self._collider(solid) for solid in walk.shapes]
        self.laws = Laws(rapier, walk, laws, self.colliders)
        self.laws.install(self.world)
        touching = {solid.owner.carrier for solid in walk.shapes if solid.owner.moves}
        self.turned_by_contact = touching - self._only_pushed()
        """Rows of the bodies that contact may turn."""
        self._set_masses()
        self.multibodies.connect(self.world)

    def release(self) -> None:
        """Leave the integration to Rapier: its gyroscopic torques and dampings, and no flywheels."""
        for handle in dict.fromkeys([*self.bodies, *self.multibodies.bodies]):
            if (body := self.world.rigid_bodies[handle]).is_dynamic:
                body.gyroscopic_forces_enabled = True
        self.multibodies.release(self.world)

    def _set_masses(self) -> None:
        """Give the bodies their masses to the last bit. Rapier adds those of colliders, which are zero, and where a collider is
        turned or displaced computes the principal axes of the sum, with half of the digits (0.42 of a tilted capsule's inertia
        lost at most, measured); with no colliders to add it keeps the masses, once it has detected the colliders."""
        handles = list(dict.fromkeys([*self.bodies, *self.multibodies.wheel_bodies]))
        for number, handle in enumerate(handles):
            # far from each other: Rapier would take bodies that touch here for touching in the next state, too, with the
            # normal of here, as long as they neither turn nor slide (measured)
            if self.world.rigid_bodies[handle].is_dynamic:
                self.world.rigid_bodies[handle].translation = self.rapier.Vec3(0.0, 0.0, SCALE * FAR * (number + 1))
        self.world.detect_collisions()
        none = self.rapier.ColliderSet()
        for handle in handles:
            self.world.rigid_bodies[handle].recompute_mass_properties_from_colliders(none)

    def _only_pushed(self) -> set[int]:
        """Rows of the bodies on which every contact force acts through the centre of mass: balls around it without
        friction, which round-off turns at 4e-4 rad/s (measured)."""
        balls: dict[int, bool] = {}
        for solid in self.walk.shapes:
            centred = not any(frames.compose(solid.owner.pose, solid.shape.pose).position)
            ball = solid.shape.kind == "sphere" and centred and self.laws.frictionless(solid.shape.material)
            balls[solid.owner.carrier] = balls.get(solid.owner.carrier, True) and ball
        return {row for row, only in balls.items() if only}

    def _body(self, placed: PlacedBody) -> Any:
        body = placed.body
        if placed.row in self.multibodies.number:
            return self.multibodies.bodies[self.multibodies.number[placed.row]]
        if placed.carrier == placed.row:
            if not body.mass > 0.0:
                raise EngineError(NAME, f"does not support {body.name!r}, which moves and has no mass")
            if not positive_definite(body.inertia):  # Rapier would make a body that never turns
                raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no inverse")
            builder = self.rapier.RigidBody.dynamic().additional_mass_properties(mass_properties(self.rapier, body))
            # the gyroscopic torque is applied before every step: Rapier's is implicit, and 4e-4 off after 2 s (measured)
            return self.world.add_body(builder.can_sleep(False).gyroscopic_forces(False).allow_fast_rotation(True))
        if placed.moves:
            return self.bodies[placed.carrier]
        builder = self.rapier.RigidBody.fixed().position(isometry(self.rapier, placed.pose, f"pose of {body.name}"))
        if body.mass:
            builder = builder.additional_mass_properties(mass_properties(self.rapier, body))
        return self.world.add_body(builder)

    def _collider(self, solid: PlacedShape) -> Any:
        kind = solid.shape.kind
        pose = frames.compose(solid.pose, AXES[kind]) if kind in AXES else solid.pose
        place = isometry(self.rapier, pose, f"pose of {solid.shape.name}")
        builder = collider_of(self.rapier, solid.shape).density(0.0).user_data(solid.number).position(place)
        return self.world.add_collider(builder, self.carrier_of(solid))

    def carrier_of(self, solid: PlacedShape) -> Any:
        """The handle of the rigid body that has a shape."""
        owner = solid.owner
        return self.bodies[owner.carrier if owner.moves else owner.row]


_HALF = math.sqrt(0.5)
AXES: Mapping[str, Pose] = {
    "cylinder": Pose(quaternion=(_HALF, _HALF, 0.0, 0.0)),
    "capsule": Pose(quaternion=(_HALF, _HALF, 0.0, 0.0)),
}
"""Poses of Rapier's shapes, whose axis is y, in those of the world."""


def collider_of(rapier: Any, shape: JsonShape) -> Any:
    """A builder of the collider of a shape."""
    size = lengths(shape.size, f"size of {shape.name}")
    if shape.kind != "mesh" and not all(
        edge > 0.0 for edge in size
    ):  # Rapier turns such a capsule upside down, silently
        raise EngineError(NAME, f"has no {shape.kind} of the size {min(shape.size)!r} ({shape.name})")
    made = rapier.Collider
    match shape.kind:
        case "sphere":
            return made.ball(*size)
        case "box":
            return made.cuboid(*(0.5 * edge for edge in size))
        case "cylinder":
            return made.cylinder(0.5 * size[1], size[0])
        case "capsule":
            return made.capsule_y(0.5 * size[1], size[0])
        case "plane":
            return made.halfspace(rapier.Vec3(0.0, 0.0, 1.0))
    return convex(rapier, shape.name, size)


def convex(rapier: Any, name: str, size: Sequence[float]) -> Any:
    """A builder of the collider of a hull (flat vertices, 1/1024 m), of its vertices and the faces that follow from them:
    Rapier's own hull leaves out vertices where it is thin or has thousands."""
    faces = hull_triangles(NAME, name, size)
    return rapier.Collider.convex_mesh(mesh_vertices(size).astype(np.float32), faces.astype(np.uint32))


def configure(rapier: Any, world: Any, timestep: float, settings: Settings) -> None:
    """Set the parameters of the integration."""
    parameters = world.integration_parameters
    parameters.dt = timestep
    parameters.num_solver_iterations = 1  # each would be a step of a share of the time
    parameters.num_internal_pgs_iterations = int(settings["iterations"])
    parameters.num_internal_stabilization_iterations = 0  # they would remove the speed that takes back an overlap
    parameters.friction_model = rapier.FrictionModel.SIMPLIFIED
    damping = 0.5 * RIGID * (1.0 / ERROR_REDUCTION - 1.0)
    parameters.contact_softness = rapier.SpringCoefficients(RIGID / (2.0 * math.pi * timestep), damping)
    parameters.static_contact_softness = rapier.SpringCoefficients(RIGID / (2.0 * math.pi * timestep), damping)
    parameters.normalized_allowed_linear_error = 0.0
    parameters.normalized_prediction_distance = SCALE * PREDICTION
    parameters.normalized_max_corrective_velocity = SCALE * FASTEST
    parameters.normalized_max_linear_velocity = SCALE * FASTEST
    parameters.contact_recycling = parameters.contact_clustering = False
    parameters.warmstart_coefficient = 1.0
