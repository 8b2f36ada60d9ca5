"""The comparator notices every field that is not the world's, and nothing that is only said otherwise."""

from __future__ import annotations

import dataclasses
import math

import pytest

from simspec.contact import Rules, contact_plan, surfaces
from simspec.proof.checks import inventory_checks, value_difference
from simspec.proof.comparator import compare
from simspec.world import frames
from simspec.world.actions import Fluid, InertiaBox, JointSum
from simspec.world.contact_pairs import shape_pairs
from simspec.world.hull import inset
from simspec.world.types import (
    Body,
    ConnectConstraint,
    Contact,
    EnginePair,
    EngineServo,
    FollowConstraint,
    Frame,
    Hardness,
    Inertial,
    Joint,
    Material,
    PairContact,
    Pose,
    ReadBack,
    Shape,
    Surface,
    WeldConstraint,
    World,
)
from tests import worlds

RULES = Rules("min", "min", "min", "min", "same")
SURFACE_FIELDS = ("friction", "torsional_friction", "rolling_friction", "restitution", "hardness")
MISS = 1e-8
"""The size of the planted errors: ten times the tolerance of the model's levels."""


def full_world() -> World:
    """Every kind of joint with every number, every shape, two materials, and surfaces that only show."""
    more = {"damping": 0.3, "armature": 0.1, "dry_friction": 0.2, "spring_stiffness": 4.0}
    limits = {"position_limits": (-2.5, 2.0), "velocity_limit": 3.0, "effort_limit": 50.0}
    tree = worlds.tree(["free", "hinge", "fixed", "slide", "ball"], 7, [-1, 0, 1, 2, 0], **more, **limits)
    tree = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, spring_rest=0.1))
        if body.joint.kind in ("hinge", "slide")
        else body
        for body in tree
    )
    tilted = Pose((0.1, 0.2, 0.3), frames.normalise((0.8, 0.1, -0.5, 0.3)))
    shapes = tuple(
        Shape(f"shape_{kind}", kind, worlds.SIZES[kind], tilted, "rubber") for kind in worlds.SIZES if kind != "plane"
    )
    seen = Shape("seen", "box", (0.1, 0.2, 0.3), tilted, collision=False)
    floor = Body(
        "floor",
        "floor",
        Inertial(0.0),
        Joint("floor_joint", "fixed"),
        (Shape("floor_0", "plane", (), tilted, "steel"),),
    )
    bodies = (dataclasses.replace(tree[0], shapes=(*shapes, seen)), *tree[1:], floor)
    contact = Contact(
        materials=(Material("rubber", 0.8, 0.5), Material("steel", 0.3, 0.2)),
        pairs=(
            PairContact("rubber", "rubber", 0.8, 0.5),
            PairContact("rubber", "steel", 0.3, 0.2, 0.03, 0.02),
            PairContact("steel", "steel", 0.3, 0.2),
        ),
        excluded_bodies=worlds.parent_pairs(bodies),
    )
    return worlds.world(bodies, "full", contact=contact)


def read_back_of(world: World) -> ReadBack:
    """A perfect read-back: the world, with numbers on its shapes instead of materials."""
    plan = contact_plan(world, RULES, True)

    def shape(entry: Shape) -> Shape:
        if not entry.collision:
            return dataclasses.replace(entry, material="")
        return dataclasses.replace(entry, material="", surfaces=surfaces(entry, plan))

    bodies = tuple(dataclasses.replace(body, shapes=tuple(map(shape, body.shapes))) for body in world.bodies)
    return ReadBack(bodies, world.physics.gravity, world.physics.timestep, world.contact.friction_cone)


def with_surface(found: ReadBack, body: str, shape: str, layer: int = 0, /, **changes) -> ReadBack:
    actual_surfaces = next(entry for entry in body_of(found, body).shapes if entry.name == shape).surfaces
    changed = tuple(
        dataclasses.replace(surface, **changes) if index == layer else surface
        for index, surface in enumerate(actual_surfaces)
    )
    return with_shape(found, body, shape, surfaces=changed)


def failures(world: World, found: ReadBack, text: bool = False) -> list[tuple[str, str, str]]:
    return [(c.level, c.name, c.where) for c in compare(world, found, RULES, True, text) if not c.passed]


def with_body(found: ReadBack, name: str, /, **changes) -> ReadBack:
    bodies = tuple(dataclasses.replace(b, **changes) if b.name == name else b for b in found.bodies)
    return dataclasses.replace(found, bodies=bodies)


def body_of(found: ReadBack, name: str) -> Body:
    return next(body for body in found.bodies if body.name == name)


def with_joint(found: ReadBack, name: str, /, **changes) -> ReadBack:
    return with_body(found, name, joint=dataclasses.replace(body_of(found, name).joint, **changes))


def with_inertial(found: ReadBack, name: str, /, **changes) -> ReadBack:
    return with_body(found, name, inertial=dataclasses.replace(body_of(found, name).inertial, **changes))


def with_shape(found: ReadBack, body: str, shape: str, /, **changes) -> ReadBack:
    shapes = tuple(
        dataclasses.replace(entry, **changes) if entry.name == shape else entry for entry in body_of(found, body).shapes
    )
    return with_body(found, body, shapes=shapes)


WORLD = full_world()
READ_BACK = read_back_of(WORLD)
HINGE, FIXED, SLIDE, BALL = "link1", "link2", "link3", "link4"


def turned(q, by=MISS):
    """The orientation turned by ``by`` rad about its own x axis."""
    return frames.multiply(q, (1.0, by / 2, 0.0, 0.0))


def moved(values, index=0, by=MISS):
    return tuple(value + (by if at == index else 0.0) for at, value in enumerate(values))


def _inertial_cases():
    for name in (b.name for b in WORLD.bodies if b.name != "floor"):
        inertial = body_of(READ_BACK, name).inertial
        scale = sum(inertial.inertia[:3])
        yield f"{name} mass", "L1", "mass", with_inertial(READ_BACK, name, mass=inertial.mass * (1 + MISS))
        for i in range(3):
            found = with_inertial(READ_BACK, name, centre_of_mass=moved(inertial.centre_of_mass, i))
            yield f"{name} centre {i}", "L1", "centre of mass", found
        for i in range(6):
            found = with_inertial(READ_BACK, name, inertia=moved(inertial.inertia, i, MISS * scale))
            yield f"{name} inertia {i}", "L1", "inertia tensor", found
        for i in (3, 4, 5):
            mirrored = tuple(-x if at == i else x for at, x in enumerate(inertial.inertia))
            yield f"{name} product {i} sign", "L1", "inertia tensor", with_inertial(READ_BACK, name, inertia=mirrored)


def _joint_cases():
    for name in (HINGE, FIXED, SLIDE, BALL, "floor"):
        joint = body_of(READ_BACK, name).joint
        for i in range(3):
            origin = dataclasses.replace(joint.origin, position=moved(joint.origin.position, i))
            yield f"{name} origin {i}", "L2", "origin, position", with_joint(READ_BACK, name, origin=origin)
        origin = dataclasses.replace(joint.origin, quaternion=turned(joint.origin.quaternion))
        yield f"{name} origin turned", "L2", "origin, orientation", with_joint(READ_BACK, name, origin=origin)
        other = "slide" if joint.kind == "hinge" else "hinge"
        yield f"{name} kind", "L2", "joint type", with_joint(READ_BACK, name, kind=other)
        yield f"{name} parent", "L2", "parent", with_joint(READ_BACK, name, parent="seat")
    numbers = ("damping", "dry_friction", "armature", "spring_stiffness", "spring_rest")
    for name in (HINGE, SLIDE):
        joint = body_of(READ_BACK, name).joint
        for field in (*numbers, "velocity_limit", "effort_limit"):
            value = getattr(joint, field)
            assert value, f"{name} has no {field} to change"
            label = field.replace("_", " ")
            yield f"{name} {field}", "L2", label, with_joint(READ_BACK, name, **{field: value * (1 + MISS)})
            gone = 0.0 if field in numbers else None
            yield f"{name} {field} gone", "L2", label, with_joint(READ_BACK, name, **{field: gone})
        lower, upper = joint.position_limits
        for label, limits in (
            ("lower", (lower * (1 + MISS), upper)),
            ("upper", (lower, upper * (1 + MISS))),
            ("gone", None),
        ):
            found = with_joint(READ_BACK, name, position_limits=limits)
            yield f"{name} limits {label}", "L2", "position limits", found
        yield f"{name} axis", "L2", "axis", with_joint(READ_BACK, name, axis=moved(joint.axis, 1))
        yield f"{name} axis flipped", "L2", "axis", with_joint(READ_BACK, name, axis=tuple(-x for x in joint.axis))
        yield f"{name} position", "L2", "initial position", with_joint(READ_BACK, name, position=moved(joint.position))
        yield (
            f"{name} velocity",
            "L2",
            "initial velocity",
            with_joint(READ_BACK, name, velocity=moved(joint.velocity, 0, 1e-7)),
        )
        yield f"{name} name", "L2", "joint name", with_joint(READ_BACK, name, name="other")
    ball = body_of(READ_BACK, BALL).joint
    for field in ("damping", "spring_stiffness"):
        found = with_joint(READ_BACK, BALL, **{field: getattr(ball, field) * (1 + MISS)})
        yield f"ball {field}", "L2", field.replace("_", " "), found
    for field in ("dry_friction", "armature", "spring_rest"):
        yield f"ball {field} appears", "L2", field.replace("_", " "), with_joint(READ_BACK, BALL, **{field: 1e-9})
    yield "ball position", "L2", "initial position", with_joint(READ_BACK, BALL, position=turned(ball.position))
    free = body_of(READ_BACK, "link0").joint
    yield "free position", "L2", "initial position", with_joint(READ_BACK, "link0", position=moved(free.position, 2))
    pose = (*free.position[:3], *turned(free.position[3:]))
    yield "free orientation", "L2", "initial position", with_joint(READ_BACK, "link0", position=pose)
    for i in range(6):
        found = with_joint(READ_BACK, "link0", velocity=moved(free.velocity, i, 1e-7))
        yield f"free velocity {i}", "L2", "initial velocity", found
    for i in range(3):
        found = with_joint(READ_BACK, BALL, velocity=moved(ball.velocity, i, 1e-7))
        yield f"ball velocity {i}", "L2", "initial velocity", found
    yield "no position", "L2", "initial position", with_joint(READ_BACK, HINGE, position=())
    yield "free is fixed", "L2", "joint type", with_joint(READ_BACK, "link0", kind="fixed")


def _shape_cases():
    for shape in body_of(READ_BACK, "link0").shapes:
        for i in range(len(shape.size)):
            found = with_shape(READ_BACK, "link0", shape.name, size=moved(shape.size, i))
            yield f"{shape.name} size {i}", "L4", "shape hull" if shape.kind == "mesh" else "shape size", found
        for i in range(3):
            pose = dataclasses.replace(shape.pose, position=moved(shape.pose.position, i))
            found = with_shape(READ_BACK, "link0", shape.name, pose=pose)
            yield f"{shape.name} position {i}", "L4", "shape position", found
        if shape.kind == "mesh":
            for label, changes in (
                ("corner missing", {"size": shape.size[3:]}),
                ("corner more", {"size": (*shape.size, 0.1, 0.1, 0.1)}),
                ("no solid", {"size": shape.size[:9]}),
                ("rounded", {"rounding": MISS}),
            ):
                yield f"{shape.name} {label}", "L4", "shape hull", with_shape(READ_BACK, "link0", shape.name, **changes)
        if shape.kind != "sphere":
            pose = dataclasses.replace(shape.pose, quaternion=turned(shape.pose.quaternion))
            found = with_shape(READ_BACK, "link0", shape.name, pose=pose)
            yield f"{shape.name} turned", "L4", "shape orientation", found
        other = "cylinder" if shape.kind == "capsule" else "capsule"
        changed = with_shape(READ_BACK, "link0", shape.name, kind=other, size=(0.05, 0.2))
        yield f"{shape.name} kind", "L4", "shape type", changed
        changed = with_shape(READ_BACK, "link0", shape.name, collision=not shape.collision, surfaces=())
        yield f"{shape.name} collision", "L4", "shape type", changed
        rest = tuple(entry for entry in body_of(READ_BACK, "link0").shapes if entry.name != shape.name)
        yield f"{shape.name} missing", "L4", "shape type", with_body(READ_BACK, "link0", shapes=rest)
        if shape.collision:
            unseen = with_shape(READ_BACK, "link0", shape.name, visual=False)
            yield f"{shape.name} unseen", "L4", "visible", unseen
            for quantity in SURFACE_FIELDS[:-1]:
                # the rule is min: the floor's numbers are as small, and any shape below them shows
                lower = with_surface(READ_BACK, "link0", shape.name, **{quantity: 0.001})
                yield f"{shape.name} {quantity}", "L4", quantity.replace("_", " "), lower
                none = with_surface(READ_BACK, "link0", shape.name, **{quantity: None})
                yield f"{shape.name} {quantity} none", "L4", quantity.replace("_", " "), none
            for hardness in (None, Hardness("native"), Hardness("stiffness", stiffness=1e4)):
                found = with_surface(READ_BACK, "link0", shape.name, hardness=hardness)
                yield f"{shape.name} hardness {hardness}", "L4", "hardness", found
            no_surface = with_shape(READ_BACK, "link0", shape.name, surfaces=())
            yield f"{shape.name} without surface", "L4", "copies of a shape", no_surface
    extra = (*body_of(READ_BACK, HINGE).shapes, Shape("extra", "sphere", (0.1,), surfaces=(Surface(0.8),)))
    yield "one shape more", "L4", "shape type", with_body(READ_BACK, HINGE, shapes=extra)
    plane = body_of(READ_BACK, "floor").shapes[0].pose
    for quantity in SURFACE_FIELDS[:-1]:
        value = getattr(body_of(READ_BACK, "floor").shapes[0].surfaces[0], quantity)
        found = with_surface(READ_BACK, "floor", "floor_0", **{quantity: value * (1 - MISS)})
        yield f"floor {quantity}", "L4", quantity.replace("_", " "), found
    up = frames.rotate(plane.quaternion, (0.0, 0.0, MISS))
    raised = dataclasses.replace(plane, position=frames.add(plane.position, up))
    yield "plane raised", "L4", "shape position", with_shape(READ_BACK, "floor", "floor_0", pose=raised)
    tilted = dataclasses.replace(plane, quaternion=turned(plane.quaternion))
    yield "plane tilted", "L4", "shape orientation", with_shape(READ_BACK, "floor", "floor_0", pose=tilted)
    over = frames.multiply(plane.quaternion, (0.0, 1.0, 0.0, 0.0))
    found = with_shape(READ_BACK, "floor", "floor_0", pose=dataclasses.replace(plane, quaternion=over))
    yield "plane upside down", "L4", "shape orientation", found


def _world_cases():
    for i in range(3):
        gravity = moved(READ_BACK.gravity, i, 1e-7)
        yield f"gravity {i}", "L4", "gravity", dataclasses.replace(READ_BACK, gravity=gravity)
    yield "timestep", "L4", "timestep", dataclasses.replace(READ_BACK, timestep=READ_BACK.timestep * (1 + MISS))
    yield "cone", "L4", "friction cone", dataclasses.replace(READ_BACK, friction_cone="pyramid-inscribed")
    yield "group", "L4", "collision group", with_body(READ_BACK, HINGE, collision_group="other")
    yield "body missing", "L1", "bodies", dataclasses.replace(READ_BACK, bodies=READ_BACK.bodies[:-1])
    more = (*READ_BACK.bodies, dataclasses.replace(READ_BACK.bodies[-1], name="more"))
    yield "body more", "L1", "bodies", dataclasses.replace(READ_BACK, bodies=more)
    yield "body twice", "L1", "bodies", dataclasses.replace(READ_BACK, bodies=(*READ_BACK.bodies, READ_BACK.bodies[-1]))
    yield "not a number", "L1", "mass", with_inertial(READ_BACK, HINGE, mass=math.nan)
    yield "infinite", "L2", "damping", with_joint(READ_BACK, HINGE, damping=math.inf)


CASES = [*_inertial_cases(), *_joint_cases(), *_shape_cases(), *_world_cases()]


def test_a_perfect_read_back_passes():
    checks = compare(WORLD, READ_BACK, RULES, True)
    assert [check for check in checks if not check.passed] == []
    assert {check.level for check in checks} == {"L1", "L2", "L4"}
    assert all(check.worst <= 1e-15 for check in checks)  # quaternions are multiplied
    counts = {check.name: check.count for check in checks}
    numbers = {"mass": 5, "inertia tensor": 5, "joint type": 6, "axis": 2, "damping": 3, "position limits": 4}
    numbers |= {
        "shape type": 8,
        "shape size": 7,
        "shape hull": 1,
        "friction": 1,
        "restitution": 1,
        "gravity": 1,
    }  # surfaces: per pair that can meet
    assert numbers.items() <= counts.items(), "a check that looks at fewer things than there are proves less"


@pytest.mark.parametrize(("level", "name", "found"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_every_field_is_found(level, name, found):
    failed = failures(WORLD, found)
    assert (level, name) in [entry[:2] for entry in failed]
    assert len({entry[1] for entry in failed}) <= 3, "one error should not be reported as many"
    assert failures(WORLD, found, text=True), "a text's tolerance is tighter still"


def test_every_field_of_the_types_is_compared_or_known_not_to_be():
    """A field added to the types must be added here, and to the comparator."""
    left_out = {"Body.model", "Shape.name", "Shape.colour", "Shape.drawn"}
    named = {
        Body: {"name", "inertial", "joint", "shapes", "collision_group", "model", "gravity_scale", "box"},
        Inertial: {"mass", "centre_of_mass", "inertia"},
        Shape: {
            *(
                "name",
                "kind",
                "size",
                "pose",
                "material",
                "collision",
                "visual",
                "colour",
                "drawn",
                "surfaces",
                "rounding",
                "margin",
                "surface_velocity",
            )
        },
        Surface: set(SURFACE_FIELDS),
        Hardness: {"kind", "time_constant", "damping_ratio", "stiffness", "damping"},
        EnginePair: {"first", "second", "surface", "margin"},
        Joint: {
            *("name", "kind", "parent", "origin", "axis", "position_limits", "velocity_limit", "effort_limit"),
            *("damping", "dry_friction", "armature", "spring_stiffness", "spring_rest", "position", "velocity"),
            # the armature has that of implicit damping in it, and what was written is no part of a model
            *("angular_damping", "angular_armature", "angle_limit", "written_armature"),
        },
        ReadBack: {
            "bodies",
            "gravity",
            "timestep",
            "friction_cone",
            "unreadable",
            "pairs",
            "servos",
            "inventory",
            "neutral",
            "constraints",
            "sums",
            "frames",
            "laws",
            "fluid",
            "made_of",
        },
        Fluid: {"density", "viscosity", "velocity"},
        InertiaBox: {"edges", "quaternion"},
        Frame: {"name", "body", "pose"},
        JointSum: {"name", "joints", "stiffness", "rest", "damping", "position_limits", "dry_friction"},
        FollowConstraint: {"name", "joint", "leader", "ratio", "offset", "kind"},
        ConnectConstraint: {"name", "first", "second", "first_point", "second_point", "kind"},
        WeldConstraint: {"name", "first", "second", "pose", "kind"},
        EngineServo: {"joint", "kp", "kd", "effort_limit"},
    }
    for kind, fields in named.items():
        assert {field.name for field in dataclasses.fields(kind)} == fields
    for path in left_out:  # these are names and looks, which move nothing
        kind, field = path.split(".")
        changes = {field: (0.1, 0.2, 0.3, 1.0) if field == "colour" else "other"}
        found = (
            with_body(READ_BACK, "link0", **changes)
            if kind == "Body"
            else with_shape(READ_BACK, "link0", "shape_box", **changes)
        )
        assert failures(WORLD, found) == []


def test_a_material_that_a_file_names_is_the_shapes():
    (shape,) = (shape for shape in body_of(WORLD, "link0").shapes if shape.name == "shape_box")
    assert failures(WORLD, with_shape(READ_BACK, "link0", "shape_box", material=shape.material)) == []
    wrong = failures(WORLD, with_shape(READ_BACK, "link0", "shape_box", material="other"))
    assert [entry[:2] for entry in wrong] == [("L4", "material")]


def test_an_additional_margin_is_found():
    assert [entry[1] for entry in failures(WORLD, with_shape(READ_BACK, "link0", "shape_box", margin=1e-6))] == [
        "margin"
    ]


def test_text_is_compared_to_twelve_digits():
    found = with_inertial(READ_BACK, HINGE, mass=body_of(READ_BACK, HINGE).inertial.mass * (1 + 1e-11))
    assert failures(WORLD, found) == []
    assert [entry[:2] for entry in failures(WORLD, found, text=True)] == [("L0", "mass")]
    assert {check.level for check in compare(WORLD, READ_BACK, RULES, True, text=True)} == {"L0"}


def negative(q):
    return tuple(-x for x in q)


def _same_cases():
    """Equivalent read-backs in another notation."""
    for name in (HINGE, FIXED, BALL):
        origin = body_of(READ_BACK, name).joint.origin
        other = dataclasses.replace(origin, quaternion=negative(origin.quaternion))
        yield f"{name} origin's sign", with_joint(READ_BACK, name, origin=other)
    position = body_of(READ_BACK, BALL).joint.position
    yield "ball's sign", with_joint(READ_BACK, BALL, position=negative(position))
    free = body_of(READ_BACK, "link0").joint
    yield "free's sign", with_joint(READ_BACK, "link0", position=(*free.position[:3], *negative(free.position[3:])))
    yield "free's origin", with_joint(READ_BACK, "link0", origin=Pose((1.0, 2.0, 3.0)))
    about_z = frames.from_axis_angle((0.0, 0.0, 1.0), 1.1)
    over = frames.from_axis_angle((1.0, 0.0, 0.0), math.pi)
    tilt = body_of(READ_BACK, "link0").shapes[0].pose
    sphere = dataclasses.replace(tilt, quaternion=frames.multiply(tilt.quaternion, (0.5, 0.5, 0.5, 0.5)))
    yield "sphere turned", with_shape(READ_BACK, "link0", "shape_sphere", pose=sphere)
    for kind in ("cylinder", "capsule"):
        for label, turn in (("about its axis", about_z), ("end over end", over)):
            pose = dataclasses.replace(tilt, quaternion=frames.multiply(tilt.quaternion, turn))
            yield f"{kind} {label}", with_shape(READ_BACK, "link0", f"shape_{kind}", pose=pose)
    along = frames.add(tilt.position, frames.rotate(tilt.quaternion, (2.0, -3.0, 0.0)))
    plane = Pose(along, frames.multiply(tilt.quaternion, about_z))
    yield "plane shifted in itself", with_shape(READ_BACK, "floor", "floor_0", pose=plane)
    shapes = body_of(READ_BACK, "link0").shapes
    size = worlds.SIZES["mesh"]
    yield "mesh's corners in another order", with_shape(READ_BACK, "link0", "shape_mesh", size=(*size[3:], *size[:3]))
    inner = (*size, 0.0, 0.0, 0.0)
    yield "mesh with a point inside", with_shape(READ_BACK, "link0", "shape_mesh", size=inner)
    yield "mesh rounded", with_shape(READ_BACK, "link0", "shape_mesh", size=inset(size, 0.001), rounding=0.001)
    yield "shapes in another order", with_body(READ_BACK, "link0", shapes=shapes[::-1])
    yield "bodies in another order", dataclasses.replace(READ_BACK, bodies=READ_BACK.bodies[::-1])


SAME = list(_same_cases())


@pytest.mark.parametrize("found", [case[1] for case in SAME], ids=[case[0] for case in SAME])
def test_equivalent_descriptions_pass(found):
    assert failures(WORLD, found) == []


UNREADABLE = {
    "joint.velocity_limit": lambda: with_joint(READ_BACK, HINGE, velocity_limit=None),
    "joint.damping": lambda: with_joint(READ_BACK, HINGE, damping=0.0),
    "joint.position_limits": lambda: with_joint(READ_BACK, HINGE, position_limits=None),
    "joint.position": lambda: with_joint(READ_BACK, HINGE, position=()),
    "joint.velocity": lambda: with_joint(READ_BACK, HINGE, velocity=()),
    "joint.name": lambda: with_joint(READ_BACK, HINGE, name=""),
    "gravity": lambda: dataclasses.replace(READ_BACK, gravity=(0.0, 0.0, 0.0)),
    "timestep": lambda: dataclasses.replace(READ_BACK, timestep=0.0),
    "friction_cone": lambda: dataclasses.replace(READ_BACK, friction_cone="pyramid-inscribed"),
    "collision_group": lambda: with_body(READ_BACK, HINGE, collision_group=""),
    **{
        f"shape.{name}": lambda name=name: with_surface(READ_BACK, "floor", "floor_0", **{name: None})
        for name in SURFACE_FIELDS
    },
    "shape.visual": lambda: with_shape(READ_BACK, "link0", "shape_box", visual=False),
}


@pytest.mark.parametrize("field", UNREADABLE)
def test_unreadable_fields_are_omitted_only_when_declared(field):
    found = UNREADABLE[field]()
    assert failures(WORLD, found)
    assert failures(WORLD, dataclasses.replace(found, unreadable={field: "cannot be queried"})) == []


def test_pairs_are_combined_by_the_rule_of_the_engine():
    """The numbers that give 0.3 under min give another under max or product."""
    numbers = {"rubber": Surface(0.8, 0.03, 0.02, 0.5, Hardness()), "steel": Surface(0.3, 0.03, 0.02, 0.2, Hardness())}
    shape = {shape.name: shape for body in WORLD.bodies for shape in body.shapes}

    def with_numbers(body: Body) -> Body:
        shapes = tuple(
            dataclasses.replace(entry, surfaces=(numbers[shape[entry.name].material],)) if entry.collision else entry
            for entry in body.shapes
        )
        return dataclasses.replace(body, shapes=shapes)

    found = dataclasses.replace(READ_BACK, bodies=tuple(map(with_numbers, READ_BACK.bodies)))
    assert failures(WORLD, found) == []
    for rule in ("max", "product"):
        wrong = [c for c in compare(WORLD, found, dataclasses.replace(RULES, friction=rule), True) if not c.passed]
        assert [c.name for c in wrong] == ["friction"]
        assert "floor" in wrong[0].where or "link0" in wrong[0].where
        wrong = [c for c in compare(WORLD, found, dataclasses.replace(RULES, restitution=rule), True) if not c.passed]
        assert [c.name for c in wrong] == ["restitution"]


TABLE = (("a", "a", 0.5), ("a", "b", 0.2), ("b", "b", 0.5))
"""Friction that one number for each material gives under no rule."""


def table_world() -> World:
    ball = worlds.shapes_world(("sphere",)).bodies[1]
    bodies = tuple(
        dataclasses.replace(
            ball,
            name=name,
            model=name,
            joint=dataclasses.replace(ball.joint, name=f"{name}_joint"),
            shapes=(Shape(f"{name}_0", "sphere", (0.05,), Pose(), name[0]),),
        )
        for name in ("a0", "a1", "b0", "b1")
    )
    pairs = tuple(PairContact(first, second, value, 0.0) for first, second, value in TABLE)
    return World("table", bodies, contact=Contact(materials=(Material("a", 0.5), Material("b", 0.5)), pairs=pairs))


def test_copies_are_compared_layer_by_layer():
    world = table_world()
    found = read_back_of(world)
    layers = len(body_of(found, "b0").shapes[0].surfaces)
    assert layers == 2
    assert failures(world, found) == []
    for layer in range(layers):
        value = body_of(found, "b0").shapes[0].surfaces[layer].friction
        wrong = with_surface(found, "b0", "b0_0", layer, friction=value / 2)
        assert {name for _, name, _ in failures(world, wrong)} == {"friction"}
    fewer = with_shape(found, "b0", "b0_0", surfaces=body_of(found, "b0").shapes[0].surfaces[:1])
    assert {name for _, name, _ in failures(world, fewer)} == {"copies of a shape"}


def explicit(world: World) -> ReadBack:
    """As an engine without layers holds the table: some pairs by numbers, all others pair by pair."""
    plan = contact_plan(world, RULES, False)
    assert plan.missed
    laws = {(pair.first, pair.second): pair for pair in world.contact.pairs}
    material = {shape.name: shape.material for body in world.bodies for shape in body.shapes}
    pairs = []
    for first, second in shape_pairs(world, plan.missed):
        law = laws[tuple(sorted((material[first], material[second])))]
        pairs.append(EnginePair(first, second, Surface(law.friction, hardness=Hardness())))
    bodies = tuple(
        dataclasses.replace(
            body,
            shapes=tuple(
                dataclasses.replace(shape, material="", surfaces=surfaces(shape, plan)) if shape.collision else shape
                for shape in body.shapes
            ),
        )
        for body in world.bodies
    )
    return ReadBack(bodies, world.physics.gravity, world.physics.timestep, pairs=tuple(pairs))


def explicit_failures(world: World, found: ReadBack) -> set[str]:
    return {check.name for check in compare(world, found, RULES, False) if not check.passed}


def test_explicit_pairs_are_compared_and_must_all_be_there():
    world = table_world()
    found = explicit(world)
    assert explicit_failures(world, found) == set()
    missing = dataclasses.replace(found, pairs=found.pairs[1:])
    assert explicit_failures(world, missing) == {"explicit pair"}
    for changes, name in (
        ({"friction": 0.4}, "friction"),
        ({"rolling_friction": 0.1}, "rolling friction"),
        ({"restitution": 0.1}, "restitution"),
        ({"hardness": Hardness("native")}, "hardness"),
    ):
        first = dataclasses.replace(found.pairs[0], surface=dataclasses.replace(found.pairs[0].surface, **changes))
        assert explicit_failures(world, dataclasses.replace(found, pairs=(first, *found.pairs[1:]))) == {name}
    stray = EnginePair("a0_0", "nothing", Surface(0.5))
    assert explicit_failures(world, dataclasses.replace(found, pairs=(*found.pairs, stray))) == {"explicit pair"}


def test_an_explicit_pair_of_excluded_shapes_is_found():
    world = table_world()
    found = explicit(world)
    passing = tuple(
        dataclasses.replace(pair, collide=pair.first == pair.second, friction=0.5) for pair in world.contact.pairs
    )
    separate = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=passing))
    assert "explicit pair" in explicit_failures(separate, found)


def test_a_failure_has_its_place_and_quantity():
    found = with_joint(READ_BACK, HINGE, damping=0.4)
    (check,) = (c for c in compare(WORLD, found, RULES, True) if not c.passed)
    assert check.where == f"bodies.{HINGE}.joint.damping"
    assert check.worst == pytest.approx(0.25)
    assert check.detail == "0.4, should be 0.3"


def test_fixed_massless_bodies_need_no_inertia():
    found = with_inertial(READ_BACK, "floor", mass=1.0, inertia=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    assert failures(WORLD, found) == []


def test_a_small_inertia_is_compared_relative_to_its_size():
    """A tensor of 1e-9 kg m² that is wrong by a millionth is wrong, though 1e-15 is negligible relative to 1."""
    small = Inertial(1e-3, (0.0, 0.0, 0.0), (1e-9, 2e-9, 1.5e-9, 0.0, 0.0, 0.0))
    bodies = (dataclasses.replace(WORLD.bodies[0], inertial=small, shapes=()),)
    world = worlds.world(bodies, "small")
    found = with_inertial(read_back_of(world), "link0", inertia=(1e-9, 2e-9 * (1 + 1e-6), 1.5e-9, 0.0, 0.0, 0.0))
    assert [entry[1] for entry in failures(world, found)] == ["inertia tensor"]
    shifted = with_inertial(read_back_of(world), "link0", centre_of_mass=(0.0, 0.0, 1e-9))
    assert [entry[1] for entry in failures(world, shifted)] == ["centre of mass"]


INVENTORY = {
    "opt.solver": 2,
    "opt.tolerance": 1e-8,
    "opt.wind": (0.0, 0.0, 1.0),
    "flags.island": False,
    "geom.a.name": "a",
}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("opt.solver", 1),
        ("opt.tolerance", 1.01e-8),
        ("opt.tolerance", math.nan),
        ("opt.wind", (0.0, 1e-6, 1.0)),
        ("opt.wind", (0.0, 0.0)),
        ("opt.wind", 0.0),
        ("flags.island", True),
        ("flags.island", 0),
        ("geom.a.name", "b"),
    ],
)
def test_the_rest_of_the_inventory_is_compared_by_name(name, value):
    (check,) = inventory_checks(INVENTORY, {**INVENTORY, name: value})
    assert (check.passed, check.level, check.where, check.count) == (False, "L4", name, len(INVENTORY))


def test_names_missing_on_either_side_differ_in_kind():
    (good,) = inventory_checks(INVENTORY, {key: list(v) if isinstance(v, tuple) else v for key, v in INVENTORY.items()})
    assert (good.passed, good.count) == (True, len(INVENTORY))
    (extra,) = inventory_checks(INVENTORY, {**INVENTORY, "count.tendon": 0})
    (missing,) = inventory_checks({**INVENTORY, "count.tendon": 0}, INVENTORY)
    assert [(check.passed, check.where) for check in (extra, missing)] == [(False, "count.tendon")] * 2
    assert inventory_checks({}, {}) == []


def test_infinite_values_are_the_same_or_not():
    assert value_difference((math.inf, 1.0), (math.inf, 1.0)) == 0.0
    assert value_difference(math.inf, -math.inf) is None
    assert value_difference((math.inf, 1.0), (math.inf, 1.1)) == pytest.approx(0.1 / 1.1)
