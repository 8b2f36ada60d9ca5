"""What an engine is: files in, arrays out. The same small contract for all, so that nothing above knows an engine's name.

Engine modules import numpy and, inside ``load``, the engine; nothing heavier: they run in the engine's own process, which
may be another Python with another version of the engine. They compute no metrics: a difference between engines must not
come from a difference in how something was computed.
"""

from __future__ import annotations

import functools
import importlib.metadata
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from simspec.contact.rules import Rules
from simspec.control.native import Servos
from simspec.engines.kit.identity import engine_name
from simspec.engines.kit.vectors import cross
from simspec.errors import EngineError, Problem
from simspec.plugins import Offered, offered
from simspec.support.declarations import Table, check_total
from simspec.world.types import HeldValue, PairContact, ReadBack, World

CONTACT_FIELDS: Mapping[str, tuple[int, ...]] = {
    "body": (2,),
    "position": (3,),
    "normal": (3,),
    "distance": (),
    "normal_force": (),
}
"""The arrays of ``Engine.contacts`` and the shape of one row. ``body``: indices into the world's bodies; ``position``: in
the world (m); ``normal``: unit vector in the world, pointing from the second body to the first; ``distance``: gap in m,
negative when the bodies overlap; ``normal_force``: N, ≥ 0."""


LARGEST_WHOLE = 2**31 - 1
"""The largest whole number that every engine's settings can hold."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One solver setting of an engine: its default, what is allowed, what it does and why the default is what it is."""

    default: bool | int | float | str
    meaning: str
    choices: tuple[str, ...] = ()
    minimum: float | None = None
    maximum: float | None = None
    only_with: str = ""
    """The switch (a setting, or itself) without which it means nothing and is not written: files of worlds that do not ask for
    it stay as they are."""
    needs: tuple[str, tuple[bool | str, ...]] | None = None
    """Another setting, and its values with which this one acts; with others it does nothing, and to give it is an error."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """A known deviation of an engine from the contact law, in one contact probe (see ``proof/contact/``).

    ``size`` is the largest measured one, ``why`` what it comes from. ``relative``: size is a share of the expected value,
    else it is in the figure's unit. It counts for pairs with at least this ``friction`` and ``restitution``, from this
    ``timestep`` (s) on, and under this ``friction_cone``, kind of ``hardness`` and ``setting`` (name, value) of the engine
    alone, where these are given.
    """

    probe: str
    size: float
    why: str
    relative: bool = True
    friction: float = 0.0
    timestep: float = 0.0
    restitution: float = 0.0
    friction_cone: str = ""
    hardness: str = ""
    setting: tuple[str, str] | None = None

    def counts_for(
        self, pair: PairContact, friction_cone: str, timestep: float, settings: Mapping[str, Any] = MappingProxyType({})
    ) -> bool:
        """Whether it is one of this pair's, under this cone, timestep, and these settings of the engine."""
        return (
            (self.setting is None or settings.get(self.setting[0]) == self.setting[1])
            and pair.friction >= self.friction
            and pair.restitution >= self.restitution
            and timestep >= self.timestep
            and self.friction_cone in ("", friction_cone)
            and self.hardness in ("", pair.hardness.kind)
        )


@dataclass(frozen=True, slots=True)
class CollisionUnit:
    """What an engine's collision detection reports as one: ``body`` is the index in the world's bodies (−1: of none of them),
    ``shapes`` are the names of those of its shapes that it may be."""

    body: int
    shapes: tuple[str, ...]


class Engine:
    """A live simulation of one world.

    States are generalised coordinates (q, v) as in ``world/kinematics.py``, float64, in the order of the world's bodies,
    whatever the engine's own order and conventions are. Life: create, ``load``, the rest, ``close``.
    """

    NAME: ClassVar[str]
    DIALECT: ClassVar[str]
    """The dialect (``simspec/dialects``) in which it is told a world."""
    DISTRIBUTION: ClassVar[str]
    """The package whose version is the engine's version."""
    EXTRA: ClassVar[str]
    """The extra of simspec that installs it."""
    SUPPORT: ClassVar[Table]
    SETTINGS: ClassVar[Mapping[str, Setting]]
    RULES: ClassVar[Rules]
    """How it combines the numbers of two shapes."""
    LAYERS: ClassVar[bool]
    """Whether pairs that no numbers give are had by copies of shapes in layers (see ``contact/plan.py``)."""
    BY_DEFAULT: ClassVar[bool] = True
    """Whether it is taken where no engine is named. One that most worlds are refused by is asked for by name."""
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = ()
    """What it is known not to reach of the contact law, each measured."""
    DRY_FRICTION_CREEP: ClassVar[float] = 0.0
    """Speed (m/s, rad/s) of a joint with dry friction that its solver may leave or miss, whatever the friction is."""
    ACCEPTED_CONES: ClassVar[Mapping[str, str]] = {}
    """The friction cone that it may hold in place of another, where the spec accepts that (``accept: [contact.cone.X]``)."""
    UNREADABLE: ClassVar[Mapping[str, str]] = {}
    """Fields that it cannot be asked for, with the reason."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        check_total(f"engine {cls.NAME}", cls.SUPPORT)

    @classmethod
    def version(cls) -> str | None:
        """The installed version; None when the engine is not installed. Does not import the engine."""
        try:
            return importlib.metadata.version(cls.DISTRIBUTION)
        except importlib.metadata.PackageNotFoundError:
            return None

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, HeldValue]) -> dict[str, HeldValue]:
        """What ``ReadBack.inventory`` must be: everything that the engine holds beside the fields of the read-back.

        Made from ``world`` and the settings resolved from it (:func:`resolve_settings`), by code that shares nothing with what
        writes the files. ``neutral`` is the read-back's: the engine's own values of what simspec never writes. The
        comparator demands the same names on both sides, numbers within 1e-9 relative, all else equal. Called outside the
        engine's process, so without the engine. The default: nothing.
        """
        return {}

    @classmethod
    def command(cls, folder: Path) -> Sequence[str] | None:
        """The command line of the program that works off the request in ``folder`` (``docs/engine-process.md``), for an engine
        that is a program of its own; None: simspec's own worker, which makes an instance of this class, in a Python."""
        return None

    @classmethod
    def chosen_settings(
        cls, world: World, settings: Mapping[str, bool | int | float | str]
    ) -> Mapping[str, bool | int | float | str]:
        """``settings`` with what their ``auto`` stands for in ``world``; the default leaves that to the format."""
        return settings

    # --- to be written by each engine -------------------------------------------------------------------------

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        """Load the artifacts in ``folder`` and put the simulation into the world's initial state.

        ``sidecar`` is the parsed ``sidecar.json``. Raises EngineError when the engine refuses a file.
        """
        raise NotImplementedError

    def read_back(self) -> ReadBack:
        """The model as the engine holds it (asked from the engine, never from the request), in the world's frames."""
        raise NotImplementedError

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into state (q (nq,), v (nv,)), with derived quantities updated and no memory of before
        (warm starts, contact caches) as far as the engine allows."""
        raise NotImplementedError

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """The state (q (nq,), v (nv,))."""
        raise NotImplementedError

    def body_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (bodies, 7) x y z w x y z of the *world's* body frames, and velocities (bodies, 6): linear of the
        body frame's origin, then angular, both in world axes."""
        raise NotImplementedError

    def mass_blocks(self, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
        """The parts (n, n) of M at the present state, armature included, that belong to each of ``blocks``: places (n,) in v.
        Trees do not act on each other through M, and M of 2,000 free bodies as one array would be 1 GB."""
        raise NotImplementedError

    def mass_matrix(self) -> np.ndarray:
        """M (nv, nv) at the present state, armature included."""
        return self.mass_blocks([np.arange(len(self.get_state()[1]))])[0]

    def bias_force(self) -> np.ndarray:
        """h (nv,) at the present state, in M v̇ + h = τ: Coriolis, centrifugal and gravity; no damping, no springs."""
        raise NotImplementedError

    @classmethod
    def prepare(cls) -> None:
        """Import what loading needs, so that processes forked from this one need not (``attempts.py``). Optional."""

    def step(self, count: int, effort: np.ndarray | None = None) -> None:
        """Advance ``count`` steps under a constant generalised effort (nv,) held over all of them (None = zero)."""
        raise NotImplementedError

    def actuate(self, q: np.ndarray, v: np.ndarray) -> Actuation:
        """Quick access to some hinges and slides, at the places ``q`` and ``v`` (n,) of their coordinates."""
        return Actuation(self, q, v)

    def track(
        self, q: np.ndarray, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ) -> Servos:
        """Let the engine's own controllers drive some hinges and slides, at the places ``q`` and ``v`` (n,) of their
        coordinates, until it is loaded again. ``stiffness`` (n,), 0 for control of velocity, ``damping`` (n,), ``limit`` (n,):
        the largest effort, infinite for none. What becomes of them is declared under ``control.native``."""
        raise EngineError(self.NAME, "has no controller of its own")

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used (at the positions before it), as arrays with ``CONTACT_FIELDS``."""
        raise NotImplementedError

    def collision_units(self) -> Sequence[CollisionUnit]:
        """What the engine's collision detection tells apart: a shape, or several of one body where it names no more."""
        raise NotImplementedError

    def detect_units(self) -> np.ndarray:
        """Pairs (n, 2) of indices into ``collision_units`` that touch at the present state, by the engine's own collision
        detection with its filters; does not advance time. Rows are sorted (smaller index first), each pair once."""
        raise NotImplementedError

    def detect_contacts(self) -> np.ndarray:
        """Pairs (n, 2) of indices of bodies that touch at the present state: those of ``detect_units``, sorted, each once."""
        return bodies_of(self.collision_units(), self.detect_units())

    def disable_contact(self) -> None:
        """Switch all contact off, for contact-free motion probes."""
        raise NotImplementedError

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """Take the dry friction of the hinges and slides at the places ``v`` (n,) of their coordinates away, and no other's,
        until loading, for motion probes against laws that have none."""
        raise NotImplementedError

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J) from the engine's own masses; gravity's potential is zero at the origin,
        springs' at rest."""
        raise NotImplementedError

    def log(self) -> list[str]:
        """What the engine had to say (warnings) since loading."""
        return []

    def close(self) -> None:
        """Free what the engine holds."""


class Actuation:
    """Some hinges and slides of a live simulation, read and driven at every step. Engines have quicker ones of their own, with
    the same numbers to the last bit."""

    def __init__(self, engine: Engine, q: np.ndarray, v: np.ndarray):
        self._engine, self._q, self._v = engine, q, v
        self._effort: np.ndarray | None = None

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities (n,) of the joints; valid until the next step."""
        q, v = self._engine.get_state()
        if self._effort is None:
            self._effort = np.zeros(len(v))
        return q[self._q], v[self._v]

    def give(self, effort: np.ndarray) -> None:
        """Efforts (n,) on the joints for the next step, and none on other coordinates. ``read`` must have been called."""
        if self._effort is None:
            raise RuntimeError("read first")
        self._effort[self._v] = effort

    def step(self) -> None:
        """One step under the efforts that were given for it."""
        self._engine.step(1, self._effort)


def sorted_pairs(pairs: np.ndarray) -> np.ndarray:
    """Pairs (n, 2) of indices with the smaller one first, sorted, each once."""
    return np.unique(np.sort(np.asarray(pairs, dtype=np.int64).reshape(-1, 2), axis=1), axis=0)


def bodies_of(units: Sequence[CollisionUnit], pairs: np.ndarray) -> np.ndarray:
    """The pairs (n, 2) of indices of bodies, sorted and each once, of pairs of ``units``."""
    return sorted_pairs(np.array([unit.body for unit in units], dtype=np.int64)[pairs]) if len(pairs) else pairs


def pick_blocks(blocks: Sequence[np.ndarray], held: Iterable[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """The parts of M for ``blocks`` (see :meth:`Engine.mass_blocks`), out of those that an engine holds: for each of its own
    trees the places (n,) in v and M (n, n) there."""
    found = [np.zeros((len(block), len(block))) for block in blocks]
    where = {int(place): (index, row) for index, block in enumerate(blocks) for row, place in enumerate(block)}
    for places, mass in held:
        wanted = [(number, *where[int(place)]) for number, place in enumerate(places) if int(place) in where]
        for index in {index for _, index, _ in wanted}:
            theirs, ours = zip(*((number, row) for number, own, row in wanted if own == index), strict=True)
            found[index][np.ix_(ours, ours)] = mass[np.ix_(theirs, theirs)]
    return found


def empty_contacts() -> dict[str, np.ndarray]:
    """Contact arrays with no rows."""
    return {
        name: np.zeros((0, *shape), dtype=np.int64 if name == "body" else np.float64)
        for name, shape in CONTACT_FIELDS.items()
    }


def resolve_settings(engine: type[Engine], world: World) -> dict[str, bool | int | float | str]:
    """The engine's solver settings: its defaults, with those of the world's options over them.

    The options were checked by :func:`check_settings`.
    """
    return {name: setting.default for name, setting in engine.SETTINGS.items()} | dict(
        world.options(engine.NAME).settings
    )


def written_settings(engine: type[Engine], world: World) -> dict[str, bool | int | float | str]:
    """The settings that stand in files: those of :func:`resolve_settings` but for those whose switch is off.

    Settings that the engine does not have stay, for it to refuse.
    """
    found = dict(engine.chosen_settings(world, resolve_settings(engine, world)))
    off = {name for name, setting in engine.SETTINGS.items() if setting.only_with and not found[setting.only_with]}
    return {name: value for name, value in found.items() if name not in off}


def idle_settings(engine: type[Engine], settings: Mapping[str, Any]) -> dict[str, str]:
    """The settings that do nothing beside the others, each with why (``"with friction: coulomb"``), of all of an engine's."""
    found = {}
    for name, setting in engine.SETTINGS.items():
        if setting.needs is not None and (value := settings[setting.needs[0]]) not in setting.needs[1]:
            found[name] = f"with {_told(setting.needs[0], value)}"
    return found


def _told(name: str, value: bool | int | float | str) -> str:
    """A setting as a spec writes it."""
    return f"{name}: {str(value).lower() if isinstance(value, bool) else value}"


def check_settings(engine: type[Engine], settings: Sequence[tuple[str, Any]]) -> list[Problem]:
    """The problems of solver settings given for ``engine``: unknown names, wrong types, values out of range, and, where all
    else is right, settings that do nothing beside others."""
    import difflib

    problems: list[Problem] = []
    for name, value in settings:
        path = f"engines.{engine.NAME}.settings.{name}"
        setting = engine.SETTINGS.get(name)
        if setting is None:
            near = difflib.get_close_matches(name, engine.SETTINGS, 1)
            problems.append(
                Problem(
                    f"{engine.NAME} has no setting {name!r}",
                    path,
                    found=name,
                    allowed=", ".join(engine.SETTINGS),
                    hint=f"did you mean {near[0]!r}?" if near else None,
                )
            )
        elif wrong := _wrong_value(setting, value):
            problems.append(Problem(f"wrong value for {name!r}", path, found=repr(value), allowed=wrong))
    return problems or _idle(engine, dict(settings))


def _idle(engine: type[Engine], given: Mapping[str, Any]) -> list[Problem]:
    defaults = {name: setting.default for name, setting in engine.SETTINGS.items()}
    why = idle_settings(engine, defaults | given)
    problems = []
    for name, value in given.items():
        if name not in why or (needs := engine.SETTINGS[name].needs) is None:
            continue
        acts = " or ".join(_told(needs[0], one) for one in needs[1])
        problems.append(
            Problem(
                f"{engine.NAME}'s setting {name!r} does nothing {why[name]}",
                f"engines.{engine.NAME}.settings.{name}",
                found=_told(name, value),
                hint=f"leave it out; it acts with {acts}",
            )
        )
    return problems


def _wrong_value(setting: Setting, value: Any) -> str | None:
    kind = type(setting.default)
    if kind is float and type(value) is int and abs(value) <= LARGEST_WHOLE:
        value = float(value)
    if type(value) is not kind:
        return {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}[kind]
    if kind is float and not math.isfinite(value):
        return "a finite number"
    if kind is int and abs(value) > LARGEST_WHOLE:
        return f"a whole number of at most {LARGEST_WHOLE}"
    if setting.choices and value not in setting.choices:
        return ", ".join(setting.choices)
    if setting.minimum is not None and value < setting.minimum:
        return f"at least {setting.minimum}"
    if setting.maximum is not None and value > setting.maximum:
        return f"at most {setting.maximum}"
    return None


def restore_velocities(poses: np.ndarray, velocities: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From states of the *file's* body frames to states of the world's: origin p − R c, velocity v − ω × R c.

    ``poses`` (bodies, 7), ``velocities`` (bodies, 6), ``offsets`` (bodies, 3) the file frame's position in the world's
    body frame. Returns new arrays.
    """
    poses, velocities = poses.copy(), velocities.copy()
    moved = np.flatnonzero(offsets.any(axis=1))
    if len(moved):
        q = poses[moved, 3:7]
        c = offsets[moved]
        uv = cross(q[:, 1:], c)
        lever = c + 2.0 * (q[:, :1] * uv + cross(q[:, 1:], uv))
        poses[moved, :3] -= lever
        velocities[moved, :3] -= cross(velocities[moved, 3:], lever)
    return poses, velocities


DECLARED = ("NAME", "DIALECT", "DISTRIBUTION", "EXTRA", "SUPPORT", "SETTINGS", "RULES", "LAYERS")
"""What an engine's class must say."""


@functools.cache
def _offered() -> Offered:
    return offered("simspec.engines", _sound)


def _sound(name: str, engine: Any) -> type[Engine]:
    """The engine, if it is one that can be used. Raises TypeError, ValueError."""
    from simspec.dialects.kit.contract import dialects

    if not (isinstance(engine, type) and issubclass(engine, Engine)):
        raise TypeError("it is no Engine")
    missing = [word for word in DECLARED if not hasattr(engine, word)]
    if missing:
        raise ValueError(f"it does not say its {', '.join(missing)}")
    if name != engine.NAME:
        raise ValueError(f"it calls itself {engine.NAME!r}")
    if engine.DIALECT not in dialects():
        raise ValueError(f"it is told worlds in {engine.DIALECT!r}, which no dialect is")
    dialects()[engine.DIALECT].check_declared(engine.SETTINGS)
    engine.version()
    return engine


def engines() -> Mapping[str, type[Engine]]:
    """Every known engine by name (entry points ``simspec.engines``), installed or not."""
    return _offered().good


def format_of(engine: type[Engine]) -> str:
    """The name of the format that an engine reads."""
    from simspec.dialects.kit.contract import dialects

    return dialects()[engine.DIALECT].FORMAT


def default_engines() -> list[str]:
    """The names of the engines that are taken where none is named."""
    return [name for name, engine in engines().items() if engine.BY_DEFAULT]


def broken_engines() -> Mapping[str, str]:
    """The engines that are offered and cannot be used, with the reason."""
    return _offered().broken


def find_engine(name: str) -> type[Engine]:
    """The engine that a name or label (``identity.py``) stands for. Raises EngineError naming the known ones."""
    found = engines().get(engine_name(name))
    if found is None:
        why = broken_engines().get(engine_name(name))
        raise EngineError(name, why or f"no such engine; known: {', '.join(engines())}")
    return found
