"""The sidecar: the small JSON beside the files of a model, for what the files cannot carry."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simspec.dialects.kit.target import Target
from simspec.errors import SpecError
from simspec.outputs.reading import read_text
from simspec.reading import NotReadableError, parse_json
from simspec.world.canonical import sha256, to_plain
from simspec.world.types import Vector3, World

SIDECAR = "sidecar.json"
SIDECAR_SCHEMA = 1


def sidecar(
    format_name: str, world: World, target: Target, offsets: Mapping[str, Vector3], **more: Any
) -> dict[str, Any]:
    """The part of a sidecar that every format has.

    schema, format, engine; world (its SHA-256); settings (the engine's solver settings, all of them); bodies: in the
    world's order, each with name, joint kind and ``frame_offset``, the position of the file's body frame in the
    world's (zero but for free roots, see ``passes.recentre_free_roots``); contact: the cone.
    """
    return {
        "schema": SIDECAR_SCHEMA,
        "format": format_name,
        "engine": target.engine,
        "world": sha256(world),
        "settings": dict(sorted(target.settings.items())),
        "bodies": [
            {
                "name": body.name,
                "kind": body.joint.kind,
                "frame_offset": list(offsets.get(body.name, (0.0, 0.0, 0.0))),
            }
            for body in world.bodies
        ],
        "friction_cone": world.contact.friction_cone,
        **more,
    }


def sidecar_text(content: Mapping[str, Any]) -> str:
    """The sidecar as text: sorted keys, two spaces, short lists of numbers on one line, newline at the end."""
    text = json.dumps(to_plain(dict(content)), indent=2, sort_keys=True, allow_nan=False, ensure_ascii=False)
    return _NUMBER_LIST.sub(_on_one_line, text) + "\n"


_NUMBER_LIST = re.compile(r'\[[^\[\]{}"]*\]')


def _on_one_line(found: re.Match[str]) -> str:
    return "[" + ", ".join(found.group()[1:-1].replace("\n", " ").replace(",", " ").split()) + "]"


def flat(content: Any, prefix: str) -> dict[str, Any]:
    """Nested plain data as one level: ``{"settings.solver": ..., "bodies.0.name": ...}`` under ``prefix``; a list of plain
    values is one value, an empty list or dict too. For the inventory of what an engine holds (``ReadBack.inventory``)."""
    if isinstance(content, Mapping) and content:
        items = content.items()
    elif isinstance(content, (list, tuple)) and any(isinstance(item, (Mapping, list, tuple)) for item in content):
        items = enumerate(content)
    else:
        return {prefix: tuple(content) if isinstance(content, (list, tuple, Mapping)) else content}
    return {key: value for name, item in items for key, value in flat(item, f"{prefix}.{name}").items()}


def read_sidecar(folder: Path) -> dict[str, Any]:
    """The sidecar of a folder of artifacts.

    Raises FileNotFoundError when there is none, and ValueError, which names it, when it is no regular file, not JSON, or of
    another schema version.
    """
    path = folder / SIDECAR
    try:
        content = parse_json(read_text(path))
    except SpecError as error:
        raise ValueError(str(error)) from None
    except NotReadableError as error:
        raise ValueError(f"{path}: {error}") from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != SIDECAR_SCHEMA:
        raise ValueError(f"{path}: schema {schema!r}, this simspec reads {SIDECAR_SCHEMA}")
    return content
