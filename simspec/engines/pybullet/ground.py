"""What PyBullet's contact with height fields does not have, world by world."""

from __future__ import annotations

from typing import Final

from simspec.contact.plan import ContactPlan
from simspec.dialects.pybullet.hulls import margins_of
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world.types import World

HOW: Final = (
    "a closed surface of triangles, in single precision; PyBullet feels their inner edges: what slides without friction over "
    "flat ground of 20 cm cells loses 1 % of 1 m/s in 2 m, and drifts 5 mm aside (measured)"
)


def ground_held(world: World, plan: ContactPlan, base_margin: float) -> Refinement | None:
    """Not supported where PyBullet would keep a margin around a height field: on other links than bases, and in copies."""
    for body in world.bodies:
        margins = [margin for _, margin in margins_of("heightfield", body, plan, base_margin)]
        if any(margins):
            shape = next(shape.name for shape in body.shapes if shape.kind == "heightfield")
            return unsupported_if(
                f"PyBullet keeps {max(margins):g} m around the height field {shape!r}: it keeps none where the body is a root "
                "without mass, with one material, and collision_margin is 0"
            )
    return None
