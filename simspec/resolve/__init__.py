"""Spec to world: arrays and models expanded, masses computed, pairs of materials combined, every default filled."""

from __future__ import annotations

import dataclasses

from simspec.errors import Problem, SpecError
from simspec.language.problems import in_order
from simspec.language.sources import Source
from simspec.language.strict import bounded_suggestions
from simspec.resolve.actuators import commanded
from simspec.resolve.bodies import expand, named_frames
from simspec.resolve.constraints import constraints
from simspec.resolve.contact import contact
from simspec.resolve.control import controllers, unstable
from simspec.resolve.scenario import (
    engines,
    expectations,
    fixed_for_ever,
    forces,
    motions,
    physics,
    record,
    shortened,
    too_much,
    unknown_shown,
)
from simspec.resolve.stability import (
    beginning_within,
    dependent_joints,
    unlike_weights,
    unstable_joints,
    without_inertia,
)
from simspec.resolve.trajectory import trajectory
from simspec.world.damping import with_implicit_damping
from simspec.world.inertia import boxed
from simspec.world.types import World

__all__ = ["resolve"]


def resolve(spec: Source) -> World:
    """The world of a spec. Raises SpecError with every problem that shows only when things are expanded: names that are
    taken twice, references to bodies and joints that do not exist, times that are not recorded; and, where all else is
    right, joints and controllers that are unstable at the timestep."""
    whole = physics(spec.content.physics)
    expansion = expand(spec, boxes=whole.fluid is not None)
    time = shortened(whole, None if spec.content.trajectory is None else spec.content.trajectory.until)
    recorded = record(spec.content.record, time)
    with bounded_suggestions():
        named, misnamed = named_frames(spec, expansion.bodies, expansion.arrays)
        actual = constraints(spec, expansion, named)
        expansion.bodies = actual.bodies
        expansion.joined_pairs += actual.joined
        beyond: list[Problem] = []
        if not expansion.problems and not actual.problems:
            expansion.bodies, beyond = beginning_within(spec, expansion.bodies)
        moved = motions(spec, expansion.bodies, () if expansion.problems else expansion.kinematic)
        expansion.bodies = moved.bodies
        expansion.excluded += moved.separated
        laws, problems = contact(spec, expansion, time.timestep)
        driven = controllers(spec, expansion.bodies, actual.followers)
        applied, pushed = (
            ((), []) if expansion.problems else forces(spec, expansion.bodies, whole, expansion.kinematic, named)
        )
        expected, more = expectations(spec, expansion.bodies, whole, time, recorded)
    shown = unknown_shown(spec, expansion.bodies) if not expansion.problems else []
    weightless = [] if expansion.problems else without_inertia(spec, expansion.bodies)
    weightless += [] if expansion.problems or weightless else dependent_joints(spec, expansion.bodies)
    weightless += [] if expansion.problems else unlike_weights(spec, expansion.bodies, expansion.kinematic)
    problems = [
        *expansion.problems,
        *misnamed,
        *actual.problems,
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
        name=spec.content.name,
        bodies=bodies,
        contact=laws,
        physics=time,
        record=recorded,
        expectations=expected,
        engines=engines(spec.content.engines, time.timestep),
        controllers=driven.controllers,
        constraints=actual.constraints,
        forces=applied,
        motions=moved.motions,
        sums=actual.sums,
        frames=named,
    )
    world = with_implicit_damping(world)
    path, problems = trajectory(spec, world, driven.velocity_limits)
    path, more = commanded(spec, path, driven.aims, world.bodies)
    problems = [*problems, *more]
    if problems:
        raise SpecError(in_order(problems))
    world = dataclasses.replace(world, trajectory=path)
    problems = unstable_joints(spec, world) or unstable(spec, world)
    if problems := [*problems, *too_much(spec, world), *fixed_for_ever(spec, world)]:
        raise SpecError(in_order(problems))
    return world
