"""Elements and attributes of URDF: a table of what each becomes (``docs/guide/import.md``), by which an import sets aside
what is never carried; and repairs of damaged numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from simspec.imports.draft import CONTACT_OF_LINK, SIZES, Draft
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
from simspec.language.foreign import LossSeverity
from simspec.numerals import NUMBER, SPACE, parts_of

READER: Final = "mujoco"
"""The element of one reader's own."""
FOR_READER: Final = "instructions to MuJoCo's own reader of URDF"
OF_READER: Final = "changes masses, or what acts on them, in that reader alone"
NO_MEANING: Final = "URDF gives it no meaning"
NOT_OF_URDF: Final = "not of URDF: no reader of it acts on this"
OF_DYNAMICS: Final = "damping and friction of <dynamics>"
OF_OTHERS: Final = "a word of another language, which no reader of URDF reads"
HULL: Final = "the convex hull stands for the surface of a mesh"
PIECES: Final = "`as: pieces` of the mesh in the spec that import writes"
NO_SELF_COLLISION: Final = "import option `self_collision: false`"
CONTROL: Final = "write the actuators as `control:` of the scenario"
FRICTION: Final = "write `contact: {materials: ...}` in the scenario"
ADDED: Final = "; of readers that add it to URDF"
LENGTHS: Final[Mapping[str, Sequence[str]]] = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "ellipsoid": ("a", "b", "c"),
}
"""Geometries by their tag, with the attributes that say how large they are."""
DIALECTS: Final = ("capsule", "ellipsoid", "plane")
"""Those that URDF itself does not have: programs that read it do, two of them with a prefix."""


def _rows(places: str, becomes: str) -> list[ElementRow]:
    return [ElementRow(place, becomes) for place in places.split()]


def _lost(places: str, reason: str, hint: str = "", severity: LossSeverity = INFORMATION) -> list[ElementRow]:
    return [ElementRow(place, "", LOST, severity, reason, hint) for place in places.split()]


def _shape_rows(holder: str) -> list[ElementRow]:
    """The rows of what is in a collision or visual element."""
    kinds = f"{holder}/geometry/"
    severity, reason = INFORMATION, "128 of the hull's vertices are kept"
    if holder == "link/visual":
        severity, reason = APPEARANCE, "it is left out"
    large = ("`max_vertices`", "a hull of more than 20,000 vertices")
    return [
        ElementRow(f"{holder}/@name", "`shapes.N.name`"),
        ElementRow(f"{holder}/origin", "`shapes.N.pose`"),
        ElementRow(f"{holder}/origin/@xyz", "`shapes.N.pose.xyz`"),
        ElementRow(f"{holder}/origin/@rpy", "`shapes.N.pose.rpy`"),
        ElementRow(f"{holder}/geometry", "the kind of the shape"),
        *_lost(f"{kinds}@name", NO_MEANING),
        *_lost(f"{kinds}material", NO_MEANING, "", APPEARANCE),
        *(
            row
            for kind, names in LENGTHS.items()
            for row in (
                ElementRow(f"{kinds}{kind}", f"`{kind}`{ADDED if kind in DIALECTS else ''}"),
                *(ElementRow(f"{kinds}{kind}/@{name}", f"`{kind}.{SIZES.get(kind, name)}`") for name in names),
            )
        ),
        ElementRow(f"{kinds}plane", f"`plane`{ADDED}"),
        ElementRow(f"{kinds}plane/@normal", "`shapes.N.pose`"),
        ElementRow(f"{kinds}mesh", "`mesh`: its convex hull"),
        ElementRow(f"{kinds}mesh/@filename", "`mesh.file`", LOST, severity, reason, *large),
        ElementRow(f"{kinds}mesh/@scale", "`mesh.scale`"),
    ]


TABLE: Final = (
    ElementRow("@name", "`name`"),
    ElementRow("@version", "", UNUSED, INFORMATION, "says how to read the file"),
    # links
    ElementRow("link", "`bodies.NAME`"),
    ElementRow("link/@name", "the body's name"),
    *_lost("link/@type", NO_MEANING),
    ElementRow("link/inertial", "`mass`, `centre_of_mass`, `inertia`"),
    ElementRow("link/inertial/origin", "`centre_of_mass`, and the axes of `inertia`"),
    ElementRow("link/inertial/origin/@xyz", "`centre_of_mass`"),
    ElementRow("link/inertial/origin/@rpy", "`inertia.rpy`, or a tensor that is turned into the body's axes"),
    *_rows("link/inertial/mass link/inertial/mass/@value", "`mass`"),
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
    *_shape_rows("link/collision"),
    *_shape_rows("link/visual"),
    ElementRow("link/visual/material", "`shapes.N.colour`"),
    ElementRow("link/visual/material/@name", "", UNUSED, APPEARANCE, "the colour is written into the shape"),
    *_rows("link/visual/material/color link/visual/material/color/@rgba", "`shapes.N.colour`"),
    *_lost("link/visual/material/texture", "simspec has no textures", "", APPEARANCE),
    *_lost("link/visual/material/specular", "a surface has a colour only", "", APPEARANCE),
    ElementRow("link/collision/material", "", UNUSED, APPEARANCE, "a collision shape is not drawn"),
    *_lost("link/collision/verbose", "URDF no longer has it"),
    *_lost("link/collision_checking link/self_collision_checking", "planners read it"),
    ElementRow("link/contact", "`contact.materials`, and `shapes.N.material` where there are several"),
    *(
        row
        for tag in ("lateral_friction", "rolling_friction", "spinning_friction", "restitution")
        for row in _rows(
            f"link/contact/{tag} link/contact/{tag}/@value", f"`contact.materials.NAME.{CONTACT_OF_LINK[tag]}`"
        )
    ),
    *_lost("link/contact/stiffness link/contact/damping link/contact/contact_cfm", HOW_HARD, HARDNESS_HINT),
    *_lost("link/contact/contact_erp link/contact/friction_anchor", HOW_HARD, HARDNESS_HINT),
    *_lost("link/origin", NO_MEANING),
    *_lost("link/gravity link/kinematic link/self_collide link/surface link/collision/surface", OF_OTHERS),
    *_lost("link/contact/inertia_scaling", "moments of inertia that one reader multiplies by it", "", PHYSICS),
    *_lost("link/@concave link/collision/@concave", HULL, PIECES, PHYSICS),
    *_lost("link/sensor", "simspec has no sensors"),
    *_lost("link/audio_source", "simspec has no sounds"),
    # materials
    ElementRow("material", "`shapes.N.colour` of the shapes that name it"),
    ElementRow("material/@name", "", UNUSED, APPEARANCE, "the colour is written into the shapes that name it"),
    *_rows("material/color material/color/@rgba", "`shapes.N.colour`"),
    *_lost("material/texture", "simspec has no textures", "", APPEARANCE),
    # joints
    ElementRow("joint", "`joint` of the child body"),
    ElementRow("joint/@name", "`joint.name`"),
    ElementRow(
        "joint/@type",
        "`joint.type`: hinge (revolute, continuous), slide (prismatic), ball (spherical), fixed; a planar joint is two slides "
        "and a hinge, `joints`; a floating joint from the root `world` is a free root",
    ),
    *_lost("joint/@dont_collapse", "an instruction to one program's converter"),
    *_lost("joint/preserveFixedJoint", "no fixed joint is removed"),
    ElementRow("joint/origin", "`joint.origin`"),
    ElementRow("joint/origin/@xyz", "`joint.origin.xyz`"),
    ElementRow("joint/origin/@rpy", "`joint.origin.rpy`"),
    *_rows("joint/parent joint/parent/@link", "`parent`"),
    *_rows("joint/child joint/child/@link", "the body that the joint is of"),
    ElementRow("joint/axis", "`joint.axis`"),
    ElementRow("joint/axis/@xyz", "`joint.axis`; of a planar joint the axis of its hinge, across which its slides are"),
    *_lost("joint/axis/@rpy", NO_MEANING),
    ElementRow("joint/limit", "`joint.limits`"),
    *_rows("joint/limit/@lower joint/limit/@upper", "`joint.limits.position`"),
    ElementRow("joint/limit/@effort", "`joint.limits.effort`", LOST, INFORMATION, "no rating is known", when="0"),
    ElementRow("joint/limit/@velocity", "`joint.limits.velocity`", LOST, INFORMATION, "no rating is known", when="0"),
    *_lost("joint/limit/@acceleration joint/limit/@jerk", "a rating that planners read"),
    *_lost("joint/limit/@stiffness joint/limit/@dissipation", SOLVER),
    ElementRow("joint/dynamics", "`joint.damping`, `joint.dry_friction`"),
    ElementRow("joint/dynamics/@damping", "`joint.damping`"),
    ElementRow("joint/dynamics/@friction", "`joint.dry_friction`"),
    *_lost(
        " ".join(
            f"joint/dynamics/@{word}"
            for word in ["D", "K", "mu_coulomb", "mu_viscous", "spring_stiffness", "spring_reference"]
        ),
        NOT_OF_URDF,
        "damping and friction of <dynamics>",
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
    *_lost("joint/safety_controller", "soft limits of a controller, which no engine has", CONTROL),
    *_lost("joint/calibration", "positions of reference of a machine's own sensors"),
    *_lost("joint/hardwareInterface", "describes actuators", CONTROL),
    *_lost("joint/joint_properties", NOT_OF_URDF, "write it as <dynamics>"),
    # elements for other programs
    *_lost("transmission transmission/actuator", "describes actuators", CONTROL),
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
    *_lost("ros2_control", "describes actuators and their interfaces", CONTROL),
    *_lost("sensor", "simspec has no sensors"),
    *_lost(f"{READER} {READER}/compiler {READER}/option", FOR_READER),
    *_lost(f"{READER}/compiler/@settotalmass {READER}/compiler/@inertiafromgeom", OF_READER, "", PHYSICS),
    *_lost(
        " ".join(f"{READER}/option/@{name}" for name in ["gravity", "wind", "density", "viscosity"]),
        OF_READER,
        "",
        PHYSICS,
    ),
    *_lost("inertial", NO_MEANING),
    *_lost("frame", "a named place without mass"),
    *_rows("gazebo gazebo/@reference", "its children are reported one by one"),
)
"""In the order of the documentation."""

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


_ALWAYS: Final = {row.where: row for row in TABLE if row.fate is not CARRIED and not row.when}


def set_aside(root: Element) -> None:
    """Say of everything in a file that is never carried what becomes of it."""
    waiting = [(root, "")]
    while waiting:
        element, where = waiting.pop()
        for name in element.attributes:
            local = name.rpartition(":")[2]  # a word of a program, in its own namespace
            if (row := _ALWAYS.get(f"{where}/@{local}".removeprefix("/"))) is not None:
                element.set_aside(name, row.fate, row.reason, row.severity, row.hint)
        for child in element.look():
            below = f"{where}/{child.tag}".removeprefix("/")
            if (row := _ALWAYS.get(below)) is not None:
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
        severity, reason, hint = GAZEBO.get(child.tag, (PHYSICS, "Gazebo's extension of URDF is not read", ""))
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
    leaves = {part.tag: part.text for part in element.within() if not part.look()}
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
