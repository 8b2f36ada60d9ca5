"""Gearboxes: two hinges on one reference body, of which the one follows the other."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.language.load import load
from tests.imports.sdf.texts import imported, model

INERTIAL = "<inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>"
LINK = '<link name="{}"><pose>{}</pose>' + INERTIAL + "</link>"
HINGE = '<joint name="{}" type="revolute"><parent>{}</parent><child>{}</child><axis><xyz>{}</xyz></axis></joint>'
BOX = """<joint name="gears" type="gearbox"><parent>rotor</parent><child>arm</child>{}
<gearbox_reference_body>base</gearbox_reference_body><axis><xyz{}>0 0 1</xyz></axis><axis2><xyz{}>0 0 {}</xyz></axis2>
</joint>"""
FRAME = ' expressed_in="__model__"'


RATIO = "<gearbox_ratio>0.04</gearbox_ratio>"


def geared(first="0 0 1", second="0 0 1", turn="0 0 0 0 0 0", ratio=RATIO, other=1, ends=("base", "arm")):
    links = LINK.format("base", "0 0 0 0 0 0") + LINK.format("rotor", "0 0 1 0 0 0") + LINK.format("arm", turn)
    hinges = HINGE.format("spin", "base", "rotor", first) + HINGE.format("swing", *ends, second)
    return model(links + hinges + "\n" + BOX.format(ratio, FRAME, FRAME, other), version="1.7")


@pytest.mark.parametrize(
    ("given", "ratio"),
    [
        ({}, -0.04),
        ({"ratio": ""}, -1.0),
        ({"first": "0 0 -1"}, 0.04),
        ({"first": "0 0 -2", "second": "0 0 -1"}, -0.04),
        ({"other": -1}, 0.04),
        ({"turn": "0 0 1 0 1.5707963267948966 0", "second": "-1 0 0"}, -0.04),
        ({"ends": ("arm", "base")}, 0.04),
    ],
)
def test_the_child_turns_against_the_parent(given, ratio, tmp_path):
    read = imported(geared(**given), tmp_path)
    (actual,) = read.data["model"]["constraints"].values()
    assert (actual["follow"]["joint"], actual["follow"]["leader"]) == ("swing", "spin")
    assert actual["follow"].get("ratio", 1.0) == pytest.approx(ratio)
    world = load(tmp_path / "robot.sdf").resolve()
    assert len(world.constraints) == 1


def test_a_joint_with_limits_leads_a_joint_without(tmp_path):
    limits = '<limit><lower>-2</lower><upper>-0.5</upper></limit></axis></joint>\n<joint name="gears"'
    text = geared().replace('</axis></joint>\n<joint name="gears"', limits)
    (actual,) = imported(text, tmp_path).data["model"]["constraints"].values()
    assert actual["follow"] == {"joint": "spin", "leader": "swing", "ratio": pytest.approx(-25)}
    assert len(load(tmp_path / "robot.sdf").resolve().constraints) == 1


@pytest.mark.parametrize(
    ("given", "passed"),
    [
        ({"second": "1 0 0"}, "the axis of a gearbox is that of the joint 'swing'"),
        ({"ends": ("rotor", "arm")}, "no hinge joins the reference body of the gearbox and its child"),
        ({"ratio": "<gearbox_ratio>0</gearbox_ratio>"}, "couples nothing"),
    ],
)
def test_gearboxes_without_two_hinges_are_refused(given, passed, tmp_path):
    with pytest.raises(SpecError, match=passed):
        imported(geared(**given), tmp_path)
