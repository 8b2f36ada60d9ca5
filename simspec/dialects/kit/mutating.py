"""Every mutation of a folder's files."""

from __future__ import annotations

import json
from collections.abc import Iterator

from simspec.dialects.kit.json_mutations import json_mutations, printed
from simspec.dialects.kit.mutations import Files, Mutation, MutationTable
from simspec.dialects.kit.obj_mutations import obj_mutations
from simspec.dialects.kit.xml_mutations import Tree, xml_mutations


def mutations(files: Files, table: MutationTable) -> Iterator[Mutation]:
    """Every mutation of ``files``, each once; those that change no byte are left out. Raises ValueError for a file that is
    neither XML, JSON nor OBJ."""
    for name, text in sorted(files.items()):
        if name.endswith(".json"):
            unchanged, found = printed(json.loads(text)), json_mutations(name, text, table)
        elif name.endswith(".obj"):
            unchanged, found = text, obj_mutations(name, text, table)
        elif text.lstrip().startswith("<"):
            unchanged, found = Tree(text).text(), xml_mutations(name, text, table)
        else:
            raise ValueError(f"{name} is neither XML, JSON nor OBJ")
        seen = {unchanged}
        for mutation in found:
            if mutation.text not in seen:
                seen.add(mutation.text)
                yield mutation
