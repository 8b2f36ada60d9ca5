"""An engine that is a program of its own, in C: it needs the folder contract, and nothing of simspec's or Python's."""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from simspec.contact import Rules
from simspec.engines.kit import process
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.request import request_schema, write_request
from simspec.errors import EngineError
from simspec.support.declarations import EXACT, never
from simspec.support.features import Feature
from simspec.world.kinematics import initial_state
from simspec.world.types import Body, Inertial, Joint
from tests import worlds

SOURCE = Path(__file__).with_name("point_mass.c")
STEPS, EVERY, PUSH = 95, 10, (1.0, -2.0, 3.0)


@pytest.fixture(scope="module")
def program(tmp_path_factory) -> Path:
    compiler = shutil.which("cc")
    assert compiler is not None, (
        "a C compiler is needed: this is the only test of engines that are programs of their own"
    )
    target = tmp_path_factory.mktemp("host") / "point-mass"
    subprocess.run([compiler, "-O1", "-Wall", "-Werror", "-o", str(target), str(SOURCE)], check=True)
    return target


@pytest.fixture
def point_mass(program, monkeypatch, tmp_path):
    """Its world, and the folder of its artifacts; the engine is known by name."""

    class PointMass(Engine):
        NAME, FORMAT, DISTRIBUTION, EXTRA = "point-mass", "none", "numpy", "none"
        RULES, LAYERS = Rules("max", "max"), False
        SUPPORT, SETTINGS = dict.fromkeys(Feature, EXACT) | {Feature.CONTROL_NATIVE: never("a toy")}, {}
        LACKS = dict.fromkeys(Capability, "a toy")

        @classmethod
        def command(cls, folder):
            return [str(program)]

    monkeypatch.setattr(process, "find_engine", lambda name: PointMass)
    at, speed = (0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0), (1.0, -2.0, 3.0, 0.0, 0.0, 0.0)
    thrown = Joint("joint", "free", position=at, velocity=speed)
    inertial = Inertial(2.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    world = worlds.world((Body("point", "point", inertial, thrown),))
    q, v = initial_state(world)
    numbers = [world.bodies[0].inertial.mass, *world.physics.gravity, world.physics.timestep, *q, *v]
    folder = tmp_path / "artifacts"
    folder.mkdir()
    (folder / "point.txt").write_text(" ".join(map(repr, map(float, numbers))))
    return world, folder


def drive(world) -> Operation:
    effort = np.array([[*PUSH, 0.0, 0.0, 0.0]])
    return Operation(
        "drive", {"timestep": world.physics.timestep, "phases": [[STEPS, EVERY]]}, {"effort": effort}, world
    )


def test_a_program_in_c_is_an_engine(point_mass):
    """Two operations; the fall against the closed form of semi-implicit Euler: x + n dt v + ½ n (n + 1) dt² a."""
    world, folder = point_mass
    states = {"q": np.array([[1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0]] * 4), "v": np.arange(24.0).reshape(4, 6)}
    reply = call("point-mass", folder, [Operation("kinematics", {}, states, world), drive(world)])
    assert reply.versions["platform"] == "C"
    echoed, driven = reply.answers
    assert np.array_equal(echoed.arrays["q"], states["q"])
    assert np.array_equal(echoed.arrays["velocity"][:, 0], states["v"])
    n = np.array([*range(0, STEPS, EVERY), STEPS])[:, None]
    dt = world.physics.timestep
    acceleration = np.array(world.physics.gravity) + np.array(PUSH) / world.bodies[0].inertial.mass
    q, v = initial_state(world)
    expected = np.array(q[:3]) + n * dt * np.array(v[:3]) + 0.5 * n * (n + 1) * dt**2 * acceleration
    assert np.allclose(driven.arrays["time"], n[:, 0] * dt, rtol=1e-14, atol=0.0)
    assert np.allclose(driven.arrays["pose"][:, 0, :3], expected, rtol=1e-12, atol=1e-12)


def test_an_unknown_operation_is_a_failure_of_the_program(point_mass):
    world, folder = point_mass
    with pytest.raises(EngineError, match=r"ended with code 3 without a result.*I do not know this operation"):
        call("point-mass", folder, [Operation("read_back", world=world)])


def test_answers_of_the_program_are_compared_with_the_world(point_mass):
    """Two bodies, where it knows of one."""
    world, folder = point_mass
    other = dataclasses.replace(world.bodies[0], name="other", model="other")
    more = dataclasses.replace(world, bodies=(*world.bodies, other))
    with pytest.raises(EngineError, match="pose"):
        call("point-mass", folder, [drive(more)])


def test_no_python_can_be_chosen_for_it(point_mass):
    _, folder = point_mass
    with pytest.raises(EngineError, match="is a separate program"):
        call("point-mass", folder, [], python="python3")


def test_a_program_that_is_not_there_is_its_failure(point_mass, monkeypatch):
    _, folder = point_mass
    kind = process.find_engine("point-mass")
    monkeypatch.setattr(kind, "command", classmethod(lambda cls, place: ["/nonexistent/engine"]))
    with pytest.raises(EngineError, match="without a result"):
        call("point-mass", folder, [])


def test_requests_have_the_published_form(point_mass, tmp_path):
    """And every path in them is relative: a folder that is moved elsewhere is the same request."""
    world, folder = point_mass
    place = tmp_path / "request"
    place.mkdir()
    write_request(place, process.find_engine("point-mass"), folder, [drive(world), drive(world)])
    text = (place / "request.json").read_text()
    jsonschema.validate(json.loads(text), request_schema())
    assert str(tmp_path) not in text
    assert [operation["artifacts"] for operation in json.loads(text)["operations"]] == ["artifacts/0", "artifacts/0"]
    assert (place / "artifacts" / "0" / "point.txt").read_text() == (folder / "point.txt").read_text()
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**json.loads(text), "schema": 2}, request_schema())
