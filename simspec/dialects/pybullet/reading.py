"""Read a folder of URDF files and their sidecar with yourdfpy: neither the emitter nor PyBullet (proof level L0).

yourdfpy reads plain URDF. What PyBullet's dialect adds (joints of type ``spherical``, geometries ``capsule`` and
``plane``, a link's ``contact``) is taken out of the XML first by :class:`_Dialect` and put back after, so that everything
else is yourdfpy's own reading: masses, inertias, frames, axes, limits, damping, friction, boxes, spheres, cylinders.
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from simspec.dialects.kit.sidecar import read_sidecar
from simspec.dialects.pybullet.sidecar import check_sidecar
from simspec.formats.kit.passes import restore_frames
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

KINDS = {"fixed": "fixed", "revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "spherical": "ball"}

NOTHING = (0.0,)
"""Size of a visual that only keeps PyBullet from showing the collision shapes."""

UNREADABLE = {
    "collision_group": "the files carry what touches what, not the names of groups",
    "control.native": "the engine's own controllers are switched on when a run begins",
}


@dataclass(slots=True)
class _Dialect:
    """What was taken out of one file before yourdfpy saw it, by the name of joint, shape and link."""

    spherical: set[str] = field(default_factory=set)
    geometry: dict[tuple[str, str, str], tuple[str, tuple[float, ...]]] = field(default_factory=dict)
    """(link, visual or collision, shape name): kind and size"""
    surface: dict[str, Surface] = field(default_factory=dict)
    """link: the numbers of its contact"""


def _plain_urdf(path: Path) -> tuple[bytes, _Dialect]:
    """The file as plain URDF, and what of PyBullet's dialect was in it."""
    root = ElementTree.fromstring(path.read_bytes())
    found = _Dialect()
    for joint in root.iter("joint"):
        if joint.get("type") == "spherical":
            found.spherical.add(joint.attrib["name"])
            joint.set("type", "floating")
    for link in root.iter("link"):
        name = link.attrib["name"]
        contact = link.find("contact")
        if contact is not None:
            found.surface[name] = _surface(contact)
            link.remove(contact)
        for role in ("visual", "collision"):
            for shape in link.findall(role):
                geometry = shape.find("geometry")
                if geometry is None or len(geometry) != 1:
                    raise ValueError(f"{path.name}: a {role} of link {name!r} has no single geometry")
                kind = geometry[0]
                if kind.tag in ("capsule", "plane"):
                    found.geometry[name, role, shape.attrib["name"]] = (kind.tag, _dialect_size(path, kind))
                    geometry.remove(kind)
                    ElementTree.SubElement(geometry, "sphere", radius="1")
    return ElementTree.tostring(root), found


def _surface(contact: ElementTree.Element) -> Surface:
    """A link's contact. Two links' springs stand in series and their dampers add up: a pair has half and twice as much."""
    sliding, spinning = _value(contact, "lateral_friction"), _value(contact, "spinning_friction")
    rolling, restitution = _value(contact, "rolling_friction"), _value(contact, "restitution")
    if contact.find("stiffness") is None:
        return Surface(sliding, spinning, rolling, restitution, Hardness())
    stiffness, damping = _value(contact, "stiffness"), _value(contact, "damping")
    spring = Hardness("stiffness", stiffness=stiffness / 2.0, damping=damping * 2.0)
    return Surface(sliding, spinning, rolling, restitution, spring)


def _value(contact: ElementTree.Element, name: str) -> float:
    element = contact.find(name)
    if element is None:
        raise ValueError(f"a <contact> has no <{name}>")
    return float(element.attrib["value"])


def _dialect_size(path: Path, kind: ElementTree.Element) -> tuple[float, ...]:
    if kind.tag == "capsule":
        return (float(kind.attrib["radius"]), float(kind.attrib["length"]))
    if tuple(map(float, kind.attrib["normal"].split())) != (0.0, 0.0, 1.0):
        raise ValueError(
            f"{path.name}: a plane's normal is {kind.attrib['normal']!r}, only z of its own frame is known here"
        )
    return ()


def _pose(matrix: Any) -> Pose:
    """A 4×4 matrix (None: the identity) as a pose."""
    if matrix is None:
        return Pose()
    rows = matrix.tolist()
    turn = frames.from_matrix(tuple(tuple(row[:3]) for row in rows[:3]))  # type: ignore[arg-type]
    return Pose((rows[0][3], rows[1][3], rows[2][3]), turn)


def _inertial(link: Any) -> Inertial:
    """Mass, centre of mass, and the tensor turned into the link's axes."""
    given = link.inertial
    pose = _pose(given.origin)
    m = given.inertia.tolist()
    tensor = (m[0][0], m[1][1], m[2][2], m[0][1], m[0][2], m[1][2])
    return Inertial(float(given.mass), pose.position, frames.turn_inertia(pose.quaternion, tensor))


def _shapes(link: Any, dialect: _Dialect, names: list[str], copied: bool = False) -> tuple[Shape, ...]:
    """The shapes of a link, in the order of ``names``; those of one name in ``visual`` and ``collision`` are one."""
    surface = dialect.surface[link.name]
    found: dict[str, Shape] = {}
    for role, elements in (("collision", link.collisions), ("visual", link.visuals)):
        for element in elements:
            kind, size = dialect.geometry.get((link.name, role, element.name)) or _geometry(element.geometry)
            if role == "visual" and size == NOTHING:
                continue
            shape = Shape(element.name, kind, size, _pose(element.origin), collision=False, visual=False)
            known = found.get(element.name)
            if known is not None and (known.kind, known.size, known.pose) != (kind, size, shape.pose):
                raise ValueError(f"link {link.name!r}: visual and collision of shape {element.name!r} differ")
            shape = known or shape
            if role == "visual":
                colour = tuple(float(part) for part in element.material.color.rgba)
                found[element.name] = dataclasses.replace(shape, visual=True, colour=colour)
            else:
                found[element.name] = dataclasses.replace(shape, collision=True, surfaces=(surface,))
    if set(found) != set(names) and not copied:
        raise ValueError(f"link {link.name!r} has the shapes {sorted(found)}, the sidecar names {sorted(names)}")
    return tuple(found[name] for name in names if name in found)


def _with_copies(own: tuple[Shape, ...], layer: int, copies: list[tuple[int, tuple[Shape, ...]]]) -> tuple[Shape, ...]:
    """The shapes of a body: those of its own link in ``layer``, and those of other links, each once with all surfaces."""
    known = {shape.name: shape for shape in own}
    layers: dict[str, list[tuple[int, Surface]]] = {
        shape.name: [(layer, shape.surfaces[0])] for shape in own if shape.collision
    }
    for number, some in copies:
        for shape in some:
            before = known.get(shape.name)
            if before is None:
                known[shape.name] = shape
            elif (before.kind, before.size, before.pose) != (shape.kind, shape.size, shape.pose):
                raise ValueError(f"a copy of shape {shape.name!r} is unlike the shape")
            layers.setdefault(shape.name, []).append((number, shape.surfaces[0]))
    found = []
    for name, shape in known.items():
        held = tuple(surface for _, surface in sorted(layers.get(name, []), key=lambda entry: entry[0]))
        found.append(dataclasses.replace(shape, collision=bool(held), surfaces=held))
    return tuple(found)


def _geometry(geometry: Any) -> tuple[str, tuple[float, ...]]:
    if geometry.box is not None:
        return "box", tuple(float(edge) for edge in geometry.box.size)
    if geometry.sphere is not None:
        return "sphere", (float(geometry.sphere.radius),)
    return "cylinder", (float(geometry.cylinder.radius), float(geometry.cylinder.length))


def _joint(joint: Any, dialect: _Dialect) -> Joint:
    kind = "ball" if joint.name in dialect.spherical else KINDS[joint.type]
    moves = kind in ("hinge", "slide")
    limit = joint.limit if moves else None
    bounded = limit is not None and limit.lower is not None and limit.lower <= limit.upper
    dynamics = joint.dynamics
    return Joint(
        joint.name,
        kind,
        joint.parent,
        _pose(joint.origin),
        tuple(float(x) for x in joint.axis) if moves else (0.0, 0.0, 0.0),
        (limit.lower, limit.upper) if bounded else None,
        limit.velocity if limit is not None else None,
        limit.effort if limit is not None else None,
        damping=float(dynamics.damping) if dynamics is not None else 0.0,  # yourdfpy leaves these two as text
        dry_friction=float(dynamics.friction) if dynamics is not None else 0.0,
    )


@dataclass(frozen=True, slots=True)
class _File:
    links: list[Any]
    joints: Mapping[str, Any]
    dialect: _Dialect


def _read_file(path: Path) -> _File:
    import yourdfpy

    text, dialect = _plain_urdf(path)
    robot = yourdfpy.URDF.load(io.BytesIO(text), build_scene_graph=False, load_meshes=False).robot
    return _File(robot.links, {joint.child: joint for joint in robot.joints}, dialect)


def _instance_bodies(file: _File, first: Mapping[str, Any], instance: Mapping[str, Any]) -> list[Body]:
    """The bodies of one tree, with the names of this instance. The file has the names of the ``first`` that shares it."""
    links = list(file.links)
    base = Pose(tuple(instance["base"]["position"]), tuple(instance["base"]["quaternion"]))
    world_link = links.pop(0).name if instance["root"] == "world link" else None
    carriers = links[len(first["bodies"]) :]
    del links[len(first["bodies"]) :]
    if [link.name for link in carriers] != [copy["link"] for copy in first["copies"]]:
        raise ValueError(f"{instance['file']}: the links of copies are not those of the sidecar")
    if len(first["copies"]) != len(instance["copies"]):
        raise ValueError(f"{instance['file']}: two instances have other copies of shapes")
    copies = _copies(file, carriers, first, instance)
    if [link.name for link in links] != first["bodies"]:
        raise ValueError(f"{instance['file']}: the links are not those of the sidecar, {first['bodies']}")
    own_name = {link.name: name for link, name in zip(links, instance["bodies"], strict=True)}
    bodies = []
    q, v = list(instance["position"]), list(instance["velocity"])
    for link, name, joint_name, shape_names, names_in_file in zip(
        links, instance["bodies"], instance["joints"], instance["shapes"], first["shapes"], strict=True
    ):
        if link.name in file.joints:
            joint = _joint(file.joints[link.name], file.dialect)
            if joint.parent == world_link:
                joint = dataclasses.replace(joint, parent=None, origin=frames.compose(base, joint.origin))
            else:
                joint = dataclasses.replace(joint, parent=own_name[joint.parent or ""])
        elif instance["root"] == "free":
            joint = Joint(joint_name, "free")
        else:
            joint = Joint(joint_name, "fixed", None, base)
        position = tuple(q[: POSITION_SIZE[joint.kind]])
        velocity = tuple(v[: VELOCITY_SIZE[joint.kind]])
        del q[: POSITION_SIZE[joint.kind]], v[: VELOCITY_SIZE[joint.kind]]
        if joint.kind == "free":
            # the sidecar has ω in body axes; the file's frame is at the centre of mass
            velocity = (*velocity[:3], *frames.rotate(position[3:7], velocity[3:]))  # type: ignore[arg-type]
        carried = copies.get(name, [])
        own_shapes = _shapes(link, file.dialect, names_in_file, copied=bool(carried))
        layer = instance["layers"][instance["bodies"].index(name)]
        whole = {one.name: one for one in _with_copies(own_shapes, layer, carried)}
        if set(whole) != set(names_in_file):
            raise ValueError(f"body {name!r} has the shapes {sorted(whole)}, the sidecar names {sorted(names_in_file)}")
        shapes = zip((whole[one] for one in names_in_file), shape_names, strict=True)
        bodies.append(
            Body(
                name,
                instance["model"],
                _inertial(link),
                dataclasses.replace(joint, name=joint_name, position=position, velocity=velocity),
                tuple(dataclasses.replace(shape, name=own) for shape, own in shapes),
            )
        )
    return bodies


def _copies(
    file: _File, carriers: list[Any], first: Mapping[str, Any], instance: Mapping[str, Any]
) -> dict[str, list[tuple[int, tuple[Shape, ...]]]]:
    """Of each body of this instance the layers and shapes that other links carry, under the file's names."""
    found: dict[str, list[tuple[int, tuple[Shape, ...]]]] = {}
    parent = {link: joint.parent for link, joint in file.joints.items()}
    for link, in_file, own in zip(carriers, first["copies"], instance["copies"], strict=True):
        joint = file.joints[link.name]
        if joint.type != "fixed" or parent[link.name] != in_file["body"] or _pose(joint.origin) != Pose():
            raise ValueError(f"link {link.name!r} is not welded onto the body of its shapes, {in_file['body']!r}")
        if _inertial(link).mass:
            raise ValueError(f"link {link.name!r} only carries shapes, and has a mass")
        shapes = _shapes(link, file.dialect, in_file["shapes"])
        found.setdefault(own["body"], []).append((own["layer"], shapes))
    return found


def read_folder(folder: Path) -> ReadBack:
    """The model that the files and the sidecar in ``folder`` say, in the world's frames and order.

    Raises ValueError where the files and the sidecar do not fit together.
    """
    content = read_sidecar(folder)
    check_sidecar(content)
    files = {name: _read_file(folder / name) for name in sorted({one["file"] for one in content["instances"]})}
    first: dict[str, Mapping[str, Any]] = {}
    found: dict[str, Body] = {}
    for instance in content["instances"]:
        for body in _instance_bodies(files[instance["file"]], first.setdefault(instance["file"], instance), instance):
            found[body.name] = body
    for entry in content["springs"]:
        found[entry["body"]] = _with_joint(
            found[entry["body"]], spring_stiffness=entry["stiffness"], spring_rest=entry["rest"]
        )
    for entry in content["armature"]:
        found[entry["body"]] = _with_joint(found[entry["body"]], armature=entry["armature"])
    ordered = tuple(found[body["name"]] for body in content["bodies"])
    offsets = {body["name"]: tuple(body["frame_offset"]) for body in content["bodies"] if any(body["frame_offset"])}
    if content["native_contact"]:
        ordered = tuple(_as_native(body) for body in ordered)
    return ReadBack(
        restore_frames(ordered, offsets),
        tuple(content["gravity"]),
        content["timestep"],
        content["friction_cone"],
        dict(UNREADABLE),
    )


def _as_native(body: Body) -> Body:
    """Contact without stiffness is as hard as PyBullet makes it."""

    def native(surface: Surface) -> Surface:
        common = surface.hardness == Hardness()
        return dataclasses.replace(surface, hardness=Hardness("native")) if common else surface

    shapes = tuple(dataclasses.replace(shape, surfaces=tuple(map(native, shape.surfaces))) for shape in body.shapes)
    return dataclasses.replace(body, shapes=shapes)


def _with_joint(body: Body, **changes: float) -> Body:
    return dataclasses.replace(body, joint=dataclasses.replace(body.joint, **changes))
