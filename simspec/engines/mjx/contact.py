"""How far MJX is from the contact law: as MuJoCo, and in what its own function for the contacts of two boxes does. Data,
measured with MJX 3.17.0 at 0.5 to 16 ms, μ of 0.5 and 0.9, and e of 0.01 to 0.7.
"""

from __future__ import annotations

from simspec.engines.kit.deviations import Deviation
from simspec.engines.mujoco.contact import CONTACT_DEVIATIONS as MUJOCO

_CORNERS = (
    "a pair that bounces has no cushion, and of two faces that overlap by less than 1 µm MJX takes one corner up to three "
    "times, so that a box is tilted and hops"
)
_BOUNCES = 0.01

CONTACT_DEVIATIONS: tuple[Deviation, ...] = (
    *MUJOCO,
    Deviation("stick", 1e-3, _CORNERS, relative=False, restitution=_BOUNCES),
    Deviation("push", 0.14, _CORNERS, restitution=_BOUNCES, timestep=0.0009),
    Deviation("push-oblong", 0.14, _CORNERS, restitution=_BOUNCES, timestep=0.0009),
)
