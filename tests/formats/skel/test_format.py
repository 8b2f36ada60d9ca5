""".skel as a language of its own: written, read again with lines, and refused by file and line where it is none."""

from __future__ import annotations

import pytest

from simspec.formats.skel.format import WORLD, Skel, SkelBody, Skeleton, SkelJoint, SkelShape, SkelWorld
from simspec.formats.skel.reading import unknown_parts, without_visual_shapes
from simspec.world.types import Inertial, Pose

TURN = (0.6, 0.8, 0.0, 0.0)
INERTIAL = Inertial(2.0, (0.0, 0.1, 0.0), (0.1, 0.2, 0.3, 0.01, -0.02, 0.0))
RED = (1.0, 0.0, 0.0, 1.0)
SHAPES = (
    SkelShape("sphere", (0.1,), Pose()),
    SkelShape("box", (0.1, 0.2, 0.3), Pose((0.0, 0.0, 1e-17), TURN)),
    SkelShape("cylinder", (0.1, 0.3), Pose()),
    SkelShape("capsule", (0.1, 0.4), Pose()),
    SkelShape("ellipsoid", (0.1, 0.2, 0.3), Pose()),
    SkelShape("plane", (), Pose()),
)
TREE = SkelWorld(
    "test",
    0.001,
    (0.0, 0.0, -9.81),
    "ode",
    (
        Skeleton(
            "arm",
            True,
            (
                SkelBody(
                    "base", Pose((1.0, 2.0, 3.0), TURN), INERTIAL, (SkelShape("sphere", (0.2,), Pose(), RED),), SHAPES
                ),
                SkelBody("tip", Pose(), INERTIAL, (), ()),
            ),
            (
                SkelJoint("base_joint", "fixed", None, "base"),
                SkelJoint("tip_joint", "hinge", "base", "tip", (0.0, 0.6, 0.8), (-1.0, 2.0), 0.5, (0.3,), (-0.1,)),
            ),
        ),
    ),
)


def _read(folder, text):
    (folder / WORLD).write_text(text, encoding="utf-8")
    return Skel().read(folder)


def test_written_files_are_read_back(tmp_path):
    document = _read(tmp_path, Skel().write(TREE)[WORLD])
    assert (document.timestep, document.gravity, document.collision_detector) == (0.001, (0.0, 0.0, -9.81), "ode")
    (skeleton,) = document.skeletons
    base, tip = skeleton.bodies
    assert (skeleton.name, skeleton.mobile) == ("arm", True)
    assert base.inertial == tip.inertial == INERTIAL
    assert base.pose.position == (1.0, 2.0, 3.0)
    assert base.pose.quaternion == pytest.approx(TURN, abs=1e-15)
    assert [shape.kind for shape in base.collision] == [shape.kind for shape in SHAPES]
    assert base.collision[4].values == {"size": (0.2, 0.4, 0.6)}, "an ellipsoid's size are its diameters"
    assert base.visual[0].colour == RED
    weld, hinge = skeleton.joints
    assert (weld.type, weld.parent, weld.child, weld.axis, weld.position) == ("weld", "world", "base", None, None)
    assert (hinge.type, hinge.parent, hinge.position, hinge.velocity) == ("revolute", "base", (0.3,), (-0.1,))
    assert (hinge.axis.xyz, hinge.axis.lower, hinge.axis.upper) == ((0.0, 0.6, 0.8), -1.0, 2.0)
    assert (hinge.axis.friction, hinge.axis.damping) == (0.5, 0.0)
    assert list(unknown_parts(document)) == []


@pytest.mark.parametrize(
    ("what", "by", "said"),
    [
        ("<skel ", "<robot ", "mismatched tag"),
        ('<?xml version="1.0" encoding="utf-8"?>', "<!DOCTYPE a []>", "a document type"),
        ("<time_step>0.001<", "<time_step>soon<", r"world\.skel:5: <time_step>: is 'soon', should be numbers"),
        ("<time_step>0.001<", "<time_step>nan<", "should be finite numbers"),
        ("<gravity>0 0 -9.81<", "<gravity>0 0<", r"world\.skel:6: <gravity>: has 2 numbers, should have 3"),
        ("<mobile>true<", "<mobile>yes<", r"'arm': <mobile> is 'yes', should be true or false"),
        ("<mass>2</mass>", "", "should have a mass, an offset and a whole moment_of_inertia"),
        ("<ixz>-0.02</ixz>", "", "should have a mass"),
        ("<mass>2</mass>", "<mass>2</mass><mass>3</mass>", "has 2 <mass>, should have one"),
        ("<sphere>", "<sphere/><sphere>", "has no single geometry"),
        ("<child>tip</child>", "<child></child>", "has no <child>"),
        (' type="weld"', "", "no attribute 'type'"),
    ],
)
def test_invalid_skel_files_are_rejected_with_file_and_line(tmp_path, what, by, said):
    text = Skel().write(TREE)[WORLD]
    assert what in text
    with pytest.raises(ValueError, match=said):
        _read(tmp_path, text.replace(what, by, 1))


@pytest.mark.parametrize(
    ("what", "by", "said"),
    [
        ("<physics>", "<physics><sub_steps>4</sub_steps>", "<sub_steps>: is not known here in <physics>"),
        ('<body name="tip">', '<body name="tip" type="soft">', "<body> 'tip': the attribute 'type' is not known here"),
        ("<limit>", "<limit><force>1</force>", "<force>: is not known here in <limit>"),
        ("<skeleton ", "<wind>1 0 0</wind><skeleton ", "<wind>: is not known here in <world>"),
    ],
)
def test_unknown_elements_are_kept_and_named(tmp_path, what, by, said):
    document = _read(tmp_path, Skel().write(TREE)[WORLD].replace(what, by, 1))
    (unknown,) = unknown_parts(document)
    assert unknown.startswith("world.skel:")
    assert unknown.endswith(said)


def test_visual_shapes_are_taken_out():
    text = Skel().write(TREE)[WORLD]
    bare, there_were = without_visual_shapes(text)
    assert there_were
    assert "visualization_shape" in text
    assert "visualization_shape" not in bare
    assert without_visual_shapes(bare) == (bare, False)
    assert without_visual_shapes("<skel>") == ("<skel>", False)


def test_unwritable_values_are_an_error():
    with pytest.raises(ValueError, match="nan cannot be written"):
        Skel().write(SkelWorld("x", float("nan"), (0.0, 0.0, 0.0), "ode", ()))
    body = SkelBody("b", Pose(), INERTIAL, (), (SkelShape("cone", (), Pose()),))
    with pytest.raises(KeyError, match="cone"):
        Skel().write(SkelWorld("x", 0.1, (0.0, 0.0, 0.0), "ode", (Skeleton("s", True, (body,), ()),)))
