"""Motion as ODE's own steps make it, where a spec asks for that: ``engines.ode.settings.native_motion``."""

from __future__ import annotations

from simspec.support.declarations import Level, Refinement, Support
from simspec.support.features import Feature
from simspec.world.types import World

SWITCH = "native_motion"
FIRST_ORDER = (
    "by ODE's own steps in the bodies' coordinates, which are of first order and let joints come apart: after 2,000 steps of "
    "1 ms a tumbling body is 2e-4 rad off, two hinges 0.02, a ball and a hinge 0.15, seven hinges 0.65 (L6, measured)"
)
SHORT = {
    Feature.JOINT_HINGE: "hinges by ODE's own steps, of first order, come apart: L6 says how far from the exact motion",
    Feature.JOINT_SLIDE: "slides by ODE's own steps, of first order, come apart: L6 says how far from the exact motion",
    Feature.JOINT_BALL: "balls by ODE's own steps, of first order, come apart: L6 says how far from the exact motion",
    Feature.JOINT_FREE: "free bodies turn by ODE's own steps, of first order: L6 says how far from the exact motion",
}


def _by_own_steps(short: str) -> Support:
    case = Refinement(Level.APPROXIMATE, FIRST_ORDER, short=short)

    def refine(world: World) -> Refinement | None:
        return case if dict(world.options("ode").settings).get(SWITCH) is True else None

    return Support(Level.EXACT, "bodies are laid on their joints before every step", refine=refine, cases=(case,))


JOINTS = {feature: _by_own_steps(short) for feature, short in SHORT.items()}
"""Joints: exact, or what they are where a spec asks for ODE's own motion."""
