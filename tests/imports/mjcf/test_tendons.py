"""Fixed tendons as what joints say: couplings, and limits of joints."""

from __future__ import annotations

import struct

import pytest

from simspec.imports.mjcf import comparison
from simspec.imports.mjcf.compiled import FEATURES
from simspec.language.foreign import ImportOptions
from simspec.language.load import load
from tests.imports.mjcf.models import lost, read, written

pytestmark = pytest.mark.usefixtures("warm_readers")

MODEL = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9"/><worldbody><body name="base"><geom size=".1" mass="1"/>
<body name="one" pos="0 0 1"><joint name="a" axis="0 1 0" ref=".1" range="-1 1.1"/><geom size=".1" pos="1 0 0"/></body>
<body name="two" pos="0 1 1"><joint name="b" axis="0 1 0" range="-1 1"/><geom size=".1" pos="1 0 0"/></body>
<body name="three" pos="0 2 1"><joint name="c" axis="0 1 0"/><geom size=".1" pos="1 0 0"/></body>
</body></worldbody><tendon>{}</tendon><equality>{}</equality></mujoco>"""
SUM = '<fixed name="{}" {}><joint joint="{}" coef="{}"/><joint joint="{}" coef="{}"/></fixed>'


def follows(imported):
    return [actual["follow"] for actual in imported.data["model"].get("constraints", {}).values()]


def test_a_sum_of_two_joints_that_is_kept_is_a_coupling(tmp_path):
    """Springs along it, and limits that it keeps, act on nothing."""
    tendons = SUM.format("s", 'stiffness="3" damping="1" range="-1 1"', "a", 0.5, "b", 0.25)
    path = written(tmp_path, MODEL.format(tendons, '<tendon tendon1="s" polycoef=".1 0 0 0 0"/>'))
    deviations, imported = comparison.deviations(path, ImportOptions())
    assert deviations.worst < 1e-9
    assert not lost(imported)
    assert follows(imported) == [{"joint": "a", "leader": "b", "ratio": -0.5, "offset": 0.2}]
    assert load(path).resolve().bodies[1].joint.position == (0.2,)


def test_two_tendons_of_a_joint_each_are_a_coupling(tmp_path):
    tendons = '<fixed name="s"><joint joint="a" coef="2"/></fixed><fixed name="t"><joint joint="c" coef="4"/></fixed>'
    imported = read(written(tmp_path, MODEL.format(tendons, '<tendon tendon1="s" tendon2="t" polycoef="0 3 0 0 0"/>')))
    assert follows(imported) == [{"joint": "a", "leader": "c", "ratio": 6}]
    assert not lost(imported)


def test_joints_that_follow_already_lead(tmp_path):
    tendons = "".join(SUM.format(name, "", *joints) for name, *joints in (("s", "a", 1, "b", 1), ("t", "a", 1, "c", 1)))
    text = '<tendon tendon1="s"/><tendon tendon1="t"/>'
    imported = read(written(tmp_path, MODEL.format(tendons, text)))
    assert [(follow["joint"], follow["leader"]) for follow in follows(imported)] == [("a", "b"), ("c", "a")]
    again = tendons + SUM.format("u", "", "b", 1, "c", 1)
    (entry,) = lost(read(written(tmp_path, MODEL.format(again, text + '<tendon tendon1="u"/>'))))
    assert entry.reason == FEATURES["equality"].reason


def test_limits_of_a_tendon_are_those_of_its_joint(tmp_path):
    name = '<fixed range="{} {}"><joint joint="{}" coef="{}"/></fixed>'
    tendons = name.format(-0.3, 0.5, "a", -0.5) + name.format(0, 9, "b", 9)
    imported = read(written(tmp_path, MODEL.format(tendons, "")))
    bodies = imported.data["model"]["bodies"]
    assert not lost(imported)
    assert bodies["one"]["joint"]["limits"]["position"] == pytest.approx([-1.1, 0.5])
    assert bodies["two"]["joint"]["limits"]["position"] == [0, 1]


@pytest.mark.parametrize(
    ("limits", "kept"), [("-2 2.1", True), ("-1.9 2.1", False), ("-2 2", False)], ids=["kept", "lower", "upper"]
)
def test_limits_that_joints_do_not_keep_are_those_of_a_sum(tmp_path, limits, kept):
    imported = read(written(tmp_path, MODEL.format(SUM.format("s", f'range="{limits}"', "a", 1, "b", 1), "")))
    assert not lost(imported)
    lower, upper = (float(end) - 0.1 for end in limits.split())
    sums = {} if kept else {"s": {"sum": {"joints": {"a": 1, "b": 1}, "limits": {"position": [lower, upper]}}}}
    assert imported.data["model"].get("constraints", {}) == sums


def test_springs_and_dampers_of_tendons_are_those_of_sums(tmp_path):
    """The reference of a is 0.1: where it is in the file, the sum is 0.2 there, and 0 in the spec."""
    tendons = SUM.format("s", 'stiffness="3" damping="0.2" springlength="0.5"', "a", 2, "c", -1)
    tendons += '<fixed name="t" damping="1"><joint joint="c" coef="1"/></fixed>'
    path = written(tmp_path, MODEL.format(tendons, ""))
    deviations, imported = comparison.deviations(path, ImportOptions())
    assert deviations.worst < 1e-9
    assert not lost(imported)
    assert imported.data["model"]["constraints"] == {
        "s": {"sum": {"joints": {"a": 2, "c": -1}, "stiffness": 3, "rest": pytest.approx(0.3), "damping": 0.2}},
        "t": {"sum": {"joints": {"c": 1}, "damping": 1}},
    }


@pytest.mark.parametrize(
    "said",
    ['stiffness="3" springlength="0.1 0.2"', 'armature="1"', 'range="1 2"', 'stiffness="3 1"'],
    ids=["slack", "inertia", "begins beyond", "not linear"],
)
def test_losses_of_sums_are_reported(tmp_path, said):
    (entry,) = lost(read(written(tmp_path, MODEL.format(SUM.format("s", said, "a", 1, "c", 1), ""))))
    assert entry.reason == FEATURES["tendon"].reason


def test_a_timestep_at_which_a_tendon_diverges_is_shortened(tmp_path):
    tendons = SUM.format("s", 'damping="3e5"', "a", 1, "c", 1)
    imported = read(written(tmp_path, MODEL.format(tendons, "")))
    assert imported.data["physics"]["timestep"] < 0.002
    load(written(tmp_path, MODEL.format(tendons, ""))).resolve()


def test_a_mesh_in_the_format_of_the_engine_is_read(tmp_path):
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    flat = [number for point in points for number in point]
    content = struct.pack("<4i12f", 4, 0, 0, 4, *flat) + struct.pack("<12i", *(n for face in faces for n in face))
    (tmp_path / "corner.msh").write_bytes(content)
    body = '<body><freejoint/><geom type="mesh" mesh="corner"/></body>'
    assets = '<asset><mesh file="corner.msh"/></asset>'
    path = written(tmp_path, f"<mujoco>{assets}<worldbody>{body}</worldbody></mujoco>")
    assert comparison.deviations(path, ImportOptions())[0].worst < 1e-9
    (shape,) = load(path).resolve().bodies[0].shapes
    assert (shape.kind, len(shape.size)) == ("mesh", 12)


def test_a_spring_along_the_first_of_two_coupled_tendons_acts(tmp_path):
    """It is kept at the other tendon's value, which moves; also where the other is the file's first."""
    tendons = '<fixed name="s"><joint joint="a" coef="2"/></fixed>'
    tendons += '<fixed name="t" stiffness="3"><joint joint="c" coef="4"/></fixed>'
    path = written(tmp_path, MODEL.format(tendons, '<tendon tendon1="t" tendon2="s"/>'))
    deviations, imported = comparison.deviations(path, ImportOptions())
    assert deviations.worst < 1e-9
    assert not lost(imported)
    (sum_,) = [entry["sum"] for entry in imported.data["model"]["constraints"].values() if "sum" in entry]
    assert (sum_["joints"], sum_["stiffness"]) == ({"c": 4}, 3)
