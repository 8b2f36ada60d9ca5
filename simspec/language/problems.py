"""pydantic's errors as located problems in the words of the language."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from pydantic import ValidationError

from simspec.errors import Problem
from simspec.language import walk
from simspec.language.document import Document
from simspec.language.hints import hint_for_key
from simspec.language.models import File
from simspec.language.reader import Reader
from simspec.language.strict import FAULT, REPORTED, Strict, near, show

MOST_LOOKED_AT = 2000
"""Problems of one file that are told with their places and hints: all that can be read; a second's worth."""
_WANTED = {
    "dict_type": "expected a mapping (key: value)",
    "list_type": "expected a list",
    "model_type": "expected a mapping (key: value)",
}


def of_validation(error: ValidationError, document: Document, root: type[Strict] = File) -> Iterator[Problem]:
    """Every error as a problem, in the order that pydantic found them."""
    errors = error.errors(include_url=False)
    if len(errors) > MOST_LOOKED_AT:
        yield document.problem((), f"{len(errors):,} problems, of which the first {MOST_LOOKED_AT:,} are listed")
        del errors[MOST_LOOKED_AT:]
    unknown: dict[tuple[Any, ...], set[str | None]] = {}
    for item in errors:
        if item["type"] == "extra_forbidden":
            words = walk.keys(walk.at(root, item["loc"][:-1]))
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
            more = {name: context[name] for name in ("found", "allowed", "hint")}
            # an unknown word at a key's place is shown at the key
            yield document.problem(path, context["message"], key=key, **more)
        elif item["type"] == "extra_forbidden":
            yield _unknown(path, document, root)
        elif item["type"] == "missing":
            owner = ".".join(str(step) for step in path[:-1])
            message = f"{path[-1]} is missing" + (f" in {owner}" if owner else "")
            kind = walk.at(root, path)
            allowed = kind.describe() if isinstance(kind, Reader) else None
            yield document.problem(path, message, allowed=allowed)
        else:
            wanted = _WANTED.get(item["type"], item["msg"])
            yield document.problem(path, wanted, found=show(item["input"]), allowed=_example(root, path))


def _unknown(path: list[Any], document: Document, root: type[Strict]) -> Problem:
    owner = walk.at(root, path[:-1])
    words = walk.keys(owner)
    known = hint_for_key(str(path[-1]), owner.__name__) if walk.is_model(owner) else None
    hint = known or near(path[-1], words) or _elsewhere(str(path[-1]), root)
    return document.problem(path, f"unknown key {path[-1]!r}", key=True, allowed=", ".join(words), hint=hint)


def _elsewhere(word: str, root: type[Strict]) -> str | None:
    """The part of the language that has a key of this name, if there is just one."""
    owners = _owners(root).get(word, frozenset())
    return f"{word} belongs to {next(iter(owners))}" if len(owners) == 1 else None


@functools.cache
def _owners(root: type[Strict]) -> Mapping[str, frozenset[str]]:
    """The parts of the language that have a key, by the key."""
    owners: dict[str, frozenset[str]] = {}
    for model in walk.models(root).values():
        for field, kind in walk.fields(model).items():
            if walk.is_model(kind):
                for word in walk.keys(kind):
                    owners[word] = owners.get(word, frozenset()) | {field}
    return owners


def _example(root: type[Strict], path: list[Any]) -> str | None:
    kind = walk.at(root, path)
    words = walk.keys(kind)
    if isinstance(kind, list):
        return "a list: [..., ...]"
    if isinstance(kind, walk.Free):
        return "{NAME: ..., ...}"
    return f"the keys {', '.join(words)}" if words else ("{}" if walk.is_model(kind) else None)


def in_order(problems: Iterable[Problem]) -> list[Problem]:
    """Each problem once, in the order of file, line and column."""
    once = dict.fromkeys(problems)

    def place(problem: Problem) -> tuple[Any, ...]:
        location = problem.location
        return (location.file, location.line, location.column) if location else ("", 0, 0)

    return sorted(once, key=place)
