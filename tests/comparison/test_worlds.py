"""Changes between worlds: matched by name, reported with their place, none for equal worlds."""

from __future__ import annotations

import dataclasses
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.attribution.differences import differences
from simspec.commands.reports import diff_specs
from simspec.comparison.worlds import diff_worlds, leaves
from simspec.language.load import load
from simspec.world.actions import JointTrajectory
from simspec.world.types import Contact, Expectation, PairContact, Physics
from tests import worlds

EVERY = (worlds.every_joint, worlds.damped_springs, worlds.shapes_world, worlds.gripper, worlds.spheres)


@pytest.mark.parametrize("make", EVERY)
def test_a_world_has_not_changed_from_itself(make):
    assert diff_worlds(make(), make()) == []


def changed(a, b):
    return {diff_world.path: (diff_world.kind, diff_world.before, diff_world.after) for diff_world in diff_worlds(a, b)}


def test_a_number_in_a_body():
    spheres = worlds.spheres(2)
    ball = spheres.bodies[1]
    heavier = dataclasses.replace(ball, inertial=dataclasses.replace(ball.inertial, mass=11.0))
    other = dataclasses.replace(spheres, bodies=(spheres.bodies[0], heavier, spheres.bodies[2]))
    assert changed(spheres, other) == {"bodies.ball_0.inertial.mass": ("changed", 10.0, 11.0)}


def test_bodies_are_matched_by_name_not_by_place():
    spheres = worlds.spheres(3)
    other = dataclasses.replace(spheres, bodies=(spheres.bodies[0], *reversed(spheres.bodies[1:])))
    assert diff_worlds(spheres, other) == []


def test_each_added_or_removed_body_is_a_single_change():
    few, many = worlds.spheres(2), worlds.spheres(3)
    (added,) = diff_worlds(few, many)
    assert (added.path, added.kind, str(added)) == ("bodies.ball_2", "added", "+ bodies.ball_2")
    (removed,) = diff_worlds(many, few)
    assert (removed.path, removed.kind) == ("bodies.ball_2", "removed")


def test_all_other_fields_of_a_world():
    world = dataclasses.replace(worlds.gripper(), engines=(worlds.BULLET,))
    other = dataclasses.replace(
        world,
        physics=Physics((0.0, 0.0, -1.62), 0.001, 2000),
        contact=dataclasses.replace(
            world.contact, pairs=(PairContact("default", "default", 0.5, 0.0),), excluded_bodies=(("bar", "palm"),)
        ),
        expectations=(Expectation("comes_to_rest", (("speed", 0.1),)), Expectation("comes_to_rest", (("speed", 0.2),))),
    )
    other = worlds.with_options(other, "mujoco", settings=(("iterations", 7),))
    found = changed(world, other)
    assert found["physics.gravity"] == ("changed", [0.0, 0.0, -9.81], [0.0, 0.0, -1.62])
    assert found["contact.pairs.default+default.friction"] == ("changed", 0.4, 0.5)
    assert found["contact.excluded_bodies.left+palm"][0] == "removed"
    assert {"expectations.comes_to_rest", "expectations.comes_to_rest#2", "engines.mujoco"} < set(found)


def test_shapes_by_name():
    shapes_world = worlds.shapes_world()
    ball = shapes_world.bodies[1]
    bigger = dataclasses.replace(ball, shapes=(dataclasses.replace(ball.shapes[0], size=(0.06,)),))
    other = dataclasses.replace(shapes_world, bodies=(shapes_world.bodies[0], bigger, *shapes_world.bodies[2:]))
    assert changed(shapes_world, other) == {"bodies.sphere.shapes.sphere_0.size": ("changed", [0.05], [0.06])}


def test_an_empty_contact_law():
    spheres = worlds.spheres(2)
    found = changed(spheres, dataclasses.replace(spheres, contact=Contact()))
    assert found["contact.materials.slick"][0] == "removed"


LEGS = """\
simspec: 1
name: legs
physics: {duration: 0.1}
bodies:
  base: {fixed: true}
  a: {parent: base, mass: 1, inertia: {principal: [1, 1, 1]}, joint: {type: hinge, axis: [0, 0, 1]}}
  b: {parent: a, mass: 1, inertia: {principal: [1, 1, 1]}, joint: {type: hinge, axis: [0, 0, 1]}}
  c: {parent: b, mass: 1, inertia: {principal: [1, 1, 1]}, joint: {type: hinge, axis: [0, 0, 1]}}
control:
  legs: {joints: ["*"], kp: 40, kd: {a_joint: 1, b_joint: 2, c_joint: 3}}
trajectory:
  points:
    - {at: 0, positions: {a_joint: 0, b_joint: 0, c_joint: 0}}
    - {at: 0.05, positions: {a_joint: 0.1, b_joint: 0.2, c_joint: 0.3}}
forces:
  - {body: a, force: [1, 0, 0], from: 0, until: 0.1}
"""


def legs(tmp_path, *sets):
    (tmp_path / "legs.yaml").write_text(LEGS)
    return load(tmp_path / "legs.yaml", sets=sets).resolve()


def test_a_gain_is_named_and_so_is_its_joint(tmp_path):
    (change,) = diff_worlds(legs(tmp_path), legs(tmp_path, "control.legs.kd.b_joint=2.5"))
    assert (change.path, change.before, change.after) == ("controllers.legs.kd.1", 2.0, 2.5)
    assert change.joint == "b_joint"
    every = diff_worlds(legs(tmp_path), legs(tmp_path, "control.legs.kp=45"))
    assert [change.path for change in every] == [f"controllers.legs.kp.{index}" for index in range(3)]


def test_another_set_of_joints_names_those_that_came_and_went(tmp_path):
    alone = [f"trajectory.points.{k}.positions={{c_joint: {0.3 * k}}}" for k in (0, 1)]
    found = changed(legs(tmp_path), legs(tmp_path, "control.legs={joints: [c_joint], kp: 40, kd: 7}", *alone))
    assert found["controllers.legs.joints.a_joint"] == ("removed", True, None)
    assert found["controllers.legs.kp.b_joint"] == ("removed", 40.0, None)
    assert found["controllers.legs.kd.c_joint"] == ("changed", 3.0, 7.0)
    assert "controllers.legs.kp.c_joint" not in found
    assert found["trajectory.positions.1.b_joint"] == ("removed", 0.2, None)
    assert "trajectory.positions.1.c_joint" not in found


def test_a_point_of_a_trajectory_and_a_force(tmp_path):
    sets = ("trajectory.points.1.positions.c_joint=0.4", "forces.0.force=[1,0,2]")
    found = changed(legs(tmp_path), legs(tmp_path, *sets))
    assert found["trajectory.positions.1.2"] == ("changed", 0.3, 0.4)
    assert found["forces.0.force"] == ("changed", [1.0, 0.0, 0.0], [1.0, 0.0, 2.0])


def test_explain_names_the_element_of_a_long_list(tmp_path):
    (difference,) = differences(legs(tmp_path), legs(tmp_path, "control.legs.kp=45"))
    assert difference.values == ("40", "45 (and 2 more)")


def test_many_changes_are_counted_and_all_in_the_json(tmp_path, capsys):
    world = legs(tmp_path)
    rows = [tuple((value, 0.0, 0.0) for _ in range(10_000)) for value in (0.0, 1.0)]
    times = tuple(k / 1e4 for k in range(10_000))
    few, many = (
        dataclasses.replace(world, trajectory=JointTrajectory(world.trajectory.joints, times, row)) for row in rows
    )
    assert diff_specs(few, many, as_json=False) == 1
    out = capsys.readouterr().out
    assert len(out.splitlines()) < 80
    assert "10,000 changes in all; --json lists every one" in out
    diff_specs(few, many, as_json=True)
    listed = json.loads(capsys.readouterr().out)["changes"]
    assert [entry["path"] for entry in listed] == [f"trajectory.positions.{k}.0" for k in range(10_000)]
    assert {entry["joint"] for entry in listed} == {"a_joint"}


PLAIN = st.recursive(
    st.one_of(st.none(), st.integers(0, 3), st.sampled_from(["x", "y"]), st.booleans()),
    lambda inner: st.one_of(st.lists(inner, max_size=9), st.dictionaries(st.sampled_from("abc"), inner)),
    max_leaves=20,
)


@given(PLAIN, PLAIN)
def test_nothing_changed_exactly_where_the_values_are_equal(before, after):
    found = list(leaves("it", before, after))
    assert bool(found) == (before != after)
    assert all(change.before != change.after or change.kind != "changed" for change in found)
    assert len({change.path for change in found}) == len(found)
    back = list(leaves("it", after, before))
    assert {(change.path, repr(change.before), repr(change.after)) for change in found} == {
        (change.path, repr(change.after), repr(change.before)) for change in back
    }
