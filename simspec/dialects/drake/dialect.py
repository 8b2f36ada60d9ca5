"""Drake's dialect: ``world.json``, which carries everything that Drake supports."""

from __future__ import annotations

from typing import ClassVar

from simspec.dialects.kit.world import WorldDialect
from simspec.support import classes
from simspec.support.declarations import Table
from simspec.support.features import Feature


class DrakeDialect(WorldDialect):
    """The world and its contact plan as JSON."""

    NAME: ClassVar[str] = "drake"
    SUPPORT: ClassVar[Table] = {**WorldDialect.SUPPORT, Feature.JOINT_SEVERAL: classes.BETWEEN_JOINTS}
