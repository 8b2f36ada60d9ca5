"""The language as a tree: which model, list or mapping stands at a path, and which keys may stand there."""

from __future__ import annotations

import functools
import typing
from collections.abc import Iterable, Sequence
from typing import Any

from pydantic.fields import FieldInfo

from simspec.language.reader import Reader
from simspec.language.strict import Strict


class Free:
    """A mapping with keys of the user's choice; ``item`` is the type of its values, ``key`` reads its keys."""

    def __init__(self, item: Any, key: Reader):
        self.item, self.key = item, key


@functools.cache
def fields(model: type[Strict]) -> dict[str, Any]:
    """The type of every field of a model, as :func:`at` gives them."""
    return {name: _plain(field.annotation, field.metadata) for name, field in model.model_fields.items()}


def _plain(annotation: Any, metadata: Sequence[Any] = ()) -> Any:
    reader = next((item for item in metadata if isinstance(item, Reader)), None)
    if reader is not None:
        return reader
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        base, *extra = typing.get_args(annotation)
        return _plain(base, extra)
    if origin is dict:
        key, item = typing.get_args(annotation)
        return Free(_plain(item), _plain(key))
    if origin is list:
        return [_plain(typing.get_args(annotation)[0])]
    return annotation


def default(kind: Any, field: FieldInfo) -> Any:
    """The default of a field that has one, as a spec would say it."""
    return kind.written(field.default) if isinstance(kind, Reader) else field.default


def is_model(kind: Any) -> bool:
    """Whether a type is a model of the language."""
    return isinstance(kind, type) and issubclass(kind, Strict)


def child(kind: Any, step: str | int) -> Any:
    """The type one step below; None where the language has nothing."""
    if is_model(kind):
        return fields(kind).get(str(step))
    if isinstance(kind, Free):
        return kind.item
    if isinstance(kind, list):
        return kind[0]
    return None


def at(root: type[Strict], path: Iterable[str | int]) -> Any:
    """The type at a path below ``root``: a model, a Reader, ``Free``, a list of one type, or None."""
    kind: Any = root
    for step in path:
        kind = child(kind, step)
    return kind


def keys(kind: Any) -> list[str]:
    """The keys of a model, in the language's order; none for other types."""
    return list(fields(kind)) if is_model(kind) else []


def models(kind: Any) -> dict[str, type[Strict]]:
    """Every model of the language at and below a type, by name, in the order of the language."""
    models: dict[str, type[Strict]] = {}
    waiting = [kind]
    while waiting:
        described = waiting.pop()
        if isinstance(described, Free):
            waiting.append(described.item)
        elif isinstance(described, list):
            waiting.append(described[0])
        elif is_model(described) and described.__name__ not in models:
            models[described.__name__] = described
            waiting.extend(reversed(fields(described).values()))
    return models
