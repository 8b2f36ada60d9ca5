"""What a format or an engine declares about each feature.

Every format and every engine declares every feature (a missing declaration is an error at import).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from simspec.support.features import Feature
from simspec.world.types import World


class Level(StrEnum):
    """How well a feature is supported, best first."""

    EXACT = "exact"
    VIA_API = "via_api"
    OUTSIDE = "outside"
    APPROXIMATE = "approximate"
    UNSUPPORTED = "unsupported"


_ORDER = list(Level)


@dataclass(frozen=True, slots=True)
class Support:
    """One declaration: the level, how (or why not), and tests of the world.

    ``only_if`` takes the world and gives None, or the reason why this world is not covered (then the feature counts as
    unsupported for it). ``exact_if``, for APPROXIMATE, gives the reason why nothing in this world can show the
    difference (then it counts as VIA_API, and needs no acceptance), or None. ``outside_if``, for APPROXIMATE too, gives how
    it is computed outside the engine where a setting of the spec asks for that (then it counts as OUTSIDE, asked for by
    name), or None. ``accepted_in`` gives what is approximate in this world because the spec accepts the feature by name, or
    None; it is for what depends on more than the feature (which shapes may meet), and which the format refuses by itself
    where it is not accepted. ``noted_in`` gives what must be known of it in this world, whatever its level, or None.

    ``short`` says in one line of at most 100 characters what is lost where it is approximate, or what is done where it is
    computed outside: a text of its own, for comments and tables; ``outside_short`` of what ``outside_if`` says.
    """

    level: Level
    how: str = ""
    only_if: Callable[[World], str | None] | None = None
    exact_if: Callable[[World], str | None] | None = None
    outside_if: Callable[[World], str | None] | None = None
    accepted_in: Callable[[World], str | None] | None = None
    short: str = ""
    outside_short: str = ""
    noted_in: Callable[[World], str | None] | None = None

    def brief(self, level: Level) -> str:
        """What is lost, or done outside, in one line; all that is said of it where nothing shorter is."""
        outside = level is Level.OUTSIDE and self.level is not Level.OUTSIDE
        return (self.outside_short if outside else self.short) or self.how


EXACT = Support(Level.EXACT)


def via_api(how: str) -> Support:
    """Exact, but set through the engine's API (the file cannot carry it; it goes into the sidecar)."""
    return Support(Level.VIA_API, how)


def outside(how: str, only_if: Callable[[World], str | None] | None = None, short: str = "") -> Support:
    """Exact, computed outside the engine at every step, where the spec asks for it by name; ``short`` in one line."""
    return Support(Level.OUTSIDE, how, only_if, short=short)


def approximate(how: str, exact_if: Callable[[World], str | None] | None = None, short: str = "") -> Support:
    """Not exact; allowed where the spec's ``accept`` names it. ``how`` says what the difference is, with its size; ``short`` in
    one line."""
    return Support(Level.APPROXIMATE, how, exact_if=exact_if, short=short)


def unsupported(why: str) -> Support:
    """Cannot be had."""
    return Support(Level.UNSUPPORTED, why)


Table = Mapping[Feature, Support]


def check_total(owner: str, table: Table) -> None:
    """Raise TypeError unless ``table`` declares every feature and no other."""
    missing = [feature.value for feature in Feature if feature not in table]
    unknown = [str(feature) for feature in table if not isinstance(feature, Feature)]
    if missing or unknown:
        raise TypeError(f"{owner} must declare every feature: missing {missing}, unknown {unknown}")


def combine(file: Table, engine: Table) -> dict[Feature, Support]:
    """What a format and an engine reading it support together: for each feature the weaker declaration, and where both are
    of one level what both say."""
    return {feature: _weaker(file[feature], engine[feature]) for feature in Feature}


def _weaker(file: Support, engine: Support) -> Support:
    if file.level is not engine.level:
        return max(file, engine, key=lambda support: _ORDER.index(support.level))
    if file.level is Level.UNSUPPORTED:  # one reason is enough
        return file
    said = dict.fromkeys(how for how in (file.how, engine.how) if how)
    return replace(engine, how="; ".join(said), short=engine.short or file.short)
