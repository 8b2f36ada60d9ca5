"""The words of ``sweep``: read strictly, every problem at its place in the spec's own file."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.language.document import parse
from simspec.language.formatting import format_text
from simspec.language.load import Spec, load
from simspec.language.sweep import MOST_CELLS

SPEC = """\
simspec: 1
name: rod
physics: {gravity: [0, 0, -9.81], timestep: 1 ms, duration: 20 ms}
bodies:
  rod:
    mass: 2 kg
    inertia: {principal: [0.04, 0.04, 0.001]}
    joint: {type: hinge, axis: [0, 1, 0], position: 60 deg}
engines:
  dart:
    settings: {iterations: 50}
sweep:
"""
LINES = SPEC.count("\n")


def problems_of(tmp_path, sweep):
    """The problems of a sweep: (line below `sweep:`, column, message, path)."""
    path = tmp_path / "rod.yaml"
    path.write_text(SPEC + "".join(f"  {line}\n" for line in sweep.splitlines()), encoding="utf-8")
    with pytest.raises(SpecError) as error:
        load(path)
    return [
        (problem.location.line - LINES, problem.location.column, problem.message, problem.path)
        for problem in error.value.problems
    ]


REFUSED = {
    "a path that there is not": ("over: {physics.timestp: [1 ms]}", (1, 10), "the spec has no 'physics.timestp'"),
    "a body that there is not": ("over:\n  bodies.rot.mass: [1, 2]", (2, 5), "the spec has no 'bodies.rot'"),
    "an element that there is not": ("over: {physics.gravity.3: [1]}", (1, 10), "no such element"),
    "below a number": ("cases: {a: {physics.timestep.x: 1}}", (1, 15), "this value has no elements"),
    "in a case": ("cases: {a: {physics.timestp: 1}}", (1, 15), "the spec has no 'physics.timestp'"),
    "in a row": ("together:\n  - {physics.timestp: [1]}", (2, 8), "the spec has no 'physics.timestp'"),
    "in samples": (
        "samples: {count: 2, seed: 1, values: {physics.timestp: {uniform: [1, 2]}}}",
        (1, 41),
        "the spec has no 'physics.timestp'",
    ),
    "an empty list": ("over: {physics.timestep: []}", (1, 10), "no values"),
    "an empty grid": ("over: {}", (1, 3), "over is empty"),
    "empty cases": ("cases: {}", (1, 3), "cases is empty"),
    "no rows": ("together: []", (1, 3), "together is empty"),
    "an empty row": ("together: [{}]", (1, 14), "no paths"),
    "no engines": ("engines: []", (1, 3), "engines is empty"),
    "an engine twice": ("engines: [dart, dart]", (1, 19), "the engine dart is duplicated"),
    "no engine's name": ("engines: ['dart@x y']", (1, 13), "expected an engine"),
    "no list": ("over: {physics.timestep: 1 ms}", (1, 28), "expected a list of values, or a range"),
    "a value twice": ("over: {physics.timestep: [1 ms, 2 ms, 1 ms]}", (1, 41), "this value is duplicated"),
    "a value twice, in other words": (
        "over: {physics.timestep: [1 ms, 0.001]}",
        (1, 35),
        "this value of physics.timestep is duplicated",
    ),
    "a wrong unit": ("over: {physics.timestep: [1 ms, 2 kg]}", (1, 35), "wrong unit: expected a time (s), found 'kg'"),
    "out of bounds": ("over: {physics.timestep: [0, 1 ms]}", (1, 29), "must be above 0"),
    "an element's unit": ("over: {physics.gravity.2: [1 kg]}", (1, 30), "wrong unit: expected an acceleration"),
    "no finite number": ("over: {physics.timestep: [.nan]}", (1, 29), "numbers must be finite"),
    "null": ("over: {physics.timestep: [null]}", (1, 29), "null is no value"),
    "a word of no list": ("over: {contact.friction_cone: [pyramid]}", (1, 34), "not an allowed word"),
    "a range to another unit": (
        "over: {physics.timestep: {from: 1 ms, to: 0.01 s, count: 3}}",
        (1, 45),
        "both numbers must have the same unit",
    ),
    "a range of one value": (
        "over: {physics.timestep: {from: 1 ms, to: 2 ms, count: 1}}",
        (1, 58),
        "out of range",
    ),
    "a range to where it begins": (
        "over: {physics.timestep: {from: 1 ms, to: 1 ms, count: 2}}",
        (1, 45),
        "from and to are equal",
    ),
    "a logarithm of 0": (
        "over: {bodies.rod.mass: {from: 0, to: 1, count: 2, spacing: logarithmic}}",
        (1, 34),
        "must be above 0 with logarithmic spacing",
    ),
    "a word of no range": (
        "over: {physics.timestep: {from: 1 ms, to: 2 ms, number: 2}}",
        (1, 59),
        "unknown key 'number'",
    ),
    "no unit that there is": (
        "over: {bodies.rod.mass: {from: 1 kk, to: 2 kk, count: 2}}",
        (1, 34),
        "unknown unit 'kk'",
    ),
    "bounds out of bounds": (
        "over: {bodies.rod.mass: {from: -1, to: 1, count: 2}}",
        (1, 34),
        "must be at least 0",
    ),
    "rows of other lengths": (
        "together:\n  - {physics.timestep: [1 ms, 2 ms], bodies.rod.mass: [1]}",
        (2, 40),
        "values that are moved together are equally many",
    ),
    "a row twice": (
        "together:\n  - {physics.timestep: [1 ms, 1 ms], bodies.rod.mass: [1, 1]}",
        (2, 33),
        "this row is duplicated",
    ),
    "a path twice": (
        "over: {bodies.rod.mass: [1]}\ntogether:\n  - {bodies.rod.mass: [1]}",
        (3, 8),
        "a sweep changes this value twice",
    ),
    "a part of what is replaced": (
        "over: {physics.gravity: [[0, 0, -1]]}\ncases: {a: {physics.gravity.2: 3}}",
        (2, 34),
        "a sweep changes this value twice",
    ),
    "replaced value, after a part of it": (
        "over: {physics.gravity.2: [1]}\ncases: {a: {physics.gravity: [0, 0, 1]}}",
        (2, 15),
        "a sweep changes this value twice",
    ),
    "a path twice in a case": (
        "cases: {a: {physics.gravity: [0, 0, 1], physics.gravity.2: 3}}",
        (1, 62),
        "a sweep changes this value twice",
    ),
    "two equal cases": (
        "cases: {a: {bodies.rod.mass: 1}, b: {bodies.rod.mass: 1.0}}",
        (1, 36),
        "the case b is the same as a",
    ),
    "a case of nothing": ("cases: {a: {}}", (1, 11), "the case a is the same as the scenario without a case"),
    "only no cases": ("only_cases: true", (1, 15), "only_cases without cases"),
    "part without effect on runs": ("over: {name: [a, b]}", (1, 10), "no run depends on this part of a spec"),
    "the sweep": ("over: {sweep.repeat: [1, 2]}", (1, 10), "no run depends on this part of a spec"),
    "no path": ("over: {physics..timestep: [1]}", (1, 10), "expected a dotted path"),
    "a key that is no word": ("overs: {physics.timestep: [1 ms]}", (1, 3), "unknown key 'overs'"),
    "no samples": (
        "samples: {count: 0, seed: 1, values: {bodies.rod.mass: {uniform: [1, 2]}}}",
        (1, 20),
        "out of range",
    ),
    "no values of samples": ("samples: {count: 1, seed: 1, values: {}}", (1, 32), "no values"),
    "two distributions": (
        "samples: {count: 1, seed: 1, values: {bodies.rod.mass: {uniform: [1, 2], normal: [1, 2]}}}",
        (1, 76),
        "uniform and normal exclude each other",
    ),
    "a distribution upside down": (
        "samples: {count: 1, seed: 1, values: {bodies.rod.mass: {uniform: [2, 1]}}}",
        (1, 72),
        "must be above the first number",
    ),
    "a distribution's unit": (
        "samples: {count: 1, seed: 1, values: {bodies.rod.mass: {normal: [2 m, 1 m]}}}",
        (1, 68),
        "wrong unit: expected a mass (kg), found 'm'",
    ),
    "no spread": (
        "samples: {count: 1, seed: 1, values: {bodies.rod.mass: {normal: [2, 0]}}}",
        (1, 71),
        "must be above 0",
    ),
    "no perturbation": ("perturb: {amount: 0, seeds: 3}", (1, 21), "must be above 0"),
    "no repeats": ("repeat: 0", (1, 11), "out of range"),
    "too many runs": ("repeat: 3000\nperturb: {amount: 1.0e-9, seeds: 4000}", (0, 1), "too many runs in one sweep"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_sweeps_are_refused_at_their_place(name, tmp_path):
    sweep, place, message = REFUSED[name]
    problems = problems_of(tmp_path, sweep)
    assert any(problem[:2] == place and message in problem[2] for problem in problems), problems


def test_each_mistake_is_a_single_problem(tmp_path):
    """Each of these has one cause, so it is reported once; a few are two mistakes."""
    several = {"no unit that there is", "a word of no range"}
    for name in REFUSED.keys() - several:
        folder = tmp_path / str(abs(hash(name)))
        folder.mkdir()
        assert len(problems_of(folder, REFUSED[name][0])) == 1, (name, problems_of(folder, REFUSED[name][0]))


def test_a_file_of_a_model_has_no_sweep():
    with pytest.raises(SpecError, match="sweep is only for scenarios"):
        Spec.from_data({"name": "m", "model": {"bodies": {"a": {"fixed": True}}}, "sweep": {"repeat": 2}})


def test_the_bound_is_that_of_the_product():
    whole = {"name": "m", "bodies": {"a": {"fixed": True}}}
    exact = {"perturb": {"amount": 1e-9, "seeds": 999}, "repeat": 10_000}
    assert Spec.from_data({**whole, "sweep": exact}).data.sweep.repeat * 1000 == MOST_CELLS
    with pytest.raises(SpecError, match="too many runs"):
        Spec.from_data({**whole, "sweep": {**exact, "engines": ["dart", "mujoco"]}})


WHOLE = """\
engines: [dart, "mujoco@3.8"]
over:
  physics.timestep: [1 ms, 2 ms]
  bodies.rod.mass: {from: 1 kg, to: 4 kg, count: 4}
  bodies.rod.joint.damping: {from: 0.001, to: 1, count: 4, spacing: logarithmic}
together:
  - {physics.duration: [20 ms, 40 ms], record.every: [10 ms, 20 ms]}
cases:
  still: {bodies.rod.joint.position: 0 deg, engines.dart.settings.iterations: 20}
only_cases: true
samples: {count: 3, seed: 1, values: {physics.gravity.2: {choice: [-9.81, -1.62]}}}
perturb: {amount: 1.0e-9, seeds: 3}
repeat: 2
measure: speed
"""


def test_all_words_are_read(tmp_path):
    path = tmp_path / "rod.yaml"
    path.write_text(SPEC + "".join(f"  {line}\n" for line in WHOLE.splitlines()), encoding="utf-8")
    spec = load(path)
    sweep = spec.data.sweep
    assert sweep.over["bodies.rod.mass"] == ("1 kg", "2 kg", "3 kg", "4 kg")
    assert sweep.over["bodies.rod.joint.damping"] == (0.001, 0.01, 0.1, 1)
    assert sweep.measure == "speed"
    again = Spec.from_data(parse(spec.to_yaml(), "again").data)
    assert again.data.sweep == sweep
    assert Spec.from_data(spec.data).data.sweep == sweep, "from the language's own models"
    text = format_text(path.read_text(encoding="utf-8"), "rod.yaml")
    assert format_text(text, "rod.yaml") == text
    assert "\n  over:\n    physics.timestep: [1 ms, 2 ms]\n" in text
    assert load(path, sets=["sweep.repeat=5"]).data.sweep.repeat == 5


# --- settings that follow from the timestep ---------------------------------------------------------------------------


def settings(entries, timestep="4 ms", **more):
    data = {
        "name": "m",
        "physics": {"timestep": timestep},
        "bodies": {"a": {"fixed": True}},
        "engines": {"dart": {"settings": {"iterations": 1, "tolerance": 0.5}, "at_timestep": entries}},
    }
    return dict(Spec.from_data(data, **more).resolve().options("dart").settings)


ENTRIES = [
    {"above": "1 ms", "settings": {"iterations": 2}},
    {"above": "8 ms", "settings": {"iterations": 3, "more": 1}},
]


@pytest.mark.parametrize(
    ("timestep", "expected"),
    [
        ("1 ms", {"iterations": 1}),
        ("1.01 ms", {"iterations": 2}),
        ("8 ms", {"iterations": 2}),
        ("9 ms", {"iterations": 3, "more": 1}),
    ],
)
def test_settings_follow_from_the_timestep(timestep, expected):
    assert settings(ENTRIES, timestep) == {"tolerance": 0.5, **expected}


def test_bounds_rise_and_entries_say_something():
    with pytest.raises(SpecError, match="bounds must rise"):
        settings(ENTRIES[::-1])
    with pytest.raises(SpecError, match="bounds must rise"):
        settings([ENTRIES[0], ENTRIES[0]])
    with pytest.raises(SpecError, match="no settings"):
        settings([{"above": "1 ms", "settings": {}}])
    with pytest.raises(SpecError, match="above is missing"):
        settings([{"settings": {"iterations": 2}}])


AT_TIMESTEP = """\
simspec: 1
name: m
physics: {timestep: 4 ms}
bodies: {a: {fixed: true}}
engines:
  dart:
    settings: {iterations: 1}
    at_timestep:
      - above: 1 ms
        settings: {iterations: 2}
"""


def test_a_setting_that_is_put_in_without_effect_is_an_error(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(AT_TIMESTEP, encoding="utf-8")
    with pytest.raises(SpecError, match="at_timestep sets iterations") as error:
        load(path, sets=["engines.dart.settings.iterations=9"])
    (problem,) = error.value.problems
    assert (problem.location.file, problem.location.line) == ("--set", 1)
    assert problem.hint == "engines.dart.at_timestep.0.settings.iterations"
    spec = load(path, sets=[f"{problem.hint}=9"])
    assert dict(spec.resolve().options("dart").settings) == {"iterations": 9}
    smaller = load(path, sets=["engines.dart.settings.iterations=9", "physics.timestep=1ms"])
    assert dict(smaller.resolve().options("dart").settings) == {"iterations": 9}


def test_a_setting_is_located_where_it_comes_from(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(AT_TIMESTEP, encoding="utf-8")
    assert load(path).locate("engines.dart.settings.iterations").line == 10
    assert load(path, sets=["physics.timestep=1ms"]).locate("engines.dart.settings.iterations").line == 7
