"""Words of files beyond UsdPhysics: carried where the language has it, reported without alarm where it has no effect."""

from __future__ import annotations

import math

import pytest

from tests.imports.usd.stages import BALL, JOINT, hinge, lost, stage

pytest.importorskip("pxr")

pytestmark = pytest.mark.usefixtures("warm_readers")


def test_effects_in_addition_to_a_drive_are_carried(tmp_path):
    spec, joint = hinge(
        tmp_path,
        "uniform double mjc:damping = 0.5",
        "uniform double mjc:stiffness = 2",
        "uniform double mjc:springref = 30",
        "uniform double mjc:frictionloss = 0.25",
        "uniform double mjc:armature = 0.125",
        "uniform double[] mjc:solreflimit = [0.08, 1]",
        "float physxLimit:angular:stiffness = 9",
        "float state:angular:physics:velocity = 90",
        "float state:angular:physics:position = 0",
        "float physics:breakForce = 3.4028235e38",
        'custom string physics:engine = "other"',
    )
    assert (joint.damping, joint.spring_stiffness, joint.dry_friction, joint.armature) == (0.5, 2.0, 0.25, 0.125)
    assert joint.spring_rest == pytest.approx(math.radians(30.0))
    assert joint.velocity == pytest.approx((math.pi / 2.0,))
    assert lost(spec) == []
    head = 'def PhysicsScene "s" {\n    uniform token mjc:compiler:angle = "radian"\n}\n'
    _, joint = hinge(tmp_path, "uniform double mjc:stiffness = 2", "uniform double mjc:springref = 0.3", head=head)
    assert joint.spring_rest == 0.3


def test_a_drive_and_a_damper_add_up_and_a_second_spring_is_lost(tmp_path):
    drive = (
        "float drive:angular:physics:stiffness = 1",
        "float drive:angular:physics:damping = 0.125",
        "uniform double mjc:damping = 0.5",
        "uniform double mjc:stiffness = 3",
    )
    text = JOINT.replace('"j" {', '"j" (prepend apiSchemas = ["PhysicsDriveAPI:angular"]) {') % "\n".join(drive)
    spec = stage(tmp_path, BALL % ("a", ""), BALL % ("b", ""), text)
    joint = next(body.joint for body in spec.resolve().bodies if body.joint.kind == "hinge")
    assert joint.damping == pytest.approx(0.5 + 0.125 * 180.0 / math.pi)
    assert [what.rpartition("@")[2] for what in lost(spec)] == ["mjc:stiffness"]


@pytest.mark.parametrize(
    ("line", "harmless"),
    [
        ("vector3f physics:linearVelocity = (0, 0, 0)", True),
        ("vector3f physics:linearVelocity = (0, 0, 1)", False),
        ("float physxRigidBody:angularDamping = 0", True),
        ("float physxRigidBody:angularDamping = 0.01", False),
        ("bool physxRigidBody:disableGravity = 0", True),
        ("bool physxRigidBody:enableGyroscopicForces = 1", True),
        ("bool physxRigidBody:enableGyroscopicForces = 0", False),
        ("uniform double mjc:unheard = 0", False),
    ],
)
def test_a_word_of_a_single_engine_is_a_loss_where_it_acts(tmp_path, line, harmless):
    assert (lost(stage(tmp_path, BALL % ("a", line))) == []) is harmless


def test_a_body_without_gravity_has_no_weight(tmp_path):
    spec = stage(tmp_path, BALL % ("a", "bool physxRigidBody:disableGravity = 1"))
    assert lost(spec) == []
    assert [body.gravity_scale for body in spec.resolve().bodies] == [0.0]


def test_a_joint_that_stands_elsewhere_than_the_file_says_is_reported(tmp_path):
    spec, joint = hinge(tmp_path, "float state:angular:physics:position = 20")
    assert joint.position == (0.0,)
    assert lost(spec) == ["/j/@state:angular:physics:position"]


GROUPS = """def PhysicsCollisionGroup "g" (prepend apiSchemas = ["CollectionAPI:colliders"]) {
    rel collection:colliders:includes = %s
    rel physics:filteredGroups = </%s>
}
def PhysicsCollisionGroup "h" (prepend apiSchemas = ["CollectionAPI:colliders"]) {
    rel collection:colliders:includes = %s
}
"""
TWO = BALL % (
    "a",
    'def Sphere "s" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {}',
)


@pytest.mark.parametrize(
    ("first", "ignored", "second", "harmless"),
    [
        ("</a/s>", "h", "</nothing>", True),
        ("</a/s>", "h", "</b>", False),
        ("[</a>, </a/s>]", "h", "</b>", True),
    ],
)
def test_groups_that_ignore_nothing_are_as_none(tmp_path, first, ignored, second, harmless):
    """A group that no shape is in is ignored without effect; one of some shapes of a body is lost where it acts."""
    spec = stage(tmp_path, TWO, BALL % ("b", ""), GROUPS % (first, ignored, second))
    assert (lost(spec) == []) is harmless
    acts = spec.resolve().contact.ignored_groups
    assert bool(acts) is (second == "</b>")
