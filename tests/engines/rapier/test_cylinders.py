"""Cylinders in Rapier: exact on planes, balls and flat on each other, nearly right at an angle, and accepted by name."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.rapier.engine import Rapier
from simspec.errors import UnsupportedError
from simspec.testing.worlds import accepting, with_options
from tests.engines.free_bodies import ball, loader, scene
from tests.engines.hulls import prism, solid, static_body
from tests.engines.overlapping import overlaps

SIZES = {"cylinder": (0.08, 0.15), "sphere": (0.1,), "capsule": (0.06, 0.2), "box": (0.2, 0.15, 0.1)}
needs_rapier = pytest.mark.skipif(Rapier.version() is None, reason="rapier3d is not installed")


def two(kind):
    """A cylinder and a body of this kind over a floor."""
    places = (("cylinder", "one", 1.0), (kind, "two", 2.0))
    return scene(*(ball(name, (0.0, 0.0, at), kind=of, size=SIZES[of]) for of, name, at in places))


def seen(load_files, kind):
    """How far depths (m) and normals are off in 60 overlaps, and how many of them are missed."""
    world = accepting(two(kind), "rapier")
    found = list(overlaps(loader(Rapier, load_files)(world), world, 60, seed=8))
    felt = [(depth, turned) for _, depth, turned, _ in found if depth is not None]
    return *np.array(felt).T, len(found) - len(felt)


@needs_rapier
def test_cylinders_and_balls_are_exact(load_files):
    depths, turned, missed = seen(load_files, "sphere")
    assert (max(depths) < 5e-7, max(turned) < 1e-5, missed) == (True, True, 0)


@needs_rapier
@pytest.mark.parametrize("kind", ["box", "capsule", "cylinder"])
def test_oblique_normals_are_off_as_is_declared(load_files, kind):
    depths, turned, missed = seen(load_files, kind)
    assert missed == 0, "missed overlaps are less deep than these"
    assert max(depths) < 1e-4
    assert max(turned) > 1e-3, "were these exact, nothing had to be accepted"
    assert np.quantile(turned, 0.95) < 0.03


@needs_rapier
def test_cylinders_that_stand_on_each_other_feel_it_to_the_round_off(load_files):
    """A stack of three, each 0.1 mm deep in what is below it."""
    stack = [
        ball(
            f"c{level}", (0.0, 0.0, 0.075 + level * 0.15 - 1e-4 * (level + 1)), kind="cylinder", size=SIZES["cylinder"]
        )
        for level in range(3)
    ]
    world = accepting(scene(*stack), "rapier")
    engine = loader(Rapier, load_files)(world)
    engine.set_state(np.concatenate([body.joint.position for body in stack]), np.zeros(18))
    engine.step(1)
    contacts = engine.contacts()
    # the step's own fall, g·dt², next to single precision
    assert contacts["distance"] == pytest.approx(np.full(len(contacts["distance"]), -1e-4), abs=1.2e-5)
    assert np.abs(np.abs(contacts["normal"][:, 2]) - 1.0).max() < 1e-6
    assert len(np.unique(contacts["position"][:, 2].round(2))) == 3, "each on what is below it"


def alone():
    return scene(ball("one", (0.0, 0.0, 1.0), kind="cylinder", size=SIZES["cylinder"]))


def bare(world):
    """Without its acceptance of cylinders."""
    return with_options(world, "rapier", accept=("contact.cone.elliptic",))


@pytest.mark.parametrize("kind", ["box", "capsule", "cylinder"])
def test_oblique_contacts_of_cylinders_are_accepted_by_name(kind):
    with pytest.raises(UnsupportedError, match=rf"shape.cylinder.*{kind}"):
        compile_world(bare(two(kind)), ["rapier"])
    assert compile_world(accepting(two(kind), "rapier"), ["rapier"])


def test_a_hull_counts_as_an_oblique_contact_of_a_cylinder():
    hull = solid("hull", prism(4), (0.0, 0.0, 2.0))
    world = bare(scene(ball("one", (0.0, 0.0, 1.0), kind="cylinder", size=SIZES["cylinder"]), hull))
    with pytest.raises(UnsupportedError, match=r"shape.cylinder.*mesh"):
        compile_world(world, ["rapier"])


@pytest.mark.parametrize("world", [alone(), two("sphere")], ids=["plane", "ball"])
def test_on_planes_and_with_balls_nothing_is_to_be_accepted(world):
    assert compile_world(bare(world), ["rapier"])


def test_approximations_of_pairs_that_never_meet_need_no_acceptance():
    """Two cylinders that cannot move meet nothing."""
    world = scene(ball("ball", (0.0, 0.0, 5.0)), static_body("pole", "cylinder", SIZES["cylinder"], (0.0, 0.0, 1.0)))
    other = static_body("pole_2", "cylinder", SIZES["cylinder"], (0.0, 0.0, 1.1))
    assert compile_world(bare(dataclasses.replace(world, bodies=(*world.bodies, other))), ["rapier"])
