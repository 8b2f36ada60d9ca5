"""The sidecar of a ``world.json``: what every sidecar has; the file itself carries the rest.

A dialect with fields of its own has a subclass of it."""

from __future__ import annotations

from dataclasses import dataclass

from simspec.dialects.kit.sidecar import Sidecar
from simspec.formats.world.format import WORLD
from simspec.formats.world.tree import JsonWorld


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldSidecar(Sidecar):
    """Settings, and where the frames of free roots are."""

    def check(self) -> None:
        """Raise ValueError where the frame of another body than a free root is moved."""
        for body in self.bodies:
            if body.kind != "free" and any(body.frame_offset):
                raise ValueError(f"the sidecar moves the frame of {body.name!r}, which is not a free root")

    def check_document(self, document: JsonWorld) -> None:
        """Raise ValueError where the sidecar is of another world than ``document``."""
        if [(body.name, body.kind) for body in self.bodies] != [
            (body.name, body.joint.kind) for body in document.bodies
        ]:
            raise ValueError(f"the bodies of {WORLD} differ from those that the sidecar names")
        if self.friction_cone != document.friction_cone:
            raise ValueError(f"the friction cone of {WORLD} is not the sidecar's")
