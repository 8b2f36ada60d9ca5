"""Convex hulls in PhysX: it makes them anew of their corners, of which it leaves some out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.physx.engine import PhysX, left_out
from simspec.errors import EngineError, UnsupportedError
from simspec.testing.worlds import accepting
from simspec.world.hull import mesh_size
from tests.engines.free_bodies import loader, of, scene
from tests.engines.hulls import check_corners, check_stands, cube, many, prism, random_hull, solid, static_body

installed = pytest.mark.skipif(PhysX.version() is None, reason="sapien is not installed")


@pytest.fixture
def load(load_files):
    of = loader(PhysX, load_files)
    return lambda world, *change: of(accepting(world, "physx"), *change)


def dented(out: float) -> tuple[float, ...]:
    """A cube of 0.2 m that stands on a corner, with a ninth corner so far (m) above one of its faces."""
    corners = np.concatenate([np.array(cube(0.2)).reshape(-1, 3), [[0.02, 0.01, 0.1 + out]]])
    x, y, z = np.array([1.0, 2.0, 2.0]) / 3.0, np.array([2.0, 1.0, -2.0]) / 3.0, np.array([-2.0, 2.0, -1.0]) / 3.0
    return mesh_size(corners @ np.stack([x, y, z]))


@installed
def test_corners_are_stored_and_a_changed_corner_is_found(load):
    check_corners(load, PhysX, random_hull(1))


@installed
def test_vertices_that_physx_leaves_out_are_predicted():
    """Of 120 hulls of all forms PhysX keeps every corner of those that are not refused, and few others."""
    from simspec.engines.physx.units import SCALE, imported

    physx = imported().physx
    material = physx.PhysxMaterial(0.0, 0.0, 0.0)
    kept, refused_for_nothing = 0, 0
    for size in many(120):
        reshape = (SCALE * np.array(size)).astype(np.float32).reshape(-1, 3)
        vertices = physx.PhysxCollisionShapeConvexMesh(reshape, np.ones(3, dtype=np.float32), material).vertices
        whole = sorted(vertices.tolist()) == sorted(reshape.tolist())
        if left_out(size) is None:
            assert whole
            kept += 1
        refused_for_nothing += whole and left_out(size) is not None
    assert kept > 60
    assert refused_for_nothing <= 4


@pytest.mark.parametrize(
    ("size", "why"),
    [
        (prism(130), r"hulls of up to 255 corners, and this has 260"),
        (random_hull(2, 140), r"hulls of up to 255 faces, and this has 276"),
        (dented(1e-4), r"1 of 9 corners do \(by 0\.0001 m at least\)"),
    ],
    ids=["corners", "faces", "near"],
)
def test_a_hull_that_physx_would_not_hold_is_refused_by_name(size, why):
    with pytest.raises(UnsupportedError, match=why + r".*\('hull'\).*max_vertices"):
        compile_world(scene(solid("hull", size, (0.0, 0.0, 1.0))), ["physx"])


def test_a_hull_that_is_only_seen_is_not_refused():
    body = solid("hull", dented(1e-4), (0.0, 0.0, 1.0))
    seen = dataclasses.replace(body.shapes[0], collision=False, visual=True)
    assert compile_world(scene(dataclasses.replace(body, shapes=(seen,))), ["physx"])


@installed
@pytest.mark.parametrize(
    ("size", "why"),
    [
        (dented(1e-4), "leaves 1 of the 9 corners of 'hull' out of its hull, and adds 0"),
        ([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0], "leaves 4 of the 4 corners of .* and adds 5"),
    ],
)
def test_files_with_such_a_hull_are_an_error(size, why, load):
    world = scene(solid("hull", random_hull(1), (0.0, 0.0, 1.0)))
    with pytest.raises(EngineError, match=why):
        load(world, lambda content, _: of("hull")(content)["shapes"][0].update(size=list(size)))


FLOORS = {"plane": None, "box": ("box", (4.0, 4.0, 0.2)), "hull": ("mesh", prism(4, 2.0, 0.2))}


@installed
@pytest.mark.parametrize("floor", FLOORS)
def test_hulls_stand_on_their_faces(floor, load):
    under = FLOORS[floor]
    base = under and static_body("base", *under, (0.0, 0.0, 0.1))
    height = 0.2 if under else 0.0
    check_stands(load, base, [solid("prism", prism(12), (0.0, 0.0, height + 0.05))])
    check_stands(load, base, [solid(f"cube {k}", cube(0.2), (0.0, 0.0, height + 0.1 + 0.2 * k)) for k in range(3)])


@installed
def test_a_cube_as_a_hull_slides_as_a_box_does(load):
    for turn in (0.1, 0.9, 2.5):
        ways = []
        for size in ((0.2, 0.2, 0.2), cube(0.2)):
            body = solid("cube", size, (0.0, 0.0, 0.1))
            speed = (np.cos(turn), np.sin(turn), 0.0, 0.0, 0.0, 0.0)
            engine = load(scene(dataclasses.replace(body, joint=dataclasses.replace(body.joint, velocity=speed))))
            engine.step(250)
            ways.append(engine.get_state()[0][:2])
        assert ways[1] == pytest.approx(ways[0], abs=1e-4)
        assert np.linalg.norm(ways[1]) == pytest.approx(0.1014, abs=2e-4)
