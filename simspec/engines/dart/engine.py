"""DART: a .skel file in, arrays out.

dartpy sets the features that .skel lacks from the sidecar. Damping and springs, which DART has only implicit in time, are
applied as an effort computed from DART's own state before every step. Facts marked *measured* were obtained with dartpy 6.20.0.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from simspec.contact import Rules, contact_plan
from simspec.control.reference import Servos
from simspec.dialects.dart.contact import OVERLOOKED, accepted_contact, detector_of, overlooked
from simspec.dialects.dart.dialect import ANGLE, COPIES, LIMITS, NO_BELTS
from simspec.dialects.dart.sidecar import DartSidecar
from simspec.engines.dart.actuation import (
    NATIVE,
    DartJointArrays,
    DartJointServos,
    no_fluid_on_servos,
    no_springs,
    no_weights_on_servos,
    none_along_servos,
    none_on_servos,
)
from simspec.engines.dart.contact import COUPLED, DEVIATIONS, SETTINGS
from simspec.engines.dart.inventory import chosen_solver, expected, inventory, neutral
from simspec.engines.dart.readback import FOREIGN, FOREIGN_ADDITIONS, SHAPE_KINDS, DartForeignFile, read_back
from simspec.engines.dart.simulation import DartSimulation, import_dartpy
from simspec.engines.kit.arrays import CollisionUnit, empty_contacts, sorted_pairs
from simspec.engines.kit.capabilities import (
    FIXED_TIMESTEP,
    HOPS,
    PREDICTED,
    PYRAMID,
    THRESHOLD,
    Capability,
    Deviation,
    NativeLaw,
    Recovery,
    ServoLaw,
)
from simspec.engines.kit.contract import Actuation
from simspec.engines.kit.foreign import EngineAddition, Reads
from simspec.engines.kit.inventory import expected_labels
from simspec.engines.kit.refinements import (
    BLUNT,
    NO_FRICTION,
    blunted,
    implicit_damping_armature,
    implicit_damping_ball_armature,
    native_implicit_damping,
)
from simspec.engines.kit.settings import Setting, resolve_settings
from simspec.engines.kit.simulated import SteppedEngine, outside_constraints
from simspec.engines.kit.world_simulation import contact_table
from simspec.errors import EngineError
from simspec.support import classes, features
from simspec.support.declarations import (
    Level,
    Refinement,
    Support,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    never,
    shape_kinds,
    via_api,
)
from simspec.support.features import Feature
from simspec.world.contact_pairs import frictionless, meeting_laws
from simspec.world.reach import reach
from simspec.world.types import EngineValue, PairContact, ReadBack, World

_NO_TORQUE = "DART's contacts have one normal and two tangential constraints, and transmit no torque"
_RIGID = "DART's contacts are rigid, and dartpy gives no access to their error reduction and constraint force mixing"
_DETECTORS = (
    "simspec selects DART's collision detector by the pairs of shapes that may touch, and rejects pairs "
    "without an exact detector unless the spec accepts them"
)
_ARMATURE = "simspec substitutes implicit damping and an opposite effort for armature at every step"
_PAGE = "see docs/engines/dart.md"


MOST_RECOVERY = 1e-3
"""DART takes back 1 % of an overlap in each step, but no faster than this (m/s): measured from 1 µm to 20 mm with all its
solvers, and the same at every timestep. Overlaps of up to 0.1 mm for each ms of the timestep follow the common law."""

_TRIPS = (
    "DART's sliders trip over their leading corners, which alone touch in a step in which round-off has tilted the body"
)
_LIVELY = (
    "DART lets bodies with restitution hop without end, at e g dt / (1 - e), where that exceeds "
    "its least bounce. Pushed bodies slide"
)


DANTZIG = ("contact_solver", "dantzig")
_BOUNDS = (
    "DART's Dantzig solver bounds friction by the normal forces of the frictionless problem, so that leaning and "
    "clamped bodies slip"
)
_FRICTIONLESS_BOUNDS = Refinement(
    Level.APPROXIMATE,
    f"{_BOUNDS}. Use contact_solver: nsgs, whose bounds are those of the actual normal forces",
    short="leaning bodies have 0.4 to 0.8 of their friction, and fall",
)
_TURNED = Refinement(
    Level.APPROXIMATE,
    "Between two moving bodies the pyramid's axes follow the tilt of the lower face, so that friction along x is "
    "up to √2 μ. On fixed bodies and level kinematic ones they are the world's axes",
    short="between two moving bodies the pyramid's axes are turned: up to √2 μ along x",
)


def _coulomb(world: World) -> Refinement | None:
    """The elliptic cone is exact unless the spec selects the solver that has only the pyramid, and something has friction."""
    if frictionless(world):
        return NO_FRICTION
    if DANTZIG in world.options("dart").settings:
        return None
    return Refinement(Level.VIA_API, "simspec selects NsgsFrictionSolver with Coulomb's law")


def _pyramid(world: World) -> Refinement | None:
    """The pyramid is exact unless something has friction, and the spec selects the solver whose friction has other bounds, or
    two bodies that move may touch."""
    if frictionless(world):
        return None
    if DANTZIG in world.options("dart").settings:
        return _FRICTIONLESS_BOUNDS
    has_friction = any(law.friction and reach(world, *pair).ratio for pair, law in meeting_laws(world).items())
    return _TURNED if has_friction else None


def _shape(kind: str, how: str = _DETECTORS) -> Support:
    """A shape that some detector has exactly; accepted deviations of the detector in use are stated."""

    accepted = Refinement(
        Level.APPROXIMATE,
        short=f"the collision detector in use misses, deepens or rounds some contacts of a {kind}",
    )

    def refine(world: World) -> Refinement | None:
        setting = str(resolve_settings(Dart, world)["collision_detector"])
        wrong = accepted_contact(world, detector_of(world, "dart", setting), "dart", kind)
        note = overlooked(world, setting, "dart", kind) or ""
        if wrong is not None:
            return dataclasses.replace(accepted, how=wrong, note=note)
        return Refinement(note=note) if note else None

    return exact(how, refine=refine, cases=(accepted,))


class Dart(SteppedEngine[DartSimulation]):
    """DART's Featherstone dynamics (semi-implicit Euler), with NSGS or Dantzig for contact, limits and dry friction."""

    NAME: ClassVar[str] = "dart"
    TITLE: ClassVar[str] = "DART"
    DIALECT: ClassVar[str] = "dart"
    DISTRIBUTION: ClassVar[str] = "dartpy"
    EXTRA: ClassVar[str] = "dart"
    # a shape's restitution above 1 DART replaces by 0, with a warning, when it touches something (6.20)
    LACKS: ClassVar[Mapping[Capability, str]] = {Capability.TIMESTEP: FIXED_TIMESTEP}
    RULES: ClassVar[Rules] = Rules("min", "product", most_restitution=1.0)
    LAYERS: ClassVar[bool] = True
    FOREIGN: ClassVar[Mapping[str, Reads]] = FOREIGN
    FOREIGN_ADDITIONS: ClassVar[Mapping[str, EngineAddition]] = FOREIGN_ADDITIONS
    NATIVE_LAW: ClassVar[NativeLaw | None] = NativeLaw(ServoLaw.MOTOR, accuracy=1e-6, implicit_damping=True)
    SUPPORT: ClassVar[Table] = {
        **classes.driven("DART"),
        **shape_kinds("DART", (kind for kind, _ in SHAPE_KINDS.values())),
        **exactly(Feature.JOINT_SEVERAL, Feature.DRY_FRICTION),
        Feature.SURFACE_VELOCITY: NO_BELTS,
        Feature.LIMIT_POSITION: LIMITS,
        Feature.LIMIT_EFFORT: via_api(classes.SIDECAR),
        **for_each(classes.explicit("DART"), *features.DAMPERS_AND_SPRINGS),
        Feature.DAMPING_IMPLICIT: native_implicit_damping(TITLE, balls=True),
        Feature.ARMATURE: implicit_damping_armature(TITLE, _ARMATURE),
        Feature.BALL_ARMATURE: implicit_damping_ball_armature(TITLE, _ARMATURE),
        **for_each(
            exact("DART's loading time grows with the cube of the length of a chain (see docs/engines/dart.md)"),
            *features.LARGE_TREES,
        ),
        Feature.SHAPE_SPHERE: _shape("sphere"),
        Feature.SHAPE_BOX: _shape("box"),
        Feature.SHAPE_CYLINDER: _shape(
            "cylinder",
            "DART's detector ode represents a flat face by the corners of an octagon, and misses some contacts "
            f"of box edges with the rim. Pairs without an exact detector are rejected unless accepted; {_PAGE}",
        ),
        **{
            Feature(f"shape.{kind}"): _shape(kind, f"{_DETECTORS}; {_PAGE}")
            for kind in ("capsule", "ellipsoid", "plane")
        },
        Feature.SHAPE_MESH: _shape(
            "mesh",
            "None of DART's collision detectors is exact for meshes: simspec rejects their contacts unless accepted",
        ),
        **for_each(COPIES, Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS),
        Feature.FRICTION: via_api(
            f"{classes.SIDECAR}. DART treats friction up to 0.001 as zero, which simspec rejects unless accepted"
        ),
        Feature.RESTITUTION: approximate(
            classes.PREDICTED_RESTITUTION,
            short="no bounce at less than 0.1 m/s after the impact; above that e is up to 0.009 too large",
        ),
        Feature.RESTITUTION_THRESHOLD: classes.FIXED_THRESHOLD,
        **for_each(never(_NO_TORQUE), *features.MOMENTS),
        Feature.HARDNESS_COMMON: exact(
            "DART's error reduction is the common law for overlaps up to 0.1 mm per ms of timestep; it removes "
            "larger ones at 1 mm/s"
        ),
        **for_each(never(_RIGID), *features.COMPLIANCES, Feature.HARDNESS_PAIRS),
        Feature.HARDNESS_NATIVE: exact("DART's default contact is the common law"),
        **for_each(via_api(classes.SIDECAR), *features.FILTERS),
        **COUPLED,
        Feature.CONE_ELLIPTIC: approximate(
            "With contact_solver: dantzig, DART bounds friction by the circumscribed pyramid and by the normal forces of the "
            "frictionless problem, so that leaning and clamped bodies slip. The solver nsgs has the elliptic cone",
            _coulomb,
            "up to 1.41 times the friction; leaning bodies have 0.4 to 0.8 of theirs, and fall",
        ),
        Feature.CONE_PYRAMID_INSCRIBED: never("DART has the elliptic cone and the circumscribed pyramid only"),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: Support(
            Level.VIA_API,
            "simspec selects NsgsFrictionSolver with the box law",
            refine=_pyramid,
            cases=(_FRICTIONLESS_BOUNDS, _TURNED),
        ),
        Feature.FORCES: via_api(classes.AS_EFFORTS, none_on_servos),
        Feature.GRAVITY_SCALE: via_api(classes.WEIGHTS, no_weights_on_servos),
        Feature.FLUID: via_api(classes.DRAG, no_fluid_on_servos),
        Feature.CONTROL_NATIVE: via_api(NATIVE, no_springs),
        **outside_constraints(TITLE),
        Feature.SUM: via_api(classes.EFFORTS, none_along_servos),
        Feature.BALL_LIMIT: ANGLE,
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = SETTINGS
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (
        *DEVIATIONS,
        Deviation("restitution", 0.08, PREDICTED, relative=False, timestep=0.008),
        Deviation("restitution", 0.16, PREDICTED, relative=False, timestep=0.016),
        Deviation("threshold", 1.02, THRESHOLD, relative=False),
        Deviation("rest", 0.16, HOPS, relative=False, timestep=0.016),
        *(
            Deviation(name, size, _LIVELY, relative, timestep=0.008, restitution=0.55)
            for name, size, relative in (("push", 0.18, True), ("stick", 0.09, False), ("rest", 0.005, False))
        ),
        *(
            Deviation(name, size, _LIVELY, relative, timestep=0.008, restitution=0.85)
            for name, size, relative in (
                *(("stop", 0.025, True), ("stick", 0.25, False), ("rest", 0.026, False)),
                ("steady", 0.73, False),
            )
        ),
        *(
            Deviation(name, size, _LIVELY, relative, timestep=0.016, restitution=0.55)
            for name, size, relative in (*(("push", 0.42, True), ("push-oblong", 0.42, True)), ("stick", 0.25, False))
        ),
        Deviation("oblique-separation", 0.085, PREDICTED, timestep=0.016, restitution=0.55),
        *(
            Deviation(name, 0.415, PYRAMID, friction_cone="elliptic", setting=DANTZIG)
            for name in ("push", "push-oblong")
        ),
        *(
            Deviation(name, 0.36, PYRAMID, friction_cone="elliptic", setting=DANTZIG)
            for name in ("stop", "stop-oblong")
        ),
        # slips of 1.6 times what friction takes, 39° from an axis: 0.435, and DART's own 2.6 % on top
        Deviation("oblique", 0.46, PYRAMID, friction_cone="elliptic", setting=DANTZIG),
        Deviation("stop", 0.04, _TRIPS, timestep=0.0144),
        Deviation("stop-oblong", 0.021, _TRIPS, friction=1.25, timestep=0.0072),
        Deviation("stop-oblong", 0.09, _TRIPS, timestep=0.0144),
        *(
            Deviation(name, 0.12, _TRIPS, timestep=0.0168) for name in ("stop", "stop-oblong")
        ),  # 9.3 % at 20 ms and μ = 1
    )
    DRY_FRICTION_CREEP: ClassVar[float] = 1e-7
    # ten times dry_friction_tolerance, at which NSGS ends; joints on joints add up
    ACCEPTED_CONES: ClassVar[Mapping[str, str]] = {"elliptic": "pyramid-circumscribed"}
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "joint.velocity_limit": "simspec passes no velocity limits to DART, which would enforce them together with the "
        "position limits",
        "shape.name": "DART generates its own shape names",
        "control.native": "simspec switches DART's controllers on when a run begins",
        "collision_group": "DART does not list its filter; simspec probes it instead",
    }

    @classmethod
    def recovery(cls, settings: Mapping[str, Any], law: PairContact) -> Recovery | None:
        return Recovery(speed=1e-3, why="takes overlaps back at 1 mm/s at most, which cannot be set")

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        settings = resolve_settings(cls, world)
        detector = detector_of(world, cls.NAME, str(settings["collision_detector"]))
        chosen = {"settings.collision_detector": detector, "settings.contact_solver": chosen_solver(world, settings)}
        plan = contact_plan(world, cls.RULES, cls.LAYERS)
        return expected(world, settings, plan, neutral, detector) | expected_labels(cls, world) | chosen

    @classmethod
    def thicker(cls, world: World) -> Mapping[str, float]:
        detector = detector_of(world, cls.NAME, str(resolve_settings(cls, world)["collision_detector"]))
        if detector != "bullet":
            return {}
        return dict.fromkeys((shape.name for kind in ("cylinder", "mesh") for shape in blunted(kind, world)), BLUNT)

    @classmethod
    def overlooks(cls, world: World) -> frozenset[tuple[str, str]]:
        detector = detector_of(world, cls.NAME, str(resolve_settings(cls, world)["collision_detector"]))
        return frozenset(OVERLOOKED.get(detector, {}))

    @classmethod
    def prepare(cls) -> None:
        import_dartpy()

    def _make(self, folder: Path, sidecar: Mapping[str, Any]) -> DartSimulation:
        try:
            typed = DartSidecar.of(sidecar)
        except ValueError as error:
            raise EngineError(self.NAME, str(error)) from error
        return DartSimulation(folder, typed)

    def _read_model(self) -> ReadBack:
        sim = self._simulation
        model = read_back(sim.whole(), *sim.coordinates.get_state(), dict(self.UNREADABLE))
        return dataclasses.replace(model, inventory=inventory(sim), neutral=neutral(sim))

    @property
    def world(self) -> Any:
        """DART's own world."""
        return self._simulation.world

    def actuate(self, q: np.ndarray, v: np.ndarray) -> Actuation:
        quick = self._before is None and DartJointArrays.suits(self._simulation)
        return DartJointArrays(self, self._simulation, q, v) if quick else Actuation(self, q, v)

    def track(
        self, q: np.ndarray, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ) -> Servos:
        return DartJointServos(self._simulation, v, stiffness, damping, limit)

    def contacts(self) -> dict[str, np.ndarray]:
        sim = self._simulation
        contacts = sim.contacts_of(sim.world.getLastCollisionResult())
        if not contacts:
            return empty_contacts()
        units = np.array([shapes for shapes, _ in contacts], dtype=np.int64)
        table = np.array([(*c.point, *c.normal, c.penetrationDepth, np.dot(c.normal, c.force)) for _, c in contacts])
        return contact_table(units, table, sim.body_of_shape)

    def collision_units(self) -> Sequence[CollisionUnit]:
        sim = self._simulation
        shapes = zip(sim.body_of_shape, sim.sidecar.shapes, strict=True)
        return [CollisionUnit(body, (shape.name,)) for body, shape in shapes]

    def detect_units(self) -> np.ndarray:
        return sorted_pairs(self._simulation.detect_contacts())

    def disable_dry_friction(self, v: np.ndarray) -> None:
        sim, places = self._simulation, set(v.tolist())
        for body, place in zip(sim.bodies, sim.coordinates.v_places, strict=True):
            if place.start in places:
                body.getParentJoint().setCoulombFriction(0, 0.0)

    def load_foreign(self, file: Path, language: str, packages: Mapping[str, str], log: list[str]) -> ReadBack:
        return DartForeignFile(import_dartpy(), log).load(file, language, packages)
