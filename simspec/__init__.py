"""simspec: one neutral scenario, every physics engine, provably the same model, and an account of every difference.

>>> import simspec
>>> spec = simspec.load(simspec.find_spec("double-pendulum"))    # or the path of a YAML file of yours
>>> world = spec.resolve()                                       # frozen, SI units, every default filled
>>> compiled = simspec.compile(world, ["mujoco", "dart"])        # {engine: Compiled}: texts of files, nothing written
>>> certificate = simspec.verify(world, ["mujoco", "dart"])      # what each engine holds, against the world
>>> a, b = simspec.run(world, "mujoco"), simspec.run(world, "dart")
>>> simspec.diff(a, b).worst                                     # where the two differ most

Everything is imported when it is first used: ``import simspec`` itself takes no time. See docs/reference/python-api.md.
"""

# ruff: noqa: F401 (the names below are offered, not used)
from __future__ import annotations

from typing import TYPE_CHECKING, Any

_HOME = {
    "load": "simspec.language.load:load",
    "Spec": "simspec.language.load:Spec",
    "find_spec": "simspec.files:find_spec",
    "World": "simspec.world.types:World",
    "compile": "simspec.compiler:compile_world",
    "Compiled": "simspec.compiler:Compiled",
    "verify": "simspec.proof.verify:verify",
    "Certificate": "simspec.proof.certificate:Certificate",
    "run": "simspec.runner.execution:run",
    "run_all": "simspec.runner.execution:run_all",
    "Session": "simspec.engines.kit.session:Session",
    "Run": "simspec.runner.run:Run",
    "load_run": "simspec.runner.store:load_run",
    "evaluate": "simspec.runner.expectations:evaluate",
    "Outcome": "simspec.runner.expectations:Outcome",
    "diff": "simspec.comparison.runs:diff",
    "Diff": "simspec.comparison.runs:Diff",
    "floor": "simspec.comparison.floor:measure_floor",
    "Floor": "simspec.comparison.floor:Floor",
    "diff_worlds": "simspec.comparison.worlds:diff_worlds",
    "Change": "simspec.comparison.worlds:Change",
    "explain": "simspec.attribution.sides:explain",
    "Configuration": "simspec.attribution.configuration:Configuration",
    "Explanation": "simspec.attribution.explanation:Explanation",
    "study": "simspec.comparison.study:study",
    "Study": "simspec.comparison.study:Study",
    "bisect": "simspec.experiments.bisect:bisect",
    "Bisection": "simspec.experiments.bisect:Bisection",
    "plan_sweep": "simspec.experiments.plan:plan_sweep",
    "Plan": "simspec.experiments.plan:Plan",
    "Cell": "simspec.experiments.plan:Cell",
    "case_of": "simspec.experiments.cases:case_of",
    "versions_of": "simspec.experiments.timing:versions_of",
    "Swept": "simspec.api:Swept",
    "known_engines": "simspec.engines.kit.registry:engines",
    "SimspecError": "simspec.errors:SimspecError",
    "SpecError": "simspec.errors:SpecError",
    "UnsupportedError": "simspec.errors:UnsupportedError",
    "EngineError": "simspec.errors:EngineError",
    "Problem": "simspec.errors:Problem",
}
"""Where each public name lives."""

__all__ = sorted(_HOME)  # noqa: PLE0605 (a list all the same; a literal would be a second place to keep)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from simspec.plugins import simspec_version

        return simspec_version()
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module 'simspec' has no attribute {name!r}")
    from importlib import import_module

    module, _, attribute = home.partition(":")
    value = getattr(import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*_HOME, "__version__"])


if TYPE_CHECKING:
    from simspec.api import Swept
    from simspec.attribution.configuration import Configuration
    from simspec.attribution.explanation import Explanation
    from simspec.attribution.sides import explain
    from simspec.comparison.floor import Floor
    from simspec.comparison.floor import measure_floor as floor
    from simspec.comparison.runs import Diff, diff
    from simspec.comparison.study import Study, study
    from simspec.comparison.worlds import Change, diff_worlds
    from simspec.compiler import Compiled
    from simspec.compiler import compile_world as compile
    from simspec.engines.kit.registry import engines as known_engines
    from simspec.engines.kit.session import Session
    from simspec.errors import EngineError, Problem, SimspecError, SpecError, UnsupportedError
    from simspec.experiments.bisect import Bisection, bisect
    from simspec.experiments.cases import case_of
    from simspec.experiments.plan import Cell, Plan, plan_sweep
    from simspec.experiments.timing import versions_of
    from simspec.files import find_spec
    from simspec.language.load import Spec, load
    from simspec.proof.certificate import Certificate
    from simspec.proof.verify import verify
    from simspec.runner.execution import run, run_all
    from simspec.runner.expectations import Outcome, evaluate
    from simspec.runner.run import Run
    from simspec.runner.store import load_run
    from simspec.world.types import World
