"""Worlds that need more memory than is given to Drake are refused before anything is built."""

from __future__ import annotations

import pytest

import simspec
from simspec.compiler import compile_world
from simspec.engines.drake import approximations
from simspec.engines.drake.engine import Drake, memory_covered
from simspec.errors import EngineError, UnsupportedError
from tests.worlds import with_options


def pile(shape: dict, count: int, friction: float = 0.5) -> simspec.World:
    body = {"mass": 1.0, "shapes": [shape], "array": {"grid": [1, 1, count], "spacing": 0.3}}
    contact = {"materials": {"plain": {"friction": friction}}}
    return simspec.Spec.from_data({"simspec": 1, "name": "pile", "contact": contact, "bodies": {"b": body}}).resolve()


BOX, BALL = {"box": {"size": [0.1, 0.1, 0.1]}}, {"sphere": {"radius": 0.1}}
CYLINDER = {"cylinder": {"radius": 0.1, "length": 0.2}}


@pytest.mark.parametrize(
    ("shape", "most", "too_many"), [(BALL, 2000, 3000), (BOX, 450, 520), (CYLINDER, 200, 260)], ids=str
)
def test_large_worlds_are_accepted_or_rejected_by_their_requirements(shape, most, too_many):
    assert memory_covered(pile(shape, most)) is None
    with pytest.raises(UnsupportedError, match=r"Drake needs \d\.\d GB") as refused:
        compile_world(pile(shape, too_many), ["drake"])
    assert "geometries" in str(refused.value)


def test_a_file_of_too_large_a_world_is_refused_before_it_is_built(load_files, monkeypatch):
    files = compile_world(
        with_options(pile(BOX, 12), "drake", settings=(("contact_approximation", "tamsi"),), accept=("shape.box",)),
        ["drake"],
    )
    load_files(Drake, files["drake"].files)
    monkeypatch.setattr(approximations, "MOST_GIGABYTES", 2e-6)
    with pytest.raises(EngineError, match=r"108 geometries .* of 72 velocities"):
        load_files(Drake, files["drake"].files)


def test_pairs_and_the_dense_matrix_are_counted():
    assert approximations.gigabytes(2001, 0) == pytest.approx(1e-9 * approximations.PAIR_BYTES * 2001 * 1000)
    assert approximations.gigabytes(0, 12_000) == pytest.approx(1.152)
