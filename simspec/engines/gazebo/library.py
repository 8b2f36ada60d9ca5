"""gz-physics and the part in C++ that hosts it (``host/``), which is compiled on first use, by ctypes.

Facts marked *measured* in this package: gz-physics 5.1.0 (ignition-physics5), its engine dartsim on libdart 6.12.1, libsdformat
12.3.0, as Debian 12 has them.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit import hulls
from simspec.engines.kit.compiled import Compiled
from simspec.engines.kit.needs import Needs

NAME = "gazebo"
PACKAGE = "ignition-physics5"
FOLDER = Path(__file__).parent / "host"
HEADERS = ("simspec_gazebo.h", "load.cc", "motion.cc", "contact.cc", "friction.cc")
PART = Compiled(
    NAME,
    "gazebo-host",
    (FOLDER / "host.cc",),
    language="C++",
    headers=tuple(FOLDER / name for name in HEADERS),
    packages=(PACKAGE, "ignition-physics5-sdf", "ignition-plugin1-loader", "sdformat12", "dart"),
    flags=("-O1", "-ffp-contract=off"),
    links=("-std=c++17",),  # the last word on it: DART's package says c++11
)
HULLS = Compiled(
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
        ("libdart-dev", "what dartsim is made of"),
        ("libode-dev", "what its detector is made of"),
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
    "gz_apart": (None, (Pointer, ctypes.POINTER(ctypes.c_ubyte))),
    "gz_no_contact": (None, (Pointer,)),
    "gz_contact_count": (Integer, (Pointer,)),
    "gz_contacts": (None, (Pointer, Integers, Numbers)),
    "gz_touching": (Integer, (Pointer, Integers, Integer)),
    "gz_body_numbers": (Integer, ()),
    "gz_body": (None, (Pointer, Integer, Numbers)),
    "gz_own": (None, (Pointer, Integer, Numbers)),
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


class Library:
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
def library() -> Library:
    """gz-physics. Raises CompileError, an EngineError, where it, or a compiler, is not there."""
    return Library(PART.load())


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


def asked(function: Any, of: Any, count: int) -> list[float]:
    """Numbers that a function of the part in C++ writes; its last argument is where."""
    held = np.zeros(count)
    function(*of, pointer(held))
    found: list[float] = held.tolist()
    return found
