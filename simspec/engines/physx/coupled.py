"""How far SAPIEN 3.0.3 is from the law in contact of several bodies, and what of it must be accepted by name.

The table is measured by ``tools/deviations.py`` at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0 to 1 and ratios of
masses of 1 to 1000.
"""

from __future__ import annotations

from pathlib import Path

from simspec.engines.kit.coupled import heavy_on_light, in_force, self_locking
from simspec.engines.kit.deviations import Deviation, Reason, read_deviations
from simspec.support.declarations import Support

_ANCHORS = (
    "friction holds the two anchors of a pair, by a spring to where they lay: what leans or is piled does not slip near its "
    "threshold, and what spins is braked aside of its slip (accepted by name: contact.cone.elliptic)"
)
_FEW = "steps of some ms are few for boxes that lie on crossing edges"
_MADE = "sweeps end before friction has made the normal force of a clamp that jams"
_SWEEPS = "sweeps over one contact after another leave overlaps and wrong friction where heavy bodies lie on light ones"

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("stack*", _SWEEPS),
        Reason("jam*", _MADE),
        Reason("cross*", _FEW),
        Reason("*", _ANCHORS),
    ),
)
MASS_RATIO: Support = heavy_on_light(
    DEVIATIONS,
    in_force("physx"),
    "heavy bodies push light ones aside: at a ratio of 1000 by 4 mm in 0.8 s at 1 ms, and they sink through within 5 s, "
    "at 4 ms within 0.8 s; less with iterations: 255. What slides with 100 times its mass on it stops 43 to 67 % short at 1 ms",
    "1000 times the mass sinks through within 5 s at 1 ms, within 0.8 s at 4 ms",
)
SELF_LOCKING: Support = self_locking(
    DEVIATIONS,
    in_force("physx"),
    "a clamp that jams falls, since sweeps end before friction has made its normal force: under a moment of its weight times "
    "its height at μ ≤ 0.2 (1 ms), under a hundredth of that at all frictions to 1",
    "a clamp that jams falls at μ ≤ 0.2, or where little but friction presses it on",
)
