"""Changes between two worlds: in the meaning, not in the text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from simspec.world.canonical import to_plain
from simspec.world.damping import without_implicit_damping
from simspec.world.types import World


@dataclass(frozen=True)
class Change:
    """One difference: its dotted path in the world, and the value before and after (None = not there).

    A body, material, joint or item of a list that came or went is one change, with ``kind`` "added" or "removed"; otherwise
    "changed". ``joint``: the full name of the joint that a number of a controller or of a trajectory is of.
    """

    path: str
    kind: str
    before: Any
    after: Any
    joint: str = ""

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
    """The changes from ``a`` to ``b``, each the leaf that changed: a number, a word, or a short vector (a position, a
    quaternion, a tensor) as a whole. Named items are matched by name (bodies, shapes, materials, pairs, controllers,
    constraints, frames), other items of lists by their index.

    Empty exactly when the two worlds are equal up to the order of their bodies.
    """
    entry, other = tree(a), tree(b)
    for side in (entry, other):
        side["controllers"] = {controller["name"]: controller for controller in side["controllers"]}
    joints = {f"controllers.{name}": controller["joints"] for name, controller in entry["controllers"].items()}
    for name, controller in other["controllers"].items():
        place = f"controllers.{name}"
        if place in joints and joints[place] != controller["joints"]:
            _by_joint(entry["controllers"][name])
            _by_joint(controller)
            del joints[place]
    paths = [side["trajectory"] for side in (entry, other)]
    if None not in paths:
        joints["trajectory"] = paths[0]["joints"]
        if paths[0]["joints"] != paths[1]["joints"]:
            for path in paths:
                for key in _ROWS:
                    path[key] = [dict(zip(path["joints"], row, strict=True)) for row in path[key]]
            del joints["trajectory"]
    return [_with_joint(change, joints) for change in leaves("", entry, other)]


def tree(world: World) -> dict[str, Any]:
    """The world as nested dicts, named things keyed by their names; lists only of numbers and words. Armature is as
    written in the spec, without that of implicit damping."""
    plain = to_plain(without_implicit_damping(world))
    bodies = {}
    for body in plain.pop("bodies"):
        body["shapes"] = {shape.pop("name"): shape for shape in body["shapes"]}
        bodies[body.pop("name")] = body
    contact = plain["contact"]
    contact["materials"] = {material.pop("name"): material for material in contact["materials"]}
    contact["pairs"] = {f"{pair.pop('first')}+{pair.pop('second')}": pair for pair in contact["pairs"]}
    contact["ignored_groups"] = {"+".join(pair): True for pair in contact["ignored_groups"]}
    contact["excluded_bodies"] = {"+".join(pair): True for pair in contact["excluded_bodies"]}
    engines = {}
    for options in plain.pop("engines"):
        options["settings"] = dict(options["settings"])
        if "pairs" in options:
            options["pairs"] = {
                f"{pair['first']}+{pair['second']}": dict(pair["settings"]) for pair in options["pairs"]
            }
        engines[options.pop("engine")] = options
    plain["engines"] = engines
    expectations: dict[str, Any] = {}
    for entry in plain.pop("expectations"):
        number = sum(1 for key in expectations if key.split("#")[0] == entry["kind"])
        expectations[entry["kind"] + (f"#{number + 1}" if number else "")] = dict(entry["parameters"])
    return {**plain, "bodies": bodies, "expectations": expectations}


def _by_joint(controller: dict[str, Any]) -> None:
    """Key the numbers of a controller by the joints that they are of."""
    joints = controller["joints"]
    for key, value in controller.items():
        if key != "joints" and isinstance(value, list) and len(value) == len(joints):
            controller[key] = dict(zip(joints, value, strict=True))


def _with_joint(change: Change, joints: dict[str, list[str]]) -> Change:
    """The change of an item of a list by joint, with its joint. ``joints``: those of controllers and of the trajectory, by the
    path of what has them."""
    steps = change.path.split(".")
    if steps[0] == "controllers" and len(steps) == 4:
        place = ".".join(steps[:2])
    elif steps[0] == "trajectory" and len(steps) == 4 and steps[1] in _ROWS:
        place = steps[0]
    else:
        return change
    return replace(change, joint=joints[place][int(steps[3])]) if place in joints else change


_ROWS = ("positions", "velocities", "accelerations", "efforts")
"""Lists of a trajectory that have a row of numbers by joint for each time."""
LONGEST_VECTOR = 7
"""Numbers of a list that is one value: the longest is a pose, a point and a quaternion."""


def leaves(path: str, before: Any, after: Any) -> Iterator[Change]:
    """The changes between two plain values, down to numbers, words and short vectors."""
    if isinstance(before, list) and isinstance(after, list):
        before, after = _matched(path, before, after)
    if isinstance(before, dict) and isinstance(after, dict):
        for key in [*before, *(key for key in after if key not in before)]:
            inner = f"{path}.{key}" if path else str(key)
            if key not in after:
                yield Change(inner, "removed", before[key], None)
            elif key not in before:
                yield Change(inner, "added", None, after[key])
            else:
                yield from leaves(inner, before[key], after[key])
    elif before != after:
        kind = "changed"
        if before is None and isinstance(after, dict):
            kind = "added"
        elif after is None and isinstance(before, dict):
            kind = "removed"
        yield Change(path, kind, before, after)


def _matched(path: str, before: list[Any], after: list[Any]) -> tuple[Any, Any]:
    """Two lists as mappings by what their items are matched by; the lists where they are one value each."""
    items = [*before, *after]
    if all(isinstance(item, dict) for item in items):
        name = "body" if path == "motions" else "name"  # a kinematic body has one motion
        if all(_distinct([item.get(name) for item in side]) for side in (before, after)):
            return {item[name]: item for item in before}, {item[name]: item for item in after}
    elif all(isinstance(item, str) for item in items):
        if _distinct(before) and _distinct(after) and set(before) != set(after):
            return dict.fromkeys(before, True), dict.fromkeys(after, True)
        return before, after
    elif _is_vector(path, before) and _is_vector(path, after) and len(before) == len(after):
        return before, after
    return dict(enumerate(before)), dict(enumerate(after))


def _is_vector(path: str, items: list[Any]) -> bool:
    """Whether a list of numbers is one value; numbers by joint are not."""
    numbers = all(isinstance(item, (int, float)) and not isinstance(item, bool) for item in items)
    return numbers and len(items) <= LONGEST_VECTOR and not path.startswith(("controllers.", "trajectory."))


def _distinct(names: list[Any]) -> bool:
    return all(isinstance(name, str) for name in names) and len(set(names)) == len(names)
