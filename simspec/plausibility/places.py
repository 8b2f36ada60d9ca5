"""Rules on where shapes are: sizes, missing and misplaced collision shapes, parts in mid-air, and overlaps at the start."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.plausibility.findings import Grade, PlausibilityFinding
from simspec.plausibility.parts import (
    Floats,
    Lump,
    MotionPart,
    axis_distance,
    box,
    carrying,
    extent,
    gap,
    lumps_of,
    part_of,
)
from simspec.world import frames
from simspec.world.kinematics import poses, rigid_groups, trees
from simspec.world.overlap import DEEP, deep_overlaps, separation
from simspec.world.types import Body, World

LARGEST_LINK: Final = 10.0
"""m, of the shapes of a moving rigid part: the boom of a large crane."""
MODEL: Final = (0.01, 20.0)
"""m, of all shapes of a model that moves."""
SHARED: Final = 0.25
"""Share of the smaller bounding box that collision and visual shapes have in common."""
SCALED: Final = 2.5
"""Ratio of the largest edges of both boxes."""
ROUND_BOX: Final = 0.01
"""m by which each box is larger than the shapes: flat and thin parts would share nothing."""
GAP: Final = (0.02, 0.05)
"""m, and share of the model's size, between a body and what carries it."""
AXIS: Final = (0.05, 0.25)
"""m, and share of the size of what turns, between it and the axis it turns about."""
NEIGHBOURS: Final = 0.25
"""Share of the smaller inner radius by which neighbours may overlap: housings around one joint do."""
ALIKE: Final = 1e-9
"""m, and of quaternions: two shapes at one place."""
FIXED: Final = 0.002
"""m by which a body may overlap a parent that is fixed to the world: some loaders test such neighbours for contact."""
MOST_PAIRS: Final = 400
"""Pairs of shapes of two neighbours that are looked at, those of the largest shapes first."""


class Places:
    """The rigid groups of a world at the initial positions; ``foreign``: whether a body comes from a robot file. Of others it
    is no mistake if they cannot be touched, are drawn otherwise than they collide, or hang in the air."""

    def __init__(self, world: World, foreign: Callable[[str], bool]):
        self.world, self.foreign = world, foreign
        self.at = poses(world)
        self.groups = rigid_groups(world)
        self.kinematic = {motion.body for motion in world.motions}
        members: dict[str, list[Body]] = {}
        for body in world.bodies:
            members.setdefault(self.groups[body.name], []).append(body)
        self.members = members
        self.parts = {
            name: part_of(name, [(body, self.at[body.name]) for body in bodies], lumps_of(world))
            for name, bodies in members.items()
        }
        self.moving = {name for name in members if name != "world" and name not in self.kinematic}

    def findings(self) -> Iterator[PlausibilityFinding]:
        """All findings about places."""
        yield from self._sizes()
        yield from self._without_collision()
        yield from self._shape_mismatch()
        yield from self._twice()
        yield from self._joints()
        yield from self._overlaps()

    def _sizes(self) -> Iterator[PlausibilityFinding]:
        for name in sorted(self.moving):
            size = self.parts[name].size
            if size > LARGEST_LINK:
                message = f"a moving link of {size:.4g} m"
                path = f"bodies.{name}.shapes"
                yield PlausibilityFinding("size", Grade.WARNING, name, message, size, "m", size / LARGEST_LINK, path)
        for root, bodies in trees(self.world).items():
            moves = any(self.groups[body.name] in self.moving for body in bodies)
            size = extent(self._solids(bodies)) if moves else 0.0
            severity = max(MODEL[0] / size, size / MODEL[1]) if size else 0.0
            if severity > 1.0:
                message = f"the whole model spans {size:.3g} m"
                path = f"bodies.{root}.shapes"
                grade = Grade.WARNING if self.foreign(root) else Grade.NOTE
                yield PlausibilityFinding("size", grade, root, message, size, "m", severity, path)

    def _solids(self, bodies: tuple[Body, ...] | list[Body]) -> tuple[Lump, ...]:
        return tuple(lump for body in bodies for lump in self._lumps(body))

    def _lumps(self, body: Body) -> list[Lump]:
        return [lump.at(self.at[body.name]) for lump in lumps_of(self.world)[body.name]]

    # --- collision and visual shapes --------------------------------------------------------------------------------------

    def _without_collision(self) -> Iterator[PlausibilityFinding]:
        bare = [
            name
            for name in sorted(self.moving)
            if self.foreign(name)
            and self.parts[name].inertial.mass
            and self.parts[name].solids
            and not self.parts[name].some(True)
        ]
        if not bare:
            return
        none_at_all = not any(part.some(True) for name, part in self.parts.items() if name in self.moving)
        grade = Grade.WARNING if none_at_all else Grade.NOTE
        for name in bare:
            message = "moves and has mass and visual shapes, and no collision shape"
            if none_at_all:
                message += "; nor has any other link"
            kilograms = self.parts[name].inertial.mass
            yield PlausibilityFinding(
                "no-collision", grade, name, message, kilograms, "kg", kilograms, f"bodies.{name}.shapes"
            )

    def _shape_mismatch(self) -> Iterator[PlausibilityFinding]:
        for name, part in sorted(self.parts.items()):
            hard, seen = part.some(True), part.some(False)
            if name == "world" or not self.foreign(name) or not hard or not seen:
                continue
            hard_box, seen_box = _boxed(hard), _boxed(seen)
            shared = np.clip(
                np.minimum(hard_box[1], seen_box[1]) - np.maximum(hard_box[0], seen_box[0]), 0.0, None
            ).prod()
            smaller = min((hard_box[1] - hard_box[0]).prod(), (seen_box[1] - seen_box[0]).prod())
            share = float(shared / smaller)
            scale = float((hard_box[1] - hard_box[0]).max() / (seen_box[1] - seen_box[0]).max())
            path = f"bodies.{name}.shapes"
            if share < SHARED:
                message = f"collision and visual shapes share {100.0 * share:.2g} % of the smaller bounding box"
                severity = SHARED / max(share, 1e-3)
                yield PlausibilityFinding("shapes-apart", Grade.WARNING, name, message, share, "", severity, path)
            elif not 1.0 / SCALED <= scale <= SCALED:
                message = f"the collision shapes have {scale:.3g} times the size of the visual ones"
                severity = max(scale, 1.0 / scale) / SCALED
                yield PlausibilityFinding("shapes-apart", Grade.NOTE, name, message, scale, "", severity, path)

    def _twice(self) -> Iterator[PlausibilityFinding]:
        for body in self.world.bodies:
            seen: dict[tuple[object, ...], list[int]] = {}
            for index, shape in enumerate(body.shapes):
                if not shape.collision:
                    continue
                alike = seen.setdefault((shape.kind, shape.size, shape.material), [])
                place = np.array((*shape.pose.position, *shape.pose.quaternion))
                for other in alike:
                    pose = body.shapes[other].pose
                    if np.abs(place - np.array((*pose.position, *pose.quaternion))).max() <= ALIKE:
                        message = f"two equal collision shapes ({shape.kind}) at one place"
                        path = f"bodies.{body.name}.shapes.{index}"
                        yield PlausibilityFinding(
                            "shape-twice", Grade.WARNING, body.name, message, 2.0, "shapes", 1.0, path
                        )
                        break
                alike.append(index)

    # --- joints -----------------------------------------------------------------------------------------------------------

    def _joints(self) -> Iterator[PlausibilityFinding]:
        by_name = {body.name: body for body in self.world.bodies}
        tree_size = {
            body.name: extent(self._solids(bodies)) for bodies in trees(self.world).values() for body in bodies
        }
        for name, carrier in carrying(self.world).items():
            body, part, parent = by_name[name], self.parts[name], self._carrier(carrier, by_name[name])
            if part.solids and parent:
                yield from self._gap(body, part, parent, carrier, tree_size[name])
            if part.solids and body.joint.kind == "hinge":
                yield from self._axis(body, part, parent)
            if part.some(True) and parent:
                yield from self._neighbours(body, carrier)

    def _carrier(self, carrier: str, child: Body) -> tuple[Lump, ...]:
        """The shapes of what carries a body; of what cannot move those of the body's tree alone."""
        if carrier != "world":
            return self.parts[carrier].solids
        tree = next(bodies for bodies in trees(self.world).values() if child in bodies)
        return self._solids([body for body in tree if self.groups[body.name] == "world"])

    def _gap(
        self, body: Body, part: MotionPart, parent: tuple[Lump, ...], carrier: str, size: float
    ) -> Iterator[PlausibilityFinding]:
        distance = gap(part.solids, parent)
        limit = max(GAP[0], GAP[1] * size)
        if distance > limit:
            above = carrier if carrier != "world" else str(body.joint.parent)
            message = f"{1e3 * distance:.4g} mm away from {above}, {100.0 * distance / size:.2g} % of the model's size"
            path = f"bodies.{body.name}.joint.origin"
            grade = Grade.WARNING if self.foreign(body.name) else Grade.NOTE
            yield PlausibilityFinding("detached", grade, body.name, message, distance, "m", distance / limit, path)

    def _axis(self, body: Body, part: MotionPart, parent: tuple[Lump, ...]) -> Iterator[PlausibilityFinding]:
        joint = body.joint
        start = frames.compose(self.at[joint.parent], joint.origin) if joint.parent is not None else joint.origin
        point, axis = np.array(start.position), np.array(frames.rotate(start.quaternion, joint.axis))
        away = axis_distance(part.solids, point, axis)
        limit = max(AXIS[0], AXIS[1] * part.size)
        if away <= limit:
            return
        other = axis_distance(parent, point, axis) if parent else away
        grade = Grade.WARNING if other > limit and self.foreign(body.name) else Grade.NOTE
        message = f"the axis passes what it turns at {1e3 * away:.4g} mm, {100.0 * away / part.size:.3g} % of its size"
        path = f"bodies.{body.name}.joint.origin"
        yield PlausibilityFinding("axis-apart", grade, joint.name, message, away, "m", away / limit, path)

    # --- overlaps ---------------------------------------------------------------------------------------------------------

    def _overlaps(self) -> Iterator[PlausibilityFinding]:
        inner = {lump.shape.name: lump.inner for lumps in lumps_of(self.world).values() for lump in lumps}
        index = {shape.name: (body.name, k) for body in self.world.bodies for k, shape in enumerate(body.shapes)}
        for overlap in deep_overlaps(self.world):
            name = overlap.second if self.groups[overlap.second_body] != "world" else overlap.first
            body, number = index[name]
            message = f"overlap by {1e3 * overlap.depth:.4g} mm at the initial positions"
            smaller = min(inner.get(overlap.first, np.inf), inner.get(overlap.second, np.inf))
            severity = overlap.depth / (DEEP * smaller) if np.isfinite(smaller) else 1.0
            element = f"{overlap.first_body} and {overlap.second_body}"
            path = f"bodies.{body}.shapes.{number}"
            yield PlausibilityFinding(
                "overlap-start", Grade.WARNING, element, message, overlap.depth, "m", severity, path
            )

    def _neighbours(self, body: Body, carrier: str) -> Iterator[PlausibilityFinding]:
        """The deepest overlap of a body with its parent in the world, which contact between them ignores."""
        if body.joint.kind not in SCALAR_JOINTS and body.joint.kind != "ball":
            return
        some = [lump for lump in self._lumps(body) if lump.shape.collision]
        above = next(entry for entry in self.world.bodies if entry.name == body.joint.parent)
        others = [lump for lump in self._lumps(above) if lump.shape.collision]
        pairs = sorted(
            ((lump, other) for lump in some for other in others), key=lambda pair: -min(pair[0].inner, pair[1].inner)
        )
        deepest, worst = 0.0, 0.0
        for entry, other in pairs[:MOST_PAIRS]:
            if np.linalg.norm(entry.centre - other.centre) >= entry.outer + other.outer:
                continue
            depth = -separation(entry, other)
            share = depth / (FIXED if carrier == "world" else NEIGHBOURS * min(entry.inner, other.inner))
            if share > 1.0 and share > worst:
                deepest, worst = depth, share
        if worst > 1.0:
            message = f"overlap by {1e3 * deepest:.4g} mm at the initial positions"
            if carrier == "world":
                message += "; the parent is fixed to the world"
            path = f"bodies.{body.name}.joint.origin"
            element = f"{above.name} and {body.name}"
            yield PlausibilityFinding("overlap-neighbours", Grade.NOTE, element, message, deepest, "m", worst, path)


def _boxed(solids: tuple[Lump, ...]) -> tuple[Floats, Floats]:
    low, high = box(solids)
    return low - ROUND_BOX, high + ROUND_BOX
