"""One canonical JSON text for a world (or any of the frozen types), and its SHA-256.

Keys are sorted, there is no white space, floats print as the shortest text that reads back to the same double,
negative zero prints as zero, and NaN or infinity cannot be written.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import types
import typing
import weakref
from collections.abc import Callable, Hashable
from typing import Any, Concatenate, ParamSpec, TypeVar

# Derived data of a world is computed once, and kept for as long as the world lives.
#
# A world never changes, and on its way from the spec to the printed table many parts need the same: its rigid groups, the
# laws of its pairs, its hash. Results are kept by the world as an object, not by what it equals: comparing two worlds costs
# more than most of what is kept here.

World = TypeVar("World")
More = ParamSpec("More")
Result = TypeVar("Result")

_KEPT: dict[int, dict[Hashable, object]] = {}
"""By the identity of a living world, what was worked out of it, by function and further arguments."""


def derived(function: Callable[Concatenate[World, More], Result]) -> Callable[Concatenate[World, More], Result]:
    """``function`` of a world and of further hashable arguments by position, called once for each world and arguments.

    Its result is shared by all callers: it must be immutable (or be treated so), and must not hold the world, which
    would then never end.
    """

    @functools.wraps(function)
    def once(world: World, /, *more: More.args, **named: More.kwargs) -> Result:
        if named:
            raise TypeError(f"{function.__name__} takes its arguments by position")
        kept = _KEPT.get(id(world))
        if kept is None:
            weakref.finalize(world, _KEPT.pop, id(world), None).atexit = False
            kept = _KEPT[id(world)] = {}
        key = (function, *more)
        if key not in kept:
            kept[key] = function(world, *more, **named)
        result: Result = kept[key]  # type: ignore[assignment]
        return result

    return once


_WHOLE = frozenset({str, int, bool, type(None)})
"""Types that are plain as they are."""


def to_plain(value: Any) -> Any:
    """Dataclasses to dicts and tuples to lists, for JSON."""
    kind = type(value)
    if kind in _WHOLE:
        return value
    if isinstance(value, float):
        return value + 0.0 if value else 0.0
    if isinstance(value, (str, int)):
        return value
    if isinstance(value, (tuple, list)):
        kinds = set(map(type, value))
        if kinds == {float}:  # most values of a world: waypoints, vertices, matrices
            return [number or 0.0 for number in value]
        return list(value) if kinds <= _WHOLE else [to_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: item if type(item) in _WHOLE else to_plain(item) for key, item in value.items()}
    plain = {name: to_plain(getattr(value, name)) for name in _field_names(kind)}
    for name, empty in _left_out(kind):
        if plain[name] == empty:
            del plain[name]
    return plain


def _names_of_fields(cls: type) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(cls) if not field.metadata.get("unstored"))


def _fields_left_out(cls: type) -> tuple[tuple[str, Any], ...]:
    return tuple(
        (field.name, to_plain(field.default)) for field in dataclasses.fields(cls) if field.metadata.get("left_out")
    )


def _types_of_fields(cls: type) -> tuple[tuple[str, Any], ...]:
    hints = typing.get_type_hints(cls)
    return tuple((name, hints[name]) for name in _names_of_fields(cls))


_field_names: Callable[[type], tuple[str, ...]] = functools.cache(_names_of_fields)
_left_out: Callable[[type], tuple[tuple[str, Any], ...]] = functools.cache(_fields_left_out)
"""The fields that are left out while they have their defaults, with these as plain data."""
_field_types: Callable[[type], tuple[tuple[str, Any], ...]] = functools.cache(_types_of_fields)


def from_plain(kind: Any, value: Any) -> Any:
    """The inverse of :func:`to_plain`: rebuilds ``kind`` (a dataclass type or a typing annotation) from plain data.

    Raises KeyError for a missing field and TypeError for a value of another type, so that a damaged file is noticed.
    """
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        unknown = set(value) - set(_field_names(kind))
        if unknown:
            raise KeyError(f"{kind.__name__} has no field {sorted(unknown)}")
        missing = [name for name, _ in _left_out(kind) if name not in value]
        return kind(**{name: from_plain(hint, value[name]) for name, hint in _field_types(kind) if name not in missing})
    origin = typing.get_origin(kind)
    if origin is tuple:
        items = typing.get_args(kind)
        if len(items) == 2 and items[1] is Ellipsis:
            if items[0] is float and all(type(item) is float for item in value):
                return tuple(value)  # the vertices of meshes: 100,000 numbers and more
            return tuple(from_plain(items[0], item) for item in value)
        if len(items) != len(value):
            raise TypeError(f"expected {len(items)} values, found {len(value)}")
        return tuple(from_plain(item_kind, item) for item_kind, item in zip(items, value, strict=True))
    if origin is dict:
        return dict(value)
    if origin in (typing.Union, types.UnionType):
        return _from_union(typing.get_args(kind), value)
    if origin is typing.Literal:
        if value not in typing.get_args(kind):
            raise TypeError(f"expected one of {typing.get_args(kind)}, found {value!r}")
        return value
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, kind):
        raise TypeError(f"expected {kind.__name__}, found {value!r}")
    return value


def _from_union(kinds: tuple[Any, ...], value: Any) -> Any:
    """The member of a union that plain JSON of this type stands for: None, a scalar, a tuple or a dataclass."""
    if value is None and type(None) in kinds:
        return None
    for kind in kinds:
        if type(value) is kind or _structured(kind, value):
            return from_plain(kind, value)
    if type(value) is int and float in kinds:
        return float(value)
    raise TypeError(f"{value!r} is none of {kinds}")


def _structured(kind: Any, value: Any) -> bool:
    """Whether a list or a dict may stand for a tuple or a dataclass; of several tuples the first item decides, of several
    dataclasses the field ``kind`` where it is a literal."""
    if isinstance(value, dict):
        if not isinstance(kind, type) or not dataclasses.is_dataclass(kind):
            return False
        annotation = dict(_field_types(kind)).get("kind")
        return typing.get_origin(annotation) is not typing.Literal or value.get("kind") in typing.get_args(annotation)
    if not isinstance(value, list) or typing.get_origin(kind) is not tuple:
        return False
    items = typing.get_args(kind)
    return not value or not items or isinstance(value[0], list) == (typing.get_origin(items[0]) is tuple)


def canonical_json(value: Any) -> str:
    """The canonical JSON text of ``value``. Raises ValueError where a number is not finite."""
    return json.dumps(to_plain(value), sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def sha256(value: Any) -> str:
    """Hexadecimal SHA-256 of the canonical JSON of ``value``; a world's is worked out once."""
    return _sha256_once(value) if hasattr(value, "__weakref__") else _sha256(value)


def _sha256(value: Any) -> str:
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()


_sha256_once = derived(_sha256)
