"""How far DART 6.20.0 is from the law in contact of several bodies, and what of it must be accepted by name.

The table is measured by ``tools/deviations.py`` at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0 to 1 and ratios of
masses of 1 to 1000.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simspec.engines.dart.inventory import chosen_solver
from simspec.engines.kit.capabilities import (
    DEEP,
    JAMMED,
    NEAR_LIMIT,
    PRESSED,
    SWEEPS,
    Deviation,
    Reason,
    coarse,
    read_deviations,
)
from simspec.engines.kit.refinements import SLIDING, coupled, in_force
from simspec.engines.kit.settings import Setting, SettingGroup
from simspec.support.declarations import Table
from simspec.support.features import Feature
from simspec.world.types import World

_DANTZIG = "contact_solver=dantzig"
_LEANS = (
    "DART's Dantzig solver bounds friction by the normal forces of the frictionless problem: "
    "contacts that friction alone presses together have none"
)
_TOGETHER = (
    "DART's Dantzig solver bounds friction in an impact on an edge by the normal impulse of the frictionless problem"
)
_SPINS = (
    "DART's Dantzig solver bounds friction by the normal forces of the frictionless problem, "
    "which friction changes. Under the elliptic cone it bounds friction by a pyramid, too"
)
_TURNED = (
    "DART's friction pyramid follows the tilt of the lower face between two moving bodies "
    "(accepted by name: contact.cone.pyramid-circumscribed)"
)
_UNEVEN = "DART's NSGS solver ends with uneven pressure over a face, whose friction turns boxes between fingers"
_FEW = coarse("slip, spin or rest on crossing edges")


def _in_force(world: World) -> Mapping[str, Any]:
    settings = in_force("dart")(world)
    return {**settings, "contact_solver": chosen_solver(world, settings)}


_MEASURED: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("rod* clamp* jam* squeeze* pile* cross* carrier slide-spin", PRESSED, bounces=True),
        Reason("rod* clamp* jam* pile*", _LEANS, _DANTZIG),
        Reason("edge*", _TOGETHER, _DANTZIG),
        Reason("slide-spin", _SPINS, _DANTZIG),
        Reason("stack-slides* stack-stays*", NEAR_LIMIT, _DANTZIG),
        Reason("stack*", DEEP, _DANTZIG),
        Reason("stack-slides* stack-stays*", _TURNED, cone="pyramid-circumscribed"),
        Reason("stack*", SWEEPS),
        Reason("jam*", JAMMED),
        Reason("squeeze*", _UNEVEN),
        Reason("*", _FEW),
    ),
)
_BULLET = ("collision_detector", "bullet")
_MOVING = "DART's detector bullet changes its contact points on a plane as a body slides, and they press on it unevenly"
DEVIATIONS: tuple[Deviation, ...] = (
    *_MEASURED,
    # now and then, at 1 ms and μ = 0.8: 0.13 mm at a ratio of 20.9, 0.19 mm at 100, and nothing at others between
    Deviation("stack-sideways", 2.4e-4, SWEEPS, False, 0.6, 9e-4, setting=("contact_solver", "nsgs"), ratio=10.01),
    # by dantzig at frictions of 0.1 to 1.5, without restitution: 19 to 25 % at a ratio of 1, 29 % at 4, 60 % at 10 (4 ms)
    Deviation("stack-slides-plane", 0.29, _MOVING, setting=_BULLET),
    Deviation("stack-slides-plane", 0.34, _MOVING, setting=_BULLET, ratio=1.001),
    Deviation("stack-slides-plane", 0.69, _MOVING, setting=_BULLET, ratio=4.004, timestep=2.1e-3),
    Deviation("stack-stays-plane", 0.026, _MOVING, relative=False, setting=_BULLET, ratio=1.001),
    Deviation("stack-stays-plane", 0.077, _MOVING, relative=False, setting=_BULLET, ratio=4.004),
    Deviation("stack-slides", 0.053, _MOVING, setting=_BULLET, timestep=2.1e-3),
)
COUPLED: Table = coupled(
    _in_force,
    DEVIATIONS,
    {
        Feature.MASS_RATIO: (
            "DART's NSGS solver leaves overlaps where heavy bodies rest on light ones, at timesteps from "
            "2 ms on, and stops bodies that slide under a load too early. contact_solver: dantzig leaves "
            "smaller overlaps",
            "a body of 1000 times the mass sinks through at 4 ms",
        ),
        Feature.EVEN_PRESSURE: (
            "DART's NSGS solver ends with uneven pressure over a face, so that boxes between two fingers "
            "turn and fall. Use contact_solver: dantzig. With both solvers fingers bounce off bodies with restitution",
            "boxes between fingers fall and turn over in 0.3 s (contact_solver: dantzig avoids this)",
        ),
        Feature.SELF_LOCKING: (
            "DART's NSGS solver ends before friction has built up the normal force of a jammed clamp, which creeps "
            "or falls. Raise iterations to 10000; contact_solver: dantzig does not help",
            "a jammed clamp falls where little but friction presses it on",
        ),
    },
    # how bodies slide over each other under the pyramid is accepted by the name of the cone
    stacks=lambda row: row.probe not in SLIDING or row.friction_cone != "pyramid-circumscribed",
)

# DART's solver settings, each with the reason for its default. Facts marked *measured* as in ``engine.py``.

SETTINGS: Mapping[str, Setting] = {
    "contact_solver": Setting(
        "auto",
        "auto: nsgs where something has friction; dantzig under the circumscribed pyramid where nothing has, "
        "and for free balls without friction. dantzig bounds friction by the normal forces of the frictionless "
        "problem, and by a pyramid: where something has friction, the spec must accept it by the name of the "
        "cone. It stacks best and is faster (see docs/engines/dart.md).",
        ("auto", "nsgs", "dantzig"),
        group=SettingGroup.SOLVER,
    ),
    "collision_detector": Setting(
        "auto",
        "auto: the first of dart, ode, fcl with the fewest inexact pairs of shapes that may touch in this "
        "world: dart for spheres, boxes and capsules, ode for cylinders and planes, fcl for ellipsoids. bullet "
        "has at most four points for each pair where ode has eight to twelve, and rounds edges.",
        ("auto", "dart", "ode", "bullet", "fcl"),
        group=SettingGroup.DETECTOR,
    ),
    "iterations": Setting(
        300,
        "Maximum number of sweeps of the NSGS solver in a step; it stops as soon as it converges. DART's "
        "default of 100 is too few for stacks of cylinders (see docs/engines/dart.md).",
        minimum=1,
        needs=("contact_solver", ("auto", "nsgs")),
        group=SettingGroup.ACCURACY,
        finer=3000,
    ),
    "tolerance": Setting(
        1e-6,
        "The NSGS solver stops below this residual. With DART's default of 1e-5 piles creep; smaller values "
        "cost time (see docs/engines/dart.md).",
        minimum=0.0,
        maximum=1.0,
        needs=("contact_solver", ("auto", "nsgs")),
        group=SettingGroup.ACCURACY,
        finer=1e-10,
    ),
    "dry_friction_tolerance": Setting(
        1e-8,
        "As tolerance (m/s, rad/s), in worlds with dry friction in joints: a friction that changes the "
        "velocity by less than this in a step is ignored.",
        minimum=0.0,
        maximum=0.01,
        needs=("contact_solver", ("auto", "nsgs")),
        group=SettingGroup.JOINTS,
        finer=1e-12,
    ),
    "contact_overflow": Setting(
        "error",
        "Action when a step has more than 1000 contacts, DART's limit, which dartpy cannot raise. simspec "
        "checks it after each recorded stretch of steps. log: continue, and report it in the run's log.",
        ("error", "log"),
        group=SettingGroup.BOUNDS,
    ),
    "sleeping": Setting(
        False,
        "Deactivate bodies at rest until a disturbance wakes them: bodies slower than 0.01 m/s (less the "
        "step's fall) and 0.05 rad/s for 0.5 s. Bodies on freely moving bodies, and the bodies that bear them, "
        "stay awake.",
        only_with="sleeping",
        group=SettingGroup.SLEEPING,
    ),
    "exact_rotation": Setting(
        "auto",
        "Replace DART's Taylor expansion of small rotations (off by up to 1.7e-10 rad in a step) by the exact "
        "form. auto: where no moving body has a collision shape; elsewhere the cost exceeds the benefit.",
        ("auto", "always", "never"),
        group=SettingGroup.ROTATION,
    ),
}
