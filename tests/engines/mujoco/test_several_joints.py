"""Several joints of one MuJoCo body: light ones to round-off, and what does not fit together."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from simspec.dialects.kit.sidecar import SIDECAR, sidecar_text
from simspec.dialects.mujoco.dialect import MujocoDialect
from simspec.dynamics.oracle import Oracle, random_states
from simspec.engines.mujoco.engine import MuJoCo
from simspec.errors import EngineError, UnsupportedError
from simspec.formats.mjcf.format import MODEL, Mjcf
from simspec.language.load import load
from simspec.world.kinematics import absorbed
from simspec.world.types import Inertial
from tests import worlds
from tests.dialects.mujoco.saying import as_stored, differences, emit
from tests.files import write
from tests.imports.mjcf.models import lost, read

mujoco = pytest.importorskip("mujoco")
LIGHT = 1e-7


def light(world):
    """The world with all inertias a ten-millionth of what they are."""

    def lighter(inertial):
        moments = tuple(LIGHT * value for value in inertial.inertia)
        return Inertial(LIGHT * inertial.mass, inertial.centre_of_mass, moments)

    bodies = tuple(dataclasses.replace(body, inertial=lighter(body.inertial)) for body in world.bodies)
    return dataclasses.replace(world, bodies=bodies)


def test_the_mass_matrix_of_a_light_body_is_exact(load_files):
    """A link between the joints would have at least 1e-15 kg m², of the 1e-10 here."""
    world = light(worlds.several_joints())
    engine, oracle = load_files(MuJoCo, emit(world)), Oracle(world)
    assert engine.model.nbody == 1 + len(world.bodies) - len(absorbed(world))
    for q, v in zip(*random_states(world, 3), strict=True):
        engine.set_state(q, v)
        (mass,) = engine.mass_blocks([np.arange(len(v))])
        wanted = oracle.mass_matrix(q)
        scale = np.sqrt(np.diag(wanted))
        assert np.abs((mass - wanted) / np.outer(scale, scale)).max() < 1e-12


def swapped(text):
    """Two joints of one body in the other order."""
    lines = text.splitlines(keepends=True)
    at = next(index for index, line in enumerate(lines) if "link1_joint" in line and "<joint" in line)
    lines[at], lines[at + 1] = lines[at + 1], lines[at]
    return "".join(lines)


@pytest.mark.parametrize(
    "change",
    [
        swapped,
        lambda text: text.replace('name="link1_joint" type="hinge" pos="', 'name="link1_joint" type="hinge" pos="1', 1),
        lambda text: text.replace('name="link4_joint" type="hinge"', 'name="link4_joint" type="slide"', 1),
    ],
    ids=["order", "place", "type"],
)
def test_another_joint_is_seen_in_the_text_and_in_the_model(change, load_files, tmp_path):
    world = worlds.several_joints()
    files = emit(world)
    changed = {**files, MODEL: change(files[MODEL])}
    assert changed != files
    actual = load_files(MuJoCo, changed).read_back().bodies
    in_text = MujocoDialect().read(write(changed, tmp_path / "text")).bodies
    for bodies in (actual, in_text):
        assert differences(as_stored(world), bodies)


DAMAGE = {
    "a name that is none": (lambda turns: turns.update(ghost=[1, 0, 0, 0]), "carriers.ghost"),
    "a body that moves itself": (lambda turns: turns.update(link3=[1, 0, 0, 0]), "carriers.link3"),
    "no rotation": (lambda turns: turns.update({"link3.link1_joint": [0, 0, 0, 0]}), "unit length"),
    "a carrier too few": (lambda turns: turns.pop("link3.link1_joint"), "link3"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_sidecar_that_does_not_fit_is_refused(name, tmp_path):
    change, message = DAMAGE[name]
    files = emit(worlds.several_joints())
    content = json.loads(files[SIDECAR])
    change(content["carriers"])
    folder = write({**files, SIDECAR: sidecar_text(content)}, tmp_path / "a")
    with pytest.raises(ValueError, match=message):
        MujocoDialect().read(folder)
    with pytest.raises(EngineError, match=message):
        MuJoCo().load(folder, content)


def test_a_carrier_of_two_bodies_is_refused_by_name():
    """Only a world that is made in Python has one: its mass would have to be made up."""
    world = worlds.several_joints()
    fork = dataclasses.replace(world.bodies[-1], name="fork", shapes=())
    fork = dataclasses.replace(fork, joint=dataclasses.replace(fork.joint, name="fork_joint"))
    forked = dataclasses.replace(world, bodies=(*world.bodies, fork))
    with pytest.raises(UnsupportedError, match=r"loose-link3\.loose-link0_joint\.mass: .* moving body without mass"):
        Mjcf().plain(forked)


def test_the_plain_file_is_imported_as_the_same_model(tmp_path):
    world = worlds.several_joints()
    folder = write(Mjcf().plain(world).files, tmp_path / "plain")
    found = load(folder / MODEL).resolve()
    ours, theirs = Oracle(world), Oracle(found)
    names = [body.joint.name for body in world.bodies if body.joint.kind != "fixed"]
    assert [body.joint.name for body in found.bodies if body.joint.kind != "fixed"] == names
    for q, v in zip(*random_states(world, 3), strict=True):
        assert np.allclose(ours.mass_matrix(q), theirs.mass_matrix(q), rtol=0.0, atol=1e-12)
        assert np.allclose(ours.bias_force(q, v), theirs.bias_force(q, v), rtol=0.0, atol=1e-12)
    assert not lost(read(folder / MODEL))
