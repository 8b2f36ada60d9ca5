"""Numbers of a run by name."""

from __future__ import annotations

import contextlib

import pytest

import simspec
from simspec.analysis.speed import figure_names, find_figure, half_width, read_figure
from simspec.comparison.runs import summary
from simspec.errors import SpecError
from simspec.runner.expectations import evaluate

pytestmark = pytest.mark.usefixtures("warm_engines")


@pytest.fixture(scope="module")
def run():
    spec = simspec.load(simspec.find_spec("box-on-ramp"), sets=("physics.duration=0.05",))
    return simspec.run(spec.resolve(), "mujoco")


def test_every_figure_of_a_run_is_found_by_its_name(run):
    names = figure_names(run.world)
    assert len(names) == len(set(names))
    read = {}
    for name in names:
        assert find_figure(run.world, name) == name
        with contextlib.suppress(SpecError):
            read[name] = read_figure(run, name)
    with pytest.raises(SpecError, match="has no largest error of a driven hinge: its channels were not recorded"):
        read_figure(run, "largest error of a driven hinge")
    assert {"expectation 1 displacement", "rough_box.z", "rough_box.vx", "deepest penetration"} <= set(read)
    assert read["rough_box.z"].value == run.q("rough_box.z")[-1]
    assert read["rough_box.vx"].value == run.v("rough_box.vx")[-1]
    assert read["deepest penetration"].value == summary(run)["deepest penetration"]
    assert read["expectation 2 displacement"].value == evaluate(run)[1].measured
    units = ("m", "m", "m", "m/s", "rad/s", "")
    shown = (
        "expectation 1 displacement",
        "deepest penetration",
        "slick_box.x",
        "slick_box.vz",
        "slick_box.wx",
        "slick_box.qw",
    )
    assert tuple(read[name].unit for name in shown) == units


@pytest.mark.parametrize(
    ("word", "name"),
    [
        ("deepest_penetration", "deepest penetration"),
        ("Contacts-mean", "contacts, mean"),
        ("expectation 2", "expectation 2 displacement"),
        ("expectation_1", "expectation 1 displacement"),
    ],
)
def test_other_ways_to_write_a_name(run, word, name):
    assert find_figure(run.world, word) == name


@pytest.mark.parametrize("word", ["deepest penetratoin", "displacement", "", "rough_box", "expectation 3"])
def test_an_unknown_figure_is_an_error_with_the_names(run, word):
    """Two expectations are of one kind: the kind alone says neither."""
    with pytest.raises(SpecError) as caught:
        find_figure(run.world, word)
    (problem,) = caught.value.problems
    assert "expectation 1 displacement" in problem.allowed
    assert caught.value.exit_code == 2


def test_a_kind_that_is_there_once_is_a_name():
    world = simspec.load(simspec.find_spec("box-on-box")).resolve()
    assert find_figure(world, "displacement") == "expectation 1 displacement"


def test_the_resolution_is_three_times_the_noise_and_at_least_round_off(run):
    assert half_width(run, 1.0, 0.0) == run.provenance["steps"] * 2.0**-52
    assert half_width(run, 1.0, 1e-3) == 1.5e-3
