"""Words of today's converters beyond UsdPhysics: each by its unit and law, and what is no loss of physics."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simspec.errors import SpecError
from simspec.language.foreign import ImportOptions, LossSeverity
from simspec.language.load import load
from tests.imports.usd.stages import BALL, hinge, lost, stage

pytest.importorskip("pxr")

pytestmark = pytest.mark.usefixtures("warm_readers")
DEGREE = math.pi / 180.0


def test_numbers_of_an_angle_are_per_degree(tmp_path):
    spec, joint = hinge(
        tmp_path,
        "float newton:damping = 0.25",
        "float newton:friction = 0.5",
        "float newton:armature = 0.125",
        "float newton:velocityLimit = 90",
        "float newton:limitStiffness = inf",
        "float newton:limitDamping = -inf",
        "uniform double mjc:damping = 9",
    )
    assert joint.damping == pytest.approx(0.25 / DEGREE)
    assert (joint.dry_friction, joint.armature) == (0.5, 0.125)
    assert joint.velocity_limit == pytest.approx(math.pi / 2.0)
    assert lost(spec) == []


def test_numbers_of_a_length_are_in_the_stage_s_units(tmp_path):
    head = ""
    path = tmp_path / "stage.usda"
    text = (
        'def PhysicsPrismaticJoint "j" {\n rel physics:body0 = </a>\n rel physics:body1 = </b>\n'
        " float newton:damping = 3\n float newton:friction = 50\n float newton:velocityLimit = 200\n}\n"
    )
    path.write_text(f"#usda 1.0\n(metersPerUnit = 0.01)\n{head}{BALL % ('a', '')}{BALL % ('b', '')}{text}")
    spec = load(path, options=ImportOptions())
    joint = next(body.joint for body in spec.resolve().bodies if body.joint.kind == "slide")
    assert joint.damping == pytest.approx(3.0)  # kg cm/s² by cm/s
    assert joint.dry_friction == pytest.approx(0.5)
    assert joint.velocity_limit == pytest.approx(2.0)


def test_a_tensor_of_doubles_goes_before_moments_and_their_axes(tmp_path):
    six = "[0.3, 0.4, 0.5, 0.01, -0.02, 0.03]"
    said = f"float physics:mass = 2\nfloat3 physics:diagonalInertia = (1, 1, 1)\ndouble[] newton:inertia = {six}"
    (body,) = stage(tmp_path, BALL % ("a", said)).resolve().bodies
    assert body.inertial.inertia == (0.3, 0.4, 0.5, 0.01, -0.02, 0.03)


def test_gravity_that_is_switched_off(tmp_path):
    head = 'def PhysicsScene "s" {\n bool newton:gravityEnabled = 0\n}\n'
    assert stage(tmp_path, BALL % ("a", ""), head=head).resolve().physics.gravity == (0.0, 0.0, 0.0)


def test_weight_that_is_away(tmp_path):
    (body,) = stage(tmp_path, BALL % ("a", "custom float mjc:body:gravcomp = 0.75")).resolve().bodies
    assert body.gravity_scale == 0.25


@pytest.mark.parametrize(
    ("lines", "effort", "losses"),
    [
        (("uniform double mjc:actuatorfrcrange:min = -3", "uniform double mjc:actuatorfrcrange:max = 3"), 3.0, 0),
        (("uniform double mjc:actuatorfrcrange:min = -1", "uniform double mjc:actuatorfrcrange:max = 3"), None, 2),
        (("custom float urdf:limit:effort = 4",), 4.0, 0),
    ],
)
def test_largest_efforts(tmp_path, lines, effort, losses):
    spec, joint = hinge(tmp_path, *lines)
    assert joint.effort_limit == effort
    assert len(lost(spec)) == losses


TWO = """def PhysicsRevoluteJoint "lead" {
 rel physics:body0 = </a>
 rel physics:body1 = </b>
}
def PhysicsRevoluteJoint "led" (prepend apiSchemas = [%s]) {
 rel physics:body0 = </a>
 rel physics:body1 = </c>
 %s
}
"""


def coupled(folder, schema, *lines):
    return stage(folder, *(BALL % (name, "") for name in "abc"), TWO % (schema, "\n ".join(lines)))


def test_a_joint_that_follows(tmp_path):
    lines = ("rel newton:mimicJoint = </lead>", "float newton:mimicCoef0 = 90", "float newton:mimicCoef1 = -2")
    spec = coupled(tmp_path, '"NewtonMimicAPI"', *lines)
    (follow,) = spec.source.imported.data["model"]["constraints"].values()
    assert follow == {"follow": {"joint": "led", "leader": "lead", "ratio": -2, "offset": pytest.approx(math.pi / 2)}}
    assert lost(spec) == []
    off = coupled(tmp_path, '"NewtonMimicAPI"', *lines, "bool newton:mimicEnabled = 0")
    assert "constraints" not in off.source.imported.data["model"]
    bent = coupled(tmp_path, '"NewtonMimicAPI"', *lines, "uniform double mjc:coef2 = 0.5")
    assert [what.rpartition("@")[2] for what in lost(bent)] == ["mjc:coef2"]


def test_a_joint_that_follows_by_physx(tmp_path):
    lines = (
        "rel physxMimicJoint:rotX:referenceJoint = </lead>",
        "float physxMimicJoint:rotX:gearing = 2",
        "float physxMimicJoint:rotX:offset = 45",
    )
    spec = coupled(tmp_path, '"PhysxMimicJointAPI:rotX"', *lines)
    (follow,) = spec.source.imported.data["model"]["constraints"].values()
    assert follow["follow"]["ratio"] == -2
    assert follow["follow"]["offset"] == pytest.approx(-math.pi / 4)


STACKED = """def Xform "robot" (prepend apiSchemas = ["PhysicsArticulationRootAPI"]) {
 uniform bool newton:jointsAddMobility = %d
 def Sphere "a" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"]) {}
 def Sphere "b" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"]) {
  double3 xformOp:translate = (0, 0, 3)
  uniform token[] xformOpOrder = ["xformOp:translate"]
 }
 %s
}
"""
PART = """def PhysicsRevoluteJoint "%s" {
  rel physics:body0 = </robot/a>
  rel physics:body1 = </robot/b>
  uniform token physics:axis = "%s"
  point3f physics:localPos0 = (0, 0, %g)
  point3f physics:localPos1 = (0, 0, %g)
 }
"""


def test_joints_that_move_the_same_body_in_sequence(tmp_path):
    parts = "".join(
        PART % (name, axis, 3 + at, at) for name, axis, at in (("x", "X", -1), ("y", "Y", -1), ("z", "Z", 0.5))
    )
    spec = stage(tmp_path, STACKED % (1, parts))
    (body,) = [data for data in spec.source.imported.data["model"]["bodies"].values() if "parent" in data]
    assert [(joint["name"], joint["axis"]) for joint in body["joints"]] == [
        ("x", [1, 0, 0]),
        ("y", [0, 1, 0]),
        ("z", [0, 0, 1]),
    ]
    assert [joint.get("origin", {}).get("xyz") for joint in body["joints"]] == [[0, 0, 2], None, [0, 0, 1.5]]
    assert lost(spec) == []
    assert lost(stage(tmp_path, STACKED % (0, parts)))  # they hold the body, by the schema's default


MATERIAL = """def Material "m" (prepend apiSchemas = ["PhysicsMaterialAPI"]) {
 float physics:staticFriction = 0.5
 float physics:dynamicFriction = 0.5
 float newton:torsionalFriction = 0.01
 float newton:rollingFriction = 0.002
 float newton:contactStiffness = 1000
}
"""
TOUCHING = """def Sphere "a" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "MaterialBindingAPI"%s]) {
 rel material:binding:physics = </m>
 %s
}
"""


@pytest.mark.parametrize(
    ("schema", "line", "torsional", "rolling"),
    [
        ("", "", 0.01, 0.002),
        (', "MjcCollisionAPI"', "", 0.0, 0.0),
        (', "MjcCollisionAPI"', "uniform int mjc:condim = 4", 0.01, 0.0),
        (', "MjcCollisionAPI"', "uniform int mjc:condim = 6", 0.01, 0.002),
    ],
)
def test_torsional_and_rolling_friction(tmp_path, schema, line, torsional, rolling):
    spec = stage(tmp_path, MATERIAL, TOUCHING % (schema, line))
    (material,) = spec.source.imported.data["contact"]["materials"].values()
    found = (material.get("torsional_friction", 0.0), material.get("rolling_friction", 0.0))
    assert found == pytest.approx((torsional, rolling), rel=1e-6)
    assert lost(spec) == []


@pytest.mark.parametrize(
    ("line", "harmless"),
    [
        ("float newton:contactMargin = 0", True),
        ("float newton:contactGap = -inf", True),
        ("float newton:contactGap = 0.01", True),
        ("uniform int mjc:group = 3", True),
        ("uniform int mjc:condim = 3", True),
        ("uniform int mjc:condim = 1", False),
        ("uniform int mjc:priority = 0", True),
        ("uniform int mjc:priority = 1", False),
        ('uniform token newton:massModel = "solid"', True),
        ('uniform token newton:massModel = "shell"', False),
        ("float newton:contactAdhesion = -inf", True),
        ("float newton:contactAdhesion = 0.1", False),
        ("uniform double[] mjc:springdamper = [0, 0]", True),
        ("uniform double[] mjc:springdamper = [0.1, 1]", False),
        ("custom float urdf:safety_controller:k_velocity = 3", True),
    ],
)
def test_defaults_and_settings_are_no_loss_of_physics(tmp_path, line, harmless):
    spec = stage(tmp_path, MATERIAL, TOUCHING % (', "MjcCollisionAPI"', line))
    assert (lost(spec) == []) is harmless


@pytest.mark.parametrize(
    ("line", "harmless"),
    [
        ("bool mjc:flag:contact = 1", True),
        ("bool mjc:flag:contact = 0", False),
        ("bool mjc:flag:warmstart = 0", True),
        ("double mjc:option:density = 0", True),
        ("double mjc:option:density = 1.2", False),
        ("double mjc:option:tolerance = 1e-8", True),
        ("uniform int newton:maxSolverIterations = 100", True),
        ("double mjc:compiler:setTotalMass = 5", False),
    ],
)
def test_settings_of_a_scene(tmp_path, line, harmless):
    spec = stage(tmp_path, BALL % ("a", ""), head=f'def PhysicsScene "s" {{\n {line}\n}}\n')
    assert (lost(spec) == []) is harmless


def test_a_margin_of_contact_and_the_density_of_what_has_a_mass(tmp_path):
    said = "float newton:contactMargin = 0.02\nfloat physics:density = 5\nfloat physics:mass = 1"
    spec = stage(tmp_path, BALL % ("a", f"{said}\nfloat3 physics:diagonalInertia = (1, 1, 1)"))
    (body,) = spec.resolve().bodies
    assert body.shapes[0].margin == pytest.approx(0.02)
    assert lost(spec) == []


def test_a_ball_has_a_damper_and_an_armature_and_loses_its_friction(tmp_path):
    text = (
        'def PhysicsSphericalJoint "j" {\n rel physics:body0 = </a>\n rel physics:body1 = </b>\n'
        " float newton:damping = 0.25\n float newton:armature = 0.5\n float newton:friction = 1\n}\n"
    )
    spec = stage(tmp_path, BALL % ("a", ""), BALL % ("b", ""), text)
    joint = next(body.joint for body in spec.resolve().bodies if body.joint.kind == "ball")
    assert np.allclose((joint.damping, joint.armature), (0.25 / DEGREE, 0.5))
    assert [what.rpartition("@")[2] for what in lost(spec)] == ["newton:friction"]
    assert all(
        loss.severity is not LossSeverity.PHYSICS for loss in spec.source.imported.losses() if "armature" in loss.what
    )


@pytest.mark.parametrize(
    ("said", "moment"),
    [
        ("float physics:mass = -2", 0.4 * 4 / 3 * math.pi * 1000),
        ("float physics:mass = 2\nfloat3 physics:diagonalInertia = (-1, 1, 1)", 0.4 * 2),
    ],
)
def test_masses_and_moments_below_0_follow_from_the_shapes_by_the_rule(tmp_path, said, moment):
    path = tmp_path / "stage.usda"
    path.write_text(f"#usda 1.0\n(metersPerUnit = 1)\n{BALL % ('a', said)}")
    with pytest.raises(SpecError, match="--repair not-positive"):
        load(path)
    spec = load(path, options=ImportOptions(repair=("all",)))
    (repair,) = spec.source.imported.repairs
    assert repair.rule == "not-positive"
    assert spec.resolve().bodies[0].inertial.inertia[0] == pytest.approx(moment)


def test_words_of_an_axis_go_before_those_of_the_joint(tmp_path):
    axis = "float physxJointAxis:angular:"
    spec, joint = hinge(
        tmp_path,
        f"{axis}armature = 0.25",
        "float physxJoint:armature = 9",
        f"{axis}maxJointVelocity = 180",
        f"{axis}staticFrictionEffort = 0.5",
        f"{axis}dynamicFrictionEffort = 0.5",
        f"{axis}viscousFrictionCoefficient = 0",
    )
    assert (joint.armature, joint.dry_friction) == (0.25, 0.5)
    assert joint.velocity_limit == pytest.approx(math.pi)
    assert lost(spec) == []
    spec, joint = hinge(tmp_path, f"{axis}staticFrictionEffort = 0.5", f"{axis}dynamicFrictionEffort = 0.25")
    assert joint.dry_friction == 0.0
    assert len(lost(spec)) == 2
