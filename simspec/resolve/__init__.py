"""Spec to world: arrays and models expanded, masses computed, pairs of materials combined, every default filled."""

from __future__ import annotations

from simspec.errors import SpecError
from simspec.resolve.bodies import expand
from simspec.resolve.contact import contact
from simspec.resolve.scenario import engines, expectations, physics, record
from simspec.spec.load import Spec
from simspec.spec.problems import in_order
from simspec.spec.strict import bounded_suggestions
from simspec.world.types import World

__all__ = ["resolve"]


def resolve(spec: Spec) -> World:
    """The world of a spec. Raises SpecError with every problem that shows only when things are expanded: names that are
    taken twice, references to bodies that do not exist, times that are not recorded."""
    expansion = expand(spec.source)
    time = physics(spec.data.physics)
    recorded = record(spec.data.record, time)
    with bounded_suggestions():
        laws, problems = contact(spec.source, expansion, time.timestep)
        expected, more = expectations(spec.source, expansion.bodies, time, recorded)
    problems = [*expansion.problems, *problems, *more]
    if problems:
        raise SpecError(in_order(problems))
    return World(
        name=spec.name,
        bodies=expansion.bodies,
        contact=laws,
        physics=time,
        record=recorded,
        expectations=expected,
        engines=engines(spec.data.engines),
    )
