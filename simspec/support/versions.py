"""Releases of engines, and the bounds of declarations that hold for some of them.

A version comes from a label (``engine@3.8`` may stand for 3.8.1) or from the installed package. Only release numbers are
compared: what follows them (``rc1``, ``.post2``, ``+local``) belongs to the release.
"""

from __future__ import annotations

import re

_RELEASE = re.compile(r"v?([0-9]+(?:\.[0-9]+)*)")


def release(version: str) -> tuple[int, ...]:
    """The numbers of a release, without zeros at the end: ``3.10.0rc1`` is (3, 10). Raises ValueError for what begins with
    no number."""
    match = _RELEASE.match(version)
    if match is None:
        raise ValueError(f"{version!r} is no version: it begins with no number")
    numbers = [int(part) for part in match[1].split(".")]
    while len(numbers) > 1 and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


def out_of_bounds(version: str, since: str = "", until: str = "") -> str | None:
    """Why ``version`` is not one from ``since`` on and before ``until`` (each may be empty); None where it is.

    A label's version that does not say enough (3 where the bound is 3.8) counts as its oldest release.
    """
    if not since and not until:
        return None
    try:
        at_work = release(version)
    except ValueError as error:
        bounds = " and ".join(part for part in (since and f"from {since} on", until and f"before {until}") if part)
        return f"has it {bounds}, and {error}"
    if since and at_work < release(since):
        return f"has it from version {since} on, and {version} is at work"
    if until and at_work >= release(until):
        return f"has it before version {until}, and {version} is at work"
    return None


def is_before(version: str, bound: str) -> bool:
    """Whether a version belongs to a release before ``bound``; False for what begins with no number."""
    try:
        return release(version) < release(bound)
    except ValueError:
        return False


def is_wholly_before(version: str, bound: str) -> bool:
    """Whether all releases that a label's version stands for are before ``bound``: 3.2 is before 3.3.6, 3.3 is not, since
    3.3.7 is one of its releases. False for what begins with no number."""
    try:
        numbers = release(version)
    except ValueError:
        return False
    return numbers < release(bound)[: max(len(numbers), version.count(".") + 1)]


def later(one: str, other: str) -> str:
    """The stricter of two first releases."""
    return max((bound for bound in (one, other) if bound), key=release, default="")


def earlier(one: str, other: str) -> str:
    """The stricter of two releases that end a declaration."""
    return min((bound for bound in (one, other) if bound), key=release, default="")
