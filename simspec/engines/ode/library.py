"""ODE and the part in C beside it (``shim/``), which is compiled on first use, by ctypes.

Facts marked *measured* in this package: ODE 0.16.2 in double precision.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit import hulls
from simspec.engines.kit.compiled import Compiled
from simspec.engines.kit.needs import Needs
from simspec.errors import EngineError

NAME = "ode"
PACKAGE = "ode >= 0.16"
FOLDER = Path(__file__).parent / "shim"
SOURCES = ("world.c", "motion.c", "contact.c", "passes.c", "step.c")
HEADERS = ("simspec_ode.h",)
PART = Compiled(
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
    "sim_told_law": (None, (Pointer, Integer, Integer, Numbers)),
    "sim_ignore": (None, (Pointer, Integer, Integer)),
    "sim_exclude": (None, (Pointer, Keys, Integer)),
    "sim_size": (Integer, (Pointer, Integer)),
    "sim_world": (Pointer, (Pointer,)),
    "sim_space": (Pointer, (Pointer,)),
    "sim_body_of": (Pointer, (Pointer, Integer)),
    "sim_geom": (Pointer, (Pointer, Integer)),
    "sim_joint": (Pointer, (Pointer, Integer, Integer)),
    "sim_carrier": (Integer, (Pointer, Integer)),
    "sim_told_body": (None, (Pointer, Integer, Numbers)),
    "sim_text": (Text, (Pointer,)),
    "sim_counts": (None, (Pointer, Counts)),
    "sim_step": (Integer, (Pointer, Integer, Numbers)),
    "sim_set": (None, (Pointer, Numbers, Numbers)),
    "sim_get": (None, (Pointer, Numbers, Numbers)),
    "sim_frames": (None, (Pointer, Numbers, Numbers)),
    "sim_accelerate": (Integer, (Pointer, Numbers, Numbers)),
    "sim_energy": (None, (Pointer, Numbers)),
    "sim_apart": (Integer, (Pointer, Integer, Integer)),
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
"""What is asked of ODE itself."""


class Library:
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
def library() -> Library:
    """ODE, started. Raises CompileError, an EngineError, where it, or a compiler, is not there, and EngineError
    where it has single precision."""
    found = Library(PART.load())
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
