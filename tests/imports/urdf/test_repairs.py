"""`--repair all`, and masses by a density: the changes by the rules, by closed forms, and that nothing else changes."""

import math
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from simspec.errors import SpecError
from simspec.imports.draft import FROM_SHAPES
from simspec.imports.mjcf.importer import MjcfImporter
from simspec.imports.writing import spec_text
from simspec.language.foreign import ImportOptions, RequestedRepairs
from simspec.language.load import load
from tests.imports.urdf.robots import BALL, DEFECTS, OTHERS, SOLID, inertial, read, refused, two_links
from tests.meshes.solids import box, stl

SIZES = {
    "box": ('box size="{0} {1} {2}"', lambda a, b, c: a * b * c, lambda a, b, c: (b * b + c * c) / 12),
    "sphere": ('sphere radius="{0}"', lambda a, b, c: 4 / 3 * math.pi * a**3, lambda a, b, c: 0.4 * a * a),
    "cylinder": (
        'cylinder radius="{0}" length="{1}"',
        lambda a, b, c: math.pi * a * a * b,
        lambda a, b, c: (3 * a * a + b * b) / 12,
    ),
    "ellipsoid": (
        'ellipsoid a="{0}" b="{1}" c="{2}"',
        lambda a, b, c: 4 / 3 * math.pi * a * b * c,
        lambda a, b, c: (b * b + c * c) / 5,
    ),
}
"""Shapes as URDF says them, with the volume and Ixx / m of their lengths."""
LENGTH = st.floats(0.01, 1.0, allow_subnormal=False)


def shape(kind: str, tag: str = "collision", origin: str = "") -> str:
    return f"<{tag}>{origin}<geometry><{kind}/></geometry></{tag}>"


def inertial_of(folder, name="arm"):
    spec = load(folder / "robot.urdf", options=ImportOptions(repair=("all",)))
    return next(body.inertial for body in spec.resolve().bodies if body.name == name)


# --- masses from shapes ---------------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(kind=st.sampled_from(sorted(SIZES)), a=LENGTH, b=LENGTH, c=LENGTH, density=st.floats(1.0, 2e4))
def test_masses_follow_from_shapes_by_closed_forms(tmp_path, kind, a, b, c, density):
    words, volume, gyration = SIZES[kind]
    arm = shape(words.format(a, b, c), origin='<origin xyz="0.1 -0.2 0.3"/>')
    imported = read(two_links(arm=arm), tmp_path, f"{FROM_SHAPES}={density} kg/m^3")
    (repair,) = imported.repairs
    assert (repair.rule, repair.location.line, repair.path) == (FROM_SHAPES, 3, "model.bodies.arm.shapes")
    (tmp_path / "spec.yaml").write_text(spec_text(imported, "robot.urdf"))
    inertial = next(body.inertial for body in load(tmp_path / "spec.yaml").resolve().bodies if body.name == "arm")
    assert inertial.mass == pytest.approx(density * volume(a, b, c), rel=1e-12)
    assert f"{inertial.mass:.6g} kg" in repair.what
    assert inertial.inertia[0] == pytest.approx(inertial.mass * gyration(a, b, c), rel=1e-12)
    assert inertial.centre_of_mass == pytest.approx((0.1, -0.2, 0.3))


def test_two_shapes_add_up_and_collision_shapes_go_before_visual_shapes(tmp_path):
    arm = BALL + shape('box size="0.1 0.1 0.2"', origin='<origin xyz="0 0 1"/>') + shape('box size="9 9 9"', "visual")
    read(two_links(arm=arm), tmp_path, "all")
    inertial = inertial_of(tmp_path)
    ball, cuboid = 4 / 3 * math.pi, 2.0
    assert inertial.mass == pytest.approx(ball + cuboid)
    assert inertial.centre_of_mass[2] == pytest.approx(cuboid / (ball + cuboid))
    lever = ball * cuboid / (ball + cuboid)
    assert inertial.inertia[0] == pytest.approx(0.4 * ball * 0.01 + cuboid * (0.01 + 0.04) / 12 + lever)


def test_visual_shapes_stand_for_collision_shapes_that_are_not_there_and_it_is_said(tmp_path):
    arm = shape('box size="0.1 0.2 0.5"', "visual")
    (repair,) = read(two_links(arm=arm), tmp_path, "all").repairs
    assert "1 visual shape of 1000 kg/m³ (no collision shape has a volume)" in repair.what
    assert inertial_of(tmp_path).mass == pytest.approx(10.0)


def test_a_closed_mesh_is_filled_and_the_hull_of_an_open_mesh_which_is_said(tmp_path):
    points, faces = box(0.1, 0.2, 0.3)
    (tmp_path / "closed.stl").write_bytes(stl(points, faces))
    (tmp_path / "open.stl").write_bytes(stl(points, faces[:-1]))
    for name, said in (("closed", False), ("open", True)):
        (repair,) = read(two_links(arm=shape(f'mesh filename="{name}.stl"')), tmp_path, "all").repairs
        assert ("not closed: the hull is filled" in repair.what) is said
        inertial = inertial_of(tmp_path)
        assert inertial.mass == pytest.approx(6.0, rel=1e-6)
        assert inertial.inertia[:3] == pytest.approx(6.0 / 12 * np.array([0.13, 0.10, 0.05]), rel=1e-6)


@pytest.mark.parametrize("said", ["", inertial('<mass value="0"/>'), inertial('<mass value="-2"/>'), inertial("")])
def test_missing_zero_and_negative_masses_are_given(tmp_path, said):
    imported = read(two_links(arm=said + BALL), tmp_path, FROM_SHAPES)
    (repair,) = imported.repairs
    assert ("-2 kg became" in repair.what) is ("-2" in said)
    assert inertial_of(tmp_path).mass == pytest.approx(4 / 3 * math.pi)


def test_links_welded_to_a_mass_or_at_rest_get_none(tmp_path):
    weld = f'<link name="cover">{BALL}</link><joint name="w" type="fixed"><parent link="arm"/><child link="cover"/></joint>'
    assert read(two_links(more=weld), tmp_path, "all").repairs == []
    imported = read(two_links(base=BALL), tmp_path, "all")  # a root without mass is fixed
    assert imported.repairs == []
    assert imported.data["model"]["bodies"]["base"]["fixed"] is True


def test_links_that_are_welded_to_each_other_and_have_no_mass_all_get_theirs(tmp_path):
    weld = f'<link name="cover">{BALL}</link><joint name="w" type="fixed"><parent link="arm"/><child link="cover"/></joint>'
    imported = read(two_links(arm=BALL, more=weld), tmp_path, "all")
    assert [repair.path for repair in imported.repairs] == ["model.bodies.arm.shapes", "model.bodies.cover.shapes"]


def test_masses_go_before_statues_and_the_rule_of_statues_alone_makes_a_statue(tmp_path):
    text = two_links(arm=BALL)
    (problem,) = refused(text, tmp_path)
    assert f"--repair {FROM_SHAPES}: " in problem
    assert [repair.rule for repair in read(text, tmp_path, "massless").repairs] == ["massless"]
    assert [repair.rule for repair in read(text, tmp_path, "massless", FROM_SHAPES).repairs] == [FROM_SHAPES]
    assert [repair.rule for repair in read(two_links(arm=""), tmp_path, "all").repairs] == ["massless"]


def test_an_arm_without_inertials_moves(tmp_path):
    more = f'<link name="hand">{BALL}</link><joint name="w" type="continuous"><parent link="arm"/><child link="hand"/></joint>'
    read(two_links(base=BALL, arm=BALL, more=more), tmp_path, "all")
    world = load(tmp_path / "robot.urdf", options=ImportOptions(repair=("all",))).resolve()
    assert [body.joint.kind for body in world.bodies] == ["fixed", "hinge", "hinge"]


# --- all ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("defect", DEFECTS)
def test_all_applies_what_the_file_needs_and_lists_exactly_that(tmp_path, defect):
    text, _, _ = DEFECTS[defect]
    expected = read(text, tmp_path, OTHERS.get(defect, defect))
    imported = read(text, tmp_path, "all")
    assert imported.data == expected.data
    assert imported.repairs == expected.repairs
    assert len(imported.repairs) == 1


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.permutations(["limits", "tensor", "mimic", "shape", "numbers"]), st.integers(0, 5))
def test_several_defects_are_all_repaired_and_all_listed(tmp_path, order, count):
    chosen = set(order[:count])
    joint = '<limit lower="2" upper="1"/>' if "limits" in chosen else '<limit lower="1" upper="2"/>'
    joint += '<mimic joint="missing"/>' if "mimic" in chosen else ""
    joint += '<origin xyz="1, 2 3"/>' if "numbers" in chosen else ""
    arm = inertial(izz=3) if "tensor" in chosen else SOLID
    arm += BALL.replace("0.1", "0") if "shape" in chosen else ""
    rules = {
        "limits": "turned-limits",
        "tensor": "triangle-inequality",
        "mimic": "missing-leaders",
        "shape": "empty-shapes",
        "numbers": "damaged-numbers",
    }
    imported = read(two_links(joint, arm=arm, kind="revolute"), tmp_path, "all")
    assert sorted(repair.rule for repair in imported.repairs) == sorted(rules[entry] for entry in chosen)
    assert imported.data == read(two_links(joint, arm=arm, kind="revolute"), tmp_path, *rules.values()).data
    written = spec_text(imported, "robot.urdf")
    assert sorted(re.findall(r"# repaired \(([a-z-]+)\):", written)) == sorted(rules[entry] for entry in chosen)


def test_a_good_file_is_the_same_with_all(tmp_path):
    assert read(two_links(), tmp_path, "all").data == read(two_links(), tmp_path).data
    assert read(two_links(), tmp_path, "all").repairs == []


def test_a_repair_that_another_replaces_is_not_listed(tmp_path):
    imported = read(two_links(base=SOLID, arm="", kind="revolute"), tmp_path, "all")
    assert [repair.rule for repair in imported.repairs] == ["massless"]


def test_defects_without_a_rule_stay_refused(tmp_path):
    assert "an axis of length 0" in refused(two_links('<axis xyz="0 0 0"/>'), tmp_path, "all")[0]


@pytest.mark.parametrize("path", ["package://nowhere/a.stl", "gone.stl"])
def test_meshes_of_missing_packages_are_left_out_and_listed(path, tmp_path):
    """Also with ``all``: each mesh is a repair of its own, and names the package."""
    text = two_links(arm=SOLID + shape(f'mesh filename="{path}"'))
    assert "not found" in refused(text, tmp_path)[0] or "no such file" in refused(text, tmp_path)[0]
    for rules in ("all", "missing-meshes"):
        (repair,) = read(text, tmp_path, rules).repairs
        assert repair.rule == "missing-meshes"
        assert ("the package 'nowhere' is not found" if "nowhere" in path else "gone.stl") in repair.what


def test_the_comment_of_a_repaired_joint_stands_at_a_body_of_another_name(tmp_path):
    text = two_links('<limit lower="2" upper="1"/>', kind="prismatic").replace('"arm"', '"upper.arm"')
    (repair,) = read(text, tmp_path, "all").repairs
    assert repair.path == "model.bodies.upper_arm.joint.limits"


# --- words ----------------------------------------------------------------------------------------------------------


def test_a_spec_says_all_as_a_word_or_a_list(tmp_path):
    (tmp_path / "robot.urdf").write_text(two_links(arm=inertial(izz=3)))
    for word in ("all", "[all]", "[triangle-inequality]"):
        scenario = f"simspec: 1\nname: s\nmodels: {{r: {{use: robot.urdf, import: {{repair: {word}}}}}}}\n"
        (tmp_path / "s.yaml").write_text(scenario)
        assert load(tmp_path / "s.yaml").resolve().bodies


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("everything",), "no rule of repair is called 'everything'"),
        (("massless=2",), "the rule massless takes no value"),
        ((f"{FROM_SHAPES}=1", f"{FROM_SHAPES}=2"), "is given two values"),
        ((f"{FROM_SHAPES}=heavy",), f"the density of {FROM_SHAPES}"),
        ((f"{FROM_SHAPES}=0",), f"the density of {FROM_SHAPES}: must be above 0"),
        ((f"{FROM_SHAPES}=3 kg",), f"the density of {FROM_SHAPES}"),
        ((f"{FROM_SHAPES}=\u0661\u0662",), f"the density of {FROM_SHAPES}"),
    ],
)
def test_wrong_words_are_named(tmp_path, words, message):
    with pytest.raises(SpecError) as error:
        read(two_links(), tmp_path, *words)
    assert message in str(error.value)


def test_values_of_the_command_line_go_before_those_of_a_spec():
    options = ImportOptions(repair=("massless", f"{FROM_SHAPES}=1"))
    both = options.together(ImportOptions(repair=(f"{FROM_SHAPES}=2", "all"))).repairs
    assert (both.value(FROM_SHAPES), "massless" in both, both.is_named("several-roots")) == ("2", True, False)
    assert RequestedRepairs().value(FROM_SHAPES) is None
    assert "massless" not in RequestedRepairs()


def test_a_language_without_rules_takes_all_and_no_rule(tmp_path):
    path = tmp_path / "m.xml"
    path.write_text('<mujoco><worldbody><body><geom size="1"/></body></worldbody></mujoco>')
    assert MjcfImporter().read(path, "m.xml", ImportOptions(repair=("all",))).repairs == []
    with pytest.raises(SpecError, match="no rule of repair is called 'massless'"):
        MjcfImporter().read(path, "m.xml", ImportOptions(repair=("massless",)))


# --- what is no loss of physics ---------------------------------------------------------------------------------------

GOOD = """<robot name="good" xmlns:drake="http://drake.mit.edu">
<mujoco><compiler balanceinertia="true" discardvisual="false" meshdir="m"/><extension/></mujoco>
<link name="base">{solid}
 <visual><origin xyz="0 0 1"/><origin xyz="0 0 1"/><geometry><box size="1 1 1"/></geometry>
  <material name="a"><color rgba="1 0 0 1"/></material><material name="b"/><shiny much="1"/></visual>
 <collision><geometry><box size="1 1 1"/></geometry><contact/><surface/><verbose value="2"/></collision>
 <contact/><extension/></link>
<link name="arm">{solid}</link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/><axis xyz="0 0 1"/>
 <limit lower="-1" upper="1" effort="1" velocity="1"/><dynamics damping="0" friction="0"/><dynamics/>
 <safety_controller k_velocity="1"/><hardwareInterface>x</hardwareInterface></joint>
<transmission/><transmission name="t"><type>x</type><joint name="j"/><hardwareInterface>x</hardwareInterface></transmission>
<gazebo/><gazebo reference="base"/><gazebo><plugin name="p" filename="f"/><static>false</static></gazebo>
<gazebo reference="arm"><extension/><selfCollide>true</selfCollide><dampingFactor>0</dampingFactor><sensor/></gazebo>
<extension/></robot>"""


def test_good_files_lose_no_physics(tmp_path):
    imported = read(GOOD.format(solid=SOLID), tmp_path)
    assert [loss.what for loss in imported.losses() if loss.severity.value == "physics"] == []
    assert "contact" not in imported.data


@pytest.mark.parametrize(
    ("before", "after", "what"),
    [
        ('<axis xyz="0 0 1"/><axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><axis xyz="0 1 0"/>', "joint[j]/axis"),
        ("<static>false</static>", "<static>true</static>", "gazebo/static"),
        ('filename="f"', 'filename="libmimic_joint.so"', "gazebo/plugin"),
        ("<dampingFactor>0</dampingFactor>", "<dampingFactor>1</dampingFactor>", "gazebo[arm]/dampingFactor"),
        ("<contact/><surface/>", '<contact harder="1"/><surface/>', "link[base]/collision/contact"),
        ('balanceinertia="true"', 'settotalmass="3"', "mujoco/compiler/@settotalmass"),
    ],
)
def test_differences_are_losses_of_physics(tmp_path, before, after, what):
    text = GOOD.format(solid=SOLID)
    assert before in text
    imported = read(text.replace(before, after), tmp_path)
    lost = [loss.what for loss in imported.losses() if loss.severity.value == "physics"]
    assert len(lost) == 1
    assert lost[0].startswith(what.replace("gazebo[arm]", "gazebo"))


def test_the_inertia_of_a_rotor_is_that_of_the_joint(tmp_path):
    actuator = '<actuator name="m"><drake:rotor_inertia value="2e-5"/><drake:gear_ratio value="-50"/></actuator>'
    more = f'<transmission name="t"><joint name="hinge"/>{actuator}</transmission>'
    joint = read(two_links(more=more), tmp_path).data["model"]["bodies"]["arm"]["joint"]
    assert joint["armature"] == pytest.approx(2e-5 * 2500)
