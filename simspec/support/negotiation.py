"""What a world needs, held against what a target declares.

All features that a world needs are decided, or one error names all problems. An approximation happens only where the spec
accepts it by name; a computation outside the engine only where the spec asks for it by name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from simspec.errors import Location, Problem, UnsupportedError
from simspec.support.declarations import Level, Table
from simspec.support.features import MEANING, Feature
from simspec.support.needs import Need, needs
from simspec.world.types import World


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
) -> list[Decision]:
    """Hold what ``world`` needs against what ``target`` declares.

    ``locate`` gives the place in the spec of a path. Returns one decision per needed feature; raises UnsupportedError
    with every problem found.
    """
    options = world.options(target)
    decisions: list[Decision] = []
    problems: list[Problem] = []
    for need in [*needs(world), *extra_needs]:
        support = table[need.feature]
        level, how = support.level, support.how
        if support.only_if is not None and (reason := support.only_if(world)):
            level, how = Level.UNSUPPORTED, reason
        if level is Level.APPROXIMATE and support.exact_if is not None and (reason := support.exact_if(world)):
            level, how = Level.VIA_API, reason
        asked = None if level is not Level.APPROXIMATE or support.outside_if is None else support.outside_if(world)
        if asked is not None:
            level, how = Level.OUTSIDE, asked
        if (
            level is not Level.UNSUPPORTED
            and support.accepted_in is not None
            and (reason := support.accepted_in(world))
        ):
            level, how = Level.APPROXIMATE, reason
        name, path = need.feature.value, need.paths[0]
        more = f" (and {len(need.paths) - 1} more places)" if len(need.paths) > 1 else ""
        if level is Level.UNSUPPORTED:
            problems.append(
                Problem(
                    f"{target} cannot have {name}: {how}{more}",
                    path,
                    locate(path),
                    found=f"{name}: {MEANING[need.feature]}",
                    hint=f"leave it out of the spec, or run without --engine {target}",
                )
            )
        elif level is Level.APPROXIMATE and name not in options.accept:
            problems.append(
                Problem(
                    f"{target} has {name} only approximately: {how}{more}",
                    path,
                    locate(path),
                    found=f"{name}: {MEANING[need.feature]}",
                    hint=f"accept it by name: engines.{target}.accept: [{name}]",
                )
            )
        elif level is Level.OUTSIDE and asked is None and name not in options.outside:
            problems.append(
                Problem(
                    f"{target} has no {name} of its own; simspec can compute it outside the engine: {how}{more}",
                    path,
                    locate(path),
                    found=f"{name}: {MEANING[need.feature]}",
                    hint=f"ask for it by name: engines.{target}.outside: [{name}]",
                )
            )
        else:
            if support.noted_in is not None and (note := support.noted_in(world)):
                how = f"{how}; {note}" if how else note
            decisions.append(Decision(need.feature, level, how, need.paths, support.brief(level) or how))
    if problems:
        raise UnsupportedError(problems)
    return decisions
