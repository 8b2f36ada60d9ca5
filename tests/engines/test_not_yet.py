"""Features declared as not built yet fail today: each is tried as if declared exact. A failure of a test here means that
a feature works now; its declaration must then be changed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.control.law import Control
from simspec.control.reference import reference
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engines, find_engine
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.contact.run import measure
from simspec.support.declarations import EXACT, Attempt, combine
from simspec.support.features import Feature
from simspec.testing.bench import wheel
from simspec.world.actions import JointController
from simspec.world.contact_pairs import meeting_laws
from simspec.world.types import Hardness, World
from tests import constrained, worlds
from tests.installed import INSTALLED

pytestmark = pytest.mark.usefixtures("warm_engines")

NOT_YET = [
    (name, feature, support.attempt)
    for name, engine in ((name, engines()[name]) for name in INSTALLED)
    for feature, support in combine(dialects()[engine.DIALECT].SUPPORT, engine.SUPPORT).items()
    if support.attempt is not None
]


def world_of(feature: Feature) -> World:
    """A world that needs a feature."""
    if feature is Feature.CONTROL_NATIVE:
        return dataclasses.replace(
            wheel(),
            controllers=(
                JointController("own", ("wheel_joint",), "native", kp=(40.0,), kd=(3.0,), effort_limits=(None,)),
            ),
        )
    if feature is Feature.HARDNESS_PAIRS:
        world = worlds.table({("a", "a"): 0.0, ("a", "b"): 0.0, ("b", "b"): 0.0})
        soft = Hardness("stiffness", stiffness=1e5, damping=100.0)
        first, *others = world.contact.pairs
        pairs = (dataclasses.replace(first, hardness=soft), *others)
        return dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))
    if feature is Feature.CONSTRAINT_COUPLING:
        return constrained.follower()
    if feature is Feature.CONSTRAINT_LOOP:
        return constrained.closed_loop()
    if feature is Feature.SHAPE_MESH:
        return worlds.meshes()
    return worlds.ball_with_law(**worlds.CONTACT_GAPS[feature])


def lifted(name: str, feature: Feature, monkeypatch: pytest.MonkeyPatch) -> World:
    """The world, with the feature declared exact by dialect and engine, and all else that it needs accepted."""
    engine = find_engine(name)
    for owner in (engine, type(dialects()[engine.DIALECT])):
        monkeypatch.setattr(owner, "SUPPORT", {**owner.SUPPORT, feature: EXACT})
    every = tuple(feature.value for feature in Feature)
    return worlds.with_options(world_of(feature), name, accept=every, outside=every)


def load(name: str, world: World, folder: Path) -> Engine:
    write_folder(compile_world(world, [name])[name].files, folder)
    engine = find_engine(name)()
    engine.load(folder, read_sidecar(folder))
    return engine


def probes_agree(name: str, world: World, folder: Path) -> bool:
    write_folder(compile_world(world, [name])[name].files, folder)
    with measure(world, name, folder, None, 60.0, False) as measuring:
        figures, _ = measuring.wait()
    return bool(figures) and all(figure.passed and not figure.deviation for figure in figures)


def laws_are_stored(name: str, world: World, folder: Path) -> bool:
    engine = load(name, world, folder)
    try:
        back = engine.read_back()
    finally:
        engine.close()
    shapes = [surface.hardness for body in back.bodies for shape in body.shapes for surface in shape.surfaces]
    there = {
        hardness.kind for hardness in (*shapes, *(pair.surface.hardness for pair in back.pairs)) if hardness is not None
    }
    return {law.hardness.kind for law in meeting_laws(world).values()} <= there


def native_controller_drives(name: str, world: World, folder: Path) -> bool:
    control = Control(world, reference(world))
    engine = load(name, world, folder)
    native, at = control.native, control.native_places
    try:
        engine.track(control.q_places[at], control.v_places[at], native.stiffness, native.damping, native.limit)
    finally:
        engine.close()
    return True


def constraint_is_kept(name: str, world: World, folder: Path) -> bool:
    engine = load(name, world, folder)
    try:
        engine.disable_contact()
        engine.step(200)
        q, _ = engine.get_state()
    finally:
        engine.close()
    return constrained.violation(world, q) < 1e-3


ATTEMPTS: Mapping[Attempt, Callable[[str, World, Path], bool]] = {
    Attempt.CONTACT_PROBES: probes_agree,
    Attempt.READ_BACK: laws_are_stored,
    Attempt.BUILT_IN_CONTROLLER: native_controller_drives,
    Attempt.CONSTRAINED_MOTION: constraint_is_kept,
}
"""Whether a feature works, in a world that needs it, compiled as if it were declared exact."""


def works(name: str, feature: Feature, attempt: Attempt, folder: Path, monkeypatch: pytest.MonkeyPatch) -> bool:
    world = lifted(name, feature, monkeypatch)
    try:
        return ATTEMPTS[attempt](name, world, folder / "artifacts")
    except (EngineError, UnsupportedError):
        return False


@pytest.mark.parametrize(("name", "feature", "attempt"), NOT_YET, ids=str)
def test_features_declared_not_yet_do_not_work(name, feature, attempt, tmp_path, monkeypatch):
    assert not works(name, feature, attempt, tmp_path, monkeypatch), f"{feature} works: declare it"


@pytest.mark.parametrize(
    ("name", "feature", "attempt"),
    [
        ("mujoco", Feature.HARDNESS_STIFFNESS, Attempt.CONTACT_PROBES),
        ("mujoco", Feature.HARDNESS_PAIRS, Attempt.READ_BACK),
        ("pybullet", Feature.HARDNESS_STIFFNESS, Attempt.READ_BACK),
        ("dart", Feature.CONTROL_NATIVE, Attempt.BUILT_IN_CONTROLLER),
    ],
    ids=str,
)
def test_an_attempt_finds_working_features(name, feature, attempt, tmp_path, monkeypatch):
    assert works(name, feature, attempt, tmp_path, monkeypatch)


def test_every_attempt_is_known_here_and_something_is_tried():
    assert set(ATTEMPTS) == set(Attempt)
    assert NOT_YET
