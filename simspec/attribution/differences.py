"""Differences between two worlds, each by itself, in terms of physics; a world with some of another's values."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from simspec.comparison.worlds import Change, leaves, tree
from simspec.errors import Problem, SpecError
from simspec.world.canonical import from_plain
from simspec.world.damping import with_implicit_damping
from simspec.world.types import World

Keys = tuple[str, ...]
INITIAL_STATE = "initial state"
MATERIALS = "materials"
OTHER = "other values of the world"
IGNORED: tuple[Keys, ...] = (
    ("name",),
    ("record",),
    ("expectations",),
    ("engines",),
    ("physics", "steps"),
    ("bodies", "*", "shapes", "*", "colour"),
    ("bodies", "*", "shapes", "*", "visual"),
)
"""Parts that no motion depends on, and options of engines, which are reported with their settings."""
GROUPS: Mapping[Keys, str] = {
    ("physics", "gravity"): "gravity",
    ("physics", "timestep"): "timestep",
    ("physics", "fluid"): "fluid",
    ("physics", "damping"): "damping of joints, explicit or implicit",
    ("bodies", "*", "box"): "fluid",
    ("contact", "friction_cone"): "friction cone",
    ("contact", "materials", "*", "friction"): "friction",
    ("contact", "pairs", "*", "friction"): "friction",
    ("contact", "materials", "*", "torsional_friction"): "torsional friction",
    ("contact", "pairs", "*", "torsional_friction"): "torsional friction",
    ("contact", "materials", "*", "rolling_friction"): "rolling friction",
    ("contact", "pairs", "*", "rolling_friction"): "rolling friction",
    ("contact", "materials", "*", "restitution"): "restitution",
    ("contact", "pairs", "*", "restitution"): "restitution",
    ("contact", "pairs", "*", "restitution_threshold"): "restitution",
    ("contact", "pairs", "*", "hardness"): "hardness",
    ("contact", "pairs", "*", "collide"): "collision filter",
    ("contact", "ignored_groups"): "collision filter",
    ("contact", "excluded_bodies"): "collision filter",
    ("bodies", "*", "collision_group"): "collision filter",
    ("bodies", "*", "inertial"): "mass and inertia",
    ("bodies", "*", "shapes", "*", "material"): MATERIALS,
    ("bodies", "*", "shapes"): "shapes",
    ("bodies", "*", "joint", "position"): INITIAL_STATE,
    ("bodies", "*", "joint", "velocity"): INITIAL_STATE,
    ("bodies", "*", "joint", "origin"): "joint frame",
    ("bodies", "*", "joint", "axis"): "joint frame",
    ("bodies", "*", "joint", "damping"): "joint damping",
    ("bodies", "*", "joint", "angular_damping"): "joint damping",
    ("bodies", "*", "joint", "angular_armature"): "armature",
    ("bodies", "*", "gravity_scale"): "gravity",
    ("bodies", "*", "joint", "dry_friction"): "dry friction of a joint",
    ("bodies", "*", "joint", "armature"): "armature",
    ("bodies", "*", "joint", "spring_stiffness"): "joint spring",
    ("bodies", "*", "joint", "spring_rest"): "joint spring",
    ("bodies", "*", "joint", "position_limits"): "joint limits",
    ("bodies", "*", "joint", "angle_limit"): "joint limits",
    ("sums",): "sums of joint positions",
    ("bodies", "*", "joint", "effort_limit"): "joint ratings",
    ("bodies", "*", "joint", "velocity_limit"): "joint ratings",
    ("controllers",): "controller",
    ("trajectory",): "trajectory",
    ("forces",): "forces on bodies",
    ("motions",): "motion of a kinematic body",
    ("constraints",): "constraints",
}
"""Of values by their place in the tree of a world, the first that fits; ``*`` stands for any name."""
MOST_THINGS = 6
"""Up to this many differences of a group are listed separately; more are combined into one."""


@dataclass(frozen=True)
class Difference:
    """One difference of two worlds A and B: ``group`` in words of physics, ``thing`` whose it is ("" for the world's own), the
    changes from A to B, and their places in the trees of the worlds."""

    group: str
    thing: str
    changes: tuple[Change, ...]
    places: tuple[Keys, ...]

    @property
    def name(self) -> str:
        """What differs."""
        return f"{self.group} of {self.thing}" if self.thing else self.group

    @property
    def values(self) -> tuple[str, str]:
        """Its value in A and in B, in short."""
        change = self.changes[0]
        # of a long list or a mapping what differs first
        first, *others = [*leaves(change.path, change.before, change.after)] or [change]  # none: another order
        count = len(self.changes) - 1 + len(others)
        more = f" (and {count} more)" if count else ""
        return _short(first.before), f"{_short(first.after)}{more}"


def _short(value: Any) -> str:
    if value is None:
        return "not there"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return f"{value:.6g}"
    if isinstance(value, (list, tuple)) and len(value) <= 7 and all(isinstance(item, (int, float)) for item in value):
        return f"[{', '.join(f'{item:.6g}' for item in value)}]"
    return value if isinstance(value, str) and len(value) <= 40 else "another"


def named_tree(world: World) -> dict[str, Any]:
    """The tree of a world (:func:`simspec.comparison.worlds.tree`), with its controllers by name, too."""
    plain = tree(world)
    plain["controllers"] = {controller.pop("name"): controller for controller in plain["controllers"]}
    return plain


def differences(a: World, b: World) -> list[Difference]:
    """Differences from ``a`` to ``b``, those of a group combined where they are many; without parts that no motion depends on.

    Raises SpecError where the worlds are of different scenes: other bodies, or joints of other kinds or other parents.
    """
    demand_same_scene(a, b)
    places: dict[tuple[str, str], list[tuple[Keys, Change]]] = {}
    entry, other = named_tree(a), named_tree(b)
    lumped = entry["contact"]["materials"].keys() != other["contact"]["materials"].keys()
    for keys, before, after in _changes((), entry, other):
        group = _group(keys, lumped)
        if group is not None:
            kind = "added" if before is None else "removed" if after is None else "changed"
            change = Change(".".join(keys), kind, before, after)
            places.setdefault((group, _thing(keys, group)), []).append((keys, change))
    things: dict[str, list[str]] = {}
    for group, thing in places:
        things.setdefault(group, []).append(thing)
    found = []
    for group, names in things.items():
        parts = [names] if len(names) > MOST_THINGS or group == INITIAL_STATE else [[name] for name in names]
        for part in parts:
            rows = [row for name in part for row in places[group, name]]
            thing = part[0] if len(part) == 1 else f"{len(part)} things"
            found.append(Difference(group, thing, tuple(row[1] for row in rows), tuple(row[0] for row in rows)))
    return found


def demand_same_scene(a: World, b: World) -> None:
    """Raise SpecError where states of one world are none of the other."""
    problems = []
    bodies = [{body.name: body for body in world.bodies} for world in (a, b)]
    for name in [*bodies[0], *(name for name in bodies[1] if name not in bodies[0])]:
        entry, other = (side.get(name) for side in bodies)
        if entry is None or other is None:
            found = f"only in {'the second' if entry is None else 'the first'}"
            problems.append(Problem("the two are of different scenes", f"bodies.{name}", found=found, code="R105"))
            continue
        for field in ("kind", "parent"):
            values = getattr(entry.joint, field), getattr(other.joint, field)
            if values[0] != values[1]:
                found = f"{values[0]} in the first, {values[1]} in the second"
                problems.append(
                    Problem("the two are of different scenes", f"bodies.{name}.joint.{field}", found=found, code="R105")
                )
    if problems:
        raise SpecError(problems)


def _changes(keys: Keys, before: Any, after: Any) -> Iterator[tuple[Keys, Any, Any]]:
    if (
        isinstance(before, dict)
        and isinstance(after, dict)
        and not (keys[:1] == ("trajectory",) or keys[-1:] == ("hardness",))
    ):
        for key in [*before, *(key for key in after if key not in before)]:
            yield from _changes((*keys, key), before.get(key), after.get(key))
    elif before != after:
        yield keys, before, after


def _group(keys: Keys, lumped: bool) -> str | None:
    """The group of a place; None for what is ignored. ``lumped``: the materials have other names, and go together."""
    if any(_fits(pattern, keys) for pattern in IGNORED):
        return None
    if lumped and (keys[:2] in (("contact", "materials"), ("contact", "pairs")) or keys[-1] == "material"):
        return MATERIALS
    return next((group for pattern, group in GROUPS.items() if _fits(pattern, keys)), OTHER)


def _fits(pattern: Keys, keys: Keys) -> bool:
    return len(keys) >= len(pattern) and all(
        word in ("*", key) for word, key in zip(pattern, keys[: len(pattern)], strict=True)
    )


def _thing(keys: Keys, group: str) -> str:
    """The owner of a value, as a user would name it."""
    if group in (MATERIALS, OTHER, "collision filter"):
        return ""
    if keys[:2] == ("contact", "materials"):
        return f"{keys[2]} and {keys[2]}"
    if keys[:2] == ("contact", "pairs"):
        return " and ".join(keys[2].split("+"))
    return keys[1] if keys[0] in ("bodies", "controllers") and len(keys) > 1 else ""


def taking(world: World, other: World, taken: Iterable[Difference]) -> World:
    """``world`` with the values of ``other`` in these differences. Raises SpecError where that is no world."""
    plain, source = named_tree(world), named_tree(other)
    timestep = False
    for difference in taken:
        for keys in difference.places:
            _put(plain, source, keys)
            timestep = timestep or keys == ("physics", "timestep")
    if timestep:  # the same duration, to a step
        steps = world.physics.steps * world.physics.timestep / other.physics.timestep
        plain["physics"]["steps"] = max(1, round(steps))
    return world_of(plain)


def _put(plain: dict[str, Any], source: dict[str, Any], keys: Keys) -> None:
    *above, last = keys
    for key in above:
        plain, source = plain[key], source[key]
    if last in source:
        plain[last] = copy.deepcopy(source[last])
    else:
        del plain[last]


def world_of(named: Mapping[str, Any]) -> World:
    """The world of a tree: the inverse of :func:`named_tree`, without expectations. Raises SpecError where that is no world."""
    plain = copy.deepcopy(dict(named))
    plain["expectations"] = []
    plain["bodies"] = [
        {**body, "name": name, "shapes": _listed(body["shapes"])} for name, body in plain["bodies"].items()
    ]
    contact = plain["contact"]
    contact["materials"] = sorted(_listed(contact["materials"]), key=lambda material: material["name"])
    pairs = [(name.split("+", 1), pair) for name, pair in contact["pairs"].items()]
    contact["pairs"] = [{**pair, "first": ends[0], "second": ends[1]} for ends, pair in sorted(pairs, key=_ends)]
    for key in ("ignored_groups", "excluded_bodies"):
        contact[key] = sorted(pair.split("+", 1) for pair in contact[key])
    plain["engines"] = [
        {
            **options,
            "engine": name,
            "settings": sorted(map(list, options["settings"].items())),
            "pairs": [_pair_settings(pair, settings) for pair, settings in sorted(options.get("pairs", {}).items())],
        }
        for name, options in plain["engines"].items()
    ]
    plain["controllers"] = _listed(plain["controllers"])
    try:
        world: World = with_implicit_damping(from_plain(World, plain))
    except (KeyError, TypeError, ValueError) as error:
        raise SpecError([Problem(f"the two worlds' values do not go together: {error}", code="R105")]) from None
    return world


def _pair_settings(pair: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    first, second = pair.split("+", 1)
    return {"first": first, "second": second, "settings": sorted(map(list, settings.items()))}


def _ends(pair: tuple[list[str], Any]) -> list[str]:
    return pair[0]


def _listed(named: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [{**value, "name": name} for name, value in named.items()]
