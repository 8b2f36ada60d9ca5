"""Drake: MultibodyPlant, built by calls from the format ``world``. Facts marked *measured*: Drake 1.51.1."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from simspec.contact import Rules, contact_plan
from simspec.control.reference import Servos
from simspec.engines.drake import integrators
from simspec.engines.drake.approximations import (
    BODY_SECONDS,
    COUPLED,
    DEVIATIONS,
    LIFTS,
    MOST_GIGABYTES,
    MOST_TAMSI,
    boxes_supported,
    chosen,
    corners,
    coulomb,
    light_enough,
    stops,
    too_large,
)
from simspec.engines.drake.building import MOST_PLANES, import_drake
from simspec.engines.drake.inventory import expected, inventory, neutral
from simspec.engines.drake.readback import FOREIGN, FOREIGN_ADDITIONS, SIZES, load, parser_parts, read_back
from simspec.engines.drake.simulation import NATIVE, DrakeJointServos, DrakeSimulation, pd_controllers_hold
from simspec.engines.kit.capabilities import (
    COMMON,
    Capability,
    Deviation,
    NativeLaw,
    Recovery,
    ServoLaw,
)
from simspec.engines.kit.foreign import EngineAddition, Reads
from simspec.engines.kit.methods import IntegrationMethod
from simspec.engines.kit.settings import Setting, SettingGroup, under_weight
from simspec.engines.kit.simulated import outside_constraints
from simspec.engines.kit.world_simulation import Parts, WorldEngine
from simspec.support import classes, features
from simspec.support.declarations import (
    Attempt,
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
from simspec.world.contact_pairs import solid_shapes
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import rigid_groups
from simspec.world.types import VELOCITY_SIZE, PairContact, ReadBack, World

_COMPUTED = (
    "Drake integrates joint damping implicitly and has no joint springs; simspec applies explicit "
    "efforts before each step"
)
NO_DRY_FRICTION = "Drake has no dry friction in joints"
SAP, TAMSI = (("contact_approximation", name) for name in ("sap", "tamsi"))
_MORE_POINTS = (
    "Drake computes one contact point for each pair of geometries; simspec adds balls and discs "
    "within the shape for further points"
)
_LIFTS_IMPACT = "SAP's contact model is convex, and friction in an impact separates the bodies"
_CONVEX = (
    "SAP's contact model is convex: friction lifts sliding bodies and separates bodies in impacts, and its size is wrong. Use "
    "contact_approximation: tamsi, whose friction is exact; see docs/engines/drake.md"
)
_SLOW_RECOVERY = "TAMSI removes overlaps at 1/dissipation at most, for any overlap and timestep"


def planes_covered(world: World) -> Refinement | None:
    """Not supported where Drake crashes with the planes of a world."""
    return unsupported_if(_planes_that_crash(world))


def _planes_that_crash(world: World) -> str | None:
    """Why Drake crashes with the planes of this world; None where it does not."""
    groups = rigid_groups(world)
    plan = contact_plan(world, Drake.RULES, Drake.LAYERS)
    planes = [(body, shape) for body in world.bodies for shape in solid_shapes(body) if shape.kind == "plane"]
    moving = [body.name for body, _ in planes if groups[body.name] != "world"]
    if moving:
        return f"Drake crashes with half spaces on moving bodies, such as {moving[0]!r}"
    if sum(len(plan.layers(shape.material)) for _, shape in planes) > MOST_PLANES:
        return f"Drake crashes with many half spaces; simspec passes at most {MOST_PLANES}, copies included"
    return None


def memory_covered(world: World) -> Refinement | None:
    """Not supported where Drake needs too much memory."""
    plan = contact_plan(world, Drake.RULES, Drake.LAYERS)
    parts = (
        len(plan.layers(shape.material)) * (1 + len(corners(shape.kind, shape.size)))
        for body in world.bodies
        for shape in solid_shapes(body)
    )
    return unsupported_if(too_large(sum(parts), sum(VELOCITY_SIZE[body.joint.kind] for body in world.bodies)))


LOST = 3e-7
"""Share of m c² (c: the centre of mass in the body's frame) below which the sum of the moments about the centre of mass is off
by more than the proof's 1e-9: Drake keeps inertias about the origins of bodies, in doubles (measured: from 1.4e-7 on, in 4,000
random inertias). No moments at all are held as none."""


def inertia_supported(world: World) -> Refinement | None:
    """Not supported where Drake needs too much memory, or where it would lose a moment of inertia in round-off."""
    static = rigid_groups(world)
    for body in world.bodies:
        inertial = lumped_inertial(world, body)
        arm = sum(value * value for value in inertial.centre_of_mass)
        lost = 0.0 < sum(inertial.inertia[:3]) < LOST * inertial.mass * arm
        if (
            lost and body.joint.kind != "free" and static[body.name] != "world"
        ):  # Drake receives free bodies' inertias about their centres
            return unsupported_if(
                f"Drake stores inertias about the origins of bodies, where the moments of {body.name!r} are "
                "below round-off"
            )
    return memory_covered(world)


class Drake(WorldEngine[DrakeSimulation]):
    """Drake's discrete MultibodyPlant, with point contact, by SAP or TAMSI."""

    NAME: ClassVar[str] = "drake"
    TITLE: ClassVar[str] = "Drake"
    DIALECT: ClassVar[str] = "drake"
    DISTRIBUTION: ClassVar[str] = "drake"
    EXTRA: ClassVar[str] = "drake"
    RULES: ClassVar[Rules] = Rules("harmonic", "none")
    LAYERS: ClassVar[bool] = True
    LACKS: ClassVar[Mapping[Capability, str]] = {Capability.DRY_FRICTION_OFF: NO_DRY_FRICTION}
    FOREIGN: ClassVar[Mapping[str, Reads]] = FOREIGN
    FOREIGN_ADDITIONS: ClassVar[Mapping[str, EngineAddition]] = FOREIGN_ADDITIONS
    NATIVE_LAW: ClassVar[NativeLaw | None] = NativeLaw(ServoLaw.IMPLICIT_SPRING, accuracy=1e-7, residual=1e-6)
    SUPPORT: ClassVar[Table] = {
        **classes.driven("Drake"),
        **exactly(Feature.JOINT_SEVERAL, Feature.FRICTION, Feature.HARDNESS_COMMON, *features.FILTERS),
        **shape_kinds("Drake", [kind for kind, _ in SIZES.values()]),
        Feature.INTEGRATOR: integrators.SUPPORT,
        Feature.DAMPING_IMPLICIT: integrators.IMPLICIT_DAMPING,
        Feature.INERTIA: exact(
            (
                "Drake stores every pair of geometries and a dense mass matrix; simspec rejects worlds that need "
                f"more than {MOST_GIGABYTES:g} GB"
            ),
            refine=inertia_supported,
        ),
        Feature.JOINT_FREE: exact(
            "simspec replaces Drake's integration of rotations by the exponential map after each step"
        ),
        Feature.JOINT_BALL: exact(
            "simspec keeps Drake's BallRpyJoint, which is singular at a pitch of 90°, at zero on a frame that "
            "carries the rotation"
        ),
        **classes.NOT_IN_WORLD_JSON,
        Feature.LIMIT_POSITION: approximate(
            "TAMSI models joint limits as springs, which joints overrun, and leave with part of their speed. "
            "Use contact_approximation: sap, which stops them within the step",
            stops,
            "with contact_approximation: tamsi limits are springs: 0.035 rad deep at 10 rad/s and 1 ms",
        ),
        **for_each(via_api(_COMPUTED), *features.DAMPERS_AND_SPRINGS, Feature.SUM),
        Feature.DRY_FRICTION: never(NO_DRY_FRICTION),
        Feature.ARMATURE: exact("simspec sets the rotor inertia of an actuator with gear ratio 1"),
        Feature.SHAPE_BOX: approximate(
            "Drake computes one contact point for each pair of geometries; simspec adds balls at the "
            "corners, and boxes with crossing edges sink. Use hydroelastic_faces: true; see "
            "docs/engines/drake.md",
            boxes_supported,
            "boxes whose edges cross sink by up to 13 mm/s (hydroelastic_faces: true avoids this)",
        ),
        Feature.SHAPE_CYLINDER: exact(_MORE_POINTS),
        Feature.SHAPE_CAPSULE: exact(_MORE_POINTS),
        Feature.SHAPE_HEIGHTFIELD: never(
            "Drake's point contact treats a mesh as its convex hull, and Drake has no hydroelastic contact of "
            "static with rigid geometries"
        ),
        Feature.SHAPE_MESH: exact(
            f"{_MORE_POINTS}. TAMSI fails to converge at some landings of irregular hulls; use "
            "contact_approximation: sap"
        ),
        Feature.SHAPE_PLANE: exact("Drake supports half spaces of static bodies only", refine=planes_covered),
        **COUPLED,
        Feature.FRICTION_PAIRS: exact("simspec writes copies of shapes in layers"),
        **for_each(never("Drake's contact has no restitution"), Feature.RESTITUTION, Feature.RESTITUTION_PAIRS),
        Feature.RESTITUTION_THRESHOLD: exact("Drake's contact has no restitution"),
        **for_each(never("Drake's point contact transmits no torque"), *features.MOMENTS),
        Feature.HARDNESS_TIME_CONSTANT: never(
            "Drake defines the stiffness of contact in N/m, independently of the masses"
        ),
        Feature.HARDNESS_STIFFNESS: classes.unwritten(TITLE, Attempt.CONTACT_PROBES),
        **for_each(classes.unwritten(TITLE, Attempt.READ_BACK), Feature.HARDNESS_NATIVE, Feature.HARDNESS_PAIRS),
        **for_each(never("Drake has the elliptic cone only"), *features.PYRAMIDS),
        Feature.CONE_ELLIPTIC: approximate(
            _CONVEX,
            coulomb,
            "with SAP pushed and sliding bodies are lifted: friction is 0.7 to 1.7 times the law's",
        ),
        Feature.IMPACT_FRICTION: approximate(
            _CONVEX,
            coulomb,
            "with SAP friction in oblique impacts is up to 62 % too large, and the bodies separate",
        ),
        Feature.KINEMATIC: via_api(classes.HEAVY, light_enough),
        Feature.CONTROL_NATIVE: exact(NATIVE, refine=pd_controllers_hold),
        **outside_constraints(TITLE),
        Feature.SUM_DRY_FRICTION: never(NO_DRY_FRICTION),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "integrator": integrators.SETTING,
        "contact_approximation": Setting(
            "auto",
            "auto: tamsi where colliding bodies have friction, no joint has limits or a Drake controller, no "
            "kinematic body carries joints, no colliding mesh moves, and one body with collision shapes moves, "
            f"or at most {MOST_TAMSI} with a timestep of at most {1e3 * BODY_SECONDS:g} ms over their number; "
            "else sap. Where edges of boxes may cross, sap is used above 2 ms. TAMSI's friction is exact, but "
            "its equations are dense, and fail to converge in some stacks. SAP has the common law's error "
            "reduction and stops joints at their limits; its friction lifts sliding bodies.",
            ("auto", "sap", "tamsi"),
            group=SettingGroup.SOLVER,
        ),
        "stiffness": Setting(
            1e8,
            "Stiffness of every shape (N/m); two shapes in contact have half. At 1e12 SAP's line search fails.",
            minimum=1.0,
            maximum=1e11,
            at_least=under_weight,
            group=SettingGroup.SOFTNESS,
            finer=1e9,
        ),
        "dissipation": Setting(
            1000.0,
            "Dissipation of the Hunt-Crossley law (s/m): TAMSI removes overlaps at 1/dissipation at most.",
            minimum=0.0,
            maximum=1e8,
            needs=("contact_approximation", ("auto", "tamsi")),
            group=SettingGroup.ERROR_REDUCTION,
        ),
        "hydroelastic_faces": Setting(
            False,
            "Compute contact of boxes with boxes and planes by hydroelastic pressure fields, instead of points "
            "at their corners. Moving boxes are compliant, static bodies rigid; other pairs have point "
            "contact. A step takes twice the time (see docs/engines/drake.md).",
            only_with="hydroelastic_faces",
            group=SettingGroup.GEOMETRY,
        ),
        "hydroelastic_modulus": Setting(
            1e8,
            "Hydroelastic modulus of every moving box (Pa). A box rests m g h/(2 A modulus) deep, where h is "
            "its smallest edge. It does not affect error reduction: the common law's β with SAP, 1/dissipation "
            "with TAMSI.",
            minimum=1.0,
            only_with="hydroelastic_faces",
            needs=("hydroelastic_faces", (True,)),
            group=SettingGroup.SOFTNESS,
        ),
        "stiction_tolerance": Setting(
            1e-6,
            "Slip (m/s) below which TAMSI's friction is less than μ N: bodies below the friction limit creep "
            "more slowly than this.",
            minimum=1e-12,
            maximum=0.01,
            needs=("contact_approximation", ("auto", "tamsi")),
            group=SettingGroup.FRICTION,
            finer=1e-8,
        ),
    }
    PROBED_TOGETHER: ClassVar[int | None] = 4  # TAMSI, 1 ms: 24 boxes 7 ms a step, six times four 1.3 ms
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (
        *DEVIATIONS,
        Deviation("overlap", 1e-3, _SLOW_RECOVERY, relative=False, setting=TAMSI),
        *(
            Deviation(name, size, LIFTS, friction=friction, setting=SAP)
            for name in ("push", "push-oblong")
            for size, friction in ((0.31, 0.1), (0.7, 0.51))
        ),
        *(Deviation(name, 0.15, LIFTS, friction=0.51, setting=SAP) for name in ("stop", "stop-oblong")),
        Deviation("stick", 1.3e-4, LIFTS, relative=False, friction=1.01, timestep=0.0144, setting=SAP),
        *(
            Deviation("oblique", size, _LIFTS_IMPACT, friction=friction, setting=SAP)
            for size, friction in ((0.31, 0.1), (0.63, 0.51))
        ),
        *(
            Deviation("oblique-separation", size, _LIFTS_IMPACT, relative=False, friction=friction, setting=SAP)
            for size, friction in ((0.31, 0.1), (0.63, 0.51))
        ),
    )
    UNREADABLE: ClassVar[Mapping[str, str]] = {"collision_group": "Drake filters pairs of geometries, not groups"}

    @classmethod
    def method(cls, world: World) -> IntegrationMethod | None:
        return integrators.method(world)

    def set_timestep(self, timestep: float) -> None:
        self._simulation.set_timestep(timestep)
        if self._before is not None:
            self._before.set_timestep(timestep)

    @classmethod
    def chosen_settings(
        cls, world: World, settings: Mapping[str, bool | int | float | str]
    ) -> dict[str, bool | int | float | str]:
        return chosen(world, settings)

    @classmethod
    def recovery(cls, settings: Mapping[str, Any], law: PairContact) -> Recovery | None:
        if settings[TAMSI[0]] != TAMSI[1]:
            return COMMON
        speed = 1.0 / float(settings["dissipation"])
        return Recovery(speed=speed, why=f"TAMSI takes overlaps back at {1e3 * speed:g} mm/s at most (1/dissipation)")

    PARTS: ClassVar[Parts[DrakeSimulation]] = Parts(DrakeSimulation, read_back, inventory, neutral, expected)

    @classmethod
    def prepare(cls) -> None:
        import_drake()

    @classmethod
    def prepare_foreign(cls) -> None:
        import_drake()
        parser_parts()

    def track(
        self, q: np.ndarray, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ) -> Servos:
        # the gains were given before the plant was finished, as Drake requires; the proof compares them
        return DrakeJointServos(self._simulation, v)

    def load_foreign(self, file: Path, language: str, packages: Mapping[str, str], log: list[str]) -> ReadBack:
        import_drake()
        return load(file, packages, log)
