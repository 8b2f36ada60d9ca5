"""The unit that is run: one world in one engine, with what is changed for this run alone."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from simspec.engines.kit.identity import engine_name
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import resolve_settings
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.world.canonical import canonical_json, derived, to_plain
from simspec.world.kinematics import initial_state, layout_of
from simspec.world.types import Record, World

KEY_SCHEMA = 1
"""Version of what a key is made of."""


@derived
def shared_world(world: World) -> World:
    """What the runs of several engines, settings and specs have in common: the world without its name, its expectations and its
    options of engines."""
    return dataclasses.replace(world, name="", expectations=(), engines=())


@derived
def _shared_json(world: World) -> str:
    return canonical_json(shared_world(world))


@dataclass(frozen=True)
class Case:
    """A world in an engine: what is run, repeated and stored.

    ``engine`` is a label. ``settings`` replace solver settings of the spec, (name, value), for this engine. ``perturb`` moves
    the initial state by this relative change (see :func:`perturbed_state`), with ``seed`` in directions drawn from it.
    ``record`` replaces the world's own.
    """

    world: World
    engine: str
    settings: tuple[tuple[str, bool | int | float | str], ...] = ()
    perturb: float = 0.0
    seed: int | None = None
    record: Record | None = None

    def __repr__(self) -> str:
        changed = f", perturbed by {self.perturb:g}" if self.perturb else ""
        return f"<Case: {self.world.name!r} in {self.engine}{changed}>"

    @cached_property
    def resolved(self) -> World:
        """The world that is compiled: with the settings and the record of this case."""
        world = self.world
        if self.settings:
            own = world.options(engine_name(self.engine))
            settings = tuple(sorted({**dict(own.settings), **dict(self.settings)}.items()))
            others = tuple(options for options in world.engines if options.engine != own.engine)
            engines = (*others, dataclasses.replace(own, settings=settings))
            world = dataclasses.replace(world, engines=tuple(sorted(engines, key=lambda options: options.engine)))
        return world if self.record in (None, world.record) else dataclasses.replace(world, record=self.record)

    @property
    def initial_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v) at the beginning."""
        if not self.perturb:
            return initial_state(self.world)
        return perturbed_state(self.world, self.perturb, self.seed)

    def key(self, versions: Mapping[str, str]) -> str:
        """What tells this case from every other that would run differently (SHA-256).

        Left out is what no run depends on: the world's name, its expectations, and what the spec says to other engines.
        ``versions``: of all that is at work (simspec, the engine, numpy, …), by name.
        """
        world, name = self.resolved, engine_name(self.engine)
        options = world.options(name)
        pairs = {"pairs": to_plain(options.pairs)} if options.pairs else {}
        told = canonical_json(
            {
                "schema": KEY_SCHEMA,
                "engine": name,
                "settings": dict(sorted(resolve_settings(find_engine(name), world).items())),
                "accept": sorted(options.accept),
                "outside": sorted(options.outside),
                "perturb": self.perturb,
                "seed": self.seed if self.perturb else None,
                "versions": dict(sorted(versions.items())),
                **pairs,
            }
        )
        # the world's text is made once for all cases of it; its name comes last in the order of canonical JSON
        return hashlib.sha256(f'{told[:-1]},"world":{_shared_json(world)}}}'.encode()).hexdigest()


def perturbed_state(world: World, amount: float, seed: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The world's initial (q, v), moved by ``amount``, a relative change: for the noise floor, 1e-15.

    Every coordinate x becomes x (1 + amount), and a position of exactly zero becomes ``amount`` (it would otherwise stay
    as it is, and a pendulum let go from zero would look free of round-off). Of a quaternion the vector part is moved, and
    the whole made of unit length again. With a ``seed`` each coordinate has an amount of its own, drawn evenly from
    −amount to amount.
    """
    q, v = initial_state(world)
    dq, dv = np.full(len(q), amount), np.full(len(v), amount)
    if seed is not None:
        generator = np.random.default_rng(seed)
        dq, dv = generator.uniform(-amount, amount, len(q)), generator.uniform(-amount, amount, len(v))
    return moved_states(world, q, v, dq, dv)


def moved_states(
    world: World, q: np.ndarray, v: np.ndarray, dq: np.ndarray | float, dv: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """States q (..., nq), v (..., nv) moved by relative changes, in the way of :func:`perturbed_state`."""
    moved = np.where(q == 0.0, dq, q * (1.0 + dq))
    for body, part in zip(world.bodies, layout_of(world).position, strict=True):
        if body.joint.kind in QUATERNION_JOINTS:
            turn = slice(part.stop - 4, part.stop)
            moved[..., part.stop - 4] = q[..., part.stop - 4]
            moved[..., turn] /= np.linalg.norm(moved[..., turn], axis=-1, keepdims=True)
    return moved, v * (1.0 + dv)
