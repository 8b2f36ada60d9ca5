"""Contact laws of the world: a number for every pair of materials, and who does not touch whom."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from simspec.errors import Problem
from simspec.resolve.bodies import DEFAULT_MATERIAL, Expansion
from simspec.spec.contact import HARDNESS_FORMS, QUANTITIES, Combine
from simspec.spec.contact import Contact as SpecContact
from simspec.spec.sources import Source
from simspec.spec.strict import near
from simspec.world.types import Contact, Hardness, Material, PairContact

RULES: Mapping[str, Callable[[float, float], float]] = {
    "min": min,
    "max": max,
    "product": lambda a, b: a * b,
    "mean": lambda a, b: 0.5 * (a + b),
    "geometric-mean": lambda a, b: math.sqrt(a * b),
}


def contact(source: Source, expansion: Expansion) -> tuple[Contact, list[Problem]]:
    """The contact laws, and the problems of excluded pairs that name no body."""
    files = [one.file for one in source.all() if one.file is not None]
    given = source.file.contact
    materials = {
        name: Material(
            name, material.friction, material.restitution, material.torsional_friction, material.rolling_friction
        )
        for file in files
        for name, material in file.contact.materials.items()
    }
    thresholds = {
        name: material.restitution_threshold for file in files for name, material in file.contact.materials.items()
    }
    if any(shape.material == DEFAULT_MATERIAL for body in expansion.bodies for shape in body.shapes):
        materials.setdefault(DEFAULT_MATERIAL, Material(DEFAULT_MATERIAL))
    ignored = {
        (min(name, other), max(name, other))
        for file in files
        for name, group in file.contact.groups.items()
        for other in group.ignores
    }
    excluded, problems = _excluded(source, expansion)
    return (
        Contact(
            friction_cone=given.friction_cone,
            materials=tuple(materials[name] for name in sorted(materials)),
            pairs=_pairs(materials, thresholds, given),
            ignored_groups=tuple(sorted(ignored)),
            excluded_bodies=excluded,
        ),
        problems,
    )


def _pairs(
    materials: Mapping[str, Material], thresholds: Mapping[str, float], given: SpecContact
) -> tuple[PairContact, ...]:
    said = {tuple(sorted(pair.between)): pair for pair in given.pairs}
    combine = given.combine or Combine()
    names = sorted(materials)

    def own(name: str, quantity: str) -> float:
        return thresholds.get(name, 0.0) if quantity == "restitution_threshold" else getattr(materials[name], quantity)

    found = []
    for index, first in enumerate(names):
        for second in names[index:]:
            pair = said.get((first, second))
            if pair is not None and not pair.collide:
                found.append(PairContact(first, second, 0.0, 0.0, collide=False))
                continue
            values = {}
            for quantity in QUANTITIES:
                a, b = own(first, quantity), own(second, quantity)
                value = getattr(pair, quantity) if pair is not None else None
                if value is None:
                    value = a if first == second else RULES[getattr(combine, quantity)](a, b)
                values[quantity] = value
            stated = pair.hardness if pair is not None and pair.hardness is not None else given.hardness
            found.append(PairContact(first, second, **values, hardness=hardness(*stated)))
    return tuple(found)


def hardness(kind: str, numbers: tuple[float, ...]) -> Hardness:
    """The world's hardness of what the spec states (see ``spec/contact.py``)."""
    return Hardness(kind, **dict(zip(HARDNESS_FORMS.get(kind, ()), numbers, strict=True)))


def _excluded(source: Source, expansion: Expansion) -> tuple[tuple[tuple[str, str], ...], list[Problem]]:
    bodies = {body.name for body in expansion.bodies}
    found = {
        (min(body.name, body.joint.parent), max(body.name, body.joint.parent))
        for body in expansion.bodies
        if body.joint.parent is not None
    }
    problems = []
    for index, pair in enumerate(source.file.contact.exclude):
        for position, name in enumerate(pair):
            if name not in bodies:
                path = ("contact", "exclude", index, position)
                problems.append(
                    source.document.problem(path, f"there is no body {name!r}", found=name, hint=near(name, bodies))
                )
        found.add((min(pair), max(pair)))
    found.update((min(pair), max(pair)) for pair in expansion.excluded)
    return tuple(sorted(found)), problems
