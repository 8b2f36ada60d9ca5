"""Imports of URDF: the data of the spec, exactly, and the fate of everything in the file."""

import math
import re

import pytest

from simspec.errors import SpecError
from simspec.imports.urdf.elements import GAZEBO, rows
from simspec.language.foreign import Fate, LossSeverity, of_physics
from simspec.language.load import load
from simspec.world import frames
from tests.imports.urdf.robots import SOLID, SPECIMEN, read, refused, two_links
from tests.meshes.solids import box, stl

pytestmark = pytest.mark.usefixtures("warm_readers")

FOLLOW = {"joint": "shoulder", "leader": "wrist", "ratio": 2, "offset": 0.5}
COUPLING = {"constraints": {"shoulder": {"follow": FOLLOW}}}


def test_a_robot_is_a_short_model_file(tmp_path):
    assert read(SPECIMEN, tmp_path).data == {
        "simspec": 1,
        "name": "arm_two",
        "contact": {
            "materials": {
                "surface-1": {
                    "friction": 1,
                    "restitution": 0.1,
                    "torsional_friction": 2e-3,
                    "rolling_friction": 1e-3,
                },
                "surface-2": {"friction": 0.2},
                "unsaid": {"friction": 0.5},
            },
            "exclude": [["base", "tip"]],
        },
        "model": {
            "bodies": {
                "base": {
                    "mass": 3.5,
                    "centre_of_mass": [0.1, 0, 0.2],
                    "inertia": {"tensor": {"xx": 0.02, "yy": 0.03, "zz": 0.04, "xy": 0.001, "yz": -0.002}},
                    "shapes": [
                        {
                            "name": "solid",
                            "box": {"size": [0.2, 0.2, 0.1]},
                            "pose": {"xyz": [0, 0, 0.05], "rpy": [0, 0, 0.5]},
                            "visual": False,
                            "material": "surface-1",
                        },
                        {
                            "name": "seen",
                            "box": {"size": [0.2, 0.2, 0.1]},
                            "pose": {"xyz": [0, 0, 0.05]},
                            "collision": False,
                            "colour": [0, 0, 0.5, 1],
                        },
                    ],
                },
                "upper_arm": {
                    "parent": "base",
                    "mass": 1.25,
                    "centre_of_mass": [0, 0, 0.25],
                    "inertia": {"principal": [0.01, 0.012, 0.003], "rpy": [0.3, 0, 0]},
                    "joint": {
                        "name": "shoulder",
                        "type": "hinge",
                        "origin": {"xyz": [0, 0, 0.1], "rpy": [0, 1.5707963267948966, 0]},
                        "axis": [0, 1, 0],
                        "limits": {"position": [-2.5, "7 rad"], "velocity": 3.2, "effort": 20},
                        "damping": 0.1,
                        "dry_friction": 0.02,
                    },
                    "shapes": [
                        {
                            "cylinder": {"radius": 0.03, "length": 0.5},
                            "pose": {"xyz": [0, 0, 0.25]},
                            "material": "unsaid",
                            "colour": [1, 0, 0, 1],
                        }
                    ],
                },
                "tip": {
                    "parent": "upper_arm",
                    "mass": 0.1,
                    "inertia": {"principal": [1e-4, 1e-4, 1e-4]},
                    "gravity_scale": 0.0,
                    "joint": {
                        "name": "wrist",
                        "type": "hinge",
                        "origin": {"xyz": [0, 0, 0.5]},
                        "axis": [0, 0, 1],
                        "armature": 0.001,
                    },
                    "shapes": [
                        {"sphere": {"radius": 0.04}, "visual": False, "material": "surface-2"},
                        {"sphere": {"radius": 0.05}, "collision": False},
                    ],
                },
            },
            **COUPLING,
        },
    }


def test_it_loads_and_resolves_as_a_spec(tmp_path):
    (tmp_path / "arm.urdf").write_text(SPECIMEN)
    spec = load(tmp_path / "arm.urdf")
    world = spec.resolve()
    assert [body.name for body in world.bodies] == ["base", "upper_arm", "tip"]
    assert world.bodies[1].joint.position_limits == (-2.5, 7.0)
    assert not [warning for warning in spec.warnings(world) if "turns" in warning.message]
    place = spec.locate("bodies.upper_arm.joint.axis")
    assert place.line == 1 + SPECIMEN[: SPECIMEN.index('<axis xyz="0 1 0" rpy')].count("\n")


def test_the_table_says_of_everything_what_becomes_of_it(tmp_path):
    (tmp_path / "box.stl").write_bytes(stl(*box(0.1, 0.2, 0.3)))
    shapes = "".join(
        f"<{tag}><geometry><{kind}/></geometry></{tag}>"
        for tag in ("visual", "collision")
        for kind in (
            'mesh filename="box.stl" scale="1 1 2"',
            'capsule radius="1" length="2"',
            'ellipsoid a="1" b="2" c="3"',
            'plane normal="0 1 0"',
        )
    )
    text = SPECIMEN.replace('<link name="tip">', f'<link name="tip">{shapes}')
    fates = {}
    for account in read(text, tmp_path).accounts:
        where = re.sub(r"\[[^]]*\]", "", account.what).removeprefix("robot/")
        fates.setdefault(where, []).append((account.fate, account.severity))
    known = {row.where: row for row in rows()}
    assert not fates.keys() - known.keys() - {"robot", "gazebo/unheard"}
    # every row without a case of its own is in the specimen, with this fate
    gazebo = {f"gazebo/{name}" for name in GAZEBO}
    assert not {name for name, row in known.items() if not row.when and name not in gazebo} - fates.keys()
    for where, met in fates.items():
        row = known.get(where)
        if row is None or row.when:
            continue
        for fate, severity in met:
            assert fate is row.fate, where
            assert fate is Fate.CARRIED or severity is row.severity, where
    assert fates["gazebo/unheard"] == [(Fate.LOST, LossSeverity.PHYSICS)]


@pytest.mark.parametrize(
    ("kind", "inside", "joint"),
    [
        ("fixed", "", {"name": "hinge", "type": "fixed"}),
        ("continuous", '<axis xyz="0 0 2"/>', {"name": "hinge", "type": "hinge", "axis": [0, 0, 2]}),
        ("continuous", "", {"name": "hinge", "type": "hinge", "axis": [1, 0, 0]}),
        (
            "prismatic",
            '<limit upper="20" effort="5"/>',
            {"name": "hinge", "type": "slide", "axis": [1, 0, 0], "limits": {"position": [0, 20], "effort": 5}},
        ),
        ("spherical", '<dynamics damping="2"/>', {"name": "hinge", "type": "ball", "damping": 2}),
    ],
)
def test_types_of_joints(tmp_path, kind, inside, joint):
    assert read(two_links(inside, kind=kind), tmp_path).data["model"]["bodies"]["arm"]["joint"] == joint


def test_a_rating_in_a_namespace_is_information(tmp_path):
    text = two_links('<limit lower="0" upper="1" p:acceleration="3" p:other="1"/>', kind="revolute")
    severities = {account.what.split("/")[-1]: account.severity for account in read(text, tmp_path).losses()}
    assert severities == {"@p:acceleration": LossSeverity.INFORMATION, "@p:other": LossSeverity.PHYSICS}


def test_a_fixed_joint_has_no_axis_and_no_limits(tmp_path):
    accounts = read(two_links('<axis xyz="0 0 1"/><limit lower="0"/>', kind="fixed"), tmp_path).accounts
    unused = {account.what for account in accounts if account.fate is Fate.UNUSED}
    assert unused == {"joint[hinge]/axis", "joint[hinge]/axis/@xyz", "joint[hinge]/limit", "joint[hinge]/limit/@lower"}


COUPLED = (
    '<link name="tip">{0}</link><joint name="second" type="{1}"><parent link="arm"/><child link="tip"/>{2}</joint>'
)


@pytest.mark.parametrize(
    ("kind", "mimic", "reason"),
    [
        ("prismatic", '<mimic joint="hinge" multiplier="0"/>', "moves on its own"),
        ("fixed", '<mimic joint="hinge"/>', "no position to follow with"),
    ],
)
def test_joints_that_follow_nothing_are_reported(tmp_path, kind, mimic, reason):
    imported = read(two_links(more=COUPLED.format(SOLID, kind, "<limit upper='1'/>" + mimic)), tmp_path)
    assert "constraints" not in imported.data["model"]
    (account,) = [account for account in imported.accounts if account.what == "joint[second]/mimic[hinge]"]
    assert reason in account.reason


def test_a_follower_moves_with_its_leader(tmp_path):
    text = two_links(more=COUPLED.format(SOLID, "continuous", '<mimic joint="hinge" multiplier="-1"/>'))
    (tmp_path / "r.urdf").write_text(text)
    world = load(tmp_path / "r.urdf").resolve()
    assert len(world.constraints) == 1
    (problem,) = refused(text.replace('<mimic joint="hinge"', '<mimic joint="nothing"'), tmp_path)
    assert "there is no joint 'nothing'" in problem


# --- the world ------------------------------------------------------------------------------------------------------


def _below_world(kind: str, world: str = "", name: str = "world") -> str:
    origin = '<origin xyz="0 0 1" rpy="0 0 0"/>'
    return (
        f'<robot name="r"><link name="{name}">{world}</link><link name="base">{SOLID}</link>'
        f'<joint name="j" type="{kind}"><parent link="{name}"/><child link="base"/>{origin}</joint></robot>'
    )


def test_a_link_called_world_is_the_world(tmp_path):
    bodies = read(_below_world("fixed"), tmp_path).data["model"]["bodies"]
    assert list(bodies) == ["base"]
    assert (bodies["base"]["fixed"], bodies["base"]["pose"]) == (True, {"xyz": [0, 0, 1]})


def test_a_floating_joint_from_the_world_is_a_free_root(tmp_path):
    bodies = read(_below_world("floating", name="map"), tmp_path).data["model"]["bodies"]
    assert bodies == {
        "base": {"pose": {"xyz": [0, 0, 1]}, "mass": 2, "inertia": {"principal": [0.1, 0.1, 0.1]}},
    }


def test_a_hinge_from_the_world_is_a_hinge_of_the_root(tmp_path):
    bodies = read(_below_world("continuous"), tmp_path).data["model"]["bodies"]
    assert bodies["base"]["joint"] == {"name": "j", "type": "hinge", "origin": {"xyz": [0, 0, 1]}, "axis": [1, 0, 0]}
    (tmp_path / "r.urdf").write_text(_below_world("continuous"))
    assert load(tmp_path / "r.urdf").resolve().bodies[0].joint.kind == "hinge"


def test_a_world_with_shapes_is_a_fixed_body(tmp_path):
    floor = '<collision><geometry><box size="9 9 1"/></geometry></collision>'
    bodies = read(_below_world("continuous", floor), tmp_path).data["model"]["bodies"]
    assert bodies["world_2"]["fixed"] is True
    assert bodies["base"]["parent"] == "world_2"


def test_a_root_without_mass_is_fixed_and_says_so(tmp_path):
    imported = read(two_links(base=""), tmp_path)
    assert imported.data["model"]["bodies"]["base"] == {"fixed": True}
    assert "no mass" in imported.comments["model.bodies.base"]


def test_floating_joints_elsewhere_are_refused_by_name(tmp_path):
    (message,) = refused(two_links(kind="floating"), tmp_path)
    assert "floating joint" in message
    assert "robot.urdf:4" in message


# --- words of other readers ---


def test_geometries_that_readers_add_are_carried_and_reported(tmp_path):
    shapes = (
        '<collision><geometry><capsule radius="0.1" length="0.4"/></geometry></collision>'
        '<collision><geometry><far:capsule radius="0.2" length="0.4"/></geometry></collision>'
        '<collision><geometry><far:ellipsoid a="0.1" b="0.2" c="0.3"/></geometry></collision>'
    )
    imported = read(two_links(arm=SOLID + shapes), tmp_path)
    kinds = [
        {k: v for k, v in shape.items() if k != "visual"} for shape in imported.data["model"]["bodies"]["arm"]["shapes"]
    ]
    assert kinds == [
        {"capsule": {"radius": 0.1, "length": 0.4}},
        {"capsule": {"radius": 0.2, "length": 0.4}},
        {"ellipsoid": {"radii": [0.1, 0.2, 0.3]}},
    ]
    given = {account.what: (account.fate.value, account.reason) for account in imported.accounts}
    assert given["link[arm]/collision/geometry/far:ellipsoid"][0] == "carried"
    assert "add to URDF" in given["link[arm]/collision/geometry/far:ellipsoid"][1]
    assert not imported.losses()
    (problem,) = refused(two_links(arm=SOLID + shapes.replace("far:ellipsoid", "far:box")), tmp_path)
    assert "without a known geometry" in problem


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -1), (0.3, 0.1, 2), (0, 1, 0)])
def test_a_plane_has_its_normal_along_z(tmp_path, normal):
    words = " ".join(map(str, normal))
    plane = f'<collision><origin xyz="0 0 2" rpy="0.4 0 0"/><geometry><plane normal="{words}"/></geometry></collision>'
    text = f'<robot name="r"><link name="ground">{plane}</link></robot>'
    read(text, tmp_path)
    (shape,) = load(tmp_path / "robot.urdf").resolve().bodies[0].shapes
    length = math.hypot(*normal)
    expected = frames.rotate(frames.from_rpy(0.4, 0, 0), tuple(value / length for value in normal))
    assert frames.rotate(shape.pose.quaternion, (0.0, 0.0, 1.0)) == pytest.approx(expected, abs=1e-14)
    assert (shape.kind, shape.pose.position) == ("plane", (0.0, 0.0, 2.0))


def test_a_plane_without_a_direction_or_on_what_moves_is_refused(tmp_path):
    plane = '<collision><geometry><plane normal="0 0 0"/></geometry></collision>'
    (problem,) = refused(two_links(arm=SOLID + plane), tmp_path)
    assert "a normal of length 0" in problem
    read(two_links(arm=SOLID + plane.replace("0 0 0", "0 0 1")), tmp_path)
    with pytest.raises(SpecError, match="plane"):
        load(tmp_path / "robot.urdf").resolve()


def test_products_of_inertia_that_are_written_twice(tmp_path):
    twice = SOLID.replace('iyz="0"', 'iyz="0" iyx="0" izx="0.0" izy="0.01"')
    imported = read(two_links(arm=twice), tmp_path)
    (lost,) = imported.losses()
    assert (lost.what.rpartition("/@")[2], lost.severity.value) == ("izy", "physics")


# --- surfaces ---

SPHERE = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'


@pytest.mark.parametrize(
    ("inside", "material", "lost"),
    [
        ("<mu1>0.3</mu1><mu2>0.3</mu2><fdir1>1 0 0</fdir1>", {"friction": 0.3}, []),
        ('<mu1 value="0.3"/><mu2>0.4</mu2>', {"friction": 0.3}, ["gazebo/mu2"]),
        ("<mu1>0.3</mu1><fdir1>1 0 0</fdir1>", {"friction": 0.3}, ["gazebo/mu1", "gazebo/fdir1"]),
        ("<selfCollide>true</selfCollide><kp>1</kp><gravity>1</gravity>", None, []),
        ("<selfCollide>false</selfCollide>", None, ["gazebo/selfCollide"]),
    ],
)
def test_friction_of_gazebo_is_a_material(tmp_path, inside, material, lost):
    text = two_links(arm=SOLID + SPHERE, more=f'<gazebo reference="arm">{inside}</gazebo>')
    imported = read(text, tmp_path)
    assert load(tmp_path / "robot.urdf").resolve()
    materials = imported.data.get("contact", {}).get("materials", {})
    assert list(materials.values()) == ([] if material is None else [material])
    assert "material" not in imported.data["model"]["bodies"]["arm"]["shapes"][0]
    assert [account.what for account in of_physics(imported)] == lost


@pytest.mark.parametrize("said", ["<gravity>false</gravity>", '<turnGravityOff value="1"/>'])
def test_gazebo_takes_the_weight_of_a_link_away(tmp_path, said):
    imported = read(two_links(more=f'<gazebo reference="arm">{said}</gazebo>'), tmp_path)
    assert imported.data["model"]["bodies"]["arm"]["gravity_scale"] == 0.0
    assert not of_physics(imported)
    base, arm = load(tmp_path / "robot.urdf").resolve().bodies
    assert (base.gravity_scale, arm.gravity_scale) == (1.0, 0.0)


def test_friction_of_a_link_without_a_shape_has_no_effect(tmp_path):
    imported = read(two_links(more='<gazebo reference="arm"><mu1>0.3</mu1></gazebo>'), tmp_path)
    assert "contact" not in imported.data
    assert not of_physics(imported)


def test_two_frictions_of_a_link_are_reported(tmp_path):
    arm = SOLID + SPHERE + '<contact><lateral_friction value="2"/></contact>'
    imported = read(two_links(arm=arm, more='<gazebo reference="arm"><mu1>1</mu1></gazebo>'), tmp_path)
    assert imported.data["contact"]["materials"] == {"surface": {"friction": 2}}
    assert [account.what for account in of_physics(imported)] == ["gazebo/mu1"]
    (problem,) = refused(two_links(arm=arm.replace('friction value="2"', 'friction value="-2"')), tmp_path)
    assert "must not be below 0" in problem


# --- names ----------------------------------------------------------------------------------------------------------


def test_names_that_the_language_does_not_allow_are_others_and_said(tmp_path):
    text = two_links().replace('"arm"', '"a.b/c"').replace('"base"', '"7.b"').replace('"hinge"', '"j 1"')
    imported = read(text, tmp_path)
    assert list(imported.data["model"]["bodies"]) == ["n_7_b", "a_b_c"]
    said = {account.what: account.reason for account in imported.accounts if account.reason}
    assert said == {
        "link[7.b]/@name": "called n_7_b in the spec",
        "link[a.b/c]/@name": "called a_b_c in the spec",
        "joint[j 1]/@name": "called j_1 in the spec",
    }


def test_two_names_that_would_become_the_same_stay_two(tmp_path):
    text = two_links(base=SOLID).replace('"arm"', '"a.b"').replace('"base"', '"a_b"')
    assert list(read(text, tmp_path).data["model"]["bodies"]) == ["a_b", "a_b_2"]
