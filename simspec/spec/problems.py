"""pydantic's errors as located problems in the words of the language."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from pydantic import ValidationError

from simspec.errors import Problem
from simspec.spec import walk
from simspec.spec.document import Document
from simspec.spec.models import File
from simspec.spec.strict import FAULT, REPORTED, Strict, near, show

_WANTED = {
    "dict_type": "wants a mapping (key: value)",
    "list_type": "wants a list",
    "model_type": "wants a mapping (key: value)",
}


def of_validation(error: ValidationError, document: Document, root: type[Strict] = File) -> Iterator[Problem]:
    """Every error as a problem, in the order that pydantic found them."""
    for one in error.errors(include_url=False):
        if one["type"] == REPORTED:
            continue
        path, key = list(one["loc"]), False
        if path and path[-1] == "[key]":
            path, key = path[:-1], True
        if one["type"] == FAULT:
            context = one["ctx"]
            more = {name: context[name] for name in ("found", "allowed", "hint")}
            # an unknown word at a key's place is shown at the key
            yield document.problem(path, context["message"], key=key, **more)
        elif one["type"] == "extra_forbidden":
            yield _unknown(path, document, root)
        elif one["type"] == "missing":
            owner = ".".join(str(step) for step in path[:-1])
            message = f"{path[-1]} is missing" + (f" in {owner}" if owner else "")
            kind = walk.at(root, path)
            allowed = kind.describe() if isinstance(kind, walk.Reader) else None
            yield document.problem(path, message, allowed=allowed)
        else:
            wanted = _WANTED.get(one["type"], one["msg"])
            yield document.problem(path, wanted, found=show(one["input"]), allowed=_example(root, path))


def _unknown(path: list[Any], document: Document, root: type[Strict]) -> Problem:
    words = walk.keys(walk.at(root, path[:-1]))
    hint = near(path[-1], words) or _elsewhere(str(path[-1]), root)
    return document.problem(path, f"unknown key {path[-1]!r}", key=True, allowed=", ".join(words), hint=hint)


def _elsewhere(word: str, root: type[Strict]) -> str | None:
    """Where the language has a key of this name, if that is one place only."""
    places = [place for place, name in _all_keys(root) if name == word]
    return f"{word} belongs to {places[0]}" if len(places) == 1 else None


def _all_keys(kind: Any, place: str = "", depth: int = 0) -> Iterable[tuple[str, str]]:
    if depth > 8:
        return
    if isinstance(kind, walk.Free):
        yield from _all_keys(kind.item, f"{place}.NAME", depth + 1)
    elif isinstance(kind, list):
        yield from _all_keys(kind[0], place, depth + 1)
    elif walk.is_model(kind):
        for name, below in walk.fields(kind).items():
            path = f"{place}.{name}".lstrip(".")
            yield place.lstrip(".") or "the top", name
            yield from _all_keys(below, path, depth + 1)


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
