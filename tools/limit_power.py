#!/usr/bin/env python3
"""The power of a proof in the limit: small defects of the model, planted into the files of an engine, and the levels that
find them.

    python tools/limit_power.py [ENGINE ...] [--write]

Each engine is loaded with files of a chain of three hinges that has one defect, and compared with the chain as it should be, by
levels L3 (mass matrix, or accelerations of one step) and L6 (motion in the limit, or step by step). Defects are those of single
precision, for engines in double precision a tenth. --write writes the table into docs/records/limit-proof.md.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simspec.compiler import compile_world, missing_options, write_folder  # noqa: E402
from simspec.engines.kit.capabilities import SINGLE  # noqa: E402
from simspec.engines.kit.process import call  # noqa: E402
from simspec.engines.kit.registry import engines, find_engine  # noqa: E402
from simspec.files import scratch_folder  # noqa: E402
from simspec.proof.verify import engine_checks, prepare  # noqa: E402
from simspec.testing import worlds  # noqa: E402
from simspec.world.types import Body, EngineOptions, World  # noqa: E402

PAGE = ROOT / "docs" / "records" / "limit-proof.md"
LEVELS = ("L3", "L6")
SETTINGS = {
    "drake": (("integrator", "runge_kutta3"),),
    "mujoco": (("integrator", "implicit"),),
    "ode": (("native_motion", True),),
    "rapier": (("native_motion", True),),
}
"""Settings that select another method of integration than semi-implicit Euler."""


def chain(free: bool) -> World:
    """Three hinges with skew axes and armature, on a fixed base, or two on a free root."""
    kinds = ["free", "hinge", "hinge"] if free else ["fixed", "hinge", "hinge", "hinge"]
    bodies = worlds.tree(kinds, 4)
    armed = (
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, armature=0.01))
        if body.joint.kind == "hinge"
        else body
        for body in bodies
    )
    return worlds.world(tuple(armed), "chain")


def defects(world: World, share: float) -> Iterator[tuple[str, World]]:
    """Worlds with one defect each, of the last body."""
    last = world.bodies[-1]

    def changed(name: str, body: Body) -> tuple[str, World]:
        return name, dataclasses.replace(world, bodies=(*world.bodies[:-1], body))

    xx, yy, zz, xy, xz, yz = last.inertial.inertia
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    for number in range(3):
        tensor = axes @ np.diag(moments * (1.0 + 1e-3 * share * (np.arange(3) == number))) @ axes.T
        numbers = tuple(tensor[at] for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        inertial = dataclasses.replace(last.inertial, inertia=tuple(float(value) for value in numbers))
        yield changed(f"principal moment {number + 1}, {0.1 * share:g} %", dataclasses.replace(last, inertial=inertial))
    axis = np.array(last.joint.axis)
    across = np.cross(axis, np.roll(axis, 1) + np.array([0.1, -0.2, 0.3]))
    turned = axis + 1e-3 * share * across / np.linalg.norm(across)
    turned = turned / np.linalg.norm(turned)
    for name, values in (
        (f"axis, {1e-3 * share:g} rad", {"axis": tuple(turned.tolist())}),
        (f"damping, {1e-3 * share:g} N m s/rad", {"damping": last.joint.damping + 1e-3 * share}),
        (f"armature, {share:g} %", {"armature": last.joint.armature * (1.0 + 1e-2 * share)}),
    ):
        yield changed(name, dataclasses.replace(last, joint=dataclasses.replace(last.joint, **values)))


def accepted(world: World, engine: str) -> World:
    """The world with all that the engine needs accepted, by its other method of integration where it has one."""
    options = EngineOptions(engine, SETTINGS.get(engine, ()))
    needed = missing_options(dataclasses.replace(world, engines=(options,)), engine, {})
    accept, outside = (tuple(sorted(needed.get(key, ()))) for key in ("accept", "outside"))
    return dataclasses.replace(world, engines=(dataclasses.replace(options, accept=accept, outside=outside),))


def found(world: World, other: World, engine: str) -> list[tuple[str, float]]:
    """The checks that fail where an engine holds ``other`` in place of ``world``, with the deviation over the tolerance."""
    kind = find_engine(engine)
    probes = prepare(world, LEVELS, kind.PRECISION)
    with scratch_folder("power") as folder:
        write_folder(compile_world(other, [engine])[engine].files, folder / "files")
        reply = call(engine, folder / "files", probes.operations(kind))
    checks, _ = engine_checks(world, kind, reply.answers, probes)
    return [
        (f"{check.level} {check.name}", (check.worst or np.inf) / check.tolerance if check.tolerance else np.inf)
        for check in checks
        if check.level in LEVELS and not check.passed
    ]


def rows(names: Sequence[str], say: Callable[[str], None]) -> Iterator[tuple[str, ...]]:
    """A row for each engine and defect."""
    for engine in names:
        share = 1.0 if find_engine(engine).PRECISION == SINGLE else 0.1
        for free in (False, True):
            world = accepted(chain(free), engine)
            method = find_engine(engine).method(world)
            by = "step by step" if method is None else "in the limit"
            if wrong := found(world, world, engine):
                raise SystemExit(f"{engine}: the sound world fails: {wrong}")
            for name, other in defects(world, share):
                say(f"{engine}: {name}")
                failed = found(world, other, engine)
                levels = ", ".join(f"{check} ({times:.0f} times)" for check, times in failed) or "**not found**"
                yield engine, "free root" if free else "fixed root", by, name, levels


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("engines", nargs="*", help="default: all that are installed")
    parser.add_argument("--write", action="store_true", help=f"write the table into {PAGE.relative_to(ROOT)}")
    arguments = parser.parse_args()
    names = arguments.engines or [name for name, kind in engines().items() if kind.version() is not None]
    lines = ["| engine | root | L6 | defect | found by (deviation over tolerance) |", "|---|---|---|---|---|"]
    for row in rows(names, lambda text: print(text, file=sys.stderr)):
        lines.append(f"| {' | '.join(row)} |")
    text = "\n".join(lines)
    if arguments.write:
        begin, end = "<!-- planted defects: generated by tools/limit_power.py -->", "<!-- end of planted defects -->"
        before, rest = PAGE.read_text().split(begin)
        PAGE.write_text(f"{before}{begin}\n{text}\n{end}{rest.split(end)[1]}")
    else:
        print(text)


if __name__ == "__main__":
    main()
