"""φ and J of constraints: φ is zero where they hold, and J is its derivative, by differences and by Pinocchio's Jacobians."""

from __future__ import annotations

import numpy as np

from simspec.dynamics.oracle_tree import OracleTree
from simspec.proof.selftest_worlds import constrained
from simspec.world.constraints import ROWS, Violation, impulse
from simspec.world.kinematics import initial_state


def test_the_jacobian_is_the_derivative_of_the_violation():
    world = constrained("")
    tree = OracleTree(world, constrained=True)
    violation = Violation(world.bodies, world.constraints)
    q, _ = initial_state(world)
    assert np.abs(violation.of(q, tree.body_poses(q))).max() < 1e-15
    q = tree.moved(q, 0.1 * np.random.default_rng(1).normal(size=tree.nv))
    settled = tree.settled(q)
    assert settled is not None
    jacobian = violation.jacobian(tree.body_poses(settled))
    np.testing.assert_allclose(jacobian, tree.jacobian(settled), rtol=0, atol=1e-13)
    step = 1e-6
    for column in range(tree.nv):
        way = np.zeros(tree.nv)
        way[column] = step
        ahead, behind = (tree.moved(settled, sign * way) for sign in (1.0, -1.0))
        rate = (violation.of(ahead, tree.body_poses(ahead)) - violation.of(behind, tree.body_poses(behind))) / (
            2 * step
        )
        np.testing.assert_allclose(rate, jacobian[:, column], rtol=0, atol=1e-8)


def test_the_impulse_makes_the_violation_vanish_and_is_pinocchio_s():
    """Pinocchio's constrained dynamics, of another algorithm, gives the same acceleration where φ is zero and the drift of J
    is left out by beginning at rest."""
    import pinocchio

    world = constrained("")
    tree = OracleTree(world, constrained=True)
    q, v = initial_state(world)
    v = np.zeros_like(v)
    dt = world.physics.timestep
    free = dt * tree.acceleration(q, v, np.zeros(tree.nv))
    jacobian = tree.jacobian(q)
    violation = np.random.default_rng(2).normal(size=len(jacobian)) * 1e-6
    after = free + impulse(tree.mass_matrix(q), jacobian, free, violation, dt)
    np.testing.assert_allclose(jacobian @ after, -violation / dt, rtol=0, atol=1e-12)
    # the loop and the weld alone: Pinocchio has no couplings of joints
    models = pinocchio.StdVec_RigidConstraintModel()
    joints = {body.name: (tree.body_joint[row], tree.body_placement[row]) for row, body in enumerate(world.bodies)}
    for constraint in world.constraints:
        if constraint.kind == "follow":
            continue
        (index, near), (other, far) = joints[constraint.first], joints[constraint.second]
        if constraint.kind == "weld":
            kind = pinocchio.ContactType.CONTACT_6D
            near = near * tree._placement(constraint.pose)
        else:
            kind = pinocchio.ContactType.CONTACT_3D
            near = near * pinocchio.SE3(np.eye(3), np.array(constraint.first_point))
            far = far * pinocchio.SE3(np.eye(3), np.array(constraint.second_point))
        models.append(pinocchio.RigidConstraintModel(kind, tree.model, index, near, other, far))
    data = pinocchio.StdVec_RigidConstraintData()
    data.extend(model.createData() for model in models)
    pinocchio.initConstraintDynamics(tree.model, tree.data, models, data)
    ours_q, ours_v = tree.spread(q, v)
    effort = np.zeros(tree.model.nv)
    effort[tree.v_index] = tree.joint_effort(q, v)
    settings = pinocchio.ProximalSettings(1e-14, 1e-14, 100)
    theirs = pinocchio.constraintDynamics(tree.model, tree.data, ours_q, ours_v, effort, models, data, settings)
    parts = [np.full(ROWS[constraint.kind], constraint.kind != "follow") for constraint in world.constraints]
    local = jacobian[np.concatenate(parts)]
    made = free + impulse(tree.mass_matrix(q), local, free, np.zeros(len(local)), dt)
    np.testing.assert_allclose(made / dt, theirs[tree.v_index], rtol=0, atol=1e-8)


def test_motion_that_has_diverged_is_not_finite_and_no_error():
    mass, jacobian = np.full((2, 2), np.nan), np.ones((1, 2))
    assert np.isnan(impulse(mass, jacobian, np.ones(2), np.zeros(1), 1e-3)).all()


def test_a_row_that_is_round_off_gives_no_impulse():
    """The third axis of a planar loop: its row of J is 1e-16, and must not be scaled to the others."""
    jacobian = np.array([[1.0, 0.5], [0.3, -1.0], [1e-16, -2e-16]])
    velocity, violation = np.array([0.2, -0.1]), np.array([1e-6, -1e-6, 3e-17])
    exact = velocity + impulse(np.diag([2.0, 0.5]), jacobian[:2], velocity, violation[:2], 1e-3)
    made = velocity + impulse(np.diag([2.0, 0.5]), jacobian, velocity, violation, 1e-3)
    np.testing.assert_allclose(made, exact, rtol=0, atol=1e-12)


def test_a_mass_matrix_that_has_lost_its_digits_ends_motion_as_diverged_and_not_with_an_error():
    """The share of a far slide in M removes all other terms by round-off: two rows are equal to the last bit."""
    mass = 1e200 * np.ones((2, 2)) + np.eye(2)
    after = impulse(mass, np.array([[1.0, -1.0]]), np.ones(2), np.zeros(1), 1e-3)
    assert np.isnan(after).all()
