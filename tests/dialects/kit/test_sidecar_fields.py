"""Sidecars whose fields are not those of their format are refused, with the place."""

from __future__ import annotations

import copy
import dataclasses
import json
import re
from collections.abc import Mapping
from types import SimpleNamespace

import pytest

from simspec.compiler import compile_world
from simspec.dialects.dart.sidecar import DartSidecar
from simspec.dialects.kit.sidecar import SIDECAR, Sidecar, SidecarBody, sidecar_text
from simspec.dialects.pybullet.sidecar import PybulletSidecar
from simspec.formats.kit.forms import NamePairs, Names, form_of
from simspec.proof.selftest_worlds import WORLDS
from tests.files import setting
from tests.planted import SHARED


@pytest.fixture(scope="module")
def sound():
    return json.loads(compile_world(WORLDS["model"]("pybullet"), ["pybullet"])["pybullet"].files[SIDECAR])


@pytest.mark.parametrize("name", [name for name in SHARED if name != "rolling"])
def test_the_emitters_are_of_the_form(name):
    PybulletSidecar.of(json.loads(compile_world(WORLDS[name]("pybullet"), ["pybullet"])["pybullet"].files[SIDECAR]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda content: content.pop("gravity"), "lacks the fields"),
        (setting(1, "more"), "'more'"),
        (setting(True, "timestep"), "sidecar.timestep is True, should be a finite number"),
        (setting(float("nan"), "timestep"), "sidecar.timestep"),
        (setting("x", "schema"), "sidecar.schema"),
        (setting({}, "springs"), "sidecar.springs is {}, should be a list"),
        (setting([], "collision_filter"), "sidecar.collision_filter is [], should be an object"),
        (setting([1.0], "gravity"), "has 1 entries, should have 3"),
        (setting([0.0] * 3, "instances", 2, "position"), "sidecar.instances.2.position has 3 numbers, should have 7"),
        (setting("static", "instances", 0, "root"), "sidecar.instances.0.root"),
        (setting([], "instances", 1, "joints"), "sidecar.instances.1.joints"),
        (setting([[4]], "instances", 0, "visual_only"), "visual_only"),
        (lambda content: content["bodies"].append(copy.deepcopy(content["bodies"][0])), "twice"),
        (lambda content: content["springs"].append(content["springs"][0]), "sidecar.springs has 'upper' twice"),
        (setting("nobody", "springs", 0, "body"), "'nobody'"),
        (setting("planar", "bodies", 3, "kind"), "'planar'"),
        (lambda content: content["collision_filter"]["classes"][0]["links"].append("cube"), "twice"),
    ],
)
def test_other_sidecars_are_rejected(sound, change, said):
    content = copy.deepcopy(sound)
    change(content)
    with pytest.raises(ValueError, match=re.escape(said)):
        PybulletSidecar.of(content)


@pytest.fixture(scope="module")
def skel():
    return json.loads(compile_world(WORLDS["surfaces"]("dart"), ["dart"])["dart"].files[SIDECAR])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda content: content["models"].pop(), "sidecar.models has 3 entries for 4 bodies"),
        (
            lambda content: content["shapes"][0]["surfaces"].append(content["shapes"][0]["surfaces"][0]),
            "surfaces has 0 twice",
        ),
        (setting([], "filter", "classes", "more"), "sidecar.filter.classes"),
        (setting({"more": []}, "groups"), "sidecar.groups"),
        (setting([["ice", "rubber", "x"]], "filter", "layers"), "sidecar.filter.layers"),
        (lambda content: content["excluded"].append(["floor", "nobody"]), "'nobody'"),
        (setting("round", "friction_cone"), "'round'"),
        (setting(None, "settings"), "sidecar.settings is None, should be an object"),
    ],
)
def test_sidecars_with_other_than_skel_fields_are_rejected(skel, change, said):
    DartSidecar.of(skel)
    content = copy.deepcopy(skel)
    change(content)
    with pytest.raises(ValueError, match=re.escape(said)):
        DartSidecar.of(content)


@dataclasses.dataclass(frozen=True, slots=True)
class Spring:
    body: str
    stiffness: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Whole(Sidecar):
    springs: tuple[Spring, ...]
    layers: tuple[tuple[str, str, int | None], ...]
    groups: Mapping[str, Names]
    pairs: NamePairs
    threshold: float
    sleepers: Names | None = None

    def check(self):
        if self.threshold < 0.0:
            raise ValueError("sidecar.threshold is below zero")


WHOLE = Whole(
    dialect="d",
    format="f",
    engine="e",
    world="w",
    settings={"iterations": 1},
    bodies=(SidecarBody("b", "free", (0.0, 1.0, 0.0)),),
    friction_cone="elliptic",
    springs=(Spring("b", 1.0),),
    layers=(("a", "b", None), ("a", "c", 2)),
    groups={"g": ("x", "y")},
    pairs=(("a", "b"), ("b", "a")),
    threshold=1.0,
)


@pytest.mark.parametrize("whole", [WHOLE, dataclasses.replace(WHOLE, sleepers=("b",))])
def test_a_dataclass_is_the_form_of_its_json(whole):
    plain = json.loads(sidecar_text(whole.plain()))
    assert ("sleepers" in plain) == (whole.sleepers is not None)
    assert Whole.of(plain) == whole
    assert isinstance(Whole.of({**plain, "threshold": 1}).threshold, float)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("springs", [{"body": "b"}], "sidecar.springs.0 lacks the fields ['stiffness']"),
        (
            "springs",
            [{"body": "b", "stiffness": True}],
            "sidecar.springs.0.stiffness is True, should be a finite number",
        ),
        ("layers", [["a", "b"]], "sidecar.layers.0 is ['a', 'b'], should be a list of 3"),
        ("layers", [["a", "b", "c"]], "sidecar.layers.0.2 is 'c', should be a whole number"),
        ("groups", {"g": ["x", "x"]}, "sidecar.groups.g has 'x' twice"),
        ("pairs", [["a", "b", "c"]], "sidecar.pairs.0 has 3 entries, should have 2"),
        ("sleepers", None, "sidecar.sleepers is None, should be a list"),
        ("threshold", -1, "sidecar.threshold is below zero"),
        ("more", 1, "which are not known"),
        ("friction_cone", "round", "'round', which is not known"),
    ],
)
def test_json_of_another_form_is_refused(field, value, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        Whole.of({**json.loads(sidecar_text(WHOLE.plain())), field: value})


def test_an_annotation_without_a_form_is_an_error():
    with pytest.raises(TypeError, match="has no form"):
        form_of(set[str])


def test_settings_of_a_pair_hold_in_either_order_and_for_no_other_shapes():
    pair = SimpleNamespace(shapes=(("a", "b"), ("c",)), settings={"margin": 2.0})
    sidecar = SimpleNamespace(settings={"margin": 1.0, "solver": "newton"}, pair_settings=(pair,))

    def between(*shapes):
        return Sidecar.settings_between(sidecar, *shapes)

    assert between("a", "c") == between("c", "b") == {"margin": 2.0, "solver": "newton"}
    for shapes in (("a", "b"), ("c", "c"), ("c", "d"), ("d", "a")):
        assert between(*shapes) == sidecar.settings
