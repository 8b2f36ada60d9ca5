"""Random scenarios of the whole language compile, are proven and run; tools/random_worlds.py does so for two hundred."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from pathlib import Path

import pytest

import simspec
from simspec.proof.verify import LEVELS
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from tests.installed import JOINTED
from tests.random_specs import spec
from tests.random_words import with_words

pytestmark = pytest.mark.usefixtures("warm_engines")

ROOT = Path(__file__).resolve().parent.parent
ENGINES = sorted(JOINTED)
RARE = {
    Feature.DAMPING_IMPLICIT,
    Feature.IMPACT_FRICTION,
    Feature.MASS_RATIO,
    Feature.CARRIED_FRICTION,
    Feature.SELF_LOCKING,
    Feature.EVEN_PRESSURE,
    Feature.TREE_SIZE,
    Feature.TREE_DEPTH,
    Feature.CONTROL_NATIVE,
    Feature.FRICTION_PAIRS,
    Feature.RESTITUTION_PAIRS,
    Feature.RESTITUTION_THRESHOLD,
    Feature.HARDNESS_PAIRS,
    Feature.HARDNESS_STIFFNESS,
    Feature.CONSTRAINT_LOOP,
    Feature.CONSTRAINT_COUPLING,
    Feature.SUM,
    Feature.SUM_LIMITS,
    Feature.SUM_DRY_FRICTION,
    Feature.SHAPE_MESH,
    Feature.SHAPE_HEIGHTFIELD,
    Feature.FORCES,
    Feature.KINEMATIC,
    Feature.SHAPE_MARGIN,
    Feature.MARGIN_PAIRS,
    Feature.SURFACE_VELOCITY,
    Feature.BALL_ARMATURE,
    Feature.BALL_LIMIT,
    Feature.FRAME,
    Feature.FREE_ARMATURE,
    Feature.FREE_DAMPING,
    Feature.GRAVITY_SCALE,
    Feature.FLUID,
    Feature.TOUCHING_PAIRS,
}
"""Features that are settings of an engine (pairs), refused in most worlds or by most engines (margins, armature of balls),
not drawn (constraints, ...), or in need of a file (meshes)."""


@pytest.fixture(scope="module")
def tool():
    place = importlib.util.spec_from_file_location("random_worlds", ROOT / "tools" / "random_worlds.py")
    assert place is not None
    module = importlib.util.module_from_spec(place)
    sys.modules["random_worlds"] = module
    assert place.loader is not None
    place.loader.exec_module(module)
    return module


def test_two_hundred_of_them_use_the_whole_language():
    used = set()
    for seed in range(200):
        world = simspec.Spec.from_data(spec(seed)).resolve()
        used |= {need.feature for need in needs(world)}
    assert set(Feature) - used <= RARE


def test_two_hundred_of_them_use_the_words_that_are_put_in():
    drawn = [with_words(seed, spec(seed)) for seed in range(200)]
    text = "".join(f"{data} {files}" for data, files in drawn)
    words = (
        "mesh",
        "margin",
        "follow",
        "connect",
        "weld",
        "kinematic",
        "motion",
        "forces",
        "touch",
        "every",
        "states",
        "fluid",
        "heightfield",
        "mirror",
        "parameters",
    )
    assert [word for word in (*words, "self_collision", "max_vertices", "mass_from") if word not in text] == []
    assert any("armature" in joint for data, _ in drawn for joint in balls(data))


def balls(data):
    bodies = [*data.get("bodies", {}).values()]
    for model in data.get("models", {}).values():
        bodies += model.get("bodies", {}).values()
    joints = [joint for body in bodies for joint in (body.get("joint", {}), *body.get("joints", ()))]
    return [joint for joint in joints if joint.get("type") == "ball"]


def test_a_seed_gives_the_same_world():
    assert spec(3) == spec(3)
    assert spec(3) != spec(4)


@pytest.mark.parametrize("seed", [17, 25, 38])
def test_they_are_proven_and_run_in_every_engine(seed, tool):
    wrong, refused = tool.attempt(seed, ENGINES, set(LEVELS) - {"L5"}, None)
    assert wrong == []
    assert all(refused.values()), "a refusal has its cause"


def test_failures_are_reported_with_their_place(tool, monkeypatch):
    verify = tool.verify

    def broken(world, engines, **more):
        found = verify(world, engines, **more)
        proof = found.engines["mujoco"]
        checks = tuple(
            dataclasses.replace(check, worst=1.0) if check.level == "L1" else check for check in proof.checks
        )
        return dataclasses.replace(found, engines={"mujoco": dataclasses.replace(proof, checks=checks)})

    monkeypatch.setattr(tool, "verify", broken)
    wrong, _ = tool.attempt(17, ["mujoco"], {"L4"}, None)
    assert wrong
    assert all(line.startswith("mujoco L1 ") for line in wrong)
