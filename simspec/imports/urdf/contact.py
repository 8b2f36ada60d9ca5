"""Surfaces of links: plain URDF has none, two programs extend it by words for them. They become materials of the language."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from simspec.imports.draft import Draft, plain
from simspec.imports.elements import Element
from simspec.imports.surfaces import CONTACT_OF_LINK, Materials, Surface
from simspec.imports.urdf.shapes import Shape
from simspec.imports.urdf.table import INFORMATION, LOST, PHYSICS, UNUSED
from simspec.language.foreign import Fate, Severity

CONTACT_DEFAULT: Final = Surface(friction=0.5)
"""Of a link without <contact>, in the program that has this element."""
GAZEBO_DEFAULT: Final = Surface(friction=1.0)
"""Of a link of which no <gazebo> speaks, in Gazebo."""
FIRST: Final = "mu1"
SECOND: Final = "mu2"
DIRECTION: Final = "fdir1"
NO_EFFECT: Final = "friction is the same in every direction"
GROUP: Final = "drake:collision_filter_group"
UNSAID: Final = "unsaid"
"""The material of shapes of which the file says nothing, where it speaks of others."""


def add_materials(
    root: Element, links: Mapping[str, tuple[Element, Sequence[Shape]]], draft: Draft
) -> dict[str, dict[str, Any]]:
    """Give every collision shape its material, and return the materials by name; {} where the file speaks of no surface.
    ``links``: by the file's names, the element and its shapes."""
    said: dict[str, Surface] = {}
    default = GAZEBO_DEFAULT
    for name, (element, _) in links.items():
        for contact in element.look("contact"):
            if not contact.look():
                continue  # as without it
            with draft.collecting():
                said[name] = _of_contact(contact, said.get(name, CONTACT_DEFAULT))
                default = CONTACT_DEFAULT
    for gazebo in root.look("gazebo"):
        name = gazebo.attributes.get("reference", "").strip()
        with draft.collecting():
            surface = _of_gazebo(gazebo)
            if surface is None:
                continue
            if name in links and any(shape.collision for shape in links[name][1]):
                _take_friction(gazebo, said.setdefault(name, surface) == surface)
            else:
                _aside(gazebo, UNUSED, "there is no such link with a collision shape", INFORMATION)
    return _named(links, said, default, draft) if said else {}


def _named(
    links: Mapping[str, tuple[Element, Sequence[Shape]]], said: Mapping[str, Surface], default: Surface, draft: Draft
) -> dict[str, dict[str, Any]]:
    """The materials, and their names in all collision shapes; one that all of them have needs no name there."""
    materials, given = Materials(), dict[int, str]()
    silent: list[Shape] = []
    for name, (_, shapes) in links.items():
        for shape in shapes:
            if not shape.collision:
                continue
            if name in said:
                given[id(shape)] = materials.name(said[name])
            else:
                silent.append(shape)
    if not given:
        return {}
    data = {key: {word: plain(value) for word, value in item.items()} for key, item in materials.data().items()}
    if silent:
        data[UNSAID] = {"friction": plain(default.friction)}
        draft.note(
            ("contact", "materials", UNSAID),
            "the file says nothing of these surfaces: the default of the program whose words it uses for others",
        )
    if len(data) > 1:
        single = next(iter(data))
        for _, shapes in links.values():
            for shape in shapes:
                if shape.collision:
                    name = given.get(id(shape), UNSAID)
                    shape.material = name if name in data else single
    return data


# --- groups that ignore each other ----------------------------------------------------------------------------------


def excluded(root: Element, links: Container[str], bodies: Mapping[str, str]) -> list[list[str]]:
    """Pairs of bodies that do not touch each other, by Drake's words for groups. ``bodies``: those of ``links`` that are bodies
    of the spec, by the file's names. Raises SpecError for a link that there is not."""
    members: dict[str, list[str]] = {}
    ignored: list[tuple[str, str]] = []
    for group in root.children(GROUP):
        name = group.need("name")
        for member in group.children("drake:member"):
            link = member.need("link").strip()
            if link not in links:
                raise member.error(f"there is no link {link[:80]!r}", link[:80])
            if link in bodies:
                members.setdefault(name, []).append(bodies[link])
        ignored += [(name, other.need("name")) for other in group.children("drake:ignored_collision_filter_group")]
    pairs = {
        (min(one, two), max(one, two))
        for first, second in ignored
        for one in members.get(first, ())
        for two in members.get(second, ())
        if one != two
    }
    return [list(pair) for pair in sorted(pairs)]


# --- <contact> of a link ------------------------------------------------------------------------------------------


def _of_contact(contact: Element, before: Surface) -> Surface:
    """What a <contact> says. Raises SpecError for what are no numbers ≥ 0."""
    numbers: dict[str, float] = {}
    contact.take()
    for tag, word in CONTACT_OF_LINK.items():
        child = contact.child(tag)
        if child is not None:
            child.need("value")
            numbers[word] = _not_negative(child, child.number("value") or 0.0)
    if numbers.get("restitution", 0.0) > 1.0:
        raise contact.error("restitution must not be above 1", f"{numbers['restitution']:g}")
    return replace(before, **numbers)


def _not_negative(element: Element, value: float) -> float:
    if value < 0.0:
        raise element.error(f"<{element.tag}> must not be below 0", f"{value:g}")
    return value


# --- <gazebo reference> of a link ---------------------------------------------------------------------------------


def _of_gazebo(gazebo: Element) -> Surface | None:
    """The friction that a <gazebo> says; None for one that speaks of other things."""
    first, second = (_friction(gazebo, tag) for tag in (FIRST, SECOND))
    if first is None and second is None:
        return None
    return Surface(friction=GAZEBO_DEFAULT.friction if first is None else first)


def _friction(gazebo: Element, tag: str) -> float | None:
    """The number of the first element of a tag, as its text or its ``value``."""
    for child in gazebo.look(tag):
        value = child.number("value") if child.has("value") else child.content(1)[0]
        return _not_negative(child, value or 0.0)
    return None


def _take_friction(gazebo: Element, is_used: bool) -> None:
    """Say what becomes of the words for friction; ``is_used``: unless the link has said another by other words."""
    if not is_used:
        _aside(gazebo, LOST, "the link says another friction by other words", PHYSICS)
        return
    first, second = (_friction(gazebo, tag) for tag in (FIRST, SECOND))
    equal = (first if first is not None else GAZEBO_DEFAULT.friction) == (
        second if second is not None else GAZEBO_DEFAULT.friction
    )
    for child in gazebo.look(FIRST)[:1]:
        child.take()
    for child in gazebo.look(SECOND)[:1]:
        if equal:
            child.take()
        else:
            child.set_aside(None, LOST, f"{NO_EFFECT} in the language: {FIRST} is carried", PHYSICS)
    if second is None and not equal:
        gazebo.look(FIRST)[0].set_aside(None, LOST, f"{NO_EFFECT} in the language; {SECOND} is 1 by default", PHYSICS)
    if equal:
        for child in gazebo.look(DIRECTION):
            child.set_aside(None, UNUSED, NO_EFFECT, INFORMATION)


def _aside(gazebo: Element, fate: Fate, reason: str, severity: Severity) -> None:
    for child in gazebo.look(FIRST, SECOND, DIRECTION):
        child.set_aside(None, fate, reason, severity)
