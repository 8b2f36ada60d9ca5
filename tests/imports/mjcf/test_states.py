"""Keys of MJCF as named states of the model: positions from the reference on, the root's pose, and losses."""

from __future__ import annotations

import numpy as np
import pytest

import simspec
from simspec.language.foreign import Fate
from simspec.world.kinematics import initial_state

pytestmark = pytest.mark.usefixtures("warm_readers")

MODEL = """<mujoco model="walker"><compiler angle="radian"/><worldbody>
  <body name="trunk" pos="0 0 0.5"><freejoint/><inertial pos="0.1 0 0" mass="5" diaginertia=".1 .1 .1"/>
    <body name="hip" pos="0.2 0 0"><joint name="swing" axis="0 1 0" ref="0.3" range="-1 1" limited="true"/>
      <inertial pos="0 0 -0.1" mass="1" diaginertia=".01 .01 .01"/>
      <body name="foot" pos="0 0 -0.3"><joint type="ball"/><inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/></body>
    </body>
  </body></worldbody>
  <keyframe>
    <key name="home" qpos="1 2 0.27 1 0 0 0 0.8 0 1 0 0" qvel="1 0 0 0 0 2 0.5 0 0 0"/>
    <key name="far" qpos="0 0 0 1 0 0 0 7 1 0 0 0"/>
    <key qpos="0 0 0 0 0 1 0 0.3 1 0 0 0" time="3"/>
  </keyframe></mujoco>"""


def placed(folder, text: str, state: str):
    (folder / "walker.xml").write_text(text, encoding="utf-8")
    spec = f"simspec: 1\nname: top\nmodels:\n  w: {{use: walker.xml, state: {state}}}\n"
    (folder / "top.yaml").write_text(spec, encoding="utf-8")
    return simspec.load(folder / "top.yaml")


def test_a_key_is_a_state(tmp_path):
    world = placed(tmp_path, MODEL, "home").resolve()
    base, hip, foot = (body.joint for body in world.bodies)
    assert base.position == (1.0, 2.0, 0.27, 1.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(base.velocity, (1.0, 0.0, 0.0, 0.0, 0.0, 2.0))
    assert hip.position == pytest.approx((0.5,))  # from the reference of 0.3 on
    assert hip.velocity == (0.5,)
    assert foot.position == (0.0, 1.0, 0.0, 0.0)
    assert np.isfinite(initial_state(world)[0]).all()


def test_losses_of_keys_are_reported(tmp_path):
    spec = placed(tmp_path, MODEL, "state_2")
    assert spec.resolve().bodies[0].joint.position[3:] == (0.0, 0.0, 1.0, 0.0)
    (file,) = spec.source.uses.values()
    assert file.imported is not None
    given = {entry.what: entry.fate for entry in file.imported.accounts if "key" in entry.what}
    assert {what for what, fate in given.items() if fate is Fate.LOST} == {"keyframe/key/@time"}
    assert given["keyframe/key[home]"] is given["keyframe/key[home]/@qpos"] is Fate.CARRIED
    with pytest.raises(simspec.SpecError, match="the model has no state 'farther'"):
        placed(tmp_path, MODEL, "farther")
    assert placed(tmp_path, MODEL, "far").resolve().bodies[1].joint.position == pytest.approx((0.7,))  # its limit


ACTED = MODEL.replace('<key name="home"', '<key name="home" ctrl="0.7 3"').replace(
    "</worldbody>",
    """</worldbody><actuator><position name="servo" joint="swing" kp="5" ctrlrange="-1 0.4" ctrllimited="true"/>
    <motor name="push" joint="swing" gear="2"/></actuator>""",
)


def test_inputs_of_a_key_are_commands_of_actuators(tmp_path):
    """At its limit where the key is beyond: 5 (0.4 − (q + 0.3)) of a joint whose reference is 0.3, and 2 · 3."""
    spec = placed(tmp_path, ACTED, "home")
    (file,) = spec.source.uses.values()
    given = {entry.what: entry.fate for entry in file.imported.accounts}
    assert given["keyframe/key[home]/@ctrl"] is Fate.CARRIED
    top = tmp_path / "top.yaml"
    text = top.read_text(encoding="utf-8")
    for name, target, feed in (("servo", 0.0, 0.5), ("push", 0.5, 6.0)):
        top.write_text(f"{text}control: {{c: {{actuators: [w/{name}]}}}}\n", encoding="utf-8")
        trajectory = simspec.load(top).resolve().trajectory
        assert trajectory.positions == pytest.approx(np.array([[target]]))
        assert trajectory.efforts == pytest.approx(np.array([[feed]]))


def test_inputs_of_actuators_that_are_not_carried_are_reported(tmp_path):
    driven = ACTED.replace('joint="swing" gear="2"', 'joint="foot" gear="2"').replace(
        'type="ball"', 'type="ball" name="foot"'
    )
    (file,) = placed(tmp_path, driven, "home").source.uses.values()
    given = {entry.what: entry.fate for entry in file.imported.accounts}
    assert given["keyframe/key[home]/@ctrl"] is Fate.LOST
    assert file.imported.data["model"]["states"]["home"]["commands"] == {"servo": 0.4}
