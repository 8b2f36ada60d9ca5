"""The contact law as a scenario's *files* hold it, so that probes measure what was written, not what was meant.

Read with the independent reader of proof level L0. Where shapes of one material disagree, the one furthest from the plan
counts: a slip in one shape must not hide behind the others.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from simspec.engines.base import Engine
from simspec.features import Feature
from simspec.formats.base import formats, read_sidecar
from simspec.formats.contact_plan import QUANTITIES, ContactPlan, contact_plan
from simspec.formats.passes import solid_shapes
from simspec.world.types import Contact, EngineOptions, PairContact, ReadBack, Surface, World

EVERYTHING = tuple(sorted(feature.value for feature in Feature))
"""What probe worlds accept: the scenario was compiled, and a probe only measures what it got."""


@dataclass(frozen=True)
class Held:
    """What the files of one engine say: contact laws, the numbers of materials, solver settings."""

    contact: Contact
    plan: ContactPlan
    options: EngineOptions


def held(world: World, engine: type[Engine], folder: Path) -> Held:
    """Read the contact law from the artifacts in ``folder``. Raises what readers raise at damaged files."""
    read = formats()[engine.FORMAT].read(folder)
    settings = read_sidecar(folder)["settings"]
    plan = contact_plan(world, engine.RULES, engine.LAYERS)
    cone = world.contact.friction_cone if "friction_cone" in read.unreadable else read.friction_cone
    contact = dataclasses.replace(world.contact, friction_cone=cone, pairs=_pairs(world, read))
    numbers = _numbers(world, read, plan)
    options = EngineOptions(engine.NAME, tuple(sorted(settings.items())), EVERYTHING)
    return Held(contact, dataclasses.replace(plan, numbers=numbers), options)


def of_pair(whole: Held, first: str, second: str) -> Held:
    """The part of a law that concerns two materials: what else a scenario has cannot matter to probes of these."""
    names = {first, second}
    contact = Contact(
        whole.contact.friction_cone,
        tuple(material for material in whole.contact.materials if material.name in names),
        tuple(pair for pair in whole.contact.pairs if {pair.first, pair.second} <= names),
    )
    plan = ContactPlan(
        {key: surface for key, surface in whole.plan.numbers.items() if key[0] in names},
        {pair: layer for pair, layer in whole.plan.layer_of.items() if set(pair) <= names},
        tuple(pair for pair in whole.plan.missed if set(pair) <= names),
    )
    return Held(contact, plan, whole.options)


def _numbers(world: World, read: ReadBack, plan: ContactPlan) -> dict[tuple[str, int], Surface]:
    found = dict(plan.numbers)
    bodies = {body.name: body for body in read.bodies}
    for body in world.bodies:
        if body.name not in bodies:
            continue  # a missing body is L0's and L1's to find
        for shape, other in zip(solid_shapes(body), solid_shapes(bodies[body.name]), strict=False):
            for layer, surface in zip(plan.layers(shape.material), other.surfaces, strict=False):
                key = (shape.material, layer)
                whole = _filled(surface, plan.numbers[key])
                if _distance(whole, plan.numbers[key]) > _distance(found[key], plan.numbers[key]):
                    found[key] = whole
    return found


def _filled(surface: Surface, wanted: Surface) -> Surface:
    """The surface, with what cannot be told taken from the plan."""
    names = (*QUANTITIES, "hardness")
    told = {name: value for name in names if (value := getattr(surface, name)) is not None}
    return dataclasses.replace(wanted, **told)


def _distance(one: Surface, other: Surface) -> float:
    numbers = sum(abs((getattr(one, name) or 0.0) - (getattr(other, name) or 0.0)) for name in QUANTITIES)
    return numbers + (0.0 if one.hardness == other.hardness else 1.0)


def _pairs(world: World, read: ReadBack) -> tuple[PairContact, ...]:
    """The world's laws, with those of explicit pairs as they are held."""
    material = {shape.name: shape.material for body in world.bodies for shape in body.shapes}
    laws = {(pair.first, pair.second): pair for pair in world.contact.pairs}
    found = dict(laws)
    for pair in read.pairs:
        names = tuple(sorted(material.get(name, "") for name in (pair.first, pair.second)))
        if names not in laws:
            continue  # a stray pair is the comparator's to find
        law = laws[names]
        known: Mapping[str, object] = {
            name: value for name in (*QUANTITIES, "hardness") if (value := getattr(pair.surface, name)) is not None
        }
        told = dataclasses.replace(law, **known)
        if _apart(told, law) > _apart(found[names], law):
            found[names] = told
    return tuple(found.values())


def _apart(one: PairContact, other: PairContact) -> float:
    numbers: Iterable[float] = (abs(getattr(one, name) - getattr(other, name)) for name in QUANTITIES)
    return sum(numbers) + (0.0 if one.hardness == other.hardness else 1.0)
