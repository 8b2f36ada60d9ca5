"""The quick self-test as a suite: every planted defect that the engine can hold must be noticed above level L0."""

from __future__ import annotations

from typing import ClassVar

import pytest

from simspec.proof.selftest import SelfTest, self_test
from simspec.testing.base import Suite


class SelfTestSuite(Suite):
    """See the module."""

    defects: ClassVar[tuple[str, ...] | None] = None
    """Those to plant; None: all."""

    @pytest.fixture(scope="class")
    @classmethod
    def planted(cls) -> SelfTest:
        """What became of each defect."""
        pythons = {} if cls.python is None else {cls.engine: cls.python}
        return self_test([cls.engine], defects=cls.defects, pythons=pythons)

    def test_every_planted_defect_is_caught(self, planted: SelfTest) -> None:
        assert [outcome.defect for outcome in planted.outcomes if outcome.caught is False] == []
        assert planted.planted > 0

    def test_what_cannot_be_planted_says_why(self, planted: SelfTest) -> None:
        assert all(outcome.reason for outcome in planted.outcomes if outcome.caught is None)
