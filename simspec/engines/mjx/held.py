"""What MJX holds, looked at as if it were an ``mjModel``: so that what reads MuJoCo's model reads MJX's, field by field.

An ``mjx.Model`` has MuJoCo's fields under MuJoCo's names, as arrays of JAX or numpy. It has no names of things
and no user data of joints: these, which it does not compute with, are those of the ``mjModel`` that it was made of.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simspec.engines.mjx.importing import Modules

OF_THE_FILE = ("jnt_user",)
"""Fields that MJX does not have, of what it does not compute with: velocity and effort limits, which are simspec's to keep."""


class HeldOption:
    """The options of an ``mjx.Model``, those of its implementation among them."""

    def __init__(self, option: Any):
        self._option = option

    def __getattr__(self, name: str) -> Any:
        return _plain(_either(self._option, name))


class Held:
    """The fields of an ``mjx.Model`` as numpy's arrays, under the names of ``mjModel``. ``file``: the model it was made of."""

    def __init__(self, model: Any, file: Any):
        self._model, self.file = model, file
        self.opt = HeldOption(model.opt)

    def __getattr__(self, name: str) -> Any:
        if name in OF_THE_FILE:
            return getattr(self.file, name)
        return _plain(_either(self._model, name))


def _either(held: Any, name: str) -> Any:
    """A field of MJX's own class, or of its implementation."""
    if name.startswith("__"):
        raise AttributeError(name)
    if name in type(held).__dataclass_fields__ and name != "_impl":
        return getattr(held, name)
    own = held._impl
    if name in type(own).__dataclass_fields__:
        return getattr(own, name)
    raise AttributeError(f"MJX has no field {name}")


def _plain(value: Any) -> Any:
    return np.asarray(value) if hasattr(value, "shape") else value


class HeldMujoco:
    """MuJoCo's module for what reads a :class:`Held`: names are those of its file, models of text become MJX's."""

    def __init__(self, modules: Modules):
        self._mujoco, self._mjx = modules.mujoco, modules.mjx
        self.MjModel = self

    def __getattr__(self, name: str) -> Any:
        return getattr(self._mujoco, name)

    def mj_id2name(self, held: Held, kind: Any, index: int) -> Any:
        """The name of a thing in the file."""
        return self._mujoco.mj_id2name(held.file, kind, index)

    def from_xml_string(self, text: str) -> Held:
        """What MJX holds of a model."""
        file = self._mujoco.MjModel.from_xml_string(text)
        return Held(self._mjx.put_model(file), file)
