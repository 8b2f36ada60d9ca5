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

from simspec.contact.plan import contact_plan
from simspec.contact.rules import Rules
from simspec.control.reference import Servos
from simspec.dialects.dart.contact import OVERLOOKED, accepted_contact, detector_of, overlooked
from simspec.dialects.dart.sidecar import DartSidecar
from simspec.engines.dart.actuation import (
    NATIVE,
    JointArrays,
    JointServos,
    no_fluid_on_servos,
    no_springs,
    no_weights_on_servos,
    none_along_servos,
    none_on_servos,
)
from simspec.engines.dart.contact import COUPLED, DEVIATIONS, SETTINGS
from simspec.engines.dart.foreign import FOREIGN, FOREIGN_ADDITIONS, Foreign
from simspec.engines.dart.inventory import chosen_solver, expected, inventory, neutral
from simspec.engines.dart.readback import SHAPE_KINDS, read_back
from simspec.engines.dart.simulation import Simulation, import_dartpy
from simspec.engines.kit.arrays import CollisionUnit, empty_contacts, sorted_pairs
from simspec.engines.kit.capabilities import NativeLaw, Recovery, ServoLaw
from simspec.engines.kit.contract import Actuation
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.efforts import outside_constraints
from simspec.engines.kit.foreign import Addition, Reads
from simspec.engines.kit.inventory import expected_labels
from simspec.engines.kit.refinements import BLUNT, NO_FRICTION, blunted, implicit_damping_armature
from simspec.engines.kit.settings import Setting, resolve_settings
from simspec.engines.kit.simulated import SteppedEngine
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

_COMPUTED = "an effort computed from DART's own state before every step; DART's own is implicit in time"
_SET = "set through dartpy"
_SLOW_LOADING = "DART's own loading grows with the cube of a chain's length: 2 s for 500 bodies, 8 s for 800"
_COPIES = "copies of shapes on welded bodies without mass, of which the collision filter lets one pair touch"
_NO_MOMENT = "DART's contacts have three rows, one normal and two tangential: no torque"
_RIGID = "DART's contacts are rigid; dartpy gives no access to its error reduction and constraint force mixing"
_DETECTORS = "pairs of shapes for which no detector is sound are refused unless accepted"


MOST_RECOVERY = 1e-3
"""DART takes back 1 % of an overlap in each step, but no faster than this (m/s): measured from 1 µm to 20 mm with all its
solvers, and the same at every timestep. Overlaps of up to 0.1 mm for each ms of the timestep follow the common law."""

_PREDICTED = (
    "DART multiplies the speed at the end of the step, gravity included: the ratio is e (1 + g dt / v), at 1 m/s"
)
_TRIPS = (
    "in a step in which round-off has tilted a slider only its leading corners touch, and it trips over them, up to 1.6 mm "
    "deep: at 16 ms at some μ, at 8 ms from 1.25 on"
)
_LIVELY = (
    "a body hops for ever, at e g dt / (1 - e), where that is above DART's least bounce: by 4.6 mm at a restitution of 0.8, by "
    "25 mm and 0.73 m/s at 0.9; pushed, it slides"
)
_HOPS = "with a restitution of 0.5 a body hops for ever, 2 mm and 0.16 m/s: g dt alone is above DART's least bounce"


DANTZIG = ("contact_solver", "dantzig")
_PYRAMID = "the circumscribed pyramid in place of the elliptic cone, as accepted"
_BOUNDS = (
    "friction is bound by the normal forces that would be without it: too little where bodies lean (a rod on a smooth wall has "
    "0.81 of it at 60° to the floor, 0.44 at 30°, and falls), none where friction alone presses (a clamp that holds itself by "
    "its own weight), too much where it lightens"
)
_FRICTIONLESS_BOUNDS = Refinement(
    Level.APPROXIMATE,
    f"DantzigBoxedLcpSolver, as the settings ask for: {_BOUNDS}",
    short="leaning bodies have 0.4 to 0.8 of their friction, and fall",
)
_TURNED = Refinement(
    Level.APPROXIMATE,
    "NsgsFrictionSolver, law Box; between two bodies that move the pyramid's axes follow the tilt of the face below, from "
    "1e-6 rad on: a box on a box that lies level has up to √2 μ along x, and stops after 0.71 of the way (measured). On what "
    "is fixed or kinematic and level they are the world's",
    short="between two bodies that move the pyramid's axes are turned: up to √2 μ along x",
)


def _coulomb(world: World) -> Refinement | None:
    """The elliptic cone is exact unless the spec selects the solver that has only the pyramid, and something has friction."""
    if frictionless(world):
        return NO_FRICTION
    if DANTZIG in world.options("dart").settings:
        return None
    return Refinement(Level.VIA_API, "NsgsFrictionSolver, law Coulomb")


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
        short=f"some contacts of a {kind} are missed, too deep or rounded by the collision detector in use",
    )

    def refine(world: World) -> Refinement | None:
        setting = str(resolve_settings(Dart, world)["collision_detector"])
        wrong = accepted_contact(world, detector_of(world, "dart", setting), "dart", kind)
        note = overlooked(world, setting, "dart", kind) or ""
        if wrong is not None:
            return dataclasses.replace(accepted, how=wrong, note=note)
        return Refinement(note=note) if note else None

    return exact(how, refine=refine, cases=(accepted,))


class Dart(SteppedEngine[Simulation]):
    """DART's Featherstone dynamics (semi-implicit Euler), with NSGS or Dantzig for contact, limits and dry friction."""

    NAME: ClassVar[str] = "dart"
    TITLE: ClassVar[str] = "DART"
    DIALECT: ClassVar[str] = "dart"
    DISTRIBUTION: ClassVar[str] = "dartpy"
    EXTRA: ClassVar[str] = "dart"
    # a shape's restitution above 1 DART replaces by 0, with a warning, when it touches something (6.20)
    RULES: ClassVar[Rules] = Rules("min", "product", most_restitution=1.0)
    LAYERS: ClassVar[bool] = True
    FOREIGN: ClassVar[Mapping[str, Reads]] = FOREIGN
    FOREIGN_ADDITIONS: ClassVar[Mapping[str, Addition]] = FOREIGN_ADDITIONS
    NATIVE_LAW: ClassVar[NativeLaw | None] = NativeLaw(ServoLaw.MOTOR, accuracy=1e-6, implicit_damping=True)
    SUPPORT: ClassVar[Table] = {
        **classes.driven("DART"),
        **shape_kinds("DART", (kind for kind, _ in SHAPE_KINDS.values())),
        **exactly(Feature.JOINT_SEVERAL, Feature.DRY_FRICTION),
        Feature.BALL_ARMATURE: never("DART has no armature, and what stands for it is of one axis"),
        Feature.SURFACE_VELOCITY: never("the velocity of a contact's surface is not in DART's Python interface"),
        Feature.LIMIT_POSITION: via_api("limits stop dead within the step, once their enforcement is switched on"),
        Feature.LIMIT_VELOCITY: exact("in the sidecar only: DART would enforce it together with the position limits"),
        Feature.LIMIT_EFFORT: via_api(_SET),
        **for_each(via_api(_COMPUTED), *features.DAMPERS_AND_SPRINGS),
        Feature.ARMATURE: implicit_damping_armature(
            TITLE, "a joint's armature by an implicit damping and an effort against it at every step"
        ),
        **for_each(exact(_SLOW_LOADING), *features.LARGE_TREES),
        Feature.SHAPE_SPHERE: _shape("sphere"),
        Feature.SHAPE_BOX: _shape("box"),
        Feature.SHAPE_CYLINDER: _shape(
            "cylinder",
            "with detector ode, whose flat faces touch at the corners of the octagon around the circle: a flat disc that spins "
            "is braked 8.2 % too strongly, and an upright cylinder that should tip where its weight points 1.00 R off the "
            "axis tips at 1.00 to 1.08 R, by how it is turned; some contacts of an edge of a box with the rim are "
            f"missed (docs/records/dart-detectors.md, and said where a world has such pairs); {_DETECTORS}",
        ),
        Feature.SHAPE_CAPSULE: _shape("capsule", f"with detector dart, on planes with ode; {_DETECTORS}"),
        Feature.SHAPE_ELLIPSOID: _shape("ellipsoid", f"with detector fcl, to 0.06 mm; {_DETECTORS}"),
        Feature.SHAPE_MESH: _shape("mesh", f"seen, and in contacts that are accepted; {_DETECTORS}"),
        Feature.SHAPE_PLANE: _shape("plane", f"with detector ode, under spheres with any; {_DETECTORS}"),
        **for_each(via_api(_COPIES), Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS),
        Feature.FRICTION: via_api(f"{_SET}; up to 0.001 is refused unless accepted: DART treats it as zero"),
        Feature.RESTITUTION: approximate(
            "e (1 + g dt / v): up to 0.009 above the asked ratio at 1 ms from 1 m/s on; none at all where the body would leave "
            "at less than 0.1 m/s, so that it settles sooner than elsewhere; nothing leaves faster than 100 m/s",
            short="bodies that would leave at less than 0.1 m/s do not bounce; otherwise e is up to 0.009 too large",
        ),
        Feature.RESTITUTION_THRESHOLD: approximate(
            "DART's own, which cannot be set: nothing bounces that would leave at less than 0.1 m/s (e v < 0.1 m/s), "
            "and all else does, for any threshold in the spec",
            short="the threshold is DART's own, 0.1 m/s after the impact, for any value in the spec",
        ),
        Feature.TORSIONAL_FRICTION: never(f"{_NO_MOMENT} about the normal"),
        Feature.ROLLING_FRICTION: never(f"{_NO_MOMENT} across the normal"),
        Feature.HARDNESS_COMMON: exact(
            "DART's own law, for overlaps up to 0.1 mm for each ms of the timestep; larger ones are taken back at 1 mm/s"
        ),
        **for_each(never(_RIGID), *features.COMPLIANCES, Feature.HARDNESS_PAIRS),
        Feature.HARDNESS_NATIVE: exact("DART's default is the common law"),
        **for_each(
            via_api("pairs in the collision filter"),
            *(Feature.PASSING_PAIRS, Feature.COLLISION_GROUPS, Feature.EXCLUDED_PAIRS),
        ),
        **COUPLED,
        Feature.CONE_ELLIPTIC: approximate(
            "exact with NsgsFrictionSolver, law Coulomb; with contact_solver: dantzig, which stacks better and is four times "
            "faster, the circumscribed pyramid: up to 1.41 times the friction between its axes of what slides on one body; and "
            f"{_BOUNDS}",
            _coulomb,
            "the pyramid: up to 1.41 times the friction; but what leans has 0.4 to 0.8 of it, and falls",
        ),
        Feature.CONE_PYRAMID_INSCRIBED: never("DART has the elliptic cone and the circumscribed pyramid only"),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: Support(
            Level.VIA_API, "NsgsFrictionSolver, law Box", refine=_pyramid, cases=(_FRICTIONLESS_BOUNDS, _TURNED)
        ),
        Feature.FORCES: via_api(classes.AS_EFFORTS, none_on_servos),
        Feature.GRAVITY_SCALE: via_api(classes.WEIGHTS, no_weights_on_servos),
        Feature.FLUID: via_api(classes.DRAG, no_fluid_on_servos),
        Feature.CONTROL_NATIVE: via_api(NATIVE, no_springs),
        Feature.TOUCHING_PAIRS: via_api("enableAdjacentBodyCheck"),
        **outside_constraints(TITLE),
        Feature.SUM: via_api(_COMPUTED, none_along_servos),
        Feature.BALL_LIMIT: never("DART limits the components of the rotation vector, and no angle"),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = SETTINGS
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (
        *DEVIATIONS,
        Deviation("restitution", 0.08, _PREDICTED, relative=False, timestep=0.008),
        Deviation("restitution", 0.16, _PREDICTED, relative=False, timestep=0.016),
        Deviation("threshold", 1.02, "DART's own threshold, e v < 0.1 m/s, cannot be set", relative=False),
        Deviation("rest", 0.16, _HOPS, relative=False, timestep=0.016),
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
        Deviation("oblique-separation", 0.085, _PREDICTED, timestep=0.016, restitution=0.55),
        *(
            Deviation(name, 0.415, _PYRAMID, friction_cone="elliptic", setting=DANTZIG)
            for name in ("push", "push-oblong")
        ),
        *(
            Deviation(name, 0.36, _PYRAMID, friction_cone="elliptic", setting=DANTZIG)
            for name in ("stop", "stop-oblong")
        ),
        # slips of 1.6 times what friction takes, 39° from an axis: 0.435, and DART's own 2.6 % on top
        Deviation("oblique", 0.46, _PYRAMID, friction_cone="elliptic", setting=DANTZIG),
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
        "joint.velocity_limit": "not given to DART, which would enforce it together with the position limits",
        "shape.name": "DART generates its own shape names",
        "control.native": "DART's own controllers are switched on when a run begins",
        "collision_group": "DART does not list its filter; it is probed instead",
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

    def _make(self, folder: Path, sidecar: Mapping[str, Any]) -> Simulation:
        try:
            typed = DartSidecar.of(sidecar)
        except ValueError as error:
            raise EngineError(self.NAME, str(error)) from error
        return Simulation(folder, typed)

    def _read_model(self) -> ReadBack:
        sim = self._simulation
        model = read_back(sim.whole(), *sim.coordinates.get_state(), dict(self.UNREADABLE))
        return dataclasses.replace(model, inventory=inventory(sim), neutral=neutral(sim))

    @property
    def world(self) -> Any:
        """DART's own world."""
        return self._simulation.world

    def actuate(self, q: np.ndarray, v: np.ndarray) -> Actuation:
        quick = self._before is None and JointArrays.suits(self._simulation)
        return JointArrays(self, self._simulation, q, v) if quick else Actuation(self, q, v)

    def track(
        self, q: np.ndarray, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ) -> Servos:
        return JointServos(self._simulation, v, stiffness, damping, limit)

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
        return Foreign(import_dartpy(), log).load(file, language, packages)
