"""What engines have in common that are MuJoCo's dynamics written anew: MuJoCo reads the file, they take its model over, and
what they then hold is read under MuJoCo's own names.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Collection
from typing import Any, ClassVar

import numpy as np

from simspec.engines.kit.contract import Actuation
from simspec.engines.mujoco.readback import read_back
from simspec.engines.mujoco.simulation import NO_EXPLICIT_PAIRS, MujocoSimulation
from simspec.errors import EngineError
from simspec.support.declarations import Refinement, Support, Table, for_each, never, unsupported_if
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_kinds, meeting_laws
from simspec.world.types import PairContact, ReadBack, World

HARDNESSES = (
    Feature.HARDNESS_COMMON,
    Feature.HARDNESS_TIME_CONSTANT,
    Feature.HARDNESS_STIFFNESS,
    Feature.HARDNESS_NATIVE,
)
NO_EQUALITIES: Table = for_each(
    never("simspec's repeated solution of equalities in a step is written for MuJoCo alone"),
    Feature.CONSTRAINT_COUPLING,
    Feature.CONSTRAINT_LOOP,
)


def hardnesses(table: Table, refine: Callable[[World], Refinement | None]) -> Table:
    """MuJoCo's declarations of hardness, from ``table``, with what holds in a world."""
    return {feature: dataclasses.replace(table[feature], refine=refine) for feature in HARDNESSES}


OF_MUJOCO = (
    "simspec's loop around MuJoCo's solver is not written for it: the engine mujoco has it right, with "
    "engines.mujoco.settings: {friction: coulomb}"
)
"""The way out where MuJoCo's declaration names a setting that only MuJoCo has."""


def without_coulomb(support: Support) -> Support:
    """MuJoCo's declaration of friction, for an engine whose friction has no Coulomb's law to be asked for."""
    said = [part for part in support.how.split("; ") if "friction: coulomb" not in part]
    return dataclasses.replace(support, how="; ".join([*said, OF_MUJOCO]), refine=None, cases=())


def rubs(law: PairContact) -> bool:
    """Whether a contact has friction of any kind."""
    return bool(law.friction or law.torsional_friction or law.rolling_friction)


def no_friction(world: World, why: str) -> Refinement | None:
    """Refused, as ``why`` says, where anything has friction."""
    return unsupported_if(why) if any(map(rubs, meeting_laws(world).values())) else None


def met_exactly(kind: str, exactly: Collection[str], why: str, world: World) -> Refinement | None:
    """Refused, as ``why`` says, where a ``kind`` of shape may meet others than ``exactly``."""
    for one, other in sorted(meeting_kinds(world)):
        met = other if one == kind else one
        if kind in (one, other) and met not in exactly:
            return unsupported_if(f"a {kind} may meet a {met}: {why}")
    return None


class HeldMujoco:
    """MuJoCo's module for what reads what an engine holds: names are those of its file (``held.file``), models of text become
    the engine's, by ``taken_over``."""

    def __init__(self, mujoco: Any, taken_over: Callable[[Any], Any]):
        self._mujoco, self._taken_over = mujoco, taken_over
        self.MjModel = self

    def __getattr__(self, name: str) -> Any:
        return getattr(self._mujoco, name)

    def mj_id2name(self, held: Any, kind: Any, index: int) -> Any:
        """The name of a thing in the file."""
        return self._mujoco.mj_id2name(held.file, kind, index)

    def from_xml_string(self, text: str) -> Any:
        """What the engine holds of a model."""
        return self._taken_over(self._mujoco.MjModel.from_xml_string(text))


class EngineModel:
    """An engine's model, or its options, with the fields of ``mjModel`` as numpy's arrays: MuJoCo's read-back reads it.
    ``file``: the model of MuJoCo that it was made of."""

    def __init__(self, model: Any, file: Any, *given: Any):
        self._model, self.file, self._given = model, file, given
        self.opt = type(self)(model.opt, file.opt, *given) if hasattr(file, "opt") else None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self.field(name)

    def field(self, name: str) -> Any:
        """A field that the engine has under MuJoCo's name, or else the file's."""
        raise NotImplementedError


class RewrittenSimulation(MujocoSimulation, abstract=True):
    """The methods that do not depend on who takes a model over."""

    OWN: ClassVar[tuple[str, ...]] = ()
    """Names of what was made of the model, to be let go."""

    data: Any
    """The present state, ``qpos`` and ``qvel``, and the contacts of the last step under MuJoCo's names."""

    def _take_over(self) -> None:
        """Make the engine's model of MuJoCo's, and its programs."""
        raise NotImplementedError

    def _seen(self, model: Any) -> Any:
        """What the engine makes of an ``mjModel``, its fields under MuJoCo's names."""
        raise NotImplementedError

    def _read(self, held: Any) -> ReadBack:
        """The read-back of what is ``held`` of the loaded model."""
        actuation = int(self._mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        flags = (int(held.opt.disableflags) & ~actuation) | (self._disabled_by_file & actuation)
        try:
            found = read_back(HeldMujoco(self._mujoco, self._seen), held, self._sidecar, flags)
        except EngineError as error:  # says that it is MuJoCo
            raise EngineError(self.NAME, str(error).removeprefix(f"{error.engine}: ")) from error
        return dataclasses.replace(found, made_of=self._made_of())

    def _made_of(self) -> str:
        """A hash of the model that the engine is given, whole, and of the sidecar: it is told nothing else."""
        model = np.empty(self._mujoco.mj_sizeModel(self.model), dtype=np.uint8)
        self._mujoco.mj_saveModel(self.model, None, model)
        digest = hashlib.sha256(model.tobytes())
        digest.update(repr(self._sidecar).encode())
        return digest.hexdigest()

    def log(self) -> list[str]:
        if self._mujoco is None or self._sidecar.explicit_pairs:
            return list(self._log)
        return [*self._log, NO_EXPLICIT_PAIRS]

    def close(self) -> None:
        super().close()
        for name in self.OWN:
            self.__dict__.pop(name, None)

    def actuate(self, q: np.ndarray, v: np.ndarray) -> Actuation:
        return Actuation(self, q, v)

    def disable_dry_friction(self, v: np.ndarray) -> None:
        super().disable_dry_friction(v)
        self._take_over()
