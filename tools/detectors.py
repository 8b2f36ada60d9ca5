"""Measure what DART's collision detectors find and miss, and write docs/records/dart-detectors.md.

python tools/detectors.py [--draws 12] [--poses 250] [--kind mesh]

Two shapes of random sizes are put into random poses in which coal, the library of signed distances that the filter proof uses,
has them overlap by 0.1, 1 or 10 mm, or have a gap of 0.1 or 1 mm; then the detector is queried for contact.

This is no study: nothing is run, and no scenario is at stake. The table ``UNSOUND`` of simspec/dialects/dart/contact.py is
made of it.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from simspec.compiler import compile_world, write_folder
from simspec.dialects.dart.contact import REFUSED, UNSOUND
from simspec.engines.dart.engine import Dart
from simspec.engines.kit.session import Session
from simspec.language.vocabulary import SHAPE_KINDS
from simspec.proof.touch.geometry import CollisionSolid, gap, solids, transform
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.hull import centred, corners, mesh_size
from simspec.world.types import (
    Body,
    Contact,
    EngineOptions,
    Inertial,
    Joint,
    Material,
    PairContact,
    Physics,
    Pose,
    Shape,
    World,
)

PAGE = Path(__file__).resolve().parent.parent / "docs" / "records" / "dart-detectors.md"
DETECTORS = ("dart", "ode", "bullet", "fcl")
SMALLEST, LARGEST = 0.02, 0.2
"""Of half-sizes and radii (m), drawn evenly in their logarithm; a cylinder and a capsule are up to that long twice over."""
OVERLAPS = (1e-4, 1e-3, 1e-2)
GAPS = (1e-4, 1e-3)
ALLOWED = 0.5
"""Of the smaller shape's inner radius: no overlap is deeper."""
POINTS = 40
"""Vertices of a hull."""
PLACES = 2.0
"""m from the origin, along each axis."""
EXACT = 1e-6
"""m: how far coal's distance may be from the wanted one."""
PAIRS = tuple(
    pair
    for pair in itertools.combinations_with_replacement(sorted(set(SHAPE_KINDS) - {"heightfield"}), 2)
    if pair != ("plane",) * 2 and pair not in REFUSED
)


def _size(kind: str, draw: np.random.Generator) -> tuple[float, ...]:
    a, b, c = np.exp(draw.uniform(math.log(SMALLEST), math.log(LARGEST), 3)).tolist()
    return {
        "sphere": (a,),
        "box": (2.0 * a, 2.0 * b, 2.0 * c),
        "cylinder": (a, 2.0 * b),
        "capsule": (a, 2.0 * b),
        "ellipsoid": (a, b, c),
        "plane": (),
        "mesh": _hull((a, b, c), draw),
    }[kind]


def _hull(half: Sequence[float], draw: np.random.Generator) -> tuple[float, ...]:
    """The convex hull of points on an ellipsoid."""
    points = draw.normal(size=(POINTS, 3))
    points *= np.array(half) / np.linalg.norm(points, axis=1, keepdims=True)
    _, vertices = centred(points[corners(points)])
    return mesh_size(vertices)


def _world(kinds: tuple[str, str], detector: str, sizes: Sequence[tuple[float, ...]]) -> World:
    """Two shapes; a plane is fixed at the origin."""
    bodies = []
    for number, (kind, size) in enumerate(zip(kinds, sizes, strict=True)):
        name = f"b{number}"
        shape = Shape(f"{name}/{kind}", kind, size, Pose(), "m")
        if kind == "plane":
            bodies.append(Body(name, name, Inertial(0.0), Joint(name, "fixed"), (shape,)))
            continue
        joint = Joint(name, "free", position=(float(number), 0.0, 5.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)
        inertial = Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0))
        bodies.append(Body(name, name, inertial, joint, (shape,)))
    contact = Contact(materials=(Material("m", 0.0),), pairs=(PairContact("m", "m", 0.0, 0.0),))
    accept = tuple(sorted(feature.value for feature in Feature))
    options = EngineOptions("dart", (("collision_detector", detector),), accept)
    return World("detectors", tuple(bodies), contact, Physics((0.0, 0.0, -9.81), 0.001, 1), engines=(options,))


def _turn(draw: np.random.Generator) -> tuple[float, ...]:
    """Evenly distributed."""
    return frames.normalise(tuple(draw.normal(size=4).tolist()))


def poses(
    solid: CollisionSolid, other: CollisionSolid, count: int, draw: np.random.Generator
) -> Iterator[tuple[float, list[Pose]]]:
    """(signed distance, poses of both), for each distance as many."""
    least = min(solid.inner, other.inner)
    wanted = [-depth for depth in OVERLAPS if depth <= ALLOWED * least] + list(GAPS)
    far = 2.0 * (min(solid.outer, 10.0) + min(other.outer, 10.0))
    for number in range(count):
        distance = wanted[number % len(wanted)]
        fixed = "plane" in (solid.shape.kind, other.shape.kind)
        turns = [(1.0, 0.0, 0.0, 0.0) if each.shape.kind == "plane" else _turn(draw) for each in (solid, other)]
        way = np.array([0.0, 0.0, 1.0]) if fixed else np.array(frames.rotate(_turn(draw), (1.0, 0.0, 0.0)))
        sign = -1.0 if other.shape.kind == "plane" else 1.0
        # anywhere: at the origin itself DART's ode misses contacts that it finds elsewhere
        where = draw.uniform(-PLACES, PLACES, 3) * (1.0, 1.0, 0.0 if fixed else 1.0)

        def placed(
            along: float,
            turns: list = turns,
            way: np.ndarray = way,
            sign: float = sign,
            where: np.ndarray = where,
            fixed: bool = fixed,
        ) -> list[Pose]:
            # a plane stays; the other shape moves
            moves = [where, where + along * way] if sign > 0.0 else [where + along * way, where]
            if fixed:
                moves[1 if sign < 0.0 else 0] = np.zeros(3)
            return [Pose(tuple(move.tolist()), turn) for move, turn in zip(moves, turns, strict=True)]

        low, high = 0.0, far
        for _ in range(60):
            middle = 0.5 * (low + high)
            at = placed(middle)
            found = gap(solid, transform(at[0]), other, transform(at[1])).distance
            low, high = (middle, high) if found < distance else (low, middle)
        at = placed(high)
        found = gap(solid, transform(at[0]), other, transform(at[1])).distance
        if abs(found - distance) <= EXACT:
            yield distance, at


def measure(
    kinds: tuple[str, str], detectors: Sequence[str], draws: int, count: int
) -> dict[str, dict[float, list[int]]]:
    """By detector and signed distance: how many poses, and in how many of them the detector said otherwise."""
    found: dict[str, dict[float, list[int]]] = {name: {} for name in detectors}
    draw = np.random.default_rng(sum(map(ord, "".join(kinds))))
    for _ in range(draws):
        sizes = [_size(kind, draw) for kind in kinds]
        first, second = solids(_world(kinds, "dart", sizes))
        placed = list(poses(first, second, count, draw))
        for detector in detectors:
            world = _world(kinds, detector, sizes)
            with tempfile.TemporaryDirectory(prefix="simspec-detectors-") as name:
                place = Path(name) / "dart"
                write_folder(compile_world(world, ["dart"])["dart"].files, place)
                session = Session(Dart, place)
                q, v = session.get_state()
                for distance, both in placed:
                    moving = [pose for pose, kind in zip(both, kinds, strict=True) if kind != "plane"]
                    state = [value for pose in moving for value in (*pose.position, *pose.quaternion)]
                    session.set_state(np.array(state).reshape(q.shape), v)
                    touching = len(session.detect_units()) > 0
                    counts = found[detector].setdefault(distance, [0, 0])
                    counts[0] += 1
                    counts[1] += touching != (distance < 0.0)
                session.close()
    return found


INTRODUCTION = """\
# DART's collision detectors, measured

> With this page you can choose a collision detector of DART for a pair of shapes.

Answers of DART's collision detectors for two shapes that overlap or do not. Generated by `python tools/detectors.py`; do
not edit. Measured with dart {version}: {draws} draws of sizes (half-sizes and radii of {low:g} to {high:g} m) for each pair of
kinds, {count} random poses of each, in which coal's signed distance is −0.1, −1, −10, +0.1 and +1 mm in turn ({total:,} poses
in all, of which those that coal does not reach to 1 µm are left out; of small shapes no overlap is deeper than half the inner
radius).

A cell shows the share of overlaps that are missed, of 0.1 / 1 / 10 mm; after a semicolon, where there are any, the share of
gaps of 0.1 / 1 mm that are taken for a touch. **Bold**: more than 1 % missed at 1 mm or deeper. *Refused*: simspec refuses the
pair with this detector unless the shape is accepted by name. The refusals have more
reasons than this page measures, which is only whether two shapes touch: a flat face that gets one contact sinks,
and depths and normals can be wrong (the measured reasons are in
`simspec/dialects/dart/contact.py`). `simspec compile --explain` lists the overlooked overlaps of pairs that are not
refused.
"""


def cell(counts: dict[float, list[int]], refused: bool) -> str:
    def share(distance: float) -> float | None:
        requested, wrong = counts.get(distance, (0, 0))
        return 100.0 * wrong / requested if requested else None

    def shown(value: float | None) -> str:
        return "–" if value is None else "0" if not value else f"{value:.1f}" if value < 10.0 else f"{value:.0f}"

    missed, extra = [share(-depth) for depth in OVERLAPS], [share(depth) for depth in GAPS]
    text = " / ".join(map(shown, missed)) + " %"
    if any(value for value in missed[1:] if value is not None and value > 1.0):
        text = f"**{text}**"
    if any(extra):
        text += "; " + " / ".join(map(shown, extra)) + " %"
    return text + (" *refused*" if refused else "")


def main(arguments: Sequence[str] | None = None) -> int:
    """See the module's docstring."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=12, help="of sizes")
    parser.add_argument("--poses", type=int, default=250, help="for each draw of sizes")
    parser.add_argument("--kind", help="measure the pairs with this kind of shape alone; the other rows stay")
    given = parser.parse_args(arguments)
    lines = ["| shapes | " + " | ".join(DETECTORS) + " |", "|---" * (1 + len(DETECTORS)) + "|"]
    rows = {
        line.split("|")[1].strip(): line for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:1] == "|"
    }
    for kinds in PAIRS:
        if given.kind is not None and given.kind not in kinds:
            lines.append(rows[", ".join(kinds)])
            continue
        found = measure(kinds, DETECTORS, given.draws, given.poses)
        cells = [cell(found[name], kinds in UNSOUND[name]) for name in DETECTORS]
        lines.append(f"| {kinds[0]}, {kinds[1]} | " + " | ".join(cells) + " |")
        print(lines[-1], flush=True)
    total = len(PAIRS) * given.draws * given.poses
    values = {"version": Dart.version(), "low": SMALLEST, "high": LARGEST, "total": total}
    head = INTRODUCTION.format(draws=given.draws, count=given.poses, **values)
    PAGE.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
