"""What touches in several runs, by names that all of them tell: shapes, or groups of shapes of a body that one of them does not
tell apart, or bodies where one did not record shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.runner.labels import SEPARATOR, labels_of, shapes_of, side_names
from simspec.runner.run import Run

Element = tuple[str, str]
"""A body, and a shape of it; "" for the body as a whole."""
NAMED = 3
"""Shapes of a group that a name lists; more are counted."""


@dataclass(frozen=True)
class Sides:
    """The sides of contacts of some runs.

    names    what may touch, by number: a body's name where that is all of its shapes, else with the shapes in brackets
    numbers  for each run the number of each of its own sides
    arrays   for each run the array (contacts, 2) of its own sides: ``contact.shape``, or ``contact.body``
    notes    why contacts are matched by less than single shapes, where they are
    """

    names: tuple[str, ...]
    numbers: tuple[NDArray[np.int64], ...]
    arrays: tuple[str, ...]
    notes: tuple[str, ...]


def common_sides(runs: Sequence[Run], by: str = "shape") -> Sides:
    """The finest sides that all ``runs`` tell; ``by``: ``shape``, or ``body`` for bodies alone. Raises ValueError for
    another."""
    if by not in ("shape", "body"):
        raise ValueError(f"contacts are matched by shape or by body, not by {by!r}")
    arrays = tuple("contact.shape" if by == "shape" and _tells_shapes(run) else "contact.body" for run in runs)
    told = [_sides(run, array) for run, array in zip(runs, arrays, strict=True)]
    above: dict[Element, Element] = {}

    def top(element: Element) -> Element:
        while above.setdefault(element, element) != element:
            element = above[element]
        return element

    for sides in told:
        for first, *others in sides:
            for other in others:
                above[top(other)] = top(first)
            top(first)
    members: dict[Element, list[str]] = {}
    for element in above:
        members.setdefault(top(element), []).append(element[1])
    solid: dict[str, set[str]] = {}
    for run in runs:
        for body in run.world.bodies:
            solid.setdefault(body.name, set()).update(shape.name for shape in body.shapes if shape.collision)
    number = {element: place for place, element in enumerate(members)}
    names = tuple(_name(body, shapes, solid[body]) for (body, _), shapes in members.items())
    numbers = tuple(np.array([number[top(first)] for first, *_ in sides], dtype=np.int64) for sides in told)
    notes = (
        [note for run, array in zip(runs, arrays, strict=True) for note in _notes(run, array)] if by == "shape" else []
    )
    return Sides(names, numbers, arrays, tuple(dict.fromkeys(notes)))


def _tells_shapes(run: Run) -> bool:
    return "contact.shape" in run.arrays


def _sides(run: Run, array: str) -> list[list[Element]]:
    """The elements of each of a run's own sides, by its number in ``array``."""
    if array == "contact.body":
        return [[(body.name, ""), *((body.name, shape.name) for shape in body.shapes)] for body in run.world.bodies]
    body_of = {shape: body for body, shape in shapes_of(run.world)}
    labels = side_names(run.world, labels_of(run.provenance))
    return [[(body_of[shape], shape) for shape in label.split(SEPARATOR)] for label in labels]


def _name(body: str, shapes: Sequence[str], solid: set[str]) -> str:
    if "" in shapes or solid <= set(shapes):
        return body
    listed = ", ".join(shapes[:NAMED])
    return f"{body} ({listed})" if len(shapes) <= NAMED else f"{body} ({listed} and {len(shapes) - NAMED} more)"


def _notes(run: Run, array: str) -> list[str]:
    if array == "contact.body":
        told = any(len(body.shapes) > 1 for body in run.world.bodies)
        why = f"{run.label} does not tell the shapes of contacts: they are matched by bodies"
        return [why] if told and len(run.arrays.get("contact.row", ())) else []
    grouped = {shape for group in labels_of(run.provenance).groups or () for shape in group}
    bodies = ", ".join(dict.fromkeys(body for body, shape in shapes_of(run.world) if shape in grouped))
    why = f"{run.label} does not tell some shapes of {bodies} apart in contact: they are matched together"
    return [why] if grouped else []
