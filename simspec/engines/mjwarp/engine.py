"""MuJoCo Warp: MuJoCo reads the file, Warp takes the model over.

Facts marked *measured* were obtained with MuJoCo Warp 4.0.0 on Warp 1.19.0 and a processor. States, efforts and answers are
singles, and copied to doubles.
"""

from __future__ import annotations

import dataclasses
import functools
import warnings
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from simspec.dialects.mujoco.contact import moment_hardness
from simspec.engines.kit.arrays import demand_singles
from simspec.engines.kit.capabilities import SINGLE, Capability, Deviation, named_reasons
from simspec.engines.kit.refinements import met_exactly
from simspec.engines.kit.settings import Setting, SettingGroup, resolve_settings
from simspec.engines.kit.warp import PROCESSOR
from simspec.engines.mjwarp.programs import (
    ANSWERS,
    AUTO,
    ENGINE,
    WarpModules,
    WarpPrograms,
    begin,
    chosen_device,
    import_modules,
    taken_over,
)
from simspec.engines.mujoco.contact import CONTACT_DEVIATIONS as MUJOCO
from simspec.engines.mujoco.engine import MuJoCo
from simspec.engines.mujoco.rewritten import (
    EngineModel,
    RewrittenSimulation,
    has_friction,
    lacks,
    settings,
    support,
)
from simspec.errors import EngineError
from simspec.formats.mjcf.format import MODEL
from simspec.support.declarations import Refinement, Support, Table, exact, never, unsupported_if
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.kinematics import rigid_groups
from simspec.world.types import EngineValue, ReadBack, World

# How far MuJoCo Warp is from the contact law: as MuJoCo, in what singles leave of friction on springs, and where what slides
# hops otherwise in singles. Data, measured at 1 ms where no timestep is said.

_SOFT = (
    "MuJoCo Warp's friction is as soft as its contact, and at most 1e5 times as stiff "
    "(high_impratio), so that boxes on springs creep"
)
_HOPS = (
    "MuJoCo Warp's friction cone is associated, as MuJoCo's: it lifts sliding bodies, which hop, "
    "at other moments in single precision. More of a short slide or push can be without friction"
)


CONTACT_DEVIATIONS: tuple[Deviation, ...] = (
    *(row for row in MUJOCO if not row.until),
    *named_reasons(Path(__file__).with_name("friction_deviations.csv"), {"soft": _SOFT, "hop": _HOPS}),
)
"""The table has what exceeds MuJoCo's rows at 2, 4, 8 and 16 ms: the largest of what specs/contact/friction-laws.yaml shows
there, with its μ of 0.05 to 1 and with 0.3, 0.7, 1.25 and 1.5, and restitution-laws.yaml, with μ of 0.05 to 1."""

# MuJoCo Warp's solver settings: those of MuJoCo's files, as far as Warp has what they say, and the device.

LARGEST_RATIO = 1e5
"""Of friction's hardness to that of contact, in singles."""

_SETTINGS = settings(
    "Warp",
    "Warp solves groups of bodies separately only where bodies sleep.",
    "The constraint solver: newton, which solves MuJoCo's convex problem to single precision in a few "
    "iterations. Warp's cg needs more than MuJoCo's 100 iterations (see docs/engines/mjwarp.md), and Warp has "
    "no pgs.",
)
SETTINGS: Mapping[str, Setting] = {
    **_SETTINGS,
    "device": Setting(
        AUTO,
        "The device that computes. auto: the first graphics processor (CUDA) that Warp finds, else the "
        "processor (cpu). The log names other devices; simspec is not tested on them.",
        (AUTO, PROCESSOR, *(f"cuda:{index}" for index in range(8))),
        group=SettingGroup.ORDER,  # of sums, which a graphics processor takes otherwise
    ),
    "impratio": dataclasses.replace(_SETTINGS["impratio"], maximum=LARGEST_RATIO),
    "high_impratio": dataclasses.replace(
        _SETTINGS["high_impratio"],
        default=LARGEST_RATIO,
        meaning="impratio of worlds with friction in compliant contact, or with torsional or rolling friction: "
        "MuJoCo makes friction as soft as its contact, and moments softer by (μ/c)². At most 1e5: at "
        "MuJoCo's 1e7 single precision yields NaN (see docs/engines/mjwarp.md).",
        maximum=LARGEST_RATIO,
    ),
}

# MuJoCo Warp's model, read as if it were an ``mjModel``: the reader of MuJoCo's model reads Warp's, field by field.
#
# A model of Warp has MuJoCo's fields under MuJoCo's names, of single precision, with one more dimension where several worlds
# may differ. Parts that it does not take over, since it does not compute with them (names, user data, keyframes), are read from
# the ``mjModel`` that it was made of: so a file that differs from the world is noticed there, too.

LAWS = ("timestep", "*solref*", "*solimp*", "o_*")
"""Fields whose numbers differ in more digits than singles have: an error reduction is a quotient by the timestep's
square. A single stands for every number that is rounded to it: these fields are reported as MuJoCo's where that is one of
them."""
LACKED = ("mjDSBL_AUTORESET",)
"""Flags of what Warp does not have, so that it is always as these say: Warp refuses a model that has them."""


class WarpModel(EngineModel):
    """Made with the bits of :data:`LACKED`."""

    def field(self, name: str) -> Any:
        if name == "impratio":  # Warp keeps one over its root
            return float(1.0 / np.square(self._model.impratio_invsqrt.numpy().astype(float))[0])
        if name == "disableflags":
            return int(self._model.disableflags) | (int(self.file.disableflags) & self._given[0])
        given = getattr(self.file, name)
        if name not in type(self._model).__dataclass_fields__:
            return given
        local = getattr(self._model, name)
        if not hasattr(local, "numpy"):
            return local
        found, like = np.asarray(local.numpy()), np.asarray(given)
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
"""Warp's warnings of steps that went on, by its names, in words."""
SEARCH_OF_FILE = "file.flags.disable_nativeccd"
"""In the inventory: the flag that stands in the file, where Warp is given it set."""
MOST_WARNINGS = 10
"""Different warnings that the log has for a model; the others are counted."""
# Worlds for which MuJoCo Warp yields NaN, and which are therefore refused.
#
# Its Newton solver factors its matrix in singles without a floor under the pivots, where MuJoCo has one (tile_cholesky in its
# solver; google-deepmind/mujoco_warp, issue 1415), and the matrix is the worse conditioned the harder friction is
# (``impratio``): most likely that is why. Warp compiles for the processor that it runs on: a result that is NaN on one may be
# finite on another. *Measured* at 1 ms, MuJoCo Warp 4.0.0 on processors of Intel and AMD:
#
# - Under the pyramid a box with friction that is pushed.
# - Under the elliptic cone a free body with a massless first part, and 1.1 kg of parts that are fixed to it: it
#   lands on a box with 3 m/s and is NaN 0.1 s later, with a hinge on it or without; not where the first part weighs 0.5
#   kg, not without friction.
# - Torsional friction without rolling friction (contacts of four rows), of 1 to 100 mm, μ = 0.2 to 1: a ball that lands, at an
#   impratio of 1e4 and more, on AMD; at 1000 all probes of L5 are met. With rolling friction (six rows) they are met at 1e5,
#   too.
# - A box that bounces may be by chance: of 240 pushes of boxes with restitution one is (L5, which says so and is not valid
#   then).

PYRAMID = "MuJoCo Warp's solver returns NaN for pushed boxes with friction under the pyramid, in single precision"
MOST_TORSIONAL_RATIO = 1000.0
"""``impratio`` up to which torsional friction by itself is met."""


def weightless_rub(world: World) -> Refinement | None:
    """Refused where a body without mass has shapes with friction on what moves."""
    groups = rigid_groups(world)
    friction = {name for pair, law in meeting_laws(world).items() if has_friction(law) for name in pair}
    for body in world.bodies:
        weightless = not body.inertial.mass and groups[body.name] != "world"
        if weightless and any(shape.material in friction for shape in solid_shapes(body)):
            return unsupported_if(
                f"MuJoCo Warp's solver returns NaN for massless bodies with friction, such as {body.name!r}. "
                "Give it mass, or give its shapes to the body that carries it"
            )
    return None


def torsional_alone(world: World, ratio: float) -> Refinement | None:
    """Refused where two shapes that may meet have torsional friction and no rolling friction; ``ratio``: impratio."""
    if ratio <= MOST_TORSIONAL_RATIO:
        return None
    for pair, law in sorted(meeting_laws(world).items()):
        if law.torsional_friction and not law.rolling_friction:
            return unsupported_if(
                "MuJoCo Warp's solver returns NaN for torsional without rolling friction at impratio "
                f"{ratio:g}, between {' and '.join(map(repr, pair))}. Add rolling friction, or set "
                f"engines.mjwarp.settings.high_impratio to {MOST_TORSIONAL_RATIO:g}, at which friction on "
                "springs creeps faster"
            )
    return None


SEARCHED = (
    "MuJoCo Warp finds contacts of this pair by a search in single precision, which is inaccurate for large "
    "shapes (see docs/engines/mjwarp.md)"
)
EXACTLY_MET: Mapping[str, tuple[str, ...]] = {
    "capsule": ("plane", "sphere", "capsule", "box"),
    "cylinder": ("plane", "sphere"),
    "ellipsoid": ("plane",),
    "mesh": ("plane",),
}
"""By kind of shape those for which there is a function of the two; planes, spheres and boxes have one for each other."""


_TORSIONAL = MuJoCo.SUPPORT[Feature.TORSIONAL_FRICTION]


def _torsional(world: World) -> Refinement | None:
    settings = resolve_settings(MjWarp, world)
    needed = moment_hardness(world.physics.timestep, meeting_laws(world).values())
    return torsional_alone(world, max(float(settings["impratio"]), min(float(settings["high_impratio"]), needed)))


def _of_kind(kind: str) -> Support:
    met = EXACTLY_MET[kind]
    return exact(
        f"MuJoCo Warp supports contacts of this shape with some kinds only: {', '.join(met)}",
        refine=functools.partial(met_exactly, kind, met, SEARCHED),
    )


class MjWarp(RewrittenSimulation):
    """MuJoCo Warp, the form of MuJoCo's dynamics for graphics processors, in single precision: the same law of contact and the
    same numbers as in :class:`MuJoCo`, solved by code of its own. It computes on a processor, too.
    """

    NAME: ClassVar[str] = "mjwarp"
    TITLE: ClassVar[str] = "MuJoCo Warp"
    DISTRIBUTION: ClassVar[str] = "mujoco-warp"
    SEPARATE_VERSION: ClassVar[str] = "4.0"
    PRECISION: ClassVar[str] = SINGLE
    LACKS: ClassVar[Mapping[Capability, str]] = lacks("MuJoCo Warp")
    SUPPORT: ClassVar[Table] = {
        **support("MuJoCo Warp", PYRAMID),
        Feature.SHAPE_CAPSULE: _of_kind("capsule"),
        Feature.SHAPE_CYLINDER: _of_kind("cylinder"),
        Feature.SHAPE_ELLIPSOID: _of_kind("ellipsoid"),
        Feature.SHAPE_MESH: _of_kind("mesh"),
        Feature.SHAPE_HEIGHTFIELD: never(
            "MuJoCo Warp represents height fields by prisms of their cells, whose contacts a single-precision "
            "search finds inaccurately"
        ),
        Feature.MASSLESS: exact(
            ("MuJoCo Warp supports massless bodies without friction only: its solver returns NaN for others"),
            refine=weightless_rub,
        ),
        Feature.TORSIONAL_FRICTION: dataclasses.replace(
            _TORSIONAL,
            how=(
                "MuJoCo Warp supports it together with rolling friction, or at impratio up to "
                f"{MOST_TORSIONAL_RATIO:g}. {_TORSIONAL.how}"
            ),
            refine=_torsional,
        ),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = SETTINGS
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = CONTACT_DEVIATIONS
    COMPILING: ClassVar[float] = 300.0
    DRY_FRICTION_CREEP: ClassVar[float] = 2e-5  # of 0.22 rad/s after 20 steps its solver misses 8e-6 (measured)

    MADE: ClassVar[tuple[str, ...]] = (*RewrittenSimulation.MADE, "_motion", "_questions")

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        found = super().expected_inventory(world, neutral)
        found[SEARCH_OF_FILE] = found["flags.disable_nativeccd"]
        found["flags.disable_nativeccd"] = True
        return found

    @classmethod
    def prepare(cls) -> None:
        import_modules()

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        self._begun: list[str] = []
        self._modules: WarpModules = begin(self._begun)
        super().load(folder, sidecar)

    def _adapt(self) -> None:
        self._log += self._begun
        self._device = chosen_device(self._modules, self._sidecar.settings)
        if not self._device.is_cpu:
            self._log.append(f"computes on {self._device} ({self._device.name})")
        bits = self._mujoco.mjtDisableBit.__members__
        self._lacked = sum(int(bits[name]) for name in LACKED)
        self._signs: dict[str, int] = {}

    def _take_over(self) -> None:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            self._taken = self._taken_of(self.model)
        different = list(
            dict.fromkeys(str(warning.message) for warning in said)
        )  # one for every shape that it is about
        self._log += different[:MOST_WARNINGS]
        if len(different) > MOST_WARNINGS:
            self._log.append(f"and {len(different) - MOST_WARNINGS} more warnings")
        # one data for motion, one for questions
        given = (self._modules, self._device, self._taken, self.model)
        self._motion, self._questions = WarpPrograms(*given), WarpPrograms(*given)

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

    def _rounded(self, values: np.ndarray) -> np.ndarray:
        demand_singles(self.NAME, values, "a state or an effort")
        return values.astype(np.float32).astype(float)

    def _query(self, program: str) -> Any:
        self._questions.run(program, {"qpos": self.data.qpos, "qvel": self.data.qvel})
        if program == "touch":
            return SimpleNamespace(**self._questions.contacts())
        return SimpleNamespace(**{name: self._questions.take(name) for name in ANSWERS[program]})

    def _advanced(self, applied: np.ndarray, count: int) -> Sequence[np.ndarray]:
        data = self.data
        state = {"qpos": data.qpos, "qvel": data.qvel, "qacc_warmstart": self._warm, "qfrc_applied": applied}
        self._motion.run("step", state, count)
        for name in self._motion.signs:
            self._signs[name] = self._signs.get(name, 0) + 1
        return [self._motion.take(name) for name in ANSWERS["step"]]

    def mass_blocks(self, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
        values = self._query("weigh").M
        return [self._block(values, self._v[block]) for block in blocks]

    def bias_force(self) -> np.ndarray:
        found = self._query("bias")
        force: np.ndarray = (found.qfrc_bias - found.qfrc_gravcomp)[self._v]
        return force

    def energy(self) -> tuple[float, float]:
        """By Warp, which leaves the weight that gravcomp takes away in the potential energy."""
        found = self._query("energy")
        potential, kinetic = found.energy.tolist()
        lifted = self.model.body_gravcomp * self.model.body_mass
        return kinetic, potential + float(lifted @ (found.xipos @ self.model.opt.gravity))

    def _last_contacts(self) -> dict[str, np.ndarray]:
        return self._motion.contacts()

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
