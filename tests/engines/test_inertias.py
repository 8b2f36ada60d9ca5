"""Very small inertias of bodies that move: refused by support, at the limits that engines were measured to have, or held."""

from __future__ import annotations

import pytest

from simspec.compiler import compile_world
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.registry import find_engine
from simspec.errors import UnsupportedError
from simspec.proof.verify import read_back_checks
from simspec.testing import worlds
from simspec.testing.bench import failures
from simspec.world.types import Body, Inertial, Joint, Pose, World

pytestmark = pytest.mark.usefixtures("warm_engines")

LIGHT = "MuJoCo"
OFFSET = "Drake stores inertias about"
FREE = (0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0)


def moving(mass: float, moment: float, offset: float = 0.0, carried: float | None = None, kind: str = "slide") -> World:
    """A body on a joint, all of whose moments are ``moment``, with the centre of mass ``offset`` from its origin, and one
    of 1 kg and the moments ``carried`` that is fixed to it."""
    joint = Joint("joint", kind, None, Pose(), (0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    if kind == "free":
        joint = Joint("joint", kind, position=FREE, velocity=(0.0,) * 6)
    bodies = [Body("body", "body", Inertial(mass, (offset, 0.0, 0.0), (moment,) * 3 + (0.0,) * 3), joint)]
    if carried is not None:
        weld = Joint("weld", "fixed", "body", Pose((0.1, 0.0, 0.0)))
        bodies.append(Body("carried", "body", Inertial(1.0, inertia=(carried,) * 3 + (0.0,) * 3), weld))
    return worlds.world(tuple(bodies), "moving")


@pytest.mark.parametrize(
    ("engine", "world", "words"),
    [
        ("mujoco", moving(1.0, 0.0), LIGHT),
        ("mujoco", moving(1.0, 1e-20), LIGHT),
        ("mujoco", moving(1.0, 0.99e-15), LIGHT),
        ("mujoco", moving(1.0, 1e-20, kind="hinge"), LIGHT),
        ("mujoco", moving(1e-16, 1e-3), LIGHT),
        ("mujoco", moving(1.0, 1e-20, carried=1e-20), LIGHT),
        ("drake", moving(1.0, 1e-20, 0.5), OFFSET),
        ("drake", moving(1.0, 2.4e-8, 0.5), OFFSET),
        ("drake", moving(100.0, 2.4e-6, 0.5, kind="hinge"), OFFSET),
    ],
)
def test_inertias_that_an_engine_rejects_or_loses_are_rejected_before(engine, world, words):
    with pytest.raises(UnsupportedError, match=words) as refused:
        compile_world(world, [engine])
    assert "body" in str(refused.value)


ACCEPTED = {
    "mujoco": [moving(1.0, 1e-15), moving(1.2e-15, 1e-3), moving(1.0, 1e-20, carried=1e-3)],
    "drake": [
        moving(1.0, 1e-20),
        moving(1.0, 0.0, 0.5),
        moving(1.0, 2.6e-8, 0.5),
        moving(100.0, 2.6e-6, 0.5, kind="hinge"),
        moving(1.0, 1e-9, 0.5, kind="free"),
    ],
    "dart": [moving(1.0, 0.0, 0.5), moving(1.0, 1e-20, 0.5)],
    "pybullet": [moving(1.0, 0.0, 0.5), moving(1.0, 1e-20, 0.5)],
}


@pytest.mark.parametrize(("engine", "world"), [(engine, world) for engine, some in ACCEPTED.items() for world in some])
def test_accepted_inertias_are_stored(engine, world, tmp_path):
    compile_world(world, [engine])[engine].artifacts.write(tmp_path / "files")
    (answer,) = call(engine, tmp_path / "files", [Operation("read_back", world=world)]).answers
    assert failures(read_back_checks(world, find_engine(engine), answer.read_back)) == []
