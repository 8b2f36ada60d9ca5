"""Bodies that are lighter than an engine holds are refused by name, before any file is written."""

from __future__ import annotations

import dataclasses

from simspec.dialects.mujoco.dialect import heavy_enough
from simspec.engines.drake.engine import inertia_supported
from simspec.support.declarations import Level
from simspec.world.types import Inertial
from tests import worlds


def light(moment, mass=1.0, centre=(0.0, 0.0, 0.5), kinds=("hinge",)):
    bodies = worlds.tree(list(kinds), 3)
    last = dataclasses.replace(bodies[-1], inertial=Inertial(mass, centre, (moment,) * 3 + (0.0,) * 3))
    return worlds.world((*bodies[:-1], last))


def test_mujoco_rejects_unsupported_features():
    refused = heavy_enough(light(1e-20))
    assert refused is not None
    assert refused.level is Level.UNSUPPORTED
    assert "'link0'" in refused.how
    assert heavy_enough(light(1e-3, mass=1e-16)) is not None
    assert heavy_enough(light(2e-15)) is None
    assert heavy_enough(light(1e-20, kinds=("hinge", "fixed"))) is None, "its carrier is heavier"
    assert heavy_enough(light(1e-20, kinds=("fixed",))) is None, "it does not move"


def test_drake_rejects_moments_below_the_round_off_of_the_mass_arm():
    assert inertia_supported(light(1e-20)) is not None
    assert inertia_supported(light(1e-20, centre=(0.0, 0.0, 0.0))) is None
    assert inertia_supported(light(1e-7)) is None
    assert inertia_supported(light(1e-20, kinds=("fixed",))) is None
