"""Joints of SDF outside the tree: loops, joints that follow others, two axes in one joint, and models that are merged."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.language.load import load
from simspec.world import frames
from simspec.world.constraints import Violation
from simspec.world.kinematics import initial_state
from simspec.world.types import ConnectConstraint, FollowConstraint, WeldConstraint
from tests.imports.sdf.texts import imported, joint, link, lost, model

FIXED = joint("fixed", name="hold", parent="world", child="base")
UPRIGHT = "<axis><xyz>0 1 0</xyz></axis>"


def placed(name, x, z=0):
    return link(name, f"<pose>{x} 0 {z} 0 0 0</pose>")


def four_bar(kind, content=UPRIGHT):
    """Two links on the base, and one that joins them: it is the child of two joints."""
    hinge = [
        joint("revolute", UPRIGHT, name, parent, child)
        for name, parent, child in (("a", "base", "crank"), ("b", "base", "rocker"), ("c", "crank", "rod"))
    ]
    closing = joint(kind, f"<pose>2 0 0 0 0 0</pose>{content}", "d", "rocker", "rod")
    return model(
        link("base") + placed("crank", 0) + placed("rocker", 2) + placed("rod", 0, 1) + FIXED + "".join(hinge) + closing
    )


def world_of(text, folder):
    imported(text, folder)
    return load(folder / "robot.sdf").resolve()


@pytest.mark.parametrize("kind", ["ball", "revolute", "fixed"])
def test_a_link_that_is_the_child_of_two_joints_closes_a_loop(kind, tmp_path):
    world = world_of(four_bar(kind), tmp_path)
    assert {type(constraint) for constraint in world.constraints} == {
        WeldConstraint if kind == "fixed" else ConnectConstraint
    }
    q, _ = initial_state(world)
    poses = Oracle(world).body_poses(q)
    violation = Violation(world.bodies, world.constraints)
    assert np.abs(violation.of(q, poses)).max() < 1e-12
    hinges = sum(body.joint.kind == "hinge" for body in world.bodies)
    assert np.linalg.matrix_rank(violation.jacobian(poses), 1e-9) == hinges - (kind != "fixed")


def test_links_that_two_fixed_joints_hold_are_welded(tmp_path):
    arms = (
        link("base")
        + placed("crank", 0)
        + placed("rod", 0, 1)
        + FIXED
        + joint("revolute", UPRIGHT, "a", "base", "crank")
    )
    world = world_of(
        model(arms + joint("fixed", "", "b", "crank", "rod") + joint("fixed", "", "c", "base", "rod")), tmp_path
    )
    (weld,) = world.constraints
    assert isinstance(weld, WeldConstraint)
    assert {weld.first, weld.second} == {"base", "rod"}


def test_the_loop_of_a_hinge_holds_its_axis(tmp_path):
    arms = link("base") + placed("arm", 1) + placed("tip", 2) + FIXED
    loose = joint("ball", "", "a", "base", "arm") + joint("revolute", UPRIGHT, "b", "base", "tip")
    text = model(arms + loose + joint("revolute", UPRIGHT, "c", "arm", "tip"))
    world = world_of(text, tmp_path)
    first, second = world.constraints
    assert np.subtract(second.first_point, first.first_point) == pytest.approx([0.0, 0.1, 0.0], abs=1e-15)
    q, _ = initial_state(world)
    poses = Oracle(world).body_poses(q)
    rank = np.linalg.matrix_rank(Violation(world.bodies, world.constraints).jacobian(poses), 1e-9)
    assert rank == 3, "of the arm, which turns about a point of its own, a ball at the tip would hold two turns"


def test_losses_of_constraints(tmp_path):
    efforts = "<limit><lower>-1</lower><upper>1</upper></limit><dynamics><damping>2</damping></dynamics>"
    efforts = UPRIGHT.replace("</axis>", f"{efforts}</axis>")
    everywhere = four_bar("revolute", efforts).replace(UPRIGHT, efforts)
    losses = lost(imported(everywhere, tmp_path))
    assert {name.split("/", 1)[1] for name in losses} >= {"joint[d]/axis/dynamics/damping", "joint[d]/axis/limit/lower"}
    assert {severity for severity, _ in losses.values()} == {"physics"}
    ratings = four_bar("revolute", "<axis><xyz>0 1 0</xyz><limit><effort>5</effort></limit></axis>").replace(
        UPRIGHT, "<axis><xyz>0 1 0</xyz><limit><effort>5</effort></limit></axis>"
    )
    assert {severity for severity, _ in lost(imported(ratings, tmp_path)).values()} == {"information"}


def test_a_joint_follows_another(tmp_path):
    words = '<mimic joint="elbow"><multiplier>-2</multiplier><offset>0.5</offset><reference>0.25</reference></mimic>'
    text = model(
        link("base")
        + link("arm")
        + link("tip")
        + joint("revolute")
        + joint("prismatic", f"<axis>{words}</axis>", "slide", "arm", "tip")
    )
    assert not lost(imported(text, tmp_path))
    (follow,) = world_of(text, tmp_path).constraints
    assert follow == FollowConstraint("slide", "slide", "elbow", -2.0, 1.0)
    none = text.replace("-2", "0")
    assert "follows nothing" in str(lost(imported(none, tmp_path)))
    ball = text.replace('type="revolute"', 'type="ball"')
    with pytest.raises(Exception, match="no position to be followed"):
        imported(ball, tmp_path)


def test_a_joint_that_leads_begins_where_its_follower_is_within_its_limits(tmp_path):
    limits = "<limit><lower>{}</lower><upper>{}</upper></limit>"
    words = '<mimic joint="elbow"><multiplier>-2</multiplier><offset>0</offset><reference>0</reference></mimic>'
    follower = f"<axis>{limits.format(-0.8, -0.3)}{words}</axis>"
    leader = f"<axis><xyz>0 1 0</xyz>{limits.format(-1, 1)}</axis>"
    text = model(
        link("base")
        + link("arm")
        + link("tip")
        + joint("revolute", leader)
        + joint("prismatic", follower, "s", "arm", "tip")
    )
    world = world_of(text, tmp_path)
    assert [body.joint.position[0] for body in world.bodies[1:]] == pytest.approx([0.15, -0.3], abs=1e-15)


@pytest.mark.parametrize("kind", ["universal", "revolute2"])
def test_two_axes_of_a_joint_are_two_hinges(kind, tmp_path):
    limited = "<limit><lower>-1</lower><upper>1</upper></limit>"
    axes = "<pose>0 0 -0.5 0 0 0</pose><axis><xyz>1 0 0</xyz></axis>"
    axes += f"<axis2><xyz>0 1 0</xyz>{limited}</axis2>"
    text = model(link("base") + placed("arm", 1) + FIXED + joint(kind, axes))
    first, second = imported(text, tmp_path).data["model"]["bodies"]["arm"]["joints"]
    assert first == {"name": "elbow", "type": "hinge", "origin": {"xyz": [1.0, 0.0, -0.5]}, "axis": [1.0, 0.0, 0.0]}
    assert second == {
        "name": "elbow_axis2",
        "type": "hinge",
        "axis": [0.0, 1.0, 0.0],
        "limits": {"position": [-1.0, 1.0]},
    }
    assert not lost(imported(text, tmp_path))
    follower = joint("revolute", '<axis><mimic joint="elbow" axis="axis2"/></axis>', "last", "arm", "tip")
    coupled = text.replace("</model>", link("tip") + follower + "</model>")
    (follow,) = world_of(coupled, tmp_path).constraints
    assert (follow.joint, follow.leader) == ("last", "elbow_axis2")


def test_models_that_are_merged_are_where_another_reader_has_them(tmp_path):
    pose = "<pose>{} 0.1 0.2 0.3 0.4 0.5</pose>"
    inner = link("base", pose.format(1)) + link("arm", pose.format(2)) + joint("revolute", pose.format(0) + UPRIGHT)
    inner += "<frame name='grip' attached_to='arm'><pose>0 0 1 0 0 0</pose></frame>"
    (tmp_path / "arm.sdf").write_text(model(inner, words=" placement_frame='arm'").replace('"robot"', '"part"'))
    include = f"<include merge='true'><uri>package://here/arm.sdf</uri>{pose.format(-1)}</include>"
    outer = link("table", pose.format(3)) + joint("fixed", "", "hold", "world", "table") + include
    outer += joint("fixed", "", "stand", "table", "base") + link("tool", "<pose relative_to='grip'/>")
    outer += joint("prismatic", UPRIGHT, "slide", "arm", "tool")
    path = tmp_path / "robot.sdf"
    path.write_text(model(outer))
    (tmp_path / "package.xml").write_text("<package><name>here</name></package>")
    from simspec.language.foreign import ImportOptions

    world = load(path, options=ImportOptions(packages={"here": "."}, base=tmp_path)).resolve()
    assert {body.name for body in world.bodies} == {"table", "base", "arm", "tool"}
    request = tmp_path / "requests.json"
    request.write_text(json.dumps([{"file": str(path), "positions": {}}]))
    script = Path(__file__).with_name("drake_reader.py")
    done = subprocess.run([sys.executable, str(script), str(request)], capture_output=True, text=True, check=True)
    (read,) = json.loads(done.stdout.splitlines()[-1])
    poses = Oracle(world).body_poses(initial_state(world)[0])
    for body, place in zip(world.bodies, poses, strict=True):
        centre = place[:3] + np.array(frames.rotate(tuple(place[3:]), body.inertial.centre_of_mass))
        np.testing.assert_allclose(centre, read["bodies"][f"robot::{body.name}"]["centre"], atol=1e-12)


def test_names_of_merged_models_are_those_of_the_model_around(tmp_path):
    (tmp_path / "arm.sdf").write_text(model(link("base") + link("arm") + joint("revolute")))
    twice = "<include merge='true'><uri>arm.sdf</uri></include>" * 2
    with pytest.raises(Exception, match="the name of two things"):
        imported(model(link("table") + twice), tmp_path, name="twice.sdf")


def test_long_chains_are_read_link_by_link(tmp_path):
    """Of frames that are attached to one another, and of links that fixed joints hold to the world in the end: each link of a
    chain looks its top up a single time, however long the chain is."""
    count = 300
    names = [f"l{number}" for number in range(count)]
    chain = [
        joint("fixed", name=f"j{number}", parent=names[number - 1], child=names[number]) for number in range(1, count)
    ]
    chain.append(joint("fixed", name="ground", parent="world", child=names[0]))
    around = joint("fixed", name="closing", parent=names[-1], child=names[0])
    frame = [
        f"<frame name='f{number}' attached_to='{f'f{number + 1}' if number < 99 else 'l7'}'/>" for number in range(100)
    ]
    text = model("".join(map(link, names)) + "".join(chain) + "".join(frame))
    data = imported(text, tmp_path).data["model"]
    assert [body.get("parent") for body in data["bodies"].values()] == [None, *names[:-1]]
    assert {frame["body"] for frame in data["frames"].values()} == {"l7"}
    closed = imported(model("".join(map(link, names)) + "".join(chain[:-1]) + around), tmp_path)
    assert list(closed.data["model"]["constraints"]) == ["closing"]
