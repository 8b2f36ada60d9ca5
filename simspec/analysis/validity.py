"""Limits of validity: up to which timestep an engine does what the scenario expects, over seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.analysis.tables import LEVEL, Interval, share
from simspec.errors import Problem, SpecError, length
from simspec.runner.expectations import Outcome
from simspec.runner.run import Run
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Expectation


@dataclass(frozen=True, slots=True)
class TimestepTrial:
    """One run at a timestep (s) with a seed (None: unperturbed, or the only one); ``reason``: why it is not valid; ``missed``:
    the first expectation that it misses, None where the run failed or misses none."""

    timestep: float
    seed: int | None
    valid: bool
    reason: str = ""
    missed: Outcome | None = None


def trial(run: Run, outcomes: Sequence[Outcome]) -> TimestepTrial:
    """Whether a run did all that is expected of it. Raises SpecError where nothing is expected: that shows nothing."""
    seed, timestep = run.provenance.get("seed"), run.world.physics.timestep
    if run.failed is not None:
        return TimestepTrial(timestep, seed, False, f"failed: {run.failed}")
    if not outcomes:
        raise SpecError(
            [Problem(f"{run.label}: nothing is expected of the run, so nothing says whether it is valid", code="R106")]
        )
    missed = [outcome for outcome in outcomes if not outcome.passed]
    if not missed:
        return TimestepTrial(timestep, seed, True)
    return TimestepTrial(timestep, seed, False, _words(missed[0], len(missed) - 1), missed[0])


MEASURED = {"no_penetration_deeper_than": "overlap"}
"""The measured quantity of expectations with the opposite name."""


def measure_words(value: float, unit: str) -> str:
    """The measured value as text: lengths in a unit of their size."""
    return length(value) if unit == "m" else f"{value:.3g} {unit}".rstrip()


def measured_name(kind: str) -> str:
    """The quantity that an expectation of this kind measures, in words."""
    return MEASURED.get(kind, kind.replace("_", " "))


def _words(outcome: Outcome, more: int) -> str:
    name = measured_name(outcome.kind)
    if outcome.measured is None:
        text = f"{name}: {outcome.detail}"
    else:
        place = f" ({outcome.detail})" if outcome.detail else ""
        figures = [measure_words(value, outcome.unit) for value in (outcome.measured, outcome.bound)]
        text = f"{name}: {figures[0]}, bound {figures[1]}{place}"
    return f"{text}, and {more} more" if more else text


@dataclass(frozen=True)
class TimestepLimit:
    """Up to which timestep an engine is valid.

    timestep       the largest (s) such that it and all smaller ones are valid with all seeds; None where the smallest is not
    shares         by timestep, ascending: the share of valid runs, with its interval over seeds
    first_invalid  the smallest timestep (s) with a run that is not valid; None where every run is: the limit is then at
                   least ``timestep``, as no larger one was tried
    first_failure  what happened there, in words; "" where every run is valid
    later_valid    larger timesteps (s) at which every run is valid again: they do not count
    fewer_seeds    timesteps (s) that were tried with fewer seeds than others
    first_missed   the expectation that the first run with a failure misses at ``first_invalid``; None where that run gave
                   no result
    """

    timestep: float | None
    shares: dict[float, Interval]
    first_invalid: float | None
    first_failure: str
    later_valid: tuple[float, ...]
    fewer_seeds: tuple[float, ...]
    first_missed: Outcome | None = None

    def __str__(self) -> str:
        if self.timestep is None:
            return f"not valid at any timestep; {self.first_failure}"
        at_least = "at least " if self.first_invalid is None else ""
        seeds = self.shares[self.timestep]
        text = f"{at_least}{1e3 * self.timestep:g} ms ({_count(seeds.trials, 'run')}, share ≥ {seeds.lower:.2g})"
        return f"{text}; {self.first_failure}" if self.first_failure else text


def limit(trials: Iterable[TimestepTrial], level: float = LEVEL) -> TimestepLimit:
    """The limit of validity of one engine.

    Raises SpecError without trials, and where one seed was tried twice at a timestep (counted twice, an interval would be too
    narrow).
    """
    by_step: dict[float, list[TimestepTrial]] = {}
    for entry in trials:
        by_step.setdefault(entry.timestep, []).append(entry)
    if not by_step:
        raise SpecError([Problem("there are no runs to find a limit of validity from", code="R106")])
    for timestep, some in by_step.items():
        twice = [seed for seed, count in Counter(trial.seed for trial in some).items() if count > 1]
        if twice:
            name = "the run without a seed" if twice[0] is None else f"seed {twice[0]}"
            raise SpecError(
                [Problem(f"{name} was run more than once at {1e3 * timestep:g} ms", hint="take it once", code="R105")]
            )
    steps = sorted(by_step)
    shares = {step: share(sum(trial.valid for trial in by_step[step]), len(by_step[step]), level) for step in steps}
    bad = [step for step in steps if shares[step].value < 1.0]
    first = bad[0] if bad else None
    good = [step for step in steps if first is None or step < first]
    seeds = {trial.seed for some in by_step.values() for trial in some}
    return TimestepLimit(
        good[-1] if good else None,
        shares,
        first,
        _first_failure(by_step[first]) if first is not None else "",
        tuple(step for step in steps if first is not None and step > first and shares[step].value == 1.0),
        tuple(step for step in steps if len(by_step[step]) < len(seeds)),
        _missed(by_step[first])[0].missed if first is not None else None,
    )


def _first_failure(trials: Sequence[TimestepTrial]) -> str:
    """In words: how many of the runs at a timestep were not valid, and why the first was not."""
    missed = _missed(trials)
    seed = "" if missed[0].seed is None else f"seed {missed[0].seed}: "
    counted = f"{len(missed)} of {_count(len(trials), 'run')}"
    return f"at {1e3 * missed[0].timestep:g} ms {counted} not valid: {seed}{missed[0].reason}"


def _missed(trials: Sequence[TimestepTrial]) -> list[TimestepTrial]:
    """Those that are not valid, by seed."""
    ordered = sorted(trials, key=lambda entry: -1 if entry.seed is None else entry.seed)
    return [trial for trial in ordered if not trial.valid]


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


# First event in a run that does not meet its expectations: the expectation that fails first, the body farthest from its target
# then, and the events of that body and of driven joints before. Events between two records have the time of the later one.

KINDS: Mapping[str, str] = {
    "no-result": "the run ended early",
    "off-trajectory": "a driven joint was far from its trajectory",
    "overlap": "the body overlapped another one deeply",
    "left-its-place": "the body was at its place, and left it",
    "not-moved": "the body stayed where it was",
    "not-lifted": "the body did not rise by half of what its place needs",
    "dropped": "the body came down on its way",
    "missed": "the body did not come to its place",
    "not-recorded": "its motion was not recorded",
    "other": "another expectation failed",
}
"""The kinds of first events."""
TRACKING = 0.2
"""rad, or 0.2 m of a slide: a controller that follows its trajectory stays far below it."""
DEEP = 0.1
"""Share of the inner radius of the thinner of two bodies: below it an overlap is how an engine models contact. So is one that
is not deeper than those before, while expectations held."""
FALLEN = 2.0
"""How many tolerances of its place a body comes down when it falls."""
RISEN = 0.5
"""Share of the way up below which a body was not lifted."""
PLACES = ("at_target", "position")


@dataclass(frozen=True, slots=True)
class Failure:
    """The first event.

    kind      word of :data:`KINDS`
    time      when it first shows (s); None where that is not known
    what      the joint, the other body, a figure; "" where there is no more to say
    expected  index of the first expectation that failed; None where the run gave no result
    at        its time (s); None for the end of the run, or all of it
    body      the body that was farthest from its place then; "" where the expectation is none of places
    away      how far (m)
    """

    kind: str
    time: float | None
    what: str
    expected: int | None = None
    at: float | None = None
    body: str = ""
    away: float | None = None

    def __str__(self) -> str:
        when = "" if self.time is None else f" at {self.time:.4g} s"
        text = f"{KINDS[self.kind]}{when}{f' ({self.what})' if self.what else ''}"
        if self.away is None:
            return text
        end = "at the end" if self.at is None else f"at {self.at:.4g} s"
        return f"{text}; {self.body} {length(self.away)} off its place {end}"


def first_failure(run: Run, outcomes: Sequence[Outcome]) -> Failure | None:
    """The first event of a run with the outcomes of its expectations; None where all are met."""
    if run.failed is not None:
        return _ended(run, run.failed)
    pairs = zip(run.world.expectations, outcomes, strict=True)
    missed = [(index, expectation, outcome) for index, (expectation, outcome) in enumerate(pairs) if not outcome.passed]
    if not missed:
        return None
    end = float(run.time[-1]) if run.recorded else 0.0
    index, expectation, outcome = min(missed, key=lambda entry: (_time(entry[1], end), entry[0]))
    at = _given(expectation).get("at")
    if expectation.kind not in PLACES:
        detail = f": {outcome.detail}" if outcome.detail else ""
        return Failure("other", None, f"{expectation.kind.replace('_', ' ')}{detail}", index, at)
    targets = {name: np.array(place) for name, place in _places(_given(expectation)) if name in run.index}
    if not run.recorded or not targets:
        return Failure("not-recorded", None, outcome.detail, index, at)
    begun = max(
        (_time(entry, end) for entry in run.world.expectations if _time(entry, end) < _time(expectation, end)),
        default=0.0,
    )
    return _of_place(run, expectation, index, targets, _row(run, begun), _row(run, _time(expectation, end)))


def _ended(run: Run, why: str) -> Failure:
    """The first event of a run that ended early: a joint that left its trajectory before, or that it ended."""
    if not run.recorded:
        return Failure("no-result", None, why)
    event = _off_trajectory(run, len(run.time) - 1)
    if event is None:
        return Failure("no-result", float(run.time[-1]), "; ".join(part for part in (why, _unseen(run)) if part))
    return Failure(event[1], float(run.time[event[0]]), f"{event[2]}; {KINDS['no-result']}: {why}")


def _of_place(
    run: Run, expectation: Expectation, index: int, targets: Mapping[str, NDArray[np.float64]], begin: int, end: int
) -> Failure:
    """The first event of the body that is farthest from its place in row ``end``; ``begin``: the row of the expectation
    before."""
    poses = run.arrays["pose"]
    away = {name: float(np.linalg.norm(poses[end, run.index[name], :3] - place)) for name, place in targets.items()}
    body = max(away, key=lambda name: np.inf if np.isnan(away[name]) else away[name])
    tolerance = float(_given(expectation)["tolerance"])
    path = poses[: end + 1, run.index[body], :3]
    events = [
        _off_trajectory(run, end),
        _overlap(run, body, begin, end),
        _left(path, targets[body], tolerance),
        _on_its_way(path[begin:], targets[body], tolerance, _up(run), begin),
    ]
    row, kind, what = min((event for event in events if event is not None), key=lambda event: event[0])
    unseen = _unseen(run) if kind != "off-trajectory" else ""
    text = "; ".join(part for part in (what, unseen) if part)
    return Failure(kind, float(run.time[row]), text, index, _given(expectation).get("at"), body, away[body])


Event = tuple[int, str, str]
"""The row in which something first shows, its kind, and what it is of."""


def _off_trajectory(run: Run, end: int) -> Event | None:
    """The first row in which a driven joint is far from its trajectory."""
    rows: list[Event] = []
    for name in _driven(run) if "control.target" in run.arrays else ():
        target, q = run.target(name)[: end + 1], run.q(name)[: end + 1]
        off = np.abs(target - q)
        far = np.flatnonzero(off > TRACKING)
        if len(far):
            rows.append((int(far[0]), "off-trajectory", f"{name} by {off[far[0]]:.2g}"))
    return min(rows, default=None)


def _driven(run: Run) -> dict[str, float]:
    """The largest tracking error of each driven joint in the whole run, rad or m; 0 where only the engine knows it."""
    control: Mapping[str, Any] = run.provenance.get("control", {})
    return {name: error or 0.0 for name, error in zip(control.get("joints", ()), control.get("error", ()), strict=True)}


def _unseen(run: Run) -> str:
    """The control errors of joints that were far from their trajectory in no recorded row, or later."""
    name, error = max(_driven(run).items(), key=lambda item: item[1], default=("", 0.0))
    return f"{name} was up to {error:.2g} off its trajectory at some time" if error > TRACKING else ""


def _overlap(run: Run, body: str, begin: int, end: int) -> Event | None:
    """The first row, from that of the expectation before on, in which a body overlaps another by more than DEEP, and by
    more than any two bodies did until then."""
    if "contact.distance" not in run.arrays:
        return None
    rows, bodies = np.asarray(run.arrays["contact.row"]), np.asarray(run.arrays["contact.body"])
    indices = np.flatnonzero((rows >= begin) & (rows <= end) & (bodies == run.index[body]).any(axis=1))
    overlaps = -np.asarray(run.arrays["contact.distance"])
    harmless = float(overlaps[rows < begin].max(initial=0.0))
    depth = overlaps[indices]
    thin = np.array([_inner_radius(other_body) for other_body in run.world.bodies])
    bound = np.maximum(harmless, DEEP * thin[bodies[indices].astype(np.int64)].min(axis=1))
    deep = np.flatnonzero(~(depth <= bound))
    if not len(deep):
        return None
    first = deep[np.argmin(rows[indices[deep]])]
    other = next((int(k) for k in bodies[indices[first]] if k != run.index[body]), run.index[body])
    return int(rows[indices[first]]), "overlap", f"{length(float(depth[first]))} with {run.world.bodies[other].name}"


def _inner_radius(body: Body) -> float:
    """The radius (m) of the largest sphere in the thinnest of a body's shapes."""
    radii = [SHAPES[shape.kind].inner_radius(shape.size) for shape in body.shapes if shape.collision]
    return min(radii, default=np.inf)


def _left(path: NDArray[np.float64], target: NDArray[np.float64], tolerance: float) -> Event | None:
    """The first row in which a body that was at its place is not there any more, for good."""
    inside = np.flatnonzero(np.linalg.norm(path - target, axis=1) <= tolerance)
    if not len(inside) or inside[-1] == len(path) - 1:
        return None
    return int(inside[-1]) + 1, "left-its-place", ""


def _on_its_way(
    path: NDArray[np.float64], target: NDArray[np.float64], tolerance: float, up: NDArray[np.float64] | None, begin: int
) -> Event:
    """The failure of a body that never came to its place: the row that shows it, the last one where all of them do."""
    last = begin + len(path) - 1
    if np.linalg.norm(path - path[0], axis=1).max() <= tolerance:
        return last, "not-moved", ""
    if up is None:
        return last, "missed", ""
    height, wanted = path @ up, float(target @ up)
    needed = wanted - float(height[0])
    if needed > tolerance and height.max() - height[0] < RISEN * needed:
        return last, "not-lifted", ""
    highest = np.maximum.accumulate(height)
    # a body that is carried over its place comes down to it
    fallen = highest - height > FALLEN * tolerance + np.maximum(0.0, highest - max(wanted, float(height[0])))
    below = np.flatnonzero(fallen & (height < wanted - tolerance))
    if len(below):
        return begin + int(below[0]), "dropped", ""
    return last, "missed", ""


def _up(run: Run) -> NDArray[np.float64] | None:
    """The direction against gravity; None without any."""
    gravity = np.array(run.world.physics.gravity)
    pull = float(np.linalg.norm(gravity))
    return -gravity / pull if pull > 0.0 else None


def _given(expectation: Expectation) -> dict[str, Any]:
    """The parameters of an expectation by name."""
    return dict(expectation.parameters)


def _time(expectation: Expectation, end: float) -> float:
    """When an expectation can be seen to fail: at its time, else at the end."""
    parameters = _given(expectation)
    return float(next((parameters[name] for name in ("at", "until") if name in parameters), end))


def _places(parameters: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    if "targets" in parameters:
        yield from parameters["targets"]
    else:
        yield parameters["body"], parameters["xyz"]


def _row(run: Run, time: float) -> int:
    """The recorded row next to a time."""
    return int(np.abs(run.time - time).argmin())
