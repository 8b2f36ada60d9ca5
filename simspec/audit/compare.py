"""Comparison of the model in an engine with the meaning of the file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from simspec.audit import AuditFinding, FindingSeverity, What
from simspec.audit.meaning import WORLD, Meaning, folded, full, groups_of, match, parents_first, plain_text, zero_poses
from simspec.engines.kit.foreign import AXES, MESH, EngineAddition, directions
from simspec.imports.draft import NOT_POSITIVE
from simspec.imports.draft import RULE as TRIANGLE
from simspec.language.moments import principal_moments
from simspec.language.vocabulary import SCALAR_JOINTS, TREE_JOINTS
from simspec.proof.checks import relative, turn_between, unlikeness
from simspec.world import frames
from simspec.world.types import Body, EngineValue, Inertial, Joint, Pose, ReadBack, Shape

# Collision shapes of a body in a file and in an engine: matched by what they are like, since few engines keep names.

SAME_SHAPE: Final = 1e-5
"""m, of sizes and places of shapes: engines keep vertices of meshes, and some shapes, in single precision."""
MESH_SHARE: Final = 2e-4
"""Share of a mesh's extent by which an engine may round its vertices."""


def compare_shapes(comparison: FileComparison, body: Body, said: Sequence[Shape], actual: Sequence[Shape]) -> None:
    """Add findings about the shapes of a body."""
    solid = [shape for shape in said if shape.collision]
    left = [shape for shape in actual if shape.collision]
    if not comparison.knows_meshes:
        left = [shape for shape in left if shape.kind != MESH]  # the file's own were not read
    for shape in solid:
        if not comparison.compares(body, "shapes"):
            return
        near = min(left, key=lambda other: _distance(shape, other), default=None)
        if near is None:
            comparison.add(What.DROPPED, FindingSeverity.PHYSICS, body, "shapes", shape_text(shape), None)
            continue
        left.remove(near)
        distance = _distance(shape, near)
        if distance > (max(SAME_SHAPE, MESH_SHARE * _extent(shape)) if shape.kind == MESH else SAME_SHAPE):
            size = None if math.isinf(distance) else distance
            comparison.add(
                What.CHANGED, FindingSeverity.PHYSICS, body, "shapes", shape_text(shape), shape_text(near), "", size
            )
    for shape in left:
        comparison.add(What.ADDED, FindingSeverity.PHYSICS, body, "shapes", None, shape_text(shape))
    seen, actual_seen = (sum(shape.visual for shape in shapes) for shapes in (said, actual))
    if seen and not actual_seen:
        comparison.add(What.DROPPED, FindingSeverity.APPEARANCE, body, "shapes", f"{seen} that are seen", "none")


def _extent(shape: Shape) -> float:
    points = np.array(shape.size, dtype=float).reshape(-1, 3)
    return float((points.max(axis=0) - points.min(axis=0)).max()) if len(points) else 0.0


def _distance(shape: Shape, other: Shape) -> float:
    """The distance of two shapes (m, rad); infinite where they are of different kinds."""
    if shape.kind != other.kind:
        return math.inf
    if shape.kind == MESH:
        return _mesh_distance(shape, other)
    return unlikeness(shape, other) - (0.0 if shape.name == other.name else 1e-6)


def _mesh_distance(shape: Shape, other: Shape) -> float:
    """The largest difference of the support functions, in the axes of the engine's shape; nan-free. ``shape.size`` are
    vertices, ``other.size`` is a support function (``engines/kit/foreign.py``)."""
    if not other.size or not shape.size:
        return math.inf
    place = frames.compose(frames.inverse(other.pose), shape.pose)
    points = np.array(shape.size, dtype=float).reshape(-1, 3) @ np.array(frames.matrix(place.quaternion)).T
    points = points + np.array(place.position)
    count = AXES if len(other.size) == AXES else len(directions())
    reach = (points @ directions()[:count].T).max(axis=0)
    return float(np.abs(reach - np.array(other.size[:count])).max())


def shape_text(shape: Shape) -> str:
    if shape.kind == MESH:
        return "mesh"
    return " ".join([shape.kind, *(f"{value:.5g}" for value in shape.size)])


SAME: Final = 1e-6
"""Relative, and in m or rad: engines keep some numbers in single precision, whose round-off is 1e-7."""
NO_TENSOR: Final = "a tensor that no body has"
NO_ROOT: Final = "the file does not say whether its root is fixed"
STUCK: Final = 0.9
"""Share of a free model's mass from which it is another model if that cannot move: it does not fall, and nothing pushes it."""
UNPHYSICAL: Final = (TRIANGLE, NOT_POSITIVE)
"""Rules of repair of tensors that no body has."""
LEAST_SHARE: Final = 1e-9
"""Share of the largest moment below which a product of inertia is not reported."""
LEAST_INERTIA: Final = 1e-12
"""kg m²: a tensor below this is none."""
RATINGS: Final = ("velocity_limit", "effort_limit")
SCALARS: Final = {
    "velocity_limit": (None, "m/s or rad/s"),
    "effort_limit": (None, "N or N m"),
    "damping": (0.0, ""),
    "dry_friction": (0.0, ""),
    "armature": (0.0, ""),
    "spring_stiffness": (0.0, ""),
}
"""Numbers of a joint, what stands for none of it, and their unit."""


class FileComparison:
    """Collects findings of one engine about one file; ``compared`` counts values that were actual against each other."""

    def __init__(self, engine: str, meaning: Meaning, actual: ReadBack, extras: Mapping[str, EngineAddition]):
        self.engine, self._meaning, self._actual, self._extras = engine, meaning, actual, extras
        self.findings: list[AuditFinding] = []
        self.compared = 0
        imported = meaning.imported
        lost = imported.losses() if imported is not None else []
        repairs = imported.repairs if imported is not None else []
        paths = [repair.path.split(".") for repair in repairs if repair.rule in UNPHYSICAL]
        self._unphysical = {name for path in paths if path[-1] == "inertia" for name in path[-2:-1]}
        self.knows_meshes = not any(MESH in account.what for account in lost)
        """Whether meshes of the file were read."""
        self._matched = match(meaning.bodies, actual.bodies)
        self._at, self._actual_at = zero_poses(meaning.bodies), zero_poses(actual.bodies)
        self._group, self._actual_group = groups_of(meaning.bodies), groups_of(actual.bodies)

    def run(self) -> FileComparison:
        """Compare everything."""
        if self._meaning.bodies:
            self._missing()
            for body in self._meaning.bodies:
                partner = self._matched.partners.get(body.name)
                if partner is not None:
                    self._body(body, partner)
                elif body.joint.kind in TREE_JOINTS:
                    self.add(What.DROPPED, FindingSeverity.PHYSICS, body, "joint", body.joint.kind, None)
            self._static()
            self._extra()
        self._inventory()
        return self

    def add(
        self,
        what: What,
        severity: FindingSeverity,
        body: Body | None,
        quantity: str,
        file_value: Any,
        engine_value: Any,
        why: str = "",
        size: float | None = None,
    ) -> None:
        """A finding about a body, or about the file as a whole."""
        element = body.name if body is not None else "the file"
        path = f"bodies.{body.name}.{quantity}" if body is not None else f"physics.{quantity}"
        location = self._meaning.locate(path) if body is not None or quantity == "gravity" else None
        values = plain_text(file_value), plain_text(engine_value)
        self.findings.append(AuditFinding(self.engine, what, severity, element, quantity, *values, location, why, size))

    def compares(self, body: Body, quantity: str) -> bool:
        """Whether a value of the file can be actual against the engine's; counts it."""
        tail = quantity.rpartition(".")[2]
        if {quantity, tail} & self._actual.unreadable.keys():
            return False
        if any(f"{body.name}.{quantity}.".startswith(f"{path}.") for path in self._meaning.unsure):
            return False
        self.compared += 1
        return True

    def _missing(self) -> None:
        for body in self._meaning.bodies:
            carrier = self._matched.carrier[body.name]
            if carrier == body.name:
                continue
            if carrier is None:
                self.add(What.DROPPED, FindingSeverity.PHYSICS, body, "body", "a body", None)
            elif body.joint.kind == "free":
                severity, why, share = self._stuck(body)
                value = f"part of {carrier}, {100.0 * share:.3g} % of the mass cannot move"
                self.add(What.MERGED, severity, body, "body", "a body", value, why)
            else:
                self.add(What.MERGED, FindingSeverity.INFORMATION, body, "body", "a body", f"part of {carrier}", "")

    def _stuck(self, root: Body) -> tuple[FindingSeverity, str, float]:
        """The effect of an engine that fixes a free root to the world: severity, why, and the share of the tree's mass that
        cannot move then."""
        actual_group = self._actual_group
        roots: dict[str, str] = {}
        for body in parents_first(self._meaning.bodies):
            roots[body.name] = body.name if body.joint.parent is None else roots[body.joint.parent]
        tree = [body for body in self._meaning.bodies if roots[body.name] == root.name]
        total, fixed = 0.0, 0.0
        for body in tree:
            carrier = self._matched.carrier[body.name]
            partner = self._matched.partners.get(carrier) if carrier is not None else None
            total += body.inertial.mass
            if carrier == WORLD or (partner is not None and actual_group[partner.name] == WORLD):
                fixed += body.inertial.mass
        share = fixed / total if total else 0.0
        if share >= STUCK:
            return FindingSeverity.PHYSICS, f"{NO_ROOT}, and {fixed:.4g} kg of {total:.4g} kg cannot move", share
        return FindingSeverity.DEFAULT, NO_ROOT, share

    def _extra(self) -> None:
        for body in self._matched.extra:
            moves = self._actual_group[body.name] != WORLD
            if body.inertial.mass and moves:
                self.add(What.ADDED, FindingSeverity.PHYSICS, body, "body", None, f"{body.inertial.mass:.6g} kg")
            elif body.joint.kind != "fixed":
                self.add(What.ADDED, FindingSeverity.INFORMATION, body, "body", None, f"a {body.joint.kind} joint")

    def _body(self, body: Body, partner: Body) -> None:
        carried = [entry for entry in self._meaning.bodies if self._matched.carrier[entry.name] == body.name]
        inertial, shapes = folded(carried, self._at, body.name)
        moves = self._group[body.name] != WORLD or self._actual_group[partner.name] != WORLD
        self._inertial(body, inertial, partner.inertial, moves)
        self._place(body, partner)
        self._joint(body, partner)
        compare_shapes(self, body, shapes, partner.shapes)

    def _inertial(self, body: Body, said: Inertial, inertial: Inertial, moves: bool) -> None:
        severity = FindingSeverity.PHYSICS if moves else FindingSeverity.INFORMATION
        why = "" if moves else "it cannot move"
        what = What.ADDED if not said.mass else What.DROPPED if not inertial.mass else What.CHANGED
        if self.compares(body, "mass") and relative(said.mass, inertial.mass) > SAME:
            off = relative(said.mass, inertial.mass)
            self.add(what, severity, body, "mass", said.mass, inertial.mass, why, off)
        if not said.mass or not inertial.mass:
            return
        away = math.dist(said.centre_of_mass, inertial.centre_of_mass)
        reach = max(1.0, math.hypot(*said.centre_of_mass))
        if self.compares(body, "centre_of_mass") and away > SAME * reach:
            values = said.centre_of_mass, inertial.centre_of_mass
            self.add(What.CHANGED, severity, body, "centre_of_mass", *values, why, away)
        if body.name in self._unphysical:
            self._replaced(body, inertial, severity)
        if not self.compares(body, "inertia"):
            return
        scale = max(float(np.abs(full(said.inertia)).max()), float(np.abs(full(inertial.inertia)).max()), LEAST_INERTIA)
        off = float(np.abs(full(said.inertia) - full(inertial.inertia)).max()) / scale
        if off > SAME:
            self.add(What.CHANGED, severity, body, "inertia", tensor_values(said), tensor_values(inertial), why, off)

    def _replaced(self, body: Body, inertial: Inertial, severity: FindingSeverity) -> None:
        """Another tensor in place of one that no body has: the file's own is repaired, and not compared."""
        self.compared += 1
        low, middle, high = principal_moments(inertial.inertia)
        if high < LEAST_INERTIA:
            self.add(
                What.DROPPED, severity, body, "inertia", NO_TENSOR, None, "the engine sets it to zero in silence", 1.0
            )
        elif low > 0.0 and low + middle >= high * (1.0 - SAME):
            self.add(
                What.CHANGED,
                severity,
                body,
                "inertia",
                NO_TENSOR,
                tensor_values(inertial),
                "the engine replaces it in silence",
            )

    def _place(self, body: Body, partner: Body) -> None:
        """Where the body stands at zero, from the nearest body below that both have, or from the world."""
        if body.joint.kind == "free" or partner.joint.kind == "free":
            return
        above = body.joint.parent
        by_name = {body.name: body for body in self._meaning.bodies}
        while above is not None and above not in self._matched.partners:
            above = by_name[above].joint.parent
        if above is None:
            start, actual_start = Pose(), Pose()
        else:
            start, actual_start = self._at[above], self._actual_at[self._matched.partners[above].name]
        said = frames.compose(frames.inverse(start), self._at[body.name])
        actual = frames.compose(frames.inverse(actual_start), self._actual_at[partner.name])
        if not self.compares(body, "joint.origin"):
            return
        away = math.dist(said.position, actual.position)
        turned = turn_between(said.quaternion, actual.quaternion)
        if away > SAME * max(1.0, math.hypot(*said.position)):
            self.add(
                What.CHANGED,
                FindingSeverity.PHYSICS,
                body,
                "joint.origin.xyz",
                said.position,
                actual.position,
                "",
                away,
            )
        if turned > SAME:
            self.add(
                What.CHANGED,
                FindingSeverity.PHYSICS,
                body,
                "joint.origin.rpy",
                said.quaternion,
                actual.quaternion,
                "",
                turned,
            )

    def _joint(self, body: Body, partner: Body) -> None:
        said, joint = body.joint, partner.joint
        if not self.compares(body, "joint.type"):
            return
        if said.kind == "fixed" and joint.position_limits == (0.0, 0.0):
            return  # one position is left to it, the one that the file says
        if said.kind != joint.kind:
            roots = said.parent is None and joint.parent is None and {said.kind, joint.kind} == {"fixed", "free"}
            severity, why = (FindingSeverity.DEFAULT, NO_ROOT) if roots else (FindingSeverity.PHYSICS, "")
            what = What.DROPPED if joint.kind == "fixed" and not roots else What.CHANGED
            if roots and said.kind == "free":
                severity, why, _ = self._stuck(body)
            self.add(what, severity, body, "joint.type", said.kind, joint.kind, why)
            return
        if said.kind in SCALAR_JOINTS:
            if self.compares(body, "joint.axis") and (away := math.dist(said.axis, joint.axis)) > SAME:
                self.add(What.CHANGED, FindingSeverity.PHYSICS, body, "joint.axis", said.axis, joint.axis, "", away)
            self._limits(body, said, joint)
        if said.kind == "fixed":
            return
        for name, (nothing, _) in SCALARS.items():
            if self.compares(body, f"joint.{name}"):
                self._scalar(body, name, getattr(said, name), getattr(joint, name), nothing)
        both = said.spring_stiffness and joint.spring_stiffness  # else there is nothing to rest
        if both and said.kind in SCALAR_JOINTS and self.compares(body, "joint.spring_rest"):
            self._scalar(body, "spring_rest", said.spring_rest, joint.spring_rest, 0.0)

    def _limits(self, body: Body, said: Joint, joint: Joint) -> None:
        if not self.compares(body, "joint.limits"):
            return
        entry, other = said.position_limits, joint.position_limits
        if entry is None and other is None:
            return
        if entry is None or other is None:
            what = What.DROPPED if other is None else What.ADDED
            self.add(what, FindingSeverity.PHYSICS, body, "joint.limits", entry, other)
        elif (away := max(abs(a - b) for a, b in zip(entry, other, strict=True))) > SAME:
            self.add(What.CHANGED, FindingSeverity.PHYSICS, body, "joint.limits", entry, other, "", away)

    def _scalar(self, body: Body, name: str, said: float | None, actual: float | None, nothing: float | None) -> None:
        entry, other = (nothing if value is None or value == 0.0 else value for value in (said, actual))
        if entry == other or (entry is not None and other is not None and relative(entry, other) <= SAME):
            return
        what = What.ADDED if entry == nothing else What.DROPPED if other == nothing else What.CHANGED
        severity = FindingSeverity.RATING if name in RATINGS else FindingSeverity.PHYSICS
        off = relative(entry or 0.0, other or 0.0) if what is What.CHANGED else None
        self.add(what, severity, body, f"joint.{name}", said, actual, "", off)

    def _static(self) -> None:
        """Shapes of bodies that became a part of the world."""
        merged = [body for body in self._meaning.bodies if self._matched.carrier[body.name] == WORLD]
        if not merged:
            return
        world = [body for body in self._matched.extra if self._actual_group[body.name] == WORLD]
        actual = folded(world, {**self._actual_at, WORLD: Pose()}, WORLD)[1] if world else ()
        _, shapes = folded(merged, {**self._at, WORLD: Pose()}, WORLD)
        compare_shapes(self, merged[0], shapes, actual)

    def _inventory(self) -> None:
        meaning, back = self._meaning, self._actual
        if meaning.gravity is not None:
            self.compared += 1
            if math.dist(meaning.gravity, back.gravity) > SAME:
                self.add(What.CHANGED, FindingSeverity.PHYSICS, None, "gravity", meaning.gravity, back.gravity)
        for name, extra in self._extras.items():
            if name not in back.inventory:
                continue
            value = back.inventory[name]
            self.compared += extra.meaning is not None
            if extra.meaning is None:
                if value or isinstance(value, bool):
                    self.add(What.ADDED, FindingSeverity(extra.changes), None, name, None, value, extra.why)
            elif not _same(extra.meaning, value):
                what = What.CHANGED if extra.meaning else What.ADDED
                self.add(what, FindingSeverity(extra.changes), None, name, extra.meaning, value, extra.why)
        frictions = sorted(
            {
                surface.friction
                for body in back.bodies
                for shape in body.shapes
                if shape.collision
                for surface in shape.surfaces
                if surface.friction is not None
            }
        )
        if frictions:
            shown = " to ".join(plain_text(value) for value in dict.fromkeys((frictions[0], frictions[-1])))
            self.add(What.ADDED, FindingSeverity.DEFAULT, None, "friction", None, shown, "sliding friction of shapes")


def tensor_values(inertial: Inertial) -> tuple[float, ...]:
    """The tensor without products of inertia that are round-off."""
    least = LEAST_SHARE * max(map(abs, inertial.inertia))
    return tuple(value for place, value in enumerate(inertial.inertia) if place < 3 or abs(value) > least)


def _same(said: EngineValue | None, engine_value: EngineValue) -> bool:
    if isinstance(said, (int, float)) and isinstance(engine_value, (int, float)) and not isinstance(said, bool):
        return abs(engine_value - said) <= SAME * max(1.0, abs(said))
    return said == engine_value


def compare(
    engine: str, meaning: Meaning, back: ReadBack, extras: Mapping[str, EngineAddition]
) -> tuple[Sequence[AuditFinding], int]:
    """Findings of what an engine holds of a file, and how many values were compared."""
    done = FileComparison(engine, meaning, back, extras).run()
    return done.findings, done.compared
