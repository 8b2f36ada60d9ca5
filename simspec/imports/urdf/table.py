"""What every element and attribute of URDF becomes: data, from which ``docs/import.md`` is written, and by which an import sets
aside what is never carried."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from simspec.imports.elements import Element
from simspec.imports.table import Row
from simspec.language.foreign import Fate, Severity

CARRIED, UNUSED, LOST = Fate.CARRIED, Fate.UNUSED, Fate.LOST
PHYSICS, APPEARANCE, INFORMATION = Severity.PHYSICS, Severity.APPEARANCE, Severity.INFORMATION


CONTROL: Final = "write the actuators as `control:` of the scenario"
FRICTION: Final = "write `contact: {materials: ...}` in the scenario"

TABLE: Final = (
    Row("@name", "`name`"),
    Row("@version", "", UNUSED, INFORMATION, "says how to read the file"),
    # links
    Row("link", "`bodies.NAME`"),
    Row("link/@name", "the body's name"),
    Row("link/@type", "", LOST, INFORMATION, "URDF gives it no meaning"),
    Row("link/inertial", "`mass`, `centre_of_mass`, `inertia`"),
    Row("link/inertial/origin", "`centre_of_mass`, and the axes of `inertia`"),
    Row("link/inertial/origin/@xyz", "`centre_of_mass`"),
    Row("link/inertial/origin/@rpy", "`inertia.rpy`, or a tensor that is turned into the body's axes"),
    Row("link/inertial/mass", "`mass`"),
    Row("link/inertial/mass/@value", "`mass`"),
    Row("link/inertial/inertia", "`inertia`"),
    *(
        Row(f"link/inertial/inertia/@i{name}", f"`inertia.tensor.{name}`, or `inertia.principal`")
        for name in ("xx", "yy", "zz", "xy", "xz", "yz")
    ),
    # shapes
    Row("link/collision", "an item of `shapes` with `visual: false`"),
    Row(
        "link/visual", "an item of `shapes` with `collision: false`; one item with `collision` where both say the same"
    ),
    *(
        row
        for holder in ("collision", "visual")
        for row in (
            Row(f"link/{holder}/@name", "`shapes.N.name`"),
            Row(f"link/{holder}/origin", "`shapes.N.pose`"),
            Row(f"link/{holder}/origin/@xyz", "`shapes.N.pose.xyz`"),
            Row(f"link/{holder}/origin/@rpy", "`shapes.N.pose.rpy`"),
            Row(f"link/{holder}/geometry", "the kind of the shape"),
            Row(f"link/{holder}/geometry/box", "`box`"),
            Row(f"link/{holder}/geometry/box/@size", "`box.size`"),
            Row(f"link/{holder}/geometry/sphere", "`sphere`"),
            Row(f"link/{holder}/geometry/sphere/@radius", "`sphere.radius`"),
            Row(f"link/{holder}/geometry/cylinder", "`cylinder`"),
            Row(f"link/{holder}/geometry/cylinder/@radius", "`cylinder.radius`"),
            Row(f"link/{holder}/geometry/cylinder/@length", "`cylinder.length`"),
            Row(f"link/{holder}/geometry/mesh", "`mesh`: its convex hull"),
            Row(f"link/{holder}/geometry/mesh/@filename", "`mesh.file`"),
            Row(f"link/{holder}/geometry/mesh/@scale", "`mesh.scale`"),
        )
    ),
    Row("link/visual/material", "`shapes.N.colour`"),
    Row("link/visual/material/@name", "", UNUSED, APPEARANCE, "the colour is written into the shape"),
    Row("link/visual/material/color", "`shapes.N.colour`"),
    Row("link/visual/material/color/@rgba", "`shapes.N.colour`"),
    Row("link/visual/material/texture", "", LOST, APPEARANCE, "simspec has no textures"),
    Row("link/collision/material", "", UNUSED, APPEARANCE, "a collision shape is not drawn"),
    Row("link/collision/verbose", "", LOST, INFORMATION, "URDF no longer has it"),
    Row("link/collision_checking", "", LOST, INFORMATION, "planners read it"),
    Row("link/self_collision_checking", "", LOST, INFORMATION, "planners read it"),
    Row("link/contact", "", LOST, PHYSICS, "friction and stiffness of contact are of pairs of materials", FRICTION),
    Row("link/sensor", "", LOST, INFORMATION, "simspec has no sensors"),
    Row("link/audio_source", "", LOST, INFORMATION, "simspec has no sounds"),
    # materials
    Row("material", "`shapes.N.colour` of the shapes that name it"),
    Row("material/@name", "", UNUSED, APPEARANCE, "the colour is written into the shapes that name it"),
    Row("material/color", "`shapes.N.colour`"),
    Row("material/color/@rgba", "`shapes.N.colour`"),
    Row("material/texture", "", LOST, APPEARANCE, "simspec has no textures"),
    # joints
    Row("joint", "`joint` of the child body"),
    Row("joint/@name", "`joint.name`"),
    Row(
        "joint/@type",
        "`joint.type`: hinge (revolute, continuous), slide (prismatic), ball (spherical), fixed; a floating "
        "joint from the root `world` is a free root",
    ),
    Row("joint/origin", "`joint.origin`"),
    Row("joint/origin/@xyz", "`joint.origin.xyz`"),
    Row("joint/origin/@rpy", "`joint.origin.rpy`"),
    Row("joint/parent", "`parent`"),
    Row("joint/parent/@link", "`parent`"),
    Row("joint/child", "the body that the joint is of"),
    Row("joint/child/@link", "the body that the joint is of"),
    Row("joint/axis", "`joint.axis`"),
    Row("joint/axis/@xyz", "`joint.axis`"),
    Row("joint/limit", "`joint.limits`"),
    Row("joint/limit/@lower", "`joint.limits.position`"),
    Row("joint/limit/@upper", "`joint.limits.position`"),
    Row("joint/limit/@effort", "`joint.limits.effort`", LOST, INFORMATION, "no rating is known", when="0"),
    Row("joint/limit/@velocity", "`joint.limits.velocity`", LOST, INFORMATION, "no rating is known", when="0"),
    Row("joint/dynamics", "`joint.damping`, `joint.dry_friction`"),
    Row("joint/dynamics/@damping", "`joint.damping`"),
    Row("joint/dynamics/@friction", "`joint.dry_friction`"),
    Row(
        "joint/mimic",
        "`constraints.NAME.follow`, of the joint's name",
        LOST,
        PHYSICS,
        "this joint moves on its own",
        when="joints without an axis, a leader that is not there, a multiplier of 0",
    ),
    Row("joint/mimic/@joint", "`follow.leader`"),
    Row("joint/mimic/@multiplier", "`follow.ratio`"),
    Row("joint/mimic/@offset", "`follow.offset`"),
    Row("joint/safety_controller", "", LOST, INFORMATION, "soft limits of a controller, which no engine has", CONTROL),
    Row("joint/calibration", "", LOST, INFORMATION, "positions of reference of a machine's own sensors"),
    Row("joint/joint_properties", "", LOST, PHYSICS, "not of URDF", "write it as <dynamics>"),
    # what is for other programs
    Row("transmission", "", LOST, INFORMATION, "describes actuators", CONTROL),
    Row("ros2_control", "", LOST, INFORMATION, "describes actuators and their interfaces", CONTROL),
    Row("sensor", "", LOST, INFORMATION, "simspec has no sensors"),
    Row("mujoco", "", LOST, INFORMATION, "instructions to MuJoCo's own reader of URDF"),
    Row("gazebo", "what is in it is told item by item"),
    Row("gazebo/@reference", "what is in it is told item by item"),
)
"""In the order of the documentation."""

GAZEBO: Final = {
    **dict.fromkeys(("plugin", "sensor", "static_map", "ros", "robotNamespace"), (INFORMATION, "for Gazebo only", "")),
    **dict.fromkeys(("material", "visual", "static_material"), (APPEARANCE, "Gazebo's own appearance", "")),
    **dict.fromkeys(
        ("mu", "mu1", "mu2", "fdir1", "kp", "kd", "minDepth", "maxVel", "maxContacts", "collision", "surface"),
        (PHYSICS, "contact as Gazebo has it", FRICTION),
    ),
    **dict.fromkeys(("preserveFixedJoint", "disableFixedJointLumping"), (INFORMATION, "no fixed joint is removed", "")),
}
"""What stands in a ``gazebo`` element: severity, reason, way out. What is not here is of physics."""


def tags(element: Element) -> str:
    """The tags from below the outermost element to this one."""
    parts: list[str] = []
    here: Element | None = element
    while here is not None and here.parent is not None:
        parts.append(here.tag)
        here = here.parent
    return "/".join(reversed(parts))


_ALWAYS: Final = {row.where: row for row in TABLE if row.fate is not CARRIED and not row.when}


def set_aside(root: Element) -> None:
    """Say of everything in a file that is never carried what becomes of it."""
    waiting = [(root, "")]
    while waiting:
        element, where = waiting.pop()
        for name in element.attributes:
            row = _ALWAYS.get(f"{where}/@{name}".removeprefix("/"))
            if row is not None:
                element.set_aside(name, row.fate, row.reason, row.severity, row.hint)
        for child in element.look():
            below = f"{where}/{child.tag}".removeprefix("/")
            row = _ALWAYS.get(below)
            if row is not None:
                child.set_aside(None, row.fate, row.reason, row.severity, row.hint)
            elif below == "gazebo":
                _gazebo(child)
            else:
                waiting.append((child, below))


def _gazebo(element: Element) -> None:
    element.take().word("reference")
    for child in element.look():
        severity, reason, hint = GAZEBO.get(child.tag, (PHYSICS, "Gazebo's extension of URDF is not read", ""))
        child.set_aside(None, LOST, reason, severity, hint)


def attributes_unused(element: Element, reason: str) -> None:
    """Say of an element, with all in it, that URDF gives it no meaning here."""
    element.set_aside(None, UNUSED, reason, INFORMATION)
    for name in element.attributes:
        element.set_aside(name, UNUSED, reason, INFORMATION)


def rows() -> Iterator[Row]:
    """All rows, those of Gazebo's extension last."""
    yield from TABLE
    for name, (severity, reason, hint) in GAZEBO.items():
        yield Row(f"gazebo/{name}", "", LOST, severity, reason, hint)
