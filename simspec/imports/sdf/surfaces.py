"""Surfaces of SDF as materials of the language."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from simspec.imports.elements import Element
from simspec.imports.sdf.aside import IN_FRICTION, IN_SURFACE, set_aside
from simspec.imports.sdf.values import finite_of, flag_of, lost, unused

NO_BOUNCE: Final = 100_000.0
"""The default of ``bounce/threshold`` (m/s): nothing is as fast."""
FILTERS: Final[Mapping[str, tuple[str, ...]]] = {
    "collide_bitmask": ("65535", "0xffff"),
    "category_bitmask": ("65535", "0xffff"),
    "collide_without_contact": ("0", "false"),
    "collide_without_contact_bitmask": ("1",),
}
"""Defaults of what says who touches whom."""


@dataclass(frozen=True, slots=True)
class Surface:
    """What the file says of a surface, as a material of the language."""

    friction: float = 1.0
    restitution: float = 0.0
    threshold: float = 0.0
    torsional: float = 0.0
    rolling: float = 0.0

    def data(self) -> dict[str, Any]:
        """The material."""
        data: dict[str, Any] = {"friction": self.friction}
        for key, value in (
            ("restitution", self.restitution),
            ("restitution_threshold", self.threshold),
            ("torsional_friction", self.torsional),
            ("rolling_friction", self.rolling),
        ):
            if value:
                data[key] = value
        return data


def read_surface(shape: Element) -> Surface:
    """The surface of a collision. What the file does not say has SDF's default: friction 1."""
    surface = shape.child("surface")
    if surface is None:
        return Surface()
    set_aside(surface, IN_SURFACE)
    for contact in surface.look("contact"):
        _filters(contact)
    mu, torsional = 1.0, 0.0
    friction = surface.child("friction")
    if friction is not None:
        mu, torsional = _friction(friction)
    restitution = threshold = 0.0
    bounce = surface.child("bounce")
    if bounce is not None:
        restitution = finite_of(bounce, "restitution_coefficient", 0.0)
        threshold = finite_of(bounce, "threshold", NO_BOUNCE)
        if not restitution:
            threshold = 0.0
            unused(next(iter(bounce.look("threshold")), None), "nothing bounces")
    return Surface(mu, restitution, threshold, torsional)


def _friction(friction: Element) -> tuple[float, float]:
    ode = friction.child("ode")
    mu = 1.0
    if ode is not None:
        mu = finite_of(ode, "mu", 1.0)
        other = finite_of(ode, "mu2", 1.0)
        if other != mu:
            lost(next(iter(ode.look("mu2")), None), "friction is the same in every direction; `mu` is carried")
        set_aside(ode, IN_FRICTION)
        if other == mu:
            unused(next(iter(ode.look("fdir1")), None), "friction is the same in every direction")
    for child in friction.look():
        if child.tag not in ("ode", "torsional"):
            lost(child, "numbers of another engine; those of `ode` are carried")
    torsion = friction.child("torsional")
    return mu, 0.0 if torsion is None else _torsional(torsion)


def _torsional(torsion: Element) -> float:
    """Torsional friction as a length: coefficient × 3π/16 × radius of the patch."""
    coefficient = finite_of(torsion, "coefficient", 1.0)
    use_patch = flag_of(torsion, "use_patch_radius", True)
    patch = finite_of(torsion, "patch_radius", 0.0)
    for child in torsion.look("ode"):
        if finite_of(child, "slip", 0.0):
            lost(child, "friction does not depend on the force")
        else:
            child.take()
    if use_patch:
        unused(next(iter(torsion.look("surface_radius")), None), "the file gives the radius of the patch")
    else:
        for child in torsion.look("surface_radius", "coefficient"):
            lost(child, "a torsional friction that grows with the depth of contact")
        return 0.0
    return coefficient * 3.0 * math.pi / 16.0 * patch


def _filters(contact: Element) -> None:
    """What an element of contact says of who touches whom: the default changes nothing."""
    values = {child.tag: child.text for child in contact.look()}
    if values.keys() <= FILTERS.keys() and all(text.strip().lower() in FILTERS[tag] for tag, text in values.items()):
        unused(contact, "the default")
