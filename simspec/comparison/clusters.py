"""Engines whose motions agree with each other, and where the other engines depart from them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from simspec.comparison.common import first_contact
from simspec.comparison.runs import INCONCLUSIVE, OUT, WITHIN, Diff
from simspec.comparison.study import Study
from simspec.runner.run import Run


@dataclass(frozen=True)
class Cluster:
    """Runs that agree with each other within tolerance, pair by pair, by label.

    position, angle  largest differences of any pair (m, rad); 0 for a single run
    noise            largest noise (m) that these comparisons took into account; None where none was measured
    until            time (s) up to which every pair was compared
    horizon          whether noise that grew past the tolerance ended one of the comparisons (chaos)
    """

    engines: tuple[str, ...]
    position: float = 0.0
    angle: float = 0.0
    noise: float | None = None
    until: float = math.inf
    horizon: bool = False


@dataclass(frozen=True)
class ClusterDeparture:
    """A cluster that does not agree with the first one.

    diff     comparison of a run of the first cluster, ``reference``, with a run of this one, ``engine``
    contact  sides of the first contact of the body that left the tolerance first; empty without such a contact
    """

    cluster: Cluster
    reference: str
    engine: str
    diff: Diff
    contact: tuple[str, str] | tuple[()] = ()


@dataclass(frozen=True)
class Agreement:
    """The compared runs of a study by agreement: ``clusters``, the largest first, and the departures of the others from it."""

    clusters: tuple[Cluster, ...]
    departures: tuple[ClusterDeparture, ...]


def agreement(study: Study) -> Agreement:
    """The clusters of a study: its largest set of runs that agree pairwise, then the largest set of the rest, and so on; of
    equal sets the one that comes first. Agreement is not transitive: a run that agrees with a part of a cluster is outside of
    it."""
    names = {run.label: name for name, run in study.runs.items() if run.recorded}
    compared = (diff for diff in study.diffs if {diff.first, diff.second} <= names.keys())
    diffs = {(names[diff.first], names[diff.second]): diff for diff in compared}
    together = {name for pair in diffs for name in pair}
    left, clusters = [name for name in names.values() if name in together or not diffs], []
    while left:
        chosen = _largest(left, diffs)
        clusters.append(_cluster(chosen, diffs))
        left = [name for name in left if name not in chosen]
    departures = [_departure(clusters[0], cluster, diffs, study.runs) for cluster in clusters[1:]]
    return Agreement(tuple(clusters), tuple(departure for departure in departures if departure is not None))


def _largest(names: Sequence[str], diffs: Mapping[tuple[str, str], Diff]) -> tuple[str, ...]:
    """The largest set of ``names`` whose pairs are all within tolerance. There are at most some twenty engines."""
    for size in range(len(names), 1, -1):
        for chosen in itertools.combinations(names, size):
            compared = (diffs.get(pair) for pair in itertools.combinations(chosen, 2))
            if all(diff is not None and diff.verdict == WITHIN for diff in compared):
                return chosen
    return (names[0],)


def _cluster(engines: tuple[str, ...], diffs: Mapping[tuple[str, str], Diff]) -> Cluster:
    inside = [diffs[pair] for pair in itertools.combinations(engines, 2)]
    if not inside:
        return Cluster(engines)
    bodies = [body for diff in inside for body in diff.bodies if body.compared]
    return Cluster(
        engines,
        max((body.position_largest for body in bodies), default=0.0),
        max((body.angle_largest for body in bodies), default=0.0),
        max((body.floor for body in bodies if body.floor is not None), default=None),
        min(diff.compared_until for diff in inside),
        any(diff.horizon is not None for diff in inside),
    )


def _departure(
    first: Cluster, cluster: Cluster, diffs: Mapping[tuple[str, str], Diff], runs: Mapping[str, Run]
) -> ClusterDeparture | None:
    """The comparison that stands for a cluster: of the pairs with the first one the one that is out of tolerance earliest,
    else one that is inconclusive; None where no pair was compared."""
    pairs = list(_pairs(first.engines, cluster.engines, diffs))
    if not pairs:
        return None
    out = [(diff.first_out.first_out or 0.0, pair) for pair in pairs if (diff := diffs[pair]).first_out is not None]
    inconclusive = [pair for pair in pairs if diffs[pair].verdict == INCONCLUSIVE]
    pair = min(out)[1] if out else inconclusive[0] if inconclusive else pairs[0]
    diff = diffs[pair]
    reference, engine = pair if pair[0] in first.engines else (pair[1], pair[0])
    contact: tuple[str, str] | tuple[()] = ()
    if diff.verdict == OUT and (body := diff.first_out) is not None and body.cause == "contact":
        contact = first_contact([runs[name] for name in pair], body.body) or ()
    return ClusterDeparture(cluster, reference, engine, diff, contact)


def _pairs(
    first: Iterable[str], second: Iterable[str], diffs: Mapping[tuple[str, str], Diff]
) -> Iterable[tuple[str, str]]:
    for a, b in itertools.product(first, second):
        yield from (pair for pair in ((a, b), (b, a)) if pair in diffs)
