"""Whether parsed JSON has the fields that it should have, of the right kinds, and no others.

A form is one of: a type (``float`` takes whole numbers too, ``int`` and ``float`` no flags), :class:`ListOf`, :class:`TupleOf`,
:class:`MapOf`, :class:`OrNull`, :class:`OneOf`, :class:`Variants`, or a dict of forms by field; a field whose name ends in
``?`` may be missing. ``form_of`` makes them of a dataclass's annotations, ``typed`` the dataclass of a value that has the form,
and ``plain`` the value of a dataclass.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
import types
import typing
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from simspec.world.canonical import to_plain

WORDS = {bool: "true or false", int: "a whole number", float: "a finite number", str: "a text"}


@dataclass(frozen=True, slots=True)
class ListOf:
    """A list of values of one form, of a given length or any; ``distinct``: no two alike."""

    form: Any
    length: int | None = None
    distinct: bool = False


@dataclass(frozen=True, slots=True)
class TupleOf:
    """A list with a form for each of its values."""

    forms: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class OrNull:
    """Null, or a value of the form."""

    form: Any


@dataclass(frozen=True, slots=True)
class MapOf:
    """An object with any names and values of one form."""

    form: Any


@dataclass(frozen=True, slots=True)
class Alternatives:
    """One of some texts."""

    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Variants:
    """Objects of different fields, distinguished by the text of their field ``KIND``: the form of each."""

    forms: Mapping[str, Any]


KIND = "kind"
"""The field that distinguishes the members of a union of dataclasses; its annotation is ``Literal``."""

DISTINCT = "distinct"
"""In annotations of lists no two values of which may be alike: ``Annotated[tuple[str, ...], DISTINCT]``."""

Names = Annotated[tuple[str, ...], DISTINCT]
"""Different names."""
NamePairs = Annotated[tuple[tuple[str, str], ...], DISTINCT]
"""Different pairs of names."""

KINDS_OF_FORMS: Mapping[type, tuple[type, str]] = {
    ListOf: (list, "a list"),
    MapOf: (dict, "an object"),
    dict: (dict, "an object"),
    Variants: (dict, "an object"),
}
"""JSON types of the values of a form, by class and in words."""


def check_fields(value: Any, form: Any, at: str = "sidecar") -> None:
    """Raise ValueError naming the first place where ``value`` is not of the form."""
    kind = KINDS_OF_FORMS.get(type(form))
    if kind is not None and type(value) is not kind[0]:
        raise ValueError(f"{at} is {_shown(value)}, should be {kind[1]}")
    if isinstance(form, OrNull):
        if value is not None:
            check_fields(value, form.form, at)
    elif isinstance(form, Alternatives):
        check_fields(value, str, at)
        check_known((value,), form.words, at)
    elif isinstance(form, Variants):
        check_fields(value.get(KIND), Alternatives(tuple(form.forms)), f"{at}.{KIND}")
        check_fields(value, form.forms[value[KIND]], at)
    elif isinstance(form, TupleOf):
        if type(value) is not list or len(value) != len(form.forms):
            raise ValueError(f"{at} is {_shown(value)}, should be a list of {len(form.forms)}")
        for index, (item, local) in enumerate(zip(value, form.forms, strict=True)):
            check_fields(item, local, f"{at}.{index}")
    elif isinstance(form, ListOf):
        if form.length is not None and len(value) != form.length:
            raise ValueError(f"{at} has {len(value)} entries, should have {form.length}")
        for index, entry in enumerate(value):
            check_fields(entry, form.form, f"{at}.{index}")
        if form.distinct:
            check_distinct(value, at)
    elif isinstance(form, MapOf):
        for name, entry in value.items():
            check_fields(entry, form.form, f"{at}.{name}")
    elif isinstance(form, dict):
        needed = {name for name in form if not name.endswith("?")}
        known = {name.removesuffix("?"): entry for name, entry in form.items()}
        wrong = sorted(needed - value.keys()), sorted(value.keys() - known.keys())
        if any(wrong):
            raise ValueError(f"{at} lacks the fields {wrong[0]} and has {wrong[1]}, which are not known")
        for name, entry in value.items():
            check_fields(entry, known[name], f"{at}.{name}")
    elif form is not object and not _is(value, form):
        raise ValueError(f"{at} is {_shown(value)}, should be {WORDS[form]}")


@functools.cache
def form_of(kind: Any) -> Any:
    """The form of an annotation: a dataclass (a field whose default is None may be missing), a tuple, a mapping, texts
    (``Literal``), a union with None, a union of dataclasses (see ``KIND``), or a plain type. A union of plain types is any
    plain value. Raises TypeError for other annotations."""
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind, include_extras=True)
        return {
            f"{_key_of(field)}{'?' if field.default is None else ''}": form_of(
                _without_none(hints[field.name]) if field.default is None else hints[field.name]
            )
            for field in dataclasses.fields(kind)
        }
    if kind in (object, bool, int, float, str):
        return kind
    origin, items = typing.get_origin(kind), typing.get_args(kind)
    if origin is Annotated:
        return dataclasses.replace(form_of(items[0]), distinct=DISTINCT in items[1:])
    if origin is tuple:
        if len(items) == 2 and items[1] is Ellipsis:
            return ListOf(form_of(items[0]))
        return ListOf(form_of(items[0]), len(items)) if len(set(items)) == 1 else TupleOf(tuple(map(form_of, items)))
    if origin in (dict, Mapping):
        return MapOf(form_of(items[1]))
    if origin in (typing.Union, types.UnionType):
        if type(None) in items:
            return OrNull(form_of(_without_none(kind)))
        if not any(map(dataclasses.is_dataclass, items)):
            return object
        return Variants({word: form_of(item) for word, item in _variants(kind).items()})
    if origin is Literal:
        return Alternatives(items)
    raise TypeError(f"{kind} has no form")


def typed(kind: Any, value: Any) -> Any:
    """The value of an annotation that plain data of its form stands for."""
    if dataclasses.is_dataclass(kind):
        hints = _hints(kind)  # type: ignore[arg-type]
        names = {_key_of(field): field.name for field in dataclasses.fields(kind)}
        return kind(**{names[key]: typed(hints[names[key]], item) for key, item in value.items()})  # type: ignore[operator]
    origin, items = typing.get_origin(kind), typing.get_args(kind)
    if origin is tuple:
        kinds = [items[0]] * len(value) if len(items) == 2 and items[1] is Ellipsis else items
        return tuple(typed(kind, item) for kind, item in zip(kinds, value, strict=True))
    if origin in (dict, Mapping):
        return {name: typed(items[1], item) for name, item in value.items()}
    if origin in (typing.Union, types.UnionType):
        if type(None) in items:
            return None if value is None else typed(_without_none(kind), value)
        return typed(_variants(kind)[value[KIND]], value) if isinstance(value, dict) else value
    return float(value) if kind is float else value


def plain(value: Any) -> Any:
    """The inverse of :func:`typed`: a field whose default is None is left out where it is None."""
    if isinstance(value, (str, int, float)) or value is None:
        return to_plain(value)
    if isinstance(value, (tuple, list)):
        return to_plain(value) if set(map(type, value)) == {float} else [plain(item) for item in value]
    if dataclasses.is_dataclass(value):
        return {
            key: plain(item)
            for key, name, optional in _keys(type(value))  # type: ignore[arg-type]
            if (item := getattr(value, name)) is not None or not optional
        }
    if isinstance(value, Mapping):
        return {name: plain(item) for name, item in value.items()}
    return to_plain(value)


def _key_of(field: dataclasses.Field[Any]) -> str:
    """The key of a field in plain data: its name, or ``key`` of its metadata."""
    key: str = field.metadata.get("key", field.name)
    return key


@functools.cache
def _keys(kind: Any) -> tuple[tuple[str, str, bool], ...]:
    """By field of a dataclass: its key, its name, and whether its default is None."""
    return tuple((_key_of(field), field.name, field.default is None) for field in dataclasses.fields(kind))


@functools.cache
def _hints(kind: Any) -> dict[str, Any]:
    return typing.get_type_hints(kind)


@functools.cache
def _variants(kind: Any) -> dict[str, Any]:
    """The members of a union of dataclasses by the texts of their field ``KIND``. Raises TypeError where a member has none."""
    members = [(_hints(item).get(KIND), item) for item in typing.get_args(kind)]
    if any(typing.get_origin(annotation) is not Literal for annotation, _ in members):
        raise TypeError(f"{kind} has no form: its members do not all have a literal {KIND!r}")
    return {word: item for annotation, item in members for word in typing.get_args(annotation)}


def _without_none(kind: Any) -> Any:
    """The annotation without its None."""
    kinds = [item for item in typing.get_args(kind) if item is not type(None)]
    return typing.Union[tuple(kinds)] if len(kinds) > 1 else kinds[0]  # noqa: UP007 (made from a list)


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
    return isinstance(value, (int, float)) and abs(value) <= sys.float_info.max


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
