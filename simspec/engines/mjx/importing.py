"""MJX and JAX, imported for one processor and double precision."""

from __future__ import annotations

import contextlib
import io
import os
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.errors import EngineError

XLA = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"}
"""What XLA reads from the environment when it begins: one thread, so that the order of sums, and with it the last bit, depends
on nothing but the program."""


@dataclass(frozen=True)
class Modules:
    """The modules that the engine works with."""

    mujoco: Any
    jax: Any
    mjx: Any
    make_condim: Any
    """``collision_driver.make_condim``: the directions of every contact there can be."""


_imported: list[Modules] = []


def import_mjx() -> Modules:
    """The modules, imported once; no thread is started. Raises EngineError where one of them is not installed."""
    if not _imported:
        try:
            with _environment({}):
                _imported.append(_import())
        except ImportError as error:
            raise EngineError("mjx", f"not installed: simspec engines install mjx --yes ({error})") from error
    return _imported[0]


def begin() -> Modules:
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


def _import() -> Modules:
    import jax
    import mujoco

    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_enable_compilation_cache", False)  # see kept.py
    # what makes a program is imported here, once for all processes that are forked from this one
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
    return Modules(mujoco, jax, mjx, collision_driver.make_condim)
