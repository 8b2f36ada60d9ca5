"""A body of a stage in the making."""

from __future__ import annotations

from dataclasses import dataclass, field

from simspec.imports.usd.graph import Link
from simspec.imports.usd.shapes import Shape
from simspec.imports.usd.stage import Prim
from simspec.world.types import Pose, Vector3


@dataclass
class Body:
    """A body: its prim, its shapes in its rigid frame, and where its frame in the spec is in that."""

    prim: Prim
    link: Link
    shapes: list[Shape]
    name: str = ""
    model: str = ""
    frame: Pose = field(default_factory=Pose)
    fixed: bool = False

    @property
    def offset(self) -> Vector3:
        """The origin of the spec's frame in the prim's."""
        return self.frame.position

    @property
    def full(self) -> str:
        """The name with that of its model."""
        return f"{self.model}/{self.name}" if self.model else self.name
