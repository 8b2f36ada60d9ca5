"""The numbers that a loaded ``mjModel`` must have, from the world and the settings resolved from it.

This states MuJoCo's numbers a second time, from the law: it shares no code with the writers of the file (``dialects/mujoco``,
``formats/mjcf/filter.py``). Only the plan of the numbers of materials (``contact.py``) is common to all sides.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from simspec.contact import Rules, contact_plan
from simspec.world import frames
from simspec.world.actions import JointSum
from simspec.world.canonical import sha256
from simspec.world.contact_pairs import meeting_laws, shape_pairs
from simspec.world.frames import quaternion, vector3
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import absorbed, free_rigid, rigid_groups
from simspec.world.types import (
    VELOCITY_SIZE,
    Body,
    Hardness,
    Joint,
    Pair,
    PairContact,
    Quaternion,
    Shape,
    Surface,
    World,
)

SOFT, CUSHION, HARDEST = 1e-4, 0.01, 0.9999
"""Impedance of springs, of a frictional contact at first touch, and the largest there is."""
DEFAULT_REFERENCE, DEFAULT_IMPEDANCE = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
COMPLIANT = ("time-constant", "stiffness")
GROUP = {(True, True): 0, (False, True): 2, (True, False): 3, (False, False): 4}
"""Of (solid, visible)."""
CLASSES_OF_MASKS = 30
"""Classes of shapes, in addition to the common class, that the bits of a mask distinguish."""
Kinds = frozenset[tuple[str, str]]
"""Kinds of solid shapes: collision group and material."""


def flat_impedance(value: float) -> tuple[float, ...]:
    """solimp of an impedance that does not depend on depth."""
    return (value, value, 0.001, 0.5, 2.0)


Reference = tuple[tuple[float, ...], tuple[float, ...]]
"""solref and solimp."""


class MujocoContactLaw(NamedTuple):
    """MuJoCo's numbers of a geom or of an explicit pair; friction is sliding, torsional, rolling."""

    condim: int
    friction: tuple[float, float, float]
    reference: Reference
    group: int = 0
    slip_rate: float = 0.0
    """1/s at which friction takes back slip."""


def _law(surface: Surface, reference: Reference) -> MujocoContactLaw:
    sliding, torsional = surface.friction or 0.0, surface.torsional_friction or 0.0
    rolling = surface.rolling_friction or 0.0
    return MujocoContactLaw(
        6 if rolling else 4 if torsional else 3 if sliding else 1, (sliding, torsional, rolling), reference
    )


class MujocoExpectedJoint(NamedTuple):
    """A joint that moves. ``start``: its coordinates before a keyframe is loaded."""

    e: MujocoExpectation
    joint: Joint
    dofs: int
    start: tuple[float, ...]

    def by_dof(self, number: float, angular: float) -> tuple[float, ...]:
        """A number for each degree of freedom; the last three of a free joint are of rotation."""
        return (number,) * 3 + (angular,) * 3 if self.joint.kind == "free" else (number,) * self.dofs


@dataclass
class MujocoExpectation:
    """A world with all settings (resolved, with defaults) in force, and the numbers that follow from both.

    ``neutral``: MuJoCo's defaults; ``engine``: the name of the engine that receives MuJoCo's files.
    """

    world: World
    settings: Mapping[str, Any]
    neutral: Mapping[str, Any]
    rules: Rules
    layers: bool
    engine: str = "mujoco"

    def __post_init__(self) -> None:
        world = self.world
        self.by_pair = {(pair.first, pair.second): dict(pair.settings) for pair in world.options(self.engine).pairs}
        self.plan = contact_plan(world, self.rules, self.layers)
        self.laws = meeting_laws(world)
        self.dt = world.physics.timestep
        self.groups = rigid_groups(world)
        self.solid = {body.name: [shape for shape in body.shapes if shape.collision] for body in world.bodies}
        self.solid_shapes = [shape for shapes in self.solid.values() for shape in shapes]
        self.owners = {shape.name: (body, shape) for body in world.bodies for shape in body.shapes}
        self.touching = Touching(world)
        self.moving = [body for body in world.bodies if body.joint.kind != "fixed"]
        self.fluid = world.physics.fluid if any(body.box is not None for body in world.bodies) else None
        self.assets = {
            kind: list(dict.fromkeys(shape.size for _, shape in self.owners.values() if shape.kind == kind))
            for kind in ("mesh", "heightfield")
        }
        """The distinct meshes and height fields, in the order in which the file has them."""

    def setting(self, name: str) -> float:
        return float(self.settings[name])

    @property
    def integrator(self) -> str:
        """The method of integration; MuJoCo's rewritten engines have one alone."""
        return str(self.settings.get("integrator", "common"))

    @property
    def sleeping(self) -> bool:
        return "sleeping" in self.settings and bool(self.settings["sleeping"])

    @property
    def coulomb(self) -> bool:
        """Whether friction obeys Coulomb's law, which needs neither a cushion nor a rate."""
        return bool(self.settings["friction"] == "coulomb")

    @cached_property
    def impratio(self) -> float:
        least, most = float(self.settings["impratio"]), float(self.settings["high_impratio"])
        needed = 0.0
        for law in self.laws.values():
            if law.friction and law.hardness.kind in COMPLIANT:
                return most
            for moment in (law.torsional_friction, law.rolling_friction):
                if law.friction and moment:
                    # 1e4 at 0.5 ms and c = μ mm, with the inverse square of both
                    needed = max(needed, 1e4 * (law.friction * 1e-3 / moment) ** 2 * (0.5e-3 / self.dt) ** 2)
        powers = (float(f"1e{exponent}") for exponent in range(-30, 30))
        raised = next(power for power in powers if power >= 0.999 * needed)
        return max(least, min(most, raised))

    # --- contact numbers ------------------------------------------------------------------------------------------

    def reference(self, surface: Surface, inverse_mass: float, cushion: bool, settings: Mapping[str, Any]) -> Reference:
        """Of a law."""
        hardness = surface.hardness or Hardness()
        high = float(settings["contact_impedance"])
        if hardness.kind == "native":
            return DEFAULT_REFERENCE, DEFAULT_IMPEDANCE
        if hardness.kind == "time-constant":
            return (hardness.time_constant, hardness.damping_ratio), flat_impedance(SOFT)
        if hardness.kind == "stiffness":
            share = (1.0 - SOFT) * inverse_mass
            return (-hardness.stiffness * share, -hardness.damping * share), flat_impedance(SOFT)
        taken_back, bounce = float(settings["contact_error_reduction"]), surface.restitution or 0.0
        solref = (-taken_back / self.dt**2, -(1.0 + bounce) / self.dt)
        depth = float(settings["friction_cushion"])
        cushioned = cushion and not self.coulomb and self.world.contact.friction_cone == "elliptic"
        soft = cushioned and depth and surface.friction and not bounce
        return solref, ((CUSHION, high, depth, 0.5, 2.0) if soft else flat_impedance(high))

    def geom(self, shape: Shape) -> MujocoContactLaw:
        surface = self.plan.numbers[shape.material, 0] if shape.collision else Surface()
        group = GROUP[shape.collision, shape.visual]
        return _law(surface, self.reference(surface, 1.0, False, self.settings))._replace(group=group)

    def pair(self, law: PairContact, name: str, other: str) -> MujocoContactLaw:
        """The numbers of an explicit pair of two shapes, by their names."""
        surface = Surface(law.friction, law.torsional_friction, law.rolling_friction, law.restitution, law.hardness)
        settings = {**self.settings, **self.by_pair.get((law.first, law.second), {})}
        inverse_mass = self._inverse_mass(name) + self._inverse_mass(other)
        numbers = _law(surface, self.reference(surface, inverse_mass, True, settings))
        return numbers._replace(slip_rate=self._slip_rate(law.hardness.kind, settings))

    def margin(self, law: PairContact, name: str, other: str) -> float:
        return self.owners[name][1].margin + self.owners[other][1].margin if law.margin is None else law.margin

    def joint(self, body: Body) -> MujocoExpectedJoint:
        """A free joint starts with the body's centre of mass in its place, a ball unturned."""
        joint: Joint = body.joint
        start: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
        if joint.kind == "free":
            turn = quaternion(joint.position[3:7])
            centre = frames.rotate(turn, lumped_inertial(self.world, body).centre_of_mass)
            start = (*frames.add(vector3(joint.position[:3]), centre), *turn)
        return MujocoExpectedJoint(self, joint, VELOCITY_SIZE[joint.kind], start)

    def tendon(self, summed: JointSum) -> tuple[Reference, Reference]:
        """Of the limits and of the dry friction of a sum of joint positions."""
        limit: Reference = (DEFAULT_REFERENCE, DEFAULT_IMPEDANCE)
        friction = limit
        if summed.position_limits is not None:
            reference = (-self.setting("limit_error_reduction") / self.dt**2, -1.0 / self.dt)
            limit = (reference, flat_impedance(self.setting("limit_impedance")))
        if summed.dry_friction:
            friction = ((0.0, -1.0 / self.dt), flat_impedance(self.setting("dry_friction_impedance")))
        return limit, friction

    @cached_property
    def explicit(self) -> tuple[list[tuple[Pair, str, str]], bool]:
        """The explicit pairs of shapes, with the materials that they are of; and whether all with friction are among them."""
        elliptic = self.world.contact.friction_cone == "elliptic"
        must, may = [], []
        for pair, law in self.laws.items():
            kind = law.hardness.kind
            if pair in self.plan.missed or kind == "stiffness" or pair in self.by_pair or law.margin is not None:
                must.append(pair)
            elif self.coulomb:
                continue
            elif law.friction and (kind in COMPLIANT or (law.restitution and elliptic)):
                must.append(pair)
            elif elliptic and law.friction and kind != "native":
                may.append(pair)
        number: dict[str, int] = {}
        for shape in self.solid_shapes:
            number[shape.material] = number.get(shape.material, 0) + 1
        most = sum(number[a] * (number[b] if a != b else number[b] / 2) for a, b in (*must, *may))
        all_there = most <= int(self.settings["explicit_pairs_limit"])
        chosen = [*must, *may] if all_there else must
        return [(pair, name, two) for pair in chosen for name, two in shape_pairs(self.world, [pair])], all_there

    def _slip_rate(self, kind: str, settings: Mapping[str, Any]) -> float:
        """1/s at which friction takes back slip."""
        if kind == "native":
            return 0.0
        if self.coulomb:
            return 1.0 / self.dt
        most = float(settings["friction_share"]) / self.dt
        return most * SOFT if kind in COMPLIANT else min(most, float(settings["friction_rate"]))

    def _inverse_mass(self, shape: str) -> float:
        """Of a single free body; nothing that stiffness is allowed for has another."""
        owner, _ = self.owners[shape]
        mass = lumped_inertial(self.world, owner).mass
        return 0.0 if self.groups[owner.name] == "world" or not mass else 1.0 / mass

    # --- the rest -------------------------------------------------------------------------------------------------

    def trees(self) -> Iterator[tuple[str, bool]]:
        """The topmost moving body of each of MuJoCo's trees, as its file has it, and whether the tree must stay awake: all but
        single free rigid bodies do, where any tree sleeps."""
        may_sleep, carriers = free_rigid(self.world), absorbed(self.world)
        for body in self.moving:
            parent = body.joint.parent
            if parent is None or self.groups[parent] == "world":
                yield carriers.get(body.name, body.name), self.sleeping and body.name not in may_sleep

    def _carriers(self) -> dict[str, Quaternion]:
        """Orientations of what stands between joints in the body's frame, all joints at zero."""
        found = {}
        known = {body.name: body for body in self.world.bodies}
        for name in absorbed(self.world):
            body, turn = known[absorbed(self.world)[name]], frames.IDENTITY
            while body.name != name:
                turn = frames.multiply(body.joint.origin.quaternion, turn)
                body = known[str(body.joint.parent)]
            found[name] = frames.conjugate(turn)
        return found

    def _pair_entry(self, pair: Pair) -> dict[str, Any]:
        """The sidecar's entry of a pair of materials with separate settings."""
        named = [[shape.name for shape in self.solid_shapes if shape.material == material] for material in pair]
        return {"between": list(pair), "shapes": named, "settings": self.by_pair[pair]}

    def sidecar(self) -> dict[str, Any]:
        settings = {**self.settings, "impratio": self.impratio}
        if self.sleeping:
            settings["island"] = True
        else:
            for name in ("sleeping", "sleep_tolerance"):  # means nothing without its switch, and is not written
                settings.pop(name, None)
        if self.integrator == "common":
            settings.pop("integrator", None)
        if not settings.get("arena"):
            settings.pop("arena", None)
        bodies = self.world.bodies
        free = {
            body.name: lumped_inertial(self.world, body).centre_of_mass for body in bodies if body.joint.kind == "free"
        }
        return {
            **({"pair_settings": [self._pair_entry(pair) for pair in sorted(self.by_pair)]} if self.by_pair else {}),
            "schema": 2,
            "dialect": "mujoco",
            "format": "mjcf",
            "engine": self.engine,
            "world": sha256(self.world),
            "settings": settings,
            "bodies": [
                {"name": body.name, "kind": body.joint.kind, "frame_offset": free.get(body.name, (0.0, 0.0, 0.0))}
                for body in bodies
            ],
            "friction_cone": self.world.contact.friction_cone,
            "explicit_pairs": self.explicit[1],
            "models": [body.model for body in bodies],
            "fixed_joints": {body.name: body.joint.name for body in bodies if body.joint.kind == "fixed"},
            **({"carriers": turns} if (turns := self._carriers()) else {}),
        }


class Touching:
    """The filter of collisions between shapes of a world in MuJoCo."""

    def __init__(self, world: World):
        self.world = world
        self.groups = rigid_groups(world)
        self.solid = {body.name: [shape for shape in body.shapes if shape.collision] for body in world.bodies}

    @cached_property
    def _classes(self) -> dict[Kinds, list[tuple[str, str]]]:
        """Kinds of solid shapes, (collision group, material), by the kinds that they do not touch."""
        kinds = sorted({(b.collision_group, s.material) for b in self.world.bodies for s in self.solid[b.name]})
        passing = {frozenset((pair.first, pair.second)) for pair in self.world.contact.pairs if not pair.collide}
        ignored = {frozenset(groups) for groups in self.world.contact.ignored_groups}
        found: dict[Kinds, list[tuple[str, str]]] = {}
        for kind in kinds:
            separate = frozenset(
                other
                for other in kinds
                if frozenset((kind[0], other[0])) in ignored or frozenset((kind[1], other[1])) in passing
            )
            found.setdefault(separate, []).append(kind)
        return found

    def by_bodies(self) -> bool:
        """Whether masks have too few bits, and bodies are excluded pair by pair."""
        return sum(bool(class_) for class_ in self._classes) > CLASSES_OF_MASKS

    def masks(self) -> dict[str, Any]:
        """Classes of shapes by their masks: members, and the classes that they touch."""
        names: dict[Any, list[str]] = {}
        row = {kind: name for name, kinds in self._classes.items() for kind in kinds}
        by_bodies = self.by_bodies()
        for body in self.world.bodies:
            for shape in body.shapes:
                kind = (body.collision_group, shape.material)
                passing = None if not shape.collision else frozenset() if by_bodies else row[kind]
                names.setdefault(passing, []).append(shape.name)
        first = {name: min(some) for name, some in names.items()}
        found: dict[str, Any] = {}
        for passing, some in names.items():
            separate = passing or frozenset()
            touches = (
                ()
                if passing is None
                else (
                    name
                    for other, name in first.items()
                    if other is not None and not self._separates(separate, other, row)
                )
            )
            found[f"masks.{first[passing]}.members"] = tuple(sorted(some))
            found[f"masks.{first[passing]}.touches"] = tuple(sorted(touches))
        return found

    @staticmethod
    def _separates(separated: Kinds, other: Kinds, row: Mapping[tuple[str, str], Kinds]) -> bool:
        return any(kind in separated for kind, passing in row.items() if passing == other)

    def excluded(self) -> set[tuple[str, str]]:
        """Pairs of solid bodies: named by the world, of one rigid moving group, or excluded where masks have too few bits."""
        bodies = [body for body in self.world.bodies if self.solid[body.name]]
        names = {body.name for body in bodies}
        found = {pair for pair in self.world.contact.excluded_bodies if set(pair) <= names}
        rigid: dict[str, list[str]] = {}
        for body in bodies:
            if self.groups[body.name] != "world":
                rigid.setdefault(self.groups[body.name], []).append(body.name)
        for members in rigid.values():
            found |= {(a, b) for a in members for b in members if a < b}
        if self.by_bodies():
            row = {kind: name for name, kinds in self._classes.items() for kind in kinds}
            kinds = {body.name: {(body.collision_group, s.material) for s in self.solid[body.name]} for body in bodies}
            found |= {
                (a, b) for a in names for b in names if a < b and all(k in row[j] for j in kinds[a] for k in kinds[b])
            }
        return found
