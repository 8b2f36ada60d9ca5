"""Mass properties that no body has, or that are missing: the rules of repair that several languages share."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final, Protocol, TypeVar

from simspec.errors import Problem
from simspec.language.foreign import RequestedRepairs
from simspec.language.quantities import Number
from simspec.language.strict import Faults

S = TypeVar("S", bound="Solid")
Six = tuple[float, float, float, float, float, float]
"""A symmetric tensor: xx, yy, zz, xy, xz, yz."""

RULE: Final = "triangle-inequality"
NOT_POSITIVE: Final = "not-positive"
"""The rule of repair of moments that are not above 0."""
MEANING: Final = "a tensor that no body has becomes the nearest one that a body can have"
FROM_SHAPES: Final = "masses-from-shapes"
DENSITY: Final = 1000.0
"""kg/m³ of :data:`FROM_SHAPES` unless a value is given with it: that of water."""
OF_SHAPES: Final = (
    "what moves and has no mass, or one below 0, has that of its shapes of 1000 kg/m³, or of another density: "
    "`masses-from-shapes=7850 kg/m^3`"
)

OF_SHAPES_OR_BALL: Final = "moments that are not above 0 follow from the mass and the shapes, or are those of a ball"


def ball(mass: float) -> float:
    """The moment of inertia (kg m²) of a ball of a mass (kg) and of :data:`DENSITY`: it stands for moments that are missing."""
    radius: float = (3.0 * mass / (4.0 * math.pi * DENSITY)) ** (1.0 / 3.0)
    return 0.4 * mass * radius * radius


class Solid(Protocol):
    """A shape that is filled. ``volume`` in m³; ``is_open``: of a mesh that is not closed, of which the hull is filled."""

    is_open: bool
    volume: float

    @property
    def collides(self) -> bool:
        """Whether it takes part in contact."""


def solids_of(shapes: Iterable[S]) -> list[S]:
    """Those of the shapes of a link that are filled: those that collide, or where none of these has a volume, those that are
    seen."""
    filled = [shape for shape in shapes if shape.volume > 0.0]
    return [shape for shape in filled if shape.collides] or filled


def given(name: str, before: float, solids: Sequence[Solid], density: float) -> str:
    """What :data:`FROM_SHAPES` did: the mass (kg) of the body ``name``, before and by shapes of ``density`` (kg/m³)."""
    counted = f"{len(solids)} {'collision' if solids[0].collides else 'visual'} shape{'s' if len(solids) > 1 else ''}"
    aside = [] if solids[0].collides else ["no collision shape has a volume"]
    if hulls := sum(shape.is_open for shape in solids):
        aside.append(f"{hulls} {'mesh is' if hulls == 1 else 'meshes are'} not closed: the hull is filled")
    kilograms = density * math.fsum(shape.volume for shape in solids)
    became = f"{before:g} kg became " if before else ""
    why = f" ({'; '.join(aside)})" if aside else ""
    return f"{name}: {became}{kilograms:.6g} kg, of {counted} of {density:g} kg/m³{why}"


def density_of(requested: RequestedRepairs, shown: str) -> tuple[float, list[Problem]]:
    """kg/m³ of the rule :data:`FROM_SHAPES`, and the problems of the value that is given with it. ``shown``: what messages call
    the file."""
    text = requested.value(FROM_SHAPES)
    if text is None:
        return DENSITY, []
    try:
        return Number("density", 0.0, above=True).read(text), []
    except Faults as error:
        form = f"{FROM_SHAPES}=1000, {FROM_SHAPES}=7850 kg/m^3"
        message = f"{shown}: the density of {FROM_SHAPES}: "
        return DENSITY, [Problem(message + one.message, found=text[:80], allowed=form) for one in error.faults]


def nearest(tensor: Sequence[float]) -> Six:
    """The tensor nearest to a positive one (by the sum of squares) that obeys the triangle inequality. It has the same
    principal axes: what the largest moment is too large by is shared by all three."""
    import numpy as np

    xx, yy, zz, xy, xz, yz = tensor
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    excess = max(0.0, (moments[2] - moments[0] - moments[1]) / 3.0)
    moved = moments + excess * np.array([1.0, 1.0, -1.0])
    full = (axes * moved) @ axes.T
    return tuple(float(full[index]) for index in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))  # type: ignore[return-value]


def shown(moments: Sequence[float]) -> str:
    """Moments in a message."""
    return ", ".join(f"{value:.6g}" for value in moments)


def became(before: Sequence[float], after: Sequence[float]) -> str:
    """What the rule did, by the principal moments."""
    return f"the principal moments {shown(before)} kg m² became {shown(after)} kg m²"
