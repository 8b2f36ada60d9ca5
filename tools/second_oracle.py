"""Hold the oracle against Simbody: the library, the worlds of the self-test, random trees, random scenarios; prints a table.

    python tools/second_oracle.py                        needs the extra second-oracle
    python tools/second_oracle.py --trees 300 --scenarios 100 --steps 200

Each row is a quantity, with the largest difference in each group of worlds, and where it was. Worlds of many equal bodies are
seen with the first twelve trees. ``tests/dynamics/agreement.py`` defines the quantities and their scales.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import simspec
from simspec.errors import SpecError
from simspec.proof.selftest_worlds import WORLDS
from simspec.world.kinematics import trees, within
from simspec.world.types import World
from tests.dynamics.agreement import QUANTITIES, deviations, random_tree
from tests.dynamics.simbody_model import MISSING
from tests.random_specs import spec
from tests.random_words import with_words, write_files

ROOT = Path(__file__).resolve().parent.parent
TREES = 12
"""Of one world: bodies that are copies of each other tell nothing new."""


def shortened(world: World) -> World:
    """The world's first ``TREES`` trees, and the constraints and sums between them."""
    kept = {body.name for bodies in list(trees(world).values())[:TREES] for body in bodies}
    return within(world, [body for body in world.bodies if body.name in kept])


def groups(count: int, scenarios: int) -> Iterator[tuple[str, str, World]]:
    """Group, name, world."""
    for folder in (ROOT / "specs", ROOT / "specs" / "contact", ROOT / "specs" / "motion"):
        for path in sorted(folder.glob("*.yaml")):
            yield "library", path.stem, simspec.load(path).resolve()
    for name, build in WORLDS.items():
        yield "self-test", name, build("mujoco")
    for seed in range(count):
        yield "random trees", str(seed), random_tree(seed)
    for seed in range(scenarios):
        with tempfile.TemporaryDirectory() as folder:
            data, files = with_words(seed, spec(seed))
            write_files(Path(folder), files)
            try:
                yield "random scenarios", str(seed), simspec.Spec.from_data(data, folder=Path(folder)).resolve()
            except SpecError as error:
                print(f"scenario {seed} is refused: {error}", file=sys.stderr)


def main() -> int:
    """Print the table; 1 where something differs by more than ``--allowed``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trees", type=int, default=200)
    parser.add_argument("--scenarios", type=int, default=50)
    parser.add_argument("--states", type=int, default=4)
    parser.add_argument("--steps", type=int, default=50)
    # largest found 7.1e-11, in motion with constraints, whose law divides round-off by the timestep
    parser.add_argument("--allowed", type=float, default=1e-9)
    options = parser.parse_args()
    if MISSING:
        print(MISSING, file=sys.stderr)
        return 3
    start = time.process_time()
    worst: dict[str, dict[str, tuple[float, str]]] = {}
    seen: dict[str, int] = {}
    for group, name, world in groups(options.trees, options.scenarios):
        world = dataclasses.replace(shortened(world), contact=type(world.contact)())
        seen[group] = seen.get(group, 0) + 1
        for quantity, share in deviations(world, options.states, options.steps).items():
            if share >= worst.setdefault(quantity, {}).get(group, (-1.0, ""))[0]:
                worst[quantity][group] = (share, name)
    print("| largest difference | " + " | ".join(f"{group} ({count})" for group, count in seen.items()) + " |")
    print("|---|" + "---|" * len(seen))
    for quantity in QUANTITIES:
        row = [worst.get(quantity, {}).get(group) for group in seen]
        print(f"| {quantity} | " + " | ".join(f"{cell[0]:.1e} ({cell[1]})" if cell else "-" for cell in row) + " |")
    print(f"{time.process_time() - start:.1f} s of processor time")
    return int(max(share for row in worst.values() for share, _ in row.values()) > options.allowed)


if __name__ == "__main__":
    sys.exit(main())
