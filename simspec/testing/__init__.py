"""Tests for engines, shipped: authors of an engine run them against it, from their repository.

    from simspec.testing import EngineSuite

    class TestMine(EngineSuite):
        engine = "mine"

``EngineSuite`` is all suites in one class; :mod:`simspec.testing.worlds` has the worlds, :func:`self_test` and
:func:`complete_self_test` plant defects. Suites need pytest (the extra ``testing``), which is imported with them only.
They ask the engine's own process, so an engine may be a program or live in another interpreter (``python``).
"""

from __future__ import annotations

from typing import Any

from simspec.proof.complete import complete_self_test
from simspec.proof.selftest import self_test

SUITES = {
    "EngineSuite": "simspec.testing.suite",
    "ModelSuite": "simspec.testing.model_suite",
    "ContactSuite": "simspec.testing.contact_suite",
    "ControlSuite": "simspec.testing.control_suite",
    "ForcesSuite": "simspec.testing.control_suite",
    "SleepingSuite": "simspec.testing.suite",
    "SelfTestSuite": "simspec.testing.suite",
}
"""Where each suite is: imported at first use, since only suites need pytest."""

__all__ = ["SUITES", "complete_self_test", "self_test"]


def __getattr__(name: str) -> Any:
    if name not in SUITES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(SUITES[name]), name)
