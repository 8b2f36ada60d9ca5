"""Limits of validity: up to which timestep an engine does what the scenario expects, over seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from simspec.analysis.intervals import LEVEL, Interval, share
from simspec.errors import Problem, SpecError
from simspec.markup import length
from simspec.runner.expectations import Outcome
from simspec.runner.run import Run


@dataclass(frozen=True, slots=True)
class Trial:
    """One run at a timestep (s) with a seed (None: unperturbed, or the only one); ``reason``: why it is not valid; ``missed``:
    the first expectation that it misses, None where the run failed or misses none."""

    timestep: float
    seed: int | None
    valid: bool
    reason: str = ""
    missed: Outcome | None = None


def trial(run: Run, outcomes: Sequence[Outcome]) -> Trial:
    """Whether a run did all that is expected of it. Raises SpecError where nothing is expected: that shows nothing."""
    seed, timestep = run.provenance.get("seed"), run.world.physics.timestep
    if run.failed is not None:
        return Trial(timestep, seed, False, f"failed: {run.failed}")
    if not outcomes:
        raise SpecError([Problem(f"{run.label}: nothing is expected of the run, so nothing says whether it is valid")])
    missed = [one for one in outcomes if not one.passed]
    if not missed:
        return Trial(timestep, seed, True)
    return Trial(timestep, seed, False, _words(missed[0], len(missed) - 1), missed[0])


MEASURED = {"no_penetration_deeper_than": "overlap"}
"""What an expectation measures, where its name says the opposite."""


def measure_words(value: float, unit: str) -> str:
    """What was measured, for reading: lengths in a unit of their size."""
    return length(value) if unit == "m" else f"{value:.3g} {unit}".rstrip()


def measured_name(kind: str) -> str:
    """What an expectation of this kind measures, in words."""
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
class Limit:
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


def limit(trials: Iterable[Trial], level: float = LEVEL) -> Limit:
    """The limit of validity of one engine.

    Raises SpecError without trials, and where one seed was tried twice at a timestep (counted twice, an interval would be too
    narrow).
    """
    by_step: dict[float, list[Trial]] = {}
    for one in trials:
        by_step.setdefault(one.timestep, []).append(one)
    if not by_step:
        raise SpecError([Problem("there are no runs to find a limit of validity from")])
    for timestep, some in by_step.items():
        twice = [seed for seed, count in Counter(one.seed for one in some).items() if count > 1]
        if twice:
            name = "the run without a seed" if twice[0] is None else f"seed {twice[0]}"
            raise SpecError([Problem(f"{name} was run more than once at {1e3 * timestep:g} ms", hint="take it once")])
    steps = sorted(by_step)
    shares = {step: share(sum(one.valid for one in by_step[step]), len(by_step[step]), level) for step in steps}
    bad = [step for step in steps if shares[step].value < 1.0]
    first = bad[0] if bad else None
    good = [step for step in steps if first is None or step < first]
    seeds = {one.seed for some in by_step.values() for one in some}
    return Limit(
        good[-1] if good else None,
        shares,
        first,
        _first_failure(by_step[first]) if first is not None else "",
        tuple(step for step in steps if first is not None and step > first and shares[step].value == 1.0),
        tuple(step for step in steps if len(by_step[step]) < len(seeds)),
        _missed(by_step[first])[0].missed if first is not None else None,
    )


def _first_failure(trials: Sequence[Trial]) -> str:
    """In words: how many of the runs at a timestep were not valid, and why the first was not."""
    missed = _missed(trials)
    seed = "" if missed[0].seed is None else f"seed {missed[0].seed}: "
    counted = f"{len(missed)} of {_count(len(trials), 'run')}"
    return f"at {1e3 * missed[0].timestep:g} ms {counted} not valid: {seed}{missed[0].reason}"


def _missed(trials: Sequence[Trial]) -> list[Trial]:
    """Those that are not valid, by seed."""
    ordered = sorted(trials, key=lambda one: -1 if one.seed is None else one.seed)
    return [one for one in ordered if not one.valid]


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
