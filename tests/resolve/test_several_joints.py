"""Several joints of one body: the links between them, their names and places, and rejected combinations."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.errors import SpecError
from simspec.formats.mjcf.bodies import inertial_of
from simspec.language.load import Spec, load
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import carried, initial_state, trees
from simspec.world.types import World

resolve = Spec.resolve

SOLID = {"mass": 2, "inertia": {"principal": [0.3, 0.2, 0.2]}}
BALL = {"shapes": [{"sphere": {"radius": 1}, "material": "m"}]}
X, Y, Z = [1, 0, 0], [0, 1, 0], [0, 0, 1]


def hinge(axis, **more):
    return {"type": "hinge", "axis": axis, **more}


def slide(axis, **more):
    return {"type": "slide", "axis": axis, **more}


def world(body, **more) -> World:
    contact = {"materials": {"m": {"friction": 0.5}}}
    bodies = {"base": {"fixed": True, **BALL}, "wheel": {"parent": "base", **SOLID, **body}}
    return resolve(Spec.from_data({"name": "x", "contact": contact, "bodies": bodies, **more}))


def problems(body, **more):
    with pytest.raises(SpecError) as error:
        world(body, **more)
    return [(problem.path, problem.message) for problem in error.value.problems]


STEERED = [hinge(Z, name="steer", origin={"xyz": [1, 0.5, 0]}), hinge(Y, name="spin", position=0.3)]


def test_the_body_moves_with_the_last_and_the_others_carry_it():
    found = world({"joints": STEERED}).bodies
    assert [(body.name, body.joint.name, body.joint.parent, body.inertial.mass) for body in found] == [
        ("base", "base_joint", None, 0.0),
        ("wheel.steer", "steer", "base", 0.0),
        ("wheel", "spin", "wheel.steer", 2.0),
    ]
    assert found[1].joint.origin.position == (1.0, 0.5, 0.0)
    assert found[2].joint.position == (0.3,)
    assert not found[1].shapes


def test_several_joints_are_a_single_feature_located_at_the_joints():
    used = {need.feature: need.paths for need in needs(world({"joints": STEERED}))}
    assert used[Feature.JOINT_SEVERAL] == ("bodies.wheel.joints",)
    assert Feature.MASSLESS not in used
    assert Feature.EXCLUDED_PAIRS not in used


def test_the_body_does_not_touch_its_parent():
    found = world({"joints": STEERED, **BALL})
    assert ("base", "wheel") in found.contact.excluded_bodies
    assert not CollisionFilter(found).may_touch("base", "wheel")


def test_joints_without_names_are_called_after_their_place():
    names = [body.joint.name for body in world({"joints": [hinge(Z), hinge(X)]}).bodies]
    assert names == ["base_joint", "wheel_joint_0", "wheel_joint_1"]


def test_a_root_and_its_copies():
    loose = {
        "joints": [slide(X, name="x"), hinge(Z)],
        "pose": {"xyz": [0, 0, 1]},
        "array": {"line": 2, "step": [0, 3, 0]},
        **SOLID,
    }
    found = resolve(Spec.from_data({"name": "x", "bodies": {"cart": loose}}))
    assert [(body.name, body.joint.name) for body in found.bodies] == [
        ("cart_0.x", "x_0"),
        ("cart_0", "cart_joint_1_0"),
        ("cart_1.x", "x_1"),
        ("cart_1", "cart_joint_1_1"),
    ]
    assert [bodies[0].joint.origin.position for bodies in trees(found).values()] == [(0, 0, 1), (0, 3, 1)]
    assert {body.model for body in found.bodies} == {"cart_0", "cart_1"}


def test_in_a_placed_model_they_begin_where_the_placement_says():
    model = {"bodies": {"base": {"fixed": True}, "wheel": {"parent": "base", "joints": STEERED, **SOLID}}}
    placed = {**model, "positions": {"steer": 0.5}, "velocities": {"spin": 2.0}}
    found = resolve(Spec.from_data({"name": "x", "models": {"car": placed}}))
    assert [(body.name, body.joint.name, body.joint.position, body.joint.velocity) for body in found.bodies[1:]] == [
        ("car/wheel.steer", "car/steer", (0.5,), (0.0,)),
        ("car/wheel", "car/spin", (0.3,), (2.0,)),
    ]


def test_each_may_be_driven():
    control = {"drive": {"law": "pd", "joints": ["steer", "spin"], "kp": "5 N m/rad", "kd": "0.5 N m s/rad"}}
    assert world({"joints": STEERED}, control=control).controllers[0].joints == ("steer", "spin")


def test_a_universal_joint_turns_as_two_hinges_do():
    """The pose is the product of both turns, in the order of the list."""
    found = world({"joints": [hinge(Z, position=0.4), hinge(X, position=0.7, origin={"xyz": [0.1, 0, 0]})]})
    oracle = Oracle(found)
    x, y, z, w, *turn = oracle.body_poses(initial_state(found)[0])[2]
    assert (x, y, z) == pytest.approx((0.1 * np.cos(0.4), 0.1 * np.sin(0.4), 0.0))
    c, s, a, b = np.cos(0.2), np.sin(0.2), np.cos(0.35), np.sin(0.35)
    assert (w, *turn) == pytest.approx((c * a, c * b, s * b, s * a))
    assert np.linalg.eigvalsh(oracle.mass_matrix(initial_state(found)[0])).min() > 0.0


REFUSED = {
    "one": ({"joints": [hinge(Z)]}, "bodies.wheel.joints", "at least two"),
    "none": ({"joints": []}, "bodies.wheel.joints", "at least two"),
    "with joint": ({"joints": STEERED, "joint": hinge(X)}, "bodies.wheel.joints", "exclude each other"),
    "fixed": ({"joints": [hinge(Z), {"type": "fixed"}]}, "bodies.wheel.joints.1.type", "is not one of several"),
    "free": ({"joints": [{"type": "free"}, hinge(Z)]}, "bodies.wheel.joints.0.type", "is not one of several"),
    "a ball first": ({"joints": [{"type": "ball"}, slide(Z)]}, "bodies.wheel.joints.0.type", "the last of several"),
    "four hinges": ({"joints": [hinge(X), hinge(Y), hinge(Z), hinge(X)]}, "bodies.wheel.joints", "at most three"),
    "no axis": ({"joints": [hinge(X), {"type": "hinge"}]}, "bodies.wheel.joints.1", "needs an axis"),
    "a name twice": (
        {"joints": [hinge(X, name="a"), hinge(Y, name="a")]},
        "bodies.wheel.joints.1.name",
        "is taken",
    ),
    "twice about one axis": ({"joints": [hinge(Z), hinge(Z)]}, "bodies.wheel.joints", "in fewer ways"),
    "twice about one axis, with armature, which some engines compute outside": (
        {"joints": [hinge(Z, armature=0.1), hinge(Z)]},
        "bodies.wheel.joints",
        "in fewer ways",
    ),
    "slides in one plane": ({"joints": [slide(X), slide(Y), slide([1, 1, 0])]}, "bodies.wheel.joints", "in fewer ways"),
    "gimbal lock": (
        {"joints": [hinge(X), hinge(Y, position="90 deg"), hinge(Z)]},
        "bodies.wheel.joints",
        "in fewer ways",
    ),
    "limits": (
        {"joints": [hinge(X, limits={"position": [0, 1]}, position=2), hinge(Y)]},
        "bodies.wheel.joints.0.position",
        "beyond the joint's limits",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_invalid_joint_lists_are_rejected_at_their_location(name):
    body, path, message = REFUSED[name]
    ((at, said),) = problems(body)
    assert at == path
    assert message in said


def test_separate_parallel_hinges_are_an_allowed_linkage():
    assert world({"joints": [hinge(Z), hinge(Z, origin={"xyz": [1, 0, 0]})]})


def test_an_element_of_joints_is_found_again(tmp_path):
    """Places in the world lead to the file: of the joint that moves what is between, and of the last one."""
    text = """simspec: 1
name: x
bodies:
  wheel:
    mass: 1
    inertia: {principal: [1, 1, 1]}
    joints:
      - {type: hinge, axis: [0, 0, 1], name: steer, damping: 0.1}
      - {type: hinge, axis: [1, 0, 0], damping: 0.2}
"""
    (tmp_path / "x.yaml").write_text(text)
    spec = load(tmp_path / "x.yaml")
    assert [body.name for body in spec.resolve().bodies] == ["wheel.steer", "wheel"]
    assert spec.locate("bodies.wheel.steer.joint.damping").line == 8
    assert spec.locate("bodies.wheel.joint.damping").line == 9
    assert spec.locate("bodies.wheel.joints").line == 7


def test_a_root_takes_a_pose_or_an_origin():
    loose = {"joints": [slide(X, origin={"xyz": [1, 0, 0]}), hinge(Z)], "pose": {"xyz": [0, 0, 1]}, **SOLID}
    with pytest.raises(SpecError, match=r"pose and joint\.origin exclude"):
        Spec.from_data({"name": "x", "bodies": {"cart": loose}})


def test_a_body_with_mass_keeps_it_under_any_name():
    """A world that is made in Python may have names with a point."""
    found = world({"joints": STEERED})
    heavy = dataclasses.replace(found.bodies[1], inertial=found.bodies[2].inertial)
    other = dataclasses.replace(found, bodies=(found.bodies[0], heavy, found.bodies[2]))
    assert Feature.JOINT_SEVERAL not in {need.feature for need in needs(other)}
    inertial = inertial_of(heavy)
    assert inertial is not None
    assert inertial.mass == 2.0
    assert set(carried(found)) == {"wheel"}
    assert not carried(other)
