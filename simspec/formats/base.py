"""What a format is: a world in, files out; and the sidecar, the small JSON for what a file cannot carry."""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from simspec.errors import SpecError
from simspec.features import Table, check_total
from simspec.formats.contact_plan import ContactPlan, Rules
from simspec.outputs.reading import read_text
from simspec.plugins import Offered, offered
from simspec.reading import NotReadableError, parse_json
from simspec.resources import resource_folder
from simspec.world.canonical import sha256, to_plain
from simspec.world.types import ReadBack, Vector3, World

SIDECAR = "sidecar.json"
SIDECAR_SCHEMA = 1


@dataclass(frozen=True, slots=True)
class Target:
    """What a format must know of the engine it writes for; data, given by the engine's module."""

    engine: str
    rules: Rules
    """How the engine combines the numbers of two shapes."""
    plan: ContactPlan
    """The numbers that shapes get, and the layers of their copies."""
    settings: Mapping[str, bool | int | float | str]


class Format:
    """A language that a world is written in. Subclasses are data, a template, and ``emit``."""

    NAME: ClassVar[str]
    SUPPORT: ClassVar[Table]
    """What the files of this format can say of each feature. ``via_api`` = it goes into the sidecar."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        check_total(f"format {cls.NAME}", cls.SUPPORT)

    def emit(self, world: World, target: Target) -> dict[str, str]:
        """The files of ``world`` as {relative path: text}, ``sidecar.json`` among them."""
        raise NotImplementedError

    def read(self, folder: Path) -> ReadBack:
        """Read the files back with a parser that is neither the emitter's nor an engine's (proof level L0).

        Gives the world's frames and order. Sidecar values that belong to the model are read too.
        """
        raise NotImplementedError


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


def number(value: float) -> str:
    """The shortest text that reads back to the same double; whole numbers without a point, no negative zero.

    Raises ValueError for NaN and infinity, which no format can carry.
    """
    if not math.isfinite(value):
        raise ValueError(f"{value} cannot be written")
    if value == 0.0:
        return "0"
    text = repr(float(value))
    return text[:-2] if text.endswith(".0") else text


def numbers(values: Any) -> str:
    """Several numbers, separated by one space."""
    return " ".join([number(value) for value in values])


@functools.cache
def environment() -> Any:
    """The one Jinja2 environment: StrictUndefined, XML autoescaping, and the filters ``number`` and ``numbers``."""
    import jinja2
    from markupsafe import Markup

    found = jinja2.Environment(
        loader=jinja2.FileSystemLoader(resource_folder("templates")),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    # digits, signs, points and e need no escaping: marking them safe spares the escape of every number
    found.filters["number"] = lambda value: Markup(number(value))
    found.filters["numbers"] = lambda values: Markup(numbers(values))
    return found


@functools.cache
def _offered() -> Offered:
    return offered("simspec.formats", _sound)


def _sound(name: str, kind: Any) -> Format:
    """The format, if it is one that can be used. Raises TypeError, ValueError."""
    if not (isinstance(kind, type) and issubclass(kind, Format)):
        raise TypeError("it is no Format")
    missing = [word for word in ("NAME", "SUPPORT") if not hasattr(kind, word)]
    if missing or name != kind.NAME:
        raise ValueError(f"it does not say its {', '.join(missing)}" if missing else f"it calls itself {kind.NAME!r}")
    return kind()


def formats() -> Mapping[str, Format]:
    """Every installed format by name (entry points ``simspec.formats``)."""
    return _offered().good


def broken_formats() -> Mapping[str, str]:
    """The formats that are offered and cannot be used, with the reason."""
    return _offered().broken
