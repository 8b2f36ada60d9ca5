"""Study files: the sweeps that they make of their scenarios, and refusals with their place."""

from __future__ import annotations

import textwrap
from pathlib import Path

import pytest

from simspec.errors import SpecError
from simspec.language.load import load_study_file

ROOT = Path(__file__).parents[2]
SPEC = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 20 ms}
bodies:
  ball: {mass: 1 kg, inertia: {principal: [1, 1, 1]}}
record: {every: 10 ms}
sweep: {repeat: 7, engines: [mujoco, dart]}
"""
STUDY = """\
simspec_study: 1
name: falls
figures: figures.yaml
sweeps:
  speed:
    spec: fall.yaml
    set: {bodies.ball.mass: 2 kg}
    sweep:
      over:
        physics.timestep: [1 ms, 2 ms, 5 ms]
      cases:
        heavy: {bodies.ball.mass: 9 kg}
    small:
      set: {bodies.ball.mass: 3 kg, physics.duration: 10 ms}
      sweep:
        over:
          physics.timestep: [1 ms]
    unequal:
      one-heavy: {mujoco: heavy}
    show: [speed, unequal]
  whole: {spec: fall.yaml}
"""
FIGURES = """\
simspec_figures: 1
source: a paper
figures:
  - {sweep: speed, quantity: real_time_factor, engine: Any, timesteps: [1 ms, 2 ms], values: [3, 6], source: table 1}
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "fall.yaml").write_text(SPEC)
    (tmp_path / "figures.yaml").write_text(FIGURES)
    (tmp_path / "study.yaml").write_text(STUDY)
    return tmp_path


def test_a_study_puts_its_values_and_words_into_the_scenario(folder):
    study = load_study_file(folder / "study.yaml")
    speed, whole = study.sweeps()
    assert speed.spec.data.bodies["ball"].mass == 2
    assert speed.spec.data.sweep.over == {"physics.timestep": ("1 ms", "2 ms", "5 ms")}
    assert speed.spec.data.sweep.repeat == whole.spec.data.sweep.repeat == 7  # the scenario's own word
    assert whole.spec.data.bodies["ball"].mass == 1
    assert study.figures[0].timesteps == (0.001, 0.002)
    assert study.figures[0].values == (3, 6)


def test_the_small_study_applies_its_changes(folder):
    (speed,) = load_study_file(folder / "study.yaml").sweeps(small=True)
    assert speed.spec.data.bodies["ball"].mass == 3
    assert speed.spec.data.physics.duration == 0.01
    assert speed.spec.data.sweep.over == {"physics.timestep": ("1 ms",)}
    assert list(speed.spec.data.sweep.cases) == ["heavy"]  # not replaced by the small study
    assert dict(speed.changed) == {"bodies.ball.mass": "3 kg", "physics.duration": "10 ms"}


@pytest.mark.parametrize(
    ("old", "new", "message", "line"),
    [
        ("name: falls", "nme: falls", "unknown key 'nme'", 2),
        ("simspec_study: 1", "simspec_study: 2", "", 1),
        ("spec: fall.yaml\n    set", "spec: gone.yaml\n    set", "no such file", 6),
        ("spec: fall.yaml\n    set", "spec: ../../fall.yaml\n    set", "", 6),
        ("{bodies.ball.mass: 2 kg}", "{bodies.bal.mass: 2 kg}", "the spec has no 'bodies.bal'", 7),
        ("{bodies.ball.mass: 2 kg}", "{bodies.ball.mass: 2 m}", "", 7),
        ("{mujoco: heavy}", "{mujoco: light}", "the sweep has no case of this name", 19),
        ("{mujoco: heavy}", "{}", "no engine has a case of its own", 19),
        ("show: [speed, unequal]", "show: [speed]", "unequal models are not shown", 18),
        ("show: [speed, unequal]", "show: [unequal, determinism]", "determinism is shown by repeated runs", 20),
        ("show: [speed, unequal]", "show: [unequal, pace]", "not an allowed word", 20),
        ("over:\n        physics.timestep", "over:\n        physics.timestp", "the spec has no 'physics.timestp'", 8),
        ("figures: figures.yaml", "figures: none.yaml", "no such file", 3),
    ],
)
def test_wrong_studies_are_located_errors(folder, old, new, message, line):
    assert old in STUDY
    (folder / "study.yaml").write_text(STUDY.replace(old, new, 1))
    with pytest.raises(SpecError) as caught:
        load_study_file(folder / "study.yaml").sweeps()
    problem = caught.value.problems[0]
    assert message in problem.message
    assert (problem.location.file, problem.location.line) == (str(folder / "study.yaml"), line), caught.value


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("values: [3, 6]", "values: [3]", "there is one value for each timestep"),
        ("timesteps: [1 ms, 2 ms], ", "", "a series needs its timesteps"),
        ("sweep: speed", "sweep: sped", "the study has no such sweep"),
        (", source: table 1", "", "source is missing"),
        ("source: a paper\n", "", "source is missing"),
    ],
)
def test_figures_are_as_strict(folder, old, new, message):
    (folder / "figures.yaml").write_text(FIGURES.replace(old, new, 1))
    with pytest.raises(SpecError) as caught:
        load_study_file(folder / "study.yaml")
    assert message in str(caught.value)
    assert str(folder / "figures.yaml") in str(caught.value)


def test_a_study_without_a_small_part_has_no_small_study(folder):
    (folder / "study.yaml").write_text(textwrap.dedent(STUDY).split("  speed:")[0] + "  whole: {spec: fall.yaml}\n")
    (folder / "figures.yaml").write_text("simspec_figures: 1\nsource: none\nfigures: []\n")
    with pytest.raises(SpecError, match="no sweep of the study is part of the small one"):
        load_study_file(folder / "study.yaml").sweeps(small=True)


def test_the_study_of_the_paper_is_whole():
    study = load_study_file(ROOT / "specs" / "studies" / "koerber-2021.yaml")
    names = [sweep.name for sweep in study.sweeps()]
    assert {"spheres", "robot"} <= set(names)
    small = {sweep.name: sweep.spec.data.sweep for sweep in study.sweeps(small=True)}
    assert "robot" not in small
    for name in ("spheres", "robot-pick"):
        assert len(small[name].over["physics.timestep"]) == 5
        assert 1 + small[name].perturb.seeds == len(small[name].engines) == 3
    assert {figure.engine for figure in study.figures} == {"Gazebo", "MuJoCo", "PyBullet", "Webots"}
