"""Collisions and visuals of SDF as shapes of the language, with their surfaces."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from simspec.errors import SpecError
from simspec.imports.draft import (
    CONTACT_OF_LINK,
    MOVING_PLANE,
    SIZES,
    Draft,
    LinkShape,
    LinkSurface,
    NamedMesh,
    Problems,
    measure_meshes,
    not_drawn,
    read_meshes,
    shape_data,
)
from simspec.imports.elements import APPEARANCE, HOW_HARD, INFORMATION, Element
from simspec.imports.sdf.models import MISSING, SdfMeshes
from simspec.imports.sdf.values import (
    IN_COLLISION,
    IN_CONTACT,
    IN_CONTACT_OF_LINK,
    IN_FRICTION,
    IN_SURFACE,
    IN_VISUAL,
    SAME,
    Placement,
    finite_of,
    flag_of,
    pose_of,
    set_aside,
    vector_of,
)
from simspec.world import frames
from simspec.world.shapes import SHAPES
from simspec.world.types import Pose

NO_BOUNCE: Final = 100_000.0
"""The default of ``bounce/threshold`` (m/s): nothing is as fast."""
FILTERS: Final[Mapping[str, tuple[str, ...]]] = {
    "collide_bitmask": ("65535", "0xffff"),
    "category_bitmask": ("65535", "0xffff"),
    "collide_without_contact": ("0", "false"),
    "collide_without_contact_bitmask": ("1",),
}
"""Defaults of what says who touches whom."""
MASKS: Final = ("collide_bitmask", "category_bitmask")


def read_surface(shape: Element, of_link: LinkSurface) -> LinkSurface:
    """The surface of a collision; ``of_link``: the surface that its link states for collisions that state none."""
    surface = shape.child("surface")
    if surface is None:
        return of_link
    set_aside(surface, IN_SURFACE)
    for contact in surface.look("contact"):
        _contact(contact)
    read = of_link
    friction = surface.child("friction")
    if friction is not None:
        mu, torsional = _friction(friction)
        read = replace(read, friction=mu, torsional_friction=torsional, rolling_friction=0.0)
    bounce = surface.child("bounce")
    if bounce is not None:
        restitution = finite_of(bounce, "restitution_coefficient", 0.0)
        threshold = finite_of(bounce, "threshold", NO_BOUNCE)
        if not restitution:
            threshold = 0.0
            bounce.ignore_child("threshold", "nothing bounces")
        read = replace(read, restitution=restitution, restitution_threshold=threshold)
    return read


def surface_of_link(link: Element) -> LinkSurface:
    """The surface of all collisions of a link, in words of one reader: lengths in m; its defaults are SDF's,
    friction 1."""
    numbers: dict[str, float] = {}
    for contact in link.look("contact"):
        contact.take()
        set_aside(contact, IN_CONTACT_OF_LINK)
        for tag, name in CONTACT_OF_LINK.items():
            for child in contact.look(tag):
                child.take()
                numbers[name] = (child.number("value") or 0.0) if child.has("value") else child.content(1)[0]
    return LinkSurface(**numbers)


def _friction(friction: Element) -> tuple[float, float]:
    ode = friction.child("ode")
    mu = 1.0
    if ode is not None:
        mu = finite_of(ode, "mu", 1.0)
        other = finite_of(ode, "mu2", 1.0)
        if other != mu:
            ode.lose_child("mu2", "friction is the same in every direction; `mu` is carried")
        set_aside(ode, IN_FRICTION)
        if other == mu:
            ode.ignore_child("fdir1", "friction is the same in every direction")
    for child in friction.look():
        if child.tag not in ("ode", "torsional"):
            child.lose(None, "numbers of another engine; those of `ode` are carried")
    torsion = friction.child("torsional")
    return mu, 0.0 if torsion is None else _torsional(torsion)


def _torsional(torsion: Element) -> float:
    """Torsional friction as a length: coefficient × 3π/16 × radius of the patch."""
    coefficient = finite_of(torsion, "coefficient", 1.0)
    use_patch = flag_of(torsion, "use_patch_radius", True)
    patch = finite_of(torsion, "patch_radius", 0.0)
    for child in torsion.look("ode"):
        if finite_of(child, "slip", 0.0):
            child.lose(None, "friction does not depend on the force")
        else:
            child.take()
    if use_patch:
        torsion.ignore_child("surface_radius", "the file gives the radius of the patch")
    else:
        reason = "a torsional friction that grows with the depth of contact"
        torsion.lose_children("surface_radius coefficient", reason)
        return 0.0
    return coefficient * 3.0 * math.pi / 16.0 * patch


def _contact(contact: Element) -> None:
    """Contact filters, and hardness. Defaults of the first change nothing, and so do masks with the bit that all defaults
    have; the other is each solver's."""
    contact.take()
    set_aside(contact, IN_CONTACT)
    for solver in contact.look():
        if solver.look():
            solver.lose(None, HOW_HARD, INFORMATION)
    for child in contact.look(*FILTERS):
        text = child.text.strip().lower()
        if text in FILTERS[child.tag] or (child.tag in MASKS and _has_first_bit(text)):
            child.ignore(None, "every collision has this bit, by default too" if child.tag in MASKS else "the default")
        else:
            child.lose(None, "contact filters are groups of bodies in a spec", hint="`contact.groups`")


def _has_first_bit(text: str) -> bool:
    try:
        return text.isascii() and "_" not in text and int(text, 0) % 2 == 1
    except ValueError:
        return False


DENSITY: Final = 1000.0
"""Of a collision that says none, where a link's inertia is to be computed."""
COLOUR: Final = (0.7, 0.7, 0.7, 1.0)
"""The language's default."""


@dataclass
class SdfShapeRead(LinkShape):
    """A shape, and the surface of one that collides."""

    surface: LinkSurface | None = None


@dataclass(frozen=True)
class LinkContext:
    """The context of a shape's element: the meshes of the import, the folder of its file, and its link's frame in the
    body's. ``density``: of collisions that say none, where the inertia is to be computed."""

    meshes: SdfMeshes
    folder: Path
    move: Placement
    density: float | None
    surface: LinkSurface
    """Of collisions that say none."""
    static: bool = False
    """Whether the link is fixed to the world."""


def read_shapes(link: Element, around: LinkContext) -> list[SdfShapeRead]:
    """All shapes of a link, moved; a visual that is the same as a collision is one with it. Raises SpecError with every
    problem."""
    shapes: list[SdfShapeRead] = []
    problems = Problems()
    for child in link.look("collision", "visual"):
        child.take()
        try:
            shape = _collision(child, around) if child.tag == "collision" else _visual(child, around)
        except SpecError as error:
            if child.tag == "visual":
                not_drawn(child, error.problems[0])
            else:
                problems.extend(error.problems)
            continue
        if shape is None:
            continue
        if "plane" in shape.data and child.tag == "visual" and not around.static:
            child.forget()
            child.lose(None, MOVING_PLANE, APPEARANCE)
            continue
        twin = _twin(shapes, shape)
        if twin is None:
            shapes.append(shape)
        else:
            for key in ("visual", "collision"):
                twin.data.pop(key, None)
            twin.collides = True
            for key in ("colour", "density"):
                if key in shape.data:
                    twin.data[key] = shape.data[key]
            if shape.surface is not None:
                twin.surface, twin.name = shape.surface, shape.name
            shape.element.ignore("name", "one shape with its collision")
    problems.demand_none()
    return shapes


GEOMETRY: Final[Mapping[str, Mapping[str, float]]] = {
    "box": {"size": 1.0},
    "sphere": {"radius": 1.0},
    "cylinder": {"radius": 1.0, "length": 1.0},
    "capsule": {"radius": 0.5, "length": 1.0},
    "ellipsoid": {"radii": 1.0},
}
"""Shapes with the elements that say how large they are, and the defaults (m) of these."""
NOT_CARRIED: Final = {
    "heightmap": "simspec has no height fields",
    "image": "simspec makes no shapes of pictures",
    "cone": "simspec has no cones",
}

POLYLINE: Final = "polyline"
OTHERS: Final = ("plane", "mesh", POLYLINE)
MOST_CORNERS: Final = 5_000
NOT_CONVEX: Final = "an extruded polygon that is not convex is not supported: a mesh is its hull"


@dataclass(frozen=True)
class _Geometry:
    """The kind and the size of a shape, with its pose against that of the element."""

    data: dict[str, Any]
    place: Placement = SAME
    mesh: NamedMesh | None = None
    volume: float = 0.0
    """m³; 0 for a mesh, or for lengths that are refused elsewhere."""


def _geometry(shape: Element, around: LinkContext) -> _Geometry | None:
    """The content of ``<geometry>``; None for one that is not carried, which is then
    said. Raises SpecError for geometries that SDF does not have."""
    geometry = shape.child("geometry")
    if geometry is None:
        raise shape.error(f"<{shape.tag}> has no <geometry>", code="I101")
    kinds = geometry.look()
    if len(kinds) != 1:
        raise geometry.error("<geometry> should have one shape in it", found=str(len(kinds)), code="I101")
    kind = kinds[0]
    if kind.tag in GEOMETRY:
        kind.take()
        size = list[float]()
        for name, default in GEOMETRY[kind.tag].items():
            size += vector_of(kind, name, (default,) * 3) if kind.tag in SIZES else [finite_of(kind, name, default)]
        volume = SHAPES[kind.tag].volume(size) if min(size) > 0.0 else 0.0
        return _Geometry(shape_data(kind.tag, size), volume=volume)
    if kind.tag == "mesh":
        read = around.meshes.read(shape, kind.take(), around.folder)
        return None if read is None else _Geometry(read[0], mesh=read[1])
    if kind.tag == POLYLINE:
        return _extruded(kind.take(), shape, around)
    if kind.tag == "plane":
        kind.take()
        kind.ignore_child("size", "a plane has no end", APPEARANCE)
        return _Geometry({"plane": {}}, _upright(kind))
    if kind.tag == "empty":
        kind.take()
        return None
    if kind.tag not in NOT_CARRIED:
        allowed = ", ".join((*GEOMETRY, *OTHERS, *NOT_CARRIED))
        raise kind.error("not a shape of SDF", found=kind.tag[:60], allowed=allowed, code="I101")
    if shape.tag == "collision":
        raise kind.error(NOT_CARRIED[kind.tag], allowed=", ".join((*GEOMETRY, *OTHERS)), code="I104")
    kind.lose(None, NOT_CARRIED[kind.tag], APPEARANCE)
    return None


def _extruded(kind: Element, shape: Element, around: LinkContext) -> _Geometry:
    """A convex polygon of the x-y plane, from z = 0 to its height, as a mesh: exactly its hull. Raises SpecError for others."""
    height = finite_of(kind, "height", 1.0)
    points = [point.content(2) for point in kind.look("point")]
    corners = [point for point, following in zip(points, [*points[1:], *points[:1]], strict=True) if point != following]
    if len(points) > MOST_CORNERS:
        raise kind.error("too many points", found=str(len(points)), allowed=f"{MOST_CORNERS:,}", code="I105")
    if len(corners) < 3 or height <= 0.0:
        raise kind.error("an extruded polygon has three corners or more, and a height above 0", code="I102")
    turns = _turns(corners)
    if turns is None:
        raise kind.error(
            NOT_CONVEX, hint='several convex polygons, or a mesh with optimization="convex_decomposition"', code="I104"
        )
    count = len(corners)
    around_up = range(count) if turns > 0 else range(count - 1, -1, -1)
    top = [corner + count for corner in around_up]
    sides = [
        (first, second, second + count, first + count)
        for first, second in zip(around_up, [*around_up[1:], around_up[0]], strict=True)
    ]
    vertices = [(x, y, z) for z in (0.0, height) for x, y in corners]
    name = shape.attributes.get("name", "").strip() or POLYLINE
    mesh = around.meshes.write(vertices, [list(reversed(around_up)), top, *sides], name)
    return _Geometry({"mesh": mesh.data()}, mesh=mesh)


def _turns(corners: Sequence[tuple[float, ...]]) -> int | None:
    """The direction in which a convex polygon turns, 1 (to the left) or -1; None for another polygon."""
    edges = [
        (following[0] - corner[0], following[1] - corner[1])
        for corner, following in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    pairs = list(zip(edges, [*edges[1:], edges[0]], strict=True))
    crosses = [a[0] * b[1] - a[1] * b[0] for a, b in pairs]
    if not (min(crosses) >= 0.0 or max(crosses) <= 0.0) or not any(crosses):
        return None
    if any(not cross and a[0] * b[0] + a[1] * b[1] < 0.0 for cross, (a, b) in zip(crosses, pairs, strict=True)):
        return None  # back along an edge
    angle = sum(math.atan2(cross, a[0] * b[0] + a[1] * b[1]) for cross, (a, b) in zip(crosses, pairs, strict=True))
    if round(abs(angle) / (2.0 * math.pi)) != 1:
        return None  # several times around
    return 1 if angle > 0.0 else -1


def _upright(plane: Element) -> Placement:
    """The rotation that turns z into a plane's normal."""
    x, y, z = vector_of(plane, "normal", (0.0, 0.0, 1.0))
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        raise plane.error("the normal of a plane has no length", code="I102")
    if x == 0.0 and y == 0.0 and z > 0.0:
        return Placement()
    if x == 0.0 and y == 0.0:
        return Placement(Pose((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)))
    half = (length + z, -y, x, 0.0)  # (1 + cos, axis × sin) of the turn from z, not yet of unit length
    return Placement(Pose((0.0, 0.0, 0.0), frames.normalise(half)))


def _posed(shape: Element, around: LinkContext) -> _Geometry | None:
    read = _geometry(shape, around)
    pose = pose_of(shape)
    if pose.relative_to:
        raise shape.error(
            "the pose of a shape against another frame is not supported", found=pose.relative_to[:80], code="I104"
        )
    if read is None:
        return None
    place = around.move.then(pose.placement).then(read.place)
    data = {**read.data, "pose": place.data()} if place.data() else read.data
    return replace(read, data=data, place=place)


def _collision(shape: Element, around: LinkContext) -> SdfShapeRead | None:
    read = _posed(shape, around)
    name = shape.word("name") or ""
    set_aside(shape, IN_COLLISION)
    surface = read_surface(shape, around.surface)
    density = finite_of(shape, "density", around.density or DENSITY)
    if around.density is None:
        shape.ignore_child("density", "the file gives the mass")
    shape.lose_child("auto_inertia_params", "simspec computes inertias of its own shapes")
    if read is None or read.mesh is None:
        shape.ignore("concave", "only a mesh can be concave")
    else:
        reason = "a mesh is its convex hull"
        shape.lose("concave", reason, hint="`as: pieces` of the mesh, in the spec")
    if read is None:
        return None
    data = read.data
    if around.density is not None and "plane" not in data:
        data["density"] = density
    data["visual"] = False
    return SdfShapeRead(shape, data, True, name, read.mesh, volume=read.volume, surface=surface)


def _visual(shape: Element, around: LinkContext) -> SdfShapeRead | None:
    read = _posed(shape, around)
    name = shape.word("name") or ""
    set_aside(shape, IN_VISUAL)
    colour = _colour(shape)
    if read is None:
        return None
    data = read.data
    data["collision"] = False
    if colour is not None and colour != COLOUR:
        data["colour"] = list(colour)
    return SdfShapeRead(shape, data, False, name, read.mesh, volume=read.volume)


def _colour(shape: Element) -> tuple[float, ...] | None:
    material = shape.child("material")
    if material is None:
        return None
    drawn = "ambient specular emissive shininess lighting script shader pbr double_sided"
    material.lose_children(drawn, "a shape has one colour", APPEARANCE)
    material.lose_child("render_order", "a shape has one colour", APPEARANCE)
    material.lose("name", "a colour has no name", INFORMATION)
    diffuse = material.look("diffuse") or material.look("ambient")
    if not diffuse:
        return None
    values = diffuse[0].content(None)
    if len(values) not in (3, 4):
        raise diffuse[0].error("a colour has three or four numbers", found=diffuse[0].text[:80], code="I101")
    return tuple(min(1.0, max(0.0, value)) for value in (*values, 1.0)[:4])


def _twin(shapes: list[SdfShapeRead], shape: SdfShapeRead) -> SdfShapeRead | None:
    """The collision of a visual, or the visual of a collision: the same shape at the same place."""
    drawn = shape.element.tag == "visual"
    mine = {key: value for key, value in shape.data.items() if key not in ("visual", "collision", "colour", "density")}
    for other in shapes:
        if other.element.tag == shape.element.tag or ("visual" if drawn else "collision") not in other.data:
            continue
        if {key: other.data[key] for key in other.data.keys() - {"visual", "collision", "colour", "density"}} == mine:
            return other
    return None


def judge_meshes(bodies: Iterable[list[SdfShapeRead]], draft: Draft) -> None:
    """Take out of each list of shapes the meshes that cannot be read; those that no rule leaves out are problems."""
    lists = list(bodies)
    shapes = [shape for found in lists for shape in found if shape.mesh is not None]
    made = read_meshes([shape.mesh for shape in shapes if shape.mesh is not None])
    unusable = measure_meshes(shapes, made, lambda _: MISSING, draft, ())
    for found in lists:
        found[:] = [shape for shape in found if id(shape) not in unusable]
