"""What PyBullet's margin of 1 mm on links that are no bases costs the shapes there (see ``dialects/pybullet/hulls.py``)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from simspec.contact.plan import contact_plan
from simspec.dialects.pybullet.hulls import faces_meet, margins_of
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.settings import resolve_settings
from simspec.engines.pybullet.meshes import KEPT
from simspec.support.declarations import Level, Refinement, not_here
from simspec.world.hull import HullError
from simspec.world.inset import THINNEST, outside
from simspec.world.meeting import meeting_kinds
from simspec.world.types import Shape, World

HALVES: Final[Mapping[str, Callable[[Sequence[float]], float]]] = {
    "box": lambda size: min(size) / 2.0,
    "cylinder": lambda size: min(size[0], size[1] / 2.0),
}
"""The least half (m) of the kinds that have the margin within them, by their size."""
ROUND = ("sphere", "ellipsoid")
"""Kinds of shapes that touch a hull in one point."""
LANDING = Refinement(
    Level.APPROXIMATE,
    f"the convex hull to {KEPT:g} of its extent; while a mesh is on another link than the base of its tree, of the contacts of "
    "each one new point in a step: at rest all are there, but a hull that lands on a face is stopped at one point first, and "
    "tumbles (a cube of 10 cm that falls 10 cm by 1.2°; what is top-heavy falls over; measured: boxes do not)",
    short="a hull that lands on a face is stopped at one point first, and tumbles",
)
THICK = {
    kind: Refinement(
        Level.APPROXIMATE,
        "on a link that is no base PyBullet's margin is 1 mm, so that no box, cylinder or mesh is thinner than 2 mm there",
        short=f"a {kind} thinner than 2 mm, on a link that is no base, is felt as thick as 2 mm",
    )
    for kind in ("mesh", *HALVES)
}
"""By the kind of shape."""


def meshes_held(engine: type[Engine], world: World) -> Refinement | None:
    """Not supported where copies of a mesh are within two margins; approximate where hardly anything of one is within the
    margin, or where one on a link with that margin may land on a face, an edge or another mesh."""
    try:
        found = _outside(engine, world, "mesh")
    except ValueError as error:
        return not_here(str(error))
    plan = contact_plan(world, engine.RULES, engine.LAYERS)
    lands = any("mesh" in pair and not set(pair) & set(ROUND) for pair in meeting_kinds(world))
    landing = LANDING if lands and not faces_meet(world, plan, _base_margin(engine, world)) else None
    return _told("mesh", found, landing) if found else landing


def thick_enough(engine: type[Engine], kind: str, world: World) -> Refinement | None:
    """Approximate where boxes or cylinders are thinner than the margin that PyBullet keeps within them."""
    found = _outside(engine, world, kind)
    return _told(kind, found) if found else None


def thicker(engine: type[Engine], world: World) -> dict[str, float]:
    """By name the shapes that PyBullet holds thicker than they are, and how far (m) outside their faces are."""
    return {name: size for kind in ("mesh", *HALVES) for name, size in _outside(engine, world, kind).items()}


def _base_margin(engine: type[Engine], world: World) -> float:
    return float(str(resolve_settings(engine, world)["collision_margin"]))


def _outside(engine: type[Engine], world: World, kind: str) -> dict[str, float]:
    """Of shapes of one kind. Raises ValueError for a mesh that no margin can be told of."""
    plan, base_margin = contact_plan(world, engine.RULES, engine.LAYERS), _base_margin(engine, world)
    found: dict[str, float] = {}
    for body in world.bodies:
        margins: dict[Shape, set[float]] = {}
        for shape, margin in margins_of(kind, body, plan, base_margin):
            margins.setdefault(shape, set()).add(margin)
        for shape, of_shape in margins.items():
            short = _short(shape, of_shape)
            if short > (THINNEST if kind in HALVES else 0.0):
                found[shape.name] = short
    return found


def _short(shape: Shape, margins: set[float]) -> float:
    if shape.kind in HALVES:
        return max(margins) - HALVES[shape.kind](shape.size)
    if len(margins) > 1:
        raise ValueError(f"copies of the mesh {shape.name!r} are on links with and without PyBullet's margin")
    try:
        return outside(shape.size, max(margins))
    except HullError as error:
        raise ValueError(f"PyBullet keeps {max(margins):g} m around the mesh {shape.name!r}: {error}") from error


def _told(kind: str, found: Mapping[str, float], besides: Refinement | None = None) -> Refinement:
    name = max(found, key=lambda name: found[name])
    thick = THICK[kind]
    how = f"{thick.how}: faces of {name!r} are felt {1e3 * found[name]:.2g} mm outside of where they are, of no {kind} more"
    return Refinement(Level.APPROXIMATE, how if besides is None else f"{besides.how}; {how}", short=thick.short)
