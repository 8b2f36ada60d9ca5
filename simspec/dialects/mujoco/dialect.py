"""MJCF, MuJoCo's own language: one ``model.xml``, with nothing left to MuJoCo's defaults.

What is a choice and not the world's is data at the top of this file, each row with its reason. Everything that all joints,
shapes or explicit pairs share stands once in the file's ``<default>``; a shape's surface stands in the class of its material.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from simspec.control.native import natives
from simspec.dialects.kit.contract import Dialect
from simspec.dialects.kit.sidecar import SIDECAR, sidecar, sidecar_text
from simspec.dialects.kit.target import Target
from simspec.dialects.mujoco.contact import (
    MATERIAL_CLASS,
    VISUAL_CLASS,
    check_friction,
    check_laws,
    classes,
    contact_reference,
    explicit_pairs,
    friction_hardness,
    joint_references,
    pair_defaults,
)
from simspec.dialects.mujoco.filter import Attributes, Kind, collision_masks
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.passes import excluded_pairs_to_write, principal_axes, recentre_free_roots
from simspec.formats.kit.text import environment, number, numbers
from simspec.support.declarations import EXACT, Level, Support, Table, approximate, never
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.kinematics import free_rigid, rigid_groups
from simspec.world.types import Body, Joint, Pose, ReadBack, Shape, Surface, World

MODEL = "model.xml"
KEYFRAME = "initial"
"""The keyframe that holds the world's initial state."""

COMPILER: Attributes = (
    ("angle", "radian"),
    ("autolimits", "false"),  # a limit holds where ``limited`` says so, not where a range happens to stand
    ("inertiafromgeom", "false"),  # mass properties are the world's, never made from shapes
    ("balanceinertia", "false"),  # no silent repair of an inertia
    ("boundmass", "0"),
    ("boundinertia", "0"),
    ("settotalmass", "-1"),
    ("alignfree", "false"),  # a free body's frame is not moved into its principal axes
    ("discardvisual", "false"),
    ("fusestatic", "false"),  # bodies joined rigidly stay bodies
    ("usethread", "false"),
)
FLAGS: Attributes = (
    ("constraint", "enable"),
    ("equality", "enable"),
    ("frictionloss", "enable"),
    ("limit", "enable"),
    ("contact", "enable"),
    ("spring", "enable"),
    ("damper", "enable"),
    ("gravity", "enable"),
    ("clampctrl", "enable"),
    ("filterparent", "disable"),  # which bodies touch is said pair by pair, equally in every engine
    ("actuation", "enable"),
    ("refsafe", "enable"),
    ("sensor", "enable"),
    ("midphase", "enable"),
    ("eulerdamp", "disable"),  # damping is explicit in time: −d v with the velocity before the step
    ("autoreset", "disable"),  # a state that is not finite is a result, not a reason to begin again
    ("nativeccd", "enable"),
    ("override", "disable"),
    ("energy", "disable"),
    ("fwdinv", "disable"),
    ("invdiscrete", "disable"),
)
"""Flags that every supported version knows; ``warmstart``, ``island`` and ``multiccd`` are settings. Newer versions have
further flags, all off unless asked for (``sleep``, by ``sleeping``); the engine's module checks them after loading."""
OPTION: Attributes = (
    ("integrator", "Euler"),  # semi-implicit: what all engines do
    ("jacobian", "auto"),
    ("density", "0"),
    ("viscosity", "0"),
    ("wind", "0 0 0"),
    ("magnetic", "0 0 0"),
    ("noslip_tolerance", "1e-06"),
    ("ccd_iterations", "50"),
    ("ccd_tolerance", "1e-06"),
)
SIZE: Attributes = (("nuser_jnt", "2"),)
"""``user`` of a joint: its velocity and its effort rating, ``NO_RATING`` for none. Neither is enforced; MJCF's own
``actuatorfrcrange`` would be, on actuators only."""
NO_RATING = -1.0
JOINT_DEFAULTS: Attributes = (
    ("pos", "0 0 0"),
    ("ref", "0"),
    ("limited", "false"),
    ("margin", "0"),
    ("actuatorfrclimited", "false"),
    ("actuatorgravcomp", "false"),
    ("damping", "0"),
    ("frictionloss", "0"),
    ("armature", "0"),
    ("stiffness", "0"),
    ("springref", "0"),
    ("user", f"{number(NO_RATING)} {number(NO_RATING)}"),
)
GEOM_DEFAULTS: Attributes = (
    ("group", "0"),
    ("contype", "1"),
    ("conaffinity", "1"),
    ("condim", "1"),
    ("friction", "0 0 0"),
    ("priority", "0"),  # equal priorities: the larger friction holds
    ("solmix", "1"),
    ("margin", "0"),
    ("gap", "0"),
    ("mass", "0"),
    ("rgba", "0.7 0.7 0.7 1"),
)
ACTUATOR: Attributes = (
    ("ctrllimited", "false"),
    ("gear", "1 0 0 0 0 0"),  # gains are on the joint's side
)
"""Of position and velocity actuators, the engine's own controllers (law ``native``)."""
DEFAULT_COLOUR = (0.7, 0.7, 0.7, 1.0)

CONES = {"elliptic": "elliptic", "pyramid-inscribed": "pyramidal"}
"""MuJoCo's word for each cone; its pyramid is the inscribed one (measured: 0.355 at 45° for μ = 0.5)."""
GROUPS = {(True, True): 0, (False, True): 2, (True, False): 3, (False, False): 4}
"""Geom group of (collision, visual): viewers show 0 to 2 and hide the rest; MuJoCo itself gives groups no meaning."""
SIZES = {
    "sphere": (1.0,),
    "box": (0.5, 0.5, 0.5),
    "cylinder": (1.0, 0.5),
    "capsule": (1.0, 0.5),
    "ellipsoid": (1.0, 1.0, 1.0),
}
"""What each number of ``Shape.size`` is multiplied with: MuJoCo wants half lengths."""
PLANE_SIZE = "0 0 1"
"""Infinite in x and y; the third number is the spacing of a viewer's grid."""
RESERVED = {"world": "world."}
"""MuJoCo calls its static root ``world``; a body of that name gets one that no spec can give."""
DEEPEST_INDENT = 24
"""Levels that are indented; deeper ones stay there, so that a chain's text grows with its length, not its square."""


class MujocoDialect(Dialect):
    """MJCF files for MuJoCo.

    Contact. The common law of every pair: in one step the normal velocity v becomes −e v + β r / dt (e restitution, r overlap,
    β ``contact_error_reduction``), written as ``solref="-β/dt² -(1+e)/dt"``; with e = 0 DART does the same by itself. MuJoCo
    takes the smaller number of each pair, so the larger restitution holds. Compliant contact is the same constraint with
    an impedance near zero, native contact MuJoCo's own numbers (``mjcf_contact.HARDNESS``).

    Friction. A shape's reference acts on the slip as on the normal velocity: it would bounce sideways and, MuJoCo's cone
    being associated, throw sliding bodies up. Explicit pairs have a reference of their own for friction (which MuJoCo
    obeys under the elliptic cone only), so every two shapes that may touch with friction are listed. A world with more than
    ``explicit_pairs_limit`` of them gets none and says so (sidecar ``explicit_pairs: false``, and the engine's log).
    Pairs of materials that no numbers of shapes can give are explicit pairs always, or refused.
    """

    NAME: ClassVar[str] = "mujoco"
    FORMAT: ClassVar[str] = "mjcf"
    SUPPORT: ClassVar[Table] = dict.fromkeys(Feature, EXACT) | {
        Feature.INERTIA_FULL: Support(Level.EXACT, "as principal moments with an orientation"),
        Feature.LIMIT_VELOCITY: Support(Level.EXACT, "as user data of the joint"),
        Feature.LIMIT_EFFORT: Support(Level.EXACT, "as user data of the joint"),
        Feature.CONTROL_NATIVE: Support(Level.EXACT, "position and velocity actuators in the file"),
        Feature.RESTITUTION: approximate(
            "a reference velocity of the contact constraint, −e times the approach speed",
            short="a bounce is a reference velocity of the contact, not an impulse",
        ),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: never("MuJoCo has the elliptic cone and the inscribed pyramid only"),
    }

    def emit(self, world: World, target: Target) -> dict[str, str]:
        """``model.xml`` and ``sidecar.json``. Raises UnsupportedError for what this world cannot have in MJCF."""
        _check(world, target)
        moved, offsets = recentre_free_roots(world)
        order = depth_first(moved)
        masks, group_excludes = collision_masks(moved)
        pairs, all_pairs = explicit_pairs(moved, target)
        content = {
            "name": world.name,
            "compiler": COMPILER,
            "flags": (*FLAGS, *_flag_settings(target)),
            "option": _option(world, target),
            "size": SIZE,
            "joint_defaults": (*JOINT_DEFAULTS, *joint_references(world, target)),
            "geom_defaults": (*GEOM_DEFAULTS, *contact_reference(world, target, Surface())),
            "pair_defaults": pair_defaults(world, target),
            "classes": classes(world, target),
            "events": _events(order, masks, _restless(world) if _sleeping(target) else frozenset()),
            "pairs": pairs,
            "actuators": _actuators(world),
            "excludes": [
                (file_name(a), file_name(b)) for a, b in sorted({*excluded_pairs_to_write(moved), *group_excludes})
            ],
            "qpos": numbers(value for body, *_ in order for value in body.joint.position),
            "qvel": numbers(value for body, *_ in order for value in _joint_velocity(body.joint)),
        }
        # the settings in force: impratio is one number for the world, and which one follows from its laws
        in_force = {**target.settings, "impratio": friction_hardness(world, target)}
        if _sleeping(target):
            in_force["island"] = True
        beside = sidecar(
            self.FORMAT,
            world,
            dataclasses.replace(target, settings=in_force),
            offsets,
            explicit_pairs=all_pairs,
            models=[body.model for body in world.bodies],
            # MJCF has no element for a rigid joint, so its name has no place there
            fixed_joints={body.name: body.joint.name for body in world.bodies if body.joint.kind == "fixed"},
        )
        return {
            MODEL: environment().get_template("mjcf/model.xml.j2").render(content),
            SIDECAR: sidecar_text(beside),
        }

    def read(self, folder: Path) -> ReadBack:
        """Read ``model.xml`` with the standard library's XML parser (see ``dialects/mujoco/reading.py``)."""
        from simspec.dialects.mujoco.reading import read_folder

        return read_folder(folder)


def file_name(name: str) -> str:
    """The name of a body in the file."""
    return RESERVED.get(name, name)


def world_name(name: str) -> str:
    """The inverse of :func:`file_name`."""
    return {there: here for here, there in RESERVED.items()}.get(name, name)


def _check(world: World, target: Target) -> None:
    problems = [
        Problem(
            "MuJoCo has no hinge or slide whose lower and upper position limits are equal",
            f"bodies.{body.name}.joint.limits.position",
            found=f"{body.joint.position_limits}",
            hint="make the joint fixed",
        )
        for body in world.bodies
        if body.joint.position_limits is not None and body.joint.position_limits[0] >= body.joint.position_limits[1]
    ]
    problems.extend(
        Problem(
            "MuJoCo has no actuator whose largest effort is zero",
            f"control.{one.name}.effort_limit",
            found=joint,
            hint="leave the joint out of the controller, or give it an effort limit above zero",
        )
        for one in natives(world)
        for joint, limit in zip(one.joints, one.effort_limits, strict=True)
        if limit == 0.0
    )
    problems.extend(check_laws(world))
    problems.extend(check_friction(target))
    if problems:
        raise UnsupportedError(problems)


def depth_first(world: World) -> list[tuple[Body, int, int]]:
    """The bodies in the order of the file, each with its depth and how many levels close after it."""
    children: dict[str | None, list[Body]] = {}
    for body in world.bodies:
        children.setdefault(body.joint.parent, []).append(body)
    found: list[tuple[Body, int]] = []
    waiting = [(body, 0) for body in reversed(children.get(None, []))]
    while waiting:
        body, depth = waiting.pop()
        found.append((body, depth))
        waiting.extend((child, depth + 1) for child in reversed(children.get(body.name, [])))
    following = [depth for _, depth in found[1:]] + [0]
    return [(body, depth, depth + 1 - after) for (body, depth), after in zip(found, following, strict=True)]


def _events(
    order: list[tuple[Body, int, int]], masks: Mapping[Kind, Attributes], restless: frozenset[str]
) -> Iterator[tuple[str, Any]]:
    """Opening and closing of bodies, in the order of the file: (indent, body row), or (indent, None) to close."""
    indents = [" " * (4 + 2 * depth) for depth in range(DEEPEST_INDENT)]
    for body, depth, closing in order:
        yield indents[min(depth, DEEPEST_INDENT - 1)], {**_body(body, masks), "restless": body.name in restless}
        for level in range(depth, depth - closing, -1):
            yield indents[min(level, DEEPEST_INDENT - 1)], None


def _body(body: Body, masks: Mapping[Kind, Attributes]) -> dict[str, Any]:
    joint = body.joint
    place = Pose(joint.position[:3], joint.position[3:7]) if joint.kind == "free" else joint.origin
    inertial = None
    if body.inertial.mass > 0.0:
        moments, turn = principal_axes(body.inertial.inertia)
        inertial = {
            "pos": numbers(body.inertial.centre_of_mass),
            "quat": numbers(turn),
            "mass": number(body.inertial.mass),
            "diaginertia": numbers(moments),
        }
    return {
        "name": file_name(body.name),
        "pos": numbers(place.position),
        "quat": numbers(place.quaternion),
        "inertial": inertial,
        "joint": None if joint.kind == "fixed" else _joint(joint),
        "geoms": [_geom(shape, masks.get((body.collision_group, shape.material), ())) for shape in body.shapes],
    }


def _joint(joint: Joint) -> dict[str, Any]:
    more: list[tuple[str, str]] = []
    if joint.kind in ("hinge", "slide"):
        more.append(("axis", numbers(joint.axis)))
    if joint.position_limits is not None:
        more += [("limited", "true"), ("range", numbers(joint.position_limits))]
    for name, value in (
        ("damping", joint.damping),
        ("frictionloss", joint.dry_friction),
        ("armature", joint.armature),
        ("stiffness", joint.spring_stiffness),
        ("springref", joint.spring_rest),
    ):
        if value:
            more.append((name, number(value)))
    ratings = (joint.velocity_limit, joint.effort_limit)
    if ratings != (None, None):
        more.append(("user", numbers(NO_RATING if rating is None else rating for rating in ratings)))
    return {"name": joint.name, "type": joint.kind, "more": more}


def _actuators(world: World) -> list[dict[str, Any]]:
    """A position actuator for each natively driven joint; without kp a velocity actuator."""
    found = []
    for controller in natives(world):
        for name, kp, kd, limit in zip(
            controller.joints, controller.kp, controller.kd, controller.effort_limits, strict=True
        ):
            more: list[tuple[str, str]] = [("kp", number(kp))] if kp else []
            more += [("kv", number(kd)), *ACTUATOR, ("forcelimited", "false" if limit is None else "true")]
            if limit is not None:
                more.append(("forcerange", numbers((-limit, limit))))
            found.append({"type": "position" if kp else "velocity", "name": name, "joint": name, "more": more})
    return found


def _geom(shape: Shape, mask: Attributes) -> dict[str, Any]:
    more: list[tuple[str, str]] = []
    if shape.collision:
        more.extend(mask)
    group = GROUPS[shape.collision, shape.visual]
    if group:
        more.append(("group", str(group)))
    if shape.colour != DEFAULT_COLOUR:
        more.append(("rgba", numbers(shape.colour)))
    size = PLANE_SIZE
    if shape.kind != "plane":
        size = numbers(value * factor for value, factor in zip(shape.size, SIZES[shape.kind], strict=True))
    return {
        "name": shape.name,
        "class": MATERIAL_CLASS + shape.material if shape.collision else VISUAL_CLASS,
        "type": shape.kind,
        "size": size,
        "pos": numbers(shape.pose.position),
        "quat": numbers(shape.pose.quaternion),
        "more": more,
    }


def _joint_velocity(joint: Joint) -> tuple[float, ...]:
    """MuJoCo's velocity of a joint: a free one turns about its own axes."""
    if joint.kind != "free":
        return joint.velocity
    return (*joint.velocity[:3], *frames.rotate(frames.conjugate(joint.position[3:7]), joint.velocity[3:]))


# --- options ------------------------------------------------------------------------------------------------------


def _option(world: World, target: Target) -> Attributes:
    settings = target.settings
    return (
        ("timestep", number(world.physics.timestep)),
        ("gravity", numbers(world.physics.gravity)),
        ("cone", CONES[world.contact.friction_cone]),
        ("solver", {"newton": "Newton", "cg": "CG", "pgs": "PGS"}[str(settings["solver"])]),
        *((name, str(settings[name])) for name in ("iterations", "ls_iterations", "noslip_iterations")),
        *((name, number(float(settings[name]))) for name in ("tolerance", "ls_tolerance")),
        ("impratio", number(friction_hardness(world, target))),
        *((("sleep_tolerance", number(float(settings["sleep_tolerance"]))),) if _sleeping(target) else ()),
        *OPTION,
    )


def _flag_settings(target: Target) -> Attributes:
    # nothing sleeps where groups of touching bodies are not solved apart (measured)
    on = {**target.settings, "sleep": _sleeping(target), "island": target.settings["island"] or _sleeping(target)}
    names = ("warmstart", "island", "multiccd", *(("sleep",) if _sleeping(target) else ()))
    return tuple((name, "enable" if on[name] else "disable") for name in names)


def _sleeping(target: Target) -> bool:
    return bool(target.settings.get("sleeping", False))  # not there when off


def _restless(world: World) -> frozenset[str]:
    """The topmost moving body of each of MuJoCo's trees that must stay awake: all but single free bodies.

    A joint that nobody drives may stand still for ten steps and go on (a pendulum where it turns), and efforts of zero do not
    keep a tree awake.
    """
    allowed, groups = free_rigid(world), rigid_groups(world)
    return frozenset(
        body.name
        for body in world.bodies
        if groups[body.name] == body.name != "world"
        and (body.joint.parent is None or groups[body.joint.parent] == "world")
        and body.joint.kind != "fixed"
        and body.name not in allowed
    )
