"""Bodies that are nothing but frames: fixed to others, without mass and shapes, and carrying nothing but such bodies."""

from __future__ import annotations

from simspec.world.derived import derived
from simspec.world.types import Body, Follow, Inertial, World

NOTHING = Inertial(0.0)


@derived
def bare_frames(world: World) -> frozenset[str]:
    """The names of the bodies of a world that are nothing but frames: where they are follows from the body that carries them,
    and nothing follows from them. The ends of constraints are none, since something acts there."""
    held = {end for one in world.constraints if not isinstance(one, Follow) for end in (one.first, one.second)}
    carrying: set[str] = set()
    bare: set[str] = set()
    for body in reversed(world.bodies):
        if _is_frame(body) and body.name not in held and body.name not in carrying:
            bare.add(body.name)
        elif body.joint.parent is not None:
            carrying.add(body.joint.parent)
    return frozenset(bare)


def _is_frame(body: Body) -> bool:
    fixed = body.joint.kind == "fixed" and body.joint.parent is not None
    return fixed and not body.shapes and body.inertial == NOTHING and body.gravity_scale == 1.0
