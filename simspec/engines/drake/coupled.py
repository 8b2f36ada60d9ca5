"""How far Drake 1.51.1 is from the law in contact of several bodies, and what of it must be accepted by name.

The table is measured by ``tools/deviations.py`` at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0 to 1 and ratios of
masses of 1 to 1000.
"""

from __future__ import annotations

from pathlib import Path

from simspec.engines.kit.coupled import even_pressure, heavy_on_light, in_force, self_locking
from simspec.engines.kit.deviations import Deviation, Reason, read_deviations
from simspec.support.declarations import Support

_SAP = "contact_approximation=sap"
_LIFTS = "SAP's contact is convex: what slips is lifted by up to the friction times its slip"
_SOFT = (
    "SAP bounds the stiffness of a contact by the lighter mass and the timestep: heavy bodies sink in, with its square"
)
_CORNERS = (
    "boxes have points of contact in their corners and one besides: where edges cross, the upper box sinks (accepted by name: "
    "shape.box)"
)
_FIFTH = (
    "beside its corners a box has one point of contact with another box, off the centre of the face, which bears most"
)
_CREEPS = "friction is proportional to slip below the stiction tolerance, and has its full size above it alone"
_UNKNOWN = "measured; the cause is not known"

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("cross*", _CORNERS),
        Reason("squeeze*", _FIFTH, "contact_approximation=tamsi"),
        Reason("stack-slides*", _LIFTS, _SAP),
        Reason("stack*", _SOFT, _SAP),
        Reason("stack-slides* stack-stays*", _CREEPS),
        Reason("*", _LIFTS, _SAP),
        Reason("*", _UNKNOWN),
    ),
)
MASS_RATIO: Support = heavy_on_light(
    DEVIATIONS,
    in_force("drake"),
    "by SAP heavy bodies sink into light ones in steps of 4 ms and more: by 9 mm at a ratio of 1000; by TAMSI they "
    "do not. By SAP what slides with another body on it stops up to 40 % short at 1 ms, by TAMSI 5 % at a ratio of 1000",
    "by SAP 1000 times the mass sinks 9 mm in at 4 ms",
)
EVEN_PRESSURE: Support = even_pressure(
    DEVIATIONS,
    in_force("drake"),
    "beside its corners a box has one point of contact with another, off the centre of the face: by TAMSI a box between two "
    "fingers on slides turns by 0.9 rad as it slips by 0.1 m; by SAP, whose contact is convex, it slips 6 % too little at "
    "1 ms and hardly at all from 4 ms on",
    "by TAMSI boxes that slip between fingers turn by 0.9 rad, by SAP they slip too little",
)
SELF_LOCKING: Support = self_locking(
    DEVIATIONS,
    in_force("drake"),
    "by TAMSI a clamp that jams falls as without friction at some frictions (0.2 to 0.4 measured), where a hundredth of the "
    "moment of its weight presses it on; under the whole it stands; contact_approximation: sap",
    "by TAMSI a clamp that jams may fall where little but friction presses it on",
)
