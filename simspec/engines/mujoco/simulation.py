"""A loaded MuJoCo model: state, dynamics, contacts.

Only stepping touches the simulation's own data; every question (poses, mass matrix, contacts at a state) is answered from
a second ``mjData`` of the same model, so that asking cannot change the motion by a single bit. Facts marked *measured*
were obtained with MuJoCo 4.0.0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simspec.control.reference import Servos
from simspec.dialects.kit.sidecar import SidecarBody
from simspec.dialects.mujoco.sidecar import COULOMB, FLAGS, KEYFRAME, NATIVE, MujocoSidecar, chains
from simspec.engines.kit.arrays import CollisionUnit, empty_contacts, restore_velocities, sorted_pairs
from simspec.engines.kit.capabilities import Recovery
from simspec.engines.kit.contract import Actuation, Engine
from simspec.engines.mujoco.joints import Between, MujocoDrive, MujocoJointArrays
from simspec.engines.mujoco.readback import JOINT_KINDS, frame_sites, read_back
from simspec.engines.mujoco.stepping import Coulomb, Equalities
from simspec.errors import EngineError, not_importable
from simspec.formats.mjcf.bodies import file_name
from simspec.formats.mjcf.format import MODEL
from simspec.world.rotations import cross
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, PairContact, ReadBack

CONTACTS_LEFT_OUT, CONSTRAINTS_LEFT_OUT = 1, 2
"""MuJoCo's mjtWarning: places of its counts of steps in which the arena had no room."""
NO_EXPLICIT_PAIRS = (
    "more shapes may touch with friction than explicit_pairs_limit allows to list: a body that slides is lifted (at μ = 0.5 by "
    "8 mm at 1 m/s, measured), and clamps slip half as far as they should, so that the proof fails; engines.mujoco.settings: "
    "{friction: coulomb} needs no list, and is right"
)


class MujocoSimulation(Engine, abstract=True):
    """The methods of the engine; its declarations are in ``engine.py``."""

    def __init__(self) -> None:
        self._log: list[str] = []
        self._mujoco: Any = None
        self._coulomb: Coulomb | None = None
        self._stepper: Coulomb | Equalities | None = None
        """The stepper that replaces MuJoCo's step where that is not the world's."""
        self._pushed = False

    # --- life -----------------------------------------------------------------------------------------------------

    @classmethod
    def prepare(cls) -> None:
        import_mujoco()

    @classmethod
    def recovery(cls, settings: Mapping[str, Any], law: PairContact) -> Recovery | None:
        cushioned = (
            settings["friction"] == NATIVE and law.friction and settings["friction_cushion"] and not law.restitution
        )
        if cushioned or law.hardness.kind != "common":
            return None
        return Recovery(float(settings["contact_error_reduction"]))

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        self.close()
        try:
            self._sidecar = MujocoSidecar.of(sidecar)
        except ValueError as error:
            raise EngineError(self.NAME, str(error)) from error
        self._mujoco = mujoco = import_mujoco()
        mujoco.set_mju_user_warning(self._log.append)
        try:
            self.model = mujoco.MjModel.from_xml_path(str(folder / MODEL))
        except (ValueError, mujoco.FatalError) as error:
            raise EngineError(self.NAME, f"refuses {MODEL}: {error}") from error
        self._check_flags()
        self._disabled_by_file = int(self.model.opt.disableflags)
        # an unused servo would hold its joint at zero; ``track`` switches them on
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        self._make_states()
        self._make_steppers()
        self._index(self._sidecar.bodies)
        key = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_KEY, KEYFRAME)
        if key < 0:
            raise EngineError(self.NAME, f"{MODEL} has no keyframe {KEYFRAME!r}")
        mujoco.mj_resetDataKeyframe(self.model, self.data, key)

    def _make_steppers(self) -> None:
        coulomb = self._sidecar.settings["friction"] == COULOMB
        equalities = Equalities(self._mujoco, self.model, self.data) if self.model.neq else None
        self._coulomb = Coulomb(self._mujoco, self.model, self.data, equalities) if coulomb else None
        self._stepper = self._coulomb or equalities

    def set_timestep(self, timestep: float) -> None:
        self.model.opt.timestep = timestep
        self._make_steppers()  # their references follow from it

    def _make_states(self) -> None:
        try:
            self.data = self._mujoco.MjData(self.model)
            self._probe = self._mujoco.MjData(self.model)
        except (MemoryError, self._mujoco.FatalError) as error:
            raise EngineError(
                self.NAME,
                f"no room for two states with an arena of {self.model.narena / 2**20:.0f} MiB each; with "
                f"engines.{self.NAME}.settings: {{arena: MIB}} they are smaller\n{error}",
            ) from error
        # live: MuJoCo counts in it
        self._warned = self.data.warning.number

    def _check_flags(self) -> None:
        """Flags that only newer versions know cannot stand in the file; their values are checked here."""
        bits = self._mujoco.mjtEnableBit.__members__
        requested = {f"mjENBL_{name.upper()}" for name, on in FLAGS if on} | {"mjENBL_MULTICCD"}
        if self._sidecar.settings.get("sleeping", False):  # not there when off
            requested.add("mjENBL_SLEEP")
        on = [name for name, bit in bits.items() if self.model.opt.enableflags & int(bit) and name not in requested]
        if on:
            raise EngineError(self.NAME, f"{MODEL} switches on what simspec does not use: {', '.join(on)}")

    def _index(self, entries: tuple[SidecarBody, ...]) -> None:
        mujoco, model = self._mujoco, self.model
        rows = chains(self._sidecar)
        numbers: dict[str, int] = {}
        joints: dict[str, int] = {}
        for name, chain in rows.items():
            number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, file_name(name))
            if number < 0:
                raise EngineError(self.NAME, f"{MODEL} has no body {name!r}")
            numbers[name] = number
            first, count = int(model.body_jntadr[number]), int(model.body_jntnum[number])
            if count not in ((0, 1) if len(chain) == 1 else (len(chain),)):
                raise EngineError(self.NAME, f"{MODEL} holds {count} joints of {name!r}, the sidecar {len(chain)}")
            joints |= {called: first + place for place, (called, _) in enumerate(chain[-count:] if count else ())}
        positions: list[int] = []
        velocities: list[int] = []
        for entry in entries:
            if entry.name not in joints:
                continue
            joint = joints[entry.name]
            kind = JOINT_KINDS[int(model.jnt_type[joint])]
            start, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
            positions.extend(range(start, start + POSITION_SIZE[kind]))
            velocities.extend(range(dof, dof + VELOCITY_SIZE[kind]))
        if model.nbody != len(numbers) + 1 or len(positions) != model.nq:
            raise EngineError(self.NAME, f"{MODEL} holds {model.nbody - 1} bodies, the sidecar {len(numbers)}")
        self._between = Between(model, entries, rows, joints) if len(rows) < len(entries) else None
        self._present = np.array([entry.name in numbers for entry in entries], dtype=bool)
        self._bodies = np.array([numbers[entry.name] for entry in entries if entry.name in numbers], dtype=np.intp)
        self._q = np.array(positions, dtype=np.intp)
        self._v = np.array(velocities, dtype=np.intp)
        self._world_index = np.full(model.nbody, -1, dtype=np.int64)
        self._world_index[self._bodies] = np.flatnonzero(self._present)
        self._offsets = np.array([entry.frame_offset for entry in entries]).reshape(-1, 3)

    def read_back(self) -> ReadBack:
        return read_back(self._mujoco, self.model, self._sidecar, self._disabled_by_file)

    def log(self) -> list[str]:
        found = list(self._log)
        if self._mujoco is not None and not self._sidecar.explicit_pairs:
            found.append(NO_EXPLICIT_PAIRS)
        if self._coulomb is not None:
            found += self._coulomb.log()
        if self._mujoco is not None:
            kinds = self._mujoco.mjtWarning.__members__
            for name, kind in kinds.items():
                if name.startswith("mjWARN_") and self.data.warning[int(kind)].number:
                    found.append(f"{name.removeprefix('mjWARN_').lower()}: {self.data.warning[int(kind)].number} times")
        return found

    def close(self) -> None:
        if self._mujoco is not None:
            self._mujoco.set_mju_user_warning(None)
            self._mujoco = self._coulomb = self._stepper = None
            for name in ("data", "_probe", "_warned", "model"):  # a refused file leaves some of them unmade
                self.__dict__.pop(name, None)
        self._log.clear()

    # --- state ----------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        self._mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self._q] = q
        self.data.qvel[self._v] = v

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        return self.data.qpos[self._q], self.data.qvel[self._v]

    def _at_state(self, velocities: bool = False) -> Any:
        """The probe's data with kinematics at the present state, and with the bodies' velocities."""
        mujoco, probe = self._mujoco, self._probe
        probe.qpos[:] = self.data.qpos
        probe.qvel[:] = self.data.qvel
        mujoco.mj_kinematics(self.model, probe)
        mujoco.mj_comPos(self.model, probe)
        if velocities:
            mujoco.mj_comVel(self.model, probe)
        return probe

    def body_states(self) -> tuple[np.ndarray, np.ndarray]:
        probe, bodies = self._at_state(velocities=True), self._bodies
        poses = np.concatenate([probe.xpos[bodies], probe.xquat[bodies]], axis=1)
        angular, central = probe.cvel[bodies, :3], probe.cvel[bodies, 3:]
        # cvel is the velocity of the point of the body at its tree's centre of mass
        lever = poses[:, :3] - probe.subtree_com[self.model.body_rootid[bodies]]
        velocities = np.concatenate([central + cross(angular, lever), angular], axis=1)
        if self._between is not None:
            poses, velocities = self._between.add(self._present, poses, velocities, probe.qpos, probe.qvel)
        return restore_velocities(poses, velocities, self._offsets)

    def frame_poses(self) -> np.ndarray | None:
        sites = list(frame_sites(self._mujoco, self.model).values())
        if not sites:
            return None
        probe, turns = self._at_state(), np.zeros((len(sites), 4))
        for turn, site in zip(turns, sites, strict=True):
            self._mujoco.mju_mat2Quat(turn, probe.site_xmat[site])
        return np.concatenate([probe.site_xpos[sites], turns], axis=1)

    # --- dynamics -------------------------------------------------------------------------------------------------

    def mass_blocks(self, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
        mujoco, model = self._mujoco, self.model
        probe = self._at_state()
        _composite_inertia(mujoco, model, probe)
        if hasattr(probe, "qM"):  # before MuJoCo 4
            full = np.zeros((model.nv, model.nv))
            mujoco.mj_fullM(model, full, probe.qM)
            return [full[np.ix_(self._v[block], self._v[block])] for block in blocks]
        return [self._block(probe.M, self._v[block]) for block in blocks]

    def _block(self, values: np.ndarray, dofs: np.ndarray) -> np.ndarray:
        """The part of M for some degrees of freedom. MuJoCo 4 keeps M's lower half by rows, and only what can be non-zero."""
        model = self.model
        found = np.zeros((len(dofs), len(dofs)))
        place = {int(dof): index for index, dof in enumerate(dofs)}
        for dof, row in place.items():
            start = int(model.M_rowadr[dof])
            entries = slice(start, start + int(model.M_rownnz[dof]))
            for other, value in zip(model.M_colind[entries].tolist(), values[entries].tolist(), strict=True):
                if other in place:
                    found[row, place[other]] = found[place[other], row] = value
        return found

    def bias_force(self) -> np.ndarray:
        probe = self._at_state(velocities=True)
        bias = np.zeros(self.model.nv)
        self._mujoco.mj_rne(self.model, probe, 0, bias)
        if self.model.body_gravcomp.any():
            self._mujoco.mj_passive(self.model, probe)
            bias -= probe.qfrc_gravcomp
        return bias[self._v]

    def step(self, count: int, effort: np.ndarray | None = None) -> None:
        if effort is not None:
            self.data.qfrc_applied[self._v] = effort
            self._pushed = True
        elif self._pushed:
            self.data.qfrc_applied[:] = 0.0
            self._pushed = False
        self._advance(count)

    def _advance(self, count: int) -> None:
        """``count`` steps. Raises EngineError where contacts or constraints found no room: MuJoCo goes on without them, and
        says so by a count only."""
        try:
            if self._stepper is not None:
                self._stepper.advance(count)
            else:
                self._mujoco.mj_step(self.model, self.data, nstep=count)
        except self._mujoco.FatalError as error:
            if "arena" not in str(error):
                raise EngineError(self.NAME, str(error)) from error
            raise self._no_room(str(error)) from error
        if self._warned[CONTACTS_LEFT_OUT] or self._warned[CONSTRAINTS_LEFT_OUT]:
            raise self._no_room("contacts or constraints were left out")

    def _no_room(self, why: str) -> EngineError:
        arena = self.model.narena // 2**20
        newton = self.model.opt.solver == self._mujoco.mjtSolver.mjSOL_NEWTON
        less = (
            "; solver: cg needs less, since Newton's factor grows with the square of the velocities" if newton else ""
        )
        return EngineError(
            self.NAME,
            f"the arena of {arena} MiB has no room for the {self.data.ncon} contacts of a step at {self.data.time:.6g} s; "
            f"engines.{self.NAME}.settings: {{arena: {max(2 * arena, 1)}}} gives it more{less}\n{why}",
        )

    def actuate(self, q: np.ndarray, v: np.ndarray) -> Actuation:
        self._pushed = True  # efforts given there must not remain for steps without effort
        return MujocoJointArrays(self.data, self._advance, self._q[q], self._v[v])

    def track(
        self, q: np.ndarray, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ) -> Servos:
        self.model.opt.disableflags &= ~int(self._mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        return MujocoDrive(self._mujoco, self.model, self.data, self._v[v], stiffness, damping)

    def energy(self) -> tuple[float, float]:
        mujoco, probe = self._mujoco, self._at_state(velocities=True)
        _composite_inertia(mujoco, self.model, probe)
        mujoco.mj_tendon(self.model, probe)  # its springs count
        mujoco.mj_energyPos(self.model, probe)
        mujoco.mj_energyVel(self.model, probe)
        # the part that gravcomp removes is not in MuJoCo's own potential energy
        lifted = self.model.body_gravcomp * self.model.body_mass
        return float(probe.energy[1]), float(probe.energy[0] + lifted @ (probe.xipos @ self.model.opt.gravity))

    # --- contact --------------------------------------------------------------------------------------------------

    def contacts(self) -> dict[str, np.ndarray]:
        data = self.data
        if data.ncon == 0:
            return empty_contacts()
        contact = data.contact
        return {
            "body": self._world_index[self.model.geom_bodyid[contact.geom]],
            "position": contact.pos.copy(),
            "normal": -contact.frame[:, :3],  # MuJoCo's points from the first to the second
            "distance": contact.dist - contact.includemargin,
            "normal_force": self._normal_forces(contact.efc_address, contact.dim),
            "unit": contact.geom.astype(np.int64),
        }

    def _normal_forces(self, address: np.ndarray, dim: np.ndarray) -> np.ndarray:
        """As ``mj_contactForce``: the first row of an elliptic contact, the sum over a pyramid's edges."""
        force = np.append(self.data.efc_force, 0.0)
        first = np.where(address >= 0, address, len(force) - 1)
        if self.model.opt.cone == self._mujoco.mjtCone.mjCONE_ELLIPTIC:
            return force[first]
        rows = np.where(dim > 1, 2 * (dim - 1), 1)
        return np.array([force[start : start + count].sum() for start, count in zip(first, rows, strict=True)])

    def collision_units(self) -> Sequence[CollisionUnit]:
        mujoco, model = self._mujoco, self.model
        return [
            CollisionUnit(
                int(self._world_index[model.geom_bodyid[geom]]),
                (mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) or "",),
            )
            for geom in range(model.ngeom)
        ]

    def detect_units(self) -> np.ndarray:
        probe = self._at_state()
        try:
            self._mujoco.mj_collision(self.model, probe)
        except self._mujoco.FatalError as error:
            raise self._no_room(str(error)) from error
        if probe.warning[CONTACTS_LEFT_OUT].number:
            raise self._no_room("contacts were left out of the answer")
        return sorted_pairs(probe.contact.geom[probe.contact.dist <= probe.contact.includemargin])

    def disable_contact(self) -> None:
        self.model.opt.disableflags |= int(self._mujoco.mjtDisableBit.mjDSBL_CONTACT)

    def disable_dry_friction(self, v: np.ndarray) -> None:
        places = self._v[v]
        self.model.dof_frictionloss[places] = 0.0
        for tendon in range(self.model.ntendon):  # efforts along sums of only such joints
            parts = slice(self.model.tendon_adr[tendon], self.model.tendon_adr[tendon] + self.model.tendon_num[tendon])
            if np.isin(self.model.jnt_dofadr[self.model.wrap_objid[parts]], places).all():
                self.model.tendon_frictionloss[tendon] = 0.0


def import_mujoco() -> Any:
    """MuJoCo's module. Raises EngineError where it cannot be imported."""
    try:
        import mujoco
    except ImportError as error:
        raise not_importable("mujoco", "mujoco", error) from error
    return mujoco


def _composite_inertia(mujoco: Any, model: Any, data: Any) -> None:
    """The mass matrix, armature included; ``mj_makeM`` where it exists."""
    getattr(mujoco, "mj_makeM", mujoco.mj_crb)(model, data)
