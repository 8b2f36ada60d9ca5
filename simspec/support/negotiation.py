"""What a world needs, held against what a target declares.

All features that a world needs are decided, or one error names all problems. An approximation happens only where the spec
accepts it by name; a computation outside the engine only where the spec asks for it by name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from simspec.errors import Location, Refusal, UnsupportedError
from simspec.support.declarations import Absence, Level, Support, Table, acceptance
from simspec.support.features import MEANING, Feature
from simspec.support.needs import Need, needs
from simspec.world.types import EngineOptions, World


@dataclass(frozen=True, slots=True)
class Decision:
    """How a needed feature is realised in one target; ``short`` in one line."""

    feature: Feature
    level: Level
    how: str
    paths: tuple[str, ...]
    short: str = ""


def negotiate(
    world: World,
    target: str,
    table: Table,
    locate: Callable[[str], Location | None] = lambda path: None,
    extra_needs: Iterable[Need] = (),
    title: str = "",
    version: str | None = None,
) -> list[Decision]:
    """Hold what ``world`` needs against what ``target`` declares.

    ``locate`` gives the place in the spec of a path; ``title`` is the target's name in sentences; ``version`` the release
    that is at work, None where it is not known. Returns one decision per needed feature; raises UnsupportedError with every
    problem found.
    """
    options = world.options(target)
    decisions: list[Decision] = []
    problems: list[Refusal] = []
    for need in [*needs(world), *extra_needs]:
        support = table[need.feature].at_version(title or target, version).in_world(world)
        refused = _refusal(need.feature, support, options, title or target)
        if refused is None:
            short = support.short or support.how
            decisions.append(Decision(need.feature, support.level, support.how, need.paths, short))
            continue
        message, hint, option = refused
        more = f" (and {len(need.paths) - 1} more places)" if len(need.paths) > 1 else ""
        path = need.paths[0]
        meaning = f"{need.feature.value}: {MEANING[need.feature]}"
        place = locate(path)
        problems.append(
            Refusal(f"{message}{more}", path, place, meaning, None, hint, target, need.feature.value, option)
        )
    if problems:
        raise UnsupportedError(problems)
    return decisions


def _refusal(feature: Feature, support: Support, options: EngineOptions, title: str) -> tuple[str, str, str] | None:
    """Why a feature is refused, what can be done, and the option that accepts it ("": none); None where the spec may have it
    so."""
    name, target = feature.value, options.engine
    if support.level is Level.UNSUPPORTED:
        yet = " yet" if support.absence is Absence.NOT_YET else ""
        return (
            f"{title} does not support {name}{yet}: {support.how}",
            f"leave it out of the spec, or run without --engine {target}",
            "",
        )
    if support.level is Level.APPROXIMATE and name not in options.accept:
        return (
            f"{title} supports {name} only approximately: {support.how}",
            acceptance(target, name),
            "accept",
        )
    if support.level is Level.OUTSIDE and not support.asked and name not in options.outside:
        return (
            f"{title} does not support {name} itself; simspec can compute it outside the engine: {support.how}",
            f"ask for it by name: engines.{target}.outside: [{name}], or --accept {name}",
            "outside",
        )
    return None
