"""Run a contact probe in an engine, for tests: the law it measures, and the law the world was compiled with."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.registry import engines, find_engine
from simspec.proof.contact.probe import GRAVITY, ProbeLaw, TrialMotion
from simspec.proof.contact.worlds import world_of_trial
from simspec.support.features import Feature
from simspec.world.kinematics import layout_of
from simspec.world.types import Contact, EngineOptions, Material, PairContact, Physics

ACCEPT = tuple(sorted(feature.value for feature in Feature))


def law(timestep=0.001, friction=0.5, restitution=0.0, **pair):
    """A law of two materials."""
    return ProbeLaw(PairContact("base", "body", friction, restitution, **pair), "elliptic", timestep)


def world_of(law, trial, settings=None):
    pair = law.pair
    materials = tuple(
        Material(name, pair.friction, pair.restitution, pair.torsional_friction, pair.rolling_friction)
        for name in sorted({pair.first, pair.second})
    )
    pairs = tuple(
        dataclasses.replace(pair, first=material.name, second=other.name)
        for material, other in itertools.combinations_with_replacement(materials, 2)
    )
    physics = Physics((0.0, 0.0, -GRAVITY), law.timestep)
    world = world_of_trial(trial, Contact(law.friction_cone, materials, pairs), physics, EngineOptions("none"))
    return dataclasses.replace(
        world,
        engines=tuple(EngineOptions(name, tuple((settings or {}).get(name, {}).items()), ACCEPT) for name in engines()),
    )


def motions(engine, cases, folder, settings=None):
    """Of each (probe, law, law that the worlds are compiled with): the motions of the probe's trials. One process does all of
    them, each in files of its own, with the engine's ``settings``."""
    given = {engine: settings or {}}
    trials = [
        [(world_of(compiled, trial, given), trial) for trial in probe.trials(law)] for probe, law, compiled in cases
    ]
    operations = []
    for index, (world, trial) in enumerate(itertools.chain.from_iterable(trials)):
        place = folder / f"{engine}-{index}"
        write_folder(compile_world(world, [engine])[engine].files, place)
        operations.append(drive(world, trial.phases, place))
    answers = iter(call(engine, place, operations).answers)
    return [[motion(world, next(answers).arrays) for world, _ in pairs] for pairs in trials]


def drive(world, phases, artifacts):
    """A driver of a world through ``phases``."""
    velocity = layout_of(world)
    effort = np.zeros((len(phases), velocity.nv))
    names = [body.name for body in world.bodies]
    for row, phase in zip(effort, phases, strict=True):
        for name, given in phase.effort.items():
            row[velocity.velocity[names.index(name)]] = given
    steps = [(phase.steps, phase.every) for phase in phases]
    parameters = {"timestep": world.physics.timestep, "phases": steps, "artifacts": str(artifacts)}
    return Operation("drive", parameters, {"effort": effort})


def motion(world, arrays):
    """The motion, by names of bodies."""
    names = [body.name for body in world.bodies]
    return TrialMotion(
        arrays["time"],
        {name: arrays["pose"][:, index] for index, name in enumerate(names)},
        {name: arrays["velocity"][:, index] for index, name in enumerate(names)},
    )


def figures(engine, probe, law, folder, compiled=None, settings=None):
    """The figures of a probe for ``law``, in worlds that are compiled with ``compiled`` (default: the law itself)."""
    return figures_of_each(engine, [(probe, law, compiled or law)], folder, settings)[0]


def figures_of_each(engine, cases, folder, settings=None):
    """The figures of each (probe, law, law that the worlds are compiled with), all measured in one process."""
    assert all(probe.applies(law) for probe, law, _ in cases)
    moved = motions(engine, cases, folder, settings)
    return [probe.figures(law, found) for (probe, law, _), found in zip(cases, moved, strict=True)]


def installed(name):
    return find_engine(name).version() is not None
