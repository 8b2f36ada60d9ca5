"""Springs and dampers of robot files are explicit in time: the timestep at which they are stable, where a file says none."""

from __future__ import annotations

import copy
import dataclasses
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from simspec.errors import SpecError
from simspec.language.beginning import begin_within
from simspec.language.foreign import Imported
from simspec.language.load import Spec
from simspec.language.mesh import named_files
from simspec.world.kinematics import owner_of
from simspec.world.types import World

USUAL: Final = 1e-3
"""s; the language's default."""
SHORTEST: Final = 1e-5
"""s; a drive that needs shorter steps is no spring that anyone would simulate so."""
LEAST: Final = 1e-7
"""s; real robots have dampers that are stable up to 5e-6 s (a wheel of 1 N m s/rad), and 7e-7 s (a finger's last link)."""
RESOLVED: Final = 1e-9
"""s: a timestep at which every spring is stable, so that every world resolves; nothing is stepped."""
SHARE: Final = 0.7
"""Of the longest stable timestep that is taken: other configurations allow less."""
MOST_ROUNDS: Final = 50
DRIVEN: Final = ("spring", "damping")


def has_drives(data: dict[str, Any]) -> bool:
    """Whether a joint of a spec has a spring or a damper."""
    return any(word in joint for body in _bodies(data).values() for joint in _joints(body) for word in DRIVEN)


def add_timestep(imported: Imported) -> None:
    """Say a timestep in the spec of a file that has no word for it, where it is unstable at the usual one."""
    data = imported.data
    if "timestep" in data.get("physics", {}) or not has_drives(data):
        return
    try:
        step = stable_timestep(data, imported.files, None)
    except SpecError:
        return  # what does not resolve is told by whoever reads the spec, with its places
    if step is not None:
        first: dict[str, Any] = {
            key: data.pop(key) for key in ("simspec", "name", "description", "physics") if key in data
        }
        first.setdefault("physics", {})["timestep"] = step
        imported.data = {**first, **data}
        imported.comments["physics.timestep"] = "the file says no timestep; its dampers are stable at this one"


def stable_timestep(
    data: dict[str, Any], meshes: dict[str, Path], leave_out: Callable[[str, float], None] | None
) -> float | None:
    """The timestep of a spec whose file says none; None for the usual one.

    ``leave_out`` is told the full name of each body whose joint's drives are stable at no timestep of :data:`SHORTEST` or more,
    with the longest (s) at which they are; they are taken out of ``data``. Without it the timestep is as short as it takes,
    down to :data:`LEAST`, and None below. Raises SpecError as resolving does. Without Pinocchio, which knows mass matrices,
    nothing is told.
    """
    try:
        from simspec.dynamics.stability import unstable
    except ModuleNotFoundError:
        return None
    for _ in range(MOST_ROUNDS):
        world = _resolved(data, meshes)
        stiff = unstable(_stepped(world, SHORTEST if leave_out is not None else LEAST))
        if not stiff:
            steps = [one.largest_stable_step for one in unstable(_stepped(world, USUAL))]
            return round_step(SHARE * min(steps)) if steps else None
        if leave_out is None:
            return None
        bodies = _bodies(data)
        for instability in stiff:
            for name in dict.fromkeys(owner_of(one) for one in instability.bodies):
                for joint in _joints(bodies[name]):
                    for word in DRIVEN:
                        joint.pop(word, None)
                leave_out(name, instability.largest_stable_step)
    return None


def _stepped(world: World, step: float) -> World:
    return dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=step))


def _resolved(data: dict[str, Any], meshes: dict[str, Path]) -> World:
    timed = copy.deepcopy(data)
    for body in _bodies(timed).values():
        if "mass" in body and "inertia" in body:
            body.pop("shapes", None)  # their mass is not asked for: meshes need not be read
    begin_within(timed, {})  # as the spec will: beyond their limits joints are refused
    timed.setdefault("physics", {})["timestep"] = RESOLVED
    here = Path.cwd()
    for path, text in list(named_files(timed)):
        holder: Any = timed
        for step in path[:-1]:
            holder = holder[step]
        holder[path[-1]] = os.path.relpath(meshes[text], here)
    return Spec.from_data(timed, folder=here, allow_outside=True).resolve()


def _bodies(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """All bodies by their full names."""
    bodies = dict(data.get("model", {}).get("bodies", {}))
    bodies |= data.get("bodies", {})
    for model, placed in data.get("models", {}).items():
        bodies |= {f"{model}/{name}": body for name, body in placed["bodies"].items()}
    return bodies


def _joints(body: dict[str, Any]) -> list[dict[str, Any]]:
    return [body["joint"]] if "joint" in body else list(body.get("joints", ()))


def round_step(longest: float) -> float:
    """The longest of 1, 2 and 5 times a power of ten that is not above ``longest``."""
    power = math.floor(math.log10(longest))
    return float(f"{max(digit for digit in (1, 2, 5) if digit * 10.0**power <= longest)}e{power}")
