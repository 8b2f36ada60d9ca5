"""Worlds said to PyBullet, and what its reader is held against."""

from __future__ import annotations

import numpy as np

from simspec.compiler import target_of
from simspec.dialects.pybullet.dialect import PybulletDialect
from simspec.engines.pybullet.engine import PyBullet
from tests import worlds

TEXT = 1e-12
"""The tolerance of proof level L0: numbers are printed to round-trip, only frame changes round."""


def target(world):
    return target_of(world, PyBullet)


def emit(world):
    return PybulletDialect().emit(world, target(world))


def body_numbers(body):
    joint = body.joint
    limits = joint.position_limits or (np.inf, -np.inf)
    return [
        body.inertial.mass,
        *body.inertial.centre_of_mass,
        *body.inertial.inertia,
        *joint.origin.position,
        *joint.origin.quaternion,
        *joint.axis,
        *(-1e9 if np.isinf(x) else x for x in limits),
        *(-1.0 if x is None else x for x in (joint.velocity_limit, joint.effort_limit)),
        joint.damping,
        joint.dry_friction,
        joint.armature,
        joint.spring_stiffness,
        joint.spring_rest,
        *joint.position,
        *joint.velocity,
    ]


def shape_numbers(shape):
    return [*shape.size, *shape.pose.position, *shape.pose.quaternion]


def assert_same_bodies(wanted, found, tolerance, names=True):
    assert [body.name for body in found] == [body.name for body in wanted]
    for entry, other in zip(wanted, found, strict=True):
        kind = (entry.model, entry.joint.kind, entry.joint.parent, entry.joint.name)
        assert kind == (other.model, other.joint.kind, other.joint.parent, other.joint.name)
        np.testing.assert_allclose(
            body_numbers(other), body_numbers(entry), rtol=tolerance, atol=tolerance, err_msg=entry.name
        )
        assert len(entry.shapes) == len(other.shapes)
        for shape, again in zip(entry.shapes, other.shapes, strict=True):
            assert (shape.kind, shape.collision, shape.visual) == (again.kind, again.collision, again.visual)
            assert not names or shape.name == again.name
            np.testing.assert_allclose(shape_numbers(again), shape_numbers(shape), rtol=tolerance, atol=tolerance)


def all_limits():
    """Every joint with every attribute that its kind has."""
    return worlds.limits_and_armature(armature=0.2, dry_friction=0.3)


WORLDS = {
    "every-joint": lambda: worlds.every_joint(damping=0.2),
    "damped-springs": worlds.damped_springs,
    "limits": all_limits,
    "shapes": worlds.shapes_world,
    "mixed-shapes": worlds.mixed_shapes,
    "spheres": worlds.spheres,
    "gripper": worlds.gripper,
    "hung": lambda: worlds.world(worlds.tree(["ball", "slide", "hinge"], 4, velocity_limit=2.0, effort_limit=3.0)),
}
