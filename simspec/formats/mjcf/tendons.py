"""Sums of joint positions as MJCF has them: fixed tendons."""

from __future__ import annotations

from simspec.formats.mjcf.tree import Attributes, Tendon, Value
from simspec.world.actions import JointSum
from simspec.world.types import World


def tendons(world: World, limited: Attributes = (), rubbed: Attributes = ()) -> tuple[Tendon, ...]:
    """One fixed tendon for each sum; ``limited``, ``rubbed``: attributes of those with limits, and with dry friction."""
    return tuple(
        Tendon(
            one.name,
            one.joints,
            (*_acting(one), *(limited if one.position_limits else ()), *(rubbed if one.dry_friction else ())),
        )
        for one in world.sums
    )


def _acting(one: JointSum) -> Attributes:
    """What acts along it. The length of a fixed tendon is the sum itself, of joint positions as the file counts them."""
    attributes: list[tuple[str, Value]] = [
        ("limited", one.position_limits is not None),
        ("range", one.position_limits or (0.0, 0.0)),
        ("stiffness", one.stiffness),
        ("springlength", one.rest),
        ("damping", one.damping),
        ("frictionloss", one.dry_friction),
        ("margin", 0.0),
    ]
    return tuple(attributes)
