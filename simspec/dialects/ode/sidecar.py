"""The sidecar of a ``world.json`` for ODE: beside what every such sidecar has, the table of laws that ODE's contacts go by."""

from __future__ import annotations

from dataclasses import dataclass

from simspec.dialects.kit.world_laws import LawSidecar


@dataclass(frozen=True, slots=True, kw_only=True)
class OdeSidecar(LawSidecar):
    """Settings, where the frames of free roots are, and laws of materials."""
