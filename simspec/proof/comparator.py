"""The one comparator: a world against what an engine, or an independent reader of a file, says it holds.

Fields that a read-back declares unreadable are left out here and named in the certificate. Two things are not compared
because they move nothing: colours, and turns that a shape's symmetry makes meaningless (any turn of a sphere, turns of a
cylinder or a capsule about its axis, half a turn of a box or an ellipsoid, shifts of a plane within itself).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

from simspec.contact.plan import contact_plan
from simspec.contact.rules import Rules, combined
from simspec.control.reference import natives
from simspec.engines.kit.capabilities import DOUBLE
from simspec.language.vocabulary import COMBINED_QUANTITIES, QUATERNION_JOINTS, SCALAR_JOINTS, TREE_JOINTS
from simspec.proof.checks import PRECISIONS, TEXT_TOLERANCE, Check, Precision, Tally
from simspec.proof.constraints import LEVELS, ConstraintComparison
from simspec.proof.distances import (
    field_distance,
    held_apart,
    hull_distance,
    pose_difference,
    table_differences,
    turn_between,
    unlikeness,
)
from simspec.world.contact_pairs import meeting_laws, shape_pairs
from simspec.world.frames import quaternion, sorted_pair
from simspec.world.hull import HullError, hull_within_margin, thickened
from simspec.world.inertia import lumped, lumped_gravity_scale, rigid_members, summed_inertial
from simspec.world.kinematics import rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import (
    Body,
    EngineValue,
    Hardness,
    Inertial,
    Joint,
    PairContact,
    ReadBack,
    Shape,
    Surface,
    World,
)

JOINT_NUMBERS = (
    "damping",
    "dry_friction",
    "armature",
    "spring_stiffness",
    "spring_rest",
    "velocity_limit",
    "effort_limit",
)
FREE_NUMBERS = ("damping", "angular_damping", "armature", "angular_armature")
INVENTORY_LEVEL, INVENTORY = "L4", "everything else held"
"""Level and name of the check of ``ReadBack.inventory``."""
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


def inventory_checks(
    expected: Mapping[str, EngineValue], actual: Mapping[str, EngineValue], precision: Precision = PRECISIONS[DOUBLE]
) -> list[Check]:
    """Everything else that an engine holds, name by name, against what it must hold; none where neither has a name.

    A name that only one side has differs in kind, as do words, flags and lengths of lists. Numbers are relative to themselves,
    small ones to ``SMALL_SHARE`` of the largest of their list.
    """
    tally = Tally()
    for name in sorted(expected.keys() | actual.keys()):
        if name not in actual:
            tally.add(INVENTORY_LEVEL, INVENTORY, precision.model, None, name, f"{name} is missing")
        elif name not in expected:
            detail = f"{name} is {actual[name]!r}, should be absent"
            tally.add(INVENTORY_LEVEL, INVENTORY, precision.model, None, name, detail)
        else:
            deviation = held_apart(expected[name], actual[name])
            detail = "" if deviation == 0.0 else f"{name} is {actual[name]!r}, should be {expected[name]!r}"
            tally.add(INVENTORY_LEVEL, INVENTORY, precision.model, deviation, name, detail)
    return tally.checks()


class _Comparison(ConstraintComparison):
    def __init__(
        self,
        world: World,
        read_back: ReadBack,
        rules: Rules,
        layers: bool,
        text: bool,
        accepted_cone: str | None,
        hull_precision: float,
        precision: Precision,
    ):
        self.world, self.read_back, self.rules, self.accepted_cone = world, read_back, rules, accepted_cone
        self.plan = contact_plan(world, rules, layers)
        self.tally = Tally()
        self.text = text
        self.tolerance = TEXT_TOLERANCE if text else precision.model
        self.hull_tolerance = self.tolerance if text else max(self.tolerance, hull_precision)
        self.levels = dict.fromkeys(LEVELS, "L0") if text else LEVELS
        self.surfaces: dict[tuple[str, int], dict[Surface, str]] = {}
        """Of each material in each layer the different numbers that shapes hold, each with one place."""

    def run(self) -> list[Check]:
        expected = {body.name: body for body in self.world.bodies}
        actual = {body.name: body for body in self.read_back.bodies}
        # not of ``actual``, in which a repeated body stands once
        names = sorted(body.name for body in self.read_back.bodies)
        self.tally.equal(self.levels["mass"], "bodies", sorted(expected), names, "bodies")
        groups, lumped_bodies = rigid_groups(self.world), lumped(self.world)
        self.rigid_groups(lumped_bodies)
        for name, body in expected.items():
            if name in actual:
                if name not in lumped_bodies:
                    self.mass(body, actual[name], moves=groups[name] != "world")
                self.joint(body.joint, actual[name].joint, f"bodies.{name}.joint")
                scale, at = lumped_gravity_scale(self.world, body), f"bodies.{name}.gravity_scale"
                if scale != 1.0 or actual[name].gravity_scale != 1.0:
                    self.note("mass", "weight", abs(actual[name].gravity_scale - scale), at, f"{scale:g}")
                self.box(body.box, actual[name].box, f"bodies.{name}")
                self.shapes(body, actual[name])
                if self.readable("collision_group"):
                    self.tally.equal(
                        self.levels["geometry"],
                        "collision group",
                        body.collision_group,
                        actual[name].collision_group,
                        f"bodies.{name}.collision_group",
                    )
        self.pairs()
        if self.readable("control.native"):
            self.servos()
        self.constraints()
        self.sums()
        self.frames()
        physics = self.world.physics
        strength = max(1.0, math.sqrt(sum(x * x for x in physics.gravity)))
        if self.readable("gravity"):
            self.vector("geometry", "gravity", physics.gravity, self.read_back.gravity, "physics.gravity", strength)
        self.fluid()
        if self.readable("timestep"):
            self.number("geometry", "timestep", physics.timestep, self.read_back.timestep, "physics.timestep")
        if self.readable("friction_cone") and any(
            shape.collision for body in self.world.bodies for shape in body.shapes
        ):
            accepted = self.read_back.friction_cone == self.accepted_cone
            cone = self.read_back.friction_cone if accepted else self.world.contact.friction_cone
            place = "contact.friction_cone"
            self.tally.equal(self.levels["geometry"], "friction cone", cone, self.read_back.friction_cone, place)
        return self.tally.checks()

    def mass(self, body: Body, actual_body: Body, moves: bool) -> None:
        """Of a body that is told its own."""
        if moves or (self.readable("static.inertial") and body.inertial.mass):
            self.inertial(body.inertial, actual_body.inertial, f"bodies.{body.name}")

    def rigid_groups(self, lumped_bodies: Mapping[str, Inertial]) -> None:
        """Of rigid groups that are told as one the sums: which of its members an engine gives what moves nothing."""
        stored = rigid_members(self.read_back.bodies) if lumped_bodies else {}
        for top, members in rigid_members(self.world.bodies).items() if lumped_bodies else ():
            if top not in lumped_bodies:
                continue
            if sorted(body.name for body, _ in stored.get(top, ())) != sorted(body.name for body, _ in members):
                self.note("mass", "bodies joined rigidly", None, f"bodies.{top}", "others than the world's")
                continue
            actual = summed_inertial((body.inertial, pose) for body, pose in stored[top])
            wanted = summed_inertial((body.inertial, pose) for body, pose in members)
            self.inertial(wanted, actual, f"bodies.{top}")

    def inertial(self, wanted: Inertial, actual: Inertial, where: str) -> None:
        """Relative to the mass, the radius of gyration (or the offset), and the trace of the tensor."""
        self.number("mass", "mass", wanted.mass, actual.mass, f"{where}.mass")
        trace = sum(wanted.inertia[:3])
        length = math.sqrt(trace / wanted.mass) if wanted.mass else 0.0
        offset = math.sqrt(sum(x * x for x in wanted.centre_of_mass))
        # positions are sums of numbers of about 1 m: below that scale the last bit is absolute, 1e-16 of a metre
        scale = max(length, offset, 1e-3)
        at = f"{where}.centre_of_mass"
        if wanted.mass or actual.mass:  # of nothing there is no centre
            self.vector("mass", "centre of mass", wanted.centre_of_mass, actual.centre_of_mass, at, scale)
        self.vector("mass", "inertia tensor", wanted.inertia, actual.inertia, f"{where}.inertia", trace or 1.0)

    def joint(self, wanted: Joint, actual: Joint, where: str) -> None:
        level = self.levels["joint"]
        if not self.tally.equal(level, "joint type", wanted.kind, actual.kind, f"{where}.type"):
            return
        self.tally.equal(level, "parent", wanted.parent, actual.parent, f"{where}.parent")
        if self.readable("joint.name") and wanted.kind not in ("fixed", "free"):
            self.tally.equal(level, "joint name", wanted.name, actual.name, f"{where}.name")
        if wanted.kind != "free":  # a free joint's origin is the world's
            place = max(1.0, math.sqrt(sum(x * x for x in wanted.origin.position)))
            at = f"{where}.origin"
            self.vector("joint", "origin, position", wanted.origin.position, actual.origin.position, at, place)
            turned = turn_between(wanted.origin.quaternion, actual.origin.quaternion)
            self.note("joint", "origin, orientation", turned, at, f"{actual.origin.quaternion}")
        if wanted.kind in SCALAR_JOINTS:
            self.vector("joint", "axis", wanted.axis, actual.axis, f"{where}.axis")
            if self.readable("joint.position_limits"):
                self.limits(wanted, actual, where)
        if wanted.kind == "ball" and (wanted.angle_limit is not None or actual.angle_limit is not None):
            self.number("joint", "angle limit", wanted.angle_limit, actual.angle_limit, f"{where}.limits.angle")
        numbers = JOINT_NUMBERS if wanted.kind in TREE_JOINTS else FREE_NUMBERS if wanted.kind == "free" else ()
        for name in numbers:
            if self.readable(f"joint.{name}"):
                at = f"{where}.{name}"
                if wanted.kind != "free" or getattr(wanted, name) or getattr(actual, name):
                    self.number("joint", name.replace("_", " "), getattr(wanted, name), getattr(actual, name), at)
        if self.readable("joint.position"):
            self.position(wanted, actual, where)
        if self.readable("joint.velocity"):
            speed = max(1.0, math.sqrt(sum(x * x for x in wanted.velocity)))
            self.vector("joint", "initial velocity", wanted.velocity, actual.velocity, f"{where}.velocity", speed)

    def servos(self) -> None:
        """The engine's own controllers: one for each natively driven joint, with its gains and limit."""
        rows = {
            name: (controller, index)
            for controller in natives(self.world)
            for index, name in enumerate(controller.joints)
        }
        names = sorted(servo.joint for servo in self.read_back.servos)  # a joint held twice counts twice
        if rows or names:
            self.tally.equal(self.levels["joint"], "controllers", sorted(rows), names, "control")
        for servo in self.read_back.servos:
            if servo.joint not in rows:
                continue
            controller, index = rows[servo.joint]
            at = f"control.{controller.name}"
            for name, values in (
                ("kp", controller.kp),
                ("kd", controller.kd),
                ("effort_limit", controller.effort_limits),
            ):
                actual = getattr(servo, name)
                self.number("joint", f"controller's {name.replace('_', ' ')}", values[index], actual, f"{at}.{name}")

    def limits(self, wanted: Joint, actual: Joint, where: str) -> None:
        at = f"{where}.limits.position"
        if (wanted.position_limits is None) != (actual.position_limits is None):
            detail = f"{actual.position_limits}, should be {wanted.position_limits}"
            self.note("joint", "position limits", None, at, detail)
        elif wanted.position_limits is not None and actual.position_limits is not None:
            for expected, actual_limit in zip(wanted.position_limits, actual.position_limits, strict=True):
                self.number("joint", "position limits", expected, actual_limit, at)

    def position(self, wanted: Joint, actual: Joint, where: str) -> None:
        at, name = f"{where}.position", "initial position"
        if len(wanted.position) != len(actual.position):
            self.vector("joint", name, wanted.position, actual.position, at)
            return
        straight = wanted.position[:3] if wanted.kind == "free" else wanted.position if wanted.kind != "ball" else ()
        place = max(1.0, math.sqrt(sum(x * x for x in straight)))
        if straight:
            self.vector("joint", name, straight, actual.position[: len(straight)], at, place)
        if wanted.kind in QUATERNION_JOINTS:
            turned = turn_between(quaternion(wanted.position[-4:]), quaternion(actual.position[-4:]))
            self.note("joint", name, turned, at, f"{actual.position}, should be {wanted.position}")

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
        reach = max(1.0, math.sqrt(sum(x * x for x in shape.pose.position)))
        self.note("geometry", "shape position", away / reach, f"{at}.pose", f"{other.pose.position}")
        self.note("geometry", "shape orientation", turned, f"{at}.pose", f"{other.pose.quaternion}")
        if self.readable("shape.visual") and shape.collision:
            self.tally.equal(self.levels["geometry"], "visible", shape.visual, other.visual, f"{at}.visual")
        moving = zip(shape.surface_velocity, other.surface_velocity, strict=True)
        if any(shape.surface_velocity) or any(other.surface_velocity):
            off = max(abs(value - actual) for value, actual in moving)
            largest = max(1.0, *(abs(value) for value in shape.surface_velocity))
            self.note(
                "geometry", "surface velocity", off / largest, f"{at}.surface_velocity", f"{other.surface_velocity}"
            )
        if not shape.collision:
            return
        if shape.margin or other.margin:
            self.note("geometry", "margin", abs(shape.margin - other.margin), f"{at}.margin", f"{other.margin:g} m")
        if other.material:
            self.tally.equal(self.levels["geometry"], "material", shape.material, other.material, at)
        layers = self.plan.layers(shape.material)
        if self.tally.equal(self.levels["geometry"], "copies of a shape", len(layers), len(other.surfaces), at):
            for layer, surface in zip(layers, other.surfaces, strict=True):
                self.surfaces.setdefault((shape.material, layer), {}).setdefault(surface, at)

    def surface(self, shape: Shape, other: Shape, at: str) -> None:
        """Two hulls as solids, since engines order and drop vertices as they like; two height fields as surfaces."""
        name = HULL if SHAPES[shape.kind].points else FIELD
        wrong = SHAPES[other.kind].wrong_size(other.size)
        deviation = None
        tolerance = self.hull_tolerance if name == HULL else max(self.tolerance, 0.0 if self.text else SINGLE)
        if wrong is None:
            try:
                if name == HULL:
                    deviation = hull_distance(hull_within_margin(shape.size, other.rounding), other.size, tolerance)
                else:
                    deviation = field_distance(shape.size, other.size)
            except HullError as error:
                wrong = f"with {other.rounding} m around it: {error}"
        count = len(shape.size) // 3
        detail = wrong or (
            f"{len(other.size) // 3} vertices, should be the hull of {count}"
            if name == HULL
            else f"its surface is off by {deviation:.3g} of its extent"
        )
        self.tally.add(self.levels["geometry"], name, tolerance, deviation, at, detail)

    def pairs(self) -> None:
        """Each pair of materials that can meet: the shapes' numbers, combined by the engine's rules, against the world's;
        and each pair that the engine holds as such."""
        laws = meeting_laws(self.world)
        for pair, layer in self.plan.layer_of.items():
            if pair in self.plan.missed:
                continue
            for first, place in self.surfaces.get((pair[0], layer), {}).items():
                for second, other_place in self.surfaces.get((pair[1], layer), {}).items():
                    self.law(laws[pair], first, second, _both(place, other_place))
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
        if needed:
            for first, second in shape_pairs(self.world, sorted(needed)):
                if (first, second) not in listed:
                    self.note("geometry", "explicit pair", None, f"pair {first}, {second}", "is not there")
                else:
                    self.note("geometry", "explicit pair", 0.0, f"pair {first}, {second}")


def _words(quantity: str) -> str:
    return quantity.replace("_", " ")


def _both(first: str, second: str) -> str:
    return first if first == second else f"{first} with {second}"
