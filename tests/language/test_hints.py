"""Hints for words of other languages: each hint names an existing word."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.language.load import Spec
from simspec.language.reference import json_schema
from simspec.language.words import entries, hint_for_key, hint_for_word, hints

SCHEMA = json_schema()
MODELS = {**SCHEMA["definitions"], "File": SCHEMA}


def words_of(node) -> set[str]:
    """The words that a schema allows, anywhere in it."""
    if isinstance(node, dict):
        found = set(node.get("enum", ())) if all(isinstance(word, str) for word in node.get("enum", ())) else set()
        return found.union(*(words_of(value) for value in node.values()))
    return set().union(*map(words_of, node)) if isinstance(node, list) else set()


@pytest.mark.parametrize("target", sorted({target for _, hint in entries() for target in hint.targets}))
def test_every_target_is_in_the_language(target):
    place, _, word = target.partition("=")
    model, _, field = place.partition(".")
    properties = MODELS[model]["properties"]
    assert field in properties
    if word:
        assert word in words_of(properties[field])


def test_every_hint_names_its_targets_and_is_of_models_that_there_are():
    for word, hint in entries():
        assert hint.targets or "not supported yet" in hint.text or "remove it" in hint.text, word
        for target in hint.targets:
            name = target.partition("=")[2] or target.rpartition(".")[2]
            assert name.removesuffix("s") in hint.text or name in ("shapes", "joint", "xyz", "rpy"), (word, target)
        for model in hint.models:
            assert model in MODELS, (word, model)
            # a word that the model has is never unknown there: its hint would be dead
            assert word not in MODELS[model]["properties"], (word, model)


def test_no_word_has_two_meanings_in_a_model():
    for word, meanings in hints().items():
        places = [model for hint in meanings for model in hint.models]
        assert len(places) == len(set(places)), word
        everywhere = [
            hint for hint in meanings if not hint.models and not any("=" in target for target in hint.targets)
        ]
        assert len(everywhere) <= 1, word


BODY = {"mass": 1, "shapes": [{"sphere": {"radius": 0.1}}]}


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"joint": {"type": "revolute", "axis": [0, 0, 1]}}, "type: hinge"),
        ({"joint": {"type": "prismatic", "axis": [0, 0, 1]}}, "type: slide"),
        ({"joint": {"type": "continuous", "axis": [0, 0, 1]}}, "type: hinge, without limits"),
        ({"joint": {"type": "floating"}}, "type: free"),
        ({"joint": {"type": "Revolute", "axis": [0, 0, 1]}}, "type: hinge"),
        ({"shapes": [{"trimesh": "a.stl"}]}, "mesh: {file: ...}"),
        ({"shapes": [{"box": {"half_size": [1, 1, 1]}}]}, "size, twice as much"),
        ({"shapes": [{"box": {"halfSize": [1, 1, 1]}}]}, "size, twice as much"),
        ({"shapes": [{"cylinder": {"radius": 1, "height": 1}}]}, "in simspec: length"),
        ({"ixx": 1}, "inertia: {tensor: {xx:"),
        ({"com": [0, 0, 0]}, "centre_of_mass"),
        ({"pos": [0, 0, 0]}, "pose: {xyz:"),
        ({"position": [0, 0, 0]}, "pose: {xyz:"),
        ({"rpy": [0, 0, 0]}, "pose: {rpy:"),
        ({"pose": {"position": [0, 0, 0]}}, "in simspec: xyz"),
        ({"origin": {"xyz": [0, 0, 0]}}, "joint: {origin:"),
        ({"shapes": [{"sphere": {"radius": 0.1}, "mu": 0.5}]}, "friction, of a material"),
        ({"shapes": [{"sphere": {"radius": 0.1}, "friction": 0.5}]}, "contact: {materials:"),
        ({"stiffness": 3}, "spring: {stiffness"),
        ({"joint": {"type": "hinge", "axis": [0, 0, 1], "stiffness": 3}}, "spring: {stiffness"),
        ({"joint": {"type": "hinge", "axis": [0, 0, 1], "lower": -1}}, "limits: {position: [lower, upper]}"),
        ({"joint": {"type": "hinge", "axis": [0, 0, 1], "limits": {"lower": -1}}}, "position: [lower, upper]"),
        ({"joint": {"type": "hinge", "axis": [0, 0, 1], "frictionloss": 1}}, "dry_friction"),
        ({"damping": 1}, "joint: {damping"),
        ({"geom": []}, "shapes: ["),
        ({"static": True}, "fixed: true"),
        ({"mas": 1}, "did you mean 'mass'?"),
    ],
)
def test_a_foreign_word_in_a_body_is_answered(body, words):
    with pytest.raises(SpecError) as error:
        Spec.from_data({"name": "x", "bodies": {"b": {**BODY, **body}}})
    hints = [problem.hint or "" for problem in error.value.problems]
    assert any(words in hint for hint in hints), hints


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ({"link": {}}, "bodies: {NAME"),
        ({"robot": {}}, "models: {NAME"),
        ({"physics": {"dt": 0.001}}, "in simspec: timestep"),
        ({"timestep": 0.001}, "physics: {timestep"),
        ({"contact": {"friction_cone": "pyramidal"}}, "pyramid-inscribed or pyramid-circumscribed"),
        ({"contact": {"contype": 1}}, "collision_group"),
        ({"record": {"channels": ["positions"]}}, "in simspec: 'pose'"),
        ({"actuator": {}}, "control: {NAME"),
    ],
)
def test_a_foreign_word_in_a_file_is_answered(file, words):
    with pytest.raises(SpecError) as error:
        Spec.from_data({"name": "x", "bodies": {"b": BODY}, **file})
    hints = [problem.hint or "" for problem in error.value.problems]
    assert any(words in hint for hint in hints), hints


def test_unknown_and_very_long_words_have_no_hint():
    assert hint_for_key("qwertz", "Body") is None
    assert hint_for_word("qwertz", ["hinge"]) is None
    assert hint_for_key("revolute" * 100_000, "Body") is None
    # a kind of joint that is written as a key, as in SDF's <joint type="revolute"> turned into YAML
    assert "type: hinge" in hint_for_key("revolute", "Joint")
    # a value is known for the words that may stand there, not for others
    assert hint_for_word("revolute", ["elliptic"]) is None
