"""How far Drake 1.51.1 is from the law in contact of several bodies, and what of it must be accepted by name.

The table is measured by ``tools/deviations.py`` at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0 to 1 and ratios of
masses of 1 to 1000.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.control.reference import natives
from simspec.engines.kit.capabilities import UNKNOWN, Deviation, Reason, read_deviations
from simspec.engines.kit.refinements import coupled
from simspec.support.declarations import Level, Refinement, Table, unsupported_if
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.hull import hull_of, inset, mesh_vertices
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.reach import crossing
from simspec.world.types import World

_SAP = "contact_approximation=sap"
LIFTS = "SAP's contact model is convex, and lifts slipping bodies by up to μ times their slip"
_SOFT = (
    "SAP bounds the stiffness of a contact by the lighter mass and the timestep: heavy bodies "
    "sink in, with the square of the timestep"
)
_CORNERS = (
    "Drake's boxes have contact points at their corners and one more: where edges cross, the "
    "upper box sinks (accepted by name: shape.box)"
)
_FIFTH = (
    "Drake's boxes have contact points at their corners and one more, which is off the centre of "
    "the face and bears most of the load"
)
_CREEPS = "Drake's friction is proportional to slip below the stiction tolerance, and has its full size only above it"

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("cross*", _CORNERS),
        Reason("squeeze*", _FIFTH, "contact_approximation=tamsi"),
        Reason("stack-slides*", LIFTS, _SAP),
        Reason("stack*", _SOFT, _SAP),
        Reason("stack-slides* stack-stays*", _CREEPS),
        Reason("*", LIFTS, _SAP),
        Reason("*", UNKNOWN),
    ),
)
COUPLED: Table = coupled(
    "drake",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: (
            "SAP lets heavy bodies sink into light ones at timesteps from 4 ms on, and stops bodies that slide "
            "under a load too early. contact_approximation: tamsi avoids the first and reduces the second",
            "with SAP a body of 1000 times the mass sinks 9 mm in at 4 ms",
        ),
        Feature.EVEN_PRESSURE: (
            "Drake adds a contact point between two boxes off the centre of the face: with TAMSI boxes "
            "between two fingers turn as they slip. With SAP they slip too little, and hardly at all from "
            "4 ms on",
            "boxes that slip between fingers turn by 0.9 rad with TAMSI, and slip too little with SAP",
        ),
        Feature.SELF_LOCKING: (
            "With TAMSI a jammed clamp falls at some frictions where little but friction presses it on. Use "
            "contact_approximation: sap",
            "with TAMSI a jammed clamp may fall where little but friction presses it on",
        ),
    },
)

# Which of Drake's contact solvers a world gets where the settings leave it to simspec.

MOST_TAMSI, BODY_SECONDS = 8, 0.008
"""TAMSI is taken for one moving body with collision shapes; for several up to this many, and up to this number times the
timestep (s). Its equations are dense (36 boxes 30 ms a step, where SAP takes 5), and at 4 ms it fails to converge in
towers of six boxes, at 1 ms not in towers of eight (measured)."""

CROSSED_SECONDS = 0.002
"""The largest timestep (s) of TAMSI where the edges of boxes may cross: at 4 ms it fails to converge on some (measured)."""
PRESSURE_SECONDS = 0.001
"""The largest timestep (s) of hydroelastic contact with friction by SAP: at 2 ms a push at μ = 1.5 meets 2.3 times its
friction, at 8 ms sliders of μ = 1 leave the floor for good. At 1 ms pushes are off by
1 % up to μ = 0.5, by 35 % at 1, within what SAP's friction is declared to be off (measured to μ = 1.5)."""


def approximation(world: World) -> str:
    """``tamsi`` where friction matters, few bodies move, no joint has limits and none a PD controller of Drake's: its friction
    is exact and its slides do not hop. ``sap`` elsewhere: it has the common law's β, stops joints at their limits, has the
    controllers, converges where hulls of meshes land and where a kinematic body carries joints, and its time grows with the
    number of contacts alone."""
    has_friction = any(law.friction for law in meeting_laws(world).values())
    groups = rigid_groups(world)
    moving = sum(groups[body.name] != "world" and bool(solid_shapes(body)) for body in world.bodies)
    limited = any(body.joint.position_limits for body in world.bodies)
    crossed = crossing(world) and world.physics.timestep > CROSSED_SECONDS
    few = moving <= 1 or (moving <= MOST_TAMSI and moving * world.physics.timestep <= BODY_SECONDS)
    diverges = carries_joints(world) or moves_hulls(world) or crossed
    return "tamsi" if has_friction and few and not limited and not natives(world) and not diverges else "sap"


def moves_hulls(world: World) -> bool:
    """Whether a body with a mesh moves and touches: of 60 landings of irregular hulls TAMSI fails to converge in 8, SAP in
    none (measured at 1 ms, μ = 0.5: ``tools/hulls.py``)."""
    groups = rigid_groups(world)
    return any(
        shape.kind == "mesh" for body in world.bodies if groups[body.name] != "world" for shape in solid_shapes(body)
    )


def carries_joints(world: World) -> bool:
    """Whether a kinematic body carries others on joints."""
    kinematic = {motion.body for motion in world.motions}
    return any(
        body.joint.kind != "fixed" and body.joint.parent is not None
        for root, bodies in (trees(world) if kinematic else {}).items()
        if root in kinematic
        for body in bodies
    )


def light_enough(world: World) -> Refinement | None:
    """Kinematic bodies that carry joints are not supported by TAMSI."""
    if requested_approximation(world) != "tamsi" or not carries_joints(world):
        return None
    return unsupported_if(
        "TAMSI fails to converge in the first step of a kinematic body with joints; use contact_approximation: sap"
    )


def requested_approximation(world: World) -> str:
    """The solver that a world's options name, or get."""
    contact_approximation = dict(world.options("drake").settings).get("contact_approximation", "auto")
    return approximation(world) if contact_approximation == "auto" else str(contact_approximation)


def coulomb(world: World) -> Refinement | None:
    """Friction is exact unless SAP has some."""
    if not any(law.friction for law in meeting_laws(world).values()):
        return Refinement(Level.VIA_API, "nothing that meets has friction")
    return Refinement(Level.VIA_API, "TAMSI's friction") if requested_approximation(world) == "tamsi" else None


def stops(world: World) -> Refinement | None:
    """Joints stop at their limits as the language has it but by TAMSI, which has springs there."""
    if requested_approximation(world) != "sap":
        return None
    return Refinement(Level.VIA_API, "with contact_approximation: sap joints stop within the step")


def boxes_supported(world: World) -> Refinement | None:
    """Boxes are exact where their edges cannot cross, and by hydroelastic contact, which is not supported with friction by SAP
    at large timesteps."""
    if not dict(world.options("drake").settings).get("hydroelastic_faces"):
        return (
            None
            if crossing(world)
            else Refinement(Level.EXACT, "no two boxes are so similar in size that their edges may cross")
        )
    small = world.physics.timestep <= PRESSURE_SECONDS
    if (
        small
        or requested_approximation(world) == "tamsi"
        or not any(law.friction for law in meeting_laws(world).values())
    ):
        return Refinement(Level.EXACT, "boxes touch by hydroelastic contact")
    return unsupported_if(
        f"hydroelastic contact with friction throws boxes off at timesteps above {1e3 * PRESSURE_SECONDS:g} ms "
        "with SAP. Lower physics.timestep, or use contact_approximation: tamsi"
    )


def chosen(world: World, settings: Mapping[str, bool | int | float | str]) -> dict[str, bool | int | float | str]:
    """The settings with what ``contact_approximation: auto`` stands for."""
    if settings["contact_approximation"] != "auto":
        return dict(settings)
    return {**settings, "contact_approximation": approximation(world)}


# Drake's memory: worlds that need too much are refused before they are built.
#
# Drake's collision filter keeps an entry for every two geometries, whether they are filtered or not, in the model and in each
# context; the steps and the mass matrix are dense in the velocities, of however many bodies that do not act on each other.

PAIR_BYTES = 400
"""Of two geometries: 1,945 of them (216 boxes) take 740 MB, 2,029 spheres 840 MB (measured)."""
MOST_GIGABYTES = 4.0
"""Of 2,860 free spheres, or 490 boxes with their corners. 2,029 spheres take 2.0 GB and load in 7 s, 344 boxes 1.9 GB and 17 s
(measured)."""


def gigabytes(geometries: int, velocities: int) -> float:
    """The memory (GB) that Drake needs for so many collision geometries, corners counted, and velocities."""
    return 1e-9 * (PAIR_BYTES * geometries * (geometries - 1) / 2 + 8 * velocities**2)


def too_large(geometries: int, velocities: int) -> str | None:
    """Why a world is refused; None where it is not."""
    needed = gigabytes(geometries, velocities)
    if needed <= MOST_GIGABYTES:
        return None
    return (
        f"Drake needs {needed:.1f} GB, and simspec allows {MOST_GIGABYTES:g} GB: its collision filter stores "
        f"every pair of {geometries:,} geometries (a box is nine, itself and its corners; a cylinder 19, a mesh "
        f"up to 49), and its mass matrix of {velocities:,} velocities is dense"
    )


# Small shapes within a shape, so that faces and edges have several points of contact.
#
# Drake has one point of contact for each pair of geometries: a box on a floor stands on one of its corners, and turns about it.
# The small shapes touch the shape's surface from within, and each gives a contact point where it overlaps the other: balls in
# the corners of boxes and along the rims of cylinders, a thin disc at each end of a cylinder, which lies on both, and the two
# round ends of a capsule, which are its own. In each corner of the hull of a mesh there is a ball for every three faces that
# meet there, which touches these.

RADIUS = 1e-4
"""Of the balls (m), where the shape is not smaller: how far points of contact are inside the edges."""
SHARE = 0.05
"""Of the shape's smallest size, at most."""
RIM = 8
"""Balls on each rim of a cylinder."""
MOST_CORNERS = 48
"""Balls in a hull. Where more would fit, these are far from each other; where it tips over another corner, the hull's own point
of contact is there."""

ROUND_OFF = 1e-13
"""Share of the largest coordinate of a centre below which another is what a rotation left of 0."""

FACED = ("box", "plane")
"""Kinds of shapes that touch each other by hydroelastic contact, where the spec sets it. Cylinders do not: their meshes are
prisms, on which they roll 10 % short of a circle's way with 64 edges and 12 % with 256, and 40 times slower (measured)."""
ANY_RESOLUTION = 1.0
"""Drake's resolution hint (m) of boxes and planes, whose meshes do not depend on it."""

Part = tuple[str, tuple[float, ...], tuple[float, float, float]]
"""The kind, size and centre, in the shape's frame and along its axes."""


def corners(kind: str, size: Sequence[float]) -> list[Part]:
    """The small shapes within a shape."""
    if kind == "box":
        radius = min(RADIUS, SHARE * min(size))
        x, y, z = (edge / 2.0 - radius for edge in size)
        signs = itertools.product((-1.0, 1.0), repeat=3)
        return [("sphere", (radius,), (a * x, b * y, c * z)) for a, b, c in signs]
    if kind == "cylinder":
        radius = min(RADIUS, SHARE * min(size))
        out, up = size[0] - radius, size[1] / 2.0 - radius
        turns = [2.0 * math.pi * index / RIM for index in range(RIM)]
        rims = [("sphere", (radius,), (out * math.cos(a), out * math.sin(a), z)) for z in (-up, up) for a in turns]
        return [*rims, *(("cylinder", (size[0], 2.0 * radius), (0.0, 0.0, z)) for z in (-up, up))]
    if kind == "capsule":
        return [("sphere", (size[0],), (0.0, 0.0, z)) for z in (-size[1] / 2.0, size[1] / 2.0)]
    if kind == "mesh":
        radius = min(RADIUS, SHARE * 2.0 * float(hull_of(size).offsets.min()))
        centres = spread(mesh_vertices(inset(tuple(size), radius)))
        return [("sphere", (radius,), (x, y, z)) for x, y, z in centres.tolist()]
    return []


def rounded_place(place: Sequence[float]) -> tuple[float, ...]:
    """A centre in its body's frame, without what round-off of the shape's pose left of coordinates that are 0."""
    least = ROUND_OFF * max(map(abs, place))
    return tuple(value if abs(value) > least else 0.0 for value in place)


def reach_of(place: Sequence[float]) -> float:
    """How far a shape is from its body's origin: the round-off of a centre in the body's frame is of this size, and the centre
    itself may be anything smaller."""
    return max(map(abs, place))


def spread(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """At most ``MOST_CORNERS`` of ``points`` (n, 3), in their order: the one that is furthest from the origin, and then again
    and again the one that is furthest from those that are taken."""
    if len(points) <= MOST_CORNERS:
        return points
    taken = [int(np.argmax(np.linalg.norm(points, axis=1)))]
    away = np.full(len(points), np.inf)
    while len(taken) < MOST_CORNERS:
        away = np.minimum(away, np.linalg.norm(points - points[taken[-1]], axis=1))
        taken.append(int(np.argmax(away)))
    chosen: NDArray[np.float64] = points[np.sort(np.array(taken))]
    return chosen


def hydroelastic(settings: Mapping[str, Any]) -> bool:
    """Whether faces touch by hydroelastic contact, not by what is put into shapes; the setting is left out where it is off."""
    return bool(settings.get("hydroelastic_faces", False))
