"""A world as SDF for gz-physics, and the further data for the part in C++.

Links, joints and shapes are called by numbers in the SDF text, since SDF reserves names and has each once in a model. Shapes
stand in it once for each layer of the contact plan, with the numbers of their material there.
"""

from __future__ import annotations

import ctypes
import dataclasses
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit import hulls
from simspec.engines.kit.building import Walk, refuse
from simspec.engines.kit.compiled import NativeBinary, Needs
from simspec.engines.kit.hulls import check_solid
from simspec.engines.kit.world_simulation import tensor_of
from simspec.errors import EngineError
from simspec.formats.sdf import tree as sdf
from simspec.formats.sdf.format import WORLD as SDF_WORLD
from simspec.formats.sdf.format import Sdf
from simspec.formats.world import AxisJoint, BallJoint, FreeJoint, JsonBody, JsonShape, JsonWorld
from simspec.world.shapes import SHAPES as WORLD_SHAPES
from simspec.world.types import Inertial, Pose

# The part in C++ (``host/``) that hosts gz-physics is compiled on first use, and called by ctypes.

NAME = "gazebo"
PACKAGE = "ignition-physics5"
FOLDER = Path(__file__).parent / "host"
HEADERS = ("simspec_gazebo.h", "load.cc", "motion.cc", "contact.cc", "friction.cc")
PART = NativeBinary(
    NAME,
    "gazebo-host",
    (FOLDER / "host.cc",),
    language="C++",
    headers=tuple(FOLDER / name for name in HEADERS),
    packages=(PACKAGE, "ignition-physics5-sdf", "ignition-plugin1-loader", "sdformat12", "dart"),
    flags=("-O1", "-ffp-contract=off"),
    links=("-std=c++17",),  # the last word on it: DART's package says c++11
)
HULLS = NativeBinary(
    NAME,
    "gazebo-hulls",
    hulls.SOURCES,
    headers=hulls.HEADERS,
    packages=("ode >= 0.16",),
    flags=hulls.FLAGS,
    links=("-lm",),
)
"""The class of hulls for the collision library of DART's detector, whose shared library is the one that DART has."""
NEEDS = Needs(
    PACKAGE,
    (PART, HULLS),
    (
        ("libignition-physics-dev", "Gazebo's physics library"),
        ("libignition-physics5-dartsim-plugin5", "its engine dartsim"),
        ("libsdformat-dev", "reads SDF"),
        ("libdart-dev", "the library of dartsim"),
        ("libode-dev", "the library of its collision detector"),
        ("g++", "compiles its part in C++"),
        ("gcc", "compiles its part in C"),
        ("pkg-config", "finds them"),
    ),
)

Pointer, Number, Integer, Text = ctypes.c_void_p, ctypes.c_double, ctypes.c_int, ctypes.c_char_p
Numbers, Integers, Keys = (ctypes.POINTER(kind) for kind in (ctypes.c_double, ctypes.c_int, ctypes.c_longlong))
Texts = ctypes.POINTER(ctypes.c_char_p)

HOST: Mapping[str, tuple[Any, tuple[Any, ...]]] = {
    "gz_said": (Text, ()),
    "gz_load": (Pointer, (Text, Number, Text, Text)),
    "gz_log": (Text, (Pointer,)),
    "gz_free": (None, (Pointer,)),
    "gz_bodies": (Integer, (Pointer, Integer, Texts, Integers, Numbers)),
    "gz_inertia": (None, (Pointer, Integer, Numbers)),
    "gz_units": (Integer, (Pointer, Integer, Texts, Integers, Integer, Text, Integer, Keys, Integer)),
    "gz_space": (Pointer, (Pointer,)),
    "gz_object": (Pointer, (Pointer, Integer)),
    "gz_restitution": (None, (Pointer, Integer, Number)),
    "gz_set": (None, (Pointer, Numbers, Numbers)),
    "gz_get": (None, (Pointer, Numbers, Numbers)),
    "gz_frames": (None, (Pointer, Numbers, Numbers)),
    "gz_step": (Integer, (Pointer, Integer, Numbers)),
    "gz_tree_count": (Integer, (Pointer,)),
    "gz_tree_size": (Integer, (Pointer, Integer)),
    "gz_tree": (Integer, (Pointer, Integer, Integers)),
    "gz_mass": (None, (Pointer, Integer, Numbers)),
    "gz_bias": (None, (Pointer, Numbers)),
    "gz_energy": (None, (Pointer, Numbers)),
    "gz_no_dry_friction": (None, (Pointer, Integer)),
    "gz_excluded": (None, (Pointer, ctypes.POINTER(ctypes.c_ubyte))),
    "gz_no_contact": (None, (Pointer,)),
    "gz_contact_count": (Integer, (Pointer,)),
    "gz_contacts": (None, (Pointer, Integers, Numbers)),
    "gz_touching": (Integer, (Pointer, Integers, Integer)),
    "gz_body_numbers": (Integer, ()),
    "gz_body": (None, (Pointer, Integer, Numbers)),
    "gz_joint_efforts": (None, (Pointer, Integer, Numbers)),
    "gz_shape_type": (Text, (Pointer, Integer)),
    "gz_unit_numbers": (Integer, ()),
    "gz_unit": (None, (Pointer, Integer, Numbers)),
    "gz_world_numbers": (Integer, ()),
    "gz_world": (None, (Pointer, Numbers)),
    "gz_detector": (Text, (Pointer,)),
    "gz_solver": (Text, (Pointer,)),
    "gz_counts": (None, (Pointer, Integers)),
    "gz_skeleton": (None, (Pointer, Integer, Numbers)),
}
"""The functions of the part in C++: result and arguments."""


class GazeboLibrary:
    """The functions of the part in C++, as attributes."""

    def __init__(self, host: ctypes.CDLL):
        for name, (result, arguments) in HOST.items():
            function = getattr(host, name)
            function.restype, function.argtypes = result, arguments
            setattr(self, name, function)

    def __getattr__(self, name: str) -> Any:  # for mypy: attributes are made above
        raise AttributeError(name)

    def said(self) -> str:
        """Why the last call failed."""
        text: bytes = self.gz_said()
        return text.decode(errors="replace")


@functools.cache
def library() -> GazeboLibrary:
    """gz-physics. Raises CompileError, an EngineError, where it, or a compiler, is not there."""
    return GazeboLibrary(PART.load())


@functools.cache
def hull_library() -> Any:
    """The part in C that makes hulls; raises CompileError as :func:`library` does."""
    found = HULLS.load()
    for name, (result, arguments) in hulls.FUNCTIONS.items():
        function = getattr(found, name)
        function.restype, function.argtypes = result, arguments
    return found


def pointer(array: NDArray[np.float64]) -> Any:
    """A contiguous array of doubles as C takes it; it has to be kept."""
    return array.ctypes.data_as(Numbers)


def query(function: Any, of: Any, count: int) -> list[float]:
    """Numbers that a function of the part in C++ writes; its last argument is where."""
    values = np.zeros(count)
    function(*of, pointer(values))
    found: list[float] = values.tolist()
    return found


KINDS = ("fixed", "hinge", "slide", "ball", "free")
"""As the part in C++ numbers them."""
SHAPES = ("sphere", "box", "cylinder", "capsule", "plane", "mesh")
CONE = "pyramid-circumscribed"
"""The one that DART's solvers have here."""
DETECTOR = "ode"
"""DART's collision detector, gz-physics' own choice."""
STANDS_FOR = Inertial(1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
"""Written for a body whose inertia SDF does not allow; the part in C++ then sets the body's."""

MOST_RESTITUTION = 1.0
"""libsdformat's bound; DART has none."""


class SdfPlan:
    """The SDF text of a document, and which classes of its units touch: ``classes`` by unit, ``meet`` (classes, classes)."""

    def __init__(self, walk: Walk):
        refuse(walk, NAME, shapes=SHAPES, servos=False, moving_planes=False)
        self.walk, self.document = walk, walk.document
        for solid in walk.shapes:
            if solid.shape.kind == "mesh":
                check_solid(NAME, solid.shape.name, solid.shape.size)
            for copy in solid.shape.copies:
                if copy.torsional_friction or copy.rolling_friction or copy.hardness is not None:
                    name = solid.shape.name
                    raise EngineError(NAME, f"has no torsional or rolling friction, and no hardness, of {name!r}")
        self.names = [f"s{unit.of.owner.row}_{unit.of.place}_{unit.copy.layer}" for unit in walk.units]
        """Of the units in the text."""
        self.text = self._text()
        self.excluded = walk.excluded_keys()
        number = {kind: index for index, kind in enumerate(walk.kinds)}
        self.classes = [number[unit.kind] for unit in walk.units]
        meet = [[walk.meet(entry, other) for other in number] for entry in number]
        self.meet = np.array(meet, dtype=np.uint8).reshape(len(number), len(number))

    def lively(self) -> list[tuple[int, float]]:
        """(unit, restitution) above SDF's bound: the restitution of a pair is a product, with one factor above 1 at most."""
        rows = [(unit.number, unit.copy.restitution) for unit in self.walk.units]
        return [(number, restitution) for number, restitution in rows if restitution > MOST_RESTITUTION]

    def _text(self) -> str:
        """Damping there is DART's own, implicit one, which with an effort against it is armature; springs and damping of the
        world are efforts."""
        shapes: dict[int, list[sdf.SdfShape]] = {}
        for unit, name in zip(self.walk.units, self.names, strict=True):
            solid, copy = unit.of.shape, unit.copy
            surface = sdf.SdfSurface(copy.friction, 0.0, min(copy.restitution, MOST_RESTITUTION), 0.0)
            shape = sdf.SdfShape(name, *_written(solid), solid.pose, surface, None)
            shapes.setdefault(unit.of.owner.row, []).append(shape)
        joints = {}
        for row, placed in enumerate(self.walk.bodies):
            joint = placed.body.joint
            numbers: dict[str, Any] = {}
            if isinstance(joint, AxisJoint):
                limits = {"position_limits": joint.position_limits, "effort_limit": joint.effort_limit}
                damping = joint.armature / self.document.timestep
                numbers = {**limits, "damping": damping, "dry_friction": joint.dry_friction}
            if not isinstance(joint, FreeJoint):
                joints[row] = sdf_joint(self.walk, row, **numbers)
        return sdf_text(self.walk, joints, shapes)


def sdf_joint(walk: Walk, row: int, **numbers: Any) -> sdf.SdfJoint:
    """The joint of a body that is not free; ``numbers``: further fields."""
    joint, parent = walk.bodies[row].body.joint, walk.bodies[row].parent
    axis = joint.axis if isinstance(joint, AxisJoint) else None
    return sdf.SdfJoint(f"j{row}", joint.kind, None if parent < 0 else f"b{parent}", f"b{row}", axis, **numbers)


def sdf_text(
    walk: Walk,
    joints: Mapping[int, sdf.SdfJoint],
    shapes: Mapping[int, Sequence[sdf.SdfShape]] | None = None,
    **changes: Any,
) -> str:
    """The SDF text of a document, a model for each tree, with the ``joints`` and ``shapes`` of bodies by rows; shapes None:
    nothing collides. ``changes``: other fields of the world."""
    solid = shapes is not None

    def link(row: int) -> sdf.SdfLink:
        body, parent = walk.bodies[row].body, walk.bodies[row].parent
        pose = Pose() if isinstance(body.joint, FreeJoint) else body.joint.origin
        inertial = Inertial(body.mass, body.centre_of_mass, body.inertia) if proper(body) else STANDS_FOR
        solids = tuple((shapes or {}).get(row, ()))
        return sdf.SdfLink(f"b{row}", None if parent < 0 else f"b{parent}", pose, inertial, solid, solids)

    models = tuple(
        sdf.SdfModel(
            f"t{root}",
            Pose(),
            False,
            solid,
            tuple(map(link, rows)),
            tuple(joints[row] for row in rows if row in joints),
        )
        for root, rows in walk.trees.items()
    )
    world = sdf.SdfWorld("w", walk.document.timestep, walk.document.gravity, models)
    return Sdf().write(dataclasses.replace(world, **changes))[SDF_WORLD]


def _written(shape: JsonShape) -> tuple[str, tuple[float, ...]]:
    """Kind and size of a shape in the text: a hull is given to DART's detector afterwards, in place of the ball around it."""
    if shape.kind == "mesh":
        return "sphere", (WORLD_SHAPES["mesh"].outer_radius(shape.size),)
    return shape.kind, shape.size


def proper(body: JsonBody) -> bool:
    """Whether SDF and its reader take the inertia of a body: a mass, and moments of something."""
    return proper_inertia(body.mass, body.inertia)


def proper_inertia(mass: float, inertia: Sequence[float]) -> bool:
    """The same of a mass and a tensor."""
    moments = np.linalg.eigvalsh(tensor_of(inertia))
    return bool(mass > 0.0 and moments[0] > 0.0 and moments[0] + moments[1] > moments[2] * (1.0 + 1e-9))


def losses(document: JsonWorld) -> np.ndarray:
    """Of each body's joint damping, stiffness, rest and armature (n, 4)."""
    found = np.zeros((len(document.bodies), 4))
    for row, body in enumerate(document.bodies):
        joint = body.joint
        if isinstance(joint, AxisJoint):
            found[row] = joint.damping, joint.spring_stiffness, joint.spring_rest, joint.armature
        elif isinstance(joint, BallJoint):
            found[row, :2] = joint.damping, joint.spring_stiffness
    return found
