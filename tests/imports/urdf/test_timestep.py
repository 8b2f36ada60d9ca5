"""A robot file has no timestep: where its dampers are unstable at the usual one, the spec says one at which they are stable."""

from __future__ import annotations

import pytest

from simspec.language.foreign import ImportOptions, import_file
from simspec.language.load import load

INERTIAL = '<inertial><mass value="1"/><inertia ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"/></inertial>'
ROBOT = """<robot name="arm"><link name="base"/><link name="arm">{}</link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><dynamics damping="{}"/></joint></robot>"""


@pytest.mark.parametrize(
    ("moment", "damping", "step"),
    [(0.01, 1.0, None), (0.001, 4.0, 2e-4), (0.01, 0.0, None), (1e-6, 3.0, 2e-7)],
    ids=["stable at 1 ms", "stable up to 0.5 ms", "no damper", "stable up to 0.67 µs"],
)
def test_the_timestep_follows_from_the_dampers(moment, damping, step, tmp_path):
    """Explicit damping is stable up to 2 I / c."""
    path = tmp_path / "arm.urdf"
    path.write_text(ROBOT.format(INERTIAL.format(moment), damping), encoding="utf-8")
    imported = import_file(path, "arm.urdf", ImportOptions())
    assert imported.data.get("physics", {}).get("timestep") == step
    assert ("physics.timestep" in imported.comments) is (step is not None)
    assert load(path).resolve().physics.timestep == (step or 1e-3)


def test_a_joint_that_begins_at_a_limit_has_its_timestep_too(tmp_path):
    limited = ROBOT.replace("continuous", "revolute").replace("<dynamics", '<limit lower="0.3" upper="1"/><dynamics')
    path = tmp_path / "arm.urdf"
    path.write_text(limited.format(INERTIAL.format(0.001), 4.0), encoding="utf-8")
    world = load(path).resolve()
    assert world.physics.timestep == 2e-4
    assert [body.joint.position for body in world.bodies if body.joint.name == "turn"] == [(0.3,)]
