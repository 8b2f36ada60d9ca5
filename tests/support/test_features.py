"""The closed list of features."""

from __future__ import annotations

from simspec.support.features import MEANING, Feature


def test_every_feature_has_a_meaning():
    assert set(MEANING) == set(Feature)
