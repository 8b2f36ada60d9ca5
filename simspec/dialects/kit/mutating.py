"""Every mutation of a folder's files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator

from simspec.dialects.kit.json_mutations import json_mutations, printed
from simspec.dialects.kit.mutations import Files, Mutation, MutationTable
from simspec.dialects.kit.obj_mutations import obj_mutations
from simspec.dialects.kit.vrml_mutations import vrml_mutations
from simspec.dialects.kit.xml_mutations import Tree, xml_mutations


def mutations(files: Files, table: MutationTable) -> Iterator[Mutation]:
    """Every mutation of ``files``, each once; those that change no byte are left out. Raises ValueError for a file that is
    neither XML, JSON, OBJ nor of VRML's manner."""
    for name, text in sorted(files.items()):
        seen = {unchanged_text(name, text)}
        for mutation in _made(name, text)(name, text, table):
            if mutation.text not in seen:
                seen.add(mutation.text)
                yield mutation


def unchanged_text(name: str, text: str) -> str:
    """The text of a file as its mutations have it where they do not change it. Raises ValueError as :func:`mutations`."""
    made = _made(name, text)
    if made is json_mutations:
        return printed(json.loads(text))
    return text if made in (obj_mutations, vrml_mutations) else Tree(text).text()


def _made(name: str, text: str) -> Callable[[str, str, MutationTable], Iterator[Mutation]]:
    if name.endswith(".json"):
        return json_mutations
    if name.endswith(".obj"):
        return obj_mutations
    if text.startswith("#VRML"):
        return vrml_mutations
    if text.lstrip().startswith("<"):
        return xml_mutations
    raise ValueError(f"{name} is neither XML, JSON, OBJ nor VRML")
