"""What compiling costs: chains and piles of 10 to 10,000 bodies, time and memory, against MuJoCo's own parsing.

Each row is measured in a process of its own, so that peak memory is that row's. ``resolve`` is spec to world (from Python
data, without YAML), ``emit`` world to files, ``parse`` the engine's own reading of the result. Linear means: the cost per
body does not grow. MuJoCo's XML reader refuses more than 500 nested elements, so long chains are written but not parsed.

    python benchmarks/compile.py
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time

SIZES = (10, 100, 1000, 10000)
PARSED = {"pile": 1000, "chain": 400}
"""Largest size that is parsed too: MuJoCo cannot load a longer chain, and a larger pile takes memory without end."""


def chain(count: int) -> dict:
    bodies = {}
    for index in range(count):
        joint = {"type": "hinge", "origin": {"xyz": [0.0, 0.0, 0.1]}, "axis": [0.0, 1.0, 0.0]}
        body = {"mass": 1.0, "inertia": {"principal": [0.01, 0.011, 0.012]}, "joint": joint}
        if index:
            body["parent"] = f"b{index - 1}"
        bodies[f"b{index}"] = body
    return {"simspec": 1, "name": "chain", "bodies": bodies}


def pile(count: int) -> dict:
    ball = {"mass": 1.0, "shapes": [{"sphere": {"radius": 0.1}}], "array": {"grid": [1, 1, count], "spacing": 0.3}}
    contact = {"materials": {"plain": {"friction": 0.5}}}
    return {"simspec": 1, "name": "pile", "contact": contact, "bodies": {"ball": ball}}


def one(kind: str, count: int, format_name: str) -> str:
    import simspec
    from simspec.compiler import target_of
    from simspec.dialects.kit.contract import dialects
    from simspec.engines.kit.registry import engines, format_of
    from simspec.errors import UnsupportedError

    spec = simspec.Spec.from_data({"chain": chain, "pile": pile}[kind](count))
    started = time.perf_counter()
    world = spec.resolve()
    resolved = time.perf_counter() - started
    engine = next(found for found in engines().values() if format_name == format_of(found))
    target = target_of(world, engine)
    emitter = dialects()[engine.DIALECT]
    small = simspec.Spec.from_data({"chain": chain, "pile": pile}[kind](2)).resolve()
    emitter.emit(small, target_of(small, engine))  # warm templates
    started = time.perf_counter()
    try:
        files = emitter.emit(world, target)
    except UnsupportedError as error:
        return f"{kind:6} {format_name:5} {count:6} refused: {error.problems[0].message[:80]}"
    emitted = time.perf_counter() - started
    size = sum(len(text) for text in files.values())
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    parse = ratio = "-"
    if format_name == "mjcf" and count <= PARSED[kind]:
        import mujoco

        started = time.perf_counter()
        mujoco.MjModel.from_xml_string(files["model.xml"])
        seconds = time.perf_counter() - started
        parse, ratio = f"{1e3 * seconds:.1f}", f"{emitted / seconds:.2f}"
    per_body = 1e6 * emitted / count
    return (
        f"{kind:6} {format_name:5} {count:6} {1e3 * resolved:11.1f} {1e3 * emitted:9.1f} {per_body:8.1f} "
        f"{size / 1e6:8.2f} {memory:8.0f} {parse:>9} {ratio:>6}"
    )


def main() -> int:
    if len(sys.argv) == 4:
        print(one(sys.argv[1], int(sys.argv[2]), sys.argv[3]))
        return 0
    print(
        f"{'':6} {'':5} {'bodies':>6} {'resolve ms':>11} {'emit ms':>9} {'µs/body':>8} {'file MB':>8} {'peak MB':>8} "
        f"{'parse ms':>9} {'ratio':>6}"
    )
    for kind in ("chain", "pile"):
        for format_name in ("mjcf", "skel", "urdf"):
            for count in SIZES:
                command = [sys.executable, __file__, kind, str(count), format_name]
                result = subprocess.run(command, check=True, capture_output=True, text=True)
                print(result.stdout.rstrip().splitlines()[-1], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
