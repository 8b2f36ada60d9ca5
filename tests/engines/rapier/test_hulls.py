"""Convex hulls in Rapier: their faces, and their corners, which are what planes touch."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.rapier.engine import Faces, Rapier, faces_of
from simspec.errors import EngineError, UnsupportedError
from simspec.testing.worlds import accepting, with_options
from simspec.world import frames
from simspec.world.hull import mesh_size
from tests.engines.free_bodies import ball, loader, of, scene
from tests.engines.hulls import check_corners, check_stands, cube, many, prism, random_hull, solid, static_body
from tests.engines.overlapping import overlaps

PLAIN = (random_hull(4, 8), random_hull(15, 10))
"""Hulls whose faces are far from being in one plane."""
installed = pytest.mark.skipif(Rapier.version() is None, reason="rapier3d is not installed")


@pytest.fixture
def load(load_files):
    return loader(Rapier, load_files)


def bent(up: float) -> tuple[float, ...]:
    """A cube of 0.2 m, one corner of which is so much (m) higher, so that two triangles of its top are not in one plane."""
    corners = np.array(cube(0.2)).reshape(-1, 3)
    corners[7, 2] += up
    return mesh_size(corners)


@installed
def test_corners_are_stored_and_a_changed_corner_is_found(load):
    check_corners(load, Rapier, PLAIN[0])


@installed
def test_hulls_of_all_forms_are_stored():
    import rapier3d

    from simspec.engines.rapier.building import convex

    for size in many(60):
        reshape = np.array(size).astype(np.float32).reshape(-1, 3)
        actual = convex(rapier3d, "hull", size).build().shape.as_convex_polyhedron()
        assert np.array_equal(actual.points, reshape)


@installed
def test_points_without_a_hull_are_an_error(load):
    flat = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0]
    with pytest.raises(EngineError, match="has no hull 'hull': all points are in one plane"):
        load(
            scene(solid("hull", PLAIN[0], (0.0, 0.0, 1.0))),
            lambda content, _: of("hull")(content)["shapes"][0].update(size=flat),
        )


@installed
@pytest.mark.parametrize("floor", ["plane", "box", "hull"])
def test_cubes_as_hulls_stand(floor, load):
    under = {"plane": None, "box": ("box", (4.0, 4.0, 0.2)), "hull": ("mesh", prism(4, 2.0, 0.2))}[floor]
    base = under and static_body("base", *under, (0.0, 0.0, 0.1))
    height = 0.2 if under else 0.0
    check_stands(
        lambda world: load(accepting(world, "rapier")),
        base,
        [solid(f"cube {k}", cube(0.2), (0.5 * k, 0.0, height + 0.1)) for k in range(3)],
    )


def test_hulls_on_hulls_are_accepted_by_name():
    world = scene(*(solid(f"cube {k}", cube(0.2), (0.0, 0.0, 0.1 + 0.2 * k)) for k in range(2)))
    with pytest.raises(UnsupportedError, match=r"stacks of convex hulls are less stable"):
        compile_world(world, ["rapier"])
    assert compile_world(accepted(world), ["rapier"])
    assert compile_world(scene(solid("cube", cube(0.2), (0.0, 0.0, 0.1)), BOX), ["rapier"]), "not on planes and boxes"


@installed
def test_a_cube_as_a_hull_slides_as_far_as_a_box(load):
    for turn in (0.1, 0.9, 2.5):
        body = solid("cube", cube(0.2), (0.0, 0.0, 0.1))
        speed = (np.cos(turn), np.sin(turn), 0.0, 0.0, 0.0, 0.0)
        engine = load(scene(dataclasses.replace(body, joint=dataclasses.replace(body.joint, velocity=speed))))
        engine.step(250)
        assert engine.get_state()[0][:2] == pytest.approx(0.1014 * np.array(speed[:2]), abs=3e-4)


@installed
@pytest.mark.parametrize("kind", ["plane", "sphere", "capsule", "cylinder", "box", "mesh"])
def test_overlaps_are_reported_with_their_depths(kind, load):
    """In 40 poses 0.1 mm deep. With lengths in metres Rapier misses some of them with balls, capsules and cylinders."""
    other = {
        "sphere": (0.1,),
        "capsule": (0.08, 0.15),
        "cylinder": (0.1, 0.2),
        "box": (0.2, 0.15, 0.1),
        "mesh": PLAIN[1],
    }
    hull = solid("hull", PLAIN[0], (0.0, 0.0, 1.0))
    alongside = [] if kind == "plane" else [ball("other", (0.0, 0.0, 9.0), kind=kind, size=other[kind])]
    world = scene(hull, *alongside)
    world = accepted(without_floor(world)) if alongside else world
    for _, depth, _, _ in overlaps(load(world), world, 40, seed=8):
        assert depth is not None
        # Rapier's cylinders are off where they meet others by their rims, boxes as well as hulls
        assert depth < (5e-4 if kind == "cylinder" else 1e-6)


def test_faces_as_rapier_merges_them():
    assert faces_of(cube(0.2)) == Faces(4, 0.0, 0.0)
    assert faces_of(prism(12)) == Faces(12, 0.0, 0.0)
    assert faces_of(bent(1e-3)).off == pytest.approx(1e-3, rel=0.02)
    assert faces_of(bent(0.05)).off == 0.0
    assert faces_of(random_hull(1)).unfelt == pytest.approx(0.055, abs=0.001)


@installed
def test_a_corner_reported_as_without_contact_has_none(load):
    """Were Rapier to feel it, hulls need not be refused on planes: the same hull, written without the check."""
    size = random_hull(1)
    world = scene(solid("hull", cube(0.2), (0.0, 0.0, 1.0)))
    engine = load(world, lambda content, _: of("hull")(content)["shapes"][0].update(size=list(size)))
    draw, missed = np.random.default_rng(1), 0
    for _ in range(300):
        turn = frames.normalise(tuple(draw.normal(size=4).tolist()))
        low = np.min(np.array(size).reshape(-1, 3) @ np.array(frames.matrix(turn))[2])
        engine.set_state(np.array([0.0, 0.0, -low - 1e-3, *turn]), np.zeros(6))
        missed += not len(engine.detect_contacts())
    assert 1 <= missed <= 30


def accepted(world):
    """With hulls and cylinders as Rapier has them."""
    return with_options(world, "rapier", accept=("contact.cone.elliptic", "shape.cylinder", "shape.mesh"))


def hull_with(size, *others):
    """A world of a hull and others, above a floor that it does not touch."""
    return scene(solid("hull", size, (0.0, 0.0, 1.0)), *others)


BOX = ball("box", (0.0, 0.0, 3.0), kind="box", size=(0.2, 0.2, 0.2))
BALL = ball("ball", (0.0, 0.0, 3.0))


def without_floor(world):
    """Nothing touches the floor."""
    contact = dataclasses.replace(world.contact, ignored_groups=(("default", "ground"),))
    floor = dataclasses.replace(world.bodies[0], collision_group="ground")
    return dataclasses.replace(world, bodies=(floor, *world.bodies[1:]), contact=contact)


@pytest.mark.parametrize(
    ("size", "others", "why"),
    [
        (prism(12), (BOX,), r"a face has 12 here.*\('hull', which may touch 'box'\)"),
        (prism(12), (), r"a face has 12 here.*\('hull', which may touch 'floor'\)"),
        (random_hull(1), (), r"by 55 mm here\. Use a box in place of the plane \('hull', which may touch 'floor'\)"),
    ],
)
def test_a_hull_of_which_rapier_would_not_feel_corners_is_refused_by_name(size, others, why):
    world = hull_with(size, *others)
    with pytest.raises(UnsupportedError, match=why):
        compile_world(without_floor(world) if others else world, ["rapier"])
    assert compile_world(without_floor(hull_with(size, BALL)), ["rapier"]), "balls touch whatever faces there are"


def test_a_hull_with_nearly_coplanar_faces_is_approximate():
    world = without_floor(hull_with(bent(1e-3), BOX))
    with pytest.raises(UnsupportedError, match=r"'box' may touch 'hull' up to 1 mm from its surface"):
        compile_world(world, ["rapier"])
    assert compile_world(accepted(world), ["rapier"])
