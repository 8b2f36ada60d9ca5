"""What touches what in Rapier, and by which law: a hook that Rapier calls for pairs of colliders.

Rapier combines a number of each of two colliders; a table of materials has more numbers than such rules can give. Where all
that meets has one law, colliders have its numbers and no hook is called for them. Else the hook writes those of the two
materials into each pair of colliders before the solver sees it (measured: exact).

Rapier solves a step without restitution first, and then adds to normal impulses, in one sweep over the points, what makes
things bounce: a ball that hits two others at once left with 12.5 % more energy than it came with, a box that landed flat with
0.77 of its speed and a spin, and the friction of an impact was that without the bounce (measured). So the hook gives Rapier
no restitution: a point that approaches at c has, for the step, the overlap −e c dt / β that error reduction undoes at e c, in
the same sweeps as all else (measured: energy to 1e-4, four points and two bodies at once, friction of the whole impulse).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from simspec.engines.rapier.units import ERROR_REDUCTION, NAME, SCALE
from simspec.errors import EngineError
from simspec.formats.world.tree import Document
from simspec.world import frames
from simspec.world.types import Hardness, PairContact


def not_held(law: PairContact) -> str | None:
    """What of a law Rapier does not have; None where it has all."""
    if law.hardness.kind != "common":
        return f"the hardness {law.hardness.kind}"
    if law.hardness != Hardness():
        return "numbers beside the common hardness"
    if law.margin is not None:
        return "a margin"
    if law.rolling_friction or law.torsional_friction:
        return "torsional or rolling friction"
    return None


class Laws:
    """The hook. ``places``: of each collider the row of what carries it (−1: it cannot move) and of its body."""

    def __init__(
        self,
        rapier: Any,
        document: Document,
        laws: Sequence[PairContact],
        colliders: Sequence[Any],
        materials: Sequence[str],
        groups: Sequence[str],
        places: Sequence[tuple[int, int]],
    ):
        for law in laws:
            if wrong := not_held(law):
                raise EngineError(NAME, f"does not support {wrong} of {law.first} and {law.second}")
        self._flags, self._kinds = rapier.SolverFlags.COMPUTE_IMPULSES, rapier.ActiveHooks
        self.colliders = list(colliders)
        self.number = {handle: index for index, handle in enumerate(colliders)}
        self.materials, self._groups, self._places = list(materials), list(groups), list(places)
        self.table: dict[tuple[str, str], tuple[float, float, float]] = {}
        self.named: dict[tuple[str, str], PairContact] = {(law.first, law.second): law for law in laws}
        for law in laws:
            row = (law.friction, law.restitution, law.restitution_threshold)
            self.table[law.first, law.second] = self.table[law.second, law.first] = row
        self._ignored = {pair for one, other in document.apart.groups for pair in ((one, other), (other, one))}
        names = {body.name: row for row, body in enumerate(document.bodies)}
        self._excluded = {
            pair
            for one, other in document.apart.bodies
            for pair in ((names[one], names[other]), (names[other], names[one]))
        }
        used = sorted(set(self.materials))
        own = {self.table[pair] for pair in self.table if set(pair) <= set(used)}
        friction, restitution, threshold = next(iter(own)) if len(own) == 1 else (0.0, 1.0, 0.0)
        self.uniform = None if restitution or threshold else (friction, restitution, threshold)
        """The one law of all that meets, where there is one, without a threshold, and nothing bounces."""
        self._timestep = document.timestep
        meets = {material: {other for one, other in self.table if one == material} for material in used}
        self._asked = [
            not set(used) <= meets[material]
            or any(group == one for one, _ in self._ignored)
            or any(row == one for one, _ in self._excluded)
            for material, group, (_, row) in zip(self.materials, self._groups, self._places, strict=True)
        ]
        self.calls = 0

    def install(self, world: Any) -> None:
        """Have Rapier ask of the colliders for which it matters."""
        friction, restitution, _ = self.uniform or (0.0, 0.0, 0.0)
        for number, handle in enumerate(self.colliders):
            held = world.colliders[handle]
            held.friction, held.restitution = friction, restitution
            flags = self._kinds.FILTER_CONTACT_PAIRS if self._asked[number] else None
            if self.uniform is None:
                more = self._kinds.MODIFY_SOLVER_CONTACTS
                flags = more if flags is None else flags | more
            if flags is not None:
                held.active_hooks = flags
        world.physics_hooks = self

    def apart(self, one: int, other: int) -> bool:
        """Whether two colliders, by their numbers, do not touch."""
        (first, body), (second, another) = self._places[one], self._places[other]
        return (
            first == second
            or (self._groups[one], self._groups[other]) in self._ignored
            or (body, another) in self._excluded
            or (self.materials[one], self.materials[other]) not in self.table
        )

    def slippery(self, material: str) -> bool:
        """Whether a material has no friction with any."""
        return not any(friction for pair, (friction, *_) in self.table.items() if material in pair)

    # --- what Rapier calls ------------------------------------------------------------------------------------

    def filter_contact_pair(self, ctx: Any) -> Any:
        return None if self.apart(self.number[ctx.collider1], self.number[ctx.collider2]) else self._flags

    def filter_intersection_pair(self, ctx: Any) -> bool:
        return False

    def modify_solver_contacts(self, ctx: Any) -> None:
        one, other = self.number[ctx.collider1], self.number[ctx.collider2]
        friction, restitution, threshold = self.table[self.materials[one], self.materials[other]]
        ctx.friction, ctx.restitution = friction, 0.0
        if restitution:
            self._bounce(ctx, restitution, threshold)

    def _bounce(self, ctx: Any, restitution: float, threshold: float) -> None:
        """Have every point of a pair that approaches at ``threshold`` (m/s) or more, and arrives in this step, leave at
        ``restitution`` times that speed. Rapier's point of attack, halfway between the two surfaces, stays."""
        pair = [ctx.bodies[handle] for handle in (ctx.rigid_body1, ctx.rigid_body2)]
        normal = ctx.normal.to_tuple()
        for number, contact in enumerate(ctx.solver_contacts):
            points = (contact.point, contact.point2)  # in the world
            speeds = [body.velocity_at_point(point).to_tuple() for body, point in zip(pair, points, strict=True)]
            closing = sum((a - b) * n for a, b, n in zip(*speeds, normal, strict=True))
            if closing <= 0.0 or closing < SCALE * threshold or contact.dist > closing * self._timestep:
                continue
            gap = -restitution * closing * self._timestep / ERROR_REDUCTION
            if gap < contact.dist:
                shift = tuple(0.5 * (gap - contact.dist) * n for n in normal)
                one, other = (point.to_tuple() for point in points)
                ctx.set_solver_contact(
                    number, point=frames.subtract(one, shift), point2=frames.add(other, shift), dist=gap
                )

    def law_table(self) -> dict[tuple[str, str], tuple[float, float, float]]:
        """By sorted materials friction, restitution and threshold."""
        return {pair: row for pair, row in self.table.items() if pair[0] <= pair[1]}
