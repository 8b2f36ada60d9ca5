"""How far MuJoCo Warp is from the contact law: as MuJoCo, in what singles leave of friction on springs, and where what slides
hops otherwise in singles. Data, measured as in ``simulation.py``, at 1 ms where no timestep is said.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simspec.engines.kit.deviations import Deviation
from simspec.engines.mujoco.contact import CONTACT_DEVIATIONS as MUJOCO

_SOFT = (
    "friction is as soft as its contact, and at most 1e5 times as hard (high_impratio): on springs a box creeps 4.9e-4 m/s at "
    "60 % of the limit"
)
_HOPS = (
    "friction's cone is associated, as MuJoCo's: what slides is lifted, and hops; in singles at other moments, so that more of "
    "a short slide, or of a push that is measured, can be without friction"
)


def _rows(probe: str, table: Mapping[float, Mapping[float, float]], **more: Any) -> tuple[Deviation, ...]:
    """``table``: by timestep (s), by least friction, the largest share of the expected value. From 0.9 of the timestep on."""
    return tuple(
        Deviation(probe, size, _HOPS, friction=friction, timestep=0.9 * timestep, **more)
        for timestep, sizes in table.items()
        for friction, size in sizes.items()
    )


_SINGLES: tuple[Deviation, ...] = (
    *_rows("push", {0.002: {1.2: 0.14}, 0.004: {0.25: 0.04}, 0.008: {0.15: 0.055, 1.2: 0.33}}),
    *_rows("push", {0.002: {0.4: 0.15}, 0.008: {0.9: 0.35}}, restitution=0.01),
    *_rows("push-oblong", {0.002: {1.4: 0.17}, 0.004: {0.25: 0.035, 0.9: 0.2, 1.2: 0.29}, 0.008: {1.2: 0.33}}),
    *_rows("push-oblong", {0.002: {0.0: 0.018}, 0.008: {0.9: 0.35}}, restitution=0.01),
    *_rows("stop", {0.002: {0.6: 0.035, 0.9: 0.045}, 0.008: {0.4: 0.025, 0.6: 0.045}, 0.016: {0.25: 0.03}}),
    *_rows("stop", {0.008: {0.4: 0.07, 0.9: 0.17}, 0.016: {0.9: 0.48}}, restitution=0.01),
    *_rows("stop-oblong", {0.002: {0.4: 0.035, 0.6: 0.055, 0.9: 0.1}, 0.016: {0.25: 0.03, 0.4: 0.1, 0.6: 0.145}}),
    *_rows("stop-oblong", {0.004: {0.4: 0.06}, 0.008: {0.4: 0.07}}, restitution=0.01),
)
"""Where it exceeds what MuJoCo's rows say, at 2, 4, 8 and 16 ms: the largest of what specs/contact/friction-laws.yaml shows
there, with its own μ of 0.05 to 1 and with 0.3, 0.7, 1.25 and 1.5, and restitution-laws.yaml, with μ of 0.05 to 1."""

CONTACT_DEVIATIONS: tuple[Deviation, ...] = (
    *MUJOCO,
    *_SINGLES,
    Deviation("stick", 5.5e-4, _SOFT, relative=False, hardness="stiffness"),
    Deviation("stick", 5.5e-4, _SOFT, relative=False, hardness="time-constant"),
)
