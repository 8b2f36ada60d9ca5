"""How a world is said to MuJoCo in MJCF, with nothing left to MuJoCo's defaults."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, Final

from simspec.control.reference import natives
from simspec.dialects.kit.contract import Dialect, Lowered, NeededSetting
from simspec.dialects.kit.sidecar import Sidecar, Target, common_fields
from simspec.dialects.mujoco.contact import (
    check_friction,
    check_laws,
    contact_reference,
    default_classes,
    dry_reference,
    equality_reference,
    explicit_pairs,
    friction_hardness,
    joint_references,
    limit_reference,
    pair_defaults,
)
from simspec.dialects.mujoco.sidecar import (
    ACTUATOR,
    COMPILER,
    FLAGS,
    GEOM_DEFAULTS,
    INTEGRATORS,
    JOINT_DEFAULTS,
    KEYFRAME,
    MATERIAL_CLASS,
    NO_RATING,
    OPTION,
    SETTINGS,
    SIZE,
    SOLVERS,
    VISUAL_CLASS,
    MujocoSidecar,
)
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.contract import recentre_free_roots
from simspec.formats.mjcf import tree
from simspec.formats.mjcf.bodies import (
    CONES,
    DEFAULT_COLOUR,
    FRAME_SITE,
    GRAVCOMP,
    GROUPS,
    KINDS,
    SINGLE_NUMBER,
    BodyRow,
    body_of,
    carrier_frames,
    depth_first,
    equalities,
    file_name,
    fluid_options,
    frame_sites,
    geom_of,
    heightfields_of,
    joint_attributes,
    keyframe,
    meshes_of,
    no_more_than_its_weight,
    single_number,
    sites_of,
    tendons,
)
from simspec.formats.mjcf.reading import MjcfDocument
from simspec.formats.mjcf.tree import (
    Attributes,
    Kind,
    MjcfBody,
    MjcfDefault,
    MjcfExclude,
    MjcfGeom,
    MjcfInertial,
    MjcfModel,
    MjcfSite,
    Value,
    arena_megabytes,
    collision_masks,
)
from simspec.support import classes, features
from simspec.support.declarations import (
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
from simspec.world import frames
from simspec.world.armature import as_inertia
from simspec.world.constraints import anchors
from simspec.world.contact_pairs import excluded_pairs
from simspec.world.inertia import least_moment, rigid_members
from simspec.world.kinematics import absorbed, free_rigid, rigid_groups
from simspec.world.types import Joint, Pose, Quaternion, ReadBack, Shape, Surface, World

# Frames of one body that MuJoCo takes for one though they are two, written with other axes that mean the same.
#
# MuJoCo does not compute the pose of an inertial frame, a geom or a site that is as its body's frame, or, of geoms, as the
# inertial frame, and compares with a tolerance of 1e-6 (m, and of a quaternion's components). A mass matrix is then wrong by
# up to 1e-6 of itself (measured: 1.3e-8 in a humanoid that was stored in single precision). It does so only where the axes are
# near to each other. So where frames are near and not equal, principal axes are named in another order, shapes turned by half
# a turn that leaves them as they are, and both sites of a constraint turned alike.

NEAR: Final = 2e-6
"""Frames whose positions (m) and quaternions differ by less are taken for one; MuJoCo's own bound is half of it."""
SAME: Final = 1e-12
"""Frames that differ by less are one to the precision of the proof."""
CYCLE: Final[Quaternion] = (0.5, 0.5, 0.5, 0.5)
"""The turn that brings x to y, y to z and z to x."""
HALF_TURNS: Final[tuple[Quaternion, ...]] = ((0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))
TURNS: Final[Mapping[str, tuple[Quaternion, ...]]] = {
    **dict.fromkeys(("sphere", "box", "cylinder", "capsule", "ellipsoid"), HALF_TURNS),
    "plane": HALF_TURNS[:1],
}
"""Turns about its own axes that leave a geom as it is, by its type; a mesh has none."""


def are_confused(frame: Pose, other: Pose) -> bool:
    """Whether MuJoCo takes two frames, or their axes, for one though they are two."""
    axes = min(
        max(abs(a - sign * b) for a, b in zip(frame.quaternion, other.quaternion, strict=True)) for sign in (1.0, -1.0)
    )
    away = max(abs(a - b) for a, b in zip(frame.position, other.position, strict=True))
    return axes < NEAR and (axes > SAME or SAME < away < NEAR)


def with_distinct_frames(body: MjcfBody) -> MjcfBody:
    """The body, with an inertial frame and geoms that MuJoCo does not take for what they are not."""
    inertial = body.inertial and _inertial(body.inertial)
    others = [Pose()] if inertial is None else [Pose(), Pose(inertial.position, inertial.orientation)]
    geoms = tuple(_geom(geom, others) for geom in body.geoms)
    return dataclasses.replace(body, inertial=inertial, geoms=geoms)


def _inertial(inertial: MjcfInertial) -> MjcfInertial:
    if not are_confused(Pose(inertial.position, inertial.orientation), Pose()):
        return inertial
    x, y, z = inertial.moments
    turn = frames.multiply(inertial.orientation, CYCLE)
    return dataclasses.replace(inertial, orientation=turn, moments=(y, z, x))


def _geom(geom: MjcfGeom, others: Sequence[Pose]) -> MjcfGeom:
    orientations = [geom.orientation]
    orientations += [frames.multiply(geom.orientation, turn) for turn in TURNS.get(geom.type, ())]
    for orientation in orientations:
        if not any(are_confused(Pose(geom.position, orientation), other) for other in others):
            return dataclasses.replace(geom, orientation=orientation)
    return geom


def distinct_sites(sites: Mapping[str, tuple[MjcfSite, ...]]) -> dict[str, tuple[MjcfSite, ...]]:
    """The sites of bodies, in pairs of which each constraint holds the frames together."""
    pair = {site.name: site.name.rpartition("/")[0] for actual in sites.values() for site in actual}
    turned = {
        pair[site.name]
        for actual in sites.values()
        for site in actual
        if are_confused(Pose(site.position, site.orientation), Pose())
    }
    return {
        body: tuple(
            dataclasses.replace(site, orientation=frames.multiply(site.orientation, CYCLE))
            if pair[site.name] in turned
            else site
            for site in actual
        )
        for body, actual in sites.items()
    }


# Bodies as MJCF has them for MuJoCo: depth first, joints with their numbers, shapes of the classes of their materials.


def lower_body(
    row: BodyRow, masks: Mapping[Kind, Attributes], restless: bool, sites: tuple[tree.MjcfSite, ...] = ()
) -> tree.MjcfBody:
    """One body; ``masks`` by kind of shape, ``restless``: it must never fall asleep."""
    body = row.body
    geoms = tuple(_geom_element(shape, masks.get((body.collision_group, shape.material), ())) for shape in body.shapes)
    joints = tuple(_joint(joint, frame) for joint, frame in row.joints)
    return with_distinct_frames(body_of(row, joints, geoms, (("sleep", "never"),) if restless else (), sites))


def _joint(joint: Joint, frame: Pose) -> tree.MjcfJoint:
    more = joint_attributes(joint, frame)
    ratings = (joint.velocity_limit, joint.effort_limit)
    if ratings != (None, None):
        more.append(("user", tuple(NO_RATING if rating is None else rating for rating in ratings)))
    return tree.MjcfJoint(joint.name, joint.kind, tuple(more))


def _geom_element(shape: Shape, mask: Attributes) -> tree.MjcfGeom:
    more: list[tuple[str, Value]] = []
    if shape.collision:
        more.extend(mask)
        if shape.margin:
            more.append(("margin", shape.margin))
        if any(shape.surface_velocity):
            more.append(("surfacevel", shape.surface_velocity))
    group = GROUPS[shape.collision, shape.visual]
    if group:
        more.append(("group", group))
    if shape.colour != DEFAULT_COLOUR:
        more.append(("rgba", shape.colour))
    class_name = MATERIAL_CLASS + shape.material if shape.collision else VISUAL_CLASS
    return geom_of(shape, class_name, tuple(more))


def actuators(world: World) -> Iterator[tree.MjcfActuator]:
    """A position actuator for each natively driven joint; without kp a velocity actuator."""
    for controller in natives(world):
        for name, kp, kd, limit in zip(
            controller.joints, controller.kp, controller.kd, controller.effort_limits, strict=True
        ):
            more: list[tuple[str, Value]] = [("kp", kp)] if kp else []
            more += [("kv", kd), *ACTUATOR, ("forcelimited", limit is not None)]
            if limit is not None:
                more.append(("forcerange", (-limit, limit)))
            yield tree.MjcfActuator("position" if kp else "velocity", name, name, tuple(more))


def restless_bodies(world: World) -> frozenset[str]:
    """The topmost moving body of each of MuJoCo's trees that must stay awake: all but single free bodies.

    An undriven joint may stand still for ten steps and go on (a pendulum where it turns), and efforts of zero do not
    keep a tree awake.
    """
    allowed, groups, inside = free_rigid(world), rigid_groups(world), absorbed(world)
    return frozenset(
        inside.get(body.name, body.name)
        for body in world.bodies
        if groups[body.name] == body.name != "world"
        and (body.joint.parent is None or groups[body.joint.parent] == "world")
        and body.joint.kind != "fixed"
        and body.name not in allowed
    )


RESTITUTION = (
    "MuJoCo's contact constraint has −e times the approach speed as its reference velocity, while gravity acts "
    "on. In impacts of several bodies the contacts act one after the other"
)
LEAST_INERTIA = 1e-15
"""kg and kg m²: less of a body on a joint, with nothing heavier fixed to it, is refused (mjMINVAL)."""


def heavy_enough(world: World) -> Refinement | None:
    """Not supported where a body moves that is lighter than MuJoCo takes."""
    for top, members in rigid_members(world.bodies).items():
        heavy = (min(body.inertial.mass, least_moment(body.inertial)) >= LEAST_INERTIA for body, _ in members)
        if top not in absorbed(world) and not any(heavy):
            return unsupported_if(
                f"the inertia of {top!r} is below {LEAST_INERTIA:g} kg or kg m², which MuJoCo rejects"
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
    Pairs of materials that no values of shapes can express are explicit pairs always, or refused.
    """

    NAME: ClassVar[str] = "mujoco"
    FORMAT: ClassVar[str] = "mjcf"
    SIDECAR: ClassVar[type[Sidecar]] = MujocoSidecar
    SETTINGS: ClassVar[Mapping[str, NeededSetting]] = SETTINGS
    SUPPORT: ClassVar[Table] = {
        **exactly(
            *(*features.JOINTS, Feature.LIMIT_POSITION, Feature.BALL_LIMIT, *features.DAMPERS_AND_SPRINGS),
            *(Feature.DRY_FRICTION, Feature.ARMATURE, Feature.BALL_ARMATURE, *features.INITIAL_STATE),
            *(Feature.KINEMATIC, *features.LARGE_TREES, *features.SHAPES_OF_BODIES, *features.MARGINS),
            *(Feature.SURFACE_VELOCITY, *features.FRICTIONS, Feature.RESTITUTION_PAIRS),
            *(Feature.RESTITUTION_THRESHOLD, *features.HARDNESSES, *features.FILTERS, Feature.IMPACT_FRICTION),
            *(*features.COUPLED_CONTACT, Feature.CONE_ELLIPTIC, Feature.CONE_PYRAMID_INSCRIBED, Feature.FORCES),
            *(*features.CONTROLS, *features.PHYSICS, Feature.FLUID, *features.CONSTRAINTS, *features.SUMS),
        ),
        **shape_kinds("MuJoCo", KINDS),
        Feature.INERTIA: exact(
            f"MuJoCo rejects moving bodies below {LEAST_INERTIA:g} kg or kg m²", refine=heavy_enough
        ),
        Feature.INERTIA_FULL: exact("simspec writes principal moments with an orientation"),
        **for_each(exact("simspec writes the rating into the joint's user data"), *features.LIMIT_RATINGS),
        Feature.RESTITUTION: approximate(
            RESTITUTION,
            short="a bounce is a reference velocity of the contact, not an impulse",
        ),
        Feature.GRAVITY_SCALE: exact(GRAVCOMP, refine=no_more_than_its_weight),
        Feature.DAMPING_IMPLICIT: exact(classes.AS_ARMATURE),
        Feature.FREE_DAMPING: exact(SINGLE_NUMBER, refine=functools.partial(single_number, "damping")),
        Feature.FREE_ARMATURE: exact(
            f"{SINGLE_NUMBER}; simspec adds a difference to the inertia of the body, without the weight of the added mass"
        ),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: never("MuJoCo has the elliptic cone and the inscribed pyramid only"),
        **classes.LUMPED,
        Feature.JOINT_SEVERAL: exact("simspec writes several joints of one MuJoCo body, which act in sequence"),
        Feature.FRAME: exact(FRAME_SITE),
    }

    def received(self, world: World) -> World:
        return as_inertia(world, True)

    def lower(self, world: World, target: Target) -> Lowered:
        """``world`` as a Model (``formats/mjcf/tree.py``) and a :class:`MujocoSidecar`. Raises UnsupportedError for what this
        world cannot have in MJCF."""
        _check(world, target)
        moved, offsets = recentre_free_roots(world)
        order = depth_first(moved)
        masks, group_excludes = collision_masks(moved)
        pairs, all_pairs = explicit_pairs(moved, target)
        restless = restless_bodies(world) if _sleeping(target) else frozenset()
        sites, named = distinct_sites(sites_of(world, offsets, anchors(world))), frame_sites(world, offsets)
        model = MjcfModel(
            world.name,
            COMPILER,
            _option(world, target),
            (*({**dict(FLAGS), "eulerdamp": _integrator(target) == "euler"}.items()), *_flag_settings(target)),
            _size(world, target),
            MjcfDefault(
                elements=(
                    ("joint", (*JOINT_DEFAULTS, *joint_references(world, target))),
                    ("geom", (*GEOM_DEFAULTS, *contact_reference(world, target, Surface()))),
                    ("pair", pair_defaults(world, target)),
                )
            ),
            default_classes(world, target),
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
                **common_fields(self.NAME, self.FORMAT, world, in_force, offsets, alongside=False),
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
            code="E104",
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
            code="E104",
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
        *({**dict(OPTION), "integrator": INTEGRATORS[_integrator(target)], **dict(fluid_options(world))}.items()),
        ("ccd_tolerance", float(settings["ccd_tolerance"])),
    )


def _size(world: World, target: Target) -> Attributes:
    given = int(target.settings.get("arena", 0))  # not there when off
    megabytes = given or arena_megabytes(world, target.settings["solver"] == "newton")
    return SIZE if megabytes is None else (*SIZE, ("memory", f"{megabytes}M"))


def _flag_settings(target: Target) -> tuple[tuple[str, bool], ...]:
    # nothing sleeps where groups of touching bodies are not solved separately (measured)
    on = {**target.settings, "sleep": _sleeping(target), "island": target.settings["island"] or _sleeping(target)}
    names = ("warmstart", "island", "multiccd", *(("sleep",) if _sleeping(target) else ()))
    return tuple((name, bool(on[name])) for name in names)


def _in_force(world: World, target: Target) -> dict[str, bool | int | float | str]:
    """The settings as they act: impratio is one number for the world, and which one follows from its laws."""
    settings = {**target.settings, "impratio": friction_hardness(world, target)}
    if _sleeping(target):
        settings["island"] = True
    return settings


def _integrator(target: Target) -> str:
    return str(target.settings.get("integrator", "common"))  # not there where it is the common one


def _sleeping(target: Target) -> bool:
    return bool(target.settings.get("sleeping", False))  # not there when off
