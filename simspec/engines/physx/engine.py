"""PhysX, as SAPIEN brings it: rigid bodies in single precision on the processor, stepped by its own solver under the common law
of contact.

Facts marked *measured*: SAPIEN 3.0.3, PhysX 5.3.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from simspec.contact.plan import contact_plan
from simspec.contact.rules import Rules
from simspec.engines.kit.capabilities import SINGLE, Capability
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.refinements import no_friction, static_or_massless, static_planes
from simspec.engines.kit.settings import Setting, SettingGroup
from simspec.engines.kit.world_simulation import Parts, WorldEngine
from simspec.engines.physx.approximations import BOXES, COUPLED, DEVIATIONS, MESHES, boxes, meshes
from simspec.engines.physx.building import exclusions, imported, kinds
from simspec.engines.physx.readback import expected, inventory, neutral, read_back
from simspec.engines.physx.simulation import PhysxSimulation
from simspec.support import classes, features
from simspec.support.declarations import (
    Refinement,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    never,
    shape_kinds,
    unsupported_if,
    via_api,
)
from simspec.support.features import Feature
from simspec.world.contact_pairs import excluded_pairs, solid_shapes
from simspec.world.types import World

_DRIFT = "PhysX integrates articulations by a different method, and they have no ball joints; see docs/engines/physx.md"
_NO_JOINTS = "simspec passes no joints to PhysX"
_THRESHOLD = (
    "simspec raises PhysX's bounce threshold, one for each scene, to 2 / (1 − e) times the speed that gravity adds in "
    "a step, so that resting bodies do not hop; slower contacts do not bounce"
)


def _bits_do(world: World) -> Refinement | None:
    """SAPIEN's filter has 32 bits for kinds of shapes, and 32 for bodies that must not touch."""
    plan = contact_plan(world, PhysX.RULES, PhysX.LAYERS)
    ignored = {frozenset(pair) for pair in world.contact.ignored_groups}

    def meet(first: tuple[str, str, int], second: tuple[str, str, int]) -> bool:
        return frozenset((first[0], second[0])) not in ignored and plan.meet(first[1:], second[1:])

    keys = dict.fromkeys(
        (body.collision_group, shape.material, layer)
        for body in world.bodies
        for shape in solid_shapes(body)
        for layer in plan.layers(shape.material)
    )
    try:
        kinds(list(keys), meet)
        exclusions(excluded_pairs(world))
    except ValueError as error:
        return unsupported_if(f"SAPIEN's filter {error}")
    return None


class PhysX(WorldEngine[PhysxSimulation]):
    """PhysX's rigid actors, by its PGS solver."""

    NAME: ClassVar[str] = "physx"
    TITLE: ClassVar[str] = "PhysX"
    DIALECT: ClassVar[str] = "physx"
    DISTRIBUTION: ClassVar[str] = "sapien"
    EXTRA: ClassVar[str] = "physx"
    PRECISION: ClassVar[str] = SINGLE
    RULES: ClassVar[Rules] = Rules("mean", "mean", most_restitution=1.0)
    LAYERS: ClassVar[bool] = True
    KEEPS_CONTACTS: ClassVar[bool] = True
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.DRY_FRICTION_OFF: _NO_JOINTS,
        Capability.NATIVE_CONTROLLERS: _NO_JOINTS,
        Capability.FOREIGN_FILES: "simspec does not use SAPIEN's loaders of robot files",
    }
    SUPPORT: ClassVar[Table] = {
        **classes.free_bodies_only("PhysX", _DRIFT),
        **exactly(Feature.FRICTION, Feature.TOUCHING_PAIRS),
        **shape_kinds("PhysX", ("sphere", "box", "capsule")),
        Feature.SHAPE_CYLINDER: never(
            "PhysX has no cylinder; SAPIEN approximates it by a prism (see docs/engines/physx.md)"
        ),
        Feature.SHAPE_BOX: exact(
            "PhysX's contact of boxes with boxes is approximate. Accept `shape.box` where boxes may touch each other",
            refine=boxes,
            cases=(BOXES,),
        ),
        Feature.JOINT_FIXED: static_or_massless(
            "PhysX integrates the common centre of mass of {name} and the body that it is fixed to, and simspec's coordinates "
            "are those of one of the two"
        ),
        Feature.SHAPE_PLANE: static_planes("PhysX's planes are static, and {name} moves"),
        Feature.SHAPE_MESH: exact(
            "PhysX supports hulls of up to 255 faces and drops corners that protrude too little; see docs/engines/physx.md. "
            "Accept `shape.mesh` where hulls may touch more than planes",
            refine=meshes,
            cases=(MESHES,),
        ),
        **COUPLED,
        **for_each(classes.LAYERS, Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS),
        Feature.RESTITUTION: exact(_THRESHOLD),
        Feature.RESTITUTION_THRESHOLD: via_api(_THRESHOLD),
        Feature.HARDNESS_COMMON: via_api(
            "simspec sets each body's maximum depenetration velocity to β depth/dt of its deepest contact before each step"
        ),
        **for_each(
            never("SAPIEN gives no access to PhysX's compliant contacts"), *features.COMPLIANCES, Feature.HARDNESS_PAIRS
        ),
        **for_each(never("PhysX bounds friction by a circular cone"), *features.PYRAMIDS),
        Feature.CONE_ELLIPTIC: approximate(
            "PhysX applies friction at two anchors of a contact patch, along and across the slip of the "
            "bodies' centres: a square bounds the friction of spinning sliders, and leaning or piled "
            "bodies slip too little. Sliding without spin is exact; see docs/engines/physx.md",
            no_friction,
            "friction is up to 1.4 times that of the cone where a body spins as it slides",
        ),
        **for_each(
            exact("simspec sets SAPIEN's collision groups", refine=_bits_do),
            *(Feature.PASSING_PAIRS, Feature.COLLISION_GROUPS, Feature.EXCLUDED_PAIRS),
        ),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "iterations": Setting(
            50,
            "Number of sweeps over all contacts in a step (solver_position_iterations). PhysX does not warm-start a "
            "step, so that stacks move by the remaining error (see docs/engines/physx.md).",
            minimum=1,
            maximum=255,
            group=SettingGroup.ACCURACY,
            finer=255,
        )
    }
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (
        *DEVIATIONS,
        Deviation(
            "overlap",
            1.0,
            "PhysX removes an overlap by a velocity that it discards before the step ends: bodies "
            "separate as by the law, and no speed remains",
        ),
    )
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "collision_group": "PhysX filters by bits that simspec sets, and has no named groups",
        "static.inertial": "PhysX's static actors have no mass",
    }

    PARTS: ClassVar[Parts[PhysxSimulation]] = Parts(PhysxSimulation, read_back, inventory, neutral, expected)

    @classmethod
    def prepare(cls) -> None:
        imported()
