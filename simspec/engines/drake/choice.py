"""Which of Drake's contact solvers a world gets where the settings leave it to simspec."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.control.native import natives
from simspec.support.declarations import Level, Refinement, unsupported_if
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.meeting import meeting_laws, solid_shapes
from simspec.world.reach import crossing
from simspec.world.types import World

MOST_TAMSI, BODY_SECONDS = 8, 0.008
"""TAMSI is taken for one moving body with collision shapes; for several up to this many, and up to this number times the
timestep (s). Its equations are dense (36 boxes 30 ms a step, where SAP takes 5), and at 4 ms it fails to converge in
towers of six boxes, at 1 ms not in towers of eight (measured)."""

CROSSED_SECONDS = 0.002
"""The largest timestep (s) of TAMSI where the edges of boxes may cross: at 4 ms it fails to converge on some (measured)."""
PRESSURE_SECONDS = 0.001
"""The largest timestep (s) of hydroelastic contact with friction by SAP: at 2 ms a push at μ = 1.5 meets 2.3 times its
friction, at 8 ms sliders of μ = 1 leave the floor for good. At 1 ms pushes are off by
1 % up to μ = 0.5, by 35 % at 1, within what SAP's friction is declared to be off (measured to μ = 1.5)."""


def approximation(world: World) -> str:
    """``tamsi`` where friction matters, few bodies move, no joint has limits and none a PD controller of Drake's: its friction
    is exact and its slides do not hop. ``sap`` elsewhere: it has the common law's β, stops joints at their limits, has the
    controllers, converges where hulls of meshes land and where a kinematic body carries joints, and its time grows with the
    number of contacts alone."""
    rubs = any(law.friction for law in meeting_laws(world).values())
    groups = rigid_groups(world)
    moving = sum(groups[body.name] != "world" and bool(solid_shapes(body)) for body in world.bodies)
    limited = any(body.joint.position_limits for body in world.bodies)
    crossed = crossing(world) and world.physics.timestep > CROSSED_SECONDS
    few = moving <= 1 or (moving <= MOST_TAMSI and moving * world.physics.timestep <= BODY_SECONDS)
    diverges = carries_joints(world) or moves_hulls(world) or crossed
    return "tamsi" if rubs and few and not limited and not natives(world) and not diverges else "sap"


def moves_hulls(world: World) -> bool:
    """Whether a body with a mesh moves and touches: of 60 landings of irregular hulls TAMSI fails to converge in 8, SAP in
    none (measured at 1 ms, μ = 0.5: ``tools/hulls.py``)."""
    groups = rigid_groups(world)
    return any(
        shape.kind == "mesh" for body in world.bodies if groups[body.name] != "world" for shape in solid_shapes(body)
    )


def carries_joints(world: World) -> bool:
    """Whether a kinematic body carries others on joints."""
    kinematic = {motion.body for motion in world.motions}
    return any(
        body.joint.kind != "fixed" and body.joint.parent is not None
        for root, bodies in (trees(world) if kinematic else {}).items()
        if root in kinematic
        for body in bodies
    )


def light_enough(world: World) -> Refinement | None:
    """Kinematic bodies that carry joints are not supported by TAMSI."""
    if asked_approximation(world) != "tamsi" or not carries_joints(world):
        return None
    return unsupported_if(
        "TAMSI fails to converge in the first step of a tree whose root is 1e5 times as heavy as what it carries (measured); "
        "contact_approximation: sap does not"
    )


def asked_approximation(world: World) -> str:
    """The solver that a world's options name, or get."""
    asked = dict(world.options("drake").settings).get("contact_approximation", "auto")
    return approximation(world) if asked == "auto" else str(asked)


def coulomb(world: World) -> Refinement | None:
    """Friction is exact unless SAP has some."""
    if not any(law.friction for law in meeting_laws(world).values()):
        return Refinement(Level.VIA_API, "nothing that meets has friction")
    return Refinement(Level.VIA_API, "TAMSI's friction") if asked_approximation(world) == "tamsi" else None


def stops(world: World) -> Refinement | None:
    """Joints stop at their limits as the language has it but by TAMSI, which has springs there."""
    if asked_approximation(world) != "sap":
        return None
    return Refinement(
        Level.VIA_API, "SAP's limits stop within the step, to 1.3e-8 rad and 5e-9 m under gravity at 1 ms (with dt²)"
    )


def boxes_hold(world: World) -> Refinement | None:
    """Boxes are exact where their edges cannot cross, and by hydroelastic contact, which is not supported with friction by SAP
    at large timesteps."""
    if not dict(world.options("drake").settings).get("hydroelastic_faces"):
        return (
            None
            if crossing(world)
            else Refinement(Level.EXACT, "no two boxes are so alike in size that their edges may cross")
        )
    small = world.physics.timestep <= PRESSURE_SECONDS
    if small or asked_approximation(world) == "tamsi" or not any(law.friction for law in meeting_laws(world).values()):
        return Refinement(Level.EXACT, "by pressure")
    return unsupported_if(
        f"hydroelastic contact with friction by SAP throws boxes off at timesteps above {1e3 * PRESSURE_SECONDS:g} ms "
        "(measured): take a smaller one, or contact_approximation: tamsi"
    )


def chosen(world: World, settings: Mapping[str, bool | int | float | str]) -> dict[str, bool | int | float | str]:
    """The settings with what ``contact_approximation: auto`` stands for."""
    if settings["contact_approximation"] != "auto":
        return dict(settings)
    return {**settings, "contact_approximation": approximation(world)}
