"""A loaded MJX model: MuJoCo reads the file, MJX takes the model over and does the rest.

Facts marked *measured* were obtained with MJX 3.17.0 on JAX 0.10.2, in double precision on one processor.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from simspec.engines.kit.arrays import sorted_pairs
from simspec.engines.mjx.programs import Modules, Programs, as_numpy, begin, import_mjx
from simspec.engines.mujoco.readback import CONE_NAMES
from simspec.engines.mujoco.rewritten import EngineModel, RewrittenSimulation
from simspec.errors import EngineError
from simspec.formats.mjcf.format import MODEL
from simspec.world.types import Body, Quaternion, ReadBack

# What MJX holds, looked at as if it were an ``mjModel``: so that what reads MuJoCo's model reads MJX's, field by field.
#
# An ``mjx.Model`` has MuJoCo's fields under MuJoCo's names, as arrays of JAX or numpy. What MJX does not take over, since it
# does not compute with it (names of things, user data, options of MuJoCo's own solvers), is what the ``mjModel`` has that it
# was made of: so a file that says something else than the world is noticed there, too.


class MjxModel(EngineModel):
    """A field of MJX's own class, or of its implementation, or else of the file."""

    def field(self, name: str) -> Any:
        model = self._model
        owners = (model, model._impl)
        owner = next((own for own in owners if name in type(own).__dataclass_fields__ and name != "_impl"), self.file)
        value = getattr(owner, name)
        return np.asarray(value) if hasattr(value, "shape") else value


CONE_OF_FILE = "file.opt.cone"
"""In the inventory: the cone that stands in the file, where MJX is given another."""
TURN = "geom.{}.quat"
"""In the inventory: how a shape is turned, also within its own symmetry. To MJX half a turn of a box is of effect: it finds
other points of contact, and the same scene moves otherwise (measured: by up to 0.6 of a motion's own length)."""
REFRAMED = ("mesh", "heightfield")
"""Kinds of shapes of which the engine keeps another frame than the file's."""


def turns(bodies: Sequence[Body]) -> dict[str, Quaternion]:
    """By their names in the inventory, the orientations of shapes in their bodies."""
    return {
        TURN.format(shape.name): shape.pose.quaternion
        for body in bodies
        for shape in body.shapes
        if shape.kind not in REFRAMED
    }


class MjxSimulation(RewrittenSimulation, abstract=True):
    """The methods of the engine; its declarations are in ``engine.py``."""

    OWN: ClassVar[tuple[str, ...]] = ("_taken", "_programs", "_file")

    # --- life -----------------------------------------------------------------------------------------------------

    @classmethod
    def prepare(cls) -> None:
        import_mjx()

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        self._modules: Modules = begin()
        super().load(folder, sidecar)
        self._choose_cone()
        self._file = self.data
        self.data = SimpleNamespace(qpos=self._file.qpos.copy(), qvel=self._file.qvel.copy(), ncon=0)
        self._take_over()
        self._forget()

    def _choose_cone(self) -> None:
        """Where no contact there can be has friction, the cone is the pyramid, of one edge: MJX has no other form of it."""
        option, cones = self.model.opt, self._mujoco.mjtCone
        self._cone_of_file = int(option.cone)
        dims = np.asarray(self._modules.make_condim(self.model))
        if option.cone != cones.mjCONE_ELLIPTIC:
            return
        if (dims == 1).all():
            option.cone = cones.mjCONE_PYRAMIDAL
        elif (dims == 1).any():
            raise EngineError(self.NAME, f"{MODEL} has contacts with friction and without, under the elliptic cone")

    def _take_over(self) -> None:
        try:
            self._taken = self._modules.mjx.put_model(self.model)
            self._programs = Programs(self._modules, self._taken)
        except NotImplementedError as error:
            raise EngineError(self.NAME, f"refuses {MODEL}: {error}") from error

    def _seen(self, model: Any) -> MjxModel:
        return MjxModel(self._modules.mjx.put_model(model), model)

    def read_back(self) -> ReadBack:
        found = self._read(MjxModel(self._taken, self.model))
        return dataclasses.replace(
            found,
            friction_cone=CONE_NAMES[self._cone_of_file],
            inventory={**found.inventory, CONE_OF_FILE: self._cone_of_file, **turns(found.bodies)},
        )

    # --- state ----------------------------------------------------------------------------------------------------

    def _forget(self) -> None:
        self._warm = np.zeros(self.model.nv)
        self._last: Mapping[str, Any] | None = None

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        self.data.qpos[self._q] = q
        self.data.qvel[self._v] = v
        self._forget()

    def _at_state(self, velocities: bool = False) -> Any:
        program = self._programs.move if velocities else self._programs.place
        found = as_numpy(program(self.data.qpos, self.data.qvel))
        found.site_xmat = found.site_xmat.reshape(-1, 9)
        found.qpos, found.qvel = self.data.qpos, self.data.qvel
        return found

    # --- dynamics -------------------------------------------------------------------------------------------------

    def mass_blocks(self, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
        full = as_numpy(self._programs.weigh(self.data.qpos, self.data.qvel)).mass
        return [full[np.ix_(self._v[block], self._v[block])] for block in blocks]

    def bias_force(self) -> np.ndarray:
        found: np.ndarray = as_numpy(self._programs.bias(self.data.qpos, self.data.qvel)).bias
        return found[self._v]

    def ready(self) -> None:
        self._programs.step(self.data.qpos, self.data.qvel, self._warm, np.zeros(self.model.nv), 0)

    def step(self, count: int, effort: np.ndarray | None = None) -> None:
        applied = np.zeros(self.model.nv)
        if effort is not None:
            applied[self._v] = effort
        last = self._programs.step(self.data.qpos, self.data.qvel, self._warm, applied, count)
        self.data.qpos, self.data.qvel = np.array(last["q"]), np.array(last["v"])
        self._warm, self._last = np.array(last["warm"]), last

    def energy(self) -> tuple[float, float]:
        """Kinetic by MJX's mass matrix. MJX computes no potential energy: that is MuJoCo's, of the model that it took over."""
        mujoco, file = self._mujoco, self._file
        speed = self.data.qvel
        kinetic = 0.5 * float(speed @ as_numpy(self._programs.weigh(self.data.qpos, self.data.qvel)).mass @ speed)
        file.qpos[:] = self.data.qpos
        mujoco.mj_kinematics(self.model, file)
        mujoco.mj_comPos(self.model, file)
        mujoco.mj_tendon(self.model, file)
        mujoco.mj_energyPos(self.model, file)
        lifted = self.model.body_gravcomp * self.model.body_mass
        return kinetic, float(file.energy[0] + lifted @ (file.xipos @ self.model.opt.gravity))

    # --- contact --------------------------------------------------------------------------------------------------

    def contacts(self) -> dict[str, np.ndarray]:
        """Of all contacts there can be, which MJX computes in every step, those that are within their margin."""
        data = self.data
        if self._last is None:
            data.ncon = 0
            return super().contacts()
        found, every = as_numpy(self._last), self._programs.blank._impl.contact
        there = np.flatnonzero(found.dist <= found.includemargin)
        data.ncon, data.efc_force = len(there), found.force
        data.contact = SimpleNamespace(
            geom=found.geom[there],
            pos=found.pos[there],
            frame=found.frame[there].reshape(-1, 9),
            dist=found.dist[there],
            includemargin=found.includemargin[there],
            dim=np.asarray(every.dim)[there],
            efc_address=np.asarray(every.efc_address)[there],
        )
        return super().contacts()

    def detect_units(self) -> np.ndarray:
        found = as_numpy(self._programs.touch(self.data.qpos, self.data.qvel))
        return sorted_pairs(found.geom[found.dist <= found.includemargin])

    def disable_contact(self) -> None:
        super().disable_contact()
        # without a contact no cone is of effect, and MJX has no form of the elliptic one where limits or friction are rows
        self.model.opt.cone = self._mujoco.mjtCone.mjCONE_PYRAMIDAL
        self._take_over()
