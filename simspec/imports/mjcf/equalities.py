"""Equality constraints of a compiled model as constraints of a spec: joints that follow others, loops, welds."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from simspec.imports.mjcf.bodies import Bodies, Vector, inverse, numbers, pose, product, rotated
from simspec.imports.mjcf.compiled import HINGE, SLIDE
from simspec.imports.mjcf.surfaces import SOLIMP, SOLREF, Surfaces
from simspec.imports.mjcf.tendons import as_follow, held_sum, leads_to

CONNECT, WELD, JOINT, TENDON = range(4)
"""Types of equality constraints; the others are of deformable bodies."""
BODY, SITE = 1, 6
"""Types of objects."""
FITS: Final = 1e-6
"""m and rad by which the reference configuration may miss a loop; beyond it the spec's language refuses the loop."""


def add_constraints(bodies: Bodies, surfaces: Surfaces) -> dict[str, Any]:
    """``constraints`` of the spec; what it does not say is a feature."""
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


def _made(bodies: Bodies, number: int, leaders: dict[int, int]) -> dict[str, Any] | None:
    """One constraint; None where the language does not say it. ``leaders``: of each joint that follows its leader."""
    kind = int(bodies.model["eq_type"][number])
    if kind == JOINT:
        return _follow(bodies, number, leaders)
    if kind == TENDON:
        return _of_tendons(bodies, number, leaders)
    if kind in (CONNECT, WELD) and int(bodies.model["eq_objtype"][number]) in (BODY, SITE):
        return _loop(bodies, number, kind)
    return None


def _joined(bodies: Bodies, number: int) -> tuple[int, int]:
    """The two bodies that a loop joins, also where it is written by sites in them."""
    one, two = (int(bodies.model[f"eq_obj{which}id"][number]) for which in (1, 2))
    if int(bodies.model["eq_objtype"][number]) == SITE:
        one, two = (int(bodies.model["site_bodyid"][site]) for site in (one, two))
    return one, two


def _held(bodies: Bodies, number: int, kind: int) -> tuple[Vector, Vector, Vector]:
    """Where a loop holds its bodies together: the point in the first body, the point in the second one, and the rotation of the
    second body in the first, of a weld; in the file's frames of the bodies."""
    model = bodies.model
    data = model["eq_data"][number]
    if int(model["eq_objtype"][number]) == SITE:
        one, two = (int(model[f"eq_obj{which}id"][number]) for which in (1, 2))
        turn = product(model["site_quat"][one], inverse(model["site_quat"][two]))
        return model["site_pos"][one], model["site_pos"][two], turn
    if kind == CONNECT:
        return data[0:3], data[3:6], np.array([1.0, 0.0, 0.0, 0.0])
    return data[3:6], data[0:3], data[6:10] / np.linalg.norm(data[6:10])


def _follow(bodies: Bodies, number: int, leaders: dict[int, int]) -> dict[str, Any] | None:
    model = bodies.model
    follower, leader = (int(model[f"eq_obj{which}id"][number]) for which in (1, 2))
    offset, ratio, *higher = (float(value) for value in model["eq_data"][number][:5])
    if leader < 0 or ratio == 0.0 or any(higher):
        return None
    if any(int(model["jnt_type"][joint]) not in (SLIDE, HINGE) for joint in (follower, leader)):
        return None
    return _coupling(bodies, leaders, follower, leader, ratio, offset)


def _of_tendons(bodies: Bodies, number: int, leaders: dict[int, int]) -> dict[str, Any] | None:
    """A sum of two joint positions that is kept at a value."""
    held = held_sum(bodies.model, number)
    coupled = None if held is None else as_follow(*held)
    made = None if coupled is None else _coupling(bodies, leaders, *coupled)
    if held is not None and made is not None and int(bodies.model["eq_obj2id"][number]) < 0:
        bodies.held_tendons[int(bodies.model["eq_obj1id"][number])] = held[1]
    return made


def _coupling(
    bodies: Bodies, leaders: dict[int, int], one: int, two: int, ratio: float, offset: float
) -> dict[str, Any] | None:
    """Two joints of which one follows the other; None where both follow already, or would begin beyond limits."""
    ways = ((one, two, ratio, offset), (two, one, 1.0 / ratio, -offset / ratio))
    for follower, leader, factor, shift in ways:
        own, lead = bodies.joint_data(follower), bodies.joint_data(leader)
        begins = factor * lead.get("position", 0.0) + shift
        lower, upper = own.get("limits", {}).get("position", (begins, begins))
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


def _loop(bodies: Bodies, number: int, kind: int) -> dict[str, Any] | None:
    one, two = _joined(bodies, number)
    if bodies.model["body_weldid"][one] == bodies.model["body_weldid"][two]:
        return None  # they are one already, or neither moves
    first_point, second_point, turn = _held(bodies, number, kind)
    first, second = bodies.shifts[one], bodies.shifts[two]
    if kind == CONNECT:
        at, other = first_point - first, second_point - second
        if not _fits(bodies.reference(one, at)[0], bodies.reference(two, other)[0]):
            return None
        ends = [(bodies.initial(body, point), point) for body, point in ((one, at), (two, other))]
        if not _fits(ends[0][0][0], ends[1][0][0]) and not _moved(bodies, (one, two), ends):
            return None
        names = [bodies.named(one), bodies.named(two)]
        return {"connect": {"bodies": names, "at": numbers(at), "second_at": numbers(other)}}
    place = first_point - rotated(turn, second_point) + rotated(turn, second) - first
    held, held_turn = bodies.reference(one, place)
    actual, actual_turn = bodies.reference(two, np.zeros(3))
    if not _fits(held, actual) or not _alike(product(held_turn, turn), actual_turn):
        return None
    (held, held_turn), (actual, actual_turn) = bodies.initial(one, place), bodies.initial(two, np.zeros(3))
    if not _fits(held, actual) or not _alike(product(held_turn, turn), actual_turn):
        ends = [((held, product(held_turn, turn)), place), ((actual, actual_turn), np.zeros(3))]
        if not _moved(bodies, (one, two), ends, turn):
            return None
    return {"weld": {"bodies": [bodies.named(one), bodies.named(two)], "pose": pose(place, turn)}}


def _moved(
    bodies: Bodies, held: tuple[int, int], ends: list[tuple[tuple[Vector, Vector], Vector]], turn: Vector | None = None
) -> bool:
    """Whether a loop that limits of joints keep open initially is closed by another place of the one of its bodies that a
    program moves. ``ends``: of each body where its end of the loop is initially, with the orientation of the body (of a weld's
    first, that which it wants of the second), and the point in the body; ``turn``: of the second body in the first, of a
    weld."""
    for number, other in ((0, 1), (1, 0)):
        if not bodies.stands_alone(held[number]):
            continue
        (there, wanted), point = ends[other][0], ends[number][1]
        if turn is None:
            wanted = bodies.initial(held[number], point)[1]
        elif number == 0:
            wanted = product(wanted, inverse(turn))
        bodies.stand(held[number], there - rotated(wanted, point), wanted)
        return True
    return False


def _fits(one: Vector, two: Vector) -> bool:
    return float(np.abs(one - two).max()) < FITS


def _alike(one: Vector, two: Vector) -> bool:
    return 2.0 * float(np.linalg.norm(product(inverse(one), two)[1:])) < FITS
