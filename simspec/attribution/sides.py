"""The two sides of a question: stored runs, or worlds in engines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from simspec.attribution.configuration import Asking, Configuration, ModelProof, prove
from simspec.attribution.explanation import Explanation, explain_sides
from simspec.attribution.windows import MOST_WINDOWS
from simspec.engines.kit.process import DEADLINE
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import Problem, SpecError
from simspec.runner.run import Run
from simspec.world.kinematics import initial_state

ROUND_OFF = 1e-12
"""Of coordinates: engines give an initial state back to the last few bits only. A run that was moved says so itself."""


def side_of_run(run: Run, pythons: Mapping[str, str] | None = None, name: str = "") -> Configuration:
    """The configuration of a run, its initial state included. Raises SpecError where the run has no rows."""
    if not run.recorded:
        why = f": {run.failed}" if run.failed is not None else ""
        message = f"{name or repr(run)} has no rows{why}"
        raise SpecError([Problem(message, hint="run it again: simspec run", code="R101")])
    start = np.array(run.arrays["q"][0]), np.array(run.arrays["v"][0])
    both = zip(start, initial_state(run.world), strict=True)
    same = not run.provenance.get("perturb") and all(
        np.allclose(*pair, rtol=ROUND_OFF, atol=ROUND_OFF) for pair in both
    )
    return Configuration(run.world, run.engine, (pythons or {}).get(run.engine), None if same else start)


def explain(
    first: Run | Configuration,
    second: Run | Configuration,
    *,
    windows: int = MOST_WINDOWS,
    names: tuple[str, str] | None = None,
    pythons: Mapping[str, str] | None = None,
    deadline: float = DEADLINE,
    proofs: Sequence[ModelProof] = (),
    verify: bool = False,
    progress: Callable[..., None] = lambda text, share=None: None,
) -> Explanation:
    """Where the difference of two sides comes from: each a run, or a :class:`Configuration` (a world in an engine).

    windows  how many windows are looked at, at most
    names    what the two are called (default: world and engine)
    pythons  interpreters of engines, by label
    deadline seconds that one engine process may take
    proofs   whether each side's engine holds its world (``configuration.proof_of``); ``verify``: prove it here
    progress receives the current action

    Both begin short windows in states of the first side's run, and the gap at the windows' ends is measured; then one thing
    that differs, or may, is taken away at a time (docs/guide/explain.md). Raises SpecError where the two are of
    different scenes or a run has no rows, UnsupportedError and EngineError where one of the two cannot run.
    """
    sides = [side if isinstance(side, Configuration) else side_of_run(side, pythons) for side in (first, second)]
    given = names or (_name_of(sides[0]), _name_of(sides[1]))
    if verify:
        progress("proving that the engines hold their models")
        proofs = prove(sides, deadline)
    with WarmProcesses() as warm:
        asking = Asking(warm, deadline)
        return explain_sides(sides[0], sides[1], given, most=windows, asking=asking, proofs=proofs, progress=progress)


def _name_of(side: Configuration) -> str:
    return f"{side.world.name} in {side.engine}"
