"""Motion as ODE's own steps make it, where a spec asks for that: ``engines.ode.settings.native_motion``."""

from __future__ import annotations

from simspec.support.declarations import Level, Refinement
from simspec.world.types import World

SWITCH = "native_motion"
FIRST_ORDER = (
    "by ODE's own steps in the bodies' coordinates, which are of first order and let joints come apart: after 2,000 steps of "
    "1 ms a tumbling body is 2e-4 rad off, two hinges 0.02, a ball and a hinge 0.15, seven hinges 0.65 (L6, measured)"
)
SHORT = "ODE's own steps are of first order, and joints come apart: L6 says how far from the exact motion"
CASE = Refinement(Level.APPROXIMATE, FIRST_ORDER, short=SHORT)


def own_steps(world: World) -> Refinement | None:
    """What joints are where a spec asks for ODE's own motion; None elsewhere."""
    return CASE if dict(world.options("ode").settings).get(SWITCH) else None
