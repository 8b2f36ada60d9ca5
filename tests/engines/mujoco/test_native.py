"""MuJoCo's actuators are in its file: their errors are found there and in the engine."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.engines.mujoco.engine import MuJoCo
from simspec.errors import EngineError
from simspec.proof.verify import verify
from simspec.testing.bench import chain, native, wheel, with_targets
from tests.dialects.mujoco.saying import emit
from tests.engines.natively import at_work

pytestmark = pytest.mark.usefixtures("warm_engines")

WRONG = {
    "kp": ('kp="200"', 'kp="200.1"', "controller's kp"),
    "kd": ('kv="2"', 'kv="2.001"', "controller's kd"),
    "effort limit": ('forcerange="-100 100"', 'forcerange="-100.1 100.1"', "controller's effort limit"),
    "effort limit dropped": ('forcelimited="true"', 'forcelimited="false"', "controller's effort limit"),
    "another joint": ('joint="link1_joint" kp', 'joint="link2_joint" kp', "controllers"),
}


@pytest.mark.parametrize("key", WRONG)
def test_a_wrong_gain_in_the_file_is_found_in_the_text_and_by_the_engine(key, tmp_path):
    engine = "mujoco"
    text, other, check = WRONG[key]
    world = with_targets(native(chain(), kp=200.0, kd=2.0, limit=100.0), [0.1] * 4)
    files = dict(compile_world(world, [engine])[engine].files)
    assert text in files["model.xml"]
    files["model.xml"] = files["model.xml"].replace(text, other, 1)
    write_folder(files, tmp_path / engine)
    proof = verify(world, [engine], artifacts={engine: tmp_path / engine}, levels=["L0", "L1", "L2"]).engines[engine]
    failed = {(check.level, check.name) for check in proof.checks if not check.passed}
    assert failed == {("L0", check), ("L2", check)}


@pytest.mark.parametrize(
    ("text", "other"),
    [('gear="1 0 0 0 0 0"', 'gear="2 0 0 0 0 0"'), ('forcerange="-100 100"', 'forcerange="-100 90"')],
)
def test_an_actuator_of_another_kind_is_refused_by_both_readers(text, other, tmp_path):
    engine = "mujoco"
    world = with_targets(native(chain(), kp=200.0, kd=2.0, limit=100.0), [0.1] * 4)
    files = dict(compile_world(world, [engine])[engine].files)
    files["model.xml"] = files["model.xml"].replace(text, other, 1)
    write_folder(files, tmp_path / engine)
    proof = verify(world, [engine], artifacts={engine: tmp_path / engine}, levels=["L0", "L1"]).engines[engine]
    assert {check.level for check in proof.checks if not check.passed} >= {"L0", "L1"}


def test_a_file_without_actuators_is_refused_when_a_run_begins(load_files):
    world = with_targets(native(wheel()), [0.5])
    engine = load_files(MuJoCo, emit(dataclasses.replace(world, controllers=())))
    with pytest.raises(EngineError, match="no actuator for wheel_joint"):
        at_work(engine, world)
