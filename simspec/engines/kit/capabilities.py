"""The capabilities of an engine in addition to its core, each by name, and the check that it declares those that it lacks; its
known deviations from the contact law.

The core is what nothing works without: ``load``, ``read_back``, ``set_state``, ``get_state``, ``body_states``, ``step``,
``log`` and ``close``. All else is a capability: an engine's class either defines its methods, or says in
``LACKS`` why it does not have it. The methods of what it lacks are not called, and raise EngineError with that reason.
"""

from __future__ import annotations

import csv
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from fnmatch import fnmatchcase
from math import inf
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NoReturn

from simspec.errors import EngineError
from simspec.support.declarations import is_before
from simspec.world.types import PairContact


class Capability(StrEnum):
    """A capability of an engine in addition to its core."""

    MASS_MATRIX = "mass_matrix"
    BIAS_FORCE = "bias_force"
    ENERGY = "energy"
    CONTACTS = "contacts"
    INVENTORY = "inventory"
    PAIR_DETECTION = "pair_detection"
    CONTACT_OFF = "contact_off"
    DRY_FRICTION_OFF = "dry_friction_off"
    NATIVE_CONTROLLERS = "native_controllers"
    FOREIGN_FILES = "foreign_files"
    TIMESTEP = "timestep"


MEANING: Mapping[Capability, str] = {
    Capability.MASS_MATRIX: "returns the mass matrix at a state",
    Capability.BIAS_FORCE: "returns the bias force (Coriolis, centrifugal, gravity) at a state",
    Capability.ENERGY: "returns kinetic and potential energy at a state",
    Capability.CONTACTS: "reports the contacts of its last step: bodies, position, normal and force",
    Capability.INVENTORY: ("reads back every stored value that affects the motion, in addition to the world's fields"),
    Capability.PAIR_DETECTION: "reports the pairs of shapes or bodies in contact at a state, without a step",
    Capability.CONTACT_OFF: "steps without contact",
    Capability.DRY_FRICTION_OFF: "steps without the dry friction of selected joints",
    Capability.NATIVE_CONTROLLERS: "drives joints by its own controllers",
    Capability.FOREIGN_FILES: ("loads files of other languages as its users do, and reports the model that it stores"),
    Capability.TIMESTEP: "steps a loaded model by another timestep than that of its files",
}

METHODS: Mapping[Capability, tuple[str, ...]] = {
    Capability.MASS_MATRIX: ("mass_blocks",),
    Capability.BIAS_FORCE: ("bias_force",),
    Capability.ENERGY: ("energy",),
    Capability.CONTACTS: ("contacts",),
    Capability.INVENTORY: ("expected_inventory",),
    Capability.PAIR_DETECTION: ("collision_units", "detect_units"),
    Capability.CONTACT_OFF: ("disable_contact",),
    Capability.DRY_FRICTION_OFF: ("disable_dry_friction",),
    Capability.NATIVE_CONTROLLERS: ("track",),
    Capability.FOREIGN_FILES: ("load_foreign",),
    Capability.TIMESTEP: ("set_timestep",),
}
"""The methods of :class:`simspec.engines.kit.contract.Engine` that an engine with the capability defines."""


FIXED_TIMESTEP = "it integrates every world by semi-implicit Euler, which is proven at the timestep of its files"
"""Why an engine does not step by another timestep."""


class Lacking:
    """Stands in an engine's class for a method of a capability that it lacks: a call raises EngineError with the reason."""

    def __init__(self, capability: Capability, reason: str):
        self._capability, self._reason = capability, reason

    def __get__(self, instance: object, owner: Any) -> Callable[..., NoReturn]:
        def refuse(*_: Any, **__: Any) -> NoReturn:
            raise EngineError(owner.NAME, f"does not support {self._capability}: {self._reason}")

        return refuse


def check_capabilities(engine: type, base: type, lacks: Mapping[Capability, str], is_program: bool = False) -> None:
    """Raise TypeError unless the class ``engine`` has each capability, or declares in ``lacks`` why it does not.

    Methods that only ``base`` and its bases define count as not defined. A method of a capability that the engine lacks is
    replaced by :class:`Lacking`, also where the engine inherits it. An engine that is a program of its own (``is_program``)
    answers by files and defines no methods here: it has what it does not declare as lacking.
    """
    owner = f"engine {engine.__name__}"
    unknown = [str(capability) for capability in lacks if not isinstance(capability, Capability)]
    if unknown:
        raise TypeError(f"{owner}: LACKS has unknown capabilities {unknown}; known: {', '.join(Capability)}")
    if silent := [str(capability) for capability, reason in lacks.items() if not reason.strip()]:
        raise TypeError(f"{owner}: LACKS gives no reason for {', '.join(silent)}")
    for capability, methods in METHODS.items():
        if capability in lacks:
            if local := [name for name in methods if name in vars(engine)]:
                raise TypeError(f"{owner} declares that it lacks {capability}, and defines {', '.join(local)}")
            for name in methods:
                setattr(engine, name, Lacking(capability, lacks[capability]))
        elif not is_program and (missing := [name for name in methods if not _defines(engine, name, base)]):
            raise TypeError(f"{owner} must define {', '.join(missing)}, or say in LACKS why it has no {capability}")


def _defines(engine: type, method: str, base: type) -> bool:
    """Whether ``engine`` has a method from a class below ``base``, and does not lack it."""
    definer = next(parent for parent in engine.__mro__ if method in vars(parent))
    return definer not in base.__mro__ and not isinstance(vars(definer)[method], Lacking)


# The law that an engine's own controllers follow, as a declaration that tests compare with its closed form.


class ServoLaw(StrEnum):
    """How an engine's own controller of one joint acts, with gains kp and kd, targets q* and v*, and an effort limit."""

    EXPLICIT_SPRING = "explicit_spring"
    """clip(kp (q* − q) + kd (v* − v)), by the state before the step."""
    IMPLICIT_SPRING = "implicit_spring"
    """clip(kp (q* − q − dt v') + kd (v* − v')), by the velocity v' after the step."""
    MOTOR = "motor"
    """The effort within the limit that makes v' = v* + kp/(kd + dt kp) (q* − q), or comes nearest."""


@dataclass(frozen=True)
class NativeLaw:
    """The law of an engine's built-in controllers."""

    law: ServoLaw
    accuracy: float
    """rad from the closed form within a second, for a wheel of 0.02 kg m²: measured, rounded up."""
    implicit_damping: bool = False
    """Whether the joint's own damping d acts by the velocity after the step where a controller is at its limit, which makes it
    weaker by 1 + dt d / I."""

    residual: float = 0.0
    """Share of a joint's momentum that the engine's solver may leave out in each step, its relative tolerance: at speed v as if
    by a damping of ``residual`` I / dt."""

    @property
    def sags(self) -> bool:
        """Whether a constant load moves the joint away from its target, as it does with a spring."""
        return self.law is not ServoLaw.MOTOR


SPRING_IN_SINGLES = NativeLaw(ServoLaw.IMPLICIT_SPRING, accuracy=1e-5, residual=1e-7)
"""Implicit springs in single precision: 4.6e-6 rad off within a second at 1 ms (measured in three engines)."""


# The numbers that an engine computes with: data, which engines declare (``Engine.PRECISION``) and proofs go by.

DOUBLE: Final = "double"
SINGLE: Final = "single"
ROUNDING: Final[Mapping[str, float]] = {DOUBLE: 2.0**-53, SINGLE: 2.0**-24}
"""By precision how far a number may be off from what it stands for, relative: half the spacing of its digits."""

# How fast an engine takes an overlap of two bodies back, as it declares it.

COMMON_SHARE = 0.01
"""Of an overlap, taken back in each step: the common law of contact (docs/records/contact.md)."""


@dataclass(frozen=True, slots=True)
class Recovery:
    """In a step of dt an overlap r decreases by min(share · r, speed · dt).

    share   of the overlap (β)
    speed   m/s, the most with which it is taken back
    why     what the largest speed comes from; empty where there is none
    """

    share: float = COMMON_SHARE
    speed: float = math.inf
    why: str = ""

    def taken_back(self, overlap: float, steps: int, timestep: float) -> float:
        """The part of an overlap (m) that is taken back in so many steps of ``timestep`` (s)."""
        left = max(0.0, overlap)
        begun = left
        for _ in range(steps):
            left -= min(self.share * left, self.speed * timestep)
        return begun - left


COMMON = Recovery()

# Known deviations of an engine from the contact law, each measured. Those of several bodies stand in the table
# ``contact_deviations.csv`` of an engine, which ``tools/deviations.py`` writes; the engine's own module gives reasons.


@dataclass(frozen=True, slots=True)
class Deviation:
    """A known deviation of an engine from the contact law, in one contact probe (see ``proof/contact/``).

    ``size`` is the largest measured one, ``why`` what it comes from. ``relative``: size is a share of the expected value,
    else it is in the figure's unit. It counts for pairs with at least this ``friction`` and ``restitution``, from this
    ``timestep`` (s) on, and under this ``friction_cone``, kind of ``hardness`` and ``setting`` (name, value) of the engine
    alone, where these are given, in worlds where bodies of at least this ``ratio`` of masses may touch, and in releases before
    ``until`` ("": in all), where the release is known; and below the values of ``below``: friction, restitution, timestep,
    ratio.
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
    setting: tuple[str, Any] | None = None
    ratio: float = 0.0
    until: str = ""
    below: tuple[float, float, float, float] = (inf, inf, inf, inf)

    @property
    def is_local(self) -> bool:
        """Whether it counts around single values alone."""
        return min(self.below) < inf

    def counts_for(
        self,
        pair: PairContact,
        friction_cone: str,
        timestep: float,
        settings: Mapping[str, Any] = MappingProxyType({}),
        ratio: float = 0.0,
        version: str | None = None,
    ) -> bool:
        """Whether it is one of this pair's, under this cone, timestep, and these settings of the engine, in this release of
        it (None: not known). A switch that is missing is off."""
        return (
            (not self.until or (version is not None and is_before(version, self.until)))
            and (self.setting is None or settings.get(self.setting[0], False) == self.setting[1])
            and pair.friction >= self.friction
            and pair.restitution >= self.restitution
            and timestep >= self.timestep
            and ratio >= self.ratio
            and self.friction_cone in ("", friction_cone)
            and self.hardness in ("", pair.hardness.kind)
            and pair.friction < self.below[0]
            and pair.restitution < self.below[1]
            and timestep < self.below[2]
            and ratio < self.below[3]
        )


LIMITS = ("friction", "restitution", "timestep", "ratio")
COLUMNS = (
    "setting",
    "cone",
    "probe",
    *(f"{name}{end}" for name in LIMITS for end in ("", "_below")),
    "size",
    "relative",
)
"""Columns of a table. A row counts from ``friction``, ``restitution``, ``timestep`` (ms) and ``ratio`` on and below the limits
``_below``; an empty cell is no limit. ``setting``: ``name=value``. ``size``: a share of the expected value where ``relative``
is ``yes``, else in the figure's unit; it includes a margin."""
SWITCHES: Mapping[str, bool] = {"true": True, "false": False}
"""Values of settings in such tables that are not words."""
RESTITUTION = 2 * LIMITS.index("restitution")
"""Its place among the cells of the limits."""
BETWEEN_VALUES = "simspec measured this deviation between the values of the engine's other tables"
"""Reason of a local deviation that no reason of the engine covers."""

# Reasons that several engines have in common.

UNKNOWN = "simspec measured this deviation, and its cause is not known"
SWEEPS = (
    "the solver sweeps over its constraints one after another, and leaves overlaps and wrong friction where heavy bodies rest "
    "on light ones"
)
JAMMED = "the solver ends before friction has built up the normal force of a jammed clamp"
DEEP = (
    "the engine removes a share of an overlap in each step: heavy bodies rest deeper, with the square of the timestep"
)
NEAR_LIMIT = (
    "bodies that slide on or under a lighter one require friction within 0.1 % of its limit at a mass ratio of 1000"
)
PREDICTED = (
    "the engine applies restitution to the speed at the end of the step, with gravity: the ratio is e (1 + g dt / v)"
)
THRESHOLD = "the engine's restitution threshold is fixed: bodies with e v < 0.1 m/s do not bounce"
BOUNCES = (
    "without a restitution_threshold, the engine applies restitution to the speed that a force gives a body in one step: "
    "bodies at rest and sliding bodies bounce, and lose friction"
)
PRESSED = (
    "the engine applies restitution where a force gives a body more than 0.1 m/s in one step: bodies that are pressed together "
    "bounce"
)
HOPS = "the engine lets bodies with restitution hop without end where g dt alone exceeds its least bounce"
PYRAMID = "the circumscribed pyramid replaces the elliptic cone, as accepted"


def coarse(motion: str) -> str:
    """That the timestep is too long for bodies that do something."""
    return f"timesteps of several ms are coarse for bodies that {motion}"


def unconverged(solver: str) -> str:
    return f"{solver} ends before friction and normal forces have converged"


@dataclass(frozen=True, slots=True)
class Reason:
    """Why probes deviate: ``probes`` are patterns of their names, separated by spaces, for a setting (``name=value``) and a
    friction cone alone where these are given; ``bounces``: for materials with restitution alone."""

    probes: str
    why: str
    setting: str = ""
    cone: str = ""
    bounces: bool = False

    def covers(self, probe: str, setting: str, cone: str, bounces: bool) -> bool:
        """Whether it is the reason of a row with these values, ``bounces``: with restitution."""
        return (
            any(fnmatchcase(probe, pattern) for pattern in self.probes.split())
            and self.setting in ("", setting)
            and self.cone in ("", cone)
            and (bounces or not self.bounces)
        )


def read_deviations(table: Path, reasons: Sequence[Reason]) -> tuple[Deviation, ...]:
    """The deviations of a table, each with the first reason that covers it. Raises ValueError for other columns, for a row
    without upper limits that no reason covers, and for a reason without such a row."""
    unused, found = list(reasons), list[Deviation]()

    @functools.cache
    def reason_of(probe: str, setting: str, cone: str, bounces: bool) -> Reason | None:
        return next((reason for reason in reasons if reason.covers(probe, setting, cone, bounces)), None)

    with table.open(newline="", encoding="utf-8") as lines:
        rows = csv.reader(lines)
        if (header := tuple(next(rows))) != COLUMNS:
            raise ValueError(f"{table}: its columns are {header}, should be {COLUMNS}")
        # every process that knows an engine reads its table: no dictionary for each of a thousand rows
        for setting, cone, probe, *limits, size, relative in rows:
            friction, restitution, timestep, ratio = [float(cell) if cell else 0.0 for cell in limits[::2]]
            below_friction, below_restitution, below_timestep, below_ratio = [
                float(cell) if cell else inf for cell in limits[1::2]
            ]
            below = (below_friction, below_restitution, below_timestep / 1e3, below_ratio)
            reason = reason_of(probe, setting, cone, bool(limits[RESTITUTION]))
            if min(below) == inf:
                if reason is None:
                    raise ValueError(f"{table}: no reason is given for {probe} {setting} {cone}")
                if reason in unused:
                    unused.remove(reason)
            found.append(
                Deviation(
                    probe,
                    float(size),
                    reason.why if reason else BETWEEN_VALUES,
                    relative=relative == "yes",
                    friction=friction,
                    timestep=timestep / 1e3,
                    restitution=restitution,
                    friction_cone=cone,
                    setting=_setting(setting),
                    ratio=ratio,
                    below=below,
                )
            )
    for reason in unused:
        raise ValueError(f"{table}: no row is of the reason for {reason.probes} {reason.setting} {reason.cone}")
    return tuple(found)


def named_reasons(table: Path, reasons: Mapping[str, str]) -> tuple[Deviation, ...]:
    """The deviations of a table whose column ``why`` names one of ``reasons``, with the columns ``hardness`` and ``until`` and
    without upper limits. Raises KeyError for another reason, and ValueError for one without a row."""
    with table.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    if unused := reasons.keys() - {row["why"] for row in rows}:
        raise ValueError(f"{table}: no row is of the reasons {', '.join(sorted(unused))}")
    return tuple(
        Deviation(
            row["probe"],
            float(row["size"]),
            reasons[row["why"]],
            row["relative"] == "yes",
            float(row["friction"] or 0.0),
            float(row["timestep"] or 0.0) / 1e3,
            float(row["restitution"] or 0.0),
            row["cone"],
            row["hardness"],
            _setting(row["setting"]),
            until=row["until"],
        )
        for row in rows
    )


def _setting(cell: str) -> tuple[str, str | bool] | None:
    name, _, value = cell.partition("=")
    return (name, SWITCHES.get(value, value)) if value else None
