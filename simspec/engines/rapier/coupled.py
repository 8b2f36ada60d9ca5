"""How far Rapier 0.36.1 is from the law in contact of several bodies, and what of it must be accepted by name.

The table is measured by ``tools/deviations.py`` at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0 to 1 and ratios of
masses of 1 to 1000.
"""

from __future__ import annotations

from pathlib import Path

from simspec.engines.kit.coupled import heavy_on_light, in_force, self_locking
from simspec.engines.kit.deviations import Deviation, Reason, read_deviations
from simspec.support.declarations import Support

_ASIDE = (
    "friction is along K⁻¹ v, K the mobility of the contact: the feet of one body are braked aside of their slip (accepted by "
    "name: contact.cone.elliptic)"
)
_SWEEPS = "sweeps over one contact after another leave overlaps and wrong friction where heavy bodies lie on light ones"
_MADE = "sweeps end before friction has made the normal force of a clamp that jams"
_FEW = "steps of some ms are few for what slips or clamps"

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("stack*", _SWEEPS),
        Reason("jam*", _MADE),
        Reason("slide-spin", _ASIDE),
        Reason("*", _FEW),
    ),
)
MASS_RATIO: Support = heavy_on_light(
    DEVIATIONS,
    in_force("rapier"),
    "heavy bodies sink into light ones, and push them aside: laid on each other at rest by 0.2 and 0.8 mm at a ratio of 1000 "
    "and 1 ms, with iterations of 500 by a tenth of it; what falls moves farther (5 kg fallen 5 cm onto 0.1 kg: 4.3 mm). "
    "What stands under a body 1000 times as heavy that slides is taken along (1 ms); what slides with 100 times its mass on it "
    "stops 16 % short at 4 ms",
    "1000 times the mass, laid on at rest, sinks 0.2 mm in and moves 0.8 mm aside at 1 ms",
)
SELF_LOCKING: Support = self_locking(
    DEVIATIONS,
    in_force("rapier"),
    "a clamp that jams falls, since sweeps end before friction has made its normal force: under a moment of its weight times "
    "its height at μ = 0.05 (1 ms), under a hundredth of that at μ ≤ 0.3",
    "a clamp that jams falls at small friction, or where little but friction presses it on",
)
