"""Drake's PD controllers are in ``world.json``, since they get gains before the plant is finalised. Their errors are found
there and in the engine."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.engines.drake.engine import Drake
from simspec.errors import EngineError, UnsupportedError
from simspec.formats.kit.text import json_text
from simspec.formats.world import WORLD
from simspec.proof.verify import verify
from simspec.testing.bench import chain, native, wheel, with_targets
from tests import worlds
from tests.engines.natively import at_work

pytestmark = pytest.mark.usefixtures("warm_engines")

pytest.importorskip("pydrake")

WRONG = {
    "kp": (lambda servo: servo.update(kp=200.1), "controller's kp"),
    "kd": (lambda servo: servo.update(kd=2.001), "controller's kd"),
    "effort limit": (lambda servo: servo.update(effort_limit=100.1), "controller's effort limit"),
    "effort limit dropped": (lambda servo: servo.update(effort_limit=None), "controller's effort limit"),
}


def driven(kp=200.0, kd=2.0, limit=100.0):
    return with_targets(native(chain(), kp=kp, kd=kd, limit=limit), [0.1] * 4)


def changed(world, change):
    """Compiled files with another ``world.json``; ``change`` gets its bodies."""
    files = dict(compile_world(world, ["drake"])["drake"].files)
    content = json.loads(files[WORLD])
    change(content["bodies"])
    return files | {WORLD: json_text(content)}


def failed(world, files, folder):
    write_folder(files, folder)
    proof = verify(world, ["drake"], artifacts={"drake": folder}, levels=["L0", "L1", "L2"]).engines["drake"]
    return {(check.level, check.name) for check in proof.checks if not check.passed}


@pytest.mark.parametrize("key", WRONG)
def test_a_wrong_gain_in_the_file_is_found_in_the_text_and_by_the_engine(key, tmp_path):
    change, name = WRONG[key]
    world = driven()
    assert failed(world, changed(world, lambda bodies: change(bodies[0]["joint"]["servo"])), tmp_path / "drake") == {
        ("L0", name),
        ("L2", name),
    }


def test_a_controller_less_or_more_is_found(tmp_path):
    world = driven()
    less = changed(world, lambda bodies: bodies[0]["joint"].pop("servo"))
    checks = failed(world, less, tmp_path / "less")
    assert {("L0", "controllers"), ("L2", "controllers")} <= checks
    local = {"kp": 1.0, "kd": 1.0, "effort_limit": None}
    more = changed(chain(), lambda bodies: bodies[0]["joint"].update(servo=local))
    assert {("L0", "controllers"), ("L2", "controllers")} <= failed(chain(), more, tmp_path / "more")


def test_a_negative_gain_is_refused(load_files):
    files = changed(driven(), lambda bodies: bodies[0]["joint"]["servo"].update(kd=-1.0))
    with pytest.raises(EngineError, match=r"servo\.kd is -1\.0, should not be negative"):
        load_files(Drake, files)


def test_a_file_without_the_controller_is_refused_when_a_run_begins(load_files):
    world = with_targets(native(wheel()), [0.5])
    engine = load_files(Drake, changed(world, lambda bodies: bodies[0]["joint"].pop("servo")))
    with pytest.raises(EngineError, match="no controller of joint 'wheel_joint'"):
        at_work(engine, world)


def test_the_effort_limit_of_a_controller_is_not_the_joints(load_files):
    """Each is held by an actuator of its own, and read back as what it is."""
    world = with_targets(native(wheel(), limit=0.4), [0.5])
    (body,) = world.bodies
    joint = dataclasses.replace(body.joint, effort_limit=7.0, armature=0.01)
    world = dataclasses.replace(world, bodies=(dataclasses.replace(body, joint=joint),))
    engine = load_files(Drake, compile_world(world, ["drake"])["drake"].files)
    back = engine.read_back()
    assert (back.bodies[0].joint.effort_limit, back.bodies[0].joint.armature) == (7.0, 0.01)
    assert [servo.effort_limit for servo in back.servos] == [0.4]
    advance, _ = at_work(engine, world)
    advance(1)
    _, v = engine.get_state()
    assert v[0] == pytest.approx(0.4 * world.physics.timestep / 0.03, rel=1e-6)


def test_only_driven_joints_are_driven(load_files):
    """With other joints that have an effort limit and no controller: their actuators come first."""
    world = chain(("hinge", "hinge", "hinge"))
    bodies = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, effort_limit=50.0)) for body in world.bodies
    )
    world = dataclasses.replace(world, bodies=bodies)
    last = bodies[-1].joint.name
    controller = dataclasses.replace(
        native(world, kp=500.0, kd=20.0).controllers[0],
        joints=(last,), kp=(500.0,), kd=(20.0,), effort_limits=(None,),
    )  # fmt: skip
    world = with_targets(dataclasses.replace(world, controllers=(controller,)), [bodies[-1].joint.position[0]])
    engine = load_files(Drake, compile_world(world, ["drake"])["drake"].files)
    start, _ = engine.get_state()
    advance, _ = at_work(engine, world)
    advance(100)
    q, _ = engine.get_state()
    moved = np.abs(q - start)
    assert moved[-1] < 0.05 < moved[0]


@pytest.mark.parametrize(
    ("world", "reason"),
    [
        (
            worlds.with_options(driven(), "drake", settings=(("contact_approximation", "tamsi"),)),
            "need contact_approximation: sap",
        ),
        (driven(limit=0.0), "effort limit above zero"),
    ],
    ids=["tamsi", "no effort"],
)
def test_features_that_drakes_controllers_lack_are_rejected_by_name(world, reason):
    with pytest.raises(UnsupportedError, match=reason):
        compile_world(world, ["drake"])
