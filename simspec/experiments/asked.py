"""What a cell of a sweep asks for, hashed: a spec's data and the files that it uses, the values put in, the engine, versions.

It is cheap, since nothing is resolved for it; so values that are written otherwise and mean the same (``1 ms``, 0.001) have
different keys, and are recognised as one only by the key of the case (:meth:`simspec.runner.case.Case.key`). It is never equal
for what could run differently. Left out is what no run depends on: the name, the description, what is expected, what a table
shows, what the spec says to other engines, and the sweep.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec.errors import SpecError
from simspec.files import NotReadableError, read_bytes
from simspec.language.load import Spec
from simspec.language.overrides import Override
from simspec.language.sources import Source

if TYPE_CHECKING:
    from hashlib import _Hash as Hash

KEY_SCHEMA = 1
"""Version of what a key is made of."""
LEFT_OUT = ("name", "description", "expect", "sweep")
"""Parts of a file that no run depends on."""
LARGEST_TABLE = 64_000_000
"""Bytes of a table of a trajectory that is hashed; larger ones are refused where they are read."""


class Asked:
    """What is hashed of a spec, for engines of these ``names``. Files are read once, when they are first hashed."""

    def __init__(self, spec: Spec, names: Sequence[str]):
        self._spec, self._names = spec, tuple(names)
        self._files = _digest_of_files(spec.source, {})

    def base(self, label: str, name: str, versions: Mapping[str, str]) -> Hash:
        """The state of the hash with all that the cells of the engine of a label (of this name) have in common."""
        data = _without(self._spec.source.document.data, ("engines",))
        data["engines"] = self._spec.source.document.data.get("engines", {}).get(name, {})
        common = [KEY_SCHEMA, data, self._files.hex(), label, sorted(versions.items())]
        return hashlib.sha256(digest(common))

    def digests(self, overrides: Sequence[tuple[str, Any]]) -> dict[str, tuple[bytes, ...]]:
        """A digest of each value that is put in and that runs of an engine may depend on, by the engine's name."""
        digests = [(path.split("."), self._digest(path, value)) for path, value in overrides]
        return {name: tuple(one for steps, one in digests if _concerns(steps, name)) for name in self._names}

    def _digest(self, path: str, value: Any) -> bytes:
        steps = path.split(".")
        if steps[0] in ("models", "model", "trajectory") and (
            steps[-1] in ("use", "file") or isinstance(value, Mapping)
        ):
            source, problems = self._spec.sources_with([Override(path, value, None, None)])
            # a file that is not there is a problem of the runs that ask for it
            files = _digest_of_files(source, {}).hex() if not problems else list(map(str, problems))
            return digest([path, value, files])
        return digest([path, value])


def key_of(base: Hash, digests: Iterable[bytes]) -> Hash:
    """The state of the hash with values put in, in whatever order: no value is put in at a place inside another one."""
    hashed = base.copy()
    hashed.update(b"".join(sorted(digests)))
    hashed.update(b"|")
    return hashed


def _concerns(steps: Sequence[str], engine: str) -> bool:
    """Whether runs of an engine may depend on the value at a path."""
    if steps[0] in LEFT_OUT or steps[:2] == ["record", "show"]:
        return False
    return steps[0] != "engines" or len(steps) == 1 or steps[1] == engine


def _without(data: Mapping[str, Any], more: Sequence[str] = ()) -> dict[str, Any]:
    """A file's data without what no run depends on."""
    kept = {key: value for key, value in data.items() if key not in LEFT_OUT and key not in more}
    if isinstance(kept.get("record"), Mapping):
        kept["record"] = {key: value for key, value in kept["record"].items() if key != "show"}
    return kept


def _digest_of_files(source: Source, known: dict[int, bytes]) -> bytes:
    """A digest of the contents of all files that a file uses, and that they use."""
    parts: list[Any] = []
    for text, used in sorted(source.uses.items()):
        if id(used) not in known:
            known[id(used)] = digest([_without(used.document.data), _digest_of_files(used, known).hex()])
        parts.append([text, known[id(used)].hex()])
    if source.table is not None:
        parts.append(["table", _digest_of_table(source, source.table)])
    return digest(parts)


def _digest_of_table(source: Source, table: Path) -> str:
    try:
        return hashlib.sha256(read_bytes(table, LARGEST_TABLE, links=True)).hexdigest()
    except (NotReadableError, OSError) as error:
        place = ("trajectory", "file")
        raise SpecError([source.document.problem(place, f"cannot be read: {error}", found=table.name)]) from None


def digest(value: Any) -> bytes:
    """SHA-256 of plain data, in the order that they are written in: that of bodies is the world's."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"), default=_plain)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest()


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy, in specs that are made in Python. Raises TypeError for what is no data."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not plain data")
