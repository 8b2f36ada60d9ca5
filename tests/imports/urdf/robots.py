"""URDF texts for tests, and their import."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from simspec.errors import SpecError
from simspec.imports.urdf.importer import UrdfImporter
from simspec.language.foreign import Imported, ImportOptions

SOLID = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'

SPECIMEN = """\
<?xml version="1.0"?>
<robot name="arm two" version="1.0" xmlns:drake="http://drake.mit.edu">
  <material name="blue"><color rgba="0 0 0.5 1"/><texture filename="wood.png"/></material>
  <link name="base" type="old" concave="yes">
    <inertial>
      <origin xyz="0.1 0 0.2" rpy="0 0 0"/>
      <mass value="3.5"/>
      <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="-0.002" izz="0.04"/>
    </inertial>
    <visual name="seen">
      <origin xyz="0 0 0.05" rpy="0 0 0"/>
      <geometry><box size="0.2 0.2 0.1"/></geometry>
      <material name="blue"/>
    </visual>
    <collision name="solid" concave="yes">
      <origin xyz="0 0 0.05" rpy="0 0 0.5"/>
      <geometry><box size="0.2 0.2 0.1"/></geometry>
      <material name="blue"/>
      <verbose value="1"/><surface/>
    </collision>
    <self_collision_checking><origin/></self_collision_checking>
    <collision_checking/>
    <contact>
      <lateral_friction value="1"/><rolling_friction value="1e-3"/><spinning_friction value="2e-3"/>
      <restitution value="0.1"/><stiffness value="3"/><damping value="1"/><friction_anchor/>
      <contact_cfm value="0"/><contact_erp value="1"/><inertia_scaling value="2"/>
    </contact>
    <origin/><gravity>1</gravity><kinematic/><self_collide/><surface/>
    <sensor name="camera"/>
    <audio_source/>
  </link>
  <link name="upper.arm">
    <inertial>
      <origin xyz="0 0 0.25" rpy="0.3 0 0"/>
      <mass value="1.25"/>
      <inertia ixx="0.01" iyy="0.012" izz="0.003" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual>
      <origin xyz="0 0 0.25" rpy="0 0 0"/>
      <geometry name="g"><cylinder radius="0.03" length="0.5"/><material/></geometry>
      <material name="red"><color rgba="1 0 0 1"/><texture filename="red.png"/><specular/></material>
    </visual>
    <collision><origin xyz="0 0 0.25" rpy="0 0 0"/><geometry><cylinder radius="0.03" length="0.5"/></geometry></collision>
  </link>
  <link name="tip">
    <inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0" rpy="0 0 0"/><geometry name="h"><sphere radius="0.04"/><material/></geometry></collision>
    <visual><origin xyz="0 0 0" rpy="0 0 0"/><geometry><sphere radius="0.05"/></geometry></visual>
  </link>
  <joint name="shoulder" type="revolute" dont_collapse="true">
    <preserveFixedJoint>1</preserveFixedJoint><parent link="base"/>
    <child link="upper.arm"/>
    <origin xyz="0 0 0.1" rpy="0 1.5707963267948966 0"/>
    <axis xyz="0 1 0" rpy="0 0 0"/>
    <limit lower="-2.5" upper="7" effort="20" velocity="3.2" acceleration="9" jerk="9" stiffness="1" dissipation="1"/>
    <dynamics damping="0.1" friction="0.02" D="1" K="1" mu_coulomb="1" mu_viscous="1" spring_stiffness="1"
      spring_reference="0"/>
    <mimic joint="wrist" multiplier="2" offset="0.5"/>
    <safety_controller soft_lower_limit="-2" k_velocity="1"/>
    <calibration rising="0"/>
    <joint_properties damping="1"/><hardwareInterface>EffortJointInterface</hardwareInterface>
  </joint>
  <joint name="wrist" type="continuous">
    <parent link="upper.arm"/>
    <child link="tip"/>
    <origin xyz="0 0 0.5"/>
    <axis xyz="0 0 1"/>
  </joint>
  <transmission name="t"><type>simple</type><joint name="wrist"/>
    <actuator name="a"><drake:rotor_inertia value="1e-5"/><drake:gear_ratio value="10"/></actuator></transmission>
  <drake:collision_filter_group name="g"><drake:member link="base"/><drake:member link="tip"/>
    <drake:ignored_collision_filter_group name="g"/></drake:collision_filter_group>
  <inertial/>
  <ros2_control name="r"/>
  <sensor name="s"/>
  <mujoco><compiler balanceinertia="true" settotalmass="3" inertiafromgeom="true"/>
    <option gravity="0 0 0" wind="1 0 0" density="1" viscosity="1"/></mujoco>
  <frame name="f"/>
  <gazebo reference="tip"><mu1>0.2</mu1><mu2>0.2</mu2><material>Gazebo/Blue</material><plugin name="p"/>
    <gravity>0</gravity><turnGravityOff>1</turnGravityOff>
    <unheard/></gazebo>
</robot>
"""
"""Every element and attribute of the table that has no case of its own."""


def two_links(joint: str = "", base: str = SOLID, arm: str = SOLID, more: str = "", kind: str = "continuous") -> str:
    """A robot of two links; the texts are the insides of its elements. The links stand in lines 2 and 3, the joint in 4."""
    return (
        f'<robot name="two">\n<link name="base">{base}</link>\n<link name="arm">{arm}</link>\n'
        f'<joint name="hinge" type="{kind}"><parent link="base"/><child link="arm"/>{joint}</joint>\n{more}</robot>\n'
    )


def read(text: str | bytes, folder: Path, *repair: str, name: str = "robot.urdf") -> Imported:
    """The import of a text as a file in ``folder``."""
    file = folder / name
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return UrdfImporter().read(file, name, ImportOptions(repair=repair, project=folder))


def refused(text: str | bytes, folder: Path, *repair: str) -> list[str]:
    """The problems of a text that is not imported, each as it is printed."""
    with pytest.raises(SpecError) as error:
        read(text, folder, *repair)
    assert all(problem.location is not None for problem in error.value.problems), str(error.value)
    return [str(problem) for problem in error.value.problems]


_watched: list[list[str]] = []


def _watch(event: str, arguments: tuple[object, ...]) -> None:
    if event == "open" and isinstance(arguments[0], str | bytes):
        for opened in _watched:
            opened.append(str(arguments[0]))


@contextlib.contextmanager
def watched(opened: list[str]) -> Iterator[None]:
    """Within it, every file that this process opens is noted. A watch cannot be removed again: there is one."""
    if not hasattr(sys, "_simspec_watch"):
        sys._simspec_watch = True  # type: ignore[attr-defined]
        sys.addaudithook(_watch)
    _watched.append(opened)
    try:
        yield
    finally:
        _watched.remove(opened)


def inertial(mass: str = '<mass value="2"/>', **moments: float) -> str:
    six = {"ixx": 1, "iyy": 1, "izz": 1, "ixy": 0, "ixz": 0, "iyz": 0, **moments}
    said = " ".join(f'{name}="{value}"' for name, value in six.items())
    return f"<inertial>{mass}<inertia {said}/></inertial>"


BALL = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'

MASSLESS = '<mass value="0"/>'
DEFECTS = {
    "triangle-inequality": (two_links(arm=inertial(izz=3)), "triangle inequality", 3),
    "not-positive": (two_links(arm=inertial(izz=0, ixx=0, iyy=0)), "must be above 0", 3),
    "negative": (two_links(arm=inertial(izz=-1)), "a principal moment is negative", 3),
    "incomplete-inertial": (two_links(arm='<inertial><mass value="1"/></inertial>'), "an incomplete inertial", 3),
    "massless": (two_links(base="", arm=""), "this joint moves no mass", 4),
    "massless-moments": (
        two_links(
            more=f'<link name="tool">{inertial(MASSLESS)}</link>'
            '<joint name="w" type="fixed"><parent link="arm"/><child link="tool"/></joint>'
        ),
        "moments of inertia of a link without mass",
        5,
    ),
    "missing-leaders": (
        two_links('<mimic joint="missing"/>'),
        "there is no joint 'missing'",
        4,
    ),
    "undeclared-world": (
        two_links(more='<joint name="w" type="fixed"><parent link="world"/><child link="base"/></joint>'),
        "there is no link 'world'",
        5,
    ),
    "undeclared-parents": (
        two_links(more='<joint name="w" type="fixed"><parent link="mast"/><child link="base"/></joint>'),
        "there is no link 'mast'",
        5,
    ),
    "damaged-numbers": (two_links('<origin xyz="1, 2 3"/>'), "xyz of <origin> should be 3 finite numbers", 4),
    "no-range": (two_links('<limit effort="1" velocity="1"/>', kind="revolute"), "with lower and upper", 4),
    "missing-limits": (two_links(kind="revolute"), "needs a <limit>", 4),
    "turned-limits": (two_links('<limit lower="2" upper="1"/>', kind="prismatic"), "lower limit is above", 4),
    "empty-shapes": (two_links(arm=SOLID + BALL.replace("0.1", "0")), "must be above 0", 3),
    "several-roots": (two_links(more='<link name="left"/>'), "have no parent", 5),
}

OTHERS = {"negative": "not-positive", "no-range": "missing-limits"}
