"""Rules on what files say of joints and meshes: axes, limits, ratings, names and surfaces of meshes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Final

from simspec.language import trees
from simspec.language.foreign import Fate
from simspec.language.load import Spec
from simspec.plausibility.findings import Finding, Grade
from simspec.plausibility.parts import extent, lumps_of
from simspec.resolve.shapes import mesh_shapes, read_meshes
from simspec.world.kinematics import poses
from simspec.world.kinematics import trees as trees_of
from simspec.world.types import World

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


def joint_findings(spec: Spec, world: World) -> Iterator[Finding]:
    """All findings about joints."""
    yield from _axes(spec)
    yield from _limits(world)
    yield from _accounts(spec)


def _axes(spec: Spec) -> Iterator[Finding]:
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
                yield Finding("axis-length", Grade.NOTE, element, message, length, "", severity, where, location)


def _limits(world: World) -> Iterator[Finding]:
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
                yield Finding("limits-equal", Grade.WARNING, joint.name, message, lower, unit, 1.0, path)
            elif joint.kind == "hinge" and span < NARROW:
                message = f"a range of {math.degrees(span):.3g}°"
                yield Finding("limits-narrow", Grade.WARNING, joint.name, message, span, "rad", NARROW / span, path)
            elif joint.kind == "hinge" and span > WIDE * (1.0 + UNIT):
                half_turns = span / math.pi
                if abs(half_turns - round(half_turns)) > WHOLE:
                    message = f"a range of {span:.5g} rad, {span / 2.0 / math.pi:.3g} turns"
                    grade = Grade.WARNING if max(-lower, upper) > WIDE else Grade.NOTE
                    yield Finding("limits-wide", grade, joint.name, message, span, "rad", span / WIDE, path)
            elif joint.kind == "slide" and span > longest:
                message = f"a travel of {span:.4g} m"
                yield Finding("limits-wide", Grade.WARNING, joint.name, message, span, "m", span / longest, path)


def _accounts(spec: Spec) -> Iterator[Finding]:
    """What importers do not carry as the file says it: ratings of 0, which they take for unknown, and joints whose limits leave
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
            yield Finding(rule, Grade.WARNING, element, message, 0.0, "", 1.0, account.what, account.location)


def mesh_findings(spec: Spec) -> Iterator[Finding]:
    """All findings about the files of collision meshes."""
    shapes = [shape for shape in mesh_shapes(spec.source) if shape.shape.collision]
    if not shapes:
        return
    meshes = read_meshes(spec.source)
    stems: dict[str, dict[str, str]] = {}
    for shape in shapes:
        path = ".".join(map(str, (*shape.path, "mesh", "file")))
        location = shape.problem("").location
        element = shape.file.name
        stems.setdefault(shape.file.stem, {}).setdefault(str(shape.file.resolve()), path)
        if len(stems[shape.file.stem]) == 2 and stems[shape.file.stem][str(shape.file.resolve())] == path:
            message = f"another collision mesh is called {shape.file.stem} too"
            yield Finding("mesh-names", Grade.NOTE, element, message, 2.0, "files", 1.0, path, location)
        made = meshes[shape.file, shape.options]
        if made.enclosed is None:
            # ``open_because`` says of which kind; it is the reader's own sentence
            message = f"encloses no volume: {made.open_because}"
            grade = Grade.WARNING if INWARDS in made.open_because else Grade.NOTE
            yield Finding("mesh-surface", grade, element, message, 0.0, "m³", 1.0, path, location)
        elif len(made.parts) == 1 and (ratio := made.hull_volume / made.enclosed.volume) > CONCAVE:
            message = f"its hull has {ratio:.3g} times its volume"
            yield Finding("mesh-concave", Grade.NOTE, element, message, ratio, "", ratio / CONCAVE, path, location)
