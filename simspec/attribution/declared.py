"""Declared deviations of two engines as candidates for the gap between them, like settings, though nothing can be swapped.

*Recovery of overlaps.* Engines declare how fast they take an overlap back. From the overlaps of a window's contacts follows how
far each side moves by that, and so what part of the gap it makes: the second side's ends are moved by the difference of the two
declared laws, and the gap is measured again. Bodies that lie on others move with them. Nothing else is predicted: the rest
stays in the gap.

*Friction and restitution.* Deviations that are declared by probe (``Engine.CONTACT_DEVIATIONS``) or accepted as approximations
have no law to predict from; nor have different laws of engines' own controllers. They fit where they count for what touches,
and where the gap closes once friction, restitution or the controllers are taken away from both sides: the difference is located
there, not predicted. That does not make a deviation the cause. Where a swap was tried with which nothing of it is declared any
more (the cone that the engine has, say), it accounts for what that swap closes and no more.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from simspec.attribution.candidates import Candidate, CandidateKind, Pair
from simspec.attribution.configuration import Configuration, Floats
from simspec.attribution.measure import Interval, Swap
from simspec.attribution.windows import Windows, exact, touching_pairs
from simspec.compiler import needed_decisions
from simspec.control.reference import natives
from simspec.engines.kit.capabilities import Recovery, ServoLaw
from simspec.engines.kit.process import Answer
from simspec.support.declarations import Level
from simspec.world.contact_pairs import solid_shapes
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, PairContact, World

TIMESTEP = ("timestep",)
"""The changed quantities of the candidate that halves the timestep."""
ACTS: Mapping[str, str] = {
    **dict.fromkeys(("push", "push-oblong", "stop", "stop-oblong", "stick", "carry", "oblique"), "friction"),
    **dict.fromkeys(("rolling", "spin", "torsion"), "friction"),
    **dict.fromkeys(("restitution", "threshold", "oblique-separation", "rest", "steady"), "restitution"),
}
"""By contact probe, what its deviations are of, in words of ``candidates.REMOVALS``."""
APPROXIMATED: Mapping[str, str] = {
    **dict.fromkeys(("contact.friction", "contact.cone", "material.friction"), "friction"),
    "material.restitution": "restitution",
    **dict.fromkeys(("contact.hardness", "shape."), "contact"),
}
"""The same by the beginning of a feature's name."""
LAWS: Mapping[ServoLaw, str] = {
    ServoLaw.EXPLICIT_SPRING: "springs with dampers, by the state before each step",
    ServoLaw.IMPLICIT_SPRING: "springs with dampers, by the velocity after each step",
    ServoLaw.MOTOR: "motors, which reach a velocity by any effort within their limit",
}
"""A description of native controllers, by law."""


@dataclass(frozen=True)
class DeclaredDeviation:
    """A declared deviation that fits.

    engine      whose it is, in words
    what        what is declared
    acts        what it is of: recovery of overlaps, friction, restitution, controllers
    predicted   whether the share follows from the declared law; else the difference is located where the deviation acts
    share       of the gap that was left, by class, where that may be claimed, with ``interval``
    swap        of one that is located: the swap that takes the deviation away and closes most ("": none was tried), and what of
                the gap that was left it closes, ``closed``: the deviation accounts for no more
    """

    engine: str
    what: str
    acts: str
    predicted: bool
    share: Mapping[str, float] = field(default_factory=dict)
    interval: Mapping[str, Interval] = field(default_factory=dict)
    swap: str = ""
    closed: Mapping[str, float] = field(default_factory=dict)


def recoveries(pair: Pair, touching: set[tuple[str, str]]) -> list[tuple[str, str]]:
    """(engine, what it declares) of the largest speeds of recovery of the two sides; empty where neither has one, or both have
    the same for all that touches."""
    found: dict[tuple[str, str], None] = {}
    for names in sorted(touching):
        both = [_recovery(side, names) for side in pair]
        if both[0] == both[1]:
            continue
        for side, recovery in zip(pair, both, strict=True):
            if recovery is not None and recovery.why:
                found[side.kind.TITLE, recovery.why] = None
    return list(found)


def touching_names(world: World, run: Answer) -> set[tuple[str, str]]:
    """The pairs of bodies that touch in a run of ``world``, by their names, the first in the world's order first."""
    _, pairs = touching_pairs(run.arrays)
    names = [body.name for body in world.bodies]
    return {(names[entry], names[other]) for entry, other in np.unique(pairs, axis=0).tolist()}


def laws_of(world: World, names: tuple[str, str]) -> list[PairContact]:
    """The laws of the materials of two bodies."""
    first, second = ({shape.material for shape in solid_shapes(body)} for body in _bodies(world, names))
    wanted = {(min(a, b), max(a, b)) for a in first for b in second}
    return [law for law in world.contact.pairs if (law.first, law.second) in wanted and law.collide]


def _bodies(world: World, names: tuple[str, str]) -> list[Body]:
    by_name = {body.name: body for body in world.bodies if body.name in names}
    return [by_name[name] for name in names]


def _recovery(side: Configuration, names: tuple[str, str]) -> Recovery | None:
    """The one recovery of two bodies; None where it is not declared, or not one for all their materials."""
    found = {side.kind.recovery(side.settings, law) for law in laws_of(side.world, names)}
    return found.pop() if len(found) == 1 else None


class RecoveryShift:
    """How much farther (m) the first side of a pair moves each body in each window than the second, (k, bodies, 3), by taking
    overlaps back as both declare it. ``run``: the first side's, with contacts, whose overlaps both begin with."""

    def __init__(self, windows: Windows, run: Answer):
        self._world = windows.world
        self._names = [body.name for body in self._world.bodies]
        groups = rigid_groups(self._world)
        self._static = [groups[name] == "world" for name in self._names]
        arrays = run.arrays
        rows, bodies = arrays["contact.row"], arrays["contact.body"].astype(np.int64)
        acting = (arrays["contact.normal_force"] > 0.0) | (arrays["contact.distance"] <= 0.0)
        self._row = int(arrays["step"][1] - arrays["step"][0]) * exact(self._world.physics.timestep)
        """s between two rows."""
        self._found: list[dict[tuple[int, int], tuple[float, Floats, int]]] = []
        begin, end = windows.rows(run, windows.numbers), windows.rows(run, windows.numbers + 1)
        for first, last in zip(begin.tolist(), end.tolist(), strict=True):
            places = np.arange(np.searchsorted(rows, first + 1), np.searchsorted(rows, last + 1))
            self._found.append(_overlaps(arrays, rows, bodies, places[acting[places]]))

    def __call__(self, pair: Pair) -> Floats:
        """The shift of a pair; nothing where it declares no law, or nothing touches in its worlds."""
        timesteps = [exact(side.world.physics.timestep) for side in pair]
        known: dict[tuple[int, int], list[Recovery | None]] = {}
        shift: Floats = np.zeros((len(self._found), len(self._names), 3))
        for number, found in enumerate(self._found):
            moves: dict[tuple[int, int], Floats] = {}
            for key, (overlap, normal, touched) in found.items():
                if key not in known:
                    names = self._names[key[0]], self._names[key[1]]
                    known[key] = [_recovery(side, names) for side in pair]
                ours, theirs = known[key]
                if ours is None or theirs is None:
                    continue
                taken_backs = [
                    recovery.taken_back(overlap, round(touched * self._row / timestep), float(timestep))
                    for recovery, timestep in zip((ours, theirs), timesteps, strict=True)
                ]
                moves[key] = (taken_backs[0] - taken_backs[1]) * normal
            _carry(shift[number], moves, self._static, self._world)
        return shift


def _overlaps(
    arrays: Mapping[str, np.ndarray], rows: np.ndarray, bodies: np.ndarray, places: np.ndarray
) -> dict[tuple[int, int], tuple[float, Floats, int]]:
    """By pair of bodies (the smaller index first): the deepest overlap (m) of the first row in which they touch, its normal
    from the second to the first, and in how many rows they do."""
    found: dict[tuple[int, int], tuple[float, Floats, int]] = {}
    begun: dict[tuple[int, int], tuple[int, int]] = {}
    for place in places.tolist():
        entry, other = bodies[place].tolist()
        key, sign = ((entry, other), 1.0) if entry < other else ((other, entry), -1.0)
        row, overlap = int(rows[place]), -float(arrays["contact.distance"][place])
        first, last = begun.get(key, (row, -1))
        if row == first and overlap > (found[key][0] if key in found else -np.inf):
            found[key] = (overlap, sign * arrays["contact.normal"][place], 1)
        if row != last:
            count = 1 if last < 0 else found[key][2] + 1
            found[key] = (*found[key][:2], count)
        begun[key] = (first, row)
    return found


def _carry(shift: Floats, moves: Mapping[tuple[int, int], Floats], static: Sequence[bool], world: World) -> None:
    """Move what lies on static bodies, and with it what lies on that; bodies that nothing static bears share a move by their
    masses."""
    placed = {index for index, is_static in enumerate(static) if is_static}
    left = dict(moves)
    while left:
        borne = [key for key in left if (key[0] in placed) != (key[1] in placed)]
        if not borne:
            break
        for key in borne:
            first, second = key
            if (first in placed) == (second in placed):
                continue
            support, body, sign = (second, first, 1.0) if second in placed else (first, second, -1.0)
            shift[body] = shift[support] + sign * left.pop(key)
            placed.add(body)
        left = {key: move for key, move in left.items() if not (key[0] in placed and key[1] in placed)}
    for (first, second), move in left.items():
        value, other = (world.bodies[index].inertial.mass for index in (first, second))
        shift[first] += move * other / (value + other)
        shift[second] -= move * value / (value + other)


Tried = Sequence[tuple[Candidate, Swap]]
"""Candidates, and what came of each."""


def located(pair: Pair, touching: set[tuple[str, str]], tried: Tried) -> Iterator[DeclaredDeviation]:
    """Declared deviations of both sides that count for what touches, with the share of what was left that goes when what they
    act on is taken away, and what swaps that take them away close."""
    removed = {swap.group: swap for _, swap in tried if swap.kind == CandidateKind.REMOVAL.value and swap.largest > 0.0}
    before = _of_both(pair, touching)
    fitting = [[(what, acts) for what, acts in side if acts in removed] for side in before]
    after = list(_with_swaps(pair, touching, tried)) if any(fitting) else []
    for number, side in enumerate(pair):
        for what, acts in fitting[number]:
            closing = {name: share for name, share in removed[acts].share.items() if share > 0.0}
            # a swap that brings another deviation of the same kind does not measure what this one does
            without = [
                swap for swap, found in after if (what, acts) not in found[number] and not _more(before, found, acts)
            ]
            best = max(without, key=lambda swap: sum(swap.share.values()), default=None)
            closed = {} if best is None else {name: share for name, share in best.share.items() if share > 0.0}
            interval = dict(removed[acts].interval)
            name = "" if best is None else best.name
            yield DeclaredDeviation(side.kind.TITLE, what, acts, False, closing, interval, name, closed)


def by_method(pair: Pair, tried: Tried, left: Mapping[str, float]) -> list[DeclaredDeviation]:
    """The part of a gap that methods of integration account for, where a side declares another than semi-implicit Euler: of a
    method of order p, what half the timestep closes over 1 − 2⁻ᵖ. ``left``: the part of the whole gap, by class, of which the
    swaps that were ``tried`` close shares."""
    methods = [method for side in pair if (method := side.kind.method(side.world)) is not None]
    halved = next((swap for candidate, swap in tried if candidate.about == TIMESTEP and swap.failed is None), None)
    if not methods or halved is None:
        return []
    # semi-implicit Euler, which is the other side's method, is of first order
    order = min(method.order for method in methods) if len(methods) == len(pair) else 1
    whole = 1.0 - 0.5**order
    share = {name: left.get(name, 1.0) * min(1.0, part / whole) for name, part in halved.share.items() if part > 0.0}
    if not share:
        return []
    interval = {
        name: (least, most)
        for name in share
        if name in halved.interval
        for least, most in [[left.get(name, 1.0) * min(1.0, end / whole) for end in halved.interval[name]]]
    }
    names = " and ".join(dict.fromkeys(method.name for method in methods))
    what = f"integrates by {names}: this part of the difference vanishes with the timestep"
    titles = " and ".join(dict.fromkeys(side.kind.TITLE for side in pair if side.kind.method(side.world) is not None))
    return [DeclaredDeviation(titles, what, "method of integration", True, share, interval)]


def without_methods(methods: Sequence[DeclaredDeviation], unexplained: Mapping[str, float]) -> dict[str, float]:
    """The unexplained shares of a gap, at most what methods of integration leave of it."""
    return {
        name: min([share, *(max(0.0, 1.0 - method.share[name]) for method in methods if name in method.share)])
        for name, share in unexplained.items()
    }


def _with_swaps(
    pair: Pair, touching: set[tuple[str, str]], tried: Tried
) -> Iterator[tuple[Swap, list[list[tuple[str, str]]]]]:
    """Declarations of both sides with each swap that was tried, where contact remains."""
    for candidate, swap in tried:
        if swap.failed is None and candidate.kind is not CandidateKind.REMOVAL:
            yield swap, _of_both(candidate.apply(pair), touching)


def _more(before: Sequence[Iterable[tuple[str, str]]], after: Sequence[Iterable[tuple[str, str]]], acts: str) -> bool:
    """Whether a side declares a deviation of what ``acts`` names that it did not declare before."""
    return any(
        entry[1] == acts and entry not in actual for actual, found in zip(before, after, strict=True) for entry in found
    )


def _of_both(pair: Pair, touching: set[tuple[str, str]]) -> list[list[tuple[str, str]]]:
    """Declarations of each side, and the laws of their own controllers where these differ."""
    found = [_declared(side, touching) for side in pair]
    laws = [side.kind.NATIVE_LAW for side in pair if natives(side.world)]
    if len({law.law for law in laws if law is not None}) == len(pair):
        for declared, law in zip(found, laws, strict=True):
            if law is not None:
                declared.append((f"its own controllers are {LAWS[law.law]}", "controllers"))
    return found


def _declared(side: Configuration, touching: set[tuple[str, str]]) -> list[tuple[str, str]]:
    """Declarations of a side that apply to the touching bodies, each once: the statement, and the quantity that it acts on."""
    return list(dict.fromkeys((*_approximated(side, touching), *_deviating(side, touching))))


def _approximated(side: Configuration, touching: set[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    bodies = {name for names in touching for name in names}
    kinds = {f"shape.{shape.kind}" for body in side.world.bodies if body.name in bodies for shape in solid_shapes(body)}
    pythons = {} if side.python is None else {side.engine: side.python}
    for decision in needed_decisions(side.accepting().world, side.engine, pythons=pythons):
        feature = decision.feature.value
        if decision.level is not Level.APPROXIMATE or (feature.startswith("shape.") and feature not in kinds):
            continue
        for beginning, acts in APPROXIMATED.items():
            if feature.startswith(beginning):
                yield decision.short or decision.how, acts


def _deviating(side: Configuration, touching: set[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    world = side.world
    laws = {law for names in touching for law in laws_of(world, names)}
    for deviation in side.kind.CONTACT_DEVIATIONS:
        acts = ACTS.get(deviation.probe)
        counts = (
            deviation.counts_for(law, world.contact.friction_cone, world.physics.timestep, side.settings)
            for law in laws
            if acts != "friction" or law.friction
        )
        if acts is not None and any(counts):
            yield deviation.why, acts
