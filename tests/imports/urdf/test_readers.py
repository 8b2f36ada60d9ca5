"""The same file by simspec and by two independent readers: Pinocchio's (urdfdom) and yourdfpy give the same mechanism."""

import random

import numpy as np
import pinocchio
import pytest
import yourdfpy

from simspec.dynamics.oracle import Oracle
from simspec.language.load import load
from simspec.world.frames import matrix

EQUAL = 1e-9


def robot(seed: int) -> str:
    """A random tree with a fixed root: joints of every kind with an axis, frames and tensors in all directions."""
    generator = random.Random(seed)
    three = lambda scale: " ".join(f"{generator.uniform(-scale, scale):.6f}" for _ in range(3))  # noqa: E731

    def unit() -> str:
        """An axis of length 1: yourdfpy moves a slide by q times the axis as it is written."""
        axis = np.array([generator.gauss(0, 1) for _ in range(3)])
        return " ".join(repr(float(value)) for value in axis / np.linalg.norm(axis))

    links, joints = ['<link name="world"/>'], []
    count = generator.randrange(3, 9)
    for index in range(count):
        a, b, c = (generator.uniform(0.5, 1.0) for _ in range(3))
        off = [generator.uniform(-0.05, 0.05) for _ in range(3)]
        moments = f'ixx="{a}" iyy="{b}" izz="{c}" ixy="{off[0]}" ixz="{off[1]}" iyz="{off[2]}"'
        links.append(
            f'<link name="l{index}"><inertial><origin xyz="{three(0.3)}" rpy="{three(3)}"/>'
            f'<mass value="{generator.uniform(0.5, 5)}"/><inertia {moments}/></inertial></link>'
        )
        kind = "fixed" if index == 0 else generator.choice(("revolute", "continuous", "prismatic", "fixed"))
        parent = "world" if index == 0 else f"l{generator.randrange(index)}"
        limit = f'<limit lower="{-generator.random()}" upper="{generator.random()}" effort="{index + 1}" velocity="3"/>'
        joints.append(
            f'<joint name="j{index}" type="{kind}"><parent link="{parent}"/><child link="l{index}"/>'
            f'<origin xyz="{three(1)}" rpy="{three(3)}"/><axis xyz="{unit()}"/>{limit}</joint>'
        )
    return f'<robot name="random">{"".join(links)}{"".join(joints)}</robot>'


@pytest.fixture(params=range(12))
def file(request, tmp_path):
    path = tmp_path / "random.urdf"
    path.write_text(robot(request.param))
    return path


def test_mass_matrix_limits_and_frames_are_those_of_the_reader_of_pinocchio(file):
    world = load(file).resolve()
    oracle = Oracle(world)
    model = pinocchio.buildModelFromUrdf(str(file))
    data = model.createData()
    names = [body.joint.name for body in world.bodies if body.joint.kind in ("hinge", "slide")]
    assert sorted(names) == sorted(list(model.names)[1:])
    generator = np.random.default_rng(3)
    values = {name: generator.uniform(-1, 1) for name in names}
    q = pinocchio.neutral(model)
    for name in names:
        joint = model.joints[model.getJointId(name)]
        circle = joint.nq == 2  # a continuous joint there is a point of the circle
        q[joint.idx_q : joint.idx_q + joint.nq] = (
            [np.cos(values[name]), np.sin(values[name])] if circle else [values[name]]
        )
    theirs = pinocchio.crba(model, data, q)
    theirs = np.triu(theirs) + np.triu(theirs, 1).T
    order = [model.joints[model.getJointId(name)].idx_v for name in names]
    ours = oracle.mass_matrix(np.array([values[name] for name in names]))
    np.testing.assert_allclose(ours, theirs[np.ix_(order, order)], atol=EQUAL, rtol=EQUAL)
    for body in world.bodies:
        joint = body.joint
        if joint.position_limits is not None:
            index = model.joints[model.getJointId(joint.name)].idx_q
            assert joint.position_limits == (model.lowerPositionLimit[index], model.upperPositionLimit[index])
            assert joint.effort_limit == model.effortLimit[model.joints[model.getJointId(joint.name)].idx_v]


def test_frames_are_those_of_yourdfpy(file):
    world = load(file).resolve()
    theirs = yourdfpy.URDF.load(str(file), load_meshes=False, load_collision_meshes=False)
    names = [body.joint.name for body in world.bodies if body.joint.kind in ("hinge", "slide")]
    assert sorted(names) == sorted(theirs.actuated_joint_names)
    generator = np.random.default_rng(4)
    for _ in range(3):
        q = generator.uniform(-1, 1, len(names))
        theirs.update_cfg(dict(zip(names, q, strict=True)))
        for body, (*place, w, x, y, z) in zip(world.bodies, Oracle(world).body_poses(q), strict=True):
            turn = theirs.get_transform(body.name, "world")
            np.testing.assert_allclose(place, turn[:3, 3], atol=EQUAL)
            np.testing.assert_allclose(matrix((w, x, y, z)), turn[:3, :3], atol=EQUAL)
