"""What MJX holds, looked at as if it were an ``mjModel``: so that what reads MuJoCo's model reads MJX's, field by field.

An ``mjx.Model`` has MuJoCo's fields under MuJoCo's names, as arrays of JAX or numpy. What MJX does not take over, since it does
not compute with it (names of things, user data, options of MuJoCo's own solvers), is what the ``mjModel`` has that it was made
of: so a file that says something else than the world is noticed there, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np


class HeldOption:
    """The options of an ``mjx.Model``, those of its implementation among them."""

    def __init__(self, option: Any, file: Any):
        self._option, self._file = option, file

    def __getattr__(self, name: str) -> Any:
        return _plain(_either(self._option, self._file, name))


class Held:
    """The fields of an ``mjx.Model`` as numpy's arrays, under the names of ``mjModel``. ``file``: the model it was made of."""

    def __init__(self, model: Any, file: Any):
        self._model, self.file = model, file
        self.opt = HeldOption(model.opt, file.opt)

    def __getattr__(self, name: str) -> Any:
        return _plain(_either(self._model, self.file, name))


def _either(held: Any, file: Any, name: str) -> Any:
    """A field of MJX's own class, or of its implementation, or else of the file."""
    if name.startswith("__"):
        raise AttributeError(name)
    if name in type(held).__dataclass_fields__ and name != "_impl":
        return getattr(held, name)
    own = held._impl
    if name in type(own).__dataclass_fields__:
        return getattr(own, name)
    return getattr(file, name)


def _plain(value: Any) -> Any:
    return np.asarray(value) if hasattr(value, "shape") else value
