"""A body's collision shapes, split by material and copied into the layers of a plan."""

from __future__ import annotations

from dataclasses import dataclass

from simspec.contact.plan import ContactPlan
from simspec.world.contact_pairs import solid_shapes
from simspec.world.types import Body, Shape, Surface


@dataclass(frozen=True, slots=True)
class Part:
    """The collision shapes of one body that share a material and a layer, and so one set of numbers and one filter."""

    body: str
    material: str
    layer: int
    shapes: tuple[Shape, ...]
    surface: Surface


def parts(body: Body, plan: ContactPlan) -> tuple[Part, ...]:
    """A body's collision shapes, split by material and copied into every layer; the body's own shapes come first.

    Most bodies have one part. An engine that holds numbers or filters per body puts the others on bodies of their own,
    rigidly joined.
    """
    solid = solid_shapes(body)
    found = []
    for material in dict.fromkeys(shape.material for shape in solid):
        shapes = tuple(shape for shape in solid if shape.material == material)
        for layer in plan.layers(material):
            found.append(Part(body.name, material, layer, shapes, plan.numbers[material, layer]))
    return tuple(found)


def surfaces(shape: Shape, plan: ContactPlan) -> tuple[Surface, ...]:
    """What an engine must hold for a collision shape: its numbers in each of its layers."""
    return tuple(plan.numbers[shape.material, layer] for layer in plan.layers(shape.material))
