"""PyBullet's solver settings, each with the reason for its default. Facts marked *measured* as in ``engine.py``."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.engines.kit.bounds import COARSE, SHARE, of_thinnest
from simspec.engines.kit.settings import Group, Setting
from simspec.world.kinematics import constrained_trees
from simspec.world.types import World

LOOP_ITERATIONS = 2000
"""``iterations`` where rows of constraints act on each other. They are solved one after the other: with the rows of a weld 200
sweeps leave a motion of 2,000 steps off by 4e-5, 1000 by 3e-9, 2000 are at round-off; with the ten followers of two hands on
a humanoid 200 leave one of 350 steps off by 9e-7, 2000 are at round-off (measured)."""


def rows_act_on_each_other(world: World) -> bool:
    """Whether a row of a constraint changes what another one wants: of a loop, or of two followers in trees that move
    together."""
    if any(constraint.kind != "follow" for constraint in world.constraints):
        return True
    followers = {constraint.joint for constraint in world.constraints if constraint.kind == "follow"}
    return any(sum(body.joint.name in followers for body in bodies) > 1 for bodies in constrained_trees(world))


SETTINGS: Mapping[str, Setting] = {
    "iterations": Setting(
        200,
        "Sweeps of the constraint solver in a step. PyBullet's own 50 leaves boxes creeping below the friction limit "
        "at up to 6e-4 m/s; 200 with residual_threshold 0 leaves 1e-19. Nothing creeps where nothing has friction. "
        "Worlds with closed loops (connect, weld), or with several joints of bodies that move together that follow "
        "others, have 2000 unless the spec says how many.",
        minimum=1,
        group=Group.ACCURACY,
        finer=2000,
        frictionless=50,
    ),
    "residual_threshold": Setting(
        0.0,
        "The solver stops early below this residual; 0: never, so that all steps are solved alike. Above 1e-15 a body at "
        "rest is tilted by what is left, loses a point of contact, falls for a step, and trembles at up to g dt "
        "(measured): a contact_processing_threshold of 1e-6 keeps the points, and the rest is then as quiet as with 0. A "
        "ball without friction is not tilted. At 1e-3 a box rests 0.8 mm deep, not 0.07 (measured).",
        minimum=0.0,
        maximum=1e-3,
        group=Group.ACCURACY,
        finer=0.0,
        frictionless=1e-7,
    ),
    "contact_erp": Setting(
        0.01,
        "Share of an overlap of two bodies that is taken back in each step; 0.01 is what all core engines can do.",
        minimum=0.0,
        maximum=1.0,
        group=Group.ERROR_REDUCTION,
    ),
    "friction_erp": Setting(
        0.0,
        "Share of a slip that friction takes back by position in each step (Bullet's frictionERP, with frictionAnchor, "
        "which PyBullet takes for base links only (measured)); 0: none, friction at the velocity level alone, as the law "
        "has it. What is carried slips by a little in every step, and the anchor takes that back: at 16 ms a stack of "
        "cylinders ends 1 mm off, not 10 (measured).",
        minimum=0.0,
        maximum=1.0,
        group=Group.FRICTION,
    ),
    "joint_erp": Setting(
        0.01,
        "Share of a passed joint limit that is taken back in each step. The speed gained by that stays, so that a stop "
        "rebounds by as much (measured); PyBullet's own 0.2 would make 20 %.",
        minimum=0.0,
        maximum=1.0,
        group=Group.JOINTS,
    ),
    "contact_slop": Setting(
        0.0,
        "Overlap that is tolerated (m); 0: none is left at rest. What rests is as deep as that.",
        minimum=0.0,
        at_most=of_thinnest(SHARE),
        depth=True,
        group=Group.ERROR_REDUCTION,
    ),
    "contact_processing_threshold": Setting(
        0.0,
        "Contacts with a gap below this are solved (m). PyBullet's own (speculative) contact kills restitution: asked "
        "1, got 0.005. 0: touching bodies only. PyBullet takes it for base links only (measured); two other links bounce "
        "off each other as they should all the same.",
        minimum=0.0,
        maximum=1e30,  # PyBullet's own: no bound
        group=Group.GEOMETRY,
    ),
    "contact_breaking_threshold": Setting(
        0.02,
        "Contact points are kept up to this gap (m); PyBullet's default. What does not touch is looked at in every step: "
        "216 spheres, 10 mm apart at first, take 1.04 times as long as with 2 mm (measured). Points that are kept for longer "
        "are solved at places where nothing touches any more: at 1 m a bounce is 0.8 mm off, at 1 km 1.3 mm (measured).",
        minimum=0.0,
        maximum=1.0,
        frictionless=0.002,
        group=Group.GEOMETRY,
    ),
    "collision_margin": Setting(
        0.0,
        "Added around convex shapes (m); PyBullet's own 0.001 makes meshes bigger. PyBullet takes it for base links only "
        "(measured); on other links 0.001 stays, which leaves faces and radii exact and rounds edges by 1 mm.",
        minimum=0.0,
        at_most=of_thinnest(COARSE),
        depth=True,
        group=Group.GEOMETRY,
    ),
    "sleeping": Setting(
        False,
        "Take free rigid bodies that rest (below 1 mm/s for PyBullet's 2 s) out of the simulation until something moving "
        "touches them.",
        only_with="sleeping",
        group=Group.SLEEPING,
    ),
    "deterministic_pairs": Setting(
        True,
        "Sort the pairs of bodies before solving, so that a run does not depend on what was there before.",
        group=Group.ORDER,
    ),
}
