"""Whether the contact figures of a stored certificate are those that its world must have: judged from the world and from
what the engine declares, since a file may have been edited, and its hash with it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.proof.contact import size
from simspec.proof.contact.probe import Figure, Law, Probe
from simspec.proof.contact.probe import wanted as figures_wanted
from simspec.proof.contact.run import PROBES, deviating, laws
from simspec.world.types import Pair, World

ROUNDING = 1e-9
"""Relative: expected values are computed anew, perhaps by another libm."""
SettingsBetween = Callable[[Pair], Mapping[str, Any]]


def figure_faults(
    figures: Sequence[Figure],
    world: World,
    engine: type[Engine] | None,
    settings: SettingsBetween,
    version: str | None = None,
) -> Iterator[str]:
    """Figures that are missing or that the world does not have, and those whose expected value, tolerance or declared
    deviation is not that of the probe and of the engine. ``engine`` None: one that is not known here, whose deviations
    cannot be judged; ``settings``: those in force between two materials; ``version``: the engine's release."""
    by_subject: dict[str, list[Figure]] = {}
    for figure in figures:
        by_subject.setdefault(figure.subject, []).append(figure)
    known = set()
    for law in laws(world):
        known.add(law.subject)
        between = settings((law.pair.first, law.pair.second))
        yield from _of_law(by_subject.get(law.subject, []), law, engine, between, version)
    rest = [figure for name, some in by_subject.items() if name not in known for figure in some]
    yield from _of_sizes(rest, world, engine)


def _of_law(
    figures: Sequence[Figure], law: Law, engine: type[Engine] | None, settings: Mapping[str, Any], version: str | None
) -> Iterator[str]:
    probes = [probe for probe in PROBES.values() if probe.applies(law)]
    wanted = Counter((figure.probe, figure.quantity) for probe in probes for figure in figures_wanted(probe, law))
    there = Counter((figure.probe, figure.quantity) for figure in figures)
    for probe in probes:
        if not figures_wanted(probe, law) and not any(name == probe.NAME for name, _ in there):
            yield f"L5 {probe.NAME}: no figure of {law.subject}"
    for (name, quantity), count in wanted.items():
        if not there[name, quantity]:
            yield f"L5 {name}: no figure of {law.subject} ({quantity})"
        elif there[name, quantity] != count:
            yield f"L5 {name}: {there[name, quantity]} figures of {law.subject} ({quantity}), this world has {count}"
    for figure in figures:
        source, reference = _reference(figure, law, probes)
        if source is None:
            yield f"L5 {figure.probe}: {figure.subject} has no figure {figure.case!r} ({figure.quantity})"
        elif reference is not None:
            yield from _numbers(figure, reference, source.slack(law))
            if engine is not None:
                yield from _deviation(figure, law, engine, settings, version, reference)


def _reference(figure: Figure, law: Law, probes: Sequence[Probe]) -> tuple[Probe | None, Figure | None]:
    """The probe that has this figure, and what the figure must be held against."""
    for probe in probes:
        if (found := probe.reference(law, figure)) is not None:
            return probe, found
    # a probe that does not say what it wants is judged by its own numbers
    silent = (probe for probe in probes if not figures_wanted(probe, law))
    return next(silent, None), None


def _numbers(figure: Figure, reference: Figure, slack: float) -> Iterator[str]:
    for name in ("expected", "without"):
        given, wanted = getattr(figure, name), getattr(reference, name)
        if (given is None) != (wanted is None) or (
            given is not None and abs(given - wanted) > (ROUNDING + slack) * max(abs(wanted), abs(reference.expected))
        ):
            yield f"L5 {figure.probe}, {figure.case}: {name} value {_number(given)}, this world has {_number(wanted)}"


def _deviation(
    figure: Figure, law: Law, engine: type[Engine], settings: Mapping[str, Any], version: str | None, reference: Figure
) -> Iterator[str]:
    """The tolerance is the probe's, or that of a deviation that the engine declares for this law."""
    share = figure.expected / reference.expected if reference.expected else 1.0
    plain = replace(figure, tolerance=share * reference.tolerance, deviation="", promised=None)
    wanted = deviating(plain, law, engine, settings, version)
    if figure.deviation != wanted.deviation:
        text = f"the deviation {figure.deviation!r}" if figure.deviation else "no deviation"
        yield f"L5 {figure.probe}, {figure.case}: {text}, {engine.NAME} declares {wanted.deviation or 'none'!r} here"
    elif abs(figure.tolerance - wanted.tolerance) > ROUNDING * wanted.tolerance:
        yield f"L5 {figure.probe}, {figure.case}: a tolerance of {figure.tolerance:g}, should be {wanted.tolerance:g}"
    elif (figure.promised is None) != (wanted.promised is None) or (
        figure.promised is not None
        and wanted.promised is not None
        and abs(figure.promised - wanted.promised) > ROUNDING * wanted.promised
    ):
        yield f"L5 {figure.probe}, {figure.case}: a promised tolerance of {_number(figure.promised)}"


def _of_sizes(figures: Sequence[Figure], world: World, engine: type[Engine] | None) -> Iterator[str]:
    lacks = engine is not None and Capability.PAIR_DETECTION in engine.LACKS
    trial = None if lacks else size.size_trial(world)
    given = {figure.subject: figure for figure in figures if figure.probe == size.NAME}
    wanted = {} if trial is None else {name: (shape, len(points)) for name, shape, _, points in trial.shapes}
    for name in wanted.keys() - given.keys():
        yield f"L5 {size.NAME}: no figure of {name}"
    thicker = {} if trial is None or engine is None else engine.thicker(trial.world)
    for figure in figures:
        if figure.probe != size.NAME or figure.subject not in wanted or trial is None:
            yield f"L5 {figure.probe}: {figure.subject} does not occur in this world"
            continue
        shape, points = wanted[figure.subject]
        outside = thicker.get(trial.world.bodies[shape].shapes[0].name, 0.0)
        limits = size.limits(outside)
        numbers = (figure.expected, figure.tolerance, figure.deviation, figure.case)
        if numbers != (0.0, *limits, size.case_of(points)):
            found = f"{figure.case}, a tolerance of {figure.tolerance:g}, should be {limits[0]:g}"
            yield f"L5 {size.NAME}, {figure.subject}: {found}"


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"
