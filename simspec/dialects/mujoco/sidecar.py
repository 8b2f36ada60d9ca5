"""The sidecar of a ``model.xml`` for MuJoCo: what MJCF has no place for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from simspec.dialects.kit.settings import wrong_pair_settings, wrong_settings
from simspec.dialects.kit.sidecar import Sidecar
from simspec.dialects.mujoco.choices import SETTINGS
from simspec.world.kinematics import CARRYING, is_carrier, owner_of
from simspec.world.types import Quaternion

UNIT = 1e-9
"""By how much the length of a quaternion may miss 1: far more than round-off, far less than an error."""
LAST = (*CARRYING, "ball")
"""Kinds of the last of several joints."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MujocoSidecar(Sidecar):
    """Names, and whether friction has all the explicit pairs that it should have."""

    explicit_pairs: bool
    """Whether every two shapes that may touch with friction are listed."""
    models: tuple[str, ...]
    """The model of each body."""
    fixed_joints: Mapping[str, str]
    """The names of rigid joints by body: MJCF has no element for them."""
    carriers: Mapping[str, Quaternion] | None = None
    """By name what stands between two joints of one body, and is no body of the file: the orientation of its frame in that
    body's, all joints at zero. The joints' places and axes stand in the file."""

    def check(self) -> None:
        """Raise ValueError where a setting is missing or of another kind, or names are not those of the bodies."""
        for name in wrong_settings(SETTINGS, self.settings):
            raise ValueError(f"sidecar.settings.{name} should be {SETTINGS[name].told}")
        for index, pair in enumerate(self.pair_settings or ()):
            for name in wrong_pair_settings(SETTINGS, pair.settings):
                raise ValueError(f"sidecar.pair_settings.{index}.settings.{name} is no setting of a pair of materials")
        kinds = {body.name: body.kind for body in self.bodies}
        for name, turn in (self.carriers or {}).items():
            if kinds.get(name) not in CARRYING or not is_carrier(name) or kinds.get(owner_of(name)) not in LAST:
                raise ValueError(f"sidecar.carriers.{name} does not stand between joints of one of sidecar.bodies")
            if abs(math.hypot(*turn) - 1.0) > UNIT:
                raise ValueError(f"sidecar.carriers.{name} is no quaternion of unit length")
        if len(self.models) != len(self.bodies):
            raise ValueError(f"sidecar.models has {len(self.models)} entries for {len(self.bodies)} bodies")
        fixed = {body.name for body in self.bodies if body.kind == "fixed"}
        if fixed != set(self.fixed_joints):
            wrong = sorted(fixed ^ set(self.fixed_joints))
            raise ValueError(f"sidecar.fixed_joints and the fixed bodies of sidecar.bodies differ in {wrong}")
