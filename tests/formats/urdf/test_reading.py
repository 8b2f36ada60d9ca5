"""Reading URDF: elements have lines, absent attributes stay absent, unknown elements are kept, hostile files are rejected."""

from __future__ import annotations

import re

import pytest

from simspec.formats.kit.text import parse_xml
from simspec.formats.urdf.format import Urdf
from simspec.formats.urdf.reading import LANGUAGE, WRITTEN, inertial_of, pose_of, read_robot, shapes_of, unknown_parts
from simspec.world.types import Inertial, Pose

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <!-- a comment -->
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.5"/>
      <mass value="2"/>
      <inertia ixx="1" ixy="0.1" ixz="0.2" iyy="2" iyz="0.3" izz="3"/>
    </inertial>
    <visual name="seen"><geometry><mesh filename="a.stl" scale="1 1 1"/></geometry><material name="grey"/></visual>
    <collision name="hull"><origin rpy="0 0 1"/><geometry><box size="1 2 3"/></geometry></collision>
    <self_collide>0</self_collide>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <limit lower="-1" upper="1" effort="10" velocity="2" stiffness="3"/>
    <mimic joint="other" multiplier="2"/>
  </joint>
  <gazebo reference="base"><static>true</static></gazebo>
</robot>
"""


def read(text):
    return read_robot(text.encode() if isinstance(text, str) else text, "arm.urdf")


def test_everything_stands_there_with_its_line():
    robot = read(ARM)
    assert (robot.name, robot.root) == ("arm", "base")
    base, upper = robot.links
    assert base.inertial is None
    assert upper.inertial.mass == 2.0
    assert upper.inertial.inertia == (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    assert (upper.inertial.origin.xyz, upper.inertial.origin.rpy) == ((0.0, 0.0, 0.5), None)
    assert upper.inertial.node.line == 7
    assert upper.collisions[0].geometry.tag == "box"
    assert (upper.visuals[0].material.name, upper.visuals[0].material.rgba) == ("grey", None)
    (shoulder,) = robot.joints
    assert (shoulder.axis, shoulder.origin, shoulder.dynamics) == (None, None, None)
    assert (shoulder.limit.lower, shoulder.limit.velocity) == (-1.0, 2.0)
    assert shoulder.node.need("mimic").need_number("multiplier") == 2.0
    assert shoulder.node.line == 16


def test_unknown_elements_are_kept_with_their_locations():
    found = [(unknown.path, unknown.name, unknown.node.line) for unknown in unknown_parts(read(ARM))]
    assert found == [
        ("robot/link/self_collide", None, 14),
        ("robot/joint/limit", "stiffness", 19),
        ("robot/gazebo", None, 22),
    ]
    more = {unknown.path for unknown in unknown_parts(read(ARM), WRITTEN)} - {path for path, _, _ in found}
    assert more == {"robot/material", "robot/joint/mimic"}
    twice = ARM.replace('<mass value="2"/>', '<mass value="2"/><mass value="3"/>')
    assert next(unknown_parts(read(twice))).path == "robot/link/inertial/mass"
    assert read(twice).links[1].inertial.mass == 2.0, "the first counts, and the second is not hidden"


def test_absent_attributes_have_the_default_of_the_language():
    upper = read(ARM).links[1]
    assert pose_of(None) == Pose()
    assert pose_of(upper.inertial.origin) == Pose((0.0, 0.0, 0.5))
    assert inertial_of(None) == Inertial(0.0)
    assert inertial_of(upper.inertial).inertia == (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    with pytest.raises(ValueError, match=r"arm\.urdf:12: the mesh 'a\.stl' is missing"):
        shapes_of(upper)


def test_every_element_of_the_language_is_known_below_another():
    below = {name for _, elements in LANGUAGE.values() for name in elements}
    assert below | {"robot"} == set(LANGUAGE)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('value="2"', 'value="two"', "9: value='two' of <mass>, should be a finite number"),
        ('value="2"', 'value="nan"', "9: value='nan'"),
        ('value="2"', 'value="1_0"', "9: value='1_0'"),
        ('xyz="0 0 0.5"', 'xyz="0 0"', "8: xyz='0 0' of <origin>, should be 3 finite numbers"),
        ('<mass value="2"/>', "", "7: <inertial> has no <mass>"),
        ('<box size="1 2 3"/>', "", "13: <geometry> has 0 elements"),
        ('<link name="base"/>', "<link/>", "5: <link> has no attribute 'name'"),
        ('<link name="base"/>', '<link name="upper"/>', "6: two links are called 'upper'"),
        ('<child link="upper"/>', '<child link="lower"/>', "16: joint 'shoulder' names a link 'lower'"),
        ('<child link="upper"/>', "", "16: <joint> has no <child>"),
        ('<link name="base"/>', '<link name="base"/><link name="more"/>', "2: 2 links are no joint's child"),
        ("<robot name", "<sdf name", "mismatched tag in <sdf> of line 2"),
        ('<parent link="base"/>', '<parent link="upper"/>', "2: joints lead from 'base' to 1 of 2 links"),
        ("</robot>", "", "no element found in <robot> of line 2"),
        (
            '<?xml version="1.0"?>',
            '<?xml version="1.0"?><!DOCTYPE robot>',
            "1: a document type, which may define entities, is not read",
        ),
    ],
)
def test_invalid_urdf_is_rejected_with_its_location(old, new, said):
    assert old in ARM
    with pytest.raises(ValueError, match=re.escape(said)) as refused:
        read(ARM.replace(old, new, 1))
    assert str(refused.value).startswith("arm.urdf:")


BOMB = "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 10))
HOSTILE = {
    "bomb": f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a0 "x">{BOMB}]><robot name="&a9;"/>',
    "external": '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="r"><link name="&x;"/></robot>',
    "unknown entity": '<robot name="&x;"/>',
    "deep": "<robot name='r'>" + "<a>" * 10_000 + "</a>" * 10_000 + "</robot>",
    "just too deep": "<robot name='r'>" + "<a>" * 64 + "</a>" * 64 + "</robot>",
    "many": b"<robot>" + b"<a/>" * 2_000_001 + b"</robot>",
    "long": b"<robot name='" + b"x" * (64 * 2**20) + b"'/>",
    "utf-16": ARM.encode("utf-16"),
    "latin": ARM.replace("arm", "ärm").encode("latin-1"),
    "random": bytes(range(256)) * 100,
    "empty": b"",
    "nul": b"<robot name='a\0b'/>",
    "said to be utf-16": ARM.replace('"1.0"', '"1.0" encoding="utf-16"').replace("<link", "<lonk"),
    "sdf": "<sdf><model/></sdf>",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_end_in_an_error(name):
    text = HOSTILE[name]
    with pytest.raises(ValueError, match=r"^arm\.urdf:\d+: "):
        read(text)


def test_truncated_files_end_in_an_error_or_are_whole():
    content = ARM.encode()
    whole = content.rindex(b"</robot>") + len(b"</robot>")
    for length in range(0, whole, 7):
        with pytest.raises(ValueError, match=r"arm\.urdf:\d+"):
            read(content[:length])


def test_a_folder_is_read_without_links_out_of_it(tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM)
    (tmp_path / "notes.txt").write_text("not read")
    assert set(Urdf().read(tmp_path).robots) == {"arm.urdf"}
    (tmp_path / "other.urdf").symlink_to("/etc/hostname")
    with pytest.raises(ValueError, match=r"other\.urdf"):
        Urdf().read(tmp_path)


def test_text_around_elements_is_kept():
    assert parse_xml(b"<robot name='r'><a>  7 </a></robot>", "r.urdf").need("a").text == "7"
