"""Constraints in engines: worlds that are refused by name, and couplings in contact. That motion and what is held are right is
seen by the suites, in the world ``held``."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import compile_world
from simspec.errors import UnsupportedError
from simspec.testing.worlds import accepting, with_options
from simspec.world.frames import compose, inverse
from simspec.world.kinematics import poses
from simspec.world.types import Body, ConnectConstraint, Contact, FollowConstraint, Material, PairContact, Shape, World
from tests import constrained, worlds

OUTSIDE = ("dart", "drake")


def solid(base: World) -> World:
    """The same world, with a ball on every body."""

    def ball(body: Body) -> Body:
        return dataclasses.replace(body, shapes=(Shape(f"{body.name}_0", "sphere", (0.2,), material="steel"),))

    contact = Contact(materials=(Material("steel"),), pairs=(PairContact("steel", "steel", 0.0, 0.0),))
    return dataclasses.replace(base, bodies=tuple(map(ball, base.bodies)), contact=contact)


def jointed(base: World, **more: float) -> World:
    """The same world, the joint of its last hinge with other numbers."""
    last = base.bodies[-1]
    joint = dataclasses.replace(last.joint, **more)
    return dataclasses.replace(base, bodies=(*base.bodies[:-1], dataclasses.replace(last, joint=joint)))


@pytest.mark.parametrize("name", OUTSIDE)
def test_constraints_computed_outside_need_a_request_and_in_contact_an_acceptance(name):
    follower = constrained.follower()
    with pytest.raises(UnsupportedError, match=r"outside: \[constraint.coupling\]"):
        compile_world(follower, [name])
    with pytest.raises(UnsupportedError, match=r"accept: \[constraint.coupling\]"):
        compile_world(solid(with_options(follower, name, outside=("constraint.coupling",))), [name])


def test_dry_friction_does_not_include_forces_computed_outside():
    rough = jointed(constrained.follower(), dry_friction=0.1)
    options = with_options(rough, "dart", outside=("constraint.coupling",), accept=("joint.dry_friction",))
    with pytest.raises(UnsupportedError, match="dry friction in DART, whose impulses would ignore 'mirror'"):
        compile_world(options, ["dart"])


def test_pybullet_has_a_common_error_reduction_for_loops_and_limits():
    limited = jointed(constrained.closed_loop(), position_limits=(-3.0, 3.0))
    with pytest.raises(UnsupportedError, match="one error reduction for loops, which need 1, and position limits"):
        compile_world(with_options(limited, "pybullet", accept=("joint.limits.position",)), ["pybullet"])


def test_gears_of_pybullet_are_within_a_single_tree():
    base = constrained.follower()
    other = worlds.world(worlds.tree(["hinge"], 3), "other").bodies[0]
    other = dataclasses.replace(other, name="other", joint=dataclasses.replace(other.joint, name="other_joint"))
    mirror = dataclasses.replace(base.constraints[0], leader="other_joint", offset=base.bodies[2].joint.position[0])
    joint = dataclasses.replace(other.joint, position=(0.0,))
    world = dataclasses.replace(
        base, bodies=(*base.bodies, dataclasses.replace(other, joint=joint)), constraints=(mirror,)
    )
    compile_world(base, ["pybullet"])
    with pytest.raises(UnsupportedError, match="'other_joint' and 'link2_joint' are in different trees"):
        compile_world(world, ["pybullet"])


def test_pybullet_s_armature_would_not_be_felt_by_a_constraint():
    armed = jointed(constrained.follower(), armature=0.1)
    with pytest.raises(
        UnsupportedError, match=r"a constraint holds the tree of .*, and its impulses would ignore the armature"
    ):
        compile_world(with_options(armed, "pybullet", outside=("joint.armature",)), ["pybullet"])


@pytest.mark.parametrize("name", ["mujoco", "pybullet"])
def test_a_coupling_holds_in_contact(name, tmp_path):
    """A chain whose balls press on each other while one joint follows another: the coupling holds to round-off."""
    from simspec.compiler import write_folder
    from simspec.engines.kit.session import Session

    world = solid(constrained.follower())
    world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, steps=1))
    accepted = accepting(world, name)
    write_folder(compile_world(accepted, [name])[name].files, tmp_path / name)
    (mirror,) = world.constraints
    assert isinstance(mirror, FollowConstraint)
    with Session(name, tmp_path / name) as session:
        worst, pressing = 0.0, 0
        for _ in range(50):
            session.step(20)
            pressing += int((session.contacts()["normal_force"] > 0.0).sum())
            q, _ = session.get_state()
            worst = max(worst, constrained.violation(world, q))
    assert pressing > 0
    assert worst < 1e-9


def test_pybullet_ignores_a_loop_of_bodies_fixed_below_a_ball_joint_at_the_root():
    def pinned(*kinds: str) -> World:
        base = worlds.world(worlds.tree(list(kinds), 5), "pinned")
        floor = dataclasses.replace(worlds.world(worlds.tree(["fixed"], 6), "floor").bodies[0], name="floor")
        floor = dataclasses.replace(floor, joint=dataclasses.replace(floor.joint, name="floor_joint"))
        world = dataclasses.replace(base, bodies=(*base.bodies, floor))
        place = poses(world)
        point = compose(inverse(place["floor"]), place[base.bodies[-1].name]).position
        pin = ConnectConstraint("pin", base.bodies[-1].name, "floor", (0.0, 0.0, 0.0), point)
        return dataclasses.replace(world, constraints=(pin,))

    with pytest.raises(UnsupportedError, match="ignores the loop 'pin'"):
        compile_world(pinned("ball", "fixed"), ["pybullet"])
    compile_world(pinned("ball", "hinge"), ["pybullet"])
