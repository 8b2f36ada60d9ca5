"""Effects of contact that are absent in an engine by its own declarations, for the support matrix: a declared deviation so
wide that an engine without the effect would pass (see ``proof/contact/declared.py``)."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator

from simspec.engines.kit.contract import Engine
from simspec.engines.kit.deviations import Deviation
from simspec.proof.contact.declared import EFFECTS
from simspec.proof.contact.probe import Figure, Law
from simspec.proof.contact.run import PROBES, widened
from simspec.world.types import Hardness, PairContact

FRICTION, RESTITUTION, TIMESTEP = 0.5, 0.5, 1e-3
"""Of the laws that declarations are tried with, where a declaration does not start above these."""


def absent(engine: type[Engine]) -> list[tuple[str, str, str]]:
    """By effect: its name, under which law and settings it is absent from the least friction, restitution and timestep on,
    and why."""
    found: dict[tuple[str, str], list[Deviation]] = {}
    for one in engine.CONTACT_DEVIATIONS:
        if any(_shows_nothing(figure, law, one) for law in _laws(one) for figure in _figures(law, one.probe)):
            found.setdefault((EFFECTS.get(one.probe, one.probe), one.why), []).append(one)
    return [(effect, "; ".join(_where(some)), why) for (effect, why), some in found.items()]


def _shows_nothing(figure: Figure, law: Law, deviation: Deviation) -> bool:
    """Whether a figure that is furthest off passes under this declaration alone, and so shows nothing of its effect."""
    if figure.without is None:
        return False
    settings = {} if deviation.setting is None else dict([deviation.setting])
    return widened(figure, law, (deviation,), settings).absent


def _laws(one: Deviation) -> Iterator[Law]:
    bounces = sorted({one.restitution, _usual(RESTITUTION, one.restitution, one.below[1])})
    for restitution, threshold in itertools.product(bounces, (0.0, 0.1)):
        pair = PairContact(
            "a",
            "b",
            _usual(FRICTION, one.friction, one.below[0]),
            restitution,
            restitution_threshold=threshold,
            torsional_friction=0.01,
            rolling_friction=0.001,
            hardness=_hardness(one.hardness or "common"),
        )
        yield Law(pair, one.friction_cone or "elliptic", _usual(TIMESTEP, one.timestep, one.below[2]))


def _usual(usual: float, least: float, below: float) -> float:
    """The usual value, or where the declaration does not count for it one for which it does."""
    return max(least, below / 2.0) if usual >= below else max(least, usual)


def _hardness(kind: str) -> Hardness:
    return Hardness(kind, time_constant=0.02, damping_ratio=1.0, stiffness=1e4, damping=100.0)


def _figures(law: Law, probe: str) -> list[Figure]:
    return [figure for figure in _wanted(law) if figure.probe == probe]


@functools.cache
def _wanted(law: Law) -> tuple[Figure, ...]:
    """What every probe that applies wants. Thousands of declarations are tried with a few hundred laws, and the slides of one
    law are worked out step by step."""
    return tuple(figure for probe in PROBES.values() if probe.applies(law) for figure in probe.wanted(law))


def _where(some: list[Deviation]) -> Iterator[str]:
    """The conditions of declarations, each once, in words."""
    told: dict[str, list[float]] = {}
    for one in some:
        parts = [
            f"{one.setting[0]}: {one.setting[1]}" if one.setting else "",
            f"cone {one.friction_cone}" if one.friction_cone else "",
            f"hardness {one.hardness}" if one.hardness else "",
        ]
        key = ", ".join(filter(None, parts))
        low = told.setdefault(key, [one.friction, one.restitution, one.timestep])
        told[key] = [min(low[0], one.friction), min(low[1], one.restitution), min(low[2], one.timestep)]
    for key, (friction, restitution, timestep) in told.items():
        least = [
            f"μ ≥ {friction:g}" if friction > 1e-6 else "",
            f"e ≥ {restitution:g}" if restitution else "",
            f"timestep ≥ {1e3 * timestep:g} ms" if timestep else "",
        ]
        yield ", ".join(filter(None, [key, *least])) or "always"
