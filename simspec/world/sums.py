"""Weighted sums of joint positions, with what acts along them. Frozen, SI units, all resolved.

L = Σ cᵢ qᵢ. A force F along L is the effort cᵢ F on each joint, by virtual work. Springs and dampers are explicit in time, as
those of joints are; limits are hard, inelastic stops, as those of joints are.
"""

from __future__ import annotations

from dataclasses import dataclass, field


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
