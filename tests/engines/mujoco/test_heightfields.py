"""Height fields in MuJoCo: stored values, points of contact, and limits of contact with faces."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.mujoco.contact import FEW, ROCKS, ground_supported
from simspec.proof.checks import field_distance
from simspec.proof.touch.geometry import gap, solids
from simspec.support.declarations import Level
from simspec.testing.worlds import GROUND, accepting, ground
from simspec.world.shapes import HEIGHTFIELD_HEAD, heightfield_size

mujoco = pytest.importorskip("mujoco")


def loaded(world):
    xml = compile_world(accepting(world, "mujoco"), ["mujoco"])["mujoco"].files["model.xml"]
    return mujoco.MjModel.from_xml_string(xml)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e3, 0.0])
def test_it_holds_heights_to_single_precision_of_their_range(scale):
    """Shares are rounded to the nearest of 24 bits: off by 2⁻²⁵ at most, 3e-8."""
    base = ground()
    floor = base.bodies[0]
    heights = scale * np.array(GROUND[HEIGHTFIELD_HEAD:]).reshape(3, 4)
    shape = dataclasses.replace(floor.shapes[0], size=heightfield_size(0.8, 0.6, 0.2, heights))
    model = loaded(dataclasses.replace(base, bodies=(dataclasses.replace(floor, shapes=(shape,)), *base.bodies[1:])))
    actual = model.hfield_size[0, 2] * np.asarray(model.hfield_data, dtype=float).reshape(3, 4)
    assert np.abs(actual - heights).max() <= 2.0**-25 * heights.max()
    if scale == 1.0:
        assert 0.0 < field_distance(GROUND, heightfield_size(0.8, 0.6, 0.2, actual)) < 3e-8 * 0.12 / 0.8


def test_a_ball_touches_it_where_the_triangles_are():
    """Its distance to the field, against coal's to the prisms, over both triangles of every cell, edges and walls."""
    world = ground()
    model = loaded(world)
    data = mujoco.MjData(model)
    field, ball = solids(world)
    place = np.eye(4)
    place[:3, 3] = world.bodies[0].shapes[0].pose.position
    generator = np.random.default_rng(4)
    grown = dataclasses.replace(ball, shape=dataclasses.replace(ball.shape, size=(0.05,)))
    geom, other = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in ("floor_0", "sphere_0"))
    compared = 0
    for _ in range(300):
        data.qpos[:3] = generator.uniform((-0.4, -0.4, -0.15), (0.6, 0.4, 0.15))
        mujoco.mj_forward(model, data)
        at = np.eye(4)
        at[:3, 3] = data.geom_xpos[other]
        expected = gap(field, place, grown, at).distance
        found = [c.dist for c in data.contact if {c.geom1, c.geom2} == {geom, other}]
        if abs(expected) < 1e-6 or expected < -0.03:  # deeper: which way out is shorter
            continue
        assert bool(found) == (expected < 0.0), data.qpos[:3]
        if found:
            assert min(found) == pytest.approx(expected, abs=2e-6)
            compared += 1
    assert compared > 40


def test_faces_and_edges_are_accepted_by_name():
    assert ground_supported(ground(("sphere", "ellipsoid"))) is None
    for kind in ("box", "cylinder", "capsule", "mesh"):
        assert ground_supported(ground(("sphere", kind))) is ROCKS
    assert ROCKS.level is FEW.level is Level.APPROXIMATE
    world = ground(("box",))
    contact = dataclasses.replace(world.contact, excluded_bodies=(("box", "floor"),))
    assert ground_supported(dataclasses.replace(world, contact=contact)) is None


def test_a_shape_over_more_triangles_than_mujoco_has_contacts_is_reported():
    """A plate on flat ground of 40 × 40 cells: MuJoCo keeps 50 contacts, all below one of its edges."""
    world = ground(("box",))
    floor, box = world.bodies
    flat = dataclasses.replace(floor.shapes[0], size=heightfield_size(2.0, 2.0, 0.2, np.zeros((41, 41))))
    plate = dataclasses.replace(box.shapes[0], size=(1.2, 1.2, 0.1))
    world = dataclasses.replace(
        world, bodies=(dataclasses.replace(floor, shapes=(flat,)), dataclasses.replace(box, shapes=(plate,)))
    )
    assert ground_supported(world) is FEW
    model = loaded(world)
    data = mujoco.MjData(model)
    data.qpos[:7] = (0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    mujoco.mj_kinematics(model, data)
    turn = np.zeros(4)
    mujoco.mju_mat2Quat(turn, data.geom_xmat[1])
    mujoco.mju_negQuat(turn, turn)
    data.qpos[3:7] = turn  # the plate lies flat
    mujoco.mj_kinematics(model, data)
    data.qpos[:3] += np.array((0.1, 0.0, -0.1 + 0.0499)) - data.geom_xpos[1]
    mujoco.mj_forward(model, data)
    assert data.ncon == 50
    assert not any(warning.number for warning in data.warning)
    reach = np.ptp(data.contact.pos[:, :2], axis=0)
    assert reach.min() < 0.2
    assert reach.max() > 1.0
