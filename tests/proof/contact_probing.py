"""Run a contact probe in an engine, for tests: the law it measures, and the law the world was compiled with."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.registry import engines, find_engine
from simspec.proof.contact.probe import GRAVITY, Law, Motion
from simspec.support.features import Feature
from simspec.world.kinematics import layout_of
from simspec.world.types import Contact, EngineOptions, Material, PairContact, Physics, World

ACCEPT = tuple(sorted(feature.value for feature in Feature))


def law(timestep=0.001, friction=0.5, restitution=0.0, **pair):
    """A law of two materials."""
    return Law(PairContact("base", "body", friction, restitution, **pair), "elliptic", timestep)


def world_of(law, trial):
    pair = law.pair
    materials = tuple(
        Material(name, pair.friction, pair.restitution, pair.torsional_friction, pair.rolling_friction)
        for name in sorted({pair.first, pair.second})
    )
    pairs = tuple(
        dataclasses.replace(pair, first=one.name, second=other.name)
        for one, other in itertools.combinations_with_replacement(materials, 2)
    )
    physics = Physics((0.0, 0.0, -GRAVITY), law.timestep, sum(phase.steps for phase in trial.phases))
    options = tuple(EngineOptions(name, (), ACCEPT) for name in engines())
    return World("probe", trial.bodies, Contact(law.friction_cone, materials, pairs), physics, engines=options)


def motions(engine, probe, law, folder, compiled=None):
    """The motions of the probe's trials for ``law``, in worlds that were compiled with the law ``compiled``."""
    found = []
    for index, trial in enumerate(probe.trials(law)):
        world = world_of(compiled or law, trial)
        place = folder / f"{engine}-{index}"
        write_folder(compile_world(world, [engine])[engine].files, place)
        found.append(drive(engine, place, world, trial.phases))
    return found


def drive(engine, place, world, phases):
    """One world driven through ``phases``."""
    velocity = layout_of(world)
    effort = np.zeros((len(phases), velocity.nv))
    names = [body.name for body in world.bodies]
    for row, phase in zip(effort, phases, strict=True):
        for name, given in phase.effort.items():
            row[velocity.velocity[names.index(name)]] = given
    steps = [(phase.steps, phase.every) for phase in phases]
    operation = Operation("drive", {"timestep": world.physics.timestep, "phases": steps}, {"effort": effort})
    arrays = call(engine, place, [operation]).answers[0].arrays
    return Motion(
        arrays["time"],
        {name: arrays["pose"][:, index] for index, name in enumerate(names)},
        {name: arrays["velocity"][:, index] for index, name in enumerate(names)},
    )


def figures(engine, probe, law, folder, compiled=None):
    assert probe.applies(law)
    return probe.figures(law, motions(engine, probe, law, folder, compiled))


def installed(name):
    return find_engine(name).version() is not None
