"""The sidecar of a ``model.xml`` for MuJoCo: what MJCF has no place for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from simspec.dialects.kit.settings import wrong_pair_settings, wrong_settings
from simspec.dialects.kit.sidecar import Sidecar
from simspec.dialects.mujoco.choices import SETTINGS


@dataclass(frozen=True, slots=True, kw_only=True)
class MujocoSidecar(Sidecar):
    """Names, and whether friction has all the explicit pairs that it should have."""

    explicit_pairs: bool
    """Whether every two shapes that may touch with friction are listed."""
    models: tuple[str, ...]
    """The model of each body."""
    fixed_joints: Mapping[str, str]
    """The names of rigid joints by body: MJCF has no element for them."""

    def check(self) -> None:
        """Raise ValueError where a setting is missing or of another kind, or names are not those of the bodies."""
        for name in wrong_settings(SETTINGS, self.settings):
            raise ValueError(f"sidecar.settings.{name} should be {SETTINGS[name].told}")
        for index, pair in enumerate(self.pair_settings or ()):
            for name in wrong_pair_settings(SETTINGS, pair.settings):
                raise ValueError(f"sidecar.pair_settings.{index}.settings.{name} is no setting of a pair of materials")
        if len(self.models) != len(self.bodies):
            raise ValueError(f"sidecar.models has {len(self.models)} entries for {len(self.bodies)} bodies")
        fixed = {body.name for body in self.bodies if body.kind == "fixed"}
        if fixed != set(self.fixed_joints):
            wrong = sorted(fixed ^ set(self.fixed_joints))
            raise ValueError(f"sidecar.fixed_joints and the fixed bodies of sidecar.bodies differ in {wrong}")
