"""What MJX computes for one model, each as a program that JAX compiles once: from arrays of the state to arrays of the answer.

A program is compiled when it is first called, for the shapes of this model. The model's arrays are its first argument,
flattened once: to flatten an ``mjx.Model`` takes longer than a small step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.engines.mjx.importing import Modules

Arrays = Mapping[str, Any]
Numbers = NDArray[np.float64]


class Programs:
    """The programs of ``model`` (``mjx.Model``)."""

    def __init__(self, modules: Modules, model: Any):
        flatten = modules.jax.tree_util.tree_flatten
        self.blank = modules.mjx.make_data(model)
        """The data of a state that nobody has set, from which every step begins but for what it is given."""
        held, held_form = flatten(model)
        blank, blank_form = flatten(self.blank)
        self._arrays = (held, blank)
        self._work = _Work(modules.jax, modules.mjx, held_form, blank_form)

    def step(self, q: Numbers, v: Numbers, warm: Numbers, effort: Numbers, count: int) -> Arrays:
        """``count`` steps from a state, begun at the accelerations ``warm`` of the step before; with the contacts and
        constraint forces of the last one."""
        return self._asked("step", q, v, warm, effort, np.int64(count))

    def place(self, q: Numbers, v: Numbers) -> Arrays:
        """Where bodies and sites are."""
        return self._asked("place", q, v)

    def move(self, q: Numbers, v: Numbers) -> Arrays:
        """Where they are, and how bodies move."""
        return self._asked("move", q, v)

    def weigh(self, q: Numbers, v: Numbers) -> Arrays:
        """The mass matrix (nv, nv), armature of joints and tendons included."""
        return self._asked("weigh", q, v)

    def bias(self, q: Numbers, v: Numbers) -> Arrays:
        """The bias force, gravity included."""
        return self._asked("bias", q, v)

    def touch(self, q: Numbers, v: Numbers) -> Arrays:
        """All contacts there can be, in a state."""
        return self._asked("touch", q, v)

    def _asked(self, name: str, *given: Numbers | np.int64) -> Arrays:
        key = (name, self._work.held_form, self._work.blank_form)
        if key not in _COMPILED:
            if len(_COMPILED) >= MOST_COMPILED:
                _COMPILED.clear()
            traced = self._work.jax.jit(getattr(self._work, name))
            _COMPILED[key] = traced.lower(self._arrays, *given).compile()
        return _COMPILED[key](self._arrays, *given)


MOST_COMPILED = 64
"""Programs that a process keeps."""
_COMPILED: dict[tuple[Any, ...], Callable[..., Arrays]] = {}
"""By name and the forms of model and data, which worlds share that differ in numbers alone: tracing takes seconds. Compiled for
the forms of what is first given, since ``jax.jit`` would trace again where an array of numpy becomes one of JAX."""


class _Work:
    """What programs do, of any model and data of these forms."""

    def __init__(self, jax: Any, mjx: Any, held_form: Any, blank_form: Any):
        self.jax, self._mjx = jax, mjx
        self.held_form, self.blank_form = held_form, blank_form

    def _begun(self, arrays: Any, q: Any, v: Any) -> tuple[Any, Any]:
        held, blank = arrays
        model, data = self.held_form.unflatten(held), self.blank_form.unflatten(blank)
        return model, data.replace(qpos=q, qvel=v)

    def _placed(self, arrays: Any, q: Any, v: Any) -> tuple[Any, Any]:
        model, data = self._begun(arrays, q, v)
        return model, self._mjx.com_pos(model, self._mjx.kinematics(model, data))

    def step(self, arrays: Any, q: Any, v: Any, warm: Any, effort: Any, count: Any) -> Arrays:
        model, data = self._begun(arrays, q, v)
        data = data.replace(qacc_warmstart=warm, qfrc_applied=effort)
        data = self.jax.lax.fori_loop(
            0, count, lambda _, before: self._same_forms(self._mjx.step(model, before), before), data
        )
        own = data._impl
        return {
            **{"q": data.qpos, "v": data.qvel, "warm": data.qacc_warmstart, "force": own.efc_force},
            **self._contacts(own.contact),
        }

    def _same_forms(self, after: Any, before: Any) -> Any:
        """The data of a step with the kinds of numbers of the one before: MJX makes integers longer, which no loop takes."""
        return self.jax.tree_util.tree_map(lambda new, old: new.astype(old.dtype), after, before)

    @staticmethod
    def _contacts(contact: Any) -> Arrays:
        names = ("dist", "pos", "frame", "includemargin", "geom")
        return {name: getattr(contact, name) for name in names}

    def place(self, arrays: Any, q: Any, v: Any) -> Arrays:
        return self._places(self._placed(arrays, q, v)[1])

    @staticmethod
    def _places(data: Any) -> Arrays:
        return {
            name: _either(data, name) for name in ("xpos", "xquat", "xipos", "site_xpos", "site_xmat", "subtree_com")
        }

    def move(self, arrays: Any, q: Any, v: Any) -> Arrays:
        model, data = self._placed(arrays, q, v)
        data = self._mjx.com_vel(model, data)
        return {**self._places(data), "cvel": _either(data, "cvel")}

    def weigh(self, arrays: Any, q: Any, v: Any) -> Arrays:
        model, data = self._placed(arrays, q, v)
        data = self._mjx.crb(model, self._mjx.tendon(model, data))
        return {"mass": self._mjx.full_m(model, self._mjx.tendon_armature(model, data))}

    def bias(self, arrays: Any, q: Any, v: Any) -> Arrays:
        model, data = self._placed(arrays, q, v)
        data = self._mjx.rne(model, self._mjx.com_vel(model, data))
        lifted = self._mjx.passive(model, self._mjx.tendon(model, data)).qfrc_gravcomp
        return {"bias": data.qfrc_bias - lifted}

    def touch(self, arrays: Any, q: Any, v: Any) -> Arrays:
        model, data = self._placed(arrays, q, v)
        return self._contacts(self._mjx.collision(model, data)._impl.contact)


def _either(data: Any, name: str) -> Any:
    """A field of MJX's data, which some releases keep with what is JAX's own."""
    return getattr(data, name) if hasattr(data, name) else getattr(data._impl, name)


def as_numpy(arrays: Arrays) -> SimpleNamespace:
    """The arrays of an answer, as numpy's own that may be written to."""
    return SimpleNamespace(**{name: np.array(value) for name, value in arrays.items()})
