"""Gazebo's dialect: ``world.json``, from which the engine generates SDF when it loads the world."""

from __future__ import annotations

from typing import ClassVar

from simspec.dialects.kit.world import WorldDialect
from simspec.support import classes
from simspec.support.declarations import Table
from simspec.support.features import Feature


class GazeboDialect(WorldDialect):
    """The world and its contact plan as JSON."""

    NAME: ClassVar[str] = "gazebo"
    SUPPORT: ClassVar[Table] = {**WorldDialect.SUPPORT, Feature.JOINT_SEVERAL: classes.BETWEEN_JOINTS}
