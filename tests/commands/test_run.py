"""Exit codes of ``simspec run``: --fail-on-diff acts on the reported differences of any engines."""

from __future__ import annotations

import numpy as np
import pytest

from simspec import cli
from simspec.commands import run as run_command
from simspec.commands.reports import diff_code
from simspec.commands.scenario_options import RunOptions
from simspec.comparison.floor import Floor
from simspec.comparison.runs import diff
from simspec.comparison.study import Study
from simspec.errors import EXIT_FAILED, EXIT_OK, SpecError
from simspec.selection import named
from tests.runner.synthetic import column, free_body, run, world

BALL = world(free_body("ball"))


def of(distance: float, noise: float, tolerance: float, engines: int = 2) -> Study:
    """A study of two engines whose runs lie ``distance`` from each other."""
    runs = {
        name: run(BALL, lambda body, t, name=name: column(0 * t + distance * (name == "second"), 0, 0), engine=name)
        for name in ("first", "second")[:engines]
    }
    flat = {name: np.zeros(run.arrays["pose"].shape[:2]) for name, run in runs.items()}
    floors = {name: Floor(name, run.time, flat[name] + noise, flat[name], True, 1e-15) for name, run in runs.items()}
    pairs = [tuple(runs.values())] if engines == 2 else []
    diffs = tuple(diff(a, b, tolerance=tolerance, floor=list(floors.values())) for a, b in pairs)
    return Study(BALL, None, runs, {}, floors, {}, diffs)


@pytest.mark.parametrize(
    ("distance", "noise", "demanded", "code", "said"),
    [
        (2e-3, 1e-6, True, EXIT_FAILED, ""),
        (2e-3, 1e-6, False, EXIT_OK, ""),
        (1e-4, 1e-6, True, EXIT_OK, ""),
        (1e-4, 5e-3, True, EXIT_FAILED, "inconclusive"),
        (1e-4, 5e-3, False, EXIT_OK, ""),
    ],
    ids=["out", "out, not demanded", "within", "inconclusive", "inconclusive, not demanded"],
)
@pytest.mark.parametrize("as_json", [False, True])
def test_fail_on_diff_acts_on_the_reported_difference(
    monkeypatch, tmp_path, capsys, distance, noise, demanded, code, said, as_json
):
    monkeypatch.setattr(run_command, "study", lambda *_, tolerance, **__: of(distance, noise, tolerance))
    found = run_command.run_world(
        RunOptions(spec="", no_verify=True, fail_on_diff=1e-3 if demanded else None, as_json=as_json),
        BALL,
        named(["first", "second"]),
        tmp_path / "run",
    )
    assert found == code
    printed = capsys.readouterr()
    assert ("failed: not within --fail-on-diff 1 mm" in printed.out) == (code != EXIT_OK)
    if said and not as_json:
        assert said in printed.err


@pytest.mark.parametrize(("option", "code"), [([], EXIT_OK), (["--fail-on-diff", "1e-3"], EXIT_FAILED)])
def test_the_option_reaches_the_comparison(monkeypatch, tmp_path, capsys, option, code):
    monkeypatch.setattr(run_command, "study", lambda *_, tolerance, **__: of(2e-3, 1e-6, tolerance))
    words = ["run", "bouncing-ball", "--engine", "mujoco", "--engine", "dart", "--out", str(tmp_path), *option]
    assert cli.main(words) == code


def test_fail_on_diff_with_a_single_engine_is_refused(tmp_path):
    with pytest.raises(SpecError, match="requires two engines"):
        run_command.run_world(
            RunOptions(spec="", no_verify=True, fail_on_diff=1e-3), BALL, named(["first"]), tmp_path / "run"
        )
    assert not (tmp_path / "run").exists()
    assert diff_code([]) == EXIT_FAILED
