"""What changed between two worlds: in the meaning, not in the text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from simspec.world.canonical import to_plain
from simspec.world.types import World


@dataclass(frozen=True)
class Change:
    """One difference: its dotted path in the world, and the value before and after (None = not there).

    A body, material or joint that came or went is one change, with ``kind`` "added" or "removed"; otherwise "changed".
    """

    path: str
    kind: str
    before: Any
    after: Any

    def __str__(self) -> str:
        if self.kind == "added":
            return f"+ {self.path}"
        if self.kind == "removed":
            return f"- {self.path}"
        return f"~ {self.path}: {_text(self.before)} -> {_text(self.after)}"


def _text(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_text(item) for item in value)}]"
    return f"{value:g}" if isinstance(value, float) and float(f"{value:g}") == value else str(value)


def diff_worlds(a: World, b: World) -> list[Change]:
    """The changes from ``a`` to ``b``: bodies, shapes, materials and pairs are matched by name, never by place.

    Empty exactly when the two worlds are equal up to the order of their bodies.
    """
    return list(_changes("", tree(a), tree(b)))


def tree(world: World) -> dict[str, Any]:
    """The world as nested dicts, named things keyed by their names; lists only of numbers and words."""
    plain = to_plain(world)
    bodies = {}
    for body in plain.pop("bodies"):
        body["shapes"] = {shape.pop("name"): shape for shape in body["shapes"]}
        bodies[body.pop("name")] = body
    contact = plain["contact"]
    contact["materials"] = {one.pop("name"): one for one in contact["materials"]}
    contact["pairs"] = {f"{one.pop('first')}+{one.pop('second')}": one for one in contact["pairs"]}
    contact["ignored_groups"] = {"+".join(pair): True for pair in contact["ignored_groups"]}
    contact["excluded_bodies"] = {"+".join(pair): True for pair in contact["excluded_bodies"]}
    engines = {}
    for options in plain.pop("engines"):
        options["settings"] = dict(options["settings"])
        if "pairs" in options:
            options["pairs"] = {f"{one['first']}+{one['second']}": dict(one["settings"]) for one in options["pairs"]}
        engines[options.pop("engine")] = options
    plain["engines"] = engines
    expectations: dict[str, Any] = {}
    for one in plain.pop("expectations"):
        number = sum(1 for key in expectations if key.split("#")[0] == one["kind"])
        expectations[one["kind"] + (f"#{number + 1}" if number else "")] = dict(one["parameters"])
    return {**plain, "bodies": bodies, "expectations": expectations}


def _changes(path: str, before: Any, after: Any) -> Iterator[Change]:
    if isinstance(before, dict) and isinstance(after, dict):
        for key in [*before, *(key for key in after if key not in before)]:
            inner = f"{path}.{key}" if path else str(key)
            if key not in after:
                yield Change(inner, "removed", before[key], None)
            elif key not in before:
                yield Change(inner, "added", None, after[key])
            else:
                yield from _changes(inner, before[key], after[key])
    elif before != after:
        yield Change(path, "changed", before, after)
