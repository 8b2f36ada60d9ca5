"""Actuators of MJCF files: those that a spec has are its model's, and a run with their commands moves as the file does in its
engine; the others are reported with the controller that acts alike."""

from __future__ import annotations

import numpy as np
import pytest

import simspec
from simspec.imports.mjcf.compiled import FEATURES
from simspec.language.load import load
from tests.imports.mjcf.models import ARM, lost, read, written

pytestmark = pytest.mark.usefixtures("warm_readers")

COMMANDS = {"p": 0.4, "v": 0.2, "g": 0.6, "m": 0.1}
DRIVEN = """<mujoco model="arm">
  <option timestep="0.001" integrator="Euler"><flag contact="disable" eulerdamp="disable"/></option>
  <worldbody>
    <body name="a"><joint name="j1" type="hinge" axis="0 1 0" damping="0.2" armature="0.01"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.4" size="0.03"/>
      <body name="b" pos="0 0 0.4"><joint name="j2" type="hinge" axis="0 1 0" damping="0.2" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.03"/>
        <body name="c" pos="0 0 0.3"><joint name="j3" type="slide" axis="0 0 1" ref="0.05" damping="1"/>
          <geom type="box" size="0.02 0.02 0.05"/>
          <body name="d" pos="0 0 0.1"><joint name="j4" type="hinge" axis="1 0 0" damping="0.01"/><geom size="0.04"/></body>
        </body></body></body>
  </worldbody>
  <actuator>
    <position name="p" joint="j1" kp="40" kv="3" ctrlrange="-1 1" forcerange="-8 8"/>
    <velocity name="v" joint="j2" kv="2" gear="3"/>
    <general name="g" joint="j3" gainprm="20" biastype="affine" biasprm="1 -50 -4" gear="-2"/>
    <motor name="m" joint="j4" gear="0.5"/>
  </actuator>
  <keyframe><key name="home" qpos="0.3 -0.2 0.07 0.1" ctrl="0.4 0.2 0.6 0.1"/></keyframe>
</mujoco>
"""


def acting(folder, text, name="robot.xml"):
    path = written(folder, text)
    (folder / "pyproject.toml").touch()
    commands = "".join(f"      arm/{actuator}: {value}\n" for actuator, value in COMMANDS.items())
    scenario = folder / "scenario.yaml"
    scenario.write_text(
        f"simspec: 1\nname: driven\nphysics: {{timestep: 1 ms, duration: 1 s}}\nmodels:\n  arm:\n    use: {path.name}\n"
        f"    state: home\ncontrol:\n  robot:\n    actuators: [arm/*]\n    commands:\n{commands}"
    )
    return path, load(scenario).resolve()


def test_a_model_carries_its_actuators(tmp_path):
    imported = read(written(tmp_path, DRIVEN))
    assert imported.data["model"]["actuators"] == {
        "p": {"joint": "j1", "kp": 40, "kd": 3, "effort_limit": 8, "command_limits": [-1, 1]},
        "v": {"joint": "j2", "law": "velocity", "kd": 2, "gear": 3},
        "g": {"joint": "j3", "law": "affine", "gain": 20, "bias": pytest.approx([6, -50, -4]), "gear": -2},
        "m": {"joint": "j4", "law": "effort", "gear": 0.5},
    }
    assert not lost(imported)
    assert not [entry for entry in imported.losses() if "actuator/" in entry.what]


def test_it_moves_as_the_file_does_in_mujoco(tmp_path):
    """Explicit dampers and actuators in both; the reference position of the slide is no position of the spec's."""
    mujoco = pytest.importorskip("mujoco")
    path, world = acting(tmp_path, DRIVEN)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(1000):
        mujoco.mj_step(model, data)
    run = simspec.run(world, "mujoco")
    ours = [[run.q(f"arm/j{k}")[-1], run.v(f"arm/j{k}")[-1]] for k in range(1, 5)]
    theirs = np.transpose([data.qpos - model.qpos0, data.qvel])
    assert np.abs(np.subtract(ours, theirs)).max() < 1e-12


def test_a_scenario_carries_them_next_to_its_bodies(tmp_path):
    imported = read(written(tmp_path, DRIVEN.replace("<worldbody>", '<worldbody><geom type="plane" size="1 1 1"/>')))
    assert "model" not in imported.data
    assert set(imported.data["actuators"]) == set(COMMANDS)
    assert not [entry for entry in imported.losses() if "actuator/" in entry.what]


@pytest.mark.parametrize(
    ("actuator", "hint"),
    [
        ('<position joint="swing" kp="30" kv="2" forcerange="-5 4"/>', "kp: 30, kd: 2, effort_limit: 5"),
        ('<general joint="swing" gainprm="1" biastype="affine" biasprm="0 1 0"/>', FEATURES["actuator"].hint),
        ('<muscle joint="swing"/>', FEATURES["actuator"].hint),
        ('<cylinder joint="swing" timeconst="1"/>', FEATURES["actuator"].hint),
    ],
)
def test_others_are_reported_with_the_controller_that_acts_alike(tmp_path, actuator, hint):
    text = ARM.replace("</mujoco>", f"<actuator>{actuator}</actuator></mujoco>")
    imported = read(written(tmp_path, text))
    assert "actuators" not in imported.data["model"]
    (entry,) = [entry for entry in imported.losses() if "actuator/" in entry.what]
    assert hint in entry.hint


@pytest.mark.parametrize(
    ("actuator", "words"),
    [
        ('<motor joint="swing" ctrllimited="true" ctrlrange="2 3"/>', {"law": "effort", "command": 2}),
        ('<general joint="swing" gainprm="5"/>', {"law": "affine", "gain": 5}),
        ('<position jointinparent="swing" kp="3"/>', {"law": "affine", "gain": 3}),
    ],
)
def test_numbers_of_an_actuator(tmp_path, actuator, words):
    text = ARM.replace("</mujoco>", f"<actuator>{actuator}</actuator></mujoco>")
    (said,) = read(written(tmp_path, text)).data["model"]["actuators"].values()
    assert words.items() <= said.items()
    load(written(tmp_path, text)).resolve()
