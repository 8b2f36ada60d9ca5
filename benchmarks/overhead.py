"""What simspec's runner costs over a bare hand-written loop of the same engine on the same files.

In one process and one trajectory, chunks of ten steps are done in turn by the runner's stepping (as ``simspec run`` times it)
and by a bare loop written against the engine's own API; between chunks both record the same. A second pass swaps who does which
chunks, so that both do every one. Of each chunk the fastest of all passes counts, on both sides (the trajectory repeats to the
last bit, so only the rest of the machine makes a chunk slower); the ratio is that of the sums. Target: ≤ 1.02.

    python benchmarks/overhead.py [--rounds 4] [--steps 1000]
"""

from __future__ import annotations

import argparse
import functools
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from simspec.engines.kit.session import Session

SCENARIOS = ("spheres-216", "ur10e")
WITHOUT = {("ur10e", "physx"), ("ur10e", "rapier"), ("spheres-216", "mjx")}
"""What an engine does not support: joints that drift by more than single precision does, and so many contacts that there can
be."""
ROOT = Path(__file__).resolve().parent.parent
EVERY = 10
"""Steps of a chunk."""


def bare_mujoco(engine, steps, every):
    import mujoco

    step, model, data = mujoco.mj_step, engine.model, engine.data
    started = time.perf_counter()
    for _ in range(steps // every):
        step(model, data, every)
    return time.perf_counter() - started


def bare_pybullet(engine, steps, every):
    import pybullet

    step, client = pybullet.stepSimulation, engine.client
    started = time.perf_counter()
    for _ in range(steps):
        step(client)
    return time.perf_counter() - started


def bare_dart(engine, steps, every):
    step = engine.world.step
    started = time.perf_counter()
    for _ in range(steps):
        step()
    return time.perf_counter() - started


def bare_drake(engine, steps, every):
    plant, context = engine._simulation.plant, engine._simulation.context
    started = time.perf_counter()
    for _ in range(steps):
        context.SetDiscreteState(plant.EvalUniquePeriodicDiscreteUpdate(context).get_vector(0).value())
    return time.perf_counter() - started


def bare_ode(engine, steps, every):
    """The part in C alone: ODE's own loop, dSpaceCollide and dWorldStep with a callback, has to be in C."""
    step, sim = engine._simulation.library.sim_step, engine._simulation.sim
    started = time.perf_counter()
    for _ in range(steps // every):
        step(sim, every, None)
    return time.perf_counter() - started


def bare_gazebo(engine, steps, every):
    """The part in C++ alone, which steps gz-physics and redoes the rotations: gz-physics can be called from C++ only."""
    step, sim = engine._simulation.library.gz_step, engine._simulation.sim
    started = time.perf_counter()
    for _ in range(steps // every):
        step(sim, every, None)
    return time.perf_counter() - started


def bare_rapier(engine, steps, every):
    """Rapier's own step. What it leaves out, simspec's exact gyroscopic torques and the places of before the last step, is in
    the ratio."""
    step = engine._simulation.world.step
    started = time.perf_counter()
    for _ in range(steps):
        step()
    return time.perf_counter() - started


def bare_physx(engine, steps, every):
    """PhysX's own step. What it leaves out, the contacts that simspec bounds the undoing of overlaps by, is in the ratio."""
    simulation = engine._simulation
    system = simulation.built.system
    started = time.perf_counter()
    for _ in range(steps):
        system.step()
    seconds = time.perf_counter() - started
    # contacts of an earlier step are freed
    simulation._found = system.get_contacts()
    return seconds


@functools.cache
def _compiled_mjx():
    import jax
    from mujoco import mjx

    return jax.jit(mjx.step)


def bare_mjx(engine, steps, every):
    """One compiled step, called from Python; simspec compiles a loop of steps. Both have the same arrays at the end."""
    import jax

    step, model = _compiled_mjx(), jax.device_put(engine._taken)
    now = engine.data
    data = jax.device_put(engine._programs.blank.replace(qpos=now.qpos, qvel=now.qvel, qacc_warmstart=engine._warm))
    started = time.perf_counter()
    for _ in range(steps):
        data = step(model, data)
    jax.block_until_ready(data)
    seconds = time.perf_counter() - started
    now.qpos, now.qvel, engine._warm = (np.array(value) for value in (data.qpos, data.qvel, data.qacc_warmstart))
    return seconds


def bare_mjwarp(engine, steps, every):
    """One recorded step, launched from Python."""
    import warp

    motion, now = engine._motion, engine.data
    motion.run("step", engine._state(np.zeros(engine.model.nv)), 0)
    launch, graph = warp.capture_launch, motion._graphs["step"]
    started = time.perf_counter()
    with warp.ScopedDevice(engine._device):
        for _ in range(steps):
            launch(graph)
        warp.synchronize()
    seconds = time.perf_counter() - started
    now.qpos, now.qvel, engine._warm = (motion.take(name) for name in ("qpos", "qvel", "qacc_warmstart"))
    now.ncon = -1
    return seconds


BARE = {
    "mujoco": bare_mujoco,
    "mjx": bare_mjx,
    "mjwarp": bare_mjwarp,
    "pybullet": bare_pybullet,
    "dart": bare_dart,
    "drake": bare_drake,
    "ode": bare_ode,
    "gazebo": bare_gazebo,
    "rapier": bare_rapier,
    "physx": bare_physx,
}


def measure(name: str, folder: Path, steps: int, every: int, rounds: int) -> tuple[float, float]:
    """Seconds of (simspec's stepping, the bare loop): the fastest of ``rounds`` for each chunk, summed."""
    chunks = steps // every
    fastest = [[math.inf] * chunks, [math.inf] * chunks]
    for turn in range(2 * rounds):
        session = Session(name, folder)
        engine = session.lend()
        for chunk in range(chunks):
            bare = (chunk + turn) % 2
            if bare:
                seconds = BARE[name](engine, every, every)
            else:
                started = time.perf_counter()
                engine.step(every)
                seconds = time.perf_counter() - started
            fastest[bare][chunk] = min(fastest[bare][chunk], seconds)
            observe(engine)
        session.close()
    # some engines set things up in their first step, in some of a process' loads longer than in others
    return sum(fastest[0][1:]), sum(fastest[1][1:])


def observe(engine) -> None:
    """What the recorder asks of an engine at each recorded row."""
    engine.body_states()
    engine.get_state()
    engine.energy()
    engine.contacts()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--engine", action="append", help="an engine; repeatable (default: all that are here)")
    parser.add_argument("--one", nargs=2, metavar=("ENGINE", "FOLDER"), help="measure these files in this process")
    given = parser.parse_args()
    if given.one:
        name, folder = given.one
        ours, bare = measure(name, Path(folder), given.steps, EVERY, given.rounds)
        print(f"{1e6 * ours / given.steps:10.1f} {1e6 * bare / given.steps:10.1f} {ours / bare:7.3f}")
        return 0
    return every_engine(given)


def every_engine(given: argparse.Namespace) -> int:
    """Each pair in a process of its own, in the interpreter of the engine."""
    # these need more than the interpreters of some engines have
    import simspec
    from simspec.compiler import compile_world, write_folder
    from simspec.engines.kit.registry import engines, version_of
    from simspec.project import load_project
    from simspec.testing.worlds import accepting

    pythons = load_project().known_interpreters()
    print(f"{'scenario':14} {'engine':9} {'simspec µs':>10} {'bare µs':>10} {'ratio':>7}")
    for scenario in SCENARIOS:
        world = simspec.load(ROOT / "specs" / f"{scenario}.yaml").resolve()
        for name in given.engine or [
            name for name in engines() if name in BARE and version_of(name, pythons.get(name))
        ]:
            if (scenario, name) in WITHOUT:
                continue
            with tempfile.TemporaryDirectory() as folder:
                write_folder(compile_world(accepting(world, name), [name])[name].files, Path(folder) / name)
                command = [pythons.get(name, sys.executable), __file__, "--one", name, str(Path(folder) / name)]
                command += ["--rounds", str(given.rounds), "--steps", str(given.steps)]
                environment = os.environ | {"PYTHONPATH": str(ROOT)}
                found = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
            print(f"{scenario:14} {name:9} {found.stdout.strip().splitlines()[-1]}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
