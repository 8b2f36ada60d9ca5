"""Fixed tendons of a compiled model, which are sums of joint positions: as sums of a spec, where joints, their limits and
`follow` do not say them already."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Final

from simspec.imports.mjcf.bodies import Bodies
from simspec.imports.mjcf.compiled import HINGE, SLIDE, Compiled

OF_JOINT: Final = 1
"""The type of a part of a tendon that is a joint."""
FORCES: Final = ("stiffness", "damping", "frictionloss", "armature")
"""What a tendon acts by, beside its limits."""
SAID: Final = {"stiffness", "damping", "frictionloss"}
"""What of it a sum of a spec has."""
UNSAID: Final = ("stiffnesspoly", "dampingpoly", "springyield")
"""Arrays of laws that are not linear, where a version has them."""

Terms = Mapping[int, float]
"""Coefficients by the numbers of joints."""


def terms(model: Compiled, number: int) -> Terms | None:
    """The sum of joint positions that is the length of a tendon; None for one that runs through space."""
    first = int(model["tendon_adr"][number])
    summed: dict[int, float] = {}
    for part in range(first, first + int(model["tendon_num"][number])):
        joint = int(model["wrap_objid"][part])
        if int(model["wrap_type"][part]) != OF_JOINT or int(model["jnt_type"][joint]) not in (SLIDE, HINGE):
            return None
        summed[joint] = summed.get(joint, 0.0) + float(model["wrap_prm"][part])
    return {joint: coefficient for joint, coefficient in summed.items() if coefficient}


def held_sum(model: Compiled, number: int) -> tuple[Terms, float] | None:
    """The sum of joint positions, from the reference on, that an equality of one or two tendons keeps at a value; None where
    there is no such sum."""
    first, second = (int(model[f"eq_obj{which}id"][number]) for which in (1, 2))
    value, ratio, *higher = (float(coefficient) for coefficient in model["eq_data"][number][:5])
    summed = terms(model, first)
    if summed is None or second < 0:
        return None if summed is None else (summed, value)
    other = terms(model, second)
    if other is None or any(higher):
        return None
    both = dict(summed)
    for joint, coefficient in other.items():
        both[joint] = both.get(joint, 0.0) - ratio * coefficient
    return {joint: coefficient for joint, coefficient in both.items() if coefficient}, value


def range_of(model: Compiled, number: int, summed: Terms) -> tuple[float, float]:
    """The limits of a fixed tendon, as those of the sum of joint positions from the reference on."""
    reference = reference_of(model, summed)
    lower, upper = (float(value) for value in model["tendon_range"][number])
    return lower - reference, upper - reference


def reference_of(model: Compiled, summed: Terms) -> float:
    """The length of a fixed tendon at the reference configuration."""
    return sum(
        coefficient * float(model["qpos0"][int(model["jnt_qposadr"][joint])]) for joint, coefficient in summed.items()
    )


def add_tendons(bodies: Bodies, held: Mapping[int, float], constraints: dict[str, Any]) -> None:
    """Give joints what tendons say of them alone, and add the others to the ``constraints`` of the spec; what nothing says is a
    feature. ``held``: the values at which constraints keep tendons, by their number: no force along such a tendon moves
    anything."""
    model, features = bodies.model, bodies.features
    off = {"stiffness": "spring", "damping": "damper", "frictionloss": "frictionloss"}
    limits = not model.disabled("limit", "constraint")
    for number, part in model.parts["tendon"].items():
        acting = [word for word in FORCES if model[f"tendon_{word}"][number].any()]
        acting = [word for word in acting if word not in off or not model.disabled(off[word])]
        limited = bool(model["tendon_limited"][number]) and limits
        summed = terms(model, number)
        if not acting and not limited and not model["tendon_actfrclimited"][number].any():
            features.add("tendon.passive", part.element)
        elif summed is None or model["tendon_actfrclimited"][number].any():
            features.add("tendon", part.element)
        elif number in held:
            lower, upper = range_of(model, number, summed)
            if limited and not lower <= held[number] <= upper:
                features.add("tendon", part.element)
            else:
                features.carry(part.element)
        elif not acting and _limit(bodies, range_of(model, number, summed), summed):
            features.carry(part.element)
        elif (made := _sum(bodies, number, summed, acting, limited)) is None:
            features.add("tendon", part.element)
        else:
            name = bodies.constraint_names.give(part.name, f"constraint_{len(constraints) + 1}")
            constraints[name] = {"sum": made}
            features.carry(part.element)
            bodies.constraint_places[name] = part.element.location


def _sum(bodies: Bodies, number: int, summed: Terms, acting: list[str], limited: bool) -> dict[str, Any] | None:
    """A sum of the spec, of joint positions from the reference on; None where the language does not say it."""
    model = bodies.model
    if not summed or not set(acting) <= SAID or any(_nonlinear(model, word, number) for word in UNSAID):
        return None
    shift = reference_of(model, summed)
    slack, taut = (float(value) - shift for value in model["tendon_lengthspring"][number])
    if "stiffness" in acting and slack != taut:
        return None
    made: dict[str, Any] = {"joints": {bodies.joint_name(joint): coefficient for joint, coefficient in summed.items()}}
    if "stiffness" in acting:
        made["stiffness"] = float(model["tendon_stiffness"][number])
        if slack:
            made["rest"] = slack
    if "frictionloss" in acting:
        made["dry_friction"] = float(model["tendon_frictionloss"][number])
    if "damping" in acting:
        made["damping"] = float(model["tendon_damping"][number])
    if limited:
        lower, upper = range_of(model, number, summed)
        begins = sum(
            coefficient * bodies.joint_data(joint).get("position", 0.0) for joint, coefficient in summed.items()
        )
        if not lower <= begins <= upper or lower == upper:
            return None
        made["limits"] = {"position": [lower, upper]}
    return made


def _nonlinear(model: Compiled, word: str, number: int) -> bool:
    values = model.get(f"tendon_{word}")
    return values is not None and bool(values[number].any())


def _limit(bodies: Bodies, allowed: tuple[float, float], summed: Terms) -> bool:
    """Whether limits of joints keep a sum of their positions within its range: those that they have, or, of one joint alone,
    those that it is given."""
    lower, upper = allowed
    if len(summed) == 1:
        ((joint, coefficient),) = summed.items()
        least, most = sorted((lower / coefficient, upper / coefficient))
        data = bodies.joint_data(joint)
        own = data.get("limits", {}).get("position")
        least, most = (least, most) if own is None else (max(least, own[0]), min(most, own[1]))
        if not least <= 0.0 <= most:
            return own is not None and bool([least, most] == own)
        data.setdefault("limits", {})["position"] = [least, most]
        return True
    ends = [bodies.joint_data(joint).get("limits", {}).get("position") for joint in summed]
    if any(end is None for end in ends):
        return False
    spans = [
        sorted(coefficient * value for value in end)
        for coefficient, end in zip(summed.values(), ends, strict=True)
        if end is not None
    ]
    within: bool = lower <= sum(span[0] for span in spans) and sum(span[1] for span in spans) <= upper
    return within


def without_effect(model: Compiled, held: Collection[int]) -> list[Terms]:
    """The sums along which forces move nothing."""
    return [summed for number in held if (summed := terms(model, number)) is not None]


def as_follow(summed: Terms, value: float) -> tuple[int, int, float, float] | None:
    """A joint, the one that it follows, the ratio and the offset, of a sum of two joint positions that is kept at a value; None
    where there are not two."""
    if len(summed) != 2:
        return None
    one, two = summed
    return one, two, -summed[two] / summed[one], value / summed[one]


def leads_to(joint: int, other: int, leaders: Mapping[int, int]) -> bool:
    """Whether a joint is another one, or follows it, by whatever many."""
    seen: set[int] = set()
    at: Any = joint
    while at is not None and at not in seen:
        if at == other:
            return True
        seen.add(at)
        at = leaders.get(at)
    return False
