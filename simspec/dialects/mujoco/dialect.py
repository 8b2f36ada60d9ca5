"""How a world is said to MuJoCo in MJCF, with nothing left to MuJoCo's defaults."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import ClassVar

from simspec.control.native import natives
from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.settings import NeededSetting
from simspec.dialects.kit.sidecar import Sidecar, common_fields
from simspec.dialects.kit.target import Target
from simspec.dialects.mujoco.apart import sites_apart
from simspec.dialects.mujoco.bodies import actuators, lower_body, restless_bodies
from simspec.dialects.mujoco.choices import (
    COMPILER,
    FLAGS,
    GEOM_DEFAULTS,
    JOINT_DEFAULTS,
    OPTION,
    SETTINGS,
    SIZE,
    SOLVERS,
)
from simspec.dialects.mujoco.contact import (
    classes,
    contact_reference,
    dry_reference,
    equality_reference,
    explicit_pairs,
    friction_hardness,
    joint_references,
    limit_reference,
    pair_defaults,
)
from simspec.dialects.mujoco.contact_checks import check_friction, check_laws
from simspec.dialects.mujoco.names import KEYFRAME
from simspec.dialects.mujoco.sidecar import MujocoSidecar
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.contract import recentre_free_roots
from simspec.formats.mjcf.bodies import (
    CONES,
    KINDS,
    ONE_NUMBER,
    carrier_frames,
    depth_first,
    equalities,
    file_name,
    fluid_options,
    frame_sites,
    heightfields_of,
    keyframe,
    meshes_of,
    no_more_than_its_weight,
    one_number,
    sites_of,
    tendons,
)
from simspec.formats.mjcf.contact import arena_megabytes, collision_masks
from simspec.formats.mjcf.reading import MjcfDocument
from simspec.formats.mjcf.tree import Attributes, MjcfDefault, MjcfExclude, MjcfModel
from simspec.support.declarations import (
    LUMPED,
    Level,
    Refinement,
    Support,
    Table,
    approximate,
    exactly,
    for_each,
    never,
    shape_kinds,
    unsupported_if,
)
from simspec.support.features import COUPLED_CONTACT, Feature
from simspec.world.constraints import anchors
from simspec.world.contact_pairs import excluded_pairs
from simspec.world.inertia import least_moment, rigid_members
from simspec.world.kinematics import absorbed
from simspec.world.types import ReadBack, Surface, World

LEAST_INERTIA = 1e-15
"""kg and kg m²: less of a body on a joint, with nothing heavier fixed to it, is refused (mjMINVAL)."""


def heavy_enough(world: World) -> Refinement | None:
    """Not supported where a body moves that is lighter than MuJoCo takes."""
    for top, members in rigid_members(world.bodies).items():
        heavy = (min(body.inertial.mass, least_moment(body.inertial)) >= LEAST_INERTIA for body, _ in members)
        if top not in absorbed(world) and not any(heavy):
            return unsupported_if(
                f"the inertia of {top!r} is below {LEAST_INERTIA:g} kg or kg m², which MuJoCo refuses"
            )
    return None


class MujocoDialect(Dialect):
    """MJCF files for MuJoCo.

    Contact. The common law of every pair: in one step the normal velocity v becomes −e v + β r / dt (e restitution, r overlap,
    β ``contact_error_reduction``), written as ``solref="-β/dt² -(1+e)/dt"``; with e = 0 rigid contact does the same. MuJoCo
    takes the smaller number of each pair, so the larger restitution holds. Compliant contact is the same constraint with
    an impedance near zero, native contact MuJoCo's own numbers (``contact.HARDNESS``).

    Friction. A shape's reference acts on the slip as on the normal velocity: it would bounce sideways and, MuJoCo's cone
    being associated, throw sliding bodies up. Explicit pairs have a reference of their own for friction (which MuJoCo
    obeys under the elliptic cone only), so every two shapes that may touch with friction are listed. A world with more than
    ``explicit_pairs_limit`` of them gets none and says so (sidecar ``explicit_pairs: false``, and the engine's log).
    Pairs of materials that no numbers of shapes can give are explicit pairs always, or refused.
    """

    NAME: ClassVar[str] = "mujoco"
    FORMAT: ClassVar[str] = "mjcf"
    SIDECAR: ClassVar[type[Sidecar]] = MujocoSidecar
    SETTINGS: ClassVar[Mapping[str, NeededSetting]] = SETTINGS
    SUPPORT: ClassVar[Table] = {
        **exactly(
            *(Feature.JOINT_FIXED, Feature.JOINT_HINGE, Feature.JOINT_SLIDE, Feature.JOINT_BALL, Feature.JOINT_FREE),
            *(Feature.LIMIT_POSITION, Feature.BALL_LIMIT),
            *(
                Feature.DAMPING,
                Feature.BALL_DAMPING,
                Feature.DRY_FRICTION,
                Feature.ARMATURE,
                Feature.BALL_ARMATURE,
                Feature.SPRING,
                Feature.BALL_SPRING,
            ),
            *(Feature.INITIAL_POSITION, Feature.INITIAL_VELOCITY),
            *(Feature.TREE_SIZE, Feature.TREE_DEPTH),
            *(
                Feature.SHAPE_VISUAL,
                Feature.SHAPE_MARGIN,
                Feature.SURFACE_VELOCITY,
                Feature.SHAPES_PER_BODY,
                Feature.MATERIALS_PER_BODY,
            ),
            *(Feature.FRICTION, Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS, Feature.RESTITUTION_THRESHOLD),
            *(Feature.TORSIONAL_FRICTION, Feature.ROLLING_FRICTION, Feature.IMPACT_FRICTION),
            *COUPLED_CONTACT,
            *(Feature.HARDNESS_COMMON, Feature.HARDNESS_TIME_CONSTANT, Feature.HARDNESS_STIFFNESS),
            *(Feature.HARDNESS_NATIVE, Feature.HARDNESS_PAIRS, Feature.MARGIN_PAIRS),
            *(Feature.CONE_ELLIPTIC, Feature.CONE_PYRAMID_INSCRIBED),
            *(Feature.PASSING_PAIRS, Feature.COLLISION_GROUPS, Feature.EXCLUDED_PAIRS, Feature.TOUCHING_PAIRS),
            *(Feature.KINEMATIC, Feature.FORCES, Feature.CONTROL),
            *(Feature.GRAVITY, Feature.TIMESTEP, Feature.FLUID),
        ),
        **shape_kinds("MuJoCo", KINDS),
        Feature.INERTIA: Support(
            Level.EXACT,
            f"of moving bodies from {LEAST_INERTIA:g} kg and kg m² on: MuJoCo refuses less",
            refine=heavy_enough,
        ),
        Feature.INERTIA_FULL: Support(Level.EXACT, "as principal moments with an orientation"),
        Feature.LIMIT_VELOCITY: Support(Level.EXACT, "as user data of the joint"),
        Feature.LIMIT_EFFORT: Support(Level.EXACT, "as user data of the joint"),
        Feature.CONTROL_NATIVE: Support(Level.EXACT, "position and velocity actuators in the file"),
        Feature.RESTITUTION: approximate(
            "a reference velocity of the contact constraint, −e times the approach speed",
            short="a bounce is a reference velocity of the contact, not an impulse",
        ),
        Feature.GRAVITY_SCALE: Support(Level.EXACT, "gravcomp = 1 − scale, up to 1", refine=no_more_than_its_weight),
        Feature.FREE_DAMPING: Support(Level.EXACT, ONE_NUMBER, refine=functools.partial(one_number, "damping")),
        Feature.FREE_ARMATURE: Support(Level.EXACT, ONE_NUMBER, refine=functools.partial(one_number, "armature")),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: never("MuJoCo has the elliptic cone and the inscribed pyramid only"),
        **LUMPED,
        Feature.JOINT_SEVERAL: Support(Level.EXACT, "several joints of one MuJoCo body, which act one after the other"),
        Feature.CONSTRAINT_COUPLING: Support(Level.EXACT, "an equality of two joints"),
        Feature.CONSTRAINT_LOOP: Support(Level.EXACT, "an equality of two sites"),
        Feature.FRAME: Support(Level.EXACT, "a site"),
        **for_each(Support(Level.EXACT, "a fixed tendon"), Feature.SUM, Feature.SUM_LIMITS, Feature.SUM_DRY_FRICTION),
    }

    def lower(self, world: World, target: Target) -> Lowered:
        """``world`` as a Model (``formats/mjcf/tree.py``) and a :class:`MujocoSidecar`. Raises UnsupportedError for what this
        world cannot have in MJCF."""
        _check(world, target)
        moved, offsets = recentre_free_roots(world)
        order = depth_first(moved)
        masks, group_excludes = collision_masks(moved)
        pairs, all_pairs = explicit_pairs(moved, target)
        restless = restless_bodies(world) if _sleeping(target) else frozenset()
        sites, named = sites_apart(sites_of(world, offsets, anchors(world))), frame_sites(world, offsets)
        model = MjcfModel(
            world.name,
            COMPILER,
            _option(world, target),
            (*FLAGS, *_flag_settings(target)),
            _size(world, target),
            MjcfDefault(
                elements=(
                    ("joint", (*JOINT_DEFAULTS, *joint_references(world, target))),
                    ("geom", (*GEOM_DEFAULTS, *contact_reference(world, target, Surface()))),
                    ("pair", pair_defaults(world, target)),
                )
            ),
            classes(world, target),
            tuple(
                lower_body(
                    row,
                    masks,
                    row.body.name in restless,
                    (*sites.get(row.body.name, ()), *named.get(row.body.name, ())),
                )
                for row in order
            ),
            pairs,
            tuple(
                MjcfExclude(file_name(first), file_name(second))
                for first, second in sorted({*excluded_pairs(moved), *group_excludes})
            ),
            tuple(actuators(world)),
            (keyframe(KEYFRAME, order),),
            meshes_of(world),
            heightfields_of(world),
            equalities(world, equality_reference(world)),
            tendons(world, limit_reference(world, target), dry_reference(world, target)),
        )
        in_force = dataclasses.replace(target, settings=_in_force(world, target))
        return Lowered(
            model,
            MujocoSidecar(
                **common_fields(self.NAME, self.FORMAT, world, in_force, offsets, beside=False),
                explicit_pairs=all_pairs,
                models=tuple(body.model for body in world.bodies),
                fixed_joints={body.name: body.joint.name for body in world.bodies if body.joint.kind == "fixed"},
                carriers=carrier_frames(order, moved) or None,
            ),
        )

    def raise_(self, document: MjcfDocument, sidecar: MujocoSidecar) -> ReadBack:
        """The model that the document holds, or ValueError (see ``raising.py``)."""
        from simspec.dialects.mujoco.raising import raise_document

        return raise_document(document, sidecar)


def _check(world: World, target: Target) -> None:
    problems = [
        Problem(
            "MuJoCo does not support a hinge or slide with equal lower and upper position limits",
            f"bodies.{body.name}.joint.limits.position",
            found=f"{body.joint.position_limits}",
            hint="make the joint fixed",
        )
        for body in world.bodies
        if body.joint.position_limits is not None and body.joint.position_limits[0] >= body.joint.position_limits[1]
    ]
    problems.extend(
        Problem(
            "MuJoCo does not support an actuator with an effort limit of zero",
            f"control.{controller.name}.effort_limit",
            found=joint,
            hint="leave the joint out of the controller, or give it an effort limit above zero",
        )
        for controller in natives(world)
        for joint, limit in zip(controller.joints, controller.effort_limits, strict=True)
        if limit == 0.0
    )
    problems.extend(check_laws(world))
    problems.extend(check_friction(target))
    if problems:
        raise UnsupportedError(problems)


def _option(world: World, target: Target) -> Attributes:
    settings = target.settings
    return (
        ("timestep", world.physics.timestep),
        ("gravity", world.physics.gravity),
        ("cone", CONES[world.contact.friction_cone]),
        ("solver", SOLVERS[str(settings["solver"])]),
        *((name, int(settings[name])) for name in ("iterations", "ls_iterations", "noslip_iterations")),
        *((name, float(settings[name])) for name in ("tolerance", "ls_tolerance")),
        ("impratio", friction_hardness(world, target)),
        *((("sleep_tolerance", float(settings["sleep_tolerance"])),) if _sleeping(target) else ()),
        *({**dict(OPTION), **dict(fluid_options(world))}.items()),
        ("ccd_tolerance", float(settings["ccd_tolerance"])),
    )


def _size(world: World, target: Target) -> Attributes:
    given = int(target.settings.get("arena", 0))  # not there when off
    megabytes = given or arena_megabytes(world, target.settings["solver"] == "newton")
    return SIZE if megabytes is None else (*SIZE, ("memory", f"{megabytes}M"))


def _flag_settings(target: Target) -> tuple[tuple[str, bool], ...]:
    # nothing sleeps where groups of touching bodies are not solved apart (measured)
    on = {**target.settings, "sleep": _sleeping(target), "island": target.settings["island"] or _sleeping(target)}
    names = ("warmstart", "island", "multiccd", *(("sleep",) if _sleeping(target) else ()))
    return tuple((name, bool(on[name])) for name in names)


def _in_force(world: World, target: Target) -> dict[str, bool | int | float | str]:
    """The settings as they act: impratio is one number for the world, and which one follows from its laws."""
    settings = {**target.settings, "impratio": friction_hardness(world, target)}
    if _sleeping(target):
        settings["island"] = True
    return settings


def _sleeping(target: Target) -> bool:
    return bool(target.settings.get("sleeping", False))  # not there when off
