"""The engines that a test is for, by what they declare."""

from __future__ import annotations

from simspec.dialects.kit.contract import dialects
from simspec.engines.kit.registry import engines
from simspec.support.declarations import Level, combine
from simspec.support.features import Feature


def engines_with(*features: Feature) -> list[str]:
    """Every installed engine that supports all the features in some world, by name."""
    return sorted(
        name
        for name, engine in engines().items()
        if engine.version() is not None
        and all(
            combine(dialects()[engine.DIALECT].SUPPORT, engine.SUPPORT)[feature].level is not Level.UNSUPPORTED
            for feature in features
        )
    )


TOUCHING = sorted(
    name for name, engine in engines().items() if engine.SUPPORT[Feature.FRICTION].level is not Level.UNSUPPORTED
)
"""Every engine that receives shapes which touch, installed or not: for tests of files."""

PYRAMID_ALONE = ("gazebo", "webots")
"""Engines that have no elliptic cone, but a pyramid that stands for it where that is accepted by name."""

SQUARE = ("physx",)
"""Engines whose elliptic cone is not one of what spins as it slides, balls among it."""


def with_the_cone(*features: Feature) -> list[str]:
    """The engines of :func:`engines_with` that have the elliptic cone: for tests of results under it. The other engines'
    cones are tested in ``tests/engines/NAME``."""
    return [name for name in engines_with(*features) if name not in PYRAMID_ALONE]
