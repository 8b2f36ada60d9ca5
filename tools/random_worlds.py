"""Random worlds: each compiled, proven and run in every engine; none may be invalid without a named cause.

    python tools/random_worlds.py --count 200                the seeds 0 to 199, three engines
    python tools/random_worlds.py --seeds 7 12               these
    python tools/random_worlds.py --contact-every 5          level L5 in every fifth (measured laws are kept)
    python tools/random_worlds.py --write out                each world's spec as YAML

Where an engine has something only approximately, or outside of itself, the spec is made to accept it by the name that the error
gives; an unsupported feature is a refusal, and is counted with its cause.
"""

from __future__ import annotations

import argparse
import collections
import re
import sys
import time
import traceback
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

import simspec
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.registry import engines
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, SpecError, UnsupportedError
from simspec.files import scratch_folder
from simspec.proof.verify import LEVELS, verify
from simspec.runner.execution import run_case
from simspec.runner.run import Case
from simspec.world.kinematics import initial_state
from simspec.world.overlap import deep_overlaps
from simspec.world.types import World
from tests.installed import INSTALLED, LEFT_OUT
from tests.random_specs import spec
from tests.random_words import with_words, write_files

ACCEPT = re.compile(r"engines\.(\w+)\.(accept|outside): \[([\w.-]+)\]")
"""How an error names what a spec may accept."""
BURIED = 0.5
"""m of overlap at the start that no world is meant to have: a hundredth of it in each step of 1 ms is 5 m/s, and what is hung
on joints far from where it is pushed is thrown at a hundred times that (740 m/s from 4.3 m, measured in MuJoCo)."""
ABSURD = 1e6
"""m/s and rad/s that no random world reaches unless its steps are too long for it."""


def accepted(data: dict[str, Any], engine: str, folder: Path) -> str:
    """Let the spec accept what the engine has only so; returns why it is refused all the same, or "". ``folder`` has the
    files that the spec names."""
    for _ in range(20):
        try:
            simspec.compile(simspec.Spec.from_data(data, folder=folder).resolve(), [engine])
        except UnsupportedError as error:
            found = [match for problem in error.problems for match in ACCEPT.findall(problem.hint or "")]
            options = data["engines"].setdefault(engine, {})
            new = [(kind, name) for who, kind, name in found if who == engine and name not in options.get(kind, ())]
            if not new:
                problem = error.problems[0]
                return f"{problem.message}{f' ({problem.found})' if problem.found else ''}"
            for kind, name in new:
                options.setdefault(kind, []).append(name)
        else:
            return ""
    return "accepts nothing in twenty rounds"


def diverges(world: World) -> str:
    """Why a run may end with a state that is not finite: shapes begin so deep in each other that the correction separates them
    at great speed, or the oracle's own motion, without contact, leaves all bounds; or ""."""
    if (deepest := next(iter(deep_overlaps(world)), None)) is not None and deepest.depth > BURIED:
        return f"{deepest.first} and {deepest.second} overlap by {deepest.depth:.3g} m at the start, taken back at once"
    q, v = initial_state(world)
    with np.errstate(all="ignore"):
        _, speeds = Oracle(world).motion(q, v, None, world.physics.steps, 1)
    fastest = np.abs(speeds).max(initial=0.0)
    if fastest < ABSURD:
        return ""
    step = int(np.argmax(~(np.abs(speeds).max(axis=1) < ABSURD)))
    return f"semi-implicit Euler itself leaves all bounds at this timestep (the oracle too, without contact, at step {step})"


def attempt(
    seed: int, names: list[str], levels: set[str], folder: Path | None, warm: WarmProcesses | None = None
) -> tuple[list[str], dict[str, str]]:
    """Failures of a seed, a line each, and the engines that refused it, with reasons. ``warm``: processes that engines are
    forked from."""
    data, files = with_words(seed, spec(seed))
    with scratch_folder("random") as scratch:
        place = folder / f"random-{seed}" if folder is not None else scratch
        write_files(place, files)
        refused = {name: why for name in names if (why := accepted(data, name, place))}
        left = [name for name in names if name not in refused]
        given = simspec.Spec.from_data(data, folder=place)
        if folder is not None:
            (place / f"random-{seed}.yaml").write_text(given.to_yaml(), encoding="utf-8")
        world = given.resolve()
    wrong = []
    found = verify(world, left, levels=levels, warm=warm)
    for engine, check in found.failures():
        wrong.append(
            f"{engine} {check.level} {check.name}: {check.where} {check.worst} of {check.tolerance}; {check.detail}"
        )
    for name in left:
        try:
            run = run_case(Case(world, name), warm=warm)
            if run.failed and not (cause := diverges(world)):
                wrong.append(f"{name} run: {run.failed}")
            elif run.failed:
                refused[f"{name} run"] = cause
        except EngineError as error:
            wrong.append(f"{name} run: {error}")
    return wrong, refused


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seeds", type=int, nargs="*")
    parser.add_argument("--engine", action="append", choices=sorted(engines()))
    parser.add_argument("--contact-every", type=int, default=10, metavar="N")
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    names = options.engine or INSTALLED
    for name, why in ({} if options.engine else LEFT_OUT).items():
        print(f"left out: {name}: {why}", flush=True)
    seeds = options.seeds or range(options.first, options.first + options.count)
    invalid, causes, began = [], collections.Counter(), time.monotonic()
    compared = collections.Counter()
    with WarmProcesses() as warm:
        for seed in seeds:
            levels = (
                set(LEVELS) if options.contact_every and seed % options.contact_every == 0 else set(LEVELS) - {"L5"}
            )
            try:
                wrong, refused = attempt(seed, names, levels, options.write, warm)
            except SpecError as error:
                wrong, refused = [f"spec: {problem.path}: {problem.message}" for problem in error.problems], {}
            except Exception as error:  # the tool searches for any exception
                wrong, refused = [f"crash: {''.join(traceback.format_exception(error))}"], {}
            causes.update(f"{engine}: {why}" for engine, why in refused.items())
            compared.update(name for name in names if name not in refused)
            if wrong:
                invalid.append(seed)
            said = "; ".join(f"{engine} refuses: {why}" for engine, why in refused.items())
            print(f"{seed}: {'INVALID' if wrong else 'ok'} {said}", *wrong, sep="\n    ", flush=True)
    print(
        f"\n{len(seeds)} worlds in {time.monotonic() - began:.0f} s; proven and run: {dict(compared)}; invalid: {invalid}"
    )
    for cause, count in causes.most_common():
        print(f"{count:4} refused, {cause}")
    return 1 if invalid else 0


if __name__ == "__main__":
    sys.exit(main())
