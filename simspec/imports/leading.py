"""Where joints begin that others follow, in a model that is imported from a file without initial positions.

At 0, a follower may be beyond limits that leave 0 out, as those of fingers that never close do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from simspec.imports.draft import angle, plain


def begin_within(bodies: Mapping[str, dict[str, Any]], constraints: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Give each joint that others follow the initial position nearest to 0 at which all of them are within their limits, in
    ``bodies``, as a spec says them; ``constraints`` as well. Returns by the name of a constraint what was said. Where there is
    no such position, and where loops are closed, which other positions would open, nothing is changed.
    """
    if any("follow" not in one for one in constraints.values()):
        return {}
    joints = dict(_joints(bodies))
    told: dict[str, str] = {}
    for first, chain in _chains(constraints).items():
        low, high = -math.inf, math.inf
        for name, ratio, offset in [(first, 1.0, 0.0), *chain.values()]:
            ends = sorted((bound - offset) / ratio for bound in _limits(joints.get(name, {})))
            low, high = (max(low, ends[0]), min(high, ends[1])) if ends else (low, high)
        if first in joints and low <= high and not low <= 0.0 <= high:
            begin = min(max(0.0, low), high)
            joints[first]["position"] = angle(begin) if joints[first]["type"] == "hinge" else plain(begin)
            told[next(iter(chain))] = (
                f"{first} begins at {begin:g}: at 0, it or what follows it would be beyond its limits"
            )
    return told


def _joints(bodies: Mapping[str, dict[str, Any]]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The joints of bodies, by their names."""
    for body, data in bodies.items():
        for joint in (*([data["joint"]] if "joint" in data else ()), *data.get("joints", ())):
            yield joint.get("name", f"{body}_joint"), joint


def _limits(joint: Mapping[str, Any]) -> list[float]:
    bounds = joint.get("limits", {}).get("position", ())
    return [float(str(bound).removesuffix(" rad")) for bound in bounds]


def _chains(constraints: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, tuple[str, float, float]]]:
    """By the joint that a chain of joints follows in the end, by the names of their constraints: each with the ratio and offset
    by which its position is that joint's. What goes round in a circle is left out."""
    own = {one["follow"]["joint"]: one["follow"] for one in constraints.values()}
    chains: dict[str, dict[str, tuple[str, float, float]]] = {}
    for constraint, one in constraints.items():
        name = first = one["follow"]["joint"]
        ratio, offset = 1.0, 0.0
        for _ in own:  # no chain is longer
            if first not in own:
                break
            next_one = own[first]
            factor = next_one.get("ratio", 1.0)
            ratio, offset, first = ratio * factor, ratio * next_one.get("offset", 0.0) + offset, next_one["leader"]
        if first not in own:
            chains.setdefault(first, {})[constraint] = (name, ratio, offset)
    return chains
