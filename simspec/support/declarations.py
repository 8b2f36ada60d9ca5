"""Declarations of a format or an engine about each feature.

Every dialect and every engine declares every feature (a missing declaration is an error at import).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from simspec.language.vocabulary import PRIMITIVE_SHAPES, SHAPE_KINDS
from simspec.support.features import Feature
from simspec.world.types import World

# Releases of engines, and the bounds of declarations that hold for some of them.
#
# A version comes from a label (``engine@3.8`` may stand for 3.8.1) or from the installed package. Only release numbers are
# compared: suffixes (``rc1``, ``.post2``, ``+local``) belong to the release.

_RELEASE = re.compile(r"v?([0-9]+(?:\.[0-9]+)*)")


def release(version: str) -> tuple[int, ...]:
    """The numbers of a release, without zeros at the end: ``3.10.0rc1`` is (3, 10). Raises ValueError for what begins with
    no number."""
    match = _RELEASE.match(version)
    if match is None:
        raise ValueError(f"{version!r} is no version: it begins with no number")
    numbers = [int(part) for part in match[1].split(".")]
    while len(numbers) > 1 and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


def out_of_bounds(version: str, since: str = "", until: str = "") -> str | None:
    """Why ``version`` is not one from ``since`` on and before ``until`` (each may be empty); None where it is.

    A label's version that does not say enough (3 where the bound is 3.8) counts as its oldest release.
    """
    if not since and not until:
        return None
    try:
        at_work = release(version)
    except ValueError as error:
        bounds = " and ".join(part for part in (since and f"from {since} on", until and f"before {until}") if part)
        return f"has it {bounds}, and {error}"
    if since and at_work < release(since):
        return f"has it from version {since} on, and {version} is at work"
    if until and at_work >= release(until):
        return f"has it before version {until}, and {version} is at work"
    return None


def is_before(version: str, bound: str) -> bool:
    """Whether a version belongs to a release before ``bound``; False for what begins with no number."""
    try:
        return release(version) < release(bound)
    except ValueError:
        return False


def is_wholly_before(version: str, bound: str) -> bool:
    """Whether all releases that a label's version stands for are before ``bound``: 3.2 is before 3.3.6, 3.3 is not, since
    3.3.7 is one of its releases. False for what begins with no number."""
    try:
        numbers = release(version)
    except ValueError:
        return False
    return numbers < release(bound)[: max(len(numbers), version.count(".") + 1)]


def later(name: str, other: str) -> str:
    """The stricter of two first releases."""
    return max((bound for bound in (name, other) if bound), key=release, default="")


def earlier(name: str, other: str) -> str:
    """The stricter of two releases that end a declaration."""
    return min((bound for bound in (name, other) if bound), key=release, default="")


class Level(StrEnum):
    """How well a feature is supported, best first."""

    EXACT = "exact"
    VIA_API = "via_api"
    OUTSIDE = "outside"
    APPROXIMATE = "approximate"
    UNSUPPORTED = "unsupported"


class Absence(StrEnum):
    """Why a feature is not supported, the weaker reason first."""

    NOT_YET = "not_yet"
    """The engine could; simspec has not built it. An attempt fails today, and the shared tests say when it works."""
    NEVER = "never"
    """The engine, or the language of its files, cannot."""


class Attempt(StrEnum):
    """How the shared tests try a feature that is not built yet: in a world that needs it, as if it were declared exact."""

    CONTACT_PROBES = "contact-probes"
    """The contact probes of the world's laws; it works when all agree with the law."""
    READ_BACK = "read-back"
    """The world is loaded and read back; it works when what the engine says it holds has the law of every pair."""
    BUILT_IN_CONTROLLER = "own-controller"
    """The engine's built-in controller drives a joint; it works when no error is raised."""
    CONSTRAINED_MOTION = "constrained-motion"
    """The world moves without contact; it works when the motion keeps the constraint."""


_LEVELS = list(Level)
_ABSENCES = list(Absence)


@dataclass(frozen=True, slots=True)
class Refinement:
    """The support for a feature in one world. ``level`` and ``how`` (None: as declared) take the declaration's place; ``short``
    is one line on what is lost or done outside; ``note`` is added to ``how``, whatever the level. ``requested``: a setting of
    the spec selects the approximation, or the computation outside the engine, so that it needs no name under ``accept`` or
    ``outside``.
    """

    level: Level | None = None
    how: str | None = None
    short: str = ""
    note: str = ""
    requested: bool = False


Refine = Callable[[World], Refinement | None]
"""The support in a world; None: as declared."""


def acceptance(engine: str, feature: str) -> str:
    """How a user accepts that an engine has a feature approximately."""
    return f"accept it by name: engines.{engine}.accept: [{feature}], or --accept {feature}"


def unsupported_if(reason: str | None) -> Refinement | None:
    """That a world is not covered, for a ``reason``; None without one."""
    return None if reason is None else Refinement(Level.UNSUPPORTED, reason)


@dataclass(frozen=True, slots=True)
class Support:
    """One declaration: the level, and how (or why not).

    short    one line of at most 100 characters, for comments and tables: the deviation where the feature is
             approximate, or the computation outside the engine
    refine   the support in one world instead
    cases    the refinements that are known for all worlds: the cost of each, for tables and pages
    absence  of an unsupported feature: never, or not yet; then ``attempt`` says how the shared tests try it
    since    the first release of the engine that has it ("" for any); ``until`` the first that no longer has it
    before   the support of releases before ``since`` in a world (None there: as declared); without it they do not support it
    requested  in one world: a setting of the spec selects the approximation, or the computation outside the engine
    """

    level: Level
    how: str = ""
    short: str = ""
    refine: Refine | None = None
    cases: tuple[Refinement, ...] = ()
    absence: Absence | None = None
    attempt: Attempt | None = None
    since: str = ""
    until: str = ""
    before: Refine | None = None
    requested: bool = False

    def __post_init__(self) -> None:
        if (self.level is Level.UNSUPPORTED) is (self.absence is None):
            raise ValueError("an unsupported feature is declared by never or not_yet, and a supported one by neither")
        if (self.absence is Absence.NOT_YET) is (self.attempt is None):
            raise ValueError("a feature that is not built yet names its attempt, and no other does")
        if self.level is Level.UNSUPPORTED and (self.since or self.until):
            raise ValueError("bounds of versions say which releases have a feature; this one is unsupported")
        if self.before is not None and not self.since:
            raise ValueError("support in earlier releases needs the first release with the feature: since")
        for bound in (self.since, self.until):
            if bound:
                release(bound)
        if self.since and self.until and release(self.since) >= release(self.until):
            raise ValueError(f"no release is from {self.since} on and before {self.until}")

    def brief(self, level: Level, how: str = "") -> str:
        """The deviation, or the computation outside the engine, in one line; the whole text where there is no shorter one.
        ``how``: the whole text of one of several cases of this level."""
        if level is not self.level:
            for case in sorted(self.cases, key=lambda case: case.how != how):
                if case.level is level:
                    return case.short or case.how or self.how
        return self.short or self.how

    def in_world(self, world: World) -> Support:
        """The support in ``world``, its refinement applied."""
        refined = None if self.refine is None else self.refine(world)
        if refined is None:
            return replace(self, refine=None)
        level = refined.level or self.level
        how = self.how if refined.how is None else refined.how
        same = level is self.level
        lost: Absence | None = None if level is not Level.UNSUPPORTED else self.absence or Absence.NEVER
        return replace(
            self,
            level=level,
            how="; ".join(part for part in (how, refined.note) if part),
            short=refined.short or (self.short if same else ""),
            refine=None,
            before=None if lost else self.before,
            absence=lost,
            attempt=self.attempt if lost is Absence.NOT_YET else None,
            since="" if lost else self.since,
            until="" if lost else self.until,
            requested=refined.requested,
        )

    def at_version(self, engine: str, version: str | None) -> Support:
        """The support in a release of ``engine``; where ``version`` is None (unknown), that in all releases."""
        if version is None or (reason := out_of_bounds(version, self.since, self.until)) is None:
            return self
        if self.before is not None and is_before(version, self.since):
            return self.in_earlier_releases()
        return never(f"{engine} {reason}")

    def in_earlier_releases(self) -> Support:
        """The support in releases before ``since``; the same in all where that is not declared."""
        return self if self.before is None else replace(self, since="", before=None, refine=self.before)


EXACT = Support(Level.EXACT)


def exact(
    how: str = "",
    refine: Refine | None = None,
    cases: tuple[Refinement, ...] = (),
    since: str = "",
    before: Refine | None = None,
) -> Support:
    """Exact, with the fields of :class:`Support`."""
    return Support(Level.EXACT, how, refine=refine, cases=cases, since=since, before=before)


def via_api(how: str, refine: Refine | None = None) -> Support:
    """Exact, but set through the engine's API (the file cannot carry it; it goes into the sidecar)."""
    return Support(Level.VIA_API, how, refine=refine)


def outside(how: str, refine: Refine | None = None, short: str = "") -> Support:
    """Exact, computed outside the engine at every step, where the spec requests it by name; ``short`` in one line."""
    return Support(Level.OUTSIDE, how, short, refine)


def approximate(
    how: str, refine: Refine | None = None, short: str = "", cases: tuple[Refinement, ...] = (), since: str = ""
) -> Support:
    """Not exact; allowed where the spec's ``accept`` names it. ``how`` says what the difference is, with its size; ``short`` in
    one line; ``since`` the first release that has it."""
    return Support(Level.APPROXIMATE, how, short, refine, cases, since=since)


def never(why: str) -> Support:
    """Not supported, since the engine or its format cannot."""
    return Support(Level.UNSUPPORTED, why, absence=Absence.NEVER)


def not_yet(why: str, attempt: Attempt) -> Support:
    """Not supported, since simspec has not built it; ``attempt`` is how the shared tests see that it works."""
    return Support(Level.UNSUPPORTED, why, absence=Absence.NOT_YET, attempt=attempt)


Table = Mapping[Feature, Support]


def for_each(support: Support, *features: Feature) -> dict[Feature, Support]:
    """One declaration for each of ``features``. They are named, so that :func:`check_total` sees that a new one is missing."""
    return dict.fromkeys(features, support)


def exactly(*features: Feature) -> dict[Feature, Support]:
    """EXACT for each of ``features``, with nothing to add."""
    return for_each(EXACT, *features)


def shape_kinds(owner: str, known: Iterable[str]) -> dict[Feature, Support]:
    """EXACT for the kinds of shapes in ``known``, a table of the owner's own, and never for all others: a new kind is refused
    by name until it is in the table."""

    known = frozenset(known)
    lacking = {kind: never(f"{owner} has no {kind}") for kind in PRIMITIVE_SHAPES}
    lacking["mesh"] = never(f"simspec gives {owner} no meshes")
    lacking["heightfield"] = never(f"simspec gives {owner} no height fields")
    return {Feature(f"shape.{kind}"): EXACT if kind in known else lacking[kind] for kind in SHAPE_KINDS}


def check_total(owner: str, table: Table) -> None:
    """Raise TypeError unless ``table`` declares every feature and no other."""
    missing = [feature.value for feature in Feature if feature not in table]
    unknown = [str(feature) for feature in table if not isinstance(feature, Feature)]
    if missing or unknown:
        raise TypeError(f"{owner} must declare every feature: missing {missing}, unknown {unknown}")


def combine(file: Table, engine: Table) -> Table:
    """The combined support of a dialect and an engine: for each feature the weaker declaration, in a world the weaker of the
    refined ones, and where both are of one level the texts of both. Declarations do not change: the result is kept."""
    key = id(file), id(engine)
    if key not in _COMBINED:
        _COMBINED[key] = file, engine, {feature: _combined(file[feature], engine[feature]) for feature in Feature}
    return _COMBINED[key][-1]


_COMBINED: dict[tuple[int, int], tuple[Table, Table, Table]] = {}
"""By the identities of two tables: both, which therefore live on, and what they are together."""


def _combined(file: Support, engine: Support) -> Support:
    weaker = _weaker(file, engine)
    refined = file.refine is not None or engine.refine is not None
    # releases before a bound that says nothing of them, and those between two bounds, are known not to have it
    known = weaker.since and all(
        support.since in ("", weaker.since) and bool(support.since) is (support.before is not None)
        for support in (file, engine)
    )
    before = _of_both(file.in_earlier_releases(), engine.in_earlier_releases()) if known else None
    return replace(weaker, refine=_of_both(file, engine) if refined else None, before=before)


def _of_both(file: Support, engine: Support) -> Refine:
    def refine(world: World) -> Refinement | None:
        there = _weaker(file.in_world(world), engine.in_world(world))
        return Refinement(there.level, there.how, there.short, requested=there.requested)

    return refine


def _rank(support: Support) -> tuple[int, int]:
    return _LEVELS.index(support.level), -1 if support.absence is None else _ABSENCES.index(support.absence)


def _weaker(file: Support, engine: Support) -> Support:
    """The weaker of two declarations without their refinements, in the releases that both allow."""
    cases = (*file.cases, *engine.cases)
    unsupported = Level.UNSUPPORTED in (file.level, engine.level)
    since = "" if unsupported else later(file.since, engine.since)
    until = "" if unsupported else earlier(file.until, engine.until)
    weaker = max(file, engine, key=_rank)
    if _rank(file) == _rank(engine) and not unsupported:  # of what is unsupported one reason is enough
        said = dict.fromkeys(how for how in (file.how, engine.how) if how)
        weaker = replace(engine, how="; ".join(said), short=engine.short or file.short)
    return replace(weaker, refine=None, before=None, cases=cases, since=since, until=until)
