"""Millimetres: warned of, and metres by the rule."""

import pytest

from simspec.imports.urdf.masses import MILLIMETRES
from simspec.language.load import load
from tests.imports.urdf.robots import read, two_links
from tests.meshes.solids import box, stl

BOX = '<collision><geometry><box size="0.1 0.2 0.4"/></geometry></collision>'
NEXT = '<origin xyz="0 0 0.4"/><axis xyz="1 0 0"/>'


def inertial(factor: float = 1.0, mass: float = 2.0) -> str:
    moments = " ".join(
        f'i{name}="{mass * value * factor!r}"' for name, value in (("xx", 0.02), ("yy", 0.02), ("zz", 0.01))
    )
    return f'<inertial><mass value="{mass}"/><inertia {moments}/></inertial>'


def mesh(name: str, scale: str = "1 1 1") -> str:
    return f'<collision><geometry><mesh filename="{name}.stl" scale="{scale}"/></geometry></collision>'


@pytest.mark.parametrize(("factor", "unit"), [(1e6, "kg mm²"), (1e9, "g mm²")])
def test_moments_of_inertia(tmp_path, factor, unit):
    text = two_links(NEXT, base=inertial() + BOX, arm=inertial(factor) + BOX)
    imported = read(text, tmp_path)
    (problem,) = imported.suspicious
    assert f"in {unit}?" in problem.message
    assert f"--repair {MILLIMETRES}" in (problem.hint or "")
    assert problem.location is not None
    assert problem.location.line == 3
    spec = load(tmp_path / "robot.urdf")
    assert any(unit in warning.message for warning in spec.warnings())
    repaired = read(text, tmp_path, MILLIMETRES)
    assert repaired.data["model"]["bodies"]["arm"]["inertia"]["principal"] == pytest.approx(
        [0.04, 0.04, 0.02], rel=1e-14
    )
    assert (
        repaired.data["model"]["bodies"]["base"]["inertia"]
        == read(text, tmp_path).data["model"]["bodies"]["base"]["inertia"]
    )
    assert [(repair.rule, repair.location.line) for repair in repaired.repairs] == [(MILLIMETRES, 3)]
    assert not repaired.suspicious


def test_where_most_moments_are_so_all_are(tmp_path):
    more = f'<link name="tip">{inertial(1e6, 1e-4)}</link><joint name="t" type="continuous"><parent link="arm"/>'
    more += '<child link="tip"/></joint>'
    text = two_links(NEXT, base=inertial(1e6) + BOX, arm=inertial(1e6) + BOX, more=more)
    assert "(and 2 more links)" in read(text, tmp_path).suspicious[0].message
    bodies = read(text, tmp_path, MILLIMETRES).data["model"]["bodies"]
    assert bodies["tip"]["inertia"]["principal"] == pytest.approx([2e-6, 2e-6, 1e-6], rel=1e-14)


@pytest.mark.parametrize(
    "arm",
    [
        inertial(),
        inertial(50) + BOX,
        '<inertial><mass value="0.001"/><inertia ixx="0.001" iyy="0.001" izz="0.001"/></inertial>',
    ],
    ids=["a link", "a large one", "moments that are made up"],
)
def test_values_that_may_be_meant_are_left_alone(tmp_path, arm):
    text = two_links(NEXT, arm=arm)
    assert not read(text, tmp_path).suspicious
    assert read(text, tmp_path, MILLIMETRES).data == read(text, tmp_path).data


def test_meshes(tmp_path):
    (tmp_path / "large.stl").write_bytes(stl(*box(100.0, 200.0, 400.0)))
    (tmp_path / "small.stl").write_bytes(stl(*box(4.0, 4.0, 4.0)))
    (tmp_path / "metres.stl").write_bytes(stl(*box(0.1, 0.2, 0.4)))
    shapes = mesh("large") + mesh("small") + mesh("metres", "1 1 2") + mesh("large", "0.001 0.001 0.001")
    text = two_links(NEXT, arm=inertial() + shapes)
    imported = read(text, tmp_path)
    (problem,) = imported.suspicious
    assert "a mesh is many times larger" in problem.message
    scales = [
        shape["mesh"].get("scale")
        for shape in read(text, tmp_path, MILLIMETRES).data["model"]["bodies"]["arm"]["shapes"]
    ]
    assert scales == [0.001, 0.001, [1, 1, 2], 0.001]
    ground = f'<robot name="g"><link name="ground">{mesh("large")}</link></robot>'
    assert not read(ground, tmp_path).suspicious


def test_a_whole_robot(tmp_path):
    joint = '<origin xyz="0 0 400"/><axis xyz="1 0 0"/><limit lower="-50" upper="100" velocity="20"/>'
    links = inertial(1e6).replace("<mass", '<origin xyz="0 0 200"/><mass') + BOX.replace("0.1 0.2 0.4", "100 200 400")
    text = two_links(joint, base=links, arm=links, kind="prismatic")
    (problem,) = read(text, tmp_path).suspicious
    assert "lengths in millimetres" in problem.message
    arm = read(text, tmp_path, MILLIMETRES).data["model"]["bodies"]["arm"]
    assert arm["centre_of_mass"] == [0, 0, 0.2]
    assert arm["inertia"]["principal"] == pytest.approx([0.04, 0.04, 0.02], rel=1e-14)
    assert arm["shapes"][0]["box"]["size"] == [0.1, 0.2, 0.4]
    assert (arm["joint"]["origin"], arm["joint"]["limits"]) == (
        {"xyz": [0, 0, 0.4]},
        {"position": [-0.05, 0.1], "velocity": 0.02},
    )
    turning = read(text.replace("prismatic", "revolute"), tmp_path, MILLIMETRES).data["model"]["bodies"]["arm"]
    assert turning["joint"]["limits"]["velocity"] == 20
