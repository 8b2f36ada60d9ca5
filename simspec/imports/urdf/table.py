"""What every element and attribute of URDF becomes: data, from which ``docs/import.md`` is written, and by which an import sets
aside what is never carried."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from simspec.imports.elements import ACTS, HARDNESS_HINT, HOW_HARD, SOLVER, Element, plugin_loss
from simspec.imports.table import Row
from simspec.language.foreign import Fate, Severity

CARRIED, UNUSED, LOST = Fate.CARRIED, Fate.UNUSED, Fate.LOST
PHYSICS, APPEARANCE, INFORMATION = Severity.PHYSICS, Severity.APPEARANCE, Severity.INFORMATION


READER: Final = "mujoco"
"""The element of one reader's own."""
FOR_READER: Final = "instructions to MuJoCo's own reader of URDF"
OF_READER: Final = "changes masses, or what acts on them, in that reader alone"
NO_MEANING: Final = "URDF gives it no meaning"
NOT_OF_URDF: Final = "not of URDF: no reader of it acts on this"
OF_OTHERS: Final = "a word of another language, which no reader of URDF reads"
HULL: Final = "the convex hull stands for the surface of a mesh"
PIECES: Final = "`as: pieces` of the mesh in the spec that import writes"
APART: Final = "import option `self_collision: false`"
CONTROL: Final = "write the actuators as `control:` of the scenario"
FRICTION: Final = "write `contact: {materials: ...}` in the scenario"

TABLE: Final = (
    Row("@name", "`name`"),
    Row("@version", "", UNUSED, INFORMATION, "says how to read the file"),
    # links
    Row("link", "`bodies.NAME`"),
    Row("link/@name", "the body's name"),
    Row("link/@type", "", LOST, INFORMATION, NO_MEANING),
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
            Row(f"link/{holder}/geometry/@name", "", LOST, INFORMATION, NO_MEANING),
            Row(f"link/{holder}/geometry/material", "", LOST, APPEARANCE, NO_MEANING),
            Row(f"link/{holder}/geometry/box", "`box`"),
            Row(f"link/{holder}/geometry/box/@size", "`box.size`"),
            Row(f"link/{holder}/geometry/sphere", "`sphere`"),
            Row(f"link/{holder}/geometry/sphere/@radius", "`sphere.radius`"),
            Row(f"link/{holder}/geometry/cylinder", "`cylinder`"),
            Row(f"link/{holder}/geometry/cylinder/@radius", "`cylinder.radius`"),
            Row(f"link/{holder}/geometry/cylinder/@length", "`cylinder.length`"),
            Row(f"link/{holder}/geometry/capsule", "`capsule`; of readers that add it to URDF"),
            Row(f"link/{holder}/geometry/capsule/@radius", "`capsule.radius`"),
            Row(f"link/{holder}/geometry/capsule/@length", "`capsule.length`"),
            Row(f"link/{holder}/geometry/ellipsoid", "`ellipsoid`; of readers that add it to URDF"),
            *(Row(f"link/{holder}/geometry/ellipsoid/@{axis}", "`ellipsoid.radii`") for axis in "abc"),
            Row(f"link/{holder}/geometry/plane", "`plane`; of readers that add it to URDF"),
            Row(f"link/{holder}/geometry/plane/@normal", "`shapes.N.pose`"),
            Row(f"link/{holder}/geometry/mesh", "`mesh`: its convex hull"),
            Row(
                f"link/{holder}/geometry/mesh/@filename",
                "`mesh.file`",
                LOST,
                INFORMATION if holder == "collision" else APPEARANCE,
                "128 of the hull's vertices are kept" if holder == "collision" else "it is left out",
                "`max_vertices`",
                when="a hull of more than 20,000 vertices",
            ),
            Row(f"link/{holder}/geometry/mesh/@scale", "`mesh.scale`"),
        )
    ),
    Row("link/visual/material", "`shapes.N.colour`"),
    Row("link/visual/material/@name", "", UNUSED, APPEARANCE, "the colour is written into the shape"),
    Row("link/visual/material/color", "`shapes.N.colour`"),
    Row("link/visual/material/color/@rgba", "`shapes.N.colour`"),
    Row("link/visual/material/texture", "", LOST, APPEARANCE, "simspec has no textures"),
    Row("link/visual/material/specular", "", LOST, APPEARANCE, "a surface has a colour only"),
    Row("link/collision/material", "", UNUSED, APPEARANCE, "a collision shape is not drawn"),
    Row("link/collision/verbose", "", LOST, INFORMATION, "URDF no longer has it"),
    Row("link/collision_checking", "", LOST, INFORMATION, "planners read it"),
    Row("link/self_collision_checking", "", LOST, INFORMATION, "planners read it"),
    Row("link/contact", "`contact.materials`, and `shapes.N.material` where there are several"),
    *(
        row
        for tag, word in (
            ("lateral_friction", "friction"),
            ("rolling_friction", "rolling_friction"),
            ("spinning_friction", "torsional_friction"),
            ("restitution", "restitution"),
        )
        for row in (
            Row(f"link/contact/{tag}", f"`contact.materials.NAME.{word}`"),
            Row(f"link/contact/{tag}/@value", f"`contact.materials.NAME.{word}`"),
        )
    ),
    *(
        Row(f"link/contact/{tag}", "", LOST, INFORMATION, HOW_HARD, HARDNESS_HINT)
        for tag in ("stiffness", "damping", "contact_cfm", "contact_erp", "friction_anchor")
    ),
    Row("link/origin", "", LOST, INFORMATION, NO_MEANING),
    *(
        Row(f"link/{tag}", "", LOST, INFORMATION, OF_OTHERS)
        for tag in ("gravity", "kinematic", "self_collide", "surface")
    ),
    Row("link/collision/surface", "", LOST, INFORMATION, OF_OTHERS),
    Row("link/contact/inertia_scaling", "", LOST, PHYSICS, "moments of inertia that one reader multiplies by it"),
    *(Row(f"{tag}/@concave", "", LOST, PHYSICS, HULL, PIECES) for tag in ("link", "link/collision")),
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
        "`joint.type`: hinge (revolute, continuous), slide (prismatic), ball (spherical), fixed; a planar joint is two slides "
        "and a hinge, `joints`; a floating joint from the root `world` is a free root",
    ),
    Row("joint/@dont_collapse", "", LOST, INFORMATION, "an instruction to one program's converter"),
    Row("joint/preserveFixedJoint", "", LOST, INFORMATION, "no fixed joint is removed"),
    Row("joint/origin", "`joint.origin`"),
    Row("joint/origin/@xyz", "`joint.origin.xyz`"),
    Row("joint/origin/@rpy", "`joint.origin.rpy`"),
    Row("joint/parent", "`parent`"),
    Row("joint/parent/@link", "`parent`"),
    Row("joint/child", "the body that the joint is of"),
    Row("joint/child/@link", "the body that the joint is of"),
    Row("joint/axis", "`joint.axis`"),
    Row("joint/axis/@xyz", "`joint.axis`; of a planar joint the axis of its hinge, across which its slides are"),
    Row("joint/axis/@rpy", "", LOST, INFORMATION, NO_MEANING),
    Row("joint/limit", "`joint.limits`"),
    Row("joint/limit/@lower", "`joint.limits.position`"),
    Row("joint/limit/@upper", "`joint.limits.position`"),
    Row("joint/limit/@effort", "`joint.limits.effort`", LOST, INFORMATION, "no rating is known", when="0"),
    Row("joint/limit/@velocity", "`joint.limits.velocity`", LOST, INFORMATION, "no rating is known", when="0"),
    *(
        Row(f"joint/limit/@{name}", "", LOST, INFORMATION, "a rating that planners read")
        for name in ("acceleration", "jerk")
    ),
    *(Row(f"joint/limit/@{name}", "", LOST, INFORMATION, SOLVER) for name in ("stiffness", "dissipation")),
    Row("joint/dynamics", "`joint.damping`, `joint.dry_friction`"),
    Row("joint/dynamics/@damping", "`joint.damping`"),
    Row("joint/dynamics/@friction", "`joint.dry_friction`"),
    *(
        Row(f"joint/dynamics/@{name}", "", LOST, INFORMATION, NOT_OF_URDF, "damping and friction of <dynamics>")
        for name in ("D", "K", "mu_coulomb", "mu_viscous", "spring_stiffness", "spring_reference")
    ),
    Row(
        "joint/mimic",
        "`constraints.NAME.follow`, of the joint's name; the leader begins where all are within their limits, nearest to 0",
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
    Row("joint/hardwareInterface", "", LOST, INFORMATION, "describes actuators", CONTROL),
    Row("joint/joint_properties", "", LOST, INFORMATION, NOT_OF_URDF, "write it as <dynamics>"),
    # what is for other programs
    Row("transmission", "", LOST, INFORMATION, "describes actuators", CONTROL),
    Row("transmission/actuator", "", LOST, INFORMATION, "describes actuators", CONTROL),
    *(
        Row(
            f"transmission/actuator/drake:{where}",
            "`joint.armature`: the rotor's inertia times the square of the ratio",
        )
        for where in ("rotor_inertia", "rotor_inertia/@value", "gear_ratio", "gear_ratio/@value")
    ),
    *(
        Row(
            f"drake:collision_filter_group{where}",
            "`contact.exclude`: pairs of bodies of groups that ignore each other",
        )
        for where in (
            *("", "/@name", "/drake:member", "/drake:member/@link"),
            *("/drake:ignored_collision_filter_group", "/drake:ignored_collision_filter_group/@name"),
        )
    ),
    Row("ros2_control", "", LOST, INFORMATION, "describes actuators and their interfaces", CONTROL),
    Row("sensor", "", LOST, INFORMATION, "simspec has no sensors"),
    Row("mujoco", "", LOST, INFORMATION, FOR_READER),
    *(Row(f"{READER}/{tag}", "", LOST, INFORMATION, FOR_READER) for tag in ("compiler", "option")),
    *(
        Row(f"{READER}/{where}", "", LOST, PHYSICS, OF_READER)
        for where in ("compiler/@settotalmass", "compiler/@inertiafromgeom", "option/@gravity", "option/@wind")
    ),
    *(Row(f"{READER}/option/@{name}", "", LOST, PHYSICS, OF_READER) for name in ("density", "viscosity")),
    Row("inertial", "", LOST, INFORMATION, NO_MEANING),
    Row("frame", "", LOST, INFORMATION, "a named place without mass"),
    Row("gazebo", "what is in it is told item by item"),
    Row("gazebo/@reference", "what is in it is told item by item"),
)
"""In the order of the documentation."""

_NOT_READ: Final = "Gazebo's extension of URDF is not read"
_HOW_HARD: Final = (INFORMATION, HOW_HARD, HARDNESS_HINT)
_OF_SOLVER: Final = (INFORMATION, "a setting of one engine's solver", "")
GAZEBO: Final = {
    **dict.fromkeys(
        ("plugin", "sensor", "static_map", "ros", "robotNamespace", "laserRetro"), (INFORMATION, "for Gazebo only", "")
    ),
    **dict.fromkeys(("material", "visual", "static_material"), (APPEARANCE, "Gazebo's own appearance", "")),
    **dict.fromkeys(("kp", "kd", "minDepth", "maxVel", "maxContacts"), _HOW_HARD),
    **dict.fromkeys(("implicitSpringDamper", "cfmDamping", "stopCfm", "stopErp", "fudgeFactor"), _OF_SOLVER),
    "provideFeedback": (INFORMATION, "runs record the forces of joints", ""),
    "pose": (INFORMATION, "where a model stands is said by the scenario that places it", ""),
    **dict.fromkeys(("fdir1", "collision", "surface"), (PHYSICS, "contact as Gazebo has it", FRICTION)),
    **dict.fromkeys(("selfCollide", "self_collide"), (PHYSICS, "the bodies of a model touch each other", APART)),
    "kinematic": (PHYSICS, "bodies that nothing moves are not in the language", ""),
    "static": (PHYSICS, "whether a robot stands on something is said where it is placed", "`fixed: true`"),
    **dict.fromkeys(("preserveFixedJoint", "disableFixedJointLumping"), (INFORMATION, "no fixed joint is removed", "")),
}
"""What stands in a ``gazebo`` element and is not carried: severity, reason, way out. What is not here is of physics."""
WITHOUT_EFFECT: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("selfCollide", "self_collide", "gravity"), ("1", "true")),
    **dict.fromkeys(("turnGravityOff", "kinematic", "enable_wind", "static"), ("0", "false")),
    **dict.fromkeys(("dampingFactor", "springStiffness", "springReference"), ("0", "0.0")),
}
"""Values that change nothing."""


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
            local = name.rpartition(":")[2]  # a word of a program, in its own namespace
            row = _ALWAYS.get(f"{where}/@{local}".removeprefix("/"))
            if row is not None:
                element.set_aside(name, row.fate, row.reason, row.severity, row.hint)
        for child in element.look():
            below = f"{where}/{child.tag}".removeprefix("/")
            row = _ALWAYS.get(below)
            if row is not None:
                child.set_aside(None, row.fate, row.reason, row.severity, row.hint)
                if below == "mujoco":
                    _reader(child)
            elif below == "gazebo":
                _gazebo(child)
            else:
                waiting.append((child, below))


def _reader(element: Element) -> None:
    """Say of what MuJoCo's own reader of URDF changes in a model that it is lost as physics."""
    for tag in ("compiler", "option"):
        for child in element.look(tag):
            for name in child.attributes:
                row = _ALWAYS.get(f"{READER}/{tag}/@{name}")
                value = child.attributes[name].strip().lower()
                if row is not None and value not in READER_DEFAULTS.get(name, ()):
                    child.set_aside(None, LOST, FOR_READER, INFORMATION)
                    child.set_aside(name, row.fate, row.reason, row.severity, row.hint)


READER_DEFAULTS: Final[Mapping[str, tuple[str, ...]]] = {
    "settotalmass": ("-1",),
    "inertiafromgeom": ("auto", "false"),
    "gravity": ("0 0 -9.81",),
    "wind": ("0 0 0",),
    "density": ("0",),
    "viscosity": ("0",),
}
"""Values with which a model is as without them."""


def _gazebo(element: Element) -> None:
    element.take().word("reference")
    for child in element.look():
        severity, reason, hint = GAZEBO.get(child.tag, (PHYSICS, _NOT_READ, ""))
        if child.tag == "plugin" and ACTS.search(" ".join(child.attributes.values())):
            severity, reason = plugin_loss(child)
        said = child.attributes.get("value", child.text).strip().lower()
        if _is_empty(child):
            child.set_aside(None, UNUSED, "it is empty: it says nothing", INFORMATION)
        elif said in WITHOUT_EFFECT.get(child.tag, ()) or (child.tag == "collision" and _does_not_bounce(child)):
            child.set_aside(None, UNUSED, "as without it", INFORMATION)
        else:
            child.set_aside(None, LOST, reason, severity, hint)


def _does_not_bounce(element: Element) -> bool:
    """Whether all that a <collision> says is that nothing bounces."""
    waiting, leaves = [element], dict[str, str]()
    while waiting:
        part = waiting.pop()
        waiting += part.look()
        if not part.look():
            leaves[part.tag] = part.text
    words = {"restitution_coefficient", "threshold", "max_contacts"}
    return leaves.keys() <= words and leaves.get("restitution_coefficient") in ("0", "0.0")


CONTAINERS: Final = frozenset(
    (
        *("contact", "gazebo", "transmission", "extension", "surface", "friction", "bounce", "dynamics"),
        *("visual", "material", "sensor", "plugin", "mujoco"),
    )
)
"""Elements that say nothing where there is nothing in them."""
NAMES: Final[Mapping[str, str]] = {"gazebo": "reference", "transmission": "name"}
"""Attributes of such elements that say nothing alone."""
DRAWN: Final = ("visual", "material")
"""Elements in which nothing is of physics."""


def _is_empty(element: Element) -> bool:
    said = element.attributes.keys() - {NAMES.get(element.tag)}
    return element.tag in CONTAINERS and not element.look() and not element.text and not said


def settle(root: Element) -> None:
    """Say of what nobody has taken what becomes of it, where that is no loss of physics: what is said twice, empty containers,
    and what is in elements that are drawn only."""
    waiting = [root]
    while waiting:
        element = waiting.pop()
        children = element.look()
        for index, child in enumerate(children):
            if child.is_settled:
                continue
            if any(child.same_as(one) for one in children[:index] if one.tag == child.tag):
                child.set_aside(None, UNUSED, "said twice, the same", INFORMATION)
            elif _is_empty(child):
                child.set_aside(None, UNUSED, "it is empty: it says nothing", INFORMATION)
        for child in children:
            if child.tag in DRAWN and child.is_settled:
                child.leave("simspec does not draw it", APPEARANCE)
            else:
                waiting.append(child)


def attributes_unused(element: Element, reason: str) -> None:
    """Say of an element, with all in it, that URDF gives it no meaning here."""
    element.set_aside(None, UNUSED, reason, INFORMATION)
    for name in element.attributes:
        element.set_aside(name, UNUSED, reason, INFORMATION)


def rows() -> Iterator[Row]:
    """All rows, those of Gazebo's extension last."""
    yield from TABLE
    where = "of a link with collision shapes"
    yield Row("gazebo/mu1", f"`contact.materials.NAME.friction`, {where}")
    yield Row(
        "gazebo/mu2",
        f"`contact.materials.NAME.friction`, {where}",
        LOST,
        PHYSICS,
        "friction is the same in every direction",
        when="another than mu1",
    )
    yield Row("gazebo/gravity", "`gravity_scale: 0` of a link with a mass, where it is false")
    yield Row("gazebo/turnGravityOff", "`gravity_scale: 0` of a link with a mass, where it is true")
    for name, (severity, reason, hint) in GAZEBO.items():
        yield Row(f"gazebo/{name}", "", LOST, severity, reason, hint)
