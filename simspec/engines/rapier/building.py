"""A world as Rapier holds it: made from the document of ``world.json`` and its sidecar by calls of its API.

What cannot move are Rapier's fixed bodies, a free root and all that is fixed to it is one dynamic body. Shapes are colliders
without density, so that masses are those that bodies are told. Facts marked *measured*: rapier3d 0.36.1.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from simspec.dialects.kit.world_laws import LawSidecar
from simspec.engines.kit.single import held_by
from simspec.errors import EngineError
from simspec.formats.world.tree import AxisJoint, FixedJoint, FreeJoint, JsonBody, JsonShape, JsonWorld, parent_of
from simspec.world import frames
from simspec.world.hull import HullError, hull_of, mesh_vertices
from simspec.world.inertia import principal_axes
from simspec.world.types import Hardness, PairContact, Pose, Quaternion, Vector3

# The unit of length that Rapier is given, and the share of an overlap that a step takes back.

NAME = "rapier"
SCALE = 1024.0
"""Rapier is told lengths in 1/1024 m. Its search for nearest points ends by thresholds in its own unit: with the metre 12 % of
the overlaps of a ball and a hull of 100 corners were missed, half of those with 400, and 13 % of a capsule and a cylinder; from
four times that to a million times none (0.03 to 5 mm deep, shapes of 0.2 m; shallower ones of cylinders are still missed,
``cylinders.py``). Of 30 stacks of three boxes as hulls 9 fell with the metre, and some with 1/256 m and more; with 1/1024 m
none of 60 (measured). A power of two changes no digit of a number."""
SQUARE = SCALE * SCALE
"""Its unit of torque, inertia and energy in 1 N m, 1 kg m² and 1 J."""

ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`)."""


def lengths(values: Iterable[float], what: str) -> tuple[float, ...]:
    """Lengths (m, m/s, m/s²) as Rapier is told them."""
    return held_by(NAME, (SCALE * value for value in values), what)


# What touches what in Rapier, and by which law: a hook that Rapier calls for pairs of colliders.
#
# Rapier combines a number of each of two colliders; a table of materials has more numbers than such rules can give. Where all
# that meets has one law, colliders have its numbers and no hook is called for them. Else the hook writes those of the two
# materials into each pair of colliders before the solver sees it (measured: exact).
#
# Rapier solves a step without restitution first, and then adds to normal impulses, in one sweep over the points, what makes
# things bounce: a ball that hits two others at once left with 12.5 % more energy than it came with, a box that landed flat with
# 0.77 of its speed and a spin, and the friction of an impact was that without the bounce (measured). So the hook gives Rapier
# no restitution: a point that approaches at c has, for the step, the overlap −e c dt / β that error reduction undoes at e c, in
# the same sweeps as all else (measured: energy to 1e-4, four points and two bodies at once, friction of the whole impulse).


def not_held(law: PairContact) -> str | None:
    """What of a law Rapier does not have; None where it has all."""
    if law.hardness.kind != "common":
        return f"the hardness {law.hardness.kind}"
    if law.hardness != Hardness():
        return "numbers beside the common hardness"
    if law.margin is not None:
        return "a margin"
    if law.rolling_friction or law.torsional_friction:
        return "torsional or rolling friction"
    return None


class Laws:
    """The hook. ``places``: of each collider the row of what carries it (−1: it cannot move) and of its body."""

    def __init__(
        self,
        rapier: Any,
        document: JsonWorld,
        laws: Sequence[PairContact],
        colliders: Sequence[Any],
        materials: Sequence[str],
        groups: Sequence[str],
        places: Sequence[tuple[int, int]],
    ):
        for law in laws:
            if wrong := not_held(law):
                raise EngineError(NAME, f"does not support {wrong} of {law.first} and {law.second}")
        self._flags, self._kinds = rapier.SolverFlags.COMPUTE_IMPULSES, rapier.ActiveHooks
        self.colliders = list(colliders)
        self.number = {handle: index for index, handle in enumerate(colliders)}
        self.materials, self._groups, self._places = list(materials), list(groups), list(places)
        self.table: dict[tuple[str, str], tuple[float, float, float]] = {}
        self.named: dict[tuple[str, str], PairContact] = {(law.first, law.second): law for law in laws}
        for law in laws:
            row = (law.friction, law.restitution, law.restitution_threshold)
            self.table[law.first, law.second] = self.table[law.second, law.first] = row
        self._ignored = {pair for one, other in document.apart.groups for pair in ((one, other), (other, one))}
        names = {body.name: row for row, body in enumerate(document.bodies)}
        self._excluded = {
            pair
            for one, other in document.apart.bodies
            for pair in ((names[one], names[other]), (names[other], names[one]))
        }
        used = sorted(set(self.materials))
        own = {self.table[pair] for pair in self.table if set(pair) <= set(used)}
        friction, restitution, threshold = next(iter(own)) if len(own) == 1 else (0.0, 1.0, 0.0)
        self.uniform = None if restitution or threshold else (friction, restitution, threshold)
        """The one law of all that meets, where there is one, without a threshold, and nothing bounces."""
        self._timestep = document.timestep
        meets = {material: {other for one, other in self.table if one == material} for material in used}
        self._asked = [
            not set(used) <= meets[material]
            or any(group == one for one, _ in self._ignored)
            or any(row == one for one, _ in self._excluded)
            for material, group, (_, row) in zip(self.materials, self._groups, self._places, strict=True)
        ]
        self.calls = 0

    def install(self, world: Any) -> None:
        """Have Rapier ask of the colliders for which it matters."""
        friction, restitution, _ = self.uniform or (0.0, 0.0, 0.0)
        for number, handle in enumerate(self.colliders):
            held = world.colliders[handle]
            held.friction, held.restitution = friction, restitution
            flags = self._kinds.FILTER_CONTACT_PAIRS if self._asked[number] else None
            if self.uniform is None:
                more = self._kinds.MODIFY_SOLVER_CONTACTS
                flags = more if flags is None else flags | more
            if flags is not None:
                held.active_hooks = flags
        world.physics_hooks = self

    def apart(self, one: int, other: int) -> bool:
        """Whether two colliders, by their numbers, do not touch."""
        (first, body), (second, another) = self._places[one], self._places[other]
        return (
            first == second
            or (self._groups[one], self._groups[other]) in self._ignored
            or (body, another) in self._excluded
            or (self.materials[one], self.materials[other]) not in self.table
        )

    def slippery(self, material: str) -> bool:
        """Whether a material has no friction with any."""
        return not any(friction for pair, (friction, *_) in self.table.items() if material in pair)

    # --- what Rapier calls ------------------------------------------------------------------------------------

    def filter_contact_pair(self, ctx: Any) -> Any:
        return None if self.apart(self.number[ctx.collider1], self.number[ctx.collider2]) else self._flags

    def filter_intersection_pair(self, ctx: Any) -> bool:
        return False

    def modify_solver_contacts(self, ctx: Any) -> None:
        one, other = self.number[ctx.collider1], self.number[ctx.collider2]
        friction, restitution, threshold = self.table[self.materials[one], self.materials[other]]
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
                one, other = (point.to_tuple() for point in points)
                ctx.set_solver_contact(
                    number, point=frames.subtract(one, shift), point2=frames.add(other, shift), dist=gap
                )

    def law_table(self) -> dict[tuple[str, str], tuple[float, float, float]]:
        """By sorted materials friction, restitution and threshold."""
        return {pair: row for pair, row in self.table.items() if pair[0] <= pair[1]}


RIGID = 1000.0
"""ω dt of contacts, where their damping ratio is then 49,500: the share ω dt / (ω dt + 2 ζ) of an overlap that a step takes
away is β, and nothing gives way beside that (measured: the contact law to three digits from 0.5 to 8 ms)."""
PREDICTION = 1e-6
"""m by which two shapes may be apart and have a contact: from 1e-3 on what slides hops."""
FAR = 1e3
"""m by which bodies are apart while Rapier sees their colliders for the first time."""
FASTEST = 1e6
"""m/s: Rapier holds speeds below a largest one, 400 m/s by itself, and those that an overlap is undone with below 3 m/s."""
SHAPES = ("sphere", "box", "cylinder", "capsule", "plane", "mesh")
Settings = Mapping[str, Any]


class Built:
    """``world``: Rapier's. ``bodies``: the handle of each body's rigid body, its own or that which carries it; ``carrier``: the
    row of that body, −1 of what cannot move; ``local``: each body's pose in it, in the world of what cannot move.
    ``shapes``: (body, name) of every collision shape, in the order of their numbers; ``colliders`` their handles."""

    def __init__(self, rapier: Any, document: JsonWorld, told: LawSidecar):
        self.rapier, self.document = rapier, document
        self.world = rapier.PhysicsWorld(gravity=rapier.Vec3(*lengths(document.gravity, "gravity")))
        self.world.set_num_threads(1)
        if document.friction_cone != "elliptic":
            raise EngineError(NAME, f"does not support the friction cone {document.friction_cone}")
        self.settings = told.settings
        configure(rapier, self.world, held_by(NAME, (document.timestep,), "timestep")[0], told.settings)
        self.bodies: list[Any] = []
        self.carrier: list[int] = []
        self.local: list[Pose] = []
        self.shapes: list[tuple[int, str]] = []
        self.colliders: list[Any] = []
        rows = {body.name: row for row, body in enumerate(document.bodies)}
        for row, body in enumerate(document.bodies):
            self._body(row, body, None if parent_of(body.joint) is None else rows[parent_of(body.joint) or ""])
        materials = []
        for row, body in enumerate(document.bodies):
            for shape in body.shapes:
                if shape.copies:
                    self._shape(row, shape)
                    materials.append(shape.material)
        groups = [document.bodies[row].group for row, _ in self.shapes]
        places = [(self.carrier[row], row) for row, _ in self.shapes]
        self.laws = Laws(rapier, document, told.laws, self.colliders, materials, groups, places)
        self.laws.install(self.world)
        self.turned_by_contact = {self.carrier[row] for row, _ in self.shapes} - {-1} - self._only_pushed()
        """Rows of the bodies that contact may turn."""
        self._weigh()

    def _weigh(self) -> None:
        """Bodies weigh what they were told, to the last bit.

        Rapier adds what every collider weighs, nothing here, and where one is turned or displaced it finds the principal axes
        of the sum anew, by a formula that loses half of all digits, and all where two moments are nearly equal (measured: up to
        0.42 of a tilted capsule's inertia). Asked to add none it keeps what was told, from when it has seen its colliders.
        """
        for number, handle in enumerate(dict.fromkeys(self.bodies)):
            # far apart: what touches here Rapier would take for touching in the state that is set next, with the normal of
            # here, as long as nothing turns or slides (a cube put onto a table was thrown down through it, measured)
            if self.world.rigid_bodies[handle].is_dynamic:
                self.world.rigid_bodies[handle].translation = self.rapier.Vec3(0.0, 0.0, SCALE * FAR * (number + 1))
        self.world.detect_collisions()
        none = self.rapier.ColliderSet()
        for handle in dict.fromkeys(self.bodies):
            self.world.rigid_bodies[handle].recompute_mass_properties_from_colliders(none)

    def _only_pushed(self) -> set[int]:
        """Rows of the bodies whose contacts all push towards their centre of mass: balls around it, without friction, which
        round-off turns at 4e-4 rad/s (216 of them in 1.2 s, measured)."""
        balls: dict[int, bool] = {}
        for row, body in enumerate(self.document.bodies):
            for shape in (shape for shape in body.shapes if shape.copies):
                centred = not any(frames.compose(self.local[row], shape.pose).position)
                ball = shape.kind == "sphere" and centred and self.laws.slippery(shape.material)
                balls[self.carrier[row]] = balls.get(self.carrier[row], True) and ball
        return {row for row, only in balls.items() if only}

    def _body(self, row: int, body: JsonBody, parent: int | None) -> None:
        joint = body.joint
        if isinstance(joint, FreeJoint):
            self.carrier.append(row)
            self.local.append(Pose())
            self.bodies.append(self._dynamic(body))
            return
        if not isinstance(joint, FixedJoint):
            driven = isinstance(joint, AxisJoint) and joint.servo is not None
            raise EngineError(
                NAME, f"does not support the {joint.kind} {joint.name!r}" + " and its controller" * driven
            )
        carrier = -1 if parent is None else self.carrier[parent]
        pose = joint.origin if parent is None else frames.compose(self.local[parent], joint.origin)
        self.carrier.append(carrier)
        self.local.append(pose)
        if carrier >= 0:
            if body.mass or any(body.inertia):
                raise EngineError(
                    NAME, f"does not support the mass of {body.name!r}, which is fixed to a body that moves"
                )
            self.bodies.append(self.bodies[carrier])
            return
        builder = self.rapier.RigidBody.fixed().position(isometry(self.rapier, pose, f"pose of {body.name}"))
        if body.mass:
            builder = builder.additional_mass_properties(self._mass(body))
        self.bodies.append(self.world.add_body(builder))

    def _dynamic(self, body: JsonBody) -> Any:
        if not body.mass > 0.0:
            raise EngineError(NAME, f"does not support {body.name!r}, which moves and has no mass")
        if not regular(body.inertia):
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no inverse")
        builder = self.rapier.RigidBody.dynamic().additional_mass_properties(self._mass(body))
        # the gyroscopic torque is given before every step: Rapier's own is implicit, and 4e-4 off after 2 s (measured)
        builder = builder.can_sleep(False).gyroscopic_forces(False).allow_fast_rotation(True)
        return self.world.add_body(builder)

    def _mass(self, body: JsonBody) -> Any:
        moments, axes = principal(body.inertia)
        mass = held_by(NAME, (body.mass,), f"mass of {body.name}")[0]
        centre = lengths(body.centre_of_mass, f"centre of {body.name}")
        told = held_by(NAME, (SQUARE * moment for moment in moments), f"inertia of {body.name}")
        vector = self.rapier.Vec3
        return self.rapier.MassProperties(vector(*centre), mass, vector(*told), self.rapier.Rotation3(*axes))

    def _shape(self, row: int, shape: JsonShape) -> None:
        builder = collider_of(self.rapier, shape)
        if builder is None:
            raise EngineError(NAME, f"does not support the {shape.kind} {shape.name!r}")
        if shape.kind == "plane" and self.carrier[row] >= 0:
            raise EngineError(NAME, f"does not support the plane {shape.name!r} on a body that moves")
        pose = shape.pose if self.carrier[row] < 0 else frames.compose(self.local[row], shape.pose)
        placed = frames.compose(pose, AXES[shape.kind]) if shape.kind in AXES else pose
        place = isometry(self.rapier, placed, f"pose of {shape.name}")
        builder = builder.density(0.0).user_data(len(self.shapes)).position(place)
        self.shapes.append((row, shape.name))
        self.colliders.append(self.world.add_collider(builder, self.bodies[row]))


NOTHING_ACROSS = 2.0**-27
"""Products of inertia, of the largest moment, that are none: an eighth of the last bit of single precision."""
_HALF = math.sqrt(0.5)
AXES: Mapping[str, Pose] = {
    "cylinder": Pose(quaternion=(_HALF, _HALF, 0.0, 0.0)),
    "capsule": Pose(quaternion=(_HALF, _HALF, 0.0, 0.0)),
}
"""How Rapier's shapes stand in the world's: their axis is y."""


def collider_of(rapier: Any, shape: JsonShape) -> Any:
    """A builder of a collider; None of a shape that Rapier does not have."""
    size = lengths(shape.size, f"size of {shape.name}")
    if shape.kind != "mesh" and not all(edge > 0.0 for edge in size):  # Rapier turns a capsule round, in silence
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
        case "mesh":
            return convex(rapier, shape.name, size)
    return None


def convex(rapier: Any, name: str, size: Sequence[float]) -> Any:
    """A builder of the collider of a hull (flat vertices, 1/1024 m), of its vertices and the faces that follow from them:
    Rapier's own hull leaves out vertices where it is thin or has thousands."""
    try:
        faces = hull_of(size).triangles
    except (HullError, ValueError) as error:
        raise EngineError(NAME, f"has no hull {name!r}: {error}") from error
    except ImportError as error:
        raise EngineError(NAME, f"meshes need scipy beside Rapier: {error}") from error
    return rapier.Collider.convex_mesh(mesh_vertices(size).astype(np.float32), faces.astype(np.uint32))


def configure(rapier: Any, world: Any, timestep: float, settings: Settings) -> None:
    """The parameters of the integration, of which Rapier would choose all for itself."""
    held = world.integration_parameters
    held.dt = timestep
    held.num_solver_iterations = 1  # each is a step of its own, of a share of the time
    held.num_internal_pgs_iterations = int(settings["iterations"])
    held.num_internal_stabilization_iterations = 0  # they would take the speed away that undoes an overlap
    held.friction_model = rapier.FrictionModel.SIMPLIFIED
    damping = 0.5 * RIGID * (1.0 / ERROR_REDUCTION - 1.0)
    held.contact_softness = rapier.SpringCoefficients(RIGID / (2.0 * math.pi * timestep), damping)
    held.static_contact_softness = rapier.SpringCoefficients(RIGID / (2.0 * math.pi * timestep), damping)
    held.normalized_allowed_linear_error = 0.0
    held.normalized_prediction_distance = SCALE * PREDICTION
    held.normalized_max_corrective_velocity = SCALE * FASTEST
    held.normalized_max_linear_velocity = SCALE * FASTEST
    held.contact_recycling = held.contact_clustering = False
    held.warmstart_coefficient = 1.0


def isometry(rapier: Any, pose: Pose, what: str) -> Any:
    place = rapier.Vec3(*lengths(pose.position, what))
    return rapier.Isometry3(place, rapier.Rotation3(*pose.quaternion))


def tensor(inertia: Sequence[float]) -> np.ndarray:
    """(3, 3) of xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def regular(inertia: Sequence[float]) -> bool:
    """Whether Rapier can invert a tensor: of a moment that is none it makes a body that never turns, without a word."""
    return bool(np.linalg.eigvalsh(tensor(inertia))[0] > 0.0)


def principal(inertia: Sequence[float]) -> tuple[Vector3, Quaternion]:
    """Principal moments and the axes that they are about: the body's own where the tensor is diagonal but for round-off."""
    x, y, z, *across = inertia
    if max(map(abs, across)) <= NOTHING_ACROSS * max(x, y, z):
        across = [0.0, 0.0, 0.0]
    return principal_axes((x, y, z, *across))
