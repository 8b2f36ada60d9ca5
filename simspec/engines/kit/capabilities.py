"""The capabilities of an engine in addition to its core, each by name, and the check that it declares those that it lacks.

The core is what nothing works without: ``load``, ``read_back``, ``set_state``, ``get_state``, ``body_states``, ``step``,
``log`` and ``close``. All else is a capability: an engine's class either defines its methods, or says in
``LACKS`` why it does not have it. The methods of what it lacks are not called, and raise EngineError with that reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, NoReturn

from simspec.errors import EngineError


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
}
"""The methods of :class:`simspec.engines.kit.contract.Engine` that an engine with the capability defines."""


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
