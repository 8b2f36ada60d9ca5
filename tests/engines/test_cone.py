"""Where an elliptic cone that is not quite one is exact, and needs no acceptance: among free balls, and where nothing has
friction."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import compile_world
from simspec.engines.kit.refinements import only_balls_slide
from simspec.errors import UnsupportedError
from simspec.world.types import Body, Inertial, Joint, PairContact, Pose, Shape
from tests import worlds

INEXACT = {
    "pybullet": "PyBullet supports .* approximately.*acts along −D⁻¹ v",
    "rapier": "Rapier supports .* approximately.*acts along K⁻¹ v",
}
"""Engines whose cone is exact for balls alone, with what they say otherwise."""
exact = only_balls_slide("by its cone")


def balls(friction=0.5, **change):
    """A ball above a plane, changed; ``change`` replaces fields of the ball."""
    world = worlds.ball_with_law(friction=friction)
    floor, ball = world.bodies
    return dataclasses.replace(world, bodies=(floor, dataclasses.replace(ball, **change)))


def inertial(x=0.01, y=0.01, z=0.01, product=0.0, centre=(0.0, 0.0, 0.0)):
    return Inertial(1.0, centre, (x, y, z, product, 0.0, 0.0))


def of_ball(**change):
    (shape,) = balls().bodies[1].shapes
    return (dataclasses.replace(shape, **change),)


BOX = {"kind": "box", "size": (0.1, 0.1, 0.1)}
EXACT = {
    "a ball": {"inertial": inertial()},
    "a ball whose inertia was computed": {"inertial": inertial(0.01 * (1 + 1e-15), product=1e-17)},
    "a ball around its centre of mass": {
        "inertial": inertial(centre=(0.1, 0.0, 0.0)),
        "shapes": of_ball(pose=Pose((0.1, 0.0, 0.0))),
    },
    "a box without collision": {"inertial": inertial(), "shapes": of_ball(collision=False, **BOX)},
}
NOT = {
    "a box": {"inertial": inertial(), "shapes": of_ball(**BOX)},
    "an uneven ball": {"inertial": inertial(0.02)},
    "a ball that wobbles": {"inertial": inertial(product=0.001)},
    "a ball off its centre of mass": {"inertial": inertial(centre=(0.01, 0.0, 0.0))},
    "a ball on a slide": {
        "inertial": inertial(),
        "joint": Joint("ball_joint", "slide", axis=(1.0, 0.0, 0.0), position=(0.0,), velocity=(0.0,)),
    },
    "a ball and a box": {"inertial": inertial(), "shapes": (*of_ball(), *of_ball(**BOX))},
}


@pytest.mark.parametrize("case", EXACT)
def test_it_is_exact_for(case):
    world = balls(**EXACT[case])
    assert "nothing in this world but free balls" in exact(world).how
    compile_world(world, list(INEXACT))


@pytest.mark.parametrize("case", NOT)
@pytest.mark.parametrize("engine", INEXACT)
def test_it_must_be_accepted_for(case, engine):
    world = balls(**NOT[case])
    assert exact(world) is None
    with pytest.raises(UnsupportedError, match=INEXACT[engine]):
        compile_world(world, [engine])
    compile_world(worlds.with_options(world, engine, accept=("contact.cone.elliptic",)), [engine])


def test_the_cone_is_irrelevant_without_friction_or_with_the_requested_pyramid():
    case = NOT["a box"]
    assert exact(balls(friction=0.0, **case))
    rough = balls(**case)
    contact = dataclasses.replace(rough.contact, friction_cone="pyramid-circumscribed")
    compile_world(dataclasses.replace(rough, contact=contact), ["pybullet"])


def test_a_pair_that_passes_or_never_meets_does_not_matter():
    case = NOT["a box"]
    rough = balls(**case)
    passing = (PairContact("default", "default", 0.5, 0.0, collide=False),)
    assert exact(dataclasses.replace(rough, contact=dataclasses.replace(rough.contact, pairs=passing)))
    separate = dataclasses.replace(rough.contact, excluded_bodies=(tuple(sorted(body.name for body in rough.bodies)),))
    assert exact(dataclasses.replace(rough, contact=separate))


def test_a_ball_that_hangs_on_something_is_none():
    world = balls(**EXACT["a ball"])
    (floor, ball) = world.bodies
    arm = Body(
        "arm",
        ball.model,
        inertial(),
        Joint("arm_joint", "hinge", ball.name, axis=(0.0, 1.0, 0.0), position=(0.0,), velocity=(0.0,)),
    )
    assert exact(dataclasses.replace(world, bodies=(floor, ball, arm))) is None


def test_the_floor_may_be_anything():
    world = balls(**EXACT["a ball"])
    floor, ball = world.bodies
    box = Shape("floor_0", "box", (4.0, 4.0, 1.0), Pose((0.0, 0.0, -0.5)), "default")
    assert exact(dataclasses.replace(world, bodies=(dataclasses.replace(floor, shapes=(box,)), ball)))
