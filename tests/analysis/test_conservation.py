"""Energy and momentum of motions that conserve them, and of ones made not to."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.analysis.conservation import conservation, free_trees
from simspec.errors import SpecError
from simspec.world.types import Body, Inertial, Joint
from tests.runner.synthetic import SPHERE, column, free_body, run, world

WORLD = world(free_body("floor", mass=1.0), free_body("ball"))


def thrown(lost=lambda t: 0.0 * t, spun=lambda t: 0.0 * t, contacts=None, of=WORLD):
    """The ball (2 kg) thrown up at 5 m/s under 10 m/s²; ``lost`` of its speed along x (which it does not have); the
    floor falls."""

    def place(name, t):
        return column(0.0, 0.0, (5.0 * t if name == "ball" else 0.0) - 5.0 * t**2)

    def speed(name, t):
        ball = name == "ball"
        sideways = 1.0 - lost(t) if ball else 0.0 * t
        return column(sideways, 0.0, (5.0 if ball else 0.0) - 10.0 * t, spun(t) if ball else 0.0, 0.0, 0.0)

    return run(of, place, speed, contacts=contacts)


def test_a_throw_conserves():
    given = conservation(thrown())
    assert given.energy is not None
    assert given.linear is not None
    assert given.angular is not None
    assert max(given.energy.relative, given.linear.relative, given.angular.relative) < 1e-14
    assert given.gained is None
    assert "not every step is recorded" in given.notes[0]


def test_spontaneous_changes_are_found():
    """From 0.5 s on the ball has lost 0.25 m/s of 1: 0.5 N s; ½·2·(1 − 0.75²) = 0.4375 J; and turns at 0.5 rad/s: 0.2 N m s."""
    late = lambda size: lambda t: np.where(t > 0.45, size, 0.0)  # noqa: E731
    given = conservation(thrown(late(0.25)))
    assert given.linear.size == pytest.approx(0.5)
    assert given.linear.whose == "ball"
    assert given.energy.size == pytest.approx(0.4375)
    assert given.energy.relative == pytest.approx(0.4375 / given_scale())
    turned = conservation(thrown(spun=late(0.5)))
    assert turned.angular.size == pytest.approx(0.2)
    assert turned.linear.size < 1e-12


def given_scale():
    """The larger of the largest kinetic energy and the swing of the potential one."""
    t = np.linspace(0.0, 1.0, 11)
    kinetic = (5.0 - 10.0 * t) ** 2 + np.where(t > 0.45, 0.75, 1.0) ** 2 + 0.5 * 100.0 * t**2
    potential = 20.0 * (5.0 * t - 5.0 * t**2) - 10.0 * 5.0 * t**2
    return max(kinetic.max(), np.ptp(potential))


def test_contact_may_take_away():
    """The same loss where the ball touches the floor is none of these figures' business."""
    given = conservation(thrown(lambda t: np.where(t > 0.45, 0.25, 0.0), contacts=[(5, 0, 1, -0.01, 5.0)]))
    assert given.energy.relative < 1e-14
    assert given.linear.relative < 1e-14
    assert given.gained.size == 0.0


def test_contact_may_not_add():
    """0.25 m/s more along x: ½·2·(1.25² − 1) J."""
    given = conservation(thrown(lambda t: np.where(t > 0.45, -0.25, 0.0), contacts=[(5, 0, 1, -0.01, 5.0)]))
    assert given.gained.size == pytest.approx(0.5625)
    # the kinetic energy at the end, of the ball at 1.25 m/s along x and -5 m/s, and of the floor at -10 m/s
    assert given.gained.relative == pytest.approx(0.5625 / (1.25**2 + 5.0**2 + 50.0))
    assert (given.gained.begin, given.gained.end) == pytest.approx((0.4, 0.6))


def test_semi_implicit_euler_loses_what_it_is_said_to():
    """Every step recorded: −½ m g² dt T."""
    dt, steps = 0.01, 100
    of = world(free_body("ball"))
    arrays = dict(thrown(of=of).arrays)
    step = np.arange(steps + 1)
    v = -10.0 * dt * step
    pose, velocity = np.zeros((steps + 1, 1, 7)), np.zeros((steps + 1, 1, 6))
    pose[..., 3], pose[:, 0, 2], velocity[:, 0, 2] = 1.0, dt * np.cumsum(v), v
    arrays |= {"step": step, "time": step * dt, "pose": pose, "velocity": velocity}
    arrays |= {"q": np.zeros((steps + 1, 7)), "v": np.zeros((steps + 1, 6))}
    given = conservation(dataclasses.replace(thrown(of=of), arrays=arrays))
    assert given.energy.size == pytest.approx(0.5 * 2.0 * 100.0 * dt * 1.0)
    assert given.integrator == pytest.approx(given.energy.size)
    assert given.linear.relative < 1e-14
    assert not given.notes


def test_damping_may_change_energy_at_any_time():
    arm = Body(
        "arm",
        "base",
        Inertial(1.0, (0.0,) * 3, SPHERE),
        Joint("elbow", "hinge", "ball", axis=(0, 0, 1), damping=0.1, position=(0.0,), velocity=(0.0,)),
    )
    of = world(*WORLD.bodies, arm)
    given = conservation(run(of))
    assert given.energy is None
    assert "damping" in " ".join(given.notes)
    assert free_trees(of) == {"floor": [0], "ball": [1, 2]}


def test_contacts_must_be_recorded():
    bare = thrown()
    bare = dataclasses.replace(bare, arrays={k: v for k, v in bare.arrays.items() if not k.startswith("contact.")})
    with pytest.raises(SpecError, match="did not record contacts"):
        conservation(bare)
