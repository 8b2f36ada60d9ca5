"""What MJX computes for one model, each as a program that JAX compiles once: from arrays of the state to arrays of the answer.

A program is compiled when it is first called, for the form of this model, or loaded where it was compiled before
(``kept.py``). The model's arrays are its first argument, flattened once: to flatten an ``mjx.Model`` takes longer than a small
step.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from fnmatch import fnmatchcase
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit.doing import doing
from simspec.engines.mjx.importing import Modules
from simspec.engines.mjx.kept import keep, loaded, name_of

Arrays = Mapping[str, Any]
Numbers = NDArray[np.float64]
CONTACTS = ("dist", "pos", "frame", "includemargin", "geom")
PLACES = ("xpos", "xquat", "xipos", "site_xpos", "site_xmat", "subtree_com")
ANSWERS: Mapping[str, tuple[str, ...]] = {
    "step": ("q", "v", "warm", "force", *CONTACTS),
    "place": PLACES,
    "move": (*PLACES, "cvel"),
    "weigh": ("mass",),
    "bias": ("bias",),
    "touch": CONTACTS,
}
"""The programs, and what each gives."""
NOT_COMPUTED = ("names", "name_*adr", "key_*", "geom_group", "signature")
"""Fields that no program computes with, and by which JAX would tell one form of a model from another."""


class Programs:
    """The programs of ``model`` (``mjx.Model``)."""

    def __init__(self, modules: Modules, model: Any):
        self._modules, self._model = modules, model

    @functools.cached_property
    def blank(self) -> Any:
        """The data of a state that nobody has set, from which every step begins but for what it is given."""
        return self._modules.mjx.make_data(self._model)

    @functools.cached_property
    def _arrays(self) -> tuple[Any, Any]:
        flatten = self._modules.jax.tree_util.tree_flatten
        held, self._held_form = flatten(_bare(self._model))
        blank, self._blank_form = flatten(self.blank)
        return held, blank

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
        arrays = self._arrays
        key = (name, self._held_form, self._blank_form)
        if key not in _COMPILED:
            if len(_COMPILED) >= MOST_COMPILED:
                _COMPILED.clear()
            _COMPILED[key] = self._made(name, given)
        return _COMPILED[key](arrays, *given)

    def _made(self, name: str, given: tuple[Numbers | np.int64, ...]) -> Callable[..., Arrays]:
        """A program that was compiled before, or is now."""
        jax, arrays = self._modules.jax, self._arrays
        kept = name_of(name, _bare(self._model), self.blank, given)
        found = loaded(kept, (arrays, *given), dict.fromkeys(ANSWERS[name], 0)) if kept is not None else None
        if found is not None:
            return found
        work = _Work(jax, self._modules.mjx, self._held_form, self._blank_form)
        with doing(f"compiling “{name}” for this model"):
            made: Callable[..., Arrays] = jax.jit(getattr(work, name)).lower(arrays, *given).compile()
        if kept is not None:
            keep(kept, made)
        return made


def _bare(model: Any) -> Any:
    """A model without what no program computes with, so that models which differ in that alone have one form."""
    rows = [
        name
        for name in type(model).__dataclass_fields__
        if any(map(functools.partial(fnmatchcase, name), NOT_COMPUTED))
    ]
    return model.replace(**{name: _nothing(getattr(model, name)) for name in rows})


def _nothing(value: Any) -> Any:
    """A value of the same kind that says nothing: zeros, no text."""
    return np.zeros_like(value) if isinstance(value, np.ndarray) else type(value)()


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
        return {name: getattr(contact, name) for name in CONTACTS}

    def place(self, arrays: Any, q: Any, v: Any) -> Arrays:
        return self._places(self._placed(arrays, q, v)[1])

    @staticmethod
    def _places(data: Any) -> Arrays:
        return {name: _either(data, name) for name in PLACES}

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
