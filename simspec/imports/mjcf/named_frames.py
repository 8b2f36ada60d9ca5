"""Sites as named frames: places on bodies that somebody gave a name to."""

from __future__ import annotations

from typing import Any

from simspec.imports.mjcf.bodies import Bodies, Names, pose
from simspec.language.amounts import MOST_FRAMES


def add_frames(bodies: Bodies) -> tuple[dict[str, dict[str, Any]], Names]:
    """The sites of a file that have a name and stand on a body, by their names in the spec, and what is renamed. Those of the
    world itself are on the body that stands for it, where there is one."""
    model, names = bodies.model, Names(set(bodies.data))
    made: dict[str, dict[str, Any]] = {}
    for number, part in model.parts.get("site", {}).items():
        body = int(model["site_bodyid"][number])
        if not part.name or (not body and bodies.ground is None) or len(made) >= MOST_FRAMES:
            continue
        shift = bodies.shifts.get(body)
        position = model["site_pos"][number] if shift is None else model["site_pos"][number] - shift
        words: dict[str, Any] = {"body": bodies.named(body)}
        if place := pose(position, model["site_quat"][number]):
            words["pose"] = place
        made[names.give(part.name, f"site_{number}")] = words
        bodies.features.framed.add(id(part.element))
    return made, names
