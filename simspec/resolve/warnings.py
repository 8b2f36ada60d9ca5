"""Warnings about values that are allowed and look like slips: angles in degrees without their unit, a squeeze that no finger
can give, bodies that begin inside each other, scenes that take no time, lengths and masses of another unit, motions that are
too fast for the timestep."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from simspec.errors import Location, Problem
from simspec.language import problems as walk
from simspec.language import trees
from simspec.language.actions import TrajectoryPoint
from simspec.language.arrays import initial_meant, matches
from simspec.language.beginning import AT_LIMITS, LimitStart, listed
from simspec.language.document import Key
from simspec.language.foreign import of_physics, problems
from simspec.language.joints import Joint as SpecJoint
from simspec.language.locate import locate
from simspec.language.models import File
from simspec.language.problems import in_order
from simspec.language.quantities import Number, Reader, Vector
from simspec.language.shapes import HULL
from simspec.language.sources import Source
from simspec.resolve.shapes import fills, mesh_shapes, read_meshes
from simspec.resolve.timestep_warnings import timestep_warnings
from simspec.resolve.trajectory import dwell_overshoots
from simspec.world.kinematics import rigid_groups
from simspec.world.overlap import deep_overlaps
from simspec.world.shapes import SHAPES
from simspec.world.types import World

MOST_WARNINGS = 50
"""Warnings that are given, after those of one place are counted together."""
FULL_TURN = 2.0 * math.pi * 1.002
"""rad; a little more than a turn, for limits that were rounded (6.2832, 6.29)."""
LARGEST_MOVING = 50.0
"""m, bounding radius of a moving body's shape: a bare `120` that meant millimetres."""
LARGEST_PLACE = 1e4
"""m from the world's origin: doubles keep 1e-12 m there, but contact margins and single precision do not."""
DENSITIES = (10.0, 25_000.0)
"""kg/m³: foam has 15, osmium 22,590. A bare `7.85` meant g/cm³."""
LARGEST_HULL = 1.25
"""Volume of a hull over that of its mesh: a link with bores and rounded corners stays below."""
LARGEST_LOSS = 0.01
"""Distance of a whole hull from one of fewer vertices, of its radius."""
MASSES = (1e-9, 1e6)
"""kg of a moving body."""
STRONGEST_GRAVITY = 100.0
"""m/s²: four times Jupiter's. A bare `-9810` meant mm/s²."""


def warnings(spec: Source, world: World) -> list[Problem]:
    """The warnings of ``spec``, with the world ``world``; in file order, each with its place and the way out.

    Of several at one place the first is given, with their number; at most ``MOST_WARNINGS`` in all.
    """
    suspicious = [
        *_losses(spec),
        *_starts(spec),
        *_angles(spec),
        *_time(spec, world),
        *_sizes(spec, world),
        *_squeeze(spec, world),
        *(("dwell", problem) for problem in dwell_overshoots(spec, world)),
        *_meshes(spec),
        *_overlaps(spec, world),
        *timestep_warnings(spec, world),
    ]
    grouped: dict[tuple[str, Location | str], list[Problem]] = {}
    for message_kind, problem in suspicious:
        grouped.setdefault((message_kind, problem.location or problem.path), []).append(problem)
    first = [_counted(group) for group in grouped.values()]
    ordered = in_order(first)
    if len(ordered) > MOST_WARNINGS:
        more = Problem(f"and {len(ordered) - MOST_WARNINGS} more warnings", code="W117")
        ordered = [*ordered[:MOST_WARNINGS], more]
    return ordered


Warned = Iterator[tuple[str, Problem]]
"""Pairs (kind, problem): those of one kind at one place are counted together."""


def _counted(group: list[Problem]) -> Problem:
    first, more = group[0], len(group) - 1
    if not more:
        return first
    message = f"{first.message} (and {more} more of this kind)"
    return dataclasses.replace(first, message=message)


# --- files of other languages --------------------------------------------------------------------------------------------


def _losses(spec: Source) -> Warned:
    """The warnings of importers, and their losses of physics, each kind once."""
    for source in spec.all():
        if source.imported is not None:
            for problem in source.imported.suspicious:
                yield problem.message, problem
            for problem in problems(of_physics(source.imported)):
                yield problem.message, problem


def _starts(spec: Source) -> Warned:
    """Joints of imported files that begin at a limit, since the file's position is beyond it, and that no spec places."""
    placed: list[tuple[Source, trees.Bodies, Iterable[str]]] = [
        (spec, bodies, use.positions if use is not None else ()) for _, use, bodies in trees.placed(spec)
    ]
    if (model := trees.model_of(spec)) is not None:
        placed.append((spec, model, ()))
    elif spec.imported is not None:
        yield from _at_limits(spec, spec.imported.starts)
    for source, bodies, positions in placed:
        chosen = trees.chosen_state(source, bodies)
        state = trees.states(source, bodies).get(chosen[2]) if chosen is not None else None
        stated = {*positions, *(state.raw.get("positions", ()) if state is not None else ())}
        for file in bodies.files:
            if file.imported is not None:
                of_state = [start for start in file.imported.starts if chosen is not None and start.state == chosen[2]]
                starts_here = [
                    start for start in file.imported.starts if not start.state and not _names(stated, start.joint)
                ]
                moved = [entry for entry in of_state if state is not None and not _names(positions, entry.joint)]
                yield from _at_limits(file, [*starts_here, *moved])


def _names(entries: Iterable[str], joint: str) -> bool:
    """Whether one of some names and patterns means a joint."""
    return any(matches(entry, joint) for entry in entries)


def _at_limits(source: Source, starts: Sequence[LimitStart]) -> Warned:
    if starts:
        hint = "positions: where the model is placed"
        yield "start", source.document.problem(starts[0].path, AT_LIMITS, found=listed(starts), hint=hint, code="W102")


# --- angles ------------------------------------------------------------------------------------------------------------


def _angles(spec: Source) -> Warned:
    for source in spec.all():
        for path, value in _bare_angles(File, source.document.data, ()):
            yield _angle(source, path, value)
    for _, use, bodies in trees.placed(spec):
        kinds = {
            joint: kind
            for name in bodies.raw
            for joint, kind in zip(bodies.joint_names(name), bodies.joint_types(name), strict=True)
        }
        following = trees.followers(spec, bodies)
        places = [(state.source, state.path, state.raw) for state in trees.states(spec, bodies).values()]
        if use is not None:
            raw = spec.document.data["models"][bodies.placed[1]]
            places.insert(0, (spec, bodies.placed, raw))
        for source, place, raw in places:
            values = raw.get("positions", {})
            for entry, value in values.items():
                meant = initial_meant(entry, values, kinds, following)
                for path, bare in _of_joint(kinds[meant[0]], value, (*place, "positions", entry)) if meant else ():
                    yield _angle(source, path, bare)


def _angle(source: Source, path: tuple[Key, ...], value: float) -> tuple[str, Problem]:
    message = f"{value:g} without a unit is {value:g} rad: {abs(value) / (2.0 * math.pi):.3g} turns"
    return "angle", source.document.problem(
        path, message, hint=f"{value:g} deg, or {value:g} rad if intended", code="W101"
    )


def _bare_angles(kind: Any, data: Any, path: tuple[Key, ...]) -> Iterator[tuple[tuple[Key, ...], float]]:
    """Angles of more than a turn that are written without a unit, below a place of the language."""
    if isinstance(kind, Reader):
        number = kind.item if isinstance(kind, Vector) else kind
        if isinstance(number, Number) and number.dimension == "angle":
            yield from _large(data, path)
    elif kind is TrajectoryPoint:
        return  # wheels and spindles turn many times, and points are many
    elif walk.is_model(kind) and isinstance(data, Mapping):
        if kind is SpecJoint:
            yield from _of_joint(data.get("type"), data.get("position"), (*path, "position"))
            for holder, field in (("limits", "position"), ("spring", "rest")):
                part = data.get(holder)
                if isinstance(part, Mapping):
                    yield from _of_joint(data.get("type"), part.get(field), (*path, holder, field))
        for key, value in data.items():
            yield from _bare_angles(walk.child(kind, key), value, (*path, key))
    elif isinstance(kind, walk.Free) and isinstance(data, Mapping):
        for key, value in data.items():
            yield from _bare_angles(kind.item, value, (*path, key))
    elif isinstance(kind, list) and isinstance(data, (list, tuple)):
        for index, value in enumerate(data):
            yield from _bare_angles(kind[0], value, (*path, index))


def _of_joint(kind: Any, value: Any, path: tuple[Key, ...]) -> Iterator[tuple[tuple[Key, ...], float]]:
    """Of a joint's position, limits or rest: angles of a hinge, and of a ball joint its orientation's."""
    if kind == "hinge":
        yield from _large(value, path)
    elif kind == "ball" and isinstance(value, Mapping):
        yield from _large(value.get("rpy"), (*path, "rpy"))


def _large(value: Any, path: tuple[Key, ...]) -> Iterator[tuple[tuple[Key, ...], float]]:
    values = enumerate(value) if isinstance(value, (list, tuple)) else [(None, value)]
    for index, item in values:
        if isinstance(item, (int, float)) and not isinstance(item, bool) and abs(item) > FULL_TURN:
            yield (path if index is None else (*path, index)), float(item)


# --- time, sizes -----------------------------------------------------------------------------------------------------


def _time(spec: Source, world: World) -> Warned:
    if not world.physics.steps and spec.content.model is None:
        message = "the run has zero duration: nothing will move"
        found = f"{spec.content.physics.duration:g} s"
        yield (
            "time",
            Problem(
                message, "physics.duration", locate(spec, "physics.duration"), found, hint="duration: 2 s", code="W103"
            ),
        )
    size = math.hypot(*world.physics.gravity)
    if size > STRONGEST_GRAVITY:
        message, where = f"gravity of {size:g} m/s²", "physics.gravity"
        yield (
            "gravity",
            Problem(message, where, locate(spec, where), hint="lengths are in metres: [0, 0, -9.81]", code="W104"),
        )


def _sizes(spec: Source, world: World) -> Warned:
    groups = rigid_groups(world)
    kinematic = {motion.body for motion in world.motions}
    written = _written_densities(spec)
    for path, location, density in written:
        message = f"a density of {density:g} kg/m³"
        least, most = DENSITIES
        hint = f"{density:g} g/cm^3?" if density < least else "kg/m³ is the unit of a bare number"
        yield (
            "density",
            Problem(
                message, path, location, allowed=f"{least:g} to {most:g} for real materials", hint=hint, code="W105"
            ),
        )
    for body in world.bodies:
        if groups[body.name] == "world":
            continue
        mass, path = body.inertial.mass, f"bodies.{body.name}.mass"
        if mass and body.name not in kinematic and not MASSES[0] <= mass <= MASSES[1]:
            hint = "a bare number is in kg"
            yield "mass", Problem(f"a moving body of {mass:.4g} kg", path, locate(spec, path), hint=hint, code="W106")
        for index, shape in enumerate(body.shapes):
            size = SHAPES[shape.kind].outer_radius(shape.size)
            if LARGEST_MOVING < size < math.inf:
                path = f"bodies.{body.name}.shapes.{index}"
                message = f"a moving body with a {shape.kind} that reaches {size:.4g} m from its centre"
                hint = "a bare number is in metres: write mm if millimetres are intended"
                yield "size", Problem(message, path, locate(spec, path), hint=hint, code="W107")
        place = body.joint.position[:3] if body.joint.kind == "free" else body.joint.origin.position
        if math.hypot(*place) > LARGEST_PLACE:
            path = f"bodies.{body.name}.{'pose' if body.joint.parent is None else 'joint.origin'}"
            message = f"{math.hypot(*place):.4g} m away from its parent"
            hint = "a bare number is in metres: write mm if millimetres are intended"
            yield "place", Problem(message, path, locate(spec, path), hint=hint, code="W107")


def _written_densities(spec: Source) -> Iterator[tuple[str, Location | None, float]]:
    """Densities out of ``DENSITIES`` that a shape states, of all trees; 0 is a way to say "no mass"."""
    for bodies in trees.every(spec):
        for name, body in bodies.typed.items():
            for index, shape in enumerate(body.shapes if body is not None else ()):
                density = shape.density
                if density and not DENSITIES[0] <= density <= DENSITIES[1]:
                    path = (*bodies.path, name, "shapes", index, "density")
                    yield ".".join(map(str, path)), bodies.source.document.locate(path), density


def _meshes(spec: Source) -> Warned:
    """The volume that a hull adds to a mesh or loses by fewer vertices, and solids that may be counted twice."""
    meshes = read_meshes(spec) if any(True for _ in mesh_shapes(spec)) else {}
    for shape in mesh_shapes(spec):
        made = meshes[shape.file, shape.options]
        if shape.shape.collision and made.enclosed is not None and len(made.parts) == 1:
            ratio = made.hull_volume / made.enclosed.volume
            if ratio > LARGEST_HULL:
                message = f"the convex hull has {ratio:.3g} times the volume of the mesh, and is what touches"
                yield "hull", shape.problem(message, "as: pieces; or several shapes", code="W108")
        for part in made.parts:
            share = part.error / SHAPES["mesh"].outer_radius(part.size)
            if share > LARGEST_LOSS:
                kept = f"{len(part.size) // 3} of {part.vertices:,} vertices"
                message = f"with {kept} the hull is up to {1e3 * part.error:.3g} mm smaller"
                yield "vertices", shape.problem(message, "more max_vertices", code="W108")
        filled = made.enclosed is not None and shape.mesh.mass_from != HULL and fills(shape.body, shape.shape)
        if filled and made.surfaces > 1:
            message = f"the mass is that of {made.surfaces} closed surfaces: where they overlap, it counts twice"
            yield "surfaces", shape.problem(message, "mass_from: hull; or the body's mass with inertia", code="W109")


# --- squeeze, overlap --------------------------------------------------------------------------------------------------


def _squeeze(spec: Source, world: World) -> Warned:
    """Feed-forward efforts beyond what their actuators give: clipped in silence, a squeeze would be a weaker one."""
    path = world.trajectory
    if path is None or not path.efforts:
        return
    limits = {
        joint: limit
        for controller in world.controllers
        for joint, limit in zip(controller.joints, controller.effort_limits, strict=True)
        if limit is not None
    }
    units = {body.joint.name: "N m" if body.joint.kind == "hinge" else "N" for body in world.bodies}
    for column, joint in enumerate(path.joints):
        wanted = max(abs(row[column]) for row in path.efforts)
        if joint in limits and wanted > limits[joint] * (1.0 + 1e-9):
            where = _squeeze_place(spec)
            clipped = f"gives at most {limits[joint]:g}: the effort is clipped"
            message = f"{joint} is commanded {wanted:.4g} {units[joint]} and {clipped}"
            hint = "a smaller squeeze (or smaller forces of the grasp), or a stronger actuator"
            yield "squeeze", Problem(message, where, locate(spec, where), hint=hint, code="W110")


def _squeeze_place(spec: Source) -> str:
    """The first step of the program that squeezes; else the trajectory."""
    program = spec.content.trajectory.program if spec.content.trajectory is not None else None
    for index, step in enumerate(program or ()):
        if getattr(step, "squeeze", None):
            return f"trajectory.program.{index}.squeeze"
    return "trajectory"


def _overlaps(spec: Source, world: World) -> Warned:
    index = {shape.name: (body.name, k) for body in world.bodies for k, shape in enumerate(body.shapes)}
    moving = {name for name, group in rigid_groups(world).items() if group != "world"}
    for overlap in deep_overlaps(world):
        # the place is that of the body that can be moved away
        name = overlap.second if overlap.second_body in moving else overlap.first
        body, number = index[name]
        path = f"bodies.{body}.shapes.{number}"
        message = f"{overlap.first_body} and {overlap.second_body} overlap by {1e3 * overlap.depth:.4g} mm at the start"
        hint = "move one of them; or contact: exclude, or groups, if they are intended to pass through each other"
        yield (
            "overlap",
            Problem(message, path, locate(spec, path), f"{overlap.first} in {overlap.second}", hint=hint, code="W111"),
        )
