"""Declarations of engines that simspec gives no joints: all of it follows from why."""

from __future__ import annotations

from simspec.support.declarations import Table, never
from simspec.support.features import Feature

JOINTS = (Feature.JOINT_HINGE, Feature.JOINT_SLIDE, Feature.JOINT_BALL, Feature.JOINT_SEVERAL)
OF_JOINTS = (
    *(Feature.LIMIT_POSITION, Feature.DAMPING, Feature.BALL_DAMPING, Feature.SPRING, Feature.BALL_SPRING),
    *(Feature.DRY_FRICTION, Feature.ARMATURE, Feature.BALL_ARMATURE, Feature.CONTROL, Feature.CONSTRAINT_COUPLING),
    *(Feature.SUM, Feature.SUM_DRY_FRICTION, Feature.SUM_LIMITS),
)
"""What acts on joints alone."""


def jointless(engine: str, drift: str, moved_by: str) -> Table:
    """The declarations of an engine without joints. ``drift``: why; ``moved_by``: what of its own would move them."""
    nothing = f"there are no joints that it could act on: {drift}"
    return {
        **dict.fromkeys(JOINTS, never(drift)),
        **dict.fromkeys(OF_JOINTS, never(nothing)),
        Feature.FREE_ARMATURE: never(
            f"{engine} has no armature of free bodies, and contact would ignore a computed one"
        ),
        Feature.BALL_LIMIT: never("world.json has no limits of balls"),
        Feature.CONTROL_NATIVE: never(f"simspec gives {engine} no joints, which its {moved_by} would move"),
        Feature.CONSTRAINT_LOOP: never(f"loops are closed by joints: {drift}"),
    }
