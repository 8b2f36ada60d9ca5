"""Every change that a JSON file can suffer, one at a time; see ``mutations.py``."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from simspec.dialects.kit.mutations import MOVED, UNKNOWN, Mutation, MutationTable, changed


def json_mutations(file: str, text: str, table: MutationTable) -> Iterator[Mutation]:
    root = json.loads(text)
    words: dict[str, list[str]] = {}
    for _, _, value, site, _ in _fields(root):
        if isinstance(value, str):
            words.setdefault(site, []).append(value)

    def made(kind: str, site: str, place: str, change: str) -> Mutation:
        return Mutation(file, kind, site, place, change, printed(root))

    for holder, key, value, site, place in list(_fields(root)):
        for kind, new in _value_changes(value, site, words, table):
            holder[key] = new
            yield made(kind, site, place, f"{value!r} to {new!r}")
        holder[key] = value
        if isinstance(holder, list):
            holder.insert(key, copy.deepcopy(value))
            yield made("element doubled", site, place, "")
            del holder[key]
            if key + 1 < len(holder):
                holder[key], holder[key + 1] = holder[key + 1], holder[key]
                yield made("swapped", site, place, "with the next")
                holder[key], holder[key + 1] = holder[key + 1], holder[key]
            del holder[key]
            yield made("element removed", site, place, "")
            holder.insert(key, value)
        else:
            before = dict(holder)
            del holder[key]
            yield made("field removed", site, place, "")
            holder.clear()
            holder.update(before)
    sites = [(root, "")] + [
        (value, site) for _, _, value, site, _ in list(_fields(root)) if isinstance(value, (dict, list))
    ]
    for row in table.added(file):
        for value, site in sites:
            if site != row.where or (isinstance(value, dict) and row.name in value):
                continue
            fresh = json.loads(row.value)
            if isinstance(value, dict):
                value[row.name] = fresh
                yield made("field added", f"{site}.{row.name}".lstrip("."), f"{site}.{row.name}", row.value)
                del value[row.name]
            else:
                value.append(fresh)
                yield made("field added", site, site, row.value)
                value.pop()
            if row.once:
                break


def printed(value: Any) -> str:
    return json.dumps(value, indent=2) + "\n"


def _fields(value: Any, site: str = "", place: str = "") -> Iterator[tuple[Any, Any, Any, str, str]]:
    """Every field of a JSON value: (its holder, its key, itself, site, place)."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        # what is keyed by names of the world is one site
        step = "*" if isinstance(value, list) else str(key)
        own, there = f"{site}.{step}".lstrip("."), f"{place}.{key}".lstrip(".")
        yield value, key, item, own, there
        yield from _fields(item, own, there)


def _value_changes(
    value: Any, site: str, words: Mapping[str, Sequence[str]], table: MutationTable
) -> Iterator[tuple[str, Any]]:
    if isinstance(value, bool):
        yield "flag", not value
    elif isinstance(value, int):
        yield ("scaled" if value else "moved"), value + 1
        if value:
            yield "sign", -value
    elif isinstance(value, float):
        for kind, new in changed(value, site, table):
            yield kind, float(new)
    elif isinstance(value, str):
        given = table.words.get(site)
        for word in given if given is not None else (*sorted(set(words[site]) - {value}), UNKNOWN):
            if word != value:
                yield "word", word
    elif value is None:
        yield "moved", MOVED
