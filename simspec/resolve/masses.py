"""Whether what moves has an inertia: of bodies that are joined rigidly the sum counts."""

from __future__ import annotations

from collections.abc import Sequence

from simspec.errors import Problem
from simspec.language.locate import locate
from simspec.language.moments import principal_moments
from simspec.language.sources import Source
from simspec.world.gathering import rigid_members, singular, summed
from simspec.world.types import Body


def without_inertia(source: Source, bodies: Sequence[Body]) -> list[Problem]:
    """The problems of rigid groups that move and have no mass, or a tensor of inertia that is singular. Single bodies are not
    looked at: ``language/checks.py`` has done so."""
    problems = []
    for top, members in rigid_members(bodies).items():
        others = [body.name for body, _ in members[1:]]
        if not others:
            continue
        whole = summed((body.inertial, pose) for body, pose in members)
        if not singular(whole):
            continue
        path = f"bodies.{top}"
        names = ", ".join(others[:6]) + (", ..." if len(others) > 6 else "")
        if not whole.mass:
            message, found = f"this body moves, and neither it nor what is fixed to it ({names}) has a mass", None
            hint = "a mass of one of them, or shapes with density"
        else:
            moments = ", ".join(f"{moment:.6g}" for moment in principal_moments(whole.inertia))
            message = f"the principal moments of this body and what is fixed to it ({names}) must be above 0"
            found, hint = f"{moments} kg m²", "a point mass needs others that are not on one line with it"
        problems.append(Problem(message, path, locate(source, path), found=found, hint=hint))
    return problems
