"""The contract of an engine: files in, arrays out. The same small contract for all, so that nothing above knows an engine's
name.

Engine modules import numpy and, inside ``load``, the engine; nothing heavier: they run in the engine's own process, which
may be another Python with another version of the engine. They compute no metrics: a difference between engines must not
come from a difference in how something was computed.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from simspec.contact import Rules
from simspec.control.reference import Servos
from simspec.engines.kit.arrays import CollisionUnit, bodies_of
from simspec.engines.kit.capabilities import (
    COMMON,
    DOUBLE,
    ROUNDING,
    Capability,
    Deviation,
    NativeLaw,
    Recovery,
    check_capabilities,
)
from simspec.engines.kit.compiled import Needs
from simspec.engines.kit.foreign import EngineAddition, Reads
from simspec.engines.kit.methods import IntegrationMethod
from simspec.engines.kit.settings import Setting, Value
from simspec.errors import EngineError
from simspec.plugins import installed_version
from simspec.support.declarations import Level, Table, check_total
from simspec.support.features import Feature
from simspec.world.types import EngineValue, PairContact, ReadBack, World


@dataclass(frozen=True, slots=True)
class LicenceTerms:
    """A licence that is not an open-source licence, of software that is installed with an engine. ``name``: the licence's;
    ``covers``: that software, in words; ``addresses``: where its texts are, each an https address.

    Raises ValueError where one of them is missing, TypeError where ``addresses`` is not a tuple.
    """

    name: str
    covers: str
    addresses: tuple[str, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.addresses, tuple):
            raise TypeError(f"addresses of the licence {self.name!r}: expected a tuple, not {self.addresses!r}")
        https = [address for address in self.addresses if address.startswith("https://")]
        if not (self.name.strip() and self.covers.strip() and https) or len(https) < len(self.addresses):
            raise ValueError(
                f"the licence {self.name!r} needs a name, the software that it covers, and https addresses"
            )


class RunnableEngine:
    """The first tier of an engine: it loads files, steps, and says where the bodies are. That is enough for ``simspec run``.

    States are generalised coordinates (q, v) as in ``world/kinematics.py``, float64, in the order of the world's bodies,
    whatever the engine's own order and conventions are. Life: create, ``load``, the rest, ``close``.
    """

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        """Load the artifacts in ``folder`` and put the simulation into the world's initial state.

        ``sidecar`` is the parsed ``sidecar.json``. Raises EngineError when the engine refuses a file.
        """
        raise NotImplementedError

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into state (q (nq,), v (nv,)), with derived quantities updated and no memory of before
        (warm starts, contact caches) as far as the engine allows."""
        raise NotImplementedError

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """The same for a state near the present one: contact points of earlier steps stay, where the engine keeps any."""
        self.set_state(q, v)

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """The state (q (nq,), v (nv,))."""
        raise NotImplementedError

    def body_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (bodies, 7) x y z w x y z of the *world's* body frames, and velocities (bodies, 6): linear of the
        body frame's origin, then angular, both in world axes."""
        raise NotImplementedError

    @classmethod
    def prepare(cls) -> None:
        """Import what loading needs, so that processes forked from this one need not (``worker.py``). Optional."""

    def step(self, count: int, effort: np.ndarray | None = None) -> None:
        """Advance ``count`` steps under a constant generalised effort (nv,) held over all of them (None = zero)."""
        raise NotImplementedError

    def ready(self) -> None:
        """Do what the first step would do once, so that steps are timed without it: for example compilation for a model. The
        state stays as it is. Optional."""

    def actuate(self, q: np.ndarray, v: np.ndarray) -> Actuation:
        """Quick access to some hinges and slides, at the places ``q`` and ``v`` (n,) of their coordinates."""
        return Actuation(self, q, v)

    def log(self) -> list[str]:
        """Warnings of the engine since loading."""
        return []

    def close(self) -> None:
        """Free what the engine holds."""


class ProvenEngine(RunnableEngine):
    """The second tier: ``simspec verify`` compares the model that the engine reads back, its dynamics and its contacts with the
    world. Each method but ``read_back`` and ``frame_poses`` belongs to a capability that an engine may lack (``LACKS``)."""

    def read_back(self) -> ReadBack:
        """The engine's model (queried from the engine, never from the request), in the world's frames."""
        raise NotImplementedError

    def frame_poses(self) -> np.ndarray | None:
        """Poses (frames, 7) of the world's named frames at the present state, in the order of their names; None where the
        engine receives none, as where ``ReadBack.frames`` is None."""
        return None

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

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J) from the engine's own masses; gravity's potential is zero at the origin,
        springs' at rest."""
        raise NotImplementedError

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used (at the positions before it), as arrays with ``CONTACT_FIELDS``,
        and, where the engine reports them, the ``unit``s that touch (``CONTACT_UNIT``): runs are else compared by bodies
        only."""
        raise NotImplementedError

    def collision_units(self) -> Sequence[CollisionUnit]:
        """The units of the engine's collision detection: a shape, or several of one body where it does not distinguish them."""
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

    def set_timestep(self, timestep: float) -> None:
        """Step by ``timestep`` (s) from now on, until loading; the model stays the same. For motion without contact."""
        raise NotImplementedError

    def track(
        self, q: np.ndarray, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ) -> Servos:
        """Let the engine's own controllers drive some hinges and slides, at the places ``q`` and ``v`` (n,) of their
        coordinates, until it is loaded again. ``stiffness`` (n,), 0 for control of velocity, ``damping`` (n,), ``limit`` (n,):
        the largest effort, infinite for none. Their treatment is declared under ``control.native``."""
        raise NotImplementedError


class Engine(ProvenEngine):
    """The third tier, complete: the engine's declarations, an inventory of all that it stores, and files of other languages.

    An engine's class is a subclass of this one. ``LACKS`` declares the missing capabilities, with the reason.
    """

    NAME: ClassVar[str]
    TITLE: ClassVar[str] = ""
    """Its name in sentences, as its makers write it; empty: ``NAME``."""
    DIALECT: ClassVar[str]
    """The dialect (``simspec/dialects``) in which it receives a world."""
    DISTRIBUTION: ClassVar[str]
    """The package of Python whose version is the engine's version; "" where no package has it (``NEEDS.library``)."""
    OTHER_DISTRIBUTIONS: ClassVar[tuple[str, ...]] = ()
    """Other packages that bring the engine, and whose version counts where the first is not installed."""
    FORMER_DISTRIBUTIONS: ClassVar[Mapping[str, str]] = {}
    """The versions (``<4``) of which another package has to be installed than ``DISTRIBUTION``, each with its name."""
    OLDEST: ClassVar[str] = ""
    """The first release that reads the files that simspec writes for it; "": any."""
    EXTRA: ClassVar[str]
    """The extra of simspec that installs it; "" where none does."""
    SEPARATE_VERSION: ClassVar[str] = ""
    """The version of an environment of its own that installing it without a version makes, where its packages do not go with
    those of another engine; "": it is installed here."""
    ALONGSIDE: ClassVar[tuple[str, ...]] = ()
    """Packages of Python that its environment has in addition to the engine's."""
    NEEDS: ClassVar[Needs] = Needs()
    """Its needs of the machine in addition to packages of Python."""
    FILES_ALONE: ClassVar[str] = ""
    """Of an engine that is proven by its files only where it is not installed: why, in words. Such a proof goes as far as
    the files (L0), says so with this reason, and is never valid. Empty: one that is named and not installed is an error
    everywhere."""
    CLASHES: ClassVar[Mapping[str, str]] = {}
    """Packages of Python, of other engines, that may not be in its process, each with the reason."""
    PRECISION: ClassVar[str] = DOUBLE
    """The numbers that it computes with, ``double`` or ``single``: tolerances of proofs, and the size of what noise is measured
    by, follow from it."""
    SUPPORT: ClassVar[Table]
    SETTINGS: ClassVar[Mapping[str, Setting]]
    RULES: ClassVar[Rules]
    """How it combines the numbers of two shapes."""
    DEPTHS: ClassVar[Mapping[str, float] | None] = None
    """Settings that are depths of contact, with their largest defaults (m); the package of an engine may state them, so that a
    check of a spec need not import it. None: not stated."""
    LAYERS: ClassVar[bool]
    """Whether pairs of materials that parameters cannot express are realised by copies of shapes in layers (see
    ``contact.py``)."""
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = ()
    """Known deviations from the contact law, each measured."""
    KEEPS_CONTACTS: ClassVar[bool] = False
    """Whether a step depends on contact points of earlier steps, in addition to the state; :meth:`move_to` then leaves them."""
    PROBED_TOGETHER: ClassVar[int | None] = None
    """Moving bodies of a contact probe in one world, where a step's time grows faster than their number; None: all."""
    DRY_FRICTION_CREEP: ClassVar[float] = 0.0
    """Speed (m/s, rad/s) of a joint with dry friction that its solver may leave or miss, whatever the friction is."""
    COMPILING: ClassVar[float] = 0.0
    """Seconds of processor time that it may take at most to compile what it computes, for one form of a model."""
    HULL_PRECISION: ClassVar[float] = 0.0
    """Share of its extent by which a convex hull that it holds may differ from the vertices that it was given, where it keeps
    fewer digits of them; measured. 0: it keeps doubles."""
    ACCEPTED_CONES: ClassVar[Mapping[str, str]] = {}
    """The friction cone that it may hold in place of another, where the spec accepts that (``accept: [contact.cone.X]``)."""
    UNREADABLE: ClassVar[Mapping[str, str]] = {}
    """Fields that cannot be read back from it, with the reason."""
    LACKS: ClassVar[Mapping[Capability, str]] = {}
    """The capabilities that it does not have, with the reason: their operations are not requested. Empty: it has all."""
    STEPS_UNMEASURED: ClassVar[str] = ""
    """Of an engine that lacks a mass matrix or a bias force: why accelerations of its steps are not compared in their place;
    "": they are."""
    NATIVE_LAW: ClassVar[NativeLaw | None] = None
    """The law of its built-in controllers; None where it lacks them."""
    FOREIGN: ClassVar[Mapping[str, Reads]] = {}
    """The languages of files that it loads by itself, by the names of their importers, and how."""
    FOREIGN_ADDITIONS: ClassVar[Mapping[str, EngineAddition]] = {}
    """The engine's additions to such files, by names of the inventory that :meth:`load_foreign` gives."""
    INSTALLS: ClassVar[str] = ""
    """A fact that a user should know before its packages are installed, such as a large size."""
    LICENCES: ClassVar[tuple[LicenceTerms, ...]] = ()
    """The terms of its packages, or of packages that come with it, that are not under an open-source licence. It is installed
    only after the user has accepted them; (): every part is under an open-source licence."""
    FOREIGN_MEMORY: ClassVar[int] = 0
    """Bytes of data that its process has before it loads a file, where they exceed half of its bound (``kit/foreign.py``)."""

    def __init_subclass__(cls, abstract: bool = False, **keywords: Any) -> None:
        """Check what the class declares; ``abstract``: it is no engine, but what several engines are built on."""
        super().__init_subclass__(**keywords)
        if abstract:
            return
        if cls.PRECISION not in ROUNDING:
            raise TypeError(f"engine {cls.NAME}: PRECISION is {cls.PRECISION!r}, allowed: {', '.join(ROUNDING)}")
        if not isinstance(cls.LICENCES, tuple) or not all(isinstance(terms, LicenceTerms) for terms in cls.LICENCES):
            raise TypeError(f"engine {cls.NAME}: LICENCES is {cls.LICENCES!r}, expected a tuple of LicenceTerms")
        check_total(f"engine {cls.NAME}", cls.SUPPORT)
        is_program = cls.command.__func__ is not Engine.command.__func__  # type: ignore[attr-defined]
        check_capabilities(cls, Engine, cls.LACKS, is_program)
        native = cls.SUPPORT[Feature.CONTROL_NATIVE]
        if Capability.NATIVE_CONTROLLERS in cls.LACKS and native.level is not Level.UNSUPPORTED:
            raise TypeError(f"engine {cls.NAME} lacks native controllers, but declares support for control.native")
        if (Capability.NATIVE_CONTROLLERS in cls.LACKS) != (cls.NATIVE_LAW is None):
            raise TypeError(f"engine {cls.NAME} must declare NATIVE_LAW exactly where it has native controllers")
        if Capability.FOREIGN_FILES in cls.LACKS and cls.FOREIGN:
            raise TypeError(f"engine {cls.NAME} declares FOREIGN, and that it loads no foreign files")

    @classmethod
    def version(cls) -> str | None:
        """The installed version; None when the engine is not installed. Does not import the engine."""
        for name in cls.distributions():
            if (version := installed_version(name)) is not None:
                return version
        return cls.NEEDS.version()

    @classmethod
    def files_alone(cls) -> str:
        """Why it is proven by its files only here; empty where it is installed, and where it is of no use without."""
        return cls.FILES_ALONE if cls.FILES_ALONE and cls.version() is None else ""

    @classmethod
    def distributions(cls) -> tuple[str, ...]:
        """The packages of Python that bring it, the one that counts first."""
        return tuple(name for name in (cls.DISTRIBUTION, *cls.OTHER_DISTRIBUTIONS) if name)

    @classmethod
    def method(cls, world: World) -> IntegrationMethod | None:
        """The method by which it integrates ``world``; None: semi-implicit Euler. The declaration of ``physics.integrator``
        follows from the same function (:func:`simspec.engines.kit.methods.integration`)."""
        return None

    @classmethod
    def recovery(cls, settings: Mapping[str, Any], law: PairContact) -> Recovery | None:
        """How fast it takes overlaps back in contacts of a law, under its settings; None where it declares nothing of that."""
        return COMMON if law.hardness.kind == "common" else None

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        """What ``ReadBack.inventory`` must be: everything that the engine stores in addition to the fields of the read-back.

        Made from ``world`` and the settings resolved from it, by code that shares nothing with what writes the files.
        ``neutral`` is the read-back's: the engine's own values of what simspec never writes. The comparator demands the same
        names on both sides, numbers within 1e-9 relative (2e-6 in single precision), all else equal. Called outside the
        engine's process, so without the engine. Part of the capability ``inventory``.
        """
        raise NotImplementedError

    @classmethod
    def command(cls, folder: Path) -> Sequence[str] | None:
        """The command line of the program that works off the request in ``folder``
        (``docs/design/engine-process.md``), for an engine
        that is a program of its own; None: simspec's own worker, which makes an instance of this class, in a Python."""
        return None

    @classmethod
    def chosen_settings(cls, world: World, settings: Mapping[str, Value]) -> Mapping[str, Value]:
        """``settings`` with what their ``auto`` stands for in ``world``; the default leaves that to the format."""
        return settings

    @classmethod
    def overlooks(cls, world: World) -> frozenset[tuple[str, str]]:
        """The sorted pairs of kinds of shapes of which it is measured to miss some overlaps in ``world``, and reports its
        filter otherwise (``expected_inventory``): a pair of such shapes that it never reports is noted, and no error."""
        return frozenset()

    @classmethod
    def thicker(cls, world: World) -> Mapping[str, float]:
        """By name the collision shapes of ``world`` whose surfaces it holds elsewhere than they are, since it has none so thin,
        or finds distances to them inexactly, and how far (m) outside or inside of where they should be they may be felt;
        declared approximate by name, measured."""
        return {}

    @classmethod
    def prepare_foreign(cls) -> None:
        """Import what :meth:`load_foreign` needs: after that, the process may load no code."""
        cls.prepare()

    def load_foreign(self, file: Path, language: str, packages: Mapping[str, str], log: list[str]) -> ReadBack:
        """Load ``file``, of one of the languages in ``FOREIGN``, as a user of the engine would: by its own loader, with that
        one's defaults. ``packages``: folders by the names of packages, for loaders that take them.
        The engine's warnings are added to ``log``.

        Returns what the engine then holds: every body under the file's name, in a frame at its last joint with the axes
        of the file's frame; coordinates relative to those that the file calls zero; the shapes of each, a mesh by its support
        function (``kit/foreign.py``); in ``inventory`` what ``FOREIGN_ADDITIONS`` names. Nothing else has been loaded, and
        nothing else is queried afterwards. Raises EngineError when the engine refuses the file."""
        raise NotImplementedError


class Actuation:
    """Some hinges and slides of a live simulation, read and driven at every step. Engines have quicker ones of their own, with
    the same numbers to the last bit."""

    def __init__(self, engine: RunnableEngine, q: np.ndarray, v: np.ndarray):
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


# Engines that may not be in one process: both bring a library of one name, and each would take the other's objects.
#
# simspec gives every engine a process of its own. A program that loads engines itself gets an error here, before its process
# dies.

_LOADED: dict[str, type[Engine]] = {}
"""Engines that this process has loaded, whose libraries stay in it."""


def enter(engine: type[Engine]) -> None:
    """Count ``engine`` as loaded into this process. Raises EngineError where it clashes with what is in it."""
    for package, why in engine.CLASHES.items():
        if package in sys.modules:
            raise EngineError(engine.NAME, f"cannot be loaded into a process that has {package}: {why}")
    for other in _LOADED.values():
        why = other.CLASHES.get(engine.DISTRIBUTION, "")
        if why:
            raise EngineError(engine.NAME, f"cannot be loaded into a process that has the engine {other.NAME}: {why}")
    _LOADED[engine.NAME] = engine
