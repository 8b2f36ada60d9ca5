"""All suites in one class, for one line of a test module."""

from __future__ import annotations

from simspec.testing.contact_suite import ContactSuite
from simspec.testing.control_suite import ControlSuite
from simspec.testing.forces_suite import ForcesSuite
from simspec.testing.model_suite import ModelSuite
from simspec.testing.selftest_suite import SelfTestSuite
from simspec.testing.sleeping_suite import SleepingSuite


class EngineSuite(ModelSuite, ContactSuite, ControlSuite, ForcesSuite, SleepingSuite, SelfTestSuite):
    """Everything that simspec asks of an engine; about 100 tests."""
