"""Transforms in bodies that nothing stands in, as named frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simspec.imports.draft import names
from simspec.imports.usd.bodies import Body
from simspec.imports.usd.places import SAME, Places
from simspec.imports.usd.shapes import pose_data
from simspec.imports.usd.stage import Prim, Stage
from simspec.world import frames

MARK = "simspec:frame"
"""What simspec says of those that it writes: others have to stand elsewhere than their body."""


def add_frames(
    stage: Stage,
    places: Places,
    body_of: Mapping[str, Prim],
    bodies: Mapping[int, Body],
    data: dict[str, Any],
    alone: bool,
) -> None:
    """Put the frames of a stage into the data of its spec. ``body_of``: of paths the rigid body; ``bodies``: of the ``id`` of
    a prim the body that is made of it; ``alone``: whether the spec is a model."""
    for prim in stage.used():
        holder = body_of.get(prim.where)
        if prim.tag != "Xform" or holder is None or holder is prim or id(holder) not in bodies or prim.look():
            continue
        marked = prim.flag(MARK, False)
        place = places.within(prim, holder).pose
        if place == SAME and not marked:
            continue
        body = bodies[id(holder)]
        around = data["model"] if alone else data["models"][body.model] if body.model else data
        own = pose_data(frames.compose(frames.inverse(body.frame), place))
        (given,) = names([prim.called()], [*around.get("bodies", ()), *around.get("frames", ())])
        around.setdefault("frames", {})[given] = {"body": body.name, **({"pose": own} if own else {})}
