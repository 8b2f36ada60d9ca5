"""MuJoCo's integrators: the text of the setting in files, its declaration, and its proof in the limit."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import compile_world
from simspec.errors import UnsupportedError
from simspec.proof.judge import judge_proof
from simspec.proof.verify import verify
from simspec.testing import worlds
from tests.constrained import follower

pytestmark = pytest.mark.usefixtures("warm_engines")

DAMPED = worlds.damped_springs()
FREE = worlds.hinges()


def by(world, name, **more):
    return worlds.with_options(world, "mujoco", settings=(("integrator", name), *more.items()))


def model(world):
    return compile_world(world, ["mujoco"])["mujoco"].files["model.xml"]


@pytest.mark.parametrize(
    ("name", "written", "damping"),
    [
        ("common", "Euler", "disable"),
        ("euler", "Euler", "enable"),
        ("implicit", "implicit", "disable"),
        ("implicitfast", "implicitfast", "disable"),
        ("RK4", "RK4", "disable"),
    ],
)
def test_the_file_has_the_integrator_and_its_flag(name, written, damping):
    text = model(by(DAMPED, name))
    assert f'integrator="{written}"' in text
    assert f'eulerdamp="{damping}"' in text


def test_the_common_method_leaves_the_files_as_they_are():
    plain, chosen = (compile_world(world, ["mujoco"])["mujoco"].files for world in (DAMPED, by(DAMPED, "common")))
    assert plain["model.xml"] == chosen["model.xml"]
    assert "integrator" not in plain["sidecar.json"]


def test_the_usual_method_of_each_engine_is_mujocos_euler():
    usual = dataclasses.replace(DAMPED, physics=dataclasses.replace(DAMPED.physics, integrator="engine"))
    assert 'eulerdamp="enable"' in model(usual)


@pytest.mark.parametrize(
    ("world", "name"), [(DAMPED, "euler"), (DAMPED, "RK4"), (FREE, "implicit"), (FREE, "implicitfast")]
)
def test_it_is_valid_in_the_limit(world, name):
    chosen = by(world, name)
    proof = verify(chosen, ["mujoco"]).engines["mujoco"]
    assert proof.valid, [check for check in proof.checks if not check.passed]
    assert "same model by another method" in proof.verdict
    assert proof.convergence is not None
    assert proof.convergence.order == (4 if name == "RK4" else 1)
    assert {check.name for check in proof.level("L6")} == {"motion", "order"}
    assert judge_proof("mujoco", proof, chosen, thorough=True) == []


def test_a_forged_proof_without_its_order_is_not_valid():
    chosen = by(FREE, "implicitfast")
    proof = verify(chosen, ["mujoco"]).engines["mujoco"]
    forged = dataclasses.replace(proof, checks=tuple(check for check in proof.checks if check.name != "order"))
    assert any("order" in line for line in judge_proof("mujoco", forged, chosen, thorough=True))


def test_a_method_that_changes_nothing_is_compared_step_by_step():
    """Without damping and free bodies implicitfast is semi-implicit Euler."""
    hinges = worlds.world(worlds.tree(["fixed", "hinge", "hinge"], 4), "pendulum")
    proof = verify(by(hinges, "implicitfast"), ["mujoco"]).engines["mujoco"]
    assert proof.verdict == "valid"
    assert "physics.integrator" not in proof.approximations


@pytest.mark.parametrize("more", [{"friction": "coulomb"}, {}])
def test_rk4_is_refused_where_a_step_is_solved_several_times(more):
    world = by(follower(), "RK4") if not more else by(DAMPED, "RK4", **more)
    with pytest.raises(UnsupportedError, match="RK4"):
        compile_world(worlds.accepting(world, "mujoco"), ["mujoco"])
