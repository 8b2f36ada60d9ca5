"""The model that PyBullet's URDF and its sidecar mean, in the world's frames and order (proof level L0).

It starts from the document that ``formats/urdf/reading.py`` reads: neither the emitter's trees nor PyBullet have a part in it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from simspec.dialects.kit.sidecar import UNREADABLE, add_armature, add_springs, fluid_of, with_passive
from simspec.dialects.pybullet.sidecar import FREE, WORLD_LINK, PybulletInstance, PybulletSidecar
from simspec.formats.kit.contract import restore_frames
from simspec.formats.kit.text import XmlElement
from simspec.formats.urdf.reading import (
    DEFAULT_AXIS,
    WRITTEN,
    UrdfDocument,
    UrdfJointNode,
    UrdfLinkNode,
    UrdfRobotNode,
    check_empty,
    check_meshes,
    inertial_of,
    pose_of,
    shapes_of,
    size_of,
    unknown_parts,
)
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import (
    POSITION_SIZE,
    VELOCITY_SIZE,
    Body,
    Hardness,
    Inertial,
    Joint,
    Pose,
    ReadBack,
    Shape,
    Surface,
)

KINDS: Final[Mapping[str, str]] = {
    "fixed": "fixed",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slide",
    "spherical": "ball",
}
"""The kind of joint that each type is; ``spherical`` is PyBullet's own."""
EXTRA_GEOMETRIES: Final[Mapping[str, tuple[str, ...]]] = {"capsule": ("radius", "length"), "plane": ("normal",)}
"""PyBullet's own geometries, with their attributes."""
CONTACT: Final = (
    "lateral_friction",
    "rolling_friction",
    "spinning_friction",
    "restitution",
    "stiffness",
    "damping",
)
"""The elements of a link's ``contact`` that simspec writes."""
NOTHING: Final = (0.0,)
"""Size of a visual that only keeps PyBullet from showing the collision shapes."""
LINK_MARGIN: Final = 1e-3
"""m: PyBullet's margin around hulls on links other than the first, whatever the request (measured)."""
MARGINS: Final = ("mesh", "box", "cylinder")
"""Kinds of shapes with that margin."""
NO_LIMITS: Final = (0.0, -1.0)
"""The limits that PyBullet assumes where a file has none: lower > upper is unlimited."""


Layers = list[tuple[int, tuple[Shape, ...]]]
"""Shapes of one body by the layer of the link that carries them."""


def raised(document: UrdfDocument, sidecar: PybulletSidecar) -> ReadBack:
    """The model of a document and its sidecar. Raises ValueError where they do not fit together, or a file has what simspec
    does not write."""
    check_meshes(document)
    margin = float(sidecar.settings["collision_margin"])
    files = {name: _UrdfFile.of(robot, document.meshes, margin) for name, robot in document.robots.items()}
    first: dict[str, PybulletInstance] = {}
    bodies: dict[str, Body] = {}
    for instance in sidecar.instances:
        if instance.file not in files:
            raise ValueError(f"the file {instance.file!r} is missing")
        file, pattern = files[instance.file], first.setdefault(instance.file, instance)
        bodies.update((body.name, body) for body in _instance_bodies(file, pattern, instance))
    for frame in sidecar.frames or ():
        fixed = Joint(frame.joint, "fixed", frame.parent, frame.pose)
        bodies[frame.name] = Body(frame.name, frame.model, Inertial(0.0), fixed)
    if unused := files.keys() - first.keys():
        raise ValueError(f"the sidecar names no instance of {', '.join(sorted(unused))}")
    add_springs(bodies, sidecar.springs)
    add_armature(bodies, sidecar.armature)
    ordered = tuple(bodies[body.name] for body in sidecar.bodies)
    if sidecar.native_contact:
        ordered = tuple(_as_native(body) for body in ordered)
    return ReadBack(
        restore_frames(with_passive(ordered, sidecar.passive), sidecar.offsets),
        sidecar.gravity,
        sidecar.timestep,
        sidecar.friction_cone,
        dict(UNREADABLE),
        constraints=sidecar.constraints or (),
        sums=sidecar.sums or (),
        fluid=fluid_of(sidecar.passive),
    )


@dataclass(frozen=True, slots=True)
class _UrdfFile:
    """One file: its links, the joint above each, and what each link holds of contact; the meshes of its folder, and
    what PyBullet keeps around hulls on the first link (m)."""

    links: tuple[UrdfLinkNode, ...]
    joints: Mapping[str, UrdfJointNode]
    surface: Mapping[str, Surface]
    meshes: Mapping[str, tuple[float, ...]]
    base_margin: float

    @staticmethod
    def of(robot: UrdfRobotNode, meshes: Mapping[str, tuple[float, ...]], base_margin: float) -> _UrdfFile:
        """Raises ValueError for what PyBullet's dialect does not have."""
        for unknown in unknown_parts(robot, WRITTEN):
            if unknown.name == "concave" and unknown.path == "robot/link/collision":
                continue  # looked at with its geometry
            if unknown.name is not None or not _is_extension(unknown.node, unknown.path):
                what = f"the attribute {unknown.name!r} of" if unknown.name is not None else "an element"
                raise unknown.node.error(f"{what} {unknown.path} that simspec does not write, or that is repeated")
        surface = {link.name: _surface(link.node.need("contact")) for link in robot.links}
        return _UrdfFile(robot.links, {joint.child: joint for joint in robot.joints}, surface, meshes, base_margin)


def _is_extension(node: XmlElement, path: str) -> bool:
    """Whether an unknown element is one of PyBullet's, as simspec writes it."""
    attributes: Iterable[str] = ()
    if path == "robot/link/contact":
        tags = [child.tag for child in node.children]
        plain = all(set(child.attributes) == {"value"} and not child.children for child in node.children)
        return not node.attributes and plain and len(set(tags)) == len(tags) and set(tags) <= set(CONTACT)
    if path.rpartition("/")[0] in ("robot/link/visual/geometry", "robot/link/collision/geometry"):
        attributes = EXTRA_GEOMETRIES.get(node.tag, ())
    return bool(attributes) and set(node.attributes) == set(attributes) and not node.children


# --- parts of a file ----------------------------------------------------------------------------------------------


def _surface(contact: XmlElement) -> Surface:
    """A link's contact. Two links' springs stand in series and their dampers add up: a pair has half and twice as much."""

    def value(name: str) -> float:
        return contact.need(name).need_number("value")

    sliding, spinning = value("lateral_friction"), value("spinning_friction")
    rolling, restitution = value("rolling_friction"), value("restitution")
    spring = Hardness()
    if contact.child("stiffness") is not None or contact.child("damping") is not None:
        spring = Hardness("stiffness", stiffness=value("stiffness") / 2.0, damping=value("damping") * 2.0)
    return Surface(sliding, spinning, rolling, restitution, spring)


def _geometry(geometry: XmlElement, meshes: Mapping[str, tuple[float, ...]]) -> tuple[str, tuple[float, ...]]:
    if geometry.tag == "capsule":
        return "capsule", (geometry.need_number("radius"), geometry.need_number("length"))
    if geometry.tag == "plane":
        if geometry.numbers("normal", 3) != (0.0, 0.0, 1.0):
            raise geometry.error(
                f"normal={geometry.word('normal')!r} of a plane, only the z axis of its own frame is supported"
            )
        return "plane", ()
    return size_of(geometry, meshes)


def _shapes(file: _UrdfFile, link: UrdfLinkNode, names: Sequence[str], copied: bool = False) -> tuple[Shape, ...]:
    """The shapes of a link, in the order of ``names``."""
    surface = file.surface[link.name]
    for collision in link.collisions:
        kind, _ = _geometry(collision.geometry, file.meshes)
        if collision.node.attributes.get("concave") != ("yes" if kind == "heightfield" else None):
            raise collision.node.error(f"concave of a {kind}: only height fields are so, and all of them")
    shapes = shapes_of(link, partial(_geometry, meshes=file.meshes), lambda size: size[1] == NOTHING)
    if set(shapes) != set(names) and not copied:
        raise ValueError(f"link {link.name!r} has the shapes {sorted(shapes)}, the sidecar names {sorted(names)}")
    margin = file.base_margin if link is file.links[0] else LINK_MARGIN
    actual = {
        name: dataclasses.replace(shape, surfaces=(surface,), rounding=margin if shape.kind in MARGINS else 0.0)
        if shape.collision
        else shape
        for name, shape in shapes.items()
    }
    return tuple(actual[name] for name in names if name in actual)


def _joint(joint: UrdfJointNode) -> Joint:
    if joint.type not in KINDS:
        raise joint.node.error(f"type={joint.type[:60]!r} of joint {joint.name!r} is not of the dialect")
    kind = KINDS[joint.type]
    moves = kind in SCALAR_JOINTS
    if (joint.limit is not None and not moves) or (joint.dynamics is not None and kind == "fixed"):
        raise joint.node.error(f"joint {joint.name!r} of type {joint.type} has limits or dynamics")
    limit = joint.limit if moves else None
    lower, upper = NO_LIMITS
    if limit is not None:
        lower = lower if limit.lower is None else limit.lower
        upper = upper if limit.upper is None else limit.upper
    dynamics = joint.dynamics
    return Joint(
        joint.name,
        kind,
        joint.parent,
        pose_of(joint.origin),
        (joint.axis or DEFAULT_AXIS) if moves else (0.0, 0.0, 0.0),
        (lower, upper) if lower <= upper else None,
        limit.velocity if limit is not None else None,
        limit.effort if limit is not None else None,
        damping=(dynamics.damping or 0.0) if dynamics is not None else 0.0,
        dry_friction=(dynamics.friction or 0.0) if dynamics is not None else 0.0,
    )


# --- instances ----------------------------------------------------------------------------------------------------


def _instance_bodies(file: _UrdfFile, first: PybulletInstance, instance: PybulletInstance) -> list[Body]:
    """The bodies of one tree, with the names of this instance. The file has the names of the ``first`` that shares it."""
    skipped = 1 if instance.root == WORLD_LINK else 0
    world_link = file.links[0].name if skipped else None
    count = skipped + len(first.bodies)
    links, carriers = file.links[skipped:count], file.links[count:]
    if [link.name for link in links] != list(first.bodies):
        raise ValueError(f"{instance.file}: the links are not those of the sidecar, {list(first.bodies)}")
    if [link.name for link in carriers] != [copy.link for copy in first.copies]:
        raise ValueError(f"{instance.file}: the links of copies are not those of the sidecar")
    if len(first.copies) != len(instance.copies) or len(first.bodies) != len(instance.bodies):
        raise ValueError(f"{instance.file}: two instances have other links, or other copies of shapes")
    if skipped:
        check_empty(file.links[0])
    copies = _copies(file, carriers, first, instance)
    local_name = dict(zip(first.bodies, instance.bodies, strict=True))
    bodies = []
    q, v = list(instance.position), list(instance.velocity)
    for place, link in enumerate(links):
        joint = _joint_above(file, link, instance, world_link, local_name)
        position = tuple(q[: POSITION_SIZE[joint.kind]])
        velocity = tuple(v[: VELOCITY_SIZE[joint.kind]])
        del q[: POSITION_SIZE[joint.kind]], v[: VELOCITY_SIZE[joint.kind]]
        if joint.kind == "free":
            # the sidecar has ω in body axes; the file's frame is at the centre of mass
            velocity = (*velocity[:3], *frames.rotate(position[3:7], velocity[3:]))  # type: ignore[arg-type]
        name, names_in_file = instance.bodies[place], first.shapes[place]
        carried = copies.get(name, [])
        local_shapes = _shapes(file, link, names_in_file, copied=bool(carried))
        whole = {shape.name: shape for shape in _with_copies(local_shapes, instance.layers[place], carried)}
        if set(whole) != set(names_in_file):
            raise ValueError(f"body {name!r} has the shapes {sorted(whole)}, the sidecar names {sorted(names_in_file)}")
        shapes = zip(names_in_file, instance.shapes[place], strict=True)
        bodies.append(
            Body(
                name,
                instance.model,
                inertial_of(link.inertial),
                dataclasses.replace(joint, name=instance.joints[place], position=position, velocity=velocity),
                tuple(dataclasses.replace(whole[in_file], name=text) for in_file, text in shapes),
            )
        )
    return bodies


def _joint_above(
    file: _UrdfFile,
    link: UrdfLinkNode,
    instance: PybulletInstance,
    world_link: str | None,
    local_name: Mapping[str, str],
) -> Joint:
    """The joint above a link, with its parent's own name; the root's is what the instance says."""
    if link.name not in file.joints:
        return Joint("", "free") if instance.root == FREE else Joint("", "fixed", None, instance.base)
    joint = _joint(file.joints[link.name])
    if joint.parent == world_link:
        return dataclasses.replace(joint, parent=None, origin=frames.compose(instance.base, joint.origin))
    if joint.parent is None or joint.parent not in local_name:
        raise ValueError(f"{instance.file}: link {link.name!r} has the parent {joint.parent!r}, which is not a body")
    return dataclasses.replace(joint, parent=local_name[joint.parent])


def _copies(
    file: _UrdfFile, carriers: Sequence[UrdfLinkNode], first: PybulletInstance, instance: PybulletInstance
) -> dict[str, Layers]:
    """Of each body of this instance the layers and shapes that other links carry, under the file's names."""
    copies: dict[str, Layers] = {}
    for link, in_file, copy in zip(carriers, first.copies, instance.copies, strict=True):
        joint = file.joints[link.name]
        if joint.type != "fixed" or joint.parent != in_file.body or pose_of(joint.origin) != Pose():
            raise joint.node.error(f"link {link.name!r} is not welded onto the body of its shapes, {in_file.body!r}")
        if inertial_of(link.inertial).mass:
            raise link.node.error(f"link {link.name!r} only carries shapes, and has a mass")
        shapes = _shapes(file, link, in_file.shapes)
        copies.setdefault(copy.body, []).append((copy.layer, shapes))
    return copies


def _with_copies(local: tuple[Shape, ...], layer: int, copies: Layers) -> tuple[Shape, ...]:
    """The shapes of a body: those of its own link in ``layer``, and those of other links, each once with all surfaces."""
    known = {shape.name: shape for shape in local}
    layers = {shape.name: [(layer, shape.surfaces[0])] for shape in local if shape.collision}
    for number, shapes in copies:
        for shape in shapes:
            before = known.setdefault(shape.name, shape)
            if (before.kind, before.size, before.pose) != (shape.kind, shape.size, shape.pose):
                raise ValueError(f"a copy of shape {shape.name!r} is unlike the shape")
            known[shape.name] = dataclasses.replace(before, rounding=max(before.rounding, shape.rounding))
            layers.setdefault(shape.name, []).append((number, shape.surfaces[0]))
    whole = []
    for name, shape in known.items():
        surfaces = tuple(surface for _, surface in sorted(layers.get(name, []), key=lambda entry: entry[0]))
        whole.append(dataclasses.replace(shape, collision=bool(surfaces), surfaces=surfaces))
    return tuple(whole)


def _as_native(body: Body) -> Body:
    """Contact without stiffness is as hard as PyBullet makes it."""

    def native(surface: Surface) -> Surface:
        common = surface.hardness == Hardness()
        return dataclasses.replace(surface, hardness=Hardness("native")) if common else surface

    shapes = tuple(dataclasses.replace(shape, surfaces=tuple(map(native, shape.surfaces))) for shape in body.shapes)
    return dataclasses.replace(body, shapes=shapes)
