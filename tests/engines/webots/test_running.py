"""Webots at work, as far as that can be tested without one: a program and a library that have its interface stand for it, and
step a world by the Open Dynamics Engine as Webots does (``stand_in/``). It is no real Webots."""

from __future__ import annotations

import ctypes.util
import dataclasses
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simspec import cli
from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.dialects.webots.nodes import WebotsSidecar
from simspec.dialects.webots.raising import raised
from simspec.engines.kit.environments import InstallState, diagnose
from simspec.engines.kit.session import Session
from simspec.engines.ode.engine import Ode
from simspec.engines.webots import program
from simspec.engines.webots import program as live
from simspec.engines.webots.engine import Webots
from simspec.engines.webots.simulation import WebotsStates
from simspec.errors import EXIT_OK, EngineError
from simspec.formats.wbt.format import Wbt
from simspec.formats.wbt.reading import parse
from simspec.proof.verify import verify
from simspec.support.features import Feature
from simspec.world.kinematics import initial_state, poses
from simspec.world.types import EngineOptions, World
from tests.dialects.webots.worlds import every

HERE = Path(__file__).parent / "stand_in"
ROOT = Path(__file__).resolve().parents[3]
WORLDS = every()
COMPILER = shutil.which("cc")


# --- states as files --------------------------------------------------------------------------------------------------


def states_of(world, folder):
    write_folder(compile_world(world, ["webots"])["webots"].files, folder)
    sidecar = WebotsSidecar.of(read_sidecar(folder))
    return WebotsStates(Wbt().read(folder), sidecar), sidecar


def elsewhere(states, seed=1):
    """A state away from the initial one."""
    rng = np.random.default_rng(seed)
    q, v = states.initial()
    q, v = q + 0.4 * rng.standard_normal(len(q)), v + rng.standard_normal(len(v))
    for body, at in zip(states.world.bodies, states.layout.position, strict=True):
        if body.joint.kind in ("ball", "free"):
            turn = slice(at.stop - 4, at.stop)
            q[turn] *= np.sign(q[turn][0]) / np.linalg.norm(q[turn])
    return q, v


@pytest.mark.parametrize("name", sorted(WORLDS))
def test_a_file_begins_in_the_state_that_it_was_written_for(name, tmp_path):
    """Read by the independent reader, which finds rates and places from the bodies'."""
    states, given = states_of(WORLDS[name], tmp_path)
    q, v = elsewhere(states)
    names = [body.name for body in given.bodies]
    turns = {start.body: tuple(q[states.layout.position[names.index(start.body)]]) for start in given.starts}
    starts = tuple(dataclasses.replace(start, turn=turns[start.body]) for start in given.starts)
    back = raised(parse(states.text(q, v, True, ()), "world.wbt"), dataclasses.replace(given, starts=starts))
    found = initial_state(World("", back.bodies))
    np.testing.assert_allclose(found[0], q, atol=1e-14)
    np.testing.assert_allclose(found[1], v, atol=1e-13)


@pytest.mark.parametrize("name", sorted(WORLDS))
def test_the_initial_state_is_the_file_as_it_was(name, tmp_path):
    states, given = states_of(WORLDS[name], tmp_path)
    again = raised(parse(states.text(*states.initial(), True, ()), "world.wbt"), given)
    for body, other in zip(again.bodies, states.model.bodies, strict=True):
        assert (body.name, body.shapes, body.inertial) == (other.name, other.shapes, other.inertial)
    assert again.laws == states.model.laws


def test_contact_and_dry_friction_are_switched_off_in_the_file(tmp_path):
    states, _ = states_of(WORLDS["dry friction"], tmp_path)
    friction = [row for row, body in enumerate(states.world.bodies) if body.joint.dry_friction]
    text = states.text(*states.initial(), False, friction[:1])
    solids = [node for node in parse(text, "world.wbt").walk() if node.kind == "Solid"]
    assert {node.node("boundingObject") for node in solids} == {None}
    rough = [node for node in parse(text, "world.wbt").walk() if any(f.name == "staticFriction" for f in node.fields)]
    assert sum(node.number("staticFriction") > 0.0 for node in rough) == len(friction) - 1


# --- an installation ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def library(tmp_path_factory):
    if COMPILER is None or ctypes.util.find_library("ode") is None:
        pytest.skip("the stand-in for Webots needs a compiler of C and ODE")
    built = tmp_path_factory.mktemp("webots") / "libController.so"
    subprocess.run([COMPILER, "-shared", "-fPIC", "-o", built, HERE / "libController.c"], check=True)
    return built


@pytest.fixture
def home(library, tmp_path, monkeypatch):
    """A folder that looks like an installation, which WEBOTS_HOME names."""
    place = tmp_path / "webots"
    for folder in ("resources", "lib/controller"):
        (place / folder).mkdir(parents=True)
    (place / "resources/version.txt").write_text("R2025a\n", encoding="ascii")
    shutil.copy(library, place / "lib/controller/libController.so")
    started = place / "webots"
    words = f"import sys\nsys.path.insert(0, {str(ROOT)!r})\nfrom tests.engines.webots.stand_in.world import main\n"
    started.write_text(f"#!{sys.executable}\n{words}sys.exit(main(sys.argv[1:]))\n", encoding="utf-8")
    started.chmod(0o755)
    monkeypatch.setenv("WEBOTS_HOME", str(place))
    monkeypatch.setenv("DISPLAY", ":0")
    return place


@pytest.fixture
def begun(home, tmp_path):
    """A function that begins a session with a world in Webots."""
    opened = []

    def begin(world):
        folder = tmp_path / f"files-{len(opened)}"
        write_folder(compile_world(world, ["webots"])["webots"].files, folder)
        opened.append(Session(Webots, folder))
        return opened[-1]

    yield begin
    for session in opened:
        session.close()


def test_an_installed_program_is_found(home):
    assert Webots.version() == "R2025a"
    assert (diagnose(Webots).state, Webots.files_alone()) == (InstallState.WHOLE, "")


@pytest.mark.parametrize(
    ("break_it", "why"),
    [
        (lambda home: (home / "lib/controller/libController.so").unlink(), "has no lib/controller/libController.so"),
        (lambda home: (home / "webots").chmod(0o644), "cannot be executed"),
        (
            lambda home: (home / "resources/version.txt").write_text("R2022b"),
            "is R2022b: simspec writes worlds of R2023b",
        ),
        (
            lambda home: (home / "resources/version.txt").write_text("new\n"),
            "should have a version like R2023b, and has 'new'",
        ),
        (lambda home: shutil.rmtree(home), "which has no resources/version.txt"),
    ],
)
def test_half_an_installation_is_none_and_says_why(home, break_it, why):
    break_it(home)
    assert Webots.version() is None
    found = diagnose(Webots)
    assert found.state is InstallState.FILES
    assert why in found.problems[1]


def test_without_a_screen_a_virtual_screen_is_started(home, monkeypatch, tmp_path):
    monkeypatch.delenv("DISPLAY")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "no xvfb-run" in diagnose(Webots).problems[1]
    (tmp_path / "xvfb-run").write_text("#!/bin/sh\n", encoding="ascii")
    (tmp_path / "xvfb-run").chmod(0o755)
    assert program.INSTALLED.command(Path("world.wbt"), 7)[:3] == ["xvfb-run", "-a", str(home.resolve() / "webots")]


def test_a_program_on_the_path_is_found(home, monkeypatch, tmp_path):
    monkeypatch.delenv("WEBOTS_HOME")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/webots").symlink_to(home / "webots")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    assert Webots.version() == "R2025a"


# --- at work --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["model", "surfaces", "ball joint"])
def test_its_nodes_and_states_are_read(begun, name):
    world = WORLDS[name]
    session = begun(world)
    back = session.read_back()
    states = session.lend()._simulation.states
    for entry, other in zip(back.bodies, states.model.bodies, strict=True):
        assert (entry.name, entry.inertial, entry.shapes) == (other.name, other.inertial, other.shapes)
    assert (back.laws, back.timestep) == (states.model.laws, states.model.timestep)
    q, v = elsewhere(states)
    for wanted in (states.initial(), (q, v)):
        session.set_state(*wanted)
        found = session.get_state()
        np.testing.assert_allclose(found[0], wanted[0], atol=1e-12)
        np.testing.assert_allclose(found[1], wanted[1], atol=1e-12)
    bodies = tuple(states._placed(row, q, v) for row in range(len(back.bodies)))
    placed = poses(dataclasses.replace(states.world, bodies=bodies))
    found = session.body_states()[0]
    np.testing.assert_allclose(found[:, :3], [placed[body.name].position for body in back.bodies], atol=1e-12)


@pytest.mark.parametrize("name", ["model", "ball joint", "dry friction", "lifted"])
def test_it_moves_as_ode_does_by_native_steps(begun, name, tmp_path):
    """Efforts, damping and springs reach Webots' bodies as forces and torques: the stand-in, which knows nothing of joints'
    coordinates, moves as simspec's engine that has ODE itself."""
    world, steps = WORLDS[name], 40
    session = begun(world)
    effort = 0.3 * np.random.default_rng(2).standard_normal(session.lend()._simulation.states.layout.nv)
    session.disable_contact()
    session.step(steps, effort)
    options = EngineOptions("ode", (("native_motion", True),), tuple(feature.value for feature in Feature))
    local = dataclasses.replace(
        world, engines=(*(engine for engine in world.engines if engine.engine != "ode"), options)
    )
    write_folder(compile_world(local, ["ode"])["ode"].files, tmp_path / "ode")
    with Session(Ode, tmp_path / "ode") as twin:
        start = twin.get_state()
        twin.disable_contact()
        twin.step(steps, effort)
        for entry, other, first in zip(session.get_state(), twin.get_state(), start, strict=True):
            assert np.abs(other - first).max() > 1e-3
            np.testing.assert_allclose(entry, other, atol=1e-7)


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        ("dies", "Webots ended with code 3: ERROR: cannot find a screen"),
        ("garbage", "Webots ended with code 0: tcp://nowhere"),
        ("hangs", "Webots was not ready within 2 s: WARNING: could not listen"),
        ("stepped", "Webots had stepped to 0.001 s when its controller came"),
    ],
)
def test_a_failed_start_is_an_error_with_the_reason(begun, monkeypatch, fault, why):
    monkeypatch.setenv("STAND_IN", fault)
    monkeypatch.setattr(live, "READY", 2.0)
    with pytest.raises(EngineError, match=why):
        begun(WORLDS["lifted"])  # its weights follow from the nodes of Webots


@pytest.mark.parametrize(
    ("fault", "why"),
    [("ends", "Webots ended in a step"), ("dies in a step", "its controller ended: Error: Webots has gone")],
)
def test_an_end_of_the_program_is_an_error_that_says_so(begun, monkeypatch, fault, why):
    monkeypatch.setenv("STAND_IN", fault)
    session = begun(WORLDS["lifted"])
    with pytest.raises(EngineError, match=why):
        session.step(30)


def test_its_messages_are_reported(begun, monkeypatch):
    monkeypatch.setenv("STAND_IN", "newer")
    session = begun(WORLDS["lifted"])
    session.read_back()
    unexpected, warning = session.log()
    assert unexpected == "Webots has Solid.colour, which is not compared"
    assert "could not listen on port" in warning


def test_nothing_of_it_is_left(begun):
    session = begun(WORLDS["lifted"])
    session.get_state()
    programs = session.lend()._simulation.live()._programs
    session.close()
    assert len(programs) == 2
    assert all(program.returncode is not None for program in programs)


# --- through simspec ----------------------------------------------------------------------------------------------------


def test_a_proof_queries_it(home):
    certificate = verify(WORLDS["lifted"], ["webots"])
    proof = certificate.engines["webots"]
    assert (proof.version, proof.files_alone) == ("R2025a", False)
    assert {check.level for check in proof.checks} >= {"L0", "L1", "L2", "L6"}
    # ODE's own steps turn bodies to first order: a proof says so, whatever the spec accepts
    assert {check.level for check in proof.checks if not check.passed} == {"L6"}
    assert set(proof.unchecked) >= {"L3"}


def test_the_read_back_is_that_of_webots(begun, monkeypatch):
    """And not the file's."""
    monkeypatch.setenv("STAND_IN", "mass")
    session = begun(WORLDS["lifted"])
    back = session.read_back()
    for body, other in zip(back.bodies, session.lend()._simulation.states.model.bodies, strict=True):
        assert body.inertial.mass == pytest.approx(1.001 * other.inertial.mass, rel=1e-12)


def test_a_run_is_a_run(home, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.yaml").write_text(FALL, encoding="utf-8")
    assert cli.main(["run", "fall.yaml", "--engine", "webots", "--no-repeats", "--no-verify", "-v"]) == EXIT_OK
    said = capsys.readouterr().out
    assert "webots R2025a" in said
    assert "ball moved 0.04954 m" in said
    assert cli.main(["engines", "doctor", "webots"]) == EXIT_OK


FALL = """
simspec: 1
name: fall
physics: {duration: 0.1 s, timestep: 1 ms}
bodies:
  ball:
    pose: {xyz: [0, 0, 1]}
    mass: 1 kg
    inertia: {principal: [0.1, 0.1, 0.1]}
expect:
  - displacement: {body: ball, distance: 0.04954, tolerance: 0.1 mm}
engines: {webots: {accept: [joint.free]}}
"""
