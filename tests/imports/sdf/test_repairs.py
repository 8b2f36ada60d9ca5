"""Rules of repair of SDF that give masses and moments: by closed forms, where they are needed, and nowhere else."""

import math

import pytest

from simspec.errors import SpecError
from simspec.imports.draft import FROM_SHAPES
from simspec.language.foreign import ImportOptions
from simspec.language.load import load
from tests.meshes.solids import box, stl

UNIT = "<inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>"
BALL = '<collision name="c"><geometry><sphere><radius>0.1</radius></sphere></geometry></collision>'
SEEN = '<visual name="v"><geometry><box><size>0.1 0.2 0.5</size></box></geometry></visual>'


def inertial(mass, *moments):
    said = "".join(f"<{name}>{value}</{name}>" for name, value in zip(("ixx", "iyy", "izz"), moments, strict=False))
    return f"<inertial><mass>{mass}</mass><inertia>{said}</inertia></inertial>"


def imported(folder, arm, *repair, more="", kind="revolute", base=UNIT):
    path = folder / "m.sdf"
    path.write_text(
        f'<sdf version="1.9"><model name="m">\n<link name="base">{base}</link>\n<link name="arm">{arm}</link>\n'
        f'<joint name="j" type="{kind}"><parent>base</parent><child>arm</child><axis><xyz>0 0 1</xyz></axis></joint>\n'
        f"{more}</model></sdf>"
    )
    spec = load(path, options=ImportOptions(repair=repair))
    body = next(body for body in spec.resolve().bodies if body.name == "arm")
    return spec.source.imported.repairs, body.inertial


def refused(folder, arm, *repair, **more):
    with pytest.raises(SpecError) as error:
        imported(folder, arm, *repair, **more)
    return str(error.value)


@pytest.mark.parametrize("said", [inertial(0, 0, 0, 0), inertial(0), inertial(-2), inertial(0, 1, 1, 1)])
def test_masses_that_are_missing_or_below_0_follow_from_the_shapes(tmp_path, said):
    assert f"--repair {FROM_SHAPES}" in refused(tmp_path, said + BALL)
    for rule in (FROM_SHAPES, "all"):
        (repair,), found = imported(tmp_path, said + BALL, rule)
        mass = 4 / 3 * math.pi
        assert (repair.rule, repair.location.line, repair.path) == (FROM_SHAPES, 3, "model.bodies.arm.shapes")
        assert f"{mass:.6g} kg, of 1 collision shape of 1000 kg/m³" in repair.what
        assert ("-2 kg became" in repair.what) is ("-2" in said)
        assert found.mass == pytest.approx(mass)
        assert found.inertia[:3] == pytest.approx([0.4 * mass * 0.01] * 3)


def test_another_density_and_shapes_that_are_only_seen(tmp_path):
    (repair,), found = imported(tmp_path, inertial(0) + SEEN, f"{FROM_SHAPES}=2.7 g/cm^3")
    assert "1 visual shape of 2700 kg/m³ (no collision shape has a volume)" in repair.what
    assert found.mass == pytest.approx(27.0)


@pytest.mark.parametrize("is_open", [False, True])
def test_meshes(tmp_path, is_open):
    points, faces = box(0.1, 0.2, 0.3)
    (tmp_path / "m.stl").write_bytes(stl(points, faces[:-1] if is_open else faces))
    mesh = '<collision name="c"><geometry><mesh><uri>m.stl</uri></mesh></geometry></collision>'
    (repair,), found = imported(tmp_path, inertial(0) + mesh, "all")
    assert ("not closed: the hull is filled" in repair.what) is is_open
    assert found.mass == pytest.approx(6.0, rel=1e-6)


@pytest.mark.parametrize("moments", [(0, 0, 0), (-1, 1, 1)])
def test_moments_that_are_not_above_0(tmp_path, moments):
    assert "--repair not-positive" in refused(tmp_path, inertial(2, *moments) + BALL)
    (repair,), found = imported(tmp_path, inertial(2, *moments) + BALL, "all")
    assert repair.rule == "not-positive"
    assert (found.mass, found.inertia[0]) == (2.0, pytest.approx(0.4 * 2 * 0.01))
    (repair,), found = imported(tmp_path, inertial(2, *moments), "all")
    radius = (3 * 2 / (4 * math.pi * 1000)) ** (1 / 3)
    assert found.inertia[0] == pytest.approx(0.4 * 2 * radius**2)
    assert f"{found.inertia[0]:.6g} kg m²" in repair.what


def test_good_links_stay_as_they_are(tmp_path):
    plain, found = imported(tmp_path, UNIT + BALL)
    same, again = imported(tmp_path, UNIT + BALL, "all")
    assert (plain, same, found) == ([], [], again)
    assert imported(tmp_path, BALL, "all")[1].mass == 1.0  # of a link without inertial, SDF says so
    weld = f'<link name="cover">{inertial(0, 0, 0, 0)}{BALL}</link>'
    weld += '<joint name="w" type="fixed"><parent>arm</parent><child>cover</child></joint>'
    assert imported(tmp_path, UNIT, "all", more=weld)[0] == []


def test_bodies_without_shapes_stay_refused_and_a_massless_root_is_fixed(tmp_path):
    assert "no shapes that it could follow from" in refused(tmp_path, inertial(0), "all")
    repairs, _ = imported(tmp_path, UNIT, "all", base=inertial(0) + BALL)
    assert [repair.rule for repair in repairs] == ["massless"]


@pytest.mark.parametrize(
    ("name", "severity"),
    [
        ("gz-sim-yarp-forcetorque-system", "information"),
        ("gazebo_ros_control", "information"),
        ("gz-sim-imu-system", "information"),
        ("mimic_gripper_left_motor", "physics"),
        ("gz-sim-buoyancy-system", "physics"),
        ("gazebo_ros_force", "physics"),
        ("RobotPlugin", "physics"),
    ],
)
def test_plugins_are_distinguished_by_their_effects(tmp_path, name, severity):
    plugin = f'<plugin name="p" filename="{name}"/>'
    imported(tmp_path, UNIT, more=plugin)
    losses = load(tmp_path / "m.sdf").source.imported.losses()
    assert [loss.severity.value for loss in losses if "plugin" in loss.what] == [severity]
