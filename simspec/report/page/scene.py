"""The page of a scene that was not run: its initial state, with a slider for each joint."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from simspec.errors import visible
from simspec.meshes.drawn import surfaces as surfaces_of
from simspec.report.page.document import Section, page
from simspec.report.page.model import DIGITS, loads_note, model_data
from simspec.report.page.packing import FARTHEST, Numbers, PackedNumbers, Rows, box_of
from simspec.report.page.sentences import Sentence
from simspec.report.page.shapes import Surfaces, drawn_shapes, is_drawn, surfaces_note
from simspec.report.table import PLAIN, Table, listed, number
from simspec.runner.metrics import moving_bodies
from simspec.world.kinematics import poses
from simspec.world.rotations import rotate
from simspec.world.shapes import SHAPES
from simspec.world.types import Joint, World

MOST_BODIES = 300
"""Bodies of the table."""
NAMES = {"hinge": "hinge", "slide": "slide", "ball": "ball joint", "free": "free body", "fixed": "fixed joint"}
"""Kinds of joints, as a sentence counts them."""
PLURALS = {"free body": "free bodies"}


def scene_page(world: World, notes: Sequence[str] = ()) -> str:
    """A page that shows ``world`` in its initial state, as one HTML file that loads nothing, with sliders that move its joints.
    ``notes``: paragraphs below the picture. The same world gives the same text."""
    return page([lambda packed: [_section(world, packed, notes)]], "scene")


def _section(world: World, packed: PackedNumbers, notes: Sequence[str]) -> Section:
    surfaces = surfaces_of(world)
    return Section(
        name=visible(world.name),
        verdict=(Sentence(PLAIN, _summary(world)),),
        notes=tuple(map(visible, notes)),
        certificate=(),
        certificate_notes=(),
        results=(_bodies(world),),
        details=(),
        provenance=None,
        scene=scene_of(world, packed, surfaces),
        caption=_caption(world, surfaces),
    )


def scene_of(world: World, packed: PackedNumbers, surfaces: Surfaces) -> dict[str, Any]:
    """A scene without runs as ``page/src/data.ts`` declares it."""
    start = poses(world)
    rest: Numbers = np.array([[*start[body.name].position, *start[body.name].quaternion] for body in world.bodies])
    rest = rest.reshape(len(world.bodies), 7)
    rest = np.where(np.abs(rest) < FARTHEST, rest, 0.0)
    moving = moving_bodies(world)
    low, high, centre, radius, _ = box_of(world, [rest[None, :, :3]], moving)
    centre, radius = _ball(world, rest, moving) or (centre, radius)
    return {
        "name": visible(world.name),
        "times": packed.floats(np.zeros(1)),
        "frames": 1,
        "bodies": [visible(body.name) for body in world.bodies],
        "shapes": drawn_shapes(world, packed, surfaces),
        "model": model_data(world, free=True),
        "low": low.tolist(),
        "high": high.tolist(),
        "rest": np.round(rest, DIGITS).tolist(),
        "moving": moving.tolist(),
        "turning": [],
        "runs": [],
        "ghost": None,
        "view": {"centre": np.round(centre, DIGITS).tolist(), "radius": round(radius, DIGITS)},
        "plots": [],
    }


def _ball(world: World, rest: Numbers, moving: Rows) -> tuple[Numbers, float] | None:
    """The centre and the radius (m) of the ball about the box of all shapes of moving bodies; None where there are none."""
    balls = [
        (
            rest[body, :3] + rotate(rest[body, 3:], np.array(shape.pose.position)),
            SHAPES[shape.kind].outer_radius(shape.size),
        )
        for body in moving.tolist()
        for shape in filter(is_drawn, world.bodies[body].shapes)
    ]
    centres = np.array([centre for centre, reach in balls if math.isfinite(reach)]).reshape(-1, 3)
    reaches = np.array([reach for _, reach in balls if math.isfinite(reach)])[:, None]
    if not len(centres):
        return None
    low, high = (centres - reaches).min(axis=0), (centres + reaches).max(axis=0)
    return 0.5 * (low + high), float(0.5 * np.linalg.norm(high - low))


def _summary(world: World) -> str:
    """The number of bodies and joints, and the mass, in one sentence."""
    kinds = Counter(NAMES[body.joint.kind] for body in world.bodies)
    counts = [
        f"{kinds[name]} {PLURALS.get(name, name + 's') if kinds[name] != 1 else name}"
        for name in NAMES.values()
        if kinds[name]
    ]
    mass = math.fsum(body.inertial.mass for body in world.bodies)
    bodies = f"{len(world.bodies)} bod{'y' if len(world.bodies) == 1 else 'ies'}"
    return f"Initial state, not run: {bodies}, {number(mass, 'kg')}; {listed(counts)}."


def _caption(world: World, surfaces: Surfaces) -> str:
    parts = ["Sliders move the joints of the tree. Nothing is simulated: no contact, no gravity."]
    if not all(is_drawn(shape) for body in world.bodies for shape in body.shapes):
        parts.append(f"Shapes of more than {FARTHEST:g} m are not drawn.")
    if (fewer := surfaces_note(surfaces)) is not None:
        parts.append(fewer)
    if (arrows := loads_note(world)) is not None:
        parts.append(arrows)
    return " ".join(parts)


def _bodies(world: World) -> Table:
    table = Table("Bodies and joints", "body", "parent", "joint", "kind", "range", "mass", right=(5,))
    for body in world.bodies[:MOST_BODIES]:
        joint = body.joint
        table.add(
            visible(body.name),
            visible(joint.parent or "world"),
            visible(joint.name),
            joint.kind,
            _range(joint),
            number(body.inertial.mass, "kg"),
        )
    if len(world.bodies) > MOST_BODIES:
        table.note = f"The first {MOST_BODIES} of {len(world.bodies)} bodies."
    return table


def _range(joint: Joint) -> str:
    unit = "m" if joint.kind == "slide" else "rad"
    if joint.position_limits is not None:
        low, high = joint.position_limits
        return f"{low:.4g} to {high:.4g} {unit}"
    return "" if joint.angle_limit is None else f"up to {joint.angle_limit:.4g} rad"
