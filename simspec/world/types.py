"""The resolved world: frozen types, SI units, every default filled, nothing left to an engine.

Frames. A body's frame coincides with its joint's frame when the joint is at zero. ``joint.origin`` is the pose of
the joint's frame in the parent's body frame (in the world, when ``parent`` is None); the joint's axis is given in the
joint's frame. Quaternions are w x y z, of unit length, first non-zero component positive.

Order. ``World.bodies`` lists every parent before its children. Sequences that have no meaningful order are sorted.

The read-back of an engine uses the same types, so that one comparator holds one against the other.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from simspec.language.vocabulary import CHANNELS
from simspec.plugins import Method
from simspec.world.actions import Fluid, Force, InertiaBox, JointController, JointSum, JointTrajectory, KinematicMotion
from simspec.world.appearance import UNSTORED, DrawnMesh

Pair = tuple[str, str]


POSITION_SIZE = {"fixed": 0, "hinge": 1, "slide": 1, "ball": 4, "free": 7}
"""Numbers in a joint's position: ball = quaternion w x y z; free = x y z, then quaternion w x y z."""
VELOCITY_SIZE = {"fixed": 0, "hinge": 1, "slide": 1, "ball": 3, "free": 6}
"""Numbers in a joint's velocity: ball = angular velocity; free = linear, then angular."""

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Velocity6 = tuple[float, float, float, float, float, float]
"""Linear, then angular velocity."""

LEFT_OUT = {"left_out": True}
"""Metadata of a field that canonical JSON leaves out while it has its default: younger than worlds whose hashes must stay."""

PlainValue = bool | int | float | str
EngineValue = PlainValue | tuple[PlainValue, ...]
"""A plain value, or several, that an engine holds under a name of its own."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Position (m) and orientation (w x y z) of one frame in another."""

    position: Vector3 = (0.0, 0.0, 0.0)
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Inertial:
    """Mass (kg), centre of mass in the body frame (m), and the inertia tensor about the centre of mass in axes
    parallel to the body frame's, as (Ixx, Iyy, Izz, Ixy, Ixz, Iyz) in kg m²; the products of inertia are the tensor's
    own off-diagonal elements, with their sign."""

    mass: float
    centre_of_mass: Vector3 = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Hardness:
    """The normal force between two bodies, for each point of contact; r is the gap (m, negative = overlap), v = dr/dt.

    common         rigid: v' ≥ β (−r)/dt − e v in every step, β = 0.01, the same equation in every engine
    time-constant  r̈ = −(2/T) v − r/(T ζ)², whatever the masses: T ``time_constant`` (s), ζ ``damping_ratio``
    stiffness      the normal force is −k r − c v, and never pulls: k ``stiffness`` (N/m), c ``damping`` (N s/m)
    native         what the engine does by default: a declared difference between engines

    Numbers that a kind does not use are zero.
    """

    kind: str = "common"
    time_constant: float = 0.0
    damping_ratio: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True, slots=True)
class Surface:
    """The numbers that an engine holds for one copy of a shape, to be combined with another's by the engine's rules.

    Sliding friction and restitution are ratios, torsional and rolling friction lengths (m); None = not readable.
    ``hardness`` None = this engine holds hardness elsewhere, or does not report it.
    """

    friction: float | None = 0.0
    torsional_friction: float | None = 0.0
    rolling_friction: float | None = 0.0
    restitution: float | None = 0.0
    hardness: Hardness | None = None


GREY = (0.7, 0.7, 0.7, 1.0)
"""The colour of a shape that has none."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A collision and/or visual shape, with its pose in the body frame.

    ``surfaces`` is empty in a world (there everything follows from ``material``); in a read-back it holds the numbers
    that the engine has for this shape, one entry for each copy of it (see ``contact.py``), in the order of
    their layers, and ``material`` is "", or the material's name where what is read says it. ``margin`` (m): contact has the gap
    between two surfaces less both margins, so
    that the shape is felt that far from its surface. ``surface_velocity``: linear (m/s), then angular (rad/s), in the shape's
    axes: at x its surface moves at linear + angular × x, along the surface, while the shape stays. ``rounding`` is of a
    read-back alone: how far (m) an engine keeps around the points of a mesh, whose faces are that much further in, and within a
    box or cylinder, of which no half is less (``world/hull.py``).
    """

    name: str
    kind: str
    size: tuple[float, ...]
    pose: Pose = Pose()
    material: str = ""
    collision: bool = True
    visual: bool = True
    colour: tuple[float, float, float, float] = GREY
    surfaces: tuple[Surface, ...] = ()
    rounding: float = field(default=0.0, metadata=LEFT_OUT)
    margin: float = field(default=0.0, metadata=LEFT_OUT)
    surface_velocity: Velocity6 = field(default=(0.0,) * 6, metadata=LEFT_OUT)
    drawn: DrawnMesh | None = field(default=None, compare=False, repr=False, metadata=UNSTORED)
    """The surface that is drawn in place of the hull of a mesh; part of no hash and of no file of an engine."""


@dataclass(frozen=True, slots=True)
class Joint:
    """The joint between a body and its parent.

    kind            one of JOINT_KINDS; fixed and free may have parent None (the world), free must
    origin          pose of the joint's frame in the parent's frame; for free the identity
    axis            unit vector in the joint's frame (hinge, slide); (0, 0, 0) otherwise
    position_limits (lower, upper) in rad or m, None = unlimited; hinge and slide only
    velocity_limit  rating (rad/s, m/s), None = none: not enforced by engines; control and expectations obey it
    effort_limit    rating (N m, N), None = none: not enforced by engines; control clips to it
    damping         d ≥ 0: effort −d v (N m s/rad, N s/m); for a ball −d times the angular velocity; for free a force −d v
                    at the centre of mass, v its velocity
    angular_damping d ≥ 0 of free: a torque −d ω (N m s/rad)
    dry_friction    largest dry effort opposing motion (N m, N); hinge and slide
    armature        added to this joint's diagonal of the mass matrix (kg m², kg); hinge, slide, ball; for free to the three
                    of translation (kg)
    angular_armature of free: added to the three of rotation (kg m²)
    written_armature    armature without dt × damping, which it contains where damping is implicit (``world/damping.py``); None
                    elsewhere
    spring_stiffness k ≥ 0: effort −k (q − spring_rest); for a ball −k log R in the child's axes (N m/rad, N/m)
    angle_limit     ball: the largest angle |log R| (rad, up to π), a hard stop as position_limits; None = unlimited
    position        initial position: hinge/slide (q,), ball quaternion, free x y z w x y z of the *body frame*
    velocity        initial velocity: hinge/slide (v,), ball angular velocity of the child relative to the parent in the
                    child's axes, free linear velocity of the body frame's origin then angular velocity, both in
                    world axes
    """

    name: str
    kind: str
    parent: str | None = None
    origin: Pose = Pose()
    axis: Vector3 = (0.0, 0.0, 0.0)
    position_limits: tuple[float, float] | None = None
    velocity_limit: float | None = None
    effort_limit: float | None = None
    damping: float = 0.0
    dry_friction: float = 0.0
    armature: float = 0.0
    spring_stiffness: float = 0.0
    spring_rest: float = 0.0
    position: tuple[float, ...] = ()
    velocity: tuple[float, ...] = ()
    angular_damping: float = field(default=0.0, metadata=LEFT_OUT)
    angular_armature: float = field(default=0.0, metadata=LEFT_OUT)
    angle_limit: float | None = field(default=None, metadata=LEFT_OUT)
    written_armature: float | None = field(default=None, metadata=LEFT_OUT)


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body. ``model`` is the name of the tree it belongs to (the tree's root body, or the model's name).

    A body that cannot move (fixed to the world through fixed joints only) may have mass 0. ``gravity_scale``: its weight is so
    many times mass × gravity, at its centre of mass. ``box``: by which it feels the fluid of the world; None: it feels none.
    """

    name: str
    model: str
    inertial: Inertial
    joint: Joint
    shapes: tuple[Shape, ...] = ()
    collision_group: str = "default"
    gravity_scale: float = field(default=1.0, metadata=LEFT_OUT)
    box: InertiaBox | None = field(default=None, metadata=LEFT_OUT)


@dataclass(frozen=True, slots=True)
class Frame:
    """A named place on a body: the frame at ``pose`` in the body's frame. Nothing of physics depends on it."""

    name: str
    body: str
    pose: Pose = Pose()


@dataclass(frozen=True, slots=True)
class ConnectConstraint:
    """A loop closed at a point: ``first_point`` of the body ``first`` is where ``second_point`` of ``second`` is; each in its
    body's frame (m)."""

    name: str
    first: str
    second: str
    first_point: Vector3
    second_point: Vector3
    kind: Literal["connect"] = "connect"


@dataclass(frozen=True, slots=True)
class WeldConstraint:
    """A loop closed rigidly: the frame of the body ``second`` is at ``pose`` in that of ``first``."""

    name: str
    first: str
    second: str
    pose: Pose
    kind: Literal["weld"] = "weld"


@dataclass(frozen=True, slots=True)
class FollowConstraint:
    """A coupling of two hinges or slides: q of ``joint`` is ``ratio`` times q of ``leader`` plus ``offset`` (rad, m)."""

    name: str
    joint: str
    leader: str
    ratio: float
    offset: float = 0.0
    kind: Literal["follow"] = "follow"


Constraint = ConnectConstraint | WeldConstraint | FollowConstraint
"""Constraints between bodies and joints outside the tree, by the law J v⁺ = −β φ/dt with β = 1: in every step the impulse that
makes the violation φ vanish."""


@dataclass(frozen=True, slots=True)
class Material:
    """A surface, by its contact with itself; the fields are those of :class:`PairContact`."""

    name: str
    friction: float = 0.0
    restitution: float = 0.0
    torsional_friction: float = 0.0
    rolling_friction: float = 0.0


@dataclass(frozen=True, slots=True)
class PairContact:
    """The law between two materials (``first`` ≤ ``second``); N is the normal force of a point of contact.

    friction               largest tangential force over N (see the cones)
    restitution            e, the ratio of separation to approach speed
    torsional_friction     length c (m): the torque about the normal is at most c N
    rolling_friction       length c (m): the torque across the normal is at most c N
    restitution_threshold  approach speed (m/s) below which nothing bounces
    hardness               see :class:`Hardness`
    collide                False: shapes of these materials pass through each other
    margin                 distance (m) at which contact of two such shapes begins, in place of the sum of both shapes'
                           margins; None: that sum
    """

    first: str
    second: str
    friction: float
    restitution: float
    torsional_friction: float = 0.0
    rolling_friction: float = 0.0
    restitution_threshold: float = 0.0
    hardness: Hardness = Hardness()
    collide: bool = True
    margin: float | None = field(default=None, metadata=LEFT_OUT)


@dataclass(frozen=True, slots=True)
class Contact:
    """Contact between bodies.

    pairs            every unordered pair of materials, sorted; the numbers that must hold in every engine
    ignored_groups   sorted pairs of collision groups (first ≤ second) whose bodies do not touch each other
    excluded_bodies  sorted pairs of body names (first < second) that do not touch: those the spec names and every
                     parent and child joined by a joint. Bodies joined rigidly (through fixed joints), and bodies that
                     both cannot move, never touch by definition and are not listed.
    """

    friction_cone: str = "elliptic"
    materials: tuple[Material, ...] = ()
    pairs: tuple[PairContact, ...] = ()
    ignored_groups: tuple[tuple[str, str], ...] = ()
    excluded_bodies: tuple[tuple[str, str], ...] = ()

    def __repr__(self) -> str:
        return f"<Contact: {self.friction_cone}, {len(self.materials)} materials, {len(self.pairs)} pairs>"


@dataclass(frozen=True, slots=True)
class Physics:
    """Gravity (m/s², world axes), timestep (s) and duration (s, a whole number of steps: ``steps``); the fluid around all
    bodies that have a box, None: a vacuum. ``integrator``: ``common``, semi-implicit Euler, or ``engine``, the usual method of
    each engine. ``damping`` of joints: ``explicit`` or ``implicit`` in time."""

    gravity: Vector3 = (0.0, 0.0, -9.81)
    timestep: float = 0.001
    steps: int = 0
    fluid: Fluid | None = field(default=None, metadata=LEFT_OUT)
    integrator: str = field(default="common", metadata=LEFT_OUT)
    damping: str = field(default="explicit", metadata=LEFT_OUT)


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """Recording of a run: every ``every_steps`` steps, the named channels."""

    every_steps: int = 1
    channels: tuple[str, ...] = tuple(sorted(CHANNELS))


@dataclass(frozen=True, slots=True)
class Expectation:
    """A named expectation with its parameters as sorted (name, value) pairs; see ``runner/expectations.py``. Places of several
    bodies are pairs (body, place) sorted by body."""

    kind: str
    parameters: tuple[tuple[str, float | str | tuple[float, ...] | tuple[tuple[str, Vector3], ...]], ...] = ()


@dataclass(frozen=True, slots=True)
class PairSettings:
    """Solver settings of one engine for contact between two materials (``first`` ≤ ``second``), sorted by name; they replace
    the engine's own there."""

    first: str
    second: str
    settings: tuple[tuple[str, bool | int | float | str], ...]


@dataclass(frozen=True, slots=True)
class EngineOptions:
    """Options of the spec for one engine: solver settings (never the model), approximations accepted by name, and
    features to be computed outside the engine because the engine has no native form of them."""

    engine: str
    settings: tuple[tuple[str, bool | int | float | str], ...] = ()
    accept: tuple[str, ...] = ()
    outside: tuple[str, ...] = ()
    pairs: tuple[PairSettings, ...] = field(default=(), metadata=LEFT_OUT)
    """Settings of pairs of materials, sorted by their names."""


@dataclass(frozen=True, slots=True, weakref_slot=True)
class World:
    """A resolved scenario; immutable. Its canonical JSON (``world/canonical.py``) gives its SHA-256."""

    name: str
    bodies: tuple[Body, ...]
    contact: Contact = Contact()
    physics: Physics = Physics()
    record: RecordOptions = RecordOptions()
    expectations: tuple[Expectation, ...] = ()
    engines: tuple[EngineOptions, ...] = ()
    controllers: tuple[JointController, ...] = ()
    trajectory: JointTrajectory | None = None
    constraints: tuple[Constraint, ...] = field(default=(), metadata=LEFT_OUT)
    """Constraints between bodies and joints outside the tree, sorted by name."""
    forces: tuple[Force, ...] = field(default=(), metadata=LEFT_OUT)
    """Forces and torques on bodies during given times, in the order of the spec."""
    motions: tuple[KinematicMotion, ...] = field(default=(), metadata=LEFT_OUT)
    """Motions of the kinematic bodies, one each, in the order of the bodies."""
    sums: tuple[JointSum, ...] = field(default=(), metadata=LEFT_OUT)
    """Weighted sums of joint positions along which something acts, sorted by name."""
    frames: tuple[Frame, ...] = field(default=(), metadata=LEFT_OUT)
    """Named frames on bodies, sorted by name."""

    def __repr__(self) -> str:
        return f"<World {self.name!r}: {len(self.bodies)} bodies, {self.physics.steps} steps of {self.physics.timestep:g} s>"

    compile = Method("simspec.api:compile_for")
    verify = Method("simspec.proof.verify:verify")
    run = Method("simspec.runner.execution:run")
    session = Method("simspec.api:session")
    show = Method("simspec.report.notebook:show_world")

    def options(self, engine: str) -> EngineOptions:
        """The options given for ``engine``; empty ones when the spec gives none."""
        for options in self.engines:
            if options.engine == engine:
                return options
        return EngineOptions(engine)


@dataclass(frozen=True, slots=True)
class EnginePair:
    """The law of two shapes that an engine holds as a pair, and which overrides the numbers of both.

    ``first`` and ``second`` are names of shapes, ``first`` < ``second``; ``margin``: of both together (m).
    """

    first: str
    second: str
    surface: Surface
    margin: float = 0.0


@dataclass(frozen=True, slots=True)
class EngineServo:
    """A position or velocity controller of its own that an engine holds for a joint: gains as in
    :class:`simspec.world.actions.JointController`, and the largest effort (None: unlimited)."""

    joint: str
    kp: float
    kd: float
    effort_limit: float | None


@dataclass(frozen=True, slots=True)
class ReadBack:
    """The world as an engine (or an independent reader of a file) says it holds it, in the world's frames and order.

    ``unreadable`` maps the dotted name of a field that cannot be read back (``joint.velocity_limit``,
    ``shape.visual``, ``friction_cone``, ...) to the reason; such fields hold their type's default and are not compared.

    ``inventory`` is everything else that the live engine holds and that can act, by the engine's own names
    (``opt.solver``, ``geom.floor_0.gap``, ``count.tendon``); lists stand for tuples, since it comes as JSON. ``neutral``:
    values of such entries in the same engine without a model, by names of the engine's module's choice. The expected inventory
    is from :meth:`simspec.engines.kit.contract.Engine.expected_inventory`. That of an independent reader holds the solver
    settings that stand in the engine's own file, as ``settings.NAME``.
    """

    bodies: tuple[Body, ...]
    gravity: Vector3
    timestep: float
    friction_cone: str = "elliptic"
    unreadable: dict[str, str] = field(default_factory=dict)
    pairs: tuple[EnginePair, ...] = ()
    servos: tuple[EngineServo, ...] = ()
    inventory: dict[str, EngineValue] = field(default_factory=dict)
    neutral: dict[str, EngineValue] = field(default_factory=dict)
    constraints: tuple[Constraint, ...] = field(default=(), metadata=LEFT_OUT)
    sums: tuple[JointSum, ...] = field(default=(), metadata=LEFT_OUT)
    frames: tuple[Frame, ...] | None = field(default=None, metadata=LEFT_OUT)
    """The named frames, sorted by name; None: it receives none."""
    fluid: Fluid | None = field(default=None, metadata=LEFT_OUT)
    laws: tuple[PairContact, ...] = field(default=(), metadata=LEFT_OUT)
    """The laws of materials, of an engine that holds a table of them (``contact.py``)."""
    made_of: str = field(default="", metadata=LEFT_OUT)
    """A hash of all that its numbers follow from, but the states it is put into, of an engine that can say so: where it is the
    same, every number is, to the last bit. It is compared with nothing; the complete self-test looks at it."""

    def __repr__(self) -> str:
        return f"<ReadBack: {len(self.bodies)} bodies, {len(self.unreadable)} unreadable fields>"
