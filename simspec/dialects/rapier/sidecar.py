"""The sidecar of a ``world.json`` for Rapier: beside what every such sidecar has, the table of laws of its contacts."""

from __future__ import annotations

from dataclasses import dataclass

from simspec.dialects.kit.world_laws import LawSidecar


@dataclass(frozen=True, slots=True, kw_only=True)
class RapierSidecar(LawSidecar):
    """Settings, where the frames of free roots are, and laws of materials."""
