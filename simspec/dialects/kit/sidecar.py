"""The sidecar: a small JSON file alongside the files of a model, for data that these cannot carry.

Each dialect has a frozen dataclass of its own, a :class:`Sidecar` with further fields; its annotations are the form that a
sidecar's JSON must have (:func:`common_fields` are those of all).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol, Self

from simspec.contact import ContactPlan, Rules
from simspec.errors import SpecError
from simspec.files import NotReadableError, parse_json
from simspec.formats.kit.forms import check_distinct, check_fields, check_known, form_of, plain, typed
from simspec.formats.kit.text import json_text
from simspec.language.vocabulary import FRICTION_CONES, JOINT_KINDS
from simspec.outputs.files import read_text
from simspec.world.actions import Fluid, InertiaBox, JointSum
from simspec.world.canonical import sha256
from simspec.world.inertia import lumped_gravity_scale
from simspec.world.kinematics import initial_state, layout
from simspec.world.types import (
    POSITION_SIZE,
    VELOCITY_SIZE,
    Body,
    Constraint,
    FollowConstraint,
    Pair,
    Surface,
    Vector3,
    World,
)

# Fields on joints, for quantities that the language of the files lacks: springs and armature, by the name of the body.

UNREADABLE: Final[Mapping[str, str]] = {
    "collision_group": "the files carry what touches what, not the names of groups",
    "control.native": "the engine's own controllers are switched on when a run begins",
}
"""Quantities that files of most dialects cannot express, for ``ReadBack.unreadable``."""


@dataclass(frozen=True, slots=True)
class JointSpring:
    """A joint's spring: effort −k (q − rest), stiffness k (N m/rad, N/m), rest (rad, m)."""

    body: str
    stiffness: float
    rest: float


@dataclass(frozen=True, slots=True)
class JointValue:
    """A number of a body's joint."""

    body: str
    value: float


@dataclass(frozen=True, slots=True)
class Armature:
    """The addition to a joint's diagonal of the mass matrix (kg m², kg)."""

    body: str
    armature: float


class OfBody(Protocol):
    """An entry that speaks of one body."""

    @property
    def body(self) -> str:
        """The body's name."""
        ...


def springs_of(world: World) -> tuple[JointSpring, ...]:
    """The springs of a world's joints."""
    return tuple(
        JointSpring(body.name, body.joint.spring_stiffness, body.joint.spring_rest)
        for body in world.bodies
        if body.joint.spring_stiffness
    )


def armature_of(world: World) -> tuple[Armature, ...]:
    """The armature of a world's joints."""
    return tuple(Armature(body.name, body.joint.armature) for body in world.bodies if body.joint.armature)


def check_of_bodies(lists: Mapping[str, Iterable[OfBody]], bodies: Collection[str]) -> None:
    """Raise ValueError where one of a sidecar's lists names a body twice, or one that is not there."""
    for name, entries in lists.items():
        names = [entry.body for entry in entries]
        check_distinct(names, f"sidecar.{name}")
        check_known(names, bodies, f"sidecar.{name}")


def add_springs(bodies: dict[str, Body], springs: Iterable[JointSpring]) -> None:
    """Give the joints of ``bodies`` (by name) their springs."""
    for spring in springs:
        body = bodies[spring.body]
        joint = dataclasses.replace(body.joint, spring_stiffness=spring.stiffness, spring_rest=spring.rest)
        bodies[spring.body] = dataclasses.replace(body, joint=joint)


def add_armature(bodies: dict[str, Body], armature: Iterable[Armature]) -> None:
    """Give the joints of ``bodies`` (by name) their armature."""
    for entry in armature:
        body = bodies[entry.body]
        bodies[entry.body] = dataclasses.replace(body, joint=dataclasses.replace(body.joint, armature=entry.armature))


# Fields on forces that act on bodies at all times and that a format lacks: weights that are not mass × gravity, damping of free
# bodies, and a fluid. Engines are given them as efforts before every step (``engines/kit/simulated.py``).


@dataclass(frozen=True, slots=True)
class GravityScale:
    """The weight of a body is so many times mass × gravity."""

    body: str
    scale: float


@dataclass(frozen=True, slots=True)
class FreeDamping:
    """A free body's damping: a force −``linear`` v at its centre of mass (N s/m) and a torque −``angular`` ω (N m s/rad)."""

    body: str
    linear: float
    angular: float


@dataclass(frozen=True, slots=True)
class InFluid:
    """The box by which a body feels the fluid (``world/actions.py``)."""

    body: str
    box: InertiaBox


@dataclass(frozen=True, slots=True)
class Around:
    """A fluid, and the bodies that feel it."""

    fluid: Fluid
    boxes: tuple[InFluid, ...]


@dataclass(frozen=True, slots=True)
class Passive:
    """The bodies for which there is something to say, each once, in the world's order."""

    gravity_scales: tuple[GravityScale, ...]
    free_damping: tuple[FreeDamping, ...]
    around: Around | None = None

    def check(self, bodies: Collection[str]) -> None:
        """Raise ValueError where a list names a body twice, or one that is not there."""
        lists = {
            "gravity_scales": [entry.body for entry in self.gravity_scales],
            "free_damping": [entry.body for entry in self.free_damping],
            "around.boxes": [] if self.around is None else [entry.body for entry in self.around.boxes],
        }
        for name, names in lists.items():
            check_distinct(names, f"sidecar.passive.{name}")
            check_known(names, bodies, f"sidecar.passive.{name}")


def passive_of(world: World) -> Passive | None:
    """The fields of a world; None where it has none."""
    scales = ((body.name, lumped_gravity_scale(world, body)) for body in world.bodies)
    passive = Passive(
        tuple(GravityScale(name, scale) for name, scale in scales if scale != 1.0),
        tuple(
            FreeDamping(body.name, body.joint.damping, body.joint.angular_damping)
            for body in world.bodies
            if body.joint.kind == "free" and (body.joint.damping or body.joint.angular_damping)
        ),
        _around(world),
    )
    return passive if passive.gravity_scales or passive.free_damping or passive.around else None


def _around(world: World) -> Around | None:
    boxes = tuple(InFluid(body.name, body.box) for body in world.bodies if body.box is not None)
    return None if world.physics.fluid is None or not boxes else Around(world.physics.fluid, boxes)


def fluid_of(passive: Passive | None) -> Fluid | None:
    """The fluid that a sidecar says."""
    return None if passive is None or passive.around is None else passive.around.fluid


def with_passive(bodies: tuple[Body, ...], passive: Passive | None) -> tuple[Body, ...]:
    """``bodies`` as an engine receives them, completed by the efforts that it receives at every step."""
    if passive is None:
        return bodies
    scales = {entry.body: entry.scale for entry in passive.gravity_scales}
    damping = {entry.body: entry for entry in passive.free_damping}
    boxes = {} if passive.around is None else {entry.body: entry.box for entry in passive.around.boxes}
    completed = []
    for body in bodies:
        if body.name in damping:
            entry = damping[body.name]
            joint = dataclasses.replace(body.joint, damping=entry.linear, angular_damping=entry.angular)
            body = dataclasses.replace(body, joint=joint)
        scale, box = scales.get(body.name, body.gravity_scale), boxes.get(body.name, body.box)
        completed.append(dataclasses.replace(body, gravity_scale=scale, box=box))
    return tuple(completed)


# Whether the trees that a sidecar lists fit its bodies: for dialects whose files hold one tree each.

UNIT: Final = 1e-9
"""How far a quaternion may be from unit length: numbers are printed to round-trip, and normalised before."""


def check_every_body(trees: Iterable[Sequence[str]], kinds: Mapping[str, str]) -> None:
    """Raise ValueError unless each body of ``kinds`` (joint kind by name) is in one of the ``trees``, once."""
    named = [name for bodies in trees for name in bodies]
    check_distinct(named, "sidecar.instances")
    if set(named) != set(kinds):
        raise ValueError(f"sidecar.instances and sidecar.bodies differ in {sorted(set(named) ^ set(kinds))}")


def check_by_body(bodies: Sequence[str], lists: Mapping[str, Sequence[object]], at: str) -> None:
    """Raise ValueError where a tree has no bodies, or one of its lists has not one entry for each."""
    if not bodies:
        raise ValueError(f"{at} has no bodies")
    for name, entries in lists.items():
        if len(entries) != len(bodies):
            raise ValueError(f"{at}.{name} has {len(entries)} entries for {len(bodies)} bodies")


def check_coordinates(kinds: Sequence[str], position: Sequence[float], velocity: Sequence[float], at: str) -> None:
    """Raise ValueError where positions or velocities are not as many as joints of these ``kinds`` have."""
    for name, sizes, numbers in (("position", POSITION_SIZE, position), ("velocity", VELOCITY_SIZE, velocity)):
        size = sum(sizes[kind] for kind in kinds)
        if len(numbers) != size:
            raise ValueError(f"{at}.{name} has {len(numbers)} numbers, should have {size}")


def check_unit(quaternions: Iterable[Sequence[float]], at: str) -> None:
    """Raise ValueError where a quaternion is not of unit length."""
    if any(abs(math.hypot(*quaternion) - 1.0) > UNIT for quaternion in quaternions):
        raise ValueError(f"{at} has a quaternion that is not of unit length")


# A world's initial state, tree by tree, for sidecars.


class InitialCoordinates:
    """The world's initial state in generalised coordinates, by body."""

    def __init__(self, world: World):
        self._q, self._v = initial_state(world)
        self._places = layout(world.bodies)
        self._index = {body.name: index for index, body in enumerate(world.bodies)}

    def of(self, bodies: Iterable[Body]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """The positions and velocities of these bodies, one after the other."""
        q: list[float] = []
        v: list[float] = []
        for body in bodies:
            index = self._index[body.name]
            q.extend(self._q[self._places.position[index]].tolist())
            v.extend(self._v[self._places.velocity[index]].tolist())
        return tuple(q), tuple(v)


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
