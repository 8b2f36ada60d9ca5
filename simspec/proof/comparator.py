"""The one comparator: a world against what an engine, or an independent reader of a file, says it holds.

Fields that a read-back declares unreadable are left out here and named in the certificate. Two things are not compared
because they move nothing: colours, and turns that a shape's symmetry makes meaningless (any turn of a sphere, turns of a
cylinder or a capsule about its axis, half a turn of a box or an ellipsoid, shifts of a plane within itself).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from simspec.contact import Rules, combined, contact_plan
from simspec.control.reference import natives
from simspec.engines.kit.capabilities import DOUBLE
from simspec.language.vocabulary import COMBINED_QUANTITIES, QUATERNION_JOINTS, SCALAR_JOINTS, TREE_JOINTS
from simspec.proof.checks import (
    PRECISIONS,
    TEXT_TOLERANCE,
    Check,
    Precision,
    Tally,
    distance,
    field_distance,
    hull_distance,
    pose_difference,
    relative,
    table_differences,
    turn_between,
    unlikeness,
)
from simspec.world.actions import InertiaBox
from simspec.world.contact_pairs import meeting_laws, shape_pairs
from simspec.world.frames import quaternion, sorted_pair
from simspec.world.hull import HullError, hull_within_margin, thickened
from simspec.world.inertia import lumped, lumped_gravity_scale, rigid_members, summed_inertial
from simspec.world.kinematics import members as ends_of
from simspec.world.kinematics import rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import (
    Body,
    ConnectConstraint,
    FollowConstraint,
    Hardness,
    Inertial,
    Joint,
    PairContact,
    Pose,
    Quaternion,
    ReadBack,
    Shape,
    Surface,
    WeldConstraint,
    World,
)

LEVELS = {"mass": "L1", "joint": "L2", "geometry": "L4"}
"""The proof level of each part of a model."""
Limits = tuple[float, float] | None
JOINT_NUMBERS = (
    *("damping", "dry_friction", "armature", "spring_stiffness", "spring_rest", "velocity_limit", "effort_limit"),
)
FREE_NUMBERS = ("damping", "angular_damping", "armature", "angular_armature")
HULL = "shape hull"
"""Name of the check of meshes, whose tolerance an engine may declare."""
FIELD = "height field"
"""Name of the check of height fields."""
SINGLE = 2.0**-22
"""Share of its extent by which a height field in an engine may be off: both that have some keep numbers of 24 bits, each off by
2⁻²⁵ of itself at most, and a share of a range, or a place, is made of a few of them (1e-8 measured)."""


def compare(
    world: World,
    read_back: ReadBack,
    rules: Rules,
    layers: bool,
    text: bool = False,
    accepted_cone: str | None = None,
    hull_precision: float = 0.0,
    precision: Precision = PRECISIONS[DOUBLE],
) -> list[Check]:
    """Compare ``read_back`` with ``world``; ``rules``, ``layers``, ``hull_precision`` and ``precision`` are the engine's (see
    ``engines/kit/contract.py``).

    ``text`` = an independent reading of the files: everything is level L0. ``accepted_cone``: a friction cone that the spec
    accepts in place of the world's.
    """
    return _Comparison(world, read_back, rules, layers, text, accepted_cone, hull_precision, precision).run()


@dataclass
class _Comparison:
    """Notes what a read-back holds other than the world."""

    world: World
    read_back: ReadBack
    rules: Rules
    layers: bool
    text: bool
    accepted_cone: str | None
    hull_precision: float
    precision: Precision

    def __post_init__(self) -> None:
        self.plan = contact_plan(self.world, self.rules, self.layers)
        self.tally = Tally()
        self.tolerance = TEXT_TOLERANCE if self.text else self.precision.model
        self.hull_tolerance = self.tolerance if self.text else max(self.tolerance, self.hull_precision)
        self.levels = dict.fromkeys(LEVELS, "L0") if self.text else LEVELS
        self.surfaces: dict[tuple[str, int], dict[Surface, str]] = {}
        """Of each material in each layer the different numbers of its shapes, each with one place."""

    def run(self) -> list[Check]:
        expected = {body.name: body for body in self.world.bodies}
        actual = {body.name: body for body in self.read_back.bodies}
        # not of ``actual``, in which a repeated body stands once
        self.same("mass", "bodies", sorted(expected), sorted(body.name for body in self.read_back.bodies), "bodies")
        groups, lumped_bodies = rigid_groups(self.world), lumped(self.world)
        self.rigid_groups(lumped_bodies)
        for name, body in expected.items():
            if name in actual:
                self.body(body, actual[name], name in lumped_bodies, groups[name] != "world")
        self.pairs()
        if self.readable("control.native"):
            self.servos()
        self.constraints()
        self.sums()
        self.frames()
        physics = self.world.physics
        if self.readable("gravity"):
            strength = max(1.0, _length(physics.gravity))
            self.vector("geometry", "gravity", physics.gravity, self.read_back.gravity, "physics.gravity", strength)
        self.fluid()
        if self.readable("timestep"):
            self.number("geometry", "timestep", physics.timestep, self.read_back.timestep, "physics.timestep")
        solid = any(shape.collision for body in self.world.bodies for shape in body.shapes)
        if self.readable("friction_cone") and solid:
            cone = self.read_back.friction_cone
            wanted = cone if cone == self.accepted_cone else self.world.contact.friction_cone
            self.same("geometry", "friction cone", wanted, cone, "contact.friction_cone")
        return self.tally.checks()

    def readable(self, field: str) -> bool:
        return field not in self.read_back.unreadable

    def note(self, part: str, name: str, deviation: float | None, where: str, detail: str = "") -> None:
        self.tally.add(self.levels[part], name, self.tolerance, deviation, where, detail)

    def same(self, part: str, name: str, expected: object, actual: object, where: str) -> bool:
        return self.tally.equal(self.levels[part], name, expected, actual, where)

    def number(self, part: str, name: str, expected: float | None, actual: float | None, where: str) -> None:
        if (expected is None) != (actual is None):
            self.note(part, name, None, where, f"{actual}, should be {expected}")
        elif expected is not None and actual is not None:
            self.note(part, name, relative(expected, actual), where, f"{actual!r}, should be {expected!r}")
        else:
            self.note(part, name, 0.0, where)

    def vector(
        self, part: str, name: str, expected: Sequence[float], actual: Sequence[float], where: str, scale: float = 1.0
    ) -> None:
        if len(expected) != len(actual):
            self.note(part, name, None, where, f"{len(actual)} numbers, should be {len(expected)}")
        else:
            detail = f"{tuple(actual)}, should be {tuple(expected)}"
            self.note(part, name, distance(expected, actual, scale), where, detail)

    def place(self, part: str, name: str, expected: Sequence[float], actual: Sequence[float], where: str) -> None:
        """A vector relative to the larger of 1 and its length."""
        self.vector(part, name, expected, actual, where, max(1.0, _length(expected)))

    def turn(self, part: str, name: str, expected: Quaternion, actual: Quaternion, where: str) -> None:
        self.note(part, name, turn_between(expected, actual), where, f"{actual}")

    def pose(self, part: str, name: str, expected: Pose, actual: Pose, where: str) -> None:
        self.place(part, f"{name}, position", expected.position, actual.position, where)
        self.turn(part, f"{name}, orientation", expected.quaternion, actual.quaternion, where)

    def named(
        self, part: str, name: str, expected: Mapping[str, Any], actual: Sequence[tuple[str, Any]], where: str
    ) -> Iterator[tuple[Any, Any]]:
        """The pairs of the same name, after noting whether the names are the same; a repeated name counts as often."""
        names = sorted(key for key, _ in actual)
        if expected or names:
            self.same(part, name, sorted(expected), names, where)
        return ((expected[key], entry) for key, entry in actual if key in expected)

    def entries(self, part: str, name: str, where: str) -> Iterator[tuple[Any, Any]]:
        """:meth:`named` of a field that world and read-back have under the same name."""
        expected = {entry.name: entry for entry in getattr(self.world, name)}
        return self.named(part, name, expected, [(entry.name, entry) for entry in getattr(self.read_back, name)], where)

    def body(self, body: Body, actual: Body, is_lumped: bool, moves: bool) -> None:
        where = f"bodies.{body.name}"
        if not is_lumped and (moves or (self.readable("static.inertial") and body.inertial.mass)):
            self.inertial(body.inertial, actual.inertial, where)
        self.joint(body.joint, actual.joint, f"{where}.joint")
        scale = lumped_gravity_scale(self.world, body)
        if scale != 1.0 or actual.gravity_scale != 1.0:
            self.note("mass", "weight", abs(actual.gravity_scale - scale), f"{where}.gravity_scale", f"{scale:g}")
        self.box(body.box, actual.box, where)
        self.shapes(body, actual)
        if self.readable("collision_group"):
            groups = (body.collision_group, actual.collision_group)
            self.same("geometry", "collision group", *groups, f"{where}.collision_group")

    def rigid_groups(self, lumped_bodies: Mapping[str, Inertial]) -> None:
        """The sums of rigid groups that are lumped: an engine may give its inertia to any of a group's members."""
        stored = rigid_members(self.read_back.bodies) if lumped_bodies else {}
        for top, members in rigid_members(self.world.bodies).items() if lumped_bodies else ():
            if top not in lumped_bodies:
                continue
            if sorted(body.name for body, _ in stored.get(top, ())) != sorted(body.name for body, _ in members):
                self.note("mass", "bodies joined rigidly", None, f"bodies.{top}", "others than the world's")
                continue
            wanted, actual = (
                summed_inertial((body.inertial, pose) for body, pose in group) for group in (members, stored[top])
            )
            self.inertial(wanted, actual, f"bodies.{top}")

    def inertial(self, wanted: Inertial, actual: Inertial, where: str) -> None:
        """Relative to the mass, the radius of gyration (or the offset), and the trace of the tensor."""
        self.number("mass", "mass", wanted.mass, actual.mass, f"{where}.mass")
        trace = sum(wanted.inertia[:3])
        length = math.sqrt(trace / wanted.mass) if wanted.mass else 0.0
        # positions are sums of numbers of about 1 m: below that scale the last bit is absolute, 1e-16 of a metre
        scale = max(length, _length(wanted.centre_of_mass), 1e-3)
        if wanted.mass or actual.mass:  # a massless body has no centre
            centres = (wanted.centre_of_mass, actual.centre_of_mass)
            self.vector("mass", "centre of mass", *centres, f"{where}.centre_of_mass", scale)
        self.vector("mass", "inertia tensor", wanted.inertia, actual.inertia, f"{where}.inertia", trace or 1.0)

    def joint(self, wanted: Joint, actual: Joint, where: str) -> None:
        if not self.same("joint", "joint type", wanted.kind, actual.kind, f"{where}.type"):
            return
        self.same("joint", "parent", wanted.parent, actual.parent, f"{where}.parent")
        if self.readable("joint.name") and wanted.kind not in ("fixed", "free"):
            self.same("joint", "joint name", wanted.name, actual.name, f"{where}.name")
        if wanted.kind != "free":  # a free joint's origin is the world's
            self.pose("joint", "origin", wanted.origin, actual.origin, f"{where}.origin")
        if wanted.kind in SCALAR_JOINTS:
            self.vector("joint", "axis", wanted.axis, actual.axis, f"{where}.axis")
            if self.readable("joint.position_limits"):
                self.limits(wanted.position_limits, actual.position_limits, f"{where}.limits.position")
        if wanted.kind == "ball" and (wanted.angle_limit is not None or actual.angle_limit is not None):
            self.number("joint", "angle limit", wanted.angle_limit, actual.angle_limit, f"{where}.limits.angle")
        numbers = JOINT_NUMBERS if wanted.kind in TREE_JOINTS else FREE_NUMBERS if wanted.kind == "free" else ()
        for name in filter(lambda name: self.readable(f"joint.{name}"), numbers):
            values = getattr(wanted, name), getattr(actual, name)
            if wanted.kind != "free" or any(values):
                self.number("joint", _words(name), *values, f"{where}.{name}")
        if self.readable("joint.position"):
            self.position(wanted, actual, f"{where}.position")
        if self.readable("joint.velocity"):
            self.place("joint", "initial velocity", wanted.velocity, actual.velocity, f"{where}.velocity")

    def limits(self, wanted: Limits, actual: Limits, where: str) -> None:
        if (wanted is None) != (actual is None):
            self.note("joint", "position limits", None, where, f"{actual}, should be {wanted}")
        for expected_end, end in zip(wanted or (), actual or (), strict=False):
            self.number("joint", "position limits", expected_end, end, where)

    def position(self, wanted: Joint, actual: Joint, at: str) -> None:
        name = "initial position"
        if len(wanted.position) != len(actual.position):
            self.vector("joint", name, wanted.position, actual.position, at)
            return
        straight = wanted.position[:3] if wanted.kind == "free" else wanted.position if wanted.kind != "ball" else ()
        if straight:
            self.place("joint", name, straight, actual.position[: len(straight)], at)
        if wanted.kind in QUATERNION_JOINTS:
            turned = turn_between(quaternion(wanted.position[-4:]), quaternion(actual.position[-4:]))
            self.note("joint", name, turned, at, f"{actual.position}, should be {wanted.position}")

    def servos(self) -> None:
        """The engine's own controllers: one for each natively driven joint, with its gains and limit."""
        native = natives(self.world)
        rows = {name: (controller, index) for controller in native for index, name in enumerate(controller.joints)}
        stored = [(servo.joint, servo) for servo in self.read_back.servos]
        for (controller, index), servo in self.named("joint", "controllers", rows, stored, "control"):
            gains = {"kp": controller.kp, "kd": controller.kd, "effort_limit": controller.effort_limits}
            for name, values in gains.items():
                where = f"control.{controller.name}.{name}"
                self.number("joint", f"controller's {_words(name)}", values[index], getattr(servo, name), where)

    def constraints(self) -> None:
        """Constraints of joints and bodies outside the tree, by name."""
        for expected, actual in self.entries("joint", "constraints", "constraints"):
            where = f"constraints.{actual.name}"
            if not self.same("joint", "constraint type", expected.kind, actual.kind, where):
                continue
            self.same("joint", "constraint of", ends_of(expected), ends_of(actual), where)
            if isinstance(expected, FollowConstraint) and isinstance(actual, FollowConstraint):
                for name in ("ratio", "offset"):
                    self.number("joint", name, getattr(expected, name), getattr(actual, name), f"{where}.{name}")
            elif isinstance(expected, ConnectConstraint) and isinstance(actual, ConnectConstraint):
                for name in ("first_point", "second_point"):
                    points = getattr(expected, name), getattr(actual, name)
                    self.place("joint", "held point", *points, f"{where}.{name}")
            elif isinstance(expected, WeldConstraint) and isinstance(actual, WeldConstraint):
                wanted, stored, at = expected.pose, actual.pose, f"{where}.pose"
                self.place("joint", "held point", wanted.position, stored.position, at)
                self.turn("joint", "weld, orientation", wanted.quaternion, stored.quaternion, at)

    def sums(self) -> None:
        """Springs, dampers, limits and friction along sums of joint positions, by name."""
        for expected, actual in self.entries("joint", "sums", "constraints"):
            where = f"constraints.{actual.name}.sum"
            joints = [[joint for joint, _ in total.joints] for total in (expected, actual)]
            if self.same("joint", "sum of", joints[0], joints[1], f"{where}.joints"):
                for (joint, weight), (_, value) in zip(expected.joints, actual.joints, strict=True):
                    self.number("joint", "coefficient", weight, value, f"{where}.joints.{joint}")
            for name in ("stiffness", "rest", "damping", "dry_friction"):
                self.number("joint", f"sum, {name}", getattr(expected, name), getattr(actual, name), f"{where}.{name}")
            nothing = (None, None)
            for ends in zip(expected.position_limits or nothing, actual.position_limits or nothing, strict=True):
                self.number("joint", "sum, limits", *ends, f"{where}.limits.position")

    def frames(self) -> None:
        """Named frames, of engines that have them."""
        if self.read_back.frames is None:
            return
        for expected, actual in self.entries("mass", "frames", "frames"):
            where = f"frames.{actual.name}"
            if self.same("mass", "frame of", expected.body, actual.body, f"{where}.body"):
                self.pose("mass", "frame", expected.pose, actual.pose, f"{where}.pose")

    def box(self, wanted: InertiaBox | None, actual: InertiaBox | None, where: str) -> None:
        """By which a body feels the fluid: the squares of its edges, which are sums of moments over a mass, relative to that of
        the longest; the orientation of its axes."""
        if wanted is None or actual is None:
            if wanted is not actual:
                self.note("mass", "box in the fluid", None, where, "missing, or unexpected")
            return
        squares, stored = ([edge * edge for edge in box.edges] for box in (wanted, actual))
        off, detail = distance(squares, stored, max(wanted.edges) ** 2), f"{actual.edges}, not {wanted.edges}"
        self.note("mass", "box in the fluid", off, where, detail)
        self.turn("mass", "box in the fluid, axes", wanted.quaternion, actual.quaternion, where)

    def fluid(self) -> None:
        """The fluid that bodies feel."""
        boxes = any(body.box is not None for body in self.world.bodies)
        wanted, actual = self.world.physics.fluid if boxes else None, self.read_back.fluid
        if wanted is None or actual is None:
            if wanted is not actual:
                self.note("geometry", "fluid", None, "physics.fluid", "missing, or unexpected")
            return
        for name in ("density", "viscosity"):
            values = getattr(wanted, name), getattr(actual, name)
            self.number("geometry", f"{name} of the fluid", *values, f"physics.fluid.{name}")
        velocities = (wanted.velocity, actual.velocity)
        self.place("geometry", "velocity of the fluid", *velocities, "physics.fluid.velocity")

    def shapes(self, body: Body, actual: Body) -> None:
        where = f"bodies.{body.name}.shapes"
        left = list(actual.shapes)
        for index, shape in enumerate(body.shapes):
            if not shape.collision and not self.readable("shape.visual"):
                continue
            at = f"{where}.{index}"
            same_kind = [other for other in left if other.kind == shape.kind and other.collision == shape.collision]
            if not same_kind:
                kinds = ", ".join(f"{o.kind}{'' if o.collision else ' (not solid)'}" for o in left) or "nothing"
                self.note("geometry", "shape type", None, at, f"{kinds}, should be {shape.kind}")
                continue
            self.note("geometry", "shape type", 0.0, at)
            other = min(same_kind, key=partial(unlikeness, shape))
            left.remove(other)
            self.shape(shape, other, at)
        extra = [shape for shape in left if shape.collision or self.readable("shape.visual")]
        if extra:
            self.note("geometry", "shape type", None, where, f"{len(extra)} more than the world has ({extra[0].kind})")

    def shape(self, shape: Shape, other: Shape, at: str) -> None:
        if SHAPES[shape.kind].points or SHAPES[shape.kind].grid:
            self.surface(shape, other, f"{at}.size")
        else:
            largest = max(shape.size, default=1.0)
            size = thickened(shape.kind, shape.size, other.rounding) if other.rounding else shape.size
            self.vector("geometry", "shape size", size, other.size, f"{at}.size", largest)
        away, turned = pose_difference(shape, other)
        reach = max(1.0, _length(shape.pose.position))
        self.note("geometry", "shape position", away / reach, f"{at}.pose", f"{other.pose.position}")
        self.note("geometry", "shape orientation", turned, f"{at}.pose", f"{other.pose.quaternion}")
        if self.readable("shape.visual") and shape.collision:
            self.same("geometry", "visible", shape.visual, other.visual, f"{at}.visual")
        moving, stored = shape.surface_velocity, other.surface_velocity
        if any(moving) or any(stored):
            off = max(abs(value - actual) for value, actual in zip(moving, stored, strict=True))
            largest = max(1.0, *map(abs, moving))
            self.note("geometry", "surface velocity", off / largest, f"{at}.surface_velocity", f"{stored}")
        if not shape.collision:
            return
        if shape.margin or other.margin:
            self.note("geometry", "margin", abs(shape.margin - other.margin), f"{at}.margin", f"{other.margin:g} m")
        if other.material:
            self.same("geometry", "material", shape.material, other.material, at)
        layers = self.plan.layers(shape.material)
        if self.same("geometry", "copies of a shape", len(layers), len(other.surfaces), at):
            for layer, surface in zip(layers, other.surfaces, strict=True):
                self.surfaces.setdefault((shape.material, layer), {}).setdefault(surface, at)

    def surface(self, shape: Shape, other: Shape, at: str) -> None:
        """Two hulls as solids, since engines order and drop vertices as they like; two height fields as surfaces."""
        is_hull = SHAPES[shape.kind].points
        tolerance = self.hull_tolerance if is_hull else max(self.tolerance, 0.0 if self.text else SINGLE)
        wrong, deviation = SHAPES[other.kind].wrong_size(other.size), None
        try:
            if wrong is None and is_hull:
                deviation = hull_distance(hull_within_margin(shape.size, other.rounding), other.size, tolerance)
            elif wrong is None:
                deviation = field_distance(shape.size, other.size)
        except HullError as error:
            wrong = f"with {other.rounding} m around it: {error}"
        if is_hull:
            detail = f"{len(other.size) // 3} vertices, should be the hull of {len(shape.size) // 3}"
        else:
            detail = "" if deviation is None else f"its surface is off by {deviation:.3g} of its extent"
        self.tally.add(self.levels["geometry"], HULL if is_hull else FIELD, tolerance, deviation, at, wrong or detail)

    def pairs(self) -> None:
        """Each pair of materials that can meet: the shapes' numbers, combined by the engine's rules, against the world's;
        and each pair that the engine holds as such."""
        laws = meeting_laws(self.world)
        for pair, layer in self.plan.layer_of.items():
            if pair in self.plan.missed:
                continue
            for first, place in self.surfaces.get((pair[0], layer), {}).items():
                for second, other_place in self.surfaces.get((pair[1], layer), {}).items():
                    both = place if place == other_place else f"{place} with {other_place}"
                    self.law(laws[pair], first, second, both)
        if self.rules.table:
            for row in table_differences(laws, self.read_back.laws):
                self.note("geometry", *row)
        self.explicit(laws)

    def law(self, law: PairContact, first: Surface, second: Surface, at: str) -> None:
        """Two shapes' numbers against the law of their materials."""
        for quantity in COMBINED_QUANTITIES:
            if not self.rules.combines(quantity) or not self.readable(f"shape.{quantity}"):
                continue
            needed = (quantity, "friction") if getattr(self.rules, quantity) == "cross" else (quantity,)
            if any(getattr(surface, name) is None for surface in (first, second) for name in needed):
                self.note("geometry", _words(quantity), None, at, "no number")
            else:
                actual = combined(self.rules, quantity, first, second)
                self.number("geometry", _words(quantity), getattr(law, quantity), actual, at)
        if self.rules.hardness == "same" and self.readable("shape.hardness"):
            for surface in (first, second):
                self.hardness(law.hardness, surface.hardness, at)

    def hardness(self, wanted: Hardness, actual: Hardness | None, at: str) -> None:
        if actual is None or wanted.kind != actual.kind:
            self.note("geometry", "hardness", None, at, f"{actual}, should be {wanted}")
            return
        self.note("geometry", "hardness", 0.0, at)
        for name in ("time_constant", "damping_ratio", "stiffness", "damping"):
            self.number("geometry", "hardness", getattr(wanted, name), getattr(actual, name), at)

    def explicit(self, laws: Mapping[tuple[str, str], PairContact]) -> None:
        """Pairs of shapes that the engine holds as such, and that all of those are there which numbers cannot give."""
        material = {shape.name: shape.material for body in self.world.bodies for shape in body.shapes}
        margins = {shape.name: shape.margin for body in self.world.bodies for shape in body.shapes}
        listed = set()
        for pair in self.read_back.pairs:
            at = f"pair {pair.first}, {pair.second}"
            listed.add((pair.first, pair.second))
            both = sorted_pair(material.get(pair.first, ""), material.get(pair.second, ""))
            if both not in laws:
                self.note("geometry", "explicit pair", None, at, "these two never touch")
                continue
            law = laws[both]
            margin = margins[pair.first] + margins[pair.second] if law.margin is None else law.margin
            if margin or pair.margin:
                self.note("geometry", "margin", abs(margin - pair.margin), at, f"{pair.margin:g} m")
            for quantity in COMBINED_QUANTITIES:
                value = getattr(pair.surface, quantity)
                if value is not None:
                    self.number("geometry", _words(quantity), getattr(law, quantity), value, at)
            if pair.surface.hardness is not None:
                self.hardness(law.hardness, pair.surface.hardness, at)
        needed = {*self.plan.missed, *(pair for pair, law in laws.items() if law.margin is not None)}
        for pair_of_shapes in shape_pairs(self.world, sorted(needed)) if needed else ():
            there = pair_of_shapes in listed
            where, detail = f"pair {', '.join(pair_of_shapes)}", "" if there else "is not there"
            self.note("geometry", "explicit pair", 0.0 if there else None, where, detail)


def _words(quantity: str) -> str:
    return quantity.replace("_", " ")


def _length(vector: Sequence[float]) -> float:
    return math.sqrt(sum(x * x for x in vector))
