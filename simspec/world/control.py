"""How joints of the world are driven: controllers, and the trajectory that they follow. Frozen, SI units, all resolved.

Joints are hinges and slides, by their full names; numbers stand on the joint's side (gears are resolved away: through a
gear of ratio g an actuator's stiffness and damping count g², its effort g, its velocity 1/g).

At every step n (time t = n dt) a controller sees the state (q, v) before the step, and gives efforts τ that are held for the
step; one that acts every m steps does so in the steps n that m divides, and its efforts are held for m steps (zero-order hold).
q*, v*, a* are the trajectory's position and its derivatives, f its feed-forward effort, all at t; M and h are the mass
matrix and the bias force (Coriolis, centrifugal, gravity) of the *world* at (q, v), never an engine's; g is h at rest.

pd               τ = clip(kp (q* − q) + kd (v* − v) + f [+ g]), joint by joint
computed-torque  τ = clip(M a + h + f), a = a* + 2 ζ ω (v* − v) + ω² (q* − q); of joints of the same tree that it does not
                 drive it takes the acceleration to be zero
native           the engine's own position controller with gains kp and kd: a declared difference between engines

``explicit``: as written. ``implicit``: the law at the end of the step, with targets at t + dt, solved for the acceleration
that it causes: v' = v + dt a, q' = q + dt v' stand for v and q. Stable at any timestep as long as nothing is clipped or
touched. One that acts every m steps has m dt in place of dt: the law at the end of the time for which its efforts are held.
pd: (M + dt kd + dt² kp) a = kp (q* − q − dt v) + kd (v* − v) + f − h [+ g];
computed-torque: a = (a* + 2 ζ ω (v* − v) + ω² (q* − q − dt v)) / (1 + 2 ζ ω dt + ω² dt²).
After J. Tan, K. Liu, G. Turk, Stable Proportional-Derivative Controllers, IEEE CG&A 2011, with the term dt² kp, which
semi-implicit Euler calls for.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Controller:
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
class Trajectory:
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
