#!/usr/bin/env python3
"""MuJoCo Warp, MJX and Newton with many worlds on a graphics processor: motion compared with the exact one, and speed.

    python tools/gpu.py [--engine NAME ...] [--device auto|cpu|cuda] [--worlds 1,64,8192] [--place DIR] [--minutes 10] [--write]

Needs Python 3.11 with simspec and its extra `proof`; a package index, and a graphics processor with its driver. Each engine is
installed into an environment of its own below --place (default: simspec-gpu in the user's cache), which is reused. All work
ends after --minutes; figures that the time did not allow are named as such. --write writes docs/records/gpu.md and gpu.json.

Two worlds of specs/ are compiled by simspec, and copied. `double-pendulum`: copies begin at 16 different velocities, and every
copy is compared with simspec's oracle after 0.5 s. `box-on-ramp`: contact; the way of the slick box after 0.5 s is compared
with its closed form, and the rough box must stay. Times are of steps recorded by Warp, or compiled by XLA, without copies.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

RECORD = ROOT / "docs" / "records" / "gpu"
PACKAGES = {
    "mjwarp": ("mujoco-warp>=4,<5",),
    "mjx": ("mujoco-mjx>=3.17,<3.18", "mujoco>=3.17,<3.18", "jax"),
    "newton": ("newton>=1.8,<1.9",),
}
ON_CARD = {"mjx": ("jax[cuda12]",)}
"""Packages of an engine in addition, for a graphics processor."""
WORLDS = (1, 8, 64, 512, 2048, 8192)
SCENES = ("double-pendulum", "box-on-ramp")
STARTS = 16
STEPS = 500
CHUNK = 50
"""Steps of one call of a compiled program."""
MOTION = 2e-5
"""rad, rad/s: three times the deviation of MuJoCo Warp on a processor (6.5e-6), since a card rounds differently."""
SLIDE, WAY = 0.296, 5e-3
"""m: the way of the slick box, and the tolerance of both boxes; the common law starts one step late (1 mm)."""
LEAST_TIME = 0.3
"""s of steps that a speed is measured over."""
ROOM = 64
"""Contacts of a world of boxes."""
UNMEASURED = "not measured: the time was over"


class Copies(NamedTuple):
    """Copies of a world on a device. ``start(q, v)`` sets (n, nq), (n, nv); ``steps(count)`` makes a multiple of ``CHUNK``
    steps and waits for their end; ``state()`` returns (q, v)."""

    start: Callable[[np.ndarray, np.ndarray], None]
    steps: Callable[[int], None]
    state: Callable[[], tuple[np.ndarray, np.ndarray]]
    device: str


# --- engines: run in their environments, with numpy and the engine alone -------------------------------------------------


def mjwarp(folder: Path, count: int, device: str) -> Copies:
    import mujoco
    import mujoco_warp
    import warp

    from simspec.engines.mjwarp.programs import WarpModules, taken_over

    warp.config.log_level = warp.LOG_WARNING
    model = mujoco.MjModel.from_xml_path(str(folder / "mujoco" / "model.xml"))
    lacked = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    taken = taken_over(WarpModules(mujoco, warp, mujoco_warp), warp.get_device(device), model, lacked)
    with warp.ScopedDevice(device):
        room = ROOM if model.ngeom else 1
        data = mujoco_warp.make_data(model, nworld=count, nconmax=room, njmax=4 * room + 16)
        mujoco_warp.step(taken, data)
        with warp.ScopedCapture() as capture:
            mujoco_warp.step(taken, data)

    def start(q: np.ndarray, v: np.ndarray) -> None:
        with warp.ScopedDevice(device):
            mujoco_warp.reset_data(taken, data)
        data.qpos.assign(q.astype(np.float32))
        data.qvel.assign(v.astype(np.float32))

    def steps(number: int) -> None:
        with warp.ScopedDevice(device):
            for _ in range(number):
                warp.capture_launch(capture.graph)
            warp.synchronize_device()

    return Copies(start, steps, lambda: (data.qpos.numpy(), data.qvel.numpy()), str(warp.get_device(device).name))


def mjx(folder: Path, count: int, device: str) -> Copies:
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    os.environ["JAX_PLATFORMS"] = "cpu" if device == "cpu" else "cuda"
    import jax
    import mujoco
    from mujoco import mjx as solver

    model = mujoco.MjModel.from_xml_path(str(folder / "mujoco" / "model.xml"))
    taken, single = solver.put_model(model), solver.make_data(model)
    chunk = jax.jit(jax.vmap(lambda data: jax.lax.fori_loop(0, CHUNK, lambda _, d: solver.step(taken, d), data)))
    now: list[Any] = []

    def start(q: np.ndarray, v: np.ndarray) -> None:
        place = jax.vmap(lambda position, velocity: single.replace(qpos=position, qvel=velocity))
        now[:] = [place(q.astype(np.float32), v.astype(np.float32))]

    def steps(number: int) -> None:
        for _ in range(number // CHUNK):
            now[:] = [chunk(now[0])]
        now[0].qpos.block_until_ready()

    found = jax.devices()[0]
    return Copies(start, steps, lambda: (np.asarray(now[0].qpos), np.asarray(now[0].qvel)), str(found.device_kind))


def newton(folder: Path, count: int, device: str) -> Copies:
    import newton as library
    import warp

    from simspec.dialects.newton import NewtonSidecar
    from simspec.engines.kit.building import Walk
    from simspec.engines.newton.building import ERROR_REDUCTION, FAR, MIXING, NewtonBuild, NewtonModules
    from simspec.formats.world import WorldJson

    warp.config.log_level = warp.LOG_WARNING
    files = folder / "newton"
    sidecar = NewtonSidecar.of(json.loads((files / "sidecar.json").read_text(encoding="utf-8")))
    built = NewtonBuild(NewtonModules(library, warp), Walk.of(WorldJson().read(files)), sidecar)
    scene = library.ModelBuilder(gravity=warp.vec3(*built.gravity))
    library.solvers.SolverSteel.register_custom_attributes(scene)
    scene.replicate(built.builder, count)
    model = scene.finalize(device=device, skip_validation_inertia=True)
    model.steel.rigid_body_angular_damping.zero_()
    touching = bool(len(built.pairs))
    if touching:
        model.rigid_contact_max = ROOM * count
    solver = library.solvers.SolverSteel(
        model,
        iterations=int(sidecar.settings["iterations"]),
        baumgarte=ERROR_REDUCTION,
        cfm=MIXING,
        friction_anchor_beta=0.0,
        enable_joint_limits=True,
        joint_limit_activation_gap=FAR,
        articulation_constraint_max=ROOM,
        free_body_constraint_max=3 * ROOM * count if touching else 1,
        warn_constraint_overflow=True,
    )
    pipeline = None
    if touching:
        pairs = built.pairs.numpy()[None] + scene.shape_count // count * np.arange(count)[:, None, None]
        pipeline = library.CollisionPipeline(
            model,
            broad_phase="explicit",
            shape_pairs_filtered=warp.array(pairs.reshape(-1, 2).astype(np.int32), dtype=warp.vec2i, device=device),
            rigid_contact_max=ROOM * count,
            reduce_contacts=False,
            deterministic=True,
            verify_buffers=False,
        )
    contacts = pipeline.contacts() if pipeline is not None else None
    state, after, control = model.state(), model.state(), model.control()

    def step() -> None:
        library.eval_fk(model, state.joint_q, state.joint_qd, state)
        if pipeline is not None:
            pipeline.collide(state, contacts)
        solver.step(state, after, control, contacts, built.timestep)
        warp.copy(state.joint_q, after.joint_q)
        warp.copy(state.joint_qd, after.joint_qd)

    with warp.ScopedDevice(device):
        step()
        with warp.ScopedCapture() as capture:
            step()

    def start(q: np.ndarray, v: np.ndarray) -> None:
        """Of hinges, or of free bodies at rest, whose frames are at their centres of mass."""
        if touching:  # Newton's quaternions are x y z w
            q = q.reshape(-1, 7)[:, [0, 1, 2, 4, 5, 6, 3]]
        solver.reset(state)
        state.joint_q.assign(q.ravel().astype(np.float32))
        state.joint_qd.assign(v.ravel().astype(np.float32))

    def steps(number: int) -> None:
        with warp.ScopedDevice(device):
            for _ in range(number):
                warp.capture_launch(capture.graph)
            warp.synchronize_device()

    def now() -> tuple[np.ndarray, np.ndarray]:
        return state.joint_q.numpy().reshape(count, -1), state.joint_qd.numpy().reshape(count, -1)

    return Copies(start, steps, now, str(warp.get_device(device).name))


ENGINES: dict[str, Callable[[Path, int, str], Copies]] = {"mjwarp": mjwarp, "mjx": mjx, "newton": newton}


def measure(engine: str, folder: Path, scene: str, count: int, device: str) -> dict[str, Any]:
    """The proof and the speed of ``count`` copies, as plain data."""
    data = np.load(folder / scene / "motion.npz")
    begun = time.perf_counter()
    copies = ENGINES[engine](folder / scene, count, device)
    rows = np.arange(count) % len(data["q"])
    copies.start(data["q"][rows], data["v"][rows])
    copies.steps(CHUNK)
    prepared = time.perf_counter() - begun
    copies.start(data["q"][rows], data["v"][rows])
    copies.steps(STEPS)
    q, v = copies.state()
    if scene == "double-pendulum":
        found = np.abs(np.concatenate([q - data["end_q"][rows], v - data["end_v"][rows]], axis=1)).max()
        tolerance, what = MOTION, "deviation from the oracle after 500 steps, rad and rad/s"
    else:
        # free bodies in the order of the file, seven numbers each; the rough box comes first
        places = q.reshape(count, -1, 7)[:, :, :3]
        way = np.linalg.norm(places - data["q"][rows].reshape(count, -1, 7)[:, :, :3], axis=2)
        found, tolerance = np.abs(way - np.array([0.0, SLIDE])).max(), WAY
        what = "deviation of the ways of both boxes from the closed form after 500 steps, m"
    done, spent = 0, 0.0
    while spent < LEAST_TIME:
        begun = time.perf_counter()
        copies.steps(CHUNK)
        done, spent = done + CHUNK, spent + time.perf_counter() - begun
    return {
        "device": copies.device,
        "what": what,
        "deviation": float(found),
        "valid": bool(np.isfinite(found) and found <= tolerance),
        "tolerance": tolerance,
        "prepared_s": prepared,
        "step_us": 1e6 * spent / done,
        "world_steps_per_s": count * done / spent,
    }


# --- the whole -----------------------------------------------------------------------------------------------------------


def prepare(folder: Path) -> None:
    """Files of both worlds for the engines, and the exact motions."""
    import simspec
    from simspec.compiler import compile_world, write_folder
    from simspec.dynamics.oracle import Oracle
    from simspec.testing.worlds import accepting
    from simspec.world.kinematics import initial_state

    if folder.exists():
        shutil.rmtree(folder)
    for scene in SCENES:
        world = simspec.load(ROOT / "specs" / f"{scene}.yaml").resolve()
        for engine in ("mujoco", "newton"):
            files = compile_world(accepting(world, engine), [engine])[engine].files
            write_folder(files, folder / scene / engine)
        q, v = initial_state(world)
        starts = np.arange(STARTS if scene == "double-pendulum" else 1)
        positions = np.repeat(q[None], len(starts), axis=0)
        speeds = np.array([v + 0.1 * number for number in starts])
        ends: dict[str, Any] = {}
        if scene == "double-pendulum":
            oracle = Oracle(world)
            motions = [oracle.motion(*start, None, STEPS, STEPS) for start in zip(positions, speeds, strict=True)]
            ends = {"end_q": np.array([m[0][-1] for m in motions]), "end_v": np.array([m[1][-1] for m in motions])}
        np.savez(folder / scene / "motion.npz", q=positions, v=speeds, **ends)


def card() -> str:
    """The graphics processor and its driver; "" without any."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return ""
    query = [program, "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
    done = subprocess.run(query, capture_output=True, text=True, check=False)
    return "; ".join(done.stdout.split("\n")).strip("; ") if done.returncode == 0 else ""


def install(engine: str, place: Path, on_card: bool, seconds: float) -> tuple[Path, str]:
    """The interpreter of an engine's environment, and its packages; made at first. Raises OSError, subprocess errors."""
    folder = place / engine
    python, mark = folder / "bin" / "python", folder / ("complete-card" if on_card else "complete")
    if not mark.is_file():
        packages = [*PACKAGES[engine], *(ON_CARD.get(engine, ()) if on_card else ())]
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True, timeout=seconds)
        words = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "numpy", *packages]
        subprocess.run(words, check=True, timeout=seconds)
        mark.touch()
    words = [str(python), "-m", "pip", "list", "--format=freeze", "--disable-pip-version-check"]
    listed = subprocess.run(words, check=True, capture_output=True, text=True, timeout=seconds).stdout.split()
    names = ("mujoco", "jax", "newton", "warp-lang")
    return python, " ".join(line for line in listed if line.startswith(names))


def child(python: Path, words: Sequence[str], seconds: float) -> dict[str, Any]:
    """The figures of one measurement, or its problem."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    try:
        done = subprocess.run(
            [str(python), __file__, "--measure", *words],
            capture_output=True,
            text=True,
            timeout=seconds,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return {"problem": UNMEASURED}
    if done.returncode:
        return {"problem": (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1][:200]}
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def markdown(result: dict[str, Any]) -> str:
    """The record as a page."""
    lines = [
        "# Many worlds on a graphics processor",
        "",
        "> After this page you can judge how fast MuJoCo Warp, MJX and Newton step many copies of a world, and how exactly.",
        "",
        f"Written by `python tools/gpu.py --write` on {result['date']}: {result['machine']}.",
        f"Graphics processor: {result['card'] or 'none; these figures are of the processor, and those of a card wait'}.",
        "",
        "| engine | scene | worlds | deviation | valid | prepared s | step µs | world steps/s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        head = f"| {row['engine']} | `{row['scene']}` | {row['worlds']:,} |"
        if "problem" in row:
            lines.append(f"{head} {row['problem'].replace('|', '/')} | | | | |")
            continue
        valid = "yes" if row["valid"] else f"no (> {row['tolerance']:g})"
        lines.append(
            f"{head} {row['deviation']:.1e} | {valid} | {row['prepared_s']:.1f} | {row['step_us']:,.0f} "
            f"| {row['world_steps_per_s']:,.0f} |"
        )
    what = dict.fromkeys(f"`{row['scene']}`: {row['what']}" for row in result["rows"] if "what" in row)
    lines += ["", "Deviations: " + "; ".join(what), ""]
    lines += [f"- {engine}: {packages}" for engine, packages in result["packages"].items()]
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--engine", action="append", choices=sorted(ENGINES))
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    parser.add_argument("--worlds", default=",".join(map(str, WORLDS)))
    parser.add_argument("--place", type=Path, default=Path.home() / ".cache" / "simspec-gpu")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--write", action="store_true")
    parser.add_argument(
        "--measure", nargs=5, metavar=("ENGINE", "FOLDER", "SCENE", "WORLDS", "DEVICE"), help=argparse.SUPPRESS
    )
    options = parser.parse_args()
    if options.measure:
        engine, folder, scene, count, device = options.measure
        print(json.dumps(measure(engine, Path(folder), scene, int(count), device)))
        return 0
    ends = time.monotonic() + 60.0 * options.minutes
    found = card()
    device = ("cuda" if found else "cpu") if options.device == "auto" else options.device
    if device == "cuda" and not found:
        print("no graphics processor is found (nvidia-smi)", file=sys.stderr)
        return 3
    print(f"graphics processor: {found or 'none: on the processor'}", flush=True)
    files = options.place / "files"
    prepare(files)
    result: dict[str, Any] = {
        "date": time.strftime("%Y-%m-%d"),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        "card": found if device == "cuda" else "",
        "packages": {},
        "rows": [],
    }
    chosen = options.engine or list(ENGINES)
    whole = ends
    for number, engine in enumerate(chosen):
        ends = time.monotonic() + (whole - time.monotonic()) / (len(chosen) - number)  # a share of the time for each
        try:
            left = max(1.0, ends - time.monotonic())
            python, result["packages"][engine] = install(engine, options.place, device == "cuda", left)
        except (OSError, subprocess.SubprocessError) as error:
            print(f"{engine}: not installed: {error}", flush=True)
            result["rows"].append({"engine": engine, "scene": "-", "worlds": 0, "problem": "not installed"})
            continue
        for scene in SCENES:
            for count in map(int, options.worlds.split(",")):
                left = ends - time.monotonic()
                words = (engine, str(files), scene, str(count), device)
                row = child(python, words, left) if left > 1.0 else {"problem": UNMEASURED}
                row = {"engine": engine, "scene": scene, "worlds": count, **row}
                result["rows"].append(row)
                print(json.dumps(row), flush=True)
    page = markdown(result)
    print(page)
    if options.write:
        RECORD.with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        RECORD.with_suffix(".md").write_text(page, encoding="utf-8")
    wrong = [row for row in result["rows"] if not row.get("valid")]
    return 0 if not wrong else 1


if __name__ == "__main__":
    sys.exit(main())
