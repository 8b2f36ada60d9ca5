"""Actions on bodies and joints besides gravity and contact: controllers and trajectories, forces, motions of kinematic
bodies, a fluid, springs along sums of joint positions. Frozen, SI units, all resolved.
"""

from __future__ import annotations

from dataclasses import dataclass, field

# How joints of the world are driven: controllers, and the trajectory that they follow. Frozen, SI units, all resolved.
#
# Joints are hinges and slides, by their full names; numbers stand on the joint's side (gears are resolved away: through a
# gear of ratio g an actuator's stiffness and damping count g², its effort g, its velocity 1/g).
#
# At every step n (time t = n dt) a controller sees the state (q, v) before the step, and gives efforts τ that are held for the
# step; one that acts every m steps does so in the steps n that m divides, and its efforts are held for m steps (zero-order
# hold). q*, v*, a* are the trajectory's position and its derivatives, f its feed-forward effort, all at t; M and h are the mass
# matrix and the bias force (Coriolis, centrifugal, gravity) of the *world* at (q, v), never an engine's; g is h at rest.
#
# pd               τ = clip(kp (q* − q) + kd (v* − v) + f [+ g]), joint by joint
# computed-torque  τ = clip(M a + h + f), a = a* + 2 ζ ω (v* − v) + ω² (q* − q); of joints of the same tree that it does not
#                  drive it takes the acceleration to be zero
# native           the engine's own position controller with gains kp and kd: a declared difference between engines
#
# ``explicit``: as written. ``implicit``: the law at the end of the step, with targets at t + dt, solved for the acceleration
# that it causes: v' = v + dt a, q' = q + dt v' stand for v and q. Stable at any timestep as long as nothing is clipped or
# touched. One that acts every m steps has m dt in place of dt: the law at the end of the time for which its efforts are held.
# pd: (M + dt kd + dt² kp) a = kp (q* − q − dt v) + kd (v* − v) + f − h [+ g];
# computed-torque: a = (a* + 2 ζ ω (v* − v) + ω² (q* − q − dt v)) / (1 + 2 ζ ω dt + ω² dt²).
# After J. Tan, K. Liu, G. Turk, Stable Proportional-Derivative Controllers, IEEE CG&A 2011, with the term dt² kp, which
# semi-implicit Euler calls for.


@dataclass(frozen=True, slots=True)
class JointController:
    """One law on some joints; every joint has at most one controller.

    joints               full names, in the order of the world's bodies
    kp, kd               one for each joint (N m/rad, N m s/rad; N/m, N s/m), ≥ 0; pd and native, else empty.
                         A velocity actuator has kp = 0; an effort actuator has both 0 and feed-forward alone
    natural_frequency    ω (rad/s), and
    damping_ratio        ζ: computed-torque, else 0
    gravity_compensation whether pd adds g
    effort_limits        one for each joint (N m, N): τ is clipped to ± this; None = not clipped
    every_steps          m ≥ 2: it acts every m steps; 0: in every step
    """

    name: str
    joints: tuple[str, ...]
    law: str = "pd"
    discretisation: str = "explicit"
    kp: tuple[float, ...] = ()
    kd: tuple[float, ...] = ()
    natural_frequency: float = 0.0
    damping_ratio: float = 0.0
    gravity_compensation: bool = False
    effort_limits: tuple[float | None, ...] = ()
    every_steps: int = field(default=0, metadata={"left_out": True})

    @property
    def hold(self) -> int:
        """For how many steps its efforts are held."""
        return max(1, self.every_steps)

    def __repr__(self) -> str:
        return f"<Controller {self.name!r}: {self.law}, {len(self.joints)} joints>"


@dataclass(frozen=True, slots=True)
class JointTrajectory:
    """Where joints should be, by points in time.

    joints          full names; the columns. A driven joint without a column is held at its initial position
    times           strictly increasing (s), the first ≥ 0. Before the first and after the last point the joints stand
                    still there, without feed-forward change
    positions       a row for each time (rad, m)
    velocities      a row for each time, or empty (rad/s, m/s): cubic and quintic
    accelerations   a row for each time, or empty: quintic, with velocities
    efforts         feed-forward: a row for each time, or empty (N m, N); linear in between (held with ``hold``)
    interpolation   hold     the position of the last point passed; v* = a* = 0
                    linear   straight between points; v* the slope of the segment, a* = 0
                    cubic    with velocities: one cubic for each segment (Hermite); else the C² spline that begins and
                             ends at rest
                    quintic  with velocities and accelerations: one quintic for each segment; else the C⁴ spline that
                             begins and ends at rest without acceleration
    """

    joints: tuple[str, ...]
    times: tuple[float, ...]
    positions: tuple[tuple[float, ...], ...]
    velocities: tuple[tuple[float, ...], ...] = ()
    accelerations: tuple[tuple[float, ...], ...] = ()
    efforts: tuple[tuple[float, ...], ...] = ()
    interpolation: str = "cubic"

    def __repr__(self) -> str:
        return f"<Trajectory: {len(self.joints)} joints, {len(self.times)} points, {self.interpolation}>"


# A fluid around the bodies, and the boxes by which they feel it. Frozen, SI units, all resolved.
#
# The law acts on one box for each body, about its centre of mass, with the edges ``edges`` (a, b, c) along the axes that
# ``quaternion`` turns: the cuboid of even density that has the body's mass and principal moments of inertia. With v and ω the
# velocity of the centre against the fluid and the angular velocity, both in the axes of the box, d the mean of the edges, ρ the
# density and μ the viscosity, the force and the torque on it are, along each axis in turn,
#
#     fx = −3 π d μ vx − ½ ρ b c |vx| vx        tx = −π d³ μ ωx − ρ a (b⁴ + c⁴)/64 |ωx| ωx
#
# It is the model of fluids by boxes of equal inertia that one engine brings, to its last constant (``LEAST``; a test holds it
# against that engine's own numbers). It is explicit in time: taken at the state before the step.

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

LEAST_MOMENT = 1e-15
"""kg m²: an edge is √(6 λ/m) with λ the sum of two principal moments less the third, or this where λ is less. It is felt by
bodies of less than a microgram alone."""


@dataclass(frozen=True, slots=True)
class Fluid:
    """Density (kg/m³), viscosity (Pa s), and the velocity of the fluid in world axes (m/s), everywhere the same."""

    density: float = 0.0
    viscosity: float = 0.0
    velocity: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class InertiaBox:
    """The box of a body: edges (m), and the orientation of its axes in the body's frame. Its centre is the centre of mass that
    engines receive (``world/inertia.py``)."""

    edges: Vector3
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)


# Forces and torques that act on bodies during given times. Frozen, SI units, all resolved.
#
# In every step a force is its mean over the step: a force that begins or ends between two steps counts by its share of the
# step, so that its impulse is exact at every timestep. It is taken at the state before the step, as all efforts are.


@dataclass(frozen=True, slots=True)
class Force:
    """A force and a torque on a body, constant in the world's axes.

    body     its full name
    force    N, world axes, at ``at``
    torque   N m, world axes; a couple, in addition to that of the force
    at       the point, in the body's frame (m); it moves with the body
    start    s, from which on it acts
    until    s, up to which it acts; None: to the end of the run
    """

    body: str
    force: Vector3 = (0.0, 0.0, 0.0)
    torque: Vector3 = (0.0, 0.0, 0.0)
    at: Vector3 = (0.0, 0.0, 0.0)
    start: float = 0.0
    until: float | None = None

    def __repr__(self) -> str:
        return f"<Force on {self.body!r}, {self.start:g} to {'the end' if self.until is None else f'{self.until:g}'} s>"


# Motions of kinematic bodies: where they are at every time, whatever pushes them. Frozen, SI units, all resolved.
#
# A kinematic body is a free root of a mass that is ``HEAVIER`` times that of all else that moves. Before every step an effort
# gives it the velocity that brings it to where its motion has it at the end of the step: contact and joints see a body of that
# velocity, and move it by 1/HEAVIER of what they would move a body of their own mass, which the next step takes back.

KINEMATIC_MASS_RATIO = 1e5
"""Of a kinematic body, relative to all that moves in its world. At 1e4 a box that slides on one shifts it by 2e-9 m in a step
of 1 ms, at 1e5 by 2e-10 m; at 1e8 one engine lifts the box at 2.5 mm/s (measured)."""


@dataclass(frozen=True, slots=True)
class KinematicMotion:
    """The motion of a kinematic body, by points in time.

    body            its full name
    times           strictly increasing (s), the first ≥ 0; before the first and after the last point it stands still there
    positions       of its frame's origin in the world (m), one for each time
    quaternions     w x y z of its frame in the world, one for each time
    interpolation   of positions as in :class:`simspec.world.actions.JointTrajectory`: linear, cubic (C²) or quintic (C⁴), at
                    rest at both ends. Between two points it turns about one axis, the shorter way, by a share of the angle: u,
                    u² (3 − 2 u) and u³ (10 − 15 u + 6 u²) at the share u of the time
    """

    body: str
    times: tuple[float, ...] = (0.0,)
    positions: tuple[Vector3, ...] = ((0.0, 0.0, 0.0),)
    quaternions: tuple[Quaternion, ...] = ((1.0, 0.0, 0.0, 0.0),)
    interpolation: str = "cubic"

    def __repr__(self) -> str:
        return f"<Motion of {self.body!r}: {len(self.times)} points, {self.interpolation}>"


# Weighted sums of joint positions, with what acts along them. Frozen, SI units, all resolved.
#
# L = Σ cᵢ qᵢ. A force F along L is the effort cᵢ F on each joint, by virtual work. Springs and dampers are explicit in time, as
# those of joints are; limits are hard, inelastic stops, as those of joints are.


@dataclass(frozen=True, slots=True)
class JointSum:
    """A weighted sum L of the positions of hinges and slides.

    name             by which the spec calls it; unique among the constraints
    joints           (joint, coefficient), sorted by joint; no coefficient is 0
    stiffness        k ≥ 0: a force −k (L − rest) along L
    rest             L at which the spring has no force
    damping          d ≥ 0: a force −d L̇ along L
    position_limits  (lower, upper) of L, None = unlimited
    dry_friction     f ≥ 0: the largest force along L against its motion, as of joints
    """

    name: str
    joints: tuple[tuple[str, float], ...]
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    position_limits: tuple[float, float] | None = None
    dry_friction: float = field(default=0.0, metadata={"left_out": True})

    def __repr__(self) -> str:
        return f"<JointSum {self.name!r} of {len(self.joints)} joints>"
