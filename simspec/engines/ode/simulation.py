"""A world in ODE, made from ``world.json`` and its sidecar through the part in C (``shim/``): stepping, efforts, contact."""

from __future__ import annotations

import ctypes
import functools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.dialects.kit.world import LawSidecar
from simspec.engines.kit import hulls
from simspec.engines.kit.arrays import empty_contacts
from simspec.engines.kit.building import PlacedBody, PlacedShape, Walk, refuse
from simspec.engines.kit.compiled import NativeBinary, Needs
from simspec.engines.kit.hulls import DOUBTED, check_solid
from simspec.engines.kit.world_simulation import (
    WorldSimulation,
    contact_table,
    growing_pairs,
    only_common,
    positive_definite,
    unit_responses,
)
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, BallJoint, FixedJoint, FreeJoint, Joint, initial_coordinates
from simspec.world.rotations import unit

# ODE and the part in C next to it, which is compiled on first use, by ctypes. The motion of bodies is defined in
# ``shim/motion.c`` and ``shim/step.c``: before every step they are laid on their joints, with the wrenches that make ODE's step
# the step of the joints' coordinates. Facts marked *measured* in this package: ODE 0.16.2 in double precision.

NAME = "ode"
PACKAGE = "ode >= 0.16"
FOLDER = Path(__file__).parent / "shim"
SOURCES = ("world.c", "motion.c", "contact.c", "passes.c", "step.c")
HEADERS = ("simspec_ode.h",)
PART = NativeBinary(
    NAME,
    "ode-shim",
    (*(FOLDER / name for name in SOURCES), *hulls.SOURCES),
    headers=(*(FOLDER / name for name in HEADERS), *hulls.HEADERS),
    packages=(PACKAGE,),
    flags=hulls.FLAGS,
    links=("-lm",),
)
NEEDS = Needs(
    PACKAGE,
    (PART,),
    (("libode-dev", "the engine"), ("gcc", "compiles its part in C"), ("pkg-config", "finds it")),
)
SINGLE = "ODE_single_precision"

Pointer, Number, Integer, Text = ctypes.c_void_p, ctypes.c_double, ctypes.c_int, ctypes.c_char_p
Numbers, Integers, Keys = (ctypes.POINTER(kind) for kind in (ctypes.c_double, ctypes.c_int, ctypes.c_longlong))
Counts = ctypes.POINTER(ctypes.c_long)

SHIM: Mapping[str, tuple[Any, tuple[Any, ...]]] = {
    "sim_start": (Integer, ()),
    "sim_new": (Pointer, (Numbers, Number, Integer, Integer, Integer, Integer, Integer, Integer)),
    "sim_free": (None, (Pointer,)),
    "sim_body": (
        Integer,
        (Pointer, Integer, Integer, Numbers, Numbers, Number, Numbers, Numbers, Numbers, Integer),
    ),
    "sim_shape": (Integer, (Pointer, Integer, Integer, Numbers, Integer, Numbers, Integer, Integer)),
    "sim_law": (None, (Pointer, Integer, Integer, Numbers)),
    "sim_law_values": (None, (Pointer, Integer, Integer, Numbers)),
    "sim_ignore": (None, (Pointer, Integer, Integer)),
    "sim_exclude": (None, (Pointer, Keys, Integer)),
    "sim_size": (Integer, (Pointer, Integer)),
    "sim_world": (Pointer, (Pointer,)),
    "sim_space": (Pointer, (Pointer,)),
    "sim_body_of": (Pointer, (Pointer, Integer)),
    "sim_geom": (Pointer, (Pointer, Integer)),
    "sim_joint": (Pointer, (Pointer, Integer, Integer)),
    "sim_carrier": (Integer, (Pointer, Integer)),
    "sim_body_values": (None, (Pointer, Integer, Numbers)),
    "sim_text": (Text, (Pointer,)),
    "sim_counts": (None, (Pointer, Counts)),
    "sim_step": (Integer, (Pointer, Integer, Numbers)),
    "sim_set": (None, (Pointer, Numbers, Numbers)),
    "sim_get": (None, (Pointer, Numbers, Numbers)),
    "sim_frames": (None, (Pointer, Numbers, Numbers)),
    "sim_accelerate": (Integer, (Pointer, Numbers, Numbers)),
    "sim_energy": (None, (Pointer, Numbers)),
    "sim_excluded": (Integer, (Pointer, Integer, Integer)),
    "sim_touching": (Integer, (Pointer, Integers, Integer)),
    "sim_points": (None, (Pointer, Integers, Numbers)),
    "sim_contact": (None, (Pointer, Integer)),
    "sim_no_dry_friction": (None, (Pointer, Integer)),
    "sim_timestep": (Number, (Pointer,)),
    "sim_set_timestep": (None, (Pointer, Number)),
    "sim_cone": (Integer, (Pointer,)),
    "sim_quick": (Integer, (Pointer,)),
    "sim_native": (Integer, (Pointer,)),
}
"""The functions of the part in C: result and arguments."""


class Mass(ctypes.Structure):
    """ODE's dMass."""

    _fields_ = (("mass", Number), ("centre", Number * 4), ("inertia", Number * 12))


Filled = (Pointer, Numbers)
ODE: Mapping[str, tuple[Any, tuple[Any, ...]]] = {
    "dGetConfiguration": (Text, ()),
    "dWorldGetGravity": (None, Filled),
    "dWorldGetERP": (Number, (Pointer,)),
    "dWorldGetCFM": (Number, (Pointer,)),
    "dWorldGetAutoDisableFlag": (Integer, (Pointer,)),
    "dWorldGetQuickStepNumIterations": (Integer, (Pointer,)),
    "dWorldGetQuickStepW": (Number, (Pointer,)),
    "dWorldGetContactMaxCorrectingVel": (Number, (Pointer,)),
    "dWorldGetContactSurfaceLayer": (Number, (Pointer,)),
    "dWorldGetLinearDamping": (Number, (Pointer,)),
    "dWorldGetAngularDamping": (Number, (Pointer,)),
    "dWorldGetMaxAngularSpeed": (Number, (Pointer,)),
    "dWorldCreate": (Pointer, ()),
    "dWorldDestroy": (None, (Pointer,)),
    "dBodyGetMass": (None, (Pointer, ctypes.POINTER(Mass))),
    "dBodyGetPosition": (Numbers, (Pointer,)),
    "dBodyGetQuaternion": (Numbers, (Pointer,)),
    "dBodyGetLinearVel": (Numbers, (Pointer,)),
    "dBodyGetAngularVel": (Numbers, (Pointer,)),
    "dBodyGetGyroscopicMode": (Integer, (Pointer,)),
    "dBodyGetFiniteRotationMode": (Integer, (Pointer,)),
    "dBodyGetGravityMode": (Integer, (Pointer,)),
    "dBodyIsEnabled": (Integer, (Pointer,)),
    "dBodyIsKinematic": (Integer, (Pointer,)),
    "dBodyGetAutoDisableFlag": (Integer, (Pointer,)),
    "dBodyGetLinearDamping": (Number, (Pointer,)),
    "dBodyGetAngularDamping": (Number, (Pointer,)),
    "dBodyGetMaxAngularSpeed": (Number, (Pointer,)),
    "dBodyGetNumJoints": (Integer, (Pointer,)),
    "dJointGetType": (Integer, (Pointer,)),
    "dJointGetBody": (Pointer, (Pointer, Integer)),
    "dJointIsEnabled": (Integer, (Pointer,)),
    "dJointGetHingeAnchor": (None, Filled),
    "dJointGetHingeAxis": (None, Filled),
    "dJointGetHingeAngle": (Number, (Pointer,)),
    "dJointGetSliderAxis": (None, Filled),
    "dJointGetSliderPosition": (Number, (Pointer,)),
    "dJointGetBallAnchor": (None, Filled),
    "dJointGetAMotorAxis": (None, (Pointer, Integer, Numbers)),
    "dJointGetLMotorAxis": (None, (Pointer, Integer, Numbers)),
    "dJointGetAMotorParam": (Number, (Pointer, Integer)),
    "dJointGetLMotorParam": (Number, (Pointer, Integer)),
    "dJointGetHingeParam": (Number, (Pointer, Integer)),
    "dJointGetSliderParam": (Number, (Pointer, Integer)),
    "dJointGetBallParam": (Number, (Pointer, Integer)),
    "dSpaceGetNumGeoms": (Integer, (Pointer,)),
    "dGeomGetClass": (Integer, (Pointer,)),
    "dGeomGetBody": (Pointer, (Pointer,)),
    "dGeomGetPosition": (Numbers, (Pointer,)),
    "dGeomGetQuaternion": (None, Filled),
    "dGeomGetOffsetPosition": (Numbers, (Pointer,)),
    "dGeomGetOffsetQuaternion": (None, Filled),
    "dGeomIsEnabled": (Integer, (Pointer,)),
    "dGeomGetCategoryBits": (ctypes.c_ulong, (Pointer,)),
    "dGeomGetCollideBits": (ctypes.c_ulong, (Pointer,)),
    "dGeomSphereGetRadius": (Number, (Pointer,)),
    "dGeomBoxGetLengths": (None, Filled),
    "dGeomCylinderGetParams": (None, (Pointer, Numbers, Numbers)),
    "dGeomCapsuleGetParams": (None, (Pointer, Numbers, Numbers)),
    "dGeomPlaneGetParams": (None, Filled),
}
"""The queries of ODE itself."""


class OdeLibrary:
    """ODE's functions and those of the part in C, as attributes."""

    def __init__(self, shim: ctypes.CDLL):
        # the part in C is linked with ODE, whose functions are found through it
        for name, (result, arguments) in {**SHIM, **ODE, **hulls.FUNCTIONS}.items():
            function = getattr(shim, name)
            function.restype, function.argtypes = result, arguments
            setattr(self, name, function)

    def __getattr__(self, name: str) -> Any:  # for mypy: attributes are made above
        raise AttributeError(name)


@functools.cache
def library() -> OdeLibrary:
    """ODE, started. Raises CompileError, an EngineError, where it, or a compiler, is not there, and EngineError
    where it has single precision."""
    found = OdeLibrary(PART.load())
    if SINGLE in found.dGetConfiguration().decode():
        raise EngineError(NAME, "has single precision here, and simspec needs one that was built with double precision")
    found.sim_start()
    return found


def numbers(values: Sequence[float] | NDArray[np.float64]) -> Any:
    """Numbers as C takes them."""
    return (ctypes.c_double * max(1, len(values)))(*values)


def pointer(array: NDArray[np.float64]) -> Any:
    """A contiguous array of doubles as C takes it; it has to be kept."""
    return array.ctypes.data_as(Numbers)


ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`)."""
KINDS = ("fixed", "hinge", "slide", "ball", "free")
"""As the part in C numbers them."""
SHAPES = ("sphere", "box", "cylinder", "capsule", "plane", "mesh")
"""The same of shapes."""
CONES = ("elliptic", "pyramid-circumscribed", "pyramid-inscribed")
"""The same of friction cones."""
SOLVERS = ("step", "quick-step")
"""ODE's, as the setting ``solver`` names them: dWorldStep, dWorldQuickStep."""
SIZES = 3
"""Numbers that a shape of the part in C has for its size, at most."""
Settings = Mapping[str, Any]


class OdeBuild:
    """``sim``: the world of the part in C, with the bodies and shapes of ``walk``, in their order."""

    def __init__(self, library: OdeLibrary, walk: Walk, sidecar: LawSidecar):
        refuse(walk, NAME, cones=CONES, shapes=SHAPES, servos=False, moving_planes=False)
        document, settings = walk.document, sidecar.settings
        self.library, self.walk = library, walk
        self.materials = sorted({solid.shape.material for solid in walk.shapes})
        self.groups = sorted({body.group for body in document.bodies})
        if settings["solver"] not in SOLVERS:
            raise EngineError(NAME, f"has no solver {settings['solver']!r}")
        self.sim = library.sim_new(
            numbers(document.gravity),
            document.timestep,
            CONES.index(document.friction_cone),
            SOLVERS.index(str(settings["solver"])),
            int(settings["iterations"]),
            int(settings.get("native_motion", False)),
            len(self.materials),
            len(self.groups),
        )
        try:
            for placed in walk.bodies:
                self._body(placed)
            for solid in walk.shapes:
                self._shape(solid)
            self._laws(sidecar)
            for name, other in document.excluded.groups:
                library.sim_ignore(self.sim, self.groups.index(name), self.groups.index(other))
            keys = walk.excluded_keys().tolist()
            library.sim_exclude(self.sim, (ctypes.c_longlong * max(1, len(keys)))(*keys), len(keys))
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        sim, self.sim = self.sim, None
        if sim is not None:
            self.library.sim_free(sim)

    def _body(self, placed: PlacedBody) -> None:
        body, joint = placed.body, placed.body.joint
        if placed.moves and not body.mass and any(body.inertia):
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no mass")
        if placed.moves and not body.mass and not isinstance(joint, FixedJoint):
            raise EngineError(NAME, f"does not support {body.name!r}, which moves and has no mass")
        if (
            placed.moves and body.mass and not positive_definite(body.inertia)
        ):  # ODE would take the identity in its place
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no inverse")
        origin = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        if not isinstance(joint, FreeJoint):
            origin = (*joint.origin.position, *joint.origin.quaternion)
        limits = joint.position_limits if isinstance(joint, AxisJoint) else None
        made = self.library.sim_body(
            self.sim,
            KINDS.index(joint.kind),
            placed.parent,
            numbers(origin),
            numbers(joint.axis if isinstance(joint, AxisJoint) else (0.0, 0.0, 0.0)),
            body.mass,
            numbers(body.centre_of_mass),
            numbers(body.inertia),
            numbers((*_losses(joint), *(limits or (-math.inf, math.inf)))),
            limits is not None,
        )
        if made < 0:
            raise EngineError(NAME, f"has no memory for {body.name!r}")

    def _shape(self, solid: PlacedShape) -> None:
        shape, owner = solid.shape, solid.owner
        if shape.kind == "mesh":
            check_solid(NAME, shape.name, shape.size)
        size = (*shape.size, *[0.0] * SIZES)[: max(SIZES, len(shape.size))]
        made = self.library.sim_shape(
            self.sim,
            owner.row,
            SHAPES.index(shape.kind),
            numbers(size),
            len(shape.size) // 3,
            numbers((*shape.pose.position, *shape.pose.quaternion)),
            self.materials.index(shape.material),
            self.groups.index(owner.body.group),
        )
        if made < 0:
            raise EngineError(NAME, f"does not support the {shape.kind} {shape.name!r}")

    def _laws(self, sidecar: LawSidecar) -> None:
        for law in sidecar.laws:
            if lacking := only_common(law):
                raise EngineError(NAME, f"does not support {lacking} of {law.first} and {law.second}")
            first, second = (self.materials.index(name) for name in (law.first, law.second))
            friction = (law.friction, law.restitution, law.restitution_threshold)
            moments = (law.rolling_friction, law.torsional_friction)
            row = (*friction, *moments, ERROR_REDUCTION, float(sidecar.settings["softness"]))
            self.library.sim_law(self.sim, first, second, numbers(row))


def _losses(joint: Joint) -> tuple[float, ...]:
    """Damping, stiffness, rest, dry friction, armature."""
    if isinstance(joint, AxisJoint):
        return joint.damping, joint.spring_stiffness, joint.spring_rest, joint.dry_friction, joint.armature
    if isinstance(joint, BallJoint):
        return joint.damping, joint.spring_stiffness, 0.0, 0.0, 0.0
    return (0.0,) * 5


class OdeSimulation(WorldSimulation[LawSidecar]):
    """A loaded world. Coordinates are those of the part in C, and of ``world/kinematics.py``."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        super().__init__(NAME, LawSidecar, folder, sidecar)
        self.library = library()
        try:
            self.built = OdeBuild(self.library, Walk.of(self.document), self.typed)
        except (KeyError, ValueError) as error:
            raise EngineError(NAME, f"the sidecar's settings lack, or have a wrong, {error}") from error
        self.sim = self.built.sim
        self._poses, self._velocities = np.zeros((len(self.names), 12)), np.zeros((len(self.names), 6))
        self.set_state(*map(np.array, initial_coordinates(self.document)))

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v)."""
        q, v = self.normalised(q), np.array(v, dtype=float)
        self.library.sim_set(self.sim, pointer(q), pointer(v))

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v)."""
        q, v = np.empty(self.nq), np.empty(self.nv)
        self.library.sim_get(self.sim, pointer(q), pointer(v))
        return q, v

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them."""
        self.library.sim_frames(self.sim, pointer(self._poses), pointer(self._velocities))
        poses = np.empty((len(self.names), 7))
        poses[:, :3], poses[:, 3:] = self._poses[:, :3], quaternions(self._poses[:, 3:].reshape(-1, 3, 3))
        return poses, self._velocities.copy()

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the damping and springs of the joints."""
        given = None if effort is None else pointer(np.ascontiguousarray(effort, dtype=float))
        if self.library.sim_step(self.sim, count, given):
            raise EngineError(NAME, f"a step failed: {self.library.sim_text(self.sim).decode(errors='replace')}")

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J), springs included."""
        found = np.empty(2)
        self.library.sim_energy(self.sim, pointer(found))
        return float(found[0]), float(found[1])

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The mass matrix as parts (places, M), one for each tree: the inverse of what unit efforts give for accelerations, of
        one joint of all trees at once, which do not act on each other."""
        trees, parts = self.tree_places(), []
        for tree, inverse in zip(trees, unit_responses(trees, self.nv, self.acceleration), strict=True):
            mass = np.linalg.inv(inverse)
            parts.append((tree, 0.5 * (mass + mass.T)))
        return parts

    def acceleration(self, effort: np.ndarray | None) -> np.ndarray:
        """v̇ (nv,) by ODE's own step: from rest under an effort alone, or (None) under gravity and the present velocities."""
        found = np.empty(self.nv)
        given = None if effort is None else pointer(effort)
        if self.library.sim_accelerate(self.sim, given, pointer(found)):
            raise EngineError(NAME, f"a step failed: {self.library.sim_text(self.sim).decode(errors='replace')}")
        return found

    def bias(self) -> np.ndarray:
        """Coriolis, centrifugal and gravity forces (nv,): −M v̇ of a body left to itself."""
        free, bias = self.acceleration(None), np.zeros(self.nv)
        for places, mass in self.mass_parts():
            bias[places] = -mass @ free[places]
        return bias

    # --- contact ----------------------------------------------------------------------------------------------

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used."""
        count = self.library.sim_size(self.sim, 3)
        if not count:
            return empty_contacts()
        units, table = np.empty((count, 2), dtype=np.int32), np.empty((count, 8))
        self.library.sim_points(self.sim, units.ctypes.data_as(Integers), pointer(table))
        return contact_table(units.astype(np.int64), table, [row for row, _ in self.units()])

    def touching(self) -> np.ndarray:
        """Pairs (n, 2) of the numbers of shapes that touch at the present state."""
        return growing_pairs(lambda pairs, room: int(self.library.sim_touching(self.sim, pairs, room)))

    def set_timestep(self, timestep: float) -> None:
        """Step by another timestep."""
        self.library.sim_set_timestep(self.sim, timestep)

    def disable_contact(self) -> None:
        """Nothing touches anything."""
        self.library.sim_contact(self.sim, 0)

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """Take the dry friction of the joints at the places ``v`` (n,) away."""
        for row in self.rows_at(v):
            self.library.sim_no_dry_friction(self.sim, row)

    def messages(self) -> list[str]:
        """ODE's messages, and steps that had to be solved again."""
        counts = (ctypes.c_long * 6)()
        self.library.sim_counts(self.sim, counts)
        retries, unsolved, said, doubtful, unsettled, stepped = counts
        lines = []
        if said:
            lines.append(f"{self.library.sim_text(self.sim).decode(errors='replace').strip()} ({said} messages)")
        if retries:
            lines.append(
                f"{retries} solutions repeated, with contacts separated slightly or softer, since ODE could not solve a step"
            )
        if unsolved:
            lines.append(
                f"{unsolved} steps that ODE did not solve, with contacts as soft as they may be: forces are missing there"
            )
        if unsettled:
            lines.append(
                f"of {stepped} steps with friction in contact {unsettled} ended before its bounds fitted the normal forces"
            )
        if doubtful:
            lines.append(DOUBTED.format(doubtful))
        return lines

    def close(self) -> None:
        self.built.close()


def quaternions(turns: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) with w ≥ 0 of rotation matrices (n, 3, 3), each by its largest component."""
    xx, yy, zz = turns[:, 0, 0], turns[:, 1, 1], turns[:, 2, 2]
    squares = np.stack([xx + yy + zz, xx - yy - zz, yy - xx - zz, zz - xx - yy], axis=1)
    largest = np.argmax(squares, axis=1)
    xy, yx, yz, zy = turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 2], turns[:, 2, 1]
    zx, xz = turns[:, 2, 0], turns[:, 0, 2]
    a, b, c = zy - yz, xz - zx, yx - xy
    d, e, f = yx + xy, xz + zx, zy + yz
    squared = 1.0 + squares
    rows = np.stack(
        [
            np.stack([squared[:, 0], a, b, c], axis=1),
            np.stack([a, squared[:, 1], d, e], axis=1),
            np.stack([b, d, squared[:, 2], f], axis=1),
            np.stack([c, e, f, squared[:, 3]], axis=1),
        ],
        axis=1,
    )
    return unit(rows[np.arange(len(turns)), largest])
