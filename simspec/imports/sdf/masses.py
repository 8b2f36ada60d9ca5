"""Masses that no body can have, or that are missing, in what joints of SDF move: the rules of repair that give them.

A link without `<inertial>` has 1 kg and a unit inertia in SDF, so that only masses of 0 or below are missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Final

from simspec.imports.draft import (
    FROM_SHAPES,
    MOMENTS,
    NOT_POSITIVE,
    OF_SHAPES,
    OF_SHAPES_OR_BALL,
    Draft,
    ball,
    even,
    given,
    plain,
    shown,
    solids_of,
)
from simspec.imports.sdf.trees import SdfBodyRead, SdfModelRead
from simspec.language.moments import principal_moments

RULES: Final = {FROM_SHAPES: OF_SHAPES, NOT_POSITIVE: OF_SHAPES_OR_BALL}
"""Rules of repair, with what they do."""
OF_MASS: Final = ("mass", "centre_of_mass", "inertia")


def give_masses(models: Sequence[SdfModelRead], draft: Draft, density: float) -> None:
    """Give what moves its masses and moments by the rules that are requested, and report what no rule repairs. ``density``:
    kg/m³ of :data:`FROM_SHAPES`."""
    for model in models:
        for group in _moving(model):
            # a free root without mass is fixed by another rule
            has_none = group[0].joint is not None and not any(
                _mass(body) > 0.0 or any("density" in shape.data for shape in body.content.shapes) for body in group
            )
            for body in group:
                if _mass(body) < 0.0 or (has_none and (body is group[0] or solids_of(body.content.shapes))):
                    _give_mass(body, draft, density)
                elif (why := _wrong_moments(body, len(group) == 1)) is not None:
                    _give_moments(body, why, draft)


def _moving(model: SdfModelRead) -> Iterator[list[SdfBodyRead]]:
    """Bodies that move as one, free or below a joint that moves them, the first nearest to the root."""
    top: dict[int, SdfBodyRead] = {}
    groups: dict[int, list[SdfBodyRead]] = {}
    for body in model.bodies:
        rigid = body.joint is None or body.joint.kind == "fixed"
        head = top[id(body.parent)] if body.parent is not None and rigid else body
        top[id(body)] = head
        groups.setdefault(id(head), []).append(body)
    for group in groups.values():
        head = group[0]
        if not head.static and (head.joint is None or head.joint.kind != "fixed"):
            yield group


def _mass(body: SdfBodyRead) -> float:
    mass: float = body.content.mass.get("mass", 0.0)
    return mass


def _give_mass(body: SdfBodyRead, draft: Draft, density: float) -> None:
    element = body.content.inertial or body.element
    solids, before = solids_of(body.content.shapes), _mass(body)
    found = f"{before:g} kg" if before else None
    if not solids:
        return draft.defect(element, "a moving body has no mass, and no shapes that it could follow from", found=found)
    if not draft.repairing(FROM_SHAPES):
        return draft.defect(element, "a moving body has no mass", FROM_SHAPES, found)
    for word in OF_MASS:
        body.content.mass.pop(word, None)
    for shape in solids:
        shape.data["density"] = plain(density)
        shape.fill()
    body.content.given.append((FROM_SHAPES, given(body.name, before, solids, density), "shapes"))
    return None


def _wrong_moments(body: SdfBodyRead, alone: bool) -> tuple[float, ...] | None:
    """The principal moments of a body with a mass, where one is below 0, or 0 in a body that moves ``alone``."""
    said = body.content.mass.get("inertia")
    if said is None or _mass(body) <= 0.0:
        return None
    principal = [*said.get("principal", ()), 0.0, 0.0, 0.0]
    moments = principal_moments([said["tensor"].get(name, 0.0) for name in MOMENTS] if "tensor" in said else principal)
    return moments if min(moments) < 0.0 or (alone and min(moments) == 0.0) else None


def _give_moments(body: SdfBodyRead, moments: Sequence[float], draft: Draft) -> None:
    element = body.content.inertial or body.element
    if not draft.repairing(NOT_POSITIVE):
        message = "the principal moments of what moves must be above 0"
        return draft.defect(element, message, NOT_POSITIVE, f"{shown(moments)} kg m²")
    moment, what = ball(_mass(body))
    if solids := solids_of(body.content.shapes):
        body.content.mass.pop("centre_of_mass", None)
        del body.content.mass["inertia"]
        for shape in solids:
            shape.fill()
        count = sum(shape.is_open for shape in solids)
        what = even(_mass(body)) + (f" ({count} not closed: the hull is filled)" if count else "")
    else:
        body.content.mass["inertia"] = {"principal": [moment] * 3}
    body.content.given.append((NOT_POSITIVE, f"{body.name}: {what}", "mass"))
    return None


def silent(model: SdfModelRead) -> list[SdfBodyRead]:
    """Bodies of a model that do not touch each other: colliding ones without ``self_collide``. [] where the joints between them
    say as much."""
    bodies = [
        body
        for body in model.bodies
        if not body.self_collide and any(shape.surface is not None for shape in body.content.shapes)
    ]
    separate = [
        pair for pair in combinations(bodies, 2) if pair[0].parent is not pair[1] and pair[1].parent is not pair[0]
    ]
    return bodies if separate else []


def excluded(bodies: list[SdfBodyRead]) -> list[list[str]]:
    """Every pair of bodies that do not touch, but those that a joint connects."""
    return [
        [first.name, second.name]
        for first, second in combinations(bodies, 2)
        if first.parent is not second and second.parent is not first
    ]
