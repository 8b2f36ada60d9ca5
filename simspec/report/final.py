"""Final state: the last recorded poses of some bodies, and positions of joints, engines side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.report.kit import table
from simspec.runner.run import Run
from simspec.world.frames import to_rpy
from simspec.world.kinematics import display_name, rigid_groups
from simspec.world.types import World

MOST_ROWS = 16
"""Rows of bodies, and as many of joints, that the terminal shows; the files have all."""


def shown_bodies(world: World, show: Sequence[str]) -> list[str]:
    """The bodies of `record.show`; where it names none, the roots that can move."""
    names = {body.name for body in world.bodies}
    chosen = [name for name in show if name in names]
    if chosen or show:
        return chosen
    groups = rigid_groups(world)
    # of a root with several joints the body itself, not what stands between them
    tops = [body for body in world.bodies if body.joint.parent is None and groups[body.name] != "world"]
    return [display_name(body.name, names) for body in tops]


def shown_joints(world: World, show: Sequence[str]) -> list[str]:
    """The hinges and slides of `record.show`; where it names none, all of them."""
    movable = [body.joint.name for body in world.bodies if body.joint.kind in SCALAR_JOINTS]
    return [name for name in show if name in movable] if show else movable


def shown_of(run: Run) -> tuple[str, ...]:
    """What `record.show` named when the run was made; nothing where it named nothing, or where that was not kept."""
    spec = run.provenance.get("spec")
    names = spec.get("show") if isinstance(spec, Mapping) else None
    return tuple(name for name in names if isinstance(name, str)) if isinstance(names, list) else ()


def ends(run: Run, show: Sequence[str]) -> dict[str, Any]:
    """The last record of a run: time (s), bodies (xyz, quat) and joints (rad, m) by name; empty where nothing was recorded."""
    if not run.recorded:
        return {}
    poses = run.arrays["pose"][-1]
    return {
        "time": float(run.time[-1]),
        "bodies": {
            name: {
                "xyz": poses[run.index[name], :3].tolist(),
                "quat": poses[run.index[name], 3:].tolist(),
            }
            for name in shown_bodies(run.world, show)
        },
        "joints": {name: float(run.q(name)[-1]) for name in shown_joints(run.world, show)},
    }


def final_table(runs: Mapping[str, Run], show: Sequence[str]) -> Table | None:
    """One row per body and joint, one column per run that recorded anything; None where there is nothing to show."""
    shown = [run for run in runs.values() if run.recorded]
    if not shown:
        return None
    world = shown[0].world
    bodies, joints = shown_bodies(world, show), shown_joints(world, show)
    if not bodies and not joints:
        return None
    times = {f"{run.time[-1]:.4g} s" for run in shown}
    when = times.pop() if len(times) == 1 else "the last record"
    ends_by_engine = table(
        f"Final state at {when}  (x y z in m, roll pitch yaw; joints in rad or m)",
        "",
        *(run.label for run in shown),
    )
    for name in bodies[:MOST_ROWS]:
        ends_by_engine.add_row(name, *(_pose(run.arrays["pose"][-1, run.index[name]].tolist()) for run in shown))
    units = {body.joint.name: "rad" if body.joint.kind == "hinge" else "m" for body in world.bodies}
    for name in joints[:MOST_ROWS]:
        ends_by_engine.add_row(name, *(f"{_number(float(run.q(name)[-1]))} {units[name]}" for run in shown))
    more = [
        f"{len(names) - MOST_ROWS} more {noun}"
        for names, noun in ((bodies, "bodies"), (joints, "joints"))
        if len(names) > MOST_ROWS
    ]
    if more:
        ends_by_engine.caption = (
            f"and {' and '.join(more)}: select with record.show; all are in bodies.parquet and states.parquet"
        )
    return ends_by_engine


def _pose(pose: Sequence[float]) -> str:
    if not all(map(math.isfinite, pose)):
        return "not finite"
    place = " ".join(_number(value) for value in pose[:3])
    turn = " ".join(
        f"{math.degrees(angle):.1f}".replace("-0.0", "0.0") for angle in to_rpy((pose[3], pose[4], pose[5], pose[6]))
    )
    return f"{place}\n{turn}°"  # two lines: three engines side by side fit 80 columns


def _number(value: float) -> str:
    """Four decimals: a tenth of a millimetre."""
    return f"{value:.4f}".replace("-0.0000", "0.0000")
