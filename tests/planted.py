"""The worlds of the self-test that engines other than MuJoCo refuse."""

from __future__ import annotations

from simspec.proof.selftest_worlds import WORLDS

MUJOCO_ALONE = {
    "ball limit": "joint.limits.angle",
    "belts": "shape.surface_velocity",
    "margins": "shape.margin",
    "sum friction": "constraint.sum.dry_friction",
    "sum limits": "constraint.sum.limits",
}
"""By name, with the feature that the others lack."""
AS_INERTIA = ("ball armature", "free armature")
"""Worlds that dialects receive as others (``Dialect.received``)."""
SHARED = {name: make for name, make in WORLDS.items() if name not in (*MUJOCO_ALONE, *AS_INERTIA)}
"""The other worlds, by name."""
