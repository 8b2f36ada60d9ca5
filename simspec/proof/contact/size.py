"""True sizes of a scenario's shapes, by touch: a small ball is held just off each surface, and just into it.

The size that an engine reports (compared at level L4) may differ from that of its collision detection: shapes
have been seen to grow by a millimetre of margin, and a capsule to be taken for a ball.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from simspec.proof.contact.probe import ProbeFigure
from simspec.world import frames, shapes
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.frames import sorted_pair, vector3
from simspec.world.hull import hull_of
from simspec.world.kinematics import initial_state, layout_of, trees
from simspec.world.shapes import Field, field_of
from simspec.world.types import Body, Contact, Inertial, Joint, Pose, Shape, World

NAME = "size"
MEANING = "size of each collision shape by touch with a small ball, against its size in the world"
TOLERANCE = 1e-4
"""m: a tenth of the least that engines are known to get wrong (1 mm), and ten thousand times what sound detection needs."""
GAPS = (-5e-3, -2e-3, -0.5e-3, -TOLERANCE, TOLERANCE, 0.5e-3, 2e-3, 5e-3)
"""m between ball and surface, sorted; the size error found is the middle between the two gaps where touching ends."""
BALL = 0.01
"""Radius of the ball (m): its centre stays outside the shape at every gap."""
MOST_SHAPES = 100
"""Distinct shapes that are probed, the first of the world's order; figures say when there are more."""
TILT = frames.from_axis_angle((2.0 / 7.0, 3.0 / 7.0, 6.0 / 7.0), 0.7)
"""Orientation of the shapes: along no axis, where detection is easiest to get right."""
THICKER = "the engine feels a shape so thin or fine off its surface, by as much as it declares"
PART, FIXED_PART = "part", "fixed part"
"""Roles of bodies that are welded to a free body, and to a fixed one."""
SHAPES, BALLS = "shapes", "balls"
"""Collision groups: only a ball meets a shape."""


@dataclass(frozen=True, slots=True)
class SurfacePoint:
    """A point of a shape's surface and the outward unit normal there, in the shape's frame."""

    where: str
    point: tuple[float, float, float]
    normal: tuple[float, float, float]


@dataclass(frozen=True)
class SizeTrial:
    """The world to load, the states (k, nq) in which to ask for touching pairs, and what each of them tests.

    ``tests``: for each state, for each shape the index of its point, and the gap; ``shapes``: subject, indices into the
    world's bodies of shape and ball, and points of each probed shape; ``left_out``: number of distinct shapes not probed.
    """

    world: World
    q: np.ndarray
    tests: tuple[tuple[int, float], ...]
    shapes: tuple[tuple[str, int, int, tuple[SurfacePoint, ...]], ...]
    left_out: int


def surface_points(shape: Shape, margin: float) -> tuple[SurfacePoint, ...]:
    """Points of a collision shape with known normals, moved out by the ``margin`` (m) at which it is felt: middles of faces,
    and places where stand-ins for it would differ."""
    return tuple(_felt(point, margin) for point in _POINTS[shape.kind](shape.size))


def _felt(point: SurfacePoint, margin: float) -> SurfacePoint:
    """Where contact begins: that far out along the normal."""
    x, y, z = (at + margin * along for at, along in zip(point.point, point.normal, strict=True))
    return SurfacePoint(point.where, (x, y, z), point.normal) if margin else point


def _sphere(size: Sequence[float]) -> Iterator[SurfacePoint]:
    for normal in _directions(((1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (1, 1, 1))):
        yield SurfacePoint(_along(normal), _scaled(normal, size[0]), normal)


def _box(size: Sequence[float]) -> Iterator[SurfacePoint]:
    half = [edge / 2 for edge in size]
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = vector3(sign if index == axis else 0.0 for index in range(3))
            name = f"face {'+' if sign > 0 else '-'}{'xyz'[axis]}"
            centre = vector3(half[index] * normal[index] for index in range(3))
            yield SurfacePoint(name, centre, normal)
            corner = vector3(centre[index] or 0.8 * half[index] for index in range(3))
            yield SurfacePoint(f"{name} near a corner", corner, normal)


def _cylinder(size: Sequence[float]) -> Iterator[SurfacePoint]:
    radius, half = size[0], size[1] / 2
    for sign, end in ((1.0, "top"), (-1.0, "bottom")):
        yield SurfacePoint(end, (0.0, 0.0, sign * half), (0.0, 0.0, sign))
        for angle in (0.0, 2.0):
            rim = (0.9 * radius * math.cos(angle), 0.9 * radius * math.sin(angle), sign * half)
            yield SurfacePoint(f"{end} near the rim", rim, (0.0, 0.0, sign))
    yield from _side(radius, (0.0, 0.9 * half, -0.9 * half))


def _side(radius: float, heights: Sequence[float]) -> Iterator[SurfacePoint]:
    for height in heights:
        for angle in (0.0, 1.0, 4.0):
            normal = (math.cos(angle), math.sin(angle), 0.0)
            where = "side" if not height else f"side at {height:+.3g} m"
            yield SurfacePoint(where, (radius * normal[0], radius * normal[1], height), normal)


def _capsule(size: Sequence[float]) -> Iterator[SurfacePoint]:
    radius, half = size[0], size[1] / 2
    for sign, end in ((1.0, "top"), (-1.0, "bottom")):
        for normal in _directions(((0, 0, sign), (1, 0, sign), (-1, 2, sign))):
            x, y, z = _scaled(normal, radius)
            where = f"{end} cap" if normal[0] else end
            yield SurfacePoint(where, (x, y, z + sign * half), normal)
    yield from _side(radius, (0.0, half, -half))


def _ellipsoid(size: Sequence[float]) -> Iterator[SurfacePoint]:
    for unit in _directions(
        ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (1, 1, 1), (-1, 1, 2))
    ):
        point = vector3(unit[index] * size[index] for index in range(3))
        normal = _unit(tuple(unit[index] / size[index] for index in range(3)))
        yield SurfacePoint(_along(unit), point, normal)


def _plane(size: Sequence[float]) -> Iterator[SurfacePoint]:
    yield SurfacePoint("origin", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    yield SurfacePoint("1 m off", (0.8, -0.6, 0.0), (0.0, 0.0, 1.0))


def _mesh(size: Sequence[float]) -> Iterator[SurfacePoint]:
    solid = hull_of(size)
    corners = solid.vertices[solid.triangles]
    first, second, third = (corners[:, corner] for corner in range(3))
    area = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    towards = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)]
    chosen: dict[int, str] = {}
    for direction in _directions(towards):  # of the faces that look this way, a large one
        score = (solid.normals @ np.array(direction)) * np.sqrt(area)
        chosen.setdefault(int(score.argmax()), _along(direction).replace("end ", "face towards "))
    for face, where in chosen.items():
        yield SurfacePoint(where, vector3(corners[face].mean(axis=0).tolist()), vector3(solid.normals[face].tolist()))


CLEAR = 1e-3
"""m by which a ball at its widest gap must be further from all other triangles of a field than from the one that it probes."""
MOST_LOOKED_AT = 200
"""Cells of a height field among which places for the ball are sought."""
MOST_TRIANGLES = 12
"""Triangles of a height field that are probed: both of a cell, so that the other diagonal would be felt."""


def _heightfield(size: Sequence[float]) -> Iterator[SurfacePoint]:
    """Middles of triangles where no other triangle is nearer to the ball: the highest, the lowest, and cells that are bent
    most, in which the other diagonal is furthest off."""
    field = field_of(size)
    corners = field.points[field.triangles]
    middles = corners.mean(axis=1)
    z = field.heights
    bent = np.abs(z[1:, 1:] + z[:-1, :-1] - z[1:, :-1] - z[:-1, 1:]).ravel()
    cells = np.argsort(-bent, kind="stable")[:MOST_LOOKED_AT]
    ends = [int(middles[:, 2].argmax()), int(middles[:, 2].argmin())]
    found = 0
    for number in dict.fromkeys([*ends, *np.stack([2 * cells, 2 * cells + 1], axis=1).ravel().tolist()]):
        normal = field.normals[number]
        if _alone(field, number, middles[number] + (BALL + GAPS[-1]) * normal):
            row, rest = divmod(number, 2 * (z.shape[1] - 1))
            where = f"{'upper' if rest % 2 else 'lower'} triangle of row {row}, column {rest // 2}"
            yield SurfacePoint(where, vector3(middles[number].tolist()), vector3(normal.tolist()))
            found += 1
            if found == MOST_TRIANGLES:
                return


def _alone(field: Field, number: int, centre: np.ndarray) -> bool:
    """Whether the ball, at its widest gap over a triangle, is clearly further from every other, and from its walls."""
    reach = BALL + GAPS[-1] + CLEAR
    corners = field.points[field.triangles]
    low, high = corners.min(axis=1) - reach, corners.max(axis=1) + reach
    near = np.flatnonzero(((low < centre) & (centre < high)).all(axis=1))
    others = corners[near[near != number]]
    return all(_from_triangle(centre, triangle) > reach for triangle in others)


def _from_triangle(point: np.ndarray, corners: np.ndarray) -> float:
    """How far (m) a point is from a triangle (3, 3)."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal /= np.linalg.norm(normal)
    after = np.roll(corners, -1, axis=0)
    inwards = np.cross(normal, after - corners)
    if (((point - corners) * inwards).sum(axis=1) >= 0.0).all():
        return abs(float((point - corners[0]) @ normal))
    along = ((point - corners) * (after - corners)).sum(axis=1) / ((after - corners) ** 2).sum(axis=1)
    nearest = corners + np.clip(along, 0.0, 1.0)[:, None] * (after - corners)
    return float(np.linalg.norm(nearest - point, axis=1).min())


_POINTS = {
    "sphere": _sphere,
    "box": _box,
    "cylinder": _cylinder,
    "capsule": _capsule,
    "ellipsoid": _ellipsoid,
    "plane": _plane,
    "mesh": _mesh,
    "heightfield": _heightfield,
}


def _directions(vectors: Sequence[Sequence[float]]) -> list[tuple[float, float, float]]:
    return [_unit(vector) for vector in vectors]


def _unit(vector: Sequence[float]) -> tuple[float, float, float]:
    return _scaled(vector, 1.0 / math.sqrt(sum(value * value for value in vector)))


def _scaled(vector: Sequence[float], by: float) -> tuple[float, float, float]:
    return (vector[0] * by, vector[1] * by, vector[2] * by)


def _along(normal: Sequence[float]) -> str:
    axes = [("+" if value > 0 else "-") + "xyz"[index] for index, value in enumerate(normal) if value]
    return "end " + axes[0] if len(axes) == 1 else "towards " + " ".join(axes)


_Probed = tuple[str, str, str, tuple[SurfacePoint, ...], Pose]
"""The name of the shape, the body that carries it, its ball, points of its surface, and the pose of the shape in the world."""

# --- the world ----------------------------------------------------------------------------------------------------


def size_trial(world: World) -> SizeTrial | None:
    """A world with each distinct collision shape of ``world`` (kind, size, and whether it sits on a fixed body, with a mass or
    without, a free one, or one that hangs in a tree, of joints or of parts that are welded together) and a ball for each; None
    when nothing in the world can touch.

    Contact laws and options of engines are the world's own.
    """
    partners: dict[str, tuple[str, float | None]] = {}
    laws = meeting_laws(world)  # other pairs have no law
    for first, second in sorted(laws, key=lambda pair: _last(laws[pair].margin)):
        margin = laws[first, second].margin
        partners.setdefault(first, (second, margin))
        partners.setdefault(second, (first, margin))
    distinct: dict[tuple[str, tuple[float, ...], float, float | None, str, bool], tuple[Shape, str, str]] = {}
    welded = _welded(world)
    for body in world.bodies:
        role = "free" if body.joint.kind == "free" else "fixed"
        if body.joint.parent is not None:
            role = welded.get(body.name, "child")
        # an engine may hold a fixed body with a mass as a link, and one without as no more than a place
        weighs = role not in ("child", "free") and body.inertial.mass > 0.0
        for shape in solid_shapes(body):
            if shape.material in partners:
                partner, margin = partners[shape.material]
                key = (shape.kind, shape.size, shape.margin, margin, role, weighs)
                distinct.setdefault(key, (shape, role, partner))
    if not distinct:
        return None
    bodies: list[Body] = []
    probed: list[_Probed] = []
    excluded = []
    at, unprobed = 0.0, 0
    chosen = list(distinct.items())[:MOST_SHAPES]
    for index, ((*_, stated, _, weighs), (shape, role, partner)) in enumerate(chosen):
        margin = shape.margin if stated is None else stated
        points = surface_points(shape, margin)
        if not points:  # ground so fine that the ball would touch several triangles at once
            unprobed += 1
            continue
        kind = shapes.SHAPES[shape.kind]
        wide = kind.points or kind.grid
        reach = (2.0 * kind.outer_radius(shape.size) if wide else sum(shape.size)) + margin + 1.0
        at += reach
        # a plane is solid below itself, without end: it lies under all other shapes
        place = Pose((at, 0.0, 0.0), TILT) if shape.kind != "plane" else Pose((at, 0.0, -1000.0 - 10.0 * index))
        at += reach
        name, ball = f"shape_{index}", f"ball_{index}"
        made = _carrier(name, shape, role, place, weighs)
        excluded += [sorted_pair(body.name, body.joint.parent) for body in made if body.joint.parent is not None]
        bodies += [*made, _ball(ball, partner, (at, 50.0, 0.0))]
        subject = f"{_described(shape, margin)}, {role}"
        probed.append((subject, name, ball, points, place))
    contact = Contact(
        world.contact.friction_cone,
        world.contact.materials,
        world.contact.pairs,
        ((BALLS, BALLS), (SHAPES, SHAPES)),
        tuple(sorted(excluded)),
    )
    trial_world = World(f"{world.name}-sizes", tuple(bodies), contact, world.physics, engines=world.engines)
    if not probed:
        return None
    return _states(trial_world, probed, len(distinct) - len(chosen) + unprobed)


def _welded(world: World) -> dict[str, str]:
    """The roles of bodies in trees in which nothing but the root moves: engines without joints have these."""
    found: dict[str, str] = {}
    for root, *others in trees(world).values():
        if root.joint.kind in ("free", "fixed") and all(body.joint.kind == "fixed" for body in others):
            found |= dict.fromkeys((body.name for body in others), PART if root.joint.kind == "free" else FIXED_PART)
    return found


def _last(margin: float | None) -> float:
    """Pairs with a large margin of their own come before others."""
    return 1.0 if margin is None else -margin


def _states(world: World, probed: Sequence[_Probed], left_out: int) -> SizeTrial:
    place_of = layout_of(world).position
    index_of = {body.name: index for index, body in enumerate(world.bodies)}
    start, _ = initial_state(world)
    states, tests = [], []
    for number in range(max(len(points) for *_, points, _ in probed)):
        for gap in GAPS:
            q = start.copy()
            for _, _, ball, points, pose in probed:
                touched = points[min(number, len(points) - 1)]
                off = vector3(touched.point[axis] + touched.normal[axis] * (BALL + gap) for axis in range(3))
                first = place_of[index_of[ball]].start
                q[first : first + 3] = frames.add(pose.position, frames.rotate(pose.quaternion, off))
            states.append(q)
            tests.append((number, gap))
    shapes = tuple((subject, index_of[name], index_of[ball], points) for subject, name, ball, points, _ in probed)
    return SizeTrial(world, np.array(states), tuple(tests), shapes, left_out)


def _described(shape: Shape, margin: float) -> str:
    """A shape's kind and size, and the distance at which it is felt, in a few words."""
    if shapes.SHAPES[shape.kind].points:
        radius = shapes.SHAPES[shape.kind].outer_radius(shape.size)
        return f"{shape.kind} of {len(shape.size) // 3} vertices within {radius:g} m"
    if shapes.SHAPES[shape.kind].grid:
        rows, columns, x, y, *_ = shape.size
        return f"{shape.kind} of {rows:g} × {columns:g} heights on {x:g} × {y:g} m"
    text = " × ".join(f"{value:g}" for value in shape.size)
    felt = f", margin {margin:g} m" if margin else ""
    return f"{shape.kind}{' ' if text else ''}{text}{' m' if text else ''}{felt}"


def _carrier(name: str, shape: Shape, role: str, place: Pose, weighs: bool) -> list[Body]:
    solid = Shape(f"{name}/solid", shape.kind, shape.size, Pose(), shape.material, margin=shape.margin)
    heavy = Inertial(1.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    if role == "fixed":
        joint = Joint(name, "fixed", None, place)
        return [Body(name, name, heavy if weighs else Inertial(0.0), joint, (solid,), SHAPES)]
    if role == "free":
        joint = Joint(name, "free", position=(*place.position, *place.quaternion), velocity=(0.0,) * 6)
        return [Body(name, name, heavy, joint, (solid,), SHAPES)]
    root = f"{name}_root"
    if role in (PART, FIXED_PART):
        below = Joint(root, "fixed", None, place)
        if role == PART:
            below = Joint(root, "free", position=(*place.position, *place.quaternion), velocity=(0.0,) * 6)
        return [
            Body(root, root, heavy, below, (), SHAPES),
            Body(name, root, heavy if weighs else Inertial(0.0), Joint(name, "fixed", root), (solid,), SHAPES),
        ]
    joint = Joint(name, "hinge", root, Pose(), (0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    return [
        Body(root, root, Inertial(0.0), Joint(root, "fixed", None, place), (), SHAPES),
        Body(name, root, heavy, joint, (solid,), SHAPES),
    ]


def _ball(name: str, material: str, position: tuple[float, float, float]) -> Body:
    inertia = 0.4 * BALL * BALL
    return Body(
        name,
        name,
        Inertial(1.0, (0.0, 0.0, 0.0), (inertia, inertia, inertia, 0.0, 0.0, 0.0)),
        Joint(name, "free", position=(*position, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6),
        (Shape(f"{name}/solid", "sphere", (BALL,), Pose(), material),),
        BALLS,
    )


# --- what the touching says ---------------------------------------------------------------------------------------


def size_figures(
    trial: SizeTrial, touching: np.ndarray, thicker: Mapping[str, float] = MappingProxyType({})
) -> list[ProbeFigure]:
    """A figure for each shape, its worst point, from the touching pairs (n, 3): state, then two bodies' indices. ``thicker``:
    by shape of the trial's world, how far (m) outside or inside an engine declares to hold its faces."""
    seen = {(int(state), int(a), int(b)) for state, a, b in touching}
    figures = []
    for subject, shape, ball, points in trial.shapes:
        pair = (min(shape, ball), max(shape, ball))
        errors = {}
        for number, point in enumerate(points):
            touched = {gap: (state, *pair) in seen for state, (n, gap) in enumerate(trial.tests) if n == number}
            errors[point] = size_error(touched)
        worst = max(errors, key=lambda point: abs(errors[point]))
        note = f"{trial.left_out} more shapes not probed" if trial.left_out else ""
        outside = thicker.get(trial.world.bodies[shape].shapes[0].name, 0.0)
        tolerance, why = limits(outside)
        numbers = (0.0, errors[worst], tolerance)
        promised = TOLERANCE if why else None
        named = (NAME, subject, case_of(len(points)), "size error", "m")
        figures.append(ProbeFigure(*named, *numbers, why, worst=worst.where, note=note, promised=promised))
    return figures


def limits(outside: float) -> tuple[float, str]:
    """The tolerance (m) of a size, and the declared deviation, of a shape whose surface the engine declares to hold so
    far (m) outside or inside."""
    if not outside:
        return TOLERANCE, ""
    passed = max(index for index, gap in enumerate(GAPS) if gap <= outside + TOLERANCE)
    return _middle(passed), THICKER


def case_of(points: int) -> str:
    """The case of a figure of so many points of a surface."""
    return f"{points} points"


def size_error(touched: dict[float, bool]) -> float:
    """How far out the surface is (m, negative: inside), from what touched at each of ``GAPS``.

    The middle of the two gaps between which touching ends; zero when it ends between the two tolerances; the last gap when
    all touch, or none. Where touching comes and goes, the deviation that is larger.
    """
    out = max((gap for gap in GAPS if touched[gap]), default=None)
    inside = min((gap for gap in GAPS if not touched[gap]), default=None)
    outward = 0.0 if out is None or out < 0.0 else _middle(GAPS.index(out))
    inward = 0.0 if inside is None or inside > 0.0 else _middle(GAPS.index(inside) - 1)
    return outward if outward >= -inward else inward


def _middle(index: int) -> float:
    """Between gap ``index`` and the next one outwards; the outermost beyond the ends."""
    if index < 0 or index + 1 >= len(GAPS):
        return GAPS[0] if index < 0 else GAPS[-1]
    return 0.5 * (GAPS[index] + GAPS[index + 1])
