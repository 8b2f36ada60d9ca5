"""Random worlds of contact of several bodies: proven models must move as the reference engines do at small timesteps.

    python tools/coupled_worlds.py --count 100 --json FILE           the seeds 0 to 99, every engine; appends to FILE
    python tools/coupled_worlds.py --seeds 7 12 --engine ode         these
    python tools/coupled_worlds.py --page FILE                       docs/records/coupled-worlds.md, from such a file

The reference of a world are two of ``REFERENCES`` that agree, at a quarter to an eighth of its timestep. An engine is *wrong*
in a world where a body ends further from it than ``TOLERANCE`` and ``SHARE`` allow. Where another engine that is right is as
far off at the world's own timestep, the timestep is to blame, not the engine. A valid world that moves wrongly is *covered*
where its proof passes by a deviation that the engine declares for such contact, or where the spec had to accept such contact by
name.
"""

from __future__ import annotations

import argparse
import collections
import copy
import datetime
import itertools
import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, UnsupportedError
from simspec.language.load import Spec
from simspec.proof.verify import prepare, verify
from simspec.runner.execution import run_case
from simspec.runner.run import Case
from tests.coupled_specs import coupled
from tools.random_worlds import accepted

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "records" / "coupled-worlds.md"
ENGINES = ("mujoco", "pybullet", "dart", "drake", "ode", "rapier", "gazebo", "physx")
TURNS = {"mujoco": {"friction": "coulomb"}}
"""Settings of every second seed; the others have the defaults."""
REFERENCES: Mapping[str, Mapping[str, str]] = {
    "ode": {"solver": "step"},
    "dart": {"contact_solver": "nsgs"},
    "drake": {"contact_approximation": "tamsi"},
    "mujoco": {"friction": "coulomb"},
}
"""The engines and solvers of which no probe is far off at 1 ms. Drake has no pyramids and no restitution, DART no inscribed
pyramid, for which MuJoCo stands in; it is no reference of other worlds."""
STEP = 0.00025
"""s: timestep of references, or an eighth of the world's where that is more."""
TOLERANCE, SHARE = 0.005, 0.03
"""m, and share of the body's way: 3 % is what the probes of slips allow, 5 mm what bodies may settle by several contacts."""
AGREEING = 0.5
"""Largest difference of two references, in tolerances."""
COVERING: Mapping[str, tuple[str, str]] = {
    "stack": ("stack* pile* cross*", "contact.mass-ratio shape.box contact.cone.pyramid-inscribed"),
    "leaner": (
        "rod* edge* stack*",
        "contact.mass-ratio shape.box contact.friction.impact contact.cone.pyramid-inscribed",
    ),
    "pile": ("pile* stack*", "contact.mass-ratio contact.friction.impact contact.cone.*"),
    "clamp": (
        "clamp* jam* stack*",
        "contact.mass-ratio shape.box contact.friction.impact contact.friction.self-locking contact.cone.pyramid-inscribed",
    ),
    "carrier": ("carrier slide-spin stack*", "contact.mass-ratio shape.box contact.friction.carried contact.cone.*"),
    "grasp": (
        "clamp* jam* squeeze* carrier",
        "contact.mass-ratio contact.pressure contact.friction.* contact.cone.pyramid-inscribed shape.cylinder",
    ),
    "strike": (
        "strike* row* edge* oblique* restitution* threshold",
        "contact.friction.impact material.restitution* contact.cone.pyramid-inscribed",
    ),
}
"""By kind of world the probes whose deviations, and the features whose acceptance, say that an engine may be off there. The
elliptic cone is accepted for what slips along no axis (piles, carriers that turn), and as ``ALSO`` says."""
ALSO = {("physx", "leaner", "contact.cone.elliptic"), ("pybullet", "grasp", "contact.cone.elliptic")}
"""PhysX's cone covers what leans. PyBullet's has some 1.3 times the friction where a finger's pad slips along a box
(seed 89); its pyramid has not."""
CAUSES = "\n## Causes\n"
"""Heading of what is written by hand at the end of the page, and is kept."""
VERDICTS = ("right", "covered", "uncovered", "timestep", "not comparable", "not valid", "failed", "refused")
MEANINGS = {
    "right": "valid, and within the tolerance of the reference",
    "covered": "valid and wrong, as a declared deviation or an accepted feature of such contact says",
    "uncovered": "valid and wrong, and nothing says so",
    "timestep": "valid and off, as two engines that are right are at this timestep",
    "not comparable": "valid, but no two references agree",
    "not valid": "level L0 to L7 has a failed check",
    "failed": "the run ended with an error",
    "refused": "the engine refuses the spec",
}

WORDS = 200
"""Characters of a reason that a page has."""
Places = Mapping[str, np.ndarray]
"""Positions (rows, 3) of the bodies that move, by name."""


@dataclass
class Judged:
    """One engine in one world. ``off``: of the worst body, in m and in tolerances."""

    seed: int
    kind: str
    drawn: str
    engine: str
    settings: str
    verdict: str
    why: str = ""
    accepted: list[str] = field(default_factory=list)
    declared: list[str] = field(default_factory=list)
    off: float | None = None
    worst: float | None = None
    body: str = ""


def places_of(spec: Mapping[str, Any], engine: str, warm: WarmProcesses) -> Places:
    """Where everything goes. Raises EngineError where the engine gives no whole run."""
    world = Spec.from_data(dict(spec), folder=ROOT).resolve()
    run = run_case(Case(world, engine), warm=warm)
    if run.failed:
        raise EngineError(engine, run.failed)
    moving = [name for name, body in spec["bodies"].items() if not (body.get("fixed") or body.get("kinematic"))]
    names = [body.name for body in world.bodies]
    return {name: run.arrays["pose"][:, names.index(name), :3] for name in moving}


def largest_distance(places: Places, other: Places, reference: Places) -> tuple[float, str, float]:
    """The largest difference of final positions, in tolerances of the reference, its body, and the distance (m)."""
    found = []
    for name, trace in reference.items():
        way = float(np.linalg.norm(np.diff(trace, axis=0), axis=1).sum())
        distance = float(np.linalg.norm(places[name][-1] - other[name][-1]))
        found.append((distance / (TOLERANCE + SHARE * way), name, distance))
    return max(found)


def references(spec: Mapping[str, Any], timestep: float, warm: WarmProcesses) -> dict[str, Places]:
    """Motion of a world in the reference engines at a timestep, by name."""
    found = {}
    for engine, settings in REFERENCES.items():
        if engine == "mujoco" and spec["contact"]["friction_cone"] != "pyramid-inscribed":
            continue
        finer = copy.deepcopy(dict(spec))
        finer["physics"]["timestep"] = timestep
        finer["engines"] = {engine: {"settings": dict(settings)}}
        if accepted(finer, engine, ROOT):
            continue
        try:
            found[engine] = places_of(finer, engine, warm)
        except EngineError:
            continue
    return found


def reference(fine: Mapping[str, Places]) -> tuple[set[str], Places, str]:
    """The two references that agree best, and one of them; or why there is none."""
    pairs = sorted(
        (largest_distance(fine[first], fine[other], fine[first]), first, other)
        for first, other in itertools.combinations(fine, 2)
    )
    if not pairs:
        return set(), {}, f"only {', '.join(fine) or 'no engine'} as reference"
    (off, body, distance), first, other = pairs[0]
    if not off <= AGREEING:
        return set(), {}, f"{first} and {other} differ by {1e3 * distance:.1f} mm ({body})"
    return {first, other}, fine[first], ""


def judge(seed: int, engines: Sequence[str], warm: WarmProcesses) -> list[Judged]:
    spec, kind, drawn = coupled(seed)
    timestep = spec["physics"]["timestep"]
    fine = references(spec, max(STEP, timestep / 8.0), warm)
    coarse = references(spec, timestep, warm)
    agreeing, right, why_not = reference(fine)
    found = []
    probes = None
    for engine in engines:
        settings = TURNS.get(engine, {}) if seed % 2 else {}
        words = " ".join(f"{name}={value}" for name, value in settings.items())
        judged = Judged(seed, kind, drawn, engine, words, "refused")
        found.append(judged)
        mine = copy.deepcopy(spec)
        mine["engines"] = {engine: {"settings": settings}} if settings else {}
        judged.why = accepted(mine, engine, ROOT)
        if judged.why:
            continue
        judged.accepted = mine["engines"].get(engine, {}).get("accept", [])
        world = Spec.from_data(mine, folder=ROOT).resolve()
        probes = probes or prepare(world)
        try:
            proof = verify(world, [engine], probes=probes, warm=warm).engines[engine]
            places = places_of(mine, engine, warm)
        except (EngineError, UnsupportedError) as error:
            judged.verdict, judged.why = "failed", str(error).splitlines()[0]
            continue
        sizes: dict[str, float] = {}
        for figure in proof.contact:
            if figure.declared:
                sizes[figure.probe] = max(sizes.get(figure.probe, 0.0), figure.width)
        judged.declared = [f"{probe} {size:.3g}" for probe, size in sizes.items()]
        if right:
            judged.worst, judged.body, judged.off = largest_distance(places, right, right)
        failures = [f"{check.level} {check.name}: {check.detail}" for check in proof.checks if not check.passed]
        if failures:
            judged.verdict, judged.why = "not valid", failures[0]
        elif not right:
            judged.verdict, judged.why = "not comparable", why_not
        elif judged.worst is not None and judged.worst <= 1.0:
            judged.verdict = "right"
        elif by_timestep(engine, places, right, agreeing, coarse):
            judged.verdict = "timestep"
        else:
            judged.verdict = "covered" if covers(judged) else "uncovered"
    return found


def by_timestep(engine: str, places: Places, right: Places, agreeing: set[str], coarse: Mapping[str, Places]) -> bool:
    """Whether another engine that is right is off at the world's own timestep too, and ends where this one does."""
    return any(
        largest_distance(coarse[other], right, right)[0] > 1.0
        and largest_distance(places, coarse[other], right)[0] <= 1.0
        for other in agreeing & set(coarse)
        if other != engine
    )


def covers(judged: Judged) -> list[str]:
    """The declared deviations and accepted features that are of this kind of contact."""
    probes, features = (patterns.split() for patterns in COVERING[judged.kind])
    declared = [text for text in judged.declared if any(fnmatchcase(text.split()[0], probe) for probe in probes)]
    return declared + [
        name
        for name in judged.accepted
        if (judged.engine, judged.kind, name) in ALSO or any(fnmatchcase(name, feature) for feature in features)
    ]


def page(rows: Sequence[Judged], date: str) -> str:
    """The record, from what was judged until ``date``."""
    seeds, engines = sorted({row.seed for row in rows}), list(dict.fromkeys(row.engine for row in rows))
    versions = ", ".join(f"{find_engine(name).TITLE} {find_engine(name).version()}" for name in engines)
    lines = [
        "# Random worlds of contact of several bodies",
        "",
        "> With this page you can see how often each engine solves random contacts of several bodies.",
        "",
        f"Seeds {seeds[0]} to {seeds[-1]} ({len(seeds)} worlds; `tests/coupled_specs.py` draws them), {date}, {versions}.",
        f"Command: `python tools/coupled_worlds.py --first {seeds[0]} --count {len(seeds)} --json FILE`, then `--page FILE`.",
        "",
        f"An engine is wrong where a body ends further from the reference than {1e3 * TOLERANCE:g} mm and "
        f"{100 * SHARE:g} % of its way. The reference are two of ODE (`step`), DART (`nsgs`), Drake (TAMSI), and under the "
        f"inscribed pyramid MuJoCo (`coulomb`), at {1e3 * STEP:g} ms or an eighth of the world's timestep, that agree to "
        "half of that. MuJoCo has `friction: coulomb` in every second seed.",
        "",
    ]
    lines += [f"- **{name}**: {MEANINGS[name]}" for name in VERDICTS]
    for title, key in (("engine", "engine"), ("kind", "kind")):
        lines += ["", f"| {title} | {' | '.join(VERDICTS)} |", "|---|" + "---:|" * len(VERDICTS)]
        for name in dict.fromkeys(getattr(row, key) for row in rows):
            counts = collections.Counter(row.verdict for row in rows if getattr(row, key) == name)
            lines.append(f"| {name} | {' | '.join(str(counts[verdict]) for verdict in VERDICTS)} |")
    lines += ["", "## What covers what is valid and wrong", ""]
    lines += ["| engine | by | worlds | widest, mm | seeds |", "|---|---|---:|---:|---|"]
    by: dict[tuple[str, str], list[Judged]] = {}
    for row in rows:
        for text in covers(row) if row.verdict == "covered" else ():
            by.setdefault((row.engine, text.split()[0]), []).append(row)
    for (engine, text), some in sorted(by.items()):
        widest = max(1e3 * (row.off or 0.0) for row in some)
        lines.append(
            f"| {engine} | `{text}` | {len(some)} | {widest:.0f} | {', '.join(str(row.seed) for row in some)} |"
        )
    for verdict in ("uncovered", "not valid", "failed", "timestep"):
        some = [row for row in rows if row.verdict == verdict]
        lines += ["", f"## {verdict.capitalize()}", ""]
        lines += [line_of(row) for row in some] or ["None."]
    whole = {row.seed: row for row in rows if row.verdict == "not comparable"}
    lines += ["", "## Not comparable", ""]
    lines += [f"- {seed}, {row.kind}: {row.why}; {row.drawn}" for seed, row in whole.items()] or ["None."]
    return "\n".join(lines) + "\n"


def line_of(row: Judged) -> str:
    off = "" if row.off is None else f"{row.body} {1e3 * row.off:.1f} mm off ({row.worst:.1f} tolerances)"
    why = row.why.partition(" Remove ")[0]  # a folder of this machine follows
    why = why if len(why) < WORDS else f"{why[:WORDS]}…"
    more = "; ".join(filter(None, (off, why, f"accepted {', '.join(row.accepted)}" if row.accepted else "")))
    declared = f"; declared: {', '.join(row.declared)}" if row.declared else ""
    settings = f" ({row.settings})" if row.settings else ""
    return f"- {row.seed}, {row.kind}, {row.engine}{settings}: {more}{declared}; {row.drawn}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seeds", type=int, nargs="*")
    parser.add_argument("--engine", action="append", choices=ENGINES)
    parser.add_argument("--json", type=Path, help="appended to, a line for each engine in a world")
    parser.add_argument("--page", type=Path, help="write the page from such a file")
    options = parser.parse_args()
    if options.page:
        lines = [Judged(**json.loads(line)) for line in options.page.read_text(encoding="utf-8").splitlines()]
        rows = sorted({(row.seed, row.engine): row for row in lines}.values(), key=lambda row: row.seed)
        for row in rows:  # by the table as it is now
            if row.verdict in ("covered", "uncovered"):
                row.verdict = "covered" if covers(row) else "uncovered"
        date = datetime.date.fromtimestamp(options.page.stat().st_mtime).isoformat()
        causes = PAGE.read_text(encoding="utf-8").partition(CAUSES)[2] if PAGE.exists() else "\n"
        PAGE.write_text(f"{page(rows, date)}{CAUSES}{causes}", encoding="utf-8")
        return 0
    uncovered = 0
    with WarmProcesses() as warm:
        for seed in options.seeds or range(options.first, options.first + options.count):
            began = time.monotonic()
            rows = judge(seed, options.engine or ENGINES, warm)
            if options.json:
                with options.json.open("a", encoding="utf-8") as file:
                    file.writelines(json.dumps(asdict(row), ensure_ascii=False) + "\n" for row in rows)
            uncovered += sum(row.verdict == "uncovered" for row in rows)
            print(f"{seed} {rows[0].kind}, {rows[0].drawn}; {time.monotonic() - began:.0f} s", flush=True)
            for row in rows:
                if row.verdict not in ("right", "refused"):
                    print(f"    {row.verdict}: {line_of(row)[2:200]}", flush=True)
    print(f"valid and wrong, covered by nothing: {uncovered}")
    return 1 if uncovered else 0


if __name__ == "__main__":
    sys.exit(main())
