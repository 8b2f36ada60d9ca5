"""Damping that is implicit in time: its law, its proof in engines, what is refused, and files of other languages."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import simspec
from simspec.attribution.differences import differences, taking
from simspec.compiler import compile_world
from simspec.dynamics.oracle import Oracle
from simspec.dynamics.stability import unstable
from simspec.errors import SpecError, UnsupportedError
from simspec.formats.kit.contract import formats
from simspec.proof.verify import verify
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.testing import worlds
from simspec.world.damping import retimed, with_implicit_damping, without_implicit_damping
from simspec.world.kinematics import initial_state

pytestmark = pytest.mark.usefixtures("warm_engines")

WORLD = worlds.implicitly_damped(armature=0.02)
STEP = WORLD.physics.timestep
LEVELS = ("L0", "L1", "L3", "L6")
SPEC = {
    "simspec": 1,
    "name": "damper",
    "physics": {"timestep": 0.001, "duration": 0.01, "gravity": [0, 0, 0], "damping": "implicit"},
    "bodies": {
        "post": {"fixed": True},
        "arm": {
            "parent": "post",
            "mass": 1,
            "inertia": {"principal": [0.001, 0.001, 0.001]},
            "joint": {"type": "hinge", "axis": [0, 1, 0], "damping": 10, "velocity": 2},
        },
    },
}


def resolved(**physics):
    return simspec.Spec.from_data({**SPEC, "physics": {**SPEC["physics"], **physics}}).resolve()


def test_a_joint_slows_down_as_by_the_closed_form():
    """v′ = v / (1 + dt d / I): 2 rad/s are 2/11 after a step, and 2/121 after two."""
    world = resolved()
    q, v = initial_state(world)
    _, speeds = Oracle(world).motion(q, v, None, 2, 1)
    np.testing.assert_allclose(speeds[:, 0], [2.0, 2.0 / 11.0, 2.0 / 121.0], rtol=1e-14)
    assert [need.paths for need in needs(world) if need.feature is Feature.DAMPING_IMPLICIT] == [
        ("bodies.arm.joint.damping",)
    ]
    assert Feature.ARMATURE not in {need.feature for need in needs(world)}


def test_a_step_is_that_of_the_documented_law():
    """(M + dt D) v′ = M v + dt (τ − h), with M and h of the same world without damping."""
    undamped = dataclasses.replace(
        without_implicit_damping(WORLD),
        bodies=tuple(worlds.with_joint(body, damping=0.0) for body in without_implicit_damping(WORLD).bodies),
    )
    oracle, plain = Oracle(WORLD), Oracle(undamped)
    (q, _), v, effort = initial_state(WORLD), np.array([1.0, -2.0, 3.0]), np.array([3.0, 1.0, -2.0])
    mass, bias = plain.mass_matrix(q), plain.bias_force(q, v)
    expected = np.linalg.solve(mass + STEP * 400.0 * np.eye(3), mass @ v + STEP * (effort - bias))
    found = oracle.motion(q, v, effort, 1, 1)[1][-1]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert np.linalg.norm(found - (v + STEP * np.linalg.solve(mass, effort - bias - 400.0 * v))) > 1.0


def test_it_is_stable_where_explicit_damping_is_not():
    explicit = dataclasses.replace(
        without_implicit_damping(WORLD), physics=dataclasses.replace(WORLD.physics, damping="explicit")
    )
    assert unstable(explicit)
    assert not unstable(WORLD)
    with pytest.raises(SpecError, match=r"(?s)S505|unstable") as refused:
        resolved(damping="explicit")
    assert "physics: {damping: implicit}" in (refused.value.problems[0].hint or "")


def test_it_is_proven_in_engines_and_planted_explicit_damping_is_caught():
    """The first has it as armature, the second by its own implicit damping."""
    world = worlds.implicitly_damped()
    proofs = verify(world, ["mujoco", "dart"], levels=LEVELS).engines
    for proof in proofs.values():
        assert proof.valid, [check for check in proof.checks if not check.passed]
        assert proof.level("L6")
    # the engine is given the armature of the spec: its damping is explicit
    planted = dataclasses.replace(world, bodies=tuple(worlds.with_joint(body, armature=0.0) for body in world.bodies))
    proof = verify(world, ["mujoco"], levels=LEVELS, compiled=compile_world(planted, ["mujoco"])).engines["mujoco"]
    assert {check.level for check in proof.checks if not check.passed} >= {"L3", "L6"}


@pytest.mark.parametrize(
    ("engine", "kinds"), [("dart", ["fixed", "hinge", "ball"]), ("ode", ["fixed", "ball", "hinge"])]
)
def test_balls_have_it_too(engine, kinds):
    """By the engine's implicit damping, and as inertia of a body on a ball whose parent is at rest."""
    world = with_implicit_damping(worlds.world(worlds.tree(kinds, 3, damping=2.0), "ball", physics=WORLD.physics))
    proof = verify(world, [engine], levels=LEVELS).engines[engine]
    assert proof.valid, [check for check in proof.checks if not check.passed]


def test_it_is_the_implicit_damping_of_the_exported_file(tmp_path):
    """The plain file has the armature of the spec, and the reader's own implicit damping: another computation of one motion."""
    mujoco = pytest.importorskip("mujoco")
    text = formats()["mjcf"].plain(WORLD).files["model.xml"]
    model = mujoco.MjModel.from_xml_string(text)
    assert list(model.dof_armature) == [0.02] * 3
    data = mujoco.MjData(model)
    q, _ = initial_state(WORLD)
    v = np.array([1.0, -2.0, 3.0])
    data.qpos[:], data.qvel[:] = q, v
    mujoco.mj_step(model, data, 100)
    positions, speeds = Oracle(WORLD).motion(q, v, None, 100, 100)
    np.testing.assert_allclose(data.qpos, positions[-1], atol=1e-12)
    np.testing.assert_allclose(data.qvel, speeds[-1], atol=1e-12)


def test_other_files_have_the_armature_of_the_spec():
    text = formats()["usd"].plain(WORLD).files["world.usda"]
    assert text.count("= 0.02") == 3
    assert "0.42" not in text
    lost = {loss.feature for loss in formats()["urdf"].plain(WORLD).losses}
    assert Feature.DAMPING_IMPLICIT.value in lost


def test_refusals_say_why():
    ball = worlds.world(worlds.tree(["fixed", "slide", "ball"], 3, damping=0.1), physics=WORLD.physics)
    ball = with_implicit_damping(ball)
    with pytest.raises(UnsupportedError, match="no armature of ball joints"):
        compile_world(ball, ["drake"])
    compile_world(ball, ["mujoco", "dart"])
    other = worlds.with_options(WORLD, "mujoco", settings=(("integrator", "implicitfast"),))
    with pytest.raises(UnsupportedError, match="implicitfast has damping of its own"):
        compile_world(other, ["mujoco"])
    limited = dataclasses.replace(
        WORLD, bodies=tuple(worlds.with_joint(body, position_limits=(-1.0, 1.0)) for body in WORLD.bodies[1:2])
    )
    limited = dataclasses.replace(WORLD, bodies=(WORLD.bodies[0], *limited.bodies, *WORLD.bodies[2:]))
    limited = worlds.with_options(limited, "dart", outside=("joint.armature",))
    with pytest.raises(UnsupportedError, match=r"joint\.damping\.implicit"):
        compile_world(limited, ["dart"])
    with pytest.raises(SpecError, match="usual methods of the engines have damping of their own"):
        resolved(integrator="engine")


def test_armature_follows_the_timestep():
    finer = retimed(WORLD, 0.5 * STEP, 200)
    assert [body.joint.armature for body in finer.bodies[1:]] == pytest.approx([0.22] * 3)
    assert [body.joint.armature for body in without_implicit_damping(WORLD).bodies[1:]] == [0.02] * 3
    assert retimed(finer, STEP, WORLD.physics.steps) == WORLD


def test_a_difference_is_the_damping_and_not_the_armature():
    explicit = resolved(damping="explicit", timestep=0.0001)
    implicit = resolved(timestep=0.0001)
    (found,) = differences(explicit, implicit)
    assert found.group == "damping of joints, explicit or implicit"
    assert taking(explicit, implicit, [found]).bodies == implicit.bodies
    assert taking(implicit, explicit, differences(implicit, explicit)).bodies == explicit.bodies
