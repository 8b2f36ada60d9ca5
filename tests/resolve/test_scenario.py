"""Spec to world: the numeric result of every keyword of the language."""

from __future__ import annotations

import dataclasses
import itertools
import math
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.errors import SpecError
from simspec.language.load import Spec, load
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.world import frames
from simspec.world.canonical import sha256
from simspec.world.kinematics import poses, trees
from simspec.world.types import Contact, Hardness, Inertial, Joint, PairContact, Physics, Pose, RecordOptions, World

resolve = Spec.resolve

TABLE = Path(__file__).parents[1] / "language" / "data" / "table.yaml"
ARM = TABLE.parent / "models" / "arm.yaml"
SOLID = {"mass": 1, "inertia": {"principal": [1, 1, 1]}}
HINGE = {"type": "hinge", "axis": [0, 0, 1]}


def world(bodies=None, **more) -> World:
    contact = more.pop("contact", {"materials": {"m": {"friction": 0.5}}})
    data = {"name": "x", "contact": contact, **more}
    if bodies is not None:
        data["bodies"] = bodies
    return resolve(Spec.from_data(data))


def by_name(found: World):
    return {body.name: body for body in found.bodies}


def only_body(**fields):
    (body,) = world({"a": {**SOLID, **fields}}).bodies
    return body


def exactly(values):
    return pytest.approx(values, rel=1e-15, abs=1e-15)  # one or two roundings


# --- roots and joints ---


def test_a_root_is_free_unless_it_has_a_joint():
    body = only_body(
        pose={"xyz": [1, 2, 3], "rpy": [0, 0, "90 deg"]}, velocity={"linear": [1, 0, 0], "angular": [0, 0, 2]}
    )
    half = math.sqrt(0.5)
    assert body.joint.kind == "free"
    assert body.joint.parent is None
    assert body.joint.origin == Pose()
    assert body.joint.position == exactly((1, 2, 3, half, 0, 0, half))
    assert body.joint.velocity == (1, 0, 0, 0, 0, 2)
    assert only_body(joint={"type": "free"}).joint == only_body().joint

    fixed = only_body(fixed=True, pose={"xyz": [1, 2, 3]}).joint
    assert (fixed.kind, fixed.origin, fixed.position, fixed.velocity) == ("fixed", Pose((1.0, 2.0, 3.0)), (), ())
    assert only_body(joint={"type": "fixed", "origin": {"xyz": [1, 2, 3]}}).joint == fixed


@pytest.mark.parametrize("kind", ["hinge", "slide", "ball"])
def test_the_pose_of_a_jointed_root_is_its_joints_origin(kind):
    joint = {"type": kind} | ({} if kind == "ball" else {"axis": [0, 0, 1]})
    place = {"xyz": [1, 2, 3], "quat": [0.6, 0.8, 0, 0]}
    assert only_body(joint=joint, pose=place) == only_body(joint={**joint, "origin": place})
    assert only_body(joint=joint, pose=place).joint.origin == Pose((1.0, 2.0, 3.0), (0.6, 0.8, 0.0, 0.0))


def test_every_number_of_a_hinge():
    joint = {
        **HINGE,
        "name": "j",
        "axis": [0, 3, 4],
        "limits": {"position": ["-90 deg", "45 deg"], "velocity": "60 rpm", "effort": "5 N m"},
        "damping": 0.1,
        "dry_friction": 0.2,
        "armature": 0.3,
        "spring": {"stiffness": 0.4, "rest": "30 deg"},
        "position": "15 deg",
        "velocity": "2 rad/s",
    }
    assert only_body(joint=joint).joint == Joint(
        "j", "hinge", None, Pose(), (0.0, 0.6, 0.8), (-math.pi / 2, math.pi / 4), 2 * math.pi, 5.0,
        0.1, 0.2, 0.3, 0.4, math.pi / 6, (math.pi / 12,), (2.0,),
    )  # fmt: skip


def test_every_number_of_a_slide():
    joint = {
        "type": "slide",
        "axis": [0, 0, -2],
        "limits": {"position": ["-5 cm", "5 cm"], "velocity": "1 m/s", "effort": "7 N"},
        "damping": "1 N s/m",
        "dry_friction": "2 N",
        "armature": "3 kg",
        "spring": {"stiffness": "4 N/mm", "rest": "1 mm"},
        "position": "2 cm",
        "velocity": "3 mm/s",
    }
    assert only_body(joint=joint).joint == Joint(
        "a_joint", "slide", None, Pose(), (0.0, 0.0, -1.0), (-0.05, 0.05), 1.0, 7.0,
        1.0, 2.0, 3.0, 4000.0, 0.001, (0.02,), (0.003,),
    )  # fmt: skip


def test_every_number_of_a_ball():
    joint = {
        "type": "ball",
        "damping": 0.1,
        "spring": {"stiffness": 2},
        "position": {"quat": [-0.6, 0, 0, -0.8]},
        "velocity": [1, "60 deg/s", 3],
    }
    found = only_body(joint=joint).joint
    assert found == Joint(
        "a_joint",
        "ball",
        damping=0.1,
        spring_stiffness=2.0,
        position=(0.6, 0.0, 0.0, 0.8),
        velocity=(1.0, math.pi / 3, 3.0),
    )


def test_defaults_are_written_out():
    found = world({"a": {**SOLID, "joint": HINGE}})
    assert found.physics == Physics((0.0, 0.0, -9.81), 0.001, 0)
    assert found.record == RecordOptions(1, ("contacts", "energy", "pose", "velocity"))
    assert found.bodies[0].joint == Joint("a_joint", "hinge", axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    assert found.expectations == ()
    assert found.engines == ()


@given(
    st.tuples(*[st.floats(-1e3, 1e3)] * 3).filter(lambda v: max(map(abs, v)) > 1e-3),
    st.sampled_from([1e-180, 1.0, 1e20]),
)
def test_axes_are_normalised(axis, scale):
    found = np.array(only_body(joint={**HINGE, "axis": [value * scale for value in axis]}).joint.axis)
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=4e-16)
    assert np.cross(found, axis) == pytest.approx(np.zeros(3), abs=1e-12 * max(map(abs, axis)))


# --- mass properties ---


def inertial(shapes, **fields) -> Inertial:
    (body,) = world({"a": {"shapes": shapes, **fields}}).bodies
    return body.inertial


def test_given_mass_properties_are_taken_as_they_are():
    tensor = {"xx": 2, "yy": 3, "zz": 4, "xy": 0.1, "xz": -0.2, "yz": 0.3}
    (body,) = world({"a": {"mass": 5, "centre_of_mass": [1, 2, 3], "inertia": {"tensor": tensor}}}).bodies
    assert body.inertial == Inertial(5.0, (1.0, 2.0, 3.0), (2.0, 3.0, 4.0, 0.1, -0.2, 0.3))


def test_principal_axes_are_turned_into_the_bodys():
    (body,) = world({"a": {"mass": 5, "inertia": {"principal": [2, 3, 4], "rpy": [0, 0, "90 deg"]}}}).bodies
    assert body.inertial.inertia == exactly((3, 2, 4, 0, 0, 0))


def test_a_density_gives_the_mass_of_the_volume():
    found = inertial([{"box": {"size": [1, 2, 3]}, "density": 10, "pose": {"xyz": [1, 0, 0]}}])
    assert found.mass == 60.0
    assert found.centre_of_mass == (1.0, 0.0, 0.0)
    assert found.inertia == exactly((60 * 13 / 12, 60 * 10 / 12, 60 * 5 / 12, 0, 0, 0))


def test_a_mass_is_spread_over_the_collision_shapes_by_volume():
    small, large = {"box": {"size": [1, 1, 1]}}, {"box": {"size": [1, 1, 2]}}
    shapes = [
        {**small, "pose": {"xyz": [3, 0, 0]}},
        large,
        {"sphere": {"radius": 9}, "collision": False},
    ]
    found = inertial(shapes, mass=6)
    assert found.mass == 6.0
    assert found.centre_of_mass == exactly((1, 0, 0))
    assert found.inertia[0] == exactly(2 * 2 / 12 + 4 * 5 / 12)
    as_densities = inertial([{**shapes[0], "density": 2}, {**shapes[1], "density": 2}, shapes[2]])
    assert as_densities.inertia == exactly(found.inertia)


def test_without_collision_shapes_visual_shapes_have_the_mass():
    visual = {"sphere": {"radius": 2}, "collision": False}
    assert inertial([visual], mass=5).inertia == exactly((8, 8, 8, 0, 0, 0))


def test_a_shape_of_density_zero_is_massless():
    ball = {"sphere": {"radius": 1}, "density": 1}
    lid = {"sphere": {"radius": 9}, "density": 0, "pose": {"xyz": [5, 5, 5]}}
    assert inertial([ball, lid]) == inertial([ball])


def test_fixed_bodies_need_no_mass():
    bodies = {
        "post": {"fixed": True},
        "arm": {"parent": "post", "joint": {"type": "fixed"}},
        "weight": {"fixed": True, "mass": 3},
    }
    assert [body.inertial.mass for body in world(bodies).bodies] == [0.0, 0.0, 3.0]
    bodies["arm"]["joint"] = HINGE
    with pytest.raises(SpecError, match="needs a mass"):
        world(bodies)


# --- shapes ---


def test_every_shape():
    shapes = [
        {"name": "s", "sphere": {"radius": 1}},
        {"box": {"size": [1, 2, 3]}, "colour": [1, 0, 0]},
        {"cylinder": {"radius": 1, "length": 2}, "visual": False},
        {"capsule": {"radius": 1, "length": 2}, "collision": False, "colour": [0, 1, 0, 0.5]},
        {"ellipsoid": {"radii": [1, 2, 3]}, "pose": {"xyz": [0, 0, 1]}},
        {"plane": {}},
    ]
    (body,) = world({"a": {"fixed": True, "shapes": shapes}}).bodies
    assert [(shape.name, shape.kind, shape.size) for shape in body.shapes] == [
        ("s", "sphere", (1.0,)),
        ("a_1", "box", (1.0, 2.0, 3.0)),
        ("a_2", "cylinder", (1.0, 2.0)),
        ("a_3", "capsule", (1.0, 2.0)),
        ("a_4", "ellipsoid", (1.0, 2.0, 3.0)),
        ("a_5", "plane", ()),
    ]
    assert [shape.material for shape in body.shapes] == ["m", "m", "m", "", "m", "m"]
    assert [shape.visual for shape in body.shapes] == [True, True, False, True, True, True]
    assert body.shapes[1].colour == (1.0, 0.0, 0.0, 1.0)
    assert body.shapes[3].colour == (0.0, 1.0, 0.0, 0.5)
    assert body.shapes[4].pose == Pose((0.0, 0.0, 1.0))


# --- trees ---


def test_parents_come_first_for_every_order_of_the_file():
    bodies = {
        "c": {**SOLID, "parent": "b", "joint": HINGE},
        "b": {**SOLID, "parent": "a", "joint": HINGE},
        "z": SOLID,
        "a": SOLID,
        "d": {**SOLID, "parent": "a", "joint": HINGE},
    }
    found = world(bodies)
    assert [body.name for body in found.bodies] == ["z", "a", "b", "c", "d"]
    assert [body.model for body in found.bodies] == ["z", "a", "a", "a", "a"]
    assert found.contact.excluded_bodies == (("a", "b"), ("a", "d"), ("b", "c"))


@given(st.permutations(range(8)), st.lists(st.integers(0, 7), min_size=8, max_size=8))
def test_any_tree_in_any_order_is_the_same_tree(order, parents):
    bodies = {}
    for index in order:
        body = dict(SOLID)
        if index and parents[index] % index != index:
            body |= {"parent": f"b{parents[index] % index}", "joint": HINGE}
        bodies[f"b{index}"] = body
    found = world(bodies)
    place = {body.name: number for number, body in enumerate(found.bodies)}
    assert sorted(place) == sorted(bodies)
    assert all(body.joint.parent is None or place[body.joint.parent] < place[body.name] for body in found.bodies)
    assert {body.name: body.joint.parent for body in found.bodies} == {
        name: body.get("parent") for name, body in bodies.items()
    }


# --- arrays ---


def positions(array, **more):
    found = world({"a": {**SOLID, "array": array, **more}})
    return [body.name for body in found.bodies], np.array([body.joint.position for body in found.bodies])


def test_a_grid_runs_fastest_along_z():
    names, found = positions({"grid": [2, 2, 3], "spacing": [1, 10, 100]}, pose={"xyz": [0.5, 0, 0]})
    assert names[0] == "a_00"
    assert names[-1] == "a_11"
    expected = [(0.5 + x, 10 * y, 100 * z) for x, y, z in itertools.product(range(2), range(2), range(3))]
    assert found[:, :3].tolist() == [list(map(float, place)) for place in expected]


def test_a_line_a_ring_and_poses():
    _, line = positions({"line": 3, "step": [0, "10 cm", 0]})
    assert line[:, :3].tolist() == [[0, 0, 0], [0, 0.1, 0], [0, 0.2, 0]]
    names, ring = positions({"ring": 4, "radius": 2, "face": True})
    assert names == ["a_0", "a_1", "a_2", "a_3"]
    assert ring[:, :3] == exactly(np.array([[2, 0, 0], [0, 2, 0], [-2, 0, 0], [0, -2, 0]], float))
    for row in ring:  # facing outwards: the x axis of each element points along its place
        assert frames.rotate(tuple(row[3:]), (2.0, 0.0, 0.0)) == exactly(tuple(row[:3]))
    assert positions({"ring": 4, "radius": 2})[1][:, 3:].tolist() == [[1, 0, 0, 0]] * 4
    _, given_poses = positions({"poses": [{"xyz": [1, 2, 3]}, {"quat": [0, 1, 0, 0]}]})
    assert given_poses.tolist() == [[1, 2, 3, 1, 0, 0, 0], [0, 0, 0, 0, 1, 0, 0]]


def test_an_array_is_laid_out_in_the_frame_of_its_pose():
    turned = {"xyz": [1, 0, 0], "rpy": [0, 0, "90 deg"]}
    _, found = positions({"line": 2, "step": [1, 0, 0]}, pose=turned)
    assert found[1, :3] == exactly(np.array([1.0, 1.0, 0.0]))
    assert found[0, 3:].tolist() == found[1, 3:].tolist()


def test_uniform_jitter_is_three_draws_of_pythons_generator_per_element():
    _, static = positions({"line": 50, "step": [1, 0, 0]})
    _, found = positions({"line": 50, "step": [1, 0, 0], "jitter": {"uniform": "1 mm", "seed": 5}})
    draw = random.Random(5).random
    expected = [[-0.001 + 0.002 * draw() for _ in range(3)] for _ in range(50)]
    assert found[:, :3] - static[:, :3] == pytest.approx(np.array(expected), abs=1e-14)  # rounding at coordinates of 50
    assert np.abs(found[:, :3] - static[:, :3]).max() <= 0.001
    _, again = positions({"line": 50, "step": [1, 0, 0], "jitter": {"uniform": "1 mm", "seed": 6}})
    assert (again != found).any()


def test_radial_jitter_scales_each_offset_by_a_single_draw():
    grid = {"grid": [3, 3, 3], "spacing": 0.21}
    _, static = positions(grid, pose={"xyz": [0, 0, 1]})
    _, found = positions({**grid, "jitter": {"radial": "0.1 %", "seed": 216}}, pose={"xyz": [0, 0, 1]})
    draw = random.Random(216).random
    origin = np.array([0, 0, 1.0])
    scales = np.array([1 - 0.001 + 0.002 * draw() for _ in range(27)])
    expected = origin + (static[:, :3] - origin) * scales[:, None]
    assert found[:, :3] == pytest.approx(expected, abs=1e-15)
    assert found[0, :3].tolist() == [0, 0, 1]


def test_arrays_copy_whole_trees():
    bodies = {
        "cart": {**SOLID, "array": {"line": 2, "step": [5, 0, 0]}},
        "rod": {
            **SOLID,
            "parent": "cart",
            "joint": {**HINGE, "name": "pin"},
            "shapes": [{"name": "tip", "sphere": {"radius": 1}}],
        },
    }
    found = by_name(world(bodies))
    assert list(found) == ["cart_0", "rod_0", "cart_1", "rod_1"]
    assert found["rod_1"].joint.parent == "cart_1"
    assert found["rod_1"].joint.name == "pin_1"
    assert found["rod_1"].shapes[0].name == "tip_1"
    assert found["cart_1"].joint.name == "cart_1_joint"
    assert [body.model for body in found.values()] == ["cart_0", "cart_0", "cart_1", "cart_1"]


@pytest.mark.parametrize(("count", "last"), [(1, "a_0"), (10, "a_9"), (11, "a_10"), (101, "a_100")])
def test_names_of_elements_are_of_equal_width(count, last):
    names, _ = positions({"line": count, "step": [1, 0, 0]})
    assert names[-1] == last
    assert names == sorted(names)


def test_an_array_of_fixed_bodies():
    found = world({"a": {"fixed": True, "array": {"line": 2, "step": [1, 0, 0]}, "pose": {"xyz": [0, 0, 1]}}})
    assert [body.joint.origin.position for body in found.bodies] == [(0, 0, 1), (1, 0, 1)]


# --- models ---


def test_placed_models_have_full_names_and_move_as_wholes():
    found = load(TABLE).resolve()
    bodies = by_name(found)
    names = [f"box_{index:02d}" for index in range(12)]
    names = ["floor", *names, "left/base", "left/upper", "left/hand"]
    names += [f"crowd_{index}/{part}" for index in range(4) for part in ("base", "upper", "hand")]
    assert list(bodies) == names
    base = bodies["left/base"]
    assert base.model == "left"
    assert base.joint.kind == "fixed"
    assert base.joint.name == "left/base_joint"
    assert base.joint.origin.position == (1.0, 0.0, 0.1)
    assert base.shapes[0].name == "left/base_0"
    assert bodies["left/upper"].joint.name == "left/shoulder"
    assert bodies["left/upper"].joint.parent == "left/base"
    assert bodies["left/upper"].joint.position == (math.pi / 6,)
    assert bodies["left/upper"].joint.velocity == (1.0,)
    assert bodies["left/hand"].joint.position == exactly((math.sqrt(0.5), 0, 0, math.sqrt(0.5)))
    crowd = bodies["crowd_1/base"].joint
    assert crowd.kind == "free"
    assert crowd.position[:3] == exactly((0, 3, 0.1))
    assert crowd.velocity == (0, 0, 1, 0, 0, 0)
    assert bodies["crowd_1/upper"].joint.position == (0.0,)
    assert bodies["crowd_1/upper"].model == "crowd_1"


def test_a_placed_model_is_the_model_alone_moved():
    """Every body of the model, placed, is where the placement takes it."""
    alone = load(ARM).resolve()
    place = {"xyz": [1, 2, 3], "rpy": [0.3, -0.4, 0.5]}
    data = {"name": "x", "models": {"arm": {"use": "models/arm.yaml", "pose": place}}}
    moved = Spec.from_data(data, folder=TABLE.parent).resolve()
    frame = Pose((1.0, 2.0, 3.0), frames.from_rpy(0.3, -0.4, 0.5))
    there = poses(moved)
    for name, here in poses(alone).items():
        expected = frames.compose(frame, here)
        assert there[f"arm/{name}"].position == pytest.approx(expected.position, abs=1e-15)
        assert there[f"arm/{name}"].quaternion == pytest.approx(expected.quaternion, abs=1e-15)


def test_an_array_of_models_is_laid_out_in_the_frame_of_its_pose():
    place = {"xyz": [1, 0, 0], "rpy": [0, 0, "90 deg"]}
    root = {**SOLID, "pose": {"xyz": [0, 0, 5]}}
    array = {"poses": [{}, {"xyz": [2, 0, 0], "rpy": [0, "90 deg", 0]}]}
    first, second = world(models={"m": {"bodies": {"a": root}, "pose": place, "array": array}}).bodies
    assert first.joint.position[:3] == exactly((1, 0, 5))
    # the element's frame is 2 m along the turned x axis; turned itself, the root's 5 m up lie along that axis too
    assert second.joint.position[:3] == pytest.approx((1, 7, 0), abs=1e-14)  # rounding of two turns, at 7 m


def test_a_velocity_is_in_the_axes_that_the_pose_is_in():
    """Of a loose body that is the world, whatever the body's own pose turns; its array does not turn it either."""
    turned = {"pose": {"rpy": [0, 0, "90 deg"]}, "velocity": {"linear": [1, 0, 0], "angular": [0, 1, 0]}}
    ring = {"array": {"ring": 4, "radius": 1, "face": True}}
    found = world({"a": SOLID | turned, "b": SOLID | turned | ring})
    assert {body.joint.velocity for body in found.bodies} == {(1, 0, 0, 0, 1, 0)}
    # in a model the same words are in the model's axes, and alone in its file these are the world's
    alone = Spec.from_data({"name": "m", "model": {"bodies": {"a": SOLID | turned}}}).resolve()
    assert alone.bodies[0].joint.velocity == (1, 0, 0, 0, 1, 0)


def test_implied_names_avoid_given_names():
    hinge = {"type": "hinge", "axis": [0, 0, 1]}
    ball = {"sphere": {"radius": 0.1}}
    found = world(
        {
            "base": {
                **SOLID,
                "joint": {**hinge, "name": "base_footprint_joint"},
                "shapes": [{**ball, "name": "arm_0"}],
            },
            "base_footprint": {**SOLID, "parent": "base", "joint": hinge},
            "arm": {**SOLID, "parent": "base", "joint": {**hinge}, "shapes": [ball, ball]},
        }
    )
    assert [body.joint.name for body in found.bodies] == [
        *("base_footprint_joint", "base_footprint_joint_2", "arm_joint"),
    ]
    assert [shape.name for body in found.bodies for shape in body.shapes] == ["arm_0", "arm_0_2", "arm_1"]


def test_a_model_that_is_turned_takes_its_velocity_with_it():
    thrown = {**SOLID, "velocity": {"linear": [1, 0, 0], "angular": [0, 1, 0]}}
    models = {
        "a": {"bodies": {"ball": thrown}, "pose": {"rpy": [0, 0, "90 deg"]}},
        "b": {"bodies": {"ball": thrown}, "pose": {"rpy": [0, 0, "90 deg"]}, "velocity": {"linear": [0, 0, 7]}},
    }
    a, b = world(models=models).bodies
    assert a.joint.velocity == exactly((0, 1, 0, -1, 0, 0))
    assert b.joint.velocity == (0, 0, 7, 0, 0, 0)


@pytest.mark.parametrize(
    ("of_model", "said", "kind"),
    [(True, None, "fixed"), (True, False, "free"), (None, True, "fixed"), (None, None, "free")],
)
def test_whether_a_model_is_fixed_is_said_by_the_placement_else_by_the_model(of_model, said, kind):
    body = SOLID | ({} if of_model is None else {"fixed": of_model})
    model = {"bodies": {"a": body}} | ({} if said is None else {"fixed": said})
    assert world(models={"m": model}).bodies[0].joint.kind == kind


def test_a_model_file_alone_is_a_world():
    found = load(ARM).resolve()
    assert [body.name for body in found.bodies] == ["base", "upper", "hand"]
    assert {body.model for body in found.bodies} == {"arm"}
    assert found.physics.steps == 0
    assert found.contact.excluded_bodies == (("base", "hand"), ("base", "upper"), ("hand", "upper"))
    assert found.contact.ignored_groups == (("hands", "hands"),)


def test_a_model_without_materials_has_a_stated_default_when_it_stands_alone(tmp_path):
    data = {"name": "x", "model": {"bodies": {"a": {"mass": 1, "shapes": [{"sphere": {"radius": 1}}]}}}}
    found = Spec.from_data(data).resolve()
    assert found.bodies[0].shapes[0].material == "default"
    assert [(material.name, material.friction, material.restitution) for material in found.contact.materials] == [
        ("default", 0.0, 0.0)
    ]


# --- contact ---


def pairs(found: World):
    return {(pair.first, pair.second): (pair.friction, pair.restitution) for pair in found.contact.pairs}


MATERIALS = {"b": {"friction": 0.4, "restitution": 0.1}, "a": {"friction": 0.9, "restitution": 0.8}}


@pytest.mark.parametrize(
    ("rule", "friction", "restitution"),
    [
        (None, 0.4, 0.1),
        ("min", 0.4, 0.1),
        ("max", 0.9, 0.8),
        ("product", 0.36, 0.08),
        ("mean", 0.65, 0.45),
        ("geometric-mean", 0.6, math.sqrt(0.08)),
        ({"friction": "max"}, 0.9, 0.1),
        ({"restitution": "mean"}, 0.4, 0.45),
    ],
)
def test_materials_combine_by_the_rule_and_are_themselves_with_themselves(rule, friction, restitution):
    contact = {"materials": MATERIALS} | ({} if rule is None else {"combine": rule})
    found = pairs(world({"a": SOLID}, contact=contact))
    assert list(found) == [("a", "a"), ("a", "b"), ("b", "b")]
    assert found["a", "b"] == exactly((friction, restitution))
    assert found["a", "a"] == (0.9, 0.8)
    assert found["b", "b"] == (0.4, 0.1)


def test_explicit_pairs_override_the_values_that_they_state():
    given_pairs = [{"between": ["b", "a"], "friction": 0.7}, {"between": ["a", "a"], "restitution": 0.5}]
    found = pairs(world({"a": SOLID}, contact={"materials": MATERIALS, "pairs": given_pairs}))
    assert found["a", "b"] == (0.7, 0.1)
    assert found["a", "a"] == (0.9, 0.5)


def test_materials_groups_and_exclusions_of_model_files_come_with_each_placement():
    found = load(TABLE).resolve().contact
    assert [material.name for material in found.materials] == ["rubber", "wood"]
    assert found.pairs[1].friction == 0.7
    assert found.ignored_groups == (("hands", "hands"),)
    expected = {("box_03", "left/hand")}
    for model in ("left", *(f"crowd_{index}" for index in range(4))):
        short = [("base", "hand"), ("base", "upper"), ("hand", "upper")]
        expected |= {(f"{model}/{a}", f"{model}/{b}") for a, b in short}
    assert set(found.excluded_bodies) == expected
    assert list(found.excluded_bodies) == sorted(expected)


def test_shapes_of_a_model_file_use_the_only_material_of_the_file():
    bodies = by_name(load(TABLE).resolve())
    assert bodies["left/base"].shapes[0].material == "rubber"
    assert bodies["floor"].shapes[0].material == "wood"


def test_groups_are_symmetric():
    groups = {"z": {"ignores": ["a", "z"]}, "a": {"ignores": ["z"]}}
    bodies = {"one": {**SOLID, "collision_group": "a"}, "two": {**SOLID, "collision_group": "z"}}
    found = world(bodies, contact={"groups": groups})
    assert found.contact.ignored_groups == (("a", "z"), ("z", "z"))
    assert [body.collision_group for body in found.bodies] == ["a", "z"]


def test_without_materials_there_are_no_pairs():
    assert world({"a": SOLID}, contact={}).contact == Contact()


# --- the rest ---


@pytest.mark.parametrize(
    ("timestep", "duration", "steps"),
    [
        ("1 ms", "4 s", 4000),
        (0.1, 0.3, 3),
        (0.001, 1.001, 1001),
        ("5 ms", "1 min", 12000),
        (1 / 3, 1, 3),
        (0.002, 0, 0),
    ],
)
def test_a_duration_is_a_number_of_steps(timestep, duration, steps):
    found = world({"a": SOLID}, physics={"timestep": timestep, "duration": duration})
    assert found.physics.steps == steps


def test_expectations_and_options():
    expect = [
        {"stays_within": {"body": "a", "upper": [1, 1, 1], "lower": [0, 0, "-1 cm"]}},
        {"comes_to_rest": {"speed": 1}},
    ]
    engines = {
        "zeta": {"settings": {"b": 1, "a": "word", "c": True}, "outside": ["y", "x", "x"]},
        "alpha": {"accept": ["q"]},
    }
    found = world(
        {"a": SOLID}, expect=expect, engines=engines, record={"every": "5 ms", "channels": ["pose", "energy", "pose"]}
    )
    assert found.expectations[0].parameters == (("body", "a"), ("lower", (0, 0, -0.01)), ("upper", (1, 1, 1)))
    assert found.expectations[1].parameters == (("speed", 1.0),)
    assert [options.engine for options in found.engines] == ["alpha", "zeta"]
    assert found.options("zeta").settings == (("a", "word"), ("b", 1), ("c", True))
    assert found.options("zeta").outside == ("x", "y")
    assert found.record == RecordOptions(5, ("energy", "pose"))


def test_a_time_is_recorded_at_the_last_step_too():
    expect = [{"position": {"body": "a", "xyz": [0, 0, 0], "tolerance": 1, "at": 0.105}}]
    physics = {"duration": 0.105}
    assert world({"a": SOLID}, expect=expect, physics=physics, record={"every": 0.01}).expectations


def test_the_same_spec_is_the_same_world_and_any_change_another():
    hashes = {sha256(load(TABLE).resolve()) for _ in range(2)}
    assert len(hashes) == 1
    assert sha256(load(TABLE, sets=["models.left.pose.xyz.0=1.0000000000000002"]).resolve()) not in hashes
    assert sha256(load(TABLE, sets=["models.left.pose.xyz.0=1000 mm"]).resolve()) in hashes


def test_units_and_comments_do_not_change_a_world():
    plain = {"a": {**SOLID, "pose": {"xyz": [0.005, 0, 0], "rpy": [0, math.pi / 6, 0]}}}
    units = {"a": {**SOLID, "pose": {"xyz": ["5 mm", 0, 0], "rpy": [0, "30 deg", 0]}}}
    assert world(plain) == world(units)


def test_a_world_is_frozen():
    found = world({"a": SOLID})
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.name = "y"


STIFF = """simspec: 1
name: stiff
physics: {timestep: 1 ms, duration: 1 s}
contact:
  hardness: HARDNESS
  materials:
    rubber: {friction: 0.5, restitution: 0.2, restitution_threshold: 0.1}
    steel: {friction: 0.2, restitution_threshold: 0.3, torsional_friction: 3 mm, rolling_friction: 2 mm}
  pairs:
    - {between: [steel, rubber], friction: 0.7, hardness: OWN}
    - {between: [steel, steel], collide: false}
bodies:
  floor: {fixed: true, shapes: [{box: {size: [4, 4, 0.2]}, material: steel}]}
  heavy: {pose: {xyz: [1, 0, 1]}, mass: 9 kg, shapes: [{sphere: {radius: 0.1}, material: rubber}]}
  light: {pose: {xyz: [0, 0, 1]}, mass: 1 kg, shapes: [{sphere: {radius: 0.1}, material: rubber}]}
"""


def stiff(tmp_path, everywhere="common", local="common"):
    path = tmp_path / "stiff.yaml"
    path.write_text(STIFF.replace("HARDNESS", everywhere).replace("OWN", local), encoding="utf-8")
    return load(path)


def test_the_whole_law_of_a_pair_is_resolved(tmp_path):
    spring = "{stiffness: 1e4 N/m, damping: 20}"
    found = {
        (pair.first, pair.second): pair
        for pair in stiff(tmp_path, "{time_constant: 5 ms, damping_ratio: 0.5}", spring).resolve().contact.pairs
    }
    both = found["rubber", "steel"]
    assert (both.friction, both.restitution, both.restitution_threshold) == (0.7, 0.0, 0.3)
    assert (both.torsional_friction, both.rolling_friction) == (0.0, 0.0)  # the rule is min
    assert both.hardness == Hardness("stiffness", stiffness=1e4, damping=20.0)
    assert found["rubber", "rubber"].hardness == Hardness("time-constant", time_constant=0.005, damping_ratio=0.5)
    assert found["steel", "steel"] == PairContact("steel", "steel", 0.0, 0.0, collide=False)


@pytest.mark.parametrize(
    ("everywhere", "of_pair", "line", "text"),
    [
        ("{time_constant: 1.9 ms, damping_ratio: 1}", "common", 5, "its time constant is below 2 steps"),
        ("common", "{time_constant: 1.9 ms, damping_ratio: 1}", 10, "its time constant is below 2 steps"),
        ("common", "{stiffness: 2.6e5, damping: 1}", 10, "√(m/k) of 'light' (1 kg)"),
    ],
)
def test_contact_too_stiff_for_the_timestep_is_refused_where_it_is_stated(tmp_path, everywhere, of_pair, line, text):
    with pytest.raises(SpecError) as caught:
        stiff(tmp_path, everywhere, of_pair).resolve()
    (problem,) = caught.value.problems
    assert text in problem.message
    assert problem.location.line == line
    assert "0.002 s" in problem.allowed


def test_contact_that_two_steps_resolve_is_taken(tmp_path):
    stiff(tmp_path, "{time_constant: 2 ms, damping_ratio: 1}", "{stiffness: 2.4e5, damping: 1}").resolve()


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("contact.pairs.rubber.steel.friction", 10),
        ("contact.pairs.rubber.steel.hardness", 10),
        ("contact.pairs.steel.steel.collide", 11),
        ("contact.pairs.rubber.rubber.restitution", 7),
        ("contact.pairs.rubber.rubber.hardness", 5),
        ("contact.pairs.rubber.steel.torsional_friction", 8),
    ],
)
def test_a_pairs_law_is_located_where_it_comes_from(tmp_path, path, line):
    assert stiff(tmp_path).locate(path).line == line


ATTACHED = """simspec: 1
name: attached
models:
  hand:
    attach: arm/fore
    pose: {xyz: [0, 0.1, -0.3], rpy: [0, 0, 90 deg]}
    bodies:
      palm: {mass: 0.3, inertia: {principal: [0.001, 0.001, 0.001]}}
      finger:
        parent: palm
        mass: 0.1
        inertia: {principal: [0.0005, 0.0005, 0.0005]}
        joint: {name: grip, type: hinge, axis: [1, 0, 0], origin: {xyz: [0, 0.05, 0]}, position: 0.3}
  arm:
    fixed: true
    bodies:
      base: {mass: 1, inertia: {principal: [0.01, 0.01, 0.01]}}
      fore:
        parent: base
        mass: 1
        inertia: {principal: [0.01, 0.01, 0.01]}
        joint: {name: elbow, type: hinge, axis: [0, 1, 0], position: 0.7}
"""


def attached(tmp_path, old="", new=""):
    assert old in ATTACHED
    path = tmp_path / "attached.yaml"
    path.write_text(ATTACHED.replace(old, new) if old else ATTACHED, encoding="utf-8")
    return load(path)


def test_an_attached_model_is_in_the_tree_of_its_carrier(tmp_path):
    world = attached(tmp_path).resolve()
    assert [body.name for body in world.bodies] == ["arm/base", "arm/fore", "hand/palm", "hand/finger"]
    palm = world.bodies[2].joint
    assert (palm.kind, palm.parent) == ("fixed", "arm/fore")
    assert list(trees(world)) == ["arm/base"]
    found = poses(world)
    turn = frames.from_axis_angle((0.0, 1.0, 0.0), 0.7)
    np.testing.assert_allclose(found["hand/palm"].position, frames.rotate(turn, (0.0, 0.1, -0.3)), atol=1e-15)
    assert ("arm/fore", "hand/palm") in world.contact.excluded_bodies
    assert world.bodies[3].joint.position == (0.3,)


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("arm/fore", "arm/four", "no model has a body or a frame 'arm/four'"),
        ("arm/fore", "hand/finger", "attached to each other"),
        ("    attach: arm/fore\n", "    attach: arm/fore\n    fixed: true\n", "no fixed of its own"),
        (
            "    attach: arm/fore\n",
            "    attach: arm/fore\n    velocity: {linear: [1, 0, 0]}\n",
            "no velocity of its own",
        ),
        (
            "    attach: arm/fore\n",
            "    attach: arm/fore\n    array: {grid: [2, 1, 1], spacing: 1}\n",
            "no array of its own",
        ),
    ],
)
def test_invalid_attachments_are_rejected(tmp_path, old, new, text):
    with pytest.raises(SpecError, match=text):
        attached(tmp_path, old, new).resolve()


def test_two_models_attached_to_each_other_are_refused(tmp_path):
    with pytest.raises(SpecError, match="attached to each other"):
        attached(tmp_path, "    fixed: true\n", "    attach: hand/palm\n").resolve()


BALL = {"shapes": [{"sphere": {"radius": 1}, "material": "m"}]}
CHAIN = {
    "base": {"fixed": True, **BALL},
    "upper": {"parent": "base", **SOLID, "joint": HINGE, **BALL},
    "fore": {"parent": "upper", **SOLID, "joint": {"type": "fixed"}, **BALL},
    "hand": {"parent": "fore", **SOLID, "joint": HINGE, **BALL},
}


def chain(*touching):
    laws = {"materials": {"m": {}}, "exclude": [["fore", "hand"]], "touch": [list(pair) for pair in touching]}
    return world(CHAIN, contact=laws)


def test_joined_bodies_touch_where_they_are_let():
    assert ("base", "upper") in chain().contact.excluded_bodies
    found = chain(("upper", "base"))
    assert found.contact.excluded_bodies == (("fore", "hand"), ("fore", "upper"))
    assert Feature.TOUCHING_PAIRS in {need.feature for need in needs(found)}
    assert Feature.TOUCHING_PAIRS not in {need.feature for need in needs(chain())}


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        (("fore", "upper"), "fore and upper are joined rigidly, and never touch"),
        (("hand", "base"), "no joint or loop joins hand and base"),
        (("hand", "fore"), "hand and fore are excluded from contact"),
        (("hand", "foot"), "there is no body 'foot'"),
        (("hand", "hand"), "a pair is of two bodies"),
    ],
)
def test_invalid_contact_permissions_are_rejected(pair, message):
    with pytest.raises(SpecError) as error:
        chain(pair)
    (problem,) = error.value.problems
    assert (problem.message, problem.path.startswith("contact.touch.0")) == (message, True)
