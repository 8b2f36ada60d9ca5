"""Control with the engine in this process, and its record by the runner (the rest is the shipped suite's): quick and slow
access are equal to the last bit, and nothing is left behind."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.control.law import Control
from simspec.control.reference import reference
from simspec.engines.kit.contract import Actuation
from simspec.proof.verify import verify
from simspec.runner.execution import run
from simspec.testing import worlds
from simspec.testing.bench import driven, wheel, with_targets
from simspec.testing.control_suite import with_load
from simspec.world.actions import JointController
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import initial_state
from simspec.world.types import Body, Inertial, Joint
from tests.installed import JOINTED

pytestmark = pytest.mark.usefixtures("warm_engines")

AT_ONCE = 250


@pytest.fixture(params=JOINTED)
def name(request) -> str:
    return request.param


@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_quick_and_slow_access_are_equal_to_the_last_bit(loaded, damping):
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
    world = with_targets(driven(wheel(), "pd"), [1.0])
    engine = loaded(world)
    control = Control(world, reference(world))
    control.advance(engine.actuate(control.q_places, control.v_places), 0, 10)
    _, before = engine.get_state()
    engine.step(10)
    _, after = engine.get_state()
    assert before[0] > 0.01
    assert after[0] == pytest.approx(before[0], rel=1e-12)


def test_a_saved_run_keeps_requested_and_applied_efforts(tmp_path):
    from simspec.runner.store import load_run

    found = run(with_targets(driven(wheel()), [0.2]), JOINTED[0])
    found.save(tmp_path / "run")
    again = load_run(tmp_path / "run")
    for channel in ("control.target", "control.effort"):
        np.testing.assert_array_equal(again.arrays[channel], found.arrays[channel])
    assert again.world == found.world


def test_a_law_that_lets_a_joint_fall_is_compared_until_it_comes_near_its_limit():
    """A carriage of 1 kg on an upright slide under gains that hold nothing: it falls from ±0.2 m to within a twentieth."""
    slide = Joint(
        "lift", "slide", None, axis=(0.0, 0.0, 1.0), position_limits=(-0.2, 0.2), position=(0.0,), velocity=(0.0,)
    )
    body = Body("carriage", "carriage", Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0)), slide)
    world = worlds.world(
        (body,), controllers=(JointController("weak", ("lift",), "pd", kp=(0.1,), kd=(0.1,), effort_limits=(None,)),)
    )
    certificate = verify(worlds.accepting(world, *JOINTED), JOINTED, levels=["L7"])
    # 9.81 t²/2 = 0.18 m after 0.19 s
    for proof in certificate.engines.values():
        (check,) = proof.level("L7")
        assert check.passed
        assert 18 <= check.count <= 20
        assert "steps of 0.001 s of 500: then a joint comes near a limit" in check.detail


def test_where_it_starts_is_where_the_world_starts(loaded):
    world = with_load()
    engine = loaded(world)
    control = Control(world, reference(world))
    q, _ = engine.actuate(control.q_places, control.v_places).read()
    np.testing.assert_allclose(q, initial_state(world)[0][control.q_places], atol=1e-12)


def test_detection_leaves_the_state_alone(loaded):
    world = worlds.gripper()
    engine = loaded(world)
    q, v = initial_state(world)
    q[1], q[2] = 0.28, -0.28
    q[3:6] = (0.0, 0.03, -0.3)
    engine.set_state(q, v)
    names = [body.name for body in world.bodies]
    touching = {(names[a], names[b]) for a, b in engine.detect_contacts()}
    assert touching == {("left", "bar"), ("right", "bar")}
    assert all(CollisionFilter(world).may_touch(*pair) for pair in touching)
    after, _ = engine.get_state()
    np.testing.assert_allclose(after, q, atol=1e-15)
