"""Tiny robot files, each with one thing that engines are known to change in silence."""

from __future__ import annotations

ROBOT = """<robot name="tiny">
  <link name="base">
    <inertial><mass value="3"/><origin xyz="0 0 0.1"/>
      <inertia ixx="0.3" iyy="0.3" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="0.2 0.2 0.2"/></geometry></visual>
    <collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>
  </link>
  <link name="flange">
    <inertial><mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="arm">
    <inertial><mass value="1"/><origin xyz="0.1 0 0" rpy="0 0 0.7"/>
      <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><cylinder radius="0.05" length="0.3"/></geometry></collision>
  </link>
  <link name="hand">
    %s
    <collision><geometry><sphere radius="0.1"/></geometry></collision>
  </link>
  <joint name="mount" type="fixed"><parent link="base"/><child link="flange"/><origin xyz="0 0 0.2"/></joint>
  <joint name="shoulder" type="revolute"><parent link="flange"/><child link="arm"/><origin xyz="0 0 0.1" rpy="0.1 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="10" velocity="3"/><dynamics damping="0.5" friction="0.1"/></joint>
  <joint name="wrist" type="%s"><parent link="arm"/><child link="hand"/><origin xyz="0.3 0 0"/>
    <axis xyz="1 0 0"/><limit lower="%s" upper="%s" effort="5" velocity="2"/></joint>
</robot>
"""
INERTIAL = (
    '<inertial><mass value="0.2"/><inertia ixx="0.002" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def robot(hand: str = INERTIAL, wrist: str = "revolute", lower: float = -1.0, upper: float = 1.0) -> str:
    """Four links: a base, a flange that is fixed to it, an arm and a hand."""
    return ROBOT % (hand, wrist, lower, upper)


PENDULUM = """<mujoco model="pendulum">
  <compiler angle="degree"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="upper" pos="0 0 1">
      <joint name="swing" type="hinge" axis="0 1 0" pos="0 0 0.2" range="-90 45" limited="true"/>
      <joint name="lift" type="slide" axis="0 0 1"/>
      <geom name="rod" type="capsule" size="0.03 0.2" density="500"/>
      <body name="lower" pos="0 0 -0.4">
        <joint name="elbow" type="hinge" axis="0 1 0" damping="0.1" armature="0.01"/>
        <geom name="tip" type="sphere" size="0.05" mass="0.3"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
