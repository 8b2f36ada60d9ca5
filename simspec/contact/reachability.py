"""What the numbers of a plan cannot give: features that a world needs, and pairs that an engine would hold otherwise."""

from __future__ import annotations

import math

from simspec.contact.plan import ContactPlan, contact_plan
from simspec.contact.rules import Rules, combine, same
from simspec.language.vocabulary import COMBINED_QUANTITIES
from simspec.support.features import Feature
from simspec.support.needs import Need
from simspec.world.contact_pairs import Pair, meeting_laws
from simspec.world.reach import reach
from simspec.world.types import World

HEAVY_ON_LIGHT = 10.0
"""Ratio of two masses from which a world needs MASS_RATIO at rest: at 10 no engine's stacks sink or move by 0.01 mm (measured).
A body with faces that slides with another on it needs it at every ratio: engines stop it up to 16 % short at 1 (4 ms)."""
_FEATURES = {
    "friction": Feature.FRICTION_PAIRS,
    "torsional_friction": Feature.FRICTION_PAIRS,
    "rolling_friction": Feature.FRICTION_PAIRS,
    "restitution": Feature.RESTITUTION_PAIRS,
}


def unreachable(world: World, rules: Rules, plan: ContactPlan) -> dict[str, dict[Pair, float]]:
    """What the numbers of a plan do not give, and an engine without explicit pairs so cannot have: for each quantity the
    pairs, with what they would get instead (NaN for ``hardness``)."""
    wanted = meeting_laws(world)
    found: dict[str, dict[Pair, float]] = {}
    for pair in plan.missed:
        first, second = (plan.numbers[name, plan.layer_of[pair]] for name in pair)
        for name, given in combine(rules, first, second).items():
            if rules.combines(name) and not same(given, getattr(wanted[pair], name)):
                found.setdefault(name, {})[pair] = given
        if rules.hardness == "same" and any(one.hardness != wanted[pair].hardness for one in (first, second)):
            found.setdefault("hardness", {})[pair] = math.nan
    return found


def pair_needs(world: World, rules: Rules) -> list[Need]:
    """Needs of FRICTION_PAIRS and RESTITUTION_PAIRS: where one number for each material cannot give the world's pairs."""
    wanted = meeting_laws(world)
    simple = contact_plan(world, rules, False)
    found: dict[Feature, dict[str, None]] = {}
    for pair in simple.missed:
        given = combine(rules, simple.numbers[pair[0], 0], simple.numbers[pair[1], 0])
        for name in COMBINED_QUANTITIES:
            if rules.combines(name) and not same(given[name], getattr(wanted[pair], name)):
                path = f"contact.pairs.{pair[0]}.{pair[1]}.{name}"
                found.setdefault(_FEATURES[name], {})[path] = None
        law = wanted[pair]
        if rules.hardness == "same" and any(simple.numbers[name, 0].hardness != law.hardness for name in pair):
            found.setdefault(Feature.HARDNESS_PAIRS, {})[f"contact.pairs.{pair[0]}.{pair[1]}.hardness"] = None
    return [Need(feature, tuple(paths)) for feature, paths in found.items()]


def coupled_needs(world: World) -> list[Need]:
    """The needs of contact of several bodies, where rigid contact can bring it about in this world (``world/reach.py``)."""
    found: dict[Feature, list[str]] = {}
    for (first, second), law in meeting_laws(world).items():
        if law.hardness.kind != "common":
            continue
        there, path = reach(world, first, second), f"contact.pairs.{first}.{second}"
        if law.friction and there.carries:
            found.setdefault(Feature.CARRIED_FRICTION, []).append(f"{path}.friction")
        if law.friction and there.jams:
            found.setdefault(Feature.SELF_LOCKING, []).append(f"{path}.friction")
        if law.friction and there.squeezes:
            found.setdefault(Feature.EVEN_PRESSURE, []).append(f"{path}.friction")
        if there.ratio >= HEAVY_ON_LIGHT or (there.ratio and there.corners and law.friction):
            found.setdefault(Feature.MASS_RATIO, []).append(path)
    return [Need(feature, tuple(found[feature])) for feature in Feature if feature in found]


def impact_needs(world: World) -> list[Need]:
    """The need of IMPACT_FRICTION: where two bodies that may touch, one of which moves, have friction under a rigid contact.

    A compliant contact lasts many steps, and its friction is that of any slide; native contact is a declared difference.
    """
    paths = tuple(
        f"contact.pairs.{first}.{second}.{quantity}"
        for (first, second), law in meeting_laws(world).items()
        if law.hardness.kind == "common"
        for quantity in ("friction", "torsional_friction", "rolling_friction")
        if getattr(law, quantity)
    )
    return [Need(Feature.IMPACT_FRICTION, paths)] if paths else []
