"""DART's solver settings, each with the reason for its default. Facts marked *measured* as in ``engine.py``."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.engines.kit.settings import Group, Setting

SETTINGS: Mapping[str, Setting] = {
    "contact_solver": Setting(
        "auto",
        "auto: nsgs where something has friction; dantzig under the circumscribed pyramid where nothing has, and for free "
        "balls without friction (216 take 0.86 of the time, measured). dantzig bounds friction by the normal forces that "
        "would be without it, and by a pyramid: a rod that leans on a smooth wall at 30° falls at 2.2 times the friction that "
        "it needs, and a clamp that holds itself by its own weight falls freely (measured). Where something has friction it "
        "must be accepted, by the name of the cone; it stacks best and is four times faster.",
        ("auto", "nsgs", "dantzig"),
        group=Group.SOLVER,
    ),
    "collision_detector": Setting(
        "auto",
        "auto: the first of dart, ode, fcl that gets the fewest pairs of shapes wrong that may touch in this world: "
        "dart for spheres, boxes and capsules, ode for cylinders and planes, fcl for ellipsoids. bullet has at most four "
        "points a pair where ode has eight to twelve, which makes stacks of cylinders a quarter cheaper, and rounds edges.",
        ("auto", "dart", "ode", "bullet", "fcl"),
        group=Group.DETECTOR,
    ),
    "iterations": Setting(
        300,
        "Most sweeps of the NSGS solver in a step. Seven cylinders on one another (detector ode, up to 12 contacts for "
        "each pair) fall within 2 s at 4 ms with DART's own 100, and stand 10 s with 300; what is solved sooner costs "
        "no more.",
        minimum=1,
        needs=("contact_solver", ("auto", "nsgs")),
        group=Group.ACCURACY,
        finer=3000,
    ),
    "tolerance": Setting(
        1e-6,
        "The NSGS solver stops below this residual. With DART's default of 1e-5 a pile of balls that must stand creeps by "
        "1.2 mm in 0.6 s (μ = 0.2, 1 ms; 2 µm with 1e-6), and a box between fingers falls at 4 ms (μ = 0.1). Towers and "
        "houses of cards take 1.05 to 1.4 times as long as with 1e-5, and up to seven times with 1e-7.",
        minimum=0.0,
        maximum=1.0,
        needs=("contact_solver", ("auto", "nsgs")),
        group=Group.ACCURACY,
        finer=1e-10,
    ),
    "dry_friction_tolerance": Setting(
        1e-8,
        "As tolerance (m/s, rad/s), in worlds with dry friction in joints. With 1e-5 a friction that takes less speed than "
        "1e-5 m/s in a step (at 1 ms, 0.01 m/s²) is left out, and what is held creeps at 6e-6 rad/s (measured).",
        minimum=0.0,
        maximum=0.01,
        needs=("contact_solver", ("auto", "nsgs")),
        group=Group.JOINTS,
        finer=1e-12,
    ),
    "contact_overflow": Setting(
        "error",
        "What happens when a step has more than the 1000 contacts that DART takes; dartpy cannot raise that number. "
        "It is looked at after each recorded stretch of steps. log: go on, and say so in the run's log.",
        ("error", "log"),
        group=Group.BOUNDS,
    ),
    "sleeping": Setting(
        False,
        "Take bodies that rest out of the simulation until something disturbs them (DART's deactivation): what is slower "
        "than 0.01 m/s, but for the step's fall, and 0.05 rad/s for 0.5 s. Bodies that stand on bodies that move "
        "freely, and what bears them, stay awake (measured).",
        only_with="sleeping",
        group=Group.SLEEPING,
    ),
    "exact_rotation": Setting(
        "auto",
        "Replace DART's Taylor form of small rotations (off by up to 1.7e-10 rad in a step) by the exact one. auto: "
        "where no moving body has a collision shape; elsewhere it would cost more time than it is worth.",
        ("auto", "always", "never"),
        group=Group.ROTATION,
    ),
}
