"""Programs that were compiled before, in the user's cache: to trace and compile one takes 1 to 15 s, to load it 0.05 to 0.5.

A program follows from the forms of what it is given, which for MJX is also every number that it unrolls loops by, and from what
traces and compiles it. Its name is a hash of all that. XLA's own cache is not used beside it: a program is then traced first,
and one that came out of that cache cannot be kept (measured: a function of it is not found when it is loaded again).
"""

from __future__ import annotations

import contextlib
import enum
import functools
import hashlib
import os
import platform
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from simspec.engines.mjx.importing import XLA
from simspec.outputs.cache import built, cache_folder, is_there
from simspec.outputs.processor import processor

FOLDER = "mjx"
MOST = 512
"""Programs that are kept, of 0.1 to 8 MB: those that were used last."""
MAKERS = ("programs.py", "importing.py", "kept.py")
"""The modules of this package that programs follow from."""
PATIENCE = 10.0
"""s that one waits for another process to have put a program there; then this one is not kept."""
DIGEST = hashlib.sha256().digest_size


def name_of(program: str, *given: Any) -> str | None:
    """The name of the program ``program`` for the forms of ``given``, trees of arrays; None where something in them is not
    known to be told by its text. Programs of one name are the same to the last bit."""
    from jax import tree_util

    digest = hashlib.sha256(_maker())
    try:
        _add(digest, (program, len(given)))
        for one in given:
            leaves, form = tree_util.tree_flatten(one)
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
    """What traces and compiles: packages, this one's own code, what they are told by the environment, the processor."""
    import jax
    import jaxlib
    import mujoco

    told = {name: value for name, value in sorted(os.environ.items()) if name.startswith(("JAX_", "XLA_", "MJX_"))}
    code = b"".join((Path(__file__).parent / name).read_bytes() for name in MAKERS)
    parts = [version("mujoco-mjx"), mujoco.__version__, jax.__version__, jaxlib.__version__, np.__version__]
    parts += [platform.python_version(), *processor(), repr(told), repr(XLA), hashlib.sha256(code).hexdigest()]
    return "\0".join(parts).encode()


def _add_form(digest: Any, form: Any) -> None:
    """The form of a tree: kinds of nodes, what they are made by, and their parts."""
    node = form.node_data()
    if node is None:  # a leaf
        digest.update(b"*")
        return
    kind, told = node
    parts = form.children()
    digest.update(f"{kind.__module__}.{kind.__qualname__} {len(parts)} ".encode())
    _add(digest, told)
    for part in parts:
        _add_form(digest, part)


def _add(digest: Any, value: Any) -> None:
    """A value by its kind and its text. Raises TypeError for one whose text may not say all of it."""
    value = getattr(value, "array", value)  # what MJX wraps its arrays of numpy in
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
        for one in value:
            _add(digest, one)
    else:
        raise TypeError(f"{type(value)} is not told by a text")
