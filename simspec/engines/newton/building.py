"""A world in Newton, built by calls of its ModelBuilder from ``world.json`` and its sidecar.

Each body is a link of Newton with its joint, each tree an articulation; a shape with several laws has a copy with its own
material for each. Facts marked *measured*: Newton 1.8.0, Warp 1.19.0.
"""

from __future__ import annotations

import dataclasses
import warnings
from typing import Any, NamedTuple

import numpy as np

from simspec.dialects.newton import NewtonSidecar
from simspec.engines.kit import warp as kit_warp
from simspec.engines.kit.arrays import checked_limit, checked_singles
from simspec.engines.kit.building import (
    HALVED,
    STATIC,
    PlacedBody,
    ShapeUnit,
    Walk,
    hull_triangles,
    refuse,
    surface_numbers,
)
from simspec.engines.kit.link_contacts import ContactRoom
from simspec.engines.kit.servos import ArrayDrives
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, BallJoint, FixedJoint, FreeJoint
from simspec.world.hull import mesh_vertices
from simspec.world.types import Pose

NAME = "newton"
SIZES = {
    "sphere": ("radius",),
    "box": ("hx", "hy", "hz"),
    "capsule": ("radius", "half_height"),
    "cylinder": ("radius", "half_height"),
    "ellipsoid": ("rx", "ry", "rz"),
}
"""By kind of shape the arguments of Newton for its size."""
SHAPES = (*SIZES, "plane", "mesh")
GAP = 5e-6
"""m from a shape at which contact begins; that of two shapes together bounds how early a resting contact is found."""
ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`)."""
REGULARISATION = 0.001
"""``contact_regularization`` with warm start, which makes impulses of redundant contact points unique."""
MIXING = 1e-9
"""``cfm`` (1/kg), which Newton adds to each effective mass. 0 leaves redundant rows unbounded."""
FAR = 1e9
"""Distance (rad, m) from a limit up to which it has a row in the solver: Newton stores no limit as 1e10."""
LEAST_THRESHOLD = 1e-6
"""m/s below which nothing bounces: approaches of bodies at rest are round-off."""
KERNELS = ("create_narrow_phase_primitive_kernel", "create_narrow_phase_kernel_gjk_mpr")
"""Functions that Newton calls for each pipeline."""
UNLIMITED = 1e10
"""Newton's number of a position limit that a joint does not have."""


class NewtonModules(NamedTuple):
    newton: Any
    warp: Any
    origins: Any
    """:mod:`simspec.engines.newton.origins`."""


def imported(log: list[str]) -> NewtonModules:
    """Newton, with Warp at work. Raises EngineError where it is not installed."""
    try:
        import newton
        import warp
    except ImportError as error:
        raise EngineError(NAME, f"not installed: simspec engines install newton --yes ({error})") from error
    kit_warp.begin(warp, NAME, log)
    kit_warp.share_kernels(newton.geometry.NarrowPhase, KERNELS)
    from simspec.engines.newton import origins

    return NewtonModules(newton, warp, origins)


class NewtonBuild:
    """``model``: Newton's. ``links``: the number of the link, and of the joint, of each body of ``walk``; ``shapes``: of each
    unit; ``pairs`` (n, 2): of the units that may touch."""

    def __init__(self, modules: NewtonModules, walk: Walk, sidecar: NewtonSidecar):
        refuse(walk, NAME, cones=("elliptic",), shapes=SHAPES, moving_planes=False, degenerate_mass=False)
        self.newton, self.wp, _ = modules
        self.walk, self.sidecar, document = walk, sidecar, walk.document
        self.warm_start = bool(sidecar.settings.get("warm_start"))
        self.gravity = checked_singles(NAME, document.gravity, "gravity")
        self.builder = self.newton.ModelBuilder(gravity=self.wp.vec3(*self.gravity))
        self.newton.solvers.SolverSteel.register_custom_attributes(self.builder)
        self.links = [0] * len(walk.bodies)
        for rows in walk.trees.values():
            joints = [self._body(walk.bodies[row]) for row in rows]
            self.builder.add_articulation(joints)
        self.shapes = [self._shape(unit) for unit in walk.units]
        self.unit_of = np.argsort(self.shapes).astype(np.int64)
        """By Newton's number of a shape that of its unit."""
        # Newton would otherwise add to all moments of a body where they miss the triangle inequality by 1e-7 (measured)
        self.model = self.builder.finalize(device="cpu", skip_validation_inertia=True)
        self.model.steel.rigid_body_angular_damping.zero_()  # 0.05 by default
        self.pairs = self._pairs(walk.unit_pairs())
        self.dofs = self.model.joint_qd_start.numpy()[self.links]
        """Newton's number of the first degree of freedom of each body's joint."""
        gains = (self.model.joint_target_ke, self.model.joint_target_kd, self.model.joint_effort_limit)
        self.drives = ArrayDrives(NAME, walk, [array.numpy() for array in gains], self.dofs)
        self.centred = self._pairs([[self.links[row] for row in pair] for pair in walk.lightest.items()])
        """Roots that cannot move, and the link at whose centre of mass each has its own (:mod:`origins`)."""

    def _pairs(self, pairs: Any) -> Any:
        rows = np.array(pairs, dtype=np.int32).reshape(-1, 2)
        return self.wp.array(rows, dtype=self.wp.vec2i, device="cpu")

    def _body(self, placed: PlacedBody) -> int:
        body, joint = placed.body, placed.body.joint
        if not placed.moves:  # mass properties that have no effect: see ``origins.py``
            body = dataclasses.replace(body, mass=0.0, centre_of_mass=(0.0,) * 3, inertia=(0.0,) * 6)
        wp, b = self.wp, self.builder
        xx, yy, zz, xy, xz, yz = checked_singles(NAME, body.inertia, f"inertia of {body.name}")
        link = b.add_link(
            mass=checked_singles(NAME, (body.mass,), f"mass of {body.name}")[0],
            com=wp.vec3(*checked_singles(NAME, body.centre_of_mass, f"centre of mass of {body.name}")),
            inertia=wp.mat33(xx, xy, xz, xy, yy, yz, xz, yz, zz),
            lock_inertia=True,
            label=body.name,
        )
        self.links[placed.row] = link
        if isinstance(joint, FreeJoint):
            return int(b.add_joint_free(link, label=joint.name))
        parent = -1 if placed.parent == STATIC else self.links[placed.parent]
        named = {
            "parent_xform": self.pose(joint.origin, f"origin of {joint.name}"),
            "child_xform": wp.transform(),
            "label": joint.name,
        }
        if isinstance(joint, FixedJoint):
            return int(b.add_joint_fixed(parent, link, **named))
        named["damping"] = checked_singles(NAME, (joint.damping,), f"damping of {joint.name}")[0]
        if isinstance(joint, BallJoint):
            armature = checked_singles(NAME, (joint.armature or 0.0,), f"armature of {joint.name}")[0]
            return int(b.add_joint_ball(parent, link, armature=armature, **named))
        return int(self._axis(parent, link, joint, named))

    def _axis(self, parent: int, link: int, joint: AxisJoint, named: dict[str, Any]) -> int:
        if joint.dry_friction:
            raise EngineError(NAME, f"has no dry friction of joints on a processor, which {joint.name!r} has")
        limits = (-UNLIMITED, UNLIMITED) if joint.position_limits is None else joint.position_limits
        lower, upper = checked_singles(NAME, limits, f"limits of {joint.name}")
        add = self.builder.add_joint_revolute if joint.kind == "hinge" else self.builder.add_joint_prismatic
        return int(
            add(
                parent,
                link,
                axis=self.wp.vec3(*checked_singles(NAME, joint.axis, f"axis of {joint.name}")),
                armature=checked_singles(NAME, (joint.armature,), f"armature of {joint.name}")[0],
                limit_lower=lower,
                limit_upper=upper,
                velocity_limit=checked_limit(NAME, joint.velocity_limit, f"limit of {joint.name}"),  # not enforced
                effort_limit=checked_limit(NAME, joint.effort_limit, f"limit of {joint.name}"),  # not enforced
                stiffness=0.0,
                friction=0.0,
                **named,
            )
        )

    def _shape(self, unit: ShapeUnit) -> int:
        shape, b = unit.of.shape, self.builder
        size = checked_singles(NAME, shape.size, f"size of {shape.name}")
        friction, restitution = surface_numbers(NAME, unit, size)
        given: dict[str, Any] = {
            "body": self.links[unit.of.owner.row],
            "xform": self.pose(shape.pose, f"pose of {shape.name}"),
            "label": f"{shape.name}.{unit.copy.layer}",
            "cfg": self.newton.ModelBuilder.ShapeConfig(
                density=0.0,
                mu=friction,
                restitution=restitution,
                mu_torsional=0.0,
                mu_rolling=0.0,
                margin=0.0,
                gap=GAP,
            ),
        }
        match shape.kind:
            case "mesh":
                triangles = hull_triangles(NAME, shape.name, size).astype(np.int32).ravel()
                vertices = mesh_vertices(size).astype(np.float32)
                given["mesh"] = self.newton.Mesh(vertices, triangles, compute_inertia=False)
                return int(b.add_shape_convex_hull(**given))
            case "plane":
                return int(b.add_shape_plane(width=0.0, length=0.0, **given))  # endless
        halves = (factor * edge for factor, edge in zip(HALVED[shape.kind], size, strict=True))
        given |= dict(zip(SIZES[shape.kind], halves, strict=True))
        return int(getattr(b, f"add_shape_{shape.kind}")(**given))

    def pose(self, pose: Pose, name: str) -> Any:
        w, x, y, z = pose.quaternion
        return self.wp.transform(self.wp.vec3(*checked_singles(NAME, pose.position, name)), self.wp.quat(x, y, z, w))

    def solver(self, room: ContactRoom) -> Any:
        """Newton's solver Steel, by the common law of contact."""
        self.model.rigid_contact_max = room.contacts
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on room for rows, which grows
            return self.newton.solvers.SolverSteel(
                self.model,
                iterations=int(self.sidecar.settings["iterations"]),
                baumgarte=ERROR_REDUCTION,
                cfm=MIXING,
                contact_warmstart=self.warm_start,
                contact_regularization=REGULARISATION if self.warm_start else 0.0,
                friction_anchor_beta=0.0,  # else friction depends on contact points of earlier steps
                drive_mode="rows" if self.drives.on else "augmented",  # which does not bound the reaction to a load
                enable_joint_limits=True,
                joint_limit_activation_gap=FAR,
                restitution_velocity_threshold=max(self.sidecar.restitution_threshold, LEAST_THRESHOLD),
                articulation_constraint_max=room.rows,
                free_body_constraint_max=3 * room.contacts,
                warn_constraint_overflow=False,
            )

    def pipeline(self, room: ContactRoom) -> Any:
        """Newton's detection of contact between the pairs that may touch."""
        return self.newton.CollisionPipeline(
            self.model,
            broad_phase="explicit",
            shape_pairs_filtered=self.pairs,
            rigid_contact_max=room.contacts,
            reduce_contacts=False,
            deterministic=True,
            contact_matching="latest" if self.warm_start else "disabled",
            verify_buffers=False,
        )
