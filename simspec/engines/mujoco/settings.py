"""MuJoCo's solver settings, each with the reason for its default. Facts marked *measured* as in ``engine.py``."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.dialects.mujoco.sidecar import COULOMB, NATIVE
from simspec.engines.kit.settings import COARSE, SHARE, ByPair, Group, Setting, of_thinnest

_RIGID = ByPair(("common",))
_SLIDING = ByPair(("common",), ("elliptic",), friction=True)
_SLIDING_ON_SPRINGS_TOO = ByPair(("common", "time-constant", "stiffness"), ("elliptic",), friction=True)
_CUSHIONED = ByPair(("common",), ("elliptic",), friction=True, inelastic=True)

SETTINGS: Mapping[str, Setting] = {
    "solver": Setting(
        "newton",
        "The constraint solver. Newton solves MuJoCo's convex problem to round-off in a handful of iterations; cg and pgs "
        "approach it. pgs for free balls without friction: they meet in single points, and 216 of them take 0.7 of "
        "Newton's time, with the same energy, depth and spread (measured, with the tolerance below).",
        ("newton", "cg", "pgs"),
        group=Group.SOLVER,
        frictionless="pgs",
        frictionless_unless=("friction", "coulomb"),
    ),
    "iterations": Setting(
        100,
        "Most iterations of the solver in a step; Newton stays far below. MuJoCo's own number.",
        minimum=1,
        group=Group.ACCURACY,
        finer=1000,
    ),
    "ls_iterations": Setting(
        50,
        "Most iterations of the solver's line search. MuJoCo's own number.",
        minimum=1,
        needs=("solver", ("newton", "cg")),
        group=Group.ACCURACY,
        finer=500,
    ),
    "tolerance": Setting(
        1e-8,
        "The solver ends when it improves by less than this. MuJoCo's own number. By pgs columns of balls at rest then lose "
        "contact in one step of seven; with 1e-10 in none, as by Newton, at the same cost (measured). It is a share of what "
        "the heaviest bodies make of it: beside a kinematic body, joints with dry friction are off by 0.03 rad/s, and the "
        "cap of a bottle before robots by 2.9 rad/s after 20 ms; a robot's finger that follows another is 9e-9 m off after "
        "0.5 s (measured).",
        minimum=0.0,
        maximum=1.0,
        group=Group.ACCURACY,
        finer=1e-14,
        frictionless=1e-10,
        kinematic=1e-14,
        light=1e-14,
    ),
    "ls_tolerance": Setting(
        0.01,
        "The line search ends below this part of the gradient. MuJoCo's own number.",
        minimum=0.0,
        maximum=1.0,
        needs=("solver", ("newton", "cg")),
        group=Group.ACCURACY,
        finer=1e-4,
    ),
    "friction": Setting(
        NATIVE,
        "native: MuJoCo's own friction, which slides, holds and rolls right but leaves out most of the friction of an "
        "impact (80 to 90 % at 1 ms): slip is taken back at friction_rate, and an impact lasts one step. To be accepted by "
        "name (contact.friction.impact), as is the slip a / friction_rate of what is carried by something that turns "
        "(contact.friction.carried). coulomb: impacts too, within 2 %, by a short loop around MuJoCo's solver; "
        "nothing hops, and nothing lies on a cushion. It costs 16 µs a step of a body at rest, 29 of one that slides, "
        "1.5 to 2.2 times MuJoCo's own time in towers, 3.4 to 4.6 times in a pile of 216 spheres. Of such a pile's steps "
        "0.1 % end unconverged at μ = 0.3, 5 % at 0.5 (a contact's normal speed then off by up to 0.02 m/s), 35 % at 1 "
        "(0.3 m/s), which the run counts and says (measured, 1 ms: docs/records/contact.md). friction_rate, friction_share and "
        "friction_cushion are native's.",
        (NATIVE, COULOMB),
        group=Group.FRICTION,
    ),
    "impratio": Setting(
        1000.0,
        "How much harder friction is than the normal direction, which friction_cushion makes soft. A box at 60 % of the "
        "limit creeps 1.7e-6 m/s (measured, 1 ms), at MuJoCo's own 1 a thousand times as fast.",
        minimum=1e-6,
        group=Group.FRICTION,
    ),
    "high_impratio": Setting(
        1e7,
        "impratio of worlds where compliant contact has friction, and the most where something has torsional or rolling "
        "friction c: MuJoCo makes friction as soft as its contact, and moments softer by (μ/c)². At an impratio of 10 a box "
        "on springs creeps 8e-3 m/s at 60 % of the limit, at 1e7 7e-6. For moments impratio is raised to 0.01 (μ/c)² "
        "(0.5 ms/dt)², from which on spinning and rolling stop within 2 % (measured, c of 0.1 mm to 20 mm); no further, since "
        "at 1e7 piled and squeezed bodies slip up to 38 mm further than at 1e4 (2 ms), and heaps jitter at 2e-4 m/s.",
        minimum=1e-6,
        group=Group.FRICTION,
    ),
    "noslip_iterations": Setting(
        0,
        "Sweeps after the solver that take away slow slip. None: the creep left is 1e-6 m/s, and the sweeps break the "
        "solver's own optimum.",
        minimum=0,
        group=Group.FRICTION,
    ),
    "multiccd": Setting(
        True,
        "Several contact points between shapes that meet in a face (MuJoCo 4's own choice, off in MuJoCo 3).",
        group=Group.GEOMETRY,
    ),
    "ccd_tolerance": Setting(
        1e-6,
        "The search for the overlap of two convex shapes ends when it improves by less than this (m). MuJoCo's own number. "
        "Of two cylinders that stand on each other it then answers, in 7 of 200,000 states drawn at random, an overlap of 37 "
        "mm sideways in place of one of up to 20 µm, and they jump apart; with 1e-8 in none, at 6 to 8 % more of a step of "
        "21 cylinders (measured, 4.0.1). On friction_cushion what rests is deeper than that.",
        minimum=1e-12,
        at_most=of_thinnest(SHARE),
        group=Group.ACCURACY,
        finer=1e-8,
    ),
    "warmstart": Setting(True, "Begin each solve at the last step's solution.", group=Group.ACCURACY),
    "island": Setting(
        False,
        "Solve groups of bodies that do not touch each other apart. Off: MuJoCo versions differ in what they make of it.",
        needs=("sleeping", (False,)),
        group=Group.SOLVER,
    ),
    "arena": Setting(
        0,
        "Memory (MiB) for the contacts, constraints and solver of a state. 0: MuJoCo's default, and in worlds of more than "
        "2,500 velocities what follows from bodies, shapes and friction, since the default grows with the square of the "
        "bodies. A run ends with an error when it is too small. No number of the motion depends on it.",
        minimum=0,
        maximum=2**20,
        only_with="arena",
        group=Group.BOUNDS,
    ),
    "sleeping": Setting(
        False,
        "Take free rigid bodies that rest out of the simulation until something touches them (MuJoCo 4; switches island "
        "on).",
        only_with="sleeping",
        group=Group.SLEEPING,
    ),
    "sleep_tolerance": Setting(
        1e-5,
        "With sleeping: the speed (m/s, angular times length) below which a body falls asleep after ten steps.",
        minimum=0.0,
        maximum=0.01,
        only_with="sleeping",
        needs=("sleeping", (True,)),
        group=Group.SLEEPING,
    ),
    "contact_error_reduction": Setting(
        0.01,
        "Share β of an overlap that is taken back in each step: the law that the core engines can share. Higher values "
        "throw overlapping bodies apart at β times overlap over timestep.",
        minimum=0.0,
        maximum=1.0,
        group=Group.ERROR_REDUCTION,
        by_pair=_RIGID,
    ),
    "contact_impedance": Setting(
        0.999,
        "Share of its reference acceleration that a contact reaches; 0.999 leaves a cube at rest 0.25 µm deep at 1 ms "
        "(measured), and higher ones solve worse.",
        minimum=1e-4,
        maximum=0.9999,
        group=Group.SOFTNESS,
        finer=0.9999,
        by_pair=_RIGID,
    ),
    "friction_rate": Setting(
        100.0,
        "Rate (1/s) at which friction takes back slip that it could stop at once, at most friction_share a step. Higher: "
        "sliders are thrown up (at μ = 1 and 5 m/s by 3.6 mm at 100, 29 mm at 300; 1 ms); lower: they stop too late (at "
        "30 by 13 % of a 50 mm slide; at 100 by 1 %).",
        minimum=1e-3,
        needs=("friction", (NATIVE,)),
        group=Group.FRICTION,
        by_pair=_SLIDING,
    ),
    "friction_share": Setting(
        0.3,
        "Most of a slip that friction takes back in one step. MuJoCo's cone is associated: where friction cannot stop a "
        "slip, the normal velocity rises by μ times what was asked for. At 1, which stops a slip at once, a box of μ = 1 "
        "that slides at 5 m/s hops 319 mm; at 0.3, 29 mm; at 0.1, 3.6 mm. What is held and carried, and never slides, "
        "slips the less the higher it is: a hand that turns asks for a new direction in every step (measured).",
        minimum=1e-3,
        maximum=1.0,
        needs=("friction", (NATIVE,)),
        group=Group.FRICTION,
        by_pair=_SLIDING_ON_SPRINGS_TOO,
    ),
    "friction_cushion": Setting(
        1e-4,
        "Depth (m) over which a frictional contact that does not bounce becomes rigid. MuJoCo's friction lifts what "
        "slides; on a cushion the lift finds its balance: to 1 m/s and μ = 0.5 nothing hops and pushing gives μ within "
        "0.02 %; without, a box hops every 10 ms and the friction of 60 ms is up to 10 % off (measured, 1 ms). Price: "
        "what rests is 70 to 100 µm deep, not 0.3. 0: none.",
        minimum=0.0,
        maximum=0.1,
        at_most=of_thinnest(COARSE),
        depth=True,
        needs=("friction", (NATIVE,)),
        group=Group.SOFTNESS,
        finer=0.0,
        by_pair=_CUSHIONED,
    ),
    "explicit_pairs_limit": Setting(
        5000,
        "Pairs of shapes with friction that are listed one by one, which alone have a friction_rate. 5000 are 100 bodies, "
        "and cost 20 % of a step (measured); beyond the limit no pair is listed, and sliding bodies hop.",
        minimum=0,
        group=Group.FRICTION,
    ),
    "limit_error_reduction": Setting(
        0.01,
        "Share of a passed joint limit that is taken back in each step; as for contact, so that a stop does not bounce.",
        minimum=0.0,
        maximum=1.0,
        group=Group.JOINTS,
    ),
    "limit_impedance": Setting(
        0.999, "As contact_impedance, for joint limits.", minimum=1e-4, maximum=0.9999, group=Group.JOINTS, finer=0.9999
    ),
    "dry_friction_impedance": Setting(
        0.9999,
        "As contact_impedance, for dry friction in joints, which creeps the less the higher it is: 9e-8 m/s at 90 % of "
        "its limit, 1 kg and 1 ms (measured; 9e-7 at 0.999).",
        minimum=1e-4,
        maximum=0.9999,
        group=Group.JOINTS,
    ),
}
