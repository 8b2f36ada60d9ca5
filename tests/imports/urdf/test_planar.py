"""Planar joints: two slides and a hinge."""

import math

import numpy as np
import pytest

from simspec.imports.urdf.joints import across
from simspec.language.foreign import LossSeverity
from simspec.language.load import load
from tests.imports.urdf.robots import SOLID, read, refused, two_links

WELD = '<link name="world"/><joint name="w" type="fixed"><parent link="world"/><child link="base"/></joint>'
TURNED = '<origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.5"/><axis xyz="0 0 1"/>'


def test_a_planar_joint_moves_as_the_file_says(tmp_path):
    """Pose and mass matrix are those of another reader, which has a planar joint: its velocities are in the body's axes."""
    pinocchio = pytest.importorskip("pinocchio")
    from simspec.dynamics.oracle import Oracle

    arm = SOLID.replace("<mass", '<origin xyz="0.1 0.2 0.3"/><mass')
    (tmp_path / "r.urdf").write_text(two_links(TURNED, arm=arm, more=WELD, kind="planar"))
    world = load(tmp_path / "r.urdf").resolve()
    oracle = Oracle(world)
    x, y, turn = 0.3, -0.7, 0.9
    q, cosine, sine = np.array([x, y, turn]), math.cos(turn), math.sin(turn)
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "r.urdf"))
    data = model.createData()
    theirs = np.array([x, y, cosine, sine])
    pinocchio.forwardKinematics(model, data, theirs)
    assert oracle.body_poses(q)[-1][:3] == pytest.approx(data.oMi[1].translation, abs=1e-14)
    mass = np.triu(pinocchio.crba(model, data, theirs))
    mass = mass + np.triu(mass, 1).T
    turned = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
    assert oracle.mass_matrix(q) == pytest.approx(turned.T @ mass @ turned, abs=1e-13)


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -2), (1, 0, 0), (-0.6, 0.3, -0.7), (1e-9, 0, -1)])
def test_the_slides_are_across_the_axis(axis):
    x, y = (np.array(direction) for direction in across(axis))
    along = np.array(axis) / np.linalg.norm(axis)
    assert np.allclose([x @ x, y @ y, x @ along, y @ along], [1, 1, 0, 0], atol=1e-15)
    assert np.allclose(np.cross(x, y), along, atol=1e-15)


def test_names_of_the_three_are_no_others(tmp_path):
    more = (
        f'<link name="tip">{SOLID}</link>'
        '<joint name="hinge_x" type="fixed"><parent link="arm"/><child link="tip"/></joint>'
    )
    bodies = read(two_links(more=more, kind="planar"), tmp_path).data["model"]["bodies"]
    names = [joint["name"] for joint in bodies["arm"]["joints"]]
    assert names == ["hinge_x_2", "hinge_y", "hinge_yaw"]
    assert bodies["tip"]["joint"]["name"] == "hinge_x"


def test_limits_and_dampers_of_a_planar_joint_are_reported(tmp_path):
    inside = '<limit lower="-1" upper="1" effort="1" velocity="1"/><dynamics damping="2" friction="0"/>'
    imported = read(two_links(inside, kind="planar"), tmp_path)
    lost = {account.what: account.severity for account in imported.losses()}
    assert lost["joint[hinge]/limit/@lower"] is LossSeverity.INFORMATION
    assert lost["joint[hinge]/dynamics/@damping"] is LossSeverity.PHYSICS
    static = read(two_links('<dynamics damping="0"/>', kind="planar"), tmp_path)
    assert not [account for account in static.losses() if account.severity is LossSeverity.PHYSICS]
    (problem,) = refused(two_links('<dynamics damping="much"/>', kind="planar"), tmp_path)
    assert "robot.urdf:4:" in problem


def test_links_without_mass_around_a_planar_joint(tmp_path):
    """A root that is the world, a planar joint, a massless link, a hinge: one body with four joints."""
    text = (
        '<robot name="r"><link name="world"/><link name="foot"/>'
        f'<link name="base">{SOLID}</link>'
        '<joint name="drive" type="planar"><parent link="world"/><child link="foot"/><axis xyz="0 0 1"/></joint>'
        '<joint name="turret" type="continuous"><parent link="foot"/><child link="base"/><axis xyz="0 0 1"/></joint></robot>'
    )
    bodies = read(text, tmp_path).data["model"]["bodies"]
    assert [joint["name"] for joint in bodies["base"]["joints"]] == ["drive_x", "drive_y", "drive_yaw", "turret"]
    alone = text.replace('<link name="foot"/>', f'<link name="foot">{SOLID}</link>')
    bodies = read(alone, tmp_path).data["model"]["bodies"]
    assert [len(bodies["foot"]["joints"]), bodies["base"]["joint"]["type"], "parent" in bodies["foot"]] == [
        3,
        "hinge",
        False,
    ]
    assert load(tmp_path / "robot.urdf").resolve().bodies
