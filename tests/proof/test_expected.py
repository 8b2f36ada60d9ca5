"""Required and inapplicable comparisons of a world: a certificate cannot call a required comparison inapplicable."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.proof.certificate import EngineProof
from simspec.proof.checks import NOTHING, Check, Tally, failed
from simspec.proof.expected import NOT_REQUESTED, judge, left_out, shortfalls
from simspec.proof.verify import verify
from simspec.world.actions import JointController
from tests import worlds

pytestmark = pytest.mark.usefixtures("warm_engines")

STATIC = worlds.world(worlds.tree(["fixed", "fixed"], 3))
ARM = worlds.limits_and_armature(dry_friction=0.2)


def test_nothing_compared_is_never_passed():
    assert not Check("L6", "motion", 0, 1e-9, None, "").passed
    assert not failed("L1", "engine", "gone").passed
    assert Check("L6", "motion", 1, 1e-9, 1e-9, "").passed
    assert not Check("L6", "motion", 1, 1e-9, None, "").passed


@pytest.mark.parametrize(
    "figures", [(0, 1e-9, 0.0), (-1, 1e-9, None), (1, float("nan"), 0.0), (1, 1.0, float("inf")), (1, 1e-9, -1.0)]
)
def test_figures_that_are_none_are_refused(figures):
    with pytest.raises(ValueError, match="L6 motion"):
        Check("L6", "motion", *figures, "")


def test_the_worst_of_many_is_kept_also_where_it_has_no_place():
    tally = Tally()
    for deviation in (3.0, 5.0, 1.0):
        tally.add("L2", "x", 1.0, deviation, "")
    assert [check.worst for check in tally.checks()] == [5.0]


def test_inapplicable_levels_are_reported_with_their_reason():
    assert left_out(STATIC) == {
        "L3": "nothing moves in this world",
        "L4 collision matrix": "there are no two bodies with collision shapes",
        "L5": "no two shapes of this world may touch",
        "L6 dry friction, sliding": "no joint has dry friction",
        "L6 dry friction, at rest": "no joint has dry friction",
        "L7": "nothing is driven in this world",
    }
    assert {name[:2] for name in left_out(worlds.gripper())} == {"L6", "L7"}
    driven = dataclasses.replace(ARM, controllers=(JointController("c", ("link1_joint",), "native"),))
    assert "own controllers" in left_out(driven)["L7"]
    assert left_out(worlds.gripper(), ["L1", "L5"]) == {
        "L4 collision matrix": NOT_REQUESTED,
        "L6": NOT_REQUESTED,
        "L7": NOT_REQUESTED,
    }


@pytest.fixture(scope="module")
def proof() -> EngineProof:
    """Of a world with dry friction, limits and no contact."""
    world = dataclasses.replace(
        ARM, engines=tuple(worlds.with_options(ARM, name, accept=ACCEPT).options(name) for name in ("mujoco",))
    )
    return verify(world, ["mujoco"]).engines["mujoco"]


ACCEPT = ("joint.dry_friction", "joint.limits.position")


def test_motion_is_compared_with_dry_friction(proof):
    assert proof.valid
    (motion,) = (check for check in proof.level("L6") if check.name == "motion")
    assert motion.count > 100
    assert set(proof.not_compared) == {"L4 collision matrix", "L5", "L7"}
    assert judge(ARM, proof.checks, proof.not_compared) == []


def test_a_missing_level_is_found(proof):
    for level in ("L0", "L1", "L2", "L3", "L4", "L6"):
        rest = [check for check in proof.checks if check.level != level]
        missing = shortfalls(ARM, rest, proof.not_compared)
        assert {(check.level, check.name) for check in missing} == {(level, NOTHING)}
        assert not any(check.passed for check in missing)
        assert any(line.startswith(level) for line in judge(ARM, rest, proof.not_compared))
        said = {**proof.not_compared, level: "nothing moves in this world"}
        assert any("does not apply to this world" in line for line in judge(ARM, rest, said))


def test_a_certificate_is_judged_by_its_figures(proof):
    for change in ({"worst": 1e9}, {"worst": None, "count": 0}):
        for name in ("motion", "mass matrix", "pose, position"):
            edited = [dataclasses.replace(c, **change) if c.name == name else c for c in proof.checks]
            assert any(name in line for line in judge(ARM, edited, proof.not_compared))
    without = [check for check in proof.checks if check.name != "mass matrix"]
    assert judge(ARM, without, proof.not_compared) == ["L3 nothing was compared: mass matrix: no comparison was made"]
