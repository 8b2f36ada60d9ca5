"""Whether a sidecar has the fields that it should have, of the right kinds, and no others.

A form is one of: a type (``float`` takes whole numbers too, ``int`` and ``float`` no flags), :class:`ListOf`, :class:`MapOf`,
or a dict of forms by field; a field whose name ends in ``?`` may be missing.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from simspec.world.types import FRICTION_CONES, JOINT_KINDS

WORDS = {bool: "true or false", int: "a whole number", float: "a finite number", str: "a text"}


@dataclass(frozen=True, slots=True)
class ListOf:
    """A list of values of one form, of a given length or any; ``distinct``: no two alike."""

    form: Any
    length: int | None = None
    distinct: bool = False


@dataclass(frozen=True, slots=True)
class MapOf:
    """An object with any names and values of one form."""

    form: Any


COMMON: Mapping[str, Any] = {
    "schema": int,
    "format": str,
    "engine": str,
    "world": str,
    "settings": MapOf(object),
    "bodies": ListOf({"name": str, "kind": str, "frame_offset": ListOf(float, 3)}),
    "friction_cone": str,
}
"""The fields that every format's sidecar has (``formats/kit/contract.py``)."""


def check_fields(value: Any, form: Any, at: str = "sidecar") -> None:
    """Raise ValueError naming the first place where ``value`` is not of the form."""
    kind = {ListOf: (list, "a list"), MapOf: (dict, "an object"), dict: (dict, "an object")}.get(type(form))
    if kind is not None and type(value) is not kind[0]:
        raise ValueError(f"{at} is {_told(value)}, should be {kind[1]}")
    if isinstance(form, ListOf):
        if form.length is not None and len(value) != form.length:
            raise ValueError(f"{at} has {len(value)} entries, should have {form.length}")
        for index, one in enumerate(value):
            check_fields(one, form.form, f"{at}.{index}")
        if form.distinct:
            check_distinct(value, at)
    elif isinstance(form, MapOf):
        for name, one in value.items():
            check_fields(one, form.form, f"{at}.{name}")
    elif isinstance(form, dict):
        needed = {name for name in form if not name.endswith("?")}
        known = {name.removesuffix("?"): one for name, one in form.items()}
        wrong = sorted(needed - value.keys()), sorted(value.keys() - known.keys())
        if any(wrong):
            raise ValueError(f"{at} lacks the fields {wrong[0]} and has {wrong[1]}, which are not known")
        for name, one in value.items():
            check_fields(one, known[name], f"{at}.{name}")
    elif form is not object and not _is(value, form):
        raise ValueError(f"{at} is {_told(value)}, should be {WORDS[form]}")


def check_common(content: Mapping[str, Any]) -> set[str]:
    """The names of a sidecar's bodies. Raise ValueError where two are alike, or a word of the common fields is not known."""
    names = [body["name"] for body in content["bodies"]]
    check_distinct(names, "sidecar.bodies")
    check_known((body["kind"] for body in content["bodies"]), JOINT_KINDS, "sidecar.bodies")
    check_known((content["friction_cone"],), FRICTION_CONES, "sidecar.friction_cone")
    return set(names)


def check_known(names: Iterable[str], known: Collection[str], at: str) -> None:
    """Raise ValueError when some of the names are not among those known."""
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise ValueError(
            f"{at} has {', '.join(map(repr, unknown))}, which {'is' if len(unknown) == 1 else 'are'} not known"
        )


def check_distinct(values: Iterable[Any], at: str) -> None:
    """Raise ValueError when two of some plain values are alike."""
    seen = set()
    for value in values:
        key = tuple(value) if isinstance(value, list) else value
        if key in seen:
            raise ValueError(f"{at} has {value!r} twice")
        seen.add(key)


def _is(value: Any, form: Any) -> bool:
    if isinstance(value, bool) or form in (bool, str):
        return type(value) is form
    if form is int:
        return isinstance(value, int)
    return isinstance(value, (int, float)) and math.isfinite(value)


def _told(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
