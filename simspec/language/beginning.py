"""Where the joints of an imported model begin: within their limits, whatever the file says or leaves out.

Some languages have no initial positions, and 0 may be beyond the limits of a joint, or of what follows it. Files of other
languages have some that are beyond limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from simspec.language.document import Path_, dotted
from simspec.language.joints import nearest, within
from simspec.language.vocabulary import SCALAR_JOINTS

UNSEEN: Final = 1e-5
"""rad or m below which a position that is moved to a limit is not mentioned but in the comment: files have single precision, or
six digits."""
AT_LIMITS: Final = "joints that begin at the nearest limit, since the file's position is beyond it"
FULL_TURN: Final = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class LimitStart:
    """A joint that begins at a limit and not where the file says, or at 0 where the file says nothing. ``joint``: its name in
    the model; ``path``: of the body or of the state in the spec's data; ``state``: the named state, "" for the model itself;
    positions in rad or m."""

    joint: str
    path: Path_
    position: float
    instead_of: float
    state: str = ""

    def shown(self) -> str:
        """The joint and both positions."""
        where = f"{self.state}: " if self.state else ""
        return f"{where}{self.joint} at {self.position:.6g} (not {self.instead_of:.6g})"


@dataclass(frozen=True, slots=True)
class _Joint:
    """A joint as a spec's data have it, the path of its body there, and the name of its body."""

    data: dict[str, Any]
    path: Path_
    body: str

    @property
    def begins(self) -> float:
        return _number(self.data.get("position", 0.0))

    @property
    def limits(self) -> list[float]:
        return [_number(bound) for bound in self.data.get("limits", {}).get("position", ())]

    def begin(self, position: float) -> None:
        turn = self.data["type"] == "hinge" and abs(position) > FULL_TURN
        whole = position == math.floor(position) and abs(position) < 1e15
        value = int(position) if whole else position
        self.data["position"] = f"{value!r} rad" if turn else value


def begin_within(data: dict[str, Any], comments: dict[str, str]) -> list[LimitStart]:
    """Move initial positions of joints in the ``data`` of an imported spec to the nearest ones at which the joints, and those
    that follow them, are within their limits. Each is returned, and has a sentence in ``comments`` (by dotted paths). Joints of
    loops stay, since others would open the loops: the world of such a spec is refused where they are beyond their limits. So do
    leaders of joints for which there is no position, and ball joints."""
    starts: list[LimitStart] = []
    for around, holder in _models(data):
        joints = dict(_joints(holder["bodies"], (*around, "bodies")))
        constraints = holder.get("constraints", {})
        in_loops = _in_loops(holder, constraints, joints)
        chains = _chains(constraints)
        followers = {name for chain in chains.values() for name, _, _ in chain.values()}
        for name, joint in joints.items():
            chain = chains.get(name, {})
            members = [(name, 1.0, 0.0), *chain.values()]
            if name in followers or in_loops & {member for member, _, _ in members}:
                continue
            low, high = -math.inf, math.inf
            for member, ratio, offset in members:
                limits = joints[member].limits if member in joints else []
                ends = sorted((bound - offset) / ratio for bound in limits)
                low, high = (max(low, ends[0]), min(high, ends[1])) if ends else (low, high)
            if not low <= high or within(joint.begins, (low, high)) == joint.begins:
                continue
            start = LimitStart(name, joint.path, nearest(joint.begins, (low, high)), joint.begins)
            joint.begin(start.position)
            starts.append(start)
            why = f"at {start.instead_of:g} it{' or what follows it' if chain else ''} would be beyond its limits"
            place = dotted((*around, "constraints", next(iter(chain)))) if chain else dotted(joint.path)
            sentence = f"{name} begins at {start.position:g}: {why}"
            comments[place] = f"{comments[place]}; {sentence}" if place in comments else sentence
    return [start for start in starts if abs(start.position - start.instead_of) > UNSEEN]


def _models(data: Mapping[str, Any]) -> Iterator[tuple[Path_, dict[str, Any]]]:
    """Everything in a spec's data that has bodies, with its path."""
    placed = data.get("models", {})
    several = (
        ((), data),
        (("model",), data.get("model", {})),
        *((("models", name), model) for name, model in placed.items()),
    )
    for path, holder in several:
        if isinstance(holder.get("bodies"), dict):
            yield path, holder


def _number(said: Any) -> float:
    return float(str(said).removesuffix(" rad"))


def _joints(bodies: Mapping[str, dict[str, Any]], around: Path_) -> Iterator[tuple[str, _Joint]]:
    """The hinges and slides of bodies, by their names."""
    for body, data in bodies.items():
        single = [data["joint"]] if "joint" in data else []
        for index, joint in enumerate(single or data.get("joints", ())):
            if joint.get("type") in SCALAR_JOINTS:
                implied = f"{body}_joint" if single else f"{body}_joint_{index}"
                yield joint.get("name", implied), _Joint(joint, (*around, body), body)


def _in_loops(
    holder: Mapping[str, Any], constraints: Mapping[str, Mapping[str, Any]], joints: Mapping[str, _Joint]
) -> set[str]:
    """The joints whose positions loops depend on: those above one of two bodies that are held together, and not above both."""
    bodies, named = holder["bodies"], holder.get("frames", {})
    moved: set[str] = set()
    for constraint in constraints.values():
        actual = next((constraint[kind]["bodies"] for kind in ("connect", "weld") if kind in constraint), None)
        if actual is None:
            continue
        chains = []
        for end in actual:
            body, chain = named.get(end, {}).get("body", end), set[str]()
            while body in bodies and body not in chain:
                chain.add(body)
                body = bodies[body].get("parent")
            chains.append(chain)
        moved |= chains[0] ^ chains[1]
    return {name for name, joint in joints.items() if joint.body in moved}


def _chains(constraints: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, tuple[str, float, float]]]:
    """By the joint that a chain of joints follows in the end, by the names of their constraints: each with the ratio and offset
    by which its position is that joint's. A circle is left out."""
    follows: dict[str, Any] = {
        constraint["follow"]["joint"]: constraint["follow"]
        for constraint in constraints.values()
        if "follow" in constraint
    }
    chains: dict[str, dict[str, tuple[str, float, float]]] = {}
    for constraint, entry in constraints.items():
        if "follow" not in entry:
            continue
        name = first = entry["follow"]["joint"]
        ratio, offset = 1.0, 0.0
        for _ in follows:  # no chain is longer
            if first not in follows:
                break
            above = follows[first]
            factor = _number(above.get("ratio", 1.0))
            ratio, offset = ratio * factor, ratio * _number(above.get("offset", 0.0)) + offset
            first = above["leader"]
        if first not in follows:
            chains.setdefault(first, {})[constraint] = (name, ratio, offset)
    return chains


def listed(starts: Sequence[LimitStart], most: int = 4) -> str:
    """Joints with their positions, at most so many."""
    more = f", and {len(starts) - most} more" if len(starts) > most else ""
    return ", ".join(start.shown() for start in starts[:most]) + more
