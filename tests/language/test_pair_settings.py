"""Settings of pairs of materials: which hold at a timestep, where each comes from, and every problem at its place."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.errors import SpecError
from simspec.language.document import parse
from simspec.language.formatting import format_text
from simspec.language.load import Spec, load
from simspec.world.canonical import canonical_json, from_plain, sha256, to_plain
from simspec.world.types import World

SPEC = """\
simspec: 1
name: m
physics: {timestep: 1 ms}
contact:
  materials:
    finger: {}
    steel: {}
    wood: {}
bodies:
  a:
    fixed: true
engines:
  first:
    settings: {d: 0.1, k: 1}
    pairs:
      - {between: [wood, finger], settings: {d: 0.2}}
      - {between: [steel, steel], settings: {d: 0.3}}
    at_timestep:
      - above: 1 ms
        pairs:
          - {between: [finger, wood], settings: {d: 0.4, b: 2}}
      - above: 8 ms
        settings: {d: 0.5}
        pairs:
          - {between: [wood, finger], settings: {b: 3}}
"""
OF_FIRST = "engines.first"


def spec_of(tmp_path, text=SPEC, sets=()):
    path = tmp_path / "m.yaml"
    path.write_text(text, encoding="utf-8")
    return load(path, sets=sets)


def pairs_of(world):
    return {(pair.first, pair.second): dict(pair.settings) for pair in world.options("first").pairs}


@pytest.mark.parametrize(
    ("timestep", "expected"),
    [("1 ms", {"d": 0.2}), ("1.1 ms", {"d": 0.4, "b": 2}), ("8 ms", {"d": 0.4, "b": 2}), ("9 ms", {"d": 0.4, "b": 3})],
)
def test_settings_of_pairs_follow_from_the_timestep(timestep, expected, tmp_path):
    """Those of a pair replace the engine's at every timestep, also what ``at_timestep`` says for all contacts."""
    world = spec_of(tmp_path, sets=[f"physics.timestep={timestep}"]).resolve()
    assert pairs_of(world) == {("finger", "wood"): expected, ("steel", "steel"): {"d": 0.3}}
    assert dict(world.options("first").settings)["d"] == (0.5 if timestep == "9 ms" else 0.1)


names = st.sampled_from(["finger", "steel", "wood"])
values = st.dictionaries(st.sampled_from(["b", "d", "k"]), st.floats(0.0, 1.0), min_size=1)
lists = st.lists(st.tuples(names, names, values), max_size=4, unique_by=lambda pair: tuple(sorted(pair[:2])))


@settings(max_examples=60, deadline=None)
@given(lists, st.lists(lists, max_size=3), st.floats(0.5, 4.0))
def test_of_each_pair_and_setting_the_last_list_that_holds_counts(plain, entries, timestep):
    def written(pairs):
        return [{"between": [a, b], "settings": values} for a, b, values in pairs]

    options = {"pairs": written(plain)}
    options["at_timestep"] = [
        {"above": f"{index + 1} ms", "settings": {"x": 1}, "pairs": written(pairs)}
        for index, pairs in enumerate(entries)
    ]
    data = {
        "name": "m",
        "physics": {"timestep": f"{timestep} ms", "duration": 0},
        "contact": {"materials": {name: {} for name in ("finger", "steel", "wood")}},
        "bodies": {"a": {"fixed": True}},
        "engines": {"first": options},
    }
    world = Spec.from_data(data).resolve()
    expected = {}
    for index, pairs in enumerate([plain, *entries]):
        for a, b, local in pairs if index == 0 or timestep > index * (1 + 1e-9) else []:
            for name, value in local.items():
                expected[min(a, b), max(a, b), name] = value
    got = {(*pair, name): value for pair, local in pairs_of(world).items() for name, value in local.items()}
    assert got == expected
    assert list(pairs_of(world)) == sorted(pairs_of(world))
    assert from_plain(World, to_plain(world)) == world


def test_a_world_without_them_has_the_text_and_the_hash_of_before(tmp_path):
    plain = SPEC[: SPEC.index("    pairs:")]
    world = spec_of(tmp_path, plain).resolve()
    assert '"pairs"' not in canonical_json(world.options("first"))
    with_pairs = spec_of(tmp_path).resolve()
    assert '"pairs"' in canonical_json(with_pairs.options("first"))
    assert sha256(world) != sha256(with_pairs)


REFUSED = {
    "an unknown material": ("pairs.0.between=[woood, finger]", "pairs.0.between.0", "there is no material 'woood'"),
    "of an entry": (
        "at_timestep.1.pairs.0.between=[wood, fingre]",
        "at_timestep.1.pairs.0.between.1",
        "there is no material 'fingre'",
    ),
    "a pair twice": ("pairs.1.between=[finger, wood]", "pairs.1", "the pair finger and wood is duplicated"),
    "twice in an entry": (
        "at_timestep.0.pairs=[{between: [steel, wood], settings: {d: 1}}, {between: [wood, steel], settings: {b: 1}}]",
        "at_timestep.0.pairs.1",
        "the pair steel and wood is duplicated",
    ),
    "one material": ("pairs.0.between=[wood]", "pairs.0.between", "expected a list of 2 names"),
    "no settings": ("pairs.0.settings={}", "pairs.0.settings", "no settings"),
    "no settings and no pairs": ("at_timestep.0.pairs=[]", "at_timestep.0", "no settings"),
    "another word": ("pairs.0.materials=[wood, finger]", "pairs.0.materials", "the spec has no"),
    "no list": ("pairs={wood: 1}", "pairs", "expected a list"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_pair_settings_are_located_errors(name, tmp_path):
    change, path, message = REFUSED[name]
    with pytest.raises(SpecError) as error:
        spec_of(tmp_path, sets=[f"{OF_FIRST}.{change}"])
    (problem,) = error.value.problems
    assert problem.path == f"{OF_FIRST}.{path}"
    assert problem.location is not None
    assert message in str(problem)


WITHOUT_EFFECT = {
    "itself": "pairs.0.settings.d=0.9",
    "its settings": "pairs.0.settings={d: 0.9}",
    "all pairs": "pairs=[{between: [finger, wood], settings: {d: 0.9}}]",
}


@pytest.mark.parametrize("name", WITHOUT_EFFECT)
def test_an_override_without_effect_is_an_error(name, tmp_path):
    change = f"{OF_FIRST}.{WITHOUT_EFFECT[name]}"
    assert pairs_of(spec_of(tmp_path, sets=[change]).resolve())["finger", "wood"] == {"d": 0.9}
    with pytest.raises(SpecError, match="no effect: at_timestep sets d at this timestep") as error:
        spec_of(tmp_path, sets=["physics.timestep=2ms", change])
    (problem,) = error.value.problems
    assert (problem.path, problem.location.line) == (f"{OF_FIRST}.pairs.0.settings.d", 2)
    world = spec_of(tmp_path, sets=["physics.timestep=2ms", f"{problem.hint}=0.8"]).resolve()
    assert pairs_of(world)["finger", "wood"]["d"] == 0.8


def test_settings_put_in_all_together_are_not_lost_either(tmp_path):
    text = SPEC[: SPEC.index("    pairs:")] + SPEC[SPEC.index("    at_timestep:") :]
    spec_of(tmp_path, text, sets=[f"{OF_FIRST}.settings={{d: 0.7}}"])
    with pytest.raises(SpecError, match="at_timestep sets d") as error:
        spec_of(tmp_path, text, sets=["physics.timestep=9ms", f"{OF_FIRST}.settings={{d: 0.7, k: 2}}"])
    assert [problem.path for problem in error.value.problems] == [f"{OF_FIRST}.settings.d"]


@pytest.mark.parametrize(
    ("timestep", "name", "line"), [("1 ms", "d", 16), ("2 ms", "d", 21), ("9 ms", "d", 21), ("9 ms", "b", 25)]
)
def test_a_setting_is_found_where_the_spec_says_it(timestep, name, line, tmp_path):
    spec = spec_of(tmp_path, sets=[f"physics.timestep={timestep}"])
    assert spec.locate(f"{OF_FIRST}.pairs.finger.wood.{name}").line == line


def test_a_sweep_changes_them_by_their_path(tmp_path):
    text = SPEC + "sweep:\n  over:\n    engines.first.pairs.0.settings.d: [0.1, 0.2]\n"
    assert spec_of(tmp_path, text).data.sweep is not None
    with pytest.raises(SpecError, match="no such element"):
        spec_of(tmp_path, text.replace("pairs.0", "pairs.7"))


def test_the_layout_is_canonical():
    laid_out = format_text(SPEC, "m.yaml")
    assert laid_out == format_text(laid_out, "m.yaml")
    assert "    pairs:\n      - {between: [wood, finger], settings: {d: 0.2}}\n" in laid_out
    assert parse(laid_out, "m.yaml").data == parse(SPEC, "m.yaml").data
