"""The shipped suites in every engine that is installed: an engine that is added needs no line here."""

from __future__ import annotations

import pytest

from simspec.engines.kit.registry import engines, not_installed
from simspec.testing import ContactSuite, ControlSuite, ForcesSuite, ModelSuite, SleepingSuite
from tests.installed import INSTALLED, each

pytestmark = pytest.mark.usefixtures("warm_engines")


class HouseSuite(ModelSuite, ContactSuite, ControlSuite, ForcesSuite, SleepingSuite):
    """All but the self-test, which ``tests/proof/test_verify.py`` runs."""


for _name in INSTALLED:
    globals()[f"Test{_name.title()}"] = type(f"Test{_name.title()}", (HouseSuite,), {"engine": _name})


@pytest.mark.parametrize("name", each())
def test_every_known_engine_is_in_the_suite(name):
    assert name in {kind.engine for kind in HouseSuite.__subclasses__()}
    assert engines()[name].version() is not None, not_installed(engines()[name])
