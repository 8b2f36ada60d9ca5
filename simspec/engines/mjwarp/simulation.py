"""A loaded model of MuJoCo Warp: MuJoCo reads the file, Warp takes the model over and does the rest.

Facts marked *measured* were obtained with MuJoCo Warp 4.0.0 on Warp 1.19.0 and a processor. What a state is told as,
and what is asked of it, are singles; between them stands nothing but their copies as doubles.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from simspec.engines.kit.arrays import demand_held, sorted_pairs
from simspec.engines.mjwarp.programs import (
    ENGINE,
    Modules,
    Programs,
    begin,
    chosen_device,
    import_modules,
    taken_over,
)
from simspec.engines.mujoco.rewritten import EngineModel, RewrittenSimulation
from simspec.errors import EngineError
from simspec.formats.mjcf.format import MODEL
from simspec.world.types import ReadBack

# What MuJoCo Warp holds, looked at as if it were an ``mjModel``: what reads MuJoCo's model reads Warp's, field by field.
#
# A model of Warp has MuJoCo's fields under MuJoCo's names, of single precision, with one more dimension where several worlds
# may differ. What it does not take over, since it does not compute with it (names of things, user data, keyframes), is what the
# ``mjModel`` has that it was made of: so a file that says something else than the world is noticed there, too.

LAWS = ("timestep", "*solref*", "*solimp*", "o_*")
"""Fields whose numbers are told apart by more digits than singles have: an error reduction is a quotient by the timestep's
square. A single stands for every number that is rounded to it: these fields are told as MuJoCo's where that is one of them."""
LACKED = ("mjDSBL_AUTORESET",)
"""Flags of what Warp does not have, so that it is always as these say: Warp refuses a model that has them."""


class WarpModel(EngineModel):
    """Made with the bits of :data:`LACKED`."""

    def field(self, name: str) -> Any:
        if name == "impratio":  # Warp keeps one over its root
            return float(1.0 / np.square(self._model.impratio_invsqrt.numpy().astype(float))[0])
        if name == "disableflags":
            return int(self._model.disableflags) | (int(self.file.disableflags) & self._given[0])
        told = getattr(self.file, name)
        if name not in type(self._model).__dataclass_fields__:
            return told
        own = getattr(self._model, name)
        if not hasattr(own, "numpy"):
            return own
        found, like = np.asarray(own.numpy()), np.asarray(told)
        if found.size != like.size:
            raise EngineError(ENGINE, f"holds {found.size} numbers of {name}, MuJoCo {like.size}")
        found = found.reshape(like.shape).astype(like.dtype)
        if any(fnmatchcase(name, law) for law in LAWS):
            found = np.where(like.astype(np.float32) == found.astype(np.float32), like, found)
        return found if like.shape else found.item()


SIGNS: Mapping[str, str] = {
    "ITERATIONS": "the solver used up its iterations",
    "LS_ITERATIONS": "a line search used up its iterations",
    "EPA_HORIZON": "the search for an overlap of two convex shapes ran out of room",
    "HFIELD": "of a shape on a height field some contacts were left out",
}
"""What Warp says of steps that went on, by its names, in words."""
SEARCH_OF_FILE = "file.flags.disable_nativeccd"
"""In the inventory: the flag that stands in the file, where Warp is given it set."""
MOST_WARNINGS = 10
"""Different ones that are told of a model; the others are counted."""
PLACES = ("xpos", "xquat", "xipos", "site_xpos", "site_xmat", "subtree_com")


class MjWarpSimulation(RewrittenSimulation, abstract=True):
    """The methods of the engine; its declarations are in ``engine.py``."""

    OWN: ClassVar[tuple[str, ...]] = ("_taken", "_motion", "_questions", "_file")

    # --- life -----------------------------------------------------------------------------------------------------

    @classmethod
    def prepare(cls) -> None:
        import_modules()

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        said: list[str] = []
        self._modules: Modules = begin(said)
        super().load(folder, sidecar)
        self._log += said
        self._device = chosen_device(self._modules, self._sidecar.settings)
        if not self._device.is_cpu:
            self._log.append(f"computes on {self._device} ({self._device.name})")
        bits = self._mujoco.mjtDisableBit.__members__
        self._lacked = sum(int(bits[name]) for name in LACKED)
        self._file = self.data
        self.data = SimpleNamespace(qpos=self._singles(self._file.qpos), qvel=self._singles(self._file.qvel), ncon=0)
        self._signs: dict[str, int] = {}
        self._take_over()
        self._forget()

    def _take_over(self) -> None:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            self._taken = self._taken_of(self.model)
        told = list(dict.fromkeys(str(one.message) for one in said))  # one for every shape that it is about
        self._log += told[:MOST_WARNINGS]
        if len(told) > MOST_WARNINGS:
            self._log.append(f"and {len(told) - MOST_WARNINGS} more warnings")
        # one data for motion, one for questions
        given = (self._modules, self._device, self._taken, self.model)
        self._motion, self._questions = Programs(*given), Programs(*given)

    def _taken_of(self, model: Any) -> Any:
        try:
            return taken_over(self._modules, self._device, model, self._lacked)
        except (NotImplementedError, ValueError) as error:
            raise EngineError(self.NAME, f"refuses {MODEL}: {error}") from error

    def _seen(self, model: Any) -> WarpModel:
        return WarpModel(self._taken_of(model), model, self._lacked)

    def read_back(self) -> ReadBack:
        found = self._read(WarpModel(self._taken, self.model, self._lacked))
        by_file = bool(self._disabled_by_file & int(self._mujoco.mjtDisableBit.mjDSBL_NATIVECCD))
        return dataclasses.replace(found, inventory={**found.inventory, SEARCH_OF_FILE: by_file})

    def log(self) -> list[str]:
        return super().log() + [f"{SIGNS.get(name, name)}: after {count} calls" for name, count in self._signs.items()]

    # --- state ----------------------------------------------------------------------------------------------------

    def _singles(self, values: np.ndarray) -> np.ndarray:
        """The numbers that Warp makes of these, as doubles."""
        demand_held(self.NAME, values, "a state or an effort")
        return values.astype(np.float32).astype(float)

    def _forget(self) -> None:
        self._warm = np.zeros(self.model.nv)
        self.data.ncon = 0

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        self.data.qpos[self._q] = self._singles(q)
        self.data.qvel[self._v] = self._singles(v)
        self._forget()

    def _asked(self, name: str) -> Programs:
        """The data after a program, at the present state."""
        self._questions.run(name, {"qpos": self.data.qpos, "qvel": self.data.qvel})
        return self._questions

    def _at_state(self, velocities: bool = False) -> Any:
        asked = self._asked("move" if velocities else "place")
        found = SimpleNamespace(**{name: asked.take(name) for name in PLACES}, cvel=asked.take("cvel"))
        found.site_xmat = found.site_xmat.reshape(-1, 9)
        found.qpos, found.qvel = self.data.qpos, self.data.qvel
        return found

    # --- dynamics -------------------------------------------------------------------------------------------------

    def mass_blocks(self, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
        values = self._asked("weigh").take("M")
        return [self._block(values, self._v[block]) for block in blocks]

    def bias_force(self) -> np.ndarray:
        asked = self._asked("bias")
        found: np.ndarray = (asked.take("qfrc_bias") - asked.take("qfrc_gravcomp"))[self._v]
        return found

    def ready(self) -> None:
        self._motion.run("step", self._state(np.zeros(self.model.nv)), 0)

    def _state(self, applied: np.ndarray) -> dict[str, np.ndarray]:
        return {
            "qpos": self.data.qpos,
            "qvel": self.data.qvel,
            "qacc_warmstart": self._warm,
            "qfrc_applied": applied,
        }

    def step(self, count: int, effort: np.ndarray | None = None) -> None:
        applied = np.zeros(self.model.nv)
        if effort is not None:
            applied[self._v] = self._singles(effort)
        self._motion.run("step", self._state(applied), count)
        for name in self._motion.signs:
            self._signs[name] = self._signs.get(name, 0) + 1
        taken = (self._motion.take(name) for name in ("qpos", "qvel", "qacc_warmstart"))
        self.data.qpos, self.data.qvel, self._warm = taken
        self.data.ncon = -1  # not asked yet

    def energy(self) -> tuple[float, float]:
        """By Warp, which leaves the weight that gravcomp takes away in the potential energy."""
        asked = self._asked("energy")
        potential, kinetic = asked.take("energy").tolist()
        lifted = self.model.body_gravcomp * self.model.body_mass
        return kinetic, potential + float(lifted @ (asked.take("xipos") @ self.model.opt.gravity))

    # --- contact --------------------------------------------------------------------------------------------------

    def contacts(self) -> dict[str, np.ndarray]:
        if self.data.ncon:
            found = self._motion.contacts()
            self.data.ncon, self.data.efc_force = len(found["dist"]), found.pop("force")
            self.data.contact = SimpleNamespace(**found)
            self.data.contact.frame = found["frame"].reshape(-1, 9)
        return super().contacts()

    def _normal_forces(self, address: np.ndarray, dim: np.ndarray) -> np.ndarray:
        """The first row of an elliptic contact, the sum over a pyramid's edges; ``address`` (n, rows): -1 where none is."""
        force = np.append(self.data.efc_force, 0.0)
        if self.model.opt.cone == self._mujoco.mjtCone.mjCONE_ELLIPTIC:
            first: np.ndarray = force[address[:, 0]]
            return first
        rows = np.where(dim > 1, 2 * (dim - 1), 1)
        there = (np.arange(address.shape[1]) < rows[:, None]) & (address >= 0)
        summed: np.ndarray = np.where(there, force[address], 0.0).sum(axis=1)
        return summed

    def detect_units(self) -> np.ndarray:
        return sorted_pairs(self._asked("touch").contacts()["geom"])

    def disable_contact(self) -> None:
        super().disable_contact()
        self._take_over()
