"""Actions during a run: forces, trajectories of driven joints (by points, by a table in a file, or by a program of moves of a
tool), and motions of kinematic bodies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field, create_model

from simspec.language.arrays import JointNames, NamePattern, too_many
from simspec.language.document import mapping
from simspec.language.joints import JointQuantity
from simspec.language.quantities import Number, Vector
from simspec.language.shapes import QUAT, RPY, Angles, NameOf, Point, Pose, Quaternion, Rotated
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, fault, fields_of, read_entries, show, too_long
from simspec.language.vocabulary import INTERPOLATIONS, MOTION_INTERPOLATIONS
from simspec.language.words import FileName, Flag, Name, Word

MOST_FORCES = 1000


class _Force(Strict):
    """Base of a force."""

    if TYPE_CHECKING:  # the types of what _FORCE makes; `from` is read with getattr
        body: str
        force: tuple[float, float, float] | None
        torque: tuple[float, float, float] | None
        at: tuple[float, float, float] | None
        until: float | None

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "force" not in data and "torque" not in data:
            yield Fault(
                (),
                "neither force nor torque",
                show(dict(data)),
                "force, torque or both",
                "force: [10, 0, 0]",
                code="S113",
            )
        if "at" in data and "force" not in data:
            yield Fault(
                ("at",),
                "a torque acts on the body as a whole, at no point",
                show(data["at"]),
                None,
                "remove it",
                code="S110",
            )
        try:
            start, until = Number("time", 0).read(data.get("from", 0.0)), Number("time", 0).read(data["until"])
        except (Faults, KeyError):
            return  # reported where it is read, or without end
        if until <= start:
            yield Fault(("until",), "it ends before it begins", f"{until:g} s", f"above {start:g} s", code="S205")


_FORCE: dict[str, Any] = {
    "body": (Annotated[str, Name(path=True)], Field(..., description="Full name of a body that can move")),
    "force": (
        Annotated[tuple[float, float, float], Vector(Number("force"))],
        Field(ABSENT, description="Force, in the world's axes"),
    ),
    "torque": (
        Annotated[tuple[float, float, float], Vector(Number("torque"))],
        Field(ABSENT, description="Torque, in the world's axes, in addition to that of the force"),
    ),
    "at": (
        Point,
        Field(ABSENT, description="Point of application, in the body's frame; default: its origin"),
    ),
    "from": (Annotated[float, Number("time", 0)], Field(0.0, description="Time at which the force begins")),
    "until": (
        Annotated[float, Number("time", 0, above=True)],
        Field(ABSENT, description="Time at which the force ends; default: the end of the run"),
    ),
}
Force: type[_Force] = create_model(
    "Force", __base__=_Force, __doc__="A force and a torque that act on a body during some time.", **_FORCE
)
"""The model of a force; ``from`` is a word of Python's own, so it cannot be written as a class."""

MOST_POINTS = 100_000
"""Points of one trajectory, whether written, read from a file or made by a program."""
MOST_NUMBERS = 1_000_000
"""Points times joints; each is kept in the world with all its digits."""
MOST_SOLVED = 10_000
"""Points of the straight moves of a program, each a place that the arm is solved for: half a millisecond with six joints, some
milliseconds with joints to spare."""
FAR = 5
"""Points that a move which is not straight counts for: it is solved once, in some twenty steps instead of three to six."""
_DERIVATIVES = ("velocities", "accelerations")


@dataclass(frozen=True)
class ByJoint(JointQuantity):
    """A mapping of such numbers by the joint's name, with ``patterns`` also by a pattern; ``rate``: the unit of a plain one."""

    SCHEMA: ClassVar = {"type": "object", "additionalProperties": Number("number").schema(), "minProperties": 1}

    rate: str = ""
    patterns: bool = True

    def read(self, value: Any) -> dict[str, Any]:
        if not isinstance(value, Mapping) or not value:
            raise fault(
                f"expected {self.describe()}", show(value) if value else "{}", "{JOINT: number, ...}", code="S104"
            )
        if (many := too_many(value)) is not None:
            raise many
        return read_entries(value, self._name, super().read)

    def _name(self, entry: Any) -> str:
        pattern = self.patterns and isinstance(entry, str) and "*" in entry
        return NamePattern(path=True).read(entry) if pattern else Name(path=True).read(entry)

    def unit(self) -> str:
        return self.rate or super().unit()

    def describe(self) -> str:
        return "numbers by joint" + ("; `*` matches any text" if self.patterns else "")

    def schema(self) -> dict[str, Any]:
        return dict(self.SCHEMA)


BY_JOINT: Mapping[str, ByJoint] = {
    "positions": ByJoint("position"),
    "velocities": ByJoint("velocity"),
    "accelerations": ByJoint("", rate="rad/s² or m/s²"),
    "efforts": ByJoint("effort"),
}
"""The numbers by joint of a point."""

Positions = Annotated[dict[str, Any], BY_JOINT["positions"]]
Postures = Annotated[dict[str, Any], ByJoint("position", patterns=False)]
Time = Annotated[float, Number("time", 0)]
Lasting = Annotated[float, Number("time", 0, above=True)]
Share = Annotated[float, Number("number", 0, 1)]
FullName = Annotated[str, Name(path=True)]


class TrajectoryPoint(Strict):
    """Joint targets at a time. All points of a trajectory have the same entries."""

    at: Time = Field(..., description="Time; later than that of the point before")
    positions: Positions = Field(
        ..., description="By the joint's full name, or by a pattern, which matches driven joints"
    )
    velocities: Maybe[Annotated[dict[str, Any], BY_JOINT["velocities"]]] = Field(
        ABSENT, description="For cubic and quintic: in all points or in none"
    )
    accelerations: Maybe[Annotated[dict[str, Any], BY_JOINT["accelerations"]]] = Field(
        ABSENT, description="For quintic, with `velocities`: in all points or in none"
    )
    efforts: Maybe[Annotated[dict[str, Any], BY_JOINT["efforts"]]] = Field(
        ABSENT, description="Feed-forward efforts: in all points or in none"
    )


class ToolFrame(Strict):
    """The frame that `move` moves."""

    body: FullName = Field(..., description="Full name of the body to which the frame is fixed")
    pose: Maybe[Pose] = Field(ABSENT, description="Pose of the frame in the body's frame; default: the same frame")


class ToolPlace(Rotated):
    """A place of the tool in the world; fields that are left out keep their values."""

    xyz: Maybe[Point] = Field(ABSENT, description="Position of the tool's origin")
    rpy: Maybe[Angles] = Field(ABSENT, description=RPY)
    quat: Maybe[Quaternion] = Field(ABSENT, description=QUAT)
    free_orientation: Annotated[bool, Flag()] = Field(
        False, description="Whether the orientation of the tool is free, for arms with too few joints"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        yield from super().faults(data)
        if not any(key in data for key in ("xyz", "rpy", "quat")):
            yield Fault((), "a move without target", show(dict(data)), "xyz, rpy or quat", code="S102")
        if data.get("free_orientation") is True:
            for key in ("rpy", "quat"):
                if key in data:
                    yield Fault(
                        (key,), f"{key} and free_orientation exclude each other", None, "one of them", code="S103"
                    )


class _Step(Strict):
    """Base of a step of a program."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("move", "grip", "wait")

    if TYPE_CHECKING:  # the types of what _STEP makes; `in` is read with getattr
        move: ToolPlace | None
        grip: float | None
        wait: float | None
        straight: bool
        squeeze: float

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "wait" in data and "in" in data:
            yield Fault(("in",), "wait contains its own duration", show(data["in"]), None, "remove it", code="S110")
        for key in ("move", "grip"):
            if key in data and "in" not in data:
                yield Fault((), f"a {key} needs a duration", None, None, "in: 2 s", code="S102")
        if "squeeze" in data and "grip" not in data:
            yield Fault(
                ("squeeze",), "squeeze requires grip", None, None, "{grip: 1, squeeze: 1, in: 1 s}", code="S110"
            )
        if "straight" in data and "move" not in data:
            yield Fault(("straight",), "straight requires move", code="S110")


_STEP: Mapping[str, tuple[Any, Any, str]] = {
    "move": (ToolPlace, None, "Move the tool to a pose"),
    "grip": (Share, None, "Fraction of the travel of the grasp's joints from open (0) to closed (1)"),
    "wait": (Lasting, None, "Wait for this time"),
    "in": (Lasting, None, "Duration of a move or a grip"),
    "straight": (
        Annotated[bool, Flag()],
        True,
        "move: true, along a straight line and by the shortest turn; false, interpolated in joint space",
    ),
    "squeeze": (
        Share,
        0.0,
        "grip: fraction of the grasp's forces, reached linearly over `in`; kept until the next grip",
    ),
}

_STEP_FIELDS: dict[str, Any] = {
    name: (kind, Field(default, description=meaning)) for name, (kind, default, meaning) in _STEP.items()
}
Step: type[Strict] = create_model(
    "Step",
    __base__=_Step,
    __doc__="One step of a program: a move, a grip or a wait. Moves and grips begin and end at rest, by minimum jerk.",
    **_STEP_FIELDS,
)
"""The model of a step; ``in`` is a word of Python's own, so it cannot be written as a class."""


class GraspForce(Strict):
    """A force that a grasp presses with, at squeeze 1."""

    body: NameOf = Field(..., description="The body that applies the force")
    at: Point = Field((0.0, 0.0, 0.0), description="Point in the body's frame")
    force: Annotated[tuple[float, float, float], Vector(Number("force"))] = Field(
        ..., description="Force on the grasped object, in the axes of the body's frame"
    )


class Grasp(Strict):
    """The open and closed positions of a hand, by the names of the model's joints, and its forces when closed:
    feed-forward efforts Jᵀ F on the grasp's joints, with J at the closed posture.
    """

    open: Postures = Field(..., description="Joint positions at `grip: 0`")
    closed: Postures = Field(..., description="Joint positions at `grip: 1`; the same joints")
    forces: list[GraspForce] = Field([], description="Forces at `squeeze: 1`")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        opened, closed = data.get("open"), data.get("closed")
        if isinstance(opened, Mapping) and isinstance(closed, Mapping):
            for name in opened.keys() ^ closed.keys():
                lacks = "closed" if name in opened else "open"
                yield Fault(
                    (lacks,), f"{name} is missing here", None, "the same joints in open and closed", code="S707"
                )


class Trajectory(Strict):
    """The trajectory of the driven joints: `points`, a table (`file`), or a `program`. After its end the targets
    remain at the last point; driven joints that it does not name remain at their initial positions.
    """

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("points", "file", "program")

    interpolation: Annotated[str, Word(INTERPOLATIONS)] = Field(
        "cubic", description="Interpolation between points, see above"
    )
    until: Maybe[Annotated[float, Number("time", 0, above=True)]] = Field(
        ABSENT,
        description="Time at which the run ends, if before its `duration`; expectations at later times are then "
        "not checked",
    )
    points: Maybe[list[TrajectoryPoint]] = Field(ABSENT, description="Points in time, in order")
    file: Maybe[Annotated[str, FileName()]] = Field(
        ABSENT, description="Path of a table, .csv or .npz, relative to this file; not outside of the project folder"
    )
    tool: Maybe[ToolFrame] = Field(ABSENT, description="With `program`: the frame that moves")
    arm: Maybe[Annotated[tuple[str, ...], JointNames()]] = Field(
        ABSENT,
        description="With `program`: joints that move the tool; default: all driven joints between the world "
        "and the tool",
    )
    interval: Annotated[float, Number("time", 0, above=True)] = Field(
        0.05, description="With `program`: largest time between two points of a move or grip"
    )
    grasp: Maybe[FullName] = Field(
        ABSENT, description="With `program`: MODEL/GRASP of the `grip` steps; default: the only grasp"
    )
    program: Maybe[list[Step]] = Field(
        ABSENT, description="Steps, one after the other, from the initial positions and time zero on"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "program" not in data:
            for key in ("tool", "arm", "interval", "grasp"):
                if key in data and any(name in data for name in ("points", "file")):
                    yield Fault((key,), f"{key} requires a program", None, None, "remove it", code="S110")
        for key in ("points", "program"):
            if data.get(key) == []:
                yield Fault((key,), f"no {key}", "[]", "at least one", code="S113")
            yield from too_long(data, key, MOST_POINTS)
        points = data.get("points")
        if isinstance(points, list):
            yield from _points(points, data.get("interpolation", "cubic"))


def _increasing(rows: Iterable[Mapping[str, Any]], allowed: bool) -> Iterator[Fault]:
    """Times ``at`` of points that do not increase; ``allowed``: say which times are allowed."""
    before: float | None = None
    for index, row in enumerate(rows):
        try:
            time = Number("time", 0).read(row.get("at"))
        except Faults:
            continue  # reported where it is read
        if before is not None and time <= before:
            found = show(time) if allowed else f"{time:g} s after {before:g} s"
            above = f"above {before:g} s" if allowed else None
            yield Fault(("points", index, "at"), "times must increase", found, above, code="S706")
        before = time


def _points(points: list[Any], interpolation: Any) -> Iterable[Fault]:
    """Times that do not increase, joints that come and go, quantities that are there in some points only."""
    rows = list(map(fields_of, points))
    first = rows[0].get("positions") if rows else None
    joints = set(first) if isinstance(first, Mapping) else None
    width = 1 if joints is None else len(joints)
    if len(rows) * width > MOST_NUMBERS:
        yield Fault(
            ("points",),
            "too many numbers",
            f"{len(rows)} points of {width} joints",
            f"up to {MOST_NUMBERS}",
            code="S109",
        )
        return
    yield from _increasing(rows, allowed=False)
    # which joints a pattern means, the world says (``resolve/trajectory.py``)
    patterns = any("*" in str(entry) for row in rows for key in BY_JOINT for entry in mapping(row.get(key)))
    quantities = {key for key in BY_JOINT if rows and rows[0].get(key) is not None}
    for index, row in enumerate(rows):
        for key in BY_JOINT:
            value = row.get(key)
            if (value is not None) != (key in quantities) and index and key != "positions":
                there, lacks = ("the first point", "this one") if key in quantities else ("this point", "the first one")
                message = f"{there} has {key}, {lacks} has none"
                yield Fault(("points", index), message, None, "in all points, or in none", code="S707")
            elif isinstance(value, Mapping) and joints is not None and set(value) != joints and not patterns:
                different = ", ".join(sorted(map(str, set(value) ^ joints))[:6])
                yield Fault(
                    ("points", index, key), "not the joints of the first point", f"differs in {different}", code="S707"
                )
    wrong = {"hold": _DERIVATIVES, "linear": _DERIVATIVES, "cubic": ("accelerations",)}.get(interpolation, ())
    for key in wrong:
        if key in quantities:
            message = f"{key} are not allowed with interpolation {interpolation}"
            yield Fault(("points", 0, key), message, None, None, "quintic", code="S707")
    if interpolation == "quintic" and len(quantities & set(_DERIVATIVES)) == 1:
        yield Fault(("points", 0), "quintic requires velocities and accelerations, or neither", code="S707")


class MotionPoint(Rotated):
    """Pose of a kinematic body at a time. Omitted fields have the values of the point before, at the first point
    those of the body's `pose`.
    """

    at: Annotated[float, Number("time", 0)] = Field(..., description="Time; later than that of the point before")
    xyz: Maybe[Point] = Field(ABSENT, description="Position of the body's frame in the world")
    rpy: Maybe[Angles] = Field(ABSENT, description=RPY)
    quat: Maybe[Quaternion] = Field(ABSENT, description=QUAT)


class Motion(Strict):
    """The motion of a kinematic body. It is at rest before the first point and after the last one."""

    interpolation: Annotated[str, Word(MOTION_INTERPOLATIONS)] = Field(
        "cubic", description="Interpolation between points, see above"
    )
    points: list[MotionPoint] = Field(..., description="Points in time, in order")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        points = data.get("points")
        if not isinstance(points, list):
            return
        if not 0 < len(points) <= MOST_POINTS:
            message = "too many points" if points else "no points"
            yield Fault(("points",), message, str(len(points)), f"1 to {MOST_POINTS}", code="S109")
        yield from _increasing(map(fields_of, points[:MOST_POINTS]), allowed=True)
