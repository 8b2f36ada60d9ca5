"""Surfaces of SDF as materials of the language."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from simspec.imports.elements import HOW_HARD, Element
from simspec.imports.sdf.aside import IN_CONTACT, IN_CONTACT_OF_LINK, IN_FRICTION, IN_SURFACE, set_aside
from simspec.imports.sdf.values import finite_of, flag_of, lost, unused
from simspec.imports.surfaces import CONTACT_OF_LINK, Surface
from simspec.language.foreign import Severity

NO_BOUNCE: Final = 100_000.0
"""The default of ``bounce/threshold`` (m/s): nothing is as fast."""
FILTERS: Final[Mapping[str, tuple[str, ...]]] = {
    "collide_bitmask": ("65535", "0xffff"),
    "category_bitmask": ("65535", "0xffff"),
    "collide_without_contact": ("0", "false"),
    "collide_without_contact_bitmask": ("1",),
}
"""Defaults of what says who touches whom."""
MASKS: Final = ("collide_bitmask", "category_bitmask")


def read_surface(shape: Element, of_link: Surface) -> Surface:
    """The surface of a collision; ``of_link``: what its link says of all its collisions, which holds where they say nothing."""
    surface = shape.child("surface")
    if surface is None:
        return of_link
    set_aside(surface, IN_SURFACE)
    for contact in surface.look("contact"):
        _contact(contact)
    read = of_link
    friction = surface.child("friction")
    if friction is not None:
        mu, torsional = _friction(friction)
        read = replace(read, friction=mu, torsional=torsional, rolling=0.0)
    bounce = surface.child("bounce")
    if bounce is not None:
        restitution = finite_of(bounce, "restitution_coefficient", 0.0)
        threshold = finite_of(bounce, "threshold", NO_BOUNCE)
        if not restitution:
            threshold = 0.0
            unused(next(iter(bounce.look("threshold")), None), "nothing bounces")
        read = replace(read, restitution=restitution, threshold=threshold)
    return read


def surface_of_link(link: Element) -> Surface:
    """The surface of all collisions of a link, in words of one reader: lengths in m; what it does not say is SDF's default,
    friction 1."""
    numbers: dict[str, float] = {}
    for contact in link.look("contact"):
        contact.take()
        set_aside(contact, IN_CONTACT_OF_LINK)
        for tag, name in CONTACT_OF_LINK.items():
            for child in contact.look(tag):
                child.take()
                numbers[name] = (child.number("value") or 0.0) if child.has("value") else child.content(1)[0]
    return Surface(**numbers)


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


def _contact(contact: Element) -> None:
    """Who touches whom, and how hard: of one the defaults change nothing, and so do masks with the bit that all defaults
    have; the other is each solver's."""
    contact.take()
    set_aside(contact, IN_CONTACT)
    for solver in contact.look():
        if solver.look():
            lost(solver, HOW_HARD, Severity.INFORMATION)
    for child in contact.look(*FILTERS):
        text = child.text.strip().lower()
        if text in FILTERS[child.tag] or (child.tag in MASKS and _has_first_bit(text)):
            unused(child, "every collision has this bit, by default too" if child.tag in MASKS else "the default")
        else:
            lost(child, "who touches whom is said by groups of bodies", hint="`contact.groups`")


def _has_first_bit(text: str) -> bool:
    try:
        return text.isascii() and "_" not in text and int(text, 0) % 2 == 1
    except ValueError:
        return False
