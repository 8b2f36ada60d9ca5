"""How far SAPIEN 3.0.3 is from the law in contact of several bodies, and what of it must be accepted by name.

The table is measured by ``tools/coupled.py`` at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0 to 1 and ratios of
masses of 1 to 1000.
"""

from __future__ import annotations

from pathlib import Path

from simspec.engines.kit.coupled import Reason, given, heavy_on_light, measured
from simspec.engines.kit.deviations import Deviation
from simspec.support.declarations import Support

_ANCHORS = (
    "friction holds the two anchors of a pair, by a spring to where they lay: what leans or is piled does not slip near its "
    "threshold, and what spins is braked aside of its slip (accepted by name: contact.cone.elliptic)"
)
_FEW = "steps of some ms are few for boxes that lie on crossing edges"
_SWEEPS = "sweeps over one contact after another leave overlaps where heavy bodies lie on light ones"

DEVIATIONS: tuple[Deviation, ...] = measured(
    Path(__file__).with_name("coupled.csv"),
    (
        Reason("stack*", _SWEEPS),
        Reason("cross*", _FEW),
        Reason("*", _ANCHORS),
    ),
)
MASS_RATIO: Support = heavy_on_light(
    DEVIATIONS,
    given("physx"),
    "heavy bodies push light ones aside: at a ratio of 1000 by 4 mm in 0.8 s at 1 ms, and they sink through within 5 s, "
    "at 4 ms within 0.8 s; less with iterations: 255",
    "1000 times the mass sinks through within 5 s at 1 ms, within 0.8 s at 4 ms",
)
