"""Every defect is planted into ``world.json`` for any engine, except defects of values that the file does not contain."""

from __future__ import annotations

from simspec.dialects.kit.defects import NAMES
from simspec.dialects.kit.world_defects import DEFECTS, UNSAID


def test_every_defect_is_planted_or_named_as_unsaid():
    assert not set(DEFECTS) & set(UNSAID)
    assert set(DEFECTS) | set(UNSAID) == set(NAMES)
