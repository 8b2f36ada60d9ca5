"""Surfaces of foreign files as materials of the language."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

CONTACT_OF_LINK: Final[Mapping[str, str]] = {
    "lateral_friction": "friction",
    "spinning_friction": "torsional",
    "rolling_friction": "rolling",
    "restitution": "restitution",
}
"""Words of a ``contact`` of a link, which one reader of robot files has."""


@dataclass(frozen=True, slots=True)
class Surface:
    """What a file says of a surface, as a material of the language."""

    friction: float = 1.0
    restitution: float = 0.0
    threshold: float = 0.0
    torsional: float = 0.0
    rolling: float = 0.0

    def data(self) -> dict[str, Any]:
        """The material."""
        data: dict[str, Any] = {"friction": self.friction}
        for key, value in (
            ("restitution", self.restitution),
            ("restitution_threshold", self.threshold),
            ("torsional_friction", self.torsional),
            ("rolling_friction", self.rolling),
        ):
            if value:
                data[key] = value
        return data


@dataclass
class Materials:
    """Names of surfaces; equal ones are one material."""

    names: dict[Surface, str] = field(default_factory=dict)

    def name(self, surface: Surface) -> str:
        """The material of a surface."""
        if surface not in self.names:
            self.names[surface] = f"surface-{len(self.names) + 1}"
        return self.names[surface]

    def data(self) -> dict[str, Any]:
        """Materials by name; a single one is called ``surface``."""
        if len(self.names) == 1:
            return {"surface": next(iter(self.names)).data()}
        return {name: surface.data() for surface, name in self.names.items()}
