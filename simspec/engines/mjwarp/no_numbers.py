"""What of a world becomes no number (NaN) in MuJoCo Warp, and is therefore refused.

Its Newton solver factors its matrix in singles without a floor under the pivots, where MuJoCo has one (tile_cholesky in its
solver; google-deepmind/mujoco_warp, issue 1415), and the matrix is the worse conditioned the harder friction is (``impratio``):
most likely that is why. Warp compiles for the processor that it runs on: what is no number on one may be one on another.
*Measured* at 1 ms, MuJoCo Warp 4.0.0 on processors of Intel and AMD:

- Under the pyramid a box with friction that is pushed.
- Under the elliptic cone a free body of which the first part weighs nothing, and the parts that are fixed to it 1.1 kg: it
  lands on a box with 3 m/s and is no number 0.1 s later, with a hinge on it or without; not where the first part weighs 0.5 kg,
  not without friction.
- Torsional friction without rolling friction (contacts of four rows), of 1 to 100 mm, μ = 0.2 to 1: a ball that lands, at an
  impratio of 1e4 and more, on AMD; at 1000 all probes of L5 are met. With rolling friction (six rows) they are met at 1e5, too.
- A box that bounces may be by chance: of 240 pushes of boxes with restitution one is (L5, which says so and is not valid then).
"""

from __future__ import annotations

from simspec.engines.mujoco.rewritten import rubs
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.kinematics import rigid_groups
from simspec.world.types import World

PYRAMID = (
    "under the pyramid a box with friction that is pushed becomes no number (NaN), in single precision (L5; measured)"
)
MOST_TORSIONAL_RATIO = 1000.0
"""``impratio`` up to which torsional friction by itself is met."""


def weightless_rub(world: World) -> Refinement | None:
    """Refused where a body without mass has shapes with friction on what moves."""
    groups = rigid_groups(world)
    rubbing = {name for pair, law in meeting_laws(world).items() if rubs(law) for name in pair}
    for body in world.bodies:
        weightless = not body.inertial.mass and groups[body.name] != "world"
        if weightless and any(shape.material in rubbing for shape in solid_shapes(body)):
            return unsupported_if(
                f"{body.name!r} has no mass and touches with friction, of which MuJoCo Warp's solver makes no numbers (NaN) "
                "within 0.1 s, in single precision (measured); give it mass, or its shapes to the body that carries it"
            )
    return None


def torsional_alone(world: World, ratio: float) -> Refinement | None:
    """Refused where two shapes that may meet have torsional friction and no rolling friction; ``ratio``: impratio."""
    if ratio <= MOST_TORSIONAL_RATIO:
        return None
    for pair, law in sorted(meeting_laws(world).items()):
        if law.torsional_friction and not law.rolling_friction:
            return unsupported_if(
                f"{' and '.join(map(repr, pair))} have torsional friction and no rolling friction: a ball that lands so is no "
                f"number (NaN), in single precision at impratio {ratio:g} (measured); give them rolling friction, or set "
                f"engines.mjwarp.settings.high_impratio to {MOST_TORSIONAL_RATIO:g}, at which friction on springs creeps faster"
            )
    return None
