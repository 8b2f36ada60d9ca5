"""Dry friction along sums of joint positions: read, imported, MuJoCo's against a closed form, refused by name elsewhere."""

from __future__ import annotations

import pytest

import simspec
from simspec.compiler import compile_world
from simspec.errors import SpecError, UnsupportedError
from simspec.language.load import load
from simspec.testing import worlds

pytestmark = pytest.mark.usefixtures("warm_engines")

WHEEL = {"mass": 1, "inertia": {"principal": [0.1, 0.1, 0.1]}}


def world_of(push: float, **along):
    """Two wheels about z, and a push on the first; their inertias are 0.1 kg m²."""
    joints = {"left": {"pose": {"xyz": [0, 0, 0]}}, "right": {"pose": {"xyz": [2, 0, 0]}}}
    bodies = {
        name: {**WHEEL, **place, "joint": {"name": f"{name}_axle", "type": "hinge", "axis": [0, 0, 1]}}
        for name, place in joints.items()
    }
    data = {
        "simspec": 1,
        "name": "wheels",
        "physics": {"timestep": 0.001, "duration": 0.5, "gravity": [0, 0, 0]},
        "bodies": bodies,
        "constraints": {"band": {"sum": {"joints": {"left_axle": 1, "right_axle": -2}, **along}}},
        "forces": [{"body": "left", "torque": [0, 0, push]}],
    }
    return simspec.Spec.from_data(data).resolve()


def speeds(push: float):
    run = simspec.run(worlds.accepting(world_of(push, dry_friction="0.4 N m"), "mujoco"), "mujoco")
    return run.arrays["v"][-1]


def test_a_push_beyond_the_friction_slides():
    """M a = τ − w f sign(L̇) = (3 − 0.4, 0 + 0.8)."""
    assert speeds(3.0) == pytest.approx([0.5 * 2.6 / 0.1, 0.5 * 0.8 / 0.1], rel=1e-6)


def test_below_the_friction_the_sum_stays():
    """The push is 0.3, the force that keeps L̇ at 0 by (M⁻¹w·τ)/(w·M⁻¹w) = 0.06, and both wheels turn with L = 0."""
    left, right = speeds(0.3)
    assert left - 2 * right == pytest.approx(0.0, abs=1e-5)
    assert left == pytest.approx(0.5 * 0.24 / 0.1, rel=1e-4)


def test_a_sum_with_friction_alone_is_valid():
    (joint_sum,) = world_of(0.1, dry_friction=0.2).sums
    assert (joint_sum.dry_friction, joint_sum.stiffness, joint_sum.damping) == (0.2, 0.0, 0.0)
    with pytest.raises(SpecError, match="nothing acts along this sum"):
        world_of(0.1, dry_friction=0)
    with pytest.raises(SpecError, match="in units of an angle and of a length"):
        world_of(0.1, dry_friction="2 N", stiffness="3 N m/rad")


@pytest.mark.parametrize("engine", ["pybullet", "dart", "drake"])
def test_other_engines_refuse_it(engine):
    with pytest.raises(UnsupportedError, match=r"constraint\.sum\.dry_friction"):
        compile_world(world_of(0.1, dry_friction=0.2), [engine])


def test_friction_of_tendons_is_imported(tmp_path):
    (tmp_path / "pair.xml").write_text(
        '<mujoco><worldbody><body name="a"><joint name="aj" axis="0 0 1"/><geom size="0.1"/>'
        '<body name="b" pos="1 0 0"><joint name="bj" axis="0 0 1"/><geom size="0.1"/></body></body></worldbody>'
        '<tendon><fixed name="band" frictionloss="0.3"><joint joint="aj" coef="1"/><joint joint="bj" coef="-2"/></fixed>'
        "</tendon></mujoco>"
    )
    (tmp_path / "scene.yaml").write_text("simspec: 1\nname: s\nmodels:\n  pair: {use: pair.xml}\n", encoding="utf-8")
    (joint_sum,) = load(tmp_path / "scene.yaml").resolve().sums
    assert (joint_sum.joints, joint_sum.dry_friction) == ((("pair/aj", 1.0), ("pair/bj", -2.0)), 0.3)
