"""MJCF that others wrote: classes resolved, includes and unknown elements kept in their place, damage refused with its line."""

from __future__ import annotations

import pytest

from simspec.formats.kit.text import parse_xml
from simspec.formats.mjcf import reading
from simspec.formats.mjcf.reading import MjcfDocument, document_of, read_document


def read(text: str) -> MjcfDocument:
    return document_of(parse_xml(text.encode(), "robot.xml"), "robot.xml")


CLASSES = """<mujoco>
  <default>
    <geom friction="0.5" group="1"/>
    <default class="outer">
      <geom friction="0.7"/><joint damping="2"/>
      <default class="inner"><geom rgba="1 0 0 1"/></default>
    </default>
  </default>
  <worldbody>
    <geom name="floor"/>
    <body name="a" childclass="outer">
      <geom name="one"/>
      <geom name="two" class="inner" group="2"/>
      <body name="b">
        <frame childclass="inner"><geom name="three"/><body name="c"><geom name="four"/><joint/></body></frame>
        <geom name="five" class="main"/>
        <freejoint/>
      </body>
    </body>
    <body name="d"><geom name="six"/></body>
  </worldbody>
  <default><geom margin="0.1"/></default>
</mujoco>"""


def test_classes_hold_down_the_tree_until_others_do():
    document = read(CLASSES)
    geoms = {item.text("name"): item for body in document.bodies for item in body.all("geom")}
    geoms |= {item.text("name"): item for item in document.world}
    assert {name: (item.class_name, item.text("friction")) for name, item in geoms.items()} == {
        "floor": ("main", "0.5"),
        "one": ("outer", "0.7"),
        "two": ("inner", "0.7"),
        "three": ("inner", "0.7"),
        "four": ("inner", "0.7"),
        "five": ("main", "0.5"),
        "six": ("main", "0.5"),
    }
    assert all(item.text("margin") == "0.1" for item in geoms.values())
    assert geoms["two"].text("group") == "2"
    assert geoms["two"].stated == {"name": "two", "class": "inner", "group": "2"}
    assert document.bodies[2].all("joint")[0].text("damping") == "2"
    assert not document.bodies[1].all("freejoint")[0].values
    assert document.classes["inner"].parent == "outer"
    assert document.classes["inner"].elements["joint"] == {"damping": "2"}


def test_bodies_know_their_parents_and_the_frames_around_them():
    document = read(CLASSES)
    assert [(body.item.text("name"), body.parent) for body in document.bodies] == [
        ("a", None),
        ("b", 0),
        ("c", 1),
        ("d", None),
    ]
    assert document.bodies[1].item.frame is None
    frame = document.bodies[2].item.frame
    assert frame is not None
    assert (frame.element.tag, frame.outer) == ("frame", None)
    assert [item.frame is not None for item in document.bodies[1].all("geom")] == [True, False]
    assert document.bodies[2].all("geom")[0].frame is None  # in its body, and that in the frame


def test_equal_orientations_in_different_notations_are_read_equal():
    text = '<mujoco><default><geom euler="1 0 0" size="1"/></default><worldbody>{}</worldbody></mujoco>'
    (mjcf_item,) = read(text.format('<geom quat="0 0 0 1"/>')).world
    assert mjcf_item.values == {"quat": "0 0 0 1", "size": "1"}
    (inherited,) = read(text.format("<geom/>")).world
    assert inherited.values == {"euler": "1 0 0", "size": "1"}
    nested = (
        '<mujoco><default><geom quat="1 0 0 0"/><default class="x"><geom euler="1 0 0"/></default></default></mujoco>'
    )
    assert read(nested).classes["x"].elements["geom"] == {"euler": "1 0 0"}


def test_actuators_of_all_kinds_share_the_common_attributes():
    document = read(
        '<mujoco><default><general gear="3" dyntype="filter"/><motor gear="2"/><position kp="5"/></default>'
        '<actuator><motor name="a"/><general/><position kp="7"/><velocity gear="4"/></actuator></mujoco>'
    )
    assert [dict(item.values) for item in document.section("actuator")] == [
        {"gear": "2", "name": "a"},
        {"gear": "2", "dyntype": "filter"},
        {"gear": "2", "kp": "7"},
        {"gear": "4"},
    ]


def test_repeated_sections_are_merged():
    document = read(
        '<mujoco><option timestep="1" cone="elliptic"><flag limit="disable"/></option><contact><exclude body1="a"/></contact>'
        '<option timestep="2"><flag contact="disable"/></option><contact><exclude body1="b"/></contact></mujoco>'
    )
    assert document.option.values == {"timestep": "2", "cone": "elliptic"}
    assert document.flags.values == {"limit": "disable", "contact": "disable"}
    assert [item.text("body1") for item in document.section("contact")] == ["a", "b"]


def test_includes_are_kept_and_never_opened(tmp_path):
    (tmp_path / "other.xml").write_text("<mujoco><compiler angle='degree'/></mujoco>")
    (tmp_path / "robot.xml").write_text(
        "<mujoco>\n<include file='other.xml'/>\n<worldbody>\n<body><include file='../../etc/hostname'/>"
        "<geom class='elsewhere'/></body></worldbody></mujoco>"
    )
    document = read_document(tmp_path / "robot.xml")
    assert [(element.line, element.attributes["file"]) for element in document.includes] == [
        (2, "other.xml"),
        (4, "../../etc/hostname"),
    ]
    assert not document.compiler.values
    assert document.missing_classes == {"elsewhere"}


def test_unknown_elements_are_kept_with_their_line():
    document = read(
        "<mujoco>\n<rocket thrust='9'><stage/></rocket>\n<worldbody>\n<body name='a'>\n<thruster power='3'/>\n<geom mass='1'/>"
        "</body></worldbody>\n<sensor><smell site='nose'/></sensor></mujoco>"
    )
    assert [(element.line, element.tag) for element in document.unknown] == [
        (2, "rocket"),
        (5, "thruster"),
        (7, "smell"),
    ]
    assert document.bodies[0].all("thruster")[0].text("power") == "3"
    assert document.section("rocket")[0].tag == "stage"
    assert document.section("sensor")[0].text("site") == "nose"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot/>", r"robot\.xml:1: the root is <robot>, should be <mujoco>"),
        (
            "<mujoco>\n<worldbody><geom class='none'/></worldbody></mujoco>",
            r"robot\.xml:2: no class of defaults 'none'",
        ),
        ("<mujoco><worldbody>\n<body childclass='none'/></worldbody></mujoco>", r"robot\.xml:2: no class of defaults"),
        ("<mujoco><default>\n<default/></default></mujoco>", r"robot\.xml:2: a class of defaults without a name"),
        (
            "<mujoco><default><default class='a'/>\n<default class='a'/></default></mujoco>",
            r"robot\.xml:2: a second class of defaults 'a'",
        ),
    ],
)
def test_documents_that_are_not_mjcf_are_rejected_with_their_line(text, message):
    with pytest.raises(ValueError, match=message):
        read(text)


def test_attributes_of_the_wrong_type_are_rejected_with_their_location():
    (geom,) = read("<mujoco><worldbody>\n<geom name='g' size='1 b' pos='1 2' mass='nan'/></worldbody></mujoco>").world
    for call, message in (
        (lambda: geom.numbers("size"), "robot.xml:2: <geom> 'g': size is '1 b', should be numbers"),
        (lambda: geom.numbers("pos", 3), "pos has 2 numbers, should have 3"),
        (lambda: geom.number("mass"), "mass is 'nan', should be finite"),
        (lambda: geom.text("quat"), "no attribute 'quat'"),
    ):
        with pytest.raises(ValueError, match=message.replace("(", r"\(")):
            call()


@pytest.mark.parametrize(
    "text",
    [
        '<mujoco><default><geom a="1"/>{}</default></mujoco>'.format(
            "".join(f'<default class="c{number}"><geom b="1" c="2"/>' for number in range(40)) + "</default>" * 40
        ),
        "<mujoco><default>{}</default></mujoco>".format(
            "".join(f"<t{number}/>" for number in range(50))
            + "".join(f'<default class="c{number}"><geom/></default>' for number in range(5))
        ),
        '<mujoco><default><motor gear="1" x="1"/></default><actuator>{}</actuator></mujoco>'.format("<motor/>" * 3),
    ],
)
def test_classes_that_repeat_each_other_are_bounded(monkeypatch, text):
    read(text)
    monkeypatch.setattr(reading, "MOST_DEFAULTS", 4)
    with pytest.raises(ValueError, match="more than 4 attributes together"):
        read(text)


def test_depth_is_no_obstacle():
    count = 5000
    text = "<mujoco><worldbody>" + "<body><frame>" * count + "</frame></body>" * count + "</worldbody></mujoco>"
    bodies = read(text).bodies
    assert [body.parent for body in bodies] == [None, *range(count - 1)]
