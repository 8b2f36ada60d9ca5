"""PyBullet: URDF files in, arrays out.

Everything that PyBullet adds of its own is switched off (damping, joint motors, velocity clamps, file cache, collision
margins, its idea of which links of one body touch), so that what is left is the world. Facts marked *measured* were
obtained with pybullet 3.2.7.

State. PyBullet keeps a tree at its base's inertial frame (centre of mass, principal axes), and a ball joint between
inertial axes; ``_Simulation`` turns both into the generalised coordinates of ``world/kinematics.py``.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from simspec.contact import Rules, contact_plan
from simspec.control.reference import Servos
from simspec.dialects.pybullet.dialect import COPIES, NO_BELTS, STIFFNESS_ONLY
from simspec.dialects.pybullet.sidecar import NO_LINKS, TREE_SIZE, PybulletSidecar
from simspec.engines.kit.arrays import CollisionUnit, empty_contacts, pick_blocks, sorted_pairs
from simspec.engines.kit.capabilities import FIXED_TIMESTEP, Capability, Deviation, NativeLaw, Recovery, ServoLaw
from simspec.engines.kit.contract import Actuation
from simspec.engines.kit.foreign import EngineAddition, Reads
from simspec.engines.kit.inventory import expected_labels
from simspec.engines.kit.refinements import armature_felt, only_balls_slide, single_motor
from simspec.engines.kit.settings import Setting, Value, resolve_settings
from simspec.engines.kit.simulated import BeforeSteps, SimulatedEngine
from simspec.engines.pybullet.actuation import (
    NATIVE,
    DynamicsProbe,
    PybulletEfforts,
    PybulletJointArrays,
    PybulletJointServos,
)
from simspec.engines.pybullet.constraints import in_same_tree, loops_supported
from simspec.engines.pybullet.contact import (
    CONE,
    CONE_SHORT,
    CONTACT_DEVIATIONS,
    COUPLED,
    DEVIATIONS,
    LOOP_ITERATIONS,
    SETTINGS,
    SOFT,
    only_balls_and_boxes_are_soft,
    rows_act_on_each_other,
)
from simspec.engines.pybullet.foreign import FOREIGN, FOREIGN_ADDITIONS, PybulletForeignFile
from simspec.engines.pybullet.geometry import (
    DULL,
    KEPT,
    LANDING,
    THICK,
    ground_supported,
    meshes_supported,
    thick_enough,
    thicker,
)
from simspec.engines.pybullet.geometry import HOW as GROUND
from simspec.engines.pybullet.inventory import expected, inventory, neutral
from simspec.engines.pybullet.readback import read_back
from simspec.engines.pybullet.simulation import PybulletSimulation, import_pybullet
from simspec.engines.pybullet.trees import SHAPE_KINDS
from simspec.errors import EngineError
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import (
    Level,
    Refinement,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    never,
    outside,
    shape_kinds,
    via_api,
)
from simspec.support.features import Feature
from simspec.world.constraints import anchors
from simspec.world.kinematics import members
from simspec.world.types import Body, EngineValue, PairContact, ReadBack, Vector3, World


def _armature_covered(world: World) -> Refinement | None:
    """Not supported where some armature sits in a tree where a computed torque is not exact."""
    constraints = {name for constraint in world.constraints for name in members(constraint)}
    return armature_felt(world, PyBullet.TITLE, functools.partial(_not_felt, constraints))


def _damping_covered(world: World) -> Refinement | None:
    """The same of implicit damping; exact where all of it is inertia of bodies. ``world``: as the engine has it."""
    if not any(body.joint.armature for body in world.bodies):
        return Refinement(Level.EXACT, classes.AS_INERTIA)
    return classes.no_armed_ball(world) or _armature_covered(world)


def _not_felt(constrained: Container[str], armed: str, bodies: Sequence[Body]) -> str | None:
    if named := next(
        (body.name for body in bodies if body.name in constrained or body.joint.name in constrained), None
    ):
        return f"a constraint holds the tree of {armed!r} at {named!r}, and its impulses would ignore the armature"
    if not {body.joint.kind for body in bodies} <= {"fixed", *SCALAR_JOINTS}:
        return f"the tree of {armed!r} has a free or ball joint; only trees of hinges and slides on a fixed base"
    if any(body.joint.dry_friction for body in bodies):
        return f"the tree of {armed!r} has dry friction, whose impulses would ignore the armature"
    return None


def _ground_supported(world: World) -> Refinement | None:
    base_margin = float(str(resolve_settings(PyBullet, world)["collision_margin"]))
    return ground_supported(world, contact_plan(world, PyBullet.RULES, PyBullet.LAYERS), base_margin)


class PyBullet(SimulatedEngine[PybulletSimulation]):
    """Bullet's multibody dynamics (Featherstone, semi-implicit Euler) through pybullet."""

    NAME: ClassVar[str] = "pybullet"
    TITLE: ClassVar[str] = "PyBullet"
    DIALECT: ClassVar[str] = "pybullet"
    DISTRIBUTION: ClassVar[str] = "pybullet"
    EXTRA: ClassVar[str] = "pybullet"
    LACKS: ClassVar[Mapping[Capability, str]] = {Capability.TIMESTEP: FIXED_TIMESTEP}
    RULES: ClassVar[Rules] = Rules("product", "product", "cross", "cross", "same")
    LAYERS: ClassVar[bool] = True
    KEEPS_CONTACTS: ClassVar[bool] = True
    HULL_PRECISION: ClassVar[float] = KEPT
    FOREIGN: ClassVar[Mapping[str, Reads]] = FOREIGN
    FOREIGN_ADDITIONS: ClassVar[Mapping[str, EngineAddition]] = FOREIGN_ADDITIONS
    NATIVE_LAW: ClassVar[NativeLaw | None] = NativeLaw(ServoLaw.MOTOR, accuracy=1e-12)
    SUPPORT: ClassVar[Table] = {
        **classes.driven("PyBullet"),
        **exactly(Feature.JOINT_SEVERAL, Feature.DAMPING, Feature.BALL_DAMPING),
        Feature.LIMIT_POSITION: approximate(
            "PyBullet stops joints one step late: they pass a limit by up to v dt, return by joint_erp of "
            "that in each step, and keep that speed. The impulse ignores armature that simspec computes",
            short="a joint passes its limit by up to one step's way, and rebounds with up to 1 % of its speed",
        ),
        Feature.DRY_FRICTION: via_api(classes.ZERO_VELOCITY_MOTOR),
        Feature.DAMPING_IMPLICIT: outside(
            "simspec applies the effort τ − dt D v̇, with (M + dt D) v̇ = τ − D v − h, from PyBullet's state before each step",
            _damping_covered,
            "simspec replaces implicit damping by an effort before each step",
        ),
        Feature.ARMATURE: outside(
            "simspec applies the effort τ − A v̇, with (M + A) v̇ = τ − D v − h, from PyBullet's state before each step",
            _armature_covered,
            "simspec replaces armature by an effort before each step",
        ),
        **for_each(via_api(classes.EFFORTS), Feature.SPRING, Feature.BALL_SPRING, Feature.SUM),
        **for_each(via_api(classes.SIDECAR), *features.INITIAL_STATE),
        Feature.TREE_SIZE: TREE_SIZE,
        Feature.TREE_DEPTH: never(NO_LINKS),
        **shape_kinds("PyBullet", SHAPE_KINDS.values()),
        Feature.SHAPE_BOX: exact(
            "PyBullet keeps a margin of 1 mm within boxes of links other than the base. Accept `shape.box` for boxes thinner "
            "than 2 mm there",
            refine=lambda world: thick_enough(PyBullet, "box", world),
            cases=(THICK["box"],),
        ),
        Feature.SHAPE_CYLINDER: exact(
            "PyBullet's cylinders are implicit surfaces, with collision margin 0 on the base",
            refine=lambda world: thick_enough(PyBullet, "cylinder", world),
            cases=(THICK["cylinder"], DULL["cylinder"]),
        ),
        Feature.SHAPE_PLANE: exact("boxes tumble when they bounce on PyBullet's plane. Use a large box as the ground"),
        Feature.SHAPE_MESH: exact(
            "simspec writes the convex hull, 1 mm smaller on links other than the base, where PyBullet adds a margin: "
            "faces are exact, edges rounded. See docs/engines/pybullet.md",
            refine=lambda world: meshes_supported(PyBullet, world),
            cases=(LANDING, THICK["mesh"], DULL["mesh"]),
        ),
        Feature.SHAPE_HEIGHTFIELD: exact(GROUND, refine=_ground_supported),
        Feature.SURFACE_VELOCITY: never(NO_BELTS),
        **for_each(
            COPIES,
            *(Feature.MATERIALS_PER_BODY, Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS, Feature.HARDNESS_PAIRS),
        ),
        Feature.FRICTION: exact("PyBullet limits the friction coefficient of a pair to 10"),
        **COUPLED,
        Feature.RESTITUTION: exact(
            "PyBullet's error reduction adds slightly to the restitution ratio; see docs/engines/pybullet.md"
        ),
        Feature.RESTITUTION_THRESHOLD: via_api(
            "PyBullet has one restitutionVelocityThreshold for all pairs that bounce"
        ),
        **for_each(
            exact("PyBullet combines spinning and rolling friction as s₁ μ₂ + s₂ μ₁, which requires sliding friction"),
            *features.MOMENTS,
        ),
        Feature.HARDNESS_COMMON: via_api(
            "simspec sets contactERP and contactSlop, and switches speculative contact off"
        ),
        Feature.HARDNESS_TIME_CONSTANT: never(STIFFNESS_ONLY),
        Feature.HARDNESS_STIFFNESS: approximate(
            f"{SOFT}. It is exact for spheres and boxes; capsules and cylinders have a different number of points; see "
            "docs/engines/pybullet.md",
            only_balls_and_boxes_are_soft,
            "capsules and cylinders have two or three points, and lie too high or too deep",
        ),
        Feature.HARDNESS_NATIVE: via_api("simspec keeps PyBullet's contactERP and contactSlop, for all pairs or none"),
        **for_each(via_api(classes.SIDECAR), Feature.PASSING_PAIRS, Feature.COLLISION_GROUPS),
        Feature.CONE_ELLIPTIC: approximate(CONE, only_balls_slide("enableConeFriction=1"), CONE_SHORT),
        Feature.CONE_PYRAMID_INSCRIBED: never("PyBullet has the elliptic cone and the circumscribed pyramid only"),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: via_api(classes.SIDECAR),
        Feature.CONTROL_NATIVE: via_api(NATIVE, single_motor("PyBullet")),
        Feature.EXCLUDED_PAIRS: via_api(classes.SIDECAR),
        Feature.TOUCHING_PAIRS: via_api(classes.SIDECAR),
        Feature.GRAVITY: via_api(classes.SIDECAR),
        Feature.TIMESTEP: via_api(classes.SIDECAR),
        Feature.CONSTRAINT_LOOP: via_api(classes.SIDECAR, loops_supported),
        Feature.CONSTRAINT_COUPLING: via_api(classes.SIDECAR, in_same_tree),
        Feature.BALL_LIMIT: never("PyBullet's spherical joints have no limits"),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = SETTINGS
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (*CONTACT_DEVIATIONS, *DEVIATIONS)
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "friction_cone": "PyBullet does not report its contact settings",
        "shape.name": "PyBullet does not store shape names",
        "shape.colour": "PyBullet stores colours in single precision",
        "control.native": "simspec switches PyBullet's controllers on when a run begins",
        "collision_group": "PyBullet does not report its collision masks; simspec probes the filter instead",
    }

    @classmethod
    def chosen_settings(cls, world: World, settings: Mapping[str, Value]) -> Mapping[str, Value]:
        """More sweeps where rows of constraints act on each other, unless the spec says how many."""
        if not rows_act_on_each_other(world) or "iterations" in dict(world.options(cls.NAME).settings):
            return settings
        return {**settings, "iterations": LOOP_ITERATIONS}

    @classmethod
    def thicker(cls, world: World) -> Mapping[str, float]:
        return thicker(cls, world)

    @classmethod
    def recovery(cls, settings: Mapping[str, Any], law: PairContact) -> Recovery | None:
        return Recovery(float(settings["contact_erp"])) if law.hardness.kind == "common" else None

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        found = expected(
            world,
            cls.chosen_settings(world, resolve_settings(cls, world)),
            contact_plan(world, cls.RULES, cls.LAYERS),
            neutral,
        )
        return found | expected_labels(cls, world)

    def __init__(self) -> None:
        super().__init__()
        self._efforts: PybulletEfforts | None = None
        self._before: BeforeSteps | None = None
        self._probe: tuple[PybulletSimulation, DynamicsProbe] | None = None
        self._source: tuple[Path, PybulletSidecar] | None = None

    @property
    def client(self) -> int:
        """The number of PyBullet's physics client."""
        return self._simulation.client

    @property
    def _outside(self) -> PybulletEfforts:
        if self._efforts is None:
            raise RuntimeError("load first")
        return self._efforts

    @classmethod
    def prepare(cls) -> None:
        import_pybullet()

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        self.close()
        try:
            typed = PybulletSidecar.of(sidecar)
        except ValueError as error:
            raise EngineError("pybullet", str(error)) from error
        self._source = (folder, typed)
        self._sim = PybulletSimulation(folder, typed, self._anchors(folder, typed))
        self._efforts = PybulletEfforts(self._sim, typed.springs, typed.armature, typed.sums or ())
        self._sim.set_state(*self._sim.initial_state)
        before = BeforeSteps(self, typed.passive)
        self._before = before if before.needed else None

    @staticmethod
    def _anchors(folder: Path, sidecar: PybulletSidecar) -> Mapping[str, Vector3]:
        """Where welds are best held, by what PyBullet holds of the bodies when it is loaded without them."""
        if not any(constraint.kind == "weld" for constraint in sidecar.constraints or ()):
            return {}
        bare = PybulletSimulation(folder, dataclasses.replace(sidecar, constraints=None))
        try:
            model = read_back(bare, PybulletEfforts(bare, sidecar.springs, sidecar.armature))
        finally:
            bare.close()
        return anchors(World("", model.bodies, constraints=sidecar.constraints or ()))

    def read_back(self) -> ReadBack:
        sim = self._simulation
        model = read_back(sim, self._outside)
        return dataclasses.replace(
            model if self._before is None else self._before.completed(model),
            unreadable=dict(self.UNREADABLE),
            inventory=inventory(sim),
            neutral=neutral(sim),
        )

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        self._simulation.move_to(q, v)

    def mass_blocks(self, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
        q, _ = self._simulation.get_state()
        parts = pick_blocks(blocks, self._probing().masses(q))
        return [part + np.diag(self._outside.armature[block]) for block, part in zip(blocks, parts, strict=True)]

    def bias_force(self) -> np.ndarray:
        q, v = self._simulation.get_state()
        bias = self._probing().bias_force(q, v)
        return bias if self._before is None else self._before.bias_force(bias)

    def _probing(self) -> DynamicsProbe:
        """A second simulation of the same files in which nothing but the tree dynamics acts."""
        if self._probe is None:
            if self._source is None:
                raise RuntimeError("load first")
            folder, sidecar = self._source
            sim = PybulletSimulation(folder, dataclasses.replace(sidecar, constraints=None))
            self._probe = (sim, DynamicsProbe(sim))
        return self._probe[1]

    def step(self, count: int, effort: np.ndarray | None = None) -> None:
        sim, efforts = self._simulation, self._outside
        if effort is None and not efforts.needed and self._before is None:
            sim.advance(count)
            return
        given = np.zeros(sim.nv) if effort is None else np.asarray(effort, dtype=float)
        for _ in range(count):  # PyBullet forgets applied efforts after each step
            efforts.apply(efforts.total(given if self._before is None else self._before.effort(given)))
            sim.advance(1)

    def actuate(self, q: np.ndarray, v: np.ndarray) -> Actuation:
        quick = not self._outside.needed and self._before is None
        return PybulletJointArrays(self, self._simulation, q, v) if quick else Actuation(self, q, v)

    def track(
        self, q: np.ndarray, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ) -> Servos:
        return PybulletJointServos(self._simulation, v, stiffness, damping, limit)

    def contacts(self) -> dict[str, np.ndarray]:
        sim = self._simulation
        reach = sim.settings["contact_processing_threshold"]
        points = [point for point in sim.bullet.getContactPoints() if point[8] <= reach]
        if not points:
            return empty_contacts()
        units = np.array([(sim.unit[p[1], p[3]], sim.unit[p[2], p[4]]) for p in points], dtype=np.int64)
        return {
            "body": np.array([body for body, _ in sim.carriers.values()], dtype=np.int64)[units],
            "unit": units,
            "position": (np.array([p[5] for p in points]) + np.array([p[6] for p in points])) / 2.0,
            "normal": np.array([p[7] for p in points]),
            "distance": np.array([p[8] for p in points]),
            "normal_force": np.array([p[9] for p in points]),
        }

    def collision_units(self) -> Sequence[CollisionUnit]:
        """Links: a point of contact does not tell which of a link's shapes it belongs to."""
        return [CollisionUnit(body, shapes) for body, shapes in self._simulation.carriers.values()]

    def detect_units(self) -> np.ndarray:
        sim = self._simulation
        unit = sim.unit
        found = {
            (unit[point[1], point[3]], unit[point[2], point[4]]) for point in sim.detect_contacts() if point[8] <= 0.0
        }
        return sorted_pairs(np.array(sorted(found), dtype=np.int64))

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(set(v.tolist()))

    def energy(self) -> tuple[float, float]:
        kinetic, potential = self._simulation.energy()
        more_kinetic, more_potential = self._outside.energy()
        more_potential += 0.0 if self._before is None else self._before.potential()
        return kinetic + more_kinetic, potential + more_potential

    def close(self) -> None:
        if self._probe is not None:
            self._probe[0].close()
        super().close()
        self._efforts = self._probe = self._before = None

    def load_foreign(self, file: Path, language: str, packages: Mapping[str, str], log: list[str]) -> ReadBack:
        foreign = PybulletForeignFile(import_pybullet(), log)
        try:
            return foreign.load(file, language)
        finally:
            foreign.close()
