"""The language as a tree (which model, list or mapping stands at a path, and which keys it can have), and pydantic's errors as
located problems in the words of the language."""

from __future__ import annotations

import functools
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from simspec.errors import Problem
from simspec.language.document import Document
from simspec.language.models import File
from simspec.language.quantities import Reader
from simspec.language.strict import FAULT, REPORTED, Strict, near, show
from simspec.language.words import hint_for_key


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


MOST_LOOKED_AT = 2000
"""Problems of a file that are reported with their places and hints: as many as can be read; a second's worth."""
_WANTED = {
    "dict_type": "expected a mapping (key: value)",
    "list_type": "expected a list",
    "model_type": "expected a mapping (key: value)",
}


def of_validation(error: ValidationError, document: Document, root: type[Strict] = File) -> Iterator[Problem]:
    """Every error as a problem, in the order that pydantic found them."""
    errors = error.errors(include_url=False)
    if len(errors) > MOST_LOOKED_AT:
        yield document.problem(
            (), f"{len(errors):,} problems, of which the first {MOST_LOOKED_AT:,} are listed", code="S109"
        )
        del errors[MOST_LOOKED_AT:]
    unknown: dict[tuple[Any, ...], set[str | None]] = {}
    for item in errors:
        if item["type"] == "extra_forbidden":
            words = keys(at(root, item["loc"][:-1]))
            unknown.setdefault(item["loc"][:-1], set()).add(near(str(item["loc"][-1]), words))
    for item in errors:
        if item["type"] == REPORTED:
            continue
        misspelt = unknown.get(item["loc"][:-1], set()) if item["type"] == "missing" else ()
        if misspelt and near(str(item["loc"][-1]), [str(item["loc"][-1])]) in misspelt:
            continue  # it is there, under a wrong name
        path, key = list(item["loc"]), False
        if path and path[-1] == "[key]":
            path, key = path[:-1], True
        if item["type"] == FAULT:
            context = item["ctx"]
            more = {name: context[name] for name in ("code", "found", "allowed", "hint")}
            # an unknown word at a key's place is shown at the key
            yield document.problem(path, context["message"], key=key, **more)
        elif item["type"] == "extra_forbidden":
            yield _unknown(path, document, root)
        elif item["type"] == "missing":
            owner = ".".join(str(step) for step in path[:-1])
            message = f"{path[-1]} is missing" + (f" in {owner}" if owner else "")
            kind = at(root, path)
            allowed = kind.describe() if isinstance(kind, Reader) else None
            yield document.problem(path, message, allowed=allowed, code="S102")
        else:
            wanted = _WANTED.get(item["type"], item["msg"])
            yield document.problem(path, wanted, found=show(item["input"]), allowed=_example(root, path), code="S104")


def _unknown(path: list[Any], document: Document, root: type[Strict]) -> Problem:
    owner = at(root, path[:-1])
    words = keys(owner)
    known = hint_for_key(str(path[-1]), owner.__name__) if is_model(owner) else None
    hint = known or near(path[-1], words) or _elsewhere(str(path[-1]), root)
    return document.problem(
        path, f"unknown key {path[-1]!r}", key=True, allowed=", ".join(words), hint=hint, code="S101"
    )


def _elsewhere(word: str, root: type[Strict]) -> str | None:
    """The part of the language that has a key of this name, if there is just one."""
    owners = _owners(root).get(word, frozenset())
    return f"{word} belongs to {next(iter(owners))}" if len(owners) == 1 else None


@functools.cache
def _owners(root: type[Strict]) -> Mapping[str, frozenset[str]]:
    """The parts of the language that have a key, by the key."""
    owners: dict[str, frozenset[str]] = {}
    for model in models(root).values():
        for field, kind in fields(model).items():
            if is_model(kind):
                for word in keys(kind):
                    owners[word] = owners.get(word, frozenset()) | {field}
    return owners


def _example(root: type[Strict], path: list[Any]) -> str | None:
    kind = at(root, path)
    words = keys(kind)
    if isinstance(kind, list):
        return "a list: [..., ...]"
    if isinstance(kind, Free):
        return "{NAME: ..., ...}"
    return f"the keys {', '.join(words)}" if words else ("{}" if is_model(kind) else None)


def in_order(problems: Iterable[Problem]) -> list[Problem]:
    """Each problem once, in the order of file, line and column."""
    once = dict.fromkeys(problems)

    def place(problem: Problem) -> tuple[Any, ...]:
        location = problem.location
        return (location.file, location.line, location.column) if location else ("", 0, 0)

    return sorted(once, key=place)
