"""Count the modules that a command enters, in order: python tools/walk.py [--modules] COMMAND …

    python tools/walk.py run specs/double-pendulum.yaml --engine mujoco --no-verify
    python tools/walk.py --modules compile specs/double-pendulum.yaml --engine mujoco

A hop is a call from one module of simspec into another. It climbs back where the called module belongs to a package that comes
later in the order of imports (``ORDER`` of tests/test_house.py): such calls go through functions that were passed, or
modules that are imported when they are used. Only the main process is traced, after its imports. ``--modules`` lists
every module at its first entry, with its caller. ``WALK_ROOT``: the root of another checkout, with its interpreter.
"""

from __future__ import annotations

import collections
import os
import sys
from pathlib import Path
from types import FrameType

from simspec.cli import main

HERE = Path(os.environ.get("WALK_ROOT", Path(__file__).resolve().parent.parent))
PACKAGE = HERE / "simspec"
sys.path.insert(0, str(HERE))


def module_of(frame: FrameType | None) -> str | None:
    """The path inside ``simspec/`` of the nearest frame of simspec; None without one, and within an import."""
    while frame is not None:
        code = frame.f_code
        if code.co_filename.startswith(str(PACKAGE)):
            return None if code.co_name == "<module>" else code.co_filename[len(str(PACKAGE)) + 1 :]
        frame = frame.f_back
    return None


class Walk:
    """Calls between modules: ``hops`` in order of first occurrence, calls by module, and the number of calls."""

    def __init__(self) -> None:
        self.hops: dict[tuple[str, str], str] = {}
        self.calls = 0
        self.counts: collections.Counter[str] = collections.Counter()

    def __call__(self, frame: FrameType, event: str, _argument: object) -> None:
        if event != "call" or not frame.f_code.co_filename.startswith(str(PACKAGE)):
            return
        module = module_of(frame)
        if module is None:
            return
        self.counts[module] += 1
        caller = module_of(frame.f_back)
        if caller is None or caller == module:
            return
        self.calls += 1
        self.hops.setdefault((caller, module), frame.f_code.co_name)


def package(module: str, order: tuple[str, ...]) -> int:
    """The place of a module's package in the order of imports, from 0."""
    first = module.split("/")[0].removesuffix(".py")
    return order.index(first) if first in order else len(order)


def show(walk: Walk, order: tuple[str, ...], modules: bool) -> None:
    climbs = [hop for hop in walk.hops if package(hop[1], order) > package(hop[0], order)]
    if modules:
        seen: set[str] = set()
        for (caller, module), function in walk.hops.items():
            if module not in seen:
                seen.add(module)
                print(f"{caller} -> {module}: {function}")
    print(
        f"{len(walk.counts)} modules entered, {len(walk.hops)} hops between modules, {len(climbs)} of them climb back; "
        f"{walk.calls:,} calls between modules"
    )
    for caller, module in climbs if modules else ():
        print(f"climbs back: {caller} -> {module}: {walk.hops[caller, module]}")


if __name__ == "__main__":
    from tests.test_house import ORDER

    arguments = sys.argv[1:]
    listed = "--modules" in arguments
    walk = Walk()
    sys.setprofile(walk)
    try:
        main([argument for argument in arguments if argument != "--modules"])
    except SystemExit:
        pass
    finally:
        sys.setprofile(None)
    show(walk, ORDER, listed)
