"""What PyBullet's margin of 1 mm on links that are no bases costs the shapes there (see ``dialects/pybullet/hulls.py``)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from simspec.contact.plan import contact_plan
from simspec.dialects.pybullet.hulls import faces_meet, margins_of
from simspec.engines.kit.blunt import BLUNT, blunted
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.settings import resolve_settings
from simspec.engines.pybullet.meshes import KEPT
from simspec.support.declarations import Level, Refinement, unsupported_if
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
DULL = {
    "cylinder": Refinement(
        Level.APPROXIMATE,
        f"the curved side of a cylinder of 1 to 30 mm length is felt up to {1e3 * BLUNT:g} mm inside of where it is (measured)",
        short=f"the side of a short cylinder is felt up to {1e3 * BLUNT:g} mm inside of where it is",
    ),
    "mesh": Refinement(
        Level.APPROXIMATE,
        f"faces of a hull with edges shorter than 1 cm are felt up to {1e3 * BLUNT:g} mm inside of where they are (measured)",
        short=f"faces of a fine hull are felt up to {1e3 * BLUNT:g} mm inside of where they are",
    ),
}
"""By the kind of shape."""


def meshes_held(engine: type[Engine], world: World) -> Refinement | None:
    """Not supported where copies of a mesh are within two margins; approximate where hardly anything of one is within the
    margin, or where one on a link with that margin may land on a face, an edge or another mesh."""
    try:
        found = _outside(engine, world, "mesh")
    except ValueError as error:
        return unsupported_if(str(error))
    plan = contact_plan(world, engine.RULES, engine.LAYERS)
    lands = any("mesh" in pair and not set(pair) & set(ROUND) for pair in meeting_kinds(world))
    landing = LANDING if lands and not faces_meet(world, plan, _base_margin(engine, world)) else None
    return _together(landing, _blunt("mesh", world), _told("mesh", found) if found else None)


def thick_enough(engine: type[Engine], kind: str, world: World) -> Refinement | None:
    """Approximate where boxes or cylinders are thinner than the margin that PyBullet keeps within them, and where cylinders
    are so short that their sides are felt inside."""
    found = _outside(engine, world, kind)
    return _together(_blunt(kind, world), _told(kind, found) if found else None)


def thicker(engine: type[Engine], world: World) -> dict[str, float]:
    """By name the shapes whose faces PyBullet holds elsewhere than they are, and how far (m) outside or inside they are."""
    blunt = dict.fromkeys((shape.name for kind in DULL for shape in blunted(kind, world)), BLUNT)
    thick = {name: size for kind in ("mesh", *HALVES) for name, size in _outside(engine, world, kind).items()}
    return {name: max(blunt.get(name, 0.0), thick.get(name, 0.0)) for name in (blunt | thick)}


def _blunt(kind: str, world: World) -> Refinement | None:
    """Approximate where shapes of a kind are felt inside of where they are."""
    found = list(blunted(kind, world))
    if not found:
        return None
    dull = DULL[kind]
    return Refinement(Level.APPROXIMATE, f"{dull.how}: {found[0].name!r}", short=dull.short)


def _together(*parts: Refinement | None) -> Refinement | None:
    """One of several approximations, or all of them in the order given."""
    found = [part for part in parts if part is not None]
    if len(found) < 2:
        return found[0] if found else None
    how = "; ".join(part.how for part in found if part.how)
    return Refinement(Level.APPROXIMATE, how, short="; ".join(part.short for part in found if part.short))


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


def _told(kind: str, found: Mapping[str, float]) -> Refinement:
    name = max(found, key=lambda name: found[name])
    thick = THICK[kind]
    how = f"{thick.how}: faces of {name!r} are felt {1e3 * found[name]:.2g} mm outside of where they are, of no {kind} more"
    return Refinement(Level.APPROXIMATE, how, short=thick.short)
