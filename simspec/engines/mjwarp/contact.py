"""How far MuJoCo Warp is from the contact law: as MuJoCo, and in what singles leave of friction on springs. Data,
measured as in ``simulation.py`` at 1 ms.
"""

from __future__ import annotations

from simspec.engines.kit.deviations import Deviation
from simspec.engines.mujoco.contact import CONTACT_DEVIATIONS as MUJOCO

_SOFT = (
    "friction is as soft as its contact, and at most 1e5 times as hard (high_impratio): on springs a box creeps 4.9e-4 m/s at "
    "60 % of the limit"
)

CONTACT_DEVIATIONS: tuple[Deviation, ...] = (
    *MUJOCO,
    Deviation("stick", 5.5e-4, _SOFT, relative=False, hardness="stiffness"),
    Deviation("stick", 5.5e-4, _SOFT, relative=False, hardness="time-constant"),
)
