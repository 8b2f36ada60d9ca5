"""The values that ODE stores besides the fields of the read-back, and that can act, and what they must be (``expected``,
which runs without ODE)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from simspec.contact.plan import ContactPlan
from simspec.engines.kit.inventory import Carrier, expected_apart, named_set, sidecar_labels
from simspec.engines.ode.building import ERROR_REDUCTION, SOLVERS
from simspec.engines.ode.readback import asked, told_law
from simspec.engines.ode.simulation import Simulation
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, EngineValue, World

BIG = 1e308
"""In place of infinity, which JSON does not have."""
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


def inventory(sim: Simulation) -> dict[str, EngineValue]:
    """The stored values by name."""
    lib, built = sim.library, sim.built
    found = of_world(sim, lib.sim_world(sim.sim))
    found |= sidecar_labels(sim.sidecar)
    found["solver"] = SOLVERS[lib.sim_quick(sim.sim)]
    found["laid before every step"] = not lib.sim_native(sim.sim)
    found["count.geoms"] = int(lib.dSpaceGetNumGeoms(lib.sim_space(sim.sim)))
    for row, body in enumerate(sim.document.bodies):
        for name, value in _body(sim, row).items():
            found[f"body.{body.name}.{name}"] = value
    for number, (row, name) in enumerate(sim.units()):
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


def of_world(sim: Simulation, world: Any) -> dict[str, EngineValue]:
    """The numbers of a world."""
    return {f"world.{name}": finite(getattr(sim.library, f"dWorldGet{name}")(world)) for name in WORLD}


def neutral(sim: Simulation) -> dict[str, EngineValue]:
    """The values of an empty world."""
    world = sim.library.dWorldCreate()
    try:
        return of_world(sim, world)
    finally:
        sim.library.dWorldDestroy(world)


def _body(sim: Simulation, row: int) -> dict[str, EngineValue]:
    lib = sim.library
    body = lib.sim_body_of(sim.sim, row)
    found: dict[str, EngineValue] = {"model": sim.document.bodies[row].model, "held": bool(body)}
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


def _where(sim: Simulation, row: int) -> dict[str, EngineValue]:
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


def _filter(sim: Simulation) -> dict[str, EngineValue]:
    """For every shape the others that it does not touch, itself not counted."""
    names = [f"{name}.0" for _, name in sim.units()]  # as carriers are called: in one layer
    apart: dict[str, list[str]] = {name: [] for name in names}
    for one, first in enumerate(names):
        for other in range(one + 1, len(names)):
            if sim.library.sim_apart(sim.sim, one, other):
                apart[first].append(names[other])
                apart[names[other]].append(first)
    return {f"apart.{name}": named_set(others) for name, others in apart.items()}


OWN_TYPES = {"hinge": "hinge", "slide": "slider", "ball": "ball", "fixed": "fixed"}
ROW_TYPES = {"hinge": "amotor", "slide": "lmotor"}
Settings = Mapping[str, bool | int | float | str]


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``; ``neutral`` are ODE's defaults."""
    groups = rigid_groups(world)
    native = bool(settings.get("native_motion", False))
    found = dict(neutral)
    found |= {
        "world.ERP": neutral["world.ERP"] if native else 1e-300,
        "laid before every step": not native,
        "world.CFM": 0.0,
        "world.AutoDisableFlag": 0.0,
        "world.QuickStepNumIterations": float(settings["iterations"]),
        "solver": settings["solver"],
        "count.geoms": sum(len(solid_shapes(body)) for body in world.bodies),
    }
    joints = _joints(world)
    carriers = []
    for body in world.bodies:
        still = groups[body.name] == "world"
        for name, value in _body_expected(world, body, still, joints, native).items():
            found[f"body.{body.name}.{name}"] = value
        for shape in solid_shapes(body):
            carriers.append(Carrier(f"{shape.name}.0", body.name, shape.material, 0))
            found |= {
                f"shape.{shape.name}.of": body.name,
                f"shape.{shape.name}.enabled": True,
                f"shape.{shape.name}.bits": True,
                f"shape.{shape.name}.moves_with": True,
            }
    used = {shape.material for body in world.bodies for shape in solid_shapes(body)}
    for one, other in meeting_laws(world):
        if {one, other} <= used:
            found[f"law.{one}.{other}.softness"] = (ERROR_REDUCTION, float(settings["softness"]))
    return found | expected_apart(world, plan, carriers)


def _rows(body: Body) -> dict[str, str]:
    """The joints that ODE has for one of the world, by what they are for."""
    joint = body.joint
    if joint.kind == "free":
        return {}
    rows = {"joint": OWN_TYPES[joint.kind]}
    if joint.kind in ROW_TYPES:
        row = ROW_TYPES[joint.kind]
        rows |= {"rotor": row} if joint.armature else {}
        rows |= {"rub": row} if joint.dry_friction else {}
        if joint.position_limits is not None:
            rows["stop"] = "amotor" if joint.kind == "hinge" else "slider"
    return rows


def _held(world: World) -> dict[str, str | None]:
    """By body the one that ODE has a body for and that carries it; None of what cannot move."""
    groups = rigid_groups(world)
    held: dict[str, str | None] = {}
    for body in world.bodies:
        if groups[body.name] == "world":
            held[body.name] = None
        elif lumped_inertial(world, body).mass > 0.0:
            held[body.name] = body.name
        else:
            held[body.name] = held[body.joint.parent or ""]
    return held


def _joints(world: World) -> dict[str, int]:
    """How many of ODE's joints each of its bodies has; one for stops of a slide is its slider."""
    held = _held(world)
    count: dict[str, int] = {}
    for body in world.bodies:
        if held[body.name] != body.name:
            continue
        rows = _rows(body)
        above = None if body.joint.parent is None else held[body.joint.parent]
        if body.joint.kind == "fixed" and above is None:
            rows = {}
        number = len(set(rows) - ({"stop"} if body.joint.kind == "slide" else set()))
        for name in (body.name, above):
            if name is not None:
                count[name] = count.get(name, 0) + number
    return count


def _body_expected(
    world: World, body: Body, still: bool, joints: Mapping[str, int], native: bool
) -> dict[str, EngineValue]:
    held = not still and lumped_inertial(world, body).mass > 0.0
    found: dict[str, EngineValue] = {"model": body.model, "held": held, "joint": body.joint.name}
    found["seen"] = ", ".join(shape.name for shape in body.shapes if not shape.collision)
    if not held:
        return found
    found |= {
        "GyroscopicMode": float(native),
        "FiniteRotationMode": float(not native),
        "GravityMode": 1.0,
        "AutoDisableFlag": 0.0,
        "LinearDamping": 0.0,
        "AngularDamping": 0.0,
        "MaxAngularSpeed": 1e308,
        "NumJoints": float(joints.get(body.name, 0)),
        "enabled": True,
        "kinematic": False,
    }
    for name, kind in _rows(body).items():
        found |= {f"{name}.type": kind, f"{name}.enabled": True, f"{name}.of": True}
    if body.joint.kind in ROW_TYPES:
        found["joint.fits"] = True
    return found
