"""Defects of a file by name, all at once, each with its place; and what each rule of repair makes of them."""

import pytest

from simspec.imports.urdf.importer import RULES
from simspec.language.load import load
from simspec.language.moments import impossible, principal_moments
from tests.imports.urdf.robots import BALL, DEFECTS, OTHERS, SOLID, inertial, read, refused, two_links


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_defect_is_an_error_at_its_line_that_names_its_repair(tmp_path, defect):
    text, message, line = DEFECTS[defect]
    (problem,) = refused(text, tmp_path)
    assert message in problem
    assert f"robot.urdf:{line}:" in problem
    rule = OTHERS.get(defect, defect)
    assert f"--repair {rule}" in problem


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_repair_is_reported_and_gives_a_spec_that_resolves(tmp_path, defect):
    text, _, line = DEFECTS[defect]
    rule = OTHERS.get(defect, defect)
    imported = read(text, tmp_path, *RULES)
    (repair,) = imported.repairs
    assert (repair.rule, repair.path.startswith("model.bodies")) == (rule, True)
    assert repair.location.line == (1 if rule == "several-roots" else line)
    scenario = f"simspec: 1\nname: s\nmodels: {{r: {{use: robot.urdf, import: {{repair: [{rule}]}}}}}}\n"
    (tmp_path / "s.yaml").write_text(scenario)
    assert load(tmp_path / "s.yaml").resolve().bodies


def test_all_defects_of_a_file_come_at_once(tmp_path):
    text = two_links(
        '<limit lower="2" upper="1"/><axis xyz="0 0 0"/>',
        base=inertial(izz=9),
        arm='<inertial><mass value="x"/></inertial>' + BALL.replace("0.1", "-1"),
        more='<joint name="j" type="planet"><parent link="arm"/><child link="missing"/></joint>',
        kind="revolute",
    )
    problems = refused(text, tmp_path)
    assert [problem.split(":")[1] for problem in problems] == ["2", "3", "3", "4", "5"]


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("1, 2 3", [1, 2, 3]),
        ("1,2,3", [1, 2, 3]),
        ("1 2 3 0", [1, 2, 3]),
        ("1. 2f -3.5.", [1, 2, -3.5]),
        ("1,5 2 3", None),
        ("1,2,3,4", None),
        ("1 2", None),
        ("1 2 nan", None),
        ("1 2 3m", None),
        ("1 2 1e400", None),
        ("1 2 0x10", None),
        ("1 2 \u0661a", None),
    ],
)
def test_damaged_numbers(tmp_path, said, meant):
    text = two_links(f'<origin xyz="{said}"/>')
    (problem,) = refused(text, tmp_path)
    assert "xyz of <origin> should be 3 finite numbers" in problem
    assert ("--repair damaged-numbers" in problem) is (meant is not None)
    if meant is None:
        refused(text, tmp_path, "damaged-numbers")
    else:
        imported = read(text, tmp_path, "damaged-numbers")
        assert imported.data["model"]["bodies"]["arm"]["joint"]["origin"]["xyz"] == meant
        assert f"{said!r} became" in imported.repairs[0].what


def test_numbers_of_other_programs_are_not_judged(tmp_path):
    others = '<sensor name="s"><origin xyz="1, 2, 3"/></sensor>'
    more = '<transmission name="t"><origin xyz="1, 2, 3"/></transmission><gazebo><limit lower="1,"/></gazebo>'
    assert read(two_links(arm=SOLID + others, more=more), tmp_path).data


def test_the_nearest_possible_tensor(tmp_path):
    arm = inertial(ixx=0.3, iyy=0.5, izz=2.0, ixy=0.1, ixz=-0.05, iyz=0.2)
    data = read(two_links(arm=arm), tmp_path, "triangle-inequality").data["model"]["bodies"]["arm"]
    six = [data["inertia"]["tensor"][name] for name in ("xx", "yy", "zz", "xy", "xz", "yz")]
    before = principal_moments((0.3, 0.5, 2.0, 0.1, -0.05, 0.2))
    after = principal_moments(six)
    assert impossible(before)
    assert impossible(after) is None
    excess = (before[2] - before[0] - before[1]) / 3
    expected = (before[0] + excess, before[1] + excess, before[2] - excess)
    assert after == pytest.approx(expected, abs=1e-14)
    # nothing nearer obeys it: a little less of the change breaks it again
    less = [b + 0.99 * (a - b) for a, b in zip(six, (0.3, 0.5, 2.0, 0.1, -0.05, 0.2), strict=True)]
    assert impossible(principal_moments(less))


def test_moments_that_are_not_positive_follow_from_the_shapes_or_are_those_of_a_ball(tmp_path):
    arm = inertial(ixx=0, iyy=0, izz=0)
    data = read(two_links(arm=arm + BALL), tmp_path, "not-positive").data["model"]["bodies"]["arm"]
    assert (data["mass"], "inertia" in data) == (2, False)
    data = read(two_links(arm=arm), tmp_path, "not-positive").data["model"]["bodies"]["arm"]
    radius = (2 / 1000 / 4.18879020478639) ** (1 / 3)
    assert data["inertia"]["principal"] == pytest.approx([0.4 * 2 * radius**2] * 3, rel=1e-12)


def test_no_rule_is_applied_unasked_or_unknown(tmp_path):
    text, _, _ = DEFECTS["triangle-inequality"]
    assert len(refused(text, tmp_path, "not-positive", "massless")) == 1
    assert read(two_links(), tmp_path, *RULES).repairs == []
    with pytest.raises(Exception, match="no rule of repair is called 'everything'"):
        read(two_links(), tmp_path, "everything")


def test_masses_are_judged_with_all_that_is_fixed_to_them(tmp_path):
    """A link without mass, and one of a point mass, that are welded to a real one move with it."""
    weld = '<joint name="w{0}" type="fixed"><parent link="{1}"/><child link="{2}"/></joint>'
    more = '<link name="frame"/><link name="point">' + inertial(ixx=0, iyy=0, izz=0) + "</link>"
    more += weld.format(1, "arm", "frame") + weld.format(2, "frame", "point")
    assert list(read(two_links(more=more), tmp_path).data["model"]["bodies"]) == ["base", "arm", "frame", "point"]
    (problem,) = refused(two_links(arm="", more=more), tmp_path)  # a point mass turns about no axis
    assert "must be above 0" in problem


def test_impossible_masses_without_effect_are_left_out(tmp_path):
    weld = '<joint name="w" type="fixed"><parent link="world"/><child link="base"/></joint><link name="world"/>'
    imported = read(two_links(base=inertial(izz=9), more=weld), tmp_path)
    assert imported.data["model"]["bodies"]["base"] == {"fixed": True}
    (account,) = [account for account in imported.accounts if account.what == "link[base]/inertial/inertia/@izz"]
    assert "fixed to the world" in account.reason


TREES = {
    "the child of two joints": '<joint name="k" type="fixed"><parent link="base"/><child link="arm"/></joint>',
    "two links are called 'arm'": f'<link name="arm">{SOLID}</link>',
    "two joints are called 'hinge'": (
        f'<link name="tip">{SOLID}</link><joint name="hinge" type="fixed"><parent link="arm"/><child link="tip"/></joint>'
    ),
    "there is no link 'missing'": '<joint name="k" type="fixed"><parent link="missing"/><child link="base"/></joint>',
    "each other's parents": '<joint name="k" type="fixed"><parent link="arm"/><child link="base"/></joint>',
    "<joint> has no <child>": '<joint name="k" type="fixed"><parent link="arm"/></joint>',
    "has no attribute 'name'": "<link/>",
}


@pytest.mark.parametrize("message", TREES)
def test_links_and_joints_that_form_no_tree(tmp_path, message):
    problems = refused(two_links(more=TREES[message]), tmp_path)
    assert any(message in problem for problem in problems), problems


def test_a_program_is_refused_where_nothing_expands_it(tmp_path):
    left = '<origin xyz="$(optenv IMU_XYZ 0.19 0 0.149)"/>'
    for inside in ('<xacro:include filename="a.xacro"/>', '<link name="${prefix}a"/>', left):
        (problem,) = refused(f'<robot name="r" xmlns:xacro="http://wiki.ros.org/xacro">\n{inside}</robot>', tmp_path)
        assert "unexpanded xacro" in problem
        assert "robot.urdf:2" in problem
    commented = "<!-- <xacro:macro/> ${x} -->\n" + two_links()
    assert read(commented, tmp_path).data
