"""Contact laws of the world: a number for every pair of materials, and who does not touch whom."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from simspec.errors import Problem
from simspec.language.contact import HARDNESS_FORMS, Combine, Pair
from simspec.language.contact import Contact as SpecContact
from simspec.language.sources import Source
from simspec.language.strict import near
from simspec.language.vocabulary import COMBINED_QUANTITIES, LAW_QUANTITIES
from simspec.resolve.bodies import DEFAULT_MATERIAL, Expansion
from simspec.world.frames import sorted_pair
from simspec.world.kinematics import joined, rigid_groups
from simspec.world.types import Contact, Hardness, Material, PairContact, World

Names = tuple[str, str]
LEAST_STEPS = 2
"""Timesteps in the time constant of compliant contact: faster ones are not a motion any more, in any engine."""

RULES: Mapping[str, Callable[[float, float], float]] = {
    "min": min,
    "max": max,
    "product": lambda a, b: a * b,
    "mean": lambda a, b: 0.5 * (a + b),
    "geometric-mean": lambda a, b: math.sqrt(a * b),
}


def contact(source: Source, expansion: Expansion, timestep: float) -> tuple[Contact, list[Problem]]:
    """The contact laws, and their problems: excluded pairs that name no body, contact too stiff for the ``timestep`` (s)."""
    files = [member.file for member in source.all() if member.file is not None]
    written = source.content.contact
    named = {name: material for file in files for name, material in file.contact.materials.items()}
    materials = {
        name: Material(name, **{quantity: getattr(material, quantity) for quantity in COMBINED_QUANTITIES})
        for name, material in named.items()
    }
    thresholds = {name: material.restitution_threshold for name, material in named.items()}
    if any(shape.material == DEFAULT_MATERIAL for body in expansion.bodies for shape in body.shapes):
        materials.setdefault(DEFAULT_MATERIAL, Material(DEFAULT_MATERIAL))
    ignored = {
        (min(name, other), max(name, other))
        for file in files
        for name, group in file.contact.groups.items()
        for other in group.ignores
    }
    excluded, problems = _excluded(source, expansion)
    pairs = _pairs(materials, thresholds, written, _said(source))
    problems += _too_stiff(source, expansion, pairs, timestep)
    ordered = tuple(materials[name] for name in sorted(materials))
    return Contact(written.friction_cone, ordered, pairs, tuple(sorted(ignored)), excluded), problems


_Said = Mapping[tuple[str, ...], tuple[Pair, Source, int]]


def _said(source: Source) -> _Said:
    """The laws of pairs in the files, by their sorted names, each with its file and its number there; a scenario replaces
    what models say."""
    members = [member for member in source.all() if member is not source]
    return {
        tuple(sorted(pair.between)): (pair, member, index)
        for member in (*members, source)
        if member.file is not None
        for index, pair in enumerate(member.file.contact.pairs)
    }


def _pairs(
    materials: Mapping[str, Material], thresholds: Mapping[str, float], written: SpecContact, said: _Said
) -> tuple[PairContact, ...]:
    combine = written.combine or Combine()
    names = sorted(materials)

    def number_of(name: str, quantity: str) -> float:
        number: float = (
            thresholds.get(name, 0.0) if quantity == "restitution_threshold" else getattr(materials[name], quantity)
        )
        return number

    laws = []
    for index, first in enumerate(names):
        for second in names[index:]:
            pair = said[first, second][0] if (first, second) in said else None
            if pair is not None and not pair.collide:
                laws.append(PairContact(first, second, 0.0, 0.0, collide=False))
                continue
            values: dict[str, Any] = {}
            for quantity in LAW_QUANTITIES:
                a, b = number_of(first, quantity), number_of(second, quantity)
                value = getattr(pair, quantity) if pair is not None else None
                if value is None:
                    value = a if first == second else RULES[getattr(combine, quantity)](a, b)
                values[quantity] = value
            stated = pair.hardness if pair is not None and pair.hardness is not None else written.hardness
            margin = None if pair is None else pair.margin
            laws.append(PairContact(first, second, **values, hardness=hardness(*stated), margin=margin))
    return tuple(laws)


def hardness(kind: str, numbers: tuple[float, ...]) -> Hardness:
    """The world's hardness of what the spec states (see ``language/contact.py``)."""
    return Hardness(kind, **dict(zip(HARDNESS_FORMS.get(kind, ()), numbers, strict=True)))


def _too_stiff(source: Source, expansion: Expansion, pairs: tuple[PairContact, ...], timestep: float) -> list[Problem]:
    """Compliance that the timestep cannot resolve, at the pair or the default that states it."""
    stated = {both: (member, index) for both, (pair, member, index) in _said(source).items() if pair.hardness}
    lightest = _lightest(expansion)
    problems: dict[tuple[object, ...], Problem] = {}
    for pair in pairs:
        if pair.hardness.kind == "time-constant":
            time, of = pair.hardness.time_constant, "time constant"
        elif pair.hardness.kind == "stiffness":
            masses = [lightest[name] for name in (pair.first, pair.second) if name in lightest]
            if not masses:
                continue  # nothing that moves has one of these materials
            mass, body = min(masses)
            time, of = math.sqrt(mass / pair.hardness.stiffness), f"√(m/k) of {body!r} ({mass:g} kg)"
        else:
            continue
        if time >= LEAST_STEPS * timestep:
            continue
        member, index = stated.get((pair.first, pair.second), (source, None))
        path = ("contact", "hardness") if index is None else ("contact", "pairs", index, "hardness")
        if (id(member), path) not in problems:
            problems[id(member), path] = member.document.problem(
                path,
                f"the timestep is too large for the stiffness of the contact of {pair.first} and {pair.second}: its {of} is "
                f"below {LEAST_STEPS} steps",
                found=f"{time:.4g} s, with a timestep of {timestep:g} s",
                allowed=f"at least {LEAST_STEPS * timestep:g} s",
                hint="use a softer contact, a smaller physics.timestep, or hardness: common (rigid)",
                code="S603",
            )
    return list(problems.values())


def _lightest(expansion: Expansion) -> dict[str, tuple[float, str]]:
    """Of each material the least mass (kg) of a body with such a shape that can move, and that body.

    A body counts with all that is joined to it rigidly.
    """
    top: dict[str, str | None] = {}
    masses: dict[str | None, float] = {}
    for body in expansion.bodies:  # parents come before their children
        fixed, parent = body.joint.kind == "fixed", body.joint.parent
        top[body.name] = body.name if not fixed else None if parent is None else top[parent]
        masses[top[body.name]] = masses.get(top[body.name], 0.0) + body.inertial.mass
    lightest: dict[str, tuple[float, str]] = {}
    for body in expansion.bodies:
        group = top[body.name]
        if group is None or not masses[group]:
            continue
        for shape in body.shapes:
            if shape.collision:
                candidate = (masses[group], body.name)
                lightest[shape.material] = min(lightest.get(shape.material, candidate), candidate)
    return lightest


def _excluded(source: Source, expansion: Expansion) -> tuple[tuple[tuple[str, str], ...], list[Problem]]:
    """The pairs of bodies that do not touch: those that are excluded, and those that are joined but for the ones that touch."""
    written = source.content.contact
    bodies = {body.name for body in expansion.bodies}
    problems = []
    for word, stated in (("exclude", written.exclude), ("touch", written.touch)):
        for index, pair in enumerate(stated):
            for position, name in enumerate(pair):
                if name not in bodies:
                    path = ("contact", word, index, position)
                    hint = near(name, bodies)
                    problems.append(
                        source.document.problem(path, f"there is no body {name!r}", found=name, hint=hint, code="S302")
                    )
    excluded = {sorted_pair(*pair) for pair in (*written.exclude, *expansion.excluded)}
    together = {sorted_pair(*pair) for pair in expansion.joined_pairs} | joined(expansion.bodies)
    if not problems and not expansion.problems:
        problems += _untouchable(source, expansion, excluded, together)
    touching = {sorted_pair(*pair) for pair in (*written.touch, *expansion.touching)}
    return tuple(sorted(excluded | (together - touching))), problems


def _untouchable(source: Source, expansion: Expansion, excluded: set[Names], together: set[Names]) -> list[Problem]:
    """Pairs of ``touch`` that cannot touch, or would without it."""
    problems = []
    groups = rigid_groups(World("", expansion.bodies))
    for index, (first, second) in enumerate(source.content.contact.touch):
        pair, path = sorted_pair(first, second), ("contact", "touch", index)
        if pair in excluded:
            message, hint = f"{first} and {second} are excluded from contact", "remove one of the two"
        elif groups[first] == groups[second]:
            message, hint = f"{first} and {second} are joined rigidly, and never touch", "remove the pair"
        elif pair not in together:
            message, hint = f"no joint or loop joins {first} and {second}", "remove the pair: they touch anyway"
        else:
            continue
        problems.append(source.document.problem(path, message, found=f"[{first}, {second}]", hint=hint, code="S604"))
    return problems
