"""Parameters of models: references, values, dimensions, nested models, sweeps, and everything that can be wrong with them."""

from __future__ import annotations

import math

import pytest

from simspec.errors import SpecError
from simspec.language.formatting import format_text
from simspec.language.load import Spec, load
from simspec.language.overrides import Override
from simspec.language.parameters import LONGEST_REFERENCE, MOST_PARAMETERS, read_reference
from simspec.language.strict import Faults
from tests.files import write

LEG = """simspec: 1
name: leg
model:
  parameters:
    length: {dimension: length, default: 0.2 m, description: Length of the rod}
    radius: {dimension: length, default: 0.1 * $length}
    swing: {dimension: angle, default: 30 deg}
    density: {dimension: density, default: 1 g/cm^3}
    drag: {dimension: number, default: 2}
  bodies:
    rod:
      joint:
        type: hinge
        axis: [0, $drag, 0]
        limits: {position: [-$swing, 2 * $swing]}
        position: $swing / 2
      shapes:
        - capsule: {radius: $radius, length: $length - 2 * $radius}
          pose: {xyz: [0, 0, -$length / 2]}
          density: $density
  states:
    out:
      positions:
        rod_joint: $swing
"""
CONTACT = {"materials": {"rubber": {"friction": 0.5}}}
SCENE = "simspec: 1\nname: scene\ncontact: {{materials: {{rubber: {{friction: 0.5}}}}}}\nmodels:\n  leg: {{{}}}\n"


def files(folder, **texts):
    return write({f"{name}.yaml": text for name, text in texts.items()}, folder)


def placed(folder, leg=LEG, **words):
    (folder / "leg.yaml").write_text(leg)
    data = {"name": "scene", "contact": CONTACT}
    return Spec.from_data({**data, "models": {"leg": {"use": "leg.yaml", **words}}}, folder=folder)


def rod(spec):
    return spec.resolve().bodies[0]


def problems(folder, leg=LEG, **words):
    with pytest.raises(SpecError) as error:
        placed(folder, leg, **words)
    return error.value.problems


def test_defaults_stand_where_nothing_else_is_given(tmp_path):
    body = rod(placed(tmp_path))
    assert body.shapes[0].size == (0.02, 0.2 - 2 * 0.02)
    assert body.shapes[0].pose.position == (0.0, 0.0, -0.1)
    assert body.joint.position_limits == (-math.pi / 6, math.pi / 3)
    assert body.joint.position == (math.pi / 12,)


def test_a_placement_sets_them_with_units_of_their_dimension(tmp_path):
    body = rod(placed(tmp_path, state="out", **{"with": {"length": "30 cm", "swing": 0.5, "density": "2 kg/l"}}))
    assert body.shapes[0].size == (0.03, pytest.approx(0.24, abs=1e-17))
    assert body.joint.position == (0.5,)
    default = rod(placed(tmp_path, **{"with": {"length": "30 cm"}}))
    assert body.inertial.mass == pytest.approx(2 * default.inertial.mass, rel=1e-15)


def test_a_model_equals_that_with_the_numbers_written_out(tmp_path):
    plain = LEG.partition("  parameters:")[0] + "  bodies:" + LEG.partition("  bodies:")[2]
    for name, number in {
        "length - 2 * $radius": "0.24 m", "length / 2": "0.15", "radius": "0.03", "swing / 2": "15 deg", "drag": "2",
        "density": "1000", "length": "0.3",
    }.items():  # fmt: skip
        plain = plain.replace(f"${name}", number)
    plain = plain.replace("2 * $swing", "60 deg").replace("$swing", "30 deg")
    assert "$" not in plain
    assert placed(tmp_path, **{"with": {"length": 0.3}}).resolve() == placed(tmp_path, plain).resolve()


def test_overrides_and_sweeps_set_them_by_path(tmp_path):
    files(tmp_path, leg=LEG, scene=SCENE.format("use: leg.yaml"))
    for sets, length in ((["models.leg.with.length=0.5"], 0.5), (["models.leg.with={length: 40 cm}"], 0.4), ([], 0.2)):
        assert rod(load(tmp_path / "scene.yaml", sets=sets)).shapes[0].size[0] == pytest.approx(length / 10)
    assert rod(load(tmp_path / "leg.yaml", sets=["model.parameters.length.default=1 m"])).shapes[0].size[0] == 0.1
    sweep = "physics: {duration: 1 s}\nsweep: {over: {models.leg.with.length: [0.1 m, 0.4 m]}}\n"
    (tmp_path / "scene.yaml").write_text(SCENE.format("use: leg.yaml") + sweep)
    spec = load(tmp_path / "scene.yaml")
    (path, lengths) = next(iter(spec.data.sweep.over.items()))
    found = [spec.with_overrides([Override(path, length, None, None)]) for length in lengths]
    assert [rod(each).shapes[0].size[0] for each in found] == [0.01, pytest.approx(0.04)]
    for path, values, message in (
        ("lenght", "[1 m]", "the model has no parameter 'lenght'"),
        ("length", "[1 kg]", "wrong unit: expected a length (m), found 'kg'"),
        ("length", "[0.2, 20 cm]", "this value of models.leg.with.length is duplicated"),
    ):
        text = SCENE.format("use: leg.yaml") + f"sweep: {{over: {{models.leg.with.{path}: {values}}}}}\n"
        (tmp_path / "scene.yaml").write_text(text)
        with pytest.raises(SpecError) as error:
            load(tmp_path / "scene.yaml")
        assert [problem.message for problem in error.value.problems] == [message]
        assert error.value.problems[0].location.line == 6
    (tmp_path / "scene.yaml").write_text(SCENE.format("use: leg.yaml"))
    with pytest.raises(SpecError, match="expected a length"):
        load(tmp_path / "scene.yaml", sets=["models.leg.with.length=3 kg"])


def test_nested_models_pass_parameters_on(tmp_path):
    outer = """simspec: 1
name: outer
model:
  parameters: {size: {dimension: length, default: 0.4 m}}
  use: leg.yaml
  with: {length: 2 * $size, radius: $size / 8}
"""
    files(tmp_path, leg=LEG, outer=outer, scene=SCENE.format("use: outer.yaml, with: {size: 0.1 m}"))
    assert rod(load(tmp_path / "scene.yaml")).shapes[0].size == (0.0125, 0.2 - 0.025)
    assert rod(load(tmp_path / "outer.yaml")).shapes[0].size == (0.05, pytest.approx(0.7))
    (tmp_path / "outer.yaml").write_text(outer.replace("length: 2 * $size", "length: 2 * $swing"))
    with pytest.raises(SpecError) as error:
        load(tmp_path / "scene.yaml")
    (problem,) = error.value.problems
    assert (problem.location.line, problem.path) == (6, "model.with.length")
    assert (problem.message, problem.allowed) == ("the model has no parameter 'swing'", "$size")


def test_values_go_with_the_copies_of_an_array_and_with_a_mirror(tmp_path):
    spec = placed(tmp_path, mirror="z", array={"line": 2, "step": [1, 0, 0]}, **{"with": {"length": 0.3}})
    assert [body.shapes[0].pose.position for body in spec.resolve().bodies] == [(0.0, 0.0, 0.15)] * 2


def test_a_spec_with_parameters_keeps_its_text(tmp_path):
    files(tmp_path, leg=LEG)
    assert load(tmp_path / "leg.yaml").to_yaml() == LEG == format_text(LEG, "leg.yaml")
    again = Spec.from_data(load(tmp_path / "leg.yaml").data)
    assert again.resolve() == load(tmp_path / "leg.yaml").resolve()


# --- what is wrong ------------------------------------------------------------------------------------------------------

WRONG = {
    "unknown parameter": ({"lenght": 1}, "", "the model has no parameter 'lenght'", "did you mean 'length'?"),
    "wrong unit": ({"length": "2 kg"}, "", "wrong unit: expected a length (m), found 'kg'", None),
    "no number": ({"length": "long"}, "", "expected a number, with or without a unit", None),
    "refers to nothing": ({"length": "$other"}, "", "a scenario has no parameters that this could refer to",
                          "a number with a unit"),
    "missing": ({}, ("default: 0.2 m, ", ""), "the parameter 'length' of the model has no value", "with: {length: 0.1 m}"),
    "unused": ({}, ("$density", "1"), "no quantity of the model refers to the parameter 'density'",
               "remove it, or write $density where it counts"),
    "unknown reference": ({}, ("$radius,", "$radios,"), "the model has no parameter 'radios'", "did you mean 'radius'?"),
    "cycle": ({}, ("0.2 m", "$radius"), "the defaults of these parameters refer to each other", None),
    "own default": ({}, ("0.2 m", "$length"), "the defaults of these parameters refer to each other", None),
    "wrong dimension": ({}, ("density: $density", "density: $length"),
                        "wrong unit: expected a density (kg/m³), found 'm'", None),
    "sum of dimensions": ({}, ("$length - 2", "$swing - 2"), "a sum of different dimensions", None),
    "product": ({}, ("$length - 2", "$length * $"), "not a reference to parameters",
                "simspec knows no other arithmetic; declare a parameter for what is not such a sum"),
    "constant": ({}, ("$length - 2 * $radius", "$length - 1 mm"), "not a reference to parameters",
                 "simspec knows no other arithmetic; declare a parameter for what is not such a sum"),
    "division": ({}, ("$length / 2]", "$length / 0]"), "a division by 0", None),
    "bounds": ({"radius": "-1 mm"}, "", "must be above 0", None),
    "unknown dimension": ({}, ("dimension: angle", "dimension: angel"), "not an allowed word", "did you mean 'angle'?"),
    "hyphen": ({}, ("    drag:", "    drag-area:"), "not a valid name of a parameter", "did you mean 'drag_area'?"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_errors_are_reported_once_with_the_way_out(case, tmp_path):
    values, change, message, hint = WRONG[case]
    leg = LEG.replace(*change) if change else LEG
    assert not change or leg != LEG
    found = problems(tmp_path, leg, **({"with": values} if values else {}))
    messages = [problem.message for problem in found]
    assert message in messages
    problem = found[messages.index(message)]
    assert problem.hint == hint
    expected = {"wrong dimension": 2, "hyphen": 2}.get(case, 1)  # the parameter that nothing refers to any more, too
    assert len(found) == expected


def test_errors_name_the_place_where_the_value_is_written(tmp_path):
    files(tmp_path, leg=LEG, scene=SCENE.format("use: leg.yaml, with: {radius: 1 kg}"))
    with pytest.raises(SpecError) as error:
        load(tmp_path / "scene.yaml")
    assert [str(problem.location).endswith("scene.yaml:5:39") for problem in error.value.problems] == [True]
    (tmp_path / "scene.yaml").write_text(SCENE.format("use: leg.yaml, with: {radius: -1 mm}"))
    with pytest.raises(SpecError) as error:
        load(tmp_path / "scene.yaml")
    (problem,) = error.value.problems
    assert (problem.location.line, problem.found) == (18, "'-0.001 m', from '$radius'")
    with pytest.raises(SpecError) as error:
        load(tmp_path / "scene.yaml", sets=["models.leg.with.radius=1 rad"])
    assert str(error.value.problems[0].location) == "--set:1:24"


def test_a_reference_in_a_scenario_is_an_error(tmp_path):
    data = {"name": "scene", "bodies": {"a": {"mass": "$heavy", "inertia": {"principal": [1, 1, 1]}}}}
    with pytest.raises(SpecError) as error:
        Spec.from_data(data)
    assert "only quantities of the `model` that declares it" in error.value.problems[0].hint


def test_a_model_without_a_value_does_not_stand_alone(tmp_path):
    files(tmp_path, leg=LEG.replace("default: 0.2 m, ", ""))
    with pytest.raises(SpecError) as error:
        load(tmp_path / "leg.yaml")
    assert error.value.problems[0].hint == "a default, or --set model.parameters.length.default=…"
    assert load(tmp_path / "leg.yaml", sets=["model.parameters.length.default=0.3"]).resolve()


@pytest.mark.parametrize(
    "text",
    [
        "$a $b", "$a +", "+", "$", "$1", "2", "$a + 2", "($a)", "$a ** 2", "$a * $b", "sin($a)", "$a / 2 / 2", "$a.b",
        "$a - - $b", "$a / 2.5.1", "$a" + " + $a" * LONGEST_REFERENCE, "__import__('os')$a",
    ],
)  # fmt: skip
def test_only_sums_of_parameters_are_read(text):
    with pytest.raises(Faults):
        read_reference(text)


def test_words_about_the_model_of_a_file_need_a_file():
    for word, value in (("with", {"a": 1}),):
        with pytest.raises(SpecError, match=f"`{word}` goes with `use`"):
            Spec.from_data({"name": "scene", "models": {"a": {"bodies": {"b": {"fixed": True}}, word: value}}})
    for word, value in (("with", {"a": 1}), ("mirror", "x")):
        with pytest.raises(SpecError, match=f"`{word}` goes with `use`"):
            Spec.from_data({"name": "scene", "model": {"bodies": {"b": {"fixed": True}}, word: value}})


def test_a_long_chain_of_defaults_is_read_and_more_parameters_are_an_error(tmp_path):
    def model(count):
        chain = "".join(f"    p{n}: {{dimension: length, default: $p{n + 1}}}\n" for n in range(count - 1))
        start, end = LEG.split("    length:")[0], LEG.partition("  bodies:")[2]
        last = f"    p{count - 1}: {{dimension: length, default: 0.3}}\n"
        plain = {"$length - 2 * $radius": "0.2", "$length / 2": "0.1", "$radius": "$p0", "$density": "1", "$drag": "1"}
        for reference, number in {**plain, "2 * $swing": "1", "$swing / 2": "0.5", "$swing": "1"}.items():
            end = end.replace(reference, number)
        return f"{start}{chain}{last}  bodies:{end}"

    assert rod(placed(tmp_path, model(MOST_PARAMETERS))).shapes[0].size[0] == 0.3
    messages = [problem.message for problem in problems(tmp_path, model(MOST_PARAMETERS + 1))]
    assert "too many parameters" in messages


def test_a_file_that_is_used_in_too_many_ways_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr("simspec.language.sources.MOST_EXPANDED", 200)
    files(tmp_path, leg=LEG)
    models = {f"leg_{n}": {"use": "leg.yaml", "with": {"length": n + 1}} for n in range(5)}
    with pytest.raises(SpecError) as error:
        Spec.from_data({"name": "scene", "contact": CONTACT, "models": models}, folder=tmp_path)
    assert [problem.message.partition(":")[0] for problem in error.value.problems] == [
        "model files that are used in too many different ways"
    ]
