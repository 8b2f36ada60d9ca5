"""Meshes within the margin that PyBullet keeps around hulls.

On the base of a tree the margin is the setting ``collision_margin``; on every other link PyBullet keeps 1 mm, whatever it is
told (measured, 3.2.7). It is outside of the hull, so that hulls are told with their faces that much further in: faces are then
where they should be, and edges are rounded by the margin, as PyBullet's own boxes and cylinders are there. A hull that is too
thin for that is told as far in as it goes (``world/inset.py``), and is thicker in PyBullet. In boxes and cylinders the margin
is within: what is thinner is told as thick as both margins, since Bullet overlooks contacts of cores of less than nothing
(measured: of a sole of 16 × 7 cm and 1 mm, 11 of 93 pairs of a robot's shapes).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Final

from simspec.contact.parts import Part, parts
from simspec.contact.plan import ContactPlan
from simspec.world.inset import thickened, within
from simspec.world.types import Body, Shape, World

LINK_MARGIN: Final = 1e-3
"""m, around hulls on links other than bases."""


def told_shapes(body: Body, parts: Sequence[Part], own_margin: float) -> dict[str, Shape]:
    """The shapes of a body by name, those that touch within the margin of the link that carries them: ``own_margin`` on its
    own."""
    margins = {shape.name: LINK_MARGIN for part in parts[1:] for shape in part.shapes}
    margins |= {shape.name: own_margin for shape in parts[0].shapes}
    return {shape.name: _within(shape, margins.get(shape.name, 0.0)) for shape in body.shapes}


def faces_meet(world: World, plan: ContactPlan, base_margin: float) -> bool:
    """Whether hulls get the features by which PyBullet finds all contact points of two faces in one step.

    It then looks at hulls without their margin (measured: one on a link is 1 mm deep in another), so that no hull may have one:
    all meshes that touch are on bases of trees, whose margin is ``base_margin`` (m).
    """
    margins = [margin for body in world.bodies for _, margin in margins_of("mesh", body, plan, base_margin)]
    return bool(margins) and not any(margins)


def margins_of(kind: str, body: Body, plan: ContactPlan, base_margin: float) -> Iterator[tuple[Shape, float]]:
    """The shapes of a ``kind`` of a body that touch, each with the margin (m) of a link that carries it; a copied one more than
    once."""
    own, *carried = parts(body, plan) or (None,)
    root = body.joint.parent is None and body.joint.kind in ("free", "fixed")
    on_base = root and (body.joint.kind == "free" or not body.inertial.mass)
    for part in () if own is None else (own, *carried):
        for shape in part.shapes:
            if shape.kind == kind:
                yield shape, base_margin if part is own and on_base else LINK_MARGIN


def _within(shape: Shape, margin: float) -> Shape:
    if not shape.collision or not margin:
        return shape
    if shape.kind in ("box", "cylinder"):
        return dataclasses.replace(shape, size=thickened(shape.kind, shape.size, margin))
    if shape.kind != "mesh":
        return shape
    return dataclasses.replace(shape, size=within(shape.size, margin))
