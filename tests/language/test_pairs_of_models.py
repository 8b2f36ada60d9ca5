"""Laws of pairs of materials that a model file says."""

from __future__ import annotations

from pathlib import Path

import pytest

from simspec.errors import SpecError
from simspec.language.load import load
from simspec.world.types import PairContact

MODEL = """simspec: 1
name: NAME
contact:
  materials: {rubber: {friction: 0.8}, steel: {friction: 0.2}}
  pairs: [PAIRS]
model:
  bodies:
    NAME:
      mass: 1
      inertia: {principal: [0.1, 0.1, 0.1]}
      shapes:
        - {sphere: {radius: 0.1}, material: rubber}
        - {sphere: {radius: 0.1}, material: steel, pose: {xyz: [1, 0, 0]}}
"""
SCENARIO = """simspec: 1
name: placed
contact: {pairs: [PAIRS]}
models: {one: {use: one.yaml}, two: {use: two.yaml, pose: {xyz: [5, 0, 0]}}}
"""


def laws(folder: Path, entry: str, two: str, text: str = "") -> dict[tuple[str, str], PairContact]:
    for name, pairs in (("one", entry), ("two", two)):
        (folder / f"{name}.yaml").write_text(MODEL.replace("NAME", name).replace("PAIRS", pairs))
    path = folder / "placed.yaml"
    path.write_text(SCENARIO.replace("PAIRS", text))
    return {(pair.first, pair.second): pair for pair in load(path).resolve().contact.pairs}


def test_a_scenario_has_the_pairs_of_its_models(tmp_path):
    found = laws(tmp_path, "{between: [steel, rubber], friction: 0.55}", "{between: [steel, steel], collide: false}")
    assert found["rubber", "steel"].friction == 0.55
    assert not found["steel", "steel"].collide
    assert found["rubber", "rubber"].friction == 0.8


def test_pairs_of_the_scenario_replace_pairs_of_models(tmp_path):
    said = "{between: [steel, rubber], friction: 0.55, margin: 1 mm}"
    found = laws(tmp_path, said, said.replace("0.55", "0.6"), "{between: [rubber, steel], friction: 0.1}")
    assert (found["rubber", "steel"].friction, found["rubber", "steel"].margin) == (0.1, None)


def test_two_models_agree_on_a_pair(tmp_path):
    said = "{between: [steel, rubber], friction: 0.55}"
    assert laws(tmp_path, said, said)["rubber", "steel"].friction == 0.55
    with pytest.raises(SpecError, match="the pair rubber and steel has another law in another file"):
        laws(tmp_path, said, said.replace("0.55", "0.6"))


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ("{between: [steel, wood], friction: 1}", "there is no material 'wood'"),
        ("{between: [steel, steel], friction: 1}, {between: [steel, steel], friction: 1}", "is duplicated"),
        ("{between: [steel, steel], hardness: {stiffness: 1e9, damping: 0}}", "the timestep is too large"),
    ],
)
def test_problems_of_a_model_file_are_located_in_that_file(tmp_path, pairs, message):
    with pytest.raises(SpecError, match=message) as error:
        laws(tmp_path, pairs, "")
    assert [problem.location.file.endswith("one.yaml") for problem in error.value.problems] == [True]
