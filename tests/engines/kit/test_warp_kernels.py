"""Functions that make kernels, which processes share between worlds."""

from __future__ import annotations

import sys
import types

import pytest

from simspec.engines.kit.warp import share_kernels


@pytest.fixture
def phase(monkeypatch):
    """A class in a module with two functions, each of which makes something new at every call."""
    module = types.ModuleType("some_engine_phase")
    module.make, module.other = (lambda flag: [flag]), (lambda: [])
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return type("Phase", (), {"__module__": module.__name__})


def test_equal_arguments_share_a_kernel_and_others_do_not(phase):
    module = sys.modules[phase.__module__]
    for _ in range(2):
        share_kernels(phase, ("make",))
    assert module.make(True) is module.make(True)
    assert module.make(True) is not module.make(False)
    assert module.other() is not module.other()
    assert module.make.__wrapped__(True) is not module.make(True)


def test_a_function_that_an_engine_no_longer_has_is_an_error(phase):
    with pytest.raises(AttributeError, match="gone"):
        share_kernels(phase, ("gone",))
