"""A world as ODE holds it: made from the document of ``world.json`` and its sidecar through the part in C (``shim/``).

The motion of bodies is defined in ``shim/motion.c`` and ``shim/step.c``: before every step they are laid on their joints,
with the wrenches that make ODE's step the step of the joints' coordinates.
"""

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
from simspec.engines.kit.building import PlacedBody, PlacedShape, Walk, refuse
from simspec.engines.kit.compiled import NativeBinary, Needs
from simspec.engines.kit.hulls import check_solid
from simspec.engines.kit.world_simulation import only_common, positive_definite
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, BallJoint, FixedJoint, FreeJoint, Joint

# ODE and the part in C next to it (``shim/``), which is compiled on first use, by ctypes.
#
# Facts marked *measured* in this package: ODE 0.16.2 in double precision.

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
