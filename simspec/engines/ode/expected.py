"""What ODE's inventory must be (``inventory.py``), from the world and the settings that follow from it alone.

Runs outside the engine's process, without ODE.
"""

from __future__ import annotations

from collections.abc import Mapping

from simspec.contact.plan import ContactPlan
from simspec.engines.kit.inventory import Carrier, expected_apart
from simspec.engines.ode.building import ERROR_REDUCTION
from simspec.world.gathering import told_inertial
from simspec.world.kinematics import rigid_groups
from simspec.world.meeting import meeting_laws, solid_shapes
from simspec.world.types import Body, HeldValue, World

OWN_TYPES = {"hinge": "hinge", "slide": "slider", "ball": "ball", "fixed": "fixed"}
ROW_TYPES = {"hinge": "amotor", "slide": "lmotor"}
Settings = Mapping[str, bool | int | float | str]


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, HeldValue]
) -> dict[str, HeldValue]:
    """What the inventory must be under the ``settings`` that follow from ``world``; ``neutral`` are ODE's own values."""
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
        for name, value in _body(world, body, still, joints, native).items():
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
        elif told_inertial(world, body).mass > 0.0:
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


def _body(world: World, body: Body, still: bool, joints: Mapping[str, int], native: bool) -> dict[str, HeldValue]:
    held = not still and told_inertial(world, body).mass > 0.0
    found: dict[str, HeldValue] = {"model": body.model, "held": held, "joint": body.joint.name}
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
