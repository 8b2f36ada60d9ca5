"""Releases are compared by their numbers."""

from __future__ import annotations

import pytest

from simspec.support.declarations import earlier, is_before, is_wholly_before, later, out_of_bounds, release


def test_a_release_is_its_numbers():
    assert release("3.10.0rc1") == (3, 10)
    assert release("4") == release("4.0.0") == (4,)
    assert release("0") == (0,)
    assert release("v1.51.1+gpu") == (1, 51, 1)
    for wrong in ("", "x", ".5", "main"):
        with pytest.raises(ValueError, match="no version"):
            release(wrong)


@pytest.mark.parametrize(
    ("version", "since", "until", "fits"),
    [
        ("3.10", "3.9", "", True),
        ("3.9", "3.10", "", False),
        ("3.9", "", "3.10", True),
        ("3.10", "", "3.10", False),
        ("3.10.0", "3.10", "3.10.1", True),
        ("3", "3.8", "", False),
        ("3", "3.0", "4", True),
        ("10", "", "9", False),
    ],
)
def test_bounds(version, since, until, fits):
    reason = out_of_bounds(version, since, until)
    assert (reason is None) is fits
    assert fits or version in reason


def test_a_version_that_cannot_be_compared_is_out_of_every_bound():
    assert out_of_bounds("unknown") is None
    assert "no version" in out_of_bounds("unknown", "3.8")


def test_the_stricter_bound():
    assert (later("3.9", "3.10"), earlier("3.9", "3.10")) == ("3.10", "3.9")
    assert (later("", "2"), earlier("2", ""), later("", "")) == ("2", "2", "")


def test_a_label_is_before_a_release_if_all_its_versions_are():
    before = ("3.0", "3.2", "3.2.7", "3.3.0", "3.3.5", "2", "3.2.0rc1")
    for version in ("3", "3.3", "3.3.6", "3.3.7", "3.3.10", "3.4", "4.0.1", "main", ""):
        assert not is_wholly_before(version, "3.3.6")
    for version in before:
        assert is_wholly_before(version, "3.3.6")
        assert is_before(version, "3.3.6")
    assert is_before("3.3", "3.3.6")
    assert not is_before("main", "3.3.6")
