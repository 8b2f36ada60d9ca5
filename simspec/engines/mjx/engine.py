"""MJX: MuJoCo reads the file, MJX takes the model over.

Facts marked *measured* were obtained with MJX 3.17.0 on JAX 0.10.2, in double precision on one processor.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from simspec.engines.kit.capabilities import Capability, Deviation
from simspec.engines.kit.refinements import met_exactly
from simspec.engines.kit.settings import Setting
from simspec.engines.mjx.programs import CONTACTS, MjxModules, MjxPrograms, as_numpy, begin, import_mjx
from simspec.engines.mujoco.contact import CONTACT_DEVIATIONS as MUJOCO
from simspec.engines.mujoco.contact import NO_CUSHION
from simspec.engines.mujoco.engine import MuJoCo
from simspec.engines.mujoco.readback import CONE_NAMES
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
from simspec.support import features
from simspec.support.declarations import Refinement, Table, exact, for_each, never, unsupported_if
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws, shape_pairs, solid_shapes
from simspec.world.kinematics import layout_of
from simspec.world.types import Body, EngineValue, Quaternion, ReadBack, World

# How far MJX is from the contact law: as MuJoCo, and in what its own function for the contacts of two boxes does. Data,
# measured with MJX 3.17.0 at 0.5 to 16 ms, μ of 0.5 and 0.9, and e of 0.01 to 0.7.

_CORNERS = (
    f"{NO_CUSHION}. MJX uses one corner of two faces up to three times where they overlap by less than 1 µm, so that boxes "
    "tilt and hop"
)
_BOUNCES = 0.01

CONTACT_DEVIATIONS: tuple[Deviation, ...] = (
    *(row for row in MUJOCO if not row.until),
    Deviation("stick", 1e-3, _CORNERS, relative=False, restitution=_BOUNCES),
    Deviation("push", 0.14, _CORNERS, restitution=_BOUNCES, timestep=0.0009),
    Deviation("push-oblong", 0.14, _CORNERS, restitution=_BOUNCES, timestep=0.0009),
)

# MJX's solver settings: those of MuJoCo's files, as far as MJX has what they say.

_UNUSED = "A setting of MuJoCo's file: MJX has no such sweeps, and allows 0 only."

_SETTINGS = settings(
    "MJX",
    "MJX solves all bodies together.",
    "The constraint solver: newton, which solves MuJoCo's convex problem to round-off in a few iterations. "
    "MJX's cg ends too early (see docs/engines/mjx.md), and MJX has no pgs.",
)
SETTINGS: Mapping[str, Setting] = {
    **_SETTINGS,
    "tolerance": dataclasses.replace(
        _SETTINGS["tolerance"],
        meaning="The solver ends when the improvement is below this. MuJoCo's default; smaller for bodies that "
        "are light relative to others, as for MuJoCo.",
    ),
    "noslip_iterations": dataclasses.replace(_SETTINGS["noslip_iterations"], meaning=_UNUSED, maximum=0),
    "multiccd": dataclasses.replace(
        _SETTINGS["multiccd"],
        default=False,
        meaning="A setting of MuJoCo's file, without effect: MJX always finds several contact points of faces, "
        "with a function for each pair of kinds of shapes.",
    ),
    "ccd_tolerance": dataclasses.replace(
        _SETTINGS["ccd_tolerance"], meaning="A setting of MuJoCo's file, without effect in MJX.", finer=None
    ),
}

# MJX's model, read as if it were an ``mjModel``: so that the reader of MuJoCo's model reads MJX's, field by field.
#
# An ``mjx.Model`` has MuJoCo's fields under MuJoCo's names, as arrays of JAX or numpy. Parts that MJX does not take over, since
# it does not compute with them (names, user data, options of MuJoCo's own solvers), are read from the ``mjModel`` that it was
# made of: so a file that says something else than the world is noticed there, too.


class MjxModel(EngineModel):
    """A field of MJX's own class, or of its implementation, or else of the file."""

    def field(self, name: str) -> Any:
        model = self._model
        owners = (model, model._impl)
        owner = next(
            (owner for owner in owners if name in type(owner).__dataclass_fields__ and name != "_impl"), self.file
        )
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


MOST_NUMBERS = 1_000_000
"""Of a step's Jacobian: bytes of each possible contact, for every degree of freedom."""
_TOO_MANY = (
    f"MJX evaluates every possible contact in each step with a dense matrix, here of more than {MOST_NUMBERS:,} "
    "entries (see docs/engines/mjx.md)"
)
FACE, FRICTIONAL_ROWS = 4, 3
"""Points of contact of two shapes, neither of which is a sphere, and rows of a point with friction."""
PYRAMIDAL = 0
"""MuJoCo's number of the cone that frictionless contacts are solved with."""
EXACTLY_MET = ("plane", "sphere")
_SOME_PAIRS = "MJX supports contacts of this shape with planes and spheres only"
_NOT_EXACTLY = "MJX has no collision function for this pair, or one that searches on distance functions"
_HOPS = (
    "MJX counts corners of faces that overlap by less than 1 µm more than once: under the pyramid bodies at rest hop"
)
_SUPPORT = support("MJX", _HOPS)


def _friction_everywhere(world: World) -> Refinement | None:
    """Refused where some contacts have friction and others none."""
    smooth = next((pair for pair, law in meeting_laws(world).items() if not has_friction(law)), None)
    if smooth is None or not any(map(has_friction, meeting_laws(world).values())):
        return None
    return unsupported_if(
        f"under the elliptic cone MJX has no frictionless contacts, and {' and '.join(smooth)} have no friction"
    )


def _small_enough(world: World) -> Refinement | None:
    """Refused where the rows of all contacts there can be, times the degrees of freedom, are too many."""
    degrees = layout_of(world).nv
    most = MOST_NUMBERS // max(degrees, 1)
    kinds = {shape.name: shape.kind for body in world.bodies for shape in solid_shapes(body)}
    rows = 0
    for pair, law in meeting_laws(world).items():
        for name, other in shape_pairs(world, [pair]):
            points = 1 if "sphere" in (kinds[name], kinds[other]) else FACE
            rows += points * (FRICTIONAL_ROWS if has_friction(law) else 1)
            if rows > most:
                return unsupported_if(_TOO_MANY)
    return None


class Mjx(RewrittenSimulation):
    """MJX, the JAX form of MuJoCo's dynamics: the same law of contact and the same numbers as in :class:`MuJoCo`, solved by
    code of its own, with functions of its own for the contacts of every two kinds of shapes.

    Every contact there can be is computed in every step, whether anything touches or not, by dense matrices: a step's cost
    is that of all pairs of shapes, and of all degrees of freedom cubed.

    Of two faces that overlap by less than 1 µm it takes some corners more than once, so that what rests on them hops. Without
    friction, and with restitution, a cube rests 0.98 µm deep at 1 ms: level L5 fails there (steady, push), and is not declared.
    """

    NAME: ClassVar[str] = "mjx"
    TITLE: ClassVar[str] = "MJX"
    DISTRIBUTION: ClassVar[str] = "mujoco-mjx"
    SEPARATE_VERSION: ClassVar[str] = "3.17"
    LACKS: ClassVar[Mapping[Capability, str]] = lacks("MJX")
    SUPPORT: ClassVar[Table] = {
        **_SUPPORT,
        **{
            feature: dataclasses.replace(MuJoCo.SUPPORT[feature], refine=_small_enough)
            for feature in features.HARDNESSES
            if feature is not Feature.HARDNESS_PAIRS
        },
        Feature.SHAPE_CYLINDER: exact(
            _SOME_PAIRS,
            refine=functools.partial(met_exactly, "cylinder", EXACTLY_MET, _NOT_EXACTLY),
        ),
        Feature.SHAPE_ELLIPSOID: exact(
            _SOME_PAIRS, refine=functools.partial(met_exactly, "ellipsoid", EXACTLY_MET, _NOT_EXACTLY)
        ),
        Feature.SHAPE_HEIGHTFIELD: never(
            "MJX represents height fields by prisms of their cells, and collides them with spheres, capsules, "
            "boxes and hulls only"
        ),
        **for_each(
            never("MJX detects a box with a margin above a floor too late (see docs/engines/mjx.md)"),
            *(Feature.SHAPE_MARGIN, Feature.MARGIN_PAIRS),
        ),
        Feature.CONE_ELLIPTIC: exact(
            "simspec sets a pyramid of one edge where nothing has friction", refine=_friction_everywhere
        ),
        Feature.IMPACT_FRICTION: dataclasses.replace(
            _SUPPORT[Feature.IMPACT_FRICTION], short="80 to 90 % of the friction in an impact is missing, at 1 ms"
        ),
        Feature.SURFACE_VELOCITY: never("MJX has no surface velocities (surfacevel)"),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = SETTINGS
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = CONTACT_DEVIATIONS
    COMPILING: ClassVar[float] = 100.0
    DRY_FRICTION_CREEP: ClassVar[float] = MuJoCo.DRY_FRICTION_CREEP

    MADE: ClassVar[tuple[str, ...]] = (*RewrittenSimulation.MADE, "_programs")

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        found = super().expected_inventory(world, neutral)
        found[CONE_OF_FILE] = found["opt.cone"]
        if not any(map(has_friction, meeting_laws(world).values())):
            found["opt.cone"] = PYRAMIDAL
        return found | turns(world.bodies)

    @classmethod
    def prepare(cls) -> None:
        import_mjx()

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        self._modules: MjxModules = begin()
        super().load(folder, sidecar)

    def _adapt(self) -> None:
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
            self._programs = MjxPrograms(self._modules, self._taken)
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

    def _query(self, program: str) -> Any:
        return as_numpy(self._programs.run(program, self.data.qpos, self.data.qvel))

    def _advanced(self, applied: np.ndarray, count: int) -> Sequence[np.ndarray]:
        given = (self.data.qpos, self.data.qvel, self._warm, applied, np.int64(count))
        self._last = self._programs.run("step", *given)
        return [np.array(self._last[name]) for name in ("q", "v", "warm")]

    def mass_blocks(self, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
        full = self._query("weigh").mass
        return [full[np.ix_(self._v[block], self._v[block])] for block in blocks]

    def bias_force(self) -> np.ndarray:
        found: np.ndarray = self._query("bias").bias
        return found[self._v]

    def energy(self) -> tuple[float, float]:
        """Kinetic by MJX's mass matrix. MJX computes no potential energy: that is MuJoCo's, of the model that it took over."""
        mujoco, file, speed = self._mujoco, self._file, self.data.qvel
        file.qpos[:] = self.data.qpos
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_energyPos):
            compute(self.model, file)
        lifted = self.model.body_gravcomp * self.model.body_mass
        potential = float(file.energy[0] + lifted @ (file.xipos @ self.model.opt.gravity))
        return 0.5 * float(speed @ self._query("weigh").mass @ speed), potential

    def _last_contacts(self) -> dict[str, np.ndarray]:
        """Of all contacts there can be, which MJX computes in every step, those that are within their margin."""
        every = self._programs.blank._impl.contact
        found = vars(as_numpy({name: self._last[name] for name in (*CONTACTS, "force")}))
        found |= {name: np.asarray(getattr(every, name)) for name in ("dim", "efc_address")}
        force, there = found.pop("force"), np.flatnonzero(found["dist"] <= found["includemargin"])
        return {name: values[there] for name, values in found.items()} | {"force": force}

    def disable_contact(self) -> None:
        # without a contact no cone is of effect, and MJX has no form of the elliptic one where limits or friction are rows
        self.model.opt.cone = self._mujoco.mjtCone.mjCONE_PYRAMIDAL
        super().disable_contact()
