"""Boxes that meet in PhysX: corners in faces are exact, edges across edges are not, and are accepted by name."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.physx.engine import PhysX
from simspec.errors import UnsupportedError
from simspec.testing.worlds import accepting, with_options
from tests.engines.free_bodies import ball, loader, scene
from tests.engines.hulls import random_hull, solid
from tests.engines.overlapping import overlaps

BOXES = [ball(name, (0.0, 0.0, at), kind="box", size=(0.2, 0.15, 0.1)) for name, at in (("one", 1.0), ("two", 2.0))]
HULLS = [solid(name, random_hull(1), (0.0, 0.0, at)) for name, at in (("one", 1.0), ("two", 2.0))]


@pytest.mark.skipif(PhysX.version() is None, reason="sapien is not installed")
def test_corners_in_faces_are_exact_and_edges_across_edges_are_as_far_off_as_is_declared(load_files):
    world = accepting(scene(*BOXES), "physx")
    engine = loader(PhysX, load_files)(world)
    off: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    for true, depth, turned, axes in overlaps(engine, world, 50, seed=8):
        assert depth is not None, "none is missed"
        in_face = bool(np.abs(axes @ true.normal).max() > 1.0 - 1e-6)
        off[in_face].append((turned, depth))
    assert min(len(of) for of in off.values()) > 10
    assert max(turned for turned, _ in off[True]) < 1e-5
    assert max(depth for _, depth in off[True]) < 5e-7
    assert 0.1 < np.median([turned for turned, _ in off[False]]) < 0.5, "were these exact, nothing had to be accepted"


@pytest.mark.parametrize(("bodies", "feature"), [(BOXES, "shape.box"), (HULLS, "shape.mesh")])
def test_contact_of_edges_is_accepted_by_name(bodies, feature):
    world = scene(*bodies)
    bare = with_options(world, "physx", accept=("contact.cone.elliptic",))
    with pytest.raises(UnsupportedError, match=rf"{feature}.*where edges of (two boxes|a hull) cross"):
        compile_world(bare, ["physx"])
    assert compile_world(accepting(bare, "physx"), ["physx"])
    alone = with_options(scene(bodies[0]), "physx", accept=("contact.cone.elliptic",))
    assert compile_world(alone, ["physx"]), "on a plane it is exact"
