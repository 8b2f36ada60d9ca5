"""A world in Newton, built by calls of its ModelBuilder from ``world.json`` and its sidecar.

Each body is a link of Newton with its joint, each tree an articulation; a shape with several laws has a copy with its own
material for each. Facts marked *measured*: Newton 1.8.0, Warp 1.19.0.
"""

from __future__ import annotations

import math
import warnings
from typing import Any, NamedTuple

import numpy as np

from simspec.dialects.newton import NewtonSidecar
from simspec.engines.kit import warp as kit_warp
from simspec.engines.kit.arrays import checked_singles
from simspec.engines.kit.building import STATIC, PlacedBody, ShapeUnit, Walk, refuse
from simspec.engines.kit.links import ContactRoom
from simspec.engines.kit.world_simulation import positive_definite
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, BallJoint, FixedJoint, FreeJoint
from simspec.world.hull import HullError, hull_of, mesh_vertices
from simspec.world.types import Pose

NAME = "newton"
SHAPES = ("sphere", "box", "capsule", "cylinder", "ellipsoid", "plane", "mesh")
GAP = 5e-6
"""m from a shape at which contact begins; that of two shapes together bounds how early a resting contact is found."""
ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`)."""
MIXING = 1e-9
"""``cfm`` (1/kg), which Newton adds to each effective mass. 0 leaves redundant rows unbounded."""
FAR = 1e9
"""Distance (rad, m) from a limit up to which it has a row in the solver: Newton stores no limit as 1e10."""
LEAST_THRESHOLD = 1e-6
"""m/s below which nothing bounces: approaches of bodies at rest are round-off."""
UNLIMITED = 1e10
"""Newton's number of a position limit that a joint does not have."""


class NewtonModules(NamedTuple):
    newton: Any
    warp: Any


def imported(log: list[str]) -> NewtonModules:
    """Newton, with Warp at work. Raises EngineError where it is not installed."""
    try:
        import newton
        import warp
    except ImportError as error:
        raise EngineError(NAME, f"not installed: simspec engines install newton --yes ({error})") from error
    kit_warp.begin(warp, NAME, log)
    return NewtonModules(newton, warp)


class NewtonBuild:
    """``model``: Newton's. ``links``: the number of the link, and of the joint, of each body of ``walk``; ``shapes``: of each
    unit; ``pairs`` (n, 2): of the units that may touch."""

    def __init__(self, modules: NewtonModules, walk: Walk, sidecar: NewtonSidecar):
        refuse(walk, NAME, cones=("elliptic",), shapes=SHAPES, servos=False, moving_planes=False)
        self.newton, self.wp = modules
        self.walk, self.sidecar, document = walk, sidecar, walk.document
        self.timestep = checked_singles(NAME, (document.timestep,), "timestep")[0]
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
        alone = [walk.bodies[rows[0]] for rows in walk.trees.values() if len(rows) == 1]
        self.single = [placed.row for placed in alone if isinstance(placed.body.joint, FreeJoint)]
        """Rows of the bodies that are trees by themselves and move freely."""
        # Newton would otherwise add to all moments of a body where they miss the triangle inequality by 1e-7 (measured)
        self.model = self.builder.finalize(device="cpu", skip_validation_inertia=True)
        self.model.steel.rigid_body_angular_damping.zero_()  # 0.05 by default
        self.pairs = self.wp.array(walk.unit_pairs().astype(np.int32), dtype=self.wp.vec2i, device="cpu")

    def _body(self, placed: PlacedBody) -> int:
        body, joint = placed.body, placed.body.joint
        if placed.carrier == placed.row and not body.mass > 0.0 and isinstance(joint, FreeJoint):
            raise EngineError(NAME, f"does not support {body.name!r}, which moves freely and has no mass")
        if body.mass and placed.moves and not positive_definite(body.inertia):
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no inverse")
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
                velocity_limit=rating(joint.velocity_limit),
                effort_limit=rating(joint.effort_limit),
                stiffness=0.0,
                friction=0.0,
                **named,
            )
        )

    def _shape(self, unit: ShapeUnit) -> int:
        shape, copy, b = unit.of.shape, unit.copy, self.builder
        size = checked_singles(NAME, shape.size, f"size of {shape.name}")
        if shape.kind != "mesh" and not all(edge > 0.0 for edge in size):
            raise EngineError(NAME, f"has no {shape.kind} of the size {min(shape.size)!r} ({shape.name})")
        friction, restitution = checked_singles(NAME, (copy.friction, copy.restitution), f"numbers of {shape.name}")
        if not 0.0 <= restitution <= 1.0:
            raise EngineError(NAME, f"does not support the restitution {restitution:g} of {shape.name!r}")
        if copy.torsional_friction or copy.rolling_friction or copy.hardness is not None:
            raise EngineError(NAME, f"does not support more than friction and restitution of {shape.name!r}")
        made = {
            "cfg": self.newton.ModelBuilder.ShapeConfig(
                density=0.0,
                mu=friction,
                restitution=restitution,
                mu_torsional=0.0,
                mu_rolling=0.0,
                margin=0.0,
                gap=GAP,
            ),
            "xform": self.pose(shape.pose, f"pose of {shape.name}"),
            "label": f"{shape.name}.{copy.layer}",
        }
        link = self.links[unit.of.owner.row]
        match shape.kind:
            case "sphere":
                return int(b.add_shape_sphere(link, radius=size[0], **made))
            case "box":
                x, y, z = (0.5 * edge for edge in size)
                return int(b.add_shape_box(link, hx=x, hy=y, hz=z, **made))
            case "capsule" | "cylinder":
                add = b.add_shape_capsule if shape.kind == "capsule" else b.add_shape_cylinder
                return int(add(link, radius=size[0], half_height=0.5 * size[1], **made))
            case "ellipsoid":
                return int(b.add_shape_ellipsoid(link, rx=size[0], ry=size[1], rz=size[2], **made))
            case "mesh":
                return int(b.add_shape_convex_hull(link, mesh=self._hull(shape.name, size), **made))
        return int(b.add_shape_plane(body=link, width=0.0, length=0.0, **made))

    def _hull(self, name: str, size: tuple[float, ...]) -> Any:
        """The mesh of a convex hull (flat vertices, m)."""
        try:
            triangles = hull_of(size).triangles.astype(np.int32)
        except (HullError, ValueError) as error:
            raise EngineError(NAME, f"has no hull {name!r}: {error}") from error
        except ImportError as error:
            raise EngineError(NAME, f"meshes need scipy as well as Newton: {error}") from error
        return self.newton.Mesh(mesh_vertices(size).astype(np.float32), triangles.ravel(), compute_inertia=False)

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
                friction_anchor_beta=0.0,  # else friction depends on contact points of earlier steps
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
            verify_buffers=False,
        )


def rating(value: float | None) -> float:
    """A velocity or effort limit, which Newton stores and simspec does not let it enforce."""
    return math.inf if value is None else checked_singles(NAME, (value,), "limit")[0]
