"""Fixed tendons and equality constraints of a compiled model as sums, couplings, loops and welds of a spec."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Final

import numpy as np

from simspec.imports.mjcf.bodies import MjcfBodies, Vector, inverse, numbers, pose, product, rotated
from simspec.imports.mjcf.compiled import HINGE, SLIDE, CompiledMjcf
from simspec.imports.mjcf.contact import SOLIMP, SOLREF, MjcfSurfaces

OF_JOINT: Final = 1
"""The type of a part of a tendon that is a joint."""
FORCES: Final = ("stiffness", "damping", "frictionloss", "armature")
"""Passive effects of a tendon, in addition to its limits."""
SAID: Final = {"stiffness": "stiffness", "frictionloss": "dry_friction", "damping": "damping"}
"""Those that a sum of a spec has, and their words there."""
UNSAID: Final = ("stiffnesspoly", "dampingpoly", "springyield")
"""Arrays of laws that are not linear, where a version has them."""

Terms = Mapping[int, float]
"""Coefficients by the numbers of joints."""


def terms(model: CompiledMjcf, number: int) -> Terms | None:
    """The sum of joint positions that is the length of a tendon; None for one that runs through space."""
    first = int(model["tendon_adr"][number])
    summed: dict[int, float] = {}
    for part in range(first, first + int(model["tendon_num"][number])):
        joint = int(model["wrap_objid"][part])
        if int(model["wrap_type"][part]) != OF_JOINT or int(model["jnt_type"][joint]) not in (SLIDE, HINGE):
            return None
        summed[joint] = summed.get(joint, 0.0) + float(model["wrap_prm"][part])
    return {joint: coefficient for joint, coefficient in summed.items() if coefficient}


def fixed_sum(model: CompiledMjcf, number: int) -> tuple[Terms, float] | None:
    """The sum of joint positions, from the reference on, that an equality of one or two tendons keeps at a value; None where
    there is no such sum."""
    first, second = _objects(model, number)
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


def _objects(model: CompiledMjcf, number: int) -> tuple[int, int]:
    return int(model["eq_obj1id"][number]), int(model["eq_obj2id"][number])


def range_of(model: CompiledMjcf, number: int, summed: Terms) -> tuple[float, float]:
    """The limits of a fixed tendon, as those of the sum of joint positions from the reference on."""
    reference = reference_of(model, summed)
    lower, upper = (float(value) for value in model["tendon_range"][number])
    return lower - reference, upper - reference


def reference_of(model: CompiledMjcf, summed: Terms) -> float:
    """The length of a fixed tendon at the reference configuration."""
    return sum(part * float(model["qpos0"][int(model["jnt_qposadr"][joint])]) for joint, part in summed.items())


def add_tendons(bodies: MjcfBodies, actual: Mapping[int, float], constraints: dict[str, Any]) -> None:
    """Give joints the properties of tendons of one joint, and add the others to the ``constraints`` of the spec; the rest is a
    feature. ``actual``: the values at which constraints keep tendons, by their number: no force along such a tendon moves
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
        elif number in actual:
            lower, upper = range_of(model, number, summed)
            if limited and not lower <= actual[number] <= upper:
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


def _sum(bodies: MjcfBodies, number: int, summed: Terms, acting: list[str], limited: bool) -> dict[str, Any] | None:
    """A sum of the spec, of joint positions from the reference on; None where the language does not say it."""
    model = bodies.model
    if not summed or not set(acting) <= SAID.keys() or any(_nonlinear(model, word, number) for word in UNSAID):
        return None
    shift = reference_of(model, summed)
    slack, taut = (float(value) - shift for value in model["tendon_lengthspring"][number])
    if "stiffness" in acting and slack != taut:
        return None
    made: dict[str, Any] = {"joints": {bodies.joint_name(joint): coefficient for joint, coefficient in summed.items()}}
    for word, key in SAID.items():
        if word in acting:
            made[key] = float(model[f"tendon_{word}"][number])
            if key == "stiffness" and slack:
                made["rest"] = slack
    if limited:
        lower, upper = range_of(model, number, summed)
        begins = sum(part * bodies.joint_data(joint).get("position", 0.0) for joint, part in summed.items())
        if not lower <= begins <= upper or lower == upper:
            return None
        made["limits"] = {"position": [lower, upper]}
    return made


def _nonlinear(model: CompiledMjcf, word: str, number: int) -> bool:
    values = model.get(f"tendon_{word}")
    return values is not None and bool(values[number].any())


def _limit(bodies: MjcfBodies, allowed: tuple[float, float], summed: Terms) -> bool:
    """Whether limits of joints keep a sum of their positions within its range: those that they have, or, of one joint alone,
    those that it is given."""
    lower, upper = allowed
    if len(summed) == 1:
        ((joint, coefficient),) = summed.items()
        least, most = sorted((lower / coefficient, upper / coefficient))
        data = bodies.joint_data(joint)
        position = data.get("limits", {}).get("position")
        least, most = (least, most) if position is None else (max(least, position[0]), min(most, position[1]))
        if not least <= 0.0 <= most:
            return position is not None and bool([least, most] == position)
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


def without_effect(model: CompiledMjcf, actual: Collection[int]) -> list[Terms]:
    """The sums along which forces move nothing."""
    return [summed for number in actual if (summed := terms(model, number)) is not None]


def as_follow(summed: Terms, value: float) -> tuple[int, int, float, float] | None:
    """A joint, the one that it follows, the ratio and the offset, of a sum of two joint positions that is kept at a value; None
    where there are not two."""
    if len(summed) != 2:
        return None
    index, two = summed
    return index, two, -summed[two] / summed[index], value / summed[index]


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


CONNECT, WELD, JOINT, TENDON = range(4)
"""Types of equality constraints; the others are of deformable bodies."""
BODY, SITE = 1, 6
"""Types of objects."""
FITS: Final = 1e-6
"""m and rad by which the reference configuration may miss a loop; beyond it the spec's language refuses the loop."""


def add_constraints(bodies: MjcfBodies, surfaces: MjcfSurfaces) -> dict[str, Any]:
    """``constraints`` of the spec; those that the language does not have are features."""
    model, features = bodies.model, bodies.features
    constraints: dict[str, Any] = {}
    leaders: dict[int, int] = {}
    for number, part in model.parts["equality"].items():
        if not bool(model["eq_active0"][number]) or model.disabled("equality", "constraint"):
            features.add("equality.inactive", part.element)
            continue
        made = _made(bodies, number, leaders)
        if made is None:
            features.add("equality", part.element)
            continue
        name = bodies.constraint_names.give(part.name, f"constraint_{len(constraints) + 1}")
        constraints[name] = made
        features.carry(part.element)
        bodies.constraint_places[name] = part.element.location
        if (*model["eq_solref"][number], *model["eq_solimp"][number]) != (*SOLREF, *SOLIMP):
            features.add("equality.softness", part.element)
        if int(model["eq_type"][number]) not in (JOINT, TENDON):
            surfaces.looped(*_joined(bodies, number))
    return constraints


def _made(bodies: MjcfBodies, number: int, leaders: dict[int, int]) -> dict[str, Any] | None:
    """One constraint; None where the language does not say it. ``leaders``: of each joint that follows its leader."""
    kind = int(bodies.model["eq_type"][number])
    if kind == JOINT:
        return _follow(bodies, number, leaders)
    if kind == TENDON:
        return _of_tendons(bodies, number, leaders)
    if kind in (CONNECT, WELD) and int(bodies.model["eq_objtype"][number]) in (BODY, SITE):
        return _loop(bodies, number, kind)
    return None


def _joined(bodies: MjcfBodies, number: int) -> tuple[int, int]:
    """The two bodies that a loop joins, also where it is written by sites in them."""
    index, two = _objects(bodies.model, number)
    if int(bodies.model["eq_objtype"][number]) == SITE:
        return int(bodies.model["site_bodyid"][index]), int(bodies.model["site_bodyid"][two])
    return index, two


def _closing_frames(bodies: MjcfBodies, number: int, kind: int) -> tuple[Vector, Vector, Vector]:
    """Where a loop holds its bodies together: the point in the first body, the point in the second one, and the rotation of the
    second body in the first, of a weld; in the file's frames of the bodies."""
    model = bodies.model
    data = model["eq_data"][number]
    if int(model["eq_objtype"][number]) == SITE:
        index, two = _objects(model, number)
        turn = product(model["site_quat"][index], inverse(model["site_quat"][two]))
        return model["site_pos"][index], model["site_pos"][two], turn
    if kind == CONNECT:
        return data[0:3], data[3:6], np.array([1.0, 0.0, 0.0, 0.0])
    return data[3:6], data[0:3], data[6:10] / np.linalg.norm(data[6:10])


def _follow(bodies: MjcfBodies, number: int, leaders: dict[int, int]) -> dict[str, Any] | None:
    model = bodies.model
    follower, leader = _objects(model, number)
    offset, ratio, *higher = (float(value) for value in model["eq_data"][number][:5])
    if leader < 0 or ratio == 0.0 or any(higher):
        return None
    if any(int(model["jnt_type"][joint]) not in (SLIDE, HINGE) for joint in (follower, leader)):
        return None
    return _coupling(bodies, leaders, follower, leader, ratio, offset)


def _of_tendons(bodies: MjcfBodies, number: int, leaders: dict[int, int]) -> dict[str, Any] | None:
    """A sum of two joint positions that is kept at a value."""
    actual = fixed_sum(bodies.model, number)
    coupled = None if actual is None else as_follow(*actual)
    made = None if coupled is None else _coupling(bodies, leaders, *coupled)
    if actual is not None and made is not None and int(bodies.model["eq_obj2id"][number]) < 0:
        bodies.fixed_tendons[int(bodies.model["eq_obj1id"][number])] = actual[1]
    return made


def _coupling(
    bodies: MjcfBodies, leaders: dict[int, int], index: int, two: int, ratio: float, offset: float
) -> dict[str, Any] | None:
    """Two joints of which one follows the other; None where both follow already, or would begin beyond limits."""
    ways = ((index, two, ratio, offset), (two, index, 1.0 / ratio, -offset / ratio))
    for follower, leader, factor, shift in ways:
        data, lead = bodies.joint_data(follower), bodies.joint_data(leader)
        begins = factor * lead.get("position", 0.0) + shift
        lower, upper = data.get("limits", {}).get("position", (begins, begins))
        if follower in leaders or leads_to(leader, follower, leaders) or not lower <= begins <= upper:
            continue
        leaders[follower] = leader
        bodies.leave_start(follower)
        said: dict[str, Any] = {"joint": bodies.joint_name(follower), "leader": bodies.joint_name(leader)}
        said["ratio"] = factor
        if shift:
            said["offset"] = shift
        return {"follow": said}
    return None


def _loop(bodies: MjcfBodies, number: int, kind: int) -> dict[str, Any] | None:
    index, two = _joined(bodies, number)
    if bodies.model["body_weldid"][index] == bodies.model["body_weldid"][two]:
        return None  # they are one already, or neither moves
    first_point, second_point, turn = _closing_frames(bodies, number, kind)
    first, second = bodies.shifts[index], bodies.shifts[two]
    if kind == CONNECT:
        at, other = first_point - first, second_point - second
        if not _fits(bodies.reference(index, at)[0], bodies.reference(two, other)[0]):
            return None
        ends = [(bodies.initial(body, point), point) for body, point in ((index, at), (two, other))]
        if not _fits(ends[0][0][0], ends[1][0][0]) and not _moved(bodies, (index, two), ends):
            return None
        names = [bodies.named(index), bodies.named(two)]
        return {"connect": {"bodies": names, "at": numbers(at), "second_at": numbers(other)}}
    place = first_point - rotated(turn, second_point) + rotated(turn, second) - first
    values, stored_turn = bodies.reference(index, place)
    actual, actual_turn = bodies.reference(two, np.zeros(3))
    if not _fits(values, actual) or not _alike(product(stored_turn, turn), actual_turn):
        return None
    (values, stored_turn), (actual, actual_turn) = bodies.initial(index, place), bodies.initial(two, np.zeros(3))
    if not _fits(values, actual) or not _alike(product(stored_turn, turn), actual_turn):
        ends = [((values, product(stored_turn, turn)), place), ((actual, actual_turn), np.zeros(3))]
        if not _moved(bodies, (index, two), ends, turn):
            return None
    return {"weld": {"bodies": [bodies.named(index), bodies.named(two)], "pose": pose(place, turn)}}


def _moved(
    bodies: MjcfBodies,
    actual: tuple[int, int],
    ends: list[tuple[tuple[Vector, Vector], Vector]],
    turn: Vector | None = None,
) -> bool:
    """Whether a loop that limits of joints keep open initially is closed by another place of the one of its bodies that a
    program moves. ``ends``: of each body where its end of the loop is initially, with the orientation of the body (of a weld's
    first, that which it wants of the second), and the point in the body; ``turn``: of the second body in the first, of a
    weld."""
    for number, other in ((0, 1), (1, 0)):
        if not bodies.stands_alone(actual[number]):
            continue
        (there, wanted), point = ends[other][0], ends[number][1]
        if turn is None:
            wanted = bodies.initial(actual[number], point)[1]
        elif number == 0:
            wanted = product(wanted, inverse(turn))
        bodies.stand(actual[number], there - rotated(wanted, point), wanted)
        return True
    return False


def _fits(vector: Vector, two: Vector) -> bool:
    return float(np.abs(vector - two).max()) < FITS


def _alike(vector: Vector, two: Vector) -> bool:
    return 2.0 * float(np.linalg.norm(product(inverse(vector), two)[1:])) < FITS
