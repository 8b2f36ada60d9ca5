"""Rules on masses, centres of mass and inertias against the shapes that should hold them."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from typing import Final

import numpy as np

from simspec.language.moments import principal_moments
from simspec.plausibility.findings import Finding, Grade
from simspec.plausibility.parts import (
    DIRECTIONS,
    Floats,
    Lump,
    Part,
    carrying,
    judged_parts,
    moving_groups,
    outside,
    pose_of,
    reach,
)
from simspec.world import inertia
from simspec.world.types import Inertial, World

OUTSIDE: Final = 0.05
"""Share of a part's size by which its centre of mass may be outside its shapes: collision shapes are often somewhat smaller."""
LEAST_OUTSIDE: Final = 1e-3
"""m: the same of small parts."""
SPREAD_OUT: Final = 2.25
"""Factor by which a second moment may exceed its bound: shapes that are smaller than the part by a third, 1.5 squared."""
SMALLER: Final = 10.0
"""Factor by which a principal moment may be below the solid's: a motor in a light housing has a fifth to a third."""
OSMIUM: Final = 22_590.0
"""kg/m³, the densest material."""
FOAM: Final = 20.0
"""kg/m³: foam has 15 to 60. Below, a part can only be hollow."""
AIR: Final = 1.2
"""kg/m³."""
PLASTIC: Final = 1000.0
"""kg/m³, of a hollow part's wall."""
THINNEST_WALL: Final = 3e-4
"""m: thinner walls are film."""
LIGHTEST: Final = 1e-4
"""kg of what a joint moves."""
LARGEST_RATIO: Final = 1000.0
"""Of the masses of two bodies that a joint joins."""
ALIKE: Final = 1e-6
"""Relative difference of three principal moments that are one number, as placeholders have."""


def mass_findings(world: World, foreign: Callable[[str], bool]) -> Iterator[Finding]:
    """All findings about masses. ``foreign``: whether a body comes from a robot file; of others those that cannot be touched
    are left out, and what does not fit the shapes is a note."""
    for part in judged_parts(world):
        grade = Grade.WARNING if foreign(part.name) else Grade.NOTE
        if foreign(part.name) or part.some(True):
            off_centre = yield from _centre(part, grade)
            yield from _inertia(part, off_centre, grade)
    yield from _densities(world, foreign)
    yield from _light(world)
    yield from _ratios(world)


def _centre(part: Part, grade: Grade) -> Generator[Finding, None, bool]:
    """Yields a finding where the centre of mass is outside; gives whether it is."""
    away = outside(part.solids, np.array(part.inertial.centre_of_mass))
    limit = max(OUTSIDE * part.size, LEAST_OUTSIDE)
    if away <= limit:
        return False
    message = f"centre of mass {1e3 * away:.3g} mm outside its shapes, {100.0 * away / part.size:.3g} % of their size"
    path = f"bodies.{part.name}.centre_of_mass"
    yield Finding("mass-outside", grade, part.name, message, away, "m", away / limit, path)
    return True


def _inertia(part: Part, off_centre: bool, grade: Grade) -> Iterator[Finding]:
    inertial = part.inertial
    moments = principal_moments(inertial.inertia)
    if min(moments) <= 0.0:
        return  # a point or a rod: a rigid group makes up for it, or resolving refuses it
    same = max(moments) - min(moments) <= ALIKE * max(moments)
    placeholder = "; equal about all axes" if same else ""
    path = f"bodies.{part.name}.inertia"
    share = 0.0 if off_centre else largest_share(inertial, part.solids, max(OUTSIDE * part.size, LEAST_OUTSIDE))
    if share > SPREAD_OUT:
        further = math.sqrt(share)
        message = f"its mass would lie {further:.3g} times as far out as its shapes reach{placeholder}"
        yield Finding("inertia-too-large", grade, part.name, message, further, "", share / SPREAD_OUT, path)
        return
    solid = solid_of(part, inertial.mass)
    if solid is None:
        return
    expected = principal_moments(solid.inertia)
    ratio, given = max((b / a, a) for a, b in zip(moments, expected, strict=True))
    if ratio > SMALLER:
        message = f"a moment of {given:.3g} kg m², {ratio:.3g} times below a solid's of its mass{placeholder}"
        yield Finding("inertia-too-small", grade, part.name, message, ratio, "", ratio / SMALLER, path)


def largest_share(inertial: Inertial, solids: tuple[Lump, ...], margin: float = 0.0) -> float:
    """The largest ratio, over directions u, of the second moment of the mass along u about its centre to the most that mass
    within the shapes can have: m·a·b with a, b the reaches from the centre of mass along u and −u (the Bhatia–Davis
    inequality); above 1 nothing within the convex hull of the shapes has this inertia. ``margin`` (m): the least of a and b."""
    xx, yy, zz, xy, xz, yz = inertial.inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    directions: Floats = np.concatenate([np.linalg.eigh(second)[1].T, DIRECTIONS])
    centre = np.array(inertial.centre_of_mass)
    middle = directions @ centre
    ahead = reach(solids, directions) - middle
    behind = reach(solids, -directions) + middle
    most = inertial.mass * np.maximum(ahead, margin) * np.maximum(behind, margin)
    given = np.einsum("ni,ij,nj->n", directions, second, directions)
    inside = most > 0.0
    return float((given[inside] / most[inside]).max(initial=0.0))


def solid_of(part: Part, total: float) -> Inertial | None:
    """The mass properties that a part of mass ``total`` (kg) has if its collision shapes (else its visual ones) are homogeneous
    solids; None without a volume."""
    solids = part.some(True) or part.some(False)
    volumes = [solid.volume for solid in solids]
    whole = math.fsum(volumes)
    if whole <= 0.0:
        return None
    pieces = [
        inertia.shape_part(solid.shape.kind, solid.shape.size, pose_of(solid), total * volume / whole)
        for solid, volume in zip(solids, volumes, strict=True)
        if volume > 0.0
    ]
    return inertia.combined_inertial(pieces, total)


def _volume(solids: tuple[Lump, ...]) -> float:
    return math.fsum(solid.volume for solid in solids)


def _densities(world: World, foreign: Callable[[str], bool]) -> Iterator[Finding]:
    for name, part in moving_groups(world).items():
        kilograms, solid = part.inertial.mass, _volume(part.some(True))
        seen = _volume(part.some(False)) if foreign(name) else 0.0
        grade = Grade.WARNING if foreign(name) else Grade.NOTE
        if not kilograms or not (solid or seen):
            continue
        path = f"bodies.{name}.mass"
        # all shapes hold at least the part; of two drawings of it the smaller one holds the least
        densest = kilograms / (solid + seen)
        if densest > OSMIUM:
            message = f"{kilograms:.3g} kg in {1e6 * (solid + seen):.3g} cm³: {densest:.3g} kg/m³, denser than osmium"
            yield Finding("density-high", grade, name, message, densest, "kg/m³", densest / OSMIUM, path)
        volume = min(value for value in (solid, seen) if value)
        density = kilograms / volume
        # no closed surface around a volume is smaller than the sphere's, (36 π V²)^(1/3)
        wall = kilograms / PLASTIC / (36.0 * math.pi * volume * volume) ** (1.0 / 3.0)
        if density < AIR or (density < FOAM and wall < THINNEST_WALL):
            message = (
                f"{kilograms:.3g} kg in {1e6 * volume:.3g} cm³: {density:.3g} kg/m³, a shell of {1e3 * wall:.2g} mm"
            )
            yield Finding("density-low", grade, name, message, density, "kg/m³", FOAM / density, path)


def _light(world: World) -> Iterator[Finding]:
    """Joints that move next to nothing, with all that hangs on them."""
    carried = {name: part.inertial.mass for name, part in moving_groups(world).items()}
    for name, carrier in reversed(carrying(world).items()):
        if name in carried and carrier in carried:
            carried[carrier] += carried[name]
    for name, kilograms in carried.items():
        if 0.0 < kilograms < LIGHTEST:
            message = f"{1e3 * kilograms:.3g} g, with all that hangs on it"
            path = f"bodies.{name}.mass"
            yield Finding("mass-tiny", Grade.NOTE, name, message, kilograms, "kg", LIGHTEST / kilograms, path)


def _ratios(world: World) -> Iterator[Finding]:
    groups = moving_groups(world)
    for name, carrier in carrying(world).items():
        if name not in groups or carrier not in groups:
            continue
        one, other = groups[name].inertial.mass, groups[carrier].inertial.mass
        if not one or not other:
            continue
        ratio = max(one, other) / min(one, other)
        if ratio > LARGEST_RATIO:
            message = f"{other:.3g} kg carries {one:.3g} kg, {ratio:.3g} times"
            path = f"bodies.{name}.joint"
            element = f"{carrier} and {name}"
            yield Finding("mass-ratio", Grade.NOTE, element, message, ratio, "", ratio / LARGEST_RATIO, path)
