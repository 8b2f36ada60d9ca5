"""The drawing of a world, and where joints and the joints that follow them put bodies."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import simspec
from simspec.meshes.drawn import wanted
from simspec.report.viewer import drawn
from simspec.report.viewer.scene import joint_position, slider_ranges, slider_values
from simspec.world.appearance import DrawnSurface
from simspec.world.kinematics import poses
from simspec.world.posture import initial_positions, poses_at, with_followers
from simspec.world.shapes import SHAPES
from simspec.world.types import FollowConstraint, Joint, Shape
from tests.runner.synthetic import free_body, world


@pytest.fixture(scope="module")
def gripper():
    return simspec.load(simspec.find_spec("coupled-gripper")).resolve()


def test_the_initial_positions_are_the_initial_poses(gripper):
    for of in (gripper, simspec.load(simspec.find_spec("double-pendulum")).resolve()):
        assert poses_at(of, initial_positions(of)) == poses(of) == poses_at(of, {})


def test_a_follower_moves_with_its_leader(gripper):
    start = poses(gripper)
    placed = poses_at(gripper, with_followers(gripper, {**initial_positions(gripper), "left_slide": (0.03,)}))
    shifts = {name: placed[name].position[0] - start[name].position[0] for name in ("left", "right", "bar")}
    before = gripper.bodies[[body.name for body in gripper.bodies].index("left")].joint.position[0]
    assert shifts == pytest.approx({"left": 0.03 - before, "right": before - 0.03, "bar": 0.0}, abs=1e-12)


def test_followers_of_followers_and_rings():
    of = world(free_body("a"))
    chain = (FollowConstraint("x", "b", "a", 2.0, 0.5), FollowConstraint("y", "c", "b", -1.0))
    given = {"a": (1.0,), "b": (0.0,), "c": (0.0,)}
    for constraints in (chain, chain[::-1]):
        made = with_followers(dataclasses.replace(of, constraints=constraints), given)
        assert made == {"a": (1.0,), "b": (2.5,), "c": (-2.5,)}
    ring = (FollowConstraint("x", "a", "b", 1.0), FollowConstraint("y", "b", "a", 1.0))
    assert with_followers(dataclasses.replace(of, constraints=ring), given)["a"] in ((0.0,), (1.0,))


SIZES = {
    "sphere": (0.3,),
    "box": (0.2, 0.4, 0.6),
    "cylinder": (0.3, 0.8),
    "capsule": (0.2, 0.5),
    "ellipsoid": (0.1, 0.2, 0.3),
}


@pytest.mark.parametrize("kind", SIZES)
def test_triangles_reach_as_far_as_the_shape(kind):
    pytest.importorskip("trimesh", reason="trimesh is not installed (extra meshes)")
    vertices, faces = drawn.triangles(Shape("x", kind, SIZES[kind]))
    axes = np.vstack([np.eye(3), -np.eye(3)])
    assert (vertices @ axes.T).max(axis=0) == pytest.approx(SHAPES[kind].support(SIZES[kind], axes), rel=0.02)
    corners = vertices[faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    assert volume == pytest.approx(SHAPES[kind].volume(SIZES[kind]), rel=0.03)  # closed, wound outwards


def test_a_plane_has_no_triangles():
    assert drawn.triangles(Shape("x", "plane", ())) is None


def test_a_mesh_is_drawn_as_its_file_has_it_where_that_can_be_read():
    of = simspec.load(simspec.find_spec("coupled-gripper")).resolve()
    bar = of.bodies[[body.name for body in of.bodies].index("bar")]
    (hull,) = drawn.visual_parts(bar, {})
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4")
    corners = np.array([[0, 1, 2], [0, 1, 3]], "<u2")
    red = (1.0, 0.0, 0.0, 1.0)
    surface = DrawnSurface(vertices.tobytes(), corners.tobytes(), ((red, 1), (None, 1)), 2)
    written = bar.shapes[0].drawn
    parts = list(drawn.visual_parts(bar, {wanted(written): surface}))
    assert [part.colour for part in parts] == [bar.shapes[0].colour] * 2  # the spec gives one
    plain = dataclasses.replace(bar.shapes[0], drawn=dataclasses.replace(written, coloured=False))
    parts = list(drawn.visual_parts(dataclasses.replace(bar, shapes=(plain,)), {wanted(written): surface}))
    assert [part.colour for part in parts] == [red, plain.colour]
    assert [part.mesh[0][part.mesh[1]].tolist() for part in parts] == [vertices[row][None].tolist() for row in corners]
    assert len(hull.mesh[1]) > 2
    further = dataclasses.replace(plain, drawn=dataclasses.replace(written, first=False))
    assert not list(drawn.visual_parts(dataclasses.replace(bar, shapes=(further,)), {wanted(written): surface}))


def test_sliders_are_of_joints_that_follow_no_other(gripper):
    ranges = {entry.joint.name: entry for entry in slider_ranges(gripper, 1.0)}
    assert sorted(ranges) == ["left_slide", "lift"]
    assert (ranges["left_slide"].low, ranges["left_slide"].high) == (-0.02, 0.05)
    assert ranges["left_slide"].label == "left_slide (m)"
    assert (ranges["lift"].low, ranges["lift"].high) == (-2.0, 2.0)  # unlimited


def test_a_ball_joint_has_three_sliders():
    half = math.sqrt(0.5)
    joint = Joint("shoulder", "ball", None, position=(half, 0.0, half, 0.0))
    values = slider_values(joint, joint.position)
    assert values == pytest.approx((0.0, math.pi / 2, 0.0))
    assert joint_position(joint, values) == pytest.approx(joint.position)
    of = world(dataclasses.replace(free_body("arm"), joint=joint))
    assert [entry.label for entry in slider_ranges(of, 1.0)] == [f"shoulder (rad) {axis}" for axis in "xyz"]


def test_ranges_of_joints_are_lines():
    hinge = Joint("h", "hinge", axis=(0.0, 0.0, 1.0), position_limits=(-1.0, 0.5), position=(0.0,))
    lines = drawn.limits_line(hinge, 1.0)
    reached = sorted(math.atan2(y, x) for x, y, _ in lines[:-2].reshape(-1, 3))
    start = math.atan2(*reversed(drawn.pointer_line(hinge, 1.0)[0, 1][:2]))
    assert reached[0] == pytest.approx(start - 1.0)
    assert reached[-1] == pytest.approx(start + 0.5)
    slide = dataclasses.replace(hinge, kind="slide")
    assert drawn.limits_line(slide, 1.0)[0] == pytest.approx(np.array([[0, 0, -1.0], [0, 0, 0.5]]))
    assert not len(drawn.limits_line(Joint("b", "ball"), 1.0))


def test_near_pairs_are_of_shapes_that_may_touch(gripper):
    placed, shapes = poses_at(gripper, {}), drawn.solids(gripper)
    near = drawn.near_pairs(gripper, shapes, placed, 0.02)
    assert len(near)
    far = {**placed, "bar": dataclasses.replace(placed["bar"], position=(0.0, 5.0, 5.0))}
    assert len(drawn.near_pairs(gripper, shapes, far, 0.02)) < len(near)
    floor = [pair for pair in near if pair[0, 2] == pytest.approx(0.0)]
    assert floor  # from the nearest point of the plane
    assert floor[0][0, :2] == pytest.approx(floor[0][1, :2])


def test_the_scene_reaches_to_a_near_plane(gripper):
    scene = drawn.extent(gripper)
    for body in ("bar", "hand", "left"):
        away = np.linalg.norm(np.subtract(poses(gripper)[body].position, scene.centre))
        assert away <= scene.radius
    assert abs(scene.centre[2]) <= scene.radius  # the floor is in sight


def test_forces_are_arrows_with_their_size_in_words():
    spec = simspec.Spec.from_data(
        {
            "simspec": 1,
            "name": "pushed",
            "physics": {"duration": 1, "timestep": "1 ms"},
            "bodies": {"ball": {"mass": 1, "inertia": {"principal": [0.01, 0.01, 0.01]}}},
            "forces": [
                {"body": "ball", "force": [30, 0, 40], "until": "0.5 s"},
                {"body": "ball", "torque": [0, 2, 0]},
            ],
        }
    )
    found = drawn.loads(spec.resolve(), drawn.Extent((0.0, 0.0, 0.0), 2.0))
    assert [load.words for load in found] == ["gravity 9.81 m/s²", "50 N, 0 s to 0.5 s", "2 N m, 0 s to the end"]
    assert found[1].along == pytest.approx((0.6, 0.0, 0.8))
    assert [load.turning for load in found] == [False, False, True]
