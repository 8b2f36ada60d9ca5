"""An explanation in sentences, the most telling first, computed from its figures alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from simspec.attribution.candidates import CandidateKind
from simspec.attribution.configuration import listed_faults
from simspec.attribution.declared import (
    DeclaredDeviation,
)
from simspec.attribution.explanation import Explanation
from simspec.attribution.measure import (
    ENOUGH,
    RUN,
    SMALLEST_SHARE,
    Interval,
    Swap,
    acting,
    useful,
)
from simspec.attribution.windows import ALL
from simspec.errors import clipped

WORDS: Mapping[str, str] = {
    "free": "free motion",
    "impact": "impacts",
    "contact": "contact",
    RUN: "the whole run",
    ALL: "all windows",
}
"""The classes, as sentences say them."""
MOST = 3
"""Probes that are reported in sentences; the table has all."""
REMEMBERED = 0.05
"""Memory of a side in addition to its state is reported from this part of the gap on."""
NARROW = 0.01
"""Narrower intervals are not reported."""
LONGEST = 120
"""Characters of a declaration that a sentence quotes."""
LIKE = 0.005
"""Shares that differ by less are reported once."""


def verdict(explanation: Explanation) -> tuple[str, ...]:
    """The causes of the difference, in sentences."""
    telling = explanation.telling
    active = acting(explanation.causes)
    faults = [
        f"The models are not proven to be equal: {listed_faults(proof)}."
        for proof in explanation.models
        if proof.faults
    ]
    if not telling:
        return (*faults, *_nothing(explanation))
    lines = [*faults]
    lines += [_cause(swap, telling) for swap in active]
    if len(explanation.caused.names) > 1 and active:
        lines.append(_together(explanation, telling))
    idle = [swap.name for swap in explanation.causes if swap not in active and swap.failed is None]
    if not active:
        lines.append(_idle(idle) if explanation.causes else _no_cause(explanation))
    lines += _predicted(explanation, rest=bool(active))
    lines += [*_ways(explanation, rest=_begun(explanation)), *_places(explanation)]
    lines += _left(explanation)
    lines += _remembered(explanation)
    if explanation.exchanged is not None:
        other = explanation.exchanged
        given = [*_predicted(other, bool(active)), *_ways(other, _begun(other)), *_left(other)]
        lines += [f"Begun in B's states instead: {line[:1].lower()}{line[1:]}" for line in given]
    if idle and active:
        lines.append(f"Different, and without effect here: {_listed(idle)}.")
    return tuple(lines)


def _together(explanation: Explanation, telling: Sequence[str]) -> str:
    joint = explanation.caused
    closed = {name: share for name, share in joint.share.items() if share >= 0.0}
    opened = {name: -share for name, share in joint.share.items() if share < 0.0 and name != ALL}
    grows = f"the gap grows by {_in_classes(opened)} when they are made equal: they hide a difference of the engines"
    if not closed or set(closed) == {ALL}:
        return f"Together they account for none of the difference: {grows}."
    text = f"Together they account for {_shares(closed, telling, joint.interval)}"
    return f"{text}; {grows}." if opened else f"{text}."


def _idle(idle: Sequence[str]) -> str:
    if not idle:
        return "None of the values and settings that differ has an effect here."
    text = f"The values and settings that differ have no effect here ({_listed(idle)})"
    return f"{text}: the difference comes from the engines themselves."


def _no_cause(explanation: Explanation) -> str:
    if explanation.same_engine:
        return "Nothing differs between the two, and yet their motions do: the engine does not repeat itself."
    return "The world and all settings are the same: the difference comes from the engines themselves."


def _nothing(explanation: Explanation) -> Iterable[str]:
    if not explanation.causes and explanation.same_engine:
        yield "Nothing differs: the same world, the same settings, the same engine, and the same motion."
        return
    digits = f", that of {' and '.join(explanation.singles)} in single precision" if explanation.singles else ""
    yield f"There is nothing to explain: the motions agree to round-off{digits}."
    if explanation.causes:
        names = [swap.name for swap in explanation.causes]
        yield f"Different, and without effect here: {_listed(names)}."


def _cause(swap: Swap, telling: Sequence[str]) -> str:
    before, after = swap.values
    values = (
        f"{before} in A, {after} in B" if swap.kind == CandidateKind.DIFFERENCE.value else f"{before}, default {after}"
    )
    name = f"{swap.name[:1].upper()}{swap.name[1:]} ({values})"
    closing = {kind: share for kind, share in swap.share.items() if share > 0.0}
    if closing:
        return f"{name} accounts for {_shares(closing, telling, swap.interval)}."
    moving = ", ".join(f"{percent(part)} in {WORDS[kind]}" for kind, part in swap.effect.items() if kind != ALL)
    return f"{name} has an effect, but closes none of the difference: of that, it moves one side by {moving}."


def _shares(share: Mapping[str, float], telling: Sequence[str], intervals: Mapping[str, Interval]) -> str:
    """``99 % of the difference in contact``, or one share for all classes where they are alike."""
    classes = [name for name in telling if name != ALL and name in share]
    if not classes:
        return f"{ranged(share.get(ALL, 0.0), intervals.get(ALL))} of the difference"
    values = [share[name] for name in classes]
    every = [name for name in telling if name != ALL]
    if len(classes) == len(every) > 1 and max(values) - min(values) < LIKE:
        return f"{percent(min(values))} of the difference ({', '.join(WORDS[name] for name in classes)})"
    first, *others = sorted(classes, key=lambda name: -share[name])
    text = f"{ranged(share[first], intervals.get(first))} of the difference in {WORDS[first]}"
    return text + "".join(f", {ranged(share[name], intervals.get(name))} in {WORDS[name]}" for name in others)


def ranged(share: float, interval: Interval | None) -> str:
    """A share with its interval, where it has one that is wider than a per cent: ``33 % (12 to 48 %)``."""
    if interval is None or interval[1] - interval[0] < NARROW:
        return percent(share)
    low, high = (percent(limit).removesuffix(" %") for limit in interval)
    return f"{percent(share)} ({low} to {high} %)"


def percent(share: float) -> str:
    """A share as people read it: ``100 %`` only where nothing is left."""
    value = 100.0 * share
    if value > 99.0 and share < 1.0:
        return f"{min(value, 99.99):.4g} %"
    if abs(value) < 0.1:
        return f"{value:.1g} %" if abs(value) >= 1e-6 else "0 %"
    return f"{value:.1f} %" if abs(value) < 10.0 else f"{value:.0f} %"


def _begun(explanation: Explanation) -> bool:
    """Whether probes are of what causes and declared laws leave."""
    return bool(acting(explanation.causes)) or any(declared.predicted for declared in explanation.declared)


def _predicted(explanation: Explanation, rest: bool) -> Iterable[str]:
    """A sentence on the part that declared laws account for."""
    of = "the rest" if rest else "the difference"
    for declared in explanation.declared:
        if declared.predicted:
            closed = {name: share for name, share in declared.share.items() if share > 0.0}
            shares = _shares(closed, explanation.telling, declared.interval).replace("the difference", of, 1)
            yield f"Declared: {declared.engine} {declared.what}. This accounts for {shares}."


def _ways(explanation: Explanation, rest: bool) -> Iterable[str]:
    of = "the rest" if rest else "the difference"
    ways = [
        swap
        for swap in useful(explanation.probes)
        if swap.kind != CandidateKind.REMOVAL.value and swap.share.get(ALL, 0.0) > 0.0
    ]
    ways.sort(key=lambda swap: -swap.share[ALL])
    given = [name for name in explanation.telling if name != RUN]
    for swap in ways[:MOST]:
        yield f"Of {of}, {swap.name} closes {_plain(swap.share, given, swap.interval)}."
    if len(explanation.probed.names) > 1:
        joint = explanation.probed
        yield f"Of {of}, {_listed(joint.names)} together close {_plain(joint.share, given, joint.interval)}."


def _places(explanation: Explanation) -> Iterable[str]:
    places = [swap for swap in useful(explanation.probes) if swap.kind == CandidateKind.REMOVAL.value]
    for swap in places:
        if swap.share.get(ALL, 0.0) > 0.5:
            yield f"With {swap.name}, {percent(swap.share[ALL])} of the difference is gone."


def _plain(share: Mapping[str, float], telling: Sequence[str], intervals: Mapping[str, Interval]) -> str:
    classes = [name for name in telling if name in share and name != ALL] or [ALL]
    given = [name for name in classes if name in share]
    closed = [f"{ranged(share[name], intervals.get(name))} in {WORDS[name]}" for name in given if share[name] >= 0.0]
    opened = [f"{percent(-share[name])} in {WORDS[name]}" for name in given if share[name] < 0.0]
    grows = f"the gap grows by {', '.join(opened)}"
    return ", ".join(closed) + (f" ({grows})" if opened else "") if closed else f"none: {grows}"


def _left(explanation: Explanation) -> Iterable[str]:
    left = {name: share for name, share in explanation.unexplained.items() if share > 1.0 - ENOUGH}
    if not left:
        yield f"Unexplained: less than {percent(1.0 - ENOUGH)}."
        return
    fitting = [
        declared
        for declared in explanation.declared
        if not declared.predicted and any(name in left for name in declared.share)
    ]
    located = dict.fromkeys(left, 0.0)
    for acts in dict.fromkeys(declared.acts for declared in fitting):
        some = [declared for declared in fitting if declared.acts == acts]
        parts = {name: min(1.0, some[0].share[name]) for name in left if name in some[0].share}
        located |= {name: max(located[name], part) for name, part in parts.items()}
        yield from _located(explanation, acts, some, parts, left)
    if fitting:
        where = _listed(list(dict.fromkeys(declared.acts for declared in fitting)))
        worth_telling = _worth_telling({name: share * (1.0 - located[name]) for name, share in left.items()})
        in_classes = _in_classes(worth_telling) if worth_telling else f"less than {percent(1.0 - ENOUGH)}"
        yield f"Unexplained, and not within {where}: {in_classes}."
    else:
        yield f"Unexplained: {_in_classes(left)}."
    if any(share > 1.0 + SMALLEST_SHARE for share in left.values()):
        yield "More than 100 %: the changes hide a part of the engines' own difference, which shows once they are made equal."


def _located(
    explanation: Explanation,
    acts: str,
    some: Sequence[DeclaredDeviation],
    parts: Mapping[str, float],
    left: Mapping[str, float],
) -> Iterable[str]:
    """Declarations on ``acts``, where ``parts`` of the rest ``left`` are, and how much of these they account for: at most the
    share that a swap closes by removing the deviation, and nothing where that swap was made already."""
    engines = {declared.engine: clipped(declared.what, LONGEST) for declared in reversed(some)}
    yield f"Declared of {acts}: {'; '.join(f'{engine}: {what}' for engine, what in sorted(engines.items()))}."
    given = {name: part for name, part in parts.items() if name != ALL} or parts
    gone = f"Without {acts}, {_in_classes(given)} of the rest is gone"
    yield f"{gone}: the cause lies there; it need not be the declared deviation."
    swaps = {declared.swap: declared for declared in some if declared.swap}
    claimed = dict.fromkeys(parts, 0.0)
    for name, swap in swaps.items():
        closed = {kind: share for kind, share in swap.closed.items() if kind in given}
        share = _in_classes(closed) if closed else "nothing"
        subject = f"{name[:1].upper()}{name[1:]}"
        yield f"{subject} removes this deviation of {swap.engine} and closes {share}: the deviation accounts for no more."
        if name not in explanation.probed.names:
            claimed = {kind: min(parts[kind], claimed[kind] + swap.closed.get(kind, 0.0)) for kind in parts}
    rest = _worth_telling({name: left[name] * (part - claimed[name]) for name, part in parts.items()})
    rest = {name: share for name, share in rest.items() if name != ALL} or rest
    if not rest:
        return
    if all(declared.swap for declared in some):
        yield f"Within {acts}, not explained: {_in_classes(rest)}."
    else:
        yield f"Within {acts}, explained only if the declared deviation is the cause, which no swap shows: {_in_classes(rest)}."


def _worth_telling(share: Mapping[str, float]) -> dict[str, float]:
    return {name: part for name, part in share.items() if part > 1.0 - ENOUGH}


def _in_classes(share: Mapping[str, float]) -> str:
    return ", ".join(f"{percent(value)} in {WORDS[name]}" for name, value in share.items())


def _remembered(explanation: Explanation) -> Iterable[str]:
    for side, means in explanation.restart.items():
        parts = {
            name: means[name] / explanation.gap[name] for name in explanation.telling if name in means and name != ALL
        }
        large = [f"{percent(part)} in {WORDS[name]}" for name, part in parts.items() if part > REMEMBERED]
        if large:
            yield (
                f"{side} does not repeat its own run from its own states: it remembers more than positions and velocities "
                f"(contact points of earlier steps, say). Begun anew it moves by, of the difference, {', '.join(large)}: "
                "so much may be due to the beginnings of windows."
            )


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
