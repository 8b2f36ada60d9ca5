"""How far DART 6.12 of Gazebo is from the law in contact of several bodies, and what of it must be accepted by name.

The table is measured by ``tools/deviations.py`` at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0 to 1 and ratios of
masses of 1 to 1000.
"""

from __future__ import annotations

from pathlib import Path

from simspec.engines.kit.coupled import even_pressure, heavy_on_light, in_force, self_locking
from simspec.engines.kit.deviations import Deviation, Reason, read_deviations
from simspec.support.declarations import Level, Refinement, Support

_PGS = "contact_solver=pgs"
_PYRAMID = "the circumscribed pyramid in place of the elliptic cone, as accepted"
_SWEEPS = (
    "pgs sweeps over one row after another: overlaps and wrong friction are left where heavy bodies lie on light ones"
)
_CREEPS = "pgs ends its sweeps before friction and normal forces fit each other"
_DEEP = "an overlap is taken back by a share in each step: heavy bodies rest deeper, with the square of the timestep"
_NEAR = (
    "what slides with a lighter body below it, or over it, needs friction within 0.1 % of its limit at a ratio of 1000"
)
_FEW = "steps of some ms are few for what slips, clamps or spins"

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("rod-slips pile-slips slide-spin", _PYRAMID, cone="elliptic"),
        Reason("stack*", _SWEEPS, _PGS),
        Reason("stack-slides* stack-stays*", _NEAR),
        Reason("stack*", _DEEP),
        Reason("rod clamp jam* squeeze* pile", _CREEPS, _PGS),
        Reason("*", _FEW),
    ),
)
MASS_RATIO: Support = heavy_on_light(
    DEVIATIONS,
    in_force("gazebo"),
    "pgs leaves overlaps where heavy bodies lie on light ones: 0.3 mm at a ratio of 10 (1 ms), and 100 times the "
    "mass sinks through within 5 s; dantzig leaves 0.2 mm at a ratio of 1000 and 4 ms, 2.6 mm at 16 ms",
    "with pgs 100 times the mass sinks through within 5 s at 1 ms",
)
EVEN_PRESSURE: Support = even_pressure(
    DEVIATIONS,
    in_force("gazebo"),
    "by pgs a box between two fingers on slides turns by 0.15 rad as it slips by 0.1 m, and creeps by 26 mm at 16 ms where it "
    "is held; contact_solver: dantzig has both right",
    "by pgs boxes that slip between fingers turn by 0.15 rad in 0.3 s",
)
SELF_LOCKING: Support = self_locking(
    DEVIATIONS,
    in_force("gazebo"),
    "by pgs a clamp that jams slips by 9 mm in 0.3 s at 1 ms and μ = 0.05, by 90 mm where a hundredth of the moment of its "
    "weight presses it on; by dantzig by less than 1 mm, from 16 ms on",
    "by pgs a clamp that jams slips by 9 to 90 mm in 0.3 s at 1 ms",
)
SWEEPS = Refinement(
    Level.APPROXIMATE,
    "pgs, as the settings ask for, ends its sweeps before friction and normal forces fit each other: a clamp that should hold "
    "itself creeps by 1.3 mm in 0.3 s (1 ms), by 14 mm at 4 ms; contact_solver: dantzig",
    short="by pgs clamps creep by 1.3 mm in 0.3 s at 1 ms, 14 mm at 4 ms",
)
