"""Mirrored models: the convention, by hand and over random models; height fields, which have no mirror; round trips."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import simspec
from simspec.dynamics.oracle import Oracle
from simspec.errors import SpecError
from simspec.language import problems
from simspec.language.load import Spec, load
from simspec.language.mirroring import RULES, flip_of, mirrored, negative
from simspec.language.models import File, Use
from simspec.language.quantities import ByJointType, Direction, Number, UnitQuaternion, Vector
from simspec.language.shapes import Scale
from simspec.world.kinematics import initial_state, layout_of, poses
from tests.files import write
from tests.random_specs import Draw

SIGNS = {"x": (-1, 1, 1), "y": (1, -1, 1), "z": (1, 1, -1)}
LEG = {
    "hip": {
        "pose": {"xyz": [0.1, 0.2, 0.3], "rpy": [0.1, 0.2, 0.3]},
        "velocity": {"linear": [1, 2, 3], "angular": [4, 5, 6]},
        "mass": 2,
        "centre_of_mass": ["1 cm", "-2 cm", 0],
        "inertia": {"tensor": {"xx": 0.1, "yy": 0.1, "zz": 0.1, "xy": 0.01, "xz": 0.02, "yz": "-0.03 kg m^2"}},
    },
    "thigh": {
        "parent": "hip",
        "mass": 1,
        "inertia": {"principal": [0.1, 0.11, 0.12], "quat": [0.5, 0.5, 0.5, 0.5]},
        "joint": {
            "type": "hinge",
            "origin": {"xyz": [0, "50 mm", 0], "quat": [0.5, -0.5, 0.5, -0.5]},
            "axis": [1, 2, 3],
            "limits": {"position": [-0.1, 0.4]},
            "position": 0.3,
            "velocity": -0.2,
        },
        "shapes": [
            {"box": {"size": [0.1, 0.2, 0.3]}, "pose": {"xyz": [1, 2, 3], "rpy": [0.1, 0.2, 0.3]}, "material": "belt",
             "surface_velocity": {"linear": [1, 2, 3], "angular": [4, 5, 6]}},
        ],
    },
    "shank": {
        "parent": "thigh",
        "mass": 1,
        "inertia": {"principal": [0.1, 0.11, 0.12]},
        "joint": {"type": "slide", "axis": [1, 2, 3], "position": "1 cm"},
    },
    "foot": {
        "parent": "shank",
        "mass": 1,
        "inertia": {"principal": [0.1, 0.11, 0.12]},
        "joint": {"type": "ball", "position": {"quat": [0.5, 0.5, -0.5, 0.5]}, "velocity": [1, 2, 3]},
    },
}  # fmt: skip
BY_HAND = {  # y is −y; pseudo-vectors change the signs of x and z
    "hip": {
        "pose": {"xyz": [0.1, -0.2, 0.3], "rpy": [-0.1, 0.2, -0.3]},
        "velocity": {"linear": [1, -2, 3], "angular": [-4, 5, -6]},
        "mass": 2,
        "centre_of_mass": [0.01, 0.02, 0],
        "inertia": {"tensor": {"xx": 0.1, "yy": 0.1, "zz": 0.1, "xy": -0.01, "xz": 0.02, "yz": 0.03}},
    },
    "thigh": {
        "parent": "hip",
        "mass": 1,
        "inertia": {"principal": [0.1, 0.11, 0.12], "quat": [0.5, -0.5, 0.5, -0.5]},
        "joint": {
            "type": "hinge",
            "origin": {"xyz": [0, -0.05, 0], "quat": [0.5, 0.5, 0.5, 0.5]},
            "axis": [-1, 2, -3],
            "limits": {"position": [-0.1, 0.4]},
            "position": 0.3,
            "velocity": -0.2,
        },
        "shapes": [
            {"box": {"size": [0.1, 0.2, 0.3]}, "pose": {"xyz": [1, -2, 3], "rpy": [-0.1, 0.2, -0.3]}, "material": "belt",
             "surface_velocity": {"linear": [1, -2, 3], "angular": [-4, 5, -6]}},
        ],
    },
    "shank": {**LEG["shank"], "joint": {"type": "slide", "axis": [1, -2, 3], "position": 0.01}},
    "foot": {
        **LEG["foot"],
        "joint": {"type": "ball", "position": {"quat": [0.5, -0.5, -0.5, -0.5]}, "velocity": [-1, 2, -3]},
    },
}  # fmt: skip
PARTS = {
    "frames": {"sole": {"body": "foot", "pose": {"xyz": [1, 2, 3], "rpy": [0.1, 0.2, 0.3]}}},
    "states": {
        "bent": {
            "positions": {"thigh_joint": 0.2, "foot_joint": {"rpy": [0.1, 0.2, 0.3]}},
            "velocities": {"foot_joint": [1, 2, 3]},
        }
    },
    "state": "bent",
}
PARTS_BY_HAND = {
    "frames": {"sole": {"body": "foot", "pose": {"xyz": [1, -2, 3], "rpy": [-0.1, 0.2, -0.3]}}},
    "states": {
        "bent": {
            "positions": {"thigh_joint": 0.2, "foot_joint": {"rpy": [-0.1, 0.2, -0.3]}},
            "velocities": {"foot_joint": [-1, 2, -3]},
        }
    },
    "state": "bent",
}  # fmt: skip
PARTS, PARTS_BY_HAND = ({**parts, "pose": {"xyz": [5, 6, 7], "rpy": [1, 0, 0]}} for parts in (PARTS, PARTS_BY_HAND))
CONTACT = {"materials": {"belt": {"friction": 0.5}}}


def scenario(**model):
    return Spec.from_data({"name": "scene", "contact": CONTACT, "models": {"leg": model}})


def test_a_mirrored_model_is_that_written_by_hand():
    found, expected = scenario(bodies=LEG, mirror="y", **PARTS), scenario(bodies=BY_HAND, **PARTS_BY_HAND)
    assert found.resolve() == expected.resolve()
    assert found.resolve() != scenario(bodies=LEG, **PARTS).resolve()


def test_constraints_and_grasps_are_mirrored():
    parts = {
        "constraints": {
            "strut": {"connect": {"bodies": ["a", "b"], "at": [1, 2, 3], "second_at": [0, "-1 cm", 0]}},
            "latch": {"weld": {"bodies": ["a", "b"], "pose": {"xyz": [1, 2, 3], "quat": [0.5, 0.5, 0.5, 0.5]}}},
            "gear": {"follow": {"joint": "a", "leader": "b", "ratio": -1, "offset": 0.2}},
        },
        "grasps": {"hold": {"open": {"a": 0.1}, "closed": {"a": 0.2}, "forces": [{"body": "a", "force": [1, 2, 3]}]}},
        "actuators": {"motor": {"joint": "a", "kp": 10, "command": 0.3}},
    }
    assert mirrored(parts, Use, (1, -1, 1)) == {
        "constraints": {
            "strut": {"connect": {"bodies": ["a", "b"], "at": [1, -2, 3], "second_at": [0, "1 cm", 0]}},
            "latch": {"weld": {"bodies": ["a", "b"], "pose": {"xyz": [1, -2, 3], "quat": [0.5, -0.5, 0.5, -0.5]}}},
            "gear": {"follow": {"joint": "a", "leader": "b", "ratio": -1, "offset": 0.2}},
        },
        "grasps": {"hold": {"open": {"a": 0.1}, "closed": {"a": 0.2}, "forces": [{"body": "a", "force": [1, -2, 3]}]}},
        "actuators": {"motor": {"joint": "a", "kp": 10, "command": 0.3}},
    }


def test_a_file_is_mirrored_as_a_model_written_in_the_scenario(tmp_path):
    file = {"simspec": 1, "name": "leg", "contact": CONTACT, "model": {"bodies": LEG}}
    write({"leg.yaml": Spec.from_data(file).to_yaml()}, tmp_path)
    spec = Spec.from_data(
        {"name": "scene", "models": {"leg": {"use": "leg.yaml", "mirror": "y", **PARTS_BY_HAND}}}, folder=tmp_path
    )
    # parts that a placement adds to a file's model are as written, in the frames of the mirrored model
    assert spec.resolve() == scenario(bodies=BY_HAND, **PARTS_BY_HAND).resolve()


def test_a_spec_says_what_was_written_and_its_models_can_be_used_again(tmp_path):
    spec = scenario(bodies=LEG, mirror="y", **PARTS)
    assert "mirror: y" in spec.to_yaml()
    write({"scene.yaml": spec.to_yaml()}, tmp_path)
    assert load(tmp_path / "scene.yaml").resolve() == spec.resolve() == Spec.from_data(spec.data).resolve()
    heavier = load(tmp_path / "scene.yaml", sets=["models.leg.bodies.hip.centre_of_mass=[0, 3 cm, 0]"]).resolve()
    assert heavier.bodies[0].inertial.centre_of_mass == (0.0, -0.03, 0.0)
    place = spec.locate("bodies.leg/thigh.joint.axis"), load(tmp_path / "scene.yaml").locate("bodies.leg/thigh.mass")
    assert place[0] is None
    assert "mass" in (tmp_path / "scene.yaml").read_text().splitlines()[place[1].line - 1]


# --- random models ------------------------------------------------------------------------------------------------------


def trees(seed):
    draw = Draw(seed)
    draw.tree(1)
    bodies = draw.bodies or draw.models["model1"]["bodies"]
    contact = {**draw.palette, **({"groups": {name: {"ignores": []} for name in draw.groups}} if draw.groups else {})}
    return bodies, contact


def world(bodies, contact, gravity, **more):
    model = {"bodies": bodies, **more}
    data = {"name": "scene", "physics": {"gravity": gravity}, "contact": contact, "models": {"tree": model}}
    return Spec.from_data(data).resolve()


def seen_in_mirror(of, signs, q, v):
    """Coordinates of the mirror image: those of hinges and slides are equal, what turns is a pseudo-vector."""
    signs = np.array(signs)
    turned = np.prod(signs) * signs
    q, v = q.copy(), v.copy()
    for body, at, rate in zip(of.bodies, layout_of(of).position, layout_of(of).velocity, strict=True):
        kind = body.joint.kind
        if kind == "free":
            q[at], v[rate] = q[at] * [*signs, 1, *turned], v[rate] * [*signs, *turned]
        elif kind == "ball":
            q[at], v[rate] = q[at] * [1, *turned], v[rate] * turned
    return q, v


def matrices(poses):
    """(rotations, places) of poses (n, 7): x y z w x y z."""
    w, x, y, z = poses[:, 3:].T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0), poses[:, :3]


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), axis=st.sampled_from("xyz"))
def test_the_motion_of_a_mirrored_model_is_the_mirror_image_of_the_motion(seed, axis):
    bodies, contact = trees(seed)
    signs = np.array(SIGNS[axis])
    gravity = np.array([1.0, 2.0, -9.81])
    before, after = world(bodies, contact, list(gravity)), world(bodies, contact, list(signs * gravity), mirror=axis)
    oracle, other = Oracle(before), Oracle(after)
    q, v = initial_state(before)
    effort = 0.1 * np.cos(np.arange(len(v)))
    _, turned_effort = seen_in_mirror(before, signs, q, effort)
    other_q, other_v = initial_state(after)
    for _ in range(20):
        wanted_q, wanted_v = seen_in_mirror(before, signs, q, v)
        assert other_q == pytest.approx(wanted_q, abs=1e-9)
        assert other_v == pytest.approx(wanted_v, abs=1e-9)
        (turns, places), (other_turns, other_places) = (
            matrices(oracle.body_poses(q)),
            matrices(other.body_poses(other_q)),
        )
        assert other_places == pytest.approx(places * signs, abs=1e-9)
        assert other_turns == pytest.approx(signs[:, None] * turns * signs, abs=1e-9)
        assert other.energy(other_q, other_v) == pytest.approx(oracle.energy(q, v), rel=1e-9, abs=1e-9)
        q, v = oracle.step(q, v, effort)
        other_q, other_v = other.step(other_q, other_v, turned_effort)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), axis=st.sampled_from("xyz"))
def test_mirrored_twice_is_the_model(seed, axis):
    bodies, _ = trees(seed)
    flip = flip_of(axis)
    once = mirrored({"bodies": bodies}, Use, flip)
    assert once != {"bodies": bodies}
    twice = mirrored(once, Use, flip)
    contact = trees(seed)[1]
    assert world(twice["bodies"], contact, [0, 0, -9.81]) == world(bodies, contact, [0, 0, -9.81])


def test_files_that_use_each_other_mirror_in_turn(tmp_path):
    file = {"simspec": 1, "name": "leg", "contact": CONTACT, "model": {"bodies": LEG}}
    write({"leg.yaml": Spec.from_data(file).to_yaml()}, tmp_path)
    for name, axis in (("other", "y"), ("far", "x")):
        write({f"{name}.yaml": f"simspec: 1\nname: {name}\nmodel: {{use: leg.yaml, mirror: {axis}}}\n"}, tmp_path)
    worlds = {}
    for use, axis in (("leg", None), ("other", "y"), ("far", "y"), ("other", "x")):
        model = {"use": f"{use}.yaml", **({"mirror": axis} if axis else {})}
        worlds[use, axis] = Spec.from_data({"name": "scene", "models": {"leg": model}}, folder=tmp_path).resolve()
    assert worlds["other", "y"] == worlds["leg", None]
    assert worlds["far", "y"] == worlds["other", "x"]  # two mirrors are half a turn, in whatever order
    assert worlds["far", "y"].bodies[0].joint.position[:3] == (-0.1, -0.2, 0.3)


# --- the table, and what it leaves out ----------------------------------------------------------------------------------

UNCHANGED = {
    *("Box.size", "Ellipsoid.radii", "Inertia.principal", "Shape.colour", "Actuator.bias", "Heightfield.size"),
    *("Heightfield.heights", "Array.step", "Limits.position", "Limits.angle", "Limits.velocity", "Limits.effort"),
    *("Spring.stiffness", "Spring.rest", "Joint.damping", "Joint.dry_friction", "Joint.armature"),
}
"""Vectors and numbers of joints that no mirror changes; arrays place models, or loose bodies."""
ELSEWHERE = {"Joint.axis", "Mesh.scale", "Tensor.xy", "Tensor.xz", "Tensor.yz", "State.positions", "State.velocities"}


def test_every_vector_of_a_model_has_a_rule():
    kinds = (Vector, UnitQuaternion, Direction, Scale, ByJointType)
    vectors = {
        f"{name}.{field}"
        for name, model in problems.models(problems.fields(File)["model"]).items()
        if name not in ("Import", "ModelParameter")
        for field, kind in problems.fields(model).items()
        if isinstance(kind, kinds) and not (isinstance(kind, Vector) and kind.item == Number("number", 0, 1))
    }
    ruled = {f"{name}.{field}" for name, table in RULES.items() for field in table if name != "Orientation"}
    assert vectors - ruled - ELSEWHERE <= UNCHANGED
    assert ruled - vectors <= ELSEWHERE


@pytest.mark.parametrize(
    ("value", "other"),
    [
        (1, -1), (0, 0), (0.0, 0.0), (-2.5, 2.5), ("5 mm", "-5 mm"), ("-5 mm", "5 mm"), ("+5mm", "-5mm"), (" - 5 mm", "5 mm"),
        (True, True), (None, None), ("", ""),
    ],
)  # fmt: skip
def test_quantities_change_their_sign_as_they_are_written(value, other):
    assert negative(value) == other


def test_a_plane_is_solid_on_the_other_side():
    floor = {"fixed": True, "shapes": [{"plane": {}, "pose": {"xyz": [0, 0, 1], "rpy": [0.2, 0, 0]}}]}
    for axis, solid in (("x", -1), ("y", -1), ("z", 1)):
        shape = scenario(bodies={"floor": floor}, mirror=axis).resolve().bodies[0].shapes[0]
        (turns, _) = matrices(np.array([[*shape.pose.position, *shape.pose.quaternion]]))
        assert np.sign(turns[0][2, 2]) == -solid  # the z axis points out of the solid
        up = np.array(SIGNS[axis]) * [0, -np.sin(0.2), np.cos(0.2)]
        assert turns[0][:, 2] == pytest.approx(up, abs=1e-15)


@pytest.mark.parametrize("axis", ["x", "z"])
def test_the_surface_of_a_plane_moves_as_its_mirror_image(axis):
    moving = {"linear": [1, 2, 0], "angular": [0.1, 0.2, 3]}
    plane = {"plane": {}, "pose": {"quat": [0.5, 0.5, -0.5, 0.5]}, "surface_velocity": moving, "material": "belt"}
    vectors = []
    for mirror in ({}, {"mirror": axis}):
        floor = scenario(bodies={"floor": {"fixed": True, "shapes": [plane]}}, **mirror).resolve().bodies[0].shapes[0]
        (turn,), _ = matrices(np.array([[*floor.pose.position, *floor.pose.quaternion]]))
        vectors.append((turn @ floor.surface_velocity[:3], turn @ floor.surface_velocity[3:]))
    signs = np.array(SIGNS[axis])
    assert vectors[1][0] == pytest.approx(signs * vectors[0][0], abs=1e-15)
    assert vectors[1][1] == pytest.approx(-signs * vectors[0][1], abs=1e-15)


def test_a_height_field_cannot_be_mirrored():
    ground = {"fixed": True, "shapes": [{"heightfield": {"rows": [[0, 0], [0, 1]], "size": [1, 1]}}]}
    with pytest.raises(SpecError, match="a height field cannot be mirrored exactly") as error:
        scenario(bodies={"ground": ground}, mirror="x")
    assert error.value.problems[0].path == "models.leg.bodies.ground.shapes.0.heightfield"


def test_a_wrong_axis_is_an_error():
    with pytest.raises(SpecError, match="not an allowed word") as error:
        scenario(bodies=LEG, mirror="xy")
    assert error.value.problems[0].allowed == "x, y, z"


# --- robot files with meshes, and an engine -----------------------------------------------------------------------------

ROBOT = """<robot name="finger">
  <link name="base"/>
  <link name="tip">
    <inertial><origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/><mass value="1.5"/>
      <inertia ixx="0.01" iyy="0.012" izz="0.013" ixy="0.001" ixz="0.002" iyz="-0.001"/></inertial>
    <collision><origin xyz="0.01 0.02 0.03" rpy="0.3 0.2 0.1"/>
      <geometry><mesh filename="tip.stl" scale="1 2 1"/></geometry></collision>
  </link>
  <joint name="bend" type="revolute"><parent link="base"/><child link="tip"/><origin xyz="0 0.1 0" rpy="0.5 0 0.2"/>
    <axis xyz="0.6 0 0.8"/><limit lower="-1" upper="1" effort="10" velocity="2"/></joint>
</robot>
"""


def vertices(body, shape):
    """The vertices of a mesh in the world, at the initial positions."""
    at = np.array([[*pose.position, *pose.quaternion] for pose in (body, shape.pose)])
    (turn, inner), places = matrices(at)
    points = np.array(shape.size).reshape(-1, 3)
    return (points @ inner.T + places[1]) @ turn.T + places[0]


def test_a_robot_file_is_mirrored_with_its_meshes(tmp_path):
    points = np.random.default_rng(1).normal(size=(20, 3)) * 0.05
    surface = trimesh.convex.convex_hull(points)
    write({"finger.urdf": ROBOT}, tmp_path)
    (tmp_path / "tip.stl").write_bytes(surface.export(file_type="stl"))
    worlds = []
    for mirror in ({}, {"mirror": "y"}):
        finger = {"use": "finger.urdf", "fixed": True, "positions": {"bend": 0.4}, **mirror}
        data = {"name": "scene", "contact": {"materials": {"skin": {"friction": 0.5}}}, "models": {"finger": finger}}
        worlds.append(Spec.from_data(data, folder=tmp_path).resolve())
    before, after = worlds
    oracle, other = Oracle(before), Oracle(after)
    q = np.array([0.4])
    assert oracle.mass_matrix(q) == pytest.approx(other.mass_matrix(q), rel=1e-14)
    tips = [poses(world)["finger/tip"] for world in worlds]
    there, here = (
        vertices(tip, next(shape for shape in world.bodies[-1].shapes if shape.kind == "mesh"))
        for tip, world in zip(tips, worlds, strict=True)
    )
    assert here == pytest.approx(there * [1, -1, 1], abs=1e-15)


def test_an_engine_moves_a_mirrored_model_as_the_mirror_image():
    hip = {key: value for key, value in LEG["hip"].items() if key != "velocity"}
    thigh = {**LEG["thigh"], "joint": {key: value for key, value in LEG["thigh"]["joint"].items() if key != "limits"}}
    bodies = {**LEG, "hip": {**hip, "fixed": True}, "thigh": thigh}
    places = []
    for mirror in ({}, {"mirror": "y"}):
        data = {
            "name": "scene",
            "physics": {"duration": "0.2 s", "gravity": [1, 0, -9.81]},
            "contact": CONTACT,
            "record": {"every": "10 ms", "channels": ["pose"]},
            "models": {"leg": {"bodies": bodies, **mirror}},
        }
        places.append(simspec.run(Spec.from_data(data).resolve(), "mujoco").arrays["pose"][:, :, :3])
    assert np.ptp(places[0], axis=0).max() > 0.1
    assert places[1] == pytest.approx(places[0] * [1, -1, 1], abs=1e-9)
