"""Methods of integration as causes of a difference: the part that vanishes with the timestep."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.attribution.candidates import CandidateKind, probes
from simspec.attribution.configuration import Configuration
from simspec.attribution.declared import by_method, without_methods
from simspec.attribution.measure import Swap
from simspec.testing import worlds

WORLD = worlds.damped_springs()
COMMON = Configuration(WORLD, "dart")


def side(integrator):
    return Configuration(worlds.with_options(WORLD, "mujoco", settings=(("integrator", integrator),)), "mujoco")


def halved(pair, share):
    """The result of halving the timestep."""
    candidate = next(entry for entry in probes(pair) if entry.about == ("timestep",))
    shares = {"free": share}
    interval = {"free": (share - 0.01, share + 0.01)}
    swap = Swap(candidate.name, CandidateKind.REFINEMENT.value, "timestep", ("1 ms", "half"), {}, shares, interval)
    return [(candidate, swap)]


@pytest.mark.parametrize(
    ("integrator", "closed", "expected"), [("euler", 0.5, 1.0), ("euler", 0.4, 0.8), ("RK4", 0.5, 1.0)]
)
def test_half_the_timestep_closes_half_of_a_difference_of_methods_of_first_order(integrator, closed, expected):
    """Against semi-implicit Euler the difference is of first order, whatever the order of the other."""
    pair = (COMMON, side(integrator))
    (found,) = by_method(pair, halved(pair, closed), {})
    assert found.predicted
    assert found.share["free"] == pytest.approx(expected)
    assert found.engine == "MuJoCo"
    least, most = found.interval["free"]
    assert least < found.share["free"] <= most
    assert without_methods([found], {"free": 1.0, "contact": 0.3}) == pytest.approx(
        {"free": 1.0 - expected, "contact": 0.3}
    )


def test_it_is_a_part_of_the_rest_after_other_causes():
    pair = (COMMON, side("euler"))
    (found,) = by_method(pair, halved(pair, 0.5), {"free": 0.25})
    assert found.share["free"] == pytest.approx(0.25)


def test_sides_by_semi_implicit_euler_have_no_method_to_name():
    pair = (COMMON, side("common"))
    assert by_method(pair, halved(pair, 0.5), {}) == []


def test_a_swap_that_failed_says_nothing():
    pair = (COMMON, side("euler"))
    ((candidate, swap),) = halved(pair, 0.5)
    assert by_method(pair, [(candidate, dataclasses.replace(swap, failed="no"))], {}) == []
