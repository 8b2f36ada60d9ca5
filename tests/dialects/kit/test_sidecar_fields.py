"""Sidecars whose fields are not those of their format are refused, with the place."""

from __future__ import annotations

import copy
import json
import re

import pytest

from simspec.compiler import compile_world
from simspec.dialects.dart import sidecar as skel_sidecar
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.dialects.pybullet.sidecar import check_sidecar
from simspec.proof.selftest_worlds import WORLDS


@pytest.fixture(scope="module")
def sound():
    return json.loads(compile_world(WORLDS["model"]("pybullet"), ["pybullet"])["pybullet"].files[SIDECAR])


@pytest.mark.parametrize("name", [name for name in WORLDS if name != "rolling"])
def test_the_emitters_are_of_the_form(name):
    check_sidecar(json.loads(compile_world(WORLDS[name]("pybullet"), ["pybullet"])["pybullet"].files[SIDECAR]))


def _set(value, *path):
    def change(content):
        for key in path[:-1]:
            content = content[key]
        content[path[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda content: content.pop("gravity"), "lacks the fields"),
        (_set(1, "more"), "'more'"),
        (_set(True, "timestep"), "sidecar.timestep is True, should be a finite number"),
        (_set(float("nan"), "timestep"), "sidecar.timestep"),
        (_set("x", "schema"), "sidecar.schema"),
        (_set({}, "springs"), "sidecar.springs is {}, should be a list"),
        (_set([], "collision_filter"), "sidecar.collision_filter is [], should be an object"),
        (_set([1.0], "gravity"), "has 1 entries, should have 3"),
        (_set([0.0] * 3, "instances", 2, "position"), "sidecar.instances.2.position has 3 numbers, should have 7"),
        (_set("static", "instances", 0, "root"), "sidecar.instances.0.root"),
        (_set([], "instances", 1, "joints"), "sidecar.instances.1.joints"),
        (_set([[4]], "instances", 0, "visual_only"), "visual_only"),
        (lambda content: content["bodies"].append(copy.deepcopy(content["bodies"][0])), "twice"),
        (lambda content: content["springs"].append(content["springs"][0]), "sidecar.springs has 'upper' twice"),
        (_set("nobody", "springs", 0, "body"), "'nobody'"),
        (_set("planar", "bodies", 3, "kind"), "'planar'"),
        (lambda content: content["collision_filter"]["classes"][0]["links"].append("cube"), "twice"),
    ],
)
def test_what_is_not_is_refused(sound, change, said):
    content = copy.deepcopy(sound)
    change(content)
    with pytest.raises(ValueError, match=re.escape(said)):
        check_sidecar(content)


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
        (_set([], "filter", "classes", "more"), "sidecar.filter.classes"),
        (_set({"more": []}, "groups"), "sidecar.groups"),
        (_set([["ice", "rubber", "x"]], "filter", "layers"), "sidecar.filter.layers"),
        (lambda content: content["excluded"].append(["floor", "nobody"]), "'nobody'"),
        (_set("round", "friction_cone"), "'round'"),
        (_set(None, "settings"), "sidecar.settings is None, should be an object"),
    ],
)
def test_what_is_not_of_a_skel_is_refused(skel, change, said):
    skel_sidecar.check_sidecar(skel)
    content = copy.deepcopy(skel)
    change(content)
    with pytest.raises(ValueError, match=re.escape(said)):
        skel_sidecar.check_sidecar(content)
