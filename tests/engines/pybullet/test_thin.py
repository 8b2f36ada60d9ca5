"""Shapes that are thinner than the margin that PyBullet keeps at them on links."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.pybullet.engine import PyBullet
from simspec.errors import UnsupportedError
from simspec.proof.touch.plan import Meetings, meetings_of, touch_checks
from simspec.proof.verify import verify
from simspec.world.hull import hull_within_margin, margin_excess, mesh_size, rounded_core, thickened
from simspec.world.types import EngineOptions, Joint, Pose, World
from tests import worlds

pytestmark = pytest.mark.usefixtures("warm_engines")

PLATE = mesh_size(np.array([[x, y, z] for x in (-0.05, 0.05) for y in (-0.03, 0.03) for z in (-0.000125, 0.000125)]))
THIN = [
    ("box", (0.1, 0.06, 0.0015)),
    ("box", (0.1, 0.06, 0.0004)),
    ("cylinder", (0.03, 0.0015)),
    ("cylinder", (0.0007, 0.1)),
]


def on_a_slide(kind: str, size: tuple[float, ...], accept: tuple[str, ...] = ()) -> World:
    base = worlds.shapes_world(("box",), 0.0)
    floor, free = base.bodies
    shape = dataclasses.replace(free.shapes[0], kind=kind, size=size, pose=Pose())
    slide = Joint("slide", "slide", "floor", Pose((0.0, 0.0, 1.0)), (0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    options = (EngineOptions("pybullet", accept=accept, outside=accept),)
    bodies = (floor, dataclasses.replace(free, joint=slide, shapes=(shape,)))
    return dataclasses.replace(base, bodies=bodies, engines=options)


@pytest.mark.parametrize(("kind", "size"), [*THIN, ("mesh", PLATE)])
def test_shapes_thinner_than_the_margin_are_approximate_on_a_link(kind, size):
    with pytest.raises(UnsupportedError, match=r"boxes, cylinders and meshes are at least 2 mm thick there"):
        compile_world(on_a_slide(kind, size), ["pybullet"])
    decisions = compile_world(on_a_slide(kind, size, (f"shape.{kind}",)), ["pybullet"])["pybullet"].decisions
    (said,) = (decision.how for decision in decisions if decision.feature.value == f"shape.{kind}")
    assert "mm too far outside" in said
    thick = tuple(20.0 * value for value in size)
    said = compile_world(on_a_slide(kind, thick, (f"shape.{kind}",)), ["pybullet"])["pybullet"].decisions
    assert not any("mm too far outside" in name.how for name in said)


@pytest.mark.parametrize(("kind", "size"), [THIN[1], ("mesh", PLATE)])
def test_a_thin_shape_is_stored_and_proven_with_the_reported_thickness(kind, size):
    world = on_a_slide(kind, size, tuple(f"shape.{name}" for name in ("box", "cylinder", "mesh")))
    checks = verify(world, ["pybullet"], levels=("L0", "L1", "L2", "L4", "L5")).engines["pybullet"].checks
    assert not [check for check in checks if not check.passed]
    (sized,) = (check for check in checks if check.level == "L5" and check.name.startswith("size"))
    assert "so thin or fine" in sized.detail


def test_on_the_base_of_a_tree_there_is_no_margin():
    base = worlds.shapes_world(("box",), 0.0)
    floor, free = base.bodies
    thin = dataclasses.replace(free, shapes=(dataclasses.replace(free.shapes[0], size=(0.1, 0.06, 0.0005)),))
    world = dataclasses.replace(base, bodies=(floor, thin))
    assert compile_world(world, ["pybullet"])
    assert not PyBullet.thicker(world)


def on_a_base(kind: str, size: tuple[float, ...], accept: tuple[str, ...] = ()) -> World:
    base = worlds.shapes_world(("box",), 0.0)
    floor, free = base.bodies
    shape = dataclasses.replace(free.shapes[0], kind=kind, size=size, pose=Pose())
    bodies = (floor, dataclasses.replace(free, shapes=(shape,)))
    return dataclasses.replace(base, bodies=bodies, engines=(EngineOptions("pybullet", accept=accept, outside=accept),))


def drum(radius: float, length: float, corners: int) -> tuple[float, ...]:
    """The hull of two regular polygons."""
    turns = 2.0 * np.pi * np.arange(corners) / corners
    ring = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return mesh_size(np.array([[x, y, z] for x, y in ring for z in (-length / 2.0, length / 2.0)]))


@pytest.mark.parametrize(
    ("kind", "size", "blunt"),
    [
        ("cylinder", (0.03, 0.0077), True),
        ("cylinder", (0.03, 0.05), False),
        ("cylinder", (0.003, 0.0077), False),
        ("mesh", drum(0.03, 0.0077, 64), True),
        ("mesh", drum(0.1, 0.05, 16), False),
        ("mesh", drum(0.004, 0.05, 4), False),  # a small box
    ],
)
def test_short_cylinders_and_fine_hulls_are_accepted_by_name_with_the_size(kind, size, blunt):
    world = on_a_base(kind, size)
    assert bool(PyBullet.thicker(world)) == blunt
    if not blunt:
        assert compile_world(world, ["pybullet"])
        return
    with pytest.raises(UnsupportedError, match=r"is up to 0\.25 mm inside the") as error:
        compile_world(world, ["pybullet"])
    assert f"shape.{kind}" in str(error.value)


@pytest.mark.parametrize(("kind", "size"), [("cylinder", (0.03, 0.0077)), ("mesh", drum(0.03, 0.0077, 64))])
def test_a_short_cylinder_is_felt_as_it_says_and_proven_so(kind, size):
    world = on_a_base(kind, size, (f"shape.{kind}", "contact.cone.elliptic"))
    checks = verify(world, ["pybullet"], levels=("L0", "L1", "L2", "L4", "L5")).engines["pybullet"].checks
    assert not [check for check in checks if not check.passed]


def test_a_hull_too_thin_for_the_margin_is_written_as_far_inside_as_possible():
    assert margin_excess(PLATE, 1e-3) == pytest.approx(1e-3 - 0.000125 / 1.5)
    reshape = np.array(hull_within_margin(PLATE, 1e-3)).reshape(-1, 3)
    assert np.ptp(reshape, axis=0) == pytest.approx(
        [0.1 - 2 * 0.000125 / 1.5, 0.06 - 2 * 0.000125 / 1.5, 0.00025 / 3.0]
    )
    thick = tuple(40.0 * value for value in PLATE)
    assert margin_excess(thick, 1e-3) == 0.0
    assert thickened("box", (0.1, 0.06, 0.0019), 1e-3) == (0.1, 0.06, 0.0019)
    assert thickened("box", (0.1, 0.06, 0.0015), 1e-3) == (0.1, 0.06, 0.002)
    assert thickened("cylinder", (0.0007, 0.1), 1e-3) == (0.001, 0.1)
    assert rounded_core("cylinder", (0.02, 0.1), 1e-3) == pytest.approx((0.019, 0.098))


def test_overlaps_by_rounded_edges_alone_are_reported_without_an_error():
    """A ball of 10 cm reaches 0.3 mm into the corner of a sole of 2 mm: where edges are rounded by 1 mm it is outside."""
    base = worlds.shapes_world(("box",), 0.0)
    floor, free = base.bodies
    sole = dataclasses.replace(free.shapes[0], kind="box", size=(0.16, 0.07, 0.002), pose=Pose())
    ball = dataclasses.replace(floor.shapes[0], kind="sphere", size=(0.1,), pose=Pose())
    joint = dataclasses.replace(floor.joint, origin=Pose())
    heavy = dataclasses.replace(free.inertial, centre_of_mass=(0.0, 0.0, 0.0))
    bodies = (
        dataclasses.replace(floor, shapes=(ball,), joint=joint),
        dataclasses.replace(free, shapes=(sole,), inertial=heavy),
    )
    world = dataclasses.replace(base, bodies=bodies)
    solids = meetings_of(world).solids
    units = [(solid.body, [solid.name]) for solid in solids]
    corner = np.array([0.08, 0.035, 0.001])
    away = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)

    def judged(depth: float, rounding: float) -> bool:
        at = -(corner + (0.1 - depth) * away)
        q = np.array([[*at, 1.0, 0.0, 0.0, 0.0]])
        meetings = Meetings(q, np.array([[0, 0, 1, 1]]), solids)
        actual = {
            (world.bodies[solid.body].name, solid.name): rounding for solid in solids if solid.shape.kind == "box"
        }
        (check,) = touch_checks(world, meetings, units, np.zeros((0, 3), int), rounding=actual)
        assert check.passed == ("edges alone" in check.detail)
        return check.passed

    assert judged(0.0003, 0.001)
    assert not judged(0.0003, 0.0)  # an engine that rounds nothing sees it
    assert not judged(0.0015, 0.001)  # deeper than what is rounded away
