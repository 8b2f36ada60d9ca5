"""PhysX, as SAPIEN brings it: rigid bodies in single precision on the processor, stepped by its own solver under the common law
of contact.

Facts marked *measured*: SAPIEN 3.0.3, PhysX 5.3.1.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from simspec.contact import Rules, contact_plan
from simspec.engines.kit.capabilities import (
    FIXED_TIMESTEP,
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
from simspec.engines.kit.refinements import coupled, met_pairs, no_friction, single_motor, static_planes
from simspec.engines.kit.settings import Setting, SettingGroup
from simspec.engines.kit.simulated import outside_constraints
from simspec.engines.kit.world_simulation import Parts, TrackingEngine
from simspec.engines.physx.cylinders import SIDES, shortfall
from simspec.engines.physx.filter import exclusions, kinds
from simspec.engines.physx.inventory import expected, inventory, neutral
from simspec.engines.physx.readback import read_back
from simspec.engines.physx.roles import MOST_LINKS, inertia_supported
from simspec.engines.physx.servos import NATIVE
from simspec.engines.physx.simulation import PhysxSimulation
from simspec.engines.physx.units import imported
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
    via_api,
)
from simspec.support.features import Feature
from simspec.world.contact_pairs import excluded_pairs, meeting_kinds, solid_shapes
from simspec.world.hull import FlatError, closed_triangles, hull, hull_of, mesh_vertices
from simspec.world.types import World

# Contact that PhysX computes approximately, and the hulls that it does not support. ``tools/deviations.py`` measures the
# tables of contact of several bodies at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0 to 1, and ratios of masses of
# 1 to 1000.

_ANCHORS = (
    "PhysX's friction ties two anchors of a pair to their initial places by springs: leaning and "
    "piled bodies do not slip near their threshold, and spinning bodies are braked at an angle to "
    "their slip (accepted by name: contact.cone.elliptic)"
)
_PRESSED = (
    "PhysX applies restitution to the speed that a force gives a body in one step, where that exceeds the threshold: bodies "
    "bounce between fingers that press them, and lose friction"
)
_FEW = coarse("rest on crossing edges")

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("squeeze*", _PRESSED),
        Reason("stack*", SWEEPS),
        Reason("jam*", JAMMED),
        Reason("cross*", _FEW),
        Reason("*", _ANCHORS),
    ),
)
COUPLED: Table = coupled(
    "physx",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: classes.HEAVY_ON_LIGHT,
        Feature.SELF_LOCKING: classes.JAMMED,
        Feature.EVEN_PRESSURE: (_PRESSED, "bodies with restitution bounce between fingers that press them"),
    },
)

# Hulls. PhysX computes the hull of the vertices again, and drops vertices silently: those that reach less than ``OUT`` of the
# sum of the hull's extents beyond the hull of the others, and some where there are more than ``MOST_FACES`` faces. Of 1,500
# random hulls of 5 to 140 vertices, none that these rules accept lost a vertex, and 1 % of those that they reject would have
# kept all.

OUT = 3.6e-4
"""A little above the measured 3.5e-4."""
LEAST_OUT = 7e-7
"""m: the least that a corner must reach beyond the others, 7e-4 of PhysX's unit of length."""
MOST_FACES, MOST_CORNERS = 255, 255
"""Of one of PhysX's hulls. A surface of triangles alone has 255 faces with 129 corners."""
DIGITS = 6
"""After the point of a normal, and of a share of the extent: by which triangles are in one face."""
KEPT = 256
"""Hulls of which the answer is remembered."""


def hull_refusal(world: World) -> Refinement | None:
    """Not a world with a hull of which PhysX would leave corners out."""
    for body in world.bodies:
        for shape in solid_shapes(body):
            if shape.kind == "mesh" and (why := left_out(shape.size)):
                return unsupported_if(f"{why} ({shape.name!r}). Reduce the hull by `max_vertices` of the mesh")
    return None


@functools.lru_cache(maxsize=KEPT)
def left_out(size: tuple[float, ...]) -> str | None:
    """Why PhysX would not hold a hull (flat vertices, m) as it is; None where it does."""
    vertices = mesh_vertices(size)
    if len(vertices) > MOST_CORNERS:
        return f"PhysX supports hulls of up to {MOST_CORNERS} corners, and this has {len(vertices)}"
    if closed_triangles(len(vertices)) > MOST_FACES and (faces := _faces(size)) > MOST_FACES:
        return f"PhysX supports hulls of up to {MOST_FACES} faces, and this has {faces}"
    needed = max(LEAST_OUT, OUT * float(np.ptp(vertices, axis=0).sum()))
    near = [reach for number in range(len(vertices)) if (reach := _reach(vertices, number)) <= needed]
    if not near:
        return None
    return (
        f"PhysX drops corners that protrude by less than {needed:.2g} m from the hull of the others, and {len(near)} of "
        f"{len(vertices)} corners do (by {min(near):.2g} m at least)"
    )


def _faces(size: tuple[float, ...]) -> int:
    """The number of different planes of a hull's triangles."""
    hull = hull_of(size)
    planes = np.column_stack([hull.normals, hull.offsets / np.ptp(hull.vertices, axis=0).max()])
    return len(np.unique(np.round(planes, DIGITS), axis=0))


def _reach(vertices: np.ndarray, number: int) -> float:
    """How far (m) a corner is outside of the hull of the others; endlessly, where these make no solid."""
    try:
        others = hull(np.delete(vertices, number, axis=0))
    except FlatError:
        return float("inf")
    return float((others.normals @ vertices[number] - others.offsets).max())


# Edges. A corner in a face is exact, an edge across an edge is not. In 720 random overlaps of each pair of kinds, 10 µm to 2 mm
# deep, compared with coal:
#
# boxes, boxes        edges cross in half: normals 0.27 rad (median) to 1.5 rad off, depths up to 2.1 mm; none missed
# hulls, boxes/hulls  normals up to 0.7 rad off in half, depths up to 0.22 mm; 7 missed, up to 0.28 mm
# hulls, balls/capsules  normals right to 4e-4 rad, depths off by 1 µm to 0.1 mm in 2 of 100; one missed
# others              right to 7e-7 m and 3e-6 rad; none missed
#
# With ``enable_pcm`` normals of edges are as wrong (0.9 rad), and contacts of earlier steps are kept.

_EDGES = (
    "PhysX's normals and depths are inaccurate where edges of a hull cross others, and it misses some of these overlaps"
)
_BOXES = (
    "PhysX's normals and depths are inaccurate where edges of two boxes cross. Corners in a face, and boxes that rest or slide "
    "on faces, are exact"
)
_ROUND = "PhysX's depths are inaccurate for some contacts of spheres and capsules with hulls"
APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("box", "box"): _BOXES,
    ("box", "mesh"): _EDGES,
    ("mesh", "mesh"): _EDGES,
    ("mesh", "sphere"): _ROUND,
    ("capsule", "mesh"): _ROUND,
}
"""Of pairs of kinds, what is lost."""
SHORT = "contact normals are inaccurate where edges of boxes cross"
SHORT_HULLS = "contact normals are inaccurate where edges of hulls cross"
SHORT_ROUND = "depths of some contacts of spheres and capsules with hulls are inaccurate"


def _refinement(met: Mapping[tuple[str, str], str]) -> Refinement:
    how = "; ".join(dict.fromkeys(met.values()))
    if ("box", "box") in met:
        return Refinement(Level.APPROXIMATE, how, SHORT)
    short = SHORT_HULLS if _EDGES in met.values() else SHORT_ROUND
    return Refinement(Level.APPROXIMATE, f"{how}; see docs/engines/physx.md", short)


def _of(kind: str) -> Mapping[tuple[str, str], str]:
    """The pairs in messages on boxes, and on hulls."""
    return {pair: how for pair, how in APPROXIMATE.items() if ("mesh" in pair) == (kind == "mesh")}


def boxes(world: World) -> Refinement | None:
    """Boxes that may meet boxes; the message on hulls covers those that may meet hulls."""
    met = met_pairs(world, _of("box"))
    return _refinement(met) if met else None


def meshes(world: World) -> Refinement | None:
    """Not hulls that PhysX would not hold; approximate are those that may meet more than planes."""
    if refused := hull_refusal(world):
        return refused
    met = met_pairs(world, _of("mesh"))
    return _refinement(met) if met else None


# Cylinders are prisms (``cylinders.py``). In 120 random overlaps of each pair of kinds, 0.1 and 1 mm deep, with a radius of 80
# mm, compared with coal, none is missed. Depths are off by 48 µm, 6e-4 of the radius, normals of spheres and capsules by 0.025
# rad, half of the angle of a side; with planes normals are exact. With boxes, hulls and cylinders edges are inaccurate as those
# of hulls.

_PRISM = (
    f"simspec gives PhysX cylinders as prisms of {SIDES} sides, whose surfaces are up to {shortfall():.1g} of the radius off: "
    "rolling cylinders lose speed at every edge, and where edges of two bodies cross, normals and depths are inaccurate; see "
    "docs/engines/physx.md"
)
_PRISM_SHORT = f"cylinders are prisms of {SIDES} sides: they roll with a loss"
FELT = 5e-5
"""m off its place from which a surface is declared, half of what the size probe allows."""


def without_cylinders(world: World) -> Refinement | None:
    """Exact in worlds in which no cylinder may touch anything."""
    met = any("cylinder" in pair for pair in meeting_kinds(world))
    return None if met else Refinement(Level.EXACT, "")


BOXES, MESHES = (_refinement(_of(kind)) for kind in ("box", "mesh"))
"""Where all of these pairs may meet, for tables."""

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


class PhysX(TrackingEngine[PhysxSimulation]):
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
        Capability.TIMESTEP: FIXED_TIMESTEP,
        Capability.FOREIGN_FILES: "simspec does not use SAPIEN's loaders of robot files",
    }
    NATIVE_LAW: ClassVar[NativeLaw | None] = SPRING_IN_SINGLES
    SUPPORT: ClassVar[Table] = {
        **classes.driven("PhysX"),
        **classes.NOT_IN_WORLD_JSON,
        **exactly(Feature.JOINT_SEVERAL, Feature.LIMIT_POSITION, Feature.ARMATURE, Feature.FRICTION),
        **exactly(Feature.TOUCHING_PAIRS),
        **for_each(classes.explicit("PhysX"), *features.DAMPERS_AND_SPRINGS),
        Feature.DRY_FRICTION: exact(classes.ZERO_VELOCITY_MOTOR),
        Feature.CONTROL_NATIVE: exact(NATIVE, refine=single_motor("PhysX")),
        Feature.HARDNESS_NATIVE: classes.unwritten("PhysX", Attempt.READ_BACK),
        Feature.INERTIA: exact(
            f"PhysX has at most {MOST_LINKS} links in an articulation, and stores inverses of inertias",
            refine=inertia_supported,
        ),
        Feature.TREE_DEPTH: never(f"PhysX has at most {MOST_LINKS} links in an articulation"),
        **outside_constraints("PhysX"),
        **for_each(never("PhysX's contacts transmit no torque"), *features.MOMENTS),
        **shape_kinds("PhysX", ("sphere", "box", "capsule")),
        Feature.SHAPE_CYLINDER: approximate(_PRISM, without_cylinders, _PRISM_SHORT),
        Feature.SHAPE_BOX: exact(
            "PhysX's contact of boxes with boxes is approximate. Accept `shape.box` where boxes may touch each other",
            refine=boxes,
            cases=(BOXES,),
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
    def thicker(cls, world: World) -> Mapping[str, float]:
        solid = (shape for body in world.bodies for shape in solid_shapes(body) if shape.kind == "cylinder")
        off = {shape.name: shortfall() * shape.size[0] for shape in solid}
        return {name: length for name, length in off.items() if length > FELT}

    @classmethod
    def prepare(cls) -> None:
        imported()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(v)
