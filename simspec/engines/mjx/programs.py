"""MJX's computations for a model, each as a program that JAX compiles once: from arrays of the state to arrays of the answer.

A program is compiled when it is first called, for the form of this model, or loaded where it was compiled before
(:func:`keep`). The model's arrays are its first argument, flattened once: to flatten an ``mjx.Model`` takes longer than a small
step.
"""

from __future__ import annotations

import contextlib
import enum
import functools
import hashlib
import io
import os
import platform
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit.messages import doing
from simspec.errors import EngineError
from simspec.outputs.files import built, cache_folder, is_there, processor

# MJX and JAX, imported for one processor and double precision.

XLA = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"}
"""Environment variables that XLA reads when it begins: one thread, so that the order of sums, and with it the last bit, depends
on nothing but the program."""


@dataclass(frozen=True)
class MjxModules:
    """The modules that the engine works with."""

    mujoco: Any
    jax: Any
    mjx: Any
    make_condim: Any
    """``collision_driver.make_condim``: the directions of every contact there can be."""


_imported: list[MjxModules] = []


def import_mjx() -> MjxModules:
    """The modules, imported once; no thread is started. Raises EngineError where one of them is not installed."""
    if not _imported:
        try:
            with _environment({}):
                _imported.append(_import())
        except ImportError as error:
            raise EngineError("mjx", f"not installed: simspec engines install mjx --yes ({error})") from error
    return _imported[0]


def begin() -> MjxModules:
    """The modules, and XLA at work."""
    modules = import_mjx()
    if not _begun:
        with _environment(XLA):
            _begun.extend(modules.jax.devices())
    return modules


_begun: list[Any] = []


@contextlib.contextmanager
def _environment(more: Mapping[str, str]) -> Iterator[None]:
    """The environment with ``more`` in it, and as it was afterwards: JAX writes into it."""
    before = dict(os.environ)
    os.environ.update(more)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _import() -> MjxModules:
    import jax
    import mujoco

    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_enable_compilation_cache", False)  # see keep()
    # the makers of a program are imported here, once for all processes that are forked from this one
    import jax.experimental.serialize_executable
    import jaxlib.lapack
    import jaxlib.mlir.dialects.mhlo

    # tracing does this, and a program that is loaded is not traced: it would call functions that are not there
    jaxlib.lapack.prepare_lapack_call("potrf_ffi", np.dtype(np.float64))
    # MJX prints that another of its forms is not installed
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        from mujoco import mjx
        from mujoco.mjx._src import collision_driver
    return MjxModules(mujoco, jax, mjx, collision_driver.make_condim)


# Programs that were compiled before, in the user's cache: to trace and compile one takes 1 to 15 s, to load it 0.05 to 0.5.
#
# A program follows from the forms of what it is given, which for MJX is also every number that it unrolls loops by, and from
# the packages that trace and compile it. Its name is a hash of all that. XLA's own cache is not used in addition: a program is
# then traced first, and one that came out of that cache cannot be kept (measured: a function of it is not found when it is
# loaded again).

FOLDER = "mjx"
MOST = 512
"""Programs that are kept, of 0.1 to 8 MB: those that were used last."""
PATIENCE = 10.0
"""s that one waits for another process to have put a program there; then this one is not kept."""
DIGEST = hashlib.sha256().digest_size


def name_of(program: str, *given: Any) -> str | None:
    """The name of the program ``program`` for the forms of ``given``, trees of arrays; None where something in them is not
    known to be identified by its text. Programs of one name are the same to the last bit."""
    from jax import tree_util

    digest = hashlib.sha256(_maker())
    try:
        _add(digest, (program, len(given)))
        for entry in given:
            leaves, form = tree_util.tree_flatten(entry)
            _add_form(digest, form)
            _add(digest, [(np.shape(leaf), np.dtype(leaf.dtype).str) for leaf in leaves])
    except TypeError:
        return None
    return digest.hexdigest()


def loaded(name: str, given: Any, answer: Any) -> Callable[..., Any] | None:
    """The program of that name; None where there is none that is whole. ``given``, ``answer``: trees of the forms of its
    arguments and of what it gives."""
    from jax import errors, tree_util
    from jax.experimental import serialize_executable

    folder = cache_folder(FOLDER)
    if folder is None:
        return None
    place = folder / name
    try:
        if not is_there(place):
            return None
        kept = place.read_bytes()
    except OSError:
        return None
    if hashlib.sha256(kept[DIGEST:]).digest() != kept[:DIGEST]:
        return None
    forms = tree_util.tree_structure((given, {})), tree_util.tree_structure(answer)
    try:
        found: Callable[..., Any] = serialize_executable.deserialize_and_load(kept[DIGEST:], *forms)
    except (errors.JaxRuntimeError, ValueError):  # compiled for another processor, whatever this one says of itself
        return None
    return found


def keep(name: str, program: Any) -> None:
    """Keep a program that was compiled just now, if the user's cache takes it."""
    from jax.experimental import serialize_executable

    folder = cache_folder(FOLDER)
    if folder is None:
        return
    content, _, _ = serialize_executable.serialize(program)
    whole = hashlib.sha256(content).digest() + content
    with contextlib.suppress(OSError):
        built(folder / name, functools.partial(_write, whole), PATIENCE, anew=True, keep=MOST)


def _write(content: bytes, place: Path) -> None:
    place.write_bytes(content)


@functools.cache
def _maker() -> bytes:
    """Inputs of tracing and compiling: packages, this package's code, their environment variables, the processor."""
    import jax
    import jaxlib
    import mujoco

    given = {name: value for name, value in sorted(os.environ.items()) if name.startswith(("JAX_", "XLA_", "MJX_"))}
    code = Path(__file__).read_bytes()
    parts = [version("mujoco-mjx"), mujoco.__version__, jax.__version__, jaxlib.__version__, np.__version__]
    parts += [platform.python_version(), *processor(), repr(given), repr(XLA), hashlib.sha256(code).hexdigest()]
    return "\0".join(parts).encode()


def _add_form(digest: Any, form: Any) -> None:
    """The form of a tree: kinds of nodes, what they are made by, and their parts."""
    node = form.node_data()
    if node is None:  # a leaf
        digest.update(b"*")
        return
    kind, given = node
    parts = form.children()
    digest.update(f"{kind.__module__}.{kind.__qualname__} {len(parts)} ".encode())
    _add(digest, given)
    for part in parts:
        _add_form(digest, part)


def _add(digest: Any, value: Any) -> None:
    """A value by its kind and its text. Raises TypeError for one whose text may not say all of it."""
    value = getattr(value, "array", value)  # MJX's wrapper of arrays of numpy
    if isinstance(value, enum.Enum):
        digest.update(f"{type(value).__qualname__}.{value.value!r};".encode())
    elif value is None or isinstance(value, bool | int | float | str | bytes):
        text = repr(value)
        digest.update(f"{type(value).__name__} {len(text)} {text};".encode())
    elif isinstance(value, np.ndarray | np.generic) and value.dtype != object:
        digest.update(f"array {value.dtype.str} {value.shape};".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, tuple | list):
        digest.update(f"{type(value).__name__} {len(value)};".encode())
        for entry in value:
            _add(digest, entry)
    else:
        raise TypeError(f"{type(value)} is not identified by a text")


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


class MjxPrograms:
    """The programs of ``model`` (``mjx.Model``)."""

    def __init__(self, modules: MjxModules, model: Any):
        self._modules, self._model = modules, model

    @functools.cached_property
    def blank(self) -> Any:
        """The data of the default state, from which every step begins but for what it is given."""
        return self._modules.mjx.make_data(self._model)

    @functools.cached_property
    def _arrays(self) -> tuple[Any, Any]:
        flatten = self._modules.jax.tree_util.tree_flatten
        actual, self._model_form = flatten(_bare(self._model))
        blank, self._blank_form = flatten(self.blank)
        return actual, blank

    def run(self, name: str, *given: Numbers | np.int64) -> Arrays:
        """The arrays of a program (:data:`ANSWERS`), for positions, velocities and, for ``step``, the accelerations of the step
        before, efforts and the number of steps."""
        arrays = self._arrays
        key = (name, self._model_form, self._blank_form)
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
        work = _Work(jax, self._modules.mjx, self._model_form, self._blank_form)
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
    """The functions of the programs, for any model and data of these forms."""

    def __init__(self, jax: Any, mjx: Any, actual_form: Any, blank_form: Any):
        self.jax, self._mjx = jax, mjx
        self.model_form, self.blank_form = actual_form, blank_form

    def _begun(self, arrays: Any, q: Any, v: Any) -> tuple[Any, Any]:
        actual, blank = arrays
        model, data = self.model_form.unflatten(actual), self.blank_form.unflatten(blank)
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
        impl = data._impl
        return {
            **{"q": data.qpos, "v": data.qvel, "warm": data.qacc_warmstart, "force": impl.efc_force},
            **self._contacts(impl.contact),
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
