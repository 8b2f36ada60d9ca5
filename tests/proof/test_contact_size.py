"""Sizes by touch: shapes of every kind and role, and shapes that are not what they should be."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.process import Operation, call
from simspec.errors import UnsupportedError
from simspec.proof.contact import size
from simspec.proof.contact.size import GAPS, size_error, size_figures, size_trial, surface_points
from simspec.world.kinematics import layout_of
from simspec.world.types import Body, Contact, EngineOptions, Inertial, Joint, Material, PairContact, Pose, Shape, World
from tests.installed import INSTALLED, JOINTED
from tests.proof.contact_probing import ACCEPT

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = sorted(JOINTED)
SIZES = {
    "sphere": (0.05,),
    "box": (0.1, 0.2, 0.3),
    "cylinder": (0.02, 0.1),
    "capsule": (0.02, 0.1),
    "ellipsoid": (0.1, 0.2, 0.05),
    "plane": (),
}


LACKING = {
    ("gazebo", "ellipsoid"),
    ("ode", "ellipsoid"),
    ("pybullet", "ellipsoid"),
    ("physx", "ellipsoid"),
    ("physx", "cylinder"),
    ("rapier", "ellipsoid"),
}
"""Engines that have no shapes of a kind."""


def _body(name, kind, role, material="rubber"):
    shape = Shape(f"{name}/solid", kind, SIZES[kind], Pose(), material)
    inertial = Inertial(1.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    if role == "fixed":
        return Body(name, name, Inertial(0.0), Joint(name, "fixed"), (shape,))
    if role == "free":
        joint = Joint(name, "free", position=(0.0, 0.0, 5.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)
        return Body(name, name, inertial, joint, (shape,))
    joint = Joint(name, "hinge", role, Pose(), (0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    return Body(name, role, inertial, joint, (shape,))


def world_of(kinds, settings=()):
    """Each kind fixed, free and as the child of a ball; planes fixed only."""
    bodies = [_body("probe", "sphere", "free")]
    for kind in kinds:
        bodies.append(_body(f"fixed_{kind}", kind, "fixed"))
        if kind != "plane":
            root = _body(f"root_{kind}", "sphere", "free")
            bodies += [_body(f"free_{kind}", kind, "free"), root, _body(f"child_{kind}", kind, root.name)]
    contact = Contact("elliptic", (Material("rubber", 0.5),), (PairContact("rubber", "rubber", 0.5, 0.0),))
    options = tuple(EngineOptions(name, dict(settings).get(name, ()), ACCEPT) for name in ENGINES)
    return World("sizes", tuple(bodies), contact, engines=options)


def measured(engine, trial, folder, world=None):
    """The trial's figures, in ``world`` (default: its own)."""
    world = world or trial.world
    write_folder(compile_world(world, [engine])[engine].files, folder / "files")
    operation = Operation("touching", {}, {"q": trial.q, "v": np.zeros((1, layout_of(world).nv))})
    return size_figures(trial, call(engine, folder / "files", [operation]).answers[0].arrays["touching"])


# --- the points ---------------------------------------------------------------------------------------------------


def _box_distance(p, s):
    q = np.abs(p) - np.array(s) / 2
    return np.linalg.norm(np.maximum(q, 0.0)) + min(q.max(), 0.0)


def _cylinder_distance(p, s):
    q = np.array([np.hypot(p[0], p[1]) - s[0], abs(p[2]) - s[1] / 2])
    return np.linalg.norm(np.maximum(q, 0.0)) + min(q.max(), 0.0)


DISTANCE = {
    "sphere": lambda p, s: np.linalg.norm(p) - s[0],
    "box": _box_distance,
    "cylinder": _cylinder_distance,
    "capsule": lambda p, s: np.linalg.norm(p - [0, 0, np.clip(p[2], -s[1] / 2, s[1] / 2)]) - s[0],
    "ellipsoid": lambda p, s: (np.linalg.norm(p / s) - 1.0) / np.linalg.norm(p / np.square(s)),  # of the first order
    "plane": lambda p, s: p[2],
}


@pytest.mark.parametrize("kind", sorted(SIZES))
def test_points_lie_on_the_surface_and_normals_point_out_of_it(kind):
    """Compared with signed distances of a separate implementation."""
    shape = Shape("x", kind, SIZES[kind])
    points = surface_points(shape, 0.0)
    assert len(points) >= 2
    assert len({point.point for point in points}) == len(points)
    for entry in points:
        point, normal = np.array(entry.point), np.array(entry.normal)
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        assert DISTANCE[kind](point, SIZES[kind]) == pytest.approx(0.0, abs=1e-12)
        assert DISTANCE[kind](point + 1e-6 * normal, SIZES[kind]) == pytest.approx(1e-6, rel=1e-3)


# --- what touching says -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("edge", "expected"),
    [(0.0, 0.0), (1e-3, 1.25e-3), (0.2e-3, 0.3e-3), (-1e-3, -1.25e-3), (0.05, 5e-3), (-0.05, -5e-3), (9e-5, 0.0)],
)
def test_size_error(edge, expected):
    assert size_error({gap: gap <= edge for gap in GAPS}) == pytest.approx(expected)


def test_a_hole_in_the_touching_is_an_error():
    assert size_error({gap: gap <= 0.0 and gap != GAPS[1] for gap in GAPS}) == pytest.approx(0.5 * (GAPS[0] + GAPS[1]))


# --- in engines ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("kind", sorted(SIZES))
def test_true_sizes(engine, kind, tmp_path):
    trial = size_trial(world_of([kind]))
    try:
        found = measured(engine, trial, tmp_path)
    except UnsupportedError:
        assert (engine, kind) in LACKING
        return
    roles = {figure.subject.rsplit(", ", 1)[1] for figure in found if figure.subject.startswith(kind)}
    assert roles == ({"fixed"} if kind == "plane" else {"fixed", "free", "child"})
    assert all(figure.passed for figure in found), found


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("role", ["fixed", "free", "child"])
def test_a_millimetre_more_is_caught(engine, role, tmp_path):
    kind = "capsule" if (engine, "cylinder") in LACKING else "cylinder"
    trial = size_trial(world_of([kind]))
    subject, index, _, _ = next(shape for shape in trial.shapes if shape[0] == f"{kind} 0.02 × 0.1 m, {role}")
    bodies = list(trial.world.bodies)
    shape = bodies[index].shapes[0]
    grown = dataclasses.replace(shape, size=(shape.size[0] + 1e-3, shape.size[1]))
    bodies[index] = dataclasses.replace(bodies[index], shapes=(grown,))
    found = measured(engine, trial, tmp_path, dataclasses.replace(trial.world, bodies=tuple(bodies)))
    assert [figure.subject for figure in found if not figure.passed] == [subject]
    (wrong,) = (figure for figure in found if not figure.passed)
    assert wrong.measured == pytest.approx(1e-3, abs=0.75e-3)
    assert kind == "capsule" or "side" in wrong.worst  # a capsule grows at its ends, too


@pytest.mark.parametrize("engine", INSTALLED)
def test_parts_that_are_welded_together_need_no_joint(engine, tmp_path):
    """Engines without joints have such trees too."""
    parts = []
    for root in ("fixed", "free"):
        below, part = _body(root, "sphere", root), _body(f"{root}_part", "box", "free")
        part = dataclasses.replace(part, model=root, inertial=Inertial(0.0), joint=Joint(part.name, "fixed", root))
        parts += [below, part]
    world = dataclasses.replace(world_of([]), bodies=tuple(parts))
    world = dataclasses.replace(world, engines=(EngineOptions(engine, (), ACCEPT),))
    trial = size_trial(world)
    assert {subject.rsplit(", ", 1)[1] for subject, *_ in trial.shapes} == {"fixed", "free", "part", "fixed part"}
    found = measured(engine, trial, tmp_path)
    assert len(found) == 4
    assert all(figure.passed for figure in found), found


def test_a_detector_that_takes_capsules_for_balls_is_caught(tmp_path):
    world = world_of(["capsule"], {"dart": (("collision_detector", "fcl"),)})
    found = measured("dart", size_trial(world), tmp_path)
    assert {figure.subject.split()[0] for figure in found if not figure.passed} == {"capsule"}


def test_shapes_without_contact_are_not_probed():
    world = world_of(["box"])
    separate = dataclasses.replace(world.contact, pairs=(PairContact("rubber", "rubber", 0.0, 0.0, collide=False),))
    assert size_trial(dataclasses.replace(world, contact=separate)) is None


def test_omitted_shapes_are_reported(monkeypatch):
    monkeypatch.setattr(size, "MOST_SHAPES", 2)
    trial = size_trial(world_of(["box"]))
    assert len(trial.shapes) == 2
    assert trial.left_out == 2
    assert all("2 more" in figure.note for figure in size_figures(trial, np.zeros((0, 3), int)))
