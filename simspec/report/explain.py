"""``simspec compile --explain``: how each engine has the scenario's contact law, and why its solver is set as it is."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Mapping
from typing import Any

from rich.table import Table

from simspec.compiler import Compiled
from simspec.engines.base import find_engine, resolve_settings
from simspec.formats.base import SIDECAR
from simspec.formats.contact_plan import QUANTITIES, ContactPlan, Rules, contact_plan, meeting_laws, shape_pairs
from simspec.formats.passes import solid_shapes
from simspec.report.terminal import decisions, table
from simspec.world.types import Hardness, PairContact, Surface, World

SIGNS: Mapping[str, str] = {"max": "max", "min": "min", "product": "×", "cross": "crossed with"}
"""How a table writes a rule of combination between two numbers."""


@dataclasses.dataclass(frozen=True)
class PairExplained:
    """How one pair of materials is had: ``how`` in words; ``explicit`` pairs of shapes that only the engine's own table of
    pairs can say; ``layer`` and ``layers``: in which layer of copies they meet, of how many."""

    first: str
    second: str
    law: dict[str, Any]
    how: str
    explicit: int
    layer: int
    layers: int


@dataclasses.dataclass(frozen=True)
class Explained:
    """All that ``--explain`` says of one engine; ``copies``: shapes that are there more than once, beyond the first."""

    engine: str
    pairs: tuple[PairExplained, ...]
    copies: int
    settings: tuple[tuple[str, Any, bool, str], ...]
    """Name, value, whether the spec gave it, and the reason for the default."""


def explained(world: World, engine_name: str) -> Explained:
    """What the compiler chose for one engine, as data."""
    engine = find_engine(engine_name)
    plan = contact_plan(world, engine.RULES, engine.LAYERS)
    layers = 1 + max(plan.layer_of.values(), default=0)
    pairs = []
    for pair, law in meeting_laws(world).items():
        explicit = sum(1 for _ in shape_pairs(world, [pair])) if pair in plan.missed else 0
        layer = plan.layer_of.get(pair, 0)
        how = _how(law, engine.RULES, plan, explicit, layer, layers)
        pairs.append(PairExplained(*pair, _law(law), how, explicit, layer, layers))
    copies = sum(len(plan.layers(shape.material)) - 1 for body in world.bodies for shape in solid_shapes(body))
    given = dict(world.options(engine_name).settings)
    settings = tuple(
        (name, value, name in given, engine.SETTINGS[name].meaning)
        for name, value in resolve_settings(engine, world).items()
    )
    return Explained(engine_name, tuple(pairs), copies, settings)


def _law(law: PairContact) -> dict[str, Any]:
    """What the pair has, without zeros."""
    found: dict[str, Any] = {name: getattr(law, name) for name in QUANTITIES if getattr(law, name)}
    found = found or {"friction": 0.0}
    if law.restitution_threshold:
        found["restitution_threshold"] = law.restitution_threshold
    if law.hardness != Hardness():
        found["hardness"] = law.hardness.kind
    return found


def _how(law: PairContact, rules: Rules, plan: ContactPlan, explicit: int, layer: int, layers: int) -> str:
    pair = (law.first, law.second)
    if explicit:
        return f"as {explicit} explicit pairs of shapes: no number for each material gives it"
    first, second = (plan.numbers[name, layer] for name in pair)
    told = [_numbers(name, rules, first, second) for name in QUANTITIES if getattr(law, name)] or ["no number needed"]
    where = f"; in layer {layer + 1} of {layers}" if layers > 1 else ""
    return ", ".join(told) + where


def _numbers(quantity: str, rules: Rules, first: Surface, second: Surface) -> str:
    rule = SIGNS.get(getattr(rules, quantity), getattr(rules, quantity))
    one, other = getattr(first, quantity), getattr(second, quantity)
    numbers = f"{one:.4g} {rule} {other:.4g}" if rule in ("×", SIGNS["cross"]) else f"{rule}({one:.4g}, {other:.4g})"
    return f"{quantity.replace('_', ' ')} {numbers}"


def tables(world: World, compiled: Compiled) -> list[Table]:
    """Three tables of one engine: contact, features, solver settings."""
    one = explained(world, compiled.engine)
    contact = table(f"Contact in {one.engine}", "materials", "law", "how it has it")
    for pair in one.pairs:
        law = ", ".join(
            f"{name.replace('_', ' ')} {value:.4g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in pair.law.items()
        )
        contact.add_row(f"{pair.first}, {pair.second}", law, pair.how)
    if one.copies:
        contact.caption = f"{one.copies} copies of shapes in layers; two copies touch only in the layer of their pair"
    settings = table(f"Solver of {one.engine}", "setting", "value", "", "why")
    in_force = json.loads(compiled.files[SIDECAR])["settings"]
    for name, value, given, why in one.settings:
        resolved = in_force.get(name, value)
        shown = str(value) if resolved == value else f"{value}: {resolved}"
        settings.add_row(name, shown, "given" if given else "", why)
    return [*([contact] if one.pairs else []), decisions(compiled), settings]


def costs(world: World, engine_name: str) -> Mapping[str, int]:
    """How many pairs of materials are had in each way, for tests and summaries."""
    one = explained(world, engine_name)
    return Counter("explicit" if pair.explicit else "layered" if pair.layers > 1 else "numbers" for pair in one.pairs)
