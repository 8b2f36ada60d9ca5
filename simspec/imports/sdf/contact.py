"""Who touches whom, and how, in a file of SDF: surfaces as materials, and the links of a model that do not collide."""

from __future__ import annotations

from itertools import combinations

from simspec.imports.sdf.trees import BodyRead, ModelRead


def silent(model: ModelRead) -> list[BodyRead]:
    """Bodies of a model that do not touch each other: colliding ones without ``self_collide``. [] where the joints between them
    say as much."""
    bodies = [
        body
        for body in model.bodies
        if not body.self_collide and any(shape.surface is not None for shape in body.content.shapes)
    ]
    apart = [
        pair for pair in combinations(bodies, 2) if pair[0].parent is not pair[1] and pair[1].parent is not pair[0]
    ]
    return bodies if apart else []


def excluded(bodies: list[BodyRead]) -> list[list[str]]:
    """Every pair of bodies that do not touch, but those that a joint connects."""
    return [
        [first.name, second.name]
        for first, second in combinations(bodies, 2)
        if first.parent is not second and second.parent is not first
    ]
