"""Everything that ODE holds beside the fields of the read-back, and that can act; what it must be says ``expected.py``."""

from __future__ import annotations

import math
from typing import Any

from simspec.engines.kit.inventory import named_set
from simspec.engines.kit.labels import sidecar_labels
from simspec.engines.ode.building import SOLVERS
from simspec.engines.ode.readback import asked, told_law
from simspec.engines.ode.simulation import Simulation
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import HeldValue

BIG = 1e308
"""Stands for infinity, which is no number in JSON."""
WORLD = (
    *("ERP", "CFM", "AutoDisableFlag", "QuickStepNumIterations", "QuickStepW", "ContactMaxCorrectingVel"),
    *("ContactSurfaceLayer", "LinearDamping", "AngularDamping", "MaxAngularSpeed"),
)
"""Numbers of a world, by the ends of the names of ODE's functions."""
BODY = (
    *("GyroscopicMode", "FiniteRotationMode", "GravityMode", "AutoDisableFlag"),
    *("LinearDamping", "AngularDamping", "MaxAngularSpeed", "NumJoints"),
)
"""The same of a body."""
TYPES = {1: "ball", 2: "hinge", 3: "slider", 5: "universal", 6: "hinge2", 7: "fixed", 9: "amotor", 10: "lmotor"}
"""ODE's numbers of types of joints."""
ROWS = ("joint", "rotor", "rub", "stop")
"""The joints of a body, as the part in C numbers them."""


def finite(value: float) -> float:
    return max(-BIG, min(BIG, float(value)))


def inventory(sim: Simulation) -> dict[str, HeldValue]:
    """Everything else that is held, by name."""
    lib, built = sim.library, sim.built
    found = of_world(sim, lib.sim_world(sim.sim))
    found |= sidecar_labels(sim.sidecar)
    found["solver"] = SOLVERS[lib.sim_quick(sim.sim)]
    found["laid before every step"] = not lib.sim_native(sim.sim)
    found["count.geoms"] = int(lib.dSpaceGetNumGeoms(lib.sim_space(sim.sim)))
    for row, body in enumerate(sim.document.bodies):
        for name, value in _body(sim, row).items():
            found[f"body.{body.name}.{name}"] = value
    for number, (row, name) in enumerate(built.shapes):
        geom = lib.sim_geom(sim.sim, number)
        found[f"shape.{name}.of"] = sim.names[row]
        found[f"shape.{name}.enabled"] = bool(lib.dGeomIsEnabled(geom))
        found[f"shape.{name}.bits"] = bool(lib.dGeomGetCategoryBits(geom) & lib.dGeomGetCollideBits(geom))
        carrier = lib.sim_carrier(sim.sim, row)
        wanted = None if carrier < 0 else lib.sim_body_of(sim.sim, carrier)
        found[f"shape.{name}.moves_with"] = lib.dGeomGetBody(geom) == wanted and (carrier >= 0 or wanted is None)
    for one, first in enumerate(built.materials):
        for other in range(one, len(built.materials)):
            held = told_law(sim, one, other)
            if held[7]:
                found[f"law.{first}.{built.materials[other]}.softness"] = tuple(held[5:7])
    return found | _filter(sim)


def of_world(sim: Simulation, world: Any) -> dict[str, HeldValue]:
    """A world's own numbers."""
    return {f"world.{name}": finite(getattr(sim.library, f"dWorldGet{name}")(world)) for name in WORLD}


def neutral(sim: Simulation) -> dict[str, HeldValue]:
    """What an empty world of ODE's holds."""
    world = sim.library.dWorldCreate()
    try:
        return of_world(sim, world)
    finally:
        sim.library.dWorldDestroy(world)


def _body(sim: Simulation, row: int) -> dict[str, HeldValue]:
    lib = sim.library
    body = lib.sim_body_of(sim.sim, row)
    found: dict[str, HeldValue] = {"model": sim.document.bodies[row].model, "held": bool(body)}
    found["joint"] = sim.document.bodies[row].joint.name
    found["seen"] = ", ".join(shape.name for shape in sim.document.bodies[row].shapes if not shape.copies)
    if body:
        found |= {name: finite(getattr(lib, f"dBodyGet{name}")(body)) for name in BODY}
        found["GyroscopicMode"] = float(bool(found["GyroscopicMode"]))  # ODE returns the bit of a flag
        found["enabled"] = bool(lib.dBodyIsEnabled(body))
        found["kinematic"] = bool(lib.dBodyIsKinematic(body))
    for number, name in enumerate(ROWS):
        joint = lib.sim_joint(sim.sim, row, number)
        if joint:
            found[f"{name}.type"] = TYPES.get(lib.dJointGetType(joint), "unknown")
            found[f"{name}.enabled"] = bool(lib.dJointIsEnabled(joint))
            found[f"{name}.of"] = lib.dJointGetBody(joint, 0) == body
    return found | _where(sim, row)


def _where(sim: Simulation, row: int) -> dict[str, HeldValue]:
    """What ODE's own joint says of its axis and position, beside the coordinates that bodies are laid by."""
    lib, joint = sim.library, sim.library.sim_joint(sim.sim, row, 0)
    kind = sim.document.bodies[row].joint.kind
    q, _ = sim.get_state()
    if not joint or kind not in SCALAR_JOINTS:
        return {}
    axis = asked(lib.dJointGetHingeAxis if kind == "hinge" else lib.dJointGetSliderAxis, joint, 3)
    own = float(lib.dJointGetHingeAngle(joint) if kind == "hinge" else lib.dJointGetSliderPosition(joint))
    position = float(q[sim.q_places[row]][0])
    off = own - position
    if kind == "hinge":
        off = math.remainder(off, 2.0 * math.pi)
    poses, _ = sim.file_frames()
    turn = tuple(poses[row, 3:].tolist())
    local = frames.rotate(frames.conjugate(turn), tuple(axis))  # type: ignore[arg-type]
    told = sim.document.bodies[row].joint.axis  # type: ignore[union-attr]
    apart = max(abs(a - b) for a, b in zip(local, told, strict=True))
    return {"joint.fits": abs(off) <= FIT * max(1.0, abs(position)) and apart <= FIT}


FIT = 1e-9
"""How far ODE's joints may be from the coordinates that bodies are laid by (rad, m): the proof's tolerance."""


def _filter(sim: Simulation) -> dict[str, HeldValue]:
    """For every shape the others that it does not touch, itself not counted."""
    names = [f"{name}.0" for _, name in sim.built.shapes]  # as carriers are called: in one layer
    apart: dict[str, list[str]] = {name: [] for name in names}
    for one, first in enumerate(names):
        for other in range(one + 1, len(names)):
            if sim.library.sim_apart(sim.sim, one, other):
                apart[first].append(names[other])
                apart[names[other]].append(first)
    return {f"apart.{name}": named_set(others) for name, others in apart.items()}
