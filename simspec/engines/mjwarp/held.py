"""What MuJoCo Warp holds, looked at as if it were an ``mjModel``: what reads MuJoCo's model reads Warp's, field by field.

A model of Warp has MuJoCo's fields under MuJoCo's names, of single precision, with one more dimension where several worlds may
differ. What it does not take over, since it does not compute with it (names of things, user data, keyframes), is what the
``mjModel`` has that it was made of: so a file that says something else than the world is noticed there, too.
"""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from simspec.engines.mjwarp.importing import ENGINE
from simspec.errors import EngineError

LAWS = ("timestep", "*solref*", "*solimp*", "o_*")
"""Fields whose numbers are told apart by more digits than singles have: an error reduction is a quotient by the timestep's
square. A single stands for every number that is rounded to it: these fields are told as MuJoCo's where that is one of them."""
LACKED = ("mjDSBL_AUTORESET",)
"""Flags of what Warp does not have, so that it is always as these say: Warp refuses a model that has them."""


class HeldOption:
    """The options of a model of Warp."""

    def __init__(self, option: Any, file: Any, lacked: int):
        self._option, self._file, self._lacked = option, file, lacked

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if name == "impratio":  # Warp keeps one over its root
            return float(1.0 / np.square(self._option.impratio_invsqrt.numpy().astype(float))[0])
        if name == "disableflags":
            return int(self._option.disableflags) | (int(self._file.disableflags) & self._lacked)
        return _either(self._option, self._file, name)


class Held:
    """The fields of a model of Warp as numpy's arrays, in the shapes of ``mjModel``'s. ``file``: the model it was made of."""

    def __init__(self, model: Any, file: Any, lacked: int):
        self._model, self.file = model, file
        self.opt = HeldOption(model.opt, file.opt, lacked)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _either(self._model, self.file, name)


def _either(held: Any, file: Any, name: str) -> Any:
    """A field that Warp has under MuJoCo's name, or else the file's."""
    told = getattr(file, name)
    if name not in type(held).__dataclass_fields__:
        return told
    own = getattr(held, name)
    if not hasattr(own, "numpy"):
        return own
    found, like = np.asarray(own.numpy()), np.asarray(told)
    if found.size != like.size:
        raise EngineError(ENGINE, f"holds {found.size} numbers of {name}, MuJoCo {like.size}")
    found = found.reshape(like.shape).astype(like.dtype)
    if any(fnmatchcase(name, law) for law in LAWS):
        found = np.where(like.astype(np.float32) == found.astype(np.float32), like, found)
    return found if like.shape else found.item()
