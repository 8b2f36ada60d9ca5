"""Elements and attributes of URDF: a table of what each becomes (``docs/guide/import.md``), by which an import sets aside
what is never carried; and repairs of damaged numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Final

from simspec.imports.draft import Draft
from simspec.imports.elements import (
    ACTS,
    APPEARANCE,
    CARRIED,
    HARDNESS_HINT,
    HOW_HARD,
    INFORMATION,
    LOST,
    PHYSICS,
    SOLVER,
    UNUSED,
    Element,
    plugin_loss,
)
from simspec.imports.reference import ElementRow
from simspec.numerals import NUMBER, SPACE, parts_of

READER: Final = "mujoco"
"""The element of one reader's own."""
FOR_READER: Final = "instructions to MuJoCo's own reader of URDF"
OF_READER: Final = "changes masses, or what acts on them, in that reader alone"
NO_MEANING: Final = "URDF gives it no meaning"
NOT_OF_URDF: Final = "not of URDF: no reader of it acts on this"
OF_OTHERS: Final = "a word of another language, which no reader of URDF reads"
HULL: Final = "the convex hull stands for the surface of a mesh"
PIECES: Final = "`as: pieces` of the mesh in the spec that import writes"
NO_SELF_COLLISION: Final = "import option `self_collision: false`"
CONTROL: Final = "write the actuators as `control:` of the scenario"
FRICTION: Final = "write `contact: {materials: ...}` in the scenario"

TABLE: Final = (
    ElementRow("@name", "`name`"),
    ElementRow("@version", "", UNUSED, INFORMATION, "says how to read the file"),
    # links
    ElementRow("link", "`bodies.NAME`"),
    ElementRow("link/@name", "the body's name"),
    ElementRow("link/@type", "", LOST, INFORMATION, NO_MEANING),
    ElementRow("link/inertial", "`mass`, `centre_of_mass`, `inertia`"),
    ElementRow("link/inertial/origin", "`centre_of_mass`, and the axes of `inertia`"),
    ElementRow("link/inertial/origin/@xyz", "`centre_of_mass`"),
    ElementRow("link/inertial/origin/@rpy", "`inertia.rpy`, or a tensor that is turned into the body's axes"),
    ElementRow("link/inertial/mass", "`mass`"),
    ElementRow("link/inertial/mass/@value", "`mass`"),
    ElementRow("link/inertial/inertia", "`inertia`"),
    *(
        ElementRow(f"link/inertial/inertia/@i{name}", f"`inertia.tensor.{name}`, or `inertia.principal`")
        for name in ("xx", "yy", "zz", "xy", "xz", "yz")
    ),
    # shapes
    ElementRow("link/collision", "an item of `shapes` with `visual: false`"),
    ElementRow(
        "link/visual", "an item of `shapes` with `collision: false`; one item with `collision` where both say the same"
    ),
    *(
        row
        for holder in ("collision", "visual")
        for row in (
            ElementRow(f"link/{holder}/@name", "`shapes.N.name`"),
            ElementRow(f"link/{holder}/origin", "`shapes.N.pose`"),
            ElementRow(f"link/{holder}/origin/@xyz", "`shapes.N.pose.xyz`"),
            ElementRow(f"link/{holder}/origin/@rpy", "`shapes.N.pose.rpy`"),
            ElementRow(f"link/{holder}/geometry", "the kind of the shape"),
            ElementRow(f"link/{holder}/geometry/@name", "", LOST, INFORMATION, NO_MEANING),
            ElementRow(f"link/{holder}/geometry/material", "", LOST, APPEARANCE, NO_MEANING),
            ElementRow(f"link/{holder}/geometry/box", "`box`"),
            ElementRow(f"link/{holder}/geometry/box/@size", "`box.size`"),
            ElementRow(f"link/{holder}/geometry/sphere", "`sphere`"),
            ElementRow(f"link/{holder}/geometry/sphere/@radius", "`sphere.radius`"),
            ElementRow(f"link/{holder}/geometry/cylinder", "`cylinder`"),
            ElementRow(f"link/{holder}/geometry/cylinder/@radius", "`cylinder.radius`"),
            ElementRow(f"link/{holder}/geometry/cylinder/@length", "`cylinder.length`"),
            ElementRow(f"link/{holder}/geometry/capsule", "`capsule`; of readers that add it to URDF"),
            ElementRow(f"link/{holder}/geometry/capsule/@radius", "`capsule.radius`"),
            ElementRow(f"link/{holder}/geometry/capsule/@length", "`capsule.length`"),
            ElementRow(f"link/{holder}/geometry/ellipsoid", "`ellipsoid`; of readers that add it to URDF"),
            *(ElementRow(f"link/{holder}/geometry/ellipsoid/@{axis}", "`ellipsoid.radii`") for axis in "abc"),
            ElementRow(f"link/{holder}/geometry/plane", "`plane`; of readers that add it to URDF"),
            ElementRow(f"link/{holder}/geometry/plane/@normal", "`shapes.N.pose`"),
            ElementRow(f"link/{holder}/geometry/mesh", "`mesh`: its convex hull"),
            ElementRow(
                f"link/{holder}/geometry/mesh/@filename",
                "`mesh.file`",
                LOST,
                INFORMATION if holder == "collision" else APPEARANCE,
                "128 of the hull's vertices are kept" if holder == "collision" else "it is left out",
                "`max_vertices`",
                when="a hull of more than 20,000 vertices",
            ),
            ElementRow(f"link/{holder}/geometry/mesh/@scale", "`mesh.scale`"),
        )
    ),
    ElementRow("link/visual/material", "`shapes.N.colour`"),
    ElementRow("link/visual/material/@name", "", UNUSED, APPEARANCE, "the colour is written into the shape"),
    ElementRow("link/visual/material/color", "`shapes.N.colour`"),
    ElementRow("link/visual/material/color/@rgba", "`shapes.N.colour`"),
    ElementRow("link/visual/material/texture", "", LOST, APPEARANCE, "simspec has no textures"),
    ElementRow("link/visual/material/specular", "", LOST, APPEARANCE, "a surface has a colour only"),
    ElementRow("link/collision/material", "", UNUSED, APPEARANCE, "a collision shape is not drawn"),
    ElementRow("link/collision/verbose", "", LOST, INFORMATION, "URDF no longer has it"),
    ElementRow("link/collision_checking", "", LOST, INFORMATION, "planners read it"),
    ElementRow("link/self_collision_checking", "", LOST, INFORMATION, "planners read it"),
    ElementRow("link/contact", "`contact.materials`, and `shapes.N.material` where there are several"),
    *(
        row
        for tag, word in (
            ("lateral_friction", "friction"),
            ("rolling_friction", "rolling_friction"),
            ("spinning_friction", "torsional_friction"),
            ("restitution", "restitution"),
        )
        for row in (
            ElementRow(f"link/contact/{tag}", f"`contact.materials.NAME.{word}`"),
            ElementRow(f"link/contact/{tag}/@value", f"`contact.materials.NAME.{word}`"),
        )
    ),
    *(
        ElementRow(f"link/contact/{tag}", "", LOST, INFORMATION, HOW_HARD, HARDNESS_HINT)
        for tag in ("stiffness", "damping", "contact_cfm", "contact_erp", "friction_anchor")
    ),
    ElementRow("link/origin", "", LOST, INFORMATION, NO_MEANING),
    *(
        ElementRow(f"link/{tag}", "", LOST, INFORMATION, OF_OTHERS)
        for tag in ("gravity", "kinematic", "self_collide", "surface")
    ),
    ElementRow("link/collision/surface", "", LOST, INFORMATION, OF_OTHERS),
    ElementRow(
        "link/contact/inertia_scaling", "", LOST, PHYSICS, "moments of inertia that one reader multiplies by it"
    ),
    *(ElementRow(f"{tag}/@concave", "", LOST, PHYSICS, HULL, PIECES) for tag in ("link", "link/collision")),
    ElementRow("link/sensor", "", LOST, INFORMATION, "simspec has no sensors"),
    ElementRow("link/audio_source", "", LOST, INFORMATION, "simspec has no sounds"),
    # materials
    ElementRow("material", "`shapes.N.colour` of the shapes that name it"),
    ElementRow("material/@name", "", UNUSED, APPEARANCE, "the colour is written into the shapes that name it"),
    ElementRow("material/color", "`shapes.N.colour`"),
    ElementRow("material/color/@rgba", "`shapes.N.colour`"),
    ElementRow("material/texture", "", LOST, APPEARANCE, "simspec has no textures"),
    # joints
    ElementRow("joint", "`joint` of the child body"),
    ElementRow("joint/@name", "`joint.name`"),
    ElementRow(
        "joint/@type",
        "`joint.type`: hinge (revolute, continuous), slide (prismatic), ball (spherical), fixed; a planar joint is two slides "
        "and a hinge, `joints`; a floating joint from the root `world` is a free root",
    ),
    ElementRow("joint/@dont_collapse", "", LOST, INFORMATION, "an instruction to one program's converter"),
    ElementRow("joint/preserveFixedJoint", "", LOST, INFORMATION, "no fixed joint is removed"),
    ElementRow("joint/origin", "`joint.origin`"),
    ElementRow("joint/origin/@xyz", "`joint.origin.xyz`"),
    ElementRow("joint/origin/@rpy", "`joint.origin.rpy`"),
    ElementRow("joint/parent", "`parent`"),
    ElementRow("joint/parent/@link", "`parent`"),
    ElementRow("joint/child", "the body that the joint is of"),
    ElementRow("joint/child/@link", "the body that the joint is of"),
    ElementRow("joint/axis", "`joint.axis`"),
    ElementRow("joint/axis/@xyz", "`joint.axis`; of a planar joint the axis of its hinge, across which its slides are"),
    ElementRow("joint/axis/@rpy", "", LOST, INFORMATION, NO_MEANING),
    ElementRow("joint/limit", "`joint.limits`"),
    ElementRow("joint/limit/@lower", "`joint.limits.position`"),
    ElementRow("joint/limit/@upper", "`joint.limits.position`"),
    ElementRow("joint/limit/@effort", "`joint.limits.effort`", LOST, INFORMATION, "no rating is known", when="0"),
    ElementRow("joint/limit/@velocity", "`joint.limits.velocity`", LOST, INFORMATION, "no rating is known", when="0"),
    *(
        ElementRow(f"joint/limit/@{name}", "", LOST, INFORMATION, "a rating that planners read")
        for name in ("acceleration", "jerk")
    ),
    *(ElementRow(f"joint/limit/@{name}", "", LOST, INFORMATION, SOLVER) for name in ("stiffness", "dissipation")),
    ElementRow("joint/dynamics", "`joint.damping`, `joint.dry_friction`"),
    ElementRow("joint/dynamics/@damping", "`joint.damping`"),
    ElementRow("joint/dynamics/@friction", "`joint.dry_friction`"),
    *(
        ElementRow(f"joint/dynamics/@{name}", "", LOST, INFORMATION, NOT_OF_URDF, "damping and friction of <dynamics>")
        for name in ("D", "K", "mu_coulomb", "mu_viscous", "spring_stiffness", "spring_reference")
    ),
    ElementRow(
        "joint/mimic",
        "`constraints.NAME.follow`, of the joint's name; the leader begins where all are within their limits, nearest to 0",
        LOST,
        PHYSICS,
        "this joint moves on its own",
        when="joints without an axis, a leader that is not there, a multiplier of 0",
    ),
    ElementRow("joint/mimic/@joint", "`follow.leader`"),
    ElementRow("joint/mimic/@multiplier", "`follow.ratio`"),
    ElementRow("joint/mimic/@offset", "`follow.offset`"),
    ElementRow(
        "joint/safety_controller", "", LOST, INFORMATION, "soft limits of a controller, which no engine has", CONTROL
    ),
    ElementRow("joint/calibration", "", LOST, INFORMATION, "positions of reference of a machine's own sensors"),
    ElementRow("joint/hardwareInterface", "", LOST, INFORMATION, "describes actuators", CONTROL),
    ElementRow("joint/joint_properties", "", LOST, INFORMATION, NOT_OF_URDF, "write it as <dynamics>"),
    # elements for other programs
    ElementRow("transmission", "", LOST, INFORMATION, "describes actuators", CONTROL),
    ElementRow("transmission/actuator", "", LOST, INFORMATION, "describes actuators", CONTROL),
    *(
        ElementRow(
            f"transmission/actuator/drake:{where}",
            "`joint.armature`: the rotor's inertia times the square of the ratio",
        )
        for where in ("rotor_inertia", "rotor_inertia/@value", "gear_ratio", "gear_ratio/@value")
    ),
    *(
        ElementRow(
            f"drake:collision_filter_group{where}",
            "`contact.exclude`: pairs of bodies of groups that ignore each other",
        )
        for where in (
            *("", "/@name", "/drake:member", "/drake:member/@link"),
            *("/drake:ignored_collision_filter_group", "/drake:ignored_collision_filter_group/@name"),
        )
    ),
    ElementRow("ros2_control", "", LOST, INFORMATION, "describes actuators and their interfaces", CONTROL),
    ElementRow("sensor", "", LOST, INFORMATION, "simspec has no sensors"),
    ElementRow("mujoco", "", LOST, INFORMATION, FOR_READER),
    *(ElementRow(f"{READER}/{tag}", "", LOST, INFORMATION, FOR_READER) for tag in ("compiler", "option")),
    *(
        ElementRow(f"{READER}/{where}", "", LOST, PHYSICS, OF_READER)
        for where in ("compiler/@settotalmass", "compiler/@inertiafromgeom", "option/@gravity", "option/@wind")
    ),
    *(ElementRow(f"{READER}/option/@{name}", "", LOST, PHYSICS, OF_READER) for name in ("density", "viscosity")),
    ElementRow("inertial", "", LOST, INFORMATION, NO_MEANING),
    ElementRow("frame", "", LOST, INFORMATION, "a named place without mass"),
    ElementRow("gazebo", "its children are reported one by one"),
    ElementRow("gazebo/@reference", "its children are reported one by one"),
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
    **dict.fromkeys(
        ("selfCollide", "self_collide"), (PHYSICS, "the bodies of a model touch each other", NO_SELF_COLLISION)
    ),
    "kinematic": (PHYSICS, "bodies that nothing moves are not in the language", ""),
    "static": (PHYSICS, "whether a robot stands on something is said where it is placed", "`fixed: true`"),
    **dict.fromkeys(("preserveFixedJoint", "disableFixedJointLumping"), (INFORMATION, "no fixed joint is removed", "")),
}
"""Children of a ``gazebo`` element that are not carried: severity, reason, way out. Others are of physics."""
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
    for tag in ("compiler", "option"):
        for child in element.look(tag):
            for name in child.attributes:
                row = _ALWAYS.get(f"{READER}/{tag}/@{name}")
                value = child.attributes[name].strip().lower()
                if row is not None and value not in READER_DEFAULTS.get(name, ()):
                    child.lose(None, FOR_READER, INFORMATION)
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
            child.ignore(None, "it is empty: it says nothing")
        elif said in WITHOUT_EFFECT.get(child.tag, ()) or (child.tag == "collision" and _does_not_bounce(child)):
            child.ignore(None, "as without it")
        else:
            child.lose(None, reason, severity, hint)


def _does_not_bounce(element: Element) -> bool:
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
    """Report the fate of elements that were not read, where that is no loss of physics: repeated elements, empty containers,
    and what is in elements that are drawn only."""
    waiting = [root]
    while waiting:
        element = waiting.pop()
        children = element.look()
        for index, child in enumerate(children):
            if child.is_settled:
                continue
            if any(child.same_as(element) for element in children[:index] if element.tag == child.tag):
                child.ignore(None, "said twice, the same")
            elif _is_empty(child):
                child.ignore(None, "it is empty: it says nothing")
        for child in children:
            if child.tag in DRAWN and child.is_settled:
                child.leave("simspec does not draw it", APPEARANCE)
            else:
                waiting.append(child)


def attributes_unused(element: Element, reason: str) -> None:
    """Say of an element, with all in it, that URDF gives it no meaning here."""
    element.ignore(None, reason)
    for name in element.attributes:
        element.ignore(name, reason)


def rows() -> Iterator[ElementRow]:
    """All rows, those of Gazebo's extension last."""
    yield from TABLE
    where = "of a link with collision shapes"
    yield ElementRow("gazebo/mu1", f"`contact.materials.NAME.friction`, {where}")
    yield ElementRow(
        "gazebo/mu2",
        f"`contact.materials.NAME.friction`, {where}",
        LOST,
        PHYSICS,
        "friction is the same in every direction",
        when="another than mu1",
    )
    yield ElementRow("gazebo/gravity", "`gravity_scale: 0` of a link with a mass, where it is false")
    yield ElementRow("gazebo/turnGravityOff", "`gravity_scale: 0` of a link with a mass, where it is true")
    for name, (severity, reason, hint) in GAZEBO.items():
        yield ElementRow(f"gazebo/{name}", "", LOST, severity, reason, hint)


DAMAGED: Final = "damaged-numbers"
RULES: Final = {
    DAMAGED: "commas between numbers are spaces, of too many numbers the first count, a point behind a number does not"
}
COUNTS: Final[Mapping[str, Mapping[str, int]]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "box": {"size": 3},
    "mesh": {"scale": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), 1),
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
"""How many numbers an attribute has, by elements."""
SEPARATOR: Final = re.compile(rf"[{SPACE},;]+")
BEHIND: Final = re.compile(r"\.?[fF]?")
"""Characters that may follow a number's digits: a second point, the mark of single precision."""


HOLDERS: Final = ("inertial", "visual", "collision", "geometry", "joint")
"""Parents of such elements."""


def mend(root: Element, draft: Draft) -> None:
    """Where numbers of links and joints are damaged, report it, or by the rule write them as they are meant."""
    for part in root.look("link", "joint"):
        for element in part.within():
            if element.parent is not None and element.parent.tag in HOLDERS:
                _mend(element, draft)


def _mend(element: Element, draft: Draft) -> None:
    for name, count in COUNTS.get(element.tag, {}).items():
        text = element.attributes.get(name)
        if text is None or _is_whole(text, count):
            continue
        meant = _meant(text, count)
        if meant is None:
            continue  # reported where it is read
        said = f"{name} of <{element.tag}>"
        message = f"{said} should be {'a finite number' if count == 1 else f'{count} finite numbers'}"
        repair = f"{said} {text[:80]!r} became {meant!r}"
        draft.mend(DAMAGED, element, message, repair, ("model", "bodies"), text[:80])
        element.attributes[name] = meant


def _is_whole(text: str, count: int) -> bool:
    parts = parts_of(text)
    return len(parts) == count and all(NUMBER.fullmatch(part) for part in parts)


def _meant(text: str, count: int) -> str | None:
    """The numbers that are meant; None where these cannot be determined."""
    parts = [part for part in SEPARATOR.split(text) if part]
    meant: list[str] = []
    for part in parts:
        found = NUMBER.match(part)
        if found is None or not BEHIND.fullmatch(part, found.end()) or not math.isfinite(float(found.group())):
            return None
        meant.append(found.group())
    exact = "," in text or ";" in text  # a comma may be that of a decimal fraction: one number too many
    return " ".join(meant[:count]) if len(meant) == count or (len(meant) > count > 1 and not exact) else None
