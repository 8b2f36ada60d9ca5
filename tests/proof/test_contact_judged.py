"""A certificate that was edited and sealed again is not valid: its content must follow from its world and from the declarations
of its engine."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.proof.certificate import Certificate
from simspec.proof.contact.probe import ProbeFigure
from simspec.proof.contact.run import PROBES, contact_checks, laws
from simspec.proof.contact.scope import MEASURED, declared, unmeasured
from simspec.proof.judge import judge, judge_proof
from simspec.proof.verify import verify
from tests import worlds
from tests.caches import cache_home

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINE = "mujoco"
PAIRS = {("ice", "ice"): 0.1, ("ice", "rubber"): 0.3, ("rubber", "rubber"): 0.2}


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    world = worlds.table(PAIRS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", cache_home(tmp_path_factory.mktemp("cache")))
        return world, verify(world, [ENGINE])


def with_check(proof, level, name, **change):
    return {
        "checks": tuple(
            dataclasses.replace(check, **change) if (check.level, check.name) == (level, name) else check
            for check in proof.checks
        )
    }


def with_figure(proof, wanted, **change):
    """The first figure of those that ``wanted`` wants changed, and the checks that follow from it."""
    first = next(number for number, figure in enumerate(proof.contact) if wanted(figure))
    figures = list(proof.contact)
    figures[first] = dataclasses.replace(figures[first], **change)
    return with_figures(proof, figures)


def with_figures(proof, figures):
    others = tuple(check for check in proof.checks if check.level != "L5")
    return {"contact": tuple(figures), "checks": (*others, *contact_checks(figures))}


def of(probe, **more):
    return lambda figure: figure.probe == probe and all(getattr(figure, key) == value for key, value in more.items())


FORGERIES = {
    "L6 of one comparison": (lambda proof: with_check(proof, "L6", "motion", count=1), "L6 motion: 1 comparisons"),
    "L6 compared coarsely": (lambda proof: with_check(proof, "L6", "motion", tolerance=1e-2), "L6 motion: a tolerance"),
    "an unknown check": (
        lambda proof: {"checks": (*proof.checks, dataclasses.replace(proof.level("L6")[0], name="peace"))},
        "L6 peace: this world has no such check",
    ),
    "no approximations": (lambda proof: {"approximations": {}}, "approximation 'contact.friction.impact' is missing"),
    "another approximation": (
        lambda proof: {"approximations": {**proof.approximations, "joint.ball": "approximate: soft"}},
        "approximation 'joint.ball'",
    ),
    "an approximation said otherwise": (
        lambda proof: {"approximations": dict.fromkeys(proof.approximations, "exact")},
        "'exact', should be",
    ),
    "an invented field": (
        lambda proof: {"not_checked": {**proof.not_checked, "mass": "it is secret"}},
        "not readable back 'mass' (it is secret)",
    ),
    "a field that is not named": (lambda proof: {"not_checked": {}}, "'collision_group' is missing"),
    "a deviation without a word": (
        lambda proof: with_figure(proof, of("oblique"), deviation="", promised=None),
        "no deviation",
    ),
    "an invented deviation": (
        lambda proof: with_figure(proof, of("push"), deviation="it hops", tolerance=0.5),
        "the deviation 'it hops'",
    ),
    "a wider deviation": (lambda proof: with_figure(proof, of("oblique"), tolerance=9.0), "a tolerance of 9"),
    "a wider tolerance": (lambda proof: with_figure(proof, of("stick"), tolerance=0.01), "a tolerance of 0.01"),
    "another promise": (lambda proof: with_figure(proof, of("oblique"), promised=1.0), "a promised tolerance"),
    "another law": (lambda proof: with_figure(proof, of("push"), expected=0.5, measured=0.5), "expected value 0.5"),
    "no effect to be absent": (lambda proof: with_figure(proof, of("oblique"), without=None), "without value none"),
    "a figure less": (lambda proof: with_figures(proof, proof.contact[1:]), "no figure of"),
    "one of several figures less": (
        lambda proof: with_figures(
            proof, [figure for figure in proof.contact if not of("overlap", case="overlap 10 µm")(figure)]
        ),
        "L5 overlap: 1 figures",
    ),
    "a figure of nothing": (
        lambda proof: with_figures(proof, [*proof.contact, dataclasses.replace(proof.contact[0], case="at night")]),
        "figures of",
    ),
    "a larger size": (lambda proof: with_figure(proof, of("size"), tolerance=0.01), "L5 size"),
    "a size of nothing": (
        lambda proof: with_figure(proof, of("size"), subject="sphere 1 m, free"),
        "does not occur in this world",
    ),
    "more contact than was measured": (
        lambda proof: {"contact_scope": dict.fromkeys(proof.contact_scope, MEASURED)},
        "kind of contact 'contact on accelerating carriers'",
    ),
    "no word of what was measured": (lambda proof: {"contact_scope": {}}, "is missing"),
}


def test_measured_figures_satisfy_the_world(sealed):
    world, certificate = sealed
    assert certificate.valid
    assert judge(Certificate.from_json(certificate.to_json()), world) == []


@pytest.mark.parametrize("forgery", FORGERIES)
def test_an_edited_and_resealed_certificate_is_not_valid(forgery, sealed):
    world, certificate = sealed
    change, words = FORGERIES[forgery]
    proof = certificate.engines[ENGINE]
    forged = dataclasses.replace(certificate, engines={ENGINE: dataclasses.replace(proof, **change(proof))})
    read = Certificate.from_json(forged.to_json())
    found = judge(read, world)
    assert any(words in line for line in found), found


def test_counts_of_motion_are_left_to_a_thorough_judgement(sealed):
    world, certificate = sealed
    proof = certificate.engines[ENGINE]
    forged = dataclasses.replace(proof, **with_check(proof, "L6", "motion", count=1))
    assert judge_proof(ENGINE, forged, world) == []
    assert judge_proof(ENGINE, forged, world, thorough=True) != []


# --- what a verdict rests on ----------------------------------------------------------------------------------------


def test_a_verdict_names_its_basis(sealed):
    _, certificate = sealed
    proof = certificate.engines[ENGINE]
    rests = proof.declared
    assert 0 < rests.declared < rests.figures == len(proof.contact)
    assert {"oblique", "overlap"} <= set(rests.absent)
    assert f"{rests.declared} of {rests.figures} contact figures by declared deviation, widest: " in proof.verdict
    assert "absent: " in proof.verdict
    assert "friction in impacts" in proof.verdict
    for kind in unmeasured(proof.contact_scope):
        assert f"{kind}: not measured" in proof.verdict
    assert "by declared deviation" in certificate._repr_html_()


FIGURE = ProbeFigure("oblique", "a, b", "case", "change", "m/s", 2.0, 0.1, 1.98, deviation="it slips", without=0.0)


@pytest.mark.parametrize(
    ("change", "absent", "width"),
    [
        ({}, True, "oblique 99 %"),
        ({"tolerance": 1.8, "measured": 0.25}, True, "oblique 90 %"),  # a tenth of the effect would pass
        ({"tolerance": 1.79, "measured": 0.3}, False, "oblique 90 %"),
        ({"without": None}, False, "oblique 99 %"),
        ({"probe": "steady", "expected": 0.0, "promised": 0.1, "without": 9.0}, False, "steady 20 times its tolerance"),
        ({"without": 1.0, "tolerance": 0.95, "measured": 1.1}, True, "oblique 48 %"),
        ({"without": 1.0, "tolerance": 0.85, "measured": 1.2}, False, "oblique 42 %"),
        ({"deviation": ""}, False, ""),
        ({"measured": None}, True, ""),  # it fails, and passes by nothing
    ],
)
def test_an_effect_is_absent_where_an_engine_without_it_would_pass(change, absent, width):
    figure = dataclasses.replace(FIGURE, **change)
    assert figure.absent is absent
    rests = declared([figure, dataclasses.replace(FIGURE, deviation="", measured=2.0)])
    assert rests.width == width
    assert rests.figures == 2
    assert rests.absent == ((figure.probe,) if absent and figure.declared else ())


def test_every_probe_states_its_expectation():
    for law in laws(worlds.table(PAIRS)):
        for probe in PROBES.values():
            if probe.applies(law):
                wanted = probe.wanted(law)
                assert wanted, probe.NAME
                for figure in wanted:
                    assert figure.measured is None
                    assert figure.subject == law.subject
                    reference = probe.reference(law, figure)
                    assert reference is not None
                    assert (reference.expected, reference.tolerance) == pytest.approx(
                        (figure.expected, figure.tolerance)
                    )
                    assert reference.without == figure.without
