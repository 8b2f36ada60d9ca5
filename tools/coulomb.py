"""What MuJoCo's setting ``friction: coulomb`` costs beside its own friction, and how often its loop ends unconverged.

    python tools/coulomb.py [SCENE ...] [--rounds 3]

Both modes are stepped in turn, 20 steps at a time, in one process, so that what disturbs the machine disturbs both; what counts
is the processor time of the process, and of several rounds, which are the same arithmetic, the quickest of each stretch. The
section "What friction: coulomb costs" of docs/contact.md is made of it: ``python tools/contact.py --only price``.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from contact_runs import RUNS, probe_world, tower

import simspec
from simspec.compiler import compile_world, write_folder
from simspec.dialects.mujoco.names import COULOMB, NATIVE
from simspec.engines.kit.session import Session
from simspec.engines.mujoco.engine import MuJoCo
from simspec.proof.contact.probe import Law
from simspec.world.types import Body, Contact, EngineOptions, Inertial, Joint, Material, PairContact, Pose, Shape, World

TIMESTEP = 0.001
STRETCH = 20
"""Steps in turn."""
MODES = {NATIVE: "mujoco", COULOMB: "mujoco, coulomb"}
SPHERES = Path(__file__).resolve().parent.parent / "specs" / "spheres-216.yaml"


def _box(speed: float, run: str) -> World:
    """A box of 1 kg on the floor, at rest or sliding."""
    ground = Shape("ground/solid", "box", (20.0, 20.0, 2.0), Pose((0.0, 0.0, -1.0)), "base")
    solid = Shape("box/solid", "box", (0.2, 0.2, 0.04), Pose(), "body")
    x, y, z = (edge * edge / 12.0 for edge in solid.size)
    inertial = Inertial(1.0, inertia=(y + z, x + z, x + y, 0.0, 0.0, 0.0))
    joint = Joint(
        "box", "free", position=(0.0, 0.0, 0.02, 1.0, 0.0, 0.0, 0.0), velocity=(speed, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    bodies = (
        Body("ground", "ground", Inertial(0.0), Joint("ground", "fixed"), (ground,)),
        Body("box", "box", inertial, joint, (solid,)),
    )
    law = Law(PairContact("base", "body", 0.5, 0.0), "elliptic", TIMESTEP)
    return probe_world(law, bodies, 1000, run)


def _spheres(friction: float, run: str) -> World:
    """The library's 216 spheres, with a friction."""
    world = simspec.load(SPHERES).resolve()
    engine, settings = RUNS[run]
    contact = Contact(
        world.contact.friction_cone,
        (Material("slick", friction),),
        (PairContact("slick", "slick", friction, 0.0),),
        excluded_bodies=world.contact.excluded_bodies,
    )
    options = (EngineOptions(engine, settings, ("contact.friction.impact",)),)
    return dataclasses.replace(world, contact=contact, engines=options, expectations=())


SCENES: Mapping[str, tuple[Callable[[str], World], int]] = {
    "one box at rest": (lambda run: _box(0.0, run), 1000),
    "one box that slides": (lambda run: _box(8.0, run), 1000),
    "tower of ten boxes": (lambda run: tower("ten boxes", TIMESTEP, "elliptic", run), 2000),
    "tower of seven cylinders": (lambda run: tower("seven cylinders", TIMESTEP, "elliptic", run), 2000),
    "216 spheres, no friction": (lambda run: _spheres(0.0, run), 1500),
    "216 spheres, μ 0.3": (lambda run: _spheres(0.3, run), 1500),
    "216 spheres, μ 0.5": (lambda run: _spheres(0.5, run), 1500),
    "216 spheres, μ 1": (lambda run: _spheres(1.0, run), 1500),
}
"""By name, the world for a run and how many steps of it, at 1 ms."""


@dataclasses.dataclass(frozen=True)
class Price:
    """µs a step in both modes; of coulomb's steps with friction in contact, how many ended unconverged, and by how much at most
    (m/s, of a contact's normal speed)."""

    scene: str
    native: float
    coulomb: float
    stepped: int
    unsettled: int
    worst: float


def price(scene: str, rounds: int) -> Price:
    make, steps = SCENES[scene]
    spent: dict[str, list[np.ndarray]] = {mode: [] for mode in MODES}
    with tempfile.TemporaryDirectory(prefix="simspec-coulomb-") as folder:
        places = {}
        for mode, run in MODES.items():
            places[mode] = Path(folder) / mode
            write_folder(compile_world(make(run), ["mujoco"])["mujoco"].files, places[mode])
        for _ in range(rounds):
            sessions = {mode: Session(MuJoCo, places[mode]) for mode in MODES}
            live = {mode: session.lend() for mode, session in sessions.items()}
            for mode in live:
                spent[mode].append(np.zeros(steps // STRETCH))
            for stretch in range(steps // STRETCH):
                for mode, engine in live.items():
                    started = time.process_time()
                    engine.step(STRETCH)
                    spent[mode][-1][stretch] = time.process_time() - started
            law, none = (live[mode]._coulomb for mode in (COULOMB, NATIVE))
            assert law is not None
            assert none is None
            counts = (law.stepped, law.unsettled, law.worst)
            for session in sessions.values():
                session.close()
    quickest = {mode: 1e6 * float(np.min(found, axis=0).sum()) / steps for mode, found in spent.items()}
    return Price(scene, quickest[NATIVE], quickest[COULOMB], *counts)


def main(arguments: Sequence[str] | None = None) -> int:
    """See the module's docstring."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=list(SCENES), metavar="SCENE")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args(arguments)
    print(f"{'':26} {'native':>9} {'coulomb':>9} {'ratio':>6} {'unconverged':>16} {'off by at most':>15}")
    for scene in given.scenes:
        one = price(scene, given.rounds)
        counts = f"{one.unsettled} of {one.stepped}"
        print(f"{scene:26} {one.native:6.0f} µs {one.coulomb:6.0f} µs {one.coulomb / one.native:6.2f}", end=" ")
        print(f"{counts:>16} {one.worst:10.2g} m/s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
