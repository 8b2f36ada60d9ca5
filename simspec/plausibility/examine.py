"""All rules over one spec and its world."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Generator, Iterator
from typing import Final

import numpy as np

from simspec.errors import Location
from simspec.language import trees
from simspec.language.foreign import Fate
from simspec.language.load import Spec
from simspec.language.moments import principal_moments
from simspec.plausibility.findings import Grade, Plausibility, PlausibilityFinding, ordered
from simspec.plausibility.parts import (
    DIRECTIONS,
    Floats,
    Lump,
    MotionPart,
    carrying,
    extent,
    judged_parts,
    lumps_of,
    moving_groups,
    outside,
    pose_of,
    reach,
)
from simspec.plausibility.places import Places
from simspec.plausibility.sweep import sweep
from simspec.resolve.shapes import mesh_shapes, read_meshes
from simspec.world import inertia
from simspec.world.kinematics import poses
from simspec.world.kinematics import trees as trees_of
from simspec.world.types import Inertial, World

# Rules on what files say of joints and meshes: axes, limits, ratings, names and surfaces of meshes.

UNIT: Final = 1e-3
"""By which the length of an axis may differ from 1: axes are printed with some digits."""
NARROW: Final = math.radians(4.0)
"""rad, of the range of a hinge: half a turn in radians, taken for degrees, is 3.1°."""
WIDE: Final = 4.0 * math.pi
"""rad, of the range of a hinge: cables end sooner."""
WHOLE: Final = 2e-3
"""Half turns by which a range may miss a whole number of them: limits are printed with some digits."""
TRAVEL: Final = (5.0, 1.5)
"""m, and times the size of the model, of the range of a slide."""
CONCAVE: Final = 1.5
"""Volume of a mesh's hull over its own."""
INWARDS: Final = "inwards"
"""The word by which a surface that is wound so is known."""


def joint_findings(spec: Spec, world: World) -> Iterator[PlausibilityFinding]:
    """All findings about joints."""
    yield from _axes(spec)
    yield from _limits(world)
    yield from _accounts(spec)


def _axes(spec: Spec) -> Iterator[PlausibilityFinding]:
    """Axes as robot files have them; in a spec they may have any length."""
    for bodies in trees.every(spec.source):
        if bodies.source.imported is None:
            continue
        for name, body in bodies.typed.items():
            if body is None:
                continue
            written = body.joints or ([body.joint] if body.joint is not None else [])
            for index, joint in enumerate(written):
                if joint.axis is None:
                    continue
                length = math.hypot(*joint.axis)
                if abs(length - 1.0) <= UNIT:
                    continue
                path = (*bodies.path, name, *bodies.joint_place(name, index), "axis")
                location = bodies.source.document.locate(path)
                element = bodies.joint_names(name)[index]
                message = f"an axis of length {length:.4g}"
                severity = abs(math.log(length)) / UNIT
                where = ".".join(map(str, path))
                yield PlausibilityFinding(
                    "axis-length", Grade.NOTE, element, message, length, "", severity, where, location
                )


def _limits(world: World) -> Iterator[PlausibilityFinding]:
    at = poses(world)
    for bodies in trees_of(world).values():
        solids = [lump.at(at[body.name]) for body in bodies for lump in lumps_of(world)[body.name]]
        longest = max(TRAVEL[0], TRAVEL[1] * extent(solids))
        for body in bodies:
            joint = body.joint
            if joint.position_limits is None:
                continue
            lower, upper = joint.position_limits
            span = upper - lower
            path = f"bodies.{body.name}.joint.limits.position"
            if span == 0.0:
                unit = "rad" if joint.kind == "hinge" else "m"
                message = f"lower and upper limit are both {lower:.6g} {unit}"
                yield PlausibilityFinding("limits-equal", Grade.WARNING, joint.name, message, lower, unit, 1.0, path)
            elif joint.kind == "hinge" and span < NARROW:
                message = f"a range of {math.degrees(span):.3g}°"
                yield PlausibilityFinding(
                    "limits-narrow", Grade.WARNING, joint.name, message, span, "rad", NARROW / span, path
                )
            elif joint.kind == "hinge" and span > WIDE * (1.0 + UNIT):
                half_turns = span / math.pi
                if abs(half_turns - round(half_turns)) > WHOLE:
                    message = f"a range of {span:.5g} rad, {span / 2.0 / math.pi:.3g} turns"
                    grade = Grade.WARNING if max(-lower, upper) > WIDE else Grade.NOTE
                    yield PlausibilityFinding("limits-wide", grade, joint.name, message, span, "rad", span / WIDE, path)
            elif joint.kind == "slide" and span > longest:
                message = f"a travel of {span:.4g} m"
                yield PlausibilityFinding(
                    "limits-wide", Grade.WARNING, joint.name, message, span, "m", span / longest, path
                )


def _accounts(spec: Spec) -> Iterator[PlausibilityFinding]:
    """Losses of importers: ratings of 0, which they take for unknown, and joints whose limits leave
    them one position, which they fix."""
    fixed: set[str] = set()
    for source in spec.source.all():
        if source.imported is None:
            continue
        from simspec.imports.elements import LOCKED, NO_RATING

        for account in source.imported.accounts:
            named = re.findall(r"joint\[([^\]]*)\]", account.what)
            element = named[-1] if named else account.what
            if account.fate is Fate.LOST and account.reason == NO_RATING:
                quantity = "velocity" if account.what.endswith("velocity") else "effort"
                message = f"a rating of 0 for its {quantity}"
                rule = "rating-zero"
            elif account.reason.endswith(LOCKED) and element not in fixed:
                fixed.add(element)
                message, rule = account.reason, "limits-equal"
            else:
                continue
            yield PlausibilityFinding(
                rule, Grade.WARNING, element, message, 0.0, "", 1.0, account.what, account.location
            )


def mesh_findings(spec: Spec) -> Iterator[PlausibilityFinding]:
    """All findings about the files of collision meshes."""
    shapes = [shape for shape in mesh_shapes(spec.source) if shape.shape.collision]
    if not shapes:
        return
    meshes = read_meshes(spec.source)
    stems: dict[str, dict[str, str]] = {}
    for shape in shapes:
        path = ".".join(map(str, (*shape.path, "mesh", "file")))
        location = shape.place
        element = shape.file.name
        stems.setdefault(shape.file.stem, {}).setdefault(str(shape.file.resolve()), path)
        if len(stems[shape.file.stem]) == 2 and stems[shape.file.stem][str(shape.file.resolve())] == path:
            message = f"another collision mesh is called {shape.file.stem} too"
            yield PlausibilityFinding("mesh-names", Grade.NOTE, element, message, 2.0, "files", 1.0, path, location)
        made = meshes[shape.file, shape.options]
        if made.enclosed is None:
            # ``open_because`` says of which kind; it is the reader's own sentence
            message = f"encloses no volume: {made.open_because}"
            grade = Grade.WARNING if INWARDS in made.open_because else Grade.NOTE
            yield PlausibilityFinding("mesh-surface", grade, element, message, 0.0, "m³", 1.0, path, location)
        elif len(made.parts) == 1 and (ratio := made.hull_volume / made.enclosed.volume) > CONCAVE:
            message = f"its hull has {ratio:.3g} times its volume"
            yield PlausibilityFinding(
                "mesh-concave", Grade.NOTE, element, message, ratio, "", ratio / CONCAVE, path, location
            )


# Rules on masses, centres of mass and inertias against the shapes that should hold them.

OUTSIDE: Final = 0.05
"""Share of a part's size by which its centre of mass may be outside its shapes: collision shapes are often somewhat smaller."""
LEAST_OUTSIDE: Final = 1e-3
"""m: the same of small parts."""
SPREAD_OUT: Final = 2.25
"""Factor by which a second moment may exceed its bound: shapes that are smaller than the part by a third, 1.5 squared."""
SMALLER: Final = 10.0
"""Factor by which a principal moment may be below the solid's: a motor in a light housing has a fifth to a third."""
OSMIUM: Final = 22_590.0
"""kg/m³, the densest material."""
FOAM: Final = 20.0
"""kg/m³: foam has 15 to 60. Below, a part can only be hollow."""
AIR: Final = 1.2
"""kg/m³."""
PLASTIC: Final = 1000.0
"""kg/m³, of a hollow part's wall."""
THINNEST_WALL: Final = 3e-4
"""m: thinner walls are film."""
LIGHTEST: Final = 1e-4
"""kg of what a joint moves."""
LARGEST_RATIO: Final = 1000.0
"""Of the masses of two bodies that a joint joins."""
ALIKE: Final = 1e-6
"""Relative difference of three principal moments that are one number, as placeholders have."""


def mass_findings(world: World, foreign: Callable[[str], bool]) -> Iterator[PlausibilityFinding]:
    """All findings about masses. ``foreign``: whether a body comes from a robot file; of others those that cannot be touched
    are left out, and what does not fit the shapes is a note."""
    for part in judged_parts(world):
        grade = Grade.WARNING if foreign(part.name) else Grade.NOTE
        if foreign(part.name) or part.some(True):
            off_centre = yield from _centre(part, grade)
            yield from _inertia(part, off_centre, grade)
    yield from _densities(world, foreign)
    yield from _light(world)
    yield from _ratios(world)


def _centre(part: MotionPart, grade: Grade) -> Generator[PlausibilityFinding, None, bool]:
    """Yields a finding where the centre of mass is outside; gives whether it is."""
    away = outside(part.solids, np.array(part.inertial.centre_of_mass))
    limit = max(OUTSIDE * part.size, LEAST_OUTSIDE)
    if away <= limit:
        return False
    message = f"centre of mass {1e3 * away:.3g} mm outside its shapes, {100.0 * away / part.size:.3g} % of their size"
    path = f"bodies.{part.name}.centre_of_mass"
    yield PlausibilityFinding("mass-outside", grade, part.name, message, away, "m", away / limit, path)
    return True


def _inertia(part: MotionPart, off_centre: bool, grade: Grade) -> Iterator[PlausibilityFinding]:
    inertial = part.inertial
    moments = principal_moments(inertial.inertia)
    if min(moments) <= 0.0:
        return  # a point or a rod: a rigid group makes up for it, or resolving refuses it
    same = max(moments) - min(moments) <= ALIKE * max(moments)
    placeholder = "; equal about all axes" if same else ""
    path = f"bodies.{part.name}.inertia"
    share = 0.0 if off_centre else largest_share(inertial, part.solids, max(OUTSIDE * part.size, LEAST_OUTSIDE))
    if share > SPREAD_OUT:
        further = math.sqrt(share)
        message = f"its mass would lie {further:.3g} times as far out as its shapes reach{placeholder}"
        yield PlausibilityFinding("inertia-too-large", grade, part.name, message, further, "", share / SPREAD_OUT, path)
        return
    solid = solid_of(part, inertial.mass)
    if solid is None:
        return
    expected = principal_moments(solid.inertia)
    ratio, given = max((b / a, a) for a, b in zip(moments, expected, strict=True))
    if ratio > SMALLER:
        message = f"a moment of {given:.3g} kg m², {ratio:.3g} times below a solid's of its mass{placeholder}"
        yield PlausibilityFinding("inertia-too-small", grade, part.name, message, ratio, "", ratio / SMALLER, path)


def largest_share(inertial: Inertial, solids: tuple[Lump, ...], margin: float = 0.0) -> float:
    """The largest ratio, over directions u, of the second moment of the mass along u about its centre to the most that mass
    within the shapes can have: m·a·b with a, b the reaches from the centre of mass along u and −u (the Bhatia–Davis
    inequality); above 1 nothing within the convex hull of the shapes has this inertia. ``margin`` (m): the least of a and b."""
    xx, yy, zz, xy, xz, yz = inertial.inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    directions: Floats = np.concatenate([np.linalg.eigh(second)[1].T, DIRECTIONS])
    centre = np.array(inertial.centre_of_mass)
    middle = directions @ centre
    ahead = reach(solids, directions) - middle
    behind = reach(solids, -directions) + middle
    most = inertial.mass * np.maximum(ahead, margin) * np.maximum(behind, margin)
    given = np.einsum("ni,ij,nj->n", directions, second, directions)
    inside = most > 0.0
    return float((given[inside] / most[inside]).max(initial=0.0))


def solid_of(part: MotionPart, total: float) -> Inertial | None:
    """The mass properties that a part of mass ``total`` (kg) has if its collision shapes (else its visual ones) are homogeneous
    solids; None without a volume."""
    solids = part.some(True) or part.some(False)
    volumes = [solid.volume for solid in solids]
    whole = math.fsum(volumes)
    if whole <= 0.0:
        return None
    pieces = [
        inertia.shape_part(solid.shape.kind, solid.shape.size, pose_of(solid), total * volume / whole)
        for solid, volume in zip(solids, volumes, strict=True)
        if volume > 0.0
    ]
    return inertia.combined_inertial(pieces, total)


def _volume(solids: tuple[Lump, ...]) -> float:
    return math.fsum(solid.volume for solid in solids)


def _densities(world: World, foreign: Callable[[str], bool]) -> Iterator[PlausibilityFinding]:
    for name, part in moving_groups(world).items():
        kilograms, solid = part.inertial.mass, _volume(part.some(True))
        seen = _volume(part.some(False)) if foreign(name) else 0.0
        grade = Grade.WARNING if foreign(name) else Grade.NOTE
        if not kilograms or not (solid or seen):
            continue
        path = f"bodies.{name}.mass"
        # all shapes hold at least the part; of two drawings of it the smaller one holds the least
        densest = kilograms / (solid + seen)
        if densest > OSMIUM:
            message = f"{kilograms:.3g} kg in {1e6 * (solid + seen):.3g} cm³: {densest:.3g} kg/m³, denser than osmium"
            yield PlausibilityFinding("density-high", grade, name, message, densest, "kg/m³", densest / OSMIUM, path)
        volume = min(value for value in (solid, seen) if value)
        density = kilograms / volume
        # no closed surface around a volume is smaller than the sphere's, (36 π V²)^(1/3)
        wall = kilograms / PLASTIC / (36.0 * math.pi * volume * volume) ** (1.0 / 3.0)
        if density < AIR or (density < FOAM and wall < THINNEST_WALL):
            message = (
                f"{kilograms:.3g} kg in {1e6 * volume:.3g} cm³: {density:.3g} kg/m³, a shell of {1e3 * wall:.2g} mm"
            )
            yield PlausibilityFinding("density-low", grade, name, message, density, "kg/m³", FOAM / density, path)


def _light(world: World) -> Iterator[PlausibilityFinding]:
    """Joints that move next to nothing, with all that hangs on them."""
    carried = {name: part.inertial.mass for name, part in moving_groups(world).items()}
    for name, carrier in reversed(carrying(world).items()):
        if name in carried and carrier in carried:
            carried[carrier] += carried[name]
    for name, kilograms in carried.items():
        if 0.0 < kilograms < LIGHTEST:
            message = f"{1e3 * kilograms:.3g} g, with all that hangs on it"
            path = f"bodies.{name}.mass"
            yield PlausibilityFinding(
                "mass-tiny", Grade.NOTE, name, message, kilograms, "kg", LIGHTEST / kilograms, path
            )


def _ratios(world: World) -> Iterator[PlausibilityFinding]:
    groups = moving_groups(world)
    for name, carrier in carrying(world).items():
        if name not in groups or carrier not in groups:
            continue
        value, other = groups[name].inertial.mass, groups[carrier].inertial.mass
        if not value or not other:
            continue
        ratio = max(value, other) / min(value, other)
        if ratio > LARGEST_RATIO:
            message = f"{other:.3g} kg carries {value:.3g} kg, {ratio:.3g} times"
            path = f"bodies.{name}.joint"
            element = f"{carrier} and {name}"
            yield PlausibilityFinding(
                "mass-ratio", Grade.NOTE, element, message, ratio, "", ratio / LARGEST_RATIO, path
            )


def examine(spec: Spec, world: World) -> Plausibility:
    """The findings about the model of ``spec``, which resolves to ``world``."""
    foreign = of_robot_files(spec)
    swept, sampling = sweep(world)
    findings = [
        *mass_findings(world, foreign),
        *Places(world, foreign).findings(),
        *swept,
        *joint_findings(spec, world),
        *mesh_findings(spec),
    ]
    return Plausibility(ordered([_located(finding, spec.locate) for finding in findings]), sampling)


def of_robot_files(spec: Spec) -> Callable[[str], bool]:
    """Whether a body, by its name in the world, comes from a robot file: there shapes, masses and joints are meant to be those
    of one mechanism, while a spec that is written by hand may be a sketch, with shapes that are only seen."""
    if spec.source.imported is not None:
        return lambda name: True
    models = tuple(
        f"{name}/"
        for name, _, bodies in trees.placed(spec.source)
        if any(source.imported is not None for source in (bodies.source, *bodies.files))
    )
    return lambda name: name.startswith(models)


def _located(finding: PlausibilityFinding, locate: Callable[[str], Location | None]) -> PlausibilityFinding:
    if finding.location is not None:
        return finding
    return dataclasses.replace(finding, location=locate(finding.path))
