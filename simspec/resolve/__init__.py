"""Spec to world: arrays and models expanded, masses computed, pairs of materials combined, every default filled."""

from __future__ import annotations

import dataclasses

from simspec.errors import Problem, SpecError
from simspec.language.load import Spec
from simspec.language.problems import in_order
from simspec.language.strict import bounded_suggestions
from simspec.resolve.actuators import commanded
from simspec.resolve.bodies import expand
from simspec.resolve.constraints import constraints
from simspec.resolve.contact import contact
from simspec.resolve.control import controllers, unstable
from simspec.resolve.forces import forces
from simspec.resolve.masses import dependent_joints, unlike_weights, without_inertia
from simspec.resolve.motions import motions
from simspec.resolve.named_frames import named_frames
from simspec.resolve.scenario import (
    engines,
    expectations,
    fixed_for_ever,
    physics,
    record,
    shortened,
    too_much,
    unknown_shown,
)
from simspec.resolve.stability import beginning_within, unstable_joints
from simspec.resolve.trajectory import trajectory
from simspec.world.boxes import boxed
from simspec.world.types import World

__all__ = ["resolve"]


def resolve(spec: Spec) -> World:
    """The world of a spec. Raises SpecError with every problem that shows only when things are expanded: names that are
    taken twice, references to bodies and joints that do not exist, times that are not recorded; and, where all else is
    right, joints and controllers that are unstable at the timestep."""
    whole = physics(spec.data.physics)
    expansion = expand(spec.source, boxes=whole.fluid is not None)
    time = shortened(whole, None if spec.data.trajectory is None else spec.data.trajectory.until)
    recorded = record(spec.data.record, time)
    with bounded_suggestions():
        named, misnamed = named_frames(spec.source, expansion.bodies, expansion.arrays)
        held = constraints(spec.source, expansion, named)
        expansion.bodies = held.bodies
        expansion.held += held.joined
        beyond: list[Problem] = []
        if not expansion.problems and not held.problems:
            expansion.bodies, beyond = beginning_within(spec.source, expansion.bodies)
        moved = motions(spec.source, expansion.bodies, () if expansion.problems else expansion.kinematic)
        expansion.bodies = moved.bodies
        expansion.excluded += moved.apart
        laws, problems = contact(spec.source, expansion, time.timestep)
        driven = controllers(spec.source, expansion.bodies, held.followers)
        applied, pushed = (
            ((), []) if expansion.problems else forces(spec.source, expansion.bodies, whole, expansion.kinematic, named)
        )
        expected, more = expectations(spec.source, expansion.bodies, whole, time, recorded)
    shown = unknown_shown(spec.source, expansion.bodies) if not expansion.problems else []
    weightless = [] if expansion.problems else without_inertia(spec.source, expansion.bodies)
    weightless += [] if expansion.problems or weightless else dependent_joints(spec.source, expansion.bodies)
    weightless += [] if expansion.problems else unlike_weights(spec.source, expansion.bodies, expansion.kinematic)
    problems = [
        *expansion.problems,
        *misnamed,
        *held.problems,
        *beyond,
        *moved.problems,
        *problems,
        *driven.problems,
        *pushed,
        *more,
        *shown,
        *weightless,
    ]
    if problems:
        raise SpecError(in_order(problems))
    bodies = driven.bodies
    if whole.fluid is not None:
        bodies = boxed(bodies, expansion.kinematic)
    world = World(
        name=spec.name,
        bodies=bodies,
        contact=laws,
        physics=time,
        record=recorded,
        expectations=expected,
        engines=engines(spec.data.engines, time.timestep),
        controllers=driven.controllers,
        constraints=held.constraints,
        forces=applied,
        motions=moved.motions,
        sums=held.sums,
        frames=named,
    )
    path, problems = trajectory(spec.source, world, driven.velocity_limits)
    path, more = commanded(spec.source, path, driven.aims, world.bodies)
    problems = [*problems, *more]
    if problems:
        raise SpecError(in_order(problems))
    world = dataclasses.replace(world, trajectory=path)
    problems = unstable_joints(spec.source, world) or unstable(spec.source, world)
    if problems := [*problems, *too_much(spec.source, world), *fixed_for_ever(spec.source, world)]:
        raise SpecError(in_order(problems))
    return world
