"""The role of each body of a world in PhysX, from the world alone: for support, and for the expected inventory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from simspec.support.declarations import Refinement, unsupported_if
from simspec.world.canonical import derived
from simspec.world.contact_pairs import excluded_pairs, solid_shapes
from simspec.world.frames import sorted_pair
from simspec.world.inertia import least_moment, lumped_inertial, principal_axes
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, World

SLIDES: Mapping[str, tuple[bool, ...]] = {
    "hinge": (False,),
    "slide": (True,),
    "ball": (False,) * 3,
    "free": (True,) * 3 + (False,) * 3,
}
"""By kind of joint, whether each of the coordinates that PhysX has for it is a slide."""


@derived
def roles(world: World) -> Mapping[str, tuple[str, str]]:
    """By body: ``static``, ``actor`` (a free body that carries nothing but massless fixed bodies), ``link``, or ``part`` of
    another body's actor or link; and the name of the body that has it."""
    groups = rigid_groups(world)
    top: dict[str, str] = {}
    moving: dict[str, list[Body]] = {}
    for body in world.bodies:
        if groups[body.name] != "world":
            parent = body.joint.parent
            top[body.name] = body.name if parent is None or parent not in top else top[parent]
            moving.setdefault(top[body.name], []).append(body)
    alone = {name for name, bodies in moving.items() if bodies[0].joint.kind == "free" and not _more(world, bodies[1:])}
    found: dict[str, tuple[str, str]] = {}
    for body in world.bodies:
        name, parent = body.name, body.joint.parent
        if name not in top:
            found[name] = ("static", name)
        elif body.joint.kind == "fixed" and parent is not None and not lumped_inertial(world, body).mass:
            found[name] = ("part", found[parent][1])
        else:
            found[name] = ("actor" if top[name] in alone else "link", name)
    return MappingProxyType(found)


def _more(world: World, bodies: Iterable[Body]) -> bool:
    return any(body.joint.kind != "fixed" or lumped_inertial(world, body).mass for body in bodies)


class PhysxLinkRole(NamedTuple):
    """A link of an articulation. ``body``: the name of its body, "" of the link that is fixed to the world; ``place``: the
    number of its joint among those of the body, or ``spacer``; ``slides``: None of a fixed joint; ``mass``: where it stands for
    a massless body, the mass and largest moment of the next body that it carries."""

    body: str
    place: int | str
    slides: bool | None
    mass: tuple[float, float] | None


@derived
def links_of(world: World) -> Mapping[str, tuple[PhysxLinkRole, ...]]:
    """The links of each articulation, by the name of its first body."""
    role = roles(world)
    top: dict[str, str] = {}
    found: dict[str, list[PhysxLinkRole]] = {}
    touching = _touching_joined(world)
    for body in world.bodies:
        kind, name = role[body.name]
        if kind not in ("link", "part") or role[name][0] != "link":
            continue
        parent = body.joint.parent
        top[body.name] = body.name if parent is None or parent not in top else top[parent]
        if kind == "part":
            continue
        links = found.setdefault(top[body.name], [PhysxLinkRole("", 0, None, None)])
        carried = _carried(world, body.name)
        if body.name in touching:
            links.append(PhysxLinkRole(body.name, "spacer", None, carried))
        slides = SLIDES.get(body.joint.kind, (None,))
        for place, slide in enumerate(slides):
            heavy = place == len(slides) - 1 and lumped_inertial(world, body).mass > 0.0
            links.append(PhysxLinkRole(body.name, place, slide, None if heavy else carried))
    return MappingProxyType({name: tuple(links) for name, links in found.items()})


def _carried(world: World, name: str) -> tuple[float, float]:
    """Mass and largest moment of a body, or of the next one with mass that it carries."""
    inside = {name}
    for body in world.bodies:
        if body.name in inside or body.joint.parent in inside:
            inside.add(body.name)
            inertial = lumped_inertial(world, body)
            if inertial.mass:
                return inertial.mass, max(principal_axes(inertial.inertia)[0])
    return 0.0, 0.0


def _touching_joined(world: World) -> frozenset[str]:
    """The bodies whose links may touch the links that they are joined to, as far as pairs of bodies are excluded."""
    role, excluded = roles(world), set(excluded_pairs(world))
    solid: dict[str, list[str]] = {}
    for body in world.bodies:
        if solid_shapes(body):
            solid.setdefault(role[body.name][1], []).append(body.name)
    found = set()
    for body in world.bodies:
        parent = body.joint.parent
        if role[body.name][0] != "link" or parent is None or role[parent][0] == "static":
            continue
        pairs = ((a, b) for a in solid.get(role[parent][1], ()) for b in solid.get(body.name, ()))
        if any(sorted_pair(*pair) not in excluded for pair in pairs):
            found.add(body.name)
    return frozenset(found)


MOST_LINKS = 255
"""Of an articulation: PhysX counts links in eight bits, without a message (measured)."""


def inertia_supported(world: World) -> Refinement | None:
    """Not a tree that needs more links than an articulation has, nor a body that moves whose inertia has no inverse."""
    for body in world.bodies:
        inertial = lumped_inertial(world, body)
        if roles(world)[body.name][0] in ("actor", "link") and inertial.mass and not least_moment(inertial) > 0.0:
            return unsupported_if(f"PhysX stores the inverse of an inertia, which that of {body.name!r} does not have")
    for name, links in links_of(world).items():
        if len(links) > MOST_LINKS:
            return unsupported_if(
                f"PhysX has at most {MOST_LINKS} links in an articulation, and the tree of {name!r} needs {len(links)}"
            )
    return None
