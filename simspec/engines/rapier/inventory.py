"""The values that Rapier stores besides the fields of the read-back, and that can act, and what they must be.

``expected`` runs without Rapier; it repeats the numbers of ``building.py`` and ``multibodies.py`` on purpose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from simspec.contact import ContactPlan
from simspec.engines.kit.arrays import LARGEST  # Rapier's default of the largest force of a motor
from simspec.engines.kit.inventory import (
    NEUTRAL,
    FilterCarrier,
    Items,
    below,
    expected_separate,
    named_set,
    sidecar_labels,
)
from simspec.engines.rapier.multibodies import ANCHOR
from simspec.engines.rapier.readback import inertial, kind_of
from simspec.engines.rapier.simulation import RapierSimulation
from simspec.engines.rapier.units import SCALE
from simspec.world.canonical import derived
from simspec.world.contact_pairs import excluded_pairs, meeting_laws, solid_shapes
from simspec.world.inertia import lumped
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import Body, EngineValue, PairContact, Shape, World

Settings = Mapping[str, bool | int | float | str]
SEPARATE = ("dt", "soft_bodies")
"""Parameters of the integration that are a field of the read-back, or counted."""


def word(value: Any) -> str:
    """One of Rapier's constants as it prints, without its class."""
    text = str(value)
    return text.rpartition(".")[2] if "(" not in text else text


class Parameters(NamedTuple):
    """A world and its settings, from which the parameters follow."""

    world: World
    settings: Settings


def _softness(of: Parameters) -> tuple[float, float]:
    """ω/2π and the damping ratio with which ω dt is 1000, and a step takes back 0.01 of an overlap."""
    return (1000.0 / (2.0 * math.pi * of.world.physics.timestep), 0.5 * 1000.0 * (1.0 - 0.01) / 0.01)


def _spring(parameters: Any, name: str) -> tuple[float, float]:
    softness = getattr(parameters, name)
    return (softness.natural_frequency, softness.damping_ratio)


PARAMETERS = (
    Items[Any, Parameters].named(
        getattr,
        {
            **dict.fromkeys(("min_ccd_dt", "length_unit", "normalized_contact_recycle_distance"), NEUTRAL),
            **dict.fromkeys(("max_ccd_substeps", "friction_in_bias_pass", "warmstart_joints"), NEUTRAL),
            "num_solver_iterations": 1,
            "num_internal_pgs_iterations": lambda of: of.settings["iterations"],
            "num_internal_stabilization_iterations": 0,
            "normalized_allowed_linear_error": 0.0,
            "contact_recycling": False,
            "contact_clustering": False,
            "warmstart_coefficient": 1.0,
        },
    )
    | Items[Any, Parameters].named(
        lambda parameters, name: getattr(parameters, name) / SCALE,
        {
            "normalized_prediction_distance": 1e-6,
            "normalized_max_corrective_velocity": 1e6,
            "normalized_max_linear_velocity": 1e6,
        },
    )
    | Items[Any, Parameters].named(_spring, {"contact_softness": _softness, "static_contact_softness": _softness})
    | Items[Any, Parameters].named(lambda of, name: word(getattr(of, name)), {"friction_model": "SIMPLIFIED"})
)


@derived
def links(world: World) -> tuple[str, ...]:
    """The bodies that are links of multibodies: all that move, but for massless bodies that are fixed to others, and for trees
    that are a single rigid body whose mass is that of its root."""
    groups, inertials = rigid_groups(world), lumped(world)
    found: list[str] = []
    for root, bodies in trees(world).items():
        mass = {body.name: inertials.get(body.name, body.inertial).mass for body in bodies}
        others = [body for body in bodies if body.name != root]
        if all(groups[body.name] == root and not mass[body.name] for body in others) and bodies[0].joint.kind == "free":
            continue
        found += [
            body.name
            for body in bodies
            if groups[body.name] != "world" and (body.joint.kind != "fixed" or mass[body.name])
        ]
    return tuple(found)


@derived
def multibody_roots(world: World) -> tuple[str, ...]:
    """The first body of each multibody: a link that is connected to what cannot move."""
    groups, connected = rigid_groups(world), set(links(world))
    return tuple(
        body.name
        for body in world.bodies
        if body.name in connected and (body.joint.parent is None or groups[body.joint.parent] == "world")
    )


COUNTS = Items[Any, World].named(
    lambda world, name: len(getattr(world, "rigid_bodies" if name == "bodies" else name)),
    {
        "bodies": lambda world: sum(_separate(world, body) for body in world.bodies) + 2 * len(multibody_roots(world)),
        "colliders": lambda world: sum(len(solid_shapes(body)) for body in world.bodies),
        **dict.fromkeys(("impulse_joints", "soft_bodies"), 0),
        "multibody_joints": lambda world: len(links(world)) + len(multibody_roots(world)),
    },
)
"""Each multibody has an anchor and a flywheel in addition to its links."""


BODY = Items[Any, Body].named(
    getattr,
    {
        **dict.fromkeys(("linear_damping", "angular_damping", "dominance_group"), NEUTRAL),
        **dict.fromkeys(("additional_solver_iterations", "additional_pgs_iterations", "is_enabled"), NEUTRAL),
        **dict.fromkeys(("ccd_enabled", "soft_ccd_prediction", "is_soft_frame", "user_data"), NEUTRAL),
        "allow_fast_rotation": NEUTRAL,
        "gyroscopic_forces_enabled": NEUTRAL,
    },
) | Items[Any, Body](
    {
        "type": (lambda body: word(body.body_type), NEUTRAL),
        "locked_axes": (lambda body: tuple(map(float, (*body.enabled_translations, *body.enabled_rotations))), NEUTRAL),
        "sleeps": (lambda body: bool(body.is_sleeping) or body.activation.linear_threshold >= 0.0, NEUTRAL),
    }
)
DYNAMIC: Mapping[str, EngineValue] = {"allow_fast_rotation": True, "sleeps": False}
"""Values of bodies that move, in place of Rapier's defaults."""


class RapierSolid(NamedTuple):
    """A collision shape of the world: its number, its body, the law of all pairs where there is only one, and whether Rapier
    queries the hook for the others that it touches."""

    number: int
    body: Body
    shape: Shape
    law: PairContact | None
    filtered: bool


def _hooks(solid: RapierSolid) -> str:
    return f"ActiveHooks(bits=0b{(0 if solid.law else 0b100) | (0b1 if solid.filtered else 0):08b})"


def _groups(collider: Any, name: str) -> str:
    groups = getattr(collider, name)
    return f"{groups.memberships.bits:x} {groups.filter.bits:x} {word(groups.test_mode)}"


COLLIDER = (
    Items[Any, RapierSolid].named(
        getattr,
        {
            **dict.fromkeys(("is_sensor", "is_enabled", "contact_skin", "contact_force_event_threshold"), NEUTRAL),
            "density": 0.0,
            "user_data": lambda solid: solid.number,
            "friction": lambda solid: solid.law.friction if solid.law else 0.0,
            "restitution": lambda solid: solid.law.restitution if solid.law else 0.0,
        },
    )
    | Items[Any, RapierSolid].named(
        lambda collider, name: word(getattr(collider, name)),
        {
            **dict.fromkeys(("friction_combine_rule", "restitution_combine_rule", "active_events"), NEUTRAL),
            "active_collision_types": NEUTRAL,
            "active_hooks": _hooks,
        },
    )
    | Items[Any, RapierSolid].named(_groups, dict.fromkeys(("collision_groups", "solver_groups"), NEUTRAL))
    | Items[Any, RapierSolid]({"kind": (kind_of, lambda solid: solid.shape.kind)})
)


class RapierLink(NamedTuple):
    """A link of the live engine: its joint as Rapier stores it, and the multibody."""

    sim: RapierSimulation
    number: int

    @property
    def data(self) -> Any:
        return self.joint.data

    @property
    def joint(self) -> Any:
        return self.sim.world.multibody_joints[self.sim.built.multibodies.joints[self.number]]

    @property
    def multibody(self) -> Any:
        return self.sim.links.multibodies[self.sim.built.multibodies.links[self.number].tree]

    def axis_value(self, name: str) -> EngineValue:
        """A value of the motor of the joint's axis; "none" without a motor."""
        for axis in AXES_OF_JOINTS:
            motor = self.data.motor(getattr(self.sim.rapier.JointAxis, axis))
            if motor is not None:
                return word(motor.model) if name == "model" else float(getattr(motor, name))
        return "none"


AXES_OF_JOINTS = ("LIN_X", "LIN_Y", "LIN_Z", "ANG_X", "ANG_Y", "ANG_Z")


def _reader(name: str) -> Callable[[RapierLink], EngineValue]:
    return lambda link: link.axis_value(name)


def _motor_value(value: EngineValue) -> Callable[[tuple[Body, Parameters]], EngineValue]:
    return lambda of: value if of[0].joint.dry_friction else "none"


def _axis_bits(body: Body, present: object) -> int:
    """The bit of the axis of a hinge or slide, where it has a limit or a motor."""
    return {"hinge": 0b1000, "slide": 0b1}[body.joint.kind] if present else 0


def _limit_softness(of: Parameters) -> tuple[float, float]:
    """ω/2π and the damping ratio with which ω dt is 1e6, and a step takes back 0.01 of an overlap."""
    return (1e6 / (2.0 * math.pi * of.world.physics.timestep), 0.5 * 1e6 * (1.0 - 0.01) / 0.01)


def _joint_softness(data: Any) -> tuple[float, float]:
    return (data.softness.natural_frequency, data.softness.damping_ratio)


def _native(of: Parameters) -> bool:
    """Whether Rapier integrates by its own method."""
    return bool(of.settings.get("native_motion", False))


def _damping(link: RapierLink) -> float:
    """The largest damping of a link's coordinates that the read-back of its joint does not contain. By Rapier's own method that
    of a ball is the same about all axes."""
    built = link.sim.built.multibodies
    begin = built.places[link.number] - built.starts[built.links[link.number].tree]
    count = link.multibody.get_link(built.numbers[link.number]).ndofs
    values = np.array(link.multibody.damping()[begin : begin + count])
    if link.sim.native and count:
        values -= values[0]
    return float(np.abs(values).max(initial=0.0))


MOTOR: Mapping[str, EngineValue] = {
    "target_vel": 0.0,
    "stiffness": 0.0,
    "damping": 1e30,
    "model": "ACCELERATION_BASED",
}
"""Of the motor that is the dry friction of a joint."""
LINK = Items[RapierLink, tuple[Body, Parameters]](
    {
        "kinematic": (lambda link: bool(link.joint.kinematic), False),
        "enabled": (lambda link: bool(link.data.is_enabled()), True),
        "contacts_enabled": (lambda link: bool(link.data.contacts_enabled), True),
        "coupled_axes": (lambda link: link.data.coupled_axes.bits, 0),
        "limit_axes": (
            lambda link: link.data.limit_axes.bits,
            lambda of: _axis_bits(of[0], of[0].joint.position_limits),
        ),
        "motor_axes": (lambda link: link.data.motor_axes.bits, lambda of: _axis_bits(of[0], of[0].joint.dry_friction)),
        "softness": (
            lambda link: _joint_softness(link.data) if link.data.limit_axes.bits else "none",
            lambda of: _limit_softness(of[1]) if of[0].joint.position_limits is not None else "none",
        ),
        **{f"motor.{name}": (_reader(name), _motor_value(value)) for name, value in MOTOR.items()},
        "damping": (_damping, 0.0),
        "self_contacts": (lambda link: bool(link.multibody.self_contacts_enabled()), True),
    }
)
"""Of a body that is a link, as ``joint.NAME``."""


class RapierWheel(NamedTuple):
    """The flywheel of a multibody of the live engine, by the number of the multibody."""

    sim: RapierSimulation
    tree: int

    @property
    def body(self) -> Any:
        return self.sim.world.rigid_bodies[self.sim.built.multibodies.wheel_bodies[self.tree]]

    @property
    def motor(self) -> Any:
        joint = self.sim.world.multibody_joints[self.sim.built.multibodies.wheels[self.tree]]
        return joint.data.motor(self.sim.rapier.JointAxis.ANG_X)

    @property
    def values(self) -> tuple[float, float]:
        """Damping and armature."""
        built, multibody = self.sim.built.multibodies, self.sim.links.multibodies[self.tree]
        place = built.wheel_places[self.tree] - built.starts[self.tree]
        return multibody.damping()[place], multibody.armature()[place]


WHEEL = Items[RapierWheel, Parameters](
    {
        "mass": (lambda wheel: (wheel.body.mass, *wheel.body.mass_properties.principal_inertia), (1.0, 1.0, 1.0, 1.0)),
        "centre": (lambda wheel: tuple(wheel.body.mass_properties.local_com), (0.0, 0.0, 0.0)),
        "gravity_scale": (lambda wheel: wheel.body.gravity_scale, 0.0),
        "motor.target_vel": (lambda wheel: wheel.motor.target_vel, 1e6),
        "motor.stiffness": (lambda wheel: wheel.motor.stiffness, 0.0),
        "motor.damping": (lambda wheel: wheel.motor.damping, 1e30),
        "motor.max_force": (lambda wheel: wheel.motor.max_force, lambda of: 0.0 if _native(of) else LARGEST),
        "model": (lambda wheel: word(wheel.motor.model), "ACCELERATION_BASED"),
        "damping": (
            lambda wheel: wheel.values[0],
            lambda of: 1e-6 if _native(of) else 1e12 / of.world.physics.timestep,
        ),
        "armature": (lambda wheel: wheel.values[1], 0.0),
    }
)
"""Of a flywheel, as ``flywheel.NAME`` with the name of the first body of its multibody."""


def _world(world: Any) -> dict[str, EngineValue]:
    parameters = PARAMETERS.read(world.integration_parameters, "parameters")
    return parameters | COUNTS.read(world, "count") | {"threads": world.num_threads}


def inventory(sim: RapierSimulation) -> dict[str, EngineValue]:
    """The stored values by name."""
    found: dict[str, EngineValue] = {**sidecar_labels(sim.sidecar), **_world(sim.world)}
    solids = dict(zip(sim.built.colliders, sim.walk.shapes, strict=True))
    for placed, body in zip(sim.walk.bodies, sim.document.bodies, strict=True):
        at, separate = f"body.{body.name}", sim.is_separate(placed.row)
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.held": separate}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        if separate:
            rigid = sim.world.rigid_bodies[sim.built.bodies[placed.row]]
            found |= BODY.read(rigid, at)
            found[f"{at}.colliders"] = " ".join(sorted(solids[handle].shape.name for handle in rigid.colliders))
        if not placed.moves:
            found[f"{at}.mass"] = inertial(sim, placed.row).mass
    built = sim.built.multibodies
    for number, link in enumerate(built.links):
        found |= LINK.read(RapierLink(sim, number), f"joint.{link.joint.name}")
        if link.parent == ANCHOR:
            found |= WHEEL.read(RapierWheel(sim, link.tree), f"flywheel.{link.placed.body.name}")
    for handle, solid in solids.items():
        found |= COLLIDER.read(sim.world.colliders[handle], f"shape.{solid.shape.name}")
        found[f"shape.{solid.shape.name}.of"] = solid.owner.body.name
    names = [f"{solid.shape.name}.0" for solid in sim.walk.shapes]  # the names of carriers: all in one layer
    for row, name in enumerate(names):
        # the answers of the hook, whether Rapier calls it or not
        others = (other for column, other in enumerate(names) if column != row and sim.built.laws.excluded(row, column))
        found[f"apart.{name}"] = named_set(others)
    return found


def neutral(sim: RapierSimulation) -> dict[str, EngineValue]:
    """The values of an empty world, of a bare body of each type and of a bare collider."""
    rapier = sim.rapier
    world = rapier.PhysicsWorld()
    found: dict[str, EngineValue] = {f"world.{name}": value for name, value in _world(world).items()}
    for name, builder in (("fixed", rapier.RigidBody.fixed()), ("dynamic", rapier.RigidBody.dynamic())):
        found |= BODY.read(world.rigid_bodies[world.add_body(builder)], name)
    return found | COLLIDER.read(world.colliders[world.add_collider(rapier.Collider.ball(1.0))], "collider")


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``; ``neutral`` are Rapier's defaults."""
    defaults = below("world.parameters", neutral)
    found = PARAMETERS.expect(Parameters(world, settings), "parameters", defaults)
    found |= COUNTS.expect(world, "count") | {"threads": 1}
    groups, law, parameters = rigid_groups(world), _only_law(world), Parameters(world, settings)
    for name in links(world):
        body = next(body for body in world.bodies if body.name == name)
        found |= LINK.expect((body, parameters), f"joint.{body.joint.name}")
    for name in multibody_roots(world):
        found |= WHEEL.expect(parameters, f"flywheel.{name}")
    carriers: list[FilterCarrier] = []
    shapes_of: dict[str, list[str]] = {}
    for body in world.bodies:
        owner = body.name if groups[body.name] == "world" else groups[body.name]
        shapes_of.setdefault(owner, []).extend(shape.name for shape in solid_shapes(body))
    for body in world.bodies:
        at, static = f"body.{body.name}", groups[body.name] == "world"
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.held": _separate(world, body)}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        if _separate(world, body):
            found |= BODY.expect(body, at, below("fixed" if static else "dynamic", neutral))
            found[f"{at}.colliders"] = " ".join(sorted(shapes_of.get(body.name, ())))
        if static:
            # the check of bodies compares the rest, and omits fixed bodies without mass
            found[f"{at}.mass"] = body.inertial.mass
        elif _separate(world, body):
            found |= {f"{at}.{name}": value for name, value in DYNAMIC.items()}
            found[f"{at}.gyroscopic_forces_enabled"] = _native(parameters)
        for shape in solid_shapes(body):
            solid = RapierSolid(len(carriers), body, shape, law, _filtered(world, body, shape.material))
            carriers.append(FilterCarrier(f"{shape.name}.0", body.name, shape.material, 0))
            found |= COLLIDER.expect(solid, f"shape.{shape.name}", below("collider", neutral))
            found[f"shape.{shape.name}.of"] = body.name
    return found | expected_separate(world, plan, carriers)


def _separate(world: World, body: Body) -> bool:
    """Whether a body is one of Rapier's, not a part of another."""
    return rigid_groups(world)[body.name] == "world" or body.joint.kind == "free" or body.name in links(world)


def _used(world: World) -> set[str]:
    return {shape.material for body in world.bodies for shape in solid_shapes(body)}


def _only_law(world: World) -> PairContact | None:
    """The law of all pairs, where there is only one and nothing bounces."""
    used = _used(world)
    laws = [law for pair, law in meeting_laws(world).items() if set(pair) <= used]
    numbers = {(law.friction, law.restitution) for law in laws}
    bounces = any(law.restitution_threshold or law.restitution for law in laws)
    return laws[0] if len(numbers) == 1 and not bounces else None


def _filtered(world: World, body: Body, material: str) -> bool:
    """Whether some shape must not touch this one: of a material that passes through this one, of a group that this ignores, or
    of an excluded body."""
    laws, used = meeting_laws(world), _used(world)
    passes = any((material, other) not in laws and (other, material) not in laws for other in used)
    groups = {body.collision_group for body in world.bodies if solid_shapes(body)}
    ignores = any(body.collision_group in pair and set(pair) <= groups for pair in world.contact.ignored_groups)
    return passes or ignores or any(body.name in pair for pair in excluded_pairs(world))
