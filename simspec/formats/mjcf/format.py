"""The format ``mjcf``: one XML file, ``model.xml``."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

from simspec.control.reference import drives
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.contract import Format, Loss, LossFate, PlainFiles, losses
from simspec.formats.kit.mesh_reading import read_meshes
from simspec.formats.kit.text import environment, hulls_of, mesh_files
from simspec.formats.mjcf import tree
from simspec.formats.mjcf.bodies import (
    CONES,
    FRAME_SITE,
    GRAVCOMP,
    GROUPS,
    KINDS,
    SINGLE_NUMBER,
    BodyRow,
    body_of,
    depth_first,
    dimensions,
    equalities,
    file_name,
    fluid_options,
    frame_sites,
    geom_of,
    heightfields_of,
    joint_attributes,
    keyframe,
    margins_of,
    meshes_of,
    no_more_than_its_weight,
    single_number,
    sites_of,
    tendons,
)
from simspec.formats.mjcf.reading import MjcfDocument, read_document
from simspec.formats.mjcf.tree import (
    Attributes,
    Kind,
    MjcfBody,
    MjcfDefault,
    MjcfModel,
    Value,
    arena_megabytes,
    collision_masks,
)
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import Table, approximate, exact, exactly, for_each, never, shape_kinds
from simspec.support.features import Feature
from simspec.world import types
from simspec.world.contact_pairs import excluded_pairs, meeting_laws, shape_pairs, solid_shapes
from simspec.world.damping import implicitly_damped, without_implicit_damping
from simspec.world.inertia import gathered
from simspec.world.kinematics import absorbed, is_carrier
from simspec.world.types import Joint, Pair, PairContact, Pose, Shape, World

# Contact: a geom has the friction of its material; two geoms have the larger of both numbers and the mean of both time
# constants. Where two materials have another law, every two of their geoms that may touch are an explicit pair.

KEYFRAME: Final = "initial"
MOST_PAIRS: Final = 20_000
"""Explicit pairs in one file; a world with more has the rule of geoms for all, and a row in the list of losses."""
NATIVE_REFERENCE: Final = (0.02, 1.0)
"""The language's default of ``solref``: time constant (s) and damping ratio."""
VISUAL: Final = "visual"
MATERIAL: Final = "material/"

COMPILER: Final[Attributes] = (("angle", "radian"), ("autolimits", False))
UNLIMITED: Final = 1e9
"""The range (rad, m) of a hinge or a slide without limits, which is not ``limited``."""
MESH_FOLDER: Final[Attributes] = (("meshdir", "./"),)
"""Where a world has meshes: one reader finds no files without it."""
WITHOUT_MASS: Final[Attributes] = (("mass", 0.0),)
"""Of the geoms of a body without mass, which has no ``inertial``: readers differ in which inertials without mass they take."""
FLAGS: Final = (
    ("filterparent", False),  # which bodies do not touch is listed
    ("eulerdamp", False),  # damping is explicit in time
)

SUPPORT: Final[Table] = {
    **classes.file_language("MJCF"),
    **exactly(
        *(*features.DAMPERS_AND_SPRINGS, Feature.ARMATURE, Feature.BALL_ARMATURE, *features.MARGINS),
        *(Feature.SURFACE_VELOCITY, *features.FRICTIONS, Feature.HARDNESS_NATIVE, *features.FILTERS),
        *(Feature.IMPACT_FRICTION, *features.COUPLED_CONTACT, Feature.CONE_ELLIPTIC, Feature.CONE_PYRAMID_INSCRIBED),
        Feature.FLUID,
    ),
    **shape_kinds("MJCF", KINDS),
    Feature.INERTIA_FULL: exact("simspec writes principal moments with an orientation"),
    **for_each(exact(f"simspec writes the keyframe {KEYFRAME!r}"), *features.INITIAL_STATE),
    **for_each(
        approximate("simspec writes the range; its stop is a spring-damper with the default solreflimit"),
        Feature.LIMIT_POSITION,
        Feature.BALL_LIMIT,
    ),
    Feature.LIMIT_EFFORT: exact("simspec writes actuatorfrcrange, which limits actuators only"),
    Feature.LIMIT_VELOCITY: never("MJCF has no velocity ratings"),
    **for_each(
        approximate("simspec writes frictionloss, a soft constraint with the default solreffriction, which creeps"),
        Feature.DRY_FRICTION,
        Feature.SUM_DRY_FRICTION,
    ),
    **for_each(
        never("MJCF has no restitution, and the default solref is critically damped"),
        Feature.RESTITUTION,
        Feature.RESTITUTION_PAIRS,
    ),
    Feature.RESTITUTION_THRESHOLD: never("MJCF has no restitution threshold"),
    Feature.HARDNESS_COMMON: approximate("MJCF's contacts are spring-dampers with the default solref and solimp"),
    Feature.HARDNESS_TIME_CONSTANT: approximate(
        "solref has both numbers, but the default solimp takes 5 % to 10 % of the load off the spring"
    ),
    Feature.HARDNESS_STIFFNESS: approximate(
        "simspec writes the default solref: MJCF's stiffness is an acceleration, which depends on the masses "
        "of both bodies"
    ),
    Feature.HARDNESS_PAIRS: approximate(
        "simspec writes time constants by pair, and the default solref for all other kinds"
    ),
    Feature.CONE_PYRAMID_CIRCUMSCRIBED: approximate(
        "simspec writes the inscribed pyramid, with down to half the friction across an edge"
    ),
    Feature.GRAVITY_SCALE: exact(GRAVCOMP, refine=no_more_than_its_weight),
    Feature.DAMPING_IMPLICIT: exact("the flag eulerdamp, which also makes damping of free joints implicit"),
    Feature.FREE_DAMPING: exact(SINGLE_NUMBER, refine=functools.partial(single_number, "damping")),
    Feature.FREE_ARMATURE: exact(SINGLE_NUMBER, refine=functools.partial(single_number, "armature")),
    Feature.FORCES: never("MJCF has no forces with a beginning and an end"),
    Feature.CONTROL: approximate(
        "simspec writes actuators with the gains, effort limits and initial target of pd, and motors for laws "
        "without gains. Trajectories, gravity compensation, implicit laws and laws that act every few steps "
        "are lost"
    ),
    Feature.CONTROL_NATIVE: approximate(
        "simspec writes actuators with gains, effort limits and the initial target, without the trajectory"
    ),
    Feature.JOINT_SEVERAL: exact("simspec writes several joints of one body"),
    **classes.LUMPED,
    Feature.CONSTRAINT_COUPLING: approximate(
        "simspec writes an equality of two joints: a spring-damper with the default solref"
    ),
    Feature.CONSTRAINT_LOOP: approximate(
        "simspec writes an equality of two sites: a spring-damper with the default solref"
    ),
    Feature.FRAME: exact(FRAME_SITE),
    Feature.SUM: exact("simspec writes a fixed tendon"),
    Feature.SUM_LIMITS: approximate(
        "simspec writes a fixed tendon's range; its stop is a spring-damper with the default solreflimit"
    ),
}
"""Support of plain MJCF for each feature."""


def model_and_losses(world: World) -> tuple[MjcfModel, tuple[Loss, ...]]:
    """The file of a world, and what is lost beyond the table. Raises UnsupportedError for joints that the language refuses."""
    _check(world)
    world = without_implicit_damping(gathered(world))
    laws = meeting_laws(world)
    masks, group_excludes = collision_masks(world)
    unlike_rule = [pair for pair, law in laws.items() if not _by_rule(world, pair, law)]
    too_many = _upper_bound(world, unlike_rule) > MOST_PAIRS
    order = depth_first(world)
    actuators = tuple(_actuators(world))
    sites, named = sites_of(world, {}), frame_sites(world, {})
    model = MjcfModel(
        world.name,
        (*COMPILER, *(MESH_FOLDER if any(hulls_of(world)) else ())),
        (
            ("timestep", world.physics.timestep),
            ("gravity", world.physics.gravity),
            ("cone", CONES.get(world.contact.friction_cone, "pyramidal")),
            *fluid_options(world),
        ),
        tuple({**dict(FLAGS), "eulerdamp": bool(implicitly_damped(world))}.items()),
        () if (memory := arena_megabytes(world)) is None else (("memory", f"{memory}M"),),
        default=MjcfDefault(),
        classes=tuple(_classes(world)),
        bodies=tuple(
            _body(row, masks, (*sites.get(row.body.name, ()), *named.get(row.body.name, ()))) for row in order
        ),
        pairs=() if too_many else tuple(_pairs(world, laws, unlike_rule)),
        excludes=tuple(
            tree.MjcfExclude(file_name(first), file_name(second))
            for first, second in sorted({*excluded_pairs(world), *group_excludes})
        ),
        actuators=tuple(actuator for actuator, _ in actuators),
        keys=(dataclasses.replace(keyframe(KEYFRAME, order), control=tuple(control for _, control in actuators)),),
        meshes=meshes_of(world),
        heightfields=heightfields_of(world),
        equalities=equalities(world),
        tendons=tendons(world),
    )
    return model, tuple(_more(world, unlike_rule if too_many else []))


def _check(world: World) -> None:
    problems = [
        Problem(
            "MJCF has no hinge or slide whose lower and upper position limits are equal",
            f"bodies.{body.name}.joint.limits.position",
            found=f"{body.joint.position_limits}",
            hint="make the joint fixed",
            code="E104",
        )
        for body in world.bodies
        if body.joint.position_limits is not None and body.joint.position_limits[0] >= body.joint.position_limits[1]
    ]
    problems.extend(
        Problem("MJCF does not support a moving body without mass", f"bodies.{body.name}.mass", code="E104")
        for body in world.bodies
        if is_carrier(body.name) and not body.inertial.mass and body.name not in absorbed(world)
    )
    if problems:
        raise UnsupportedError(problems)


def _more(world: World, unlike_rule: list[Pair]) -> Iterator[Loss]:
    """Losses of this world only."""
    no_effort = tuple(
        f"bodies.{body.name}.joint.limits.effort" for body in world.bodies if body.joint.effort_limit == 0
    )
    if no_effort:
        yield Loss(Feature.LIMIT_EFFORT.value, LossFate.LEFT_OUT, "MJCF has no range of zero", no_effort)
    for feature, native in ((Feature.CONTROL_NATIVE, True), (Feature.CONTROL, False)):
        no_drive = tuple(
            f"control.{controller.name}.effort_limit"
            for controller in world.controllers
            if (controller.law == "native") is native and any(limit == 0 for limit in controller.effort_limits)
        )
        if no_drive:
            yield Loss(feature.value, LossFate.LEFT_OUT, "no actuator where its largest effort is zero", no_drive)
    if unlike_rule:
        how = f"the larger number of both materials: these laws need more than {MOST_PAIRS} explicit pairs"
        paths = tuple(f"contact.pairs.{first}.{second}" for first, second in unlike_rule)
        yield Loss(Feature.FRICTION_PAIRS.value, LossFate.APPROXIMATED, how, paths)
    renamed = tuple(f"bodies.{body.name}" for body in world.bodies if file_name(body.name) != body.name)
    if renamed:
        how = f"called {file_name('world')!r}: the static root has its name"
        yield Loss("body.name", LossFate.APPROXIMATED, how, renamed)


# --- contact ------------------------------------------------------------------------------------------------------


def _laws_of_pairs(world: World) -> Mapping[str, PairContact]:
    """The law of each material with itself."""
    return {pair.first: pair for pair in world.contact.pairs if pair.first == pair.second}


def _friction(law: PairContact) -> tuple[float, float, float]:
    return (law.friction, law.torsional_friction, law.rolling_friction)


def _reference(law: PairContact) -> tuple[float, float]:
    """``solref``."""
    hardness = law.hardness
    return (hardness.time_constant, hardness.damping_ratio) if hardness.kind == "time-constant" else NATIVE_REFERENCE


def _by_rule(world: World, pair: Pair, law: PairContact) -> bool:
    """Whether two geoms of these materials have this law by the language's rule."""
    contacts = _laws_of_pairs(world)
    first, second = (contacts[name] for name in pair)
    larger = tuple(max(values) for values in zip(_friction(first), _friction(second), strict=True))
    return (
        law.margin is None
        and larger == _friction(law)
        and _reference(first) == _reference(second) == _reference(law)
        and max(dimensions(first), dimensions(second)) == dimensions(law)
    )


def _upper_bound(world: World, pairs: list[Pair]) -> float:
    """How many pairs of shapes there may be at most, without a look at single bodies."""
    counts: dict[str, int] = {}
    for body in world.bodies:
        for shape in solid_shapes(body):
            counts[shape.material] = counts.get(shape.material, 0) + 1
    return sum(counts[first] * counts[second] / (1 + (first == second)) for first, second in pairs)


def _classes(world: World) -> Iterator[MjcfDefault]:
    yield MjcfDefault(VISUAL, (("geom", (("contype", 0), ("conaffinity", 0))),))
    contacts = _laws_of_pairs(world)
    for material in world.contact.materials:
        law = contacts[material.name]
        reference = _reference(law)
        attributes: Attributes = (("condim", dimensions(law)), ("friction", _friction(law)))
        if reference != NATIVE_REFERENCE:
            attributes = (*attributes, ("solref", reference))
        yield MjcfDefault(MATERIAL + material.name, (("geom", attributes),))


def _pairs(world: World, laws: Mapping[Pair, PairContact], pairs: list[Pair]) -> Iterator[tree.MjcfPair]:
    margins = margins_of(world)
    for pair in pairs:
        law = laws[pair]
        sliding, torsional, rolling = _friction(law)
        attributes: Attributes = (
            ("condim", dimensions(law)),
            ("friction", (sliding, sliding, torsional, rolling, rolling)),
            ("solref", _reference(law)),
        )
        for first, second in shape_pairs(world, [pair]):
            margin = margins[first] + margins[second] if law.margin is None else law.margin
            local: Attributes = (("margin", margin),) if margin else ()
            yield tree.MjcfPair(first, second, (*attributes, *local))


# --- bodies -------------------------------------------------------------------------------------------------------


def _body(row: BodyRow, masks: Mapping[Kind, Attributes], sites: tuple[tree.MjcfSite, ...]) -> tree.MjcfBody:
    body = row.body
    mass = () if body.inertial.mass else WITHOUT_MASS
    geoms = tuple(_geom(shape, mass, masks.get((body.collision_group, shape.material), ())) for shape in body.shapes)
    return body_of(row, tuple(_joint(joint, frame) for joint, frame in row.joints), geoms, sites=sites)


def _joint(joint: Joint, frame: Pose) -> tree.MjcfJoint:
    more = joint_attributes(joint, frame)
    if not any(name == "limited" for name, _ in more):
        more += [("limited", False)]
        if joint.kind in SCALAR_JOINTS:
            more.append(
                ("range", (-UNLIMITED, UNLIMITED))
            )  # one reader takes a joint without a range for one that is locked
    if joint.effort_limit:
        more += [("actuatorfrclimited", True), ("actuatorfrcrange", (-joint.effort_limit, joint.effort_limit))]
    return tree.MjcfJoint(joint.name, joint.kind, tuple(more))


def _geom(shape: Shape, mass: Attributes, mask: Attributes) -> tree.MjcfGeom:
    group = GROUPS[shape.collision, shape.visual]
    shown: Attributes = (("group", group),) if group else ()
    class_name = MATERIAL + shape.material if shape.collision else VISUAL
    margin: Attributes = (("margin", shape.margin),) if shape.collision and shape.margin else ()
    moving: Attributes = (("surfacevel", shape.surface_velocity),) if any(shape.surface_velocity) else ()
    solid = (*mask, *margin, *moving) if shape.collision else ()
    return geom_of(shape, class_name, (*mass, *solid, *shown, ("rgba", shape.colour)))


def _actuators(world: World) -> Iterator[tuple[tree.MjcfActuator, float]]:
    """An actuator for each driven joint, with its control at the start, so that the actuator's force is the law's there: a
    position servo; without kp a velocity servo; without gains a motor. The law clips efforts, not targets, and one reader takes
    ``ctrlrange`` for a limit of the effort: there is none."""
    for drive in drives(world):
        if drive.effort_limit == 0:
            continue
        more: list[tuple[str, Value]] = []
        kind, control = "motor", drive.effort
        if drive.kp:
            kind, control = "position", drive.position + (drive.kd * drive.velocity + drive.effort) / drive.kp
            more = [("kp", drive.kp), ("kv", drive.kd)]
        elif drive.kd:
            kind, control = "velocity", drive.velocity + drive.effort / drive.kd
            more = [("kv", drive.kd)]
        if drive.effort_limit is not None:
            more += [("forcelimited", True), ("forcerange", (-drive.effort_limit, drive.effort_limit))]
        yield tree.MjcfActuator(kind, drive.joint, drive.joint, tuple(more)), control


MODEL: Final = "model.xml"
DEEPEST_INDENT: Final = 24
"""Levels that are indented; deeper ones stay there, so that a chain's text grows with its length, not its square."""


class Mjcf(Format):
    """The MJCF language, without what any one program makes of it."""

    NAME: ClassVar[str] = "mjcf"
    SUPPORT: ClassVar[Table] = SUPPORT
    RANGED: ClassVar[tuple[str, ...]] = SCALAR_JOINTS

    def write(self, tree: Any) -> dict[str, str]:
        """``model.xml`` of a Model (``tree.py``), and the files of its meshes. Raises ValueError for numbers that are not
        finite, and for bodies that are not listed depth first."""
        if not isinstance(tree, MjcfModel):
            raise TypeError(f"{type(tree).__name__} is not a Model of MJCF")
        flags = tuple((name, "enable" if on else "disable") for name, on in tree.flags)
        template = environment().get_template("mjcf/model.xml.j2")
        text = template.render(model=tree, flags=flags, events=_events(tree.bodies))
        return {MODEL: text, **mesh_files(mesh.vertices for mesh in tree.meshes)}

    def plain(self, world: World) -> PlainFiles:
        """``model.xml`` in the language's own words. Raises UnsupportedError for joints that the language refuses."""
        model, more = model_and_losses(world)
        return PlainFiles(self.write(model), losses(world, SUPPORT, more))

    def parts(self, world: World, files: Mapping[str, str]) -> Mapping[str, tuple[types.Body, ...]]:
        """``model.xml``."""
        return {MODEL: world.bodies}

    def read(self, folder: Path) -> MjcfDocument:
        """The document of ``model.xml`` in ``folder``, with the files of meshes below it; files that it includes are not read.

        Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file and line, where it is no MJCF,
        or a mesh is no convex hull.
        """
        return dataclasses.replace(read_document(folder / MODEL), meshes=read_meshes(folder))


def _events(bodies: tuple[MjcfBody, ...]) -> Iterator[tuple[str, MjcfBody | None]]:
    """Opening and closing of bodies, in the order of the file: (indent, body), or (indent, None) to close."""
    indents = [" " * (4 + 2 * depth) for depth in range(DEEPEST_INDENT)]
    if not bodies:
        return
    following = [body.depth for body in bodies[1:]] + [0]
    if bodies[0].depth != 0:
        raise ValueError(f"the body {bodies[0].name!r} is the first and stands in another")
    for body, after in zip(bodies, following, strict=True):
        if not 0 <= after <= body.depth + 1:
            raise ValueError(f"a body after the body {body.name!r} stands in {after} bodies, of which one is missing")
        yield indents[min(body.depth, DEEPEST_INDENT - 1)], body
        for level in range(body.depth, after - 1, -1):
            yield indents[min(level, DEEPEST_INDENT - 1)], None
