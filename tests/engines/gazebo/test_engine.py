"""Gazebo: its read-back, the SDF of a world, refusals, joints, contact, states that would end it."""

from __future__ import annotations

import dataclasses
import json
import math
import socket

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.engines.gazebo import building
from simspec.engines.gazebo.building import SdfPlan, proper
from simspec.engines.gazebo.engine import Gazebo
from simspec.engines.kit.building import Walk
from simspec.engines.kit.compiled import CompileError, Missing
from simspec.errors import EngineError, UnsupportedError
from simspec.formats.kit.text import json_text
from simspec.formats.world import WORLD, WorldJson
from simspec.proof.checks import inventory_checks
from simspec.proof.selftest_worlds import WORLDS
from simspec.testing.worlds import accepting
from simspec.world.types import Body, Inertial, Joint, Physics, Pose, World
from tests import worlds
from tests.engines.drake.scenes import boxes
from tests.files import write
from tests.planted import SHARED

installed = pytest.mark.skipif(Gazebo.version() is None, reason="gz-physics or a C++ compiler is not installed")
REFUSED = ("rolling", "ground")
DT = 0.001


def accepting_gazebo(world):
    """The world with Gazebo's approximations accepted."""
    return accepting(world, "gazebo")


@pytest.fixture
def load(load_files):
    """A function that compiles and loads a world, with its files changed on the way."""

    def of(world, change=lambda content, sidecar: None):
        files = dict(compile_world(accepting_gazebo(world), ["gazebo"])["gazebo"].files)
        content, sidecar = json.loads(files[WORLD]), json.loads(files[SIDECAR])
        change(content, sidecar)
        return load_files(Gazebo, files | {WORLD: json_text(content), SIDECAR: json_text(sidecar)})

    return of


def joint_world(**fields):
    """A wheel of 1 kg m² on a hinge, or 1 kg on a slide."""
    joint = Joint("j", fields.pop("kind", "hinge"), None, Pose(), (0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    inertial = Inertial(1.0, inertia=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    body = Body("b", "b", inertial, dataclasses.replace(joint, **fields))
    return World("joint", (body,), physics=Physics(gravity=(0.0, 0.0, 0.0), timestep=DT, steps=10))


@installed
@pytest.mark.parametrize("name", [name for name in SHARED if name not in REFUSED])
def test_the_inventory_equals_the_expectation_of_the_world(name, load):
    world = accepting_gazebo(WORLDS[name]("gazebo"))
    back = load(world).read_back()
    (check,) = inventory_checks(Gazebo.expected_inventory(world, back.neutral), back.inventory)
    assert check.passed, check.detail
    assert check.count > 20


def test_the_text_has_no_turned_inertia_and_no_joint_that_becomes_a_weld(tmp_path):
    """gz-physics turns an <inertial> twice, and makes welds of ``continuous`` joints and gearboxes (measured)."""
    world = accepting_gazebo(worlds.every_joint())
    files = compile_world(world, ["gazebo"])["gazebo"].files
    text = SdfPlan(Walk.of(WorldJson().read(write(files, tmp_path)))).text
    assert "continuous" not in text
    assert "gearbox" not in text
    lines = text.splitlines()
    turned = [lines[at + 1].strip() for at, line in enumerate(lines) if "<inertial>" in line]
    assert turned
    assert all(line.endswith(" 0 0 0</pose>") for line in turned)


@installed
@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_stops_at_its_limit(kind, side, load):
    engine = load(joint_world(kind=kind, position_limits=(-0.0105, 0.0105), velocity=(2.0 * side,)))
    engine.step(20, np.array([3.0 * side]))
    q, v = engine.get_state()
    assert q == pytest.approx(0.0105 * side, abs=1e-9)
    assert v == pytest.approx(0.0, abs=1e-9)
    engine.step(100, np.array([-3.0 * side]))
    assert engine.get_state()[1] * side == pytest.approx(-0.3, rel=1e-6)  # it leaves at once


@installed
@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_dry_friction_holds_and_brakes(kind, load):
    engine = load(joint_world(kind=kind, dry_friction=2.0))
    engine.step(10, np.array([1.9]))
    assert engine.get_state()[1] == pytest.approx(0.0, abs=1e-11)  # of its solver's softness
    engine.step(10, np.array([5.0]))
    assert engine.get_state()[1] == pytest.approx(0.03, rel=1e-9)
    engine.disable_dry_friction(np.array([0]))
    engine.step(10, np.array([5.0]))
    assert engine.get_state()[1] == pytest.approx(0.08, rel=1e-9)


@installed
def test_armature_is_felt_by_efforts(load):
    engine = load(joint_world(armature=3.0))
    engine.step(10, np.array([8.0]))
    assert engine.get_state()[1] == pytest.approx(0.02, rel=1e-12)
    assert engine.mass_matrix() == pytest.approx(np.array([[4.0]]), rel=1e-12)


@installed
@pytest.mark.parametrize("depth", [1e-4, 0.01])
def test_overlaps_are_taken_back_by_the_common_law(depth, load):
    """DART's own takes back 0.01 m/s at most."""
    engine = load(boxes(1))
    q, v = engine.get_state()
    q[2] -= depth
    engine.set_state(q, v)
    engine.step(1)
    assert engine.get_state()[1][2] == pytest.approx(0.01 * depth / DT, rel=5e-4)


@installed
@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_friction_is_that_of_the_circumscribed_pyramid(degrees, load):
    world = boxes(1, friction=0.5)
    sliding = 9.81 * 0.8 * math.cos(math.radians(degrees)), 9.81 * 0.8 * math.sin(math.radians(degrees)), -9.81
    engine = load(dataclasses.replace(world, physics=dataclasses.replace(world.physics, gravity=sliding)))
    engine.step(200)
    v = engine.get_state()[1][:2]
    for axis in (0, 1):  # each axis has a friction of its own
        wanted = max(0.0, sliding[axis] - 0.5 * 9.81) * 0.2
        assert v[axis] == pytest.approx(wanted, abs=0.01)


def _lively(content, _):
    for body, restitution in zip(content["bodies"], (1.6, 0.5), strict=True):
        for copy in body["shapes"][0]["copies"]:
            copy["restitution"] = restitution


@installed
def test_restitution_above_1_is_stored_where_the_law_of_a_pair_needs_it(load):
    """SDF's own are at most 1, and one of the two numbers whose product is a pair's law may be above."""
    engine = load(boxes(1), _lively)
    copies = [body.shapes[0].surfaces for body in engine.read_back().bodies]
    assert [{entry.restitution for entry in of} for of in copies] == [{1.6}, {0.5}]
    q, v = engine.get_state()
    v[2], q[2] = -1.0, q[2] + 0.0005
    engine.set_state(q, v)
    engine.step(3)
    assert engine.get_state()[1][2] == pytest.approx(0.8, abs=0.05)


@installed
def test_a_mass_of_a_fixed_body_is_found(load):
    world = accepting_gazebo(boxes(1))
    engine = load(world, lambda content, sidecar: content["bodies"][0].update(mass=0.01))
    (check,) = inventory_checks(Gazebo.expected_inventory(world, {}), engine.read_back().inventory)
    assert "floor.mass" in check.detail or "mass" in check.where


@installed
def test_a_restitution_whose_product_with_every_other_is_zero_is_seen(load):
    world = accepting_gazebo(boxes(1))
    engine = load(
        world, lambda content, sidecar: content["bodies"][0]["shapes"][0]["copies"][0].update(restitution=0.01)
    )
    (check,) = inventory_checks(Gazebo.expected_inventory(world, {}), engine.read_back().inventory)
    assert not check.passed
    assert "restitution" in check.detail


@installed
def test_nothing_listens_to_the_network(load, monkeypatch):
    """gz-common's profiler would, at all addresses, for as long as the process lives."""
    with socket.socket() as free:
        free.bind(("", 0))
        port = free.getsockname()[1]
    monkeypatch.setenv("RMT_PORT", str(port))
    load(boxes(1)).step(1)
    with socket.socket() as other:
        other.bind(("", port))


@installed
def test_a_state_of_the_wrong_length_is_refused_before_it_ends_the_process(load):
    engine = load(boxes(1))
    q, v = engine.get_state()
    with pytest.raises(EngineError, match="not finite"):
        engine.set_state(q * math.nan, v)
    with pytest.raises(EngineError, match="not finite"):
        engine.step(1, np.full(len(v), math.nan))
    with pytest.raises(EngineError, match="not finite"):
        engine.step(10, np.full(len(v), 1e308))


def test_cylinders_side_by_side_are_accepted_by_name():
    with pytest.raises(UnsupportedError, match="contacts of cylinders with cylinders"):
        compile_world(
            worlds.with_options(boxes(2, kind="cylinder"), "gazebo", accept=("contact.cone.elliptic",)), ["gazebo"]
        )


def _moving_plane(content, _):
    content["bodies"][1]["shapes"][0].update(kind="plane", size=[])


def _rolling(content, _):
    content["bodies"][1]["shapes"][0]["copies"][0]["rolling_friction"] = 0.01


@installed
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_moving_plane, "plane 'b0_0' on a body that moves"),
        (_rolling, "no torsional or rolling friction"),
        (lambda content, sidecar: sidecar["settings"].pop("contact_solver"), "contact_solver"),
    ],
)
def test_features_that_gazebo_lacks_are_refused_when_loaded(change, said, load):
    with pytest.raises(EngineError, match=said):
        load(boxes(1), change)


def test_an_inertia_that_sdf_refuses_is_not_proper(tmp_path):
    files = compile_world(accepting_gazebo(worlds.every_joint()), ["gazebo"])["gazebo"].files
    body = WorldJson().read(write(files, tmp_path)).bodies[0]
    proper_single = dataclasses.replace(body, mass=1.0, inertia=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    assert proper(proper_single)
    assert not proper(dataclasses.replace(proper_single, mass=0.0))
    assert not proper(dataclasses.replace(proper_single, inertia=(0.0, 1.0, 1.0, 0.0, 0.0, 0.0)))
    assert not proper(dataclasses.replace(proper_single, inertia=(1.0, 1.0, 3.0, 0.0, 0.0, 0.0)))


def test_a_missing_library_is_named():
    missing = dataclasses.replace(building.PART, packages=("ignition-physics99",))
    lacking = missing.lacking()
    assert isinstance(lacking, CompileError)
    assert lacking.missing in (Missing.PACKAGE, Missing.PKG_CONFIG, Missing.COMPILER)


@installed
def test_a_fixed_body_without_mass_has_no_centre_and_no_moments(load_files):
    """As bases of robots are written, whose inertial has a place and moments, and no mass."""
    world = accepting(boxes(1), "gazebo")
    floor, *others = world.bodies
    floor = dataclasses.replace(floor, inertial=Inertial(0.0, (-0.1, 0.0, 0.07), (0.05, 0.06, 0.03, 0.0, 0.0, 0.0)))
    world = dataclasses.replace(world, bodies=(floor, *others))
    back = load_files(Gazebo, compile_world(world, ["gazebo"])["gazebo"].files).read_back()
    (check,) = inventory_checks(Gazebo.expected_inventory(world, back.neutral), back.inventory)
    assert check.passed, check.detail
