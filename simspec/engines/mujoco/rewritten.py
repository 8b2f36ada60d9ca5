"""Engines that implement MuJoCo's dynamics anew: MuJoCo reads the file, the engine takes the model over, and its model is read
back under MuJoCo's names.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from simspec.contact import Rules
from simspec.dialects.mujoco.sidecar import NATIVE
from simspec.engines.kit.arrays import sorted_pairs
from simspec.engines.kit.capabilities import FIXED_TIMESTEP, Capability
from simspec.engines.kit.contract import Actuation
from simspec.engines.kit.settings import Setting, resolve_settings
from simspec.engines.mujoco.contact import NATIVE_FRICTION
from simspec.engines.mujoco.engine import MuJoCo
from simspec.engines.mujoco.expectation import MujocoExpectation
from simspec.engines.mujoco.inventory import expected_inventory
from simspec.engines.mujoco.readback import read_back
from simspec.engines.mujoco.simulation import NO_EXPLICIT_PAIRS, MujocoSimulation
from simspec.errors import EngineError
from simspec.support import features
from simspec.support.declarations import (
    EXACT,
    Attempt,
    Refinement,
    Support,
    exact,
    for_each,
    never,
    not_yet,
    unsupported_if,
)
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws
from simspec.world.types import EngineValue, PairContact, ReadBack, World

OF_MUJOCO = "Use the engine mujoco with engines.mujoco.settings: {friction: coulomb}"
"""The way out where MuJoCo's declaration names a setting that only MuJoCo has."""


def support(title: str, pyramid: str) -> dict[Feature, Support]:
    """MuJoCo's declarations without what simspec computes around MuJoCo's solver. ``pyramid``: why friction needs the cone."""
    return {
        **MuJoCo.SUPPORT,
        **{
            feature: dataclasses.replace(MuJoCo.SUPPORT[feature], how=f"{lack}. {OF_MUJOCO}", refine=None, cases=())
            for feature, lack in NATIVE_FRICTION.items()
        },
        Feature.SHAPE_BOX: EXACT,  # by a function for two boxes, in every release of MuJoCo
        Feature.CONTROL_NATIVE: not_yet(f"simspec drives {title} by efforts only", Attempt.BUILT_IN_CONTROLLER),
        Feature.CONE_PYRAMID_INSCRIBED: exact(
            f"{title} has this cone without friction only: simspec sets a pyramid of one edge",
            lambda world: _no_friction(world, pyramid),
        ),
        **for_each(
            never("simspec implements its iteration of equality constraints for MuJoCo only"),
            *features.CONSTRAINTS,
        ),
    }


NOT_REWRITTEN = ("integrator", "sleeping", "sleep_tolerance")
"""Settings of MuJoCo that its rewritten engines do not have."""


def settings(title: str, island: str, solver: str) -> dict[str, Setting]:
    """MuJoCo's settings. ``island``, ``solver``: their meanings."""
    given = {name: value for name, value in MuJoCo.SETTINGS.items() if name not in NOT_REWRITTEN}
    return given | {
        "solver": dataclasses.replace(
            given["solver"], meaning=solver, choices=("newton",), frictionless=None, frictionless_unless=None
        ),
        "friction": dataclasses.replace(
            given["friction"],
            meaning="native: MuJoCo's friction, which leaves out most of the friction of an impact. The spec "
            "must accept contact.friction.impact and contact.friction.carried. simspec implements "
            "friction: coulomb for MuJoCo only.",
            choices=(NATIVE,),
        ),
        "island": dataclasses.replace(
            given["island"], meaning=f"A setting of MuJoCo's file, without effect: {island}", needs=None
        ),
    }


def lacks(title: str) -> Mapping[Capability, str]:
    """The capabilities that it lacks."""
    return {
        Capability.NATIVE_CONTROLLERS: f"simspec drives {title} by efforts only",
        Capability.FOREIGN_FILES: f"{title} reads no files: MuJoCo loads the model",
        Capability.TIMESTEP: FIXED_TIMESTEP,
    }


def has_friction(law: PairContact) -> bool:
    """Whether a contact has friction of any kind."""
    return bool(law.friction or law.torsional_friction or law.rolling_friction)


def _no_friction(world: World, why: str) -> Refinement | None:
    """Refused, as ``why`` says, where anything has friction."""
    return unsupported_if(why) if any(map(has_friction, meeting_laws(world).values())) else None


class _ReadMujoco:
    """MuJoCo's module for the read-back of an engine's model: names are those of its file, models of text become the engine's,
    by ``taken_over``."""

    def __init__(self, mujoco: Any, taken_over: Callable[[Any], Any]):
        self._mujoco, self._taken_over = mujoco, taken_over
        self.MjModel = self

    def __getattr__(self, name: str) -> Any:
        return getattr(self._mujoco, name)

    def mj_id2name(self, model: EngineModel, kind: Any, index: int) -> Any:
        return self._mujoco.mj_id2name(model.file, kind, index)

    def from_xml_string(self, text: str) -> Any:
        return self._taken_over(self._mujoco.MjModel.from_xml_string(text))


class EngineModel:
    """An engine's model, or its options, with the fields of ``mjModel`` as numpy's arrays: MuJoCo's read-back reads it.
    ``file``: the model of MuJoCo that it was made of."""

    def __init__(self, model: Any, file: Any, *given: Any):
        self._model, self.file, self._given = model, file, given
        self.opt: Any = type(self)(model.opt, file.opt, *given) if hasattr(file, "opt") else None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self.field(name)

    def field(self, name: str) -> Any:
        """A field that the engine has under MuJoCo's name, or else the file's."""
        raise NotImplementedError


class RewrittenSimulation(MujocoSimulation, abstract=True):
    """The methods that do not depend on the engine that takes a model over."""

    DIALECT: ClassVar[str] = "mujoco"
    EXTRA: ClassVar[str] = ""
    RULES: ClassVar[Rules] = MuJoCo.RULES
    LAYERS: ClassVar[bool] = False
    HULL_PRECISION: ClassVar[float] = MuJoCo.HULL_PRECISION
    UNREADABLE: ClassVar[Mapping[str, str]] = MuJoCo.UNREADABLE
    MADE: ClassVar[tuple[str, ...]] = ("_taken", "_file")
    """Attributes made of the model, which ``close`` deletes."""

    data: Any
    """The present state, ``qpos`` and ``qvel``, and the contacts of the last step under MuJoCo's names; ``ncon`` is 0 without a
    step, and -1 where its contacts have not been taken yet."""

    # --- what an engine defines ---

    def _adapt(self) -> None:
        """Change MuJoCo's model before it is taken over. Optional."""

    def _take_over(self) -> None:
        """Make the engine's model of MuJoCo's, and its programs."""
        raise NotImplementedError

    def _seen(self, model: Any) -> EngineModel:
        """The engine's model of an ``mjModel``, its fields under MuJoCo's names."""
        raise NotImplementedError

    def _query(self, program: str) -> Any:
        """The arrays that a program computes at the present state, as attributes."""
        raise NotImplementedError

    def _advanced(self, applied: np.ndarray, count: int) -> Sequence[np.ndarray]:
        """``qpos``, ``qvel`` and the accelerations to begin the next step at, after ``count`` steps under ``applied`` (nv,)."""
        raise NotImplementedError

    def _last_contacts(self) -> dict[str, np.ndarray]:
        """The contacts of the last step within their margin, under MuJoCo's names, and ``force``, that of each row."""
        raise NotImplementedError

    def _rounded(self, values: np.ndarray) -> np.ndarray:
        """The numbers that the engine makes of these, as doubles."""
        return np.array(values, dtype=float)

    # --- life ---

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        super().load(folder, sidecar)
        self._adapt()
        self._file = self.data
        self.data = SimpleNamespace(qpos=self._rounded(self._file.qpos), qvel=self._rounded(self._file.qvel))
        self._take_over()
        self._forget()

    def _read(self, model: EngineModel) -> ReadBack:
        actuation = int(self._mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        flags = (int(model.opt.disableflags) & ~actuation) | (self._disabled_by_file & actuation)
        try:
            found = read_back(_ReadMujoco(self._mujoco, self._seen), model, self._sidecar, flags)
        except EngineError as error:  # says that it is MuJoCo
            raise EngineError(self.NAME, str(error).removeprefix(f"{error.engine}: ")) from error
        return dataclasses.replace(found, made_of=self._made_of())

    def _made_of(self) -> str:
        """A hash of all that the engine is given: the whole model and the sidecar."""
        model = np.empty(self._mujoco.mj_sizeModel(self.model), dtype=np.uint8)
        self._mujoco.mj_saveModel(self.model, None, model)
        return hashlib.sha256(model.tobytes() + repr(self._sidecar).encode()).hexdigest()

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        return expected_inventory(
            MujocoExpectation(world, resolve_settings(cls, world), neutral, cls.RULES, cls.LAYERS, cls.NAME)
        )

    def log(self) -> list[str]:
        if self._mujoco is None or self._sidecar.explicit_pairs:
            return list(self._log)
        return [*self._log, NO_EXPLICIT_PAIRS]

    def close(self) -> None:
        super().close()
        for name in self.MADE:
            self.__dict__.pop(name, None)

    # --- state and dynamics ---

    def _forget(self) -> None:
        self._warm = np.zeros(self.model.nv)
        self.data.ncon = 0

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        self.data.qpos[self._q] = self._rounded(q)
        self.data.qvel[self._v] = self._rounded(v)
        self._forget()

    def _at_state(self, velocities: bool = False) -> Any:
        found = self._query("move" if velocities else "place")
        found.site_xmat = found.site_xmat.reshape(-1, 9)
        found.qpos, found.qvel = self.data.qpos, self.data.qvel
        return found

    def ready(self) -> None:
        self._advanced(np.zeros(self.model.nv), 0)

    def step(self, count: int, effort: np.ndarray | None = None) -> None:
        applied = np.zeros(self.model.nv)
        if effort is not None:
            applied[self._v] = self._rounded(effort)
        self.data.qpos, self.data.qvel, self._warm = self._advanced(applied, count)
        self.data.ncon = -1

    def actuate(self, q: np.ndarray, v: np.ndarray) -> Actuation:
        return Actuation(self, q, v)

    # --- contact ---

    def contacts(self) -> dict[str, np.ndarray]:
        if self.data.ncon:
            found = self._last_contacts()
            self.data.ncon, self.data.efc_force = len(found["dist"]), found.pop("force")
            self.data.contact = SimpleNamespace(**found)
            self.data.contact.frame = found["frame"].reshape(-1, 9)
        return super().contacts()

    def detect_units(self) -> np.ndarray:
        found = self._query("touch")
        return sorted_pairs(found.geom[found.dist <= found.includemargin])

    def disable_contact(self) -> None:
        super().disable_contact()
        self._take_over()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        super().disable_dry_friction(v)
        self._take_over()
