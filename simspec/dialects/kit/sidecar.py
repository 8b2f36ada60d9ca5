"""The sidecar: a small JSON file alongside the files of a model, for data that these cannot carry.

Each dialect has a frozen dataclass of its own, a :class:`Sidecar` with further fields; its annotations are the form that a
sidecar's JSON must have (``sidecar_fields.py``).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from simspec.contact.plan import ContactPlan
from simspec.contact.rules import Rules
from simspec.dialects.kit.joints import Passive, passive_of
from simspec.errors import SpecError
from simspec.files import NotReadableError, parse_json
from simspec.formats.kit.forms import check_distinct, check_fields, check_known, form_of, plain, typed
from simspec.formats.kit.text import json_text
from simspec.language.vocabulary import FRICTION_CONES, JOINT_KINDS
from simspec.outputs.files import read_text
from simspec.world.actions import JointSum
from simspec.world.canonical import sha256
from simspec.world.types import Constraint, FollowConstraint, Pair, Surface, Vector3, World

# Properties of the engine that a dialect writes for.


@dataclass(frozen=True, slots=True)
class Target:
    """Properties of the engine that a dialect writes for; data, given by the engine's module."""

    engine: str
    rules: Rules
    """How the engine combines the numbers of two shapes."""
    plan: ContactPlan
    """The numbers that shapes get, and the layers of their copies."""
    settings: Mapping[str, bool | int | float | str]
    pair_settings: Mapping[Pair, Mapping[str, bool | int | float | str]] = field(default_factory=dict)
    """Settings of pairs of materials, which replace ``settings`` in their contacts."""

    def between(self, pair: Pair) -> Target:
        """The target with the settings that are in force between two materials (sorted names)."""
        pair_setting = self.pair_settings.get(pair)
        return dataclasses.replace(self, settings={**self.settings, **pair_setting}) if pair_setting else self


def known(numbers: Surface, quantity: str) -> float:
    """A number that the plan gives a shape. Raises ValueError where it gives none."""
    value: float | None = getattr(numbers, quantity)
    if value is None:
        raise ValueError(f"the contact plan lacks the {quantity} of {numbers}")
    return value


SIDECAR = "sidecar.json"
SIDECAR_SCHEMA = 2
"""2: a sidecar names its dialect."""


@dataclass(frozen=True, slots=True)
class SidecarBody:
    """One body: its name, the kind of its joint, and where the file's body frame stands in the world's (m): zero but for free
    roots (see ``formats/kit/contract.py``)."""

    name: str
    kind: str
    frame_offset: Vector3


@dataclass(frozen=True, slots=True)
class SidecarPair:
    """Settings of a pair of materials (sorted names), and the names of the solid shapes of both."""

    between: tuple[str, str]
    shapes: tuple[tuple[str, ...], tuple[str, ...]]
    settings: Mapping[str, bool | int | float | str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sidecar:
    """Fields of every sidecar. A field whose default is None is left out of the text where it is None."""

    schema: int = SIDECAR_SCHEMA
    dialect: str
    format: str
    engine: str
    world: str
    """SHA-256 of the world."""
    settings: Mapping[str, bool | int | float | str]
    """The engine's solver settings, all of them."""
    bodies: tuple[SidecarBody, ...]
    """In the world's order."""
    friction_cone: str
    pair_settings: tuple[SidecarPair, ...] | None = None
    """Settings of pairs of materials that replace ``settings`` in their contacts."""
    constraints: tuple[Constraint, ...] | None = None
    """The world's constraints, in the world's frames, where the files do not carry them; None where there are none."""
    sums: tuple[JointSum, ...] | None = None
    """The world's sums of joint positions, where the files do not carry them; None where there are none."""
    passive: Passive | None = None
    """Forces that act on bodies at all times, where the files do not carry them; None where there are none."""

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Self:
        """The sidecar that parsed JSON is. Raises ValueError, which names the place, where a field is missing, unknown or of
        another kind, or where fields do not fit together."""
        check_fields(content, form_of(cls))  # type: ignore[arg-type]
        sidecar: Self = typed(cls, content)
        check_distinct((body.name for body in sidecar.bodies), "sidecar.bodies")
        check_known((body.kind for body in sidecar.bodies), JOINT_KINDS, "sidecar.bodies")
        check_known((sidecar.friction_cone,), FRICTION_CONES, "sidecar.friction_cone")
        check_distinct((constraint.name for constraint in sidecar.constraints or ()), "sidecar.constraints")
        check_distinct((sum_.name for sum_ in sidecar.sums or ()), "sidecar.sums")
        ends = (
            name
            for constraint in sidecar.constraints or ()
            if not isinstance(constraint, FollowConstraint)
            for name in (constraint.first, constraint.second)
        )
        check_known(ends, [body.name for body in sidecar.bodies], "sidecar.constraints")
        if sidecar.passive is not None:
            sidecar.passive.check([body.name for body in sidecar.bodies])
        sidecar.check()
        return sidecar

    def settings_between(self, first: str, second: str) -> Mapping[str, bool | int | float | str]:
        """The settings that are in force between two shapes."""
        for pair in self.pair_settings or ():
            entry, other = pair.shapes
            if (first in entry and second in other) or (second in entry and first in other):
                return {**self.settings, **pair.settings}
        return self.settings

    @property
    def offsets(self) -> dict[str, Vector3]:
        """Where the file's body frames stand in the world's (m), of those that are moved."""
        return {body.name: body.frame_offset for body in self.bodies if any(body.frame_offset)}

    def check(self) -> None:
        """Raise ValueError where fields of a dialect's own do not fit together, or name what is not there."""

    def plain(self) -> dict[str, Any]:
        """As plain data, for JSON."""
        content: dict[str, Any] = plain(self)
        return content


def common_fields(
    dialect: str,
    format_name: str,
    world: World,
    target: Target,
    offsets: Mapping[str, Vector3],
    alongside: bool = True,
) -> dict[str, Any]:
    """The fields of :class:`Sidecar` for ``world``; ``offsets`` as :func:`recentre_free_roots` gives them. ``beside``: whether
    constraints, sums, and what acts on bodies at all times, stand in the sidecar, and not in the files."""
    fields: dict[str, Any] = {
        "dialect": dialect,
        "format": format_name,
        "engine": target.engine,
        "world": sha256(world),
        "settings": dict(sorted(target.settings.items())),
        "bodies": tuple(
            SidecarBody(body.name, body.joint.kind, offsets.get(body.name, (0.0, 0.0, 0.0))) for body in world.bodies
        ),
        "friction_cone": world.contact.friction_cone,
    }
    if target.pair_settings:
        fields["pair_settings"] = tuple(_pairs(world, target))
    if alongside and world.constraints:
        fields["constraints"] = world.constraints
    if alongside and world.sums:
        fields["sums"] = world.sums
    if alongside and (passive := passive_of(world)) is not None:
        fields["passive"] = passive
    return fields


def _pairs(world: World, target: Target) -> Iterator[SidecarPair]:
    names: dict[str, list[str]] = {}
    for body in world.bodies:
        for shape in body.shapes:
            if shape.collision:
                names.setdefault(shape.material, []).append(shape.name)
    for pair, settings in sorted(target.pair_settings.items()):
        first, second = (tuple(names.get(material, ())) for material in pair)
        yield SidecarPair(pair, (first, second), dict(sorted(settings.items())))


def sidecar_text(content: Mapping[str, Any]) -> str:
    """The sidecar as text."""
    return json_text(dict(content))


def flat(content: Any, prefix: str) -> dict[str, Any]:
    """Nested plain data as one level: ``{"settings.solver": ..., "bodies.0.name": ...}`` under ``prefix``; a list of plain
    values is one value, an empty list or dict too. For the inventory of what an engine holds (``ReadBack.inventory``)."""
    items: Iterable[tuple[Any, Any]]
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
        content: dict[str, Any] = parse_json(read_text(path))
    except SpecError as error:
        raise ValueError(str(error)) from None
    except NotReadableError as error:
        raise ValueError(f"{path}: {error}") from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != SIDECAR_SCHEMA:
        raise ValueError(f"{path}: schema {schema!r}, this simspec reads {SIDECAR_SCHEMA}")
    return content
