"""What PhysX has of boxes that meet: corners in faces are exact, edges across edges are not, and are accepted by name."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.physx.engine import PhysX
from simspec.errors import UnsupportedError
from simspec.proof.touch.geometry import gap, solids, transforms
from simspec.testing.worlds import accepting, with_options
from simspec.world import frames
from tests.engines.free_bodies import ball, loader, scene
from tests.engines.hulls import random_hull, solid

BOXES = [ball(name, (0.0, 0.0, at), kind="box", size=(0.2, 0.15, 0.1)) for name, at in (("one", 1.0), ("two", 2.0))]
HULLS = [solid(name, random_hull(1), (0.0, 0.0, at)) for name, at in (("one", 1.0), ("two", 2.0))]
DEPTH = 1e-4
FAR = 5.0
"""m above the floor."""


@pytest.mark.skipif(PhysX.version() is None, reason="sapien is not installed")
def test_corners_in_faces_are_exact_and_edges_across_edges_are_as_far_off_as_is_declared(load_files):
    world = accepting(scene(*BOXES), "physx")
    engine, found = loader(PhysX, load_files)(world), {one.body: one for one in solids(world)}
    draw = np.random.default_rng(8)
    off: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    for _ in range(50):
        turns = [frames.normalise(tuple(draw.normal(size=4).tolist())) for _ in range(2)]
        away = draw.normal(size=3)
        away /= np.linalg.norm(away)

        def poses(far, turns=turns, away=away):
            return np.array([[0.0, 0.0, FAR, *turns[0]], [*(np.array([0.0, 0.0, FAR]) + far * away), *turns[1]]])

        def between(far):
            one, two = transforms(poses(far))
            return gap(found[1], one, found[2], two)

        near, far = 0.0, 1.0
        for _ in range(40):
            middle = 0.5 * (near + far)
            near, far = (middle, far) if between(middle).distance < -DEPTH else (near, middle)
        true = between(far)
        engine.set_state(poses(far).ravel(), np.zeros(12))
        engine.step(1)
        told = engine.contacts()
        deepest = int(np.argmin(told["distance"]))
        axes = np.concatenate([np.array(frames.matrix(turn)).T for turn in turns])
        in_face = bool(np.abs(axes @ true.normal).max() > 1.0 - 1e-6)
        turned = float(np.linalg.norm(np.cross(told["normal"][deepest], true.normal)))
        off[in_face].append((turned, abs(told["distance"][deepest] - true.distance)))
    assert min(len(of) for of in off.values()) > 10
    assert max(turned for turned, _ in off[True]) < 1e-5
    assert max(depth for _, depth in off[True]) < 5e-7
    assert 0.1 < np.median([turned for turned, _ in off[False]]) < 0.5, "were these exact, nothing had to be accepted"


@pytest.mark.parametrize(("bodies", "feature"), [(BOXES, "shape.box"), (HULLS, "shape.mesh")])
def test_what_may_meet_by_edges_is_accepted_by_name(bodies, feature):
    world = scene(*bodies)
    bare = with_options(world, "physx", accept=("contact.cone.elliptic",))
    with pytest.raises(UnsupportedError, match=rf"{feature}.*where two edges cross"):
        compile_world(bare, ["physx"])
    assert compile_world(accepting(bare, "physx"), ["physx"])
    alone = with_options(scene(bodies[0]), "physx", accept=("contact.cone.elliptic",))
    assert compile_world(alone, ["physx"]), "on a plane it is exact"
