"""Rapier: rigid bodies in single precision, stepped by its own solver under the common law of contact.

Facts marked *measured*: rapier3d 0.36.1, on one thread.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from simspec.contact import Rules
from simspec.engines.kit.capabilities import (
    BOUNCES,
    JAMMED,
    SINGLE,
    SPRING_IN_SINGLES,
    SWEEPS,
    Capability,
    Deviation,
    NativeLaw,
    Reason,
    coarse,
    read_deviations,
)
from simspec.engines.kit.methods import IntegrationMethod
from simspec.engines.kit.refinements import coupled, met_pairs, only_balls_slide, single_motor, static_planes
from simspec.engines.kit.settings import Setting, SettingGroup
from simspec.engines.kit.world_simulation import Parts, TrackingEngine
from simspec.engines.rapier import integration
from simspec.engines.rapier.inventory import expected, inventory, neutral
from simspec.engines.rapier.readback import read_back
from simspec.engines.rapier.servos import NATIVE
from simspec.engines.rapier.simulation import NATIVE_MOTION, RapierSimulation
from simspec.support import classes, features
from simspec.support.declarations import (
    Attempt,
    Level,
    Refinement,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    never,
    shape_kinds,
    unsupported_if,
)
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws, shape_pairs, solid_shapes
from simspec.world.hull import Hull, HullError, hull_of
from simspec.world.types import World

# Balls. Rapier's normal of a ball is the direction from the other surface to the ball's centre, in single precision: it is
# round-off where the centre is in the surface of a plane or box. Sliding on four balls of 1 µm of radius, 1 in 5 bodies jams;
# of 10 µm, 1 in 15; of 30 µm, 1 in 30; of 0.1 mm and more, none of 540. On hulls normals are off by 5e-7 m over the radius
# (5e-3 rad at 0.1 mm).
LEAST = 1e-4
"""The smallest radius (m) of balls that never jammed."""
SMALL = Refinement(
    Level.APPROXIMATE,
    "Rapier's contact normals of spheres with a radius below 0.1 mm are dominated by round-off, and sliding spheres may jam; "
    "see docs/engines/rapier.md",
    "sliding spheres with a radius below 0.1 mm may jam",
)


def balls(world: World) -> Refinement | None:
    """Balls that are smaller than round-off lets them be."""
    small = any(
        shape.kind == "sphere" and shape.size[0] < LEAST for body in world.bodies for shape in solid_shapes(body)
    )
    return SMALL if small else None


# Contact of several bodies. ``tools/deviations.py`` measures the tables at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions
# of 0 to 1, and ratios of masses of 1 to 1000.

_ASIDE = (
    "Rapier's friction acts along K⁻¹ v, with the mobility K of the contact: the feet of a body "
    "are braked at an angle to their slip (accepted by name: contact.cone.elliptic)"
)
_UNEVEN = (
    "Rapier's solver does not spread the pressure of a face that a joint presses on a body evenly; see "
    "docs/engines/rapier.md"
)
_FEW = coarse("slip or clamp")

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("stack*", SWEEPS),
        Reason("rod* clamp* jam* pile*", BOUNCES, bounces=True),
        Reason("jam*", JAMMED),
        Reason("squeeze*", _UNEVEN),
        Reason("slide-spin", _ASIDE),
        Reason("*", _FEW),
    ),
)
COUPLED: Table = coupled(
    "rapier",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: classes.HEAVY_ON_LIGHT,
        Feature.SELF_LOCKING: classes.JAMMED,
        Feature.EVEN_PRESSURE: (_UNEVEN, "boxes that slip between fingers may turn"),
    },
)

# Cylinders. Rapier's search for the nearest points of round shapes ends before single precision does. In 720 random overlaps of
# each pair of kinds, 10 µm to 2 mm deep, compared with coal (median; largest):
#
# with         missed              depth              normal
# capsules     31, up to 38 µm     5 µm; 84 µm        0.005 rad; 0.024 rad
# cylinders    1, of 11 µm         0.25 µm; 22 µm     7e-4 rad; 0.9 rad where rims meet at an angle
# boxes        2, up to 22 µm      9 µm at most       2e-6 rad; 0.16 rad
# hulls        3, up to 18 µm      as boxes           as boxes
# planes, balls: exact to 3e-7 m and 4e-6 rad. Flat on flat: exact

APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("box", "cylinder"): "boxes",
    ("capsule", "cylinder"): "capsules",
    ("cylinder", "cylinder"): "cylinders",
    ("cylinder", "mesh"): "meshes",
}
"""Pairs of kinds, by the name of what a cylinder touches."""


def _refinement(met: Mapping[tuple[str, str], str]) -> Refinement:
    return Refinement(
        Level.APPROXIMATE,
        f"Rapier misses some shallow overlaps of cylinders with {', '.join(met.values())}, and its normals are "
        f"inaccurate unless "
        "flat faces touch; see docs/engines/rapier.md",
        "oblique contacts of cylinders have inaccurate normals, and shallow ones may be missed",
    )


CYLINDERS = _refinement(APPROXIMATE)
"""Where all of these pairs may meet, for tables."""


def cylinders(world: World) -> Refinement | None:
    """Cylinders that may meet more than planes and balls."""
    met = met_pairs(world, APPROXIMATE)
    return _refinement(met) if met else None


# Hulls. Rapier keeps every vertex, but computes contact by faces: it merges neighbouring faces whose normals are within
# ``ALIKE``, and uses four corners of a face. On a plane it uses the face that is most parallel to the plane, and ignores
# deeper corners of others. So a hull is exact where its faces have up to four corners and meet at more than 1.5°, and on
# planes where the deepest corner belongs to the face that looks down. Balls touch a hull exactly.

ALIKE = 3.6e-4
"""1 − the cosine of the angle, 1.5°, up to which Rapier takes two faces for one: a little above √2⁻²³."""
MOST_CORNERS = 4
"""Of a face."""
FLAT = 1e-6
"""Share of its extent by which a hull is off at most that is exact: a few roundings."""
DIRECTIONS = 4000
"""Spread over the sphere, 3° between neighbours, in which planes are tried as well as those that three faces look at alike."""
KEPT = 256
"""Hulls of which the faces are remembered."""
MERGED_SHORT = "faces of a hull that meet at less than 1.5° are merged into one plane"
STACKS = "Rapier's stacks of convex hulls are less stable than stacks of boxes; see docs/engines/rapier.md"
STACKED = Refinement(Level.APPROXIMATE, STACKS, "stacks of convex hulls shift or fall over")


@dataclass(frozen=True, slots=True)
class Faces:
    """The faces of a hull in Rapier: the most ``corners`` of one; how far (m) it is ``off`` where faces are nearly
    in one plane; how deep (m) a corner may be in a plane and ``unfelt``."""

    corners: int
    off: float
    unfelt: float


def hull_support(world: World) -> Refinement | None:
    """Not hulls of which Rapier would not feel corners; approximately those that may touch hulls, and those with faces that are
    nearly in one plane, where they may touch what is no ball."""
    shapes = {shape.name: shape for body in world.bodies for shape in solid_shapes(body)}
    faces = {name: faces_of(shape.size) for name, shape in shapes.items() if shape.kind == "mesh"}
    off, stacked = (0.0, "", ""), False
    for pair in shape_pairs(world, meeting_laws(world)) if faces else ():
        stacked = stacked or all(name in faces for name in pair)
        for name, other in (pair, pair[::-1]):
            if name not in faces or shapes[other].kind == "sphere":
                continue
            if why := _refused(faces[name], shapes[other].kind):
                return unsupported_if(f"{why} ({name!r}, which may touch {other!r})")
            off = max(off, (faces[name].off, name, other))
    size, name, other = off
    found = [STACKS] if stacked else []
    if size:
        found.append(
            f"Rapier merges faces that meet at less than 1.5°: {other!r} may touch {name!r} up to {1e3 * size:.2g} mm from its "
            "surface, the largest error of all hulls here"
        )
    short = STACKED.short if stacked else MERGED_SHORT
    return Refinement(Level.APPROXIMATE, "; ".join(found), short) if found else None


def _refused(faces: Faces, kind: str) -> str | None:
    """Why Rapier does not support contact of a hull with a kind of shape."""
    if faces.corners > MOST_CORNERS:
        return (
            f"Rapier uses {MOST_CORNERS} corners of a face, and a face has {faces.corners} here; it merges faces that "
            f"meet at less "
            "than 1.5°"
        )
    if kind == "plane" and faces.unfelt:
        return (
            "Rapier tests a plane against the corners of a hull's lowest face only, and other corners may penetrate it by "
            f"{1e3 * faces.unfelt:.2g} mm here. Use a box in place of the plane"
        )
    return None


@functools.lru_cache(maxsize=KEPT)
def faces_of(size: tuple[float, ...]) -> Faces:
    """The faces in Rapier of a hull (flat vertices, m)."""
    hull = hull_of(size)
    groups, most = _merged(hull)
    least = FLAT * float(np.ptp(hull.vertices, axis=0).max())
    off = max(_bent(hull, group) for group in groups)
    unfelt = 0.0 if most > MOST_CORNERS else _unfelt(hull, groups)
    return Faces(most, off if off > least else 0.0, unfelt if unfelt > least else 0.0)


def _merged(hull: Hull) -> tuple[list[list[int]], int]:
    """The triangles of each of Rapier's faces, and the most corners that one has."""
    first: dict[tuple[int, int], int] = {}
    edges: list[tuple[int, int]] = []
    up = list(range(len(hull.triangles)))

    def root(face: int) -> int:
        while up[face] != face:
            up[face] = up[up[face]]
            face = up[face]
        return face

    for face, (a, b, c) in enumerate(hull.triangles.tolist()):
        for edge in ((a, b), (b, c), (c, a)):
            other = first.setdefault((min(edge), max(edge)), face)
            if other == face:
                continue
            edges.append((face, other))
            if hull.normals[face] @ hull.normals[other] > 1.0 - ALIKE:
                up[root(face)] = root(other)
    members: dict[int, list[int]] = {}
    for face in range(len(up)):
        members.setdefault(root(face), []).append(face)
    sides = dict.fromkeys(members, 0)
    for index, other in ((root(face), root(other)) for face, other in edges):
        if index != other:
            sides[index] += 1
            sides[other] += 1
    return list(members.values()), max(sides.values())


def _bent(hull: Hull, group: Sequence[int]) -> float:
    """How far (m) corners of some triangles are from the planes of the others, at most."""
    if len(group) == 1:
        return 0.0
    vertex = hull.vertices[np.unique(hull.triangles[group])]
    return float(np.abs(vertex @ hull.normals[group].T - hull.offsets[group]).max())


def _unfelt(hull: Hull, groups: Sequence[Sequence[int]]) -> float:
    """How much further (m) a hull reaches than the face that looks in a direction most, at most."""
    faces = np.zeros(len(hull.triangles), dtype=np.intp)
    for number, group in enumerate(groups):
        faces[group] = number
    local = np.zeros((len(groups), len(hull.vertices)), dtype=bool)
    for face, corners in zip(faces.tolist(), hull.triangles, strict=True):
        local[face, corners] = True
    directions = _directions(hull)
    reach = directions @ hull.vertices.T
    looking = faces[np.argmax(directions @ hull.normals.T, axis=1)]
    felt = np.where(local[looking], reach, -math.inf).max(axis=1)
    return float((reach.max(axis=1) - felt).max())


def _directions(hull: Hull) -> np.ndarray:
    """Unit vectors (n, 3): a Fibonacci spiral, and those that three faces look at alike, a little towards each."""
    index = np.arange(DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * index / DIRECTIONS
    turn, across = math.pi * (1.0 + math.sqrt(5.0)) * index, np.sqrt(1.0 - z * z)
    found = [np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)]
    try:
        cells = hull_of(tuple(hull.normals.ravel().tolist()))
    except HullError:
        return found[0]
    corners = cells.vertices[cells.triangles]
    found += [cells.normals + 1e-6 * corners[:, corner] for corner in range(3)]
    every = np.concatenate(found)
    unit: np.ndarray = every / np.linalg.norm(every, axis=1, keepdims=True)
    return unit


_TITLE = "Rapier"
_CONSTRAINTS = (
    "Rapier's Python package has no constraints between coordinates of a multibody, and does not report the mass matrix that "
    "efforts of constraints need; see docs/engines/rapier.md"
)
_JOINTS = exact(
    "simspec builds Rapier's multibodies, each with a flywheel that makes Rapier solve for accelerations with the mass matrix "
    "alone; see docs/engines/rapier.md"
)
_STOPS = exact(
    "simspec sets the limit of a joint close to a stop before each step, so that the joint stops within the step"
)
_OBLONG_ASIDE = (
    "Rapier's friction acts along K⁻¹ v, with the mobility K of the contact: oblong bodies are "
    "braked at an angle to their slip"
)
_BOUNCE = (
    "simspec adds an overlap that Rapier's error reduction removes at e times the approach speed. Rapier's own restitution "
    "adds energy where one body hits two; see docs/engines/rapier.md"
)


class Rapier(TrackingEngine[RapierSimulation]):
    """Rapier's rigid bodies, by its pipeline with one iteration a step and many sweeps in it."""

    NAME: ClassVar[str] = "rapier"
    TITLE: ClassVar[str] = _TITLE
    DIALECT: ClassVar[str] = "rapier"
    DISTRIBUTION: ClassVar[str] = "rapier3d"
    EXTRA: ClassVar[str] = "rapier"
    PRECISION: ClassVar[str] = SINGLE
    RULES: ClassVar[Rules] = Rules("table", "table", "table", "table", "table")
    LAYERS: ClassVar[bool] = False
    KEEPS_CONTACTS: ClassVar[bool] = True
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.FOREIGN_FILES: "simspec does not use Rapier's loaders of robot files",
    }
    NATIVE_LAW: ClassVar[NativeLaw | None] = SPRING_IN_SINGLES
    SUPPORT: ClassVar[Table] = {
        **classes.driven(_TITLE),
        **exactly(Feature.HARDNESS_COMMON, Feature.GRAVITY_SCALE, *features.FILTERS),
        **exactly(Feature.ARMATURE, Feature.BALL_ARMATURE),
        Feature.INTEGRATOR: integration.SUPPORT,
        Feature.DAMPING_IMPLICIT: integration.IMPLICIT_DAMPING,
        **for_each(_JOINTS, Feature.JOINT_HINGE, Feature.JOINT_SLIDE, Feature.JOINT_BALL),
        Feature.JOINT_SEVERAL: classes.BETWEEN_JOINTS,
        Feature.LIMIT_POSITION: _STOPS,
        **for_each(classes.explicit(_TITLE), *features.DAMPERS_AND_SPRINGS),
        Feature.DRY_FRICTION: exact(classes.ZERO_VELOCITY_MOTOR),
        **for_each(never(_CONSTRAINTS), *features.CONSTRAINTS),
        **for_each(never(f"{_TITLE}'s contacts transmit no torque"), *features.MOMENTS),
        **classes.NOT_IN_WORLD_JSON,
        Feature.CONTROL_NATIVE: exact(NATIVE, refine=single_motor(_TITLE)),
        Feature.HARDNESS_NATIVE: classes.unwritten(_TITLE, Attempt.READ_BACK),
        **shape_kinds("Rapier", ("sphere", "box", "capsule", "cylinder")),
        Feature.SHAPE_SPHERE: exact(
            "Rapier is exact for spheres with a radius of at least 0.1 mm", refine=balls, cases=(SMALL,)
        ),
        Feature.SHAPE_CYLINDER: exact(
            "Rapier's cylinders are exact on planes and spheres. Accept `shape.cylinder` where they may touch other shapes",
            refine=cylinders,
            cases=(CYLINDERS,),
        ),
        Feature.SHAPE_PLANE: static_planes("simspec passes only static planes to Rapier, and {name} moves"),
        Feature.SHAPE_MESH: exact(
            "Rapier resolves hulls whose faces have up to four corners and meet at 1.5° or more; see docs/engines/rapier.md. "
            "Accept `shape.mesh` where hulls may touch each other",
            refine=hull_support,
            cases=(STACKED,),
        ),
        **for_each(classes.LAW_AT_CONTACTS, Feature.FRICTION, Feature.FRICTION_PAIRS),
        **COUPLED,
        **for_each(exact(_BOUNCE), Feature.RESTITUTION, Feature.RESTITUTION_PAIRS),
        Feature.RESTITUTION_THRESHOLD: exact("contact points that approach more slowly do not bounce"),
        **for_each(
            never("Rapier has one contact softness for dynamic bodies, and one for their contact with static bodies"),
            *features.COMPLIANCES,
            Feature.HARDNESS_PAIRS,
        ),
        **for_each(never("Rapier bounds friction by a circular cone"), *features.PYRAMIDS),
        Feature.CONE_ELLIPTIC: approximate(
            "Rapier's friction model SIMPLIFIED acts along K⁻¹ v, with the mobility K of the contact: "
            "oblong bodies are braked at an angle to their slip, and bodies that slide on several shapes "
            "stop late. Spheres are exact; see docs/engines/rapier.md",
            only_balls_slide("friction model SIMPLIFIED"),
            "bodies that slide on several shapes stop late",
        ),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "iterations": Setting(
            50,
            "Number of sweeps over all contacts in a step (num_internal_pgs_iterations). Fewer add energy in piles "
            "(see docs/engines/rapier.md).",
            minimum=1,
            group=SettingGroup.ACCURACY,
            finer=1000,
        ),
        NATIVE_MOTION: integration.SETTING,
    }
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (
        *DEVIATIONS,
        Deviation("push-oblong", 0.02, _OBLONG_ASIDE),
        Deviation("stop-oblong", 0.027, _OBLONG_ASIDE),
    )
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "collision_group": "Rapier filters pairs by a hook, and has no named groups"
    }

    PARTS: ClassVar[Parts[RapierSimulation]] = Parts(RapierSimulation, read_back, inventory, neutral, expected)

    @classmethod
    def method(cls, world: World) -> IntegrationMethod | None:
        return integration.method(world)

    @classmethod
    def prepare(cls) -> None:
        import rapier3d  # noqa: F401

    def set_timestep(self, timestep: float) -> None:
        self._simulation.set_timestep(timestep)

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(v)
