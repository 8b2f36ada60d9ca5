"""The language: every field of a spec, with its meaning, its unit and its bounds.

A field that is not given is None (or its stated default); an explicit null in a file is refused. Numbers are kept in SI.
The order of the fields is the order in which ``simspec fmt`` writes them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field, create_model

from simspec.language.actions import MOST_FORCES, Force, Grasp, Motion, Trajectory
from simspec.language.arrays import Array, Frame, NamePattern, State
from simspec.language.constraints import Constraint
from simspec.language.contact import Contact, EngineOptions
from simspec.language.control import MOST_CONTROLLERS, Actuator, Controller
from simspec.language.document import listed, mapping
from simspec.language.expectations import Expectation
from simspec.language.foreign import Import
from simspec.language.joints import Joint
from simspec.language.parameters import ModelParameter, ParameterName, ParameterValue
from simspec.language.physics import Physics, Record, not_whole, whole_steps
from simspec.language.quantities import Number, Reader
from simspec.language.shapes import AXES, Inertia, NameOf, Point, Pose, Shape, Switch, Velocity
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, fault, fields_of, misspelt, show, too_long
from simspec.language.sweep import Sweep
from simspec.language.vocabulary import JOINT_KINDS, STATIC_SHAPES, TREE_JOINTS
from simspec.language.words import FileName, Name, Text, Word

VERSION = 1
Mass = Annotated[float, Number("mass", 0)]


@dataclass(frozen=True)
class Version(Reader):
    """The version of the language."""

    WORDS = str(VERSION)
    SCHEMA: ClassVar = {"const": VERSION}

    def read(self, value: Any) -> int:
        if value != VERSION or isinstance(value, bool):
            raise fault("this simspec reads version 1 of the language", show(value), str(VERSION), code="S112")
        return VERSION


class Body(Strict):
    """A rigid body. One without `parent` is a root: free, unless it is `fixed` or has a `joint` to the world."""

    array: Maybe[Array] = Field(ABSENT, description="Copies of this root body and all its descendants")
    parent: Maybe[NameOf] = Field(
        ABSENT, description="Parent body, to which the joint connects this body; none: a root"
    )
    fixed: Maybe[Switch] = Field(ABSENT, description="A root only: whether it is fixed to the world")
    pose: Maybe[Pose] = Field(
        ABSENT,
        description="A root only: initial pose of the body's frame in the world; with a joint, the joint's origin",
    )
    velocity: Maybe[Velocity] = Field(
        ABSENT, description="A free root only: initial velocity, in the axes of the reference frame of `pose`"
    )
    kinematic: Maybe[Switch] = Field(
        ABSENT,
        description="A root only: whether it follows `motion` regardless of all forces; its mass then has no effect",
    )
    mass: Maybe[Mass] = Field(
        ABSENT, description="Mass; without `inertia` it is distributed evenly over the volumes of the collision shapes"
    )
    centre_of_mass: Maybe[Point] = Field(
        ABSENT, description="Centre of mass in the body frame; with `inertia`; default: its origin"
    )
    inertia: Maybe[Inertia] = Field(ABSENT, description="Moments of inertia about the centre of mass; with `mass`")
    gravity_scale: Annotated[float, Number("number")] = Field(
        1.0, description="Factor of the body's weight, mass × gravity, at its centre of mass; 0: weightless"
    )
    collision_group: NameOf = Field("default", description="Collision group, see `contact.groups`")
    joint: Maybe[Joint] = Field(ABSENT, description="Joint to the parent, or of a root to the world")
    joints: list[Joint] = Field(
        [],
        description="Two to six hinges, slides and balls in series instead of one joint, beginning at the "
        "parent: the `origin` of each is in the frame that the joint before it moves, and the last "
        "joint moves the body",
    )
    shapes: list[Shape] = Field([], description="Collision and visual shapes")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        several = [fields_of(joint) for joint in data.get("joints") or () if isinstance(joint, (dict, Joint))]
        fields = several[0] if several else fields_of(data.get("joint"))
        kind = several[-1].get("type") if several else fields.get("type")
        yield from _in_a_row(data, several)
        if "parent" in data:
            yield from _child(data, kind)
        else:
            yield from _root(data, kind, fields)
        yield from _mass(data)


_EITHER = "one of them"
_PLACED_BY_MOTION = "exclude each other: motion says where it is"


def _in_a_row(data: Mapping[str, Any], several: Sequence[Mapping[str, Any]]) -> Iterable[Fault]:
    """The faults of several joints together."""
    if "joints" not in data:
        return
    if "joint" in data:
        yield Fault(("joints",), "joint and joints exclude each other", None, _EITHER, code="S103")
    joints = data["joints"]
    if not isinstance(joints, list) or len(several) != len(joints):
        return  # reported where they are read
    if len(several) < 2:
        yield Fault(
            ("joints",), "several joints are at least two", str(len(several)), "2 to 6", "joint: {...}", code="S409"
        )
    for index, joint in enumerate(several):
        kind = joint.get("type")
        if kind in JOINT_KINDS and kind not in TREE_JOINTS:
            message = f"a {kind} joint is not one of several"
            yield Fault(("joints", index, "type"), message, str(kind), "hinge, slide, ball", code="S409")
        elif kind == "ball" and index < len(several) - 1:
            yield Fault(
                ("joints", index, "type"), "a ball joint is the last of several", "ball", "hinge, slide", code="S409"
            )
    turns = sum({"hinge": 1, "ball": 3}.get(str(joint.get("type")), 0) for joint in several)
    slides = sum(joint.get("type") == "slide" for joint in several)
    for count, what in ((turns, "turns about"), (slides, "slides along")):
        if count > 3:
            yield Fault(("joints",), f"a body {what} at most three axes", f"{count}", "up to 3", code="S409")


def _child(data: Mapping[str, Any], kind: Any) -> Iterable[Fault]:
    for key, hint in {
        "array": "only roots have arrays; the array copies all descendants",
        "fixed": "write joint: {type: fixed}",
        "pose": "write joint: {origin: ...}",
        "velocity": "write joint: {velocity: ...}",
        "kinematic": "a kinematic body has no parent; bodies that it carries move with it",
    }.items():
        if key in data:
            yield Fault((key,), f"{key} is only for roots, and this body has a parent", None, None, hint, code="S110")
    if "joint" not in data and "joints" not in data:
        yield Fault(
            (), "a body with a parent needs a joint", None, None, "joint: {type: fixed}, or another type", code="S102"
        )
    elif kind == "free" and "joint" in data:
        message = "only roots are free; this body has a parent"
        yield Fault(("joint", "type"), message, "free", "fixed, hinge, slide, ball", code="S110")


def _root(data: Mapping[str, Any], kind: Any, joint: Mapping[str, Any]) -> Iterable[Fault]:
    if data.get("kinematic") is True:
        for key in ("fixed", "velocity", "joint", "joints"):
            if data.get(key) not in (None, False):
                yield Fault((key,), f"kinematic and {key} {_PLACED_BY_MOTION}", None, _EITHER, code="S404")
    if data.get("fixed") is True and ("joint" in data or "joints" in data):
        key = "joint" if "joint" in data else "joints"
        yield Fault((key,), f"fixed and {key} exclude each other", None, _EITHER, code="S404")
    elif "fixed" in data and data.get("fixed") is False and kind == "fixed":
        yield Fault(("fixed",), "fixed: false contradicts the fixed joint", code="S404")
    if "pose" in data and joint.get("origin") is not None:
        message = "pose and joint.origin exclude each other: both place the root in the world"
        yield Fault(("pose",), message, None, _EITHER, code="S404")
    immovable = data.get("fixed") is True or kind in ("fixed", *TREE_JOINTS)
    if "velocity" in data and immovable:
        hint = "write joint: {velocity: ...}" if kind in TREE_JOINTS else "remove it"
        yield Fault(("velocity",), "velocity is only for free roots", None, None, hint, code="S404")


def _mass(data: Mapping[str, Any]) -> Iterable[Fault]:
    fields = list(map(fields_of, listed(data.get("shapes"))))
    dense = [index for index, item in enumerate(fields) if item.get("density") is not None]
    for key in ("mass", "inertia", "centre_of_mass"):
        if dense and key in data:
            message = f"{key} and density exclude each other: both define the mass"
            yield Fault((key,), message, None, "mass and inertia; or mass alone; or densities", code="S403")
    if dense:
        for index, item in enumerate(fields):
            solid = item.get("collision") is not False and not any(item.get(kind) is not None for kind in STATIC_SHAPES)
            if solid and item.get("density") is None:
                hint = "density: 0 makes a shape massless"
                yield Fault(
                    ("shapes", index),
                    "this shape has no density, but others of the body have one",
                    hint=hint,
                    code="S403",
                )
        return
    if "inertia" in data and "mass" not in data and not misspelt("mass", data, Body.model_fields):
        yield Fault((), "inertia without mass", None, "both, or neither", code="S403")
    if "centre_of_mass" in data and "inertia" not in data:
        yield Fault(
            ("centre_of_mass",), "centre_of_mass goes with inertia; otherwise it follows from the shapes", code="S403"
        )


_WITH: dict[str, Any] = {  # `with` and `import` are no names that a class body may have
    "with": (
        dict[Annotated[str, ParameterName()], Annotated[Any, ParameterValue()]],
        Field({}, description="Values of the parameters of the file's model, by name"),
    )
}
_IMPORT: dict[str, Any] = {
    "import": (Import, Field(ABSENT, description="For a file of another language: options of its importer"))
}
_MIRROR = "Mirror {} through the plane x = 0, y = 0 or z = 0 of its frame; see Mirrored models"


class _WithUse(Strict):
    use: Maybe[Annotated[str, FileName()]] = Field(ABSENT, description="Path of a model file, relative to this file")


_WithImport: type[_WithUse] = create_model("_WithImport", __base__=_WithUse, **_IMPORT, **_WITH)


class Use(_WithImport):
    """A model placed in the scenario: the file's (`use`), or one written here (`bodies`). Its bodies are called
    `<model>/<body>`, its joints `<model>/<joint>`."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("use", "bodies")

    mirror: Maybe[Annotated[str, Word(AXES)]] = Field(
        ABSENT, description=_MIRROR.format("the file's model, or the model written here,")
    )
    bodies: Maybe[dict[NameOf, Body]] = Field(
        ABSENT, description="The bodies of a model written here; exactly one root"
    )
    frames: dict[NameOf, Frame] = Field(
        {}, description="Named frames on bodies of the model, in addition to those of its file"
    )
    grasps: dict[NameOf, Grasp] = Field({}, description="Grasps of a model written here, by name")
    actuators: dict[NameOf, Actuator] = Field(
        {},
        description="Actuators of the model, by name, in addition to those of its file; they act where "
        "`control` names them",
    )
    constraints: dict[NameOf, Constraint] = Field(
        {}, description="Constraints within the model, by name; joints and bodies by their names in the model"
    )
    states: dict[NameOf, State] = Field(
        {}, description="Initial states of the model, by name, in addition to those of its file"
    )
    state: Maybe[Annotated[str, Name()]] = Field(
        ABSENT, description="Name of the initial state; `positions` and `velocities` override it"
    )
    array: Maybe[Array] = Field(ABSENT, description="Copies of the whole model")
    attach: Maybe[Annotated[str, Name(path=True)]] = Field(
        ABSENT,
        description="Full name of another model's body, or of a frame on it, to which the root is fixed, or connected "
        "by its joint; `pose` is then in that frame",
    )
    joint: Maybe[Joint] = Field(
        ABSENT,
        description="Joint of the root to the body of `attach`, or to the world, in place of the root being fixed or free; "
        "its `origin` is another word for `pose`",
    )
    fixed: Maybe[Switch] = Field(ABSENT, description="Whether the root is fixed to the world; default: as in the model")
    kinematic: Maybe[Switch] = Field(
        ABSENT, description="Whether the root follows `motion` regardless of all forces; default: as in the model"
    )
    pose: Maybe[Pose] = Field(
        ABSENT, description="Pose of the model in the world, to which the root's pose in the model is relative"
    )
    velocity: Maybe[Velocity] = Field(
        ABSENT, description="Initial velocity of a free root, in world axes, in place of the model's"
    )
    positions: dict[Annotated[str, NamePattern()], Any] = Field(
        {}, description="Initial joint positions by the joint's name in the model; `*` matches any text"
    )
    velocities: dict[Annotated[str, NamePattern()], Any] = Field(
        {}, description="Initial joint velocities by the joint's name in the model; `*` matches any text"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "import" in data and "use" not in data:
            yield Fault(("import",), "`import` goes with `use`: it is said to the importer of that file", code="S307")
        if "attach" in data:
            for key in ("array", "fixed", "kinematic", "velocity"):
                if key in data:
                    message = f"a model that is attached to a body has no {key} of its own"
                    yield Fault((key,), message, hint="remove one", code="S103")
        yield from _needs_file(data, ("with",))
        yield from _placed_joint(data)
        if data.get("kinematic") is True:
            for key in ("fixed", "velocity"):
                if data.get(key) not in (None, False):
                    yield Fault((key,), f"kinematic and {key} {_PLACED_BY_MOTION}", code="S404")


def _needs_file(data: Mapping[str, Any], keys: Iterable[str]) -> Iterator[Fault]:
    """Words about a file's model, of a model that is no file's."""
    for key in keys:
        if key in data and "use" not in data:
            yield Fault((key,), f"`{key}` goes with `use`: it is about the model of that file", code="S110")


def _placed_joint(data: Mapping[str, Any]) -> Iterator[Fault]:
    """The faults of a joint that a placement gives the root."""
    joint = fields_of(data.get("joint"))
    if joint.get("type") == "free" and "attach" in data:
        message = "a model that is attached to a body does not move freely"
        yield Fault(("joint", "type"), message, "free", "fixed, hinge, slide, ball", code="S110")
    for key in ("fixed", "kinematic"):
        if joint and data.get(key) not in (None, False):
            yield Fault((key,), f"{key} and joint exclude each other", None, _EITHER, code="S404")
    if "pose" in data and joint.get("origin") is not None:
        message = "pose and joint.origin exclude each other: both place the root"
        yield Fault(("pose",), message, None, _EITHER, code="S404")


class _Parametrised(Strict):
    parameters: dict[Annotated[str, ParameterName()], ModelParameter] = Field(
        {}, description="Quantities that placements of the model may set, by name; see Parameters"
    )
    use: Maybe[Annotated[str, FileName()]] = Field(
        ABSENT, description="Path of another model file, relative to this file"
    )


_ParametrisedUse: type[_Parametrised] = create_model("_ParametrisedUse", __base__=_Parametrised, **_WITH)


class Model(_ParametrisedUse):
    """The one model of a model file: bodies with exactly one root, or another model file's model."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("use", "bodies")

    mirror: Maybe[Annotated[str, Word(AXES)]] = Field(ABSENT, description=_MIRROR.format("the other file's model"))
    bodies: Maybe[dict[NameOf, Body]] = Field(ABSENT, description="The bodies; exactly one root")
    frames: dict[NameOf, Frame] = Field({}, description="Named frames on bodies of the model")
    grasps: dict[NameOf, Grasp] = Field({}, description="Grasps of the model's hand, by name")
    actuators: dict[NameOf, Actuator] = Field(
        {}, description="Actuators of the model, by name; they act where `control` names them"
    )
    constraints: dict[NameOf, Constraint] = Field({}, description="Constraints within the model, by name")
    states: dict[NameOf, State] = Field({}, description="Initial states of the model, by name")
    state: Maybe[Annotated[str, Name()]] = Field(
        ABSENT,
        description="Name of the initial state, unless the file that uses the model names another; "
        "default: the state that the bodies define",
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        yield from _needs_file(data, ("with", "mirror"))


class File(Strict):
    """A spec: a scenario (`bodies`, `models`) or one model (`model`)."""

    simspec: Annotated[int, Version()] = Field(..., description="Version of the language")
    name: NameOf = Field(..., description="Name of the spec and of its output folder")
    description: Annotated[str, Text()] = Field(
        "", description="One sentence on the subject or the purpose of the file"
    )
    physics: Physics = Field(Physics(), description="Gravity, timestep, duration")
    contact: Contact = Field(Contact(), description="Materials, friction cone, collision groups, excluded pairs")
    bodies: dict[NameOf, Body] = Field({}, description="Loose bodies and trees, by name")
    models: dict[NameOf, Use] = Field({}, description="Placed models, by name")
    model: Maybe[Model] = Field(ABSENT, description="The model of a model file; excludes `bodies` and `models`")
    frames: dict[NameOf, Frame] = Field({}, description="Named frames on bodies: tool points, places of sensors")
    constraints: dict[NameOf, Constraint] = Field(
        {}, description="Constraints between joints and bodies outside the tree, by name"
    )
    actuators: dict[NameOf, Actuator] = Field(
        {}, description="Actuators of loose bodies, by name; they act where `control` names them"
    )
    control: dict[NameOf, Controller] = Field({}, description="Controllers of joints, by name")
    trajectory: Maybe[Trajectory] = Field(
        ABSENT, description="Trajectory of the driven joints; default: their initial positions"
    )
    forces: list[Force] = Field([], description="Forces and torques on bodies during given times: pushes and loads")
    motion: dict[Annotated[str, Name(path=True)], Motion] = Field(
        {}, description="Motions of kinematic bodies, by full name; a kinematic body without a motion is at rest"
    )
    record: Record = Field(Record(), description="The recording of a run")
    expect: list[Expectation] = Field([], description="Statements that must be true of every run")
    engines: dict[NameOf, EngineOptions] = Field({}, description="Options by the engine's name")
    sweep: Maybe[Sweep] = Field(ABSENT, description="Many runs of this scenario, which itself remains unchanged")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        contact = mapping(data.get("contact"))
        if "model" in data:
            yield from _model_file(data, contact)
        elif "self_collision" in contact:
            allowed = "in the file of a model; else: groups, exclude"
            yield Fault(("contact", "self_collision"), "self_collision is only for a model", None, allowed, code="S110")
        parts = ("bodies", "models", "model")
        if not any(key in data or misspelt(key, data, cls.model_fields) for key in parts):
            yield Fault((), "no bodies and no models: nothing to simulate", code="S113")
        control = mapping(data.get("control"))
        if len(control) > MOST_CONTROLLERS:
            yield Fault(
                ("control",), "too many controllers", str(len(control)), f"up to {MOST_CONTROLLERS}", code="S109"
            )
        yield from too_long(data, "forces", MOST_FORCES)
        yield from _in_steps(data, "record", "every")
        yield from _in_steps(data, "trajectory", "until")
        for controller in control:
            yield from _in_steps(data, "control", controller, "every")


def _model_file(data: Mapping[str, Any], contact: Mapping[str, Any]) -> Iterable[Fault]:
    for key in ("bodies", "models"):
        if key in data:
            message = f"model and {key} exclude each other: a file is a model or a scenario"
            yield Fault((key,), message, None, "model, or bodies and models", code="S103")
    for key in ("frames", "constraints", "actuators"):
        if key in data:
            yield Fault(
                (key,), f"{key} of a model stand in the model itself", hint=f"model: {{{key}: ...}}", code="S110"
            )
    if "sweep" in data:
        yield Fault(("sweep",), "sweep is only for scenarios, not for a model", None, None, "remove it", code="S110")
    for key in ("friction_cone", "combine"):
        if key in contact:
            allowed = "materials, pairs, groups, exclude, touch, self_collision"
            yield Fault(("contact", key), f"{key} is only for scenarios, not for a model", None, allowed, code="S110")


def _in_steps(data: Mapping[str, Any], *path: str) -> Iterable[Fault]:
    """A time that is no whole number of timesteps, or none at all."""
    time: Any = data
    for name in path:
        time = fields_of(time).get(name)
    if time is None:
        return
    timestep = fields_of(data.get("physics")).get("timestep")
    number = Number("time", 0, above=True)
    try:
        times = number.read(time), 0.001 if timestep is None else number.read(timestep)
    except Faults:
        return  # reported where it is read
    if whole_steps(*times) in (None, 0):
        yield not_whole(".".join(path), *times, path)
