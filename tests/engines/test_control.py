"""Control in every engine: quick access is the slow one to the last bit, and the laws do what the oracle does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.control.law import Control
from simspec.control.reference import reference
from simspec.engines.kit.contract import Actuation
from simspec.proof.verify import verify
from simspec.runner.execution import run
from simspec.world.control import Controller, Trajectory
from simspec.world.kinematics import initial_state
from simspec.world.types import Body, Inertial, Joint, Record
from tests import worlds
from tests.control.driving import OracleJoints, chain, driven, told, wheel
from tests.engines.conftest import ENGINES

AT_ONCE = 250


def with_load(damping: float = 0.0):
    """A driven chain beside a falling free body, and another chain that nobody drives."""
    first = chain(damping=damping)
    more = worlds.tree(["free", "hinge"], 11, prefix="free-") + worlds.tree(["slide", "ball"], 12, prefix="idle-")
    world = worlds.world(more + first.bodies, physics=first.physics)
    joints = tuple(body.joint.name for body in first.bodies)
    q = np.array([body.joint.position[0] for body in first.bodies])
    world = driven(world, joints=joints)
    rows = (tuple(q.tolist()), tuple((q + 0.3).tolist()))
    return dataclasses.replace(world, trajectory=Trajectory(joints, (0.0, 0.5), rows, interpolation="quintic"))


@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_quick_access_is_the_slow_one_to_the_last_bit(loaded, damping):
    world = with_load(damping)
    ends = []
    for quick in (True, False):
        engine = loaded(world)
        control = Control(world, reference(world))
        places = control.q_places, control.v_places
        control.advance(engine.actuate(*places) if quick else Actuation(engine, *places), 0, AT_ONCE)
        q, v = engine.get_state()
        ends.append(q.tobytes() + v.tobytes())
    assert ends[0] == ends[1]


def test_efforts_of_control_are_not_left_behind(loaded):
    """After control, steps without effort are without effort."""
    world = told(driven(wheel(), "pd"), [1.0])
    engine = loaded(world)
    control = Control(world, reference(world))
    control.advance(engine.actuate(control.q_places, control.v_places), 0, 10)
    _, before = engine.get_state()
    engine.step(10)
    _, after = engine.get_state()
    assert before[0] > 0.01
    assert after[0] == pytest.approx(before[0], rel=1e-12)


@pytest.mark.parametrize("law", ["computed-torque", "pd"])
@pytest.mark.parametrize("discretisation", ["explicit", "implicit"])
def test_it_moves_as_the_oracle_does(loaded, law, discretisation):
    world = dataclasses.replace(with_load(), expectations=())
    one = dataclasses.replace(driven(chain(), law).controllers[0], discretisation=discretisation)
    world = dataclasses.replace(world, controllers=(one,))
    engine = loaded(world)
    control = Control(world, reference(world))
    control.advance(engine.actuate(control.q_places, control.v_places), 0, AT_ONCE)
    oracle = OracleJoints(world, control)
    again = Control(world, reference(world))
    again.advance(oracle, 0, AT_ONCE)
    q, _ = engine.get_state()
    np.testing.assert_allclose(q[control.q_places], oracle.q[control.q_places], atol=1e-12)


def test_a_run_records_what_was_asked_and_given(name):
    world = worlds.with_options(dataclasses.replace(with_load(), record=Record(50, ("energy",))), name)
    world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, steps=500))
    found = run(world, name)
    assert found.failed is None
    about = found.provenance["control"]
    order = [list(reference(world).joints).index(joint) for joint in about["joints"]]
    (wanted,) = reference(world).position.at(found.time)
    np.testing.assert_allclose(found.arrays["control.target"], wanted[:, order], atol=1e-15)
    assert found.arrays["control.effort"].shape == (11, 4)
    assert not found.arrays["control.effort"][0].any()
    assert found.arrays["control.effort"][1:].all()
    assert max(about["error"]) < 0.05
    assert about["clipped"] == [0] * 4
    assert found.provenance["seconds"]["control"] > 0.0


def test_the_same_run_twice_gives_the_same_bits(name):
    world = worlds.with_options(with_load(), name)
    one, two = (run(world, name) for _ in range(2))
    assert one.arrays["q"].tobytes() == two.arrays["q"].tobytes()
    assert one.arrays["control.effort"].tobytes() == two.arrays["control.effort"].tobytes()


def test_a_saved_run_keeps_what_was_asked_and_given(tmp_path):
    from simspec.runner.store import load_run

    found = run(told(driven(wheel()), [0.2]), ENGINES[0])
    found.save(tmp_path / "run")
    again = load_run(tmp_path / "run")
    for channel in ("control.target", "control.effort"):
        np.testing.assert_array_equal(again.arrays[channel], found.arrays[channel])
    assert again.world == found.world


@pytest.mark.parametrize("law", ["computed-torque", "pd"])
def test_the_proof_holds_the_step_response(law):
    world = driven(chain(), law)
    certificate = verify(world, ENGINES, levels=["L7"])
    for proof in certificate.engines.values():
        checks = proof.level("L7")
        assert [check.name for check in checks] == ["step response", "step response, closed form"][: len(checks)]
        assert len(checks) == (2 if law == "computed-torque" else 1)
        assert all(check.passed and check.worst < 1e-12 and check.count >= 200 for check in checks)


def test_a_law_that_lets_a_joint_fall_is_compared_until_it_comes_near_its_limit():
    """A carriage of 1 kg on an upright slide under gains that hold nothing: it falls from ±0.2 m to within a twentieth."""
    slide = Joint(
        "lift", "slide", None, axis=(0.0, 0.0, 1.0), position_limits=(-0.2, 0.2), position=(0.0,), velocity=(0.0,)
    )
    body = Body("carriage", "carriage", Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0)), slide)
    world = worlds.world(
        (body,), controllers=(Controller("weak", ("lift",), "pd", kp=(0.1,), kd=(0.1,), effort_limits=(None,)),)
    )
    for engine in ENGINES:
        world = worlds.with_options(world, engine, accept=("joint.limits.position",))
    certificate = verify(world, ENGINES, levels=["L7"])
    # 9.81 t²/2 = 0.18 m after 0.19 s
    for proof in certificate.engines.values():
        (check,) = proof.level("L7")
        assert check.passed
        assert 18 <= check.count <= 20
        assert "steps of 0.001 s of 500: then a joint comes near a limit" in check.detail


@pytest.mark.parametrize("engine", ENGINES)
def test_an_engine_that_holds_another_mass_fails_the_step_response(engine, tmp_path):
    """M of the law is the world's: files of another world move otherwise."""
    from simspec.compiler import compile_world, write_folder

    world = driven(chain())
    heavy = world.bodies[-1]
    heavier = dataclasses.replace(heavy, inertial=dataclasses.replace(heavy.inertial, mass=heavy.inertial.mass * 1.001))
    other = dataclasses.replace(world, bodies=(*world.bodies[:-1], heavier))
    write_folder(compile_world(other, [engine])[engine].files, tmp_path / engine)
    certificate = verify(world, [engine], artifacts={engine: tmp_path / engine}, levels=["L7"])
    assert [check.passed for check in certificate.engines[engine].level("L7")] == [False, False]


def test_where_it_starts_is_where_the_world_starts(loaded):
    world = with_load()
    engine = loaded(world)
    control = Control(world, reference(world))
    q, _ = engine.actuate(control.q_places, control.v_places).read()
    np.testing.assert_allclose(q, initial_state(world)[0][control.q_places], atol=1e-12)
