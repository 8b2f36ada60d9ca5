"""Joints that close loops as constraints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simspec.imports.draft import numbers
from simspec.imports.usd.bodies import Body
from simspec.imports.usd.joints import Joint
from simspec.imports.usd.places import Places
from simspec.imports.usd.shapes import pose_data
from simspec.language.foreign import Fate
from simspec.world import frames
from simspec.world.types import Pose


def loop_data(joint: Joint, bodies: Mapping[int, Body], places: Places) -> tuple[str, dict[str, Any]] | None:
    """The model that a loop is in ("": none), and its words; None for what the language does not say, which is then lost."""
    prim = joint.prim
    if joint.first is None or joint.second is None:
        prim.set_aside(
            None,
            Fate.LOST,
            "a loop that is closed against the world is not supported",
            hint="join it to a body that is fixed",
        )
        return None
    kinds = [freedom.kind for freedom in joint.freedoms]
    first, second = bodies[id(joint.first)], bodies[id(joint.second)]
    if first.model != second.model:
        prim.set_aside(None, Fate.LOST, "a loop of two models is not supported")
        return None
    names = [first.name, second.name]
    here = frames.compose(frames.inverse(first.frame), joint.in_first)
    there = frames.compose(frames.inverse(second.frame), joint.in_second)
    if not kinds:
        pose = frames.compose(here, frames.inverse(there))
        said = Pose(prim.exactly("origin", pose.position), prim.turn("orientation", pose.quaternion))  # type: ignore[arg-type]
        return first.model, {"weld": {"bodies": names, "pose": pose_data(said)}}
    if kinds not in (["ball"], ["hinge"]):
        prim.set_aside(None, Fate.LOST, "loops are closed by fixed, spherical and revolute joints only")
        return None
    if kinds == ["hinge"]:
        prim.set_aside(
            "physics:axis",
            Fate.LOST,
            "a loop is held at the joint's point; nothing holds the direction of its axis, unless the other joints do",
        )
    at = prim.exactly("origin", here.position)
    second_at = prim.exactly("second_point", there.position)
    return first.model, {"connect": {"bodies": names, "at": numbers(at), "second_at": numbers(second_at)}}
