"""Deviations in contact of several bodies, from an engine's table of measurements."""

from __future__ import annotations

import pytest

from simspec.engines.kit.coupled import ABOVE, MARGIN, Reason, measured
from simspec.world.types import PairContact

HEAD = "setting,cone,probe,restitution,ratio,1,4\n"
PAIR = PairContact("base", "body", 0.5, 0.0)
WHY = Reason("*", "few steps")


def table(tmp_path, *lines):
    path = tmp_path / "coupled.csv"
    path.write_text(HEAD + "".join(f"{line}\n" for line in lines))
    return path


def sizes(rows, timestep, ratio=0.0, settings=None, cone="elliptic", pair=PAIR):
    return [row.size for row in rows if row.counts_for(pair, cone, timestep, settings or {}, ratio)]


def test_a_size_counts_between_its_timestep_and_the_one_before(tmp_path):
    rows = measured(table(tmp_path, ",,rod,,,0.001,0.004"), [WHY])
    small, large = MARGIN * 0.001, MARGIN * 0.004
    assert sizes(rows, 0.0005) == sizes(rows, 0.001) == pytest.approx([small], rel=1e-3)
    assert sizes(rows, 0.001 * ABOVE) == sizes(rows, 0.016) == pytest.approx([small, large], rel=1e-3)
    assert not rows[0].relative


def test_a_size_that_shrinks_with_the_timestep_is_not_repeated(tmp_path):
    assert len(measured(table(tmp_path, ",,rod-slips,,,0.4,0.1"), [WHY])) == 1


def test_settings_cones_restitutions_and_ratios_are_conditions(tmp_path):
    rows = measured(
        table(
            tmp_path,
            "solver=quick,elliptic,stack,,100,0.001,",
            ",,edge,>0,,0.2,",
        ),
        [WHY],
    )
    stack, edge = rows
    assert sizes([stack], 0.001, 11.0, {"solver": "quick"}) == [stack.size]
    assert not sizes([stack], 0.001, 10.0, {"solver": "quick"})
    assert not sizes([stack], 0.001, 11.0, {"solver": "step"})
    assert not sizes([stack], 0.001, 11.0, {"solver": "quick"}, "pyramid-inscribed")
    assert not sizes([edge], 0.001)
    assert sizes([edge], 0.001, pair=PairContact("base", "body", 0.5, 0.5)) == [edge.size]
    assert edge.relative


def test_the_first_reason_that_covers_a_row_is_given(tmp_path):
    reasons = [Reason("stack*", "sweeps", "solver=quick"), Reason("stack*", "deep"), Reason("rod clamp", "leans")]
    rows = measured(
        table(tmp_path, "solver=quick,,stack,,1,0.1,", "solver=step,,stack-sideways,,1,0.1,", ",,clamp,,,0.1,"), reasons
    )
    assert [row.why for row in rows] == ["sweeps", "deep", "leans"]


def test_a_row_without_a_reason_and_a_reason_without_a_row_are_errors(tmp_path):
    path = table(tmp_path, ",,rod,,,0.1,")
    with pytest.raises(ValueError, match=r"no reason is given for .*rod"):
        measured(path, [Reason("clamp", "leans")])
    with pytest.raises(ValueError, match="no row is of the reason for clamp"):
        measured(path, [WHY, Reason("clamp", "leans")])
